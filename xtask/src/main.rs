//! Developer commands: `cargo xtask --help`.
#![expect(clippy::print_stdout, reason = "a program")]

mod deps;
mod dist;
mod image_nets;
mod paper;
mod parity;

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::{Parser, Subcommand, ValueEnum};

/// Developer commands.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Checks docs/paper-map.md against the code: files and items exist, keys are those that doc comments quote.
    Paper,
    /// Checks which crate uses which against xtask/layers.toml, and the table of crates in ARCHITECTURE.md.
    Deps,
    /// Packages the program: stripped, with completions, man pages, licences, a list of its parts (CycloneDX), checksums.
    Dist(dist::Options),
    /// Compares networks of full size with their reference implementations in PyTorch, with seeded random weights.
    ///
    /// About 25 GB of disk, 12 GB of memory. HARMONY_VGGT: a checkout of the VGGT authors' repository (default: the
    /// cache's folder vggt); HARMONY_SAM2: a checkout of facebookresearch/sam2 (default: the cache's folder sam2);
    /// HARMONY_CACHE: where Python, weights and outputs go (default: ~/.cache/harmony).
    Parity {
        /// Only these networks.
        only: Option<Networks>,
        /// Also times both in turn, so often.
        #[arg(long, default_value_t = 0)]
        rounds: usize,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Networks {
    /// Those of images: SAM 2, OWLv2, CLIP, LPIPS.
    Images,
}

/// The checkout that this was started in. Asked when it runs: checkouts that share a target folder share this program too,
/// and the path it was compiled in may be another's.
fn root() -> PathBuf {
    let manifest = std::env::var_os("CARGO_MANIFEST_DIR");
    manifest.map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from).join("..")
}

fn main() -> Result<()> {
    let root = root();
    match Arguments::parse().command {
        Command::Paper => told("docs/paper-map.md", &paper::check(&root)?),
        Command::Deps => told("crates", &deps::check(&root)?),
        Command::Dist(options) => dist::run(&root, &options),
        Command::Parity { only, rounds } => {
            if only.is_none() {
                parity::run(rounds)?;
            }
            image_nets::run(rounds)
        }
    }
}

/// Prints what is wrong; an error when anything is.
fn told(what: &str, complaints: &[String]) -> Result<()> {
    for complaint in complaints {
        println!("{complaint}");
    }
    if complaints.is_empty() {
        println!("{what}: in order");
        return Ok(());
    }
    bail!("{what}: {} complaints", complaints.len())
}
