//! `harmony completions` and `harmony man`: made from the command line's own definitions.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Command;

use crate::{EXIT_OK, say};

/// Arguments of `harmony completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  harmony completions bash > ~/.local/share/bash-completion/completions/harmony")]
pub struct CompletionArgs {
    /// For which shell.
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

/// Arguments of `harmony man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  harmony man --out ~/.local/share/man/man1")]
pub struct ManArgs {
    /// Folder for the pages, one a command; made when absent.
    #[arg(long, short)]
    out: PathBuf,
}

/// Prints the completions of a shell.
///
/// # Errors
/// The output cannot be written.
pub fn completions(args: &CompletionArgs, mut command: Command) -> Result<u8> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command, "harmony", &mut text);
    say!("{}", String::from_utf8_lossy(&text).trim_end())?;
    Ok(EXIT_OK)
}

/// Writes man pages: `harmony.1`, `harmony-reconstruct.1` and so on.
///
/// # Errors
/// The folder cannot be written.
pub fn man(args: &ManArgs, command: Command) -> Result<u8> {
    std::fs::create_dir_all(&args.out).with_context(|| format!("making {}", args.out.display()))?;
    clap_mangen::generate_to(command, &args.out).with_context(|| format!("writing {}", args.out.display()))?;
    Ok(EXIT_OK)
}
