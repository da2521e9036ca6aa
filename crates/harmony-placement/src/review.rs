//! Review actions: typed, tried, measured, kept only if the evidence does not speak against them and the scene then
//! shows what was asked for.
//!
//! An action is tried on a copy of the scene (`edit`, one function each), put onto support and contact again, and
//! judged by the energy of the whole scene (`verdict`) against the odds of who asks for it. Positions, turns and
//! factors are of the room frame, in metres, degrees and ratios. An action that its support undoes has not come about,
//! and is told so (`effect`).

mod edit;
mod effect;
mod shape;
mod verdict;

use std::collections::BTreeSet;

use harmony_scene::{ObjectId, Support, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::edit::{carry, copy, edit_item, exchange, hang_elsewhere, rehost, rescale};
use self::effect::missed;
pub use self::shape::{fit_shape, reshape};
pub use self::verdict::{Verdict, energy_change, judge};
use crate::contact::collision::relax_around;
use crate::scene::subtree::subtree;
use crate::stats::median_of_ratios;
use crate::{Evidence, PartialScene, PlacementSettings, YawHint, measure};

/// Longest single move that is tried, metres.
const LONGEST_MOVE: f64 = 5.0;

/// Smallest scale factor that is tried; its inverse is the largest.
const SMALLEST_FACTOR: f64 = 0.3;

/// What a reviewer (the VLM) may ask for. Degrees and metres as it writes them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "action", rename_all = "snake_case", deny_unknown_fields)]
pub enum ReviewAction {
    /// Shift an object in the room.
    Move {
        /// The object.
        object: ObjectId,
        /// Metres along room x, y, z.
        by_m: [f64; 3],
    },
    /// Turn an object about the vertical, counter-clockwise seen from above.
    Rotate {
        /// The object.
        object: ObjectId,
        /// Degrees.
        by_deg: f64,
    },
    /// Change an object's size.
    Rescale {
        /// The object.
        object: ObjectId,
        /// Factors on its present width, height and depth.
        factor: [f64; 3],
    },
    /// Give all members of an object's matched set one size, the median of theirs.
    Equalize {
        /// One of the set.
        object: ObjectId,
    },
    /// Exchange the places of two objects: each takes the other's mask and support, and keeps its shape and size.
    Swap {
        /// One.
        object: ObjectId,
        /// The other.
        with: ObjectId,
    },
    /// Put a decoration onto another host.
    Rehost {
        /// The decoration.
        object: ObjectId,
        /// The new host.
        host: ObjectId,
    },
    /// Add a copy of an object where one is missing.
    Add {
        /// The object to copy.
        like: ObjectId,
        /// Where, room metres of the bottom centre.
        at_m: [f64; 3],
        /// Its yaw, degrees.
        yaw_deg: f64,
    },
    /// Take an object out.
    Remove {
        /// The object.
        object: ObjectId,
    },
}

/// Why an action could not even be tried.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ActionError {
    /// No such object in the scene.
    #[error("there is no object {id} in the scene")]
    Unknown {
        /// The id.
        id: ObjectId,
    },
    /// A number is not finite or out of range.
    #[error("{what} is {value}, allowed is {min} to {max}")]
    Range {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Smallest allowed.
        min: f64,
        /// Largest allowed.
        max: f64,
    },
    /// What hangs on a wall faces away from it.
    #[error("it hangs on a wall and is turned as that wall is")]
    HeldByWall,
    /// It belongs to no matched set with other members.
    #[error("{id} belongs to no matched set of which others are in the scene")]
    NoSet {
        /// The id.
        id: ObjectId,
    },
    /// One of the two carries the other, or they are held in different ways.
    #[error("{a} and {b} cannot exchange places: one carries the other, or they are of different levels")]
    NotExchangeable {
        /// One.
        a: ObjectId,
        /// The other.
        b: ObjectId,
    },
}

/// An applied action: the changed scene and the objects it touched.
#[derive(Debug, Clone)]
pub struct ReviewOutcome {
    /// The scene after the action.
    pub scene: PartialScene,
    /// Objects that changed (new ones included).
    pub touched: Vec<ObjectId>,
    /// Objects that are gone.
    pub removed: Vec<ObjectId>,
    /// Objects that are new, each with the one that it is a copy of.
    pub added: Vec<(ObjectId, ObjectId)>,
    /// What of the actions the scene does not show, in words: their supports hold objects where the actions would not.
    pub missed: Option<String>,
    /// Evidence of the touched ones after the action.
    pub evidence: Vec<Evidence>,
}

/// Tries actions together on a copy of the scene: the objects go where the actions say, one after the other, are put back onto
/// their supports and are measured there. What rests on them goes along.
///
/// # Errors
/// [`ActionError`] when an action names unknown objects or absurd numbers.
pub fn apply(
    scene: &PartialScene,
    actions: &[ReviewAction],
    settings: &PlacementSettings,
) -> Result<ReviewOutcome, ActionError> {
    let mut outcome = ReviewOutcome {
        scene: scene.clone(),
        touched: Vec::new(),
        removed: Vec::new(),
        added: Vec::new(),
        missed: None,
        evidence: Vec::new(),
    };
    for action in actions {
        step(&mut outcome, action, settings)?;
    }
    let ReviewOutcome { scene: after, touched, removed, evidence, .. } = &mut outcome;
    if settings.collision {
        // Its neighbours make room for it, and it for them.
        let mut come = vec![false; after.placed.len()];
        for i in touched.iter().filter_map(|id| after.position(id)) {
            for k in subtree(after, i) {
                come[k] = true;
            }
        }
        for (k, far) in relax_around(after, come, settings).into_iter().enumerate() {
            if far > 0.0 {
                touched.push(after.placed[k].item.id.clone());
            }
        }
    }
    let mut seen = BTreeSet::new();
    touched.retain(|id| seen.insert(id.clone()) && !removed.contains(id));
    for id in touched.iter() {
        if let Some(i) = after.position(id) {
            after.placed[i].evidence = measure(after, i, settings);
            evidence.push(after.placed[i].evidence);
        }
    }
    // In the end, when supports and neighbours have had their say.
    outcome.missed = missed(scene, &outcome.scene, actions, &outcome.added);
    Ok(outcome)
}

