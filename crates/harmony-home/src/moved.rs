//! A run's objects, camera and lights in the home.
//!
//! The similarity of the room carries everything, so that the photo stays as it is. What is held by a wall keeps its
//! distance to that wall instead, for a wall may have yielded; what hangs keeps its distance to the ceiling; what stands on
//! something goes with it.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use harmony_scene::{Camera, Light, LightKind, ObjectId, Pose, SceneObject, Size, Support, Wall};

use crate::layout::outward;
use crate::rooms::Evidence;
use crate::solve::Solved;

/// Hosts of hosts that are followed.
const MAX_HOSTS: usize = 16;
/// Objects this near to the wall that they have their back to are held by it, metres.
const HELD_M: f64 = 0.6;

/// The wall that holds an object in place.
pub(crate) fn held_by(object: &SceneObject, evidence: &Evidence) -> Option<Wall> {
    match object.support {
        Support::Wall { wall } => Some(wall),
        Support::Floor => object.relations.wall_affinity.wall().filter(|wall| {
            let reach = object.size.depth / 2.0 + HELD_M;
            wall.distance(&evidence.extents, object.pose.position) < reach
        }),
        Support::Ceiling | Support::Object { .. } | Support::Block { .. } | Support::Niche { .. } => None,
    }
}

/// Poses of a run's objects in the home.
pub fn poses(objects: &[SceneObject], evidence: &Evidence, solved: &Solved) -> Vec<Pose> {
    let place = &solved.place;
    let carried: Vec<Pose> = objects
        .iter()
        .map(|o| Pose {
            position: place.point(&evidence.extents, o.pose.position),
            yaw: o.pose.yaw + place.turn.angle() + place.yaw,
            scale: o.pose.scale * place.scale,
            stretch: o.pose.stretch,
        })
        .collect();
    let of: BTreeMap<&ObjectId, usize> = objects.iter().enumerate().map(|(k, o)| (&o.id, k)).collect();
    let own = |k: usize| {
        let (object, mut pose) = (&objects[k], carried[k]);
        if let Some(wall) = held_by(object, evidence) {
            let side = place.turn.wall(wall);
            let distance = wall.distance(&evidence.extents, object.pose.position) * place.scale;
            let at = solved.rect.side(side) - outward(side) * distance;
            let axis =
                if matches!(side, Wall::Left | Wall::Right) { &mut pose.position.x } else { &mut pose.position.z };
            *axis = at;
            // Walls of the home are straight whatever the photo's axes were off.
            pose.yaw -= place.yaw;
        }
        if object.support == Support::Ceiling {
            let below = (evidence.extents.height - object.pose.position.y) * place.scale;
            pose.position.y = place.floor + solved.height - below;
        }
        pose
    };
    (0..objects.len())
        .map(|k| {
            let mut root = k;
            for _ in 0..MAX_HOSTS {
                match &objects[root].support {
                    Support::Object { id } => match of.get(id) {
                        Some(host) => root = *host,
                        None => break,
                    },
                    _ => break,
                }
            }
            let (before, after) = (carried[root], own(root));
            let mut pose = if root == k { after } else { carried[k] };
            if root != k {
                let turned = after.yaw - before.yaw;
                pose.position = after.position + DMat3::from_rotation_y(turned) * (pose.position - before.position);
                pose.yaw += turned;
            }
            pose
        })
        .collect()
}

/// Sizes grow with the scale.
pub(crate) fn scaled(size: Size, scale: f64) -> Size {
    Size::from_vec(size.as_vec() * scale)
}

/// The photo's camera in the home: it sees the same picture.
pub fn camera(camera: &Camera, evidence: &Evidence, solved: &Solved) -> Camera {
    let rotation = camera.rotation * solved.place.rotation().transpose();
    let centre = solved.place.point(&evidence.extents, camera.centre());
    Camera { rotation, translation: -(rotation * centre), ..*camera }
}

/// A light in the home; powers of lamps grow with the square of the scale, so that surfaces are as bright as before.
pub(crate) fn light(light: &Light, evidence: &Evidence, solved: &Solved, offset: DVec3) -> Light {
    let turned = |d: [f64; 3]| (solved.place.rotation() * DVec3::from_array(d)).to_array();
    let k = solved.place.scale;
    let (kind, power) = match &light.kind {
        LightKind::Point { radius_m } => (LightKind::Point { radius_m: radius_m * k }, k * k),
        LightKind::Area { direction, size_m } => {
            (LightKind::Area { direction: turned(*direction), size_m: size_m.map(|s| s * k) }, k * k)
        }
        LightKind::Sun { direction } => (LightKind::Sun { direction: turned(*direction) }, 1.0),
    };
    let position = solved.place.point(&evidence.extents, DVec3::from_array(light.position)) + offset;
    Light { kind, position: position.to_array(), intensity: light.intensity * power, ..light.clone() }
}
