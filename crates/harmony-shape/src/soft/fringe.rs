//! Threads, tassels and pompoms along an edge.

use glam::DVec3;

use crate::Piece;
use crate::tree::FringeKind;

/// Arguments of [`fringe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FringeSpec {
    /// Which.
    pub kind: FringeKind,
    /// Length.
    pub length: f64,
    /// Distance between them.
    pub spacing: f64,
    /// 0 to 1.
    pub jitter: f64,
    /// Seed.
    pub seed: u32,
}

/// A fringe that hangs down (-y) from a polyline; `closed` joins its end to its start.
///
/// What would pass through the floor at `y = 0` lies on it instead when the edge itself is above it.
pub fn fringe(along: &[DVec3], closed: bool, spec: &FringeSpec) -> Piece {
    let _ = (along, closed, spec);
    Piece::default()
}
