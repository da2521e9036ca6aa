//! The run folder as a whole: one program at a time works in it, and what a killed one left half-written goes.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use harmony_io::atomic::{io_hint, is_temporary};

/// Name of the lock file in a run folder; it is empty and stays there.
pub const LOCK_FILE: &str = ".lock";

/// Folders deeper than this are not looked into for half-written files; a run folder has five levels.
const DEEPEST: usize = 12;

/// A run folder cannot be worked in.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunFolderError {
    /// It cannot be made or written.
    #[error("the run folder {path} cannot be used: {source}", path = path.display())]
    Unusable {
        /// Which folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Somebody else is at it.
    #[error("another harmony is at work in {path}", path = path.display())]
    Busy {
        /// Which folder.
        path: PathBuf,
    },
}

impl RunFolderError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Unusable { source, .. } => io_hint(source),
            Self::Busy { .. } => Some("wait until it has ended, or choose another folder with --out"),
        }
    }
}

/// The right to write into a run folder, until it is dropped or the program ends in whatever way.
#[derive(Debug)]
pub struct RunFolder {
    _lock: File,
}

impl RunFolder {
    /// Makes the folder, locks it, and removes half-written files.
    ///
    /// The lock is the operating system's: it vanishes with its program, so a killed run leaves nothing in the way.
    ///
    /// # Errors
    /// [`RunFolderError`].
    pub fn take(run: &Path) -> Result<Self, RunFolderError> {
        let fail = |source| RunFolderError::Unusable { path: run.to_owned(), source };
        fs::create_dir_all(run).map_err(fail)?;
        let lock = File::options().create(true).truncate(false).write(true).open(run.join(LOCK_FILE)).map_err(fail)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(RunFolderError::Busy { path: run.to_owned() }),
            // Some network file systems have no locks; a run there is as good as without one.
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
            Err(TryLockError::Error(error)) => return Err(fail(error)),
        }
        sweep(run, 0);
        Ok(Self { _lock: lock })
    }
}

/// Removes the temporary files of [`harmony_io::write_atomic`] that a killed program left.
fn sweep(folder: &Path, depth: usize) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        // Links are not followed: what they lead to is not ours.
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_dir() && depth < DEEPEST {
            sweep(&entry.path(), depth + 1);
        } else if kind.is_file() && is_temporary(&entry.file_name()) {
            // A file that cannot be removed does no harm.
            let _ = fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time_and_the_next_one_finds_no_litter() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("a/run");
        let first = RunFolder::take(&run).unwrap();
        fs::create_dir_all(run.join("3_furniture/masks")).unwrap();
        let litter = run.join("3_furniture/masks/.chair_01.png.4711.3.tmp");
        let kept = [run.join("3_furniture/masks/chair_01.png"), run.join("notes.tmp"), run.join(".mine.tmp")];
        for path in kept.iter().chain([&litter]) {
            fs::write(path, "x").unwrap();
        }
        let error = RunFolder::take(&run).unwrap_err();
        assert!(matches!(error, RunFolderError::Busy { .. }) && error.hint().is_some());
        assert!(litter.exists());
        drop(first);
        let _second = RunFolder::take(&run).unwrap();
        assert!(!litter.exists() && kept.iter().all(|path| path.exists()));
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "x").unwrap();
        for path in [file.clone(), file.join("run")] {
            let error = RunFolder::take(&path).unwrap_err();
            assert!(error.to_string().contains("file") && error.hint().is_some(), "{error}");
        }
    }
}
