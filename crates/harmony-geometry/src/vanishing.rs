//! Focal length and rotation of a single image, from its line segments.
//!
//! A Manhattan room has three vanishing points, and they are what a focal length, a tilt, a roll and a yaw make of
//! three axes. So these four numbers are searched, not the points: over a grid of focal length, tilt and roll every
//! segment says whether it is vertical, and otherwise under which yaw (mod 90 degrees) it is horizontal; the best cells
//! are refined by robust least squares of the angles between segments and the lines to their vanishing points.
//! The idea of voting on the horizon is that of J.-C. Bazin et al. (CVPR 2012) and of H. Wildenauer and A. Hanbury
//! (CVPR 2012); ours is a plain exhaustive version. Weak regimes: a camera that faces a wall squarely and level shows
//! one finite vanishing point, so the focal length stays the prior's (`FocalSource::Assumed`); textile patterns and
//! slanted roofs can outvote a bare room.

use harmony_scene::{ImageSize, Intrinsics, Mat3, Vec2, Vec3};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use crate::least_squares::{Solution, minimise_with, robust, robust_slope};
use crate::{CameraHints, GrayImage, LineSegment, detect_segments};

/// Focal length over image diagonal of a typical room photo, and one sigma of its logarithm: phones 0.60, sensors
/// (Kinect, ScanNet) 0.66 to 0.72, wide-angle pictures of estate agents 0.4 to 0.5.
const TYPICAL_FOCAL: f64 = 0.58;
const TYPICAL_SIGMA: f64 = 0.22;
/// A prior sharper than this is knowledge.
const KNOWN_SIGMA: f64 = 0.05;
/// Focal lengths outside of this (of the diagonal) are not looked at.
const FOCAL_RANGE: [f64; 2] = [0.3, 2.5];
/// Grid of focal lengths in sigmas of the prior, tilts and rolls (degrees).
const GRID_FOCALS: [f64; 7] = [0.0, -0.7, 0.7, -1.4, 1.4, -2.2, 2.2];
const GRID_TILTS_DEG: [f64; 3] = [-32.5, 52.5, 2.5];
const GRID_ROLLS_DEG: [f64; 3] = [-7.5, 7.5, 1.5];
/// Yaw bins over the 90 degrees after which a frame repeats.
const YAW_BINS: usize = 45;
/// Softness of the grid's votes, degrees.
const GRID_SIGMA_DEG: f64 = 1.5;
/// What photos are like: tilt and roll, degrees (mean, sigma).
const USUAL_TILT_DEG: [f64; 2] = [5.0, 15.0];
const USUAL_ROLL_DEG: [f64; 2] = [0.0, 2.0];
/// Segments used: the longest ones, and none shorter than this share of the diagonal.
const MAX_SEGMENTS: usize = 220;
const SHORTEST_SHARE: f64 = 0.022;
/// Accuracy of a segment's direction: ends in working pixels (of 960), and what bends in lenses and walls, degrees.
const END_SIGMA_PX: f64 = 0.8;
const BEND_SIGMA_DEG: f64 = 0.35;
/// Robust limit, sigmas, and the weight that neighbouring, correlated segments leave to each.
const LIMIT_SIGMAS: f64 = 3.0;
const EACH_WEIGHT: f64 = 0.15;
/// Lines along the border this close to it (share of the image) are a picture's frame, not the room's.
const FRAME_BAND: f64 = 0.02;
/// Candidates of the grid that are refined.
const CANDIDATES: usize = 10;

/// What is known of the focal length before looking (EXIF, a lens table).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FocalPrior {
    /// Focal length, pixels of the image.
    pub focal_px: f64,
    /// One sigma of its natural logarithm: 0.03 for EXIF, 0.25 for "a typical lens".
    pub sigma: f64,
}

/// Where the focal length comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FocalSource {
    /// Given (a prior with a small sigma).
    Known,
    /// From orthogonal vanishing points.
    Estimated,
    /// Nothing in the image fixes it: the prior's, or a typical lens.
    Assumed,
}

