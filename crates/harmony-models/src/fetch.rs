//! Fetching a model: resume, checksum, rename.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use reqwest::header::{CONTENT_RANGE, ETAG, HeaderMap, IF_RANGE, RANGE};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::ModelError;
use crate::hub::{Answer, Hub, Linked, causes};
use crate::ledger::Checksum;
use crate::store::{FileState, Lock, Store, Verified, hash_into, hex, key, part};
use crate::table::{Model, ModelFile, Source};

/// What happens while a model is fetched.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Event {
    /// It was here and right.
    Already {
        /// `model/file`.
        name: String,
    },
    /// Bytes have come.
    Bytes {
        /// `model/file`.
        name: String,
        /// Bytes that are here.
        have: u64,
        /// Bytes of the whole, where known.
        total: Option<u64>,
    },
    /// What came before cannot be gone on with.
    Anew {
        /// `model/file`.
        name: String,
        /// Why.
        reason: String,
    },
    /// A try failed; the next one comes after a while.
    Again {
        /// `model/file`.
        name: String,
        /// Why.
        reason: String,
        /// The while.
        wait: Duration,
    },
    /// It is here and right.
    Done {
        /// `model/file`.
        name: String,
        /// Where, and what is known of it.
        path: PathBuf,
        /// Its checksum and whether that was known before.
        verified: Verified,
    },
}

/// What is remembered of a file that is not whole.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Begun {
    /// Path at the source and revision: another one is another file.
    what: String,
    /// The server's mark of this very content.
    etag: Option<String>,
    total: Option<u64>,
}

/// A file that is coming.
struct Coming<'a> {
    name: String,
    file: &'a ModelFile,
    commit: Option<String>,
    part: PathBuf,
    out: File,
    hasher: Sha256,
    have: u64,
    begun: Begun,
    linked: Linked,
    /// Bytes that came in this process, to tell progress from standing still.
    fresh: u64,
    /// Whether the beginning is from an earlier answer.
    resumed: bool,
}

impl Hub {
    /// Fetches what is missing of a model into a store; what is there is checked first. The licence must have been
    /// accepted.
    ///
    /// # Errors
    /// [`ModelError`]; what came stays and is gone on with the next time, unless it was found wrong.
    pub async fn pull(
        &self,
        store: &Store,
        lock: &Lock,
        model: &Model,
        tell: &(dyn Fn(Event) + Sync),
    ) -> Result<(), ModelError> {
        store.check_licence(model)?;
        for file in model.files {
            let name = key(model, file);
            match store.state(model, file)? {
                FileState::Verified(_) => {
                    tell(Event::Already { name });
                    continue;
                }
                FileState::Unchecked => match store.verify(model, file, &|_| {}) {
                    Ok(_) => {
                        tell(Event::Already { name });
                        continue;
                    }
                    Err(error) => tell(Event::Anew { name, reason: error.to_string() }),
                },
                FileState::WrongSize { wanted, found } => {
                    tell(Event::Anew { name, reason: format!("the file here has {found} bytes, wanted {wanted}") });
                }
                FileState::Missing { .. } => {}
            }
            self.file(store, lock, model, file, tell).await?;
        }
        Ok(())
    }

