//! What a player takes, counted for all programs of a batch: one small state a player, kept as JSON in the queue's
//! database and changed under its row's lock. Pure: times are milliseconds of the database's clock, so that clocks of
//! machines may differ.
//!
//! The last window (a minute) is counted in slots of a twelfth. A slot counts until it has wholly left the window, so
//! that no window of any position holds more than the limit; at most a twelfth of the rate is left unused for that.
//! The state has at most so many slots, however many programs ask and however often.

use serde::{Deserialize, Serialize};

use harmony_calls::PlayerLimits;

/// Parts of a window.
const SLOTS: i64 = 12;

/// Tokens that a request is taken to use before any was counted.
const USUAL_TOKENS: u64 = 3000;

/// Share of the requests of the last window that is kept after refusals.
const SLOWER: f64 = 0.8;

/// Growth of a learnt rate with every window without a refusal.
const FASTER: f64 = 1.25;

/// Fewest requests in the window from which a rate can be learnt.
const MIN_TO_LEARN: u64 = 4;

/// Requests and tokens of one slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Slot {
    at: i64,
    requests: u64,
    tokens: u64,
}

/// See the module.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Window {
    slots: Vec<Slot>,
    /// Tokens of all counted requests, and how many those were.
    counted: (u64, u64),
    /// Nobody goes before.
    closed_until: i64,
    /// Requests a window that were learnt, and when that was last changed.
    learnt: Option<(f64, i64)>,
    /// When the player last said that it was too much.
    last_refusal: Option<i64>,
}

/// A request that was counted: what is needed to correct its tokens later.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Counted {
    pub slot: i64,
    pub expected: u64,
}

impl Window {
    /// Counts a request when the rates allow one now; else says for how many milliseconds to wait. `minute` is the
    /// window's length in milliseconds (other than a minute only in tests whose times are scaled down).
    pub fn admit(&mut self, now: i64, limits: &PlayerLimits, minute: i64) -> Result<Counted, i64> {
        if self.closed_until > now {
            return Err(self.closed_until - now);
        }
        if let Some((rate, since)) = self.learnt
            && now - since >= minute
        {
            self.learnt = (rate < 1e4).then_some((rate * FASTER, now));
        }
        let rates = [limits.requests_per_minute, self.learnt.map(|(rate, _)| rate)];
        let rate = rates.into_iter().flatten().fold(f64::INFINITY, f64::min);
        // Below one a minute there is one in a longer window.
        let window = (minute as f64 * (1.0 / rate).max(1.0)) as i64;
        let slot_length = (minute / SLOTS).max(1);
        // A slot that began before this may still reach into the window.
        self.slots.retain(|s| s.at + slot_length > now - window);
        // The oldest slot must leave before there is room; it leaves when its end does.
        let until_oldest_leaves = |slots: &[Slot], length: i64| {
            slots.first().map_or(slot_length, |s| (s.at + slot_length + length - now).max(1))
        };
        if rate.is_finite() {
            let used: u64 = self.slots.iter().map(|s| s.requests).sum();
            if used >= rate.max(1.0) as u64 {
                return Err(until_oldest_leaves(&self.slots, window));
            }
        }
        let (tokens, calls) = self.counted;
        let expected = tokens.checked_div(calls).unwrap_or(USUAL_TOKENS);
        if let Some(limit) = limits.tokens_per_minute {
            let recent: Vec<Slot> = self.slots.iter().copied().filter(|s| s.at + slot_length > now - minute).collect();
            let used: u64 = recent.iter().map(|s| s.tokens).sum();
            // One that is larger than the limit by itself goes alone.
            if !recent.is_empty() && (used + expected) as f64 > limit {
                return Err(until_oldest_leaves(&recent, minute));
            }
        }
        let at = now - now.rem_euclid(slot_length);
        match self.slots.iter_mut().find(|s| s.at == at) {
            Some(slot) => {
                slot.requests += 1;
                slot.tokens += expected;
            }
            None => self.slots.push(Slot { at, requests: 1, tokens: expected }),
        }
        Ok(Counted { slot: at, expected })
    }

    /// Tells how many tokens a request really used.
    pub fn used(&mut self, counted: Counted, tokens: u64) {
        self.counted = (self.counted.0.saturating_add(tokens), self.counted.1 + 1);
        if let Some(slot) = self.slots.iter_mut().find(|s| s.at == counted.slot) {
            slot.tokens = slot.tokens.saturating_sub(counted.expected).saturating_add(tokens);
        }
    }

