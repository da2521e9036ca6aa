//! A worker: claims scenes, makes each in a child program, renews its leases, ends what it must not go on with.
//!
//! It keeps nothing that matters: killed at any moment, its children end after their calls in flight, its leases run
//! out, and others go on from the run folders. When the database is away, children go on (nobody else can claim their
//! scenes meanwhile, and they get no new turns at players), and ends are told when it is back.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::child::{Order, Program};
use crate::queue::{Ended, Job, JobResult, Queue, SetRow, SetState};
use crate::set::SetFolder;
use crate::{BatchError, status};

/// How old what is known about sets may be.
const SETS_AGE: Duration = Duration::from_millis(500);

/// How long ends are told to a database that is away while the worker wants to end.
const LAST_WORDS: Duration = Duration::from_secs(30);

/// What a worker tells whoever shows it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum WorkerEvent {
    /// A scene begins.
    Began {
        /// Which.
        scene: String,
    },
    /// A scene's turn has ended.
    Ended {
        /// Which.
        scene: String,
        /// How.
        ended: Ended,
        /// After this time.
        time: Duration,
    },
    /// Scenes of workers that were silent for too long were put back.
    PutBack {
        /// Which.
        scenes: Vec<String>,
    },
    /// The queue does not answer.
    Away {
        /// What was said.
        reason: String,
    },
    /// It answers again.
    Back,
}

/// How a worker works.
#[derive(Clone)]
pub struct WorkerOptions {
    /// The program that makes scenes.
    pub program: PathBuf,
    /// Scenes at a time.
    pub slots: usize,
    /// Only this set, and its folder as seen from here; else all sets of the queue, where their makers saw them.
    pub only: Option<SetFolder>,
    /// Ends when nothing is left to do, or nothing may be begun.
    pub until_idle: bool,
    /// Time between looks into an empty queue.
    pub poll: Duration,
    /// Time between heartbeats; a quarter of the lease is usual.
    pub heartbeat: Duration,
    /// How long a scene's program may take to end after it was asked to.
    pub grace: Duration,
    /// Told of what happens.
    pub on_event: Arc<dyn Fn(WorkerEvent) + Send + Sync>,
}

impl WorkerOptions {
    /// As usual, with a program.
    pub fn new(program: PathBuf) -> Self {
        Self {
            program,
            slots: 1,
            only: None,
            until_idle: false,
            poll: Duration::from_secs(1),
            heartbeat: Duration::from_secs(15),
            grace: Duration::from_mins(3),
            on_event: Arc::new(|_| {}),
        }
    }
}

/// What a worker did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WorkerReport {
    /// Scenes that are there now.
    pub done: usize,
    /// Turns that failed.
    pub failed: usize,
    /// Scenes that were stopped because somebody cancelled them.
    pub cancelled: usize,
    /// Turns that gave the scene back.
    pub given_back: usize,
}

/// Ends a worker from outside.
#[derive(Debug, Clone, Default)]
pub struct WorkerStop(Arc<watch::Sender<Stopping>>);

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Stopping {
    #[default]
    No,
    /// Scenes that run stop after their calls in flight, and go back.
    Soon,
    /// At once.
    Now,
}

impl WorkerStop {
    /// Scenes that run ask nobody new, await what is in flight, and go back into the queue; then the worker ends.
    pub fn soon(&self) {
        self.0.send_modify(|state| *state = (*state).max(Stopping::Soon));
    }

    /// Scenes that run are killed.
    pub fn now(&self) {
        self.0.send_modify(|state| *state = Stopping::Now);
    }

    /// Whether somebody wants it to end.
    pub fn is_wanted(&self) -> bool {
        *self.0.borrow() > Stopping::No
    }
}

/// Scenes that run here: what is told to them, and their tokens.
type Running = Arc<Mutex<BTreeMap<i64, (i64, watch::Sender<Order>)>>>;

fn locked(running: &Running) -> MutexGuard<'_, BTreeMap<i64, (i64, watch::Sender<Order>)>> {
    running.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Worker {
    name: String,
    host: String,
    queue: Queue,
    options: WorkerOptions,
    running: Running,
    stop: WorkerStop,
    away: Mutex<bool>,
    /// The sets of the queue, and when that was looked up.
    sets: Mutex<Option<(Instant, Vec<SetRow>)>>,
}

/// Works until it is stopped, or until nothing is left if that is wanted.
///
/// # Errors
/// The queue cannot be used (being away for a while is no error), or the program cannot be started.
pub async fn work(queue: &Queue, options: WorkerOptions, stop: &WorkerStop) -> Result<WorkerReport, BatchError> {
    let host = host_name();
    let worker = Arc::new(Worker {
        name: format!("{host}/{}/{:08x}", std::process::id(), rand::random::<u32>()),
        host,
        queue: queue.clone(),
        options,
        running: Running::default(),
        stop: stop.clone(),
        away: Mutex::new(false),
        sets: Mutex::default(),
    });
    let beats = tokio::spawn(Arc::clone(&worker).beat());
    let report = worker.run().await;
    beats.abort();
    let _ = tokio::time::timeout(Duration::from_secs(2), queue.goodbye(&worker.name)).await;
    report
}

