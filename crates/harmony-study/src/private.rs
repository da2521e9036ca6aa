//! The private folder: the decoding map and the secret.
//!
//! `study.json` says which opaque name is which scene and method and holds the secret; `participants.csv` has the
//! invitations. Neither is ever part of the site. The secret signs two things (HMAC-SHA-256, shortened):
//!
//! - an **invitation** (96 bits): this code was given out by this study;
//! - a **token** (128 bits): this code may answer this trial. The server hands the tokens out for an invitation, and
//!   needs no memory of having done so.

use std::fmt::Write as _;
use std::path::Path;

use harmony_io::{read_json, write_json};
use hmac::{Hmac, Mac as _};
use serde::{Deserialize, Serialize};
use sha2::Sha256;

use crate::{FORMAT, StudyError};

/// Name of the file with map and secret.
pub const STUDY_FILE: &str = "study.json";
/// Name of the file with invitations.
pub const PARTICIPANTS_FILE: &str = "participants.csv";

/// What a trial is for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum TrialKind {
    /// A scene whose ranks count.
    Scene,
    /// The same scene shown again, to see whether a person agrees with themselves.
    Repeat,
    /// An attention check: the photo itself must be ranked first, another room last.
    Check,
}

/// A panel of a trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PrivatePanel {
    /// Opaque name.
    pub id: String,
    /// The method; in an attention check also [`PHOTO_ITSELF`] and [`OTHER_ROOM`].
    pub method: String,
}

/// The panel of an attention check that shows the photo.
pub const PHOTO_ITSELF: &str = "(photo)";
/// The panel of an attention check that shows another room.
pub const OTHER_ROOM: &str = "(other room)";

/// A trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PrivateTrial {
    /// Opaque name.
    pub id: String,
    /// Name of the scene.
    pub scene: String,
    /// What it is for.
    pub kind: TrialKind,
    /// Panels in ascending order of their opaque names.
    pub panels: Vec<PrivatePanel>,
}

/// The rule by which participants are left out, fixed when the study is built.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Exclusion {
    /// Shortest median time a trial, milliseconds.
    pub min_median_ms: u64,
    /// Attention checks that may fail.
    pub failed_checks: usize,
}

impl Default for Exclusion {
    fn default() -> Self {
        Self { min_median_ms: 5000, failed_checks: 0 }
    }
}

/// `study.json` of the private folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PrivateStudy {
    /// Format.
    pub format: u32,
    /// The study's name.
    pub study: String,
    /// Version of the site.
    pub version: String,
    /// 64 hexadecimal digits.
    pub secret: String,
    /// Methods in the order in which they were given.
    pub methods: Vec<String>,
    /// The method that the others are compared with.
    pub reference: String,
    /// Who is left out.
    pub exclusion: Exclusion,
    /// Trials in the order of the page's list.
    pub trials: Vec<PrivateTrial>,
    /// Scenes that were left out, and why.
    pub left_out: Vec<String>,
    /// What a careful reader should know: panels that can be recognised by their shape, for one.
    pub notes: Vec<String>,
}

impl PrivateStudy {
    /// Reads a private folder.
    ///
    /// # Errors
    /// An unreadable file, or one of another format.
    pub fn load(folder: &Path) -> Result<Self, StudyError> {
        let path = folder.join(STUDY_FILE);
        let study: Self = read_json(&path)?;
        if study.format != FORMAT {
            return Err(StudyError::Format { path, found: study.format, known: FORMAT });
        }
        Ok(study)
    }

    /// Writes `study.json`, readable by its owner alone where the system knows owners.
    ///
    /// # Errors
    /// An unwritable folder.
    pub fn save(&self, folder: &Path) -> Result<(), StudyError> {
        let path = folder.join(STUDY_FILE);
        write_json(&path, self)?;
        private(&path);
        Ok(())
    }

    /// The key of an invitation.
    pub fn invitation(&self, participant: &str) -> String {
        self.sign(&format!("participant\n{}\n{participant}", self.study), 12)
    }

    /// The token for an answer of a participant to a trial.
    pub fn token(&self, participant: &str, trial: &str) -> String {
        self.sign(&format!("trial\n{}\n{participant}\n{trial}", self.study), 16)
    }

    /// Whether an invitation is genuine.
    pub fn invited(&self, participant: &str, key: &str) -> bool {
        same(&self.invitation(participant), key)
    }

    /// Whether a token is genuine.
    pub fn signed(&self, participant: &str, trial: &str, token: &str) -> bool {
        same(&self.token(participant, trial), token)
    }

    fn sign(&self, text: &str, bytes: usize) -> String {
        hex(&keyed(self.secret.as_bytes(), text)[..bytes])
    }
}

/// Only the owner may read the file.
pub(crate) fn private(path: &Path) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let _ = std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600));
    }
    #[cfg(not(unix))]
    let _ = path;
}

/// HMAC-SHA-256.
pub(crate) fn keyed(secret: &[u8], text: &str) -> [u8; 32] {
    let mut mac = Hmac::<Sha256>::new_from_slice(secret).expect("HMAC takes keys of any length");
    mac.update(text.as_bytes());
    mac.finalize().into_bytes().into()
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(bytes.len() * 2), |mut text, b| {
        let _ = write!(text, "{b:02x}");
        text
    })
}

/// Compares in a time that does not depend on where the texts differ.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |d, (x, y)| d | (x ^ y)) == 0
}
