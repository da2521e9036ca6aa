//! `harmony study`: build a page, serve it, collect answers, analyse them.

use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use harmony_study::StudyError;
use harmony_study::analyse::{AnalyseOptions, analyse};
use harmony_study::build::{BuildOptions, build};
use harmony_study::collect::collect;
use harmony_study::log::{Log, LogLimits, read};
use harmony_study::private::{Exclusion, PARTICIPANTS_FILE, PrivateStudy};
use harmony_study::server::{ServeOptions, Site, serve};
use harmony_study::sets::{self, RunPicture};
use harmony_study::simulate::{Crowd, simulate};

use crate::display::hinted;
use crate::{EXIT_INCOMPLETE, EXIT_OK, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony study build ours=runs theirs=rivals/cast --out study
  harmony study serve study --log answers.jsonl
  harmony study analyse answers.jsonl --private study.private")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Make the page: photo above anonymous panels, to be ranked. Methods stay in a private folder.
    #[command(after_help = "\
Example:
  harmony study build ours=runs theirs=rivals/cast --out study --checks 2 --participants 20")]
    Build(Box<BuildArgs>),
    /// Serve the page and keep the answers: what is acknowledged is on the disk.
    #[command(after_help = "Example:\n  harmony study serve study --log answers.jsonl")]
    Serve(ServeArgs),
    /// Add answers that came as files (from pages opened from disk) to the log.
    #[command(after_help = "\
Example:
  harmony study collect answers/ada.json --private study.private --log answers.jsonl")]
    Collect(CollectArgs),
    /// Mean ranks, Top-1, Top-2, intervals, tests.
    #[command(after_help = "Example:\n  harmony study analyse answers.jsonl --private study.private --out analysis")]
    Analyse(AnalyseArgs),
    /// A log of made-up people with known preferences: how wide would the intervals be?
    #[command(after_help = "\
Example:
  harmony study simulate --private study.private --log made_up.jsonl --strengths 1,0")]
    Simulate(SimulateArgs),
}

/// Which render of runs is shown.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Picture {
    /// In even light.
    Flat,
    /// Path-traced.
    Lit,
}

#[derive(Debug, clap::Args)]
struct BuildArgs {
    /// The methods, as name=folder of run folders or of pictures named by their scenes. The first is the one that the
    /// others are compared with.
    #[arg(required = true)]
    sets: Vec<String>,
    /// Folder of the site; must not exist.
    #[arg(long, short)]
    out: PathBuf,
    /// Folder of the decoding map, the secret and the invitations; default `<out>.private`. Never publish it.
    #[arg(long)]
    private: Option<PathBuf>,
    /// Name of the study, part of every seed.
    #[arg(long, default_value = "study")]
    name: String,
    /// Title of the page.
    #[arg(long)]
    title: Option<String>,
    /// Folder of photos named by their scenes; default: those of the runs.
    #[arg(long)]
    photos: Option<PathBuf>,
    /// The method that the others are compared with; default the first.
    #[arg(long)]
    reference: Option<String>,
    /// So many scenes by lot; default all.
    #[arg(long)]
    scenes: Option<usize>,
    /// Attention checks: the photo itself among the panels must be first, another room last.
    #[arg(long, default_value_t = 0)]
    checks: usize,
    /// Scenes that are shown twice, to see whether people agree with themselves.
    #[arg(long, default_value_t = 0)]
    repeats: usize,
    /// Invitations to write.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    participants: u32,
    /// Address of the page, for the links in the invitations.
    #[arg(long, default_value = "http://127.0.0.1:8750/")]
    url: String,
    /// File with instructions in place of the paper's.
    #[arg(long)]
    instructions: Option<PathBuf>,
    /// File with a consent text in place of the general one.
    #[arg(long)]
    consent: Option<PathBuf>,
    /// Whom participants may write to; stands in the general consent text.
    #[arg(long)]
    contact: Option<String>,
    /// Which render of runs.
    #[arg(long, value_enum, default_value = "flat")]
    picture: Picture,
    /// Longest side of pictures, pixels.
    #[arg(long, default_value_t = 1280, value_parser = clap::value_parser!(u32).range(64..=4096))]
    size: u32,
    /// One HTML file with all pictures inside, to be sent around.
    #[arg(long)]
    single_file: bool,
    /// People whose median time a trial is shorter are left out, seconds. Fixed now, before anybody looks.
    #[arg(long, default_value_t = 5.0)]
    min_seconds: f64,
    /// Attention checks that a person may fail.
    #[arg(long, default_value_t = 0)]
    failed_checks: usize,
    /// Same seed, same bytes. The secret follows from it: for demonstrations and tests alone.
    #[arg(long)]
    seed: Option<u64>,
}

