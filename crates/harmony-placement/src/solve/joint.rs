//! All poses, the camera, the room and the scale together (beyond the paper; decision 0012).
//!
//! Placing objects one after the other in a fixed camera leaves each with its own errors, and all with those of the
//! camera and the walls. Here everything is one least squares over the terms of `terms`: the outlines of all masks in
//! sixteen directions each, the front depths of the map, sizes, walls at backs, equal sizes within sets, and what calibration
//! knows of camera, room and scale. Its information matrix is the posterior from which confidences come.
//!
//! All lengths but the room's height are in units of the map as it is, and the scale that makes them metres is an
//! unknown of its own: a change of the scale alone changes no outline, and nothing is left behind by it.

use harmony_geometry::least_squares::{differences, minimise_with};
use harmony_geometry::{MAD_TO_SIGMA, RoomPosterior, median_absolute_deviation, room_from_unknowns, room_unknowns};
use harmony_scene::{Camera, Extents, Intrinsics, PointMapKind, Pose, Support, Vec3, Wall};
use nalgebra::DMatrix;

use crate::accept::{accepts, total};
use crate::contact::rest::take_poses;
use crate::noise::Noise;
use crate::observe::{Outline, Window};
use crate::scene::attachment::{
    Attachment, PoseConstraint, YawRule, angle_between, attachment_of, height_stretch, size_of,
};
use crate::scene::{Energy, Spread, TRUSTED_IOU};
use crate::terms::{
    DepthNoise, Kernel, NAMED, NamedSize, outline_residuals, placed_energy, scene_energy, told_objective, wall_residual,
};
use crate::{PartialScene, PlacementSettings};

use super::local::{polish, solve};

/// Rounds: what is read of outlines and depths is read anew where the last one left everything.
const ROUNDS: usize = 2;
/// Outlines are extremes over points, whose kinks make the steps small: rooms whose scale is open need two dozen.
const ITERATIONS: usize = 30;
/// How a model names sizes is judged from so many objects on, and believed this many times less at most.
const JUDGED_SIZES: usize = 8;
const MAX_INFLATION: f64 = 3.0;
/// The distance of a wall that nobody sees stays within about this (logarithm): it is an unknown that nothing else holds, and not known.
const HELD: f64 = 0.01;
/// A depth farther from the object's than this is another surface's (logarithm).
const OTHER_SURFACE: f64 = 0.25;

/// Numbers of the room at the front of all unknowns: those of [`harmony_geometry::RoomPosterior`] with lengths in units of the map and
/// `ln floor` in place of the logit, the logarithm of the scale last; then what the named sizes have in common; then
/// four an object: place (two), yaw, ln scale.
const ROOM: usize = 10;
const FLOOR: usize = 6;
const HEIGHT: usize = 8;
const SCALE: usize = 9;
const COMMON: usize = 10;
const FIRST: usize = ROOM + 1;
const EACH: usize = 4;
/// Derivative steps of the room's unknowns and of the objects'.
const STEPS: [f64; 2] = [1e-5, 1e-4];

/// What the refinement did.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct GlobalReport {
    /// Energy of all objects and of the room before and after, nats.
    pub energy: [f64; 2],
    /// Move of the camera, metres, and its turn, degrees.
    pub camera_moved_m: f64,
    /// See `camera_moved_m`.
    pub camera_turned_deg: f64,
    /// Factor on the scene's scale.
    pub scale: f64,
    /// How much less than a good model's the named sizes were believed, because they contradict one another; 1: not.
    pub size_inflation: f64,
    /// Mean move of the objects, metres.
    pub objects_moved_m: f64,
    /// Whether the result was kept.
    pub kept: bool,
}

/// One object as the problem sees it: what its block of residuals is made from.
struct ObjectBlock {
    /// Index into the placed objects.
    object: usize,
    attachment: Attachment,
    /// `None` where the object agrees so little with its mask that it says nothing.
    outline: Option<Outline>,
    /// Logarithm of the map's front depth over that of the object, and one sigma.
    depth: Option<(f64, f64)>,
    sizes: NamedSize,
    start: Pose,
    /// Planar depth of its position at the start.
    start_depth: f64,
    /// Its set's first member, as an index of blocks.
    reference: Option<usize>,
}

/// Everything that is placed as one least squares, linearised where it is.
struct Problem<'a> {
    scene: &'a PartialScene,
    noise: &'a Noise,
    blocks: Vec<ObjectBlock>,
    /// A square root of the calibration's information, and where it holds.
    root: Vec<f64>,
    mean: [f64; ROOM],
    now: [f64; ROOM],
    /// Which of the left and the right wall is a guess.
    loose: [bool; 2],
    size_inflation: f64,
}

