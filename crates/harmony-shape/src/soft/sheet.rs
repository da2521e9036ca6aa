//! Cloth as a result: a piece and its edges.

use glam::{DVec2, DVec3};

use super::grid::{push, smooth_normals};
use crate::Piece;

/// The edges of a cloth, polylines in the cloth's coordinates.
///
/// `head` is the edge at -z of a draped cloth before its turn, or the top of a hanging one; `foot` the opposite one;
/// `left` at -x, `right` at +x. Head and foot run from left to right, left and right from head to foot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Hems {
    /// Edge at the head, left to right.
    pub head: Vec<DVec3>,
    /// Edge at the foot, left to right.
    pub foot: Vec<DVec3>,
    /// Left edge, head to foot.
    pub left: Vec<DVec3>,
    /// Right edge, head to foot.
    pub right: Vec<DVec3>,
}

impl Hems {
    /// An edge by name: `head`, `foot`, `left`, `right`, or `all` (closed: the last point is next to the first one).
    pub fn named(&self, side: &str) -> Option<Vec<DVec3>> {
        match side {
            "head" => Some(self.head.clone()),
            "foot" => Some(self.foot.clone()),
            "left" => Some(self.left.clone()),
            "right" => Some(self.right.clone()),
            "all" => {
                let mut all = self.head.clone();
                all.extend(self.right.iter().skip(1));
                all.extend(self.foot.iter().rev().skip(1));
                all.extend(self.left.iter().rev().skip(1));
                all.pop();
                Some(all)
            }
            _ => None,
        }
    }
}

/// A cloth in its place.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cloth {
    /// The cloth, with its thickness; texture coordinates are those of the flat cloth in metres.
    pub piece: Piece,
    /// Its edges.
    pub hems: Hems,
    /// Rod, rings or hooks that hold it (metal, another material than the cloth's); empty for a draped cloth.
    pub fittings: Piece,
}

/// A grid of points on the middle surface of a cloth: `nu` a row, rows one after the other, seen with its upper (or
/// front) side towards the viewer columns go right and rows go down.
#[derive(Debug, Clone)]
pub(super) struct Middle {
    /// Points.
    pub points: Vec<DVec3>,
    /// Flat places, metres.
    pub flat: Vec<DVec2>,
    /// Points a row.
    pub nu: usize,
    /// Rows.
    pub nv: usize,
}

impl Middle {
    /// Evens out what the simulation leaves between neighbours without shrinking folds (Taubin 1995); edges are
    /// smoothed along themselves, corners stay.
    pub fn smooth(&mut self, passes: usize) {
        let (nu, nv) = (self.nu, self.nv);
        for pass in 0..2 * passes {
            let amount = if pass % 2 == 0 { 0.5 } else { -0.53 };
            let old = self.points.clone();
            for j in 0..nv {
                for i in 0..nu {
                    let k = j * nu + i;
                    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
                    if i > 0 && i + 1 < nu {
                        sum += old[k - 1] + old[k + 1];
                        count += 2.0;
                    }
                    if j > 0 && j + 1 < nv {
                        sum += old[k - nu] + old[k + nu];
                        count += 2.0;
                    }
                    if count > 0.0 {
                        self.points[k] += (sum / count - old[k]) * amount;
                    }
                }
            }
        }
    }

