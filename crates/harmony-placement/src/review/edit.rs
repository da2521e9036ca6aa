//! What actions do to a scene: objects are moved, scaled, exchanged, copied and put onto other supports.
//!
//! Every edit keeps two things: what rests on an object goes with it, and a pose is settled onto its support again. An
//! edit changes what is *said* of the object too (its wall, its host, its size), so that the next solve does not take
//! it back. Room frame, metres, radians. Nothing is judged here: edits give a scene, `verdict` says whether it stays.

use std::sync::Arc;

use harmony_scene::{Mask, ObjectId, Pose, Relations, Size, Support, Vec3, Wall, WallPlane};

use super::ActionError;
use crate::observe::Window;
use crate::propose::level_direction;
use crate::scene::attachment::{Attachment, PoseConstraint, SAME_TURN, YawRule, angle_between, attachment_of, reach};
use crate::scene::subtree::take_along;
use crate::solve::local::solve;
use crate::{Item, PartialScene, Placed, PlacementSettings};

/// Changes what is said of a placed object.
pub(super) fn edit_item(scene: &mut PartialScene, object: usize, change: impl Fn(&mut Item)) {
    let mut item = (*scene.placed[object].item).clone();
    change(&mut item);
    scene.placed[object].item = Arc::new(item);
}

/// Changes an object's pose, puts it back onto its support, and takes along what rests on it.
pub(super) fn carry(scene: &mut PartialScene, object: usize, settings: &PlacementSettings, change: impl Fn(&mut Pose)) {
    let old = scene.placed[object].pose;
    let mut wanted = old;
    change(&mut wanted);
    let item = Arc::clone(&scene.placed[object].item);
    // An object that is turned away from its wall stands free from then on.
    let attachment = match attachment_of(scene, object, &settings.noise) {
        Attachment::AgainstWall(wall) if angle_between(wanted.yaw, wall.yaw()).abs() > SAME_TURN => Attachment::Floor,
        Attachment::AgainstWall(wall) if pulled_off(scene, &old, &wanted, wall) => Attachment::Floor,
        // Into a niche behind it.
        Attachment::AgainstWall(wall) if wall.distance(&scene.room.extents, wanted.position) < 0.0 => Attachment::Floor,
        Attachment::OnHost { host, level } => {
            Attachment::OnHost { host, level: level + wanted.position.y - old.position.y }
        }
        Attachment::OnWall(wall) => Attachment::OnWall(plane_towards(scene, wall, &old, &wanted)),
        other => other,
    };
    let yaw = YawRule::Fixed(wanted.yaw);
    let noise = &settings.noise;
    let constraint = PoseConstraint { fixed_size: true, ..PoseConstraint::new(scene, &item, attachment, yaw, noise) };
    let new = constraint.settle(&wanted);
    take_along(scene, object, new);
}

/// A move off a wall by more than this takes what stands at it away from it, metres.
const OFF_WALL: f64 = 0.03;

/// The plane, of those that face as an object's wall does, that a move off its plane leads to: into a recess, or out of it.
fn plane_towards(scene: &PartialScene, wall: WallPlane, old: &Pose, wanted: &Pose) -> WallPlane {
    let inset = wall.inset + (wanted.position - old.position).dot(wall.normal());
    let off = |plane: &WallPlane| (plane.inset - inset).abs();
    scene.room.planes(wall.wall).into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(wall)
}

/// Whether a wanted place is farther from the wall than the present one.
fn pulled_off(scene: &PartialScene, old: &Pose, wanted: &Pose, wall: WallPlane) -> bool {
    let far = |pose: &Pose| wall.distance(&scene.room.extents, pose.position);
    far(wanted) - far(old) > OFF_WALL
}

/// Multiplies the sides of an object. The size that it has then is what is said about it from now on: whoever asks for a
/// factor looks at the size that it was placed with, not at the one that was said before.
pub(super) fn rescale(scene: &mut PartialScene, object: usize, factor: Vec3, settings: &PlacementSettings) {
    let common = (factor.x * factor.y * factor.z).cbrt();
    let wanted = Size::from_vec(scene.placed[object].size().as_vec() * factor);
    edit_item(scene, object, |item| {
        item.size = wanted;
        item.traits.corrected = true;
    });
    let base = scene.placed[object].pose.position.y;
    let seen_end = seen_end(scene, object, settings);
    let half = |placed: &Placed, along: Vec3| {
        let (low, high) = reach(&placed.item, &placed.pose);
        ((high - low) * along.abs()).element_sum() / 2.0
    };
    let before = seen_end.map(|end| half(&scene.placed[object], end));
    carry(scene, object, settings, |pose| {
        pose.scale *= common;
        pose.stretch *= factor / common;
    });
    if let (Some(end), Some(before)) = (seen_end, before) {
        // What the picture cuts, or another thing hides, grows there: the end that is seen stays.
        let by = before - half(&scene.placed[object], end);
        carry(scene, object, settings, |pose| pose.position += end * by);
    }
    // Its surfaces have gone up or down, and what stands on them with them.
    let host = scene.placed[object].item.id.clone();
    let moved = scene.placed[object].pose.position.y - base;
    let stands = |p: &Placed| matches!(&p.support, Support::Object { id } if *id == host);
    for guest in (0..scene.placed.len()).filter(|k| stands(&scene.placed[*k])).collect::<Vec<_>>() {
        let mut pose = scene.placed[guest].pose;
        pose.position.y += (pose.position.y - base - moved) * (factor.y - 1.0);
        take_along(scene, guest, pose);
    }
}

