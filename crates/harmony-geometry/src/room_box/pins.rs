//! The camera and the box from pinned room edges.
//!
//! Nine unknowns (focal length, yaw, tilt, roll, and the distances to left, right, floor, ceiling and back) by
//! robust least squares (Levenberg-Marquardt) on: distances of pins to the images of their edges; angles of the
//! image's segments to their vanishing points; what the prior says about room and camera, each with its sigma. Floor
//! and ceiling distance add up to the prior's height, which is the metric reference, as in the paper. So a picture with
//! one good pin is pulled to it and the rest stays what the prior says; with six the prior hardly matters. With many
//! pins that no centred camera fits, the principal point may move up or down (a shifted lens, straightened verticals).
//!
//! Some pins are wrong. The losses saturate, and the solver starts several times: from the measured view, from the
//! view a quarter turn on (the prior may call the other wall "back"), from the hinted angles, and without each of the
//! pinned edges in turn; the least total cost wins.

use std::f64::consts::FRAC_PI_2;

use harmony_scene::{Camera, Extents, ImageSize, Vec2, Vec3};

use super::edges::image_evidence;
use super::solved::CameraBox;
use super::{RoomBox, RoomBoxEvidence, RoomBoxMethod, SolveError, USUAL_CAMERA_HEIGHT, finish, sane};
use crate::calibration::TOLD_HEIGHT_SIGMA;
use crate::least_squares::{differences, minimise, robust};
use crate::vanishing::Search;
use crate::{
    FocalPrior, GrayImage, LayoutPrior, LineSegment, RoomEdge, RoomPosterior, ViewEstimate, WallSide, camera_rotation,
    median, room_unknowns,
};

use RoomEdge as E;

/// One sigma of a pin, share of the photo's diagonal.
const PIN_SIGMA: f64 = 0.005;
/// One sigma of the layout answer's own corner and junction row: they are rougher than pins.
const HINT_SIGMA: f64 = 0.012;
/// Saturation of the losses, sigmas.
const LIMIT: f64 = 3.0;
/// A pin farther off than this many sigmas is called wrong.
const WRONG: f64 = 4.0;
/// Sigmas of the logarithms of the prior's lengths: camera height (hinted, usual), width, distance to back.
const HEIGHT_SIGMA: [f64; 2] = [0.15, 0.22];
const WIDTH_SIGMA: f64 = 0.25;
const BACK_SIGMA: [f64; 2] = [0.25, 0.4];
/// One sigma of left against right where nothing says where the camera stands (logarithm of the ratio).
const SIDE_SIGMA: f64 = 0.8;
/// One sigma of hinted tilt and yaw, degrees: weak, they only break ties.
const ANGLE_SIGMA_DEG: f64 = 12.0;
/// Largest pin RMS that is still agreement, share of the diagonal.
const AGREE: f64 = 0.03;
/// Least distance of the camera from a wall that nothing speaks of, metres.
const SIDE_MARGIN: f64 = 0.3;
/// Groups of pins that are left out in turn, at most.
const MAX_GROUPS: usize = 12;
/// Pins used at most, and how far outside the image a pin may lie (shares of its sides).
const MAX_PINS: usize = 80;
const OUTSIDE: f64 = 1.0;

/// Vertical shifts of the principal point that are tried: one sigma and farthest, shares of the image's height.
const SHIFT_SIGMA: f64 = 0.1;
const MAX_SHIFT: f64 = 0.35;
/// A shift is looked for when so many pins are given and their RMS is above this share of the diagonal (or some are
/// called wrong), and kept when it lowers the cost by this much.
const SHIFT_PINS: usize = 8;
const SHIFT_RMS: f64 = 0.0015;
/// Least sigma of a pin while a shift is looked for, share of the diagonal.
const SHARP_SIGMA: f64 = 0.0012;
const SHIFT_GAIN: f64 = 8.0;

