//! `harmony`: one photo of a room in, one editable, lit, simulation-ready 3D scene out.
//!
//! The program as a library, for tests that need its configuration and its cast; `main.rs` only calls [`run`].

pub mod cast;
mod commands;
pub mod config;
pub mod display;
mod models;
mod networks;
pub mod setup;
mod stopping;
pub mod survey;

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::LazyLock;

use clap::{CommandFactory, Parser, Subcommand};

/// Everything did what it should.
const EXIT_OK: u8 = 0;
/// Something else went wrong: a file, a folder, an argument's content.
const EXIT_ERROR: u8 = 1;
/// A phase failed or a required file is missing; what was obtained is kept, `run.json` tells which and why.
const EXIT_INCOMPLETE: u8 = 3;
/// A budget, a deadline or Ctrl-C stopped the run; what was obtained is kept.
const EXIT_STOPPED: u8 = 4;

/// What `--version` tells beside the number: the commit that `cargo xtask dist` built from, and the features.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let features = match (cfg!(feature = "nets"), cfg!(feature = "cuda")) {
        (_, true) => "nets, cuda",
        (true, _) => "nets",
        _ => "none",
    };
    let commit = option_env!("HARMONY_COMMIT").unwrap_or("not told, a build of one's own");
    format!("{}\ncommit: {commit}\nfeatures: {features}", env!("CARGO_PKG_VERSION"))
});