    async fn file(
        &self,
        store: &Store,
        _lock: &Lock,
        model: &Model,
        file: &ModelFile,
        tell: &(dyn Fn(Event) + Sync),
    ) -> Result<(), ModelError> {
        let path = store.path(model, file);
        store.make_room(model, 0)?;
        let mut coming = Coming::open(store, model, file)?;
        loop {
            self.whole(store, model, &mut coming, tell).await?;
            let found = hex(&std::mem::take(&mut coming.hasher).finalize());
            let place = self.options.endpoints.address(file, coming.commit.as_deref()).to_string();
            match store.judge(model, file, &place, &found, coming.linked.sha256.as_deref()) {
                Ok(()) => {
                    coming.out.sync_all().map_err(ModelError::io(&coming.part))?;
                    std::fs::rename(&coming.part, &path).map_err(ModelError::io(&path))?;
                    let _ = std::fs::remove_file(about(&coming.part));
                    let before = store.known(model, file)?;
                    let checksum = match (file.sha256, &before, &coming.linked.sha256) {
                        (Some(_), _, _) => Checksum::Table,
                        (None, Some(known), _) => known.checksum,
                        (None, None, Some(_)) => Checksum::Hub,
                        (None, None, None) => Checksum::FirstUse,
                    };
                    let first = file.sha256.is_none() && before.is_none();
                    let known = store.record(model, file, found, checksum, coming.revision())?;
                    tell(Event::Done { name: coming.name, path, verified: Verified { known, first } });
                    return Ok(());
                }
                // A beginning of one file and an end of another: once more from the start.
                Err(error) if coming.resumed => {
                    tell(Event::Anew { name: coming.name.clone(), reason: error.to_string() });
                    coming.start_over()?;
                }
                Err(error) => {
                    let _ = std::fs::remove_file(&coming.part);
                    let _ = std::fs::remove_file(about(&coming.part));
                    return Err(error);
                }
            }
        }
    }

    /// Asks until the file is whole.
    async fn whole(
        &self,
        store: &Store,
        model: &Model,
        coming: &mut Coming<'_>,
        tell: &(dyn Fn(Event) + Sync),
    ) -> Result<(), ModelError> {
        let limits = self.options.limits;
        let (mut failed, mut wait) = (0, limits.first_wait);
        loop {
            let before = coming.fresh;
            let error = match self.once(store, model, coming, tell).await {
                Ok(()) => return Ok(()),
                Err(error) => error,
            };
            if coming.fresh > before {
                (failed, wait) = (0, limits.first_wait);
            }
            failed += 1;
            if !error.is_passing() || failed >= limits.tries.max(1) {
                return Err(error);
            }
            let asked = match &error {
                ModelError::Answer { after: Some(seconds), .. } => Duration::from_secs(*seconds),
                _ => Duration::ZERO,
            };
            let pause = wait.max(asked).min(limits.longest_wait);
            tell(Event::Again { name: coming.name.clone(), reason: error.to_string(), wait: pause });
            tokio::time::sleep(pause).await;
            wait = wait.saturating_mul(2).min(limits.longest_wait);
        }
    }

