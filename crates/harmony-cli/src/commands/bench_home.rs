//! `harmony bench home`: homes with known truth, reconstructed room by room, built and judged.

use std::path::PathBuf;

use anyhow::Result;
use harmony_bench::homes::{HomesRequest, PlacedBy, folder, judge, reconstruct, table};
use harmony_bench::oracle::NoiseLevel;

use super::bench::{players, runtime};
use crate::display::hinted;
use crate::{EXIT_INCOMPLETE, EXIT_OK, config, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder for homes, runs and tables; what is there already is used again.
    #[arg(long, short)]
    out: PathBuf,
    /// Seeds, comma separated: a home each.
    #[arg(long, default_value = "1,2,3", value_delimiter = ',')]
    seeds: Vec<u64>,
    /// Rooms of each home (default: 2 to 5, by the seed).
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=5))]
    rooms: Option<u8>,
    /// How far the oracle's answers are off: clean, real, harsh.
    #[arg(long, default_value = "real")]
    noise: NoiseLevel,
    /// Runs at a time.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: u16,
}

/// Runs the command.
///
/// # Errors
/// Folders that cannot be used.
pub fn run(args: &Args) -> Result<u8> {
    let request = HomesRequest {
        seeds: args.seeds.clone(),
        rooms: args.rooms.map(usize::from),
        out: args.out.clone(),
        level: args.noise,
        settings: config::load(None)?.settings,
        jobs: args.jobs.into(),
    };
    let offline = players(false);
    let homes = runtime()?
        .block_on(reconstruct(&request, &offline, &|line| tell!("{line}")))
        .map_err(|e| hinted(e.to_string(), None::<String>))?;
    let mut scores = Vec::new();
    for (seed, truth) in args.seeds.iter().zip(&homes) {
        let home = folder(&args.out, *seed);
        for by in [PlacedBy::Layout, PlacedBy::Doors] {
            let (score, built) = judge(&home, truth, *seed, by)?;
            if let Some(built) = built {
                let out = home.join(format!("built_by_{}", by.name()));
                if out.exists() {
                    std::fs::remove_dir_all(&out)?;
                }
                harmony_home::files::write(built, &out).map_err(|e| hinted(e.to_string(), e.hint()))?;
            }
            tell!(
                "{} by {}: {} of {} rooms, {} of {} doors right{}",
                score.home,
                by.name(),
                score.rooms[1],
                score.rooms[0],
                score.doors[1],
                score.doors[0],
                score.failure.as_ref().map_or_else(String::new, |f| format!("; not built: {f}"))
            );
            scores.push(score);
        }
    }
    let text = table(&scores);
    harmony_io::write_json(&args.out.join("homes.json"), &scores)?;
    harmony_io::write_atomic(&args.out.join("homes.md"), text.as_bytes())?;
    say!("{}", text.trim_end())?;
    Ok(if scores.iter().all(|s| s.failure.is_none()) { EXIT_OK } else { EXIT_INCOMPLETE })
}
