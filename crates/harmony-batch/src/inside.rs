//! What a scene's program has of its worker: turns at players from the worker's queue, and the end of its standard
//! input when the worker is gone or wants it to stop.
//!
//! Why standard input: an operating system closes it whatever way a worker ends, SIGKILL included, on every platform and
//! without a signal that could hit another program. The program then asks nobody new, awaits what is in flight (it is
//! paid), records it, and ends.

use std::io::Read as _;
use std::time::Duration;

use crate::queue::SharedPlayers;
use crate::{BatchError, Queue, QueueAddress};

/// Address of the queue, in full.
pub const QUEUE: &str = "HARMONY_BATCH_QUEUE";

/// Set, job and token: `1:23:4`.
pub const JOB: &str = "HARMONY_BATCH_JOB";

/// Name of the machine.
pub const HOST: &str = "HARMONY_BATCH_HOST";

/// How long the queue may be away when a scene's program begins.
const PATIENCE: Duration = Duration::from_mins(1);

/// Turns at players, when this program was started by a worker.
///
/// # Errors
/// What the worker left is no queue, or it cannot be reached for a while.
pub async fn shared_players() -> Result<Option<SharedPlayers>, BatchError> {
    let (Ok(queue), Ok(job)) = (std::env::var(QUEUE), std::env::var(JOB)) else { return Ok(None) };
    let refused = || BatchError::Unknown(format!("{JOB} is {job:?}; it is set:job:token, written by the worker"));
    let numbers: Vec<i64> = job.split(':').map(str::parse).collect::<Result<_, _>>().map_err(|_| refused())?;
    let [set, job, token] = numbers[..] else { return Err(refused()) };
    let address = QueueAddress::parse(&queue)?;
    let begun = tokio::time::Instant::now();
    let queue = loop {
        // Two connections: one asks while the end of a call is told.
        match Queue::open(&address, 2).await {
            Err(error) if error.is_passing() && begun.elapsed() < PATIENCE => {
                tokio::time::sleep(Duration::from_millis(500)).await;
            }
            other => break other?,
        }
    };
    let host = std::env::var(HOST).unwrap_or_default();
    Ok(Some(SharedPlayers::new(queue, (set, job, token), host)))
}

/// Calls `then` when the worker is gone or wants this program to stop; never when it was not started by a worker.
pub fn when_worker_ends(then: impl FnOnce() + Send + 'static) {
    if std::env::var_os(JOB).is_none() {
        return;
    }
    // A thread of its own: a read that waits would keep an asynchronous runtime from ending.
    std::thread::spawn(move || {
        let mut input = std::io::stdin().lock();
        let mut nothing = [0; 64];
        while matches!(input.read(&mut nothing), Ok(n) if n > 0) {}
        then();
    });
}
