//! What the models folder knows of itself: licences that were accepted, files that were checked.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{ModelError, date};

/// Name of the record in the models folder.
pub const LEDGER: &str = "harmony-models.json";

/// Where a checksum comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Checksum {
    /// The program's table.
    Table,
    /// The hub told it beside the file, and the file has it. Not known before: it holds from now on.
    Hub,
    /// The first file that came has it. Not known before: it holds from now on.
    FirstUse,
}

/// A file that was checked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Known {
    /// SHA-256 of its content.
    pub sha256: String,
    /// Who says that it should be this one.
    pub checksum: Checksum,
    /// Bytes.
    pub size: u64,
    /// When it was changed last, nanoseconds since 1970; another time means that it has to be checked again.
    pub modified: u64,
    /// Commit that it came from, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revision: Option<String>,
    /// When it was checked, seconds since 1970.
    pub checked: u64,
}

impl Known {
    /// The day on which it was checked.
    pub fn day(&self) -> String {
        date::day(self.checked)
    }
}

/// A licence that somebody agreed to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Accepted {
    /// Seconds since 1970.
    pub when: u64,
    /// How: `--accept-licence`, or an answer on a terminal.
    pub how: String,
}

impl Accepted {
    pub(crate) fn now(how: &str) -> Self {
        Self { when: date::now(), how: how.to_owned() }
    }

    /// The day.
    pub fn day(&self) -> String {
        date::day(self.when)
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Ledger {
    pub(crate) accepted: BTreeMap<String, Accepted>,
    /// By `model/file`.
    pub(crate) files: BTreeMap<String, Known>,
}

impl Ledger {
    pub(crate) fn read(folder: &Path) -> Result<Self, ModelError> {
        let path = folder.join(LEDGER);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(ModelError::Io { path, source: error }),
        };
        serde_json::from_str(&text).map_err(|error| ModelError::Ledger { path, reason: error.to_string() })
    }

    pub(crate) fn write(&self, folder: &Path) -> Result<(), ModelError> {
        let path = folder.join(LEDGER);
        let text = serde_json::to_vec_pretty(self)
            .map_err(|error| ModelError::Ledger { path: path.clone(), reason: error.to_string() })?;
        let new = folder.join(format!("{LEDGER}.new"));
        let write = || {
            use std::io::Write as _;
            let mut file = std::fs::File::create(&new)?;
            file.write_all(&text)?;
            file.sync_all()?;
            std::fs::rename(&new, &path)
        };
        write().map_err(ModelError::io(&path))
    }
}
