//! One object in the least squares of the global refinement: what its mask, the map's depths and its size say of a pose.

use std::sync::LazyLock;

use harmony_geometry::least_squares::robust;
use harmony_geometry::median_absolute_deviation;
use harmony_scene::{Camera, Extents, Level, Mask, PixelBox, PointMapKind, Pose, Vec2, Vec3};

use super::EACH;
use crate::anchoring::{Anchoring, USUAL_GAP, prior_scale, size_of};
use crate::level::{anchoring_of, neighbours};
use crate::proxy::Proxy;
use crate::standard::standard_height;
use crate::view::{View, border_px};
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
/// One sigma of the turn from where sequential placement left it, radians.
const YAW_SIGMA: f64 = 0.12;
/// One sigma of what nothing else holds: move from where sequential placement left it, metres; and size, relative.
const TETHER: [f64; 2] = [0.3, 0.3];
/// Spread of the sizes that a good model names, from so many objects on; others' sigmas grow by up to `MOST_DOUBT`.
const SIZES_OF_A_GOOD_MODEL: f64 = 0.15;
const JUDGED_SIZES: usize = 8;
const MOST_DOUBT: f64 = 3.0;
/// Objects that agree less with their masks say nothing about the others.
const TRUSTED_IOU: f64 = 0.6;
/// Saturation of the losses, sigmas.
const LIMIT: f64 = 3.0;
/// ... of sizes in metres, round by round: all of them are off together where the scale was.
pub(super) const METRIC_LIMITS: [f64; 2] = [4.0 * LIMIT, LIMIT];
/// What is nearer to the camera than this has no image, metres.
const NEAREST: f64 = 0.05;
/// Edges of an object that the image's border cuts, at most.
const MOST_EDGES: usize = 2000;

/// What makes the map's lengths metres, and how far the sizes that it makes are believed.
pub(super) struct Metric {
    pub(super) ln_scale: f64,
    /// What the sizes that a model named have in common.
    pub(super) ln_common: f64,
    /// Saturation of the losses of sizes, sigmas.
    pub(super) limit: f64,
}

/// One object as the problem sees it.
pub(super) struct Body {
    /// Index into the placed objects.
    pub(super) object: usize,
    anchoring: Anchoring,
    /// Edges of the mesh, of an object that the image's border cuts: what of them is in the image makes its outline there.
    edges: Vec<[Vec3; 2]>,
    /// Where the outline counts: the image where its border cuts the mask.
    within: PixelBox,
    /// How far the mask reaches in each direction, pixels, and whether it ends there by itself.
    reach: Vec<(f64, bool)>,
    outline_sigma: f64,
    /// Front depth of the map over that of the object, and one sigma, relative.
    depth: Option<(f64, f64)>,
    pub(super) start: Pose,
    /// Planar depth of its position at the start.
    start_depth: f64,
    size_log: f64,
    size_sigma: f64,
    /// Whether its mask tells its size.
    trusted: bool,
    /// Logarithm of the scale at which it has its standard height, and one sigma.
    standard: Option<(f64, f64)>,
    /// Its set's first member, in bodies.
    pub(super) twin: Option<usize>,
}

fn direction(k: usize) -> Vec2 {
    static ALL: LazyLock<[Vec2; DIRECTIONS]> = LazyLock::new(|| {
        std::array::from_fn(|k| Vec2::from_angle(std::f64::consts::TAU * k as f64 / DIRECTIONS as f64))
    });
    ALL[k]
}