/// Does what one action says.
fn step(outcome: &mut ReviewOutcome, action: &ReviewAction, settings: &PlacementSettings) -> Result<(), ActionError> {
    let ReviewOutcome { scene: after, touched, removed, added, .. } = outcome;
    match action {
        ReviewAction::Move { object, by_m } => {
            let i = find(after, object)?;
            for v in by_m {
                in_range("a move", *v, -LONGEST_MOVE, LONGEST_MOVE)?;
            }
            edit_item(after, i, |item| item.traits.corrected = true);
            carry(after, i, settings, |pose| pose.position += Vec3::from_array(*by_m));
            touched.push(object.clone());
        }
        ReviewAction::Rotate { object, by_deg } => {
            let i = find(after, object)?;
            in_range("a rotation", *by_deg, -360.0, 360.0)?;
            let wanted = after.placed[i].pose.yaw + by_deg.to_radians();
            if let Support::Wall { wall } = after.placed[i].support {
                hang_elsewhere(after, i, wall, wanted, settings)?;
            } else {
                // The reviewer's answer takes the place of the one before.
                edit_item(after, i, |item| {
                    item.yaw = YawHint::About(wanted);
                    item.traits.corrected = true;
                });
                carry(after, i, settings, |pose| pose.yaw = wanted);
            }
            touched.push(object.clone());
        }
        ReviewAction::Rescale { object, factor } => {
            let i = find(after, object)?;
            for f in factor {
                in_range("a scale factor", *f, SMALLEST_FACTOR, 1.0 / SMALLEST_FACTOR)?;
            }
            rescale(after, i, Vec3::from_array(*factor), settings);
            touched.push(object.clone());
        }
        ReviewAction::Equalize { object } => {
            find(after, object)?;
            let no_set = || ActionError::NoSet { id: object.clone() };
            let members = members_of_set(after, object).filter(|members| members.len() > 1).ok_or_else(no_set)?;
            let sizes: Vec<Vec3> = members.iter().map(|k| after.placed[*k].size().as_vec()).collect();
            let of = |axis: usize| median_of_ratios(&mut sizes.iter().map(|s| s[axis]).collect::<Vec<_>>());
            let wanted = Vec3::new(of(0), of(1), of(2));
            for (k, size) in members.into_iter().zip(sizes) {
                rescale(after, k, wanted / size, settings);
                touched.push(after.placed[k].item.id.clone());
            }
        }
        ReviewAction::Swap { object, with } => {
            let (i, j) = (find(after, object)?, find(after, with)?);
            exchange(after, i, j, settings)?;
            touched.extend([object.clone(), with.clone()]);
        }
        ReviewAction::Rehost { object, host } => {
            let i = find(after, object)?;
            if after.room.ledge_named(host).is_none() {
                find(after, host)?;
            }
            rehost(after, i, host, settings);
            touched.push(object.clone());
        }
        ReviewAction::Add { like, at_m, yaw_deg } => {
            let i = find(after, like)?;
            for v in at_m {
                in_range("a position", *v, -LONGEST_MOVE, 30.0)?;
            }
            in_range("a yaw", *yaw_deg, -360.0, 360.0)?;
            let id = copy(after, i, Vec3::from_array(*at_m), yaw_deg.to_radians(), settings);
            added.push((id.clone(), like.clone()));
            touched.push(id);
        }
        ReviewAction::Remove { object } => {
            let i = find(after, object)?;
            let gone: Vec<ObjectId> = subtree(after, i).iter().map(|k| after.placed[*k].item.id.clone()).collect();
            after.placed.retain(|p| !gone.contains(&p.item.id));
            removed.extend(gone);
        }
    }
    Ok(())
}

/// The placed members of an object's matched set, itself among them; `None` when it is of no set.
fn members_of_set(scene: &PartialScene, object: &ObjectId) -> Option<Vec<usize>> {
    let set = scene.find(object)?.item.relations.matched_set.as_ref()?;
    let member = |k: &usize| scene.placed[*k].item.relations.matched_set.as_ref() == Some(set);
    Some((0..scene.placed.len()).filter(member).collect())
}

fn find(scene: &PartialScene, id: &ObjectId) -> Result<usize, ActionError> {
    scene.position(id).ok_or_else(|| ActionError::Unknown { id: id.clone() })
}

fn in_range(what: &'static str, value: f64, min: f64, max: f64) -> Result<(), ActionError> {
    if value >= min && value <= max { Ok(()) } else { Err(ActionError::Range { what, value, min, max }) }
}

#[cfg(test)]
mod tests;
