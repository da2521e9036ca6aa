//! The Manhattan frame of a room from surface normals (`SVDCluster` of the paper's Algorithm 1).
//!
//! Several starts around the camera's own axes; each is refined by assigning every normal to the nearest axis,
//! weighting it by a Tukey biweight of its angle, and taking the nearest rotation to the weighted sums by SVD
//! (orthogonal Procrustes). The width of the biweight shrinks, as in graduated non-convexity. The start with the most
//! agreeing weight wins. Weak regime: one plane only (a wall, a table top) leaves the turn about its normal open;
//! then the camera is taken to have no roll.

use harmony_scene::{Mat3, Vec3};
use nalgebra::{Matrix3, SVD};
use rayon::prelude::*;

use crate::surfels::{Surfel, Surfels};

/// Starting and final width of the biweight, degrees.
const WIDTH_DEG: [f64; 2] = [40.0, 15.0];
/// Rounds in which the width shrinks; after them starts are compared, and the best goes on for some more.
const ROUNDS: [usize; 2] = [8, 20];
/// Normals used while comparing starts.
const SAMPLE: usize = 600;
/// Turns and tilts of the starts from the camera's axes, degrees. A frame repeats every 90 degrees.
const START_YAWS_DEG: [f64; 6] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0];
const START_TILTS_DEG: [f64; 5] = [0.0, -25.0, 15.0, 30.0, 50.0];
/// An axis with less than this share of the agreeing weight doesn't hold the frame.
const WEAK_AXIS: f64 = 0.03;

/// Three orthogonal unit directions in the `points` frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManhattanAxes {
    /// The paper's `a_w`; room +X after [`ManhattanAxes::oriented`].
    pub width: Vec3,
    /// The paper's `a_v`; room +Y.
    pub vertical: Vec3,
    /// The paper's `a_d`; room +Z.
    pub depth: Vec3,
}

impl ManhattanAxes {
    /// Assigns width and depth and fixes all signs (key `cam.rotation`; paper Sec. 3.1 "Rotation", Alg. 1).
    ///
    /// `up` and `forward` are the camera's, in the frame of the axes. The horizontal axis nearest to `forward` is the
    /// depth axis; it points against `forward`, for +Z leaves the back wall; `width = vertical x depth`.
    /// The paper orients depth "so the camera looks toward the back wall", which is this.
    #[must_use]
    pub fn oriented(self, up: Vec3, forward: Vec3) -> Self {
        let vertical = if self.vertical.dot(up) < 0.0 { -self.vertical } else { self.vertical };
        let swap = self.width.dot(forward).abs() > self.depth.dot(forward).abs();
        let depth = if swap { self.width } else { self.depth };
        let depth = if depth.dot(forward) > 0.0 { -depth } else { depth };
        Self { width: vertical.cross(depth), vertical, depth }
    }

    /// The same frame with the other horizontal axis as depth: the room seen turned by a quarter.
    ///
    /// The new depth axis again points against `forward`.
    #[must_use]
    pub fn quarter_turned(self, forward: Vec3) -> Self {
        let depth = if self.width.dot(forward) > 0.0 { -self.width } else { self.width };
        Self { width: self.vertical.cross(depth), vertical: self.vertical, depth }
    }

    /// The paper's `R_align`: rows are the axes, it takes the `points` frame to the room's directions.
    pub fn r_align(self) -> Mat3 {
        Mat3::from_cols(self.width, self.vertical, self.depth).transpose()
    }

    /// From the rotation whose rows are the axes.
    pub fn from_r_align(r: Mat3) -> Self {
        let t = r.transpose();
        Self { width: t.x_axis, vertical: t.y_axis, depth: t.z_axis }
    }
}

/// A Manhattan frame and how well the normals agree with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManhattanFrame {
    /// The axes; only the vertical one is named for good, signs of the others are free.
    pub axes: ManhattanAxes,
    /// RMS angle of the counted normals to their axis, degrees.
    pub agreement_deg: f64,
    /// Share of the weight of all normals within 15 degrees of an axis.
    pub support: f64,
    /// Share of the agreeing weight by axis: width, vertical, depth.
    pub shares: [f64; 3],
    /// Rounds of the winning start.
    pub iterations: usize,
}

