//! `harmony record`.

use std::path::PathBuf;

use anyhow::Result;
use harmony_calls::{RecordingAbout, export_recording};
use harmony_roles::Role;

use crate::{EXIT_OK, say};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  harmony record run --out recording --label kitchen --made-by \"Ada, by hand\"")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Folder of the recording; made when absent.
    #[arg(long, short)]
    out: PathBuf,
    /// Short name of the recording.
    #[arg(long)]
    label: String,
    /// Who or what gave the answers, in words; shown wherever the recording is used.
    #[arg(long)]
    made_by: String,
    /// Licence of the answers.
    #[arg(long, default_value = "CC0-1.0")]
    license: String,
    /// Take along meshes, edited pictures, masks and point maps too, so that the run can be replayed without any
    /// player. Edited pictures show parts of the photo.
    #[arg(long)]
    everything: bool,
}

/// Runs the command.
///
/// # Errors
/// A run without answers, or an unwritable folder.
pub fn run(args: &Args) -> Result<u8> {
    let mut about = RecordingAbout::texts(&args.label, &args.made_by, &args.license);
    if args.everything {
        about.roles = Role::ALL.to_vec();
    }
    let count = export_recording(&args.run, &args.out, &about)?;
    say!("{count} answers in {}", args.out.display())?;
    Ok(EXIT_OK)
}