/// A pin relative to the principal point (at first the image centre).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pin {
    pub edge: RoomEdge,
    pub point: Vec2,
    pub sigma: f64,
    /// Pins of one group (an edge, a corner) are right or wrong together.
    pub group: usize,
    /// Given as a pin, not as a hint of the layout answer.
    pub given: bool,
}

/// Camera and box by least squares on pinned edges, the view's vanishing directions and the prior
/// (key `cam.pins`, beyond the paper, whose Sec. 3.1 refines the camera of the language model by corner pinning).
///
/// The hinted corner and junction row of `prior.camera` count as rough pins.
///
/// # Errors
/// [`SolveError`] when there is no usable pin or they contradict each other.
pub fn solve_from_pins(view: &ViewEstimate, prior: &LayoutPrior) -> Result<RoomBox, SolveError> {
    solve_with_image(None, view, prior)
}

/// [`solve_from_pins`]; with the image, its colours help to tell right pins from wrong ones.
pub(super) fn solve_with_image(
    image: Option<&GrayImage>,
    view: &ViewEstimate,
    prior: &LayoutPrior,
) -> Result<RoomBox, SolveError> {
    let prior = sane(prior);
    let found = solve_in_height(image, view, &prior)?;
    if prior.ceiling_seen {
        return Ok(found);
    }
    let (height, top) = (prior.extents.height, top_of_picture(&found.camera, &found.extents));
    match top.map(|top| (CLEAR * top).min(MAX_RAISED * height)).filter(|higher| *higher > height) {
        Some(height) => {
            let extents = Extents { height, ..prior.extents };
            solve_in_height(image, view, &LayoutPrior { extents, ..prior })
        }
        None => Ok(found),
    }
}

/// The height that the walls have at least where the photo shows no ceiling: that of what its upper border shows of them, metres.
fn top_of_picture(camera: &Camera, e: &Extents) -> Option<f64> {
    let at = |k: u32| {
        let ray = camera.ray(Vec2::new(f64::from(k) / f64::from(TOP_RAYS) * f64::from(camera.size.width), 0.0));
        let (o, d) = (ray.origin, ray.direction);
        let to = |from: f64, wall: f64, along: f64| Some((wall - from) / along).filter(|t| *t > 0.0 && t.is_finite());
        let walls = [to(o.x, 0.0, d.x), to(o.x, e.width, d.x), to(o.z, 0.0, d.z)];
        Some(o.y + walls.into_iter().flatten().reduce(f64::min)? * d.y)
    };
    (0..=TOP_RAYS).filter_map(at).reduce(f64::max)
}

/// [`solve_with_image`] in a room of the prior's height.
fn solve_in_height(image: Option<&GrayImage>, view: &ViewEstimate, prior: &LayoutPrior) -> Result<RoomBox, SolveError> {
    let pins = pins(prior);
    if pins.is_empty() {
        return Err(SolveError::TooFewPins { got: 0, min: 1 });
    }
    let mut problem = Problem::new(view, prior, pins.clone(), 0.0);
    let (mut candidates, mut iterations) = problem.solve();
    if let Some(shift) = problem.shift(view, &candidates, &mut iterations) {
        problem = Problem::new(view, prior, pins, shift);
        let (shifted, more) = problem.solve();
        candidates = shifted;
        iterations += more;
    }
    // Which pins are wrong is often open among the pins alone: the lines and colours of the photo decide.
    // (They are read around the middle of the image, so only where that is the principal point.)
    let speaks = |b: &CameraBox| if problem.shift == 0.0 { image_evidence(image, view, prior, b) } else { 0.0 };
    let solved = candidates
        .iter()
        .map(|(cost, p)| (problem.unpack(p), cost))
        .map(|(b, cost)| (b, speaks(&b) - cost))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or_else(|| problem.unpack(&problem.start(problem.view, None)), |(b, _)| b);
    let solved = problem.unpinned_sides(solved);
    let report = problem.report(&solved);
    let diagonal = diagonal(prior.photo);
    if report.used == 0 || report.rms.is_nan() || report.rms > AGREE * diagonal {
        return Err(SolveError::Disagree { rms_px: report.rms, limit_px: AGREE * diagonal });
    }
    let strength = (report.used as f64 / 6.0).min(1.0) * (report.used as f64 / report.given.max(1) as f64);
    let fit = (1.0 - report.rms / (AGREE * diagonal)).max(0.0);
    let confidence = (0.15 + 0.75 * strength * fit + 0.1 * view.confidence).clamp(0.0, 1.0);
    let evidence = RoomBoxEvidence {
        method: RoomBoxMethod::Pins,
        pin_rms_px: report.rms,
        pins_used: report.used,
        pins_given: report.given,
        pins_rejected: report.rejected,
        edge_support: 0.0,
        view_confidence: view.confidence,
        iterations,
        fallbacks: vec![],
    };
    Ok(RoomBox { posterior: Some(problem.posterior(&solved)), ..finish(&solved, prior, confidence, evidence) })
}