/// What the lines of one image tell about its camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewEstimate {
    /// The image all pixels speak about.
    pub size: ImageSize,
    /// Square pixels, centred principal point.
    pub intrinsics: Intrinsics,
    /// `camera_from_manhattan` (OpenCV camera): columns are the room's +X, +Y (up) and +Z in the camera; the camera
    /// looks towards the room's -Z, turned by at most 45 degrees.
    pub rotation: Mat3,
    /// Where the focal length comes from.
    pub focal: FocalSource,
    /// One sigma of the focal length's logarithm.
    pub focal_sigma: f64,
    /// What was believed of the focal length before looking.
    pub focal_prior: FocalPrior,
    /// Share of the total segment length that points to the vanishing point of x, y, z.
    pub support: [f64; 3],
    /// Number of segments that point to the vanishing point of x, y, z.
    pub counts: [usize; 3],
    /// 0 (the default camera) to 1 (many long segments agree).
    pub confidence: f64,
    /// The segments, pixels of `size`, with the axis (0 x, 1 y, 2 z) each points to.
    pub segments: Vec<(LineSegment, Option<u8>)>,
}

impl ViewEstimate {
    /// Share of the total segment length that points to the vanishing points of another rotation and focal length (pixels of
    /// `size`).
    pub(crate) fn explained_by(&self, rotation: &Mat3, focal_px: f64) -> f64 {
        let search = Search::new(self.size, &[], None);
        let (mut explained, mut total) = (0.0, 0.0);
        for s in self.segments.iter().map(|(s, _)| s).filter(|s| s.length() >= search.shortest) {
            total += s.length();
            if search.line(s).and_then(|line| line.axis(focal_px, rotation)).is_some() {
                explained += s.length();
            }
        }
        if total > 0.0 { explained / total } else { 0.0 }
    }

    /// A view from a model's hints alone: known lens, tilt and yaw as hinted (0 where not), no roll, no lines.
    pub fn from_hints(size: ImageSize, intrinsics: Intrinsics, hints: &CameraHints) -> Self {
        let degrees = |v: Option<f64>, limit: f64| v.filter(|v| v.abs() <= limit).unwrap_or(0.0).to_radians();
        let (tilt, yaw) = (degrees(hints.tilt_deg, 80.0), degrees(hints.yaw_deg, 90.0));
        Self {
            size,
            intrinsics,
            rotation: camera_rotation(yaw, tilt, 0.0),
            focal: FocalSource::Known,
            focal_sigma: 0.01,
            focal_prior: FocalPrior { focal_px: intrinsics.fx, sigma: 0.01 },
            support: [0.0; 3],
            counts: [0; 3],
            confidence: 0.0,
            segments: vec![],
        }
    }

    /// Downward tilt of the optical axis, degrees.
    pub fn tilt_deg(&self) -> f64 {
        let forward = self.rotation.transpose() * Vec3::Z;
        -forward.y.clamp(-1.0, 1.0).asin().to_degrees()
    }

    /// Roll, radians, as in [`camera_rotation`].
    pub fn roll(&self) -> f64 {
        // The room's up in the camera is (sin roll, -cos roll) * cos tilt in x and y.
        let up = self.rotation.y_axis;
        (-up.x).atan2(-up.y)
    }

    /// Turn to the left (positive) from facing the back wall squarely, degrees.
    pub fn yaw_deg(&self) -> f64 {
        let forward = self.rotation.transpose() * Vec3::Z;
        (-forward.x).atan2(-forward.z).to_degrees()
    }
}

/// `camera_from_room` rotation of a camera turned left by `yaw`, down by `tilt` and clockwise by `roll`, radians.
///
/// With all three 0 it faces the back wall squarely.
pub fn camera_rotation(yaw: f64, tilt: f64, roll: f64) -> Mat3 {
    // Facing -Z, level: camera x = +X, y = -Y, z = -Z.
    let facing = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
    Mat3::from_rotation_z(-roll) * Mat3::from_rotation_x(tilt) * facing * Mat3::from_rotation_y(-yaw)
}

/// Derivatives of [`camera_rotation`] by yaw, tilt and roll.
pub(crate) fn rotation_slopes(yaw: f64, tilt: f64, roll: f64) -> [Mat3; 3] {
    const STEP: f64 = 1e-5;
    let slope = |d: [f64; 3]| {
        let at = |k: f64| camera_rotation(yaw + k * d[0], tilt + k * d[1], roll + k * d[2]);
        (at(STEP) - at(-STEP)) * (0.5 / STEP)
    };
    [slope([1.0, 0.0, 0.0]), slope([0.0, 1.0, 0.0]), slope([0.0, 0.0, 1.0])]
}