/// Clusters normals into a Manhattan frame (key `cam.manhattan`; Alg. 1 line 1).
///
/// `camera_from_points` is the paper's `R_0`. `tilt` is the expected downward tilt of the camera (radians, 0 when
/// unknown): the vertical axis is the one nearest to the camera's up direction, corrected by half of it.
/// `None` when there are fewer than 30 normals.
pub fn manhattan_frame(surfels: &Surfels, camera_from_points: Mat3, tilt: f64) -> Option<ManhattanFrame> {
    let all: Vec<&Surfel> = surfels.oriented().collect();
    if all.len() < 30 {
        return None;
    }
    let sample: Vec<&Surfel> = all.iter().step_by(all.len().div_ceil(SAMPLE)).copied().collect();
    let points_from_camera = camera_from_points.transpose();
    let starts: Vec<[f64; 2]> =
        START_YAWS_DEG.iter().flat_map(|yaw| START_TILTS_DEG.iter().map(move |tilt| [*yaw, *tilt])).collect();
    let tries: Vec<(f64, Mat3, usize)> = starts
        .into_par_iter()
        .map(|[yaw, start_tilt]| {
            let start = points_from_camera
                * Mat3::from_rotation_x(start_tilt.to_radians())
                * Mat3::from_rotation_y(yaw.to_radians());
            let (frame, iterations) = refine(&sample, start, WIDTH_DEG, [ROUNDS[0]; 2]);
            (agreement(&sample, frame).weight, frame, iterations)
        })
        .collect();
    // Of equally good ones the first.
    let best = tries.into_iter().reduce(|best, next| if next.0 > best.0 { next } else { best });
    let (_, frame, iterations) = best?;
    let (frame, more) = refine(&all, frame, [WIDTH_DEG[1]; 2], [0, ROUNDS[1]]);

    // A camera tilted down by t sees up at -cos t on its y axis and -sin t on its z axis.
    let (sin, cos) = (tilt / 2.0).sin_cos();
    let up = points_from_camera * Vec3::new(0.0, -cos, -sin);
    let columns = [frame.x_axis, frame.y_axis, frame.z_axis];
    let v = (0..3).max_by(|a, b| columns[*a].dot(up).abs().total_cmp(&columns[*b].dot(up).abs()))?;
    let (w, d) = ((v + 1) % 3, (v + 2) % 3);
    let mut axes = ManhattanAxes { width: columns[w], vertical: columns[v], depth: columns[d] };
    let stats = agreement(&all, Mat3::from_cols(axes.width, axes.vertical, axes.depth));
    if stats.shares[1] < WEAK_AXIS && stats.shares.iter().filter(|s| **s >= WEAK_AXIS).count() < 2 {
        axes = without_roll(axes, stats.shares, points_from_camera);
    }
    Some(ManhattanFrame {
        axes,
        agreement_deg: stats.rms_deg,
        support: stats.weight_share,
        shares: stats.shares,
        iterations: iterations + more,
    })
}

/// One wall alone: keeps its normal and takes the camera's x axis to be level.
fn without_roll(axes: ManhattanAxes, shares: [f64; 3], points_from_camera: Mat3) -> ManhattanAxes {
    let wall = if shares[0] >= shares[2] { axes.width } else { axes.depth };
    let right = points_from_camera * Vec3::X;
    // Up is orthogonal to the wall's normal and to the camera's x axis, unless these are parallel.
    let up_guess = points_from_camera * Vec3::NEG_Y;
    let up = right.cross(wall).try_normalize().filter(|u| u.dot(up_guess).abs() > 0.3);
    let up = up.unwrap_or_else(|| up_guess.reject_from(wall).normalize_or(axes.vertical));
    ManhattanAxes { width: up.cross(wall), vertical: up, depth: wall }
}

