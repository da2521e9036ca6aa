//! The room box from the image's own lines.
//!
//! With the view known, a box is four numbers: camera height, distance to the back wall, to the left and to the
//! right (the room's height is the prior's, the metric reference). As in the classical box layouts (V. Hedau, D. Hoiem,
//! D. Forsyth, ICCV 2009; D. Lee, M. Hebert, T. Kanade, CVPR 2009) boxes are proposed from lines that could be room
//! edges and scored by
//!
//! * how much of each visible box edge is covered by segments of its direction,
//! * whether the segments of the image lie on faces that can hold their direction (a line along z cannot lie on the
//!   back wall), counted fully above the horizon, where furniture is rare, and little below it,
//! * how much the faces tell about the colours of the image ([`Appearance`]),
//! * what the prior says about sizes, camera height and (if it has some) pinned edges.
//!
//! Left and right are independent given height and back distance, so all combinations can be looked at. Nothing is
//! learned. Weak regime: rooms whose edges are hidden, or whose furniture fills a wall.

use harmony_scene::{Mat3, Vec2, Vec3};

use super::appearance::{Appearance, face};
use super::pins::{Pin, pins};
use super::solved::CameraBox;
use super::{RoomBox, RoomBoxEvidence, RoomBoxMethod, USUAL_CAMERA_HEIGHT, finish};
use crate::least_squares::robust;
use crate::{GrayImage, LayoutPrior, LineSegment, RoomEdge, ViewEstimate};

/// A segment within this distance of an edge (share of the diagonal) covers it.
const TOLERANCE: f64 = 0.005;
/// Shortest segment that counts, share of the diagonal.
const SHORTEST: f64 = 0.012;
/// Nats for an edge covered over a length of one diagonal, and for a visible edge left uncovered over it.
const COVERED: f64 = 8.0;
const UNCOVERED: f64 = 1.5;
/// Nats for segments of one diagonal's length on faces that can't hold them, above the horizon.
const MISPLACED: f64 = 4.0;
/// Share of that below the horizon, by the direction of the segment: furniture stands in front of every face, but
/// its legs (y) say least, and lines into the depth (z) on the back wall say most.
const BELOW_HORIZON: [f64; 3] = [0.3, 0.1, 0.5];
/// Nats for one nat of mutual information of face and colour a pixel: so many pixels count as independent.
const INFORMATION: f64 = 25.0;
/// Combinations that are looked at in colour.
const FINALISTS: usize = 400;
/// Sigmas of the logarithms of what the prior says: camera height (hinted, usual), width, back (hinted, usual), sides.
const HEIGHT_SIGMA: [f64; 2] = [0.12, 0.18];
const WIDTH_SIGMA: f64 = 0.35;
const BACK_SIGMA: [f64; 2] = [0.25, 0.4];
const SIDE_SIGMA: f64 = 0.7;
/// Proposals by kind.
const MAX_PROPOSALS: usize = 18;
/// Heights tried around the prior's camera height where one line is missing.
const HEIGHT_FACTORS: [f64; 5] = [0.75, 0.88, 1.0, 1.12, 1.25];
/// Back distances and half widths tried around the prior's.
const SIZE_FACTORS: [f64; 7] = [0.5, 0.65, 0.8, 1.0, 1.25, 1.55, 2.0];
/// Least and largest distances, metres.
const REACH: [f64; 2] = [0.25, 30.0];

/// A segment with a direction of the room, relative to the image centre.
struct Mark {
    ends: [Vec2; 2],
    axis: usize,
    length: f64,
    /// Direction of its middle, room axes.
    ray: Vec3,
    /// Directions along it, room axes.
    rays: [Vec3; 3],
}

/// Everything a score needs; lengths in pixels of the photo.
struct Scene<'a> {
    prior: &'a LayoutPrior,
    view: CameraBox,
    rotation: Mat3,
    marks: Vec<Mark>,
    pins: Vec<Pin>,
    appearance: Option<Appearance>,
    half: Vec2,
    diagonal: f64,
    camera_height: f64,
    height_sigma: f64,
    back: f64,
    back_sigma: f64,
}

/// Which half of the box a score is about.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Left,
    Right,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cover {
    covered: f64,
    length: f64,
}

/// Height and back distance.
#[derive(Debug, Clone, Copy)]
struct Core {
    floor: f64,
    back: f64,
}

