//! `harmony export`: the scene of a run as files of other programs, read back and compared.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use harmony_export::{Budget, ExportError, Format, GlbOptions, Options, World};

use crate::display::hinted;
use crate::{EXIT_ERROR, EXIT_OK, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony export run --to usd,mjcf --check
  harmony export run --to glb --faces 100000 --texture 1024 --out small")]
#[expect(clippy::struct_excessive_bools, reason = "switches of a command line")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Formats, several with commas: glb, usd, usdz, mjcf, urdf, blend, obj, plan.
    #[arg(long, value_delimiter = ',', value_parser = format)]
    to: Vec<Format>,
    /// Where to write; default `<run>/export`.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Read the files back and compare them with the scene; without --to those of an earlier export.
    #[arg(long)]
    check: bool,
    /// Triangles of the whole scene at most (of meshes that can be simplified).
    #[arg(long, value_parser = clap::value_parser!(u32).range(100..=20_000_000))]
    faces: Option<u32>,
    /// Longest side of textures, pixels.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(4..=8192))]
    texture: Option<u32>,
    /// Put coarser forms of each object into GLB files (MSFT_lod).
    #[arg(long)]
    lods: bool,
    /// Textures of GLB files as lossy WebP (EXT_texture_webp); readers must know it.
    #[arg(long)]
    webp: bool,
    /// Pack geometry of GLB files (EXT_meshopt_compression); readers must know it.
    #[arg(long)]
    meshopt: bool,
}

fn format(text: &str) -> Result<Format, String> {
    text.trim().parse().map_err(|e: ExportError| e.to_string())
}

/// Where convex decompositions are kept: where `harmony simulate` left some, else beside the exports.
fn hulls(run: &Path, folder: &Path) -> PathBuf {
    let simulated = run.join("7_world/hulls");
    if simulated.is_dir() { simulated } else { folder.join("hulls") }
}

fn told(error: &ExportError) -> anyhow::Error {
    hinted(error.to_string(), error.hint())
}

/// Runs the command.
///
/// # Errors
/// A folder that is no run, an object that cannot be exported, an unwritable file.
pub fn run(args: &Args) -> Result<u8> {
    if args.to.is_empty() && !args.check {
        bail!("nothing to do: name formats with --to, or give --check to read an earlier export back");
    }
    let world = World::read(&args.run).map_err(|e| told(&e))?;
    for note in &world.notes {
        tell!("note: {note}");
    }
    let folder = args.out.clone().unwrap_or_else(|| args.run.join("export"));
    let options = Options {
        budget: Budget { faces: args.faces.map(|f| f as usize), texture: args.texture },
        glb: GlbOptions { lods: args.lods, webp: args.webp, meshopt: args.meshopt },
        cache: Some(hulls(&args.run, &folder)),
    };
    if !args.to.is_empty() {
        let mut formats = args.to.clone();
        formats.sort_unstable();
        formats.dedup();
        let files = harmony_export::export(&world, &formats, &folder, &options).map_err(|e| told(&e))?;
        let bytes: usize = files.iter().map(|(_, b)| b.len()).sum();
        let names: Vec<&str> = formats.iter().map(|f| f.name()).collect();
        let count = files.iter().count();
        say!("{}: {} in {count} files, {:.1} MB", folder.display(), names.join(", "), bytes as f64 / 1e6)?;
    }
    if args.check {
        let report = harmony_export::check(&world, &folder, options.cache.as_deref()).map_err(|e| told(&e))?;
        for file in &report.files {
            let colliders = if file.colliders > 0 { format!(", {} colliders", file.colliders) } else { String::new() };
            say!("{}: {} objects, {} triangles{colliders}", file.file, file.objects, file.triangles)?;
        }
        for difference in &report.differences {
            tell!("error: {difference}");
        }
        if !report.differences.is_empty() {
            tell!("{} differences between the files and the scene", report.differences.len());
            return Ok(EXIT_ERROR);
        }
        say!("{} files hold the scene", report.files.len())?;
    }
    Ok(EXIT_OK)
}
