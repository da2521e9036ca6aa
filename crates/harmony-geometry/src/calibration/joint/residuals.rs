//! The residuals of the joint refinement and their derivatives: pins and prior, the photo's lines, the map's cells.
//!
//! Each is in units of its own sigma: pixels of a pin to the image of its edge, directions of segments to vanishing
//! points, logarithms of lengths and depths. Losses saturate at a limit of sigmas. Derivatives of lines and cells,
//! which are many, are written down, and a test holds them against differences; those of the few others are
//! differences. A cell speaks for the face that it was last assigned to, so that the sum is smooth only between
//! assignments.

use harmony_scene::{PointMapKind, Surface, Vec3};
use nalgebra::DMatrix;

use super::{
    BACK_SIGMA, CAMERA_HEIGHT_SIGMA, LINES_WEIGHT, LN_HEIGHT, LN_SCALE, METRIC_HEIGHT_SIGMA, Problem, STEPS,
    TOLD_HEIGHT_SIGMA, UNSEEN_SIGMA, USUAL_HEIGHT_SIGMA, Unknowns, WIDTH_SIGMA, distance_to, index, outward, towards,
};
use crate::least_squares::{Solution, differences, minimise_with, robust, robust_slope};
use crate::room_box::USUAL_CAMERA_HEIGHT;
use crate::room_box::pins::{FLOOR_LOGIT, LN_BACK, LN_FOCAL, LN_LEFT, LN_RIGHT, ROLL, TILT, YAW};
use crate::room_box::solved::CameraBox;
use crate::vanishing::{Search, rotation_slopes};

