//! The way to one player: so many calls at a time, so many requests and tokens a minute.
//!
//! Who waits longest goes first within a phase, and earlier phases go before later ones: what is placed first is
//! wanted first. A limit is configured, or learnt: a player that says "too many requests" is left alone for as long as
//! it asks (or we back off), and from then on gets fewer requests a minute than it just refused, slowly more again.
//!
//! Times are Tokio's, so that tests can stop the clock.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::Instant;

use crate::limits::PlayerLimits;

/// Length of the window that rates are counted in.
const WINDOW: Duration = Duration::from_mins(1);

/// Share of the requests of the last minute that is kept after a refusal.
const SLOWER: f64 = 0.8;

/// Growth of a learnt rate with every minute without a refusal.
const FASTER: f64 = 1.25;

/// Fewest requests in the window from which a rate can be learnt; below, a pause is enough.
const MIN_TO_LEARN: usize = 4;

/// Tokens that a request is taken to use before any was counted.
const USUAL_TOKENS: u64 = 3000;

/// Order of those who wait: phase, then who came first.
type Ticket = (String, u64);

#[derive(Debug, Default)]
struct Inside {
    taken: usize,
    waiting: BTreeMap<Ticket, oneshot::Sender<()>>,
    tickets: u64,
    /// Requests of the last minute, with the tokens that each used or is expected to use.
    requests: VecDeque<Request>,
    /// Tokens of all counted requests, and how many those were.
    counted: (u64, u64),
    /// Nobody goes before.
    closed_until: Option<Instant>,
    /// Requests a minute that were learnt, and when that was last changed.
    learnt: Option<(f64, Instant)>,
    /// When the player last said that it was too much.
    last_refusal: Option<Instant>,
}

#[derive(Debug)]
struct Request {
    number: u64,
    at: Instant,
    tokens: u64,
}

/// See the module.
#[derive(Debug)]
pub(crate) struct Gate {
    places: usize,
    limits: PlayerLimits,
    /// Length of the window that rates are counted in.
    window: Duration,
    inside: Mutex<Inside>,
}

/// A place at a player; given back when dropped.
#[derive(Debug)]
pub(crate) struct Place(Arc<Gate>);

impl Drop for Place {
    fn drop(&mut self) {
        self.0.give_back();
    }
}

/// Waits in line; a place that was given to one who has gone goes to the next.
struct Waiter {
    gate: Arc<Gate>,
    ticket: Ticket,
    turn: oneshot::Receiver<()>,
    done: bool,
}

impl Drop for Waiter {
    fn drop(&mut self) {
        if self.done {
            return;
        }
        self.gate.inside().waiting.remove(&self.ticket);
        self.turn.close();
        if self.turn.try_recv().is_ok() {
            self.gate.give_back();
        }
    }
}

impl Gate {
    /// A gate with so many places (0 = no limit) and rates.
    pub fn new(places: usize, limits: PlayerLimits, minute: Option<Duration>) -> Arc<Self> {
        let places = if places == 0 { usize::MAX } else { places };
        Arc::new(Self { places, limits, window: minute.unwrap_or(WINDOW), inside: Mutex::default() })
    }

