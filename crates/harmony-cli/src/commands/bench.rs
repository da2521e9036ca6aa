//! `harmony bench`: rooms with known truth, played by the oracle, judged.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use harmony_bench::ablate::{self, AblationError, ablate};
use harmony_bench::compare::{compare, text as comparison};
use harmony_bench::fit;
use harmony_bench::generate::{GeneratorSettings, RoomFeature, generate, write as write_room};
use harmony_bench::oracle::{Fault, Meshes, Noise, NoiseLevel};
use harmony_bench::overrides::{OverrideError, with_change, with_changes};
use harmony_bench::photos::{self, PhotosRequest};
use harmony_bench::protocols::{self, Protocol, ProtocolOptions, RunSurfaces, pair_runs, pieces, score_run, truths_in};
use harmony_bench::report::write_tables;
use harmony_bench::run::{BenchRequest, BenchResult, Judging, judge_finished, pairs, read_result, run as run_bench};
use harmony_bench::score::{BENCH_POINTS, Prediction};
use harmony_bench::summary::{TEXT_HEADING, summary, text_table};
use harmony_bench::truth::{TruthRoom, rooms_in};
use harmony_bench::views::{LIT_WIDTH, Lit, LitOptions, text as views_text};
use harmony_calls::Cast;

use crate::display::hinted;
use crate::{EXIT_INCOMPLETE, EXIT_OK, config, models, networks, say, tell};

/// Stack of the threads that run a pipeline each, bytes: as much as a program's first thread usually has.
const STACK: usize = 8 << 20;

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony bench generate rooms --count 5
  harmony bench run rooms --out bench")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Run the pipeline on rooms with known truth, the oracle playing every role, and judge the results.
    #[command(after_help = "Example:\n  harmony bench run rooms --out bench --noise real --seeds 1,2")]
    Run(RunArgs),
    /// Make furnished rooms with known truth.
    #[command(after_help = "\
Examples:
  harmony bench generate rooms --count 5
  harmony bench generate attics --count 5 --shapes slope,recess")]
    Generate(GenerateArgs),
    /// Judge runs that are there: one run folder, or a folder of runs named <room>_<seed>.
    #[command(after_help = "Example:\n  harmony bench score bench rooms --out scores")]
    Score(ScoreArgs),
    /// Look at finished scenes from where the photo was not taken, and compare that with what is there.
    #[command(after_help = "Example:\n  harmony bench views bench --rooms rooms --out views")]
    Views(ViewsArgs),
    /// Run the full configuration and every part switched off in turn, as in the paper's ablation table.
    #[command(after_help = "\
Example:
  harmony bench ablate rooms --out ablation --variants full,placement.refinement=false")]
    Ablate(AblateArgs),
    /// Several photos of one room: generated rooms from several sides, each photo run by itself, the runs joined.
    #[command(after_help = "Example:\n  harmony bench join --out joined --photos 2,4 --seeds 1,2")]
    Join(JoinArgs),
    /// Two results side by side: every figure, every room, the objects that got worse.
    #[command(after_help = "Example:\n  harmony bench compare before after")]
    Compare(CompareArgs),
    /// Estimate how far answers are off (placement.noise) from finished runs of rooms with known truth.
    #[command(after_help = "Example:\n  harmony bench fit bench --rooms rooms --out noise.toml")]
    Fit(FitArgs),
    /// Make homes of 2 to 5 rooms with known truth, reconstruct their rooms, build them, and judge the result.
    #[command(after_help = "Example:\n  harmony bench home --out homes --seeds 1,2,3")]
    Home(super::bench_home::Args),
}

