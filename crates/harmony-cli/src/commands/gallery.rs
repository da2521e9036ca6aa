//! `harmony gallery`: canonical views of many runs, contact sheets, turntables.

use std::path::PathBuf;

use anyhow::Result;
use harmony_dataset::gallery::{GalleryOptions, find_runs, make};

use super::dataset::failed;
use crate::{EXIT_INCOMPLETE, EXIT_OK, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  harmony gallery run --out gallery --frames 12")]
pub struct Args {
    /// Run folders, or folders that hold them; scenes of a data set, too.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Folder of the gallery; must not exist.
    #[arg(long, short)]
    out: PathBuf,
    /// Columns of a picture, pixels.
    #[arg(long, default_value_t = 1280, value_parser = clap::value_parser!(u32).range(64..=4096))]
    width: u32,
    /// Pictures of a turntable; 0 = no turntables.
    #[arg(long, default_value_t = 36, value_parser = clap::value_parser!(u32).range(0..=360))]
    frames: u32,
    /// Columns of a turntable, pixels.
    #[arg(long, default_value_t = 480, value_parser = clap::value_parser!(u32).range(64..=1920))]
    turntable_width: u32,
    /// Columns of the contact sheets.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    columns: u32,
}

/// Runs the command.
///
/// # Errors
/// No run, or a folder that exists.
pub fn run(args: &Args) -> Result<u8> {
    let options = GalleryOptions {
        width: args.width,
        frames: args.frames as usize,
        turntable_width: args.turntable_width,
        columns: args.columns,
        ..GalleryOptions::default()
    };
    let runs = find_runs(&args.runs).map_err(failed)?;
    let shown = make(&runs, &args.out, &options).map_err(failed)?;
    let failed =
        shown.iter().filter(|s| !s.failed.is_empty()).inspect(|s| tell!("not shown: {}: {}", s.name, s.failed)).count();
    let lit = shown.iter().filter(|s| s.lit).count();
    say!("{}: {} runs, {lit} of them path-traced", args.out.join("index.html").display(), shown.len() - failed)?;
    Ok(if failed == 0 { EXIT_OK } else { EXIT_INCOMPLETE })
}
