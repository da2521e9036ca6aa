//! Hairy surfaces.

use crate::Piece;
use crate::tree::FuzzKind;

/// The hairs of a piece, without the piece itself; at most 40 000 triangles.
///
/// `length` of the hairs; `density` 0 to 1 of what the kind would have.
pub fn fuzz(child: &Piece, kind: FuzzKind, length: f64, density: f64, seed: u32) -> Piece {
    let _ = (child, kind, length, density, seed);
    Piece::default()
}