/// Arguments of `bench run`; `bench ablate` has them, too.
#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "switches of a command line")]
struct RunArgs {
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
    /// Change a setting, for instance placement.refinement=false; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    changes: Vec<String>,
    /// Points drawn from each side's surfaces (the published protocol takes 1000000); 0 leaves surfaces out.
    #[arg(long, default_value_t = BENCH_POINTS)]
    points: usize,
    /// Runs at a time.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: u16,
    /// Keep the run folders (true, false); the tables and the pictures of the cases stay in any case.
    #[arg(long, default_value_t = true, default_missing_value = "true", num_args = 0..=1, action = clap::ArgAction::Set)]
    keep: bool,
    /// What the generator's meshes are made of: truth (painted from the photo), part (part models, paint from the
    /// photo), degraded (as a generator leaves them at its worse), grey.
    #[arg(long, default_value = "truth")]
    meshes: Meshes,
    /// The layout answer tells nothing of the room's shape: what measurement finds by itself.
    #[arg(long)]
    untold: bool,
    /// No point map: room and camera from the layout answer and the photo's lines, as without VGGT's weights.
    #[arg(long)]
    photo_alone: bool,
    /// A mistake of the first answers, made so often: what second looks are there for. May be given several times, with
    /// overlooked (objects that lists and detector pass over), relations (hosts and walls), turns (quarter turns), swapped
    /// (sets of which two members are taken for each other), disordered (levels whose order of placing is at random).
    #[arg(long = "fault", value_name = "KIND=SHARE")]
    faults: Vec<Fault>,
    /// Go on through materials and light, and judge lit pictures, too, from the photo's place and from the room's
    /// other views; needs Blender.
    #[arg(long)]
    lit: bool,
}

/// Arguments of `bench generate`.
#[derive(Debug, clap::Args)]
struct GenerateArgs {
    /// Folder for the rooms; each gets its own in it.
    folder: PathBuf,
    /// Seed of the first room.
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    /// Number of rooms.
    #[arg(long, default_value_t = 1)]
    count: u64,
    /// What makes rooms other than boxes: box (nothing), mixed (one or two of all), or some of lshape, chimney, niche,
    /// recess, slope, passage, tray, separated by commas.
    #[arg(long, default_value = "box", value_parser = Shapes::parse)]
    shapes: Shapes,
}

/// Features that rooms may have.
#[derive(Debug, Clone)]
struct Shapes(Vec<RoomFeature>);

impl Shapes {
    fn parse(text: &str) -> Result<Self, String> {
        RoomFeature::list(text).map(Self)
    }
}

