//! One module a command.

pub mod batch;
pub mod bench;
pub mod bench_home;
pub mod bill;
pub mod dataset;
pub mod doctor;
pub mod estimate;
pub mod eval;
pub mod export;
pub mod gallery;
pub mod home;
pub mod join;
pub mod manual;
pub mod model;
pub mod models;
pub mod reconstruct;
pub mod record;
pub mod render;
pub mod robot;
pub mod schema;
pub mod setup;
pub mod show;
pub mod simulate;
pub mod study;
