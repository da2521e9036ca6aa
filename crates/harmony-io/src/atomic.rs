//! Bytes and JSON on disk: written under a temporary name beside the target, then renamed.
//!
//! A reader never sees half a file, and a killed program leaves the old file or the new one. [`write_durable`] also
//! survives a power cut; [`write_atomic`] trusts the operating system's cache, which is enough for files that can be
//! made again.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Largest JSON file that is read, bytes.
pub const MAX_JSON_BYTES: u64 = 256 << 20;

/// A file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// Reading failed.
    #[error("cannot read {path}: {source}")]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Writing failed.
    #[error("cannot write {path}: {source}")]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is larger than what is read.
    #[error("{bytes} bytes are more than the {limit} that are read at most: {path}")]
    TooLarge {
        /// Which file.
        path: PathBuf,
        /// Its size (at least).
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// The file is not the JSON that was expected.
    #[error("not the expected JSON, {source}: {path}")]
    Parse {
        /// Which file.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// A value cannot be written as JSON.
    #[error("cannot be written as JSON, {source}: {path}")]
    Encode {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
}

impl FileError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Read { source, .. } | Self::Write { source, .. } => io_hint(source),
            Self::TooLarge { .. } => Some("this does not look like a file that HARMONY wrote; check the path"),
            Self::Parse { .. } => {
                Some("the file was changed by hand or by another version; delete it to have it made again")
            }
            Self::Encode { .. } => None,
        }
    }
}

/// What a person can do about an operating-system error.
pub fn io_hint(error: &io::Error) -> Option<&'static str> {
    match error.kind() {
        io::ErrorKind::NotFound => Some("check the path; it is relative to the current folder"),
        io::ErrorKind::PermissionDenied => Some("check who owns the file and its folder, or write somewhere else"),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            Some("the disk is full: free some space and run the same command again, finished work is kept")
        }
        io::ErrorKind::ReadOnlyFilesystem => Some("the file system is read-only: choose another output folder"),
        io::ErrorKind::AlreadyExists => Some("a file of this name is in the way: move it, or choose another folder"),
        io::ErrorKind::IsADirectory => Some("this is a folder, a file is needed"),
        io::ErrorKind::NotADirectory => Some("a part of the path is a file, not a folder"),
        _ => None,
    }
}

/// Writes a file through a temporary name in the same folder; missing folders are made.
///
/// # Errors
/// [`FileError::Write`]; the target is then as it was before and the temporary file is gone.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_renamed(path, bytes, false)
}

/// As [`write_atomic`], and flushed to the disk before and after the rename.
///
/// # Errors
/// [`FileError::Write`].
pub fn write_durable(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_renamed(path, bytes, true)
}

/// Whether a name is one under which [`write_atomic`] writes: `.<name>.<process>.<number>.tmp`.
pub fn is_temporary(name: &std::ffi::OsStr) -> bool {
    let number = |part: Option<&str>| part.is_some_and(|p| !p.is_empty() && p.bytes().all(|b| b.is_ascii_digit()));
    let Some(inner) = name.to_str().and_then(|n| n.strip_prefix('.')?.strip_suffix(".tmp")) else { return false };
    let mut parts = inner.rsplitn(3, '.');
    number(parts.next()) && number(parts.next()) && parts.next().is_some_and(|n| !n.is_empty())
}

fn write_renamed(path: &Path, bytes: &[u8], durable: bool) -> Result<(), FileError> {
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let fail = |source| FileError::Write { path: path.to_owned(), source };
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let name = path.file_name().ok_or_else(|| fail(io::Error::from(io::ErrorKind::IsADirectory)))?;
    fs::create_dir_all(folder).map_err(fail)?;
    // Two threads, or two processes, may write the same target at once: each has its own temporary file.
    let mut temporary = std::ffi::OsString::from(".");
    temporary.push(name);
    temporary.push(format!(".{}.{}.tmp", std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed)));
    let temporary = folder.join(temporary);
    let written = (|| {
        let mut file = File::create(&temporary)?;
        file.write_all(bytes)?;
        if durable {
            file.sync_all()?;
        }
        drop(file);
        fs::rename(&temporary, path)?;
        if durable {
            // Folders cannot be flushed everywhere; where they can, the rename is then on the disk too.
            if let Ok(handle) = File::open(folder) {
                let _ = handle.sync_all();
            }
        }
        Ok(())
    })();
    written.map_err(|source| {
        let _ = fs::remove_file(&temporary);
        fail(source)
    })
}