/// Refines everything that is placed; the scene changes only when its energy falls.
///
/// `None` where calibration left no posterior (neither a point map nor pins) or nothing is placed.
pub fn refine_globally(scene: &mut PartialScene, settings: &PlacementSettings) -> Option<GlobalReport> {
    let posterior = scene.posterior.as_ref()?.clone().with_height_known_to(settings.noise.height);
    let before_each = scene_energy(scene, settings);
    let before = total(&before_each) + room_energy(scene, &posterior)?;
    let (camera, positions): (Camera, Vec<Vec3>) =
        (scene.camera, scene.placed.iter().map(|p| p.pose.position).collect());
    let mut trial = scene.clone();
    let (mut scale, mut size_inflation) = (1.0, 1.0);
    for _ in 0..ROUNDS {
        let problem = Problem::new(&trial, settings, true)?;
        size_inflation = problem.size_inflation;
        let step = problem.solved()?;
        scale *= step.scale;
        step.take(&mut trial, settings);
    }
    polish_all(&mut trial, &before_each, settings);
    let after_each = scene_energy(&trial, settings);
    let after = total(&after_each) + room_energy(&trial, &posterior)?;
    for ((p, before), after) in scene.placed.iter().zip(&before_each).zip(&after_each) {
        tracing::debug!(object = %p.item.id, ?before, ?after, "solved jointly");
    }
    // Each object alone fits its own mask, in a camera that is off, better than all of them together can: only the least
    // squares knows what their errors have in common. Where a sensor measured the depths there are none.
    let metric = scene.points.as_ref().is_some_and(|p| p.kind == PointMapKind::Metric);
    let slack = if metric { 0.0 } else { settings.noise.joint_slack * scene.placed.len() as f64 };
    let turn = trial.camera.rotation * camera.rotation.transpose();
    let cos = ((turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0) / 2.0).clamp(-1.0, 1.0);
    let moved: f64 = trial.placed.iter().zip(&positions).map(|(p, q)| p.pose.position.distance(*q)).sum();
    let report = GlobalReport {
        energy: [before, after],
        camera_moved_m: trial.camera.centre().distance(camera.centre()),
        camera_turned_deg: cos.acos().to_degrees(),
        scale,
        size_inflation,
        objects_moved_m: moved / positions.len().max(1) as f64,
        kept: accepts(before, after, slack),
    };
    if report.kept {
        *scene = trial;
    }
    Some(report)
}

/// Looks at every object once more in the camera and room that the least squares left: one that agrees less than `before`
/// (energies of the placed objects) by more than [`Noise::joint_slack`] is solved anew, and the new pose kept by the rule
/// of `accept`: a host that contradicts an answer has its price here, too. What a reviewer has corrected is left alone.
fn polish_all(scene: &mut PartialScene, before: &[Energy], settings: &PlacementSettings) {
    use rayon::prelude::*;
    let still: &PartialScene = scene;
    let poses: Vec<(usize, Pose, Support)> = (0..still.placed.len())
        .into_par_iter()
        .filter_map(|i| {
            let p = &still.placed[i];
            if p.item.traits.corrected {
                return None;
            }
            let window = Window::new(still, &p.item, Some(i), &[], settings)?;
            let yaw = YawRule::About { yaw: p.pose.yaw, sigma: settings.noise.yaw_square };
            let attachment = attachment_of(still, i, &settings.noise);
            let constraint = PoseConstraint::new(still, &p.item, attachment, yaw, &settings.noise);
            let polished = polish(&window, constraint, &p.pose, settings, settings.renders_per_object / 4);
            let told = |pose: &Pose| told_objective(still, i, &window, settings).energy(pose).0.observed();
            if told(&polished.pose) > before[i].observed() + settings.noise.joint_slack {
                let anew = solve(still, &p.item, &window, settings);
                let (pose, support) = (anew.pose, anew.objective.constraint.support());
                if better_anew(still, i, &polished.pose, (&pose, &support), settings) {
                    return Some((i, pose, support));
                }
            }
            Some((i, polished.pose, p.support.clone()))
        })
        .collect();
    let mut moved = Vec::new();
    for (i, pose, support) in poses {
        scene.placed[i].support = support;
        moved.push((i, pose));
    }
    take_poses(scene, moved, settings);
}

/// Whether an object is to be held and placed as `anew` says instead of at a pose on the support it has.
fn better_anew(
    scene: &PartialScene,
    object: usize,
    pose: &Pose,
    anew: (&Pose, &Support),
    settings: &PlacementSettings,
) -> bool {
    let energy = |pose: &Pose, support: &Support| {
        let mut tried = scene.clone();
        let placed = &mut tried.placed[object];
        (placed.pose, placed.support) = (*pose, support.clone());
        placed_energy(&tried, object, settings).map(|e| e.total())
    };
    let was = energy(pose, &scene.placed[object].support);
    was.zip(energy(anew.0, anew.1)).is_some_and(|(was, is)| accepts(was, is, 0.0))
}

