//! Rooms with truth, oracle, metrics, tables.
#![allow(clippy::unwrap_used, clippy::format_push_string, clippy::type_complexity, reason = "helpers of tests")]

mod calibration;
mod generate;
mod homes;
mod metrics_scipy;
mod paper;
mod photos;
mod protocols;
mod shapes;
mod tables;
mod views_agree;
mod wall_clock;
