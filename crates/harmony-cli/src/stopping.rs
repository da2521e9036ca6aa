//! Ctrl-C, and the line that tells what is going on.

use std::sync::Arc;
use std::time::Duration;

use harmony_calls::{Calls, StopReason};

use crate::display::Display;
use crate::{EXIT_STOPPED, tell};

/// How long the program may take to end after somebody insists.
const INSISTED: Duration = Duration::from_secs(5);

/// Listens for Ctrl-C while a run goes on. The first one stops the run cleanly: nobody new is asked, what is in flight
/// is awaited and recorded. The second one lets go of what is in flight. Records are whole or not there at any moment,
/// so ending the program is safe whenever it does not end by itself.
pub fn on_interrupt(calls: &Arc<Calls>) {
    let stop = Arc::clone(calls.stop());
    let calls = Arc::clone(calls);
    tokio::spawn(async move {
        if tokio::signal::ctrl_c().await.is_err() {
            return; // No signals here: the run goes on to its end.
        }
        let underway = calls.now().underway;
        let (told, wait) = words(underway.iter().map(|call| (call.player.as_str(), call.offline)));
        tell!("stopping: {told}");
        let reason = StopReason::Interrupted("interrupted".to_owned());
        if wait {
            stop.close(reason);
        } else {
            stop.now(reason);
        }
        if tokio::signal::ctrl_c().await.is_ok() {
            stop.now(StopReason::Interrupted("interrupted".to_owned()));
            tokio::time::sleep(INSISTED).await;
            std::process::exit(EXIT_STOPPED.into());
        }
    });
}

/// What is told of the calls in flight, by who plays and whether it works on this machine alone, and whether they are
/// awaited: open questions to a person are not.
fn words<'a>(players: impl Iterator<Item = (&'a str, bool)>) -> (String, bool) {
    let (mut open, mut free, mut others) = (0_usize, 0_usize, Vec::new());
    for (player, offline) in players {
        match player {
            "files" => open += 1,
            _ if offline => free += 1,
            _ => others.push(player),
        }
    }
    let flying = free + others.len();
    others.sort_unstable();
    others.dedup();
    let mut told = Vec::new();
    if open > 0 {
        told.push(format!("open questions stay in their folders ({open}), the same command goes on with them"));
    }
    if !others.is_empty() {
        let names = others.join(", ");
        told.push(format!(
            "calls in flight are awaited ({flying}), for what {names} does may be paid; Ctrl-C again lets go of them"
        ));
    } else if flying > 0 {
        told.push(format!("what is being computed is awaited ({flying}); Ctrl-C again lets go of it"));
    }
    if told.is_empty() {
        told.push("nothing is in flight".to_owned());
    }
    (told.join("; "), flying > 0 || open == 0)
}

/// Stops the run as a first Ctrl-C does when the worker that began it has ended, or wants it to stop.
pub fn with_worker(calls: &Arc<Calls>) {
    let stop = Arc::clone(calls.stop());
    harmony_batch::inside::when_worker_ends(move || {
        stop.close(StopReason::Interrupted("the worker has ended, or wants this scene to stop".to_owned()));
    });
}

/// Shows what is under way, as long as the returned task runs.
pub fn show_calls(calls: &Arc<Calls>, display: &Arc<Display>) -> tokio::task::JoinHandle<()> {
    let (calls, display) = (Arc::clone(calls), Arc::clone(display));
    tokio::spawn(async move {
        let mut tick = tokio::time::interval(Duration::from_millis(500));
        loop {
            tick.tick().await;
            display.calls(calls.now().line());
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_who_costs_nothing_is_said_to_be_paid() {
        let of = |players: &[&str]| words(players.iter().map(|p| (*p, ["offline", "cycles"].contains(p))));
        let (told, wait) = of(&["files", "files"]);
        assert!(told.contains("open questions stay in their folders (2)") && !told.contains("paid"), "{told}");
        assert!(!wait, "a person is not waited for");
        let (told, wait) = of(&["cycles"]);
        assert!(wait && told.contains("computed") && !told.contains("paid"), "{told}");
        let (told, wait) = of(&["openai", "offline", "openai", "files"]);
        assert!(wait && told.contains("awaited (3), for what openai does may be paid"), "{told}");
        assert_eq!(of(&[]), ("nothing is in flight".to_owned(), true));
    }
}