/// How uncertain each placed object is: its part of the posterior of everything; `None` for those without a mask.
pub(crate) fn spreads(scene: &PartialScene, settings: &PlacementSettings) -> Vec<Option<Spread>> {
    let mut out = vec![None; scene.placed.len()];
    let Some(problem) = Problem::new(scene, settings, false) else { return out };
    let start = problem.start();
    let rows = problem.rows();
    let jacobian = problem.jacobian(&start, &rows);
    let mut information = jacobian.tr_mul(&jacobian);
    for i in 0..information.nrows() {
        information[(i, i)] += 1e-9;
    }
    let Some(covariance) = information.cholesky().map(|c| c.inverse()) else { return out };
    for (k, b) in problem.blocks.iter().enumerate() {
        out[b.object] = Some(problem.spread(k, &start, &covariance));
    }
    out
}

/// Half the squared residuals of the calibration at the present room, with the scale as it is, nats.
fn room_energy(scene: &PartialScene, posterior: &RoomPosterior) -> Option<f64> {
    let root = root(&posterior.information)?;
    let mean = scene.posterior.as_ref()?.mean;
    let now = room_unknowns(&scene.camera, &scene.room.extents, 1.0);
    let residual = |row: usize| (0..ROOM).map(|c| root[row * ROOM + c] * (now[c] - mean[c])).sum::<f64>();
    Some((0..ROOM).map(|row| NAMED.loss(residual(row))).sum())
}

/// What a least squares found.
struct Step {
    camera: Camera,
    extents: Extents,
    poses: Vec<(usize, Pose)>,
    scale: f64,
}

impl Step {
    fn take(self, scene: &mut PartialScene, settings: &PlacementSettings) {
        carry_points(scene, &self.camera, self.scale);
        if let Some(posterior) = &mut scene.posterior {
            posterior.mean[SCALE] -= self.scale.ln();
        }
        scene.anchor *= self.scale;
        scene.camera = self.camera;
        scene.room.shape.stretched(&scene.room.extents, &self.extents, self.scale);
        scene.room.extents = self.extents;
        take_poses(scene, self.poses, settings);
    }
}

impl<'a> Problem<'a> {
    /// With `hold`, what a reviewer has corrected goes where the room goes: its outline has been overruled.
    fn new(scene: &'a PartialScene, settings: &'a PlacementSettings, hold: bool) -> Option<Self> {
        use rayon::prelude::*;
        let noise = &settings.noise;
        let mut blocks: Vec<ObjectBlock> = (0..scene.placed.len())
            .into_par_iter()
            .filter_map(|i| ObjectBlock::new(scene, i, settings, hold))
            .collect();
        let item = |b: &ObjectBlock| &scene.placed[b.object].item;
        for i in 0..blocks.len() {
            let set = item(&blocks[i]).relations.matched_set.as_ref().filter(|_| settings.groups);
            blocks[i].reference =
                set.and_then(|set| (0..i).find(|j| item(&blocks[*j]).relations.matched_set.as_ref() == Some(set)));
        }
        let size_inflation = size_inflation(scene, &blocks, noise);
        let labels: Vec<String> = blocks.iter().map(|b| item(b).label.clone()).collect();
        for (b, label) in blocks.iter_mut().zip(&labels) {
            let alike = labels.iter().filter(|l| *l == label).count();
            b.sizes = b.sizes.inflated(size_inflation).shared_by(alike);
        }
        let now = room_unknowns(&scene.camera, &scene.room.extents, 1.0);
        let loose = [Wall::Left, Wall::Right].map(|wall| scene.is_loose(wall));
        let (information, mut mean) = match &scene.posterior {
            Some(posterior) => {
                let posterior = posterior.with_hints_inflated(size_inflation).with_height_known_to(noise.height);
                (posterior.information, posterior.mean)
            }
            None => (unknown_room(noise), now),
        };
        // A loose wall says nothing, and stays where it is.
        for k in (0..2).filter(|k| loose[*k]) {
            mean[4 + k] = now[4 + k];
        }
        Some(Self { scene, noise, blocks, root: root(&information)?, mean, now, loose, size_inflation })
    }

    fn start(&self) -> Vec<f64> {
        let mut start = self.now.to_vec();
        start[FLOOR] = self.scene.camera.centre().y.max(0.05).ln();
        start.push(0.0);
        start.extend(self.blocks.iter().flat_map(|b| b.numbers(&self.scene.room.extents)));
        start
    }

    /// What calibration knows.
    fn of_room(&self, u: &[f64], out: &mut Vec<f64>) {
        let metric = metric_unknowns(u);
        for row in 0..ROOM {
            out.push((0..ROOM).map(|c| self.root[row * ROOM + c] * (metric[c] - self.mean[c])).sum());
        }
        out.push((u[0] - self.mean[0]) / self.noise.focal);
        out.extend((1..4).map(|i| (u[i] - self.mean[i]) / self.noise.rotation));
        out.extend((0..2).map(|k| if self.loose[k] { (u[4 + k] - self.now[4 + k]) / HELD } else { 0.0 }));
        out.push(u[COMMON] / (self.size_inflation * self.noise.size_common));
    }

