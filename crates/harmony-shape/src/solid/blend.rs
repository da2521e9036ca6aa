//! Smooth unions by surface nets.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use super::collect::Collector;
use super::field::Field;
use super::project::box_projected;
use crate::Piece;

/// Cells along the longest side.
const CELLS: f64 = 56.0;
/// Smallest cell, metres.
const MIN_CELL: f64 = 8e-4;
/// Side of the blocks in which far away space is skipped, cells.
const BLOCK: usize = 8;

/// One solid of a blend.
#[derive(Debug, Clone)]
pub struct Blob {
    /// Its distance.
    pub field: Field,
    /// Lowest corner of its bounds.
    pub lo: DVec3,
    /// Highest corner of its bounds.
    pub hi: DVec3,
}

/// The smooth union of solids: joints are rounded over about `radius`. Surface nets (Gibson 1998), vertices moved onto
/// the surface along its gradient; texture coordinates by box projection.
///
/// # Errors
/// When there is nothing to blend or nothing is left of it.
pub fn blend(blobs: &[Blob], radius: f64) -> Result<Piece, String> {
    if blobs.is_empty() {
        return Err("nothing to blend".into());
    }
    let lo = blobs.iter().fold(DVec3::INFINITY, |a, b| a.min(b.lo));
    let hi = blobs.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(b.hi));
    let size = hi - lo;
    let cell = (size.max_element() / CELLS).max(MIN_CELL);
    let margin = cell * 2.0 + radius * 0.25;
    let start = lo - DVec3::splat(margin);
    let n = ((size + DVec3::splat(2.0 * margin)) / cell).ceil().as_usizevec3() + glam::USizeVec3::splat(2);
    let (nx, ny, nz) = (n.x, n.y, n.z);
    let field = Field::United(blobs.iter().map(|b| b.field.clone()).collect(), radius);
    let at = |i: usize, j: usize, k: usize| start + DVec3::new(i as f64, j as f64, k as f64) * cell;
    let index = |i: usize, j: usize, k: usize| (k * ny + j) * nx + i;
    let mut values = vec![0.0_f64; nx * ny * nz];
    for k0 in (0..nz).step_by(BLOCK) {
        for j0 in (0..ny).step_by(BLOCK) {
            for i0 in (0..nx).step_by(BLOCK) {
                let half = (BLOCK - 1) as f64 / 2.0;
                let middle = start + (DVec3::new(i0 as f64, j0 as f64, k0 as f64) + DVec3::splat(half)) * cell;
                let far = field.at(middle);
                let skip = far.abs() > 2.0 * (half + 1.0) * 1.733 * cell + radius;
                for k in k0..(k0 + BLOCK).min(nz) {
                    for j in j0..(j0 + BLOCK).min(ny) {
                        for i in i0..(i0 + BLOCK).min(nx) {
                            values[index(i, j, k)] = if skip { far } else { field.at(at(i, j, k)) };
                        }
                    }
                }
            }
        }
    }
    let mut out = Collector::new();
    let group = out.group();
    let mut vertex: HashMap<usize, u32> = HashMap::new();
    for k in 0..nz - 1 {
        for j in 0..ny - 1 {
            for i in 0..nx - 1 {
                let Some(p) = crossing(|a, b, c| values[index(i + a, j + b, k + c)]) else { continue };
                let mut p = at(i, j, k) + p * cell;
                for _ in 0..3 {
                    let g = field.gradient(p, cell * 0.05);
                    let step = g * (field.at(p) / g.length_squared().max(1e-3));
                    p -= step.clamp_length_max(cell * 0.5);
                }
                let normal = field.gradient(p, cell * 0.1).normalize_or(DVec3::Y);
                vertex.insert(index(i, j, k), out.vertex(group, p, normal, DVec2::ZERO));
            }
        }
    }
    // a quad around every edge that crosses the surface
    for k in 1..nz - 1 {
        for j in 1..ny - 1 {
            for i in 1..nx - 1 {
                let here = values[index(i, j, k)] < 0.0;
                for axis in 0..3 {
                    let next = [index(i + 1, j, k), index(i, j + 1, k), index(i, j, k + 1)][axis];
                    if here == (values[next] < 0.0) {
                        continue;
                    }
                    let cells = match axis {
                        0 => [index(i, j - 1, k - 1), index(i, j, k - 1), index(i, j, k), index(i, j - 1, k)],
                        1 => [index(i - 1, j, k - 1), index(i - 1, j, k), index(i, j, k), index(i, j, k - 1)],
                        _ => [index(i - 1, j - 1, k), index(i, j - 1, k), index(i, j, k), index(i - 1, j, k)],
                    };
                    let corners: Vec<u32> = cells.iter().filter_map(|c| vertex.get(c).copied()).collect();
                    if let [a, b, c, d] = corners[..] {
                        if here {
                            out.triangle([a, b, c]);
                            out.triangle([a, c, d]);
                        } else {
                            out.triangle([a, c, b]);
                            out.triangle([a, d, c]);
                        }
                    }
                }
            }
        }
    }
    let piece = out.finish();
    if piece.triangles.is_empty() {
        return Err("nothing is left of the blend; its solids are thinner than a fiftieth of the whole".into());
    }
    Ok(box_projected(&piece))
}

/// Mean of the crossings of a cell's edges, in cells; `None` when the surface does not pass.
fn crossing(value: impl Fn(usize, usize, usize) -> f64) -> Option<DVec3> {
    let corners: [(DVec3, f64); 8] = std::array::from_fn(|c| {
        let (x, y, z) = (c & 1, (c >> 1) & 1, (c >> 2) & 1);
        (DVec3::new(x as f64, y as f64, z as f64), value(x, y, z))
    });
    let mut sum = DVec3::ZERO;
    let mut count = 0.0;
    for a in 0..8_usize {
        for bit in [1, 2, 4] {
            let b = a | bit;
            if b == a {
                continue;
            }
            let ((pa, va), (pb, vb)) = (corners[a], corners[b]);
            if (va < 0.0) != (vb < 0.0) {
                sum += pa.lerp(pb, va / (va - vb));
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum / count)
}