    /// Twice as many cells each way: points stay, new ones lie on cubics through four (Dyn, Levin and Gregory 1987).
    pub fn divided(&self) -> Self {
        let (nu, nv) = (self.nu, self.nv);
        let (wide, high) = (2 * nu - 1, 2 * nv - 1);
        let mut points = vec![DVec3::ZERO; wide * high];
        let mut flat = vec![DVec2::ZERO; wide * high];
        let between = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b + c) * 0.5625 - (a + d) * 0.0625;
        for j in 0..nv {
            for i in 0..nu {
                points[2 * j * wide + 2 * i] = self.points[j * nu + i];
                flat[2 * j * wide + 2 * i] = self.flat[j * nu + i];
            }
            for i in 0..nu - 1 {
                let at = |i: usize| self.points[j * nu + i.min(nu - 1)];
                let k = 2 * j * wide + 2 * i + 1;
                points[k] = between(at(i.saturating_sub(1)), at(i), at(i + 1), at(i + 2));
                flat[k] = self.flat[j * nu + i].midpoint(self.flat[j * nu + i + 1]);
            }
        }
        for j in 0..nv - 1 {
            for i in 0..wide {
                let at = |j: usize| points[2 * j.min(nv - 1) * wide + i];
                let k = (2 * j + 1) * wide + i;
                points[k] = between(at(j.saturating_sub(1)), at(j), at(j + 1), at(j + 2));
                flat[k] = flat[2 * j * wide + i].midpoint(flat[2 * (j + 1) * wide + i]);
            }
        }
        Self { points, flat, nu: wide, nv: high }
    }

    /// Unit normals of the upper side.
    pub fn normals(&self) -> Vec<DVec3> {
        let (nu, nv) = (self.nu, self.nv);
        let mut out = Vec::with_capacity(nu * nv);
        for j in 0..nv {
            for i in 0..nu {
                let at = |i: usize, j: usize| self.points[j * nu + i];
                let du = at((i + 1).min(nu - 1), j) - at(i.saturating_sub(1), j);
                let dv = at(i, (j + 1).min(nv - 1)) - at(i, j.saturating_sub(1));
                out.push(dv.cross(du).normalize_or(DVec3::Y));
            }
        }
        out
    }

    /// Its edges.
    pub fn hems(&self) -> Hems {
        let (nu, nv) = (self.nu, self.nv);
        let column = |i: usize| (0..nv).map(|j| self.points[j * nu + i]).collect();
        Hems {
            head: self.points[..nu].to_vec(),
            foot: self.points[nu * (nv - 1)..].to_vec(),
            left: column(0),
            right: column(nu - 1),
        }
    }

    /// A closed piece with thickness, its edges rounded. `half` gives half the thickness at a point (column, row).
    ///
    /// The under side has a quarter of the triangles: it is hardly ever seen. The grid must have odd numbers of points.
    pub fn thickened(&self, half: impl Fn(usize, usize) -> f64) -> Piece {
        let (nu, nv) = (self.nu, self.nv);
        let normals = self.normals();
        let mut piece = Piece { closed: true, ..Piece::default() };
        let half: Vec<f64> = (0..nu * nv).map(|k| half(k % nu, k / nu)).collect();
        for k in 0..nu * nv {
            push(&mut piece, self.points[k] + normals[k] * half[k], normals[k], self.flat[k]);
        }
        for j in 0..nv - 1 {
            for i in 0..nu - 1 {
                let a = (j * nu + i) as u32;
                let (b, c, d) = (a + 1, a + nu as u32 + 1, a + nu as u32);
                if (i + j) % 2 == 0 {
                    piece.triangles.extend([[a, c, b], [a, d, c]]);
                } else {
                    piece.triangles.extend([[a, d, b], [b, d, c]]);
                }
            }
        }
        let mut under = vec![u32::MAX; nu * nv];
        for k in 0..nu * nv {
            let (i, j) = (k % nu, k / nu);
            if edge_side((i, j), nu, nv) || (i % 2 == 0 && j % 2 == 0) {
                under[k] = push(&mut piece, self.points[k] - normals[k] * half[k], -normals[k], self.flat[k]);
            }
        }
        let mut corners = Vec::with_capacity(8);
        for j in (0..nv - 1).step_by(2) {
            for i in (0..nu - 1).step_by(2) {
                let ring =
                    [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)].map(|(a, b)| (i + a, j + b));
                corners.clear();
                // Begin at a point in the middle of an outer side, if there is one: no triangle is flat then.
                let begin = (1..8).step_by(2).find(|k| edge_side(ring[*k], nu, nv)).unwrap_or(0);
                for k in 0..8 {
                    let at = ring[(begin + k) % 8];
                    let middle = (begin + k) % 2 == 1;
                    if !middle || edge_side(at, nu, nv) {
                        corners.push(under[at.1 * nu + at.0]);
                    }
                }
                for k in 1..corners.len() - 1 {
                    piece.triangles.push([corners[0], corners[k], corners[k + 1]]);
                }
            }
        }
        self.round_edge(&mut piece, &normals, &half, &under);
        smooth_normals(&mut piece);
        piece
    }

    /// Half a round between the upper and the under side all around.
    fn round_edge(&self, piece: &mut Piece, normals: &[DVec3], half: &[f64], under: &[u32]) {
        let (nu, nv) = (self.nu, self.nv);
        let mut ring: Vec<usize> = (0..nu).collect();
        ring.extend((1..nv).map(|j| j * nu + nu - 1));
        ring.extend((0..nu - 1).rev().map(|i| (nv - 1) * nu + i));
        ring.extend((1..nv - 1).rev().map(|j| j * nu));
        let n = ring.len();
        let mut rows: Vec<[u32; 4]> = Vec::with_capacity(n);
        for (k, at) in ring.iter().enumerate() {
            let (before, after) = (ring[(k + n - 1) % n], ring[(k + 1) % n]);
            let tangent = (self.points[after] - self.points[before]).normalize_or(DVec3::X);
            let normal = normals[*at];
            // Clockwise seen from above, so that the outside is on the left.
            let outward = normal.cross(tangent).normalize_or(DVec3::X);
            let r = half[*at];
            let mut row = [*at as u32, 0, 0, under[*at]];
            for (m, (s, c)) in [(1, (0.5, 0.866)), (2, (-0.5, 0.866))] {
                let p = self.points[*at] + normal * (r * s) + outward * (r * c);
                row[m] = push(piece, p, outward, self.flat[*at]);
            }
            rows.push(row);
        }
        for k in 0..n {
            let (a, b) = (rows[k], rows[(k + 1) % n]);
            for m in 0..3 {
                piece.triangles.extend([[a[m], b[m], b[m + 1]], [a[m], b[m + 1], a[m + 1]]]);
            }
        }
    }
}