    fn of_block(&self, i: usize, u: &[f64], (camera, extents): &(Camera, Extents), out: &mut Vec<f64>) {
        let b = &self.blocks[i];
        let item = &self.scene.placed[b.object].item;
        let pose = b.pose(self.scene, &u[FIRST + EACH * i..FIRST + EACH * (i + 1)], extents);
        let outline = b.outline.as_ref().map(|o| o.residuals(camera, &item.shape, &pose));
        out.extend(outline_residuals(outline.unwrap_or_default(), self.noise));
        out.push(b.depth.map_or(0.0, |(log, sigma)| {
            // The front goes with the position.
            let own = (camera.depth(pose.position) / b.start_depth.max(0.05)).max(0.05).ln();
            Kernel::GemanMcClure(self.noise.outline_limit).residual((log - own) / sigma)
        }));
        out.extend(b.sizes.residuals(item, &pose, u[SCALE], u[COMMON]).map(|r| NAMED.residual(r)));
        out.push(match b.attachment {
            Attachment::AgainstWall(wall) => {
                let gap = wall.distance(extents, pose.position) - size_of(item, &pose).z / 2.0;
                wall_residual(gap * u[SCALE].exp(), self.noise)
            }
            _ => 0.0,
        });
        let [metres, radians, size] = self.noise.tether;
        out.push((pose.position.x - b.start.position.x) / metres);
        out.push((pose.position.z - b.start.position.z) / metres);
        out.push(angle_between(pose.yaw, b.start.yaw) / radians);
        out.push((pose.scale / b.start.scale).ln() / size);
        let other = b.reference.map(|other| u[ln_scale(other)] - self.blocks[other].start.scale.ln());
        out.push(other.map_or(0.0, |other| (u[ln_scale(i)] - b.start.scale.ln() - other) / self.noise.size_set));
    }

    fn residuals(&self, u: &[f64], out: &mut Vec<f64>) {
        self.of_room(u, out);
        let room = room(u, self.scene);
        (0..self.blocks.len()).for_each(|i| self.of_block(i, u, &room, out));
    }

    /// Residuals of each block.
    fn rows(&self) -> Vec<usize> {
        let start = self.start();
        let room = room(&start, self.scene);
        let count = |i: usize| {
            let mut out = Vec::new();
            self.of_block(i, &start, &room, &mut out);
            out.len()
        };
        (0..self.blocks.len()).map(count).collect()
    }

    /// The unknowns with which a block's residuals change: the room, its own, and the scale of its reference.
    fn unknowns_of(&self, i: usize) -> Vec<usize> {
        let own = FIRST + EACH * i..FIRST + EACH * (i + 1);
        (0..FIRST).chain(own).chain(self.blocks[i].reference.map(ln_scale)).collect()
    }

    fn jacobian(&self, u: &[f64], rows_of: &[usize]) -> DMatrix<f64> {
        use rayon::prelude::*;
        let of_blocks: Vec<(Vec<usize>, DMatrix<f64>)> = (0..self.blocks.len())
            .into_par_iter()
            .map(|i| {
                let unknowns = self.unknowns_of(i);
                let take = |f: &dyn Fn(usize) -> f64| unknowns.iter().map(|k| f(*k)).collect::<Vec<f64>>();
                let slopes = differences(&take(&|k| u[k]), &take(&step), rows_of[i], |own, out| {
                    let mut moved = u.to_vec();
                    unknowns.iter().zip(own).for_each(|(k, v)| moved[*k] = *v);
                    self.of_block(i, &moved, &room(&moved, self.scene), out);
                });
                (unknowns, slopes)
            })
            .collect();
        let mut of_room = Vec::new();
        self.of_room(u, &mut of_room);
        let mut row = of_room.len();
        let mut out = DMatrix::zeros(row + rows_of.iter().sum::<usize>(), u.len());
        let steps: Vec<f64> = (0..u.len()).map(step).collect();
        out.rows_mut(0, row).copy_from(&differences(u, &steps, row, |u, out| self.of_room(u, out)));
        for (unknowns, slopes) in of_blocks {
            for (k, unknown) in unknowns.into_iter().enumerate() {
                out.view_mut((row, unknown), (slopes.nrows(), 1)).copy_from(&slopes.column(k));
            }
            row += slopes.nrows();
        }
        out
    }

    fn solved(&self) -> Option<Step> {
        let rows = self.rows();
        let residuals = |u: &[f64], out: &mut Vec<f64>| self.residuals(u, out);
        let u = minimise_with(&self.start(), ITERATIONS, residuals, |u, _| self.jacobian(u, &rows)).parameters;
        if !u.iter().all(|v| v.is_finite()) {
            return None;
        }
        let (mut camera, mut extents) = room(&u, self.scene);
        let scale = u[SCALE].exp();
        let in_metres = |(b, n): (&ObjectBlock, &[f64])| {
            let mut pose = b.pose(self.scene, n, &extents);
            pose.position *= scale;
            pose.scale *= scale;
            pose.stretch.y = height_stretch(&self.scene.placed[b.object].item, pose.scale, pose.stretch.y);
            (b.object, pose)
        };
        let poses = self.blocks.iter().zip(u[FIRST..].chunks(EACH)).map(in_metres).collect();
        camera.translation *= scale;
        extents = Extents { width: extents.width * scale, height: u[HEIGHT].exp(), depth: extents.depth * scale };
        Some(Step { camera, extents, poses, scale })
    }