/// Number of points that were pinned (not hinted).
pub(super) fn pinned_points(prior: &LayoutPrior) -> usize {
    pins(prior).iter().filter(|p| p.given).count()
}

fn diagonal(size: ImageSize) -> f64 {
    f64::from(size.width).hypot(f64::from(size.height)).max(1.0)
}

/// Usable pins of a prior, then its hints.
pub(crate) fn pins(prior: &LayoutPrior) -> Vec<Pin> {
    let (w, h) = (f64::from(prior.photo.width), f64::from(prior.photo.height));
    let centre = Vec2::new(w, h) / 2.0;
    let diagonal = diagonal(prior.photo);
    let usable = |p: &Vec2| {
        p.x >= -OUTSIDE * w && p.x <= (1.0 + OUTSIDE) * w && p.y >= -OUTSIDE * h && p.y <= (1.0 + OUTSIDE) * h
    };
    let mut out = Vec::new();
    let mut group = 0;
    for pinned in &prior.pins.edges {
        let points: Vec<&Vec2> = pinned.points.iter().filter(|p| usable(p)).collect();
        // Many points of one edge are not many measurements.
        let sigma = PIN_SIGMA * diagonal * (points.len() as f64 / 2.0).sqrt().max(1.0);
        out.extend(points.iter().map(|p| Pin { edge: pinned.edge, point: **p - centre, sigma, group, given: true }));
        group += 1;
    }
    out.truncate(MAX_PINS);

    let hints = &prior.camera;
    if let Some(point) = hints.corner_px.map(Vec2::from_array).filter(usable) {
        let left_end = match hints.back_wall_side {
            Some(WallSide::Right) => true,
            Some(WallSide::Left) => false,
            Some(WallSide::Both) | None => point.x < centre.x,
        };
        let upright = if left_end { RoomEdge::BackLeft } else { RoomEdge::BackRight };
        let (at, sigma) = (point - centre, HINT_SIGMA * diagonal);
        out.extend([RoomEdge::FloorBack, upright].map(|edge| Pin { edge, point: at, sigma, group, given: false }));
    }
    if let Some(row) = hint(hints.floor_junction_y_frac, 0.0, 1.5) {
        let at = Vec2::new(0.0, row * h - centre.y);
        let sigma = 2.0 * HINT_SIGMA * diagonal;
        out.push(Pin { edge: RoomEdge::FloorBack, point: at, sigma, group: group + 1, given: false });
    }
    out
}

fn hint(value: Option<f64>, low: f64, high: f64) -> Option<f64> {
    value.filter(|v| (low..=high).contains(v))
}