/// Focal length and rotation of one image. Never fails: without evidence it is a level camera with a typical
/// lens and confidence 0. Any size will do; the work is done on at most 960 pixels.
pub fn estimate_view(image: &GrayImage, focal_prior: Option<FocalPrior>) -> ViewEstimate {
    estimate_view_from_segments(image.size(), detect_segments(image), focal_prior)
}

/// [`estimate_view`] from segments found elsewhere (pixels of `size`).
pub fn estimate_view_from_segments(
    size: ImageSize,
    segments: Vec<LineSegment>,
    focal_prior: Option<FocalPrior>,
) -> ViewEstimate {
    let segments: Vec<LineSegment> = segments.into_iter().filter(|s| !is_frame(s, size)).collect();
    let search = Search::new(size, &segments, focal_prior);
    let found = search.best();
    let (intrinsics, rotation) = (Intrinsics::centred(size, found.focal()), found.rotation());
    let focal = if search.focal_sigma <= KNOWN_SIGMA {
        FocalSource::Known
    } else if found.focal_sigma <= 0.10 && found.focal_sigma <= 0.6 * search.focal_sigma {
        FocalSource::Estimated
    } else {
        FocalSource::Assumed
    };

    let (mut support, mut counts, mut total) = ([0.0; 3], [0; 3], 0.0);
    let labelled: Vec<(LineSegment, Option<u8>)> = segments
        .into_iter()
        .map(|s| {
            let axis = search.line(&s).and_then(|line| line.axis(found.focal(), &rotation));
            if s.length() >= search.shortest {
                total += s.length();
                if let Some(k) = axis {
                    support[usize::from(k)] += s.length();
                    counts[usize::from(k)] += 1;
                }
            }
            (s, axis)
        })
        .collect();
    let support = support.map(|v| if total > 0.0 { v / total } else { 0.0 });
    ViewEstimate {
        size,
        intrinsics,
        rotation,
        focal,
        focal_sigma: found.focal_sigma.min(search.focal_sigma),
        focal_prior: FocalPrior { focal_px: search.focal_log.exp(), sigma: search.focal_sigma },
        support,
        counts,
        confidence: confidence(support, counts),
        segments: labelled,
    }
}

/// Whether a segment is the edge of a frame around the picture: close to the border and parallel to it.
fn is_frame(s: &LineSegment, size: ImageSize) -> bool {
    let (w, h) = (f64::from(size.width), f64::from(size.height));
    let near = |a: f64, b: f64, full: f64| {
        let band = FRAME_BAND * full;
        (a.max(b) < band || a.min(b) > full - band) && (a - b).abs() < 0.01 * full
    };
    near(s.start.x, s.end.x, w) && s.length() > 0.1 * h || near(s.start.y, s.end.y, h) && s.length() > 0.1 * w
}

/// Chance alone puts some 15 % of all segments near one of three vanishing points.
fn confidence(support: [f64; 3], counts: [usize; 3]) -> f64 {
    let explained = ((support.iter().sum::<f64>() - 0.15) / 0.5).clamp(0.0, 1.0);
    let vertical = (counts[1] as f64 / 4.0).min(1.0);
    let horizontal = ((counts[0] + counts[2]) as f64 / 6.0).min(1.0);
    explained * (0.3 + 0.7 * vertical) * (0.3 + 0.7 * horizontal)
}

/// A segment relative to the image centre.
#[derive(Debug, Clone, Copy)]
struct Line {
    middle: Vec2,
    direction: Vec2,
    ends: [Vec2; 2],
    /// One sigma of its direction, radians.
    sigma: f64,
}

impl Line {
    /// Angle to the line from its middle to the vanishing point of a camera-frame direction, radians, signed.
    fn angle_to(&self, focal: f64, axis: Vec3) -> f64 {
        angle(self.sides_to(focal, axis))
    }

    /// The nearest of three vanishing points, and the sides of its triangle, which tell.
    fn nearest(&self, focal: f64, axes: [Vec3; 3]) -> (usize, [f64; 2]) {
        let [a, b, c] = axes.map(|axis| self.sides_to(focal, axis));
        let steeper = |p: [f64; 2], q: [f64; 2]| p[0].abs() * q[1].abs() > q[0].abs() * p[1].abs();
        let nearer = if steeper(a, b) { (1, b) } else { (0, a) };
        if steeper(nearer.1, c) { (2, c) } else { nearer }
    }