    fn inside(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a call would have to wait for a place.
    pub fn is_full(&self) -> bool {
        let inside = self.inside();
        inside.taken >= self.places || !inside.waiting.is_empty()
    }

    /// Waits for a place.
    pub async fn place(self: &Arc<Self>, phase: &str) -> Place {
        let mut waiter = {
            let mut inside = self.inside();
            if inside.taken < self.places && inside.waiting.is_empty() {
                inside.taken += 1;
                return Place(Arc::clone(self));
            }
            let (give, turn) = oneshot::channel();
            inside.tickets += 1;
            let ticket = (phase.to_owned(), inside.tickets);
            inside.waiting.insert(ticket.clone(), give);
            Waiter { gate: Arc::clone(self), ticket, turn, done: false }
        };
        // The sender stays in line until it is used, so this cannot fail.
        let _ = (&mut waiter.turn).await;
        waiter.done = true;
        Place(Arc::clone(self))
    }

    fn give_back(&self) {
        let mut inside = self.inside();
        while let Some((_, give)) = inside.waiting.pop_first() {
            if give.send(()).is_ok() {
                return;
            }
        }
        inside.taken -= 1;
    }

    /// Counts a request when the rates allow one now, and returns its number; else until when to wait.
    pub fn admit(&self, now: Instant) -> Result<u64, Instant> {
        let mut inside = self.inside();
        if let Some(until) = inside.closed_until.filter(|until| *until > now) {
            return Err(until);
        }
        if let Some((rate, since)) = inside.learnt
            && now.duration_since(since) >= self.window
        {
            inside.learnt = (rate < 1e4).then_some((rate * FASTER, now));
        }
        let rates = [self.limits.requests_per_minute, inside.learnt.map(|(rate, _)| rate)];
        let rate = rates.into_iter().flatten().fold(f64::INFINITY, f64::min);
        // Below one a minute there is one in a longer window.
        let window = self.window.mul_f64((1.0 / rate).max(1.0));
        while inside.requests.front().is_some_and(|r| now.duration_since(r.at) >= window) {
            inside.requests.pop_front();
        }
        if rate.is_finite() {
            let most = rate.max(1.0) as usize;
            if inside.requests.len() >= most {
                return Err(inside.requests[inside.requests.len() - most].at + window);
            }
        }
        let (tokens, calls) = inside.counted;
        let expected = tokens.checked_div(calls).unwrap_or(USUAL_TOKENS);
        if let Some(limit) = self.limits.tokens_per_minute {
            let recent = inside.requests.iter().filter(|r| now.duration_since(r.at) < self.window);
            let used: u64 = recent.clone().map(|r| r.tokens).sum();
            // One that is larger than the limit by itself goes alone.
            if let Some(first) = recent.clone().next().filter(|_| (used + expected) as f64 > limit) {
                return Err(first.at + self.window);
            }
        }
        inside.tickets += 1;
        let number = inside.tickets;
        inside.requests.push_back(Request { number, at: now, tokens: expected });
        Ok(number)
    }

    /// Tells how many tokens a request really used.
    pub fn used(&self, number: u64, tokens: u64) {
        let mut inside = self.inside();
        inside.counted = (inside.counted.0.saturating_add(tokens), inside.counted.1 + 1);
        if let Some(request) = inside.requests.iter_mut().find(|r| r.number == number) {
            request.tokens = tokens;
        }
    }

    /// The player said with an answer how much it takes: nothing more until then. That is no refusal, and teaches no
    /// rate: the player counts better than we could.
    pub fn pause(&self, until: Instant) {
        let mut inside = self.inside();
        inside.closed_until = inside.closed_until.max(Some(until));
    }

    /// The player said that this was too much: nobody goes for a while, and when it says so again soon after, fewer go
    /// from then on. One refusal alone teaches no rate: at the begin of a run few requests were made, and most of them
    /// were let pass.
    pub fn refused(&self, now: Instant, wait: Duration) {
        let mut inside = self.inside();
        let until = now + wait;
        if inside.closed_until.is_some_and(|closed| closed > now) {
            // One of several refusals of one burst: it says nothing new about the rate.
            inside.closed_until = inside.closed_until.max(Some(until));
            return;
        }
        inside.closed_until = Some(until);
        let again = inside.last_refusal.is_some_and(|at| now.duration_since(at) < 2 * self.window);
        inside.last_refusal = Some(now);
        if !again {
            return;
        }
        let recent = inside.requests.iter().filter(|r| now.duration_since(r.at) < self.window).count();
        if recent >= MIN_TO_LEARN {
            let rate = (recent as f64 * SLOWER).max(1.0);
            inside.learnt = Some((inside.learnt.map_or(rate, |(old, _)| old.min(rate)), now));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(requests: Option<f64>, tokens: Option<f64>) -> PlayerLimits {
        PlayerLimits { requests_per_minute: requests, tokens_per_minute: tokens, ..PlayerLimits::default() }
    }

    #[tokio::test]
    async fn earlier_phases_go_first_and_one_who_leaves_the_line_loses_no_place() {
        let gate = Gate::new(1, PlayerLimits::default(), None);
        let held = gate.place("3_furniture").await;
        let order = Arc::new(Mutex::new(Vec::new()));
        let mut tasks = Vec::new();
        for (i, phase) in ["5_decoration", "3_furniture", "3_furniture", "2_wall"].into_iter().enumerate() {
            let (gate, order) = (Arc::clone(&gate), Arc::clone(&order));
            tasks.push(tokio::spawn(async move {
                let _place = gate.place(phase).await;
                order.lock().unwrap().push((i, phase));
            }));
            tokio::task::yield_now().await;
        }
        tasks[1].abort();
        tokio::task::yield_now().await;
        drop(held);
        for (i, task) in tasks.into_iter().enumerate() {
            assert_eq!(task.await.is_err(), i == 1);
        }
        assert_eq!(*order.lock().unwrap(), [(3, "2_wall"), (2, "3_furniture"), (0, "5_decoration")]);
        assert!(!gate.is_full());
    }

    #[tokio::test]
    async fn a_place_given_to_one_who_has_just_gone_goes_to_the_next() {
        let gate = Gate::new(1, PlayerLimits::default(), None);
        let held = gate.place("a").await;
        let mut gone = Box::pin(gate.place("a"));
        assert!(futures_poll(&mut gone).await.is_none());
        drop(held);
        drop(gone);
        let _next = gate.place("b").await;
    }

    async fn futures_poll<F: Future + Unpin>(future: &mut F) -> Option<F::Output> {
        tokio::select! { biased; out = future => Some(out), () = std::future::ready(()) => None }
    }

    #[tokio::test(start_paused = true)]
    async fn so_many_requests_a_minute_and_no_more() {
        let gate = Gate::new(0, limits(Some(3.0), None), None);
        let start = Instant::now();
        let mut times = Vec::new();
        for _ in 0..7 {
            loop {
                match gate.admit(Instant::now()) {
                    Ok(_) => break,
                    Err(until) => tokio::time::sleep_until(until).await,
                }
            }
            times.push(start.elapsed().as_secs());
        }
        assert_eq!(times, [0, 0, 0, 60, 60, 60, 120]);
        let slow = Gate::new(0, limits(Some(0.5), None), None);
        assert!(slow.admit(start).is_ok());
        assert_eq!(slow.admit(start).unwrap_err(), start + Duration::from_mins(2), "one in two minutes");
    }

    #[tokio::test(start_paused = true)]
    async fn tokens_are_counted_as_used_and_one_large_request_goes_alone() {
        let gate = Gate::new(0, limits(None, Some(1000.0)), None);
        let now = Instant::now();
        let first = gate.admit(now).expect("larger than the limit, but alone");
        assert!(gate.admit(now).is_err());
        gate.used(first, 400);
        gate.admit(now).expect("400 used, 400 expected");
        assert_eq!(gate.admit(now).unwrap_err(), now + WINDOW);
    }

    #[tokio::test(start_paused = true)]
    async fn a_refusal_closes_the_gate_for_all_and_lowers_the_rate_for_a_while() {
        let gate = Gate::new(0, PlayerLimits::default(), None);
        let now = Instant::now();
        for _ in 0..10 {
            gate.admit(now).unwrap();
        }
        gate.refused(now, Duration::from_secs(7));
        gate.refused(now, Duration::from_secs(5));
        assert_eq!(gate.admit(now).unwrap_err(), now + Duration::from_secs(7));
        let soon = now + Duration::from_secs(8);
        assert!(gate.admit(soon).is_ok(), "one refusal teaches no rate");
        gate.refused(soon, Duration::from_secs(2));
        // Eleven in the last minute: 8 a minute from now on, and one in the minute that is running.
        assert!(gate.admit(soon + Duration::from_secs(3)).is_err());
        let later = soon + WINDOW + Duration::from_secs(1);
        // The minute without a refusal has raised 8.8 to 11.
        let admitted = (0..20).filter(|_| gate.admit(later).is_ok()).count();
        assert_eq!(admitted, 11);
    }

    #[tokio::test(start_paused = true)]
    async fn a_pause_holds_everybody_back_and_teaches_no_rate() {
        let gate = Gate::new(0, PlayerLimits::default(), None);
        let now = Instant::now();
        assert_eq!((0..10).filter(|_| gate.admit(now).is_ok()).count(), 10);
        gate.pause(now + Duration::from_secs(5));
        gate.pause(now + Duration::from_secs(3));
        assert_eq!(gate.admit(now).unwrap_err(), now + Duration::from_secs(5));
        let after = now + Duration::from_secs(5);
        assert_eq!((0..30).filter(|_| gate.admit(after).is_ok()).count(), 30);
    }
}
