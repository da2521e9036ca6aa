//! `run.json`: what a run was, and how it ended.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use harmony_calls::Bill;
use harmony_io::{FileError, read_bounded};
use harmony_roles::{PlayerCard, Role};
use harmony_viewer::{PlausibilityRow, ReportError, show_plausibility};
use serde::{Deserialize, Serialize};

use crate::looks::Came;
use crate::{LOCK_FILE, Settings};

/// How a phase ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhaseState {
    /// Not run (left out with `--until`, or an earlier phase failed).
    #[default]
    Pending,
    /// Begun and not ended: the program was killed, or is at it.
    Running,
    /// Done, its files are there.
    Done,
    /// It did not do what it should.
    Failed,
}

/// A phase's marker.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PhaseEntry {
    /// How it ended.
    pub state: PhaseState,
    /// One line about the outcome, or why it failed.
    pub outcome: String,
    /// What a person can do about a failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// How long it took, once it has ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<PhaseTime>,
}

/// How long a phase took from its begin to its end, seconds. Levels are prepared ahead: what was prepared during the phase
/// before is in that one's time.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PhaseTime {
    /// This program alone was at work.
    pub own_s: f64,
    /// A player from outside (or whoever writes the answers of `files`) was asked and had not answered.
    pub waited_s: f64,
}

impl PhaseTime {
    /// Of a phase that took so long, with so much waiting in it.
    pub fn new(all: Duration, waited: Duration) -> Self {
        Self { own_s: all.saturating_sub(waited).as_secs_f64(), waited_s: waited.as_secs_f64() }
    }
}

/// A run that is part of a joined one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JoinedRun {
    /// Its folder's name.
    pub name: String,
    /// Its [`RunFile::inputs`]; empty when it had no `run.json`.
    pub inputs: String,
}

/// `run.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunFile {
    /// What made it.
    pub generator: String,
    /// Profile.
    pub profile: String,
    /// Hash of everything the run depends on beside answers: photo, settings, cast, program version.
    pub inputs: String,
    /// Digest of all recorded answers.
    pub answers: String,
    /// Phases in order.
    pub phases: BTreeMap<String, PhaseEntry>,
    /// Who played.
    pub cast: Vec<(Role, PlayerCard)>,
    /// Settings as they were resolved.
    pub settings: Settings,
    /// Objects placed.
    pub objects: usize,
    /// Questions to the VLM for each placed object.
    pub questions_per_object: f64,
    /// Calls, tokens, cost and time spent in calls, from their records.
    pub bill: Bill,
    /// What the looks at what was placed were asked and have changed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub looks: Vec<Came>,
    /// How plausible the scene is as a place, when `harmony simulate` was asked; a new reconstruction has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plausibility: Vec<PlausibilityRow>,
    /// The runs that it was joined from, the one whose frame it has first; empty for a run of one photo.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joined_from: Vec<JoinedRun>,
    /// Every file of the run but this one and the calls: path and hash.
    pub files: BTreeMap<String, String>,
}

impl RunFile {
    /// Reads `run.json`; `None` when it is absent or cannot be read as such (it is then made anew).
    pub fn read(run: &Path) -> Option<Self> {
        let bytes = read_bounded(&run.join("run.json"), 64 << 20).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// Writes `run.json`.
    ///
    /// # Errors
    /// An unwritable folder.
    pub fn write(&self, run: &Path) -> Result<(), FileError> {
        harmony_io::write_json(&run.join("run.json"), self)
    }

    /// Keeps what a simulation said of a run's scene, here and in its report.
    ///
    /// `false` when the folder has no `run.json` of this program.
    ///
    /// # Errors
    /// An unwritable folder.
    pub fn keep_plausibility(run: &Path, rows: &[PlausibilityRow]) -> Result<bool, ReportError> {
        let Some(mut file) = Self::read(run) else { return Ok(false) };
        if show_plausibility(run, rows)?
            && let Some(hash) = file_hash(&run.join("report.html"))
        {
            file.files.insert("report.html".to_owned(), hash);
        }
        file.plausibility = rows.to_vec();
        file.write(run)?;
        Ok(true)
    }

    /// Whether all phases are done.
    pub fn complete(&self) -> bool {
        !self.phases.is_empty() && self.phases.values().all(|p| p.state == PhaseState::Done)
    }

    /// What a person should know when nobody looked at the photo; empty when somebody did.
    pub fn unseen(&self) -> &'static [&'static str] {
        let blind = self.cast.iter().any(|(role, card)| *role == Role::VisionLanguage && card.offline);
        if !blind || self.bill.total.recorded > 0 {
            return &[];
        }
        &[
            "nobody looked at this photo: room, openings and flat things are there, all else stays as paint on walls and floor, or as a relief where a point map has it",
            "for furniture as objects: --profile files (answer by hand), keys and --profile paper, or servers and --profile local (docs/players.md)",
        ]
    }

    /// Whether every listed file is there and unchanged.
    pub fn files_hold(&self, run: &Path) -> bool {
        !self.files.is_empty()
            && self.files.iter().all(|(path, hash)| file_hash(&run.join(path)).is_some_and(|found| found == *hash))
    }
}

/// Hash of a file's content.
fn file_hash(path: &Path) -> Option<String> {
    std::fs::read(path).ok().map(|bytes| blake3::hash(&bytes).to_hex().to_string())
}

/// Hashes of all files of a run folder but `run.json`, the calls, the runs of single photos and what is unfinished.
pub fn hash_files(run: &Path) -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    let mut folders = vec![run.to_owned()];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        for entry in entries.flatten() {
            let path = entry.path();
            let Ok(relative) = path.strip_prefix(run) else { continue };
            let name = relative.to_string_lossy().replace('\\', "/");
            let skip = name == "run.json"
                || name == LOCK_FILE
                || name == "calls"
                || name == "questions"
                || name == "photos"
                || name.contains(".tmp");
            if skip {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else if let Some(hash) = file_hash(&path) {
                files.insert(name, hash);
            }
        }
    }
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_waited_for_was_own_work() {
        let of = |all, waited| PhaseTime::new(Duration::from_secs(all), Duration::from_secs(waited));
        assert_eq!(of(90, 60), PhaseTime { own_s: 30.0, waited_s: 60.0 });
        assert_eq!(of(10, 10), PhaseTime { own_s: 0.0, waited_s: 10.0 });
    }
}
