//! The child process alone, for tests and for programs that are not `harmony`.

use std::process::ExitCode;

fn main() -> ExitCode {
    harmony_program::child_main()
}
