//! First poses on walls: the mask's centre as a ray against the walls, its extent projected onto the wall plane.
//! Paper App. C "Wall-Mounted Object Placement".

use harmony_scene::{Pose, Ray, Vec2, Vec3, Wall};

use crate::anchoring::{Anchoring, YawRule, prior_scale, size_of};
use crate::first_pose::{Hypothesis, Starter};

/// Nearer than this to the seam of two walls, both are tried, metres.
const SEAM: f64 = 0.35;

/// Price of another wall than the reasoned one.
const OTHER_WALL: f64 = 0.06;

/// Where less of the prior width than this is seen between two ends, one of them is perhaps not the object's own: a
/// panel of a pair of curtains whose other one is out of view.
const PART: f64 = 0.7;

/// A measured size outside this factor of the prior is clamped: the plausibility clamp of App. C.
const PLAUSIBLE: f64 = 2.5;

pub(crate) fn hypotheses<'a>(starter: &Starter<'a, '_>) -> Vec<Hypothesis<'a>> {
    let mut out = Vec::new();
    let said = starter.item.relations.wall_affinity.wall().filter(|_| starter.settings.relations);
    for wall in walls(starter) {
        let frame = starter.frame(Anchoring::OnWall(wall), YawRule::Fixed(wall.yaw()));
        let pose = on_wall(starter, wall);
        let price = if said.is_some_and(|said| said != wall) { OTHER_WALL } else { 0.0 };
        out.extend(wholes(starter, wall).iter().map(|whole| Hypothesis { frame, pose: frame.settle(whole), price }));
        out.push(Hypothesis { frame, pose: frame.settle(&pose), price });
    }
    out
}

/// The object in its prior size with one of its ends and its top where they are seen, where only a part may be seen.
fn wholes(starter: &Starter, wall: Wall) -> Vec<Pose> {
    let e = &starter.scene.room.extents;
    let whole = starter.sized(Vec3::ZERO, wall.yaw());
    let size = size_of(starter.item, &whole);
    let Some([(u0, u1), (_, top)]) = seen_on(starter, wall, size).filter(|[(u0, u1), _]| u1 - u0 < PART * size.x)
    else {
        return Vec::new();
    };
    let at = |u: f64| Pose { position: wall.point(e, u, top - size.y), ..whole };
    vec![at(u0 + size.x / 2.0), at(u1 - size.x / 2.0)]
}

/// The walls in question: the one that the centre ray meets, its neighbour near a seam, and the reasoned one.
fn walls(starter: &Starter) -> Vec<Wall> {
    let e = &starter.scene.room.extents;
    let ray = starter.scene.camera.ray(starter.view.mask_box.centre());
    let mut out: Vec<Wall> = Vec::new();
    if starter.settings.relations {
        out.extend(starter.item.relations.wall_affinity.wall());
    }
    let hit = e.exit(&ray).and_then(|(face, at)| match face.wall() {
        Some(wall) => Some((wall, at)),
        None => nearest_wall(starter, &ray),
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
fn nearest_wall(starter: &Starter, ray: &Ray) -> Option<(Wall, Vec3)> {
    let e = &starter.scene.room.extents;
    let at = e.exit(ray)?.1;
    let seen = |w: &Wall| ray.direction.dot(w.normal()) < 0.0;
    let wall = Wall::ALL.into_iter().filter(seen).min_by(|a, b| a.distance(e, at).total_cmp(&b.distance(e, at)))?;
    Some((wall, at))
}

/// Where a pixel's ray meets the plane of an object on a wall: `(u, y)` of the wall.
fn on_plane(starter: &Starter, wall: Wall, size: Vec3, pixel: Vec2) -> Option<Vec2> {
    // What is seen of a thick object is its front as much as its sides: the middle plane is the least wrong.
    let away = starter.settings.wall_gap + if starter.item.traits.planar { size.z } else { size.z / 2.0 };
    let ray = starter.scene.camera.ray(pixel);
    let towards = -ray.direction.dot(wall.normal());
    let k = (wall.distance(&starter.scene.room.extents, ray.origin) - away) / towards;
    (towards > 0.02 && k > 0.0).then(|| wall.coordinates(ray.at(k)))
}

/// From where to where the mask reaches on a wall, along it and in height; strays do not count.
fn seen_on(starter: &Starter, wall: Wall, size: Vec3) -> Option<[(f64, f64); 2]> {
    let pixels = starter.view.masked_pixels().into_iter();
    let (mut us, mut ys): (Vec<f64>, Vec<f64>) =
        pixels.filter_map(|p| on_plane(starter, wall, size, p)).map(|c| (c.x, c.y)).unzip();
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
fn on_wall(starter: &Starter, wall: Wall) -> Pose {
    let (item, view, camera) = (starter.item, starter.view, &starter.scene.camera);
    let e = &starter.scene.room.extents;
    let mut pose = starter.sized(Vec3::ZERO, wall.yaw());
    let size = size_of(item, &pose);
    let Some([(u0, u1), (y0, y1)]) = seen_on(starter, wall, size) else {
        let centre = on_plane(starter, wall, size, view.mask_box.centre()).unwrap_or(e.as_vec().truncate() / 2.0);
        pose.position = wall.point(e, centre.x, centre.y - size.y / 2.0);
        return pose;
    };
    // Left and right in the image are low and high u on the back wall, and so on around the room.
    let along = wall.point(e, 1.0, 0.0) - wall.point(e, 0.0, 0.0);
    let low_is_left = along.dot(camera.right()) > 0.0;
    let free = view.free;
    let (low_free, high_free) = if low_is_left { (free[0], free[2]) } else { (free[2], free[0]) };
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