    /// The angle's opposite and adjacent side; a vanishing point at the middle is at a right angle.
    fn sides_to(&self, focal: f64, axis: Vec3) -> [f64; 2] {
        let to = Vec2::new(axis.x, axis.y) * focal - self.middle * axis.z;
        let (cross, dot) = (self.direction.perp_dot(to), self.direction.dot(to));
        if cross == 0.0 && dot == 0.0 { [1.0, 0.0] } else { [cross, dot] }
    }

    /// The axis whose vanishing point it points to, if any.
    fn axis(&self, focal: f64, rotation: &Mat3) -> Option<u8> {
        let angles = [0, 1, 2].map(|k| self.angle_to(focal, rotation.col(k)).abs());
        let k = (0..3).min_by(|a, b| angles[*a].total_cmp(&angles[*b]))?;
        (angles[k] <= (LIMIT_SIGMAS * self.sigma).max(1f64.to_radians())).then_some(k as u8)
    }
}

/// The angle of opposite and adjacent side, a line's: within a quarter turn.
fn angle([cross, dot]: [f64; 2]) -> f64 {
    if dot < 0.0 { (-cross).atan2(-dot) } else { cross.atan2(dot) }
}

/// One set of the four numbers: ln focal, yaw, tilt, roll.
#[derive(Debug, Clone)]
struct Candidate {
    parameters: [f64; 4],
    focal_sigma: f64,
    cost: f64,
}

impl Candidate {
    fn focal(&self) -> f64 {
        self.parameters[0].exp()
    }

    fn rotation(&self) -> Mat3 {
        camera_rotation(self.parameters[1], self.parameters[2], self.parameters[3])
    }
}

pub(crate) struct Search {
    centre: Vec2,
    shortest: f64,
    /// Image pixels to a working pixel.
    pixel: f64,
    lines: Vec<Line>,
    focal_log: f64,
    focal_sigma: f64,
    log_range: [f64; 2],
}

impl Search {
    pub(crate) fn new(size: ImageSize, segments: &[LineSegment], prior: Option<FocalPrior>) -> Self {
        let (w, h) = (f64::from(size.width.max(1)), f64::from(size.height.max(1)));
        let diagonal = w.hypot(h);
        let typical = FocalPrior { focal_px: TYPICAL_FOCAL * diagonal, sigma: TYPICAL_SIGMA };
        let prior = prior
            .filter(|p| p.focal_px > 0.05 * diagonal && p.focal_px < 50.0 * diagonal && p.sigma > 0.0)
            .unwrap_or(typical);
        let log = prior.focal_px.ln();
        let mut search = Self {
            centre: Vec2::new(w, h) / 2.0,
            shortest: SHORTEST_SHARE * diagonal,
            pixel: w.max(h) / 960.0,
            lines: vec![],
            focal_log: log,
            focal_sigma: prior.sigma.clamp(1e-3, 1.0),
            log_range: [log.min((FOCAL_RANGE[0] * diagonal).ln()), log.max((FOCAL_RANGE[1] * diagonal).ln())],
        };
        let mut long: Vec<&LineSegment> = segments.iter().filter(|s| s.length() >= search.shortest).collect();
        long.sort_by(|a, b| b.length().total_cmp(&a.length()));
        long.truncate(MAX_SEGMENTS);
        search.lines = long.into_iter().filter_map(|s| search.line(s)).collect();
        search
    }

    fn line(&self, s: &LineSegment) -> Option<Line> {
        let length = s.length();
        if !(length > 1e-6 && length.is_finite()) {
            return None;
        }
        let ends = (END_SIGMA_PX * self.pixel * std::f64::consts::SQRT_2 / length).atan();
        Some(Line {
            middle: s.middle() - self.centre,
            direction: s.direction(),
            ends: [s.start - self.centre, s.end - self.centre],
            sigma: ends.hypot(BEND_SIGMA_DEG.to_radians()),
        })
    }

    fn best(&self) -> Candidate {
        let level = Candidate {
            parameters: [self.focal_log, 0.0, USUAL_TILT_DEG[0].to_radians(), 0.0],
            focal_sigma: self.focal_sigma,
            cost: f64::INFINITY,
        };
        if self.lines.len() < 3 {
            // Too little to say anything: level, for a picture without lines suggests no tilt.
            return Candidate { parameters: [self.focal_log, 0.0, 0.0, 0.0], ..level };
        }
        self.grid()
            .iter()
            .map(|start| self.refine(*start))
            .chain(std::iter::once(self.refine(level.parameters)))
            .min_by(|a, b| a.cost.total_cmp(&b.cost))
            .unwrap_or(level)
    }

