//! An answer as the page sends it, and what makes it valid.

use serde::{Deserialize, Serialize};

use crate::private::PrivateStudy;
use crate::shuffle::panel_order;

/// Largest answer that is taken, bytes.
pub const MAX_ANSWER_BYTES: usize = 8 << 10;
/// Times that one trial may be answered anew.
pub const MAX_REVISIONS: u32 = 50;
/// Longest time of a trial that is believed, milliseconds (a week: a page may stay open).
const MAX_MS: u64 = 7 * 24 * 3600 * 1000;

/// How the page showed the panels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LayoutShown {
    /// Photo above a grid of panels.
    #[default]
    Grid,
    /// One column, as on a phone.
    Column,
}

/// One answer to one trial. Nothing in it tells who answered but the code.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answer {
    /// The study's name.
    pub study: String,
    /// The site's version: another one has other pictures.
    pub version: String,
    /// The participant's code.
    pub participant: String,
    /// The trial's opaque name.
    pub trial: String,
    /// 1 for the first answer, 2 for the first change of it, ...
    pub revision: u32,
    /// Opaque names of the panels in the order of the letters.
    pub order: Vec<String>,
    /// Ranks in the order of the letters, 1 = best.
    pub ranks: Vec<u8>,
    /// Time with the page in view and the person at it, milliseconds.
    pub active_ms: u64,
    /// Time from the first look at the trial to its last change, milliseconds.
    pub total_ms: u64,
    /// Clicks that set or moved a rank.
    pub changes: u32,
    /// Times that the zoom was changed.
    pub zooms: u32,
    /// Times that another view or the photo in place of a panel was looked at.
    pub views: u32,
    /// How the panels were shown.
    pub layout: LayoutShown,
}

/// Why an answer is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Not JSON, or not an answer.
    #[error("this is no answer: {0}")]
    Malformed(String),
    /// Of another study, or of another version of its site.
    #[error("this answer belongs to another study, or to an older version of its page")]
    OtherStudy,
    /// A code of characters that no code has.
    #[error("participants' codes have 4 to 32 characters, a to z, 0 to 9 and -")]
    Participant,
    /// A trial that the study does not have.
    #[error("the study has no such trial")]
    Trial,
    /// The signature does not fit participant and trial.
    #[error("the signature does not belong to this participant and trial")]
    Forged,
    /// The panels are not in the order that the seed gives.
    #[error("the panels are not in the order that this participant saw")]
    Order,
    /// Not every rank once.
    #[error("every rank from 1 to the number of panels must be given once")]
    Ranks,
    /// A number that cannot be.
    #[error("a count or a time is out of range")]
    Range,
    /// The same revision was stored with another content.
    #[error("this trial has been answered already; a change needs the next revision")]
    Doubled,
    /// The participant has handed in.
    #[error("this participant has handed in; answers are closed")]
    Closed,
    /// Too many participants for the log.
    #[error("no more participants are taken")]
    Full,
}

/// Whether a text can be a participant's code.
pub fn is_participant(code: &str) -> bool {
    (4..=32).contains(&code.len()) && code.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}

impl Answer {
    /// Checks everything that can be checked without the log.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check(&self, study: &PrivateStudy) -> Result<(), Refusal> {
        if self.study != study.study || self.version != study.version {
            return Err(Refusal::OtherStudy);
        }
        if !is_participant(&self.participant) {
            return Err(Refusal::Participant);
        }
        let trial = study.trials.iter().find(|t| t.id == self.trial).ok_or(Refusal::Trial)?;
        let count = trial.panels.len();
        let expected = panel_order(&self.study, &self.participant, &self.trial, count);
        if self.order.len() != count || !expected.iter().zip(&self.order).all(|(i, id)| trial.panels[*i].id == *id) {
            return Err(Refusal::Order);
        }
        let mut seen = vec![false; count];
        for rank in &self.ranks {
            match (*rank as usize).checked_sub(1).and_then(|i| seen.get_mut(i)) {
                Some(slot) if !*slot => *slot = true,
                _ => return Err(Refusal::Ranks),
            }
        }
        if self.ranks.len() != count {
            return Err(Refusal::Ranks);
        }
        let counts = [self.changes, self.zooms, self.views];
        if !(1..=MAX_REVISIONS).contains(&self.revision)
            || counts.iter().any(|n| *n > 1_000_000)
            || self.active_ms > MAX_MS
            || self.total_ms > MAX_MS
        {
            return Err(Refusal::Range);
        }
        Ok(())
    }
}