    /// One sigma of a block's position and turn in the room in metres, and of its size.
    fn spread(&self, k: usize, u: &[f64], covariance: &DMatrix<f64>) -> Spread {
        let unknowns = self.unknowns_of(k);
        let value = |own: &[f64], out: &mut Vec<f64>| {
            let mut moved = u.to_vec();
            unknowns.iter().zip(own).for_each(|(k, v)| moved[*k] = *v);
            let extents = room(&moved, self.scene).1;
            let pose = self.blocks[k].pose(self.scene, &moved[FIRST + EACH * k..FIRST + EACH * (k + 1)], &extents);
            out.extend((pose.position * moved[SCALE].exp()).to_array());
            out.extend([pose.yaw, pose.scale.ln() + moved[SCALE]]);
        };
        let take = |f: &dyn Fn(usize) -> f64| unknowns.iter().map(|k| f(*k)).collect::<Vec<f64>>();
        let slopes = differences(&take(&|k| u[k]), &take(&step), 5, value);
        let own = DMatrix::from_fn(unknowns.len(), unknowns.len(), |i, j| covariance[(unknowns[i], unknowns[j])]);
        let of_pose = &slopes * own * slopes.transpose();
        let variance = |i: usize| of_pose[(i, i)].max(0.0);
        Spread {
            position_m: (variance(0) + variance(1) + variance(2)).sqrt(),
            // The turn of what has no front is no error.
            yaw: if self.scene.placed[self.blocks[k].object].item.traits.has_front { variance(3).sqrt() } else { 0.0 },
            size: variance(4).sqrt(),
        }
    }
}

/// Index of an object's logarithm of scale.
fn ln_scale(block: usize) -> usize {
    FIRST + EACH * block + 3
}

/// Derivative step of an unknown.
fn step(unknown: usize) -> f64 {
    STEPS[usize::from(unknown >= FIRST)]
}

/// Information about a room of which no map was calibrated.
fn unknown_room(noise: &Noise) -> Vec<f64> {
    let mut out = vec![0.0; ROOM * ROOM];
    for i in 0..ROOM {
        out[i * ROOM + i] = noise.scale_unknown.powi(-2);
    }
    out
}

/// By how much the sizes that a model named are farther from those that masks and depths show than a good model's are.
fn size_inflation(scene: &PartialScene, blocks: &[ObjectBlock], noise: &Noise) -> f64 {
    let trusted = blocks.iter().filter(|b| b.outline.is_some()).map(|b| &scene.placed[b.object]);
    let off: Vec<f64> = trusted.map(|p| crate::terms::size_log_ratio(&p.item, &p.pose)).collect();
    let spread =
        median_absolute_deviation(&off).filter(|_| off.len() >= JUDGED_SIZES).map_or(0.0, |m| MAD_TO_SIGMA * m.1);
    (spread / noise.size).clamp(1.0, MAX_INFLATION)
}

impl ObjectBlock {
    fn new(scene: &PartialScene, object: usize, settings: &PlacementSettings, hold: bool) -> Option<Self> {
        let placed = &scene.placed[object];
        let item = &placed.item;
        let window = Window::new(scene, item, Some(object), &[], settings)?;
        let held = hold && item.traits.corrected;
        let trusted = !held && placed.evidence.silhouette_iou.unwrap_or(0.0) >= TRUSTED_IOU;
        let ratio = if trusted { window.depth_ratio(&item.shape, &placed.pose).map(f64::ln) } else { None };
        let sigma = DepthNoise::new(scene, &window, &settings.noise).mean;
        Some(Self {
            object,
            attachment: attachment_of(scene, object, &settings.noise),
            outline: trusted.then_some(window.outline),
            depth: ratio.filter(|log| log.abs() < OTHER_SURFACE).map(|log| (log, sigma)),
            sizes: NamedSize::of_item(item, &settings.noise),
            start: placed.pose,
            start_depth: scene.camera.depth(placed.pose.position),
            reference: None,
        })
    }

    /// The four numbers of an object.
    fn numbers(&self, extents: &Extents) -> [f64; EACH] {
        let p = self.start.position;
        let (u, v) = match self.attachment {
            Attachment::OnWall(wall) => (wall.coordinates(p).x, p.y),
            Attachment::AgainstWall(wall) => (wall.coordinates(p).x, wall.distance(extents, p)),
            _ => (p.x, p.z),
        };
        [u, v, self.start.yaw, self.start.scale.ln()]
    }

