//! Tests of the whole: from a finished run to a release that others read.

#![allow(
    clippy::unwrap_used,
    clippy::semicolon_if_nothing_returned,
    clippy::format_push_string,
    clippy::type_complexity,
    clippy::needless_for_each,
    clippy::needless_range_loop,
    reason = "helpers of tests"
)]

mod building;
mod checking;
mod fixture;
mod galleries;
