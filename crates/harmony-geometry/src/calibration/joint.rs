//! Camera and room once more, by everything that is known together.
//!
//! Algorithm 1 reads the frame from the point map alone: an error of its depths that is smooth over the image turns
//! the planes and with them the camera. The photo's lines hold the directions much better, the pinned edges hold where
//! the planes meet, the map holds how far they are. One robust least squares over focal length, rotation, the distances
//! to the faces, the map's scale and the room's height weighs them, each in units of its own uncertainty.

mod residuals;

use harmony_scene::{Camera, Extents, ImageSize, PointMap, PointMapKind, Similarity, Surface, Vec2, Vec3};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::creases::{Depths, pins_on_creases};
use super::edge_lines::{EdgeLine, Reach, line_on_edge};
use super::lens::Lens;
use super::posterior::RoomPosterior;
use super::types::{AnchorKind, Calibration, CalibrationMethod};
use crate::least_squares::{Solution, differences, minimise};
use crate::room_box::pins::{FLOOR_LOGIT, LN_BACK, LN_FOCAL, LN_LEFT, LN_RIGHT, Pin, ROLL, TILT, YAW, pins};
use crate::room_box::solved::CameraBox;
use crate::vanishing::Search;
use crate::{CameraHints, FocalPrior, LayoutPrior, LineSegment, RoomEdge, ViewEstimate, median};

/// Cells along the longer side of the map.
const CELLS: u32 = 36;
/// The share of the image over which a map's error stays the same.
const DEPTH_LENGTH: f64 = 0.1;

/// How far off a map's depths are, relative.
struct Accuracy {
    /// One sigma.
    sigma: f64,
    /// A cell belongs to a face when it is nearer to it than this, relative to its depth; round by round.
    reach: [f64; 3],
    /// Largest spread of depths in a cell, relative, over what a slanted plane has.
    cell_spread: f64,
    /// Whether pins are as sure as they fit, and not as surely as pins are: where the map says little, nothing else tells
    /// good ones from bad ones.
    pins_as_they_fit: bool,
}

/// Of a map with surfaces; of one in which no surface shows, so that camera and room come from pins and lines.
const SMOOTH: Accuracy = Accuracy { sigma: 0.03, reach: [0.1, 0.07, 0.06], cell_spread: 0.12, pins_as_they_fit: false };
const ROUGH: Accuracy = Accuracy { sigma: 0.08, reach: [0.2, 0.14, 0.12], cell_spread: 0.2, pins_as_they_fit: true };
/// The sigma of pins that do not fit grows by up to this factor, if there are so many of them.
const WORST_PINS: f64 = 4.0;
const JUDGED_PINS: usize = 4;

/// Saturation of the losses, sigmas.
const LIMIT: f64 = 2.5;
/// Sigmas of logarithms: focal length of the map's camera (a given one stays), distance to a face that is not seen,
/// height of a metric map's room.
const FOCAL_SIGMA: f64 = 0.025;
const GIVEN_FOCAL_SIGMA: f64 = 1e-4;
const UNSEEN_SIGMA: f64 = 0.15;
const METRIC_HEIGHT_SIGMA: f64 = 0.08;
/// One sigma of the told height (logarithm): the map has no other metres, so that calibration takes it as it is;
/// [`RoomPosterior::with_height_known_to`] says how far it is believed.
pub(crate) const TOLD_HEIGHT_SIGMA: f64 = 0.001;
/// Sigmas of the prior's camera height, distance to the back wall and width (logarithms): they matter where no face is
/// seen.
const CAMERA_HEIGHT_SIGMA: f64 = 0.12;
const BACK_SIGMA: f64 = 0.15;
const WIDTH_SIGMA: f64 = 0.15;
/// One sigma of the height at which people hold their cameras, about [`crate::room_box::USUAL_CAMERA_HEIGHT`] (logarithm).
const USUAL_HEIGHT_SIGMA: f64 = 0.15;
/// Edges that must be pinned before a side wall without a pinned edge is doubted.
const VOUCHING_EDGES: usize = 2;
/// Weight of the angles of the photo's segments to their vanishing points: by themselves they hold the rotation three
/// times better than with the map's depths at equal rights, whose errors are smooth and turn planes.
const LINES_WEIGHT: f64 = 2.0;
/// How far the photo's lines are looked for from an edge, and one sigma of their place, round by round; shares of the
/// image's longer side.
const LINE_REACH: [[f64; 2]; 3] = [[0.018, 0.006], [0.009, 0.003], [0.005, 0.0008]];
/// By how much a line along an edge holds it less where pins and map are rough, so that which of some parallel lines is the
/// edge's was a guess: objects on the floor and at walls may say otherwise.
const LINES_OF_ROUGH_PINS: f64 = 8.0;
/// Times that the map's creases are looked for.
const CREASE_ROUNDS: usize = 2;
/// How far beside the focal length that was found others are tried (logarithm).
const FOCAL_BESIDE: f64 = 0.03;
/// A refinement that turns the camera more than this is not believed, degrees.
const MAX_TURN_DEG: f64 = 14.0;