pub(super) fn bodies(scene: &PartialScene, settings: &PlacementSettings) -> Vec<Body> {
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

/// By how much the sizes that a model named are farther from those that masks and depths show than a good model's are; their
/// sigmas grow by it.
pub(super) fn doubt(bodies: &mut [Body]) -> f64 {
    let off: Vec<f64> = bodies.iter().filter(|b| b.trusted).map(|b| b.start.scale.ln() - b.size_log).collect();
    let spread = median_absolute_deviation(&off).filter(|_| off.len() >= JUDGED_SIZES).map_or(0.0, |m| 1.48 * m.1);
    let doubt = (spread / SIZES_OF_A_GOOD_MODEL).clamp(1.0, MOST_DOUBT);
    for b in bodies {
        b.size_sigma *= doubt;
    }
    doubt
}

fn body(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<Body> {
    let placed = &scene.placed[object];
    let item = &placed.item;
    let others = neighbours(scene, item, &[], Some(object));
    let view = View::new(scene, Some(object), &item.mask, &others, settings.window_px)?;
    let dense = settings.point_map && scene.points.as_ref().is_some_and(RoomPoints::is_dense);
    let poor = placed.evidence.silhouette_iou.unwrap_or(0.0) < TRUSTED_IOU;
    let b = &view.mask_box;
    let width = f64::from(scene.camera.size.width);
    let metric = scene.points.as_ref().is_some_and(|p| p.kind == PointMapKind::Metric);
    let patches = 1.0 + b.width() * b.height() / (PATCH * width).powi(2);
    let depth_sigma = if metric { SENSOR_SIGMA } else { (DEPTH_SIGMA[0] / patches.sqrt()).hypot(DEPTH_SIGMA[1]) };
    let readable = !poor && dense;
    let ratio = || view.depth_ratio(item.shape.proxy(), &placed.pose);
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
        edges: if view.is_cut() { edges_of(item.shape.proxy()) } else { Vec::new() },
        within: view.within,
        reach,
        outline_sigma,
        depth,
        start: placed.pose,
        start_depth: scene.camera.depth(placed.pose.position),
        size_log: scale.ln() - stretched,
        size_sigma: size_sigma(settings),
        trusted: !poor,
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
pub(super) fn clipped(a: Vec2, b: Vec2, within: &PixelBox) -> Option<[Vec2; 2]> {
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
    let beyond = |x: i64, y: i64, by: f64| (x + (d.x * by).round() as i64, y + (d.y * by).round() as i64);
    let outside = |(u, v): (i64, i64)| u < 0 || v < 0 || u >= w || v >= h;
    let border = border_px(size);
    let nearer = |x: i64, y: i64, by: f64| {
        let (u, v) = beyond(x, y, by);
        match (depth_at(scene, u, v), depth_at(scene, x, y)) {
            (Some(there), Some(here)) => there < NEARER * here,
            _ => others.iter().any(|o| scene.placed[*o].item.mask.get(u, v)) && !mask.get(u, v),
        }
    };
    let cut = |&&(_, x, y): &&(f64, i64, i64)| {
        outside(beyond(x, y, border)) || [2.0, 4.0, 6.0].into_iter().any(|by| nearer(x, y, by))
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
pub(super) fn numbers(b: &Body, extents: &Extents) -> [f64; EACH] {
    let p = b.start.position;
    let (u, v) = match b.anchoring {
        Anchoring::OnWall(wall) => (wall.coordinates(p).x, p.y),
        Anchoring::AgainstWall(wall) => (wall.coordinates(p).x, wall.distance(extents, p)),
        _ => (p.x, p.z),
    };
    [u, v, b.start.yaw, b.start.scale.ln()]
}

/// The pose of four numbers in a room of some size.
pub(super) fn pose(scene: &PartialScene, b: &Body, n: &[f64], extents: &Extents) -> Pose {
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

pub(super) fn residuals(
    scene: &PartialScene,
    b: &Body,
    pose: &Pose,
    camera: &Camera,
    extents: &Extents,
    metric: &Metric,
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
    let item = &scene.placed[b.object].item;
    for c in item.shape.extremes().iter().map(|p| linear * *p + offset).filter(|c| c.z >= NEAREST) {
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
    out.push(robust((pose.scale.ln() + metric.ln_scale - b.size_log - metric.ln_common) / b.size_sigma, metric.limit));
    out.push(match b.standard {
        Some((log, sigma)) => robust((pose.scale.ln() + metric.ln_scale - log) / sigma, metric.limit),
        None => 0.0,
    });
    out.push(match b.anchoring {
        Anchoring::AgainstWall(wall) => {
            let gap = (wall.distance(extents, pose.position) - size_of(item, pose).z / 2.0) * metric.ln_scale.exp();
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

/// One sigma of a size that was named, relative: the setting is a cautious bound for single objects.
fn size_sigma(settings: &PlacementSettings) -> f64 {
    0.75 * settings.size_sigma
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
