//! Calibration and room boxes, on rooms with known truth.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod calibration_on_rooms;
mod common;
mod depth_frames;
mod pins;
mod room_boxes;
mod views;
