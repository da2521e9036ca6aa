//! Batches with players that only wait.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;
mod ends;
mod limits;
mod queue;
mod trials;
