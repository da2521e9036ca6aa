//! Does the scene stand? Five seconds of gravity, and what they do to each object.
//! Key `physics.settle`.
//!
//! Before: how deep objects are in each other and in the room, and how far each is above what it could stand on. Then the
//! simulation ([`crate::world`]). After: how far each has drifted (the origin of its frame) and tilted, and what it touches.
//! Stable is what drifted at most [`STABLE_M`] and tilted at most [`STABLE_DEG`].

use harmony_scene::{Scene, Support};
use serde::{Deserialize, Serialize};

use crate::bodies::Bodies;
use crate::matter::Motion;
use crate::touch::{Solid, TOUCH_M};
use crate::world::{Placed, STEP, Touched, World};

/// How long the scene is left alone, seconds.
pub const SETTLE_SECONDS: f64 = 5.0;
/// Largest drift of what is stable, metres.
pub const STABLE_M: f64 = 0.01;
/// Largest tilt of what is stable, degrees.
pub const STABLE_DEG: f64 = 2.0;
/// Faster than this nothing moves by falling from a table: it was thrown, m/s.
const EXPLODED_SPEED: f64 = 6.0;
/// Farther than this out of the room is gone, metres.
const GONE_M: f64 = 0.5;
/// Penetrations below this are what solvers allow themselves, metres.
const NO_PENETRATION_M: f64 = 1e-3;

/// Two things in each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Penetration {
    /// An object.
    pub object: String,
    /// Another object, or a face of the room.
    pub other: String,
    /// How deep, metres.
    pub depth_m: f64,
}

/// What five seconds did to an object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SettledObject {
    /// Which.
    pub id: String,
    /// Whether it moves at all.
    pub motion: Motion,
    /// Mass, kilograms.
    pub mass_kg: f64,
    /// Colliders against the mesh at the 95th percentile, metres.
    pub fit_m: f64,
    /// Convex colliders.
    pub hulls: usize,
    /// Deepest penetration before, metres.
    pub penetration_m: f64,
    /// Height above the nearest thing below it before, metres; `None` when nothing is below.
    pub gap_m: Option<f64>,
    /// Drift of its origin, metres.
    pub drift_m: f64,
    /// Tilt of its up axis, degrees.
    pub tilt_deg: f64,
    /// Fastest it ever was, m/s.
    pub fastest_m_s: f64,
    /// Whether it was thrown or left the room.
    pub exploded: bool,
    /// At most 1 cm of drift and 2 degrees of tilt.
    pub stable: bool,
    /// What the scene says it rests on.
    pub support: String,
    /// What it touches after settling.
    pub touches: Vec<String>,
    /// Whether it touches what it should rest on.
    pub support_right: bool,
    /// Where it is after settling.
    pub settled: Placed,
}

/// The whole scene after settling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Settled {
    /// Simulated time, seconds.
    pub seconds: f64,
    /// In the scene's order.
    pub objects: Vec<SettledObject>,
    /// Pairs deeper than a millimetre before, the deepest first.
    pub penetrations: Vec<Penetration>,
}

impl Settled {
    /// Objects that move.
    pub fn dynamic(&self) -> impl Iterator<Item = &SettledObject> {
        self.objects.iter().filter(|o| o.motion == Motion::Dynamic)
    }

    /// How many of the objects that move are stable, and how many there are.
    pub fn stable(&self) -> (usize, usize) {
        (self.dynamic().filter(|o| o.stable).count(), self.dynamic().count())
    }
}

/// Where the scene has its objects.
pub fn places(scene: &Scene) -> Vec<Placed> {
    scene.objects.iter().map(|o| Placed::of(&o.pose)).collect()
}

