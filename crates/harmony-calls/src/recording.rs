//! Recordings: the answers of a run without its photos, to be replayed without the players.
//!
//! ```text
//! <recording>/recording.json                 what made it, its licence, what was asked
//!            <role>/<name>/answer.json       the answers
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harmony_io::atomic::{write_atomic, write_json};
use harmony_roles::{PlayerCard, Role};
use serde::{Deserialize, Serialize};

use crate::book::{BookError, answer_digest, is_answer_file, names_under, read_json, sorted_entries};
use crate::record::CallRecord;
use crate::{CallBook, CallName, ContentKey, key_for};

/// Version of `recording.json`.
const RECORDING_VERSION: u32 = 1;

/// `recording.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingManifest {
    /// Version of this file.
    pub version: u32,
    /// Short name of the recording, shown in reports.
    pub label: String,
    /// Who or what made the answers, in words.
    pub made_by: String,
    /// Licence of the answers.
    pub license: String,
    /// What each answer belongs to, by `<role>/<name>`.
    #[serde(default)]
    pub answers: BTreeMap<String, RecordedAnswer>,
}

/// What an answer of a recording belongs to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedAnswer {
    /// Key of the question that was asked.
    pub question: ContentKey,
    /// Who answered.
    pub player: String,
    /// Its model.
    pub model: String,
}

/// A recording that is replayed: a recording folder, or the folder of another run.
#[derive(Debug, Clone)]
pub struct Recording {
    root: PathBuf,
    manifest: Option<RecordingManifest>,
    label: String,
}

/// One answer of a recording.
#[derive(Debug, Clone)]
pub(crate) struct Recorded {
    /// Folder that holds the answer's files.
    pub folder: PathBuf,
    /// Key under which this run keeps the answer: changes when the recorded answer or the question does.
    pub key: ContentKey,
    /// Who plays: the recording.
    pub card: PlayerCard,
    /// Whether the question differs from the recorded one; false when the recording does not say.
    pub question_differs: bool,
}

impl Recording {
    /// Opens a recording folder, or the folder of a run.
    ///
    /// # Errors
    /// [`BookError::NotARecording`].
    pub fn open(folder: &Path) -> Result<Self, BookError> {
        let fail = |reason: String| BookError::NotARecording { reason, path: folder.to_owned() };
        let manifest_file = folder.join("recording.json");
        if manifest_file.is_file() {
            let manifest: RecordingManifest = read_json(&manifest_file).map_err(fail)?;
            if manifest.version != RECORDING_VERSION {
                return Err(fail(format!("it has version {}, {RECORDING_VERSION} is read", manifest.version)));
            }
            let label = crate::check::shortened(&manifest.label, 120);
            Ok(Self { root: folder.to_owned(), manifest: Some(manifest), label })
        } else if folder.join("calls").is_dir() {
            let label = folder.file_name().map_or_else(|| "a run".into(), |n| n.to_string_lossy().into_owned());
            Ok(Self { root: folder.join("calls"), manifest: None, label })
        } else {
            Err(fail("neither recording.json nor a run's calls folder is there".to_owned()))
        }
    }

    /// Short name.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// `recording.json`; `None` when the folder of a run is replayed.
    pub fn manifest(&self) -> Option<&RecordingManifest> {
        self.manifest.as_ref()
    }

    /// Names of the answers of one role.
    ///
    /// # Errors
    /// [`BookError::Io`].
    pub fn names(&self, role: Role) -> Result<Vec<CallName>, BookError> {
        names_under(&self.root.join(role.folder()), self.marker())
    }

    /// Whether there are answers for a role at all.
    pub fn covers(&self, role: Role) -> bool {
        self.root.join(role.folder()).is_dir()
    }

    /// Whether somebody outside (not this program alone) answered for a role. Recordings keep only such answers unless
    /// they were told otherwise; of a run's folder the records tell.
    pub fn played_outside(&self, role: Role) -> bool {
        let Ok(names) = self.names(role) else { return false };
        match &self.manifest {
            Some(manifest) => names.iter().any(|name| {
                let answer = manifest.answers.get(&format!("{}/{name}", role.folder()));
                answer.is_some_and(|a| a.player != "offline")
            }),
            None => names.iter().any(|name| {
                let folder = name.under(&self.root.join(role.folder()));
                read_json::<CallRecord>(&folder.join("record.json")).is_ok_and(|record| !record.answered_by.offline)
            }),
        }
    }

