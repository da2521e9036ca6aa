//! Meshes from grids, tubes and balls.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use crate::Piece;

/// Turns a vector about a unit axis (Rodrigues), radians.
pub(super) fn turn(v: DVec3, axis: DVec3, angle: f64) -> DVec3 {
    let (s, c) = libm::sincos(angle);
    v * c + axis.cross(v) * s + axis * (axis.dot(v) * (1.0 - c))
}

/// A unit vector square to a unit vector.
pub(super) fn square_to(v: DVec3) -> DVec3 {
    let other = if v.x.abs() < 0.7 { DVec3::X } else { DVec3::Y };
    v.cross(other).normalize_or(DVec3::Z)
}

/// Adds a vertex.
pub(super) fn push(piece: &mut Piece, p: DVec3, n: DVec3, uv: DVec2) -> u32 {
    let index = piece.positions.len() as u32;
    piece.positions.push(p);
    piece.normals.push(n);
    piece.uvs.push(uv);
    index
}

/// A number for every position, the same for positions that are equal.
pub(super) fn weld(positions: &[DVec3]) -> Vec<u32> {
    let key = |i: &u32| {
        let p = positions[*i as usize] + DVec3::ZERO; // -0 becomes 0
        [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()]
    };
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_by_key(|i| (key(i), *i));
    let mut group = vec![0; positions.len()];
    let mut first = 0;
    for (k, i) in order.iter().enumerate() {
        if k == 0 || key(i) != key(&order[k - 1]) {
            first = *i;
        }
        group[*i as usize] = first;
    }
    group
}

/// Replaces the normals by area-weighted ones, smooth wherever positions are equal.
pub(super) fn smooth_normals(piece: &mut Piece) {
    let group = weld(&piece.positions);
    let mut sums = vec![DVec3::ZERO; piece.positions.len()];
    for t in &piece.triangles {
        let [a, b, c] = t.map(|i| piece.positions[i as usize]);
        let n = (b - a).cross(c - a);
        for i in t {
            sums[group[*i as usize] as usize] += n;
        }
    }
    piece.normals = group.iter().map(|g| sums[*g as usize].normalize_or(DVec3::Y)).collect();
}

