//! `<level>/reorder`: another placement order where things stay in one another (paper Sec. 3.3: "when a collision persists, we
//! invoke the VLM to revise the placement order"), and other hosts or sizes where those are the fault.

use std::collections::BTreeSet;

use harmony_scene::{Level, ObjectId};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::inspect::InspectedSize;
use crate::question::{Ask, fill, in_range, lines, mostly_sound};
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
    /// Objects of the level that something else carries than was taken.
    #[serde(default)]
    pub hosts: Vec<ReorderHost>,
    /// Objects of the level of which the size is wrong.
    #[serde(default)]
    pub sizes: Vec<ReorderSize>,
    /// Why.
    #[serde(default)]
    pub reason: String,
}

/// Another host.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReorderHost {
    /// The object, of this level.
    pub id: String,
    /// What it stands or lies on; null: on nothing but the room.
    pub on_top_of: Option<String>,
}

/// Another size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReorderSize {
    /// The object, of this level.
    pub id: String,
    /// Width (side to side seen from its own front), height and depth, complete, metres.
    pub size_m: InspectedSize,
}

impl ReorderAnswer {
    /// Whether it changes nothing.
    pub fn is_empty(&self) -> bool {
        self.placement_order.is_empty() && self.hosts.is_empty() && self.sizes.is_empty()
    }
}

impl ReorderQuestion {
    /// What is wrong with another host: the object is not of this level, or what shall carry it is not there.
    pub fn host_complaint(&self, host: &ReorderHost) -> Option<String> {
        let there = |id: &str| self.placed.iter().any(|p| p.id.as_str() == id && id != host.id);
        match &host.on_top_of {
            _ if !self.is_of_level(&host.id) => Some(format!("{:?} is not of this level", host.id)),
            Some(on) if !there(on) => Some(format!("{on:?} cannot carry {}", host.id)),
            _ => None,
        }
    }

    /// What is wrong with another size: the object is not of this level, or a side is none.
    pub fn size_complaint(&self, size: &ReorderSize) -> Option<String> {
        if !self.is_of_level(&size.id) {
            return Some(format!("{:?} is not of this level", size.id));
        }
        let InspectedSize { width, height, depth } = size.size_m;
        let side = |v: f64| in_range(&format!("a side of {}", size.id), v, 0.001, 12.0).err();
        [width, height, depth].into_iter().find_map(side)
    }

    fn is_of_level(&self, id: &str) -> bool {
        self.order.iter().any(|o| o.as_str() == id)
    }
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
        ReorderAnswer {
            placement_order: order,
            hosts: vec![ReorderHost { id: "cushion_01".into(), on_top_of: Some("bed_01".into()) }],
            sizes: vec![ReorderSize {
                id: "nightstand_01".into(),
                size_m: InspectedSize { width: 0.42, height: 0.5, depth: 0.38 },
            }],
            reason: "the wardrobe stands in the corner, the bed beside it; the nightstand was taken for a wide one"
                .into(),
        }
    }

    fn check(&self, answer: &ReorderAnswer) -> Result<(), String> {
        let known: BTreeSet<&str> = self.order.iter().map(ObjectId::as_str).collect();
        if let Some(other) = answer.placement_order.iter().find(|id| !known.contains(id.as_str())) {
            return Err(format!("{other:?} is not of this level"));
        }
        let hosts = answer.hosts.iter().filter_map(|host| self.host_complaint(host));
        let complaints: Vec<String> =
            hosts.chain(answer.sizes.iter().filter_map(|size| self.size_complaint(size))).collect();
        mostly_sound(&complaints, answer.hosts.len() + answer.sizes.len())
    }

    fn without_looking(&self) -> Option<ReorderAnswer> {
        Some(ReorderAnswer::default())
    }
}
