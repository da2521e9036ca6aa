//! The program `harmony`; everything is in the library beside it.

use std::process::ExitCode;

fn main() -> ExitCode {
    // Before anything else: a child that runs a modelling program reads no configuration and opens no file.
    if std::env::args_os().nth(1).is_some_and(|first| first == harmony_program::CHILD_COMMAND) {
        return harmony_program::child_main();
    }
    harmony_cli::run(std::env::args_os())
}
