//! What is known of the scene when a level's questions are asked: what is placed, and what is only found so far.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_prompts::InspectedObject;
use harmony_scene::{Level, ObjectId};
use serde_json::{Value, json};

use crate::state::{Candidate, SceneState};
use crate::views;

/// The kept objects of a level that is inspected, but not placed yet.
#[derive(Debug, Clone)]
pub struct Known {
    /// Level.
    pub level: Level,
    /// Its objects, in order of their ids.
    pub objects: Vec<(Candidate, InspectedObject)>,
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
    /// One line an object: where it stands, or where it is seen when it is not placed yet.
    pub fn lines(&self) -> Vec<String> {
        let placed = self.state.partial.placed.iter().map(views::line);
        placed.chain(self.waiting().map(|(c, o)| self.found_line(c, o))).collect()
    }

    /// The same in machine-readable form.
    pub fn facts(&self) -> Vec<Value> {
        let placed = self.state.partial.placed.iter().map(|p| {
            json!({
                "id": p.item.id, "label": p.item.label, "level": p.item.level, "box": p.item.mask.bounds(),
                "position": p.pose.position.to_array(), "size": p.size(),
            })
        });
        let found = self.waiting().map(|(c, o)| {
            json!({
                "id": c.id, "label": o.kind, "level": c.level, "box": c.mask.bounds(), "position": null, "size": o.size_m,
            })
        });
        placed.chain(found).collect()
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
        self.state.prepared.keys().chain(self.waiting().map(|(c, _)| &c.id))
    }

    fn waiting(&self) -> impl Iterator<Item = &(Candidate, InspectedObject)> {
        self.found.iter().flat_map(|known| &known.objects)
    }

    fn found_line(&self, c: &Candidate, o: &InspectedObject) -> String {
        let size = self.state.partial.camera.size;
        let (kx, ky) = (1000.0 / f64::from(size.width), 1000.0 / f64::from(size.height));
        let b = c.detection.bounds;
        format!(
            "- {}: {}, seen at box [{:.0}, {:.0}, {:.0}, {:.0}], about {:.2} x {:.2} x {:.2} m; its place is not \
             known yet",
            c.id,
            o.kind,
            b.x0 * kx,
            b.y0 * ky,
            b.x1 * kx,
            b.y1 * ky,
            o.size_m.width,
            o.size_m.height,
            o.size_m.depth
        )
    }
}

/// `chair` of `chair_02`.
pub fn stem(id: &str) -> String {
    id.rsplit_once('_').map_or(id, |(stem, _)| stem).to_owned()
}
