//! Leaves and plants.

mod grow;
mod leaf;
mod stem;
#[cfg(test)]
mod tests;

use crate::Piece;
use crate::tree::PlantKind;

pub use leaf::leaf;

/// Arguments of [`plant`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantSpec {
    /// How it grows.
    pub kind: PlantKind,
    /// Height; of a vine the whole height, four fifths of which hang below `y = 0`.
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

/// A plant without pot growing from the origin, within its height and diameter (a vine hangs below `y = 0` as well).
///
/// `leaf`: a leaf to use instead of the usual one, from the origin along +z, about as long as it is meant to be; it is
/// scaled with the plant. Fronds of ferns and palms and blades of grass are always their own.
pub fn plant(spec: &PlantSpec, leaf: Option<&Piece>) -> Plant {
    let spec = &PlantSpec { height: spec.height.clamp(0.02, 12.0), spread: spec.spread.clamp(0.02, 12.0), ..*spec };
    let mut growth = grow::Growth::new(spec, leaf);
    match spec.kind {
        PlantKind::Bush => growth.bush(),
        PlantKind::Rosette => growth.rosette(),
        PlantKind::Fern => growth.fern(),
        PlantKind::Vine => growth.vine(),
        PlantKind::Succulent => growth.succulent(),
        PlantKind::Palm => growth.palm(),
        PlantKind::Grass => growth.grass(),
        PlantKind::Flowers => growth.flowers(),
        PlantKind::Tree => growth.tree(),
    }
    growth.fitted()
}