#[derive(Debug, clap::Args)]
struct ServeArgs {
    /// Folder of the site.
    site: PathBuf,
    /// Folder of the decoding map and the secret; default `<site>.private`.
    #[arg(long)]
    private: Option<PathBuf>,
    /// The log; made when there is none.
    #[arg(long)]
    log: PathBuf,
    /// Address to listen on. Other than loopback: put a proxy with TLS before it.
    #[arg(long, default_value = "127.0.0.1:8750")]
    listen: SocketAddr,
    /// Let so many people without an invitation take part.
    #[arg(long, default_value_t = 0)]
    open: usize,
}

#[derive(Debug, clap::Args)]
struct CollectArgs {
    /// Files that participants saved.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Folder of the decoding map and the secret.
    #[arg(long)]
    private: PathBuf,
    /// The log; made when there is none.
    #[arg(long)]
    log: PathBuf,
    /// Take files without an invitation, too; they are marked and counted.
    #[arg(long)]
    unsigned: bool,
}

#[derive(Debug, clap::Args)]
struct AnalyseArgs {
    /// The log.
    log: PathBuf,
    /// Folder of the decoding map.
    #[arg(long)]
    private: PathBuf,
    /// People who did not hand in count, too.
    #[arg(long)]
    partial: bool,
    /// Draws of the bootstrap.
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    draws: u32,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 2026)]
    seed: u64,
    /// Folder for table.csv, rankings.csv, analysis.json and analysis.html; must not exist.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct SimulateArgs {
    /// Folder of the decoding map of a built study.
    #[arg(long)]
    private: PathBuf,
    /// The log to write; must not exist.
    #[arg(long)]
    log: PathBuf,
    /// People.
    #[arg(long, default_value_t = 16)]
    people: usize,
    /// Log strength of each method in the study's order, such as 2,0.5,0,-1.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true)]
    strengths: Vec<f64>,
    /// Standard deviation of the shifts of scenes.
    #[arg(long, default_value_t = 0.5)]
    scene_sd: f64,
    /// Standard deviation of the shifts of people.
    #[arg(long, default_value_t = 0.3)]
    person_sd: f64,
    /// People, of all, who answer at random and fast.
    #[arg(long, default_value_t = 0)]
    careless: usize,
    /// Seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with sets, logs and files.
pub fn run(args: Args) -> Result<u8> {
    match args.command {
        Command::Build(args) => run_build(*args),
        Command::Serve(args) => run_serve(&args),
        Command::Collect(args) => run_collect(&args),
        Command::Analyse(args) => run_analyse(&args),
        Command::Simulate(args) => run_simulate(&args),
    }
}

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
fn failed(error: StudyError) -> anyhow::Error {
    let hint = error.hint();
    hinted(error.to_string(), hint)
}

fn beside(site: &std::path::Path) -> PathBuf {
    let mut name = site.file_name().unwrap_or_default().to_owned();
    name.push(".private");
    site.with_file_name(name)
}

fn run_build(args: BuildArgs) -> Result<u8> {
    let named = args.sets.iter().map(|s| sets::parse(s)).collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let read_text = |path: &Option<PathBuf>| -> Result<Option<String>> {
        path.as_ref()
            .map(|p| {
                let bytes = harmony_io::read_bounded(p, 1 << 20)?;
                String::from_utf8(bytes).with_context(|| format!("{} is not UTF-8", p.display()))
            })
            .transpose()
    };
    if !(args.min_seconds >= 0.0 && args.min_seconds < 3600.0) {
        bail!("--min-seconds is a number from 0 to 3600");
    }
    let mut options = BuildOptions::new(&args.name, named);
    if let Some(title) = args.title {
        options.title = title;
    }
    options.instructions = read_text(&args.instructions)?;
    options.consent = read_text(&args.consent)?;
    options.photos = args.photos;
    options.reference = args.reference;
    options.scenes = args.scenes;
    options.checks = args.checks;
    options.repeats = args.repeats;
    options.participants = args.participants as usize;
    options.url = args.url;
    options.contact = args.contact;
    options.picture = match args.picture {
        Picture::Flat => RunPicture::Flat,
        Picture::Lit => RunPicture::Lit,
    };
    options.size = args.size;
    options.single_file = args.single_file;
    options.exclusion =
        Exclusion { min_median_ms: (args.min_seconds * 1000.0) as u64, failed_checks: args.failed_checks };
    options.seed = args.seed;
    let private = args.private.unwrap_or_else(|| beside(&args.out));
    let built = build(&options, &args.out, &private).map_err(failed)?;
    for note in built.study.left_out.iter().map(|s| format!("left out: {s}")).chain(built.study.notes.clone()) {
        tell!("note: {note}");
    }
    say!(
        "{}: {} trials of {} panels, {} files, {:.1} MB",
        args.out.join("index.html").display(),
        built.study.trials.len(),
        built.study.methods.len(),
        built.files,
        built.bytes as f64 / 1e6
    )?;
    say!("{}: decoding map, secret and {} invitations; keep it to yourself", private.display(), options.participants)?;
    say!("next: harmony study serve {} --log answers.jsonl", args.out.display())?;
    Ok(EXIT_OK)
}

