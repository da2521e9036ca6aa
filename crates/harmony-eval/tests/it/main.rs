//! The judge on small sets of pictures whose figures are known.

#![allow(
    clippy::unwrap_used,
    clippy::semicolon_if_nothing_returned,
    clippy::format_push_string,
    clippy::format_collect,
    clippy::type_complexity,
    clippy::needless_for_each,
    clippy::needless_range_loop,
    reason = "helpers of tests"
)]

mod judging;
mod rivals;
mod scoring;
