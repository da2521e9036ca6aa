//! A cloth that falls over what lies below it.

use super::Cloth;
use crate::Piece;

/// Arguments of [`drape`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrapeSpec {
    /// Width (x) and length (z) of the flat cloth.
    pub size: [f64; 2],
    /// Middle of the cloth in x and z.
    pub at: [f64; 2],
    /// Turn about y, degrees, counter-clockwise seen from above.
    pub turn_deg: f64,
    /// 0 smooth to 1 rumpled.
    pub rumple: f64,
    /// Thickness.
    pub thick: f64,
    /// Length of the head end (-z before the turn) that is folded back over the rest, 0: none.
    pub fold: f64,
    /// 0 limp to 1 stiff.
    pub stiff: f64,
    /// Seed.
    pub seed: u32,
}

/// Lets a cloth fall over pieces and the floor at `y = 0`, in the pieces' coordinates.
///
/// `below` is everything it may meet, earlier cloths with them.
///
/// # Errors
/// When the cloth has no area or no finite place, with what would do.
pub fn drape(spec: &DrapeSpec, below: &[&Piece]) -> Result<Cloth, String> {
    let _ = (spec, below);
    Ok(Cloth::default())
}
