//! The support subtree: what rests on what.
//!
//! Supports name the carrier, so that they form a tree with room faces as roots; it is walked from an object downwards.
//! What moves takes its subtree along, shifted and turned but not resized. Relations may be circular while they are
//! edited, so that walks are bounded in depth.

use harmony_scene::{Mat3, Pose, Support};

use crate::PartialScene;

/// Hosts that are followed downwards, at most: relations may go in a circle.
const MAX_LEVELS: usize = 8;

/// Whether an object rests on another, directly or through others.
pub(crate) fn rests_on(scene: &PartialScene, object: usize, by: usize) -> bool {
    let mut at = object;
    for _ in 0..MAX_LEVELS {
        let Support::Object { id } = &scene.placed[at].support else { return false };
        match scene.position(id) {
            Some(host) if host == by => return true,
            Some(host) if host != at => at = host,
            _ => return false,
        }
    }
    false
}

/// An object and everything that rests on it.
pub(crate) fn subtree(scene: &PartialScene, object: usize) -> Vec<usize> {
    (0..scene.placed.len()).filter(|i| *i == object || rests_on(scene, *i, object)).collect()
}

/// Gives an object another pose, and takes along what rests on it.
pub(crate) fn take_along(scene: &mut PartialScene, object: usize, new: Pose) {
    let old = scene.placed[object].pose;
    let (turn, by) = (new.yaw - old.yaw, new.position - old.position);
    for i in subtree(scene, object) {
        let pose = &mut scene.placed[i].pose;
        if i == object {
            *pose = new;
        } else {
            let arm = pose.position - old.position;
            pose.position = old.position + by + Mat3::from_rotation_y(turn) * arm;
            pose.yaw += turn;
        }
    }
}
