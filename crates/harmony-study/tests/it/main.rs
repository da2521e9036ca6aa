//! Tests of the whole: pages, servers, analyses.

#![allow(
    clippy::unwrap_used,
    clippy::semicolon_if_nothing_returned,
    clippy::format_push_string,
    clippy::type_complexity,
    clippy::needless_for_each,
    clippy::needless_range_loop,
    reason = "helpers of tests"
)]

mod analysis;
mod building;
mod collecting;
mod fixture;
mod orders;
mod serving;
