//! First poses on walls: the mask's centre as a ray against the walls, its extent projected onto the wall plane. Paper
//! App. C "Wall-Mounted Object Placement". Key `wall.ray`.
//!
//! Walls in question are the one that the ray meets, its neighbour near a seam, and the one that was named; in a room
//! that is no box the planes of blocks and niches too. Every pixel of the mask is projected, which is the exact
//! correction for foreshortening; sizes outside a factor of the prior are clamped. Wall coordinates `(u, y)` and
//! metres. Where two ends are seen and one may be another thing's, the prior width is tried from either end.

use harmony_scene::{Pose, Ray, Support, Vec2, Vec3, Wall, WallPlane};

use super::{Hypothesis, Proposer};
use crate::contact::rows::{along, axis};
use crate::noise::surprise;
use crate::observe::Window;
use crate::scene::attachment::{Attachment, YawRule, prior_scale, size_of};
use crate::{PartialScene, PlacementSettings};

/// Nearer than this to the seam of two walls, both are tried, metres.
const SEAM: f64 = 0.35;

/// Where less of the prior width than this is seen between two ends, one of them is perhaps not the object's own: a
/// panel of a pair of curtains whose other one is out of window.
const PART: f64 = 0.7;

/// How far beyond a window's end its curtains may end, share of the window's width.
const OVERHANG: f64 = 0.6;

/// A measured size outside this factor of the prior is clamped: the plausibility clamp of App. C.
const PLAUSIBLE: f64 = 2.5;

pub(crate) fn hypotheses<'a>(proposer: &Proposer<'a, '_>) -> Vec<Hypothesis<'a>> {
    let mut out = Vec::new();
    let said = proposer.item.relations.wall_affinity.wall().filter(|_| proposer.settings.relations);
    for wall in planes(proposer) {
        let constraint = proposer.constraint(Attachment::OnWall(wall), YawRule::Fixed(wall.yaw()));
        let pose = on_wall(proposer, wall);
        let price =
            if said.is_some_and(|said| said != wall.wall) { surprise(proposer.settings.noise.wrong_hung) } else { 0.0 };
        out.extend(wholes(proposer, wall).iter().map(|whole| Hypothesis {
            constraint,
            pose: constraint.settle(whole),
            price,
        }));
        out.push(Hypothesis { constraint, pose: constraint.settle(&pose), price });
    }
    out
}

/// The object in its prior size with one of its ends and its top where they are seen, where only a part may be seen.
fn wholes(proposer: &Proposer, wall: WallPlane) -> Vec<Pose> {
    let e = &proposer.scene.room.extents;
    let whole = proposer.sized(Vec3::ZERO, wall.yaw());
    let size = size_of(proposer.item, &whole);
    let Some([(u0, u1), (_, top)]) = seen_on(proposer, wall, size).filter(|[(u0, u1), _]| u1 - u0 < PART * size.x)
    else {
        return Vec::new();
    };
    let at = |u: f64| Pose { position: wall.point(e, u, top - size.y), ..whole };
    vec![at(u0 + size.x / 2.0), at(u1 - size.x / 2.0)]
}

/// The planes in question: in a box the walls; else the plane that the centre ray meets, and those of the reasoned walls
/// that it can reach.
fn planes(proposer: &Proposer) -> Vec<WallPlane> {
    let room = &proposer.scene.room;
    let walls = walls(proposer);
    if room.shape.is_box() {
        return walls.into_iter().map(WallPlane::from).collect();
    }
    let ray = proposer.scene.camera.ray(proposer.window.mask_box.centre());
    let mut out: Vec<WallPlane> = room.faces().hit_plane(&ray).into_iter().collect();
    for wall in walls {
        for plane in room.planes(wall) {
            let towards = -ray.direction.dot(plane.normal());
            let at = ray.at(plane.distance(&room.extents, ray.origin) / towards);
            let meets = towards > 0.02 && room.plane_behind(wall, at).inset == plane.inset;
            if meets && !out.iter().any(|p| p.wall == wall && (p.inset - plane.inset).abs() < 1e-3) {
                out.push(plane);
            }
        }
    }
    if out.is_empty() { vec![Wall::Back.into()] } else { out }
}