/// The best box of the image's lines, or `None` when too few lines have a direction.
pub(super) fn box_from_lines(image: &GrayImage, view: &ViewEstimate, prior: &LayoutPrior) -> Option<RoomBox> {
    let mut scene = Scene::new(view, prior);
    scene.appearance = Appearance::new(image, &scene.rotation, scene.view.focal, scene.half);
    if scene.marks.len() < 4 {
        return None;
    }
    let (solved, score) = scene.best()?;
    let (solved, score, rounds) = scene.climb(solved, score);
    let cover = scene.total_cover(&solved);
    let support = cover.covered / cover.length.max(1.0);
    tracing::debug!(score, support, "box from lines");
    let evidence = RoomBoxEvidence {
        method: RoomBoxMethod::Lines,
        pin_rms_px: 0.0,
        pins_used: 0,
        pins_given: scene.pins.iter().filter(|p| p.given).count(),
        pins_rejected: vec![],
        edge_support: support,
        view_confidence: view.confidence,
        iterations: rounds,
        fallbacks: vec!["room edges from the lines of the photo, the size from the prior's height".to_owned()],
    };
    let confidence = (0.1 + 0.5 * (support / 0.5).min(1.0) * view.confidence).clamp(0.0, 1.0);
    Some(finish(&solved, prior, confidence, evidence))
}

/// What the lines (and the colours, given the image) of the photo say for a box, nats; nothing of the prior.
pub(super) fn image_evidence(
    image: Option<&GrayImage>,
    view: &ViewEstimate,
    prior: &LayoutPrior,
    solved: &CameraBox,
) -> f64 {
    let mut scene = Scene::new(view, prior);
    let rotation = solved.rotation();
    // Seen a quarter turn on, the view's x is the box's z.
    if rotation.col(0).dot(scene.rotation.col(0)).abs() < std::f64::consts::FRAC_1_SQRT_2 {
        for m in &mut scene.marks {
            m.axis = [2, 1, 0][m.axis];
        }
    }
    scene.rotation = rotation;
    let cover = scene.total_cover(solved);
    let lines = (COVERED * cover.covered - UNCOVERED * (cover.length - cover.covered)) / scene.diagonal;
    scene.appearance = image.and_then(|i| Appearance::new(i, &rotation, solved.focal, scene.half));
    lines + scene.colour_score(solved)
}

impl<'a> Scene<'a> {
    fn new(view: &ViewEstimate, prior: &'a LayoutPrior) -> Self {
        let photo = prior.photo;
        let k = f64::from(photo.width.max(1)) / f64::from(view.size.width.max(1));
        let half = Vec2::new(f64::from(photo.width), f64::from(photo.height)) / 2.0;
        let diagonal = 2.0 * half.length();
        let focal = view.intrinsics.fx * k;
        let rotation = view.rotation;
        let shortest = SHORTEST * diagonal;
        let marks = view
            .segments
            .iter()
            .filter_map(|(s, axis)| Some((s, usize::from((*axis)?))))
            .filter_map(|(s, axis)| mark(s, axis, k, half, focal, &rotation))
            .filter(|m| m.length >= shortest)
            .collect();
        let height = prior.extents.height;
        let hints = &prior.camera;
        let hinted = hints.height_m.filter(|h| (0.1..0.97 * height).contains(h));
        let distance = hints.dist_to_back_m.filter(|d| (0.2..=40.0).contains(d));
        let camera_height = hinted.unwrap_or(USUAL_CAMERA_HEIGHT.min(0.7 * height));
        let back = distance.unwrap_or(0.75 * prior.extents.depth);
        let view = CameraBox {
            focal,
            yaw: view.yaw_deg().to_radians(),
            tilt: view.tilt_deg().to_radians(),
            roll: view.roll(),
            left: prior.extents.width / 2.0,
            right: prior.extents.width / 2.0,
            floor: camera_height,
            ceiling: height - camera_height,
            back,
            shift: 0.0,
        };
        Self {
            prior,
            view,
            rotation,
            marks,
            pins: pins(prior),
            appearance: None,
            half,
            diagonal,
            camera_height,
            height_sigma: HEIGHT_SIGMA[usize::from(hinted.is_none())],
            back,
            back_sigma: BACK_SIGMA[usize::from(distance.is_none())],
        }
    }

    fn with(&self, core: Core) -> CameraBox {
        CameraBox { floor: core.floor, ceiling: self.prior.extents.height - core.floor, back: core.back, ..self.view }
    }