    /// Nothing more until then.
    pub fn close_until(&mut self, until: i64) {
        self.closed_until = self.closed_until.max(until);
    }

    /// The player said that it was too much: nobody goes for a while, and when it says so again within two windows,
    /// fewer go from then on. Several refusals of one burst count as one.
    pub fn refused(&mut self, now: i64, wait: i64, minute: i64) {
        let burst = self.closed_until > now;
        self.close_until(now + wait);
        if burst {
            return;
        }
        let again = self.last_refusal.is_some_and(|at| now - at < 2 * minute);
        self.last_refusal = Some(now);
        let recent: u64 = self.slots.iter().filter(|s| s.at > now - minute).map(|s| s.requests).sum();
        if again && recent >= MIN_TO_LEARN {
            let rate = (recent as f64 * SLOWER).max(1.0);
            self.learnt = Some((self.learnt.map_or(rate, |(old, _)| old.min(rate)), now));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: i64 = 60_000;

    fn limits(requests: Option<f64>, tokens: Option<f64>) -> PlayerLimits {
        PlayerLimits { requests_per_minute: requests, tokens_per_minute: tokens, ..PlayerLimits::default() }
    }

    /// Times of all requests that are let pass when somebody asks again as soon as it is worth it.
    fn times(window: &mut Window, limits: &PlayerLimits, begin: i64, count: usize) -> Vec<i64> {
        let (mut now, mut times) = (begin, Vec::new());
        while times.len() < count {
            match window.admit(now, limits, MINUTE) {
                Ok(_) => times.push(now),
                Err(wait) => {
                    assert!(wait > 0);
                    now += wait;
                }
            }
        }
        times
    }

    #[test]
    fn no_minute_of_any_position_holds_more_than_the_limit_and_little_is_left_unused() {
        for begin in [0, 1, 4_999, 1_764_000_000_123] {
            let limits = limits(Some(30.0), None);
            let times = times(&mut Window::default(), &limits, begin, 300);
            for (i, first) in times.iter().enumerate() {
                let within = times[i..].iter().take_while(|t| *t - first < MINUTE).count();
                assert!(within <= 30, "{within} from {first}");
            }
            let minutes = (times[299] - begin) as f64 / MINUTE as f64;
            // 300 at 30 a minute: the last burst goes after nine minutes at best.
            assert!((9.0..=9.0 * 13.0 / 12.0 + 0.1).contains(&minutes), "{minutes}");
        }
    }

    #[test]
    fn below_one_a_minute_there_is_one_in_a_longer_window() {
        let limits = limits(Some(0.5), None);
        let times = times(&mut Window::default(), &limits, 0, 4);
        assert!(times.windows(2).all(|t| (2 * MINUTE..=2 * MINUTE + MINUTE / 6).contains(&(t[1] - t[0]))), "{times:?}");
    }

    #[test]
    fn tokens_are_counted_as_used_and_one_large_request_goes_alone() {
        let limits = limits(None, Some(1000.0));
        let mut window = Window::default();
        let first = window.admit(0, &limits, MINUTE).expect("larger than the limit, but alone");
        assert!(window.admit(0, &limits, MINUTE).is_err());
        window.used(first, 400);
        window.admit(10, &limits, MINUTE).expect("400 used, 400 expected");
        assert!(window.admit(20, &limits, MINUTE).is_err());
    }

    #[test]
    fn refusals_close_the_way_and_two_teach_a_rate() {
        let none = PlayerLimits::default();
        let mut window = Window::default();
        for _ in 0..10 {
            window.admit(0, &none, MINUTE).unwrap();
        }
        window.refused(0, 7000, MINUTE);
        window.refused(0, 5000, MINUTE);
        assert_eq!(window.admit(0, &none, MINUTE), Err(7000));
        assert!(window.admit(8000, &none, MINUTE).is_ok(), "one refusal teaches no rate");
        window.refused(8000, 2000, MINUTE);
        let later = 8000 + MINUTE + MINUTE / 6;
        let admitted = (0..20).filter(|_| window.admit(later, &none, MINUTE).is_ok()).count();
        assert_eq!(admitted, 11, "four fifths of eleven, and a quarter more after a minute");
        let json = serde_json::to_string(&window).unwrap();
        assert_eq!(serde_json::from_str::<Window>(&json).unwrap(), window);
        assert!(json.len() < 1000);
    }
}