/// The walls in question: the one that the centre ray meets, its neighbour near a seam, and the reasoned one.
fn walls(proposer: &Proposer) -> Vec<Wall> {
    let e = &proposer.scene.room.extents;
    let ray = proposer.scene.camera.ray(proposer.window.mask_box.centre());
    let mut out: Vec<Wall> = Vec::new();
    if proposer.settings.relations {
        out.extend(proposer.item.relations.wall_affinity.wall());
    }
    let hit = proposer.scene.room.faces().exit(&ray).and_then(|exit| match exit.wall() {
        Some(wall) => Some((wall, exit.point)),
        None => nearest_wall(proposer, &ray),
    });
    if let Some((wall, at)) = hit {
        if !out.contains(&wall) {
            out.push(wall);
        }
        for other in Wall::ALL {
            if other != wall && other.distance(e, at) < SEAM && !out.contains(&other) {
                out.push(other);
            }
        }
    }
    if out.is_empty() {
        out.push(Wall::Back);
    }
    out
}

/// The wall nearest to where a ray leaves through floor or ceiling.
fn nearest_wall(proposer: &Proposer, ray: &Ray) -> Option<(Wall, Vec3)> {
    let e = &proposer.scene.room.extents;
    let at = e.exit(ray)?.1;
    let seen = |w: &Wall| ray.direction.dot(w.normal()) < 0.0;
    let wall = Wall::ALL.into_iter().filter(seen).min_by(|a, b| a.distance(e, at).total_cmp(&b.distance(e, at)))?;
    Some((wall, at))
}

/// Where a pixel's ray meets the plane of an object on a wall: `(u, y)` of the wall.
fn on_plane(proposer: &Proposer, wall: WallPlane, size: Vec3, pixel: Vec2) -> Option<Vec2> {
    // What is seen of a thick object is its front as much as its sides: the middle plane is the least wrong.
    let away = proposer.settings.noise.wall_clearance + if proposer.item.traits.planar { size.z } else { size.z / 2.0 };
    let ray = proposer.scene.camera.ray(pixel);
    let towards = -ray.direction.dot(wall.normal());
    let k = (wall.distance(&proposer.scene.room.extents, ray.origin) - away) / towards;
    (towards > 0.02 && k > 0.0).then(|| wall.coordinates(ray.at(k)))
}

/// From where to where the mask reaches on a wall, along it and in height; strays do not count.
fn seen_on(proposer: &Proposer, wall: WallPlane, size: Vec3) -> Option<[(f64, f64); 2]> {
    let pixels = proposer.window.masked_pixels().into_iter();
    let (mut us, mut ys): (Vec<f64>, Vec<f64>) =
        pixels.filter_map(|p| on_plane(proposer, wall, size, p)).map(|c| (c.x, c.y)).unzip();
    if us.is_empty() {
        return None;
    }
    us.sort_by(f64::total_cmp);
    ys.sort_by(f64::total_cmp);
    let span = |v: &[f64]| (v[v.len() / 200], v[v.len() - 1 - v.len() / 200]);
    Some([span(&us), span(&ys)])
}

/// Place and size on a wall from the mask's free edges, projected onto the plane of the object's front.
///
/// Projecting every pixel is the exact foreshortening correction.
fn on_wall(proposer: &Proposer, wall: WallPlane) -> Pose {
    let (item, window) = (proposer.item, proposer.window);
    let e = &proposer.scene.room.extents;
    let mut pose = proposer.sized(Vec3::ZERO, wall.yaw());
    let size = size_of(item, &pose);
    let Some([(u0, u1), (y0, y1)]) = seen_on(proposer, wall, size) else {
        let centre = on_plane(proposer, wall, size, window.mask_box.centre()).unwrap_or(e.as_vec().truncate() / 2.0);
        pose.position = wall.point(e, centre.x, centre.y - size.y / 2.0);
        return pose;
    };
    let free = window.free;
    let (low_free, high_free) = if wall.wall.runs_to_the_right() { (free[0], free[2]) } else { (free[2], free[0]) };
    let measured_w = (low_free && high_free).then_some(u1 - u0);
    let measured_h = (free[1] && free[3]).then_some(y1 - y0);
    let clamp = |measured: f64, prior: f64| (measured / prior).clamp(1.0 / PLAUSIBLE, PLAUSIBLE);
    if !item.traits.heavily_occluded {
        let w = measured_w.map(|m| clamp(m, size.x));
        let h = measured_h.map(|m| clamp(m, size.y));
        if item.traits.may_stretch || item.traits.planar {
            pose.stretch.x *= w.unwrap_or(1.0);
            pose.stretch.y *= h.unwrap_or(1.0);
        } else {
            let factor = match (w, h) {
                (Some(w), Some(h)) => (w * h).sqrt(),
                (Some(f), None) | (None, Some(f)) => f,
                (None, None) => 1.0,
            };
            pose.scale = prior_scale(item, item.size).0 * factor;
        }
    }
    let size = size_of(item, &pose);
    let centre_of = |low: f64, high: f64, extent: f64, free: (bool, bool)| match free {
        (true, false) => low + extent / 2.0,
        (false, true) => high - extent / 2.0,
        _ => f64::midpoint(low, high),
    };
    let u = centre_of(u0, u1, size.x, (low_free, high_free));
    let y = centre_of(y0, y1, size.y, (free[3], free[1]));
    pose.position = wall.point(e, u, y - size.y / 2.0);
    pose
}