/// Unknowns, in this order.
pub(crate) const LN_FOCAL: usize = 0;
pub(crate) const YAW: usize = 1;
pub(crate) const TILT: usize = 2;
pub(crate) const ROLL: usize = 3;
pub(crate) const LN_LEFT: usize = 4;
pub(crate) const LN_RIGHT: usize = 5;
/// Logit of floor distance over room height.
pub(crate) const FLOOR_LOGIT: usize = 6;
pub(crate) const LN_BACK: usize = 7;
type Unknowns = [f64; 8];
const STEPS: Unknowns = [1e-5; 8];
/// The posterior's further unknowns; one sigma of the scale, which nothing speaks of: no map has one of its own.
const LN_HEIGHT: usize = 8;
const LN_SCALE: usize = 9;
const SCALE_SIGMA: f64 = 0.3;

/// Rays through the photo's upper border that tell how high the walls are at least; how far above it an unseen ceiling lies
/// that was said to be lower, and how much it is raised at most (more is no wrong guess but a wrong view).
const TOP_RAYS: u32 = 8;
const CLEAR: f64 = 1.015;
const MAX_RAISED: f64 = 1.35;
/// One sigma of an unseen ceiling's height over that of the photo's upper border (logarithm): it has no metres of its own.
const UNSEEN_SIGMA: f64 = 0.02;

struct Problem<'a> {
    prior: &'a LayoutPrior,
    /// Principal point below the image centre, pixels; pins and lines are relative to it.
    shift: f64,
    pins: Vec<Pin>,
    lines: Search,
    view: [f64; 4],
    camera_height: f64,
    camera_height_sigma: f64,
    back: f64,
    back_sigma: f64,
}

struct Report {
    rms: f64,
    used: usize,
    given: usize,
    rejected: Vec<String>,
}

impl<'a> Problem<'a> {
    fn new(view: &ViewEstimate, prior: &'a LayoutPrior, mut pins: Vec<Pin>, shift: f64) -> Self {
        let by = Vec2::new(0.0, shift);
        for pin in &mut pins {
            pin.point -= by;
        }
        let photo = prior.photo;
        let k = f64::from(photo.width.max(1)) / f64::from(view.size.width.max(1));
        let segments: Vec<LineSegment> = view
            .segments
            .iter()
            .map(|(s, _)| LineSegment { start: s.start * k - by, end: s.end * k - by, strength: s.strength })
            .collect();
        let focal = FocalPrior { focal_px: view.focal_prior.focal_px * k, sigma: view.focal_prior.sigma };
        let height = prior.extents.height;
        let hinted = hint(prior.camera.height_m, 0.1, 0.97 * height);
        let camera_height = hinted.unwrap_or(USUAL_CAMERA_HEIGHT.min(0.7 * height));
        let distance = hint(prior.camera.dist_to_back_m, 0.2, 40.0);
        Self {
            prior,
            shift,
            pins,
            lines: Search::new(photo, &segments, Some(focal)),
            view: [
                (view.intrinsics.fx * k).ln(),
                view.yaw_deg().to_radians(),
                view.tilt_deg().to_radians(),
                view.roll(),
            ],
            camera_height,
            camera_height_sigma: HEIGHT_SIGMA[usize::from(hinted.is_none())],
            back: distance.unwrap_or(0.75 * prior.extents.depth),
            back_sigma: BACK_SIGMA[usize::from(distance.is_none())],
        }
    }

    fn unpack(&self, p: &Unknowns) -> CameraBox {
        self.unpack_in(p, self.prior.extents.height)
    }

    /// [`Self::unpack`] in a room of another height.
    fn unpack_in(&self, p: &[f64], height: f64) -> CameraBox {
        let floor = height / (1.0 + (-p[FLOOR_LOGIT]).exp());
        CameraBox {
            focal: p[LN_FOCAL].exp(),
            yaw: p[YAW],
            tilt: p[TILT],
            roll: p[ROLL],
            left: p[LN_LEFT].exp(),
            right: p[LN_RIGHT].exp(),
            floor,
            ceiling: height - floor,
            back: p[LN_BACK].exp(),
            shift: self.shift,
        }
    }

    /// The residuals at `p`; pins of the group `left_out` are 0.
    fn residuals(&self, p: &Unknowns, limit: f64, left_out: Option<usize>, out: &mut Vec<f64>) {
        let solved = self.unpack(p);
        self.of_image(&solved, p, limit, left_out, out);
        self.of_lengths(&solved, out);
    }

