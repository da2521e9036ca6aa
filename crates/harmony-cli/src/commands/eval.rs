//! `harmony eval`: finished runs on photos without truth, judged, and beside what other programs made.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use harmony_bench::ablate::{FULL, variants};
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls};
use harmony_eval::ablate::{self, AblateRequest, ablate_photos, subjects};
use harmony_eval::baked::{BakedOptions, export_baked};
use harmony_eval::judge::{self, JudgeOptions, Judgement, agreement, pairs};
use harmony_eval::rivals::{self, Axes, DrawOptions, RivalKind, RivalOptions};
use harmony_eval::score::{self, Look, RunSet, RunsError, SetOptions, comparisons, evaluate, find_set, table};
use harmony_io::load_photo;
use harmony_players::{FilesEvent, FilesOptions, FilesPlayer, flat_cast};
use harmony_roles::Role;
use harmony_scene::ImageSize;

use crate::cast::{self, Known};
use crate::config::players::Language;
use crate::config::{self, Profile};
use crate::display::hinted;
use crate::{EXIT_ERROR, EXIT_INCOMPLETE, EXIT_OK, models, networks, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "\
Examples:
  harmony eval runs --out eval
      every run folder in runs: three means of each figure, and a page with the worst on top
  harmony eval 'runs/bedroom_*' --against before=old_runs --out eval
      the same scenes in another set: paired differences, intervals and a sign test
  harmony eval renders --photos photos --name theirs
      pictures that another program rendered, by the names of the photos
  harmony eval rival --kind cast outputs/bedroom --run runs/bedroom --out rivals/cast/bedroom
      another program's scene drawn by our renderer; then: harmony eval runs --against cast=rivals/cast
  harmony eval judge ours=runs cast=rivals/cast --player openai --out judged
      both put to somebody who looks, in both orders, without names"
)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    score: ScoreArgs,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Put pairs of renders to a language model that sees, or to a person (`--player files`), in both orders.
    #[command(after_help = "Example:\n  harmony eval judge ours=runs cast=rivals/cast --player openai --out judged")]
    Judge(JudgeArgs),
    /// Read another program's finished scene and draw it from the photo's place by our flat renderer.
    #[command(after_help = "\
Example:
  harmony eval rival --kind cast outputs/bedroom --run runs/bedroom --out rivals/cast/bedroom")]
    Rival(RivalArgs),
    /// The paper's ablation table on photos with recordings.
    #[command(after_help = "\
Example:
  harmony eval ablate photos --recordings recordings --out ablation --only bedroom")]
    Ablate(AblateArgs),
    /// Write a run's scene with transforms baked into the vertices and shell names that the paper's scripts drop.
    #[command(after_help = "Example:\n  harmony eval export-baked run --out baked.glb --furniture")]
    ExportBaked(BakedArgs),
}

/// Arguments of scoring.
#[derive(Debug, clap::Args)]
struct ScoreArgs {
    /// Run folders, folders of runs, patterns, list files (a folder a line, or NAME,FOLDER), or folders of pictures.
    #[arg(required = true)]
    runs: Vec<String>,
    /// What this set is called.
    #[arg(long, default_value = "ours")]
    name: String,
    /// Another set over the same photos, NAME=SET or SET; may be repeated.
    #[arg(long, value_name = "NAME=SET")]
    against: Vec<String>,
    /// Photos for renders that have none beside them, by name.
    #[arg(long)]
    photos: Option<PathBuf>,
    /// Folder for eval.json, scenes.csv, table.csv and eval.html (default: the table is only printed).
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Take runs of several versions of the program as one set.
    #[arg(long)]
    mixed: bool,
}

/// Arguments of `eval judge`.
#[derive(Debug, clap::Args)]
struct JudgeArgs {
    /// Two or more sets over the same photos, NAME=SET or SET.
    #[arg(required = true, num_args = 2..)]
    sets: Vec<String>,
    /// Folder for judge.json, judge.html and the record of every call.
    #[arg(long, short)]
    out: PathBuf,
    /// Who looks: files, openai, openai_chat, gemini, anthropic, compatible (default: the configuration's).
    #[arg(long)]
    player: Option<String>,
    /// Its model.
    #[arg(long)]
    model: Option<String>,
    /// Profile whose language model looks, without --player.
    #[arg(long)]
    profile: Option<Profile>,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Which render is shown: flat, lit.
    #[arg(long, default_value = "flat", value_parser = look)]
    look: Look,
    /// How often each pair is asked about, each time in both orders.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=20))]
    rounds: u8,
    /// Decides which set comes first in a pair's first question, and the bootstrap.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// judge.json of another judge of the same sets, for the agreement; may be repeated.
    #[arg(long)]
    with: Vec<PathBuf>,
    /// Answer from a recording by name.
    #[arg(long)]
    replay: Option<PathBuf>,
    /// Take runs of several versions of the program as one set.
    #[arg(long)]
    mixed: bool,
}

