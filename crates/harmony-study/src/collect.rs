//! Answers that came as files: from pages opened from disk, or whose server could not be reached.

use std::path::{Path, PathBuf};

use harmony_io::read_json;
use serde::{Deserialize, Serialize};

use crate::log::{Entry, Log, NotStored, Stored, Via};
use crate::private::PrivateStudy;
use crate::record::{Answer, Refusal, is_participant};
use crate::{FORMAT, StudyError};

/// Most answers of a file.
const MAX_ANSWERS: usize = 10_000;

/// What the page exports.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Export {
    /// Format.
    pub format: u32,
    /// The study's name.
    pub study: String,
    /// Version of its site.
    pub version: String,
    /// The participant's code.
    pub participant: String,
    /// The invitation's key, if there was an invitation.
    pub key: Option<String>,
    /// Whether the participant handed in.
    pub finished: bool,
    /// Latest answers.
    pub answers: Vec<Answer>,
}

/// What became of one file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Collected {
    /// Answers stored now.
    pub stored: usize,
    /// Answers that were there already.
    pub before: usize,
    /// Answers that were refused, and why.
    pub refused: Vec<String>,
}

/// Adds a file's answers to the log.
///
/// # Errors
/// A file that is no export of this study's page, or whose invitation is not genuine (`unsigned` takes those without).
pub fn collect(path: &Path, study: &PrivateStudy, log: &Log, unsigned: bool) -> Result<Collected, StudyError> {
    let export: Export = read_json(path)?;
    let refuse = |name: &str, why| StudyError::Name { what: "the file of", name: name.to_owned(), why };
    if export.format != FORMAT {
        return Err(StudyError::Format { path: PathBuf::from(path), found: export.format, known: FORMAT });
    }
    if export.study != study.study || export.version != study.version {
        return Err(StudyError::OtherStudy {
            path: PathBuf::from(path),
            found: format!("{} (version {})", export.study, export.version),
            wanted: format!("{} (version {})", study.study, study.version),
        });
    }
    if !is_participant(&export.participant) || export.answers.len() > MAX_ANSWERS {
        return Err(refuse(&export.participant, "no page writes such a file"));
    }
    let via = match &export.key {
        Some(key) if study.invited(&export.participant, key) => Via::File,
        Some(_) => return Err(refuse(&export.participant, "its invitation is not one of this study")),
        None if unsigned => Via::UnsignedFile,
        None => return Err(refuse(&export.participant, "it has no invitation (--unsigned takes such files, too)")),
    };
    let mut collected = Collected::default();
    for answer in export.answers {
        let trial = answer.trial.clone();
        let outcome = if answer.participant == export.participant {
            answer.check(study).map_err(NotStored::from)
        } else {
            Err(NotStored::Refused(Refusal::Forged))
        };
        match outcome.and_then(|()| log.append_blocking(Entry::Answer { answer, via })) {
            Ok(Stored::New) => collected.stored += 1,
            Ok(Stored::Before) => collected.before += 1,
            Err(error) => collected.refused.push(format!("trial {trial}: {error}")),
        }
    }
    if export.finished
        && let Err(error) = log.append_blocking(Entry::Finish { participant: export.participant })
    {
        collected.refused.push(error.to_string());
    }
    Ok(collected)
}
