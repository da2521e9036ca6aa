//! What every modelling function makes: a piece of surface with metric texture coordinates.

use glam::{DAffine3, DVec2, DVec3};

/// A triangle surface in metres. Vertices are split where normals or texture coordinates are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Piece {
    /// Positions.
    pub positions: Vec<DVec3>,
    /// Unit normals, one a position.
    pub normals: Vec<DVec3>,
    /// Unwrapped positions in metres, one a position: lengths along the surface, so that patterns keep their scale.
    pub uvs: Vec<DVec2>,
    /// Indices, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Whether the surface is watertight once equal positions are welded.
    pub closed: bool,
}

impl Piece {
    /// Adds another piece; closed only when both are.
    pub fn append(&mut self, other: &Self) {
        let base = self.positions.len() as u32;
        self.closed = (self.positions.is_empty() || self.closed) && other.closed;
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.uvs.extend_from_slice(&other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
    }

    /// Moves it; a reflection keeps it wound outwards. Texture coordinates stay as they are.
    pub fn transformed(mut self, map: &DAffine3) -> Self {
        let normal_map = map.matrix3.inverse().transpose();
        for p in &mut self.positions {
            *p = map.transform_point3(*p);
        }
        for n in &mut self.normals {
            *n = (normal_map * *n).normalize_or(DVec3::Y);
        }
        if map.matrix3.determinant() < 0.0 {
            for t in &mut self.triangles {
                t.swap(1, 2);
            }
        }
        self
    }

    /// Lowest and highest corner; `None` without positions.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold((first, first), |(lo, hi), p| (lo.min(*p), hi.max(*p))))
    }
}
