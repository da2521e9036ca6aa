//! `harmony batch` and `harmony worker`: many photos, many machines. The logic is in `harmony-batch`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use harmony_batch::queue::{Ended, Filter, NewSet, SetRow, SetState, SharedPlayers};
use harmony_batch::status::{Status, spoken, write_table};
use harmony_batch::{
    BatchError, Queue, QueueAddress, SetFolder, Submission, WorkerEvent, WorkerOptions, WorkerReport, WorkerStop,
    inside, work,
};
use harmony_players::http::{is_loopback, parse_address};
use harmony_roles::Role;

use crate::config::Profile;
use crate::config::players::PlayersConfig;
use crate::display::hinted;
use crate::{EXIT_ERROR, EXIT_INCOMPLETE, EXIT_OK, EXIT_STOPPED, say, tell};

/// Connections of a worker: claims, ends, heartbeats.
const CONNECTIONS: u32 = 4;

/// How long the ends of calls are told to the queue when a scene's program ends.
const LAST_WORDS: Duration = Duration::from_secs(10);

/// Arguments of `harmony batch`.
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "\
Examples:
  harmony batch photos --out set --profile paper --max-usd 50 --places 4
      all photos of a folder, four at a time; run it again to go on, or with more photos to add them
  harmony batch list.txt --out /shared/set --queue postgres://harmony@db/harmony --only-queue
  harmony worker --queue postgres://harmony@db/harmony --places 2
      the same on many machines: queue once, then any number of workers
  harmony batch status set
  harmony batch retry set --stage 3_furniture --cause 'no answer'
docs/batch.md tells more."
)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    submit: Submit,
}

