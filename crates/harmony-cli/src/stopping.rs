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
        let flying = calls.now().underway.len();
        tell!("stopping: {flying} calls in flight are awaited, for they are paid (Ctrl-C again lets go of them)");
        stop.close(StopReason::Interrupted("interrupted".to_owned()));
        if tokio::signal::ctrl_c().await.is_ok() {
            stop.now(StopReason::Interrupted("interrupted".to_owned()));
            tokio::time::sleep(INSISTED).await;
            std::process::exit(EXIT_STOPPED.into());
        }
    });
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
