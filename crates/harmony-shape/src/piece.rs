//! What every modelling function makes: a piece of surface with metric texture coordinates.

use std::collections::HashMap;

use glam::{DAffine3, DVec2, DVec3};

/// Positions closer than about this count as the same, metres.
const WELD: f64 = 1e-6;

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
    /// Whether it is wound outwards though it is open, as turned walls are; else whoever wrote its points did not think of it.
    pub outwards: bool,
}

impl Piece {
    /// Adds another piece; closed only when both are.
    pub fn append(&mut self, other: &Self) {
        let base = self.positions.len() as u32;
        let first = self.positions.is_empty();
        self.closed = (first || self.closed) && other.closed;
        self.outwards = (first || self.outwards) && other.outwards;
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.uvs.extend_from_slice(&other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
    }

    /// Moves it; a reflection keeps it wound outwards. Texture coordinates stay as they are.
    #[must_use]
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

    /// Corners of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|i| self.positions[i as usize]))
    }

    /// Surface area, square metres.
    pub fn area(&self) -> f64 {
        self.corners().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
    }

    /// Signed volume, cubic metres: positive when wound outwards; meaningless for open pieces.
    pub fn volume(&self) -> f64 {
        // about a point of the piece: far from the origin the terms would cancel badly
        let o = self.positions.first().copied().unwrap_or_default();
        self.corners().map(|[a, b, c]| (a - o).dot((b - o).cross(c - o)) / 6.0).sum()
    }

    /// The other side out: windings and normals reversed.
    #[must_use]
    pub fn flipped(mut self) -> Self {
        for t in &mut self.triangles {
            t.swap(1, 2);
        }
        for n in &mut self.normals {
            *n = -*n;
        }
        self
    }

    /// For each position the index of the first one at the same place (within a micrometre).
    pub fn welded(&self) -> Vec<u32> {
        let mut first: HashMap<[i64; 3], u32> = HashMap::with_capacity(self.positions.len());
        self.positions.iter().enumerate().map(|(i, p)| *first.entry(weld_key(*p)).or_insert(i as u32)).collect()
    }

    /// Whether every edge, positions welded, has its opposite: triangles close a volume and are wound alike.
    pub fn is_watertight(&self) -> bool {
        let weld = self.welded();
        let mut balance: HashMap<(u32, u32), i32> = HashMap::with_capacity(self.triangles.len() * 2);
        for t in &self.triangles {
            let t = t.map(|i| weld[i as usize]);
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                if a != b {
                    *balance.entry((a.min(b), a.max(b))).or_insert(0) += if a < b { 1 } else { -1 };
                }
            }
        }
        !self.triangles.is_empty() && balance.values().all(|n| *n == 0)
    }

    /// Moves every position by `f` and turns the normals by its local linear part, found by small differences.
    /// Texture coordinates stay.
    #[must_use]
    pub fn deformed(mut self, f: impl Fn(DVec3) -> DVec3) -> Self {
        const STEP: f64 = 1e-5;
        for (p, n) in self.positions.iter_mut().zip(&mut self.normals) {
            let along = |d: DVec3| (f(*p + d * STEP) - f(*p - d * STEP)) / (2.0 * STEP);
            let (x, y, z) = (along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
            // cofactor matrix: the inverse transpose but for the determinant, whose sign is kept
            let turned = y.cross(z) * n.x + z.cross(x) * n.y + x.cross(y) * n.z;
            let sign = if x.dot(y.cross(z)) < 0.0 { -1.0 } else { 1.0 };
            *n = (turned * sign).normalize_or(*n);
            *p = f(*p);
        }
        self
    }
}

/// Cell of a position; the shift keeps round numbers away from cell borders.
pub(crate) fn weld_key(p: DVec3) -> [i64; 3] {
    [p.x, p.y, p.z].map(|v| (v / WELD + 0.37).floor() as i64)
}