/// What the joint refinement changed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct JointEvidence {
    /// Turn of the camera against Algorithm 1, degrees.
    pub turned_deg: f64,
    /// Move of its centre, metres.
    pub moved_m: f64,
    /// Focal length over the map's own.
    pub focal_ratio: f64,
    /// Cells of the map that lie on faces.
    pub cells: usize,
    /// Their RMS depth residual, relative.
    pub depth_rms: f64,
    /// RMS distance of the pins that agree, pixels of the photo; `None` without pins.
    pub pin_rms_px: Option<f64>,
    /// One sigma of the rotation, degrees, and of the focal length, relative.
    pub sigma_rotation_deg: f64,
    /// See `sigma_rotation_deg`.
    pub sigma_focal: f64,
}

impl JointEvidence {
    /// The same with turn and move measured against another camera.
    pub(super) fn against(self, before: &Camera, after: &Camera) -> Self {
        Self {
            turned_deg: angle_deg(after.rotation * before.rotation.transpose()),
            moved_m: after.centre().distance(before.centre()),
            ..self
        }
    }
}

/// The ten unknowns of [`RoomPosterior`] for a camera in a room; focal length in pixels of its image.
pub fn room_unknowns(camera: &Camera, extents: &Extents, scale: f64) -> [f64; 10] {
    let view = ViewEstimate {
        rotation: camera.rotation,
        ..ViewEstimate::from_hints(camera.size, camera.intrinsics, &CameraHints::default())
    };
    let (centre, positive) = (camera.centre(), |v: f64| v.max(0.05));
    let floor = centre.y.clamp(0.02 * extents.height, 0.98 * extents.height);
    [
        camera.intrinsics.fx.ln(),
        view.yaw_deg().to_radians(),
        view.tilt_deg().to_radians(),
        view.roll(),
        positive(centre.x).ln(),
        positive(extents.width - centre.x).ln(),
        (floor / (extents.height - floor)).ln(),
        positive(centre.z).ln(),
        extents.height.ln(),
        scale.ln(),
    ]
}

/// Camera and room of ten unknowns; the room's depth is the distance to the back wall, which is all that they know.
pub fn room_from_unknowns(unknowns: &[f64], size: ImageSize) -> (Camera, Extents) {
    let solved = Problem::unpack(unknowns);
    (solved.camera(size), solved.extents(0.0))
}

/// Two more unknowns after those of the pins.
pub(super) const LN_HEIGHT: usize = 8;
const LN_SCALE: usize = 9;
type Unknowns = [f64; 10];
const STEPS: Unknowns = [1e-5; 10];

/// A cell of the map: where it is (relative to the principal point, [`Lens::relative`]), how deep, on which face.
#[derive(Debug, Clone, Copy)]
struct Cell {
    at: Vec2,
    depth: f64,
    face: Option<Surface>,
}

impl Cell {
    /// Its ray in the camera's frame, planar depth 1.
    fn ray(&self, focal: f64) -> Vec3 {
        Vec3::new(self.at.x / focal, self.at.y / focal, 1.0)
    }
}