    fn marker(&self) -> &'static str {
        if self.manifest.is_some() { "answer.json" } else { "record.json" }
    }

    /// The answer under a name, if there is one.
    pub(crate) fn answer(
        &self,
        role: Role,
        name: &CallName,
        question: &ContentKey,
    ) -> Result<Option<Recorded>, BookError> {
        let folder = name.under(&self.root.join(role.folder()));
        if !folder.join(self.marker()).is_file() {
            return Ok(None);
        }
        let asked = match &self.manifest {
            Some(manifest) => {
                manifest.answers.get(&format!("{}/{name}", role.folder())).map(|answer| answer.question.clone())
            }
            None => read_json::<CallRecord>(&folder.join("record.json")).ok().map(|record| record.question),
        };
        let question_differs = asked.is_some_and(|asked| asked != *question);
        let card =
            PlayerCard { player: "replay".to_owned(), model: self.label.clone(), offline: false, concurrency: 0 };
        let of_answer = PlayerCard { model: answer_digest(&folder)?, ..card.clone() };
        Ok(Some(Recorded { folder, key: key_for(question, &of_answer), card, question_differs }))
    }
}

/// What a recording says about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingAbout {
    /// Short name.
    pub label: String,
    /// Who or what made the answers, in words.
    pub made_by: String,
    /// Licence of the answers.
    pub license: String,
    /// Roles whose answers are taken along; the answers of an editor or a segmenter are pictures.
    pub roles: Vec<Role>,
    /// Whether answers that this program gave alone are taken along (they can be had again at any time).
    pub with_offline: bool,
}

impl RecordingAbout {
    /// The answers of the language model and of the detector: text about the photo, nothing of the photo itself.
    pub fn texts(label: &str, made_by: &str, license: &str) -> Self {
        Self {
            label: label.to_owned(),
            made_by: made_by.to_owned(),
            license: license.to_owned(),
            roles: vec![Role::VisionLanguage, Role::Detector],
            with_offline: false,
        }
    }
}

/// Writes the answers of a run as a recording: no photos, no prompts. Returns how many answers it holds.
///
/// # Errors
/// [`BookError`].
pub fn export_recording(run_folder: &Path, out: &Path, about: &RecordingAbout) -> Result<usize, BookError> {
    let calls = run_folder.join("calls");
    let mut answers = BTreeMap::new();
    let fail = |path: &Path, reason: String| BookError::Write { reason, path: path.to_owned() };
    for role in &about.roles {
        for name in names_under(&calls.join(role.folder()), "record.json")? {
            let from = name.under(&calls.join(role.folder()));
            let Ok(record) = read_json::<CallRecord>(&from.join("record.json")) else { continue };
            if record.answered_by.offline && !about.with_offline {
                continue;
            }
            let to = name.under(&out.join(role.folder()));
            for file in answer_files(&from)? {
                let target = to.join(file.strip_prefix(&from).unwrap_or(&file));
                let bytes = std::fs::read(&file).map_err(crate::book::io_error("read", &file))?;
                write_atomic(&target, &bytes).map_err(|error| fail(&target, error.to_string()))?;
            }
            let answer = RecordedAnswer {
                question: record.question,
                player: record.answered_by.player,
                model: record.answered_by.model,
            };
            answers.insert(format!("{}/{name}", role.folder()), answer);
        }
    }
    let count = answers.len();
    let manifest = RecordingManifest {
        version: RECORDING_VERSION,
        label: about.label.clone(),
        made_by: about.made_by.clone(),
        license: about.license.clone(),
        answers,
    };
    let path = out.join("recording.json");
    write_json(&path, &manifest).map_err(|error| fail(&path, error.to_string()))?;
    Ok(count)
}

/// The files of an answer: `answer.*`, `points.npz` and what is in `masks/`.
fn answer_files(folder: &Path) -> Result<Vec<PathBuf>, BookError> {
    let mut files = Vec::new();
    for entry in sorted_entries(folder)? {
        if !entry.file_name().and_then(|n| n.to_str()).is_some_and(is_answer_file) {
            continue;
        }
        if entry.is_dir() { files.extend(sorted_entries(&entry)?) } else { files.push(entry) }
    }
    Ok(files)
}

impl CallBook {
    /// What a recording holds for a call.
    pub(crate) fn recorded(
        &self,
        role: Role,
        name: &CallName,
        question: &ContentKey,
    ) -> Result<Option<Recorded>, BookError> {
        self.recording().map_or(Ok(None), |recording| recording.answer(role, name, question))
    }
}
