//! The call book: the records of a run, written whole or not at all.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::{fs, io};

use harmony_io::atomic::{json_text, read_bounded};
use harmony_roles::{Role, RoleError};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::record::{CallRecord, CallSummary, CallTiming, RECORD_VERSION, Source, Unanswered};
use crate::recording::Recording;
use crate::{CallName, ContentKey, NameError};

/// Folder of half-written records; emptied when a book is opened.
const TEMPORARY: &str = ".tmp";

/// Folder of the accounts of calls that have no answer yet.
const UNANSWERED: &str = ".unanswered";

/// Folder of the images that calls were made with, one file an image.
const IMAGES: &str = ".images";

/// Largest text file of a record that is read back, bytes.
const MAX_TEXT_BYTES: u64 = 64 << 20;

/// The call book could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BookError {
    /// The disk did not let us.
    #[error("cannot {action}: {source}: {path}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// Why not.
        source: io::Error,
        /// Where.
        path: PathBuf,
    },
    /// A file could not be encoded or written.
    #[error("cannot write a part of the record: {reason}: {path}")]
    Write {
        /// Why not.
        reason: String,
        /// Where.
        path: PathBuf,
    },
    /// The call's name can't be used.
    #[error(transparent)]
    Name(#[from] NameError),
    /// A record lies where this call's folder should have sub-folders, or the other way round.
    #[error("call {name} and another call would share a folder: {path}")]
    NameConflict {
        /// The call.
        name: String,
        /// Where.
        path: PathBuf,
    },
    /// What was given as a recording is none.
    #[error("not a recording, {reason}: {path}")]
    NotARecording {
        /// What is missing.
        reason: String,
        /// Where.
        path: PathBuf,
    },
}

impl BookError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Io { source, .. } => harmony_io::atomic::io_hint(source),
            Self::NotARecording { .. } => Some("give a folder with recording.json, or the folder of a finished run"),
            Self::NameConflict { .. } | Self::Name(_) | Self::Write { .. } => None,
        }
    }
}

impl From<BookError> for RoleError {
    fn from(error: BookError) -> Self {
        let kind = if let BookError::Io { source, .. } = &error { source.kind() } else { io::ErrorKind::Other };
        Self::Io { player: "the call book".to_owned(), source: io::Error::new(kind, error) }
    }
}

pub(crate) fn io_error(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> BookError {
    let path = path.to_owned();
    move |source| BookError::Io { action, source, path }
}

/// How a book is opened.
#[derive(Debug, Clone, Default)]
pub struct BookOptions {
    /// A recording (or the folder of another run) whose answers are taken by name.
    pub replay: Option<PathBuf>,
    /// Ask again where the offline player stood in for a player that failed, instead of taking the record.
    pub retry_replaced: bool,
    /// Don't keep the images that calls were made with.
    pub without_images: bool,
    /// Texts that must never be written, such as API keys; each is replaced by `[secret]`.
    pub secrets: Vec<Secret>,
}

/// A text that is never shown.
#[derive(Clone)]
pub struct Secret(String);

impl Secret {
    /// Wraps a text.
    pub fn new(text: String) -> Self {
        Self(text)
    }
}

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("[secret]")
    }
}

/// The records of one run.
#[derive(Debug)]
pub struct CallBook {
    root: PathBuf,
    options: BookOptions,
    recording: Option<Recording>,
    counter: AtomicU64,
}

