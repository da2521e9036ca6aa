//! All poses, the camera, the room and the scale together (beyond the paper; DESIGN section 8).
//!
//! Placing objects one after the other in a fixed camera leaves each with its own errors, and all with those of the
//! camera and the walls. Here everything is one weighted least squares: the outlines of all masks in a dozen
//! directions each, the front depths of the map, sizes, walls at backs, equal sizes within sets, and what calibration
//! knows of camera, room and scale, each in units of its own uncertainty. An outline is compared only where the mask
//! ends by itself: not at the image's border, and not at something nearer.
//!
//! All lengths but the room's height are in units of the map as it is, and the scale that makes them metres is an
//! unknown of its own: a change of the scale alone changes no outline, and nothing is left behind by it.

use std::cell::RefCell;
use std::sync::LazyLock;

use harmony_geometry::least_squares::{minimise, robust};
use harmony_geometry::{room_from_unknowns, room_unknowns};
use harmony_scene::{Camera, Extents, Level, Mask, PixelBox, PointMapKind, Pose, Support, Vec2, Vec3, Wall};

use crate::anchoring::{Anchoring, USUAL_GAP, prior_scale, size_of};
use crate::formulas::front_surface_depth;
use crate::level::{anchoring_of, neighbours};
use crate::proxy::Proxy;
use crate::standard::standard_height;
use crate::view::View;
use crate::{PartialScene, PlacementSettings, RoomPoints};

/// Directions in which outlines are compared.
const DIRECTIONS: usize = 16;
/// One sigma of an outline, pixels of an image 1000 pixels wide, and relative to the object's size in the image: masks
/// are ragged, and generated meshes approximate.
const OUTLINE_SIGMA: [f64; 2] = [2.5, 0.015];
/// One sigma of reaching a cut, in outline sigmas.
const CUT_SIGMA: f64 = 2.0;
/// Share of the outermost pixels that must end by themselves.
const FREE_SHARE: f64 = 0.6;
/// A neighbour whose depth is smaller than this share of the own one is nearer.
const NEARER: f64 = 0.955;
/// One sigma of the map's depth, relative: smooth error over a patch (share of the image's width), and its floor.
const DEPTH_SIGMA: [f64; 2] = [0.03, 0.012];
const PATCH: f64 = 0.1;
/// One sigma of a metric map's depth, relative.
const SENSOR_SIGMA: f64 = 0.012;
/// One sigma of the gap to a wall that an object stands at, metres.
const GAP_SIGMA: f64 = 0.02;
/// One sigma of sizes within a matched set, relative.
const SET_SIGMA: f64 = 0.01;
/// One sigma of the turn from where sequential placement left it, radians.
const YAW_SIGMA: f64 = 0.12;
/// One sigma of what nothing else holds: move from where sequential placement left it, metres; and size, relative.
const TETHER: [f64; 2] = [0.3, 0.3];
/// One sigma of the camera's angles, radians: many lines of the photo hold them, better than calibration claims.
const ROTATION_SIGMA: f64 = 0.001;
/// One sigma of what the sizes named by one model have in common, relative.
const COMMON_SIZE_SIGMA: f64 = 0.03;
/// Objects that agree less with their masks say nothing about the others.
const TRUSTED_IOU: f64 = 0.6;
/// Saturation of the losses, sigmas.
const LIMIT: f64 = 3.0;
/// Surface points an object is outlined by, at most.
const OUTLINE_POINTS: usize = 240;
/// What is nearer to the camera than this has no image, metres.
const NEAREST: f64 = 0.05;
/// Edges of an object that the image's border cuts, at most.
const MOST_EDGES: usize = 2000;
/// Least-squares rounds; outlines and depths are read anew before each.
const ROUNDS: usize = 2;
const ITERATIONS: usize = 8;
/// Mean agreement with the masks that a refinement may cost: where camera and scale were off, the first poses fit their
/// own masks better than the right ones do.
const IOU_SLACK: f64 = 0.1;
/// ... and the largest share of objects that may lose their mask: fall by `LOST_IOU` from at least `SEEN_IOU`. Many small
/// losses are the price of one camera for all; an object that is no longer where it is seen is an error.
const MOST_LOST: f64 = 0.07;
const LOST_IOU: f64 = 0.25;
const SEEN_IOU: f64 = 0.4;

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

