//! Whether a player can do its part now: what `harmony doctor` asks, and a run before it begins.

use async_trait::async_trait;
use harmony_roles::{RoleError, Usage};

/// What a check found.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// In a sentence.
    pub detail: String,
    /// What the check used, if it was a paid one.
    pub usage: Option<Usage>,
}

/// A player that can be asked whether it is there.
#[async_trait]
pub trait Check: Send + Sync {
    /// Asks with one cheap call that costs nothing; with `paid`, does a tiny piece of work instead.
    ///
    /// # Errors
    /// What is missing, as the player's work would fail.
    async fn check(&self, paid: bool) -> Result<Checked, RoleError>;
}