/// A window of which both ends are hidden, in the middle of the curtains that hide them; `None` where that is not so.
pub(crate) fn between_curtains(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<Pose> {
    let p = &scene.placed[object];
    let Support::Wall { wall } = p.support else { return None };
    if !p.item.traits.opening || p.item.traits.to_floor {
        return None;
    }
    let window = Window::new(scene, &p.item, Some(object), &[], settings)?;
    if [Vec2::X, Vec2::NEG_X].into_iter().any(|side| window.contour.cut_share(&window.mask_box, side) < 0.5) {
        return None;
    }
    let width = size_of(&p.item, &p.pose).x;
    let own = along(scene, object, wall);
    let curtains = (0..scene.placed.len())
        .filter(|k| *k != object && scene.placed[*k].item.traits.hangs && scene.placed[*k].support == p.support)
        .map(|k| along(scene, k, wall))
        .filter(|c| c[0] < own[1] + OVERHANG * width && c[1] > own[0] - OVERHANG * width);
    let (low, high) = curtains.fold((f64::MAX, f64::MIN), |(l, h), c| (l.min(c[0]), h.max(c[1])));
    // One curtain of a pair, the other unseen, says nothing about the middle.
    if high - low < width || high - low > (1.0 + 2.0 * OVERHANG) * width {
        return None;
    }
    let by = f64::midpoint(low, high) - f64::midpoint(own[0], own[1]);
    Some(Pose { position: p.pose.position + axis(wall) * by, ..p.pose })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::{Level, Mask};

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn a_window_with_hidden_ends_is_in_the_middle_of_its_curtains() {
        let curtains = |scene: &mut PartialScene, pair: bool| {
            for (k, x) in [1.0, 3.0].into_iter().enumerate().take(if pair { 2 } else { 1 }) {
                let name = format!("curtain_0{k}");
                add(scene, &name, Vec3::new(0.5, 2.2, 0.1), Vec3::new(x, 0.1, 0.1), |p| {
                    p.support = Support::Wall { wall: Wall::Back };
                    let mut item = (*p.item).clone();
                    item.traits.hangs = true;
                    item.level = Level::Wall;
                    p.item = Arc::new(item);
                });
            }
        };
        for (pair, expected) in [(true, 2.0), (false, 2.4)] {
            let mut scene = empty_room();
            curtains(&mut scene, pair);
            let masks: Vec<Arc<Mask>> = scene.placed.iter().map(|p| p.item.mask.clone()).collect();
            add(&mut scene, "window_01", Vec3::new(1.8, 1.2, 0.05), Vec3::new(2.0, 0.9, 0.03), |p| {
                p.support = Support::Wall { wall: Wall::Back };
                p.pose.position.x = 2.4;
                let mut item = (*p.item).clone();
                item.level = Level::Wall;
                item.traits.opening = true;
                item.traits.planar = true;
                // What the curtains leave of it.
                let full = item.mask.clone();
                item.mask = Mask::from_fn(full.size(), |x, y| {
                    let (x, y) = (i64::from(x), i64::from(y));
                    full.get(x, y) && !masks.iter().any(|m| m.get(x, y))
                })
                .into();
                p.item = Arc::new(item);
            });
            let pose = between_curtains(&scene, scene.placed.len() - 1, &PlacementSettings::default());
            let at = pose.map_or(2.4, |p| p.position.x);
            assert!((at - expected).abs() < 0.02, "{pair}: {pose:?}");
        }
    }
}
