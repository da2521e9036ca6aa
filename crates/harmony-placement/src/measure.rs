//! Measuring what is placed: agreement, contact, and the posterior's uncertainty.
//!
//! Evidence belongs to a scene: an object's silhouette depends on what stands before it, its gap on its host, its
//! spread on everything. So all objects are measured again whenever the scene has changed, those of earlier levels too.
//! Energies are in nats by the objective of what was *said* (`terms::told_objective`), whatever hypothesis the solve
//! took; gaps and penetrations in metres. Spreads come with [`measure_posterior`] alone, for they need the information
//! matrix of the whole scene.

use rayon::prelude::*;

use crate::contact::collision;
use crate::contact::solid::Solid;
use crate::observe::Window;
use crate::scene::Evidence;
use crate::scene::attachment::{Attachment, PoseConstraint};
use crate::solve::joint::spreads;
use crate::terms::{evidence_of, size_log_ratio, told_objective};
use crate::{PartialScene, PlacementSettings};

/// Measures a placed object (an index into [`PartialScene::placed`]) in the scene as it is. Its spread and the probability of
/// its hypothesis stay what they were.
///
/// # Panics
/// When there is no such object.
pub fn measure(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Evidence {
    measure_among(scene, &collision::solids(scene), object, settings)
}

fn measure_among(scene: &PartialScene, all: &[Solid], object: usize, settings: &PlacementSettings) -> Evidence {
    let placed = &scene.placed[object];
    let constraint = PoseConstraint::as_placed(scene, object, &settings.noise);
    let seen = Window::new(scene, &placed.item, Some(object), &[], settings)
        .map(|window| evidence_of(&told_objective(scene, object, &window, settings), &placed.pose));
    Evidence {
        contact_gap_m: contact_gap(&constraint, object),
        penetration_m: collision::deepest(scene, all, object, settings),
        spread: placed.evidence.spread,
        hypothesis: placed.evidence.hypothesis,
        size_log_ratio: size_log_ratio(&placed.item, &placed.pose),
        ..seen.unwrap_or_default()
    }
}

/// Gap between a placed object and what carries it, metres.
fn contact_gap(constraint: &PoseConstraint, object: usize) -> f64 {
    let scene = constraint.scene;
    let placed = &scene.placed[object];
    let at = placed.pose.position;
    match constraint.attachment {
        Attachment::Floor | Attachment::AgainstWall(_) => at.y,
        Attachment::OnHost { .. } | Attachment::OnLedge(_) => at.y - constraint.settle(&placed.pose).position.y,
        // The thick part of a window is in the wall: where it should be is not where its back touches.
        Attachment::OnWall(wall) => {
            let away = |at| wall.distance(&scene.room.extents, at);
            away(at) - away(constraint.settle(&placed.pose).position)
        }
        Attachment::Ceiling => scene.room.ceiling_over(at) - at.y - placed.size().height,
    }
}

/// Measures all objects again: those of earlier levels move too, by the joint solve and by what came beside them.
pub(crate) fn measure_all(scene: &mut PartialScene, settings: &PlacementSettings) {
    let still: &PartialScene = scene;
    let solids = collision::solids(still);
    let measured: Vec<Evidence> =
        (0..still.placed.len()).into_par_iter().map(|i| measure_among(still, &solids, i, settings)).collect();
    for (placed, evidence) in scene.placed.iter_mut().zip(measured) {
        placed.evidence = evidence;
    }
}

/// [`measure_all`], and how uncertain each pose is.
pub(crate) fn measure_posterior(scene: &mut PartialScene, settings: &PlacementSettings) {
    measure_all(scene, settings);
    let spreads = spreads(scene, settings);
    for (placed, spread) in scene.placed.iter_mut().zip(spreads) {
        placed.evidence.spread = spread;
    }
}