/// What the refinement did.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct GlobalReport {
    /// Mean agreement of outlines with masks before and after.
    pub iou: [f64; 2],
    /// Objects that lost their mask by it.
    pub lost: usize,
    /// Move of the camera, metres, and its turn, degrees.
    pub camera_moved_m: f64,
    /// See `camera_moved_m`.
    pub camera_turned_deg: f64,
    /// Factor on the scene's scale.
    pub scale: f64,
    /// Mean move of the objects, metres.
    pub objects_moved_m: f64,
    /// Whether the result was kept.
    pub kept: bool,
}

/// One object as the problem sees it.
struct Body {
    /// Index into the placed objects.
    object: usize,
    anchoring: Anchoring,
    /// Canonical points whose projections make its outline.
    outline: Vec<Vec3>,
    /// Edges of the mesh, of an object that the image's border cuts: what of them is in the image makes its outline there.
    edges: Vec<[Vec3; 2]>,
    /// Where the outline counts: the image where its border cuts the mask.
    within: PixelBox,
    /// How far the mask reaches in each direction, pixels, and whether it ends there by itself.
    reach: Vec<(f64, bool)>,
    outline_sigma: f64,
    /// Front depth of the map over that of the object, and one sigma, relative.
    depth: Option<(f64, f64)>,
    start: Pose,
    /// Planar depth of its position at the start.
    start_depth: f64,
    size_log: f64,
    size_sigma: f64,
    /// Logarithm of the scale at which it has its standard height, and one sigma.
    standard: Option<(f64, f64)>,
    /// Its set's first member, in bodies.
    twin: Option<usize>,
}

/// Refines everything that is placed; the scene changes only when its agreement with the masks does not suffer.
///
/// `None` where calibration left no posterior (no point map) or nothing is placed.
pub fn refine_globally(scene: &mut PartialScene, settings: &PlacementSettings) -> Option<GlobalReport> {
    scene.posterior.as_ref()?;
    let before = agreement(scene, settings)?;
    let (camera, positions): (Camera, Vec<Vec3>) =
        (scene.camera, scene.placed.iter().map(|p| p.pose.position).collect());
    let mut trial = scene.clone();
    let mut scale = 1.0;
    for _ in 0..ROUNDS {
        scale *= round(&mut trial, settings)?;
    }
    crate::level::polish_all(&mut trial, settings);
    let after = agreement(&trial, settings)?;
    let lost = before.iter().zip(&after).filter(|(b, a)| **b >= SEEN_IOU && **a < **b - LOST_IOU).count();
    let kept = mean(&after) >= mean(&before) - IOU_SLACK && lost as f64 <= MOST_LOST * before.len() as f64;
    let turn = trial.camera.rotation * camera.rotation.transpose();
    let cos = ((turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0) / 2.0).clamp(-1.0, 1.0);
    let moved: f64 = trial.placed.iter().zip(&positions).map(|(p, q)| p.pose.position.distance(*q)).sum();
    let report = GlobalReport {
        iou: [mean(&before), mean(&after)],
        lost,
        camera_moved_m: trial.camera.centre().distance(camera.centre()),
        camera_turned_deg: cos.acos().to_degrees(),
        scale,
        objects_moved_m: moved / positions.len().max(1) as f64,
        kept,
    };
    if kept {
        *scene = trial;
    }
    Some(report)
}

/// One sigma of a size that was named, relative: the setting is a cautious bound for single objects.
fn size_sigma(settings: &PlacementSettings) -> f64 {
    0.75 * settings.size_sigma
}