/// Triangles of a grid of points, `nu` a row; rows go towards the viewer's right-hand turn: `u x v` is the outside.
pub(super) fn grid_triangles(nu: u32, nv: u32, base: u32, into: &mut Vec<[u32; 3]>) {
    for j in 0..nv.saturating_sub(1) {
        for i in 0..nu.saturating_sub(1) {
            let a = base + j * nu + i;
            let (b, c, d) = (a + 1, a + nu + 1, a + nu);
            // Alternating diagonals leave no grain in the shading.
            if (i + j) % 2 == 0 {
                into.extend([[a, b, c], [a, c, d]]);
            } else {
                into.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
}

/// An open sheet from a grid of points, its normals towards `u x v`.
pub(super) fn sheet(points: Vec<DVec3>, uvs: Vec<DVec2>, nu: u32) -> Piece {
    let nv = points.len() as u32 / nu.max(1);
    let mut piece = Piece {
        normals: vec![DVec3::Y; points.len()],
        positions: points,
        uvs,
        triangles: Vec::new(),
        closed: false,
        outwards: false,
    };
    grid_triangles(nu, nv, 0, &mut piece.triangles);
    smooth_normals(&mut piece);
    piece
}

/// Lengths along a polyline up to each point.
pub(super) fn lengths(points: &[DVec3]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut out = Vec::with_capacity(points.len());
    for (i, p) in points.iter().enumerate() {
        if i > 0 {
            sum += p.distance(points[i - 1]);
        }
        out.push(sum);
    }
    out
}

/// The point at a length along a polyline and the direction there.
pub(super) fn along(points: &[DVec3], lengths: &[f64], s: f64) -> (DVec3, DVec3) {
    let last = points.len().saturating_sub(1);
    if last == 0 {
        return (points.first().copied().unwrap_or_default(), DVec3::X);
    }
    let k = lengths.partition_point(|l| *l <= s).clamp(1, last);
    let (a, b) = (points[k - 1], points[k]);
    let t = ((s - lengths[k - 1]) / (lengths[k] - lengths[k - 1]).max(1e-12)).clamp(0.0, 1.0);
    (a.lerp(b, t), (b - a).normalize_or(DVec3::X))
}

/// Directions of a polyline at its points.
fn tangents(points: &[DVec3], closed: bool) -> Vec<DVec3> {
    let n = points.len();
    (0..n)
        .map(|i| {
            let before = if i > 0 {
                i - 1
            } else if closed {
                n - 1
            } else {
                0
            };
            let after = if i + 1 < n {
                i + 1
            } else if closed {
                0
            } else {
                n - 1
            };
            (points[after] - points[before]).normalize_or(DVec3::Y)
        })
        .collect()
}

/// A tube around a polyline, `radii` one a point, with flat-fanned pointed ends; closed as a solid.
///
/// Frames are carried along without twist (each turned onto the next tangent).
pub(super) fn tube(piece: &mut Piece, points: &[DVec3], radii: &[f64], sides: u32, closed: bool) {
    let n = points.len();
    if n < 2 || sides < 3 {
        return;
    }
    let tangent = tangents(points, closed);
    let length = lengths(points);
    let mut side = square_to(tangent[0]);
    let mut frames = Vec::with_capacity(n + 1);
    for t in &tangent {
        side = (side - *t * side.dot(*t)).normalize_or(square_to(*t));
        frames.push(side);
    }
    // What twist is left where a closed tube meets itself is spread over its length.
    let mut twist = 0.0;
    if closed {
        let back = (side - tangent[0] * side.dot(tangent[0])).normalize_or(frames[0]);
        twist = libm::atan2(tangent[0].dot(back.cross(frames[0])), back.dot(frames[0]));
    }
    let rings = if closed { n + 1 } else { n };
    let base = piece.positions.len() as u32;
    let whole = length[n - 1] + if closed { points[n - 1].distance(points[0]) } else { 0.0 };
    for ring in 0..rings {
        let i = ring % n;
        let v = if ring == n { whole } else { length[i] };
        let r = radii[i.min(radii.len() - 1)];
        let a = turn(frames[i], tangent[i], if ring == n { 0.0 } else { twist * v / whole.max(1e-12) });
        let b = tangent[i].cross(a);
        for k in 0..=sides {
            let angle = TAU * f64::from(k % sides) / f64::from(sides);
            let (s, c) = libm::sincos(angle);
            let normal = a * c + b * s;
            push(piece, points[i] + normal * r, normal, DVec2::new(TAU * r * f64::from(k) / f64::from(sides), v));
        }
    }
    let row = sides + 1;
    for ring in 0..rings as u32 - 1 {
        for k in 0..sides {
            let a = base + ring * row + k;
            piece.triangles.extend([[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]);
        }
    }
    if !closed {
        for (i, outward) in [(0, -tangent[0]), (n - 1, tangent[n - 1])] {
            let r = radii[i.min(radii.len() - 1)];
            if r < 1e-6 {
                continue;
            }
            let ring = base + i as u32 * row;
            let tip = push(piece, points[i] + outward * (r * 0.4), outward, DVec2::new(0.0, length[i]));
            for k in 0..sides {
                let (a, b) = (ring + k, ring + k + 1);
                piece.triangles.push(if i == 0 { [tip, b, a] } else { [tip, a, b] });
            }
        }
    }
}

/// An ellipsoid with unit axes `right`, `up` and radii along right, up and their product.
pub(super) fn ball(piece: &mut Piece, centre: DVec3, right: DVec3, up: DVec3, radii: DVec3, rings: u32, sides: u32) {
    let third = right.cross(up);
    let base = piece.positions.len() as u32;
    for j in 0..=rings {
        let (sj, cj) = libm::sincos(PI * f64::from(j) / f64::from(rings));
        // Poles are one point, to the last bit.
        let sj = if j == 0 || j == rings { 0.0 } else { sj };
        for k in 0..=sides {
            let (sk, ck) = libm::sincos(TAU * f64::from(k % sides) / f64::from(sides));
            let d = DVec3::new(sj * ck, -cj, sj * sk);
            let at = centre + right * (d.x * radii.x) + up * (d.y * radii.y) + third * (d.z * radii.z);
            let n = right * (d.x / radii.x) + up * (d.y / radii.y) + third * (d.z / radii.z);
            let uv = DVec2::new(
                TAU * radii.x * f64::from(k) / f64::from(sides),
                PI * radii.y * f64::from(j) / f64::from(rings),
            );
            push(piece, at, n.normalize_or(up), uv);
        }
    }
    let row = sides + 1;
    for j in 0..rings {
        for k in 0..sides {
            let a = base + j * row + k;
            // Up is towards -cos: rows rise, columns turn from right to the third axis.
            if j > 0 {
                piece.triangles.push([a, a + row + 1, a + 1]);
            }
            if j + 1 < rings {
                piece.triangles.push([a, a + row, a + row + 1]);
            }
        }
    }
}

#[cfg(test)]
pub(super) mod testing {
    use std::collections::BTreeMap;

    use super::*;

    /// Volume by the divergence theorem; positive when wound outwards.
    pub fn volume(piece: &Piece) -> f64 {
        let p = |i: u32| piece.positions[i as usize];
        piece.triangles.iter().map(|t| p(t[0]).dot(p(t[1]).cross(p(t[2]))) / 6.0).sum()
    }

    /// Edges (of welded vertices) that are not used exactly once in each direction.
    pub fn open_edges(piece: &Piece) -> usize {
        let group = weld(&piece.positions);
        let mut count: BTreeMap<(u32, u32), i32> = BTreeMap::new();
        for t in &piece.triangles {
            let t = t.map(|i| group[i as usize]);
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                if a != b {
                    *count.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
                }
            }
        }
        count.values().filter(|c| **c != 0).count()
    }

    /// Checks what every piece must hold.
    pub fn sound(piece: &Piece) {
        let n = piece.positions.len();
        assert!(!piece.triangles.is_empty(), "no triangles");
        assert_eq!((piece.normals.len(), piece.uvs.len()), (n, n));
        assert!(piece.positions.iter().all(|p| p.is_finite()), "a position is not finite");
        assert!(piece.uvs.iter().all(|p| p.is_finite()), "a texture coordinate is not finite");
        assert!(piece.normals.iter().all(|v| (v.length() - 1.0).abs() < 1e-6), "a normal is not of unit length");
        assert!(piece.triangles.iter().flatten().all(|i| (*i as usize) < n), "an index is out of range");
        if piece.closed {
            assert_eq!(open_edges(piece), 0, "said to be closed");
            assert!(volume(piece) > 0.0, "inside out");
        }
    }

    #[test]
    fn tubes_and_balls_are_closed_and_of_the_right_volume() {
        let mut p = Piece { closed: true, ..Piece::default() };
        ball(&mut p, DVec3::new(1.0, 2.0, 3.0), DVec3::X, DVec3::Y, DVec3::new(0.3, 0.2, 0.1), 24, 32);
        sound(&p);
        let whole = 4.0 / 3.0 * PI * 0.006;
        assert!((volume(&p) / whole - 1.0).abs() < 0.03, "{}", volume(&p));
        let mut p = Piece { closed: true, ..Piece::default() };
        let ring: Vec<DVec3> = (0..48)
            .map(|i| {
                let (s, c) = libm::sincos(TAU * f64::from(i) / 48.0);
                DVec3::new(c, s * 0.8, 0.2 * s * c)
            })
            .collect();
        tube(&mut p, &ring, &[0.05], 16, true);
        sound(&p);
        let mut p = Piece { closed: true, ..Piece::default() };
        tube(&mut p, &[DVec3::ZERO, DVec3::Y, DVec3::new(0.0, 2.0, 0.1)], &[0.1, 0.1, 0.1], 24, false);
        sound(&p);
        assert!((volume(&p) / (PI * 0.01 * 2.0) - 1.0).abs() < 0.1, "{}", volume(&p));
    }
}