impl Worker {
    fn tell(&self, event: WorkerEvent) {
        (self.options.on_event)(event);
    }

    async fn run(self: &Arc<Self>) -> Result<WorkerReport, BatchError> {
        let mut report = WorkerReport::default();
        let mut tasks: JoinSet<Result<Ended, BatchError>> = JoinSet::new();
        let mut stopping = self.stop.0.subscribe();
        let mut told = Stopping::No;
        let mut failure = None;
        loop {
            let wanted = *stopping.borrow_and_update();
            if wanted > told {
                told = wanted;
                let order = if wanted == Stopping::Now { Order::Kill } else { Order::GiveBack };
                for (_, sender) in locked(&self.running).values() {
                    sender.send_modify(|now| *now = (*now).max(order));
                }
            }
            let ending = wanted > Stopping::No || failure.is_some();
            let mut empty = true;
            while !ending && tasks.len() < self.options.slots {
                let Some((job, folder)) = self.tolerating_outage(self.next().await)?.flatten() else { break };
                empty = false;
                self.begin(&mut tasks, job, folder);
            }
            if tasks.is_empty() && (ending || (empty && self.options.until_idle && self.is_idle().await?)) {
                return failure.map_or(Ok(report), Err);
            }
            // Some spread, so that workers that were started together do not look together.
            let pause = self.options.poll.mul_f64(0.75 + 0.5 * rand::random::<f64>());
            let full = ending || tasks.len() >= self.options.slots;
            tokio::select! {
                Some(ended) = tasks.join_next() => match ended {
                    Ok(Ok(Ended::Done)) => report.done += 1,
                    Ok(Ok(Ended::Failed { .. })) => report.failed += 1,
                    Ok(Ok(Ended::Cancelled)) => report.cancelled += 1,
                    Ok(Ok(Ended::Again { .. })) => report.given_back += 1,
                    Ok(Err(error)) => failure = failure.or(Some(error)),
                    // A panic of ours: the lease runs out, and the scene goes to somebody else.
                    Err(error) => tracing::error!("a scene's task ended badly: {error}"),
                },
                _ = stopping.changed() => {}
                () = tokio::time::sleep(pause), if !full => {}
            }
        }
    }

