//! The rasteriser.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod behaviour;
mod closed_form;
mod common;
mod glass;