#[derive(Debug, clap::Args)]
struct Submit {
    /// A folder of photos, or a list: one path a line, after a tabulator its priority.
    #[arg(required = true)]
    photos: Option<PathBuf>,
    /// The set's folder; made when absent, added to when there.
    #[arg(long, short, required = true)]
    out: Option<PathBuf>,
    /// Where the queue is: postgres://user@host/database, or an SQLite file (default: queue.sqlite in the set).
    #[arg(long, env = "HARMONY_QUEUE")]
    queue: Option<String>,
    /// Who plays the roles.
    #[arg(long)]
    profile: Option<Profile>,
    /// Configuration (default: harmony.toml here, if there is one); a copy of it is the set's.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Answer from a recording.
    #[arg(long)]
    replay: Option<PathBuf>,
    /// Further arguments of `harmony reconstruct`, such as --no-lit; paths must be absolute.
    #[arg(last = true)]
    more: Vec<String>,
    /// Higher goes first.
    #[arg(long, default_value_t = 0, allow_hyphen_values = true)]
    priority: i64,
    /// Pause before more US dollars are spent for all scenes together.
    #[arg(long)]
    max_usd: Option<f64>,
    /// Pause before players outside are asked more often for all scenes together.
    #[arg(long)]
    max_calls: Option<i64>,
    /// Times that a scene may fail before it is set aside.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(i64).range(1..=100))]
    attempts: i64,
    /// Times that a scene may lose its worker before it is set aside.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(i64).range(1..=1_000_000))]
    losses: i64,
    /// Scenes that fail in a row before the set is paused; 0 = never.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(i64).range(0..))]
    pause_after: i64,
    /// Minutes after which a scene counts as hung; 0 = never.
    #[arg(long, default_value_t = 0.0)]
    scene_minutes: f64,
    /// Seconds that a worker may be silent before its scenes go to others.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(i64).range(2..=86_400))]
    lease: i64,
    /// Scenes at a time here.
    #[arg(long, default_value_t = 1)]
    places: usize,
    /// Only queue; workers are started elsewhere.
    #[arg(long)]
    only_queue: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// What a set has come to; also writes status.html, status.json and scenes.csv into it.
    #[command(after_help = "Example:\n  harmony batch status set")]
    Status {
        #[command(flatten)]
        which: Which,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Begin no further scenes; what runs goes on, workers wait.
    #[command(after_help = "Example:\n  harmony batch pause set")]
    Pause(Which),
    /// Begin scenes again.
    #[command(after_help = "Example:\n  harmony batch resume set --max-usd 80")]
    Resume {
        #[command(flatten)]
        which: Which,
        /// A higher budget, US dollars for all scenes together.
        #[arg(long)]
        max_usd: Option<f64>,
        /// More calls for all scenes together.
        #[arg(long)]
        max_calls: Option<i64>,
    },
    /// Begin no further scenes; what runs goes on, workers end.
    #[command(after_help = "Example:\n  harmony batch drain set")]
    Drain(Which),
    /// Begin no further scenes, and stop what runs after its calls in flight.
    #[command(after_help = "Example:\n  harmony batch cancel set --scene kitchen_03")]
    Cancel {
        #[command(flatten)]
        which: Which,
        /// This scene only.
        #[arg(long)]
        scene: Option<String>,
    },
    /// Put failed scenes back into the queue.
    #[command(after_help = "Example:\n  harmony batch retry set --stage 3_furniture --cause 'no answer'")]
    Retry {
        #[command(flatten)]
        which: Which,
        /// Those whose cause contains this.
        #[arg(long)]
        cause: Option<String>,
        /// Those that failed at this stage.
        #[arg(long)]
        stage: Option<String>,
        /// This one.
        #[arg(long)]
        scene: Option<String>,
        /// Cancelled ones instead.
        #[arg(long)]
        cancelled: bool,
    },
    /// Set the priority of scenes that have not begun.
    #[command(after_help = "Example:\n  harmony batch priority set 10 --scene kitchen_03")]
    Priority {
        #[command(flatten)]
        which: Which,
        /// Higher goes first.
        #[arg(allow_hyphen_values = true)]
        priority: i64,
        /// This one only.
        #[arg(long)]
        scene: Option<String>,
    },
}

#[derive(Debug, clap::Args)]
struct Which {
    /// The set's folder.
    set: PathBuf,
    /// Its queue, where the set's own note has no password.
    #[arg(long, env = "HARMONY_QUEUE")]
    queue: Option<String>,
}

/// Arguments of `harmony worker`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony worker --set set --places 2
  harmony worker --queue postgres://harmony@db/harmony")]
pub struct WorkerArgs {
    /// Only this set, by its folder as seen from here; left out, all sets of the queue.
    #[arg(long)]
    set: Option<PathBuf>,
    /// The queue (default: the set's).
    #[arg(long, env = "HARMONY_QUEUE", required_unless_present = "set")]
    queue: Option<String>,
    /// Scenes at a time.
    #[arg(long, default_value_t = 1)]
    places: usize,
    /// End when nothing is left to do; else wait for more.
    #[arg(long)]
    until_idle: bool,
}

fn shown(error: &BatchError) -> anyhow::Error {
    hinted(error.to_string(), error.hint())
}

fn block_on<T>(work: impl Future<Output = Result<T>>) -> Result<T> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    runtime.block_on(work)
}

/// Runs `harmony batch`.
///
/// # Errors
/// Photos, a set or a queue that cannot be used.
pub fn run(args: Args) -> Result<u8> {
    block_on(async {
        match args.command {
            Some(command) => Box::pin(control(command)).await,
            None => Box::pin(submit(args.submit)).await,
        }
    })
}

