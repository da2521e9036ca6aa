//! The judge on small sets of pictures whose figures are known.

#![allow(clippy::unwrap_used, clippy::format_collect, reason = "helpers of tests")]

mod judging;
mod rivals;
mod scoring;
