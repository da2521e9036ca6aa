//! What a player says beside its answer: that nothing more is left of its rate, and until when.
//!
//! A service tells its rates with every answer, in headers that a role's answer has no place for. Whoever reads them
//! tells it here, and the call that is being made waits accordingly: the note belongs to the task of the call, so that
//! players need not know who calls them.

use std::cell::Cell;
use std::time::Duration;

tokio::task_local! {
    static PAUSE: Cell<Option<Duration>>;
}

/// Longest pause that is believed: a window of a rate is a minute, at times an hour; a day's quota is no rate.
const LONGEST: Duration = Duration::from_hours(1);

/// Tells that the player takes nothing more for so long, the answer to this call being its last. Outside of a call
/// nobody hears it.
pub fn no_more_for(wait: Duration) {
    if wait > LONGEST {
        return;
    }
    let _ = PAUSE.try_with(|pause| pause.set(pause.get().max(Some(wait))));
}

/// Makes a call and hears what was told during it.
pub(crate) async fn hearing<T>(call: impl Future<Output = T>) -> (T, Option<Duration>) {
    PAUSE.scope(Cell::new(None), async { (call.await, PAUSE.with(Cell::get)) }).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_longest_pause_of_a_call_is_heard_and_nothing_of_others() {
        no_more_for(Duration::from_secs(9));
        let call = async {
            no_more_for(Duration::from_secs(2));
            tokio::task::yield_now().await;
            no_more_for(Duration::from_secs(1));
            no_more_for(Duration::from_hours(30));
            "answer"
        };
        let ((answer, pause), ((), nothing)) = tokio::join!(hearing(call), hearing(async {}));
        assert_eq!((answer, pause, nothing), ("answer", Some(Duration::from_secs(2)), None));
    }
}