async fn submit(args: Submit) -> Result<u8> {
    let (Some(photos), Some(out)) = (args.photos, args.out) else { return Ok(EXIT_ERROR) };
    let what = Submission { from: photos, priority: args.priority };
    what.check().map_err(|e| shown(&e))?;
    let config = config_text(args.config.as_deref())?;
    let mut all: Vec<String> =
        ["reconstruct", "{photo}", "--out", "{run}", "--config", "{set}/harmony.toml"].map(str::to_owned).into();
    if let Some(profile) = args.profile {
        all.extend(["--profile".to_owned(), profile.name().to_owned()]);
    }
    if let Some(replay) = &args.replay {
        let absolute = std::path::absolute(replay).context("the recording's path")?;
        if !absolute.is_dir() {
            return Err(hinted(format!("there is no recording at {}", replay.display()), Some("check --replay")));
        }
        all.extend(["--replay".to_owned(), absolute.display().to_string()]);
    }
    all.extend(args.more);
    let address = args.queue.as_deref().map(QueueAddress::parse).transpose().map_err(|e| shown(&e))?;
    let generator = concat!("harmony ", env!("CARGO_PKG_VERSION"));
    // A queue that cannot be used is found before a folder is made for it.
    if let Some(address) = &address {
        Queue::create(address, 1).await.map_err(|e| shown(&e))?.close().await;
    }
    let set = SetFolder::make(&out, address.as_ref(), &all, &config, generator).map_err(|e| shown(&e))?;
    let queue = open(&set, args.queue.as_deref(), true).await?;
    let new = NewSet {
        name: set.name().to_owned(),
        folder: std::path::absolute(&out).unwrap_or(out).display().to_string(),
        args: set.args().to_vec(),
        attempts: args.attempts,
        losses: args.losses,
        lease_ms: args.lease * 1000,
        retry_ms: 10_000,
        timeout_ms: (args.scene_minutes.clamp(0.0, 1e6) * 60_000.0) as i64,
        streak: args.pause_after,
    };
    let row = queue.put_set(&new).await.map_err(|e| shown(&e))?;
    queue.set_budget(row.id, args.max_usd, args.max_calls).await.map_err(|e| shown(&e))?;
    let known = queue.names(row.id).await.map_err(|e| shown(&e))?;
    let submitted = set.take_photos(&what, &known).map_err(|e| shown(&e))?;
    let added = queue.enqueue(row.id, &submitted.jobs).await.map_err(|e| shown(&e))?;
    say!("{added} scenes queued, {} were there already or twice", submitted.twice)?;
    if args.only_queue {
        say!("start workers: harmony worker --set {} --queue {}", set.path().display(), queue.address().shown())?;
        return Ok(EXIT_OK);
    }
    let stop = WorkerStop::default();
    let report = labour(&queue, Some(set.clone()), args.places, true, args.lease, &stop).await?;
    finish(&queue, &set, report, &stop).await
}

/// The configuration as text: the same for all workers, whatever lies in their folders.
fn config_text(named: Option<&Path>) -> Result<String> {
    // Read as `reconstruct` reads it, so that a mistake is found now.
    crate::config::load(named)?;
    let usual = Path::new("harmony.toml");
    let path = named.or_else(|| usual.is_file().then_some(usual));
    path.map_or_else(
        || Ok("# all as usual\n".to_owned()),
        |path| std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display())),
    )
}

async fn open(set: &SetFolder, given: Option<&str>, make: bool) -> Result<Queue> {
    let address = set.queue(given).map_err(|e| shown(&e))?;
    let queue =
        if make { Queue::create(&address, CONNECTIONS).await } else { Queue::open(&address, CONNECTIONS).await };
    queue.map_err(|e| shown(&e))
}

/// Works, tells what happens, and listens to Ctrl-C.
async fn labour(
    queue: &Queue,
    only: Option<SetFolder>,
    places: usize,
    until_idle: bool,
    lease_s: i64,
    stop: &WorkerStop,
) -> Result<WorkerReport> {
    let options = WorkerOptions {
        slots: places.max(1),
        only,
        until_idle,
        heartbeat: Duration::from_secs_f64((lease_s as f64 / 4.0).min(15.0)),
        on_event: Arc::new(tell_event),
        ..WorkerOptions::new(std::env::current_exe().context("finding this program")?)
    };
    let wanted = stop.clone();
    let listener = tokio::spawn(async move {
        // Slurm and Kubernetes end a job with SIGTERM.
        interrupted().await;
        tell!("stopping: calls in flight are awaited and recorded, scenes go back into the queue (again: kill them)");
        wanted.soon();
        interrupted().await;
        wanted.now();
    });
    let report = work(queue, options, stop).await;
    listener.abort();
    report.map_err(|e| shown(&e))
}