/// Arguments of `eval rival`.
#[derive(Debug, clap::Args)]
struct RivalArgs {
    /// Folder of the finished output (or its one file).
    folder: PathBuf,
    /// Whose it is: harmony-release, gen3dsr, sam3d, 3d-re-gen, cast, viga, midi, scenegen, sceneconductor, generic.
    #[arg(long)]
    kind: RivalKind,
    /// Our run of the same photo: lends its background, and the frame for the view from above.
    #[arg(long, required_unless_present = "photo")]
    run: Option<PathBuf>,
    /// The photo, without a run.
    #[arg(long)]
    photo: Option<PathBuf>,
    /// Folder for input.*, render_flat.png, render_canonical.png, rival.glb, rival.json.
    #[arg(long, short)]
    out: PathBuf,
    /// A camera file in place of the output's own.
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Which camera of a GLB that has several.
    #[arg(long)]
    camera_name: Option<String>,
    /// Horizontal field of view, degrees, for a scene in its camera's frame without a focal length.
    #[arg(long)]
    hfov: Option<f64>,
    /// Axes of a generic file: y-up, z-up, opencv, pytorch3d.
    #[arg(long)]
    axes: Option<Axes>,
    /// Lend no background.
    #[arg(long)]
    no_background: bool,
    /// Draw it even when next to nothing is in the picture.
    #[arg(long)]
    anyway: bool,
}

