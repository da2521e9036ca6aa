//! Pillows: two sheets sewn at the seam and filled.

use crate::Piece;

/// Arguments of [`pillow`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PillowSpec {
    /// Width (x), depth (z), greatest thickness (y).
    pub size: [f64; 3],
    /// 0 smooth to 1 crumpled.
    pub wrinkle: f64,
    /// Radius of the piping, 0: none.
    pub piping: f64,
    /// How far the corners stand out, 0 to 1.
    pub ears: f64,
    /// Dent of the middle of the upper edge (-z: up once it leans), 0 to 1.
    pub dent: f64,
    /// Seed.
    pub seed: u32,
}

/// A pillow lying flat on `y = 0`, closed, within its width, depth and thickness.
pub fn pillow(spec: &PillowSpec) -> Piece {
    let _ = spec;
    Piece::default()
}
