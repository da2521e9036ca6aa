//! What is going on now, for a person who watches.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use harmony_roles::{PlayerCard, Role};
use tokio::time::Instant;

use crate::budget::Spent;

/// What a call is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doing {
    /// It waits for a free place at the player.
    Queued,
    /// It waits for a rate limit, until then.
    RateLimited(Instant),
    /// The player did not answer; it is asked again then.
    Backoff(Instant),
    /// The player is at it.
    Running,
}

/// One call that is under way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Underway {
    /// Role.
    pub role: Role,
    /// Call name.
    pub name: String,
    /// Who is asked.
    pub player: String,
    /// Whether the work is this machine's own, and costs time alone ([`PlayerCard::offline`]).
    pub offline: bool,
    /// What it does.
    pub doing: Doing,
    /// Since when.
    pub since: Instant,
}

/// All calls that are under way, and what was spent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CallsNow {
    /// By name.
    pub underway: Vec<Underway>,
    /// Spent in the run folder, earlier starts included.
    pub spent: Spent,
}

impl CallsNow {
    /// One line: who runs, who waits and why, and what was spent. Empty when nothing is under way.
    pub fn line(&self) -> String {
        let mut parts = Vec::new();
        for role in Role::ALL {
            let running: Vec<&str> = self
                .underway
                .iter()
                .filter(|u| u.role == role && u.doing == Doing::Running)
                .map(|u| short(&u.name))
                .collect();
            if !running.is_empty() {
                let more = running.len().saturating_sub(3);
                let names = running[..running.len().min(3)].join(", ");
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                parts.push(format!("{}: {names}{more}", role.folder().replace('_', " ")));
            }
        }
        let count = |is: fn(&Doing) -> bool| self.underway.iter().filter(|u| is(&u.doing)).count();
        let until = |of: fn(&Doing) -> Option<Instant>| {
            let now = Instant::now();
            let waits = self.underway.iter().filter_map(|u| of(&u.doing));
            waits.min().map_or(0, |at| at.saturating_duration_since(now).as_secs())
        };
        let queued = count(|d| *d == Doing::Queued);
        if queued > 0 {
            parts.push(format!("{queued} in line"));
        }
        let limited = count(|d| matches!(d, Doing::RateLimited(_)));
        if limited > 0 {
            let next = until(|d| if let Doing::RateLimited(at) = d { Some(*at) } else { None });
            parts.push(format!("{limited} wait for a rate limit ({next} s)"));
        }
        let backing = count(|d| matches!(d, Doing::Backoff(_)));
        if backing > 0 {
            let next = until(|d| if let Doing::Backoff(at) = d { Some(*at) } else { None });
            parts.push(format!("{backing} to be tried again ({next} s)"));
        }
        if self.spent.usd > 0.0 {
            parts.push(format!("{:.2} US$", self.spent.usd));
        }
        parts.join(" | ")
    }
}

/// `chair_02/mesh` of `3_furniture/chair_02/mesh`.
fn short(name: &str) -> &str {
    name.split_once('/').map_or(name, |(_, rest)| rest)
}

/// Keeps what is under way.
#[derive(Debug, Default)]
pub(crate) struct Board(Mutex<Lines>);

/// What is under way, and for how long something was.
#[derive(Debug, Default)]
struct Lines {
    of: BTreeMap<(Role, String), Underway>,
    /// Time in which somebody from outside was asked, up to the last change.
    waited: Duration,
    /// Since when somebody from outside is asked now.
    waiting_since: Option<Instant>,
}

impl Lines {
    /// After a line came or went.
    fn changed(&mut self) {
        let waits = self.of.values().any(|line| !line.offline);
        if let Some(since) = self.waiting_since.take_if(|_| !waits) {
            self.waited += since.elapsed();
        } else if waits && self.waiting_since.is_none() {
            self.waiting_since = Some(Instant::now());
        }
    }
}

/// A call's line on the board; wiped when dropped.
pub(crate) struct Line<'a> {
    board: &'a Board,
    key: (Role, String),
}

impl Board {
    pub fn line<'a>(&'a self, role: Role, name: &str, card: &PlayerCard) -> Line<'a> {
        let key = (role, name.to_owned());
        let new = Underway {
            role,
            name: name.to_owned(),
            player: card.player.clone(),
            offline: card.offline,
            doing: Doing::Queued,
            since: Instant::now(),
        };
        let mut lines = self.lines();
        lines.of.insert(key.clone(), new);
        lines.changed();
        Line { board: self, key }
    }

    pub fn underway(&self) -> Vec<Underway> {
        self.lines().of.values().cloned().collect()
    }

    /// Time so far in which somebody from outside was asked; two at once count once.
    pub fn waited(&self) -> Duration {
        let lines = self.lines();
        lines.waited + lines.waiting_since.map_or(Duration::ZERO, |since| since.elapsed())
    }

    fn lines(&self) -> MutexGuard<'_, Lines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Line<'_> {
    pub fn doing(&self, doing: Doing) {
        let mut lines = self.board.lines();
        if let Some(line) = lines.of.get_mut(&self.key) {
            line.doing = doing;
            line.since = Instant::now();
        }
    }
}

impl Drop for Line<'_> {
    fn drop(&mut self) {
        let mut lines = self.board.lines();
        lines.of.remove(&self.key);
        lines.changed();
    }
}

/// Seconds of a wait, for events.
pub(crate) fn until(at: Instant) -> Duration {
    at.saturating_duration_since(Instant::now())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn card(player: &str) -> PlayerCard {
        PlayerCard { player: player.to_owned(), model: "1".to_owned(), offline: false, concurrency: 0 }
    }

    #[tokio::test(start_paused = true)]
    async fn waiting_for_two_counts_once_and_work_of_this_machine_does_not() {
        let board = Board::default();
        let pass = |seconds| tokio::time::sleep(Duration::from_secs(seconds));
        let own = board.line(Role::Segmenter, "2_wall/segment", &PlayerCard { offline: true, ..card("offline") });
        pass(5).await;
        assert_eq!(board.waited().as_secs(), 0);
        let first = board.line(Role::VisionLanguage, "2_wall/list", &card("openai"));
        pass(3).await;
        let second = board.line(Role::VisionLanguage, "3_furniture/list", &card("openai"));
        drop(own);
        pass(4).await;
        drop(first);
        pass(2).await;
        assert_eq!(board.waited().as_secs(), 9, "it still waits");
        drop(second);
        pass(50).await;
        assert_eq!(board.waited().as_secs(), 9);
    }

    #[tokio::test(start_paused = true)]
    async fn the_line_says_who_runs_who_waits_and_what_was_spent() {
        let board = Board::default();
        let mesh = board.line(Role::MeshGenerator, "3_furniture/chair_02/mesh", &card("hunyuan"));
        mesh.doing(Doing::Running);
        let waits = board.line(Role::VisionLanguage, "3_furniture/inspect", &card("openai"));
        waits.doing(Doing::RateLimited(Instant::now() + Duration::from_secs(12)));
        let _queued = board.line(Role::MeshGenerator, "3_furniture/sofa_01/mesh", &card("hunyuan"));
        let spent = Spent { usd: 0.42, ..Spent::default() };
        let now = CallsNow { underway: board.underway(), spent };
        assert_eq!(now.line(), "mesh generator: chair_02/mesh | 1 in line | 1 wait for a rate limit (12 s) | 0.42 US$");
        drop((mesh, waits));
        assert_eq!(board.underway().len(), 1);
    }
}