impl CallBook {
    /// Opens (or starts) the book of a run folder: `<run>/calls`. What an earlier, killed program left half-written
    /// is removed. One program at a time may have a run's book open.
    ///
    /// # Errors
    /// [`BookError`] when the folder can't be made or the recording can't be read.
    pub fn open(run_folder: &Path, options: BookOptions) -> Result<Self, BookError> {
        let root = run_folder.join("calls");
        let temporary = root.join(TEMPORARY);
        match fs::remove_dir_all(&temporary) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(io_error("remove half-written records", &temporary)(error));
            }
            _ => {}
        }
        fs::create_dir_all(&root).map_err(io_error("make the folder", &root))?;
        let recording = options.replay.as_deref().map(Recording::open).transpose()?;
        Ok(Self { root, options, recording, counter: AtomicU64::new(0) })
    }

    /// Looks into the book of a run folder, which another program may be writing: nothing is made or tidied.
    pub fn look(run_folder: &Path) -> Self {
        let root = run_folder.join("calls");
        Self { root, options: BookOptions::default(), recording: None, counter: AtomicU64::new(0) }
    }

    /// `<run>/calls`.
    pub fn folder(&self) -> &Path {
        &self.root
    }

    /// The recording that is replayed, if any.
    pub fn recording(&self) -> Option<&Recording> {
        self.recording.as_ref()
    }

    /// How the book was opened.
    pub fn options(&self) -> &BookOptions {
        &self.options
    }

    /// The folder of a record, whether there is one or not.
    pub fn record_folder(&self, role: Role, name: &CallName) -> PathBuf {
        name.under(&self.root.join(role.folder()))
    }

    /// Reads a record, or `None` when there is none that this version can read.
    pub fn record(&self, role: Role, name: &CallName) -> Option<CallRecord> {
        let record: CallRecord = read_json(&self.record_folder(role, name).join("record.json")).ok()?;
        let fits = record.version == RECORD_VERSION && record.role == role && record.name == name.as_str();
        fits.then_some(record)
    }

    /// The first call of a role that a player answered and that was this work; `None` when there is none.
    pub(crate) fn with_work(&self, role: Role, work: &ContentKey) -> Result<Option<CallRecord>, BookError> {
        let names = names_under(&self.root.join(role.folder()), "record.json")?;
        let mut records = names.iter().filter_map(|name| self.record(role, name));
        Ok(records.find(|record| record.work.as_ref() == Some(work) && record.source == Source::Player))
    }

    /// The text with every secret replaced.
    pub fn redacted(&self, text: &str) -> String {
        self.options
            .secrets
            .iter()
            .filter(|secret| secret.0.len() >= 4)
            .fold(text.to_owned(), |text, secret| text.replace(&secret.0, "[secret]"))
    }

    /// Writes a record: all its files into a temporary folder, which is then renamed. A record that was there under
    /// this name is replaced.
    pub(crate) fn store(
        &self,
        record: &CallRecord,
        timing: CallTiming,
        write: impl FnOnce(&RecordWriter<'_>) -> Result<(), BookError>,
    ) -> Result<PathBuf, BookError> {
        let name = CallName::new(&record.name)?;
        let target = self.record_folder(record.role, &name);
        self.refuse_conflict(record.role, &name, &target)?;
        let number = self.counter.fetch_add(1, Ordering::Relaxed);
        let temporary = self.root.join(TEMPORARY).join(number.to_string());
        fs::create_dir_all(&temporary).map_err(io_error("make the folder", &temporary))?;
        let writer = RecordWriter { book: self, folder: &temporary };
        let written = write(&writer).and_then(|()| {
            writer.json("timing.json", &timing)?;
            writer.json("record.json", record)
        });
        if let Err(error) = written {
            // The error that stopped the record says more than one about its litter.
            let _ = fs::remove_dir_all(&temporary);
            return Err(error);
        }
        if let Some(parent) = target.parent() {
            fs::create_dir_all(parent).map_err(io_error("make the folder", parent))?;
        }
        let old = self.root.join(TEMPORARY).join(format!("{number}_old"));
        let replaced = target.exists();
        if replaced {
            fs::rename(&target, &old).map_err(io_error("move the old record away from", &target))?;
        }
        fs::rename(&temporary, &target).map_err(io_error("move the record to", &target))?;
        if replaced {
            // A leftover would be removed when the book is opened the next time.
            let _ = fs::remove_dir_all(&old);
        }
        Ok(target)
    }

    /// A record's folder holds files and `images/`, so no other call may live inside it.
    fn refuse_conflict(&self, role: Role, name: &CallName, target: &Path) -> Result<(), BookError> {
        let conflict = |path: &Path| BookError::NameConflict { name: name.to_string(), path: path.to_owned() };
        let top = self.root.join(role.folder());
        for folder in target.ancestors().skip(1).take_while(|folder| **folder != top) {
            if folder.join("record.json").exists() {
                return Err(conflict(folder));
            }
        }
        // A folder without a record and without calls below it is what is left of a damaged record.
        if !target.join("record.json").exists() && !names_under(target, "record.json")?.is_empty() {
            return Err(conflict(target));
        }
        Ok(())
    }

    fn unanswered_file(&self, role: Role, name: &CallName) -> PathBuf {
        // The parts of a name hold no dot, so names and files go one to one.
        let file = format!("{}.json", name.as_str().replace('/', "."));
        self.root.join(UNANSWERED).join(role.folder()).join(file)
    }

    /// What was tried for a call that has no answer yet.
    pub(crate) fn unanswered(&self, role: Role, name: &CallName) -> Option<Unanswered> {
        let account: Unanswered = read_json(&self.unanswered_file(role, name)).ok()?;
        (account.role == role && account.name == name.as_str()).then_some(account)
    }

    pub(crate) fn keep_unanswered(&self, account: &Unanswered) -> Result<(), BookError> {
        let path = self.unanswered_file(account.role, &CallName::new(&account.name)?);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(io_error("make the folder", folder))?;
        }
        let write = |reason: String| BookError::Write { reason, path: path.clone() };
        let text = json_text(account).map_err(|error| write(error.to_string()))?;
        harmony_io::write_atomic(&path, self.redacted(&text).as_bytes()).map_err(|error| write(error.to_string()))
    }

    pub(crate) fn forget_unanswered(&self, role: Role, name: &CallName) {
        // Mostly there is none; one that stays is overruled by the record.
        let _ = fs::remove_file(self.unanswered_file(role, name));
    }

    /// Every record of the run in order of role and name: the audit log, and what the bill is made from. After the
    /// records of a role come the calls that were tried and have no answer yet.
    ///
    /// # Errors
    /// [`BookError::Io`] when the folder can't be listed; a record that can't be read is left out.
    pub fn log(&self) -> Result<Vec<CallSummary>, BookError> {
        let mut log = Vec::new();
        for role in Role::ALL {
            for name in names_under(&self.root.join(role.folder()), "record.json")? {
                let Some(record) = self.record(role, &name) else { continue };
                let timing = read_json(&self.record_folder(role, &name).join("timing.json")).unwrap_or_default();
                log.push(CallSummary {
                    name: record.name,
                    phase: name.phase().to_owned(),
                    role,
                    player: record.answered_by.player,
                    model: record.answered_by.model,
                    offline: record.answered_by.offline,
                    source: record.source,
                    tries: record.tries.len(),
                    usage: record.usage,
                    timing,
                });
            }
            for path in sorted_entries(&self.root.join(UNANSWERED).join(role.folder()))? {
                let Ok(account) = read_json::<Unanswered>(&path) else { continue };
                let Ok(name) = CallName::new(&account.name) else { continue };
                if account.role != role || self.record(role, &name).is_some() {
                    continue;
                }
                log.push(CallSummary {
                    name: account.name,
                    phase: name.phase().to_owned(),
                    role,
                    player: account.tries.last().map(|t| t.player.clone()).unwrap_or_default(),
                    model: String::new(),
                    offline: false,
                    source: Source::Unanswered,
                    tries: account.tries.len(),
                    usage: account.usage,
                    timing: CallTiming { started_unix_ms: account.started_unix_ms, latency_ms: account.latency_ms },
                });
            }
        }
        Ok(log)
    }

    /// Hash of all answers whose names begin with a prefix such as `3_furniture/` (of every role): changes when a
    /// person edits an answer, or one is made anew and comes out differently. Times don't count.
    ///
    /// # Errors
    /// [`BookError::Io`] when a folder or file can't be read.
    pub fn answers_digest(&self, prefix: &str) -> Result<String, BookError> {
        let mut hasher = blake3::Hasher::new();
        for role in Role::ALL {
            for name in names_under(&self.root.join(role.folder()), "record.json")? {
                if name.as_str().starts_with(prefix) {
                    hasher.update(role.folder().as_bytes());
                    hasher.update(name.as_str().as_bytes());
                    hasher.update(answer_digest(&self.record_folder(role, &name))?.as_bytes());
                }
            }
        }
        Ok(hasher.finalize().to_hex().to_string())
    }

    /// Keeps an image once, however many calls show it.
    fn keep_image(&self, hash: &str, encode: impl FnOnce() -> Result<Vec<u8>, String>) -> Result<PathBuf, BookError> {
        let path = self.root.join(IMAGES).join(format!("{hash}.png"));
        if !path.exists() {
            let bytes = encode().map_err(|reason| BookError::Write { reason, path: path.clone() })?;
            harmony_io::write_atomic(&path, &bytes)
                .map_err(|error| BookError::Write { reason: error.to_string(), path: path.clone() })?;
        }
        Ok(path)
    }
}