/// Turns one photograph of a room into an editable, lit, simulation-ready 3D scene.
///
/// Start with `harmony reconstruct photo.jpg --out run`, then open run/report.html.
/// `harmony setup` finds keys and servers and writes harmony.toml; `harmony doctor` tells what can be used on this machine and what is missing.
#[derive(Debug, Parser)]
#[command(name = "harmony", version, long_version = VERSION.as_str(), after_help = EXIT_CODES)]
struct Cli {
    /// More log on stderr: -v for steps, -vv for everything.
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    verbose: u8,
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "\
Example:
  harmony reconstruct room.jpg --out run --profile offline

Exit codes:
  0  all phases did what they should
  1  the input or an argument cannot be used, or another harmony is at work in the run folder; nothing was run
  2  wrong usage of the command line
  3  a phase failed, or a required file is missing or cannot be written (a full disk): what was obtained is kept,
     run.json tells which and why; run the same command again to go on from there
  4  stopped before its end by a budget, a deadline or Ctrl-C: every answer is kept, running again goes on";

#[derive(Debug, Subcommand)]
enum Command {
    /// Reconstruct a photo, or several of one room, into a run folder (scene.json, scene_full.glb, renders, report.html).
    Reconstruct(Box<commands::reconstruct::Args>),
    /// Join runs of several photos of one room into one scene.
    Join(commands::join::Args),
    /// Reconstruct many photos: a queue, workers on this machine and on others, what has come of it.
    Batch(Box<commands::batch::Args>),
    /// Work from a queue that `harmony batch` filled, here or on another machine.
    Worker(commands::batch::WorkerArgs),
    /// Tell what a run would take: calls, money, minutes. Asks nobody.
    Estimate(commands::estimate::Args),
    /// Tell what a run took, by phase, role, player and object.
    Bill(commands::bill::Args),
    /// Find out what is here, propose who plays, write harmony.toml.
    Setup(commands::setup::Args),
    /// Tell who can play each role here and what is missing.
    Doctor(commands::doctor::Args),
    /// Summarise a run in the terminal.
    Show(commands::show::Args),
    /// Render the scene of a run with the built-in renderer.
    Render(commands::render::Args),
    /// Write the scene of a run as GLB, USD, MJCF, URDF, Blender, OBJ or drawings, and check what was written.
    Export(commands::export::Args),
    /// Let the scene of a run stand, repair what does not, shake it.
    Simulate(commands::simulate::Args),
    /// What robots can do in the scene of a run: what can be grasped, sat on, opened; scripted tasks on its geometry.
    Robot(commands::robot::Args),
    /// The modelling program of an object: print it, change it, run it again.
    Model(commands::model::Args),
    /// Keep the answers of a run as a recording that can be replayed (answers only, no photo).
    Record(commands::record::Args),
    /// Weights of the networks inside this program: what there is, fetch, check.
    Models(commands::models::Args),
    /// Put reconstructed rooms into one home, or one room into another size.
    Home(commands::home::Args),
    /// Measure the program on rooms with known truth.
    Bench(commands::bench::Args),
    /// Judge finished runs on photos without truth, beside what other programs made.
    Eval(Box<commands::eval::Args>),
    /// Ask people: a page to rank reconstructions blind, a server for the answers, the statistics.
    Study(commands::study::Args),
    /// Photos and their reconstructions as a data set: sources, licences, checks, releases.
    Dataset(commands::dataset::Args),
    /// Canonical views of many runs, contact sheets, turntables.
    Gallery(commands::gallery::Args),
    /// Print the JSON Schema of scene.json or of the configuration.
    Schema(commands::schema::Args),
    /// Print completions of this command line for a shell.
    Completions(commands::manual::CompletionArgs),
    /// Write man pages of all commands.
    Man(commands::manual::ManArgs),
}

/// Whether words are a command that the program understands, the program's name first. Nothing is run.
///
/// # Errors
/// What is not understood, as the program would say it.
pub fn understood(words: impl IntoIterator<Item = String>) -> Result<(), String> {
    Cli::try_parse_from(words).map(|_| ()).or_else(|error| match error.kind() {
        clap::error::ErrorKind::DisplayHelp | clap::error::ErrorKind::DisplayVersion => Ok(()),
        _ => Err(error.to_string()),
    })
}

/// Runs the program on arguments as a shell gives them, the program's name first.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = Cli::parse_from(args);
    display::log_to_stderr(cli.verbose);
    let result = match cli.command {
        Command::Reconstruct(args) => commands::reconstruct::run(*args),
        Command::Join(args) => commands::join::run(&args),
        Command::Batch(args) => commands::batch::run(*args),
        Command::Worker(args) => commands::batch::run_worker(&args),
        Command::Estimate(args) => commands::estimate::run(&args),
        Command::Bill(args) => commands::bill::run(&args),
        Command::Setup(args) => commands::setup::run(&args),
        Command::Doctor(args) => commands::doctor::run(&args),
        Command::Show(args) => commands::show::run(&args),
        Command::Render(args) => commands::render::run(&args),
        Command::Export(args) => commands::export::run(&args),
        Command::Simulate(args) => commands::simulate::run(&args),
        Command::Robot(args) => commands::robot::run(&args),
        Command::Model(args) => commands::model::run(&args),
        Command::Record(args) => commands::record::run(&args),
        Command::Models(args) => commands::models::run(&args),
        Command::Home(args) => commands::home::run(&args),
        Command::Bench(args) => commands::bench::run(args),
        Command::Eval(args) => commands::eval::run(&args),
        Command::Study(args) => commands::study::run(args),
        Command::Dataset(args) => commands::dataset::run(args),
        Command::Gallery(args) => commands::gallery::run(&args),
        Command::Schema(args) => commands::schema::run(&args),
        Command::Completions(args) => commands::manual::completions(&args, Cli::command()),
        Command::Man(args) => commands::manual::man(&args, Cli::command()),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            display::print_error(&error);
            ExitCode::from(EXIT_ERROR)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The commands that a help text shows: lines of the example that begin with the program's name, as a shell would split them.
    fn shown(help: &str) -> Vec<Vec<String>> {
        let commands =
            help.lines().filter_map(|line| line.strip_prefix("  ")).filter(|line| line.starts_with("harmony "));
        commands.map(split).collect()
    }

    /// Words of a command, quotes taken away; what goes behind a pipe or into a file is the shell's.
    fn split(line: &str) -> Vec<String> {
        let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
        for c in line.chars().chain([' ']) {
            match (quote, c) {
                (Some(open), _) if c == open => quote = None,
                (None, '\'' | '"') => quote = Some(c),
                (None, ' ') if word.is_empty() => {}
                (None, ' ') => words.push(std::mem::take(&mut word)),
                _ => word.push(c),
            }
        }
        let own = words.iter().position(|word| [">", "|"].contains(&word.as_str())).unwrap_or(words.len());
        words.truncate(own);
        words
    }

    /// Complaints about the help of a command and of all below it.
    fn complaints(command: &clap::Command, path: &str, all: &mut Vec<String>) {
        let help =
            command.get_after_long_help().or(command.get_after_help()).map(ToString::to_string).unwrap_or_default();
        let examples = shown(&help);
        let below: Vec<_> = command.get_subcommands().filter(|below| below.get_name() != "help").collect();
        let own = |words: &Vec<String>| words.join(" ").starts_with(&format!("{path} "));
        let alone = |words: &Vec<String>| words.join(" ") == path;
        if !help.starts_with("Example") || !examples.iter().any(|words| own(words) || alone(words)) {
            all.push(format!("{path}: no example"));
        }
        for words in examples {
            if let Err(error) = understood(words.clone()) {
                all.push(format!("{path}: {}: {error}", words.join(" ")));
            }
        }
        for command in below {
            complaints(command, &format!("{path} {}", command.get_name()), all);
        }
    }

    #[test]
    fn the_help_of_each_command_shows_an_example_that_is_understood() {
        let mut all = Vec::new();
        complaints(&Cli::command(), "harmony", &mut all);
        assert!(all.is_empty(), "{}", all.join("\n"));
        // The walk sees what is wrong.
        let example = "Example:\n  harmony bill run --no-such-switch";
        let wrong = clap::Command::new("harmony").subcommand(clap::Command::new("bill").after_help(example));
        complaints(&wrong, "harmony", &mut all);
        assert_eq!(all.len(), 2, "{all:?}");
        assert_eq!(split("harmony x 'a b' --to=\"c d\" > file"), ["harmony", "x", "a b", "--to=c d"]);
    }
}
