//! One scene: the program that makes it, as a child process, and how it ended.
//!
//! A process of its own for each scene: a crash, a leak or the kernel's memory killer takes that scene alone, limits of
//! the operating system hold per scene, and what is run is what a user would run by hand (`logs/` has it word for
//! word). Its start costs some hundredths of a second beside minutes of work.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use tokio::process::{Child, Command};
use tokio::sync::watch;

use crate::cause::{Cause, bill_of};
use crate::queue::{Ended, Job, Queue};
use crate::set::SetFolder;
use crate::{BatchError, inside};

/// Exit codes of `harmony reconstruct`.
const DONE: i32 = 0;
const STOPPED: i32 = 4;

/// Wait before a scene is tried again whose folder another program still has.
const BUSY_WAIT_MS: i64 = 2000;

/// What is read of the end of a log.
const TAIL: u64 = 16 << 10;

/// What a worker tells a scene that runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// Go on.
    Go,
    /// The worker ends: stop after the calls in flight; the scene goes back.
    GiveBack,
    /// Another worker has the job.
    Lost,
    /// Somebody cancelled it.
    Cancel,
    /// At once, whatever is in flight.
    Kill,
}

/// How scenes are made.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// The program.
    pub path: PathBuf,
    /// The queue, in full, for it.
    pub queue: String,
    /// This machine's name.
    pub host: String,
    /// How long it may take to end after it was asked to.
    pub grace: Duration,
}

impl Program {
    /// Makes a scene. `orders` may end it early.
    ///
    /// # Errors
    /// The program cannot be started, or the set's folder cannot be written: nothing that the scene is to blame for.
    pub async fn make(
        &self,
        set: &SetFolder,
        job: &Job,
        queue: &Queue,
        mut orders: watch::Receiver<Order>,
    ) -> Result<(Ended, Option<f64>), BatchError> {
        let run = set.run(&job.scene);
        if is_busy(&run) {
            return Ok((Ended::Again { wait_ms: BUSY_WAIT_MS }, None));
        }
        let (log, from) = open_log(&set.log(&job.scene), job)?;
        let mut child = self.start(set, job, &run, &log)?;
        // Its worker's end is the end of this.
        let mut input = child.stdin.take();
        let deadline = Duration::from_millis(job.set.timeout_ms.unsigned_abs());
        let overdue = async {
            match job.set.timeout_ms {
                0 => std::future::pending().await,
                _ => tokio::time::sleep(deadline).await,
            }
        };
        let mut late = false;
        let ended = tokio::select! {
            status = child.wait() => Some(status),
            () = ordered(&mut orders, Order::GiveBack) => None,
            () = overdue => { late = true; None }
        };
        let status = if let Some(status) = ended {
            status
        } else {
            drop(input.take());
            tokio::select! {
                status = child.wait() => status,
                () = tokio::time::sleep(self.grace) => killed(&mut child).await,
                () = ordered(&mut orders, Order::Kill) => killed(&mut child).await,
            }
        };
        let failed = |source| BatchError::Program { program: self.path.clone(), source };
        let status = status.map_err(failed)?;
        drop(input);
        let order = *orders.borrow();
        let bill = bill_of(&run);
        let ended = match (status.code(), order) {
            (Some(DONE), _) => Ended::Done,
            (_, Order::Cancel) => Ended::Cancelled,
            (_, Order::GiveBack | Order::Lost | Order::Kill) => Ended::Again { wait_ms: 0 },
            _ if late => failure(Cause::new("time", &format!("it took longer than {} s", deadline.as_secs_f64()))),
            // A budget that all share: the set is paused, and the scene goes on when it does.
            (Some(STOPPED), _) if is_over_budget(queue, job).await => Ended::Again { wait_ms: 0 },
            (Some(code), _) => failure(Cause::of_exit(code, &run, &tail(&log, from))),
            (None, _) => failure(Cause::new("crash", &signal_text(status))),
        };
        Ok((ended, bill))
    }

