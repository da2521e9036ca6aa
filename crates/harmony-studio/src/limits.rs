//! Rate limits as services count them: a bucket of requests that is refilled by the window.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use crate::services::Service;

/// Buckets, one a service.
#[derive(Debug)]
pub struct Buckets {
    requests: u32,
    window: Duration,
    /// Requests of the running window, and when it began.
    used: Mutex<HashMap<Service, (u32, Instant)>>,
}

/// How full a bucket is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Level {
    /// Requests in a window.
    pub limit: u32,
    /// Of these, still allowed in this one.
    pub remaining: u32,
    /// Until the next window.
    pub reset: Duration,
    /// Whether this request is one too many.
    pub over: bool,
}

impl Buckets {
    /// So many requests in a window.
    pub fn new(requests: u32, window: Duration) -> Self {
        Self { requests, window, used: Mutex::default() }
    }

    /// Counts a request.
    pub fn take(&self, service: Service) -> Level {
        let now = Instant::now();
        let mut used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let (count, since) = used.entry(service).or_insert((0, now));
        if now.duration_since(*since) >= self.window {
            (*count, *since) = (0, now);
        }
        let over = *count >= self.requests;
        *count += u32::from(!over);
        let reset = self.window.saturating_sub(now.duration_since(*since));
        Level { limit: self.requests, remaining: self.requests - *count, reset, over }
    }
}

/// A duration as OpenAI spells it: `6m0s`, `1.5s`, `20ms` (vlm sheet, section 4).
pub fn spelled(duration: Duration) -> String {
    let ms = duration.as_millis();
    match ms {
        0..1000 => format!("{ms}ms"),
        1000..60_000 => format!("{}s", duration.as_secs_f64()),
        _ => format!("{}m{}s", ms / 60_000, (ms % 60_000) as f64 / 1000.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_bucket_is_empty_until_the_next_window() {
        let buckets = Buckets::new(2, Duration::from_millis(300));
        assert_eq!(buckets.take(Service::OpenAi).remaining, 1);
        assert_eq!(buckets.take(Service::OpenAi).remaining, 0);
        let third = buckets.take(Service::OpenAi);
        assert!(third.over && third.reset <= Duration::from_millis(300));
        assert!(!buckets.take(Service::Anthropic).over);
        tokio::time::sleep(Duration::from_millis(310)).await;
        assert!(!buckets.take(Service::OpenAi).over);
        let read = |ms: u64| harmony_players::http::spelled(&spelled(Duration::from_millis(ms)));
        for ms in [20, 1500, 59_000, 360_000, 61_500] {
            assert_eq!(read(ms), Some(Duration::from_millis(ms)));
        }
    }
}
