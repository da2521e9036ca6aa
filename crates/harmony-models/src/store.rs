//! The folder that holds weights.
//!
//! ```text
//! <models>/<model>/<file>            a weight file
//! <models>/<model>/<file>.part       one that is still coming, with <file>.part.json about it
//! <models>/harmony-models.json       accepted licences, checked files
//! <models>/.lock                     taken while somebody changes the folder
//! ```

use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use sha2::{Digest, Sha256};

use crate::ledger::{Accepted, Checksum, Known, Ledger};
use crate::table::{Licence, Model, ModelFile};
use crate::{ModelError, date};

/// Bytes read at a time.
const BLOCK: usize = 1 << 20;

/// Bytes that stay free on a disk.
const SPARE: u64 = 64 << 20;

/// A folder of models; it need not exist.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    folder: PathBuf,
}

/// What is known of a file without reading it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FileState {
    /// Not there. Bytes of it that came so far.
    Missing {
        /// Bytes in the unfinished file.
        partial: u64,
    },
    /// Another length than it must have.
    WrongSize {
        /// Bytes it must have.
        wanted: u64,
        /// Bytes it has.
        found: u64,
    },
    /// There, with the right length as far as that is known; its content was not looked at since it was changed.
    Unchecked,
    /// There and unchanged since it was found right.
    Verified(Known),
}

/// A file that has just been found right.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verified {
    /// What is written down of it.
    pub known: Known,
    /// Whether its checksum was not known before, and is from now on.
    pub first: bool,
}