    /// All combinations of proposals; the best of them looked at in colour.
    fn best(&self) -> Option<(CameraBox, f64)> {
        let mut all: Vec<(CameraBox, f64)> = Vec::new();
        for core in self.cores() {
            let base = self.with(core);
            let common = self.core_prior(&base);
            let left = self.best_side(&base, Side::Left);
            let right = self.best_side(&base, Side::Right);
            for (l, l_score) in &left {
                for (r, r_score) in &right {
                    let candidate = CameraBox { left: *l, right: *r, ..base };
                    all.push((candidate, common + l_score + r_score + self.width_prior(&candidate)));
                }
            }
        }
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all.truncate(FINALISTS);
        all.into_iter().map(|(b, score)| (b, score + self.colour_score(&b))).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn colour_score(&self, b: &CameraBox) -> f64 {
        self.appearance.as_ref().map_or(0.0, |a| INFORMATION * a.information(b))
    }

    /// The three best distances of one side, with their scores.
    fn best_side(&self, base: &CameraBox, side: Side) -> Vec<(f64, f64)> {
        let mut scored: Vec<(f64, f64)> = self
            .side_proposals(base, side)
            .into_iter()
            .map(|distance| (distance, self.side_score(&with_side(base, side, distance), side)))
            .collect();
        scored.sort_by(|a, b| b.1.total_cmp(&a.1));
        scored.truncate(3);
        scored
    }

    /// Pairs of camera height and back distance that some line or the prior suggests.
    fn cores(&self) -> Vec<Core> {
        let height = self.prior.extents.height;
        // Back distance over floor (ceiling) distance of every x segment below (above) the horizon.
        let ratios = |below: bool| {
            let mut found: Vec<(f64, f64)> = self
                .marks
                .iter()
                .filter(|m| m.axis == 0 && m.ray.z < -1e-3 && (m.ray.y < -1e-3) == below && m.ray.y.abs() > 1e-3)
                .map(|m| (m.ray.z.abs() / m.ray.y.abs(), m.length))
                .filter(|(ratio, _)| (0.3..25.0).contains(ratio))
                .collect();
            distinct(&mut found)
        };
        let (floors, ceilings) = (ratios(true), ratios(false));
        let heights: Vec<f64> = HEIGHT_FACTORS.iter().map(|k| (k * self.camera_height).min(0.93 * height)).collect();
        let mut cores = Vec::new();
        for f in &floors {
            cores.extend(ceilings.iter().map(|c| {
                let back = height / (1.0 / f + 1.0 / c);
                Core { floor: back / f, back }
            }));
            cores.extend(heights.iter().map(|h| Core { floor: *h, back: h * f }));
        }
        for c in &ceilings {
            cores.extend(heights.iter().map(|h| Core { floor: *h, back: (height - h) * c }));
        }
        for h in &heights {
            cores.extend(SIZE_FACTORS.iter().map(|k| Core { floor: *h, back: k * self.back }));
        }
        let sigmas = |c: &Core| ((c.floor / self.camera_height).ln() / self.height_sigma).abs();
        cores.retain(|c| {
            (REACH[0]..REACH[1]).contains(&c.back) && c.floor > 0.1 && c.floor < 0.97 * height && sigmas(c) < 4.0
        });
        cores
    }

    fn side_proposals(&self, base: &CameraBox, side: Side) -> Vec<f64> {
        let sign = if side == Side::Left { -1.0 } else { 1.0 };
        let mut found: Vec<(f64, f64)> = self
            .marks
            .iter()
            .filter(|m| m.ray.x * sign > 1e-3)
            .filter_map(|m| {
                let across = m.ray.x.abs();
                let distance = match m.axis {
                    1 if m.ray.z < -1e-3 => base.back * across / -m.ray.z,
                    2 if m.ray.y < -1e-3 => base.floor * across / -m.ray.y,
                    2 if m.ray.y > 1e-3 => base.ceiling * across / m.ray.y,
                    _ => return None,
                };
                (REACH[0]..REACH[1]).contains(&distance).then_some((distance, m.length))
            })
            .collect();
        let mut out = distinct(&mut found);
        out.extend(SIZE_FACTORS.iter().map(|k| k * self.prior.extents.width / 2.0));
        out
    }

    fn core_prior(&self, b: &CameraBox) -> f64 {
        let height = (b.floor / self.camera_height).ln() / self.height_sigma;
        let back = (b.back / self.back).ln() / self.back_sigma;
        let core = [RoomEdge::FloorBack, RoomEdge::CeilingBack];
        -0.5 * (height * height + back * back) - self.pin_cost(b, &core)
    }

    fn width_prior(&self, b: &CameraBox) -> f64 {
        let k = ((b.left + b.right) / self.prior.extents.width).ln() / WIDTH_SIGMA;
        -0.5 * k * k
    }

    fn pin_cost(&self, b: &CameraBox, edges: &[RoomEdge]) -> f64 {
        self.pins
            .iter()
            .filter(|p| edges.contains(&p.edge))
            .map(|p| robust(b.distance_to_edge(&self.rotation, p.edge, p.point) / p.sigma, 4.0).powi(2) / 2.0)
            .sum()
    }

    /// What the lines and the prior say about one half of the box.
    fn side_score(&self, b: &CameraBox, side: Side) -> f64 {
        let edges = side_edges(side);
        let mut score = 0.0;
        let mut add = |c: Cover| score += (COVERED * c.covered - UNCOVERED * (c.length - c.covered)) / self.diagonal;
        add(self.cover(b, &self.rotation, RoomEdge::FloorBack, Some(side)));
        add(self.cover(b, &self.rotation, RoomEdge::CeilingBack, Some(side)));
        for edge in edges {
            add(self.cover(b, &self.rotation, edge, None));
        }
        let distance = if side == Side::Left { b.left } else { b.right };
        let k = (distance / (self.prior.extents.width / 2.0)).ln() / SIDE_SIGMA;
        score - 0.5 * k * k - self.pin_cost(b, &edges) - MISPLACED * self.misplaced(b, side) / self.diagonal
    }

    /// Length of segments (weighted) on faces that can't hold their direction: those normal to it.
    fn misplaced(&self, b: &CameraBox, side: Side) -> f64 {
        self.marks
            .iter()
            .filter(|m| (m.ray.x < 0.0) == (side == Side::Left))
            .map(|m| {
                let weight = if m.ray.y > 0.0 { 1.0 } else { BELOW_HORIZON[m.axis] };
                let wrong = m.rays.iter().filter(|r| face(b, **r) / 2 == m.axis).count();
                weight * m.length * wrong as f64 / m.rays.len() as f64
            })
            .sum()
    }

    fn total_score(&self, b: &CameraBox) -> f64 {
        self.core_prior(b)
            + self.width_prior(b)
            + self.side_score(b, Side::Left)
            + self.side_score(b, Side::Right)
            + self.colour_score(b)
    }

    fn total_cover(&self, b: &CameraBox) -> Cover {
        let mut sum = Cover::default();
        for edge in RoomEdge::ALL {
            let c = self.cover(b, &self.rotation, edge, None);
            sum.covered += c.covered;
            sum.length += c.length;
        }
        sum
    }

    /// Coordinate search with shrinking steps.
    fn climb(&self, start: CameraBox, score: f64) -> (CameraBox, f64, usize) {
        let (mut best, mut best_score) = (start, score.max(self.total_score(&start)));
        let mut step: f64 = 0.03;
        let mut rounds = 0;
        while step > 0.001 && rounds < 60 {
            rounds += 1;
            let mut improved = false;
            for which in 0..4 {
                for factor in [1.0 + step, 1.0 / (1.0 + step)] {
                    let mut trial = best;
                    match which {
                        0 => trial.left *= factor,
                        1 => trial.right *= factor,
                        2 => trial.back *= factor,
                        _ => trial.floor = (trial.floor * factor).min(0.97 * self.prior.extents.height),
                    }
                    trial.ceiling = self.prior.extents.height - trial.floor;
                    let score = self.total_score(&trial);
                    if score > best_score + 1e-9 {
                        (best, best_score, improved) = (trial, score, true);
                    }
                }
            }
            if !improved {
                step /= 2.0;
            }
        }
        (best, best_score, rounds)
    }

    /// How much of the visible part of an edge is covered by segments of its direction; of one half only, if asked.
    fn cover(&self, b: &CameraBox, rotation: &Mat3, edge: RoomEdge, half: Option<Side>) -> Cover {
        let Some([from, to]) = self.visible(b, rotation, edge, half) else { return Cover::default() };
        let along = to - from;
        let length = along.length();
        let direction = along / length;
        let tolerance = TOLERANCE * self.diagonal;
        let axis = match edge {
            RoomEdge::FloorBack | RoomEdge::CeilingBack => 0,
            RoomEdge::BackLeft | RoomEdge::BackRight => 1,
            _ => 2,
        };
        let mut spans: Vec<(f64, f64)> = self
            .marks
            .iter()
            .filter(|m| m.axis == axis)
            .filter(|m| m.ends.iter().all(|e| (*e - from).perp_dot(direction).abs() <= tolerance))
            .map(|m| {
                let (a, b) = ((m.ends[0] - from).dot(direction), (m.ends[1] - from).dot(direction));
                (a.min(b).max(0.0), a.max(b).min(length))
            })
            .filter(|(a, b)| b > a)
            .collect();
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut covered, mut reach) = (0.0, 0.0f64);
        for (a, b) in spans {
            covered += (b - a.max(reach)).max(0.0);
            reach = reach.max(b);
        }
        Cover { covered, length }
    }