    /// One request and what comes of it.
    async fn once(
        &self,
        store: &Store,
        model: &Model,
        coming: &mut Coming<'_>,
        tell: &(dyn Fn(Event) + Sync),
    ) -> Result<(), ModelError> {
        let file = coming.file;
        let mut range = Vec::new();
        if coming.have > 0 {
            if coming.begun.etag.is_none() && file.sha256.is_none() {
                // Nobody could tell whether the rest belongs to the beginning.
                coming.anew("the server had given it no mark", tell)?;
            } else {
                range.push((RANGE.as_str(), format!("bytes={}-", coming.have)));
                range.extend(coming.begun.etag.clone().map(|etag| (IF_RANGE.as_str(), etag)));
            }
        }
        let answer = self.get(&coming.name, file, coming.commit.as_deref(), &range).await;
        let Answer { mut response, linked, place } = answer.map_err(|e| coming.counted(e))?;
        // The hub tells the checksum and the commit on its own page; what was pinned holds against it.
        if let (Some(wanted), Some(found)) = (file.sha256, &linked.sha256)
            && wanted != found
        {
            let (name, wanted, found) = (coming.name.clone(), wanted.to_owned(), found.clone());
            return Err(ModelError::WrongChecksum { name, wanted, found, place });
        }
        coming.linked = linked;
        let (start, total) = match response.status().as_u16() {
            206 => content_range(response.headers()).map_or((u64::MAX, None), |(start, total)| (start, total)),
            416 => {
                // Perhaps all of it is here; then its checksum will say so.
                let total = content_range(response.headers()).and_then(|(_, total)| total);
                if total == Some(coming.have) && coming.have > 0 {
                    return Ok(());
                }
                coming.anew("the server has no such part of it", tell)?;
                return Err(coming.broken("it has to be asked for from the start", &place));
            }
            _ => (0, response.content_length().or(coming.linked.size)),
        };
        let etag = strong_etag(response.headers());
        if coming.have > 0 {
            let changed = coming.begun.etag.is_some() && etag.is_some() && etag != coming.begun.etag;
            let other_size = coming.begun.total.is_some() && total.is_some() && coming.begun.total != total;
            if start == 0 {
                let reason =
                    if changed { "the file has changed at the server" } else { "the server sends only whole files" };
                coming.anew(reason, tell)?;
            } else if start != coming.have || changed || other_size {
                coming.anew("the server sent a part that does not fit", tell)?;
                return Err(coming.broken("it has to be asked for from the start", &place));
            }
        } else if start != 0 {
            return Err(coming.broken("the server sent a part from the middle", &place));
        }
        if let (Some(wanted), Some(found)) = (file.size, total)
            && wanted != found
        {
            return Err(ModelError::WrongSize { name: coming.name.clone(), wanted, found, place });
        }
        let total = total.or(file.size);
        coming.begin(etag, total)?;
        store.make_room(model, total.unwrap_or(0).saturating_sub(coming.have))?;
        loop {
            let chunk = tokio::time::timeout(self.options.limits.silence, response.chunk()).await;
            let chunk = match chunk {
                Err(_) => {
                    return Err(coming.broken(&format!("nothing came for {:?}", self.options.limits.silence), &place));
                }
                Ok(Err(error)) => {
                    let why = format!("the connection broke ({})", causes(&error.without_url()));
                    return Err(coming.broken(&why, &place));
                }
                Ok(Ok(chunk)) => chunk,
            };
            let Some(chunk) = chunk else { break };
            coming.take(&chunk)?;
            if total.is_some_and(|total| coming.have > total) {
                let (name, found) = (coming.name.clone(), coming.have);
                coming.start_over()?;
                return Err(ModelError::WrongSize { name, wanted: total.unwrap_or(0), found, place });
            }
            tell(Event::Bytes { name: coming.name.clone(), have: coming.have, total });
        }
        if total.is_some_and(|total| coming.have < total) {
            return Err(coming.broken("the connection ended early", &place));
        }
        Ok(())
    }
}

