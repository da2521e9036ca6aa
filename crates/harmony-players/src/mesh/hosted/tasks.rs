//! Which tasks were made at a service and for what: paid work that is not forgotten when a try, or the program, ends
//! before it is done.
//!
//! A note is written before anything else is done with a new task, and kept: when the same work is asked for again, the
//! same task is looked at, whether it is still at work or has long been done. Only a task that cannot give a mesh any more
//! makes room for another one.

use std::collections::HashMap;
use std::io;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::wire::plain_id;

/// What is known of a piece of work.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TaskNote {
    /// Name of the call that asked first, for people.
    pub call: String,
    /// The service.
    pub player: String,
    /// The task that does it; `None` = none does.
    pub task: Option<String>,
    /// When that was made, milliseconds since 1970.
    pub made_unix_ms: u64,
    /// Tasks that ended without a result.
    pub failed: u32,
    /// Times that the task's file could not be used.
    pub unusable: u32,
}

impl TaskNote {
    /// How long ago the task was made.
    pub fn age(&self) -> Duration {
        Duration::from_millis(now().saturating_sub(self.made_unix_ms))
    }
}

fn now() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

/// Notes, in memory and in a folder where there is one.
#[derive(Debug, Default)]
pub struct Tasks {
    folder: Option<PathBuf>,
    notes: Mutex<HashMap<String, TaskNote>>,
}

impl Tasks {
    /// Notes that outlive the program, one file each; the folder is made when it is needed.
    pub fn in_folder(folder: PathBuf) -> Self {
        Self { folder: Some(folder), notes: Mutex::default() }
    }

    fn file(&self, work: &str) -> Option<PathBuf> {
        self.folder.as_ref().map(|folder| folder.join(format!("{work}.json")))
    }

    /// What is known of a piece of work. `work` is a hash in hexadecimal digits. A note that cannot be read is none.
    pub fn of(&self, work: &str) -> TaskNote {
        let mut notes = self.notes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(note) = notes.get(work) {
            return note.clone();
        }
        let kept = self.file(work).and_then(|path| harmony_io::read_json(&path).ok());
        let mut note: TaskNote = kept.unwrap_or_default();
        // It becomes part of an address, whoever wrote the file.
        note.task = note.task.filter(|id| plain_id(Some(&Value::String(id.clone()))).is_ok());
        notes.insert(work.to_owned(), note.clone());
        note
    }

    fn keep(&self, work: &str, note: TaskNote) -> io::Result<()> {
        if let Some(path) = self.file(work) {
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            let text = serde_json::to_vec_pretty(&note).map_err(io::Error::other)?;
            harmony_io::write_durable(&path, &text).map_err(io::Error::other)?;
        }
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).insert(work.to_owned(), note);
        Ok(())
    }

    /// A task was made.
    ///
    /// # Errors
    /// The note cannot be written.
    pub fn made(&self, work: &str, call: &str, player: &str, task: &str) -> io::Result<()> {
        let note = TaskNote {
            call: call.to_owned(),
            player: player.to_owned(),
            task: Some(task.to_owned()),
            made_unix_ms: now(),
            unusable: 0,
            ..self.of(work)
        };
        self.keep(work, note)
    }

    /// The task ended without a result, or its result is not there any more; how many did.
    ///
    /// # Errors
    /// The note cannot be written.
    pub fn failed(&self, work: &str) -> io::Result<u32> {
        let before = self.of(work);
        let failed = before.failed + 1;
        self.keep(work, TaskNote { task: None, failed, ..before })?;
        Ok(failed)
    }

    /// The task's file cannot be used; how often that was.
    ///
    /// # Errors
    /// The note cannot be written.
    pub fn unusable(&self, work: &str) -> io::Result<u32> {
        let before = self.of(work);
        let unusable = before.unusable + 1;
        self.keep(work, TaskNote { unusable, ..before })?;
        Ok(unusable)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_outlive_the_program_and_broken_ones_are_none() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("calls/tasks");
        let tasks = Tasks::in_folder(at.clone());
        assert_eq!(tasks.of("ab"), TaskNote::default());
        tasks.made("ab", "3_furniture/sofa_01/mesh", "fal", "task-1").unwrap();
        let again = Tasks::in_folder(at.clone());
        let note = again.of("ab");
        assert_eq!((note.task.as_deref(), note.failed), (Some("task-1"), 0));
        assert!(note.age() < Duration::from_mins(1));
        assert_eq!(again.unusable("ab").unwrap(), 1);
        assert_eq!(again.failed("ab").unwrap(), 1);
        assert_eq!(Tasks::in_folder(at.clone()).of("ab").task, None);
        again.made("ab", "x", "fal", "task-2").unwrap();
        let note = Tasks::in_folder(at.clone()).of("ab");
        assert_eq!((note.task.as_deref(), note.failed, note.unusable), (Some("task-2"), 1, 0));
        std::fs::write(at.join("cd.json"), "{ half").unwrap();
        assert_eq!(Tasks::in_folder(at.clone()).of("cd"), TaskNote::default());
        let led = serde_json::to_string(&TaskNote { task: Some("../account".into()), ..TaskNote::default() }).unwrap();
        std::fs::write(at.join("ef.json"), led).unwrap();
        assert_eq!(Tasks::in_folder(at).of("ef").task, None);
    }

    #[test]
    fn without_a_folder_notes_live_as_long_as_the_program() {
        let tasks = Tasks::default();
        tasks.made("ab", "x", "fal", "task-1").unwrap();
        assert_eq!(tasks.of("ab").task.as_deref(), Some("task-1"));
    }
}
