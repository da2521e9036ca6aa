//! Networks against their reference implementations, on small configurations.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod backends;
mod clip;
mod common;
mod detector;
#[cfg(any(feature = "clip", feature = "lpips", feature = "sam2"))]
mod image_nets;
mod lpips;
mod no_gpu;
mod sam2;
mod vggt;
mod weights;
