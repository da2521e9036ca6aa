//! Parts of an object that move against it, as whoever modelled it has said.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// How a part moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Turns about an axis.
    Hinge,
    /// Slides along an axis.
    Slide,
}

/// A part that moves, in the canonical frame of its object's mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MovingPart {
    /// What it is called; may be empty.
    pub name: String,
    /// How it moves.
    pub motion: Motion,
    /// Axis, unit.
    pub axis: DVec3,
    /// A point of the axis.
    pub pivot: DVec3,
    /// Least and greatest value: degrees, by the right hand about the axis, or the mesh's units. The mesh stands at 0.
    pub range: [f64; 2],
    /// Lowest and highest corners of the pieces that move: triangles within one of them do.
    pub boxes: Vec<[DVec3; 2]>,
}
