//! The program `harmony`; everything is in the library beside it.

use std::process::ExitCode;

fn main() -> ExitCode {
    harmony_cli::run(std::env::args_os())
}
