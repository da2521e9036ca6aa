//! When a player that is not answering now is asked again: exponential backoff with full jitter.
//!
//! Marc Brooker, "Exponential Backoff And Jitter", AWS Architecture Blog, 2015: the wait is drawn evenly from zero to
//! the doubled bound, so that callers that failed together don't come back together.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// How what is passing is tried again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RetryPolicy {
    /// Further tries after one that was not answered.
    pub retries: u32,
    /// Upper bound of the first wait, seconds; it doubles from try to try.
    pub first_seconds: f64,
    /// Upper bound of every wait that we choose, seconds.
    pub most_seconds: f64,
    /// Longest wait that a player may ask for (Retry-After), seconds; one that asks for more is given up.
    pub patience_seconds: f64,
}

impl Default for RetryPolicy {
    fn default() -> Self {
        Self { retries: 5, first_seconds: 1.0, most_seconds: 60.0, patience_seconds: 600.0 }
    }
}

impl RetryPolicy {
    /// How long to wait before the next try, when `done` tries were not answered; `None` = give up.
    ///
    /// `random` is 0 to 1. A wait that the player asked for is kept in full, and spread over one first wait more.
    pub fn wait(&self, done: u32, asked_for: Option<Duration>, random: f64) -> Option<Duration> {
        if done > self.retries {
            return None;
        }
        let seconds = match asked_for {
            Some(wait) if wait.as_secs_f64() > self.patience_seconds => return None,
            Some(wait) => wait.as_secs_f64() + random * self.first_seconds,
            None => {
                random * (self.first_seconds * 2_f64.powi(done.saturating_sub(1).min(30) as i32)).min(self.most_seconds)
            }
        };
        Some(Duration::from_secs_f64(seconds.clamp(0.0, 86_400.0)))
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// A sentence that names the field, its value and what is allowed.
    pub fn check(&self) -> Result<(), String> {
        for (name, value) in [
            ("first_seconds", self.first_seconds),
            ("most_seconds", self.most_seconds),
            ("patience_seconds", self.patience_seconds),
        ] {
            if !(0.0..=86_400.0).contains(&value) {
                return Err(format!("limits.retry.{name} is {value}; allowed is 0 to 86400"));
            }
        }
        if self.retries > 100 {
            return Err(format!("limits.retry.retries is {}; allowed is 0 to 100", self.retries));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_double_up_to_the_most_and_jitter_is_full() {
        let policy = RetryPolicy { retries: 9, first_seconds: 1.0, most_seconds: 10.0, patience_seconds: 60.0 };
        let bounds: Vec<f64> = (1..=6).map(|n| policy.wait(n, None, 1.0).unwrap().as_secs_f64()).collect();
        assert_eq!(bounds, [1.0, 2.0, 4.0, 8.0, 10.0, 10.0]);
        assert_eq!(policy.wait(3, None, 0.0), Some(Duration::ZERO));
        assert_eq!(policy.wait(3, None, 0.5), Some(Duration::from_secs(2)));
        assert_eq!(policy.wait(10, None, 0.5), None, "nine retries are enough");
    }

    #[test]
    fn what_the_player_asks_for_is_kept_in_full_or_given_up() {
        let policy = RetryPolicy { patience_seconds: 60.0, ..RetryPolicy::default() };
        let asked = Some(Duration::from_secs(12));
        assert_eq!(policy.wait(1, asked, 0.0), asked);
        assert!(policy.wait(1, asked, 1.0) > asked);
        assert_eq!(policy.wait(1, Some(Duration::from_secs(61)), 0.0), None);
    }
}
