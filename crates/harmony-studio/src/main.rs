//! The program `harmony-studio`: a studio to be used by hand, runs with faults, and the program itself.

use std::ffi::OsString;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use clap::{Parser, Subcommand};
use harmony_bench::oracle::NoiseLevel;
use harmony_bench::truth::TruthRoom;
use harmony_bench::wall_clock::Pace;
use harmony_studio::profile::{Profile, config};
use harmony_studio::soak::{self, SoakOptions};
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{KEY, Studio, StudioOptions};

/// Plays the services of the profiles on loopback, from a room's truth.
#[derive(Debug, Parser)]
#[command(name = "harmony-studio")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Plays until it is ended; writes a harmony.toml that leads to it.
    Serve(Serve),
    /// Runs with random faults, each checked; writes a table.
    Faults(SoakOptions),
    /// The program `harmony` as it is built beside this studio.
    Harmony {
        /// Its arguments.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        args: Vec<OsString>,
    },
}

#[derive(Debug, clap::Args)]
struct Serve {
    /// Folder of the room's truth (`harmony bench generate` makes some).
    room: PathBuf,
    /// Which profile the configuration is for.
    #[arg(long, value_enum, default_value = "paper")]
    profile: Profile,
    /// How far the answers are off: clean, real, harsh.
    #[arg(long, default_value = "clean")]
    noise: NoiseLevel,
    /// Seed of the errors.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Answers take as long as those of real services, divided by this: 8 s a question, 12 s an edit, 45 s a mesh.
    #[arg(long)]
    like_real: Option<f64>,
    /// Port; 0 = any.
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Where the configuration is written.
    #[arg(long, default_value = "harmony.toml")]
    config: PathBuf,
}

fn main() -> ExitCode {
    match Cli::parse().command {
        Command::Harmony { args } => harmony_cli::run(std::iter::once(OsString::from("harmony")).chain(args)),
        Command::Serve(args) => ended(serve(&args).map(|()| true)),
        Command::Faults(options) => ended(soak::command(&options)),
    }
}

fn ended(result: anyhow::Result<bool>) -> ExitCode {
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn serve(args: &Serve) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    runtime.block_on(async {
        let room = TruthRoom::load(&args.room)?;
        let truth_oracle = Arc::new(TruthOracle::new(room, args.noise.noise(), args.seed, false)?);
        // How many at a time is the program's choice, not ours.
        let pace = args.like_real.map(|faster| Pace::like_real(faster, 0));
        let studio = Studio::start(truth_oracle, StudioOptions { pace, ..StudioOptions::default() }, args.port).await?;
        std::fs::write(&args.config, config(&studio, args.profile)).context("writing the configuration")?;
        let mut out = std::io::stdout();
        writeln!(out, "playing; {} leads here. Keys:", args.config.display())?;
        writeln!(out, "export OPENAI_API_KEY={KEY} GEMINI_API_KEY={KEY} FAL_KEY={KEY}")?;
        out.flush()?;
        studio.wait().await;
        Ok(())
    })
}
