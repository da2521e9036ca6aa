//! Metrics of reconstructed geometry and pictures.
//!
//! | module | does |
//! |---|---|
//! | [`nearest`] | exact nearest neighbours between large point sets |
//!
//! Geometry is in the unit its caller states; results say theirs. Same input and seed, same output: the number of
//! threads has no influence.

pub mod nearest;
