//! Files as they are made: all in memory first, so that nothing is overwritten when one cannot be made.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use harmony_io::write_atomic;

use crate::ExportError;

/// Files by their path below the export folder, with `/` between.
#[derive(Debug, Clone, Default)]
pub struct Files {
    files: BTreeMap<String, Arc<[u8]>>,
}

impl Files {
    /// Adds a file; the same path again replaces it.
    pub fn add(&mut self, path: impl Into<String>, bytes: impl Into<Arc<[u8]>>) {
        self.files.insert(path.into(), bytes.into());
    }

    /// Adds a text file.
    pub fn text(&mut self, path: impl Into<String>, text: String) {
        self.add(path, text.into_bytes());
    }

    /// Adds all files of another set.
    pub fn extend(&mut self, other: Self) {
        self.files.extend(other.files);
    }

    /// A file's bytes.
    pub fn get(&self, path: &str) -> Option<&[u8]> {
        self.files.get(path).map(|bytes| &**bytes)
    }

    /// All of them, by path.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &[u8])> {
        self.files.iter().map(|(path, bytes)| (path.as_str(), &**bytes))
    }

    /// Writes them below a folder, each whole or not at all.
    ///
    /// # Errors
    /// [`ExportError::File`] for the first that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), ExportError> {
        for (path, bytes) in self.iter() {
            write_atomic(&folder.join(path), bytes)?;
        }
        Ok(())
    }
}