struct Problem<'a> {
    prior: &'a LayoutPrior,
    lens: Lens,
    lines: Search,
    /// Relative to the principal point.
    segments: Vec<LineSegment>,
    pins: Vec<Pin>,
    cells: Vec<Cell>,
    accuracy: Accuracy,
    cell_sigma: f64,
    start: Unknowns,
    /// Faces that the map or a pin shows, and those that the map shows.
    seen: [bool; 6],
    measured: [bool; 6],
    kind: PointMapKind,
}

/// How far a joint refinement goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refinement {
    /// Until the axes and the focal length are known: lines, pins and the map's cells.
    Axes,
    /// To the end: by the map's creases and the photo's lines along edges too.
    Full,
}

/// Refines a calibration by photo, pins and map together (key `cam.joint`, beyond the paper).
///
/// `view` are the photo's lines, which like the prior's pins are those of the centred camera ([`Lens`]);
/// `calibration.camera` is at the map's size and stays so. The calibration comes back
/// unchanged, with `None`, where there is nothing to refine by or the result is not believable.
pub(super) fn refine_jointly(
    calibration: &Calibration,
    points: (&PointMap, &DepthCells),
    view: &ViewEstimate,
    prior: &LayoutPrior,
    until: Refinement,
) -> (Calibration, Option<JointEvidence>) {
    match Problem::new(calibration, points, view, prior).and_then(|p| p.refine(calibration, points.0, until)) {
        Some((refined, evidence)) => (refined, Some(evidence)),
        None => (calibration.clone(), None),
    }
}

fn index(surface: Surface) -> usize {
    Surface::ALL.iter().position(|s| *s == surface).unwrap_or(0)
}

impl<'a> Problem<'a> {
    fn new(
        c: &Calibration,
        (points, depths): (&PointMap, &DepthCells),
        view: &ViewEstimate,
        prior: &'a LayoutPrior,
    ) -> Option<Self> {
        let photo = prior.photo;
        let camera = c.camera.resized(photo);
        let k = f64::from(photo.width.max(1)) / f64::from(view.size.width.max(1));
        let segments: Vec<LineSegment> = view
            .segments
            .iter()
            .map(|(s, _)| LineSegment { start: s.start * k, end: s.end * k, strength: s.strength })
            .collect();
        let centre = Vec2::new(f64::from(photo.width), f64::from(photo.height)) / 2.0;
        let focal_px = camera.intrinsics.fx;
        let sigma = if depths.lens.is_given() { GIVEN_FOCAL_SIGMA } else { FOCAL_SIGMA };
        let focal = FocalPrior { focal_px, sigma };
        let start = room_unknowns(&camera, &c.extents, c.room_from_points.scale);
        let mut measured = [false; 6];
        for surface in &c.seen {
            measured[index(*surface)] = true;
        }
        // Whoever pins an edge of a face has seen it; but only a face that the map shows takes depths.
        let mut seen = measured;
        let pins = pins(prior);
        for pin in pins.iter().filter(|p| p.given) {
            for surface in faces_of(pin.edge) {
                seen[index(surface)] = true;
            }
        }
        let smooth = c.evidence.method == CalibrationMethod::Manhattan;
        if !smooth {
            // No plane was found in the map: its depths say how far away what is pinned is.
            measured = seen;
        }
        let accuracy = if smooth { SMOOTH } else { ROUGH };
        let patch = (DEPTH_LENGTH * f64::from(depths.per_side)).max(1.0);
        let problem = Self {
            prior,
            lens: depths.lens,
            lines: Search::new(photo, &segments, Some(focal)),
            segments: segments
                .iter()
                .map(|s| LineSegment { start: s.start - centre, end: s.end - centre, ..*s })
                .collect(),
            pins,
            cells: depths.smooth(accuracy.cell_spread),
            cell_sigma: accuracy.sigma * patch,
            accuracy,
            start,
            seen,
            measured,
            kind: points.kind,
        };
        start.iter().all(|v| v.is_finite()).then_some(problem)
    }

