//! Tests of the whole: pages, servers, analyses.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod analysis;
mod building;
mod collecting;
mod fixture;
mod orders;
mod serving;
