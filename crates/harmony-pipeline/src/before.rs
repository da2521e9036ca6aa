//! What is known of the scene when a level's questions are asked: what is placed, and what is only found so far.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_prompts::{FoundObject, KnownObject};
use harmony_scene::{Level, ObjectId};

use crate::state::{Object, SceneState};
use crate::views;

/// The kept objects of a level that is inspected, but not placed yet.
#[derive(Debug, Clone)]
pub struct Known {
    /// Level.
    pub level: Level,
    /// Its objects, in order of their ids.
    pub objects: Vec<Object>,
}

/// What a level's questions can tell about the levels before it.
#[derive(Debug, Clone)]
pub struct Before {
    /// The scene as placed so far.
    pub state: Arc<SceneState>,
    /// Earlier levels that are not in it yet, in order.
    pub found: Vec<Arc<Known>>,
}

impl Before {
    /// The objects: where they stand, or where they are seen when they are not placed yet.
    pub fn objects(&self) -> Vec<KnownObject> {
        let placed = self.state.partial.placed.iter().map(|p| KnownObject::Placed(views::placed_object(p)));
        placed.chain(self.waiting().map(|o| KnownObject::Found(self.found(o)))).collect()
    }

    /// How many objects of each kind of id there are: `chair` -> 4.
    pub fn counts(&self) -> BTreeMap<String, usize> {
        let mut counts = BTreeMap::new();
        for id in self.ids() {
            *counts.entry(stem(id.as_str())).or_default() += 1;
        }
        counts
    }

    /// Ids that are taken.
    pub fn ids(&self) -> impl Iterator<Item = &ObjectId> {
        self.state.objects.keys().chain(self.waiting().map(|o| &o.id))
    }

    fn waiting(&self) -> impl Iterator<Item = &Object> {
        self.found.iter().flat_map(|known| &known.objects)
    }

    fn found(&self, o: &Object) -> FoundObject {
        FoundObject {
            id: o.id.clone(),
            label: o.said.kind.clone(),
            level: o.level,
            seen: o.mask.bounds(),
            bounds: o.detection.bounds,
            image: self.state.partial.camera.size,
            size: o.size(),
        }
    }
}

/// `chair` of `chair_02`.
pub fn stem(id: &str) -> String {
    id.rsplit_once('_').map_or(id, |(stem, _)| stem).to_owned()
}
