//! The program `harmony`; everything is in the library beside it.

use std::process::ExitCode;

fn main() -> ExitCode {
    // As its own child it evaluates one modelling program and does nothing else.
    if std::env::args_os().nth(1).is_some_and(|first| first == harmony_program::CHILD_COMMAND) {
        return harmony_program::child_main();
    }
    harmony_cli::run(std::env::args_os())
}