/// Agreement of each placed object with its mask, in the partial scene; 0 where there is none.
fn agreement(scene: &PartialScene, settings: &PlacementSettings) -> Option<Vec<f64>> {
    use rayon::prelude::*;
    let all: Vec<f64> = (0..scene.placed.len())
        .into_par_iter()
        .map(|i| crate::evidence::silhouette_iou(scene, i, settings).unwrap_or(0.0))
        .collect();
    (!all.is_empty()).then_some(all)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn direction(k: usize) -> Vec2 {
    static ALL: LazyLock<[Vec2; DIRECTIONS]> = LazyLock::new(|| {
        std::array::from_fn(|k| Vec2::from_angle(std::f64::consts::TAU * k as f64 / DIRECTIONS as f64))
    });
    ALL[k]
}

/// What is left of each body's residuals in one room: most derivatives move one body only, and nothing of the others
/// changes then.
#[derive(Default)]
struct Known {
    /// The unknowns that concern all bodies.
    room: Vec<f64>,
    /// By body, its numbers and its residuals.
    bodies: Vec<(Vec<f64>, Vec<f64>)>,
}

/// One round; returns the factor on the scale.
fn round(scene: &mut PartialScene, settings: &PlacementSettings) -> Option<f64> {
    let bodies = bodies(scene, settings);
    let posterior = scene.posterior.as_ref()?;
    let factor = root(&posterior.information)?;
    let now = room_unknowns(&scene.camera, &scene.room.extents, 1.0);
    let mut start = now.to_vec();
    start[FLOOR] = scene.camera.centre().y.max(0.05).ln();
    start.push(0.0);
    for b in &bodies {
        start.extend(numbers(b, &scene.room.extents));
    }
    let steps: Vec<f64> = (0..start.len()).map(|i| if i < FIRST { 1e-5 } else { 1e-4 }).collect();
    // A loose wall says nothing, and stays where it is.
    let loose = [(4, Wall::Left), (5, Wall::Right)].map(|(i, wall)| (i, scene.is_loose(wall)));
    let mut mean = posterior.mean;
    for (i, _) in loose.into_iter().filter(|(_, loose)| *loose) {
        mean[i] = now[i];
    }
    let known = RefCell::new(Known::default());
    let solution = minimise(&start, &steps, ITERATIONS, |u, out| {
        // What calibration knows.
        let metric = metric_unknowns(u);
        for row in 0..ROOM {
            out.push((0..ROOM).map(|c| factor[row * ROOM + c] * (metric[c] - mean[c])).sum());
        }
        out.extend((1..4).map(|i| (u[i] - mean[i]) / ROTATION_SIGMA));
        out.extend(loose.map(|(i, loose)| if loose { (u[i] - now[i]) / 0.01 } else { 0.0 }));
        out.push(u[COMMON] / COMMON_SIZE_SIGMA);
        let (camera, extents) = room(u, scene);
        let mut known = known.borrow_mut();
        if known.room != u[..FIRST] {
            known.room = u[..FIRST].to_vec();
            known.bodies.clear();
        }
        for (i, (b, own)) in bodies.iter().zip(u[FIRST..].chunks(EACH)).enumerate() {
            match known.bodies.get(i) {
                Some((numbers, left)) if numbers == own => out.extend(left),
                before => {
                    let first = before.is_none();
                    let begun = out.len();
                    let pose = pose(scene, b, own, &extents);
                    residuals(scene, b, &pose, &camera, &extents, [u[SCALE], u[COMMON]], out);
                    if first {
                        known.bodies.push((own.to_vec(), out[begun..].to_vec()));
                    }
                }
            }
            if let Some(twin) = b.twin {
                let own = u[FIRST + EACH * i + 3] - bodies[i].start.scale.ln();
                let other = u[FIRST + EACH * twin + 3] - bodies[twin].start.scale.ln();
                out.push((own - other) / SET_SIGMA);
            }
        }
    });
    let u = &solution.parameters;
    if !u.iter().all(|v| v.is_finite()) {
        return None;
    }
    let (mut camera, mut extents) = room(u, scene);
    let mut poses = poses(scene, &bodies, u, &extents);
    let scale = u[SCALE].exp();
    camera.translation *= scale;
    extents = Extents { width: extents.width * scale, height: u[HEIGHT].exp(), depth: extents.depth * scale };
    for pose in &mut poses {
        pose.position *= scale;
        pose.scale *= scale;
    }
    carry_points(scene, &camera, scale);
    if let Some(posterior) = &mut scene.posterior {
        posterior.mean[SCALE] -= u[SCALE];
    }
    scene.anchor *= scale;
    scene.camera = camera;
    scene.room.extents = extents;
    for (b, pose) in bodies.iter().zip(poses) {
        scene.placed[b.object].pose = pose;
    }
    settle_all(scene, settings);
    Some(scale)
}

fn poses(scene: &PartialScene, bodies: &[Body], u: &[f64], extents: &Extents) -> Vec<Pose> {
    bodies.iter().zip(u[FIRST..].chunks(EACH)).map(|(b, n)| pose(scene, b, n, extents)).collect()
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
/// point.
fn room(u: &[f64], scene: &PartialScene) -> (Camera, Extents) {
    let height = u[HEIGHT] - u[SCALE];
    let p = [u[0], u[1], u[2], u[3], u[4], u[5], floor_logit(u[FLOOR], height), u[7], height, 0.0];
    let (mut camera, mut extents) = room_from_unknowns(&p, scene.camera.size);
    camera.intrinsics.cx = scene.camera.intrinsics.cx;
    camera.intrinsics.cy = scene.camera.intrinsics.cy;
    extents.depth = scene.room.extents.depth - scene.camera.centre().z + camera.centre().z;
    (camera, extents)
}

/// A matrix whose square is the information: `F^T F = I`.
fn root(information: &[f64]) -> Option<Vec<f64>> {
    let m = nalgebra::DMatrix::from_column_slice(ROOM, ROOM, information);
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

fn bodies(scene: &PartialScene, settings: &PlacementSettings) -> Vec<Body> {
    use rayon::prelude::*;
    let mut out: Vec<Body> = (0..scene.placed.len()).into_par_iter().filter_map(|i| body(scene, i, settings)).collect();
    for i in 0..out.len() {
        let set = |b: &Body| scene.placed[b.object].item.relations.matched_set.clone();
        let own = set(&out[i]);
        if own.is_some() {
            out[i].twin = (0..i).find(|j| set(&out[*j]) == own);
        }
    }
    // How far a room's worktops are from the standard, they are together.
    let labels: Vec<&str> = out.iter().map(|b| scene.placed[b.object].item.label.as_str()).collect();
    for (i, b) in out.iter_mut().enumerate() {
        let alike = labels.iter().filter(|l| **l == labels[i]).count();
        b.standard = b.standard.map(|(log, sigma)| (log, sigma * (alike as f64).sqrt()));
    }
    out
}

fn body(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<Body> {
    let placed = &scene.placed[object];
    let item = &placed.item;
    let others = neighbours(scene, item, &[], Some(object));
    let view = View::new(scene, Some(object), &item.mask, &others, settings.window_px)?;
    let (reference, rendered) = view.front_depths(item.shape.proxy(), &placed.pose);
    let dense = settings.point_map && scene.points.as_ref().is_some_and(RoomPoints::is_dense);
    let poor = placed.evidence.silhouette_iou.unwrap_or(0.0) < TRUSTED_IOU;
    let b = &view.mask_box;
    let width = f64::from(scene.camera.size.width);
    let metric = scene.points.as_ref().is_some_and(|p| p.kind == PointMapKind::Metric);
    let patches = 1.0 + b.width() * b.height() / (PATCH * width).powi(2);
    let depth_sigma = if metric { SENSOR_SIGMA } else { (DEPTH_SIGMA[0] / patches.sqrt()).hypot(DEPTH_SIGMA[1]) };
    let readable = !poor && dense && reference.len() >= 12 && rendered.len() >= 12;
    let ratio = || Some(front_surface_depth(&reference)? / front_surface_depth(&rendered)?);
    // Far from 1 another surface was read: an object in front, a wall behind.
    let depth = if readable { ratio().filter(|r| (r - 1.0).abs() < 0.25) } else { None };
    let depth = depth.map(|ratio| (ratio, depth_sigma));
    let extent = b.width().max(b.height());
    let heavily = if item.traits.heavily_occluded { 2.0 } else { 1.0 };
    let outline_sigma = (OUTLINE_SIGMA[0] * width / 1000.0).hypot(OUTLINE_SIGMA[1] * extent) * heavily;
    let reach = if poor {
        vec![(f64::NEG_INFINITY, false); DIRECTIONS]
    } else {
        let others = others_of(scene, object);
        (0..DIRECTIONS).map(|k| mask_reach(scene, &item.mask, direction(k), &others)).collect()
    };
    let (scale, stretch) = prior_scale(item, item.size);
    let relative = (placed.pose.stretch / stretch).max(Vec3::splat(1e-3));
    let stretched = if item.traits.flat {
        (relative.x * relative.z).sqrt().ln()
    } else {
        (relative.x * relative.y * relative.z).cbrt().ln()
    };
    Some(Body {
        object,
        anchoring: anchoring_of(scene, object),
        outline: outline_points(scene, object),
        edges: if view.is_cut() { edges_of(item.shape.proxy()) } else { Vec::new() },
        within: view.within,
        reach,
        outline_sigma,
        depth,
        start: placed.pose,
        start_depth: scene.camera.depth(placed.pose.position),
        size_log: scale.ln() - stretched,
        size_sigma: size_sigma(settings),
        standard: standard_height(&item.label, item.size.height).map(|(height, sigma)| {
            let own = item.shape.bounds().size().y * placed.pose.stretch.y;
            ((height / own.max(1e-6)).ln(), sigma)
        }),
        twin: None,
    })
}

fn others_of(scene: &PartialScene, object: usize) -> Vec<usize> {
    (0..scene.placed.len())
        .filter(|i| *i != object && !scene.placed[*i].item.traits.flat && scene.placed[*i].item.level != Level::Wall)
        .collect()
}

/// The canonical points that can be the outermost in some direction: extremes of the hulls.
fn outline_points(scene: &PartialScene, object: usize) -> Vec<Vec3> {
    let all: Vec<Vec3> = scene.placed[object].item.shape.hulls().iter().flatten().copied().collect();
    if all.len() <= OUTLINE_POINTS {
        return all;
    }
    let mut chosen: Vec<usize> = Vec::new();
    for i in 0..OUTLINE_POINTS {
        // A Fibonacci sphere of directions.
        let y = 1.0 - 2.0 * (i as f64 + 0.5) / OUTLINE_POINTS as f64;
        let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
        let d = Vec3::new(cos * (1.0 - y * y).sqrt(), y, sin * (1.0 - y * y).sqrt());
        let best = (0..all.len()).max_by(|a, b| all[*a].dot(d).total_cmp(&all[*b].dot(d)));
        chosen.extend(best.filter(|b| !chosen.contains(b)));
    }
    chosen.into_iter().map(|i| all[i]).collect()
}

/// The edges of a form, at most [`MOST_EDGES`] of them.
fn edges_of(proxy: &Proxy) -> Vec<[Vec3; 2]> {
    let at = |i: u32| proxy.points[i as usize].as_dvec3();
    let mut edges: Vec<[u32; 2]> = proxy
        .triangles
        .iter()
        .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let step = edges.len().div_ceil(MOST_EDGES).max(1);
    edges.into_iter().step_by(step).map(|[a, b]| [at(a), at(b)]).collect()
}

/// The part of a segment that is inside of a box.
fn clipped(a: Vec2, b: Vec2, within: &PixelBox) -> Option<[Vec2; 2]> {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    let sides = [(Vec2::X, -within.x0), (Vec2::Y, -within.y0), (Vec2::NEG_X, within.x1), (Vec2::NEG_Y, within.y1)];
    for (normal, limit) in sides {
        let (da, db) = (normal.dot(a) + limit, normal.dot(b) + limit);
        match (da >= 0.0, db >= 0.0) {
            (true, true) => {}
            (false, false) => return None,
            (true, false) => to = to.min(da / (da - db)),
            (false, true) => from = from.max(da / (da - db)),
        }
    }
    (from <= to).then(|| [a.lerp(b, from), a.lerp(b, to)])
}

/// How far a mask reaches in a direction (pixels), and whether it ends there by itself: not at the image's border,
/// nor at a mask of something nearer.
fn mask_reach(scene: &PartialScene, mask: &Mask, d: Vec2, others: &[usize]) -> (f64, bool) {
    let size = mask.size();
    let (w, h) = (size.width as i64, size.height as i64);
    let mut along: Vec<(f64, i64, i64)> = Vec::new();
    let Some(b) = mask.bounds() else { return (f64::NEG_INFINITY, false) };
    for y in b.y0 as i64..b.y1 as i64 {
        // Only the ends of a row can be outermost.
        let mut row = (b.x0 as i64..b.x1 as i64).filter(|x| mask.get(*x, y));
        if let Some(first) = row.next() {
            let last = row.next_back().unwrap_or(first);
            for x in [first, last] {
                let p = Vec2::new(x as f64 + 0.5, y as f64 + 0.5);
                along.push((p.dot(d) + 0.5 * (d.x.abs() + d.y.abs()), x, y));
            }
        }
    }
    if d.y.abs() > 0.9 {
        // Up and down the outermost rows count with all their pixels.
        for y in [b.y0 as i64, b.y1 as i64 - 1] {
            for x in b.x0 as i64..b.x1 as i64 {
                if mask.get(x, y) {
                    along.push((Vec2::new(x as f64 + 0.5, y as f64 + 0.5).dot(d) + 0.5, x, y));
                }
            }
        }
    }
    along.sort_by(|a, b| b.0.total_cmp(&a.0));
    // A stray pixel or two is no outline.
    let reach = along.get(along.len() / 300).map_or(f64::NEG_INFINITY, |a| a.0);
    let band: Vec<&(f64, i64, i64)> = along.iter().take_while(|a| a.0 > reach - 3.0).take(200).collect();
    let cut = |&&(_, x, y): &&(f64, i64, i64)| {
        (2..=6).step_by(2).any(|k| {
            let (u, v) = (x + (d.x * f64::from(k)).round() as i64, y + (d.y * f64::from(k)).round() as i64);
            if u < 1 || v < 1 || u >= w - 1 || v >= h - 1 {
                return true;
            }
            let other = others.iter().any(|o| scene.placed[*o].item.mask.get(u, v)) && !mask.get(u, v);
            match (depth_at(scene, u, v), depth_at(scene, x, y)) {
                (Some(there), Some(here)) => there < NEARER * here,
                _ => other,
            }
        })
    };
    let cuts = band.iter().filter(|a| cut(a)).count();
    (reach, (cuts as f64) < (1.0 - FREE_SHARE) * band.len() as f64)
}

fn depth_at(scene: &PartialScene, x: i64, y: i64) -> Option<f64> {
    let points = scene.points.as_ref().filter(|p| p.is_dense())?;
    let k = |v: i64, own: u32, full: u32| (v * i64::from(own) / i64::from(full)).clamp(0, i64::from(own) - 1) as usize;
    let (u, v) = (k(x, points.size.width, scene.camera.size.width), k(y, points.size.height, scene.camera.size.height));
    let p = points.xyz[v * points.size.width as usize + u];
    p.is_finite().then(|| scene.camera.depth(p))
}

/// The four numbers of an object.
fn numbers(b: &Body, extents: &Extents) -> [f64; EACH] {
    let p = b.start.position;
    let (u, v) = match b.anchoring {
        Anchoring::OnWall(wall) => (wall.coordinates(p).x, p.y),
        Anchoring::AgainstWall(wall) => (wall.coordinates(p).x, wall.distance(extents, p)),
        _ => (p.x, p.z),
    };
    [u, v, b.start.yaw, b.start.scale.ln()]
}

/// The pose of four numbers in a room of some size.
fn pose(scene: &PartialScene, b: &Body, n: &[f64], extents: &Extents) -> Pose {
    let item = &scene.placed[b.object].item;
    let mut pose = Pose { yaw: n[2], scale: n[3].exp(), ..b.start };
    match b.anchoring {
        Anchoring::OnWall(wall) => {
            let away = wall.distance(&scene.room.extents, b.start.position);
            pose.position = wall.point(extents, n[0], n[1]) + wall.normal() * away;
            pose.yaw = b.start.yaw;
        }
        Anchoring::AgainstWall(wall) => {
            pose.position = wall.point(extents, n[0], 0.0) + wall.normal() * n[1];
            pose.position.y = b.start.position.y;
            pose.yaw = b.start.yaw;
        }
        Anchoring::Ceiling => {
            pose.position = Vec3::new(n[0], extents.height - size_of(item, &pose).y, n[1]);
        }
        Anchoring::Floor | Anchoring::OnHost { .. } => pose.position = Vec3::new(n[0], b.start.position.y, n[1]),
    }
    pose
}

fn residuals(
    scene: &PartialScene,
    b: &Body,
    pose: &Pose,
    camera: &Camera,
    extents: &Extents,
    [ln_scale, ln_common]: [f64; 2],
    out: &mut Vec<f64>,
) {
    let linear = camera.rotation * pose.linear();
    let offset = camera.to_camera(pose.position);
    let k = camera.intrinsics;
    let pixel = |c: Vec3| Vec2::new(k.fx * c.x / c.z + k.cx, k.fy * c.y / c.z + k.cy);
    let reach_to = |far: &mut [f64; DIRECTIONS], p: Vec2| {
        for (i, far) in far.iter_mut().enumerate() {
            *far = far.max(p.dot(direction(i)));
        }
    };
    let mut far = [f64::NEG_INFINITY; DIRECTIONS];
    for c in b.outline.iter().map(|p| linear * *p + offset).filter(|c| c.z >= NEAREST) {
        reach_to(&mut far, pixel(c));
    }
    // Of an object that the border cuts, what is beyond it says nothing about where the mask should end by itself.
    let mut far_inside = [f64::NEG_INFINITY; DIRECTIONS];
    for [p, q] in &b.edges {
        let (p, q) = (linear * *p + offset, linear * *q + offset);
        if p.z >= NEAREST
            && q.z >= NEAREST
            && let Some(ends) = clipped(pixel(p), pixel(q), &b.within)
        {
            for end in ends {
                reach_to(&mut far_inside, end);
            }
        }
    }
    for (i, (reach, free)) in b.reach.iter().enumerate() {
        let far = if *free && !b.edges.is_empty() { far_inside[i] } else { far[i] };
        let off = if reach.is_finite() && far.is_finite() { (far - reach) / b.outline_sigma } else { 0.0 };
        // Where the mask is cut the outline may go on, but must get there.
        let off = if *free { off } else { (off / CUT_SIGMA).min(0.0) };
        out.push(robust(off, LIMIT) / (DIRECTIONS as f64 / 4.0).sqrt());
    }
    out.push(match b.depth {
        Some((ratio, sigma)) => {
            // Ratio of the map's depth to the object's: the object goes with its position.
            let own = camera.depth(pose.position) / b.start_depth.max(0.05);
            robust((ratio.ln() - own.max(0.05).ln()) / sigma, LIMIT)
        }
        None => 0.0,
    });
    out.push(robust((pose.scale.ln() + ln_scale - b.size_log - ln_common) / b.size_sigma, LIMIT));
    out.push(match b.standard {
        Some((log, sigma)) => robust((pose.scale.ln() + ln_scale - log) / sigma, LIMIT),
        None => 0.0,
    });
    let item = &scene.placed[b.object].item;
    out.push(match b.anchoring {
        Anchoring::AgainstWall(wall) => {
            let gap = (wall.distance(extents, pose.position) - size_of(item, pose).z / 2.0) * ln_scale.exp();
            (gap - USUAL_GAP) / if gap < 0.003 { 0.3 * GAP_SIGMA } else { GAP_SIGMA }
        }
        _ => 0.0,
    });
    let turn = crate::cost::angle_between(pose.yaw, b.start.yaw);
    out.push(turn / YAW_SIGMA);
    out.push((pose.position.x - b.start.position.x) / TETHER[0]);
    out.push((pose.position.z - b.start.position.z) / TETHER[0]);
    out.push((pose.scale / b.start.scale).ln() / TETHER[1]);
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

/// Puts everything back onto its support, hosts before what they carry.
pub(crate) fn settle_all(scene: &mut PartialScene, settings: &PlacementSettings) {
    use crate::anchoring::{Frame, YawRule};
    let order: Vec<usize> = {
        let carried = |i: usize| matches!(scene.placed[i].support, Support::Object { .. });
        let mut all: Vec<usize> = (0..scene.placed.len()).collect();
        all.sort_by_key(|i| carried(*i));
        all
    };
    for i in order {
        let item = std::sync::Arc::clone(&scene.placed[i].item);
        let frame = Frame {
            scene,
            item: &item,
            anchoring: anchoring_of(scene, i),
            yaw: YawRule::Fixed(scene.placed[i].pose.yaw),
            wall_gap: settings.wall_gap,
            fixed_size: true,
        };
        let pose = frame.settle(&scene.placed[i].pose);
        scene.placed[i].pose = pose;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_geometry::RoomPosterior;
    use harmony_scene::ObjectId;

    use super::*;
    use crate::testing::{boxed, empty_room};
    use crate::{Evidence, Placed};

    /// Six boxes on the floor as they are, with masks of the camera as it is; calibration knows directions and focal
    /// length well, the height exactly, the scale to `sigma`, the camera's height (logit) to `floor_sigma`.
    fn furnished(sigma: f64, floor_sigma: f64) -> PartialScene {
        let mut scene = empty_room();
        let places = [[0.8, 1.0], [2.0, 0.8], [3.2, 1.2], [1.0, 2.4], [2.2, 2.0], [3.3, 2.7]];
        for (k, [x, z]) in places.into_iter().enumerate() {
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
        scene.posterior = Some(RoomPosterior { information, mean });
        scene
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
    fn a_segment_is_cut_at_the_sides_of_a_box() {
        let b = PixelBox { x0: 0.0, y0: 0.0, x1: 10.0, y1: 10.0 };
        let cut = |a: [f64; 2], c: [f64; 2]| clipped(Vec2::from(a), Vec2::from(c), &b);
        assert_eq!(cut([-5.0, 5.0], [15.0, 5.0]), Some([Vec2::new(0.0, 5.0), Vec2::new(10.0, 5.0)]));
        assert_eq!(cut([2.0, 3.0], [4.0, 5.0]), Some([Vec2::new(2.0, 3.0), Vec2::new(4.0, 5.0)]));
        assert_eq!(cut([-5.0, 8.0], [8.0, 21.0]), None, "past the corner");
        let across = cut([5.0, 5.0], [5.0, 25.0]).unwrap();
        assert!((across[1] - Vec2::new(5.0, 10.0)).length() < 1e-12);
    }

    #[test]
    fn sizes_right_a_scale_that_calibration_leaves_open() {
        let truth = furnished(0.3, 0.5);
        let mut scene = scaled(truth.clone(), 1.12);
        let report = refine_globally(&mut scene, &PlacementSettings::default()).unwrap();
        assert!(report.kept, "{report:?}");
        // Six sizes that may share an error of 3 % against an open scale: nearly all of it comes back.
        assert!((report.scale * 1.12 - 1.0).abs() < 0.03, "{report:?}");
        assert!((scene.room.extents.height - truth.room.extents.height).abs() < 0.01);
        assert!(report.iou[1] > report.iou[0] - 0.02, "{report:?}");
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
        assert!(report.iou[1] > report.iou[0] - 0.02, "{report:?}");
    }

    #[test]
    fn without_a_posterior_nothing_is_done() {
        let mut scene = furnished(0.3, 0.5);
        scene.posterior = None;
        assert!(refine_globally(&mut scene, &PlacementSettings::default()).is_none());
    }
}