    /// The pose of four numbers in a room of some size.
    fn pose(&self, scene: &PartialScene, n: &[f64], extents: &Extents) -> Pose {
        let item = &scene.placed[self.object].item;
        let mut pose = Pose { yaw: n[2], scale: n[3].exp(), ..self.start };
        match self.attachment {
            Attachment::OnWall(wall) => {
                let away = wall.distance(&scene.room.extents, self.start.position);
                pose.position = wall.point(extents, n[0], n[1]) + wall.normal() * away;
                pose.yaw = self.start.yaw;
            }
            Attachment::AgainstWall(wall) => {
                pose.position = wall.point(extents, n[0], 0.0) + wall.normal() * n[1];
                pose.position.y = self.start.position.y;
                pose.yaw = self.start.yaw;
            }
            Attachment::Ceiling => {
                pose.position = Vec3::new(n[0], 0.0, n[1]);
                let recessed = scene.room.ceiling_over(pose.position) - scene.room.extents.height;
                pose.position.y = extents.height + recessed - size_of(item, &pose).y;
            }
            Attachment::Floor | Attachment::OnHost { .. } | Attachment::OnLedge(_) => {
                pose.position = Vec3::new(n[0], self.start.position.y, n[1]);
            }
        }
        pose
    }
}

/// The unknowns of the calibration in metres.
fn metric_unknowns(u: &[f64]) -> [f64; ROOM] {
    let s = u[SCALE];
    let logit = floor_logit(u[FLOOR] + s, u[HEIGHT]);
    [u[0], u[1], u[2], u[3], u[4] + s, u[5] + s, logit, u[7] + s, u[HEIGHT], s]
}

/// `ln(floor / (height - floor))` of two logarithms; a camera above the ceiling counts as just below it.
fn floor_logit(ln_floor: f64, ln_height: f64) -> f64 {
    let share = (ln_floor - ln_height).exp().clamp(0.001, 0.98);
    (share / (1.0 - share)).ln()
}

/// Camera and room of some unknowns, in units of the map; what they do not know stays: the front wall, the principal
/// point, a lens that a sensor's map gives.
fn room(u: &[f64], scene: &PartialScene) -> (Camera, Extents) {
    let height = u[HEIGHT] - u[SCALE];
    let p = [u[0], u[1], u[2], u[3], u[4], u[5], floor_logit(u[FLOOR], height), u[7], height, 0.0];
    let (mut camera, mut extents) = room_from_unknowns(&p, scene.camera.size);
    let (fx, old) = (camera.intrinsics.fx, scene.camera.intrinsics);
    let is_given = scene.points.as_ref().is_some_and(|p| p.kind == PointMapKind::Metric);
    camera.intrinsics = if is_given { old } else { Intrinsics { fx, fy: fx * old.fy / old.fx, ..old } };
    extents.depth = scene.room.extents.depth - scene.camera.centre().z + camera.centre().z;
    (camera, extents)
}

