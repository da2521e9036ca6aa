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
//! Left for later, with its place: waiting and retrying what is passing (`Calls::try_player`), budgets (before a
//! player is asked, same place), prices (by the player, in [`harmony_roles::Usage`]).

mod bill;
mod book;
mod calls;
mod cast;
mod check;
mod codec;
mod key;
mod name;
mod record;
mod recording;

pub use bill::{Bill, BillLine};
pub use book::{BookError, BookOptions, CallBook, RecordWriter, Secret};
pub use calls::{CallCounts, CallEvent, CallEventKind, CallOptions, Calls};
pub use cast::Cast;
pub use check::{MAX_ANSWER_BYTES, parse_answer, schema_complaints, shortened};
pub use key::{ContentKey, KeyHasher, key_for, pixel_hash};
pub use name::{CallName, NameError};
pub use record::{CallRecord, CallSummary, CallTiming, RECORD_VERSION, Source, Try, add_usage};
pub use recording::{RecordedAnswer, Recording, RecordingAbout, RecordingManifest, export_recording};
