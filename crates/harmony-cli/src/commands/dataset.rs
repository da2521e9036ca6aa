//! `harmony dataset`: photos and their reconstructions as a data set that can be published.

use std::path::PathBuf;

use anyhow::Result;
use harmony_dataset::DatasetError;
use harmony_dataset::add::{Origin, add, init};
use harmony_dataset::check::{Kind, Severity, check};
use harmony_dataset::config::Config;
use harmony_dataset::layout::Split;
use harmony_dataset::records;
use harmony_dataset::release::build;
use harmony_dataset::sources;
use harmony_dataset::stats::Stats;

use crate::display::hinted;
use crate::{EXIT_INCOMPLETE, EXIT_OK, say, tell};

mod faces;

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony dataset init rooms --name my-rooms
  harmony dataset add rooms run --split medium --source own --author Ada --licence CC0-1.0
  harmony dataset build rooms --out release")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Make an empty data set.
    #[command(after_help = "Example:\n  harmony dataset init rooms --name my-rooms --licence CC-BY-4.0")]
    Init(InitArgs),
    /// Add a finished run as a scene.
    #[command(after_help = "\
Example:
  harmony dataset add rooms run --split medium --source own --author Ada --licence CC0-1.0")]
    Add(Box<AddArgs>),
    /// Ask the detector where faces are in the photos that are published, so that a release blurs them.
    #[command(after_help = "\
Examples:
  harmony dataset faces rooms --profile paper
      every photo that is published; regions given by hand stay
  harmony dataset faces rooms --profile local --local-only --only-new
      those that nobody looked at, and no photo leaves this machine")]
    Faces(faces::FacesArgs),
    /// Make a release: photos without metadata, faces blurred, licences, card, index, shards, hashes.
    #[command(after_help = "Example:\n  harmony dataset build rooms --out release")]
    Build(BuildArgs),
    /// Find what is missing, wrong or not licensed, in a working folder or a release.
    #[command(after_help = "Example:\n  harmony dataset check rooms")]
    Check(CheckArgs),
    /// Room types, objects per scene, levels, as SVG and CSV.
    #[command(after_help = "Example:\n  harmony dataset stats rooms --out stats")]
    Stats(StatsArgs),
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum SplitName {
    /// Synthetic renders with truth.
    Easy,
    /// Real photos with a single dominant layout.
    Medium,
    /// Real photos, cluttered.
    Complicated,
}

#[derive(Debug, clap::Args)]
struct InitArgs {
    /// Folder; must not exist or be empty.
    root: PathBuf,
    /// Name: letters, digits, -, _ and .
    #[arg(long)]
    name: String,
    /// Licence of the data set as a whole, by its SPDX name.
    #[arg(long, default_value = "CC-BY-NC-4.0")]
    licence: String,
    /// One paragraph.
    #[arg(long, default_value = "")]
    description: String,
}

#[derive(Debug, clap::Args)]
struct AddArgs {
    /// The data set.
    root: PathBuf,
    /// Folder of the run.
    run: PathBuf,
    /// Level of difficulty.
    #[arg(long, value_enum)]
    split: SplitName,
    /// Room type; default the run's.
    #[arg(long)]
    room_type: Option<String>,
    /// Who offers the photo: pexels, unsplash, own, ...
    #[arg(long)]
    source: String,
    /// Its number there.
    #[arg(long, default_value = "")]
    source_id: String,
    /// Its page there; may be left out for own photos alone.
    #[arg(long, default_value = "")]
    url: String,
    /// Who made it.
    #[arg(long, default_value = "")]
    author: String,
    /// Licence of the photo: CC0-1.0, CC-BY-4.0, Pexels, Unsplash, 3D-FRONT-research, or in words.
    #[arg(long)]
    licence: String,
    /// Where that licence is written, if it is not a known one.
    #[arg(long, default_value = "")]
    licence_url: String,
    /// Day on which the photo was fetched, YYYY-MM-DD.
    #[arg(long, default_value = "")]
    retrieved_at: String,
    /// Whether the photo itself is published; default what a known licence says, else no.
    #[arg(long)]
    redistributable: Option<bool>,
    /// Regions to blur on export, "x0 y0 x1 y1; ..." in pixels of the upright photo: faces, number plates.
    #[arg(long, default_value = "")]
    blur: String,
    /// Who looked for faces, if somebody did: "by hand"; a photo with regions counts as looked at.
    #[arg(long, default_value = "")]
    faces: String,
    /// Anything else.
    #[arg(long, default_value = "")]
    note: String,
}

