//! Stems as curves.

use glam::DVec3;

use super::super::grid::{along, lengths, tube};
use crate::Piece;

/// A stem: points from its base to its tip.
#[derive(Debug, Clone)]
pub(super) struct Stem {
    points: Vec<DVec3>,
    lengths: Vec<f64>,
}

impl Stem {
    /// Grown from a place in steps: at each step the direction bends by `pull` (a vector, a step's worth of it).
    pub fn grown(from: DVec3, direction: DVec3, length: f64, steps: usize, pull: impl Fn(f64) -> DVec3) -> Self {
        let step = length / steps as f64;
        let (mut at, mut d) = (from, direction.normalize_or(DVec3::Y));
        let mut points = vec![at];
        for k in 0..steps {
            d = (d + pull(k as f64 / steps as f64) / steps as f64).normalize_or(d);
            at += d * step;
            points.push(at);
        }
        let lengths = lengths(&points);
        Self { points, lengths }
    }

    /// Place and direction at a fraction of the length.
    pub fn at(&self, t: f64) -> (DVec3, DVec3) {
        let whole = self.lengths.last().copied().unwrap_or(0.0);
        along(&self.points, &self.lengths, t.clamp(0.0, 1.0) * whole)
    }

    /// Draws it, thinner towards the tip.
    pub fn draw(&self, into: &mut Piece, base: f64, tip: f64, sides: u32) {
        let n = self.points.len();
        let radii: Vec<f64> = (0..n).map(|k| base + (tip - base) * k as f64 / (n - 1).max(1) as f64).collect();
        tube(into, &self.points, &radii, sides, false);
    }
}
