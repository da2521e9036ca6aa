//! The questions from outside: what is rendered from them, and what their checks let through.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

mod checks;
mod rendering;
mod samples;
