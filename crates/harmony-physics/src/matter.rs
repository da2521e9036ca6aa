//! What a thing weighs, how it slides and springs, and whether it moves at all.
//! Key `physics.mass`.
//!
//! Mass comes from the scene: `material.physical.rigid` (the paper's question for simulations, asked once a room), else
//! `weight_kg` (its question for materials, or the catalogue where no model was asked). It is checked twice: against the
//! catalogue's mass over the bounding box of such a thing, and against what its solid would weigh if it were full of its
//! material. Friction is that of the same question, else the catalogue's of the material against dry wood. Restitution follows the paper's elasticity, but cloth, leather
//! and foam swallow a blow and do not give it back.

use harmony_catalogue::{Trait, box_density, kind, material};
use harmony_scene::{Level, MaterialCategory, SceneObject, Support, Vec3};
use serde::{Deserialize, Serialize};

/// Whether a thing moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// It stands by gravity and friction alone.
    Dynamic,
    /// It belongs to the room: fixed to a wall or the ceiling, built in, or lying under everything.
    Static,
}

/// A weight farther from the catalogue's than this factor is not believed.
pub const FARTHEST_MASS: f64 = 5.0;
/// A friction farther from the material's in the catalogue than this factor is not believed. By hand: what tables give for
/// one material on dry wood differs by less.
pub const FARTHEST_FRICTION: f64 = 3.0;
/// Nothing that moves is lighter, kilograms: solvers lose their footing with much less.
pub const LIGHTEST_KG: f64 = 0.02;

/// Whether an object moves.
pub fn motion(object: &SceneObject) -> Motion {
    let kind = kind(&object.label);
    let on_something = matches!(
        object.support,
        Support::Floor | Support::Object { .. } | Support::Block { .. } | Support::Niche { .. }
    );
    let hung = matches!(object.level, Level::Wall | Level::Ceiling) || !on_something;
    let of_the_room = kind.is_some_and(|k| {
        k.opening.is_some() || [Trait::Flat, Trait::Hangs, Trait::Fixed].into_iter().any(|own| k.has(own))
    });
    if hung || of_the_room { Motion::Static } else { Motion::Dynamic }
}

/// Whether what stands on it presses it flat: rugs, through which the scene has furniture stand on the floor. They touch
/// nothing: a collider of a millimetre's height is a step on which solvers rock and creep.
pub fn gives_way(object: &SceneObject) -> bool {
    kind(&object.label).is_some_and(|k| k.has(Trait::Flat))
}

/// Mass of an object in kilograms and what was changed about it. `solid_m3` is the volume of its hulls.
pub fn mass(object: &SceneObject, solid_m3: f64) -> (f64, Vec<String>) {
    let mut notes = Vec::new();
    let category = object.material.category;
    let volume = object.size.as_vec().max(Vec3::splat(1e-3)).element_product();
    let usual = (box_density(&object.label, category) * volume).max(LIGHTEST_KG);
    let full = (material(category).density_kg_m3 * solid_m3).max(LIGHTEST_KG);
    // A thing cannot weigh more than its solid, but its solid is only as good as its mesh.
    let expected = usual.min(1.5 * full).max(LIGHTEST_KG);
    let physical = &object.material.physical;
    let named = physical.rigid.map_or(physical.weight_kg, |r| r.mass_kg);
    if !(named.is_finite() && named > 0.0) {
        notes.push(format!("no usable weight in the scene: {expected:.2} kg by its kind and size"));
        return (expected, notes);
    }
    let (low, high) = (expected / FARTHEST_MASS, expected * FARTHEST_MASS);
    if named < low || named > high {
        let taken = named.clamp(low, high);
        notes.push(format!(
            "{named:.2} kg is not believed of a {}, {expected:.2} kg is usual at this size: {taken:.2} kg is taken",
            object.label
        ));
        return (taken.max(LIGHTEST_KG), notes);
    }
    (named.max(LIGHTEST_KG), notes)
}

/// Coefficient of friction against dry wood, and what was changed about it.
pub fn friction(object: &SceneObject) -> (f64, Option<String>) {
    let category = object.material.category;
    let usual = material(category).friction;
    let Some(named) = object.material.physical.rigid.map(|r| r.friction) else { return (usual, None) };
    let (low, high) = (usual / FARTHEST_FRICTION, usual * FARTHEST_FRICTION);
    if (low..=high).contains(&named) {
        return (named, None);
    }
    let taken = if named.is_finite() { named.clamp(low, high) } else { usual };
    let note =
        format!("a friction of {named:.2} is not believed of {category:?}, {usual:.2} is usual: {taken:.2} is taken");
    (taken, Some(note))
}

