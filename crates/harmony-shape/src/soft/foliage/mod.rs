//! Leaves and plants.

use crate::Piece;
use crate::tree::PlantKind;

/// Arguments of [`plant`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantSpec {
    /// How it grows.
    pub kind: PlantKind,
    /// Height.
    pub height: f64,
    /// Diameter.
    pub spread: f64,
    /// Leaves, fronds or stems; 0: as many as usual.
    pub count: u32,
    /// Seed.
    pub seed: u32,
}

/// A plant: three pieces for three materials.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plant {
    /// Leaves (open sheets, to be drawn from both sides).
    pub leaves: Piece,
    /// Stems, trunk, branches.
    pub stems: Piece,
    /// Flowers; empty where there are none.
    pub flowers: Piece,
}

/// One leaf from the origin along +z, its upper side +y: an open sheet, to be drawn from both sides.
///
/// `size`: length and width. `shape`: `oval`, `lance`, `heart`, `round`, `lobed`, `blade`; anything else is `oval`.
/// `fold_deg` folds the halves up along the midrib, `curl_deg` bends the tip down over the whole length.
pub fn leaf(size: [f64; 2], shape: &str, fold_deg: f64, curl_deg: f64) -> Piece {
    let _ = (size, shape, fold_deg, curl_deg);
    Piece::default()
}

/// A plant without pot growing from the origin, within its height and diameter (a vine hangs below `y = 0` as well).
///
/// `leaf`: a leaf to use instead of the usual one, from the origin along +z; it keeps its size.
pub fn plant(spec: &PlantSpec, leaf: Option<&Piece>) -> Plant {
    let _ = (spec, leaf);
    Plant::default()
}