/// Writes the files of one record; every text has its secrets replaced.
pub struct RecordWriter<'a> {
    book: &'a CallBook,
    folder: &'a Path,
}

impl RecordWriter<'_> {
    /// The folder that is being filled.
    pub fn folder(&self) -> &Path {
        self.folder
    }

    /// Writes bytes.
    ///
    /// # Errors
    /// [`BookError::Io`].
    pub fn bytes(&self, file: &str, bytes: &[u8]) -> Result<(), BookError> {
        let path = self.folder.join(file);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(io_error("make the folder", parent))?;
        }
        fs::write(&path, bytes).map_err(io_error("write", &path))
    }

    /// Writes a text.
    ///
    /// # Errors
    /// [`BookError::Io`].
    pub fn text(&self, file: &str, text: &str) -> Result<(), BookError> {
        self.bytes(file, self.book.redacted(text).as_bytes())
    }

    /// Writes JSON.
    ///
    /// # Errors
    /// [`BookError`].
    pub fn json<T: Serialize + ?Sized>(&self, file: &str, value: &T) -> Result<(), BookError> {
        let text = json_text(value)
            .map_err(|error| BookError::Write { reason: error.to_string(), path: self.folder.join(file) })?;
        self.text(file, &text)
    }

    /// Shows an image in the record's `images/`; the pixels are kept once for all records.
    ///
    /// # Errors
    /// [`BookError`].
    pub fn image(
        &self,
        file: &str,
        hash: &str,
        encode: impl FnOnce() -> Result<Vec<u8>, String>,
    ) -> Result<(), BookError> {
        if self.book.options.without_images {
            return Ok(());
        }
        let kept = self.book.keep_image(hash, encode)?;
        let path = self.folder.join("images").join(file);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(io_error("make the folder", parent))?;
        }
        // Not every file system has hard links.
        if fs::hard_link(&kept, &path).is_err() {
            fs::copy(&kept, &path).map_err(io_error("write", &path))?;
        }
        Ok(())
    }
}