fn run_serve(args: &ServeArgs) -> Result<u8> {
    let private = args.private.clone().unwrap_or_else(|| beside(&args.site));
    let study = PrivateStudy::load(&private).map_err(failed)?;
    let site = Site::open(&args.site, &study).map_err(failed)?;
    let log = Log::open(&args.log, &study, LogLimits::default()).map_err(failed)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let listening = |source| failed(StudyError::Listen { address: args.listen.to_string(), source });
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::bind(args.listen).await.map_err(listening)?;
        let address = listener.local_addr().map_err(listening)?;
        say!("http://{address}/")?;
        if !address.ip().is_loopback() {
            tell!("note: answers travel unencrypted; put a proxy with TLS before this address");
        }
        if args.open == 0 {
            tell!(
                "invitations are in {}; --open N lets people without one take part",
                private.join(PARTICIPANTS_FILE).display()
            );
        }
        let until = async {
            // Without the signal there is nothing to wait for but the end of the process.
            if tokio::signal::ctrl_c().await.is_err() {
                std::future::pending::<()>().await;
            }
        };
        serve(listener, site, study, log.clone(), ServeOptions { open: args.open }, until).await;
        let (people, answers) = log.counts().await.unwrap_or_default();
        tell!("{answers} answers of {people} people in {}", args.log.display());
        anyhow::Ok(())
    })?;
    log.close();
    Ok(EXIT_OK)
}

fn run_collect(args: &CollectArgs) -> Result<u8> {
    let study = PrivateStudy::load(&args.private).map_err(failed)?;
    let log = Log::open(&args.log, &study, LogLimits::default()).map_err(failed)?;
    let mut refused = 0;
    for path in &args.files {
        match collect(path, &study, &log, args.unsigned) {
            Ok(collected) => {
                say!("{}: {} stored, {} there before", path.display(), collected.stored, collected.before)?;
                for why in &collected.refused {
                    refused += 1;
                    tell!("refused, {why}: {}", path.display());
                }
            }
            Err(error) => {
                refused += 1;
                tell!("refused, {error}: {}", path.display());
            }
        }
    }
    log.close();
    Ok(if refused == 0 { EXIT_OK } else { EXIT_INCOMPLETE })
}

fn run_analyse(args: &AnalyseArgs) -> Result<u8> {
    let study = PrivateStudy::load(&args.private).map_err(failed)?;
    let entries = read(&args.log, &study).map_err(failed)?;
    let options = AnalyseOptions { draws: args.draws as usize, seed: args.seed, partial: args.partial };
    if let Some(out) = args.out.as_ref().filter(|out| out.exists()) {
        return Err(failed(StudyError::Exists(out.clone())));
    }
    let analysis = analyse(&entries, &study, &options).map_err(failed)?;
    if args.json {
        say!("{}", serde_json::to_string_pretty(&analysis)?)?;
    } else {
        say!("{}", analysis.text().trim_end())?;
    }
    if let Some(out) = &args.out {
        harmony_io::write_atomic(&out.join("table.csv"), analysis.csv().as_bytes())?;
        harmony_io::write_atomic(&out.join("rankings.csv"), analysis.rankings_csv().as_bytes())?;
        harmony_io::write_json(&out.join("analysis.json"), &analysis)?;
        harmony_io::write_atomic(&out.join("analysis.html"), analysis.html().as_bytes())?;
        tell!("{}", out.join("analysis.html").display());
    }
    Ok(EXIT_OK)
}

fn run_simulate(args: &SimulateArgs) -> Result<u8> {
    let study = PrivateStudy::load(&args.private).map_err(failed)?;
    if args.strengths.len() != study.methods.len() || args.strengths.iter().any(|s| !s.is_finite()) {
        bail!("--strengths needs one number for each of {}", study.methods.join(", "));
    }
    if args.people == 0 || args.people > 100_000 {
        bail!("--people is a number from 1 to 100000");
    }
    if args.log.exists() {
        return Err(failed(StudyError::Exists(args.log.clone())));
    }
    let crowd = Crowd {
        people: args.people,
        strengths: args.strengths.clone(),
        scene_sd: args.scene_sd,
        person_sd: args.person_sd,
        careless: args.careless.min(args.people),
        seed: args.seed,
    };
    let log = Log::open(&args.log, &study, LogLimits::default()).map_err(failed)?;
    let entries = simulate(&study, &crowd);
    let count = entries.len();
    for entry in entries {
        log.append_blocking(entry)?;
    }
    log.close();
    say!("{}: {count} entries of {} made-up people", args.log.display(), args.people)?;
    Ok(EXIT_OK)
}
