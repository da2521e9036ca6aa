//! Rooms with truth, oracle, metrics, tables.
#![allow(
    clippy::unwrap_used,
    clippy::semicolon_if_nothing_returned,
    clippy::format_push_string,
    clippy::type_complexity,
    clippy::needless_for_each,
    clippy::needless_range_loop,
    reason = "helpers of tests"
)]

mod calibration;
mod generate;
mod metrics_scipy;
mod protocols;
mod tables;
mod views_agree;
mod wall_clock;