    fn start(&self, set: &SetFolder, job: &Job, run: &Path, log: &File) -> Result<Child, BatchError> {
        let path = std::path::absolute(set.path()).unwrap_or_else(|_| set.path().to_owned());
        let photo = path.join(&job.photo);
        let run = std::path::absolute(run).unwrap_or_else(|_| run.to_owned());
        let put = |arg: &String| {
            arg.replace("{photo}", &photo.to_string_lossy())
                .replace("{run}", &run.to_string_lossy())
                .replace("{set}", &path.to_string_lossy())
                .replace("{scene}", &job.scene)
        };
        let failed = |source| BatchError::Program { program: self.path.clone(), source };
        let mut command = Command::new(&self.path);
        command
            .args(job.set.args.iter().map(put))
            .env(inside::QUEUE, &self.queue)
            .env(inside::JOB, format!("{}:{}:{}", job.set.id, job.id, job.token))
            .env(inside::HOST, &self.host)
            .stdin(Stdio::piped())
            .stdout(log.try_clone().map_err(failed)?)
            .stderr(log.try_clone().map_err(failed)?);
        // Ctrl-C in a terminal is for the worker; it tells its children itself.
        #[cfg(unix)]
        command.process_group(0);
        command.spawn().map_err(failed)
    }
}

fn failure(cause: Cause) -> Ended {
    Ended::Failed { stage: cause.stage, cause: cause.cause, message: cause.message }
}

/// Resolves when as much or more is ordered; never when whoever orders is gone.
async fn ordered(orders: &mut watch::Receiver<Order>, least: Order) {
    if orders.wait_for(|order| *order >= least).await.is_err() {
        std::future::pending::<()>().await;
    }
}

async fn killed(child: &mut Child) -> std::io::Result<ExitStatus> {
    // It may have ended just now.
    let _ = child.start_kill();
    child.wait().await
}

async fn is_over_budget(queue: &Queue, job: &Job) -> bool {
    queue.set(&job.set.name).await.is_ok_and(|set| set.reason.starts_with("budget:"))
}

#[cfg(unix)]
fn signal_text(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt as _;
    match status.signal() {
        Some(9) => "killed by signal 9 (by hand, or the machine had no memory left)".to_owned(),
        Some(signal) => format!("killed by signal {signal}"),
        None => "it ended without a code".to_owned(),
    }
}

#[cfg(not(unix))]
fn signal_text(_: ExitStatus) -> String {
    "it ended without a code".to_owned()
}

/// Whether a program is at work in a run folder: one of a worker that is gone ends in a moment.
fn is_busy(run: &Path) -> bool {
    let Ok(lock) = File::options().write(true).open(run.join(".lock")) else { return false };
    matches!(lock.try_lock(), Err(TryLockError::WouldBlock))
}

/// Opens a scene's log for more, and says where the new part begins.
fn open_log(path: &Path, job: &Job) -> Result<(File, u64), BatchError> {
    let fail = |source| harmony_io::FileError::Write { path: path.to_owned(), source };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(fail)?;
    }
    let mut log = OpenOptions::new().create(true).append(true).read(true).open(path).map_err(fail)?;
    writeln!(log, "-- turn {}, {} failed before", job.token, job.attempts).map_err(fail)?;
    let from = log.seek(SeekFrom::End(0)).map_err(fail)?;
    Ok((log, from))
}

/// The end of what was written since.
fn tail(log: &File, from: u64) -> String {
    let mut log = log;
    let mut text = Vec::new();
    let end = log.metadata().map_or(from, |m| m.len());
    let start = from.max(end.saturating_sub(TAIL));
    if log.seek(SeekFrom::Start(start)).is_ok() {
        let _ = log.take(TAIL).read_to_end(&mut text);
    }
    String::from_utf8_lossy(&text).into_owned()
}