/// Reads a bounded JSON file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, String> {
    let bytes = read_bounded(path, MAX_TEXT_BYTES).map_err(|error| error.to_string())?;
    serde_json::from_slice(&bytes).map_err(|error| error.to_string())
}

/// Whether a file of a record is part of the answer (and not of the request or the book-keeping).
pub(crate) fn is_answer_file(name: &str) -> bool {
    name.starts_with("answer.") || name == "points.npz" || name == "masks"
}

/// Hash of the answer's files in a record's folder.
pub(crate) fn answer_digest(folder: &Path) -> Result<String, BookError> {
    let mut files = Vec::new();
    for entry in sorted_entries(folder)? {
        let Some(name) = entry.file_name().and_then(|n| n.to_str()).map(str::to_owned) else { continue };
        if !is_answer_file(&name) {
            continue;
        }
        if entry.is_dir() {
            files.extend(sorted_entries(&entry)?);
        } else {
            files.push(entry);
        }
    }
    let mut hasher = blake3::Hasher::new();
    for file in files {
        let bytes = fs::read(&file).map_err(io_error("read", &file))?;
        hasher.update(file.file_name().unwrap_or_default().as_encoded_bytes());
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Entries of a folder by name; none when it does not exist.
pub(crate) fn sorted_entries(folder: &Path) -> Result<Vec<PathBuf>, BookError> {
    let listing = match fs::read_dir(folder) {
        Ok(listing) => listing,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(io_error("list", folder)(error)),
    };
    let mut entries = Vec::new();
    for entry in listing {
        entries.push(entry.map_err(io_error("list", folder))?.path());
    }
    entries.sort();
    Ok(entries)
}

/// Names of all calls below a role's folder, in order: the folders that hold `marker`.
pub(crate) fn names_under(role_folder: &Path, marker: &str) -> Result<Vec<CallName>, BookError> {
    fn walk(folder: &Path, name: &str, marker: &str, names: &mut Vec<CallName>) -> Result<(), BookError> {
        if !name.is_empty() && folder.join(marker).is_file() {
            names.extend(CallName::new(name));
            return Ok(());
        }
        for entry in sorted_entries(folder)? {
            let Some(part) = entry.file_name().and_then(|n| n.to_str()) else { continue };
            let inner = if name.is_empty() { part.to_owned() } else { format!("{name}/{part}") };
            // A name that would not be accepted can't hold a call; this bounds the depth too. Links are not followed.
            let is_folder = fs::symlink_metadata(&entry).is_ok_and(|m| m.is_dir());
            if is_folder && CallName::new(&inner).is_ok() {
                walk(&entry, &inner, marker, names)?;
            }
        }
        Ok(())
    }
    let mut names = Vec::new();
    walk(role_folder, "", marker, &mut names)?;
    Ok(names)
}
