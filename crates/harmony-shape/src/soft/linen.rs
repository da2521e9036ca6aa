//! Rolled and folded cloths.

use crate::Piece;

/// A rolled sheet lying along x on `y = 0`: `width` long, `radius` outside, with `turns` that show at its ends.
pub fn roll(width: f64, radius: f64, turns: f64, thick: f64) -> Piece {
    let _ = (width, radius, turns, thick);
    Piece::default()
}

/// A folded cloth of width and depth `size` standing on `y = 0`: `layers` of `thick` with rounded folds at the front.
pub fn folded(size: [f64; 2], layers: u32, thick: f64, seed: u32) -> Piece {
    let _ = (size, layers, thick, seed);
    Piece::default()
}
