//! `<level>/reorder`: another placement order where things stay in one another (paper Sec. 3.3: "when a collision persists, we
//! invoke the VLM to revise the placement order").

use std::collections::BTreeSet;

use harmony_scene::{Level, ObjectId};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, fill, lines};
use crate::subjects::{PlacedObject, RoomSummary};

/// Asks for another order.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReorderQuestion {
    /// Level just placed.
    pub level: Level,
    /// Room and camera.
    #[serde(skip)]
    pub room: RoomSummary,
    /// Objects in the scene.
    #[serde(skip)]
    pub placed: Vec<PlacedObject>,
    /// The level's objects in the order in which they were placed.
    pub order: Vec<ObjectId>,
    /// What stays in what, one line each.
    pub collisions: Vec<String>,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReorderAnswer {
    /// Ids of the level in the new order; empty = the order is not the fault.
    pub placement_order: Vec<String>,
    /// Why.
    #[serde(default)]
    pub reason: String,
}

impl Ask for ReorderQuestion {
    type Answer = ReorderAnswer;

    fn prompt(&self) -> String {
        fill(
            include_str!("../templates/reorder.md"),
            &[
                ("stage", self.level.stage().to_owned()),
                ("room", self.room.to_string()),
                ("objects", lines(&self.placed)),
                ("order", self.order.iter().map(ObjectId::as_str).collect::<Vec<_>>().join(", ")),
                ("collisions", lines(&self.collisions)),
            ],
        )
    }

    fn example(&self) -> ReorderAnswer {
        let order = ["wardrobe_01", "bed_01", "nightstand_01"].map(str::to_owned).to_vec();
        ReorderAnswer { placement_order: order, reason: "the wardrobe stands in the corner, the bed beside it".into() }
    }

    fn check(&self, answer: &ReorderAnswer) -> Result<(), String> {
        let known: BTreeSet<&str> = self.order.iter().map(ObjectId::as_str).collect();
        match answer.placement_order.iter().find(|id| !known.contains(id.as_str())) {
            Some(other) => Err(format!("{other:?} is not of this level")),
            None => Ok(()),
        }
    }

    fn without_looking(&self) -> Option<ReorderAnswer> {
        Some(ReorderAnswer::default())
    }
}
