//! What a call leaves on disk.
//!
//! ```text
//! <run>/calls/<role>/<name>/record.json   who was asked, who answered, keys, tries, tokens, cost, warnings
//!                          timing.json    when, and how long: the only file of a record that holds times
//!                          request.json   parameters, schema, facts, hashes of the images
//!                          prompt.md      the prompt of a question
//!                          images/        the images that were sent (links to calls/.images, one file an image)
//!                          raw.txt        the raw answer
//!                          answer.*       the answer in the role's form
//! ```
//!
//! A record's folder is renamed into place when it is whole, and never changed afterwards.

use harmony_roles::{PlayerCard, Role, Usage};
use harmony_scene::Warning;
use serde::{Deserialize, Serialize};

use crate::ContentKey;

/// Version of the record's files; records of another version are made anew.
pub const RECORD_VERSION: u32 = 1;

/// Where an answer came from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "from", rename_all = "snake_case")]
pub enum Source {
    /// The player that was asked.
    Player,
    /// A recording.
    Recording {
        /// The recording's label.
        label: String,
        /// Whether the question differs from the one that was recorded.
        question_differs: bool,
    },
    /// The answer to another call of this run that was the same work for the player; it was paid there.
    Shared {
        /// Name of that call.
        with: String,
    },
    /// The offline player, for the one that was asked failed.
    Replaced {
        /// Why, in words.
        reason: String,
    },
    /// Nobody yet: tries were made, and the run stopped before one was answered. Never in a record; only in the log.
    Unanswered,
}

/// One time that a player was asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Try {
    /// Who.
    pub player: String,
    /// What was wrong with the answer; `None` = it was taken.
    pub complaint: Option<String>,
    /// Tokens and cost.
    pub usage: Usage,
}

/// `record.json`: everything about a call but its content and its times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CallRecord {
    /// [`RECORD_VERSION`].
    pub version: u32,
    /// Call name.
    pub name: String,
    /// Role.
    pub role: Role,
    /// Content key: role, player, model, parameters, prompt and images. Re-entry goes by it.
    pub key: ContentKey,
    /// The same without the player: tells whether a recording answers this very question.
    pub question: ContentKey,
    /// What reached the player, and which one, where that is less than the question: same key, same work.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub work: Option<ContentKey>,
    /// Who was to answer.
    pub cast: PlayerCard,
    /// Whose answer this is.
    pub answered_by: PlayerCard,
    /// How it came.
    pub source: Source,
    /// Every time somebody was asked, in order; empty for a recorded answer.
    pub tries: Vec<Try>,
    /// Sum over all tries.
    pub usage: Usage,
    /// What there is to say about it; told again when the record is used again.
    pub warnings: Vec<Warning>,
}

/// `calls/.unanswered/<role>/<name>.json`: what was tried, and paid, for a call that has no answer yet. The next start
/// goes on from it, and the file goes when the call is recorded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unanswered {
    /// Call name.
    pub name: String,
    /// Role.
    pub role: Role,
    /// Every time somebody was asked, in order.
    pub tries: Vec<Try>,
    /// Sum over all tries.
    pub usage: Usage,
    /// Start of the last of them, milliseconds since 1970-01-01 UTC.
    pub started_unix_ms: u64,
    /// Time that players took, milliseconds.
    pub latency_ms: u64,
}

/// `timing.json`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CallTiming {
    /// Start, milliseconds since 1970-01-01 UTC.
    pub started_unix_ms: u64,
    /// Time that players took over all tries, without any waiting, milliseconds.
    pub latency_ms: u64,
}

/// One line of the audit log and of the bill.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CallSummary {
    /// Call name.
    pub name: String,
    /// First part of the name.
    pub phase: String,
    /// Role.
    pub role: Role,
    /// Who answered.
    pub player: String,
    /// Model of who answered.
    pub model: String,
    /// Who answered is this program alone.
    pub offline: bool,
    /// How the answer came.
    pub source: Source,
    /// How often somebody was asked.
    pub tries: usize,
    /// Tokens and cost of all tries.
    pub usage: Usage,
    /// When, and how long.
    pub timing: CallTiming,
}

/// Adds up usage; a cost that is not known stays unknown only when no other is known.
pub fn add_usage(sum: Usage, more: Usage) -> Usage {
    Usage {
        input_tokens: sum.input_tokens.saturating_add(more.input_tokens),
        cached_tokens: sum.cached_tokens.saturating_add(more.cached_tokens),
        output_tokens: sum.output_tokens.saturating_add(more.output_tokens),
        cost_usd: match (sum.cost_usd, more.cost_usd) {
            (None, None) => None,
            (a, b) => Some(a.unwrap_or(0.0) + b.unwrap_or(0.0)),
        },
        closed_for: sum.closed_for.max(more.closed_for),
    }
}