/// Lets the scene settle from these places (see [`places`]) for [`SETTLE_SECONDS`].
pub fn settle(scene: &Scene, bodies: &Bodies, places: &[Placed]) -> Settled {
    let solids: Vec<Solid> = bodies.objects.iter().zip(places).map(|(b, p)| Solid::placed(&b.hulls, p)).collect();
    let shell: Vec<Solid> = bodies.shell.iter().map(|(_, hulls)| Solid::fixed(hulls)).collect();
    let penetrations = penetrations(bodies, &solids, &shell);
    let mut world = World::new(bodies, places, false);
    let steps = (SETTLE_SECONDS / STEP).round() as usize;
    let mut fastest = vec![0.0_f64; places.len()];
    for _ in 0..steps {
        world.step(None);
        for (k, f) in fastest.iter_mut().enumerate() {
            *f = f.max(world.speed(k));
        }
    }
    let contacts = world.contacts(TOUCH_M as f32);
    let size = scene.room.extents.as_vec();
    let objects = bodies
        .objects
        .iter()
        .enumerate()
        .map(|(k, body)| {
            let settled = world.place(k);
            let drift_m = settled.position.distance(places[k].position);
            let tilt_deg = settled.tilt().to_degrees();
            let out = (-settled.position).max(settled.position - size).max_element();
            let finite = settled.position.is_finite() && tilt_deg.is_finite();
            let moves = body.motion == Motion::Dynamic;
            let exploded = moves && (!finite || fastest[k] > EXPLODED_SPEED || out > GONE_M);
            let touched = |t: Touched| match t {
                Touched::Object(i) => bodies.objects[i].id.clone(),
                Touched::Face(i) => bodies.shell[i].0.clone(),
            };
            let me = Touched::Object(k);
            let touches: Vec<String> = if moves {
                contacts
                    .iter()
                    .filter_map(|(a, b)| {
                        if *a == me {
                            Some(*b)
                        } else if *b == me {
                            Some(*a)
                        } else {
                            None
                        }
                    })
                    .map(touched)
                    .collect()
            } else {
                Vec::new()
            };
            let support = support_name(carrier(scene, bodies, &scene.objects[k].support));
            SettledObject {
                id: body.id.clone(),
                motion: body.motion,
                mass_kg: body.mass_kg,
                fit_m: body.fit_m,
                hulls: body.hulls.len(),
                penetration_m: penetrations
                    .iter()
                    .filter(|p| p.object == body.id || p.other == body.id)
                    .map(|p| p.depth_m)
                    .fold(0.0, f64::max),
                gap_m: gap(k, &solids, &shell),
                drift_m,
                tilt_deg,
                fastest_m_s: fastest[k],
                exploded,
                stable: finite && !exploded && drift_m <= STABLE_M && tilt_deg <= STABLE_DEG,
                support_right: !moves || touches.contains(&support),
                support,
                touches,
                settled,
            }
        })
        .collect();
    Settled { seconds: SETTLE_SECONDS, objects, penetrations }
}

/// What carries an object in the end: through what gives way, to what that rests on.
fn carrier<'a>(scene: &'a Scene, bodies: &Bodies, mut support: &'a Support) -> &'a Support {
    for _ in 0..scene.objects.len() {
        let Support::Object { id } = support else { break };
        let below = scene.objects.iter().zip(&bodies.objects).find(|(o, _)| o.id == *id);
        let Some((object, _)) = below.filter(|(_, body)| body.hulls.is_empty()) else { break };
        support = &object.support;
    }
    support
}

/// Name of what carries an object: an object, or a face of the room.
pub(crate) fn support_name(support: &Support) -> String {
    match support {
        Support::Floor => "floor".to_owned(),
        Support::Ceiling => "ceiling".to_owned(),
        Support::Wall { wall } => harmony_mesh::shell_material_name(wall.surface()).to_owned(),
        Support::Object { id } => id.to_string(),
        Support::Block { block } => harmony_scene::Ledge::Block(*block).id().to_string(),
        Support::Niche { niche } => harmony_scene::Ledge::Niche(*niche).id().to_string(),
    }
}

/// Every pair of an object that moves and something else, deeper than a millimetre.
pub(crate) fn penetrations(bodies: &Bodies, solids: &[Solid], shell: &[Solid]) -> Vec<Penetration> {
    let mut out = Vec::new();
    for i in 0..solids.len() {
        let moves = |k: usize| bodies.objects[k].motion == Motion::Dynamic;
        for j in i + 1..solids.len() {
            if (moves(i) || moves(j))
                && let Some(d) = solids[i].depth(&solids[j]).filter(|d| d.depth > NO_PENETRATION_M)
            {
                let name = |k: usize| bodies.objects[k].id.clone();
                out.push(Penetration { object: name(i), other: name(j), depth_m: d.depth });
            }
        }
        for (face, (name, _)) in shell.iter().zip(&bodies.shell).filter(|_| moves(i)) {
            if let Some(d) = solids[i].depth(face).filter(|d| d.depth > NO_PENETRATION_M) {
                out.push(Penetration { object: bodies.objects[i].id.clone(), other: name.clone(), depth_m: d.depth });
            }
        }
    }
    out.sort_by(|a, b| b.depth_m.total_cmp(&a.depth_m));
    out
}

