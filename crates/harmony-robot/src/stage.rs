//! A motion as time samples of USD: a layer over the scene's own stage.

use harmony_export::World;
use harmony_export::animation::{AddedLink, Animation, Track};

use crate::motion::{FRAMES_PER_SECOND, Motion};
use crate::pictures::meshes;
use crate::room::Surroundings;

/// `usd/<task>.usda`, to be written beside `usd/scene.usda`: every link is an Xform of its own below `/World/robot`, and what
/// is moved has samples where the scene has it.
pub(crate) fn layer(world: &World, room: &Surroundings, motion: &Motion) -> String {
    let moved = || motion.frames.iter().map(|f| f.moved).collect();
    let name = &room.things[motion.object].id;
    let track = |item: &harmony_export::world::Item| {
        let object = item.name().to_owned();
        if item.opens.iter().any(|o| o.name == *name) {
            return Some(Track { object, part: Some(name.clone()), moved: moved() });
        }
        let thing = room.things.iter().position(|t| t.id == object)?;
        room.rides(thing, motion.object).then(|| Track { object, part: None, moved: moved() })
    };
    let model = &motion.model;
    let places: Vec<_> = motion.frames.iter().map(|f| model.places(&f.posture)).collect();
    let seen = meshes(model);
    let links = model.links.iter().enumerate().map(|(k, link)| AddedLink {
        name: link.name.clone(),
        meshes: seen[k].iter().map(|s| (s.link_from_mesh, std::sync::Arc::clone(&s.mesh), s.color)).collect(),
        places: places.iter().map(|p| p[k]).collect(),
    });
    let animation = Animation {
        title: format!("{} by {}", motion.task, model.name),
        frames_per_second: FRAMES_PER_SECOND,
        tracks: world.items.iter().filter_map(track).collect(),
        added: Some(("robot".to_owned(), links.collect())),
        ground: vec![],
    };
    animation.layer(world)
}
