//! What was asked of the studio, what it answered, and what a real service would have charged.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use crate::faults::{Fault, Part};

/// One request to a service.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Entry {
    /// Service.
    pub service: &'static str,
    /// Part.
    pub part: Part,
    /// Hash of path and body: the same work asked again has the same.
    pub fingerprint: String,
    /// Status.
    pub status: u16,
    /// What went wrong on purpose.
    pub fault: Option<Fault>,
    /// Input and output tokens.
    pub tokens: (u64, u64),
    /// It holds a usable answer to paid work.
    pub usable: bool,
    /// Whether it went out whole; `None` = it is on its way.
    pub whole: Option<bool>,
}

impl Entry {
    /// Whether the other side has got what it asked for: asking the same again would be paying twice.
    pub fn is_paid(&self) -> bool {
        self.usable && self.whole == Some(true)
    }
}

/// All requests since the start.
#[derive(Debug, Default)]
pub struct Ledger {
    entries: Mutex<Vec<Entry>>,
    seen: Mutex<HashMap<String, usize>>,
    /// Tasks that were made at hosted mesh generators.
    pub tasks: AtomicU64,
    /// Of these, those that were cancelled.
    pub cancelled: AtomicU64,
}

impl Ledger {
    fn lock(&self) -> MutexGuard<'_, Vec<Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How often a fingerprint came before, and counts it.
    pub fn seen(&self, fingerprint: &str) -> usize {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let count = seen.entry(fingerprint.to_owned()).or_default();
        *count += 1;
        *count - 1
    }

    /// Adds an entry; its number.
    pub fn add(&self, entry: Entry) -> u64 {
        let mut entries = self.lock();
        entries.push(entry);
        entries.len() as u64
    }

    /// An answer went out, whole or not. Number 0 is no entry.
    pub fn sent(&self, number: u64, whole: bool) {
        if let Some(entry) =
            (number as usize).checked_sub(1).and_then(|i| self.lock().get_mut(i).map(|e| e.whole = Some(whole)))
        {
            let () = entry;
        }
    }

    /// All entries so far.
    pub fn entries(&self) -> Vec<Entry> {
        self.lock().clone()
    }

    /// Work that was paid more than once: fingerprint and how often.
    pub fn paid_twice(&self) -> Vec<(String, usize)> {
        let mut paid: BTreeMap<String, usize> = BTreeMap::new();
        for entry in self.lock().iter().filter(|entry| entry.is_paid()) {
            *paid.entry(format!("{} {}", entry.service, entry.fingerprint)).or_default() += 1;
        }
        paid.into_iter().filter(|(_, count)| *count > 1).collect()
    }

    /// Tokens of all paid answers, input and output.
    pub fn paid_tokens(&self) -> (u64, u64) {
        let entries = self.lock();
        let paid = entries.iter().filter(|entry| entry.is_paid());
        paid.fold((0, 0), |sum, entry| (sum.0 + entry.tokens.0, sum.1 + entry.tokens.1))
    }
}
