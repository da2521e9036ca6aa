//! Hanging cloth.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::part_model::Part;
use crate::part_model::solid::SolidBuilder;

/// A sheet hanging along -Y with folds across x; folds are shallower at the top, where it is gathered.
pub(super) fn cloth(b: &mut SolidBuilder, half: DVec3, part: &Part) {
    let folds = f64::from(part.folds.unwrap_or(6).clamp(1, 40));
    let columns = (folds as usize * 8).clamp(8, 160);
    let rows = 6;
    let thickness = (half.z * 0.12).min(0.006).max(half.z * 0.02);
    let seed = f64::from(part.seed.unwrap_or(1) % 97);
    let sheet = |i: usize, j: usize, side: f64| {
        let (s, t) = (i as f64 / columns as f64, j as f64 / rows as f64);
        // folds wander a little from top to bottom and are not all equally wide
        let wander = 0.35 * (TAU * (s * 1.7 + 0.13 * seed)).sin() + 0.25 * (1.0 - t) * (TAU * (s * 2.3 + seed)).cos();
        let phase = TAU * folds * s + wander;
        let deep = 0.7 + 0.3 * (1.0 - t);
        let deep = deep * (0.85 + 0.15 * (TAU * (s * 3.1 + 0.37 * seed)).sin());
        let sway = 0.06 * (1.0 - t).powi(2) * (TAU * (s * folds * 0.5 + seed)).sin();
        let z = (phase.sin() + sway) * deep / 1.06 * (half.z - thickness);
        DVec3::new((2.0 * s - 1.0) * half.x, (2.0 * t - 1.0) * half.y, z + side * thickness)
    };
    let front = b.group();
    b.patch(front, columns, rows, |i, j| sheet(i, j, 1.0));
    let rear = b.group();
    b.patch(rear, rows, columns, |j, i| sheet(i, j, -1.0));
    let hem = b.group();
    b.patch(hem, columns, 1, |i, k| sheet(i, 0, k as f64 * 2.0 - 1.0));
    let heading = b.group();
    b.patch(heading, columns, 1, |i, k| sheet(i, rows, 1.0 - k as f64 * 2.0));
    let left = b.group();
    b.patch(left, 1, rows, |k, j| sheet(0, j, k as f64 * 2.0 - 1.0));
    let right = b.group();
    b.patch(right, 1, rows, |k, j| sheet(columns, j, 1.0 - k as f64 * 2.0));
    b.piece_of_all();
}
