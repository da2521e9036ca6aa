//! Another shape for a placed object.

use std::sync::Arc;

use harmony_scene::{ObjectId, Support, Vec3};

use super::edit::{carry, place_anew};
use super::{ActionError, ReviewOutcome, energy_change, find};
use crate::scene::subtree::{subtree, take_along};
use crate::{PartialScene, PlacementSettings, Shape, measure};

/// Tries another shape for a placed object, whose units are metres: it takes the old one's place, turn and support.
///
/// What rests on the object is lifted or lowered with its top.
///
/// # Errors
/// [`ActionError::Unknown`].
pub fn reshape(
    scene: &PartialScene,
    object: &ObjectId,
    shape: Arc<Shape>,
    settings: &PlacementSettings,
) -> Result<ReviewOutcome, ActionError> {
    let i = find(scene, object)?;
    let mut after = scene.clone();
    let placed = &mut after.placed[i];
    let grown = shape.extent().y - placed.size().height;
    let hangs = matches!(placed.support, Support::Ceiling);
    Arc::make_mut(&mut placed.item).shape = shape;
    placed.pose.scale = 1.0;
    placed.pose.stretch = Vec3::ONE;
    if hangs {
        placed.pose.position.y -= grown;
    }
    carry(&mut after, i, settings, |_| {});
    if !hangs {
        lift(&mut after, i, grown);
    }
    Ok(changed(after, i, settings))
}

/// As [`reshape`]; beside the old place the shape is also placed anew by what is seen of the object, and what explains more
/// is taken: the old pose and size were fitted to the old shape, and a better one must not be judged by them. Where a
/// reviewer has corrected place, turn or size they were not, and stay.
///
/// # Errors
/// [`ActionError::Unknown`].
pub fn fit_shape(
    scene: &PartialScene,
    object: &ObjectId,
    shape: Arc<Shape>,
    settings: &PlacementSettings,
) -> Result<ReviewOutcome, ActionError> {
    let there = reshape(scene, object, shape, settings)?;
    let i = find(&there.scene, object)?;
    if there.scene.placed[i].item.traits.corrected {
        return Ok(there);
    }
    let mut anew = there.scene.clone();
    let (item, old) = ((*anew.placed[i].item).clone(), anew.placed[i].clone());
    place_anew(&mut anew, i, item, settings);
    let grown = anew.placed[i].size().height - old.size().height;
    let new = std::mem::replace(&mut anew.placed[i].pose, old.pose);
    take_along(&mut anew, i, new);
    lift(&mut anew, i, grown);
    let better = energy_change(&there.scene, &anew, settings) < 0.0;
    Ok(if better { changed(anew, i, settings) } else { there })
}

/// Lifts what rests on an object whose top has risen.
fn lift(scene: &mut PartialScene, object: usize, by: f64) {
    for k in subtree(scene, object).into_iter().filter(|k| *k != object) {
        scene.placed[k].pose.position.y += by;
    }
}

fn changed(mut scene: PartialScene, object: usize, settings: &PlacementSettings) -> ReviewOutcome {
    scene.placed[object].evidence = measure(&scene, object, settings);
    let placed = &scene.placed[object];
    let (touched, evidence) = (vec![placed.item.id.clone()], vec![placed.evidence]);
    ReviewOutcome { scene, touched, removed: Vec::new(), added: Vec::new(), missed: None, evidence }
}