    fn unpack(p: &[f64]) -> CameraBox {
        let height = p[LN_HEIGHT].exp();
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
            shift: 0.0,
        }
    }

    /// Gives every cell the face it lies on, if any.
    fn assign(&mut self, p: &[f64], reach: f64) {
        let solved = Self::unpack(p);
        let room_from_camera = solved.rotation().transpose();
        for i in 0..self.cells.len() {
            let cell = self.cells[i];
            let ray = room_from_camera * cell.ray(solved.focal);
            let depth = cell.depth * p[LN_SCALE].exp();
            // The face that the ray meets first is the one that could be seen there.
            let met = Surface::ALL
                .into_iter()
                .filter(|s| self.seen[index(*s)])
                .filter_map(|s| Some((s, depth_of(&solved, s, ray)?)))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            self.cells[i].face =
                met.filter(|(s, z)| self.measured[index(*s)] && (depth / z).ln().abs() < reach).map(|(s, _)| s);
        }
    }

    /// Whether a side wall is one: who pins the room's edges pins those of the side walls that are there. The flank of
    /// a cupboard at the image's border is a plane like a wall, but nobody sees its edge with the floor as the room's.
    fn vouched(&self, surface: Surface) -> bool {
        let given = || self.pins.iter().filter(|p| p.given);
        let mut edges: Vec<RoomEdge> = given().map(|p| p.edge).collect();
        edges.sort_unstable();
        edges.dedup();
        let side = matches!(surface, Surface::Left | Surface::Right);
        !side || edges.len() < VOUCHING_EDGES || given().any(|p| faces_of(p.edge).contains(&surface))
    }

    /// The lowest minimum of those that are found from beside a solution: lines that were dropped for a wrong focal length
    /// keep it.
    fn minimise_beside(&self, solution: Solution, limit: f64) -> Solution {
        let mut start: Unknowns = self.start;
        start.copy_from_slice(&solution.parameters);
        let beside = |by: f64| {
            let mut start = start;
            start[LN_FOCAL] += by;
            self.minimise(&start, limit, 40)
        };
        let (shorter, longer) = rayon::join(|| beside(-FOCAL_BESIDE), || beside(FOCAL_BESIDE));
        [shorter, longer].into_iter().fold(solution, |best, other| if other.cost < best.cost { other } else { best })
    }

    /// The information matrix where the line along an edge may be another thing's.
    fn with_lines_inflated(&mut self, p: &Unknowns) -> Vec<f64> {
        self.pins.iter_mut().filter(|pin| !pin.given).for_each(|pin| pin.sigma *= LINES_OF_ROUGH_PINS);
        let mut residuals = Vec::new();
        self.residuals(p, LIMIT, &mut residuals);
        let jacobian = self.jacobian(p, LIMIT, residuals.len());
        jacobian.tr_mul(&jacobian).iter().copied().collect()
    }

    /// Derivatives of what a model guesses of lengths, and how far it is off.
    fn hints(&self, p: &Unknowns) -> Vec<([f64; 10], f64)> {
        let mut off = Vec::new();
        self.residuals_of_hints(p, &mut off);
        let slopes = differences(p, &STEPS, off.len(), |p, out| self.residuals_of_hints(p, out));
        off.iter().enumerate().map(|(i, off)| (std::array::from_fn(|k| slopes[(i, k)]), *off)).collect()
    }

    /// Makes the pins as unsure as they are off.
    fn judge_pins(&mut self, p: &Unknowns) {
        let solved = Self::unpack(p);
        let rotation = solved.rotation();
        let given = self.pins.iter().filter(|pin| pin.given);
        let off: Vec<f64> =
            given.map(|pin| (solved.distance_to_edge(&rotation, pin.edge, pin.point) / pin.sigma).abs()).collect();
        if let Some(middle) = median(&off).filter(|_| off.len() >= JUDGED_PINS) {
            // The median of normal errors is at 1 / 1.48 sigmas.
            let factor = (1.48 * middle).clamp(1.0, WORST_PINS);
            self.pins.iter_mut().for_each(|pin| pin.sigma *= factor);
        }
    }

    /// Pins on the photo's lines along the edges, the surest first: where it is tells where the others are to be
    /// looked for.
    fn lines_in_turn(&self, p: &Unknowns, information: &[f64], edges: &[RoomEdge], reach: Reach) -> Vec<Pin> {
        let group = self.pins.len();
        let mut left = edges.to_vec();
        let mut pins: Vec<Pin> = Vec::new();
        let known = DMatrix::from_column_slice(p.len(), p.len(), information).cholesky().map(|c| c.l().transpose());
        let mut at = *p;
        while let Some((k, line)) = left
            .iter()
            .enumerate()
            .filter_map(|(k, edge)| {
                Some((k, line_on_edge(&Self::unpack(&at), &self.segments, *edge, group + *edge as usize, reach)?))
            })
            .max_by(|a: &(usize, EdgeLine), b| a.1.margin.total_cmp(&b.1.margin))
        {
            left.remove(k);
            pins.extend(line.pins);
            // What was known before, and these lines.
            let Some(known) = &known else { continue };
            let s = minimise(p, &STEPS, 4, |x, out| {
                let moved = DVector::from_iterator(p.len(), x.iter().zip(p).map(|(x, p)| x - p));
                out.extend((known * moved).iter());
                let solved = Self::unpack(x);
                let rotation = solved.rotation();
                out.extend(pins.iter().map(|pin| solved.distance_to_edge(&rotation, pin.edge, pin.point) / pin.sigma));
            });
            at.copy_from_slice(&s.parameters[..10]);
        }
        pins
    }

    fn refine(
        mut self,
        before: &Calibration,
        points: &PointMap,
        until: Refinement,
    ) -> Option<(Calibration, JointEvidence)> {
        let (creases, lines): (usize, &[[f64; 2]]) = match until {
            Refinement::Axes => (0, &[]),
            Refinement::Full => (CREASE_ROUNDS, &LINE_REACH),
        };
        let mut p = self.start;
        let (mut sigmas, mut information) = (Vec::new(), Vec::new());
        for (round, reach) in self.accuracy.reach.into_iter().enumerate() {
            self.assign(&p, reach);
            // Wide losses first: the start may be some degrees off.
            let limit = if round == 0 { 4.0 * LIMIT } else { LIMIT };
            let mut s = self.minimise(&p, limit, 40);
            if until == Refinement::Full && round + 1 == self.accuracy.reach.len() {
                s = self.minimise_beside(s, limit);
            }
            p.copy_from_slice(&s.parameters[..10]);
            (sigmas, information) = (s.sigmas, s.information);
            if round == 0 && self.accuracy.pins_as_they_fit {
                self.judge_pins(&p);
            }
        }
        let given = self.pins.len();
        let depths = Depths::new(points, self.lens);
        for _ in 0..creases {
            self.pins.truncate(given);
            let seen = |s: Surface| self.seen[index(s)];
            let found = pins_on_creases(&Self::unpack(&p), &depths, seen, given);
            self.pins.extend(found);
            let s = self.minimise(&p, LIMIT, 20);
            p.copy_from_slice(&s.parameters[..10]);
            (sigmas, information) = (s.sigmas, s.information);
        }
        // Then the photo's lines stand in for the pins near them.
        let pinned = self.pins.len();
        let mut edges: Vec<RoomEdge> =
            self.pins.iter().enumerate().filter(|(i, pin)| pin.given || *i >= given).map(|(_, pin)| pin.edge).collect();
        edges.sort_unstable();
        edges.dedup();
        let side_px = f64::from(self.prior.photo.width.max(self.prior.photo.height));
        for &[px, sigma_px] in lines {
            let reach = Reach { px: px * side_px, sigma_px: sigma_px * side_px, side_px };
            self.pins.truncate(pinned);
            let found = self.lines_in_turn(&p, &information, &edges, reach);
            self.pins.extend(found);
            let s = self.minimise(&p, LIMIT, 20);
            p.copy_from_slice(&s.parameters[..10]);
            (sigmas, information) = (s.sigmas, s.information);
        }
        if self.lens.is_given() {
            p[LN_FOCAL] = self.start[LN_FOCAL];
        }
        let solved = Self::unpack(&p);
        let photo = self.prior.photo;
        let camera = self.lens.camera(&solved);
        let old = before.camera.resized(photo);
        let turned_deg = angle_deg(camera.rotation * old.rotation.transpose());
        let sound = p.iter().all(|v| v.is_finite()) && turned_deg <= MAX_TURN_DEG;
        if !sound {
            return None;
        }
        let centre = camera.centre();
        let mut extents = before.extents;
        extents.width = solved.left + solved.right;
        extents.height = solved.floor + solved.ceiling;
        // The front wall moves with the camera.
        extents.depth = before.extents.depth - old.centre().z + centre.z;
        let scale = p[LN_SCALE].exp();
        let rotation = camera.rotation.transpose() * points.rotation;
        let translation = centre - rotation * points.camera_centre() * scale;
        let anchor = moved_anchor(before, &extents);
        let on_faces: Vec<f64> = self
            .cells
            .iter()
            .filter_map(|c| {
                let ray = camera.rotation.transpose() * c.ray(solved.focal);
                Some((c.depth * scale / depth_of(&solved, c.face?, ray)?).ln())
            })
            .collect();
        let rms = |v: &[f64]| (v.iter().map(|x| x * x).sum::<f64>() / v.len().max(1) as f64).sqrt();
        let turn = camera.rotation;
        let pinned: Vec<f64> = self
            .pins
            .iter()
            .filter(|pin| pin.given)
            .map(|pin| (solved.distance_to_edge(&turn, pin.edge, pin.point), pin.sigma))
            .filter(|(off, sigma)| off.abs() <= 4.0 * sigma)
            .map(|(off, _)| off)
            .collect();
        let mut refined = before.clone();
        refined.camera = camera.resized(points.size);
        refined.extents = extents;
        refined.room_from_points = Similarity { scale, rotation, translation };
        refined.anchor = anchor;
        refined.seen = Surface::ALL.into_iter().filter(|s| self.seen[index(*s)] && self.vouched(*s)).collect();
        refined.evidence.anchor = anchor;
        refined.evidence.anchor_px = refined.camera.project(anchor).map(|p| p.to_array());
        let evidence = JointEvidence {
            turned_deg,
            moved_m: centre.distance(old.centre()),
            focal_ratio: solved.focal / old.intrinsics.fx,
            cells: on_faces.len(),
            depth_rms: rms(&on_faces),
            pin_rms_px: (!pinned.is_empty()).then(|| rms(&pinned)),
            sigma_rotation_deg: [YAW, TILT, ROLL]
                .iter()
                .map(|i| sigmas[*i] * sigmas[*i])
                .sum::<f64>()
                .sqrt()
                .to_degrees(),
            sigma_focal: sigmas[LN_FOCAL],
        };
        refined.evidence.joint = Some(evidence);
        if self.accuracy.pins_as_they_fit {
            information = self.with_lines_inflated(&p);
        }
        let mean = room_unknowns(&camera, &extents, 1.0);
        refined.posterior = Some(RoomPosterior { information, mean, hints: self.hints(&p) });
        Some((refined, evidence))
    }
}

