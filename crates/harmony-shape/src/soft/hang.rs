//! Hanging cloth: curtains.

use super::Cloth;
use crate::tree::HangTop;

/// Arguments of [`hang`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HangSpec {
    /// Width and height as it hangs.
    pub size: [f64; 2],
    /// Number of folds; 0: one every 12 cm.
    pub folds: u32,
    /// Cloth width relative to the width it hangs in.
    pub gather: f64,
    /// How it is held.
    pub top: HangTop,
    /// Height of a tie-back as a fraction of the height, 0: none. Tied to the left (-x) side.
    pub tie: f64,
    /// Seed.
    pub seed: u32,
}

/// A cloth that hangs in folds, from `y = height` down to `y = 0`, centred in x, its middle plane at z = 0.
pub fn hang(spec: &HangSpec) -> Cloth {
    let _ = spec;
    Cloth::default()
}
