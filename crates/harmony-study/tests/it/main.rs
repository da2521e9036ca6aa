//! Tests of the whole: pages, servers, analyses.

mod analysis;
mod building;
mod collecting;
mod fixture;
mod orders;
mod serving;