/// The two faces that meet in an edge.
pub(super) fn faces_of(edge: RoomEdge) -> [Surface; 2] {
    match edge {
        RoomEdge::FloorBack => [Surface::Floor, Surface::Back],
        RoomEdge::FloorLeft => [Surface::Floor, Surface::Left],
        RoomEdge::FloorRight => [Surface::Floor, Surface::Right],
        RoomEdge::CeilingBack => [Surface::Ceiling, Surface::Back],
        RoomEdge::CeilingLeft => [Surface::Ceiling, Surface::Left],
        RoomEdge::CeilingRight => [Surface::Ceiling, Surface::Right],
        RoomEdge::BackLeft => [Surface::Back, Surface::Left],
        RoomEdge::BackRight => [Surface::Back, Surface::Right],
    }
}

/// The same corner of the room in its new size.
fn moved_anchor(before: &Calibration, extents: &harmony_scene::Extents) -> Vec3 {
    if before.evidence.anchor_kind == AnchorKind::Prior && before.anchor == Vec3::ZERO {
        return before.anchor;
    }
    let at = |value: f64, old: f64, new: f64| if value > old / 2.0 { new } else { 0.0 };
    Vec3::new(
        at(before.anchor.x, before.extents.width, extents.width),
        before.anchor.y,
        at(before.anchor.z, before.extents.depth, extents.depth),
    )
}