/// Arguments of `bench score`.
#[derive(Debug, clap::Args)]
struct ScoreArgs {
    /// A run folder, or a folder of runs named <room>_<seed>.
    run: PathBuf,
    /// The room's truth, or a folder of rooms.
    truth: PathBuf,
    /// Folder for the tables (default: they are only printed).
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Points drawn from each side's surfaces; 0 leaves surfaces out.
    #[arg(long, default_value_t = BENCH_POINTS)]
    points: usize,
    /// Compare surfaces and objects by named protocols instead, comma separated: gen3dsr, harmony (the paper's script),
    /// harmony-iso, midi. The truth may then be of 3D-FRONT, too (docs/evaluation.md).
    #[arg(long, value_delimiter = ',')]
    protocol: Vec<Protocol>,
    /// Seed of the samplings, with --protocol.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Arguments of `bench views`.
#[derive(Debug, clap::Args)]
struct ViewsArgs {
    /// Run folders, or folders of runs named <room>_<seed>.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// A folder of rooms with truth and views, or one such room.
    #[arg(long)]
    rooms: PathBuf,
    /// The room of the runs (default: the one of that name, or that has the run's photo).
    #[arg(long)]
    room: Option<String>,
    /// Folder for the tables, the page and the pictures (default: figures are only printed).
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Judge lit pictures, too; needs Blender, about ten seconds a picture.
    #[arg(long)]
    lit: bool,
    /// Longest side of lit pictures, pixels.
    #[arg(long, default_value_t = LIT_WIDTH, value_parser = clap::value_parser!(u32).range(64..=4096))]
    lit_size: u32,
}

/// Arguments of `bench ablate`.
#[derive(Debug, clap::Args)]
struct AblateArgs {
    #[command(flatten)]
    run: RunArgs,
    /// Only these variants, comma separated: full, or changes such as placement.refinement=false.
    #[arg(long, value_delimiter = ',')]
    variants: Vec<String>,
}

/// Arguments of `bench join`.
#[derive(Debug, clap::Args)]
struct JoinArgs {
    /// Folder for rooms, runs, joined runs and tables; rooms and runs that are there are kept.
    #[arg(long, short)]
    out: PathBuf,
    /// Numbers of photos, comma separated, 2 to 4.
    #[arg(long, default_value = "2,4", value_delimiter = ',', value_parser = clap::value_parser!(u8).range(2..=4))]
    photos: Vec<u8>,
    /// Seeds of the rooms, comma separated.
    #[arg(long, default_value = "1", value_delimiter = ',')]
    seeds: Vec<u64>,
    /// How far the oracle's answers are off: clean, real, harsh; drawn for each photo by itself.
    #[arg(long, default_value = "real")]
    noise: NoiseLevel,
    /// What the generator's meshes are made of.
    #[arg(long, default_value = "truth")]
    meshes: Meshes,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
}

/// Arguments of `bench compare`.
#[derive(Debug, clap::Args)]
struct CompareArgs {
    /// scores.json before (or the folder that holds it).
    before: PathBuf,
    /// scores.json after.
    after: PathBuf,
    /// Compare what was measured after scale alignment.
    #[arg(long)]
    aligned: bool,
}

/// Arguments of `bench fit`.
#[derive(Debug, clap::Args)]
struct FitArgs {
    /// Run folders, or folders of runs named <room>_<seed>: those of `bench run`, or replays of a model's recordings.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// A folder of rooms with truth, or one such room.
    #[arg(long)]
    rooms: PathBuf,
    /// File for what was found, as a part of harmony.toml (default: it is only printed).
    #[arg(long, short)]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Folders and files that cannot be used.
pub fn run(args: Args) -> Result<u8> {
    match args.command {
        Command::Run(args) => rooms(&args),
        Command::Generate(args) => make(&args),
        Command::Score(args) => judge(&args),
        Command::Views(args) => views(&args),
        Command::Ablate(args) => variants(&args),
        Command::Home(args) => super::bench_home::run(&args),
        Command::Join(args) => several(&args),
        Command::Compare(args) => {
            let result = |path: &Path| {
                let path = if path.is_dir() { path.join("scores.json") } else { path.to_owned() };
                read_result(&path).map_err(|e| hinted(e.to_string(), Some("`harmony bench run` writes scores.json")))
            };
            let (before, after) = (result(&args.before)?, result(&args.after)?);
            say!("before: {}\nafter:  {}\n", about(&before), about(&after))?;
            say!("{}", comparison(&compare(&before, &after, args.aligned)))?;
            Ok(EXIT_OK)
        }
        Command::Fit(args) => estimate(&args),
    }
}

fn estimate(args: &FitArgs) -> Result<u8> {
    let rooms = truths(&args.rooms, None)?;
    let used = config::load(None)?.settings.placement.noise;
    let (mut measured, mut failed) = (fit::Measured::default(), 0);
    for folder in &args.runs {
        for (run, room, _) in pairs(folder, &rooms)? {
            let truth = TruthRoom::load(&room).map_err(|e| hinted(e.to_string(), e.hint()))?;
            match measured.add(&truth, &run) {
                Ok(()) => tell!("{}", run.display()),
                Err(error) => {
                    tell!("{}: {error}", run.display());
                    failed += 1;
                }
            }
        }
    }
    let fitted = measured.fitted(&used);
    say!("{}", fit::table(&fitted).trim_end())?;
    say!("{} answers speak of nothing that is there", measured.unmatched())?;
    if let Some(out) = &args.out {
        harmony_io::write_atomic(out, fit::toml(&fitted).as_bytes())?;
        tell!("{}: copy its lines into harmony.toml", out.display());
    }
    Ok(exit_code(failed))
}

pub(super) fn runtime() -> Result<tokio::runtime::Runtime> {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    builder.enable_all().thread_stack_size(STACK).build().context("starting")
}

fn truths(folder: &Path, only: Option<&str>) -> Result<Vec<PathBuf>> {
    let mut rooms = rooms_in(folder).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let name = |path: &Path| path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    rooms.retain(|r| only.is_none_or(|o| name(r).contains(o)));
    if rooms.is_empty() {
        let text = format!("no room in {} is named like {:?}", folder.display(), only.unwrap_or_default());
        return Err(hinted(text, Some("--only takes a part of a room's name")));
    }
    Ok(rooms)
}

fn refused(error: &OverrideError) -> anyhow::Error {
    hinted(error.to_string(), error.hint())
}

fn request(args: &RunArgs) -> Result<BenchRequest> {
    let config = config::load(args.config.as_deref())?;
    let settings = config.settings;
    let told = [(args.untold, "shape untold"), (args.photo_alone, "photo alone")];
    let told = told.into_iter().filter(|(is_so, _)| *is_so).map(|(_, what)| what.to_owned());
    let noise = args.faults.iter().fold(args.noise.noise(), |noise, fault| noise.with(*fault));
    let faults = args.faults.iter().map(|fault| format!("fault {fault}"));
    Ok(BenchRequest {
        rooms: truths(&args.rooms, args.only.as_deref())?,
        out: args.out.clone(),
        level: args.noise,
        noise: Noise { features_untold: if args.untold { 1.0 } else { 0.0 }, photo_alone: args.photo_alone, ..noise },
        seeds: args.seeds.clone(),
        exact_height: args.exact_height,
        settings: with_changes(&settings, &args.changes).map_err(|e| refused(&e))?,
        changes: args.changes.iter().cloned().chain(told).chain(faults).collect(),
        points: args.points,
        jobs: args.jobs.into(),
        keep: args.keep,
        looking: networks::looking(&models::store(&config.models, None)),
        lit: args.lit.then(LitOptions::default),
        meshes: args.meshes,
    })
}

fn rooms(args: &RunArgs) -> Result<u8> {
    let request = request(args)?;
    let offline = players(args.lit);
    let result = runtime()?.block_on(run_bench(&request, &offline, &|line| tell!("{line}")))?;
    write_tables(&args.out, &result)?;
    print(&result)?;
    tell!("tables and pictures: {}", args.out.join("report.html").display());
    Ok(exit_code(result.raw.iter().filter(|r| r.failure.is_some()).count()))
}

fn make(args: &GenerateArgs) -> Result<u8> {
    let settings = GeneratorSettings { shapes: args.shapes.0.clone(), ..GeneratorSettings::default() };
    let last = args.first_seed.checked_add(args.count).context("seeds end at 2^64")?;
    for seed in args.first_seed..last {
        let begun = Instant::now();
        let room = generate(seed, &settings);
        let folder = args.folder.join(&room.name);
        write_room(&room, &folder)?;
        tell!(
            "{:>3}/{} {:<20} {:?}, {:.1} x {:.1} x {:.1} m, {} objects, {} in view, {:.1} s",
            seed - args.first_seed + 1,
            args.count,
            room.name,
            room.kind,
            room.extents.width,
            room.extents.height,
            room.extents.depth,
            room.objects.len(),
            room.objects.iter().filter(|o| o.visible_pixels > 0).count(),
            begun.elapsed().as_secs_f64()
        );
    }
    Ok(EXIT_OK)
}

fn by_protocols(args: &ScoreArgs) -> Result<u8> {
    let truths = truths_in(&args.truth).map_err(|e| hinted(e.to_string(), e.hint()))?;
    truths.iter().flat_map(|t| t.notes.iter().map(move |n| (t, n))).for_each(|(t, n)| tell!("{}: {n}", t.name));
    let pairs = pair_runs(&args.run, &truths);
    if pairs.is_empty() {
        return Err(hinted(
            format!("no run is in {}", args.run.display()),
            Some("name a run folder, or a folder of runs"),
        ));
    }
    let options = ProtocolOptions { protocols: args.protocol.clone(), points: args.points.max(1), seed: args.seed };
    let (mut scores, mut objects, mut failed) = (Vec::new(), Vec::new(), 0);
    for (run, truth) in &pairs {
        let Some(truth) = truth.map(|i| &truths[i]) else {
            tell!("{}: of no truth in {}", run.display(), args.truth.display());
            failed += 1;
            continue;
        };
        let prediction = match Prediction::load(run) {
            Ok(prediction) => prediction,
            Err(error) => {
                tell!("{}: {error}", run.display());
                failed += 1;
                continue;
            }
        };
        let surfaces = RunSurfaces::of(&prediction);
        let own = score_run(truth, &surfaces, run, &options);
        failed += own.iter().filter(|s| s.failure.is_some()).count();
        own.iter()
            .filter_map(|s| Some((s, s.failure.as_ref()?)))
            .for_each(|(s, f)| tell!("{}: {}: {f}", s.truth, s.protocol.name()));
        scores.extend(own);
        objects.extend(pieces(truth, &surfaces, args.seed));
        tell!("{}: {}", truth.name, run.display());
    }
    say!("{}", protocols::text(&scores, &objects).trim_end())?;
    if let Some(out) = &args.out {
        harmony_io::write_json(
            &out.join("protocols.json"),
            &serde_json::json!({"scores": scores, "objects": objects}),
        )?;
        harmony_io::write_atomic(&out.join("protocols.csv"), protocols::csv(&scores).as_bytes())?;
        harmony_io::write_atomic(&out.join("protocol_objects.csv"), protocols::objects_csv(&objects).as_bytes())?;
    }
    Ok(exit_code(failed))
}

fn judge(args: &ScoreArgs) -> Result<u8> {
    if !args.protocol.is_empty() {
        return by_protocols(args);
    }
    let rooms = truths(&args.truth, None)?;
    let looking = networks::looking(&models::store(&config::load(None)?.models, None));
    let judging = Judging { points: args.points, out: args.out.as_deref(), looking: &looking, lit: None };
    let runs = [args.run.clone()];
    let result = runtime()?.block_on(judge_finished(&runs, &rooms, judging, &|line| tell!("{line}")))?;
    if let Some(out) = &args.out {
        write_tables(out, &result)?;
    }
    print(&result)?;
    Ok(exit_code(result.raw.iter().filter(|r| r.failure.is_some()).count()))
}

/// This program's own players; with the path tracer only when lit pictures are wanted.
pub(super) fn players(lit: bool) -> Cast {
    if lit { harmony_players::offline_cast() } else { harmony_players::flat_cast() }
}

fn views(args: &ViewsArgs) -> Result<u8> {
    let mut rooms = truths(&args.rooms, args.room.as_deref())?;
    if let Some(exact) = rooms.iter().find(|r| r.file_name().and_then(|n| n.to_str()) == args.room.as_deref()) {
        rooms = vec![exact.clone()];
    }
    let looking = networks::looking(&models::store(&config::load(None)?.models, None));
    let cast = players(args.lit);
    let options = LitOptions { longest: args.lit_size, ..LitOptions::default() };
    let lit = args.lit.then_some(Lit { renderer: &*cast.lit_renderer, options });
    let judging = Judging { points: 0, out: args.out.as_deref(), looking: &looking, lit };
    let result = runtime()?.block_on(judge_finished(&args.runs, &rooms, judging, &|line| tell!("{line}")))?;
    if let Some(out) = &args.out {
        write_tables(out, &result)?;
        tell!("tables and pictures: {}", out.join("report.html").display());
    }
    say!("{}", views_text(&result.raw))?;
    let mut figures = summary(&result.raw);
    figures.retain(|f| f.name.starts_with("views ") || f.name.contains(" lit "));
    if figures.is_empty() {
        say!("no room of these has a folder `views`")?;
    } else {
        say!("{TEXT_HEADING}\n{}", text_table(&figures))?;
    }
    result.absent.iter().try_for_each(|line| say!("{line}"))?;
    Ok(exit_code(result.raw.iter().filter(|r| r.failure.is_some()).count()))
}

fn variants(args: &AblateArgs) -> Result<u8> {
    let request = request(&args.run)?;
    let offline = players(args.run.lit);
    let changes = if args.variants.is_empty() { ablate::variants(&request.settings) } else { args.variants.clone() };
    for change in changes.iter().filter(|c| *c != ablate::FULL) {
        with_change(&request.settings, change).map_err(|e| refused(&e))?;
    }
    let done = runtime()?.block_on(ablate(&request, &changes, &offline, &|line| tell!("{line}")));
    let ablation = done.map_err(|e| match e {
        AblationError::Override(e) => refused(&e),
        other => other.into(),
    })?;
    say!("{}, metres as delivered\n{}", ablation.title, ablate::text_table(&ablation))?;
    tell!("tables: {}", args.run.out.join("ablation.md").display());
    Ok(exit_code(ablation.variants.iter().map(|v| v.failed).sum()))
}

fn several(args: &JoinArgs) -> Result<u8> {
    let request = PhotosRequest {
        out: args.out.clone(),
        seeds: args.seeds.clone(),
        photos: args.photos.iter().map(|n| usize::from(*n)).collect(),
        level: args.noise,
        noise: args.noise.noise(),
        settings: config::load(args.config.as_deref())?.settings,
        meshes: args.meshes,
    };
    let offline = players(false);
    let rooms = runtime()?.block_on(photos::several(&request, &offline, &|line| tell!("{line}")))?;
    let lines = photos::lines(&rooms, &request.photos);
    let table = photos::markdown(&lines);
    let strangers = photos::strangers(&request);
    harmony_io::write_json(
        &args.out.join("photos.json"),
        &serde_json::json!({ "lines": lines, "rooms": rooms, "strangers": strangers }),
    )?;
    harmony_io::write_atomic(&args.out.join("photos.md"), table.as_bytes())?;
    say!("{}", table.trim_end())?;
    if strangers.pairs > 0 {
        say!(
            "of {} pairs of photos of different rooms {} were taken for one room; the highest odds are {:.1} nats",
            strangers.pairs,
            strangers.taken_for_one,
            strangers.odds[0]
        )?;
    }
    tell!("tables: {}", args.out.join("photos.md").display());
    Ok(EXIT_OK)
}

fn about(result: &BenchResult) -> String {
    let height = match (result.level, result.exact_height) {
        (None, _) => "",
        (_, true) => " (room height exact)",
        (_, false) => " (room height as noisy as the rest)",
    };
    let changes = if result.changes.is_empty() { String::new() } else { format!(", {}", result.changes.join(", ")) };
    let meshes = result.meshes.map_or_else(String::new, |m| format!(", meshes {}", m.name()));
    format!("{}{height}{meshes}{changes}", result.title)
}

fn print(result: &BenchResult) -> Result<()> {
    say!("{}, metres as delivered\n{TEXT_HEADING}\n{}", about(result), text_table(&summary(&result.raw)))?;
    say!("the same after scale alignment\n{}", text_table(&summary(&result.aligned)))?;
    result.absent.iter().try_for_each(|line| say!("{line}"))
}

fn exit_code(failed: usize) -> u8 {
    if failed > 0 {
        tell!("{failed} runs failed");
        return EXIT_INCOMPLETE;
    }
    EXIT_OK
}