    /// The part of an edge inside the image, pixels from the centre; `None` when nothing of it shows.
    fn visible(&self, b: &CameraBox, rotation: &Mat3, edge: RoomEdge, half: Option<Side>) -> Option<[Vec2; 2]> {
        let (point, along) = b.edge(edge);
        // From the camera: x from -left to right, y from -floor to ceiling, z from -back to the camera's plane.
        let (low, high) = match edge {
            RoomEdge::FloorBack | RoomEdge::CeilingBack => match half {
                Some(Side::Left) => (-b.left, 0.0),
                Some(Side::Right) => (0.0, b.right),
                None => (-b.left, b.right),
            },
            RoomEdge::BackLeft | RoomEdge::BackRight => (-b.floor, b.ceiling),
            _ => (-b.back, b.back),
        };
        let (p, d) = (*rotation * point, *rotation * along);
        // In front of the camera: p.z + t d.z >= near.
        let near = 0.02;
        let (mut low, mut high) = (low, high);
        if d.z.abs() < 1e-9 {
            if p.z < near {
                return None;
            }
        } else {
            let t = (near - p.z) / d.z;
            if d.z > 0.0 { low = low.max(t) } else { high = high.min(t) }
        }
        if low >= high {
            return None;
        }
        let project = |t: f64| {
            let q = p + d * t;
            Vec2::new(q.x, q.y) * (b.focal / q.z)
        };
        clip(project(low), project(high), self.half)
    }
}