/// A matrix whose square is the information: `F^T F = I`.
fn root(information: &[f64]) -> Option<Vec<f64>> {
    let m = DMatrix::from_column_slice(ROOM, ROOM, information);
    let eigen = nalgebra::SymmetricEigen::new((&m + m.transpose()) * 0.5);
    let mut out = vec![0.0; ROOM * ROOM];
    for row in 0..ROOM {
        let k = eigen.eigenvalues[row].max(0.0).sqrt();
        for c in 0..ROOM {
            out[row * ROOM + c] = k * eigen.eigenvectors[(c, row)];
        }
    }
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// Brings the map's points along: they keep their pixels and take the new scale.
fn carry_points(scene: &mut PartialScene, camera: &Camera, scale: f64) {
    let old = scene.camera;
    let ratio = camera.intrinsics.fx / old.intrinsics.fx;
    for p in scene.points.iter_mut().flat_map(|p| &mut p.xyz) {
        if p.is_finite() {
            let c = old.to_camera(*p) * scale;
            *p = camera.to_room(Vec3::new(c.x / ratio, c.y / ratio, c.z));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_geometry::RoomPosterior;
    use harmony_scene::{ObjectId, Support};

    use super::*;
    use crate::testing::{add, boxed, empty_room};
    use crate::{Evidence, Placed};

    /// Six boxes on the floor as they are, with masks of the camera as it is; calibration knows directions and focal
    /// length well, the height exactly, the scale to `sigma`, the camera's height (logit) to `floor_sigma`.
    fn furnished(sigma: f64, floor_sigma: f64) -> PartialScene {
        furnished_at(&[[0.8, 1.0], [2.0, 0.8], [3.2, 1.2], [1.0, 2.4], [2.2, 2.0], [3.3, 2.7]], sigma, floor_sigma)
    }

    fn furnished_at(places: &[[f64; 2]], sigma: f64, floor_sigma: f64) -> PartialScene {
        let mut scene = empty_room();
        for (k, [x, z]) in places.iter().copied().enumerate() {
            let size = Vec3::new(0.5 + 0.05 * k as f64, 0.9 - 0.06 * k as f64, 0.5);
            let mut item = boxed(&scene, size, Vec3::new(x, 0.0, z), 0.2 * k as f64);
            item.id = ObjectId::numbered("box", k);
            scene.placed.push(Placed {
                item: Arc::new(item),
                pose: Pose::new(Vec3::new(x, 0.0, z), 0.2 * k as f64, 1.0),
                support: Support::Floor,
                evidence: Evidence { silhouette_iou: Some(1.0), ..Evidence::default() },
            });
        }
        let mut information = vec![0.0; ROOM * ROOM];
        let sigmas = [0.002, 0.001, 0.001, 0.001, 0.02, 0.02, floor_sigma, 0.02, 0.001, sigma];
        for (i, s) in sigmas.into_iter().enumerate() {
            information[i * ROOM + i] = 1.0 / (s * s);
        }
        // Left, right and back are known relative to the map, whose scale is open.
        for i in [4, 5, 7] {
            let k = 1.0 / (sigmas[i] * sigmas[i]);
            information[i * ROOM + SCALE] = -k;
            information[SCALE * ROOM + i] = -k;
            information[SCALE * ROOM + SCALE] += k;
        }
        let mean = room_unknowns(&scene.camera, &scene.room.extents, 1.0);
        scene.posterior = Some(RoomPosterior { information, mean, hints: Vec::new() });
        scene
    }

    #[test]
    fn a_given_lens_stays_whole_and_another_one_changes_its_focal_length_alone() {
        let mut scene = furnished(0.1, 0.1);
        let given = Intrinsics { fx: 300.0, fy: 306.0, cx: 165.0, cy: 110.0 };
        scene.camera.intrinsics = given;
        let mut u = room_unknowns(&scene.camera, &scene.room.extents, 1.0);
        u[0] += 0.01;
        for (kind, times) in [(PointMapKind::Metric, 1.0), (PointMapKind::Relative, 0.01_f64.exp())] {
            let (size, xyz) = (harmony_scene::ImageSize::new(1, 1), vec![Vec3::NAN]);
            scene.points = Some(crate::RoomPoints { kind, size, xyz, confidence: vec![0.0] });
            let k = room(&u, &scene).0.intrinsics;
            assert!(
                (k.fx - given.fx * times).abs() < 1e-9 && (k.fy - given.fy * times).abs() < 1e-9,
                "{kind:?}: {k:?}"
            );
            assert_eq!([k.cx, k.cy], [given.cx, given.cy]);
        }
    }

    #[test]
    fn what_stands_on_something_goes_up_and_down_with_it() {
        let mut scene = furnished(0.1, 0.1);
        let top = Vec3::new(0.8, 0.9, 1.0);
        let mut lamp = boxed(&scene, Vec3::new(0.1, 0.3, 0.1), top, 0.0);
        lamp.id = ObjectId::numbered("lamp", 0);
        let support = Support::Object { id: scene.placed[0].item.id.clone() };
        let evidence = Evidence::default();
        scene.placed.push(Placed { item: Arc::new(lamp), pose: Pose::new(top, 0.0, 1.0), support, evidence });
        // By more than the slack within which a surface is looked for.
        let grown = Pose { scale: 1.4, ..scene.placed[0].pose };
        take_poses(&mut scene, vec![(0, grown)], &PlacementSettings::default());
        let y = scene.placed[6].pose.position.y;
        assert!((y - 1.4 * 0.9).abs() < 1e-3, "{y}");
    }

    /// The same scene in another scale; the room's height stays.
    fn scaled(mut scene: PartialScene, factor: f64) -> PartialScene {
        scene.camera.translation *= factor;
        scene.room.extents.width *= factor;
        scene.room.extents.depth *= factor;
        for p in &mut scene.placed {
            p.pose.position *= factor;
            p.pose.scale *= factor;
        }
        let mean = room_unknowns(&scene.camera, &scene.room.extents, 1.0);
        scene.posterior = scene.posterior.map(|p| RoomPosterior { mean, ..p });
        scene
    }

    #[test]
    fn sizes_right_a_scale_that_calibration_leaves_open() {
        let truth = furnished(0.3, 0.5);
        let mut scene = scaled(truth.clone(), 1.12);
        let report = refine_globally(&mut scene, &PlacementSettings::default()).unwrap();
        assert!(report.kept, "{report:?}");
        // Six sizes that may share an error of 3 % against an open scale: nearly all of it comes back.
        assert!((report.scale * 1.12 - 1.0).abs() < 0.03, "{report:?}");
        // The told height is known to 4 %, and nothing seen speaks against it.
        let height = (scene.room.extents.height / truth.room.extents.height).ln();
        assert!(height.abs() < PlacementSettings::default().noise.height, "{height}");
        assert!(report.energy[1] < report.energy[0] + 3.0, "{report:?}");
        for (p, q) in scene.placed.iter().zip(&truth.placed) {
            assert!(p.pose.position.distance(q.pose.position) < 0.12, "{:?} {:?}", p.pose, q.pose);
        }
    }

    #[test]
    fn a_scale_that_calibration_knows_stays_whatever_the_sizes_say() {
        let mut scene = furnished(0.002, 0.02);
        for p in &mut scene.placed {
            let mut item = (*p.item).clone();
            item.size = harmony_scene::Size::from_vec(item.size.as_vec() * 1.25);
            p.item = Arc::new(item);
        }
        let report = refine_globally(&mut scene, &PlacementSettings::default()).unwrap();
        assert!((report.scale - 1.0).abs() < 0.01, "{report:?}");
        assert!(report.energy[1] < report.energy[0] + 3.0, "{report:?}");
    }

    /// Boxes that are as large as they are seen, whose sizes are named 12 % too large in the middle and up to `spread` beside
    /// that (logarithms).
    fn with_sizes_off(count: u32, spread: f64) -> PartialScene {
        let places: Vec<[f64; 2]> =
            (0..count).map(|k| [0.6 + 0.7 * f64::from(k % 5), 0.6 + 1.3 * f64::from(k / 5)]).collect();
        let mut scene = furnished_at(&places, 0.06, 0.5);
        for (k, p) in scene.placed.iter_mut().enumerate() {
            let mut item = (*p.item).clone();
            let off = 0.12 + spread * (2.0 * k as f64 / f64::from(count - 1) - 1.0);
            item.size = harmony_scene::Size::from_vec(item.size.as_vec() * off.exp());
            p.item = Arc::new(item);
        }
        scene
    }

    #[test]
    fn sizes_that_contradict_each_other_are_doubted() {
        let doubt = |count: u32, spread: f64| {
            Problem::new(&with_sizes_off(count, spread), &PlacementSettings::default(), true).unwrap().size_inflation
        };
        // Together too large is not doubt, but the scale's affair; nor is a spread as that of good models.
        assert_eq!([doubt(10, 0.0), doubt(10, 0.15)], [1.0, 1.0]);
        // Eleven sizes, 0.08 from one to the next: the median distance from the middle one is 0.24.
        let twice = doubt(11, 0.4);
        assert!((twice - 1.48 * 0.24 / 0.15).abs() < 0.1, "{twice}");
        // Of few objects nobody knows.
        assert_eq!(doubt(6, 0.6), 1.0);
    }

    #[test]
    fn doubted_sizes_move_the_scale_less() {
        let refined =
            |spread: f64| refine_globally(&mut with_sizes_off(10, spread), &PlacementSettings::default()).unwrap();
        let [agreeing, scattered] = [0.1, 0.6].map(refined);
        let moved = |report: &GlobalReport| report.scale.ln();
        assert!(moved(&agreeing) > 0.02 && moved(&scattered) < 0.6 * moved(&agreeing), "{agreeing:?} {scattered:?}");
        assert!(agreeing.size_inflation == 1.0 && scattered.size_inflation > 1.5, "{agreeing:?} {scattered:?}");
    }

    #[test]
    fn an_open_scale_makes_every_position_and_size_uncertain_and_a_known_one_does_not() {
        let settings = PlacementSettings::default();
        let of = |sigma: f64| {
            let mut scene = furnished(sigma, 0.5);
            for p in &mut scene.placed {
                // Nothing is said of sizes.
                Arc::make_mut(&mut p.item).label = "thing".to_owned();
            }
            let unsaid =
                PlacementSettings { noise: Noise { size: 10.0, ..settings.noise.clone() }, ..settings.clone() };
            spreads(&scene, &unsaid).into_iter().map(|s| s.unwrap()).collect::<Vec<_>>()
        };
        let (open, known) = (of(0.2), of(0.001));
        for (a, b) in open.iter().zip(&known) {
            assert!(a.size > 1.5 * b.size && a.position_m > b.position_m, "{a:?} {b:?}");
        }
    }

    #[test]
    fn a_pose_solved_anew_pays_for_a_host_that_nobody_named() {
        let settings = PlacementSettings::default();
        let mut scene = empty_room();
        let (table, top) = (Vec3::new(2.0, 0.0, 2.0), Vec3::new(2.0, 0.7, 2.0));
        for name in ["table_01", "bench_01"] {
            add(&mut scene, name, Vec3::new(1.6, 0.7, 0.8), table, |_| {});
        }
        let on = |name: &str| Support::Object { id: ObjectId::new(name).unwrap() };
        add(&mut scene, "vase_01", Vec3::new(0.15, 0.3, 0.15), top, |p| {
            Arc::make_mut(&mut p.item).relations.on_top_of = ObjectId::new("table_01").ok();
            p.support = on("table_01");
        });
        let there = Pose::new(top, 0.0, 1.0);
        let aside = |x: f64| Pose { position: top + Vec3::X * x, ..there };
        let observed = |pose: &Pose| {
            let mut tried = scene.clone();
            tried.placed[2].pose = *pose;
            placed_energy(&tried, 2, &settings).unwrap().observed()
        };
        let elsewhere = on("bench_01");
        let anew = |from: f64| better_anew(&scene, 2, &aside(from), (&there, &elsewhere), &settings);
        assert!(observed(&there) < observed(&aside(0.005)), "a little better seen");
        assert!(!anew(0.005), "not by what another host costs");
        assert!(anew(0.4), "half a metre is more than that");
    }

    #[test]
    fn without_a_posterior_nothing_is_done() {
        let mut scene = furnished(0.3, 0.5);
        scene.posterior = None;
        assert!(refine_globally(&mut scene, &PlacementSettings::default()).is_none());
    }
}
