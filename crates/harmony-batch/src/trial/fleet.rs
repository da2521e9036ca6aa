//! Sets of made-up photos, and workers as processes.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use harmony_batch::queue::{Counts, NewSet, SetRow};
use harmony_batch::{Queue, QueueAddress, SetFolder, Submission};

/// How a set is made.
pub struct Plan<'a> {
    pub folder: &'a Path,
    pub queue: Option<&'a str>,
    pub scenes: usize,
    pub objects: usize,
    pub speed: f64,
    pub more: &'a [String],
    pub losses: i64,
    pub lease_ms: i64,
}

/// A set with its queue.
pub struct Fleet {
    pub set: SetFolder,
    pub queue: Queue,
    pub row: SetRow,
    address: Option<String>,
    workers: Vec<Child>,
}

impl Fleet {
    /// Makes photos, a set, its jobs.
    pub async fn new(plan: &Plan<'_>) -> Result<Self, String> {
        let text = |e: harmony_batch::BatchError| e.to_string();
        let photos = plan.folder.join("photos");
        std::fs::create_dir_all(&photos).unwrap();
        for i in 0..plan.scenes {
            std::fs::write(photos.join(format!("room_{i:04}.png")), format!("photo {i}")).unwrap();
        }
        let path = plan.folder.join("set");
        let mut args: Vec<String> =
            ["scene", "{photo}", "--out", "{run}", "--ledger", "{set}/paid.log"].map(str::to_owned).into();
        args.extend(["--speed".to_owned(), plan.speed.to_string(), "--objects".to_owned(), plan.objects.to_string()]);
        args.extend(plan.more.iter().cloned());
        let address = plan.queue.map(QueueAddress::parse).transpose().map_err(text)?;
        let set = SetFolder::make(&path, address.as_ref(), &args, "", "trial").map_err(text)?;
        let queue = Queue::create(&set.queue(plan.queue).map_err(text)?, 4).await.map_err(text)?;
        let new = NewSet {
            name: set.name().to_owned(),
            folder: path.display().to_string(),
            args,
            attempts: 3,
            losses: plan.losses,
            lease_ms: plan.lease_ms,
            retry_ms: 200,
            timeout_ms: 0,
            streak: 0,
        };
        let row = queue.put_set(&new).await.map_err(text)?;
        let what = Submission { from: photos, priority: 0 };
        let jobs = set.take_photos(&what, &std::collections::BTreeMap::new()).map_err(text)?.jobs;
        queue.enqueue(row.id, &jobs).await.map_err(text)?;
        Ok(Self { set, queue, row, address: plan.queue.map(str::to_owned), workers: Vec::new() })
    }

    /// Starts a worker.
    pub fn hire(&mut self) {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.arg("worker").arg("--set").arg(self.set.path()).stdin(Stdio::null());
        if let Some(address) = &self.address {
            command.args(["--queue", address]);
        }
        self.workers.push(command.spawn().unwrap());
    }

    /// Kills the i-th worker with SIGKILL and hires another.
    pub fn replace(&mut self, i: usize) {
        let mut worker = self.workers.swap_remove(i);
        let _ = worker.kill();
        let _ = worker.wait();
        self.hire();
    }

    pub fn size(&self) -> usize {
        self.workers.len()
    }

    /// Hires another for each that has ended by itself.
    pub fn refill(&mut self) {
        let before = self.workers.len();
        self.workers.retain_mut(|worker| worker.try_wait().unwrap().is_none());
        for _ in self.workers.len()..before {
            self.hire();
        }
    }

    /// Processes of scenes that run.
    pub fn scenes(&self) -> Vec<i32> {
        let ours = self.set.path().join("scenes").display().to_string();
        let mut found = Vec::new();
        for entry in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
            let Some(pid) = entry.file_name().to_str().and_then(|name| name.parse::<i32>().ok()) else { continue };
            let line = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
            let line = String::from_utf8_lossy(&line).into_owned();
            if line.contains("\0scene\0") && line.contains(&ours) {
                found.push(pid);
            }
        }
        found
    }

    /// Jobs by state; `None` while the database is away.
    pub async fn counts(&self) -> Option<Counts> {
        self.queue.counts(self.row.id).await.ok()
    }

    /// Waits until all have ended.
    pub async fn wait(&mut self, longest: Duration) -> Result<(), String> {
        let begun = Instant::now();
        loop {
            if let Some(counts) = self.counts().await
                && counts.open() == 0
            {
                break;
            }
            if begun.elapsed() > longest {
                return Err(format!("not over after {longest:?}: {:?}", self.counts().await));
            }
            self.refill();
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        for worker in &mut self.workers {
            let _ = worker.wait();
        }
        Ok(())
    }

    /// What was paid: player, scene, call, begin and end in milliseconds.
    pub fn ledger(&self) -> Vec<Paid> {
        let text = std::fs::read_to_string(self.set.path().join("paid.log")).unwrap_or_default();
        text.lines()
            .map(|line| {
                let parts: Vec<&str> = line.split('\t').collect();
                Paid {
                    player: parts[0].to_owned(),
                    scene: parts[1].to_owned(),
                    call: parts[2].to_owned(),
                    begun: parts[3].parse().unwrap(),
                    ended: parts[4].parse().unwrap(),
                }
            })
            .collect()
    }
}

/// An answer that was paid.
#[derive(Debug, Clone)]
pub struct Paid {
    pub player: String,
    pub scene: String,
    pub call: String,
    pub begun: i64,
    pub ended: i64,
}

impl Drop for Fleet {
    fn drop(&mut self) {
        for worker in &mut self.workers {
            let _ = worker.kill();
            let _ = worker.wait();
        }
    }
}

/// A folder for a trial, kept when named.
pub fn folder(named: Option<&PathBuf>) -> (PathBuf, Option<Kept>) {
    if let Some(named) = named {
        std::fs::create_dir_all(named).unwrap();
        return (std::path::absolute(named).unwrap(), None);
    }
    let path = std::env::temp_dir().join(format!("harmony-batch-{}-{:08x}", std::process::id(), rand::random::<u32>()));
    std::fs::create_dir_all(&path).unwrap();
    (path.clone(), Some(Kept(path)))
}

/// Removes a folder when dropped.
pub struct Kept(PathBuf);

impl Drop for Kept {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