#[derive(Debug, clap::Args)]
struct BuildArgs {
    /// The data set.
    root: PathBuf,
    /// Folder of the release; must not exist.
    #[arg(long, short)]
    out: PathBuf,
}

#[derive(Debug, clap::Args)]
struct CheckArgs {
    /// The data set, or a release.
    root: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct StatsArgs {
    /// The data set, or a release.
    root: PathBuf,
    /// Folder for stats.svg and stats.csv; must not exist. Without it the CSV is printed.
    #[arg(long, short)]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with folders, lists and files.
pub fn run(args: Args) -> Result<u8> {
    match args.command {
        Command::Init(args) => {
            let config = Config { description: args.description, ..Config::new(&args.name, &args.licence) };
            init(&args.root, &config).map_err(failed)?;
            say!("{}: fill in dataset.json, then harmony dataset add", args.root.display())?;
            Ok(EXIT_OK)
        }
        Command::Add(args) => run_add(*args),
        Command::Faces(args) => faces::run(&args),
        Command::Build(args) => run_build(&args),
        Command::Check(args) => run_check(&args),
        Command::Stats(args) => run_stats(&args),
    }
}

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
pub(super) fn failed(error: DatasetError) -> anyhow::Error {
    let hint = error.hint();
    hinted(error.to_string(), hint)
}

fn run_add(args: AddArgs) -> Result<u8> {
    let split = match args.split {
        SplitName::Easy => Split::Easy,
        SplitName::Medium => Split::Medium,
        SplitName::Complicated => Split::Complicated,
    };
    let blurred = !args.blur.trim().is_empty();
    let origin = Origin {
        source: args.source,
        source_id: args.source_id,
        source_url: args.url,
        author: args.author,
        licence: args.licence,
        licence_url: args.licence_url,
        retrieved_at: args.retrieved_at,
        redistributable: args.redistributable,
        blur: args.blur,
        faces: args.faces,
        note: args.note,
    };
    let id = add(&args.root, &args.run, split, args.room_type.as_deref(), &origin).map_err(failed)?;
    say!("{}", id.path())?;
    if blurred {
        tell!(
            "note: only the photo is blurred; textures of this run were cut from the photo as it was. Blur before \
             harmony reconstruct where a face lies on a textured surface"
        );
    }
    Ok(EXIT_OK)
}

fn run_build(args: &BuildArgs) -> Result<u8> {
    let released = build(&args.root, &args.out).map_err(failed)?;
    for finding in &released.report.findings {
        tell!("warning: {} {}", finding.scene, finding.what);
    }
    say!(
        "{}: {} scenes, {} photos left out by licence, {} shards, {} files",
        args.out.display(),
        released.scenes,
        released.photos_left_out,
        released.shards,
        released.files
    )?;
    Ok(EXIT_OK)
}

fn run_check(args: &CheckArgs) -> Result<u8> {
    let report = check(&args.root).map_err(failed)?;
    if args.json {
        say!("{}", serde_json::to_string_pretty(&report)?)?;
    } else {
        for f in &report.findings {
            let kind = match f.kind {
                Kind::Missing => "missing",
                Kind::Wrong => "wrong",
                Kind::Licence => "licence",
            };
            let severity = if f.severity == Severity::Fault { "fault" } else { "warning" };
            let scene = if f.scene.is_empty() { "data set" } else { &f.scene };
            say!("{severity:7} {kind:7} {scene}: {}", f.what)?;
        }
        say!(
            "{} scenes, {} faults, {} warnings",
            report.scenes,
            report.faults(),
            report.findings.len() - report.faults()
        )?;
    }
    Ok(if report.faults() == 0 { EXIT_OK } else { EXIT_INCOMPLETE })
}

fn run_stats(args: &StatsArgs) -> Result<u8> {
    Config::load(&args.root).map_err(failed)?;
    if let Some(out) = args.out.as_ref().filter(|out| out.exists()) {
        return Err(failed(DatasetError::Exists(out.clone())));
    }
    let rows = sources::load(&args.root).map_err(failed)?;
    let records =
        rows.iter().map(|row| records::load(&args.root, row)).collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let stats = Stats::of(&records);
    match &args.out {
        Some(out) => {
            harmony_io::write_atomic(&out.join("stats.svg"), stats.svg().as_bytes())?;
            harmony_io::write_atomic(&out.join("stats.csv"), stats.csv().as_bytes())?;
            say!("{}", out.join("stats.svg").display())?;
        }
        None => say!("{}", stats.csv().trim_end())?,
    }
    Ok(EXIT_OK)
}