    /// The best cells of the grid, one per neighbourhood.
    fn grid(&self) -> Vec<[f64; 4]> {
        let steps = |[low, high, step]: [f64; 3]| {
            (0..=((high - low) / step).round() as usize).map(move |i| (low + step * i as f64).to_radians())
        };
        let focals: &[f64] = if self.focal_sigma <= KNOWN_SIGMA { &GRID_FOCALS[..1] } else { &GRID_FOCALS };
        let mut cells: Vec<(f64, [f64; 4])> = Vec::new();
        for sigmas in focals {
            let log = (self.focal_log + sigmas * self.focal_sigma).clamp(self.log_range[0], self.log_range[1]);
            for tilt in steps(GRID_TILTS_DEG) {
                for roll in steps(GRID_ROLLS_DEG) {
                    let (votes, yaw) = self.vote(log.exp(), tilt, roll);
                    let unusual = ((tilt.to_degrees() - USUAL_TILT_DEG[0]) / USUAL_TILT_DEG[1]).powi(2)
                        + (roll.to_degrees() / USUAL_ROLL_DEG[1]).powi(2)
                        + sigmas * sigmas;
                    cells.push((votes - 0.5 * unusual, [log, yaw, tilt, roll]));
                }
            }
        }
        cells.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut chosen: Vec<[f64; 4]> = Vec::new();
        for (_, cell) in cells {
            let near = |other: &[f64; 4]| {
                let yaw = (cell[1] - other[1]).abs();
                let yaw = yaw.min(std::f64::consts::FRAC_PI_2 - yaw);
                (cell[0] - other[0]).abs() < 0.25
                    && yaw < 8f64.to_radians()
                    && (cell[2] - other[2]).abs() < 6f64.to_radians()
                    && (cell[3] - other[3]).abs() < 4f64.to_radians()
            };
            if !chosen.iter().any(near) {
                chosen.push(cell);
                if chosen.len() == CANDIDATES {
                    break;
                }
            }
        }
        chosen
    }

    /// Votes for a focal length, tilt and roll under the best yaw, and that yaw.
    fn vote(&self, focal: f64, tilt: f64, roll: f64) -> (f64, f64) {
        let base = camera_rotation(0.0, tilt, roll);
        let up = base.y_axis;
        let spread = GRID_SIGMA_DEG.to_radians();
        let mut bins = [0.0; YAW_BINS];
        let mut vertical = 0.0;
        for line in &self.lines {
            let softness = line.sigma.hypot(spread);
            let k = line.angle_to(focal, up) / softness;
            let upright = (-0.5 * k * k).exp();
            vertical += upright;
            let plane = line.ends[0].extend(focal).cross(line.ends[1].extend(focal)).normalize_or_zero();
            let level = plane.cross(up);
            // A segment on the horizon lies in every vertical plane: it says nothing about the yaw.
            let sharp = level.length();
            if sharp < 0.02 {
                continue;
            }
            let in_room = base.transpose() * level;
            // Direction in the ground plane; turning the camera left by the yaw makes it an axis.
            let angle = in_room.x.atan2(in_room.z).rem_euclid(std::f64::consts::FRAC_PI_2);
            let x = angle / std::f64::consts::FRAC_PI_2 * YAW_BINS as f64;
            bins[(x as usize).min(YAW_BINS - 1)] += (1.0 - upright) * sharp.sqrt();
        }
        let smooth = |i: usize| {
            let at = |k: usize| bins[(i + YAW_BINS + k - 1) % YAW_BINS];
            0.5 * at(0) + at(1) + 0.5 * at(2)
        };
        let (best, votes) =
            (0..YAW_BINS).map(|i| (i, smooth(i))).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
        let mut yaw = -(best as f64 + 0.5) / YAW_BINS as f64 * std::f64::consts::FRAC_PI_2;
        if yaw < -std::f64::consts::FRAC_PI_4 {
            yaw += std::f64::consts::FRAC_PI_2;
        }
        (vertical + votes, yaw)
    }

