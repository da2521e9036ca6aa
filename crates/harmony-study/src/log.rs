//! The append-only log: what was acknowledged is on the disk.
//! Key `study.log`.
//!
//! One thread owns the file. It takes all answers that are waiting, checks each against what is stored, writes the
//! lines in one piece, flushes them to the disk (`fdatasync`), and only then acknowledges them: a group commit, so
//! that a thousand answers a second need far fewer flushes. A killed program leaves at most an unfinished last line,
//! which nobody was told of; it is cut off at the next start.
//!
//! A line is JSON and ends in a chain value: the first 8 bytes of the SHA-256 of the chain value before it and the line
//! itself. A line that was changed, lost or moved shows at the next reading.
//!
//! Limits: one writer at a time (the file is locked); the file grows to [`LogLimits::bytes`] at most.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use harmony_io::FileError;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use tokio::sync::{mpsc, oneshot};

use crate::private::{PrivateStudy, hex};
use crate::record::{Answer, Refusal};
use crate::{FORMAT, StudyError};

/// Answers that wait for the writer at most.
const QUEUE: usize = 4096;
/// Answers that are written in one piece at most.
const BATCH: usize = 1024;
/// Length of `,"chain":"0123456789abcdef"}`.
const CHAIN_LENGTH: usize = 28;
/// Chain value before the first line.
const CHAIN_START: &str = "0000000000000000";

/// How an answer came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Via {
    /// From the page.
    Server,
    /// From a file with an invitation's key.
    File,
    /// From a file that nobody signed.
    UnsignedFile,
}

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Entry {
    /// The first line: whose log it is.
    Study {
        /// Format.
        format: u32,
        /// The study's name.
        study: String,
        /// Version of its site.
        version: String,
    },
    /// An answer.
    Answer {
        /// What was answered.
        answer: Answer,
        /// How it came.
        via: Via,
    },
    /// A participant has handed in.
    Finish {
        /// Their code.
        participant: String,
    },
}

/// How large a log may become.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogLimits {
    /// Bytes of the file.
    pub bytes: u64,
    /// Participants.
    pub participants: usize,
}

impl Default for LogLimits {
    fn default() -> Self {
        Self { bytes: 4 << 30, participants: 100_000 }
    }
}

/// Why an entry was not stored.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotStored {
    /// It is refused.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The log has reached its size.
    #[error("the log is full")]
    Full,
    /// The disk did not take it.
    #[error("the log cannot be written: {0}")]
    Disk(String),
    /// The writer has ended.
    #[error("the log is closed")]
    Closed,
}

/// That an entry is on the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stored {
    /// Now.
    New,
    /// It was already.
    Before,
}

/// What the log has of a participant.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Seen {
    /// Latest answer to each trial.
    pub answers: BTreeMap<String, SeenAnswer>,
    /// Whether they have handed in.
    pub finished: bool,
}

/// A stored answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeenAnswer {
    /// Its revision.
    pub revision: u32,
    /// Its ranks by letter.
    pub ranks: Vec<u8>,
}

enum Job {
    Append(Box<Entry>, oneshot::Sender<Result<Stored, NotStored>>),
    Look(String, oneshot::Sender<Seen>),
    Count(oneshot::Sender<(usize, usize)>),
}

/// A log that is being written. Clones share it; the file is closed with the last.
#[derive(Debug, Clone)]
pub struct Log {
    jobs: mpsc::Sender<Job>,
    writer: Arc<JoinHandle<()>>,
}