impl Problem<'_> {
    pub(super) fn residuals(&self, p: &[f64], limit: f64, out: &mut Vec<f64>) {
        self.residuals_of_pins(p, limit, out);
        self.residuals_of_prior(p, out);
        let lines = out.len();
        self.lines.residuals(&p[..4], out);
        for r in &mut out[lines..lines + self.lines.count()] {
            *r *= LINES_WEIGHT;
        }
        let solved = Self::unpack(p);
        let off = self.off_faces(p, &solved);
        out.extend(off.map(|off| robust(off.unwrap_or(limit), limit)));
    }

    fn residuals_of_pins(&self, p: &[f64], limit: f64, out: &mut Vec<f64>) {
        let solved = Self::unpack(p);
        let rotation = solved.rotation();
        for pin in &self.pins {
            out.push(robust(solved.distance_to_edge(&rotation, pin.edge, pin.point) / pin.sigma, limit));
        }
    }

    /// What holds the rest: where a face is not seen, its distance stays about what it was.
    fn residuals_of_prior(&self, p: &[f64], out: &mut Vec<f64>) {
        let solved = Self::unpack(p);
        let keep = |i: usize, sigma: f64| (p[i] - self.start[i]) / sigma;
        let unseen = |surface: Surface| if self.seen[index(surface)] { 10.0 } else { UNSEEN_SIGMA };
        out.push(keep(LN_LEFT, unseen(Surface::Left)));
        out.push(keep(LN_RIGHT, unseen(Surface::Right)));
        self.residuals_of_hints(p, out);
        if self.kind == PointMapKind::Relative {
            out.push((solved.floor / USUAL_CAMERA_HEIGHT).ln() / USUAL_HEIGHT_SIGMA);
        }
        let height = p[LN_HEIGHT].exp();
        // The prior's height is the metric reference, but for a map that has metres of its own.
        let wanted = self.prior.extents.height.ln();
        if self.kind == PointMapKind::Metric {
            out.push((height.ln() - wanted) / METRIC_HEIGHT_SIGMA);
            out.push(keep(LN_SCALE, 0.002));
        } else {
            out.push((height.ln() - wanted) / TOLD_HEIGHT_SIGMA);
            out.push(keep(LN_SCALE, 2.0));
        }
    }

    /// What the model guesses of lengths, and how high people hold their cameras: it matters where no face is seen.
    pub(super) fn residuals_of_hints(&self, p: &[f64], out: &mut Vec<f64>) {
        let solved = Self::unpack(p);
        let keep = |i: usize, sigma: f64| (p[i] - self.start[i]) / sigma;
        let hinted = |v: Option<f64>, low: f64, high: f64| v.filter(|v| (low..=high).contains(v));
        out.push(match hinted(self.prior.camera.height_m, 0.1, 0.97 * self.prior.extents.height) {
            Some(h) => (solved.floor / h).ln() / CAMERA_HEIGHT_SIGMA,
            None => keep(FLOOR_LOGIT, 1.0),
        });
        out.push(match hinted(self.prior.camera.dist_to_back_m, 0.2, 40.0) {
            Some(b) => (solved.back / b).ln() / BACK_SIGMA,
            None => keep(LN_BACK, 10.0),
        });
        out.push(((solved.left + solved.right) / self.prior.extents.width).ln() / WIDTH_SIGMA);
    }

    /// How far each cell is off its face, sigmas: 0 where it has none, `None` where its ray does not meet it.
    fn off_faces(&self, p: &[f64], solved: &CameraBox) -> impl Iterator<Item = Option<f64>> {
        let ln_distances = Surface::ALL.map(|face| distance_to(solved, face).map_or(f64::NAN, f64::ln));
        let room_from_camera = solved.rotation().transpose();
        self.cells.iter().map(move |cell| {
            let Some(face) = cell.face else { return Some(0.0) };
            let towards = towards(face, room_from_camera * cell.ray(solved.focal))?;
            let off = (cell.depth * towards).ln() + p[LN_SCALE] - ln_distances[index(face)];
            off.is_finite().then_some(off / self.cell_sigma)
        })
    }

    /// Derivatives of [`Self::residuals`]: of lines and cells, which are many, as written down; of the others by
    /// differences.
    pub(super) fn jacobian(&self, p: &[f64], limit: f64, rows: usize) -> DMatrix<f64> {
        let few = rows - self.lines.count() - Search::BESIDE_LINES - self.cells.len();
        let mut out = DMatrix::zeros(rows, p.len());
        out.rows_mut(0, few).copy_from(&differences(p, &STEPS, few, |p, out| {
            self.residuals_of_pins(p, limit, out);
            self.residuals_of_prior(p, out);
        }));
        for (i, slopes) in self.lines.slopes(&p[..4]).into_iter().enumerate() {
            let weight = if i < self.lines.count() { LINES_WEIGHT } else { 1.0 };
            for (k, slope) in slopes.into_iter().enumerate() {
                out[(few + i, k)] = weight * slope;
            }
        }
        let solved = Self::unpack(p);
        let first = rows - self.cells.len();
        let room_from_camera = solved.rotation().transpose();
        let turns = rotation_slopes(solved.yaw, solved.tilt, solved.roll).map(|turn| turn.transpose());
        let below = solved.floor / (solved.floor + solved.ceiling);
        for (i, (cell, off)) in self.cells.iter().zip(self.off_faces(p, &solved)).enumerate() {
            let (Some(face), Some(off)) = (cell.face, off) else { continue };
            let ray = cell.ray(solved.focal);
            let Some(towards) = towards(face, room_from_camera * ray) else { continue };
            let slope = robust_slope(off, limit) / self.cell_sigma;
            let of = |ray: Vec3| slope * outward(face, ray).unwrap_or(0.0) / towards;
            let mut set = |k: usize, value: f64| out[(first + i, k)] = value;
            set(LN_FOCAL, of(room_from_camera * Vec3::new(-ray.x, -ray.y, 0.0)));
            for (k, turn) in [YAW, TILT, ROLL].into_iter().zip(&turns) {
                set(k, of(*turn * ray));
            }
            set(LN_SCALE, slope);
            match face {
                Surface::Left => set(LN_LEFT, -slope),
                Surface::Right => set(LN_RIGHT, -slope),
                Surface::Back => set(LN_BACK, -slope),
                Surface::Floor => {
                    set(LN_HEIGHT, -slope);
                    set(FLOOR_LOGIT, -slope * (1.0 - below));
                }
                Surface::Ceiling => {
                    set(LN_HEIGHT, -slope);
                    set(FLOOR_LOGIT, slope * below);
                }
                Surface::Front => {}
            }
        }
        out
    }

    pub(super) fn minimise(&self, start: &Unknowns, limit: f64, most_steps: usize) -> Solution {
        let residuals = |p: &[f64], out: &mut Vec<f64>| self.residuals(p, limit, out);
        minimise_with(start, most_steps, residuals, |p, rows| self.jacobian(p, limit, rows))
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Extents, ImageSize, Vec2};

    use super::super::{Cell, LIMIT, SMOOTH, depth_of};
    use super::*;
    use crate::calibration::lens::Lens;
    use crate::{CameraHints, FocalPrior, LayoutPrior, LineSegment};

    /// A box seen from inside, its depths a little bent so that no residual is 0, one cell of another surface.
    #[test]
    fn written_derivatives_are_those_of_differences() {
        let photo = ImageSize::new(640, 480);
        let extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };
        let prior = LayoutPrior {
            extents,
            camera: CameraHints { height_m: Some(1.4), dist_to_back_m: Some(4.2), ..CameraHints::default() },
            ..LayoutPrior::unknown(photo)
        };
        let p: Unknowns = [320f64.ln(), 0.2, -0.1, 0.02, 1.9f64.ln(), 2.2f64.ln(), 0.1, 4.1f64.ln(), 2.6f64.ln(), 0.3];
        let solved = Problem::unpack(&p);
        let mut cells = Vec::new();
        for (i, x) in (-300..=300).step_by(40).enumerate() {
            for (k, y) in (-220..=220).step_by(40).enumerate() {
                let mut cell = Cell { at: Vec2::new(f64::from(x), f64::from(y)), depth: 1.0, face: None };
                let ray = solved.rotation().transpose() * cell.ray(solved.focal);
                let met = Surface::ALL.into_iter().filter_map(|s| Some((s, depth_of(&solved, s, ray)?)));
                let (face, depth) = met.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
                let bent = 1.0 + 0.03 * (i as f64).sin() * (k as f64).cos();
                cell.depth = depth * bent * (-p[LN_SCALE]).exp() * if i + k == 9 { 0.7 } else { 1.0 };
                cell.face = (i + k != 7).then_some(face);
                cells.push(cell);
            }
        }
        assert_eq!(Surface::ALL.iter().filter(|s| cells.iter().any(|c| c.face == Some(**s))).count(), 5);
        let segments: Vec<LineSegment> = (0..60)
            .map(|i| {
                let at = |k: u32| Vec2::new(f64::from(k * 97 % 600 + 20), f64::from(k * 61 % 440 + 20));
                LineSegment { start: at(i), end: at(i + 7), strength: 1.0 }
            })
            .collect();
        let problem = Problem {
            prior: &prior,
            lens: Lens::unknown(photo),
            lines: Search::new(photo, &segments, Some(FocalPrior { focal_px: 325.0, sigma: 0.02 })),
            segments: Vec::new(),
            pins: Vec::new(),
            cells,
            accuracy: SMOOTH,
            cell_sigma: 0.1,
            start: p,
            seen: [true; 6],
            measured: [true; 6],
            kind: PointMapKind::Relative,
        };
        let mut residuals = Vec::new();
        problem.residuals(&p, LIMIT, &mut residuals);
        let rows = residuals.len();
        let ours = problem.jacobian(&p, LIMIT, rows);
        let theirs = differences(&p, &STEPS, rows, |p, out| problem.residuals(p, LIMIT, out));
        assert!(problem.lines.count() > 20 && rows > 200);
        for (i, (a, b)) in ours.iter().zip(theirs.iter()).enumerate() {
            assert!((a - b).abs() <= 1e-5 * (1.0 + b.abs()), "row {} column {}: {a} {b}", i % rows, i / rows);
        }
        assert!(ours.column_iter().all(|c| c.norm() > 0.0));
    }
}
