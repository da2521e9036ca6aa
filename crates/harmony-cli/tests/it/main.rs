//! The program as a person runs it.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod bad_answers;
mod bad_inputs;
mod batch;
#[cfg(unix)]
mod blender;
mod common;
mod faces;
mod first_day;
mod joined;
mod killed;
mod networks;
mod photos;
mod replay;
mod said_errors;
mod spending;
