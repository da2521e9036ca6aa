//! Finer triangles where a shape will be bent, and bending with the normals carried along.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DVec3};

use super::grid::weld;
use crate::Piece;

/// Divides triangles that `wanted` picks (by their middle) until no edge of them is longer than `limit`, or `most`
/// triangles are there. Neighbours are divided along, so that no gaps open.
pub(super) fn refine(piece: &Piece, limit: f64, most: usize, wanted: impl Fn(DVec3) -> bool) -> Piece {
    let mut out = piece.clone();
    for _ in 0..12 {
        let group = weld(&out.positions);
        let mut marked: BTreeSet<(u32, u32)> = BTreeSet::new();
        let name = |a: u32, b: u32| {
            let (a, b) = (group[a as usize], group[b as usize]);
            (a.min(b), a.max(b))
        };
        for t in &out.triangles {
            let p = t.map(|i| out.positions[i as usize]);
            if !wanted((p[0] + p[1] + p[2]) / 3.0) {
                continue;
            }
            for k in 0..3 {
                if p[k].distance(p[(k + 1) % 3]) > limit {
                    marked.insert(name(t[k], t[(k + 1) % 3]));
                }
            }
        }
        if marked.is_empty() || out.triangles.len() + marked.len() * 2 > most {
            break;
        }
        let mut middle: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut triangles = Vec::with_capacity(out.triangles.len() * 2);
        for t in std::mem::take(&mut out.triangles) {
            let mut mid = [None; 3];
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                if marked.contains(&name(a, b)) {
                    mid[k] = Some(*middle.entry((a.min(b), a.max(b))).or_insert_with(|| halfway(&mut out, a, b)));
                }
            }
            split(&out.positions, t, mid, &mut triangles);
        }
        out.triangles = triangles;
    }
    out
}

fn halfway(piece: &mut Piece, a: u32, b: u32) -> u32 {
    let (a, b) = (a as usize, b as usize);
    piece.positions.push((piece.positions[a] + piece.positions[b]) * 0.5);
    piece.normals.push((piece.normals[a] + piece.normals[b]).normalize_or(piece.normals[a]));
    piece.uvs.push((piece.uvs[a] + piece.uvs[b]) * 0.5);
    piece.positions.len() as u32 - 1
}

/// Replaces a triangle by the pieces that the middles of its edges (first edge from the first corner) make.
fn split(at: &[DVec3], t: [u32; 3], mid: [Option<u32>; 3], into: &mut Vec<[u32; 3]>) {
    let [a, b, c] = t;
    match mid {
        [None, None, None] => into.push(t),
        [Some(p), Some(q), Some(r)] => into.extend([[a, p, r], [p, b, q], [r, q, c], [p, q, r]]),
        [Some(p), None, None] => into.extend([[a, p, c], [p, b, c]]),
        [Some(p), Some(q), None] => {
            into.push([p, b, q]);
            let d = |i: u32, j: u32| at[i as usize].distance_squared(at[j as usize]);
            if d(a, q) < d(p, c) {
                into.extend([[a, p, q], [a, q, c]]);
            } else {
                into.extend([[a, p, c], [p, q, c]]);
            }
        }
        // The same with the corners turned.
        [None, q, r] => split(at, [b, c, a], [q, r, None], into),
        [p, None, r] => split(at, [c, a, b], [r, p, None], into),
    }
}

/// Moves every position by `f` and turns the normals by its derivative.
pub(super) fn deform(piece: &mut Piece, f: impl Fn(DVec3) -> DVec3) {
    const H: f64 = 2e-4;
    for (p, n) in piece.positions.iter_mut().zip(&mut piece.normals) {
        let slope = |axis: DVec3| (f(*p + axis * H) - f(*p - axis * H)) / (2.0 * H);
        let j = DMat3::from_cols(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
        // The cofactor matrix carries areas; it works where the map is flat in one direction, too.
        let cofactor = DMat3::from_cols(j.y_axis.cross(j.z_axis), j.z_axis.cross(j.x_axis), j.x_axis.cross(j.y_axis));
        *n = (cofactor * *n).normalize_or(*n);
        *p = f(*p);
    }
}

#[cfg(test)]
mod tests {
    use super::super::collider::tests::block;
    use super::super::grid::testing::{open_edges, volume};
    use super::*;

    #[test]
    fn refined_boxes_stay_closed_and_of_the_same_volume() {
        let b = block(DVec3::ZERO, DVec3::new(1.0, 0.3, 0.5));
        let fine = refine(&b, 0.05, 100_000, |p| p.x > 0.7);
        assert_eq!(open_edges(&fine), 0);
        assert!((volume(&fine) - 0.15).abs() < 1e-12);
        for t in &fine.triangles {
            let p = t.map(|i| fine.positions[i as usize]);
            let longest = (0..3).map(|k| p[k].distance(p[(k + 1) % 3])).fold(0.0, f64::max);
            assert!((p[0] + p[1] + p[2]).x / 3.0 <= 0.7 || longest <= 0.05, "{longest}");
        }
        assert!(fine.triangles.len() > 300);
    }

    #[test]
    fn bent_normals_stay_square_to_the_surface() {
        let mut p = refine(&block(DVec3::ZERO, DVec3::ONE), 0.02, 100_000, |p| p.y > 0.99);
        for n in &mut p.normals {
            *n = DVec3::Y;
        }
        deform(&mut p, |p| p + DVec3::Y * (0.1 * libm::sin(5.0 * p.x)) * p.y);
        for (p, n) in p.positions.iter().zip(&p.normals).filter(|(p, _)| p.y > 0.8) {
            let slope = 0.5 * libm::cos(5.0 * p.x);
            assert!(n.distance(DVec3::new(-slope, 1.0, 0.0).normalize()) < 1e-3);
        }
    }
}