/// Coefficient of restitution, 0 to 1.
pub fn restitution(object: &SceneObject) -> f64 {
    let elasticity = object.material.physical.elasticity;
    match object.material.category {
        MaterialCategory::Fabric | MaterialCategory::Leather | MaterialCategory::Foam => 0.0,
        _ if elasticity.is_finite() => elasticity.clamp(0.0, 0.5),
        _ => 0.0,
    }
}

/// Share of the mass in the lowest fifth of the height, for kinds with a heavy foot.
pub fn heavy_foot(object: &SceneObject) -> Option<f64> {
    kind(&object.label)?.heavy_foot
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::object;

    #[test]
    fn what_hangs_or_is_built_in_stays_and_the_rest_moves() {
        let of = |label: &str, level, support| motion(&object("x_01", label, level, support));
        assert_eq!(of("oak chair", Level::Furniture, Support::Floor), Motion::Dynamic);
        assert_eq!(of("persian rug", Level::Furniture, Support::Floor), Motion::Static);
        assert_eq!(of("bathtub", Level::Furniture, Support::Floor), Motion::Static);
        assert_eq!(of("pendant lamp", Level::Ceiling, Support::Ceiling), Motion::Static);
        assert_eq!(of("curtain", Level::Wall, Support::Floor), Motion::Static);
        let id = harmony_scene::ObjectId::new("desk_01").unwrap();
        assert_eq!(of("vase", Level::Decoration, Support::Object { id }), Motion::Dynamic);
        assert_eq!(of("vase", Level::Decoration, Support::Block { block: 0 }), Motion::Dynamic);
    }

    #[test]
    fn weights_are_believed_within_reason() {
        let mut chair = object("chair_01", "chair", Level::Furniture, Support::Floor);
        let sound = 5.0;
        chair.material.physical.weight_kg = sound;
        let (kg, notes) = mass(&chair, 0.02);
        assert!(kg == sound && notes.is_empty(), "{kg} {notes:?}");
        for bad in [500.0, 0.001, f64::NAN, -3.0] {
            chair.material.physical.weight_kg = bad;
            let (kg, notes) = mass(&chair, 0.02);
            assert!((0.5..=60.0).contains(&kg) && notes.len() == 1, "{bad}: {kg} {notes:?}");
        }
        // A thing of little solid cannot be heavy, whatever its box.
        chair.material.physical.weight_kg = f64::NAN;
        let (kg, _) = mass(&chair, 1e-4);
        assert!(kg < 0.2, "{kg}");
    }

    #[test]
    fn cloth_does_not_bounce() {
        let mut thing = object("thing_01", "cushion", Level::Decoration, Support::Floor);
        thing.material.category = MaterialCategory::Fabric;
        thing.material.physical.elasticity = 0.5;
        assert_eq!(restitution(&thing), 0.0);
        thing.material.category = MaterialCategory::Plastic;
        assert!((restitution(&thing) - 0.5).abs() < 1e-12);
        assert!((0.1..1.0).contains(&friction(&thing).0));
    }

    #[test]
    fn what_was_answered_for_simulations_comes_before_the_materials_weight() {
        let mut chair = object("chair_01", "chair", Level::Furniture, Support::Floor);
        chair.material.category = MaterialCategory::Wood;
        chair.material.physical.weight_kg = 4.0;
        let usual = friction(&chair).0;
        let mut of = |mass_kg, slip| {
            chair.material.physical.rigid = Some(harmony_scene::RigidEstimate { mass_kg, friction: slip });
            (mass(&chair, 0.02), friction(&chair))
        };
        assert_eq!(of(6.0, 1.2 * usual), ((6.0, vec![]), (1.2 * usual, None)));
        let ((kg, mass_notes), (slip, note)) = of(600.0, 9.0);
        assert!(kg < 60.0 && mass_notes.len() == 1 && note.is_some(), "{kg} {mass_notes:?} {note:?}");
        assert!((slip - 3.0 * usual).abs() < 1e-12, "{slip}");
    }
}