impl Log {
    /// Opens a study's log, making it when there is none. Every stored line is read and checked.
    ///
    /// # Errors
    /// A damaged log, one of another study, one that another program writes.
    pub fn open(path: &Path, study: &PrivateStudy, limits: LogLimits) -> Result<Self, StudyError> {
        let fail = |source| StudyError::File(FileError::Write { path: path.to_owned(), source });
        if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(parent).map_err(fail)?;
        }
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(fail)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(StudyError::LogInUse(path.to_owned())),
            Err(TryLockError::Error(source)) => return Err(fail(source)),
        }
        let mut text = Vec::new();
        file.read_to_end(&mut text).map_err(fail)?;
        let whole = text.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
        let (entries, chain) = parse(path, &text[..whole])?;
        belongs(path, &entries, study)?;
        let mut index = Index { limits, ..Index::default() };
        for entry in &entries {
            index.note(entry);
        }
        // An unfinished line was acknowledged to nobody.
        file.set_len(whole as u64).map_err(fail)?;
        file.seek(SeekFrom::End(0)).map_err(fail)?;
        let mut open = OpenLog { file, length: whole as u64, chain, index, broken: None };
        if whole == 0 {
            let first = Entry::Study { format: FORMAT, study: study.study.clone(), version: study.version.clone() };
            open.write(&[first]).map_err(fail)?;
            // The file's own name must be on the disk, too.
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            File::open(folder).and_then(|f| f.sync_all()).map_err(fail)?;
        }
        let (jobs, queue) = mpsc::channel(QUEUE);
        let writer =
            std::thread::Builder::new().name("study-log".to_owned()).spawn(move || open.run(queue)).map_err(fail)?;
        Ok(Self { jobs, writer: Arc::new(writer) })
    }

    /// Stores an entry; when this returns it is on the disk.
    ///
    /// # Errors
    /// [`NotStored`].
    pub async fn append(&self, entry: Entry) -> Result<Stored, NotStored> {
        let (reply, answer) = oneshot::channel();
        self.jobs.send(Job::Append(Box::new(entry), reply)).await.map_err(|_| NotStored::Closed)?;
        answer.await.map_err(|_| NotStored::Closed)?
    }

    /// As [`Log::append`], outside of an asynchronous program.
    ///
    /// # Errors
    /// [`NotStored`].
    pub fn append_blocking(&self, entry: Entry) -> Result<Stored, NotStored> {
        let (reply, answer) = oneshot::channel();
        self.jobs.blocking_send(Job::Append(Box::new(entry), reply)).map_err(|_| NotStored::Closed)?;
        answer.blocking_recv().map_err(|_| NotStored::Closed)?
    }

    /// Waits until the file is closed, if this is the last that uses it.
    pub fn close(self) {
        let Self { jobs, writer } = self;
        drop(jobs);
        if let Ok(writer) = Arc::try_unwrap(writer) {
            let _ = writer.join();
        }
    }

    /// What is stored of a participant.
    pub async fn seen(&self, participant: &str) -> Option<Seen> {
        let (reply, answer) = oneshot::channel();
        self.jobs.send(Job::Look(participant.to_owned(), reply)).await.ok()?;
        answer.await.ok()
    }

    /// Participants and answers so far.
    pub async fn counts(&self) -> Option<(usize, usize)> {
        let (reply, answer) = oneshot::channel();
        self.jobs.send(Job::Count(reply)).await.ok()?;
        answer.await.ok()
    }
}

/// What is stored, without the file.
#[derive(Debug, Default)]
struct Index {
    seen: BTreeMap<String, Seen>,
    digests: BTreeMap<(String, String), [u8; 32]>,
    finished: BTreeSet<String>,
    answers: usize,
    limits: LogLimits,
}

fn digest(answer: &Answer) -> [u8; 32] {
    let text = serde_json::to_vec(answer).unwrap_or_default();
    Sha256::digest(text).into()
}

impl Index {
    /// Whether an entry may be stored; `Some(Stored::Before)` when it is already.
    fn judge(&self, entry: &Entry) -> Result<Option<Stored>, Refusal> {
        match entry {
            Entry::Study { .. } => Err(Refusal::OtherStudy),
            Entry::Finish { participant } => {
                if self.finished.contains(participant) {
                    return Ok(Some(Stored::Before));
                }
                self.room(participant)?;
                Ok(None)
            }
            Entry::Answer { answer, .. } => {
                let stored = self.seen.get(&answer.participant).and_then(|s| s.answers.get(&answer.trial));
                let key = (answer.participant.clone(), answer.trial.clone());
                if let Some(stored) = stored {
                    if stored.revision == answer.revision && self.digests.get(&key) == Some(&digest(answer)) {
                        return Ok(Some(Stored::Before));
                    }
                    if answer.revision <= stored.revision {
                        return Err(Refusal::Doubled);
                    }
                }
                if self.finished.contains(&answer.participant) {
                    return Err(Refusal::Closed);
                }
                self.room(&answer.participant)?;
                Ok(None)
            }
        }
    }

