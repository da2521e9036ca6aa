//! The benchmark: rooms with known truth, oracle players that answer from it with chosen noise, and metrics.
//!
//! `harmony bench` runs the pipeline on such rooms and judges every change to the geometry.

pub mod ablate;
pub mod compare;
pub mod fit;
pub mod generate;
pub mod homes;
pub mod metrics;
pub mod oracle;
pub mod overrides;
pub mod photos;
pub mod ply;
pub mod protocols;
pub mod report;
pub mod run;
pub mod score;
pub mod spent;
pub mod summary;
pub mod truth;
pub mod views;
pub mod wall_clock;
