//! Exports of a furnished room, read back by the crate's own readers and by those of other programs.

#![expect(clippy::unwrap_used, reason = "tests, helpers included")]

mod bad_input;
mod formats;
mod outside;
mod support;
