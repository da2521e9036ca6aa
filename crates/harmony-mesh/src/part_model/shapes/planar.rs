//! Extruded polygons.

use glam::{DVec2, DVec3};

use super::{runs, smooth_path};
use crate::part_model::solid::SolidBuilder;
use crate::part_model::{Axis, Part};

/// Pulls a polygon along an axis.
pub(super) fn extrude(b: &mut SolidBuilder, half: DVec3, part: &Part, axis: Axis) {
    let (u, v, w) = match axis {
        Axis::Z => (0, 1, 2),
        Axis::X => (2, 1, 0),
        Axis::Y => (0, 2, 1),
    };
    let given: Vec<DVec2> = part
        .points
        .as_deref()
        .unwrap_or(&[])
        .iter()
        .map(|p| DVec2::from_array(*p).clamp(DVec2::ZERO, DVec2::ONE))
        .collect();
    let smoothed = part.smooth.unwrap_or(false).then(|| {
        let curve = smooth_path(&given, 4, true);
        curve.into_iter().map(|p| p.clamp(DVec2::ZERO, DVec2::ONE)).collect()
    });
    let square = vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    let outline = [smoothed, Some(given), Some(square)]
        .into_iter()
        .flatten()
        .map(tidy)
        .find(|p| is_simple(p))
        .unwrap_or_default();
    let outline: Vec<DVec2> = outline.iter().map(|p| (*p * 2.0 - DVec2::ONE) * DVec2::new(half[u], half[v])).collect();
    let place = |p: DVec2, side: f64| {
        let mut out = DVec3::ZERO;
        out[u] = p.x;
        out[v] = p.y;
        out[w] = side * half[w];
        out
    };
    // in (u, v, w) coordinates; when these are left-handed the finished solid is turned outside out
    for run in runs(&outline, true) {
        let group = b.group();
        b.patch(group, run.len() - 1, 1, |i, j| place(outline[run[i]], j as f64 * 2.0 - 1.0));
    }
    let triangles = triangulate(&outline);
    let mut normal = DVec3::ZERO;
    normal[w] = 1.0;
    let handed = if axis == Axis::Z { 1.0 } else { -1.0 };
    let near: Vec<DVec3> = outline.iter().map(|p| place(*p, -1.0)).collect();
    let far: Vec<DVec3> = outline.iter().map(|p| place(*p, 1.0)).collect();
    let reversed: Vec<[u32; 3]> = triangles.iter().map(|t| [t[0], t[2], t[1]]).collect();
    b.flat(&near, -normal * handed, &reversed);
    b.flat(&far, normal * handed, &triangles);
    for piece in convex_pieces(&outline, &triangles) {
        b.piece(piece.iter().flat_map(|p| [place(*p, -1.0), place(*p, 1.0)]).collect());
    }
}

/// Without repeated points and points on straight lines, counter-clockwise.
pub(super) fn tidy(mut p: Vec<DVec2>) -> Vec<DVec2> {
    p.dedup_by(|a, b| a.distance(*b) < 1e-4);
    while p.len() > 1 && p[0].distance(p[p.len() - 1]) < 1e-4 {
        p.pop();
    }
    if area(&p) < 0.0 {
        p.reverse();
    }
    p
}

fn area(p: &[DVec2]) -> f64 {
    (0..p.len()).map(|i| p[i].perp_dot(p[(i + 1) % p.len()])).sum::<f64>() / 2.0
}

