//! `harmony reconstruct`.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result};
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, SharedLimits, StopReason};
use harmony_io::load_photo;
use harmony_pipeline::{Phase, RunError, RunFolder, RunOutcome, RunRequest, Warnings};
use harmony_roles::Role;

use crate::cast::{self, CastRequest, Casting};
use crate::config::{self, Profile};
use crate::display::{Display, hinted, print_error};
use crate::{EXIT_ERROR, EXIT_INCOMPLETE, EXIT_OK, EXIT_STOPPED, say, stopping, tell};

/// Arguments.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Examples:
  harmony reconstruct room.jpg --out run
      what this program can do alone
  harmony reconstruct room.jpg --out run --profile files
      you (or any chat window) answer the questions that appear in run/questions
  harmony reconstruct examples/home_office.jpg --out run --replay examples/home_office_recording
      the bundled example, from a recording
  harmony reconstruct room.jpg --out run --profile paper
      the paper's cast; needs OPENAI_API_KEY, GEMINI_API_KEY and two servers (harmony doctor --profile paper)
  harmony reconstruct frame.png --out run --points depth.png --intrinsics 518.0,519.0,325.5,253.5
      with sensor depth
  harmony reconstruct door.jpg window.jpg --out run
      several photos of one room: each into run/photos/<n>, then joined (harmony join)")]
