//! Sets with scenes that take moments.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use harmony_batch::queue::{NewSet, SceneRow, SetRow};
use harmony_batch::{Queue, SetFolder, Submission, WorkerEvent, WorkerOptions};

/// The program that makes scenes here.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_harmony-batch-trial");

pub struct Desk {
    pub folder: tempfile::TempDir,
    pub set: SetFolder,
    pub queue: Queue,
    pub row: SetRow,
    pub events: Arc<Mutex<Vec<WorkerEvent>>>,
}

/// What a set is like.
pub fn new_set(name: &str) -> NewSet {
    NewSet {
        name: name.to_owned(),
        folder: String::new(),
        args: Vec::new(),
        attempts: 2,
        losses: 3,
        lease_ms: 2000,
        retry_ms: 50,
        timeout_ms: 0,
        streak: 0,
    }
}

impl Desk {
    /// Photos by name and content, as a set of scenes that take about `1 / speed` minutes.
    pub async fn new(photos: &[(&str, &str)], speed: f64, change: impl FnOnce(&mut NewSet)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let from = folder.path().join("photos");
        std::fs::create_dir(&from).unwrap();
        for (name, content) in photos {
            std::fs::write(from.join(format!("{name}.png")), content).unwrap();
        }
        let speed = speed.to_string();
        let args: Vec<String> =
            ["scene", "{photo}", "--out", "{run}", "--ledger", "{set}/paid.log", "--objects", "2", "--speed", &speed]
                .map(str::to_owned)
                .into();
        let set = SetFolder::make(&folder.path().join("set"), None, &args, "", "test").unwrap();
        let queue = Queue::create(&set.queue(None).unwrap(), 4).await.unwrap();
        let mut new = NewSet { folder: set.path().display().to_string(), args, ..new_set(set.name()) };
        change(&mut new);
        let row = queue.put_set(&new).await.unwrap();
        let jobs = set.take_photos(&Submission { from, priority: 0 }, &BTreeMap::new()).unwrap().jobs;
        assert_eq!(queue.enqueue(row.id, &jobs).await.unwrap(), photos.len() as u64);
        Self { folder, set, queue, row, events: Arc::default() }
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn options(&self) -> WorkerOptions {
        let events = Arc::clone(&self.events);
        WorkerOptions {
            slots: 2,
            only: Some(self.set.clone()),
            until_idle: true,
            poll: Duration::from_millis(30),
            heartbeat: Duration::from_millis(100),
            grace: Duration::from_secs(10),
            on_event: Arc::new(move |event| events.lock().unwrap().push(event)),
            ..WorkerOptions::new(PathBuf::from(PROGRAM))
        }
    }

    pub async fn scenes(&self) -> BTreeMap<String, SceneRow> {
        let rows = self.queue.scenes(self.row.id, "", 1000).await.unwrap();
        rows.into_iter().map(|row| (row.scene.clone(), row)).collect()
    }

    /// Waits until so many scenes are in a state.
    pub async fn until(&self, state: &str, count: usize) {
        for _ in 0..4800 {
            if self.queue.scenes(self.row.id, state, 1000).await.unwrap().len() >= count {
                return;
            }
            tokio::time::sleep(Duration::from_millis(25)).await;
        }
        panic!("no {count} scenes became {state}: {:?}", self.scenes().await);
    }

    /// Lines of what was paid.
    pub fn paid(&self) -> Vec<String> {
        let text = std::fs::read_to_string(self.set.path().join("paid.log")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }
}