fn with_side(base: &CameraBox, side: Side, distance: f64) -> CameraBox {
    match side {
        Side::Left => CameraBox { left: distance, ..*base },
        Side::Right => CameraBox { right: distance, ..*base },
    }
}

fn side_edges(side: Side) -> [RoomEdge; 3] {
    match side {
        Side::Left => [RoomEdge::FloorLeft, RoomEdge::CeilingLeft, RoomEdge::BackLeft],
        Side::Right => [RoomEdge::FloorRight, RoomEdge::CeilingRight, RoomEdge::BackRight],
    }
}

fn mark(s: &LineSegment, axis: usize, k: f64, half: Vec2, focal: f64, rotation: &Mat3) -> Option<Mark> {
    let ends = [s.start * k - half, s.end * k - half];
    let middle = (ends[0] + ends[1]) / 2.0;
    let ray = (rotation.transpose() * middle.extend(focal)).try_normalize()?;
    let rays = [0.1, 0.5, 0.9].map(|k| rotation.transpose() * ends[0].lerp(ends[1], k).extend(focal));
    Some(Mark { ends, axis, length: ends[0].distance(ends[1]), ray, rays })
}

/// Values 1.5 % or more apart, those with the most length behind them first.
fn distinct(found: &mut [(f64, f64)]) -> Vec<f64> {
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut merged: Vec<(f64, f64)> = Vec::new();
    for (value, weight) in found.iter() {
        match merged.last_mut() {
            Some(last) if value / last.0 < 1.015 => {
                last.0 = (last.0 * last.1 + value * weight) / (last.1 + weight);
                last.1 += weight;
            }
            _ => merged.push((*value, *weight)),
        }
    }
    merged.sort_by(|a, b| b.1.total_cmp(&a.1));
    merged.truncate(MAX_PROPOSALS);
    merged.into_iter().map(|m| m.0).collect()
}

/// Liang-Barsky clipping of a segment to the rectangle of half size `half` around the origin.
fn clip(a: Vec2, b: Vec2, half: Vec2) -> Option<[Vec2; 2]> {
    if !(a.is_finite() && b.is_finite()) {
        return None;
    }
    let d = b - a;
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for (p, q) in [(-d.x, a.x + half.x), (d.x, half.x - a.x), (-d.y, a.y + half.y), (d.y, half.y - a.y)] {
        if p == 0.0 {
            if q < 0.0 {
                return None;
            }
        } else if p < 0.0 {
            from = from.max(q / p);
        } else {
            to = to.min(q / p);
        }
    }
    let out = [a + d * from, a + d * to];
    (to > from && out[0].distance(out[1]) > 1.0).then_some(out)
}