    /// What the photo shows, and what is said of the angles.
    fn of_image(&self, solved: &CameraBox, p: &[f64], limit: f64, left_out: Option<usize>, out: &mut Vec<f64>) {
        let rotation = solved.rotation();
        for pin in &self.pins {
            let off = solved.distance_to_edge(&rotation, pin.edge, pin.point) / pin.sigma;
            out.push(if Some(pin.group) == left_out { 0.0 } else { robust(off, limit) });
        }
        self.lines.residuals(&p[..4], out);
        let hints = &self.prior.camera;
        let angle = |value: f64, hinted: Option<f64>, wide: f64| match hint(hinted, -90.0, 90.0) {
            Some(h) => robust((value.to_degrees() - h) / ANGLE_SIGMA_DEG, limit),
            None => value.to_degrees() / wide,
        };
        out.push(angle(solved.tilt, hints.tilt_deg, 40.0));
        out.push(angle(solved.yaw, hints.yaw_deg, 40.0));
    }

    /// What is said of the lengths.
    fn of_lengths(&self, solved: &CameraBox, out: &mut Vec<f64>) {
        out.push((solved.floor / self.camera_height).ln() / self.camera_height_sigma);
        out.push(((solved.left + solved.right) / self.prior.extents.width).ln() / WIDTH_SIGMA);
        out.push((solved.left / solved.right).ln() / SIDE_SIGMA);
        out.push((solved.back / self.back).ln() / self.back_sigma);
    }

    /// How surely the solution is known, for whoever finds more that speaks of it.
    fn posterior(&self, solved: &CameraBox) -> RoomPosterior {
        let photo = self.prior.photo;
        let mean = room_unknowns(&solved.camera(photo), &solved.extents(0.0), 1.0);
        let lengths = |p: &[f64], out: &mut Vec<f64>| self.of_lengths(&self.unpack_in(p, p[LN_HEIGHT].exp()), out);
        let above = |p: &[f64]| {
            let solved = self.unpack_in(p, p[LN_HEIGHT].exp());
            top_of_picture(&solved.camera(photo), &solved.extents(0.0)).map(|top| p[LN_HEIGHT] - top.max(0.1).ln())
        };
        let unseen = above(&mean).filter(|_| !self.prior.ceiling_seen);
        let all = |p: &[f64], out: &mut Vec<f64>| {
            self.of_image(&self.unpack_in(p, p[LN_HEIGHT].exp()), p, LIMIT, None, out);
            lengths(p, out);
            out.push(match unseen {
                Some(mean) => above(p).map_or(0.0, |above| (above - mean) / UNSEEN_SIGMA),
                None => (p[LN_HEIGHT] - self.prior.extents.height.ln()) / TOLD_HEIGHT_SIGMA,
            });
            out.push(p[LN_SCALE] / SCALE_SIGMA);
        };
        let (mut residuals, mut off) = (Vec::new(), Vec::new());
        all(&mean, &mut residuals);
        lengths(&mean, &mut off);
        let steps = [1e-5; 10];
        let slopes = differences(&mean, &steps, residuals.len(), all);
        let of_lengths = differences(&mean, &steps, off.len(), lengths);
        let hints = off.iter().enumerate().map(|(i, off)| (std::array::from_fn(|k| of_lengths[(i, k)]), *off));
        RoomPosterior { information: slopes.tr_mul(&slopes).iter().copied().collect(), mean, hints: hints.collect() }
    }

