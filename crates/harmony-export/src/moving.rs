//! What moves within or with an object: parts that open, lights of lamps.
//!
//! An object's mass is shared out by surface; what remains with the body keeps its centre and, in proportion, its inertia.
//! A part collides as the box of its panel; its object's hulls, which hold the panel too, do not collide with it.

use glam::DVec3;
use harmony_physics::{Bodies, Body, Hull, Motion};
use harmony_scene::Light;

use crate::World;
use crate::world::{Item, Opens};

/// A part is no lighter, kilograms.
const LIGHTEST_KG: f64 = 0.05;
/// Share of an object's mass that its parts have at most, together.
const MOST: f64 = 0.6;
/// A panel collides as a board of this thickness at least, metres.
const THINNEST_M: f64 = 0.004;

/// A moving part as a body.
#[derive(Debug, Clone)]
pub(crate) struct PartBody<'a> {
    /// The part.
    pub part: &'a Opens,
    /// Its place among the object's.
    pub number: usize,
    /// Kilograms.
    pub mass_kg: f64,
    /// Centre of mass, body frame.
    pub centre: DVec3,
    /// Principal moments about it, axes of the body frame.
    pub inertia: DVec3,
    /// Its collider.
    pub hull: Hull,
}

/// The parts of an object, and the share of its mass that stays with the body.
pub(crate) fn parts<'a>(item: &'a Item, body: &Body) -> (Vec<PartBody<'a>>, f64) {
    let all: f64 = item.opens.iter().map(|o| o.share).sum();
    let down = (MOST / all.max(1e-9)).min(1.0);
    let parts: Vec<PartBody<'a>> = item
        .opens
        .iter()
        .enumerate()
        .map(|(number, part)| {
            let size = (part.high - part.low).max(DVec3::splat(THINNEST_M));
            let centre = (part.low + part.high) / 2.0;
            let mass_kg = (body.mass_kg * part.share * down).max(LIGHTEST_KG.min(0.1 * body.mass_kg));
            let squares = size * size;
            let inertia =
                DVec3::new(squares.y + squares.z, squares.x + squares.z, squares.x + squares.y) * (mass_kg / 12.0);
            PartBody {
                part,
                number,
                mass_kg,
                centre,
                inertia,
                hull: Hull::cuboid(centre - size / 2.0, centre + size / 2.0),
            }
        })
        .collect();
    let moved: f64 = parts.iter().map(|p| p.mass_kg).sum();
    let rest = (1.0 - moved / body.mass_kg.max(1e-9)).max(0.1);
    (parts, rest)
}

/// Lights that an object takes along where it goes.
pub(crate) fn lights<'a>(world: &'a World, item: &'a Item, body: &Body) -> impl Iterator<Item = &'a Light> {
    let moves = body.motion == Motion::Dynamic;
    let its = move |light: &&Light| light.object.as_ref().is_some_and(|o| o.as_str() == item.name());
    world.scene.lighting.lights.iter().filter(move |_| moves).filter(its)
}

/// Lights that nothing takes along.
pub(crate) fn still_lights<'a>(world: &'a World, bodies: &Bodies) -> Vec<&'a Light> {
    let taken: Vec<&Light> =
        world.items.iter().zip(&bodies.objects).flat_map(|(item, body)| lights(world, item, body)).collect();
    world.scene.lighting.lights.iter().filter(|l| !taken.iter().any(|t| std::ptr::eq(*t, *l))).collect()
}
