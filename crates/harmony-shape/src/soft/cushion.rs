//! Upholstered boxes.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::grid::{grid_triangles, push, smooth_normals, tube};
use super::noise::noise3;
use crate::Piece;

/// Form of an upholstered box.
struct Form {
    /// Half the width, height without the crown, half the depth.
    half: DVec3,
    round: f64,
    crown: f64,
    sag: f64,
    bulge: f64,
}

impl Form {
    /// From a point on the sharp box (y from -half to half) to the upholstered one standing on y = 0.
    fn at(&self, q: DVec3) -> DVec3 {
        let inner = self.half - DVec3::splat(self.round);
        let core = q.clamp(-inner, inner);
        let p = core + (q - core).normalize_or(DVec3::ZERO) * self.round;
        let cos = |v: f64, h: f64| libm::cos(PI / 2.0 * (v / h).clamp(-1.0, 1.0)).max(0.0);
        let (cx, cy, cz) = (cos(p.x, self.half.x), cos(p.y, self.half.y), cos(p.z, self.half.z));
        // Full in the middle, drawn in towards the edges; corners stay a little pointed.
        let dome = (cx * cz).sqrt();
        let top = f64::midpoint(p.y / self.half.y, 1.0);
        let soft = noise3(p / 0.16, 5) * 0.03 + noise3(p / 0.07, 6) * 0.012;
        let up = (self.crown * (dome + soft * dome) - self.sag * cx * cz) * top;
        let side = |v: f64, h: f64, along: f64| v * (1.0 - self.bulge / h * (1.0 - (cy * along).sqrt()));
        DVec3::new(side(p.x, self.half.x, cz), p.y + self.half.y + up, side(p.z, self.half.z, cx))
    }
}

/// An upholstered box of `size` (width, height, depth) standing on `y = 0`: crowned top, rounded edges, piping.
///
/// `crown` is the height of the middle of the top above its edges (within the height), `sag` takes from the middle
/// what sitting took, `piping` is the radius of the cord on the upper and lower seams (0: none), `bevel` the edge radius.
pub fn cushion(size: [f64; 3], crown: f64, sag: f64, piping: f64, bevel: f64) -> Piece {
    let [w, h, d] = size.map(|v| v.clamp(0.01, 20.0));
    let crown = crown.clamp(0.0, h * 0.6);
    let piping = piping.clamp(0.0, h * 0.2);
    let flat = DVec3::new(w, h - crown, d);
    let half = flat / 2.0 - DVec3::new(piping, 0.0, piping) * 0.6;
    let round = bevel.max(0.004).min(half.min_element() * 0.98);
    let bulge = (0.025 * w.min(d)).min(0.012).min(0.3 * h);
    let form = Form { half, round, crown, sag: sag.clamp(0.0, h * 0.6), bulge };
    let mut piece = Piece { closed: true, ..Piece::default() };
    for (axis, sign) in (0..3).flat_map(|a| [(a, -1.0), (a, 1.0)]) {
        side(&form, axis, sign, &mut piece);
    }
    smooth_normals(&mut piece);
    if piping > 0.0 {
        for y in [form.half.y, -form.half.y] {
            let seam = seam(&form, y);
            tube(&mut piece, &seam, &[piping], 8, true);
        }
    }
    // Crown and noise are within the height but for millimetres: made exact, so that what lies on it lies on it.
    let (lo, hi) = piece.bounds().unwrap_or_default();
    for p in &mut piece.positions {
        p.y = (p.y - lo.y) * h / (hi.y - lo.y).max(1e-6);
    }
    piece
}