fn angle_deg(turn: harmony_scene::Mat3) -> f64 {
    (((turn.x_axis.x + turn.y_axis.y + turn.z_axis.z) - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
}

/// Planar depth at which a ray (room axes, planar depth 1) from the camera meets a face; `None` when it doesn't.
fn depth_of(b: &CameraBox, face: Surface, ray: Vec3) -> Option<f64> {
    Some(distance_to(b, face)? / towards(face, ray)?)
}

/// Distance from the camera to a face; that of the front wall is not known.
fn distance_to(b: &CameraBox, face: Surface) -> Option<f64> {
    match face {
        Surface::Left => Some(b.left),
        Surface::Right => Some(b.right),
        Surface::Floor => Some(b.floor),
        Surface::Ceiling => Some(b.ceiling),
        Surface::Back => Some(b.back),
        Surface::Front => None,
    }
}

/// How far a ray goes towards a face for each unit of planar depth; `None` when it hardly does.
fn towards(face: Surface, ray: Vec3) -> Option<f64> {
    outward(face, ray).filter(|towards| *towards > 0.02)
}

/// The part of a ray (room axes) across a face, out of the room; that of the front wall is not asked for.
fn outward(face: Surface, ray: Vec3) -> Option<f64> {
    match face {
        Surface::Left => Some(-ray.x),
        Surface::Right => Some(ray.x),
        Surface::Floor => Some(-ray.y),
        Surface::Ceiling => Some(ray.y),
        Surface::Back => Some(-ray.z),
        Surface::Front => None,
    }
}

/// 1 / planar depth of a face, beyond its ends too, along a ray (room axes, planar depth 1): linear in the ray.
pub(super) fn inverse_depth_of(b: &CameraBox, face: Surface, ray: Vec3) -> Option<f64> {
    Some(outward(face, ray)? / distance_to(b, face)?)
}

/// Depths of a map by square cells. Another focal length leaves them as they are.
pub(super) struct DepthCells {
    lens: Lens,
    /// Cells, and how far depths spread in each, relative.
    cells: Vec<(Cell, f64)>,
    /// How many lie along the longer side.
    per_side: u32,
}

impl DepthCells {
    pub(super) fn new(points: &PointMap, lens: Lens) -> Self {
        let (photo, w, h) = (lens.photo, points.size.width, points.size.height);
        let side = w.max(h).div_ceil(CELLS).max(1);
        let depth_row = points.rotation.transpose() * Vec3::Z;
        let k = Vec2::new(f64::from(photo.width) / f64::from(w), f64::from(photo.height) / f64::from(h));
        let of_row = |cy: u32| {
            let mut depths: Vec<f64> = Vec::with_capacity((side * side) as usize);
            let mut row = Vec::new();
            for cx in 0..w / side {
                depths.clear();
                for y in cy * side..(cy + 1) * side {
                    let seen = (cx * side..(cx + 1) * side).filter_map(|x| points.at(x, y));
                    depths.extend(seen.map(|p| depth_row.dot(p) + points.translation.z));
                }
                depths.retain(|z| *z > 1e-6 && z.is_finite());
                if depths.len() * 2 < (side * side) as usize {
                    continue;
                }
                let last = (depths.len() - 1) as f64;
                let mut at = |q: f64| *depths.select_nth_unstable_by((last * q) as usize, f64::total_cmp).1;
                let (low, depth, high) = (at(0.1), at(0.5), at(0.9));
                let middle = Vec2::new(f64::from(cx), f64::from(cy)) * f64::from(side) + f64::from(side) / 2.0;
                row.push((Cell { at: lens.relative(middle * k), depth, face: None }, high / low - 1.0));
            }
            row
        };
        let rows: Vec<Vec<(Cell, f64)>> = (0..h / side).into_par_iter().map(of_row).collect();
        Self { lens, cells: rows.concat(), per_side: w.max(h).div_ceil(side) }
    }

    /// Those in which depths spread little.
    fn smooth(&self, most_spread: f64) -> Vec<Cell> {
        self.cells.iter().filter(|(_, spread)| *spread <= most_spread).map(|(cell, _)| *cell).collect()
    }
}