    fn room(&self, participant: &str) -> Result<(), Refusal> {
        let known = self.seen.contains_key(participant);
        if known || self.seen.len() < self.limits.participants { Ok(()) } else { Err(Refusal::Full) }
    }

    fn note(&mut self, entry: &Entry) {
        match entry {
            Entry::Study { .. } => {}
            Entry::Finish { participant } => {
                self.finished.insert(participant.clone());
                self.seen.entry(participant.clone()).or_default().finished = true;
            }
            Entry::Answer { answer, .. } => {
                self.answers += 1;
                self.digests.insert((answer.participant.clone(), answer.trial.clone()), digest(answer));
                let seen = SeenAnswer { revision: answer.revision, ranks: answer.ranks.clone() };
                self.seen.entry(answer.participant.clone()).or_default().answers.insert(answer.trial.clone(), seen);
            }
        }
    }
}

/// The file and what is in it.
struct OpenLog {
    file: File,
    length: u64,
    chain: String,
    index: Index,
    broken: Option<String>,
}

impl OpenLog {
    fn run(mut self, mut queue: mpsc::Receiver<Job>) {
        while let Some(first) = queue.blocking_recv() {
            let mut jobs = vec![first];
            while jobs.len() < BATCH
                && let Ok(job) = queue.try_recv()
            {
                jobs.push(job);
            }
            self.serve(jobs);
        }
    }

    /// Stores what may be stored of a batch, flushes, and answers all.
    fn serve(&mut self, jobs: Vec<Job>) {
        let mut entries = Vec::new();
        let mut waiting = Vec::new();
        for job in jobs {
            match job {
                Job::Look(participant, reply) => {
                    // Only what is on the disk: entries of this batch are not noted yet.
                    let _ = reply.send(self.index.seen.get(&participant).cloned().unwrap_or_default());
                }
                Job::Count(reply) => {
                    let _ = reply.send((self.index.seen.len(), self.index.answers));
                }
                Job::Append(entry, reply) => {
                    // An entry may depend on one before it in the same batch: that one is flushed first.
                    if touches(&entries, &entry) {
                        self.commit(&mut entries, &mut waiting);
                    }
                    let verdict = match &self.broken {
                        Some(why) => Err(NotStored::Disk(why.clone())),
                        None if self.length >= self.index.limits.bytes => Err(NotStored::Full),
                        None => self.index.judge(&entry).map_err(NotStored::from),
                    };
                    match verdict {
                        Ok(None) => {
                            entries.push(*entry);
                            waiting.push(reply);
                        }
                        Ok(Some(stored)) => drop(reply.send(Ok(stored))),
                        Err(error) => drop(reply.send(Err(error))),
                    }
                }
            }
        }
        self.commit(&mut entries, &mut waiting);
    }

    fn commit(&mut self, entries: &mut Vec<Entry>, waiting: &mut Vec<oneshot::Sender<Result<Stored, NotStored>>>) {
        if entries.is_empty() {
            return;
        }
        let outcome = match self.write(entries) {
            Ok(()) => {
                for entry in &*entries {
                    self.index.note(entry);
                }
                Ok(Stored::New)
            }
            Err(error) => Err(NotStored::Disk(error.to_string())),
        };
        entries.clear();
        for reply in waiting.drain(..) {
            let _ = reply.send(outcome.clone());
        }
    }

