//! What rests on what.

use harmony_scene::Support;

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
