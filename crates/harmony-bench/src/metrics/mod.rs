//! Metrics of reconstructed geometry and pictures.
//!
//! | module | does |
//! |---|---|
//! | [`nearest`] | exact nearest neighbours between large point sets |
//! | [`soup`] | triangle soups: from meshes and depth maps, cut to what a camera sees |
//! | [`sample`] | points on surfaces, uniformly by area, from a seed |
//! | [`two_way`] | Chamfer distance, precision, recall and F1 of two point sets |
//! | [`gen3dsr`] | the protocol of Gen3DSR: camera frame, metres, no registration |
//! | [`midi`] | the protocol of MIDI-3D: normalised scene, rigid ICP, squared distances |
//! | [`icp`] | rigid alignment |
//! | [`depth`] | scale of a prediction from depth maps |
//! | [`picture`] | pixel loss |
//! | [`similarity`] | N-CLIP and LPIPS, by networks that are handed in |
//!
//! Geometry is in the unit its caller states; results say theirs. Same input and seed, same output: the number of
//! threads has no influence. `bench/metrics_vs_scipy.sh` compares numbers and speed with SciPy and Pillow.

pub mod depth;
pub mod gen3dsr;
pub mod icp;
pub mod midi;
pub mod nearest;
pub mod picture;
pub mod sample;
pub mod similarity;
pub mod soup;
pub mod two_way;
