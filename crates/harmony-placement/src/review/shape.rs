//! Another shape for a placed object.
//!
//! Its units are metres, so that it takes the old one's place, turn and support as they are; beside that it is placed
//! anew by what is seen of the object, because pose and size were fitted to the old shape, and what costs less stays.
//! What rests on the object follows its top, and may lie on another of its surfaces where it agrees better there.

use std::sync::Arc;

use harmony_scene::{ObjectId, Pose, Support, Vec3};

use super::edit::{carry, place_anew};
use super::{ActionError, ReviewOutcome, energy_change, find};
use crate::accept::accepts;
use crate::scene::attachment::sag_of;
use crate::scene::subtree::{subtree, take_along};
use crate::scene::support::layers;
use crate::terms::placed_energy;
use crate::{PartialScene, Placed, PlacementSettings, Shape, measure};

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
    find_tops(&mut after, i, settings);
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
    find_tops(&mut anew, i, settings);
    let better = energy_change(&there.scene, &anew, settings) < 0.0;
    Ok(if better { changed(anew, i, settings) } else { there })
}

/// Lifts what rests on an object whose top has risen.
fn lift(scene: &mut PartialScene, object: usize, by: f64) {
    for k in subtree(scene, object).into_iter().filter(|k| *k != object) {
        scene.placed[k].pose.position.y += by;
    }
}

/// Puts what stands on an object onto another of its surfaces, straight up or down, where it agrees better there: the top of a
/// chest need not have risen with the mirror on it.
fn find_tops(scene: &mut PartialScene, object: usize, settings: &PlacementSettings) {
    let host = scene.placed[object].item.id.clone();
    let stands = |p: &Placed| matches!(&p.support, Support::Object { id } if *id == host);
    for k in (0..scene.placed.len()).filter(|k| *k != object && stands(&scene.placed[*k])).collect::<Vec<_>>() {
        let energy = |scene: &PartialScene| placed_energy(scene, k, settings).map(|e| e.total());
        let Some(mut least) = energy(scene) else { continue };
        let (pose, sag) = (scene.placed[k].pose, sag_of(&scene.placed[k].item, &scene.placed[k].pose));
        for layer in layers(&scene.placed[object], scene.placed[k].size().height) {
            let mut tried = scene.clone();
            take_along(&mut tried, k, Pose { position: pose.position.with_y(layer.height - sag), ..pose });
            if let Some(found) = energy(&tried).filter(|found| accepts(least, *found, 0.0)) {
                (least, *scene) = (found, tried);
            }
        }
    }
}

fn changed(mut scene: PartialScene, object: usize, settings: &PlacementSettings) -> ReviewOutcome {
    scene.placed[object].evidence = measure(&scene, object, settings);
    let placed = &scene.placed[object];
    let (touched, evidence) = (vec![placed.item.id.clone()], vec![placed.evidence]);
    ReviewOutcome { scene, touched, removed: Vec::new(), added: Vec::new(), missed: None, evidence }
}