#[cfg(unix)]
async fn interrupted() {
    use tokio::signal::unix::{SignalKind, signal};
    let Ok(mut terminate) = signal(SignalKind::terminate()) else { return std::future::pending().await };
    tokio::select! {
        _ = terminate.recv() => {}
        ended = tokio::signal::ctrl_c() => if ended.is_err() { std::future::pending().await },
    }
}

#[cfg(not(unix))]
async fn interrupted() {
    if tokio::signal::ctrl_c().await.is_err() {
        std::future::pending().await
    }
}

fn tell_event(event: WorkerEvent) {
    match event {
        WorkerEvent::Began { scene } => tell!("{scene}: begins"),
        WorkerEvent::Ended { scene, ended, time } => {
            let time = spoken(time.as_secs_f64());
            match ended {
                Ended::Done => tell!("{scene}: done in {time}"),
                Ended::Failed { stage, message, .. } => tell!("{scene}: failed after {time} at {stage}: {message}"),
                Ended::Cancelled => tell!("{scene}: cancelled"),
                Ended::Again { .. } => tell!("{scene}: goes back into the queue"),
            }
        }
        WorkerEvent::PutBack { scenes } => tell!("lost by their workers, queued again: {}", scenes.join(", ")),
        WorkerEvent::Away { reason } => tell!("{reason}; waiting for it"),
        WorkerEvent::Back => tell!("the queue is back"),
        _ => {}
    }
}

/// Writes what the set has come to, and says it.
async fn finish(queue: &Queue, set: &SetFolder, report: WorkerReport, stop: &WorkerStop) -> Result<u8> {
    let status = written(queue, set).await?;
    say!("{}", status.text(set.path()))?;
    say!("{} scenes made here; look at {}", report.done, set.path().join("status.html").display())?;
    let counts = &status.counts;
    Ok(match () {
        () if stop.is_wanted() || counts.open() > 0 => EXIT_STOPPED,
        () if counts.failed > 0 => EXIT_INCOMPLETE,
        () => EXIT_OK,
    })
}

async fn written(queue: &Queue, set: &SetFolder) -> Result<Status> {
    let status = Status::of(queue, set.name()).await.map_err(|e| shown(&e))?;
    status.write(set).map_err(|e| shown(&e))?;
    write_table(queue, &status.set, set).await.map_err(|e| shown(&e))?;
    Ok(status)
}

async fn known(which: &Which) -> Result<(SetFolder, Queue, SetRow)> {
    let set = SetFolder::open(&which.set).map_err(|e| shown(&e))?;
    let queue = open(&set, which.queue.as_deref(), false).await?;
    let row = queue.set(set.name()).await.map_err(|e| shown(&e))?;
    Ok((set, queue, row))
}

async fn control(command: Command) -> Result<u8> {
    match command {
        Command::Status { which, json } => {
            let (set, queue, _) = known(&which).await?;
            let status = written(&queue, &set).await?;
            if json {
                say!("{}", serde_json::to_string_pretty(&status)?)?;
            } else {
                say!("{}", status.text(set.path()))?;
            }
        }
        Command::Pause(which) => change(&which, SetState::Paused, "by hand").await?,
        Command::Drain(which) => change(&which, SetState::Draining, "").await?,
        Command::Resume { which, max_usd, max_calls } => {
            let (_, queue, row) = known(&which).await?;
            queue.set_budget(row.id, max_usd, max_calls).await.map_err(|e| shown(&e))?;
            change(&which, SetState::Running, "").await?;
        }
        Command::Cancel { which, scene } => {
            let (_, queue, row) = known(&which).await?;
            if let Some(scene) = scene {
                let n = queue.cancel_scene(row.id, &scene).await.map_err(|e| shown(&e))?;
                some(n, "scene of that name that has not ended")?;
                say!("{scene}: cancelled (at once, or after its calls in flight)")?;
            } else {
                let (waiting, running) = queue.cancel_set(row.id).await.map_err(|e| shown(&e))?;
                say!("{waiting} scenes cancelled, {running} that run stop after their calls in flight")?;
            }
        }
        Command::Retry { which, cause, stage, scene, cancelled } => {
            let (_, queue, row) = known(&which).await?;
            let filter = Filter { cause, stage, scene, cancelled };
            let n = queue.retry(row.id, &filter).await.map_err(|e| shown(&e))?;
            some(n, if cancelled { "cancelled scene that fits" } else { "failed scene that fits" })?;
            say!("{n} scenes queued again")?;
            if row.state != SetState::Running {
                say!("the set is {}: `harmony batch resume` lets it go on", row.state.name())?;
            }
        }
        Command::Priority { which, priority, scene } => {
            let (_, queue, row) = known(&which).await?;
            let scene = scene.unwrap_or_default();
            let n = queue.set_priority(row.id, &scene, priority).await.map_err(|e| shown(&e))?;
            some(n, "scene that fits and has not begun")?;
            say!("{n} scenes have priority {priority}")?;
        }
    }
    Ok(EXIT_OK)
}