pub struct Args {
    /// The photo: JPEG, PNG, WebP, BMP, TIFF or PNM.
    photo: PathBuf,
    /// Further photos of the same room, from other places.
    #[arg(value_name = "PHOTO")]
    more: Vec<PathBuf>,
    /// Run folder; made when absent, gone on with when there.
    #[arg(long, short)]
    out: PathBuf,
    /// Who plays the roles.
    #[arg(long)]
    profile: Option<Profile>,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Answer from a recording (or another run's folder) by name.
    #[arg(long)]
    replay: Option<PathBuf>,
    /// A point map: .npz, or a 16-bit depth PNG / PGM (then give --intrinsics).
    #[arg(long)]
    points: Option<PathBuf>,
    /// fx,fy,cx,cy of the depth image, pixels.
    #[arg(long)]
    intrinsics: Option<String>,
    /// Depth units a metre (1000 = millimetres, 5000 = TUM).
    #[arg(long, default_value_t = 1000.0)]
    depth_scale: f64,
    /// Instance masks: a colour-coded image, or a folder of masks (labels from file names or labels.json).
    #[arg(long)]
    masks: Option<PathBuf>,
    /// Last phase to run: layout, wall, furniture, ceiling, decoration, lighting.
    #[arg(long)]
    until: Option<Phase>,
    /// Ask anew from this phase on (records of earlier phases are kept).
    #[arg(long)]
    from: Option<Phase>,
    /// Only this program: overrides the profile, and nothing outside is asked.
    #[arg(long)]
    offline_only: bool,
    /// Nothing may leave this machine: players elsewhere are refused.
    #[arg(long)]
    local_only: bool,
    /// Leave the path-traced render out even where Blender is there.
    #[arg(long)]
    no_lit: bool,
    /// Stop before more US dollars are spent in this run folder; overrides budget.usd.
    #[arg(long)]
    max_usd: Option<f64>,
    /// Stop before players outside are asked more often in this run folder; overrides budget.calls.
    #[arg(long)]
    max_calls: Option<usize>,
    /// Stop after so many minutes; overrides budget.minutes.
    #[arg(long)]
    max_minutes: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// An input or argument that cannot be used.
pub fn run(args: Args) -> Result<u8> {
    if !args.more.is_empty() {
        return several(&args);
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    runtime.block_on(reconstruct(args))
}

/// Several photos of one room: a run each below the result's folder, then all joined. Budgets are those of each run.
fn several(args: &Args) -> Result<u8> {
    for (given, name) in [
        (args.points.is_some(), "--points"),
        (args.masks.is_some(), "--masks"),
        (args.replay.is_some(), "--replay"),
        (args.until.is_some(), "--until"),
    ] {
        if given {
            let hint = "reconstruct each photo by itself, then `harmony join RUNS --out RUN`";
            return Err(hinted(format!("{name} is about one photo, and several were given"), Some(hint)));
        }
    }
    let photos: Vec<&PathBuf> = std::iter::once(&args.photo).chain(&args.more).collect();
    let mut runs = Vec::new();
    for (k, photo) in photos.iter().enumerate() {
        tell!("photo {} of {}: {}", k + 1, photos.len(), photo.display());
        let out = args.out.join("photos").join((k + 1).to_string());
        let code = run(Args { photo: (*photo).clone(), more: Vec::new(), out: out.clone(), ..args.clone() })?;
        if code != EXIT_OK {
            tell!("the photos are joined once all are reconstructed; run the same command again to go on");
            return Ok(code);
        }
        runs.push(out);
    }
    super::join::joined(&runs, &args.out, true)
}

async fn reconstruct(args: Args) -> Result<u8> {
    let config = config::load(args.config.as_deref())?;
    let profile =
        if args.offline_only { Profile::Offline } else { args.profile.or(config.profile).unwrap_or_default() };
    let photo = load_photo(&args.photo).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let _folder = RunFolder::take(&args.out).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let display = Display::new();
    let mut players = config.players.resolved(profile);
    players.local_only |= args.local_only;
    let request = CastRequest {
        profile,
        players,
        models: crate::models::store(&config.models, None),
        photo_size: photo.size(),
        points: args.points.as_deref(),
        intrinsics: args.intrinsics.as_deref(),
        depth_scale: args.depth_scale,
        masks: args.masks.as_deref(),
        questions: config.files.folder.clone().unwrap_or_else(|| args.out.join("questions")),
        tasks: Some(args.out.join("calls").join(cast::TASKS)),
        timeout_minutes: config.files.timeout_minutes,
        path_tracer: !args.no_lit,
        working_px: config.settings.working_px,
        tell: display.line_sink(),
    };
    let casting = cast::cast(&request)?;
    let shared = super::batch::shared_players(&request.players).await?;
    if args.replay.is_none() {
        look_around(&casting, &args.out, &request.tell).await?;
    }
    let warnings = Arc::new(Warnings::default());
    for note in &casting.notes {
        warnings.push(harmony_scene::Warning {
            phase: "input".into(),
            object: None,
            kind: harmony_scene::WarningKind::Input,
            message: note.clone(),
        });
    }
    for note in &casting.absent {
        warnings.push(harmony_scene::Warning {
            phase: "input".into(),
            object: None,
            kind: harmony_scene::WarningKind::NotAvailable,
            message: note.clone(),
        });
    }
    if let Some(from) = args.from {
        forget(&args.out, from)?;
    }
    let options =
        BookOptions { replay: args.replay.clone(), secrets: casting.secrets.clone(), ..BookOptions::default() };
    let book = CallBook::open(&args.out, options).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let collected = Arc::clone(&warnings);
    let mut budget = config.budget;
    budget.usd = args.max_usd.or(budget.usd);
    budget.calls = args.max_calls.or(budget.calls);
    budget.minutes = args.max_minutes.or(budget.minutes);
    budget.check().map_err(|e| anyhow::anyhow!(e))?;
    let options = CallOptions {
        on_warning: Arc::new(move |warning| collected.push(warning)),
        on_event: display.call_sink(),
        limits: config.limits,
        budget,
        prices: config.prices,
        shared: shared.clone().map(|shared| shared as Arc<dyn SharedLimits>),
        ..CallOptions::default()
    };
    let calls = Arc::new(Calls::new(Arc::new(book), casting.cast, casting.offline, options));
    stopping::on_interrupt(&calls);
    stopping::with_worker(&calls);
    let ticker = stopping::show_calls(&calls, &display);
    let replaying = args.replay.is_some();
    let run_request = RunRequest {
        title: args.photo.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
        photo,
        run: args.out.clone(),
        profile: if replaying { format!("{} (replayed)", profile.name()) } else { profile.name().to_owned() },
        settings: config.settings,
        until: args.until.unwrap_or(Phase::Lighting),
        path_tracer: !args.no_lit,
        further_inputs: casting.inputs,
    };
    let outcome = Box::pin(harmony_pipeline::run(&run_request, &calls, &warnings, &display.sink())).await;
    ticker.abort();
    super::batch::flush(shared).await;
    display.finish();
    match outcome {
        Ok(outcome) => {
            let code = report(&args, &outcome)?;
            let stopped = matches!(calls.stop().reason(), Some(StopReason::Interrupted(_) | StopReason::Budget(_)));
            Ok(if code == EXIT_INCOMPLETE && stopped { EXIT_STOPPED } else { code })
        }
        Err(error) => {
            let begun = matches!(error, RunError::File(_));
            print_error(&hinted(error.to_string(), error.hint()));
            if begun {
                tell!("what was obtained is kept in {}; run the same command again to go on", args.out.display());
            }
            Ok(if begun { EXIT_INCOMPLETE } else { EXIT_ERROR })
        }
    }
}

/// Asks hosted and local players whether they are there, before anything is computed. A run that was begun may be gone
/// on with without them: its answers are recorded, perhaps all that are needed.
async fn look_around(casting: &Casting, run: &std::path::Path, tell: &Arc<dyn Fn(String) + Send + Sync>) -> Result<()> {
    let begun = run.join("run.json").exists();
    for (role, name, result) in cast::check_all(&casting.checks, false).await {
        let Err(error) = result else { continue };
        let message = format!("{}: {name}: {error}", role.folder());
        if begun {
            tell(format!("{message}; going on with what is recorded"));
            continue;
        }
        let hint = error.hint().map_or_else(|| cast::unreachable_hint(role, &name), str::to_owned);
        return Err(hinted(message, Some(hint)));
    }
    Ok(())
}

/// Removes the records of a phase and all after it. What is asked anew may be paid anew: tasks at hosted services are
/// forgotten, too.
fn forget(run: &std::path::Path, from: Phase) -> Result<()> {
    let tasks = run.join("calls").join(cast::TASKS);
    if tasks.is_dir() && from < Phase::Lighting {
        std::fs::remove_dir_all(&tasks).with_context(|| format!("removing {}", tasks.display()))?;
    }
    for role in Role::ALL {
        for phase in Phase::ALL.into_iter().filter(|phase| *phase >= from) {
            let folder = run.join("calls").join(role.folder()).join(phase.folder());
            if folder.is_dir() {
                std::fs::remove_dir_all(&folder).with_context(|| format!("removing {}", folder.display()))?;
            }
        }
    }
    Ok(())
}

/// Tells how it went; returns the exit code.
fn report(args: &Args, outcome: &RunOutcome) -> Result<u8> {
    let out = args.out.display();
    if outcome.nothing_to_do {
        say!("{out} is finished already and nothing it depends on has changed: no call was made")?;
    }
    if let Some(scene) = &outcome.scene {
        let e = scene.room.extents;
        say!(
            "{}: {:.2} x {:.2} x {:.2} m, {} objects, {} warnings",
            scene.room.room_type,
            e.width,
            e.depth,
            e.height,
            scene.objects.len(),
            scene.warnings.len()
        )?;
    }
    let bill = &outcome.file.bill.total;
    say!(
        "calls: {} ({} by this program, {} from a recording), {:.2} questions for each placed object, {}",
        bill.calls,
        bill.offline,
        bill.recorded,
        outcome.file.questions_per_object,
        bill.usage.cost_usd.map_or_else(|| "no known cost".to_owned(), |c| format!("{c:.3} US$")),
    )?;
    for line in outcome.file.unseen() {
        say!("{line}")?;
    }
    if bill.calls > bill.offline + bill.recorded {
        super::bill::print(&outcome.file.bill, false)?;
    }
    if let Some(failure) = &outcome.failure {
        tell!("error: {failure}");
        if let Some(hint) = &failure.hint {
            tell!("hint: {hint}");
        }
        tell!("what was obtained is kept in {out}; run.json tells more");
        return Ok(EXIT_INCOMPLETE);
    }
    say!("look at {out}/report.html")?;
    Ok(EXIT_OK)
}