/// The direction, level, in which the one end of an object lies that is seen, where the other is not.
fn seen_end(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<Vec3> {
    let window = Window::new(scene, &scene.placed[object].item, Some(object), &[], settings)?;
    let right = level_direction(scene.camera.right())?;
    match (window.free[0], window.free[2]) {
        (true, false) => Some(-right),
        (false, true) => Some(right),
        _ => None,
    }
}

/// Two objects exchange their places: what is seen there, what carries them and what they carry. Each keeps its
/// shape and what is said about its size, and is fitted to its new place.
pub(super) fn exchange(
    scene: &mut PartialScene,
    i: usize,
    j: usize,
    settings: &PlacementSettings,
) -> Result<(), ActionError> {
    let (p, q) = (scene.placed[i].clone(), scene.placed[j].clone());
    let carried = |a: &Placed, b: &Placed| matches!(&a.support, Support::Object { id } if *id == b.item.id);
    if i == j || p.item.level != q.item.level || carried(&p, &q) || carried(&q, &p) {
        return Err(ActionError::NotExchangeable { a: p.item.id.clone(), b: q.item.id.clone() });
    }
    let moved = |own: &Placed, place: &Placed| {
        let there = &place.item;
        let mut item = (*own.item).clone();
        item.mask = Arc::clone(&there.mask);
        item.detection = there.detection;
        item.placement = there.placement;
        item.host_candidates.clone_from(&there.host_candidates);
        item.yaw = there.yaw;
        item.traits.heavily_occluded = there.traits.heavily_occluded;
        item.relations = Relations {
            group: own.item.relations.group.clone(),
            matched_set: own.item.relations.matched_set.clone(),
            ..there.relations.clone()
        };
        let pose = Pose { scale: own.pose.scale, stretch: own.pose.stretch, ..place.pose };
        Placed { item: Arc::new(item), pose, support: place.support.clone(), evidence: place.evidence }
    };
    (scene.placed[i], scene.placed[j]) = (moved(&p, &q), moved(&q, &p));
    // What rests there stays, on whoever is there now.
    let (a, b) = (&p.item.id, &q.item.id);
    for k in (0..scene.placed.len()).filter(|k| *k != i && *k != j) {
        let Support::Object { id } = &scene.placed[k].support else { continue };
        let Some(now) = (if id == a { Some(b) } else { (id == b).then_some(a) }) else { continue };
        scene.placed[k].support = Support::Object { id: now.clone() };
        edit_item(scene, k, |item| item.relations.on_top_of = Some(now.clone()));
    }
    for k in [i, j] {
        let item = (*scene.placed[k].item).clone();
        place_anew(scene, k, item, settings);
    }
    Ok(())
}

/// Places a decoration anew on another host.
pub(super) fn rehost(scene: &mut PartialScene, object: usize, host: &ObjectId, settings: &PlacementSettings) {
    let mut item = (*scene.placed[object].item).clone();
    item.relations.on_top_of = Some(host.clone());
    place_anew(scene, object, item, settings);
}

/// Places an object anew by changed relations.
pub(super) fn place_anew(scene: &mut PartialScene, object: usize, item: Item, settings: &PlacementSettings) {
    let item = Arc::new(item);
    let solution = Window::new(scene, &item, Some(object), &[], settings).map(|window| {
        let s = solve(scene, &item, &window, settings);
        (s.pose, s.objective.constraint.support())
    });
    let placed = &mut scene.placed[object];
    placed.item = item;
    if let Some((pose, support)) = solution {
        placed.pose = pose;
        placed.support = support;
    }
}

/// Turns what hangs on a wall: it hangs on the wall that faces so, if that is another one.
pub(super) fn hang_elsewhere(
    scene: &mut PartialScene,
    object: usize,
    from: Wall,
    yaw: f64,
    settings: &PlacementSettings,
) -> Result<(), ActionError> {
    let off = |w: &Wall| angle_between(yaw, w.yaw()).abs();
    let wall = Wall::ALL.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).filter(|w| *w != from);
    let wall = wall.ok_or(ActionError::HeldByWall)?;
    let mut item = (*scene.placed[object].item).clone();
    item.relations.wall_affinity = wall.into();
    place_anew(scene, object, item, settings);
    Ok(())
}

/// Adds a copy of an object, without a mask of its own; returns its id.
pub(super) fn copy(
    scene: &mut PartialScene,
    like: usize,
    at: Vec3,
    yaw: f64,
    settings: &PlacementSettings,
) -> ObjectId {
    let model = scene.placed[like].clone();
    let mut number = 2;
    let id = loop {
        let id = ObjectId::numbered(&model.item.label, number);
        if scene.position(&id).is_none() {
            break id;
        }
        number += 1;
    };
    let mut item = (*model.item).clone();
    item.id = id.clone();
    item.index = scene.placed.iter().map(|p| p.item.index).max().unwrap_or(9) + 1;
    item.mask = Mask::empty(scene.camera.size).into();
    scene.placed.push(Placed { item: Arc::new(item), ..model });
    let last = scene.placed.len() - 1;
    carry(scene, last, settings, |pose| {
        pose.position = at;
        pose.yaw = yaw;
    });
    id
}