fn some(n: u64, what: &str) -> Result<()> {
    if n == 0 {
        return Err(hinted(format!("there is no {what}"), Some("`harmony batch status SET` lists what there is")));
    }
    Ok(())
}

async fn change(which: &Which, state: SetState, reason: &str) -> Result<()> {
    let (_, queue, row) = known(which).await?;
    queue.set_state(row.id, state, reason).await.map_err(|e| shown(&e))?;
    say!("{}: {}", which.set.display(), state.name())
}

/// Runs `harmony worker`.
///
/// # Errors
/// A queue or set that cannot be used.
pub fn run_worker(args: &WorkerArgs) -> Result<u8> {
    block_on(async {
        let only = args.set.as_deref().map(SetFolder::open).transpose().map_err(|e| shown(&e))?;
        let address = match (&only, &args.queue) {
            (_, Some(queue)) => QueueAddress::parse(queue),
            (Some(set), None) => set.queue(None),
            (None, None) => return Err(hinted("no queue is named".to_owned(), Some("give --queue or --set"))),
        };
        let queue = Queue::open(&address.map_err(|e| shown(&e))?, CONNECTIONS).await.map_err(|e| shown(&e))?;
        let sets = queue.sets().await.map_err(|e| shown(&e))?;
        // A heartbeat must come several times within the shortest lease.
        let lease = sets.iter().map(|set| set.lease_ms / 1000).min().unwrap_or(60).max(1);
        let stop = WorkerStop::default();
        let report = labour(&queue, only, args.places, args.until_idle, lease, &stop).await?;
        say!(
            "{} scenes made, {} turns failed, {} cancelled, {} given back",
            report.done,
            report.failed,
            report.cancelled,
            report.given_back
        )?;
        Ok(if stop.is_wanted() { EXIT_STOPPED } else { EXIT_OK })
    })
}

/// Turns at players, when this program makes a scene for a worker. Places and rates of players at a loopback address
/// hold on each machine, those of others over all of them.
///
/// # Errors
/// A queue that cannot be reached.
pub async fn shared_players(players: &PlayersConfig) -> Result<Option<Arc<SharedPlayers>>> {
    let addresses = [
        (Role::VisionLanguage, &players.vision_language.address),
        (Role::ImageEditor, &players.image_editor.address),
        (Role::MeshGenerator, &players.mesh_generator.address),
        (Role::Detector, &players.detector.address),
    ];
    let here = |address: &Option<String>| {
        address.as_deref().and_then(|a| parse_address(a).ok()).is_some_and(|url| is_loopback(&url))
    };
    let own = addresses.into_iter().filter(|(_, address)| here(address)).map(|(role, _)| role);
    let shared = inside::shared_players().await.map_err(|e| shown(&e))?;
    Ok(shared.map(|shared| Arc::new(shared.with_own(own))))
}

/// Tells the queue how the last calls ended.
pub async fn flush(shared: Option<Arc<SharedPlayers>>) {
    if let Some(shared) = shared {
        shared.flush(LAST_WORDS).await;
    }
}
