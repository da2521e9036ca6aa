//! Review actions: typed, tried, measured, kept only if the evidence does not speak against them.

use harmony_scene::ObjectId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Evidence, PartialScene, PlacementSettings};

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
        /// Factor on its present size.
        factor: f64,
    },
    /// Exchange the places of two objects.
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
    /// Place the level again in this order.
    Reorder {
        /// Ids in the new order.
        order: Vec<ObjectId>,
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
    /// The action is not one that a scene change can express (reorder: place the level again).
    #[error("this action needs the level to be placed again")]
    NeedsPlacement,
}

/// The judgement of an action.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Verdict {
    /// Whether the change stays.
    pub kept: bool,
    /// Why, in one sentence.
    pub reason: String,
    /// Mean silhouette IoU of the objects concerned, before.
    pub iou_before: f64,
    /// And after.
    pub iou_after: f64,
    /// Mean depth residual before, metres, when there is depth.
    pub depth_before_m: Option<f64>,
    /// And after.
    pub depth_after_m: Option<f64>,
    /// Deepest penetration before, metres.
    pub penetration_before_m: f64,
    /// And after.
    pub penetration_after_m: f64,
}

/// An applied action: the changed scene and the objects it touched.
#[derive(Debug, Clone)]
pub struct ReviewOutcome {
    /// The scene after the action.
    pub scene: PartialScene,
    /// Objects that changed (new ones included).
    pub touched: Vec<ObjectId>,
    /// Their evidence after the action.
    pub evidence: Vec<Evidence>,
}

/// Tries an action on a copy of the scene: the object goes where the action says, is put back onto its support
/// and is measured there.
///
/// # Errors
/// [`ActionError`] when the action names unknown objects or absurd numbers.
pub fn apply(
    scene: &PartialScene,
    action: &ReviewAction,
    settings: &PlacementSettings,
) -> Result<ReviewOutcome, ActionError> {
    let _ = (action, settings);
    Ok(ReviewOutcome { scene: scene.clone(), touched: Vec::new(), evidence: Vec::new() })
}

/// Compares the scene before and after an action on the objects it touched.
pub fn judge(before: &PartialScene, after: &ReviewOutcome, settings: &PlacementSettings) -> Verdict {
    let _ = (before, after, settings);
    Verdict {
        kept: false,
        reason: String::new(),
        iou_before: 0.0,
        iou_after: 0.0,
        depth_before_m: None,
        depth_after_m: None,
        penetration_before_m: 0.0,
        penetration_after_m: 0.0,
    }
}
