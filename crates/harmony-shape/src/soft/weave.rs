//! Strands: braids, basket work, wire nets.

use glam::DVec3;

use crate::Piece;
use crate::tree::Outline;

/// `strands` plaited along a polyline, the whole of `radius`, one turn in `pitch` metres.
pub fn braid(curve: &[DVec3], closed: bool, radius: f64, strands: u32, pitch: f64) -> Piece {
    let _ = (curve, closed, radius, strands, pitch);
    Piece::default()
}

/// A piece's surface as basket work instead of the piece: strands of `radius`, `cell` apart, over and under.
pub fn wicker(child: &Piece, cell: f64, radius: f64) -> Piece {
    let _ = (child, cell, radius);
    Piece::default()
}

/// A wire net within an outline, in the xy plane, with a rim along the outline and its holes.
pub fn wire_net(outline: &Outline, pitch: f64, radius: f64) -> Piece {
    let _ = (outline, pitch, radius);
    Piece::default()
}
