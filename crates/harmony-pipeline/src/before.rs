//! What is known of the scene when a level's questions are asked: what is placed, and what is only found so far.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_prompts::{FoundObject, KnownObject};
use harmony_scene::{Level, ObjectId};

use crate::filter::one_kind;
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
        let objects = self.state.partial.placed.iter().map(views::placed_object);
        let placed = objects.chain(views::ledges(&self.state)).map(KnownObject::Placed);
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

    /// The object of an earlier level that a candidate is: it is of the same kind, and their masks agree from an IoU on.
    ///
    /// A thing is often listed on two levels (a plant as furniture and as decoration), and its second mesh would stand in
    /// the first one.
    pub fn same_as(&self, candidate: &Object, iou: f64) -> Option<&ObjectId> {
        let placed = self.state.partial.placed.iter().map(|p| (&p.item.id, p.item.label.as_str(), &p.item.mask));
        let known = placed.chain(self.waiting().map(|o| (&o.id, o.said.kind.as_str(), &o.mask)));
        let mut of_kind = known.filter(|(_, label, _)| one_kind(label, &candidate.detection.label));
        of_kind.find(|(_, _, mask)| mask.iou(&candidate.mask) >= iou).map(|(id, ..)| id)
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

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_roles::Detection;
    use harmony_scene::Support;

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn what_an_earlier_level_has_is_known_by_kind_and_pixels_whether_it_is_placed_or_not() {
        let mut state = empty_room();
        let size = DVec3::new(0.4, 0.8, 0.4);
        let plant = add(&mut state, "plant_01", Level::Furniture, size, DVec3::new(2.0, 0.0, 1.5), Support::Floor);
        let first = state.objects[&plant].clone();
        let candidate = |label: &str, shrunk: i32| {
            let detection = Detection { label: label.to_owned(), ..first.detection.clone() };
            let id = ObjectId::numbered(label, 2);
            Object::found(id, Level::Decoration, detection, first.mask.dilated(-shrunk))
        };
        let mut bare = state.clone();
        bare.partial.placed.clear();
        let waiting = Arc::new(Known { level: Level::Furniture, objects: vec![first.clone()] });
        let before = |state: &SceneState, found| Before { state: Arc::new(state.clone()), found };
        for before in [before(&state, Vec::new()), before(&bare, vec![waiting])] {
            assert_eq!(before.same_as(&candidate("potted plant", 1), 0.7), Some(&plant));
            assert_eq!(before.same_as(&candidate("vase", 1), 0.7), None, "another kind");
            assert_eq!(before.same_as(&candidate("potted plant", 8), 0.7), None, "a part of it");
        }
        assert_eq!(before(&bare, Vec::new()).same_as(&candidate("potted plant", 1), 0.7), None);
    }
}