/// How far an object is above the nearest thing below it.
pub(crate) fn gap(object: usize, solids: &[Solid], shell: &[Solid]) -> Option<f64> {
    let others = solids.iter().enumerate().filter(|(k, _)| *k != object).map(|(_, s)| s).chain(shell);
    others.filter_map(|other| solids[object].fall(other)).min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use harmony_mesh::Mesh;
    use harmony_scene::{ObjectId, SceneObject, Vec3};

    use super::*;
    use crate::bodies::{BodySettings, bodies};
    use crate::testing::{cuboid, scene};

    fn settled(things: Vec<(SceneObject, Arc<Mesh>)>) -> Settled {
        let meshes: BTreeMap<ObjectId, Arc<Mesh>> = things.iter().map(|(o, m)| (o.id.clone(), Arc::clone(m))).collect();
        let scene = scene(things.into_iter().map(|(o, _)| o).collect());
        let bodies = bodies(&scene, &meshes, &BodySettings::default()).unwrap();
        settle(&scene, &bodies, &places(&scene))
    }

    #[test]
    fn a_box_on_the_floor_stays_and_what_stands_on_it_too() {
        let id = ObjectId::new("table_01").unwrap();
        let found = settled(vec![
            cuboid("table_01", "table", Vec3::new(1.0, 0.7, 0.6), Vec3::new(2.0, 0.0, 2.0), Support::Floor),
            cuboid("vase_01", "box", Vec3::new(0.1, 0.3, 0.1), Vec3::new(2.2, 0.7, 2.1), Support::Object { id }),
        ]);
        for o in &found.objects {
            assert!(o.stable && o.support_right && !o.exploded, "{o:?}");
            assert!(o.drift_m < 0.001 && o.tilt_deg < 0.1 && o.penetration_m == 0.0, "{o:?}");
            assert!(o.gap_m.unwrap() < 1e-3);
        }
        assert_eq!(found.stable(), (2, 2));
        assert_eq!(found.objects[1].touches, ["table_01"]);
    }

    #[test]
    fn what_leans_over_the_edge_falls_and_what_floats_drops() {
        let id = ObjectId::new("table_01").unwrap();
        let on = || Support::Object { id: id.clone() };
        let found = settled(vec![
            cuboid("table_01", "table", Vec3::new(1.0, 0.7, 0.6), Vec3::new(2.0, 0.0, 2.0), Support::Floor),
            // Its middle is 6 cm beyond the edge at x = 2.5.
            cuboid("box_01", "box", Vec3::new(0.3, 0.1, 0.1), Vec3::new(2.56, 0.7, 2.0), on()),
            cuboid("box_02", "box", Vec3::new(0.1, 0.1, 0.1), Vec3::new(1.8, 0.75, 2.0), on()),
        ]);
        let [table, over, floating] = &found.objects[..] else { panic!() };
        assert!(table.stable);
        assert!(!over.stable && over.settled.position.y < 0.3 && !over.exploded, "{over:?}");
        assert!((floating.gap_m.unwrap() - 0.05).abs() < 1e-3, "{floating:?}");
        assert!(!floating.stable && (floating.drift_m - 0.05).abs() < 0.003, "it fell 5 cm");
        assert!(floating.support_right);
    }

    #[test]
    fn a_pencil_on_its_end_falls_unless_it_stands_exactly() {
        let mut pencil =
            cuboid("pencil_01", "box", Vec3::new(0.008, 0.18, 0.008), Vec3::new(2.0, 0.0, 2.0), Support::Floor);
        pencil.0.material.physical.weight_kg = 0.02;
        let found = settled(vec![pencil.clone()]);
        assert!(found.objects[0].drift_m < 0.01, "upright and still it may stand: {:?}", found.objects[0]);
        // Of a pencil whose top is 2 cm to the side the centre of mass is beyond the foot.
        let leaning = crate::testing::hull_mesh(&[crate::Hull::of(
            &[(0.0, 0.0), (0.02, 0.18)]
                .iter()
                .flat_map(|(x, y)| {
                    [(-4e-3, -4e-3), (4e-3, -4e-3), (4e-3, 4e-3), (-4e-3, 4e-3)].map(|(u, w)| Vec3::new(x + u, *y, w))
                })
                .collect::<Vec<_>>(),
        )
        .unwrap()]);
        let found = settled(vec![(pencil.0, Arc::new(leaning))]);
        assert!(found.objects[0].tilt_deg > 60.0 && !found.objects[0].stable, "{:?}", found.objects[0]);
    }

    #[test]
    fn deep_penetration_is_told_and_does_not_explode() {
        let found = settled(vec![
            cuboid("box_01", "box", Vec3::splat(0.4), Vec3::new(2.0, 0.0, 2.0), Support::Floor),
            cuboid("box_02", "box", Vec3::splat(0.4), Vec3::new(2.3, 0.0, 2.0), Support::Floor),
        ]);
        assert!((found.penetrations[0].depth_m - 0.1).abs() < 1e-3, "{:?}", found.penetrations);
        assert!(found.objects.iter().all(|o| !o.exploded && !o.stable && o.fastest_m_s < 1.0), "{:?}", found.objects);
        let apart = found.objects[1].settled.position.x - found.objects[0].settled.position.x;
        assert!(apart > 0.395, "{apart}");
    }

    #[test]
    fn it_is_the_same_every_time() {
        let id = ObjectId::new("table_01").unwrap();
        let run = || {
            settled(vec![
                cuboid("table_01", "table", Vec3::new(1.0, 0.7, 0.6), Vec3::new(2.0, 0.0, 2.0), Support::Floor),
                cuboid(
                    "box_01",
                    "box",
                    Vec3::splat(0.1),
                    Vec3::new(2.45, 0.72, 2.0),
                    Support::Object { id: id.clone() },
                ),
            ])
        };
        assert_eq!(run(), run());
    }
}