fn refine(normals: &[&Surfel], start: Mat3, width_deg: [f64; 2], rounds: [usize; 2]) -> (Mat3, usize) {
    let mut frame = start;
    for round in 0..rounds[1] {
        let k = if rounds[0] == 0 { 1.0 } else { (round as f64 / rounds[0] as f64).min(1.0) };
        let width = (width_deg[0] + (width_deg[1] - width_deg[0]) * k).to_radians();
        let reach = 1.0 - width.cos();
        let columns = [frame.x_axis, frame.y_axis, frame.z_axis];
        let mut sums = [Vec3::ZERO; 3];
        for s in normals {
            let (axis, dot) = nearest(&columns, s.normal);
            let short = 1.0 - dot.abs();
            if short < reach {
                let k = 1.0 - squared_angle(short) / (width * width);
                sums[axis] += s.normal * (dot.signum() * s.weight * k * k);
            }
        }
        let Some(next) = nearest_rotation(Mat3::from_cols(sums[0], sums[1], sums[2]), frame) else { break };
        let turn = (frame.transpose() * next - Mat3::IDENTITY).to_cols_array();
        frame = next;
        if k >= 1.0 && turn.iter().all(|v| v.abs() < 1e-6) {
            return (frame, round + 1);
        }
    }
    (frame, rounds[1])
}

fn nearest(columns: &[Vec3; 3], n: Vec3) -> (usize, f64) {
    let dots = columns.map(|c| c.dot(n));
    let axis = if dots[0].abs() >= dots[1].abs() && dots[0].abs() >= dots[2].abs() {
        0
    } else if dots[1].abs() >= dots[2].abs() {
        1
    } else {
        2
    };
    (axis, dots[axis])
}

/// The square of the angle of which the cosine falls short of 1 by `short`, radians: twice the sum of
/// `(2 short)^n / (n^2 (2n over n))`. Below 45 degrees ten terms leave less than 1e-10, at a third of the price of `acos`.
fn squared_angle(short: f64) -> f64 {
    const TERMS: [f64; 10] = [
        1.0 / 2.0,
        1.0 / (4.0 * 6.0),
        1.0 / (9.0 * 20.0),
        1.0 / (16.0 * 70.0),
        1.0 / (25.0 * 252.0),
        1.0 / (36.0 * 924.0),
        1.0 / (49.0 * 3432.0),
        1.0 / (64.0 * 12870.0),
        1.0 / (81.0 * 48620.0),
        1.0 / (100.0 * 184_756.0),
    ];
    let x = 2.0 * short.max(0.0);
    2.0 * x * TERMS.iter().rev().fold(0.0, |sum, term| sum * x + term)
}

/// Tukey's biweight: 1 at 0, 0 from 1 on.
pub(crate) fn biweight(x: f64) -> f64 {
    let k = (1.0 - x * x).max(0.0);
    k * k
}

/// The rotation nearest to a matrix (orthogonal Procrustes by SVD); axes without data stay near `fallback`.
pub(crate) fn nearest_rotation(m: Mat3, fallback: Mat3) -> Option<Mat3> {
    let size = m.to_cols_array().iter().fold(0.0f64, |a, v| a.max(v.abs()));
    if !(size > 0.0 && size.is_finite()) {
        return None;
    }
    // A column without any weight would leave the SVD free to flip it; a trace of the fallback holds it.
    let m = m + fallback * (1e-3 * size);
    let a = Matrix3::from_column_slice(&m.to_cols_array());
    let svd = SVD::try_new(a, true, true, 1e-15, 200)?;
    let (u, vt) = (svd.u?, svd.v_t?);
    let mut r = u * vt;
    if r.determinant() < 0.0 {
        let mut u = u;
        // The smallest singular value's direction is the cheapest to flip.
        let smallest = svd.singular_values.imin();
        u.column_mut(smallest).neg_mut();
        r = u * vt;
    }
    Some(Mat3::from_cols_slice(r.as_slice()))
}

struct Agreement {
    weight: f64,
    weight_share: f64,
    shares: [f64; 3],
    rms_deg: f64,
}