    /// The shift of the principal point that explains the pins, where none does not (`found`: the minima without).
    ///
    /// Photographers keep verticals upright by shifting the lens, or straighten them and crop; a centred camera can
    /// then not fit the horizontals.
    fn shift(&self, view: &ViewEstimate, found: &[(f64, Unknowns)], iterations: &mut usize) -> Option<f64> {
        let (_, best) = found.first()?;
        let report = self.report(&self.unpack(best));
        let fits = report.rejected.is_empty() && report.rms <= SHIFT_RMS * diagonal(self.prior.photo);
        if report.given < SHIFT_PINS || fits {
            return None;
        }
        let height = f64::from(self.prior.photo.height);
        // The pins agree better than their usual sigma, or a shift could not be told.
        let sigma = (SHARP_SIGMA * diagonal(self.prior.photo)).max(report.rms / 2.0);
        let mut pins = self.pins.clone();
        for pin in pins.iter_mut().filter(|p| p.given) {
            pin.sigma = pin.sigma.min(sigma);
        }
        let mut at = |share: f64| {
            let problem = Problem::new(view, self.prior, pins.clone(), share * height);
            let (minima, spent) = problem.search(0);
            *iterations += spent;
            minima.first().map_or(f64::INFINITY, |(c, _)| c + 0.5 * (share / SHIFT_SIGMA).powi(2))
        };
        let straight = at(0.0);
        let mut best = (straight, 0.0);
        let mut step = MAX_SHIFT / 7.0;
        for share in (-7..=7).filter(|i| *i != 0).map(|i| f64::from(i) * step) {
            best = least(best, (at(share), share));
        }
        while step > 0.002 {
            step /= 2.0;
            for share in [best.1 - step, best.1 + step] {
                best = least(best, (at(share), share));
            }
        }
        (best.0 + SHIFT_GAIN < straight).then_some(best.1 * height)
    }

    /// The minima found, least cost first, and the iterations spent.
    fn solve(&self) -> (Vec<(f64, Unknowns)>, usize) {
        self.search(self.pins.iter().map(|p| p.group + 1).max().unwrap_or(0).min(MAX_GROUPS))
    }

