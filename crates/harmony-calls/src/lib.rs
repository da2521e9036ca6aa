//! What is true of any call to a role: its name, its key, its record, its replay, its checks, its place in the bill.
//!
//! [`Calls`] wraps a [`Cast`]. Every call goes the same way:
//!
//! 1. the record of an earlier run, when name and content key agree: no call ([`CallBook`]);
//! 2. the recording that is replayed, by name; it is said when the question differs ([`Recording`]);
//! 3. the cast player; an answer that does not fit or makes no sense is asked for again with the complaint, a bounded
//!    number of times;
//! 4. the offline player, with a warning.
//!
//! The answer is then written as a record, whole or not at all, and *read back*: a run that is re-entered sees to the
//! bit what the first one saw. What is returned is always checked: answers of players, recordings and records alike
//! are untrusted.
//!
//! On the way to a player (step 3) a call waits for a free place, for the player's rates, and for the next try when
//! what happened is passing; budgets and deadlines are looked at before anybody outside is asked. An answered call is
//! never asked again, by this start or a later one; a try that was not answered is followed by another try.
//! [`Stop`] ends a run cleanly: nobody new is asked, what is in flight is awaited and recorded.

mod asking;
mod bill;
mod board;
mod book;
mod budget;
mod calls;
mod cast;
mod check;
mod codec;
mod gate;
mod key;
mod limits;
mod name;
mod prices;
mod record;
mod recording;
mod retry;
mod shared;
mod stop;

pub use bill::{Bill, BillLine};
pub use board::{CallsNow, Doing, Underway};
pub use book::{BookError, BookOptions, CallBook, RecordWriter, Secret};
pub use budget::{Budget, RoleBudget, Spent, WhenReached};
pub use calls::{CallCounts, CallEvent, CallEventKind, CallOptions, Calls};
pub use cast::{Capabilities, Cast};
pub use check::{MAX_ANSWER_BYTES, parse_answer, schema_complaints, shortened};
pub use key::{ContentKey, KeyHasher, key_for, pixel_hash};
pub use limits::{Limits, Pace, PlayerLimits};
pub use name::{CallName, NameError};
pub use prices::{Price, Prices};
pub use record::{CallRecord, CallSummary, CallTiming, RECORD_VERSION, Source, Try, Unanswered, add_usage};
pub use recording::{RecordedAnswer, Recording, RecordingAbout, RecordingManifest, export_recording};
pub use retry::RetryPolicy;
pub use shared::{SharedAsk, SharedLimits, SharedOver, SharedTurn};
pub use stop::{Stop, StopReason};