    /// What a queue that may be away said; `None` when it is.
    fn tolerating_outage<T>(&self, said: Result<T, BatchError>) -> Result<Option<T>, BatchError> {
        let mut away = self.away.lock().unwrap_or_else(PoisonError::into_inner);
        match said {
            Ok(value) => {
                if std::mem::take(&mut *away) {
                    self.tell(WorkerEvent::Back);
                }
                Ok(Some(value))
            }
            Err(error) if error.is_passing() => {
                if !std::mem::replace(&mut *away, true) {
                    self.tell(WorkerEvent::Away { reason: error.to_string() });
                }
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    async fn sets(&self) -> Result<Vec<SetRow>, BatchError> {
        if let Some((at, sets)) = &*self.sets.lock().unwrap_or_else(PoisonError::into_inner)
            && at.elapsed() < SETS_AGE
        {
            return Ok(sets.clone());
        }
        let mut sets = self.queue.sets().await?;
        if let Some(only) = &self.options.only {
            sets.retain(|set| only.is(&set.name));
        }
        *self.sets.lock().unwrap_or_else(PoisonError::into_inner) = Some((Instant::now(), sets.clone()));
        Ok(sets)
    }

    /// Claims the next scene of the first set that has one.
    async fn next(&self) -> Result<Option<(Job, SetFolder)>, BatchError> {
        for set in self.sets().await? {
            if set.state != SetState::Running {
                continue;
            }
            let Some(folder) = self.folder(&set) else { continue };
            if let Some(job) = self.queue.claim(&set, &self.name).await? {
                return Ok(Some((job, folder)));
            }
        }
        Ok(None)
    }

    /// A set's folder as seen from here; `None` when this machine does not see it.
    fn folder(&self, set: &SetRow) -> Option<SetFolder> {
        if let Some(only) = &self.options.only {
            return Some(only.clone());
        }
        let folder = SetFolder::open(set.folder.as_ref()).ok().filter(|folder| folder.is(&set.name));
        if folder.is_none() {
            tracing::warn!("set {}: its folder {} is not there on this machine", set.name, set.folder);
        }
        folder
    }

    /// Whether nothing is left that this worker could do, now or later.
    async fn is_idle(&self) -> Result<bool, BatchError> {
        *self.sets.lock().unwrap_or_else(PoisonError::into_inner) = None;
        let Some(sets) = self.tolerating_outage(self.sets().await)? else { return Ok(false) };
        for set in sets {
            let goes_on = set.state == SetState::Running && self.folder(&set).is_some();
            // Scenes of others count: they may come back.
            if goes_on && self.tolerating_outage(self.queue.is_open(set.id).await)?.unwrap_or(true) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn begin(self: &Arc<Self>, tasks: &mut JoinSet<Result<Ended, BatchError>>, job: Job, folder: SetFolder) {
        let (sender, orders) = watch::channel(Order::Go);
        locked(&self.running).insert(job.id, (job.token, sender));
        self.tell(WorkerEvent::Began { scene: job.scene.clone() });
        let this = Arc::clone(self);
        tasks.spawn(async move {
            let ended = this.make(&job, &folder, orders).await;
            let mut running = locked(&this.running);
            // The same job may have been claimed again meanwhile.
            if running.get(&job.id).is_some_and(|(token, _)| *token == job.token) {
                running.remove(&job.id);
            }
            ended
        });
    }

    async fn make(&self, job: &Job, folder: &SetFolder, orders: watch::Receiver<Order>) -> Result<Ended, BatchError> {
        let begun = Instant::now();
        let program = Program {
            path: self.options.program.clone(),
            queue: self.queue.address().full(),
            host: self.host.clone(),
            grace: self.options.grace,
        };
        let made = program.make(folder, job, &self.queue, orders.clone()).await;
        let lost = *orders.borrow() == Order::Lost;
        let (ended, bill) = match made {
            Ok(ended) => ended,
            // Not the scene's fault: it goes back, and this worker ends.
            Err(error) => {
                let _ = self.queue.finish(job, &Ended::Again { wait_ms: 0 }, None).await;
                return Err(error);
            }
        };
        if ended == Ended::Done {
            let (run, thumb) = (folder.run(&job.scene), folder.thumb(&job.scene));
            let photo = folder.path().join(&job.photo);
            // A picture for the page; without it the page has none.
            let _ = tokio::task::spawn_blocking(move || status::write_thumb(&photo, &run, &thumb)).await;
        }
        // What is done is done, whoever holds the job.
        if !lost || ended == Ended::Done {
            self.finish(job, &ended, bill).await?;
        }
        self.tell(WorkerEvent::Ended { scene: job.scene.clone(), ended: ended.clone(), time: begun.elapsed() });
        Ok(ended)
    }

    /// Tells the queue that a turn has ended, however long that takes.
    async fn finish(&self, job: &Job, ended: &Ended, bill: Option<f64>) -> Result<(), BatchError> {
        let mut wait = Duration::from_millis(100);
        let begun = Instant::now();
        loop {
            match self.tolerating_outage(self.queue.finish(job, ended, bill).await)? {
                Some(JobResult::Kept) => return Ok(()),
                Some(JobResult::NotOurs) => {
                    tracing::info!("{}: another worker has it by now", job.scene);
                    return Ok(());
                }
                None if self.stop.is_wanted() && begun.elapsed() > LAST_WORDS => return Ok(()),
                None => tokio::time::sleep(wait).await,
            }
            wait = (wait * 2).min(Duration::from_secs(3));
        }
    }

    /// Heartbeats: renews leases, tells scenes that are lost or cancelled, puts back what others lost.
    async fn beat(self: Arc<Self>) {
        let mut tick = tokio::time::interval(self.options.heartbeat);
        tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            tick.tick().await;
            // An error that does not pass is seen by the main loop too.
            let _ = self.tolerating_outage(self.one_beat().await);
        }
    }

    async fn one_beat(&self) -> Result<(), BatchError> {
        let mine: Vec<(i64, i64)> = locked(&self.running).iter().map(|(id, (token, _))| (*id, *token)).collect();
        let slots = i64::try_from(self.options.slots).unwrap_or(i64::MAX);
        self.queue.hello(&self.name, &self.host, slots, mine.len() as i64).await?;
        if !mine.is_empty() {
            let held = self.queue.renew(&self.name).await?;
            let running = locked(&self.running);
            for (id, token) in mine {
                let now = held.iter().find(|held| held.id == id && held.token == token);
                let order = match now {
                    Some(held) if held.cancel => Order::Cancel,
                    Some(_) => continue,
                    None => Order::Lost,
                };
                if let Some((_, sender)) = running.get(&id).filter(|(running, _)| *running == token) {
                    sender.send_modify(|now| *now = (*now).max(order));
                }
            }
        }
        let scenes = self.queue.tend().await?;
        if !scenes.is_empty() {
            self.tell(WorkerEvent::PutBack { scenes });
        }
        Ok(())
    }
}

/// This machine's name.
pub fn host_name() -> String {
    let named = std::env::var("HOSTNAME").ok().filter(|name| !name.is_empty());
    let read =
        || std::fs::read_to_string("/proc/sys/kernel/hostname").or_else(|_| std::fs::read_to_string("/etc/hostname"));
    let name = named.or_else(|| read().ok()).unwrap_or_default();
    let plain: String =
        name.trim().chars().filter(|c| c.is_ascii_alphanumeric() || "-._".contains(*c)).take(64).collect();
    if plain.is_empty() { "here".to_owned() } else { plain }
}