impl<'a> Coming<'a> {
    /// Goes on with what is there, if it is the beginning of the same file.
    fn open(store: &Store, model: &Model, file: &'a ModelFile) -> Result<Self, ModelError> {
        let part = part(&store.path(model, file));
        // Files of one model belong together: where the table knows no commit, that of the first one holds for all.
        let mut commit = None;
        for other in model.files {
            commit = commit.or(store.known(model, other)?.and_then(|k| k.revision));
        }
        let what = format!("{} {} {}", file.path, origin(file), commit.as_deref().unwrap_or("-"));
        let before: Option<Begun> =
            std::fs::read(about(&part)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let before = before.filter(|b: &Begun| b.what == what);
        let out = File::options().create(true).truncate(before.is_none()).write(true).open(&part);
        let mut out = out.map_err(ModelError::io(&part))?;
        let mut hasher = Sha256::new();
        let mut have = out.seek(SeekFrom::End(0)).map_err(ModelError::io(&part))?;
        let begun = before.unwrap_or(Begun { what, etag: None, total: None });
        if begun.total.is_some_and(|total| have > total) {
            out.set_len(0).map_err(ModelError::io(&part))?;
            have = out.seek(SeekFrom::Start(0)).map_err(ModelError::io(&part))?;
        }
        if have > 0 {
            hash_into(&mut hasher, &part)?;
        }
        let name = key(model, file);
        Ok(Self {
            name,
            file,
            commit,
            part,
            out,
            hasher,
            have,
            begun,
            linked: Linked::default(),
            fresh: 0,
            resumed: have > 0,
        })
    }

    fn begin(&mut self, etag: Option<String>, total: Option<u64>) -> Result<(), ModelError> {
        self.resumed |= self.have > 0;
        let begun = Begun { what: self.begun.what.clone(), etag: etag.or(self.begun.etag.take()), total };
        let path = about(&self.part);
        std::fs::write(&path, serde_json::to_vec(&begun).unwrap_or_default()).map_err(ModelError::io(&path))?;
        self.begun = begun;
        Ok(())
    }

    fn take(&mut self, bytes: &[u8]) -> Result<(), ModelError> {
        self.out.write_all(bytes).map_err(ModelError::io(&self.part))?;
        self.hasher.update(bytes);
        self.have += bytes.len() as u64;
        self.fresh += bytes.len() as u64;
        Ok(())
    }

    fn start_over(&mut self) -> Result<(), ModelError> {
        self.out.set_len(0).map_err(ModelError::io(&self.part))?;
        self.out.seek(SeekFrom::Start(0)).map_err(ModelError::io(&self.part))?;
        (self.hasher, self.have, self.resumed) = (Sha256::new(), 0, false);
        (self.begun.etag, self.begun.total) = (None, None);
        Ok(())
    }

    fn anew(&mut self, reason: &str, tell: &(dyn Fn(Event) + Sync)) -> Result<(), ModelError> {
        tell(Event::Anew { name: self.name.clone(), reason: reason.to_owned() });
        self.start_over()
    }

    fn broken(&self, reason: &str, place: &str) -> ModelError {
        let (name, place) = (self.name.clone(), place.to_owned());
        ModelError::Broken { name, reason: reason.to_owned(), have: self.have, total: self.begun.total, place }
    }

    /// The error of a request, with what is here already.
    fn counted(&self, error: ModelError) -> ModelError {
        match error {
            ModelError::Broken { reason, place, .. } => self.broken(&reason, &place),
            other => other,
        }
    }

    /// The commit that the file is of.
    fn revision(&self) -> Option<String> {
        match self.file.source {
            Source::Hub { revision, .. } => {
                revision.map(str::to_owned).or_else(|| self.commit.clone()).or_else(|| self.linked.commit.clone())
            }
            Source::Code { commit, .. } => Some(commit.to_owned()),
            Source::Torch => None,
        }
    }
}

fn origin(file: &ModelFile) -> String {
    match file.source {
        Source::Hub { repo, revision } => format!("{repo}@{}", revision.unwrap_or("main")),
        Source::Torch => "torch".to_owned(),
        Source::Code { repo, commit } => format!("{repo}@{commit}"),
    }
}

fn about(part: &Path) -> PathBuf {
    let mut name = part.as_os_str().to_owned();
    name.push(".json");
    name.into()
}

/// A mark that stands for the very bytes; a weak one (`W/`) does not.
fn strong_etag(headers: &HeaderMap) -> Option<String> {
    let tag = headers.get(ETAG)?.to_str().ok()?;
    (tag.starts_with('"') && tag.len() > 2).then(|| tag.to_owned())
}

/// `bytes 5-9/10`: where the part begins and how long the whole is; `bytes */10` begins nowhere.
fn content_range(headers: &HeaderMap) -> Option<(u64, Option<u64>)> {
    let text = headers.get(CONTENT_RANGE)?.to_str().ok()?.strip_prefix("bytes ")?;
    let (range, total) = text.split_once('/')?;
    let start = if range == "*" { u64::MAX } else { range.split_once('-')?.0.parse().ok()? };
    Some((start, total.parse().ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_marks_are_read() {
        let headers = |key: reqwest::header::HeaderName, value: &str| {
            let mut map = HeaderMap::new();
            map.insert(key, value.parse().unwrap());
            map
        };
        let range = |text: &str| content_range(&headers(CONTENT_RANGE, text));
        assert_eq!(range("bytes 5-9/10"), Some((5, Some(10))));
        assert_eq!(range("bytes 5-9/*"), Some((5, None)));
        assert_eq!(range("bytes */10"), Some((u64::MAX, Some(10))));
        assert_eq!(range("lines 5-9/10"), None);
        let etag = |text: &str| strong_etag(&headers(ETAG, text));
        assert_eq!(etag("\"abc\""), Some("\"abc\"".to_owned()));
        assert_eq!(etag("W/\"abc\""), None);
    }
}
