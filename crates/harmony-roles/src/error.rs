//! Why a player could not answer.

use std::time::Duration;

/// A role's failure. Which variant it is must not depend on the player.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RoleError {
    /// The answer is not what was asked for: not JSON, not to the schema, not finite, no image.
    #[error("{player} gave an unusable answer: {complaint}")]
    UnusableAnswer {
        /// Who.
        player: String,
        /// What is wrong, in words that can be sent back to a model.
        complaint: String,
        /// The raw body, shortened.
        raw: String,
    },
    /// The player declined on policy grounds.
    #[error("{player} refused: {reason}")]
    Refused {
        /// Who.
        player: String,
        /// Its words.
        reason: String,
    },
    /// A passing failure: overload, time-out, broken connection.
    #[error("{player} is not answering now: {reason}")]
    Unavailable {
        /// Who.
        player: String,
        /// What happened.
        reason: String,
        /// HTTP status, where there was one.
        status: Option<u16>,
        /// When to try again, if it said so.
        retry_after: Option<Duration>,
    },
    /// It cannot work as set up: no key, no server, no such model, no weights.
    #[error("{player} cannot be used: {reason}")]
    NotSetUp {
        /// Who.
        player: String,
        /// Why.
        reason: String,
        /// What to do about it.
        hint: String,
    },
    /// The player can't do this particular thing, and nobody is to blame.
    #[error("{player} cannot do this: {reason}")]
    NotCapable {
        /// Who.
        player: String,
        /// Why.
        reason: String,
    },
    /// A recording has no answer under this name.
    #[error("the recording has no answer for {name}")]
    NotRecorded {
        /// Call name.
        name: String,
    },
    /// A limit on calls, money or time was reached.
    #[error("budget reached: {reason}")]
    Budget {
        /// Which limit.
        reason: String,
    },
    /// The run stops before its end: somebody wants it so, or another part of it failed.
    #[error("stopped: {reason}")]
    Interrupted {
        /// Why.
        reason: String,
    },
    /// The disk did not let us.
    #[error("could not read or write for {player}: {source}")]
    Io {
        /// Who.
        player: String,
        /// Why.
        #[source]
        source: std::io::Error,
    },
}

impl RoleError {
    /// Whether the same request may succeed later.
    pub fn is_retryable(&self) -> bool {
        matches!(self, Self::Unavailable { .. })
    }

    /// How long the player asked to wait.
    pub fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::Unavailable { retry_after, .. } => *retry_after,
            _ => None,
        }
    }

    /// HTTP status, where there was one.
    pub fn status(&self) -> Option<u16> {
        match self {
            Self::Unavailable { status, .. } => *status,
            _ => None,
        }
    }

    /// Whether the whole run should stop rather than go on with another player.
    pub fn is_fatal(&self) -> bool {
        matches!(self, Self::Budget { .. } | Self::Interrupted { .. } | Self::Io { .. })
    }

    /// What a person can do about it.
    pub fn hint(&self) -> Option<&str> {
        match self {
            Self::NotSetUp { hint, .. } => Some(hint),
            _ => None,
        }
    }
}