/// Arguments of `eval ablate`.
#[derive(Debug, clap::Args)]
struct AblateArgs {
    /// Folder of the photos.
    photos: PathBuf,
    /// Folder of their recordings, each named like its photo.
    #[arg(long)]
    recordings: PathBuf,
    /// Folder for the runs and the tables.
    #[arg(long, short)]
    out: PathBuf,
    /// Only these variants, comma separated: full, or changes such as placement.refinement=false.
    #[arg(long, value_delimiter = ',')]
    variants: Vec<String>,
    /// Only photos whose name contains this.
    #[arg(long)]
    only: Option<String>,
    /// Judge lit renders, too; needs Blender, minutes a run.
    #[arg(long)]
    lit: bool,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Arguments of `eval export-baked`.
#[derive(Debug, clap::Args)]
struct BakedArgs {
    /// Run folder.
    run: PathBuf,
    /// The GLB file to write.
    #[arg(long, short)]
    out: PathBuf,
    /// Only the room and the furniture on its floor, which is what the paper's geometry truth holds.
    #[arg(long)]
    furniture: bool,
}

fn look(text: &str) -> Result<Look, String> {
    Look::ALL.into_iter().find(|l| l.name() == text).ok_or_else(|| "looks are flat, lit".to_owned())
}

/// Runs the command.
///
/// # Errors
/// Sets that cannot be used, files that cannot be written.
pub fn run(args: &Args) -> Result<u8> {
    match &args.command {
        None => scores(&args.score),
        Some(Command::Judge(args)) => judges(args),
        Some(Command::Rival(args)) => rival(args),
        Some(Command::Ablate(args)) => ablation(args),
        Some(Command::ExportBaked(args)) => {
            let options = BakedOptions { furniture_only: args.furniture };
            let names = export_baked(&args.run, &args.out, options).map_err(|e| hinted(e.to_string(), e.hint()))?;
            say!("{}: {} meshes without transforms", args.out.display(), names.len())?;
            Ok(EXIT_OK)
        }
    }
}

/// `NAME=SET`, or a set of a name of its own.
fn named(text: &str, or: &str) -> (String, String) {
    match text.split_once('=') {
        Some((name, source)) if !name.is_empty() && !source.is_empty() => (name.to_owned(), source.to_owned()),
        _ => (or.to_owned(), text.to_owned()),
    }
}

fn add(sets: &mut Vec<RunSet>, name: &str, sources: &[String], options: &SetOptions) -> Result<()> {
    if sets.iter().any(|s| s.name == name) {
        return Err(hinted(format!("two sets are named {name}"), Some("NAME=SET gives a set a name")));
    }
    sets.push(find_set(name, sources, options).map_err(|e| refused(&e))?);
    Ok(())
}

fn scores(args: &ScoreArgs) -> Result<u8> {
    let options = SetOptions { photos: args.photos.clone(), mixed: args.mixed };
    let mut sets = Vec::new();
    add(&mut sets, &args.name, &args.runs, &options)?;
    for (i, text) in args.against.iter().enumerate() {
        let (name, source) = named(text, &format!("other{}", if i == 0 { String::new() } else { (i + 1).to_string() }));
        add(&mut sets, &name, &[source], &options)?;
    }
    let looks = networks::looks(&models::store(&config::load(None)?.models, None));
    let evaluation = evaluate(&sets, &looks, args.seed, &|line| tell!("{line}"));
    say!("{}", table(&evaluation).trim_end())?;
    if !evaluation.comparisons.is_empty() {
        say!("\n{}", comparisons(&evaluation).trim_end())?;
    }
    evaluation.notes.iter().try_for_each(|note| say!("{note}"))?;
    if let Some(out) = &args.out {
        score::write(out, &evaluation).map_err(|e| hinted(e.to_string(), e.hint()))?;
        tell!("tables and pictures: {}", out.join("eval.html").display());
    }
    Ok(exit_code(&sets, evaluation.columns.is_empty()))
}

fn exit_code(sets: &[RunSet], nothing: bool) -> u8 {
    let failed = sets[0].runs.iter().filter(|r| r.failure.is_some()).count();
    match (nothing, failed) {
        (true, _) => EXIT_ERROR,
        (_, 0) => EXIT_OK,
        _ => {
            tell!("{failed} of {} runs have no render", sets[0].runs.len());
            EXIT_INCOMPLETE
        }
    }
}

fn refused(error: &RunsError) -> anyhow::Error {
    hinted(error.to_string(), error.hint())
}

fn judges(args: &JudgeArgs) -> Result<u8> {
    let options = SetOptions { photos: None, mixed: args.mixed };
    let mut sets = Vec::new();
    for (i, text) in args.sets.iter().enumerate() {
        let (name, source) = named(text, &format!("set{}", i + 1));
        add(&mut sets, &name, &[source], &options)?;
    }
    let scenes = pairs(&sets, args.look).map_err(|e| hinted(e.to_string(), Some(e.hint())))?;
    // Other judgements are read first: nobody is asked for nothing.
    let others: Vec<Judgement> = args.with.iter().map(|p| other(p)).collect::<Result<_>>()?;
    let calls = player(args)?;
    let names: Vec<String> = sets.iter().map(|s| s.name.clone()).collect();
    let how = JudgeOptions { look: args.look, rounds: args.rounds.into(), seed: args.seed };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    let told = |line: String| tell!("{line}");
    let judgement = runtime.block_on(judge::judge(&scenes, &names, how, &calls, &told));
    let write = |file: &str, text: &str| {
        let path = args.out.join(file);
        harmony_io::write_atomic(&path, text.as_bytes()).map_err(|e| hinted(e.to_string(), e.hint()))
    };
    harmony_io::write_json(&args.out.join("judge.json"), &judgement).map_err(|e| hinted(e.to_string(), e.hint()))?;
    write("judge.html", &judge::page(&judgement, &scenes))?;
    say!("{}", judge::text(&judgement).trim_end())?;
    for other in &others {
        say!("\nagreement with {}", other.judge)?;
        for a in agreement(&judgement, other) {
            let cell = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
            say!("{:<16} n {:>4}  same {:>5}  kappa {:>5}", a.criterion.title(), a.n, cell(a.same), cell(a.kappa))?;
        }
    }
    tell!("pictures and what was said: {}", args.out.join("judge.html").display());
    let unanswered = judgement.trials.iter().filter(|t| t.verdicts.is_none()).count();
    if unanswered > 0 {
        tell!(
            "{unanswered} of {} questions have no answer; run the same command again to ask them",
            judgement.trials.len()
        );
    }
    Ok(if unanswered > 0 { EXIT_INCOMPLETE } else { EXIT_OK })
}

fn ablation(args: &AblateArgs) -> Result<u8> {
    let config = config::load(args.config.as_deref())?;
    let mut found = subjects(&args.photos, &args.recordings).map_err(|e| {
        hinted(e.to_string(), Some("`harmony record` keeps a run's answers; name the recording like the photo"))
    })?;
    found.retain(|s| args.only.as_ref().is_none_or(|o| s.name.contains(o.as_str())));
    if found.is_empty() {
        return Err(hinted("no photo is left".to_owned(), Some("--only takes a part of a photo's name")));
    }
    let mut changes = if args.variants.is_empty() { variants(&config.settings) } else { args.variants.clone() };
    // What the others are compared with.
    changes.retain(|c| c != FULL);
    changes.insert(0, FULL.to_owned());
    let looks = networks::looks(&models::store(&config.models, None));
    let request = AblateRequest {
        subjects: found,
        out: args.out.clone(),
        settings: config.settings,
        changes,
        lit: args.lit,
        seed: args.seed,
    };
    let cast = if args.lit { harmony_players::offline_cast() } else { flat_cast() };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    let done = runtime.block_on(ablate_photos(&request, &cast, &looks, &|line| tell!("{line}")))?;
    say!("{}", ablate::text(&done).trim_end())?;
    done.evaluation.notes.iter().try_for_each(|note| say!("{note}"))?;
    let failed: usize = done.variants.iter().map(|v| v.failed).sum();
    Ok(if failed > 0 { EXIT_INCOMPLETE } else { EXIT_OK })
}

fn other(path: &Path) -> Result<Judgement> {
    let path = if path.is_dir() { path.join("judge.json") } else { path.to_owned() };
    harmony_io::read_json(&path).map_err(|e| hinted(e.to_string(), Some("`harmony eval judge` writes judge.json")))
}

/// Who looks, with every call recorded in the folder.
fn player(args: &JudgeArgs) -> Result<Calls> {
    let config = config::load(args.config.as_deref())?;
    let profile = args.profile.or(config.profile).unwrap_or_default();
    let mut players = config.players.resolved(profile);
    if let Some(name) = &args.player {
        let language: Language = serde_json::from_value(serde_json::Value::String(name.clone())).map_err(|_| {
            let known = "players are files, openai, openai_chat, gemini, anthropic, compatible";
            hinted(format!("no player is named {name:?}"), Some(known))
        })?;
        players.vision_language.player = Some(language);
    }
    if args.model.is_some() {
        players.vision_language.model.clone_from(&args.model);
    }
    let mut cast = flat_cast();
    let offline = cast.clone();
    let mut known = Known::default();
    if players.vision_language.player == Some(Language::Files) {
        let questions = args.out.join("questions");
        tell!("questions will appear in {}", questions.display());
        let mut options = FilesOptions::new(&questions);
        options.on_event = Arc::new(|event| match event {
            FilesEvent::Waiting { folder, open, answered, .. } => {
                tell!("waiting for {}/answer.json ({open} open, {answered} answered)", folder.display());
            }
            FilesEvent::Complained { folder, .. } => {
                tell!("{}/answer.json was not accepted: complaint.md says why", folder.display());
            }
            _ => {}
        });
        cast.vision_language = Arc::new(FilesPlayer::new(options));
    } else {
        let failures = cast::cast_services(&mut cast, &players, None, &mut known);
        if let Some((_, error)) = failures.into_iter().find(|(role, _)| *role == Role::VisionLanguage) {
            return Err(hinted(error.to_string(), error.hint().map(str::to_owned)));
        }
    }
    if !cast.vision_language.sees() && args.replay.is_none() {
        let hint = "--player files (you look), or a player with a key or a server: docs/players.md";
        return Err(hinted("nobody here looks at pictures".to_owned(), Some(hint)));
    }
    let options = BookOptions { replay: args.replay.clone(), secrets: known.secrets, ..BookOptions::default() };
    let book = CallBook::open(&args.out, options).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let options =
        CallOptions { limits: config.limits, budget: config.budget, prices: config.prices, ..CallOptions::default() };
    Ok(Calls::new(Arc::new(book), cast, offline, options))
}

fn rival(args: &RivalArgs) -> Result<u8> {
    let photo = args.photo.as_ref().map(|p| load_photo(p).map_err(|e| hinted(e.to_string(), e.hint()))).transpose()?;
    let in_run = || -> Option<ImageSize> {
        let scene: harmony_scene::Scene = harmony_io::read_json(&args.run.as_ref()?.join("scene.json")).ok()?;
        Some(scene.camera.size)
    };
    let options = RivalOptions {
        camera: args.camera.clone(),
        camera_name: args.camera_name.clone(),
        hfov: args.hfov.map(f64::to_radians),
        axes: args.axes,
        photo: photo.map(|p| p.size()).or_else(in_run),
    };
    let refused = |e: rivals::RivalError| hinted(e.to_string(), e.hint());
    let scene = rivals::load(args.kind, &args.folder, &options).map_err(refused)?;
    let how = DrawOptions {
        run: args.run.clone(),
        photo: args.photo.clone(),
        lend_background: !args.no_background,
        anyway: args.anyway,
    };
    let drawn = rivals::draw(&scene, &args.folder, &how).map_err(refused)?;
    rivals::write(&args.out, &drawn).map_err(refused)?;
    let r = &drawn.report;
    let star = if r.background_lent { ", background lent by our run (*)" } else { "" };
    say!(
        "{}: {} parts, {:.0} % of its objects in the picture, {:.0} % of the picture covered{star}",
        args.kind.name(),
        r.parts.len(),
        100.0 * r.share_inside,
        100.0 * r.coverage
    )?;
    if let Some(overlap) = r.overlap_with_run {
        say!("objects' pixels over our run's: IoU {overlap:.2}")?;
    }
    if let Some(scale) = r.scale_to_run {
        say!("scale to our run: {scale:.3}")?;
    }
    r.files.iter().try_for_each(|f| say!("read: {}", f.display()))?;
    r.notes.iter().try_for_each(|n| say!("note: {n}"))?;
    say!("{}", args.out.join("render_flat.png").display())?;
    Ok(EXIT_OK)
}