/// Keeps others from changing the folder.
#[derive(Debug)]
pub struct Lock(#[expect(dead_code, reason = "held open: the lock goes with it")] File);

impl Store {
    /// The folder at a path.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Its path.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where a file of a model is, or would be.
    pub fn path(&self, model: &Model, file: &ModelFile) -> PathBuf {
        self.folder.join(model.id).join(file.name)
    }

    /// Makes the folder and keeps others from changing it, until the lock is dropped.
    ///
    /// # Errors
    /// [`ModelError::Busy`] when somebody else has it, [`ModelError::Io`].
    pub fn lock(&self) -> Result<Lock, ModelError> {
        std::fs::create_dir_all(&self.folder).map_err(ModelError::io(&self.folder))?;
        let path = self.folder.join(".lock");
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(ModelError::io(&path))?;
        match file.try_lock() {
            Ok(()) => Ok(Lock(file)),
            Err(TryLockError::WouldBlock) => Err(ModelError::Busy { path }),
            Err(TryLockError::Error(error)) => Err(ModelError::io(&path)(error)),
        }
    }

    /// When a licence was accepted in this folder; `None` for one that nobody agreed to yet.
    ///
    /// # Errors
    /// A record that cannot be read.
    pub fn accepted(&self, licence: &Licence) -> Result<Option<Accepted>, ModelError> {
        Ok(Ledger::read(&self.folder)?.accepted.get(licence.id).cloned())
    }

    /// Whether a model may be used as far as its licence goes.
    ///
    /// # Errors
    /// [`ModelError::NotAccepted`].
    pub fn check_licence(&self, model: &Model) -> Result<(), ModelError> {
        if !model.licence.restricted || self.accepted(model.licence)?.is_some() {
            return Ok(());
        }
        Err(ModelError::NotAccepted { model: model.id.to_owned(), licence: model.licence.id.to_owned() })
    }

    /// Writes down that a licence was accepted.
    ///
    /// # Errors
    /// [`ModelError::Io`].
    pub fn accept(&self, _lock: &Lock, licence: &Licence, how: &str) -> Result<(), ModelError> {
        let mut ledger = Ledger::read(&self.folder)?;
        ledger.accepted.entry(licence.id.to_owned()).or_insert_with(|| Accepted::now(how));
        ledger.write(&self.folder)
    }

    /// What is known of a file without reading it.
    ///
    /// # Errors
    /// A record that cannot be read.
    pub fn state(&self, model: &Model, file: &ModelFile) -> Result<FileState, ModelError> {
        let path = self.path(model, file);
        let Ok(about) = std::fs::metadata(&path).map_err(ModelError::io(&path)) else {
            let partial = std::fs::metadata(part(&path)).map_or(0, |m| m.len());
            return Ok(FileState::Missing { partial });
        };
        let known = self.known(model, file)?;
        let wanted = file.size.or(known.as_ref().map(|k| k.size));
        let found = about.len();
        if let Some(wanted) = wanted.filter(|w| *w != found) {
            return Ok(FileState::WrongSize { wanted, found });
        }
        let unchanged =
            |k: &Known| k.size == found && k.modified == modified(&about) && file.sha256.is_none_or(|s| s == k.sha256);
        Ok(known.filter(unchanged).map_or(FileState::Unchecked, FileState::Verified))
    }

    /// Whether all files of a model are there with the right lengths.
    ///
    /// # Errors
    /// A record that cannot be read.
    pub fn has(&self, model: &Model) -> Result<bool, ModelError> {
        for file in model.files {
            if !matches!(self.state(model, file)?, FileState::Unchecked | FileState::Verified(_)) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Reads a file and compares it with what it should be. `progress` hears the bytes read.
    ///
    /// # Errors
    /// [`ModelError::Missing`], [`ModelError::WrongSize`], [`ModelError::WrongChecksum`], [`ModelError::Io`].
    pub fn verify(&self, model: &Model, file: &ModelFile, progress: &dyn Fn(u64)) -> Result<Verified, ModelError> {
        let path = self.path(model, file);
        match self.state(model, file)? {
            FileState::Missing { .. } => return Err(ModelError::Missing { name: name(model, file), path }),
            FileState::WrongSize { wanted, found } => {
                let place = path.display().to_string();
                return Err(ModelError::WrongSize { name: name(model, file), wanted, found, place });
            }
            FileState::Unchecked | FileState::Verified(_) => {}
        }
        let found = hash(&path, progress)?;
        let before = self.known(model, file)?;
        self.judge(model, file, &path.display().to_string(), &found, None)?;
        let first = file.sha256.is_none() && before.is_none();
        let checksum = match (file.sha256, &before) {
            (Some(_), _) => Checksum::Table,
            (None, Some(known)) => known.checksum,
            (None, None) => Checksum::FirstUse,
        };
        let known = self.record(model, file, found, checksum, before.and_then(|k| k.revision))?;
        Ok(Verified { known, first })
    }

    /// Copies a model's files from another folder: from `<from>/<model>/`, `<from>/<hub name>/` or `<from>` itself.
    /// Each is checked on the way; where the table has no checksum, the other folder's own record is believed.
    ///
    /// # Errors
    /// [`ModelError::Missing`] with the places that were looked at, [`ModelError::WrongSize`],
    /// [`ModelError::WrongChecksum`], [`ModelError::NoSpace`], [`ModelError::Io`].
    pub fn import(
        &self,
        _lock: &Lock,
        model: &Model,
        from: &Path,
        progress: &dyn Fn(&ModelFile, u64),
    ) -> Result<Vec<Verified>, ModelError> {
        let theirs = Ledger::read(from)?;
        let mut done = Vec::new();
        for file in model.files {
            // Where the table has no checksum, only a folder that names the model says what a file is.
            let mut places = vec![from.join(model.id).join(file.name), from.join(model.origin()).join(file.name)];
            if file.sha256.is_some() {
                places.push(from.join(file.name));
            }
            let Some(source) = places.iter().find(|p| p.is_file()) else {
                let path = places.into_iter().next().unwrap_or_default();
                return Err(ModelError::Missing { name: name(model, file), path });
            };
            let place = source.display().to_string();
            let length = std::fs::metadata(source).map_err(ModelError::io(source))?.len();
            if let Some(wanted) = file.size.filter(|w| *w != length) {
                return Err(ModelError::WrongSize { name: name(model, file), wanted, found: length, place });
            }
            let target = self.path(model, file);
            let known = theirs.files.get(&key(model, file));
            self.make_room(model, length)?;
            let copy = part(&target);
            let found = copied(source, &copy, &|bytes| progress(file, bytes))?;
            let right = self.judge(model, file, &place, &found, known.map(|k| k.sha256.as_str()));
            if let Err(error) = right {
                let _ = std::fs::remove_file(&copy);
                return Err(error);
            }
            std::fs::rename(&copy, &target).map_err(ModelError::io(&target))?;
            let checksum = match (file.sha256, known) {
                (Some(_), _) => Checksum::Table,
                (None, Some(known)) => known.checksum,
                (None, None) => Checksum::FirstUse,
            };
            let revision = known.and_then(|k| k.revision.clone());
            let first = file.sha256.is_none() && self.known(model, file)?.is_none();
            done.push(Verified { known: self.record(model, file, found, checksum, revision)?, first });
        }
        Ok(done)
    }

    /// What is written down of a file.
    ///
    /// # Errors
    /// A record that cannot be read.
    pub fn known(&self, model: &Model, file: &ModelFile) -> Result<Option<Known>, ModelError> {
        Ok(Ledger::read(&self.folder)?.files.remove(&key(model, file)))
    }

    /// Whether a checksum is the one that the table, this folder's record or somebody else wants.
    pub(crate) fn judge(
        &self,
        model: &Model,
        file: &ModelFile,
        place: &str,
        found: &str,
        told: Option<&str>,
    ) -> Result<(), ModelError> {
        let known = self.known(model, file)?.map(|k| k.sha256);
        let wanted = file.sha256.or(known.as_deref()).or(told);
        match wanted {
            Some(wanted) if wanted != found => Err(ModelError::WrongChecksum {
                name: name(model, file),
                wanted: wanted.to_owned(),
                found: found.to_owned(),
                place: place.to_owned(),
            }),
            _ => Ok(()),
        }
    }

    /// Writes down that a file is right.
    pub(crate) fn record(
        &self,
        model: &Model,
        file: &ModelFile,
        sha256: String,
        checksum: Checksum,
        revision: Option<String>,
    ) -> Result<Known, ModelError> {
        let path = self.path(model, file);
        let about = std::fs::metadata(&path).map_err(ModelError::io(&path))?;
        let known =
            Known { sha256, checksum, size: about.len(), modified: modified(&about), revision, checked: date::now() };
        let mut ledger = Ledger::read(&self.folder)?;
        ledger.files.insert(key(model, file), known.clone());
        // A folder that cannot be written to is used all the same; its files are checked each time.
        match ledger.write(&self.folder) {
            Err(ModelError::Io { source, .. }) if is_read_only(&source) => Ok(known),
            other => other.map(|()| known),
        }
    }

    /// Makes a model's folder and looks whether so many bytes have room on its disk.
    pub(crate) fn make_room(&self, model: &Model, bytes: u64) -> Result<(), ModelError> {
        let folder = self.folder.join(model.id);
        std::fs::create_dir_all(&folder).map_err(ModelError::io(&folder))?;
        let about = rustix::fs::statvfs(&folder).map_err(|e| ModelError::io(&folder)(e.into()))?;
        let free = about.f_bavail.saturating_mul(about.f_frsize);
        let needed = bytes.saturating_add(SPARE);
        if free < needed { Err(ModelError::NoSpace { path: folder, needed, free }) } else { Ok(()) }
    }
}

fn is_read_only(error: &std::io::Error) -> bool {
    matches!(error.kind(), std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem)
}

/// `model/file`, as the record has it and people read it.
pub(crate) fn key(model: &Model, file: &ModelFile) -> String {
    format!("{}/{}", model.id, file.name)
}

pub(crate) fn name(model: &Model, file: &ModelFile) -> String {
    key(model, file)
}

/// Where a file is while it comes.
pub(crate) fn part(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

fn modified(about: &std::fs::Metadata) -> u64 {
    let since = about.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    since.and_then(|d| u64::try_from(d.as_nanos()).ok()).unwrap_or(0)
}

pub(crate) fn hex(digest: &[u8]) -> String {
    use std::fmt::Write as _;
    digest.iter().fold(String::with_capacity(2 * digest.len()), |mut out, byte| {
        let _ = write!(out, "{byte:02x}");
        out
    })
}

/// Hands a file's bytes on, block by block.
fn each_block(
    path: &Path,
    progress: &dyn Fn(u64),
    each: &mut dyn FnMut(&[u8]) -> Result<(), ModelError>,
) -> Result<(), ModelError> {
    let mut file = File::open(path).map_err(ModelError::io(path))?;
    let (mut block, mut done) = (vec![0; BLOCK], 0);
    loop {
        let n = file.read(&mut block).map_err(ModelError::io(path))?;
        if n == 0 {
            return Ok(());
        }
        each(&block[..n])?;
        done += n as u64;
        progress(done);
    }
}

/// Hashes what there is of a file into `hasher`.
pub(crate) fn hash_into(hasher: &mut Sha256, path: &Path) -> Result<(), ModelError> {
    each_block(path, &|_| {}, &mut |block| {
        hasher.update(block);
        Ok(())
    })
}

fn hash(path: &Path, progress: &dyn Fn(u64)) -> Result<String, ModelError> {
    let mut hasher = Sha256::new();
    each_block(path, progress, &mut |block| {
        hasher.update(block);
        Ok(())
    })?;
    Ok(hex(&hasher.finalize()))
}

fn copied(from: &Path, to: &Path, progress: &dyn Fn(u64)) -> Result<String, ModelError> {
    let mut hasher = Sha256::new();
    let mut file = File::create(to).map_err(ModelError::io(to))?;
    each_block(from, progress, &mut |block| {
        hasher.update(block);
        file.write_all(block).map_err(ModelError::io(to))
    })?;
    file.sync_all().map_err(ModelError::io(to))?;
    Ok(hex(&hasher.finalize()))
}
