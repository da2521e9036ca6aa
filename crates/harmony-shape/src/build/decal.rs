//! Flat pieces laid on a side.

use glam::{DVec2, DVec3};

use super::Built;
use super::expand::outward;
use super::place::bvh;
use crate::Piece;
use crate::solid::Collector;
use crate::tree::Face;

/// Distance above the surface, metres.
const ABOVE: f64 = 8e-4;
/// Side of a cell, metres: on a can of 10 cm a chord of it lies a fifth of a millimetre inside.
const CELL: f64 = 0.008;
/// Most cells along a side.
const MAX_CELLS: usize = 48;

/// Right and up direction of a side seen from outside.
fn axes(face: Face) -> (DVec3, DVec3) {
    match face {
        Face::Front => (DVec3::X, DVec3::Y),
        Face::Back => (DVec3::NEG_X, DVec3::Y),
        Face::Right => (DVec3::NEG_Z, DVec3::Y),
        Face::Left => (DVec3::Z, DVec3::Y),
        Face::Top => (DVec3::X, DVec3::NEG_Z),
        Face::Bottom => (DVec3::X, DVec3::Z),
    }
}

/// A patch of `size` with its middle at the share `at` of the side, every point thrown onto the surface; texture
/// coordinates run from (0, 0) at the top left to the size. Where there is no surface, there is no decal.
pub(super) fn decal(child: &Built, face: Face, at: DVec2, size: DVec2) -> Result<Piece, String> {
    let (lo, hi) = child.bounds().ok_or("a decal needs something to lie on")?;
    let (right, up) = axes(face);
    let out_dir = outward(face);
    let middle = (lo + hi) / 2.0;
    let half = (hi - lo) / 2.0;
    let extent = |d: DVec3| (half * d).length();
    let centre = middle + right * ((2.0 * at.x - 1.0) * extent(right)) + up * ((2.0 * at.y - 1.0) * extent(up));
    let plane = centre + out_dir * (extent(out_dir) + 0.5);
    let bvh = bvh(child);
    let reach = 2.0 * extent(out_dir) + 1.0;
    let cells = |l: f64| ((l / CELL).ceil() as usize).clamp(1, MAX_CELLS);
    let (nu, nv) = (cells(size.x), cells(size.y));
    // a flat side needs one cell only: seen at its corners and middle
    let cast = |s: f64, t: f64| {
        let p = plane + right * ((s - 0.5) * size.x) + up * ((0.5 - t) * size.y);
        bvh.raycast(p, -out_dir, reach).map(|hit| {
            let n = if hit.normal.dot(out_dir) < 0.0 { -hit.normal } else { hit.normal };
            (p - out_dir * (hit.distance - ABOVE), n)
        })
    };
    // the border is looked up a hair inside, so that a decal as large as its side is whole
    let share = |k: usize, n: usize| (k as f64 / n as f64).clamp(2e-4, 1.0 - 2e-4);
    let grid: Vec<Option<(DVec3, DVec3)>> =
        (0..=nv).flat_map(|j| (0..=nu).map(move |i| (i, j))).map(|(i, j)| cast(share(i, nu), share(j, nv))).collect();
    let depth = |g: &Option<(DVec3, DVec3)>| g.as_ref().map(|(p, _)| p.dot(out_dir));
    let depths: Vec<f64> = grid.iter().filter_map(depth).collect();
    if depths.is_empty() {
        return Err("the decal lies beside its part; `at` are shares from 0 to 1 of the side".into());
    }
    let spread =
        depths.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b)) - depths.iter().fold(f64::INFINITY, |a, b| a.min(*b));
    let flat = depths.len() == grid.len() && spread < 2e-4;
    let mut out = Collector::new();
    let group = out.group();
    let (nu, nv, grid) = if flat {
        let corner = |i: usize, j: usize| grid[j * nv * (nu + 1) + i * nu];
        (1, 1, vec![corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)])
    } else {
        (nu, nv, grid)
    };
    let vertices: Vec<Option<(u32, f64)>> = grid
        .iter()
        .enumerate()
        .map(|(k, g)| {
            let (i, j) = (k % (nu + 1), k / (nu + 1));
            let uv = DVec2::new(size.x * i as f64 / nu as f64, size.y * j as f64 / nv as f64);
            g.map(|(p, n)| (out.vertex(group, p, n, uv), p.dot(out_dir)))
        })
        .collect();
    let step = (size.x / nu as f64).max(size.y / nv as f64);
    for j in 0..nv {
        for i in 0..nu {
            let k = j * (nu + 1) + i;
            // top left, bottom left, bottom right, top right
            let (Some(a), Some(b), Some(c), Some(d)) =
                (vertices[k], vertices[k + nu + 1], vertices[k + nu + 2], vertices[k + 1])
            else {
                continue;
            };
            let heights = [a.1, b.1, c.1, d.1];
            let jump = heights.iter().fold(f64::NEG_INFINITY, |m, h| m.max(*h))
                - heights.iter().fold(f64::INFINITY, |m, h| m.min(*h));
            if jump < 2.5 * step.max(0.004) {
                out.triangle([a.0, b.0, c.0]);
                out.triangle([a.0, c.0, d.0]);
            }
        }
    }
    Ok(out.finish())
}
