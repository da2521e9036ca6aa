//! `harmony bench`: rooms with known truth, played by the oracle, judged.

use std::path::PathBuf;

use anyhow::{Context, Result};
use harmony_bench::oracle::NoiseLevel;
use harmony_bench::run::{BenchRequest, BenchResult, run as run_bench};
use harmony_bench::summary::{TEXT_HEADING, summary, text_table};
use harmony_bench::truth::rooms_in;

use crate::display::hinted;
use crate::{EXIT_INCOMPLETE, EXIT_OK, config, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Run the pipeline on rooms with known truth, the oracle playing every role, and judge the results.
    Run(RunArgs),
}

/// Arguments of `bench run`.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    /// A folder of rooms with truth, or one such room.
    rooms: PathBuf,
    /// Folder for the runs and the tables.
    #[arg(long, short)]
    out: PathBuf,
    /// How far the oracle's answers are off: clean, real, harsh.
    #[arg(long, default_value = "real")]
    noise: NoiseLevel,
    /// Seeds, comma separated: every room is run once with each.
    #[arg(long, default_value = "1", value_delimiter = ',')]
    seeds: Vec<u64>,
    /// Tell the room's height exactly, whatever the noise.
    #[arg(long)]
    exact_height: bool,
    /// Only rooms whose name contains this.
    #[arg(long)]
    only: Option<String>,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Folders and files that cannot be used.
pub fn run(args: Args) -> Result<u8> {
    let Command::Run(args) = args.command;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    let mut rooms = rooms_in(&args.rooms).map_err(|e| hinted(e.to_string(), e.hint()))?;
    rooms.retain(|r| args.only.as_ref().is_none_or(|o| r.to_string_lossy().contains(o.as_str())));
    let settings = config::load(args.config.as_deref())?.settings;
    let request = BenchRequest {
        rooms,
        out: args.out.clone(),
        level: args.noise,
        noise: args.noise.noise(),
        seeds: args.seeds.clone(),
        exact_height: args.exact_height,
        settings,
    };
    let offline = harmony_players::offline_cast();
    let result = runtime.block_on(run_bench(&request, &offline, &|line| tell!("{line}")))?;
    harmony_io::write_json(&args.out.join("scores.json"), &result)?;
    print(&result)
}

fn print(result: &BenchResult) -> Result<u8> {
    let height = if result.exact_height { "room height exact" } else { "room height as noisy as the rest" };
    say!("{} ({height}), metres as delivered\n{TEXT_HEADING}\n{}", result.title, text_table(&summary(&result.raw)))?;
    say!("the same after scale alignment\n{}", text_table(&summary(&result.aligned)))?;
    let failed = result.raw.iter().filter(|r| r.failure.is_some()).count();
    if failed > 0 {
        tell!("{failed} runs failed");
        return Ok(EXIT_INCOMPLETE);
    }
    Ok(EXIT_OK)
}