    /// [`Self::solve`], also without each of the first `groups` groups of pins in turn.
    fn search(&self, groups: usize) -> (Vec<(f64, Unknowns)>, usize) {
        let mut found: Vec<(f64, Unknowns)> = Vec::new();
        let mut iterations = 0;
        for angles in self.angle_starts() {
            for left_out in std::iter::once(None).chain((0..groups).map(Some)) {
                let mut p = self.start(angles, left_out);
                let mut cost = f64::INFINITY;
                // Wide losses first: a start is seldom within three sigmas of every good pin.
                for limit in [4.0 * LIMIT, LIMIT] {
                    let s = minimise(&p, &STEPS, 30, |p, out| self.residuals(&array(p), limit, left_out, out));
                    iterations += s.iterations;
                    p = array(&s.parameters);
                    cost = s.cost;
                }
                if left_out.is_some() {
                    let s = minimise(&p, &STEPS, 20, |p, out| self.residuals(&array(p), LIMIT, None, out));
                    iterations += s.iterations;
                    p = array(&s.parameters);
                    cost = s.cost;
                }
                let sound =
                    cost.is_finite() && p.iter().all(|v| v.is_finite()) && p[YAW].abs() < 1.4 && p[TILT].abs() < 1.4;
                let known = found.iter().any(|(_, q)| p.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-3));
                if sound && !known {
                    found.push((cost, p));
                }
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        (found, iterations)
    }

    /// A side wall that no pin speaks of is where the prior's width puts it.
    fn unpinned_sides(&self, solved: CameraBox) -> CameraBox {
        let pinned = |edges: [E; 3]| self.pins.iter().any(|p| edges.contains(&p.edge));
        let width = self.prior.extents.width;
        let left = pinned([E::FloorLeft, E::CeilingLeft, E::BackLeft]);
        let right = pinned([E::FloorRight, E::CeilingRight, E::BackRight]);
        match (left, right) {
            (true, false) => CameraBox { right: (width - solved.left).max(SIDE_MARGIN), ..solved },
            (false, true) => CameraBox { left: (width - solved.right).max(SIDE_MARGIN), ..solved },
            _ => solved,
        }
    }

    fn angle_starts(&self) -> Vec<[f64; 4]> {
        let mut starts = vec![self.view];
        for quarter in [-FRAC_PI_2, FRAC_PI_2] {
            let yaw = self.view[YAW] + quarter;
            if yaw.abs() < 65f64.to_radians() {
                starts.push([self.view[0], yaw, self.view[2], self.view[3]]);
            }
        }
        let hints = &self.prior.camera;
        if let (Some(tilt), Some(yaw)) = (hint(hints.tilt_deg, -60.0, 60.0), hint(hints.yaw_deg, -70.0, 70.0)) {
            starts.push([self.view[0], yaw.to_radians(), tilt.to_radians(), 0.0]);
        }
        starts
    }

    /// Distances under given angles: medians of what the pins say one by one, floor first.
    fn start(&self, angles: [f64; 4], left_out: Option<usize>) -> Unknowns {
        let height = self.prior.extents.height;
        let focal = angles[0].exp();
        let turn = camera_rotation(angles[1], angles[2], angles[3]).transpose();
        let of = |edges: &[RoomEdge], value: &dyn Fn(RoomEdge, Vec3) -> f64| {
            let values: Vec<f64> = self
                .pins
                .iter()
                .filter(|p| Some(p.group) != left_out && edges.contains(&p.edge))
                .map(|p| value(p.edge, turn * p.point.extend(focal)))
                .filter(|v| v.is_finite() && *v > 0.05 && *v < 60.0)
                .collect();
            median(&values)
        };
        let floor = self.camera_height;
        let ceiling = height - floor;
        // On the floor a ray falls by `floor` while it goes `-z` back; on the ceiling it rises by `ceiling`.
        let back = of(&[E::FloorBack, E::CeilingBack], &|e, r| {
            let k = if e == E::FloorBack { floor / -r.y } else { ceiling / r.y };
            -r.z * k
        })
        .unwrap_or(self.back);
        let side = |edges: [RoomEdge; 3], sign: f64| {
            of(&edges, &|e, r| {
                let k = match e {
                    E::FloorLeft | E::FloorRight => floor / -r.y,
                    E::CeilingLeft | E::CeilingRight => ceiling / r.y,
                    _ => back / -r.z,
                };
                sign * r.x * k
            })
        };
        let half = self.prior.extents.width / 2.0;
        let left = side([E::FloorLeft, E::CeilingLeft, E::BackLeft], -1.0);
        let right = side([E::FloorRight, E::CeilingRight, E::BackRight], 1.0);
        let other = |known: Option<f64>| known.map_or(half, |k| (2.0 * half - k).max(0.3 * half));
        let (left, right) = (left.unwrap_or_else(|| other(right)), right.unwrap_or_else(|| other(left)));
        [angles[0], angles[1], angles[2], angles[3], left.ln(), right.ln(), (floor / ceiling).ln(), back.ln()]
    }

    fn report(&self, solved: &CameraBox) -> Report {
        let rotation = solved.rotation();
        let any_given = self.pins.iter().any(|p| p.given);
        let mut report = Report { rms: 0.0, used: 0, given: 0, rejected: vec![] };
        let mut squares = 0.0;
        for pin in self.pins.iter().filter(|p| p.given || !any_given) {
            let off = solved.distance_to_edge(&rotation, pin.edge, pin.point);
            report.given += 1;
            if off.abs() <= WRONG * pin.sigma {
                squares += off * off;
                report.used += 1;
            } else {
                report.rejected.push(format!("{:?} pin is {:.0} px off its edge", pin.edge, off.abs()));
            }
        }
        report.rms = if report.used > 0 { (squares / report.used as f64).sqrt() } else { f64::INFINITY };
        report
    }
}

fn least(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    if b.0 < a.0 { b } else { a }
}

fn array(p: &[f64]) -> Unknowns {
    let mut out = [0.0; 8];
    out.copy_from_slice(&p[..8]);
    out
}
