//! Limits that hold over several programs at once: the scenes of a batch share the players' rates and places, and one
//! purse.
//!
//! The gates and the purse of this program ([`crate::Limits`], [`crate::Budget`]) know its own run alone. Where many
//! runs are made beside each other, on one machine or on many, somebody above them counts: [`SharedLimits`] is asked
//! before each try, after this program's own gate and before its own purse, and is told when the try is over.

use std::time::Duration;

use harmony_roles::Role;

use crate::limits::PlayerLimits;

/// What a try would take.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedAsk {
    /// Role.
    pub role: Role,
    /// Player, as on its card.
    pub player: String,
    /// Its model.
    pub model: String,
    /// Calls that the player takes at a time; 0 = no limit.
    pub places: usize,
    /// Its rates.
    pub limits: PlayerLimits,
    /// US dollars that the try is expected to cost, where the price table knows.
    pub expected_usd: Option<f64>,
}

/// Whether a try may be made.
#[derive(Debug, Clone, PartialEq)]
pub enum SharedTurn {
    /// Now; the number is given back with [`SharedLimits::settle`].
    Go(i64),
    /// Not yet: ask again after this time.
    Wait(Duration),
    /// A budget that all share is reached.
    Budget(String),
    /// This run is no longer wanted: it was cancelled, or another program has taken it over.
    Stop(String),
}

/// How a try ended.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SharedOver {
    /// Tokens it used, where the player counts them.
    pub tokens: Option<u64>,
    /// US dollars it cost; `None` = nobody knows, and what was expected counts.
    pub cost_usd: Option<f64>,
    /// The player takes nothing more for so long.
    pub closed_for: Option<Duration>,
}

/// Whoever counts for several programs.
#[async_trait::async_trait]
pub trait SharedLimits: Send + Sync {
    /// Counts a try, or says why it must not be made now. An answer must come even when whoever counts cannot be
    /// reached: then [`SharedTurn::Wait`].
    async fn take(&self, ask: &SharedAsk) -> SharedTurn;

    /// The try is over. What cannot be told now is told later or counts as expected.
    async fn settle(&self, number: i64, over: SharedOver);

    /// The player said that it was too much: nobody goes for so long.
    async fn refused(&self, player: &str, model: &str, wait: Duration);
}