    /// Writes lines in one piece and flushes them; a failure leaves the file as long as it was.
    fn write(&mut self, entries: &[Entry]) -> io::Result<()> {
        let mut text = Vec::new();
        let mut chain = self.chain.clone();
        for entry in entries {
            let body = serde_json::to_string(entry)?;
            chain = link(&chain, &body);
            text.extend_from_slice(&body.as_bytes()[..body.len() - 1]);
            text.extend_from_slice(format!(",\"chain\":\"{chain}\"}}\n").as_bytes());
        }
        let written = self.file.write_all(&text).and_then(|()| self.file.sync_data());
        if let Err(error) = written {
            // Without knowing what reached the disk nothing more may be promised.
            let back = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::End(0)));
            if back.and_then(|_| self.file.sync_data()).is_err() {
                self.broken = Some(error.to_string());
            }
            return Err(error);
        }
        self.length += text.len() as u64;
        self.chain = chain;
        Ok(())
    }
}

/// Whether one of the entries is of the same participant.
fn touches(entries: &[Entry], entry: &Entry) -> bool {
    let of = |e: &Entry| match e {
        Entry::Answer { answer, .. } => Some((answer.participant.clone(), Some(answer.trial.clone()))),
        Entry::Finish { participant } => Some((participant.clone(), None)),
        Entry::Study { .. } => None,
    };
    let Some((participant, trial)) = of(entry) else { return false };
    entries.iter().filter_map(of).any(|(p, t)| p == participant && (t.is_none() || trial.is_none() || t == trial))
}

fn link(before: &str, body: &str) -> String {
    let hash = Sha256::new().chain_update(before.as_bytes()).chain_update(body.as_bytes()).finalize();
    hex(&hash[..8])
}

/// Reads a study's log; an unfinished last line is left out.
///
/// # Errors
/// An unreadable or damaged log, or one of another study.
pub fn read(path: &Path, study: &PrivateStudy) -> Result<Vec<Entry>, StudyError> {
    let text = harmony_io::read_bounded(path, LogLimits::default().bytes)?;
    let whole = text.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
    let (entries, _) = parse(path, &text[..whole])?;
    belongs(path, &entries, study)?;
    Ok(entries)
}

fn parse(path: &Path, text: &[u8]) -> Result<(Vec<Entry>, String), StudyError> {
    let mut chain = CHAIN_START.to_owned();
    let mut entries = Vec::new();
    for (i, line) in text.split_inclusive(|b| *b == b'\n').enumerate() {
        let damaged = |why| StudyError::Log { path: PathBuf::from(path), line: i + 1, why };
        let line = std::str::from_utf8(line).map_err(|_| damaged("no UTF-8"))?.trim_end_matches('\n');
        let cut = line.len().checked_sub(CHAIN_LENGTH).filter(|c| line.is_char_boundary(*c));
        let (body, tail) = line.split_at(cut.ok_or_else(|| damaged("too short"))?);
        let body = format!("{body}}}");
        chain = link(&chain, &body);
        if tail != format!(",\"chain\":\"{chain}\"}}") {
            return Err(damaged("it does not follow from the line before"));
        }
        entries.push(serde_json::from_str(&body).map_err(|_| damaged("no entry of a log"))?);
    }
    Ok((entries, chain))
}

/// The first line must name the study.
fn belongs(path: &Path, entries: &[Entry], study: &PrivateStudy) -> Result<(), StudyError> {
    match entries.first() {
        None => Ok(()),
        Some(Entry::Study { format, .. }) if *format != FORMAT => {
            Err(StudyError::Format { path: path.to_owned(), found: *format, known: FORMAT })
        }
        Some(Entry::Study { study: name, version, .. }) if *name == study.study && *version == study.version => Ok(()),
        Some(Entry::Study { study: name, version, .. }) => Err(StudyError::OtherStudy {
            path: path.to_owned(),
            found: format!("{name} (version {version})"),
            wanted: format!("{} (version {})", study.study, study.version),
        }),
        Some(_) => Err(StudyError::Log { path: path.to_owned(), line: 1, why: "it does not name the study" }),
    }
}