/// Places along an edge of the sharp box: close together in the rounding, 3 cm apart between.
fn stops(half: f64, round: f64) -> Vec<f64> {
    let inner = half - round;
    let mut out = Vec::new();
    // Equal angles of the rounding: the box point at angle a from the face is at inner + round * tan(a).
    let bend: Vec<f64> = (0..4).map(|k| inner + round * libm::tan(PI / 4.0 * (1.0 - f64::from(k) / 4.0))).collect();
    out.extend(bend.iter().map(|v| -v));
    let n = (2.0 * inner / 0.03).ceil().clamp(4.0, 48.0) as usize;
    out.extend((0..=n).map(|k| inner * (2.0 * k as f64 / n as f64 - 1.0)));
    out.extend(bend.iter().rev());
    out[0] = -half;
    let last = out.len() - 1;
    out[last] = half;
    out
}

fn side(form: &Form, axis: usize, sign: f64, piece: &mut Piece) {
    // Columns and rows so that columns x rows point outwards.
    let (u, v) = match (axis, sign > 0.0) {
        (0, true) => (1, 2),
        (0, false) => (2, 1),
        (1, true) => (2, 0),
        (1, false) => (0, 2),
        (2, true) => (0, 1),
        _ => (1, 0),
    };
    let (us, vs) = (stops(form.half[u], form.round), stops(form.half[v], form.round));
    let base = piece.positions.len() as u32;
    for b in &vs {
        for a in &us {
            let mut q = DVec3::ZERO;
            q[axis] = sign * form.half[axis];
            q[u] = *a;
            q[v] = *b;
            // Grain runs upright on the sides and away on the top.
            let uv = match axis {
                0 => DVec2::new(-sign * q.z, q.y),
                1 => DVec2::new(q.x, -sign * q.z),
                _ => DVec2::new(sign * q.x, q.y),
            };
            push(piece, form.at(q), DVec3::Y, uv);
        }
    }
    grid_triangles(us.len() as u32, vs.len() as u32, base, &mut piece.triangles);
}

/// The line in the middle of the rounding along an upper or lower edge.
fn seam(form: &Form, y: f64) -> Vec<DVec3> {
    let (xs, zs) = (stops(form.half.x, form.round), stops(form.half.z, form.round));
    let (hx, hz) = (form.half.x, form.half.z);
    let mut out: Vec<DVec3> = xs.iter().map(|x| form.at(DVec3::new(*x, y, -hz))).collect();
    out.extend(zs.iter().skip(1).map(|z| form.at(DVec3::new(hx, y, *z))));
    out.extend(xs.iter().rev().skip(1).map(|x| form.at(DVec3::new(*x, y, hz))));
    out.extend(zs.iter().rev().skip(1).map(|z| form.at(DVec3::new(-hx, y, *z))));
    out.pop();
    out
}

#[cfg(test)]
mod tests {
    use super::super::grid::testing::{sound, volume};
    use super::*;

    #[test]
    fn cushions_are_closed_crowned_and_of_the_right_size() {
        for piping in [0.0, 0.006] {
            let c = cushion([0.6, 0.16, 0.55], 0.03, 0.0, piping, 0.03);
            sound(&c);
            let (lo, hi) = c.bounds().unwrap();
            assert!(lo.y.abs() < 1e-9 && (hi.y - 0.16).abs() < 1e-9);
            assert!((hi.x - lo.x - 0.6).abs() < 0.012 && (hi.z - lo.z - 0.55).abs() < 0.012, "{lo} {hi}");
            let top = |x: f64, z: f64| {
                let near = c.positions.iter().filter(|p| (p.x - x).abs() < 0.03 && (p.z - z).abs() < 0.03);
                near.map(|p| p.y).fold(0.0, f64::max)
            };
            assert!(top(0.0, 0.0) - top(0.25, 0.22) > 0.008, "{} {}", top(0.0, 0.0), top(0.25, 0.22));
        }
        let full = volume(&cushion([0.6, 0.16, 0.55], 0.0, 0.0, 0.0, 0.02));
        assert!((0.85..1.0).contains(&(full / (0.6 * 0.16 * 0.55))), "{full}");
        let sat = cushion([0.6, 0.16, 0.55], 0.02, 0.04, 0.0, 0.02);
        assert!(volume(&sat) < full);
        sound(&cushion([0.05, 0.02, 0.05], 0.5, 0.0, 0.0, 0.5));
    }
}