fn agreement(normals: &[&Surfel], frame: Mat3) -> Agreement {
    let columns = [frame.x_axis, frame.y_axis, frame.z_axis];
    let limit = WIDTH_DEG[1].to_radians();
    let (mut all, mut inside, mut score, mut squares) = (0.0, 0.0, 0.0, 0.0);
    let mut by_axis = [0.0; 3];
    for s in normals {
        let (axis, dot) = nearest(&columns, s.normal);
        let angle = dot.abs().min(1.0).acos();
        all += s.weight;
        if angle < limit {
            inside += s.weight;
            by_axis[axis] += s.weight;
            squares += s.weight * angle * angle;
            score += s.weight * biweight(angle / limit);
        }
    }
    let total = inside.max(f64::MIN_POSITIVE);
    Agreement {
        weight: score,
        weight_share: inside / all.max(f64::MIN_POSITIVE),
        shares: by_axis.map(|b| b / total),
        rms_deg: (squares / total).sqrt().to_degrees(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud(frame: Mat3, noise: f64) -> Surfels {
        // A quarter floor, a wall of each direction, and clutter on a spiral.
        let cells = (0..2000u32)
            .map(|i| {
                let k = f64::from(i);
                let wobble = Vec3::new((k * 1.7).sin(), (k * 2.3).sin(), (k * 3.1).sin()) * noise;
                let clean = match i % 5 {
                    0 => frame.x_axis,
                    1 | 2 => frame.y_axis,
                    3 => frame.z_axis,
                    _ => Vec3::new((k * 0.37).sin(), (k * 0.11).cos(), (k * 0.73).cos()),
                };
                let normal = (clean + wobble).normalize();
                Surfel { point: Vec3::Z, normal, weight: 1.0, depth: 1.0, row: 0.5, column: 0.5 }
            })
            .collect();
        Surfels { cells, cell_px: 1, usable_points: 2000, median_depth: 1.0 }
    }

    proptest! {
        #[test]
        fn the_frame_is_found_whatever_the_yaw_and_tilt(
            yaw in -45.0f64..45.0, tilt in -15.0f64..35.0, roll in -6.0f64..6.0, noise in 0.0f64..0.15,
        ) {
            let truth = Mat3::from_rotation_z(roll.to_radians())
                * Mat3::from_rotation_x(tilt.to_radians())
                * Mat3::from_rotation_y(yaw.to_radians());
            let found = manhattan_frame(&cloud(truth, noise), Mat3::IDENTITY, 0.0).unwrap();
            let off = found.axes.vertical.dot(truth.y_axis).abs().min(1.0).acos().to_degrees();
            prop_assert!(off <= 1.0, "vertical off by {off} degrees");
            let side = found.axes.width.dot(truth.x_axis).abs().max(found.axes.width.dot(truth.z_axis).abs());
            prop_assert!(side.min(1.0).acos().to_degrees() <= 1.0);
        }

        #[test]
        fn oriented_axes_are_a_rotation_that_looks_along_minus_z(
            yaw in -180.0f64..180.0, tilt in -40.0f64..40.0, flips in 0u8..8,
        ) {
            let r = Mat3::from_rotation_x(tilt.to_radians()) * Mat3::from_rotation_y(yaw.to_radians());
            let sign = |bit: u8| if flips & (1 << bit) == 0 { 1.0 } else { -1.0 };
            let axes = ManhattanAxes {
                width: r.x_axis * sign(0), vertical: r.y_axis * sign(1), depth: r.z_axis * sign(2),
            };
            // OpenCV camera axes in the points frame: up is -y, forward is z.
            let o = axes.oriented(Vec3::NEG_Y, Vec3::Z);
            prop_assert!((o.r_align().determinant() - 1.0).abs() <= 1e-12);
            prop_assert!(o.vertical.dot(Vec3::NEG_Y) >= 0.0);
            let forward = o.r_align() * Vec3::Z;
            prop_assert!(forward.z <= 0.0 && forward.z.abs() + 1e-12 >= forward.x.abs());
        }
    }

    #[test]
    fn squared_angles_are_those_of_the_arc_cosine() {
        for k in 0..=450 {
            let angle = f64::from(k).mul_add(0.1, 0.0).to_radians();
            let found = squared_angle(1.0 - angle.cos());
            assert!((found - angle * angle).abs() <= 1e-9, "{k}: {found} for {}", angle * angle);
        }
        assert_eq!(squared_angle(-1e-17), 0.0, "a cosine that rounding took over 1");
    }

    #[test]
    fn a_lone_wall_gives_a_level_frame() {
        let mut surfels = cloud(Mat3::IDENTITY, 0.0);
        let wall = Vec3::new(0.3, 0.1, -0.9).normalize();
        for s in &mut surfels.cells {
            s.normal = wall;
        }
        let f = manhattan_frame(&surfels, Mat3::IDENTITY, 0.0).unwrap();
        assert!(f.axes.vertical.x.abs() <= 1e-9, "up has no sideways part in the camera: no roll");
        assert!(f.axes.vertical.dot(wall).abs() <= 1e-9);
    }
}
