//! Many photos, many machines: a set of photos becomes a set of run folders.
//!
//! ```text
//! harmony batch FOLDER --out SET      photos -> SET/photos, one job each in the queue, workers until all have ended
//! harmony worker --queue ADDRESS      on any machine that sees SET: claims jobs, one child program a scene
//! ```
//! | module | holds |
//! |---|---|
//! | [`queue`] | jobs, sets, turns at players, in SQLite or PostgreSQL |
//! | [`set`] | the set's folder: what it is, its photos, where runs and logs are |
//! | [`child`] | one scene: the program that makes it, and how it ended |
//! | [`worker`] | claims, children, heartbeats, ends |
//! | [`inside`] | the other side: what the child asks of its worker's queue |
//! | [`status`], [`page`] | what a set has come to, for terminal and browser |
//!
//! What holds whatever is killed: a scene's state is its run folder, where every paid answer is a record
//! (`docs/decisions/0002-records-are-the-state.md`); a scene's program ends with its worker, after the calls in flight
//! are recorded; who lost a job's lease gets no turn at any player. So a scene that is begun again pays nothing again.
//! What does not hold: a call that is in flight when a *machine* dies may have been paid, and is asked again.

#![allow(clippy::format_push_string, reason = "pages and tables: plain rather than quick")]

mod cause;
pub mod child;
mod error;
pub mod inside;
pub mod page;
pub mod queue;
pub mod set;
pub mod status;
mod window;
pub mod worker;

pub use cause::Cause;
pub use error::BatchError;
pub use queue::{Queue, QueueAddress};
pub use set::{SetFolder, Submission, Submitted};
pub use worker::{WorkerEvent, WorkerOptions, WorkerReport, WorkerStop, work};