/// Reads a file of at most `limit` bytes.
///
/// # Errors
/// [`FileError::Read`] or [`FileError::TooLarge`].
pub fn read_bounded(path: &Path, limit: u64) -> Result<Vec<u8>, FileError> {
    let fail = |source| FileError::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(fail)?;
    let meta = file.metadata().map_err(fail)?;
    if meta.is_dir() {
        return Err(fail(io::Error::from(io::ErrorKind::IsADirectory)));
    }
    if meta.len() > limit {
        return Err(FileError::TooLarge { path: path.to_owned(), bytes: meta.len(), limit });
    }
    let mut bytes = Vec::with_capacity(meta.len() as usize);
    // The size may lie (pipes, growing files), so the reader itself is bounded too.
    file.take(limit + 1).read_to_end(&mut bytes).map_err(fail)?;
    if bytes.len() as u64 > limit {
        return Err(FileError::TooLarge { path: path.to_owned(), bytes: bytes.len() as u64, limit });
    }
    Ok(bytes)
}

/// JSON text as it is written everywhere: indented by two blanks, fields in declaration order, newline at the end.
///
/// # Errors
/// When the value has no JSON form (a map with keys that are not text).
pub fn json_text<T: Serialize + ?Sized>(value: &T) -> Result<String, serde_json::Error> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    Ok(text)
}

/// Writes a value as JSON, atomically.
///
/// # Errors
/// [`FileError::Encode`] or [`FileError::Write`].
pub fn write_json<T: Serialize + ?Sized>(path: &Path, value: &T) -> Result<(), FileError> {
    let text = json_text(value).map_err(|source| FileError::Encode { path: path.to_owned(), source })?;
    write_atomic(path, text.as_bytes())
}

/// Reads a value from JSON.
///
/// # Errors
/// [`FileError`].
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, FileError> {
    let bytes = read_bounded(path, MAX_JSON_BYTES)?;
    serde_json::from_slice(&bytes).map_err(|source| FileError::Parse { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a/b/value.json");
        write_json(&target, &[1, 2]).unwrap();
        assert_eq!(fs::read_to_string(&target).unwrap(), "[\n  1,\n  2\n]\n");
        assert_eq!(read_json::<Vec<i32>>(&target).unwrap(), [1, 2]);
        // A folder in the way cannot be replaced by a file.
        let blocked = folder.path().join("a/blocked");
        fs::create_dir_all(blocked.join("inside")).unwrap();
        let error = write_atomic(&blocked, b"x").unwrap_err();
        assert!(matches!(error, FileError::Write { .. }));
        let names: Vec<_> = fs::read_dir(folder.path().join("a")).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(names.len(), 2, "only b and blocked: {names:?}");
        assert!(blocked.join("inside").is_dir());
    }

    #[test]
    fn only_our_own_temporary_names_are_taken_for_such() {
        for (name, ours) in [
            (".scene.json.812.0.tmp", true),
            (".x.1.2.tmp", true),
            (".1.2.tmp", false),
            ("scene.json.812.0.tmp", false),
            (".scene.json.812.tmp", false),
            (".scene.json..0.tmp", false),
            (".tmp", false),
        ] {
            assert_eq!(is_temporary(std::ffi::OsStr::new(name)), ours, "{name}");
        }
    }

    #[test]
    fn reading_is_bounded_and_says_what_is_wrong() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("x.json");
        fs::write(&file, "{\"a\": ").unwrap();
        assert!(matches!(read_bounded(&file, 3), Err(FileError::TooLarge { bytes: 6, limit: 3, .. })));
        let error = read_json::<serde_json::Value>(&file).unwrap_err();
        assert!(error.to_string().contains("line 1"), "{error}");
        let error = read_json::<serde_json::Value>(&folder.path().join("none.json")).unwrap_err();
        assert!(error.hint().is_some());
        assert!(matches!(read_bounded(folder.path(), 10), Err(FileError::Read { .. })));
    }

    #[test]
    fn a_full_disk_and_a_read_only_one_have_hints() {
        // ENOSPC and EROFS by number: what the kernel would answer.
        for (number, word) in [(28, "full"), (30, "read-only"), (13, "owns")] {
            let error = FileError::Write { path: "x".into(), source: io::Error::from_raw_os_error(number) };
            assert!(error.hint().is_some_and(|h| h.contains(word)), "{error}");
        }
    }

    #[test]
    fn concurrent_writers_leave_one_whole_file() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("shared.bin");
        std::thread::scope(|scope| {
            for k in 0..4_u8 {
                let target = &target;
                scope.spawn(move || {
                    for _ in 0..20 {
                        write_atomic(target, &vec![k; 10_000]).unwrap();
                    }
                });
            }
        });
        let bytes = fs::read(&target).unwrap();
        assert_eq!(bytes.len(), 10_000);
        assert!(bytes.iter().all(|b| *b == bytes[0]));
    }
}