/// Whether a point lies on an outer side of the grid.
fn edge_side((i, j): (usize, usize), nu: usize, nv: usize) -> bool {
    i == 0 || j == 0 || i + 1 == nu || j + 1 == nv
}

#[cfg(test)]
mod tests {
    use super::super::grid::testing::{sound, volume};
    use super::*;

    fn flat(nu: usize, nv: usize, pitch: f64) -> Middle {
        let flat: Vec<DVec2> =
            (0..nu * nv).map(|k| DVec2::new((k % nu) as f64 * pitch, (k / nu) as f64 * pitch)).collect();
        Middle { points: flat.iter().map(|p| DVec3::new(p.x, 1.0, p.y)).collect(), flat, nu, nv }
    }

    #[test]
    fn thickened_sheets_are_closed_for_all_counts() {
        for (nu, nv) in [(2, 2), (2, 5), (3, 3), (6, 4)] {
            let piece = flat(nu, nv, 0.05).divided().thickened(|_, _| 0.004);
            sound(&piece);
            let area = 0.05 * 0.05 * ((nu - 1) * (nv - 1)) as f64;
            let v = volume(&piece);
            assert!(v > 0.008 * area && v < 0.008 * area * 1.5, "{nu} {nv}: {v}");
            let up: f64 = piece.normals[..nu].iter().map(|n| n.y).sum::<f64>() / nu as f64;
            assert!(up > 0.4, "the first points are those of the upper side: {up}");
        }
    }

    #[test]
    fn smoothing_takes_the_sawtooth_and_leaves_the_fold() {
        let mut sheet = flat(41, 9, 0.02);
        let wave = |x: f64| 0.03 * libm::sin(x * 20.0);
        for (k, p) in sheet.points.iter_mut().enumerate() {
            p.y += wave(p.x) + if k % 2 == 0 { 0.004 } else { -0.004 };
        }
        sheet.smooth(3);
        let worst = sheet
            .points
            .iter()
            .enumerate()
            .filter(|(k, _)| (3..38).contains(&(k % 41)) && (1..8).contains(&(k / 41)))
            .map(|(_, p)| (p.y - 1.0 - wave(p.x)).abs())
            .fold(0.0, f64::max);
        assert!(worst < 0.0022, "{worst}");
    }

    #[test]
    fn all_hems_make_one_ring() {
        let hems = flat(4, 3, 1.0).hems();
        let all = hems.named("all").unwrap();
        assert_eq!(all.len(), 10);
        for k in 0..10 {
            assert!((all[k].distance(all[(k + 1) % 10]) - 1.0).abs() < 1e-9);
        }
        assert!(hems.named("top").is_none());
    }
}