/// Whether a polygon has an area and does not meet itself.
pub(super) fn is_simple(p: &[DVec2]) -> bool {
    let n = p.len();
    if n < 3 || area(p).abs() < 1e-6 {
        return false;
    }
    let side = |a: DVec2, b: DVec2, c: DVec2| (b - a).perp_dot(c - a);
    let on = |a: DVec2, b: DVec2, c: DVec2| {
        // distance of c to the segment a-b
        let t = ((c - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        c.distance(a + (b - a) * t) < 1e-5
    };
    for i in 0..n {
        let (a, b) = (p[i], p[(i + 1) % n]);
        for j in i + 1..n {
            let (c, d) = (p[j], p[(j + 1) % n]);
            let next = j == i + 1;
            let wraps = (j + 1) % n == i;
            let meets = if next && wraps {
                false
            } else if next {
                on(a, b, d) || on(c, d, a)
            } else if wraps {
                on(a, b, c) || on(c, d, b)
            } else {
                on(a, b, c)
                    || on(a, b, d)
                    || on(c, d, a)
                    || on(c, d, b)
                    || (side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0)
            };
            if meets {
                return false;
            }
        }
    }
    true
}

/// Ear clipping of a simple counter-clockwise polygon; always `n - 2` triangles that use each edge once.
fn triangulate(p: &[DVec2]) -> Vec<[u32; 3]> {
    let mut left: Vec<usize> = (0..p.len()).collect();
    let mut out = Vec::with_capacity(p.len());
    while left.len() > 3 {
        let n = left.len();
        let corner = |k: usize| (left[(k + n - 1) % n], left[k], left[(k + 1) % n]);
        let turn = |k: usize| {
            let (a, b, c) = corner(k);
            (p[b] - p[a]).perp_dot(p[c] - p[b])
        };
        let clear = |k: usize| {
            let (a, b, c) = corner(k);
            left.iter().filter(|i| **i != a && **i != b && **i != c).all(|i| {
                let inside = |s: usize, e: usize| (p[e] - p[s]).perp_dot(p[*i] - p[s]) >= -1e-15;
                !(inside(a, b) && inside(b, c) && inside(c, a))
            })
        };
        // the best shaped ear, for even triangles
        let quality = |k: usize| {
            let (a, b, c) = corner(k);
            let longest = p[a].distance_squared(p[b]).max(p[b].distance_squared(p[c])).max(p[a].distance_squared(p[c]));
            turn(k) / longest
        };
        let ear = (0..n).filter(|k| turn(*k) > 0.0 && clear(*k)).max_by(|a, b| quality(*a).total_cmp(&quality(*b)));
        let k = ear.unwrap_or_else(|| (0..n).max_by(|a, b| turn(*a).total_cmp(&turn(*b))).unwrap_or(0));
        let (a, b, c) = corner(k);
        out.push([a as u32, b as u32, c as u32]);
        left.remove(k);
    }
    if let [a, b, c] = left[..] {
        out.push([a as u32, b as u32, c as u32]);
    }
    out
}

/// Joins triangles to convex polygons (Hertel and Mehlhorn 1983, greedily).
fn convex_pieces(p: &[DVec2], triangles: &[[u32; 3]]) -> Vec<Vec<DVec2>> {
    let mut polygons: Vec<Vec<u32>> = triangles.iter().map(|t| t.to_vec()).collect();
    let convex = |poly: &[u32]| {
        let n = poly.len();
        (0..n).all(|k| {
            let [a, b, c] = [poly[k], poly[(k + 1) % n], poly[(k + 2) % n]].map(|i| p[i as usize]);
            (b - a).perp_dot(c - b) >= -1e-9
        })
    };
    'again: loop {
        for i in 0..polygons.len() {
            for j in i + 1..polygons.len() {
                if let Some(joined) = join(&polygons[i], &polygons[j]).filter(|q| convex(q)) {
                    polygons[i] = joined;
                    polygons.remove(j);
                    continue 'again;
                }
            }
        }
        break;
    }
    polygons.iter().map(|q| q.iter().map(|i| p[*i as usize]).collect()).collect()
}

/// One polygon from two that share an edge.
fn join(a: &[u32], b: &[u32]) -> Option<Vec<u32>> {
    let (n, m) = (a.len(), b.len());
    for i in 0..n {
        let (s, e) = (a[i], a[(i + 1) % n]);
        for j in 0..m {
            if b[j] == e && b[(j + 1) % m] == s {
                let mut out: Vec<u32> = (0..n).map(|k| a[(i + 1 + k) % n]).collect();
                out.extend((2..m).map(|k| b[(j + k) % m]));
                return Some(out);
            }
        }
    }
    None
}