    fn refine(&self, start: [f64; 4]) -> Candidate {
        let residuals = |p: &[f64], out: &mut Vec<f64>| self.residuals(p, out);
        let Solution { parameters, cost, sigmas, .. } = minimise_with(&start, 40, residuals, |p, rows| {
            let slopes = self.slopes(p);
            DMatrix::from_fn(rows, 4, |row, column| slopes[row][column])
        });
        let [log, yaw, tilt, roll] = [parameters[0], parameters[1], parameters[2], parameters[3]];
        // A frame repeats every quarter turn; back to the turn that is at most 45 degrees.
        let quarter = std::f64::consts::FRAC_PI_2;
        let yaw = yaw - (yaw / quarter).round() * quarter;
        Candidate { parameters: [log, yaw, tilt, roll], focal_sigma: sigmas[0], cost }
    }

    /// Lines that are looked at: as many of the first residuals are theirs.
    pub(crate) fn count(&self) -> usize {
        self.lines.len()
    }

    /// Pushes what four numbers (ln focal, yaw, tilt, roll) leave of the segments and of what photos are like;
    /// each in sigmas. The number of residuals is fixed.
    pub(crate) fn residuals(&self, p: &[f64], out: &mut Vec<f64>) {
        let log = p[0].clamp(self.log_range[0], self.log_range[1]);
        let rotation = camera_rotation(p[1], p[2], p[3]);
        let focal = log.exp();
        let weight = EACH_WEIGHT.sqrt();
        let axes = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
        for line in &self.lines {
            let (_, sides) = line.nearest(focal, axes);
            out.push(weight * robust(angle(sides) / line.sigma, LIMIT_SIGMAS));
        }
        out.push((p[0] - self.focal_log) / self.focal_sigma);
        out.push((p[0] - log) / 0.01);
        out.push((p[2].to_degrees() - USUAL_TILT_DEG[0]) / USUAL_TILT_DEG[1]);
        out.push((p[3].to_degrees() - USUAL_ROLL_DEG[0]) / USUAL_ROLL_DEG[1]);
    }

    /// Residuals after those of the lines.
    pub(crate) const BESIDE_LINES: usize = 4;

    /// Derivatives of [`Self::residuals`] by the four numbers, row by row.
    pub(crate) fn slopes(&self, p: &[f64]) -> Vec<[f64; 4]> {
        let log = p[0].clamp(self.log_range[0], self.log_range[1]);
        let inside = if log == p[0] { 1.0 } else { 0.0 };
        let rotation = camera_rotation(p[1], p[2], p[3]);
        let turns = rotation_slopes(p[1], p[2], p[3]);
        let focal = log.exp();
        let weight = EACH_WEIGHT.sqrt();
        let axes = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
        let mut out = Vec::with_capacity(self.lines.len() + Self::BESIDE_LINES);
        for line in &self.lines {
            let (nearest, [cross, dot]) = line.nearest(focal, axes);
            let (axis, hypot) = (axes[nearest], cross * cross + dot * dot);
            let slope = weight * robust_slope(angle([cross, dot]) / line.sigma, LIMIT_SIGMAS) / (line.sigma * hypot);
            let of = |to: Vec2| {
                let s = slope * (dot * line.direction.perp_dot(to) - cross * line.direction.dot(to));
                if s.is_finite() { s } else { 0.0 }
            };
            let turned = |turn: &Mat3| {
                let axis = turn.col(nearest);
                of(Vec2::new(axis.x, axis.y) * focal - line.middle * axis.z)
            };
            let [yaw, tilt, roll] = &turns;
            out.push([of(Vec2::new(axis.x, axis.y) * (focal * inside)), turned(yaw), turned(tilt), turned(roll)]);
        }
        out.push([1.0 / self.focal_sigma, 0.0, 0.0, 0.0]);
        out.push([(1.0 - inside) / 0.01, 0.0, 0.0, 0.0]);
        out.push([0.0, 0.0, 1f64.to_degrees() / USUAL_TILT_DEG[1], 0.0]);
        out.push([0.0, 0.0, 0.0, 1f64.to_degrees() / USUAL_ROLL_DEG[1]]);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn angles_come_back_from_a_rotation(
            yaw in -0.78f64..0.78, tilt in -1.0f64..1.0, roll in -0.3f64..0.3,
        ) {
            let size = ImageSize::new(640, 480);
            let mut view = ViewEstimate::from_hints(size, Intrinsics::centred(size, 500.0), &CameraHints::default());
            view.rotation = camera_rotation(yaw, tilt, roll);
            prop_assert!((view.yaw_deg().to_radians() - yaw).abs() <= 1e-9);
            prop_assert!((view.tilt_deg().to_radians() - tilt).abs() <= 1e-9);
            prop_assert!((view.roll() - roll).abs() <= 1e-9);
        }
    }
}
