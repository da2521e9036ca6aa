//! Least changes that make a scene stand.
//!
//! Rounds of four steps, until all is stable or nothing more helps. (1) What is in something else leaves it by the least
//! move: upwards when the other is what carries it, sideways else; whatever it carries comes along; of two that move, the
//! lighter moves. (2) What floats is lowered onto what is below it. (3) What fell because its weight is not above what it
//! stands on moves sideways by the least way at that height that puts it there. (4) The scene settles; what came to rest
//! near its place and upright takes the place where it came to rest. What is then still not stable is named with the reason.
//!
//! A repaired pose is one of `scene.json`: a place and a yaw, never a tilt. Objects fixed to the room are not moved.

use harmony_scene::{Scene, Support, Vec3};
use serde::{Deserialize, Serialize};

use crate::bodies::Bodies;
use crate::matter::Motion;
use crate::settle::{Settled, SettledObject, gap, settle};
use crate::touch::Solid;
use crate::world::Placed;

/// Most rounds.
const ROUNDS: usize = 4;
/// Sweeps of moving apart in a round.
const SWEEPS: usize = 24;
/// Penetrations below this stay, metres.
const LET_BE_M: f64 = 5e-4;
/// What came to rest farther from its place has fallen, metres ...
const NEAR_M: f64 = 0.12;
/// ... and what tilts more does not stand, degrees.
const UPRIGHT_DEG: f64 = 6.0;
/// Step of the search for a place where the weight of an object is above what carries it, metres ...
const BALANCE_STEP_M: f64 = 0.005;
/// ... its directions ...
const BALANCE_WAYS: usize = 16;
/// ... and its end, metres.
const BALANCE_FARTHEST_M: f64 = 0.15;
/// Rows and columns of points of an object's underside.
const FOOT_GRID: usize = 24;
/// An underside this far above the lowest point stands too, and so does a foot this far above what is below it, metres.
const FOOT_M: f64 = 0.005;
/// Share of what an object's own feet reach beyond its weight that must be carried, in each direction.
const CARRIED: f64 = 0.25;
/// Moves below this are not told, metres and radians.
const TOLD: f64 = 5e-4;
/// Farthest that an object may be moved in all, metres: beyond it the photo says otherwise.
const FARTHEST_M: f64 = 0.3;

/// An object that was moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Repair {
    /// Which.
    pub id: String,
    /// Its new place, metres.
    pub position: Vec3,
    /// Its new yaw, radians.
    pub yaw: f64,
    /// How far it was moved, metres.
    pub moved_m: f64,
    /// How far it was turned, degrees.
    pub turned_deg: f64,
    /// Why, in words.
    pub reasons: Vec<String>,
}

/// An object that does not stand by itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unrepaired {
    /// Which.
    pub id: String,
    /// Why not, in words.
    pub reason: String,
}

/// What was changed, and how the scene settles with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Repaired {
    /// Moved objects, in the scene's order.
    pub repairs: Vec<Repair>,
    /// What is still not stable.
    pub unrepaired: Vec<Unrepaired>,
    /// Settling after the repair.
    pub after: Settled,
}

impl Repaired {
    /// Writes the new places into a scene.
    pub fn apply(&self, scene: &mut Scene) {
        for repair in &self.repairs {
            if let Some(object) = scene.objects.iter_mut().find(|o| o.id.as_str() == repair.id) {
                object.pose.position = repair.position;
                object.pose.yaw = repair.yaw;
            }
        }
    }
}

/// Repairs a scene whose settling is known.
pub fn repair(scene: &Scene, bodies: &Bodies, start: &[Placed], before: &Settled) -> Repaired {
    let mut places = start.to_vec();
    let mut reasons: Vec<Vec<String>> = vec![Vec::new(); places.len()];
    let mut best = (before.clone(), places.clone(), reasons.clone());
    let mut now = before.clone();
    for _ in 0..ROUNDS {
        if now.stable().0 == now.stable().1 {
            break;
        }
        part(scene, bodies, start, &mut places, &mut reasons);
        lower(scene, bodies, start, &mut places, &mut reasons);
        balance(scene, bodies, &now, start, &mut places, &mut reasons);
        now = settle(scene, bodies, &places);
        keep_better(&mut best, &now, &places, &reasons);
        if adopt(&now, start, &mut places, &mut reasons) {
            now = settle(scene, bodies, &places);
            keep_better(&mut best, &now, &places, &reasons);
        }
    }
    let (after, places, reasons) = best;
    let repairs =
        (0..places.len()).filter_map(|k| told(&bodies.objects[k].id, start[k], places[k], &reasons[k])).collect();
    let unrepaired =
        after.dynamic().filter(|o| !o.stable).map(|o| Unrepaired { id: o.id.clone(), reason: why_not(o) }).collect();
    Repaired { repairs, unrepaired, after }
}

type Best = (Settled, Vec<Placed>, Vec<Vec<String>>);

fn keep_better(best: &mut Best, now: &Settled, places: &[Placed], reasons: &[Vec<String>]) {
    if now.stable().0 > best.0.stable().0 {
        *best = (now.clone(), places.to_vec(), reasons.to_vec());
    }
}

fn told(id: &str, from: Placed, to: Placed, reasons: &[String]) -> Option<Repair> {
    let moved_m = from.position.distance(to.position);
    let turned = turn(from.yaw(), to.yaw());
    (moved_m > TOLD || turned.abs() > TOLD).then(|| {
        let mut reasons = reasons.to_vec();
        reasons.dedup();
        Repair {
            id: id.to_owned(),
            position: to.position,
            yaw: to.yaw(),
            moved_m,
            turned_deg: turned.to_degrees(),
            reasons,
        }
    })
}

/// From one yaw to another the short way, radians.
fn turn(from: f64, to: f64) -> f64 {
    let d = to - from;
    d.sin().atan2(d.cos())
}

fn why_not(o: &SettledObject) -> String {
    let far =
        format!("{:.1} cm and {:.1} degrees in {} s", 100.0 * o.drift_m, o.tilt_deg, crate::settle::SETTLE_SECONDS);
    if o.exploded {
        format!("it was thrown out of its place: {far}")
    } else if o.tilt_deg > 20.0 {
        format!("it falls over ({far}): its weight is not above what it stands on")
    } else if o.gap_m.is_none() {
        format!("there is nothing below it ({far})")
    } else if o.penetration_m > 0.01 {
        format!("it is {:.1} cm in something else and has no room beside it ({far})", 100.0 * o.penetration_m)
    } else {
        format!("it slides or rocks: {far}")
    }
}

/// Who is carried by whom, by the scene's own words.
fn carrier(scene: &Scene, k: usize) -> Option<usize> {
    match &scene.objects[k].support {
        Support::Object { id } => scene.objects.iter().position(|o| o.id == *id),
        _ => None,
    }
}

/// An object with all that stands on it.
fn with_carried(scene: &Scene, k: usize) -> Vec<usize> {
    let mut out = vec![k];
    let mut at = 0;
    while at < out.len() {
        let carried = (0..scene.objects.len()).filter(|j| carrier(scene, *j) == Some(out[at]));
        let new: Vec<usize> = carried.filter(|j| !out.contains(j)).collect();
        out.extend(new);
        at += 1;
    }
    out
}

/// Moves objects out of each other.
fn part(scene: &Scene, bodies: &Bodies, start: &[Placed], places: &mut [Placed], reasons: &mut [Vec<String>]) {
    let moves = |k: usize| bodies.objects[k].motion == Motion::Dynamic;
    let shell: Vec<Solid> = bodies.shell.iter().map(|(_, h)| Solid::fixed(h)).collect();
    let solid = |k: usize, p: &[Placed]| Solid::placed(&bodies.objects[k].hulls, &p[k]);
    let mut solids: Vec<Solid> = (0..places.len()).map(|k| solid(k, places)).collect();
    for _ in 0..SWEEPS {
        let mut moved = false;
        for k in (0..places.len()).filter(|k| moves(*k)) {
            // The deepest penetration of this object first.
            let objects = (0..places.len()).filter(|j| *j != k);
            let of_objects =
                objects.filter_map(|j| Some((solids[k].depth(&solids[j])?, Some(j), bodies.objects[j].id.as_str())));
            let of_faces = shell
                .iter()
                .zip(&bodies.shell)
                .filter_map(|(s, (name, _))| Some((solids[k].depth(s)?, None, name.as_str())));
            let deepest = of_objects
                .chain(of_faces)
                .filter(|(d, ..)| d.depth > LET_BE_M)
                .max_by(|a, b| a.0.depth.total_cmp(&b.0.depth));
            let Some((found, other, name)) = deepest else { continue };
            if let Some(j) = other {
                // What carries it is not moved by it; of two others the lighter moves.
                let mine = bodies.objects[k].mass_kg;
                let carried_by_me = carrier(scene, j) == Some(k);
                let carries_me = carrier(scene, k) == Some(j);
                let theirs = bodies.objects[j].mass_kg;
                let heavier = mine > theirs || (mine == theirs && k < j);
                if moves(j) && !carries_me && (carried_by_me || heavier) {
                    continue;
                }
            }
            let on_it = other.is_some_and(|j| carrier(scene, k) == Some(j)) || name == "floor";
            let direction = if on_it || found.out.y > 0.9 {
                Vec3::Y
            } else {
                Vec3::new(found.out.x, 0.0, found.out.z).normalize_or(Vec3::Y)
            };
            // The way along the direction is the depth over its share of the true one; bounded where that share is small.
            let by = direction * (found.depth / found.out.dot(direction).max(0.25) + 1e-4);
            let group = with_carried(scene, k);
            let too_far = group.iter().any(|g| (places[*g].position + by).distance(start[*g].position) > FARTHEST_M);
            if too_far {
                continue;
            }
            reasons[k].push(format!("it was {:.1} cm in {name}", 100.0 * found.depth));
            for g in group {
                places[g].position += by;
                if g != k {
                    reasons[g].push(format!("it stands on {}, which moved", bodies.objects[k].id));
                }
                solids[g] = solid(g, places);
            }
            moved = true;
        }
        if !moved {
            break;
        }
    }
    for r in reasons {
        r.sort();
        r.dedup();
    }
}

/// Lowers what floats.
fn lower(scene: &Scene, bodies: &Bodies, start: &[Placed], places: &mut [Placed], reasons: &mut [Vec<String>]) {
    let shell: Vec<Solid> = bodies.shell.iter().map(|(_, h)| Solid::fixed(h)).collect();
    let mut solids: Vec<Solid> =
        bodies.objects.iter().zip(places.iter()).map(|(b, p)| Solid::placed(&b.hulls, p)).collect();
    // Carriers before what they carry.
    let mut order: Vec<usize> = (0..places.len()).filter(|k| bodies.objects[*k].motion == Motion::Dynamic).collect();
    order.sort_by(|a, b| places[*a].position.y.total_cmp(&places[*b].position.y));
    for k in order {
        let Some(gap) = gap(k, &solids, &shell).filter(|g| *g > LET_BE_M) else { continue };
        let by = Vec3::NEG_Y * (gap - 1e-4);
        let group = with_carried(scene, k);
        if group.iter().any(|g| (places[*g].position + by).distance(start[*g].position) > FARTHEST_M) {
            continue;
        }
        reasons[k].push(format!("it was {:.1} cm above what it stands on", 100.0 * gap));
        for g in group {
            places[g].position += by;
            solids[g] = Solid::placed(&bodies.objects[g].hulls, &places[g]);
        }
    }
}

/// Points of an object's underside that are within [`FOOT_M`] of its lowest, where it stands.
fn feet(solid: &Solid) -> Vec<Vec3> {
    let at = |k: usize, low: f64, high: f64| low + (high - low) * (k as f64 + 0.5) / FOOT_GRID as f64;
    let below = solid.low.y - FOOT_M;
    (0..FOOT_GRID * FOOT_GRID)
        .map(|k| {
            let x = at(k % FOOT_GRID, solid.low.x, solid.high.x);
            Vec3::new(x, below, at(k / FOOT_GRID, solid.low.z, solid.high.z))
        })
        .filter(|p| solid.meets(*p, Vec3::Y, 2.0 * FOOT_M))
        .map(|p| p + Vec3::Y * FOOT_M)
        .collect()
}

/// How far points reach beyond another in each of [`BALANCE_WAYS`] directions on the floor, metres.
fn reach(points: impl Iterator<Item = Vec3> + Clone, beyond: Vec3) -> impl Iterator<Item = f64> {
    ways().map(move |way| points.clone().map(|p| (p - beyond).dot(way)).fold(f64::NEG_INFINITY, f64::max))
}

fn ways() -> impl Iterator<Item = Vec3> {
    (0..BALANCE_WAYS).map(|k| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / BALANCE_WAYS as f64).sin_cos();
        Vec3::new(cos, 0.0, sin)
    })
}

/// Moves what fell, for its weight is not above what it stands on, to the nearest place at that height where it is.
fn balance(
    scene: &Scene,
    bodies: &Bodies,
    now: &Settled,
    start: &[Placed],
    places: &mut [Placed],
    reasons: &mut [Vec<String>],
) {
    let shell: Vec<Solid> = bodies.shell.iter().map(|(_, h)| Solid::fixed(h)).collect();
    for k in 0..places.len() {
        let o = &now.objects[k];
        if o.motion != Motion::Dynamic || o.stable || o.tilt_deg <= UPRIGHT_DEG {
            continue;
        }
        let group = with_carried(scene, k);
        let body = &bodies.objects[k];
        let others: Vec<Solid> = (0..places.len())
            .filter(|j| !group.contains(j))
            .map(|j| Solid::placed(&bodies.objects[j].hulls, &places[j]))
            .chain(shell.iter().cloned())
            .collect();
        let solid = Solid::placed(&body.hulls, &places[k]);
        let (feet, weight) = (feet(&solid), places[k].point(body.centre_of_mass));
        let wanted: Vec<f64> = reach(feet.iter().copied(), weight).collect();
        if wanted.iter().any(|w| *w <= 0.0) {
            continue;
        }
        let stands = |by: Vec3| {
            let carried: Vec<Vec3> = feet
                .iter()
                .map(|p| *p + by)
                .filter(|p| others.iter().any(|s| s.meets(*p + Vec3::Y * FOOT_M, Vec3::NEG_Y, 2.0 * FOOT_M)))
                .collect();
            reach(carried.iter().copied(), weight + by).zip(&wanted).all(|(has, wants)| has >= CARRIED * wants)
        };
        if stands(Vec3::ZERO) {
            continue;
        }
        let free = |by: Vec3| {
            let there = Placed { position: places[k].position + by, ..places[k] };
            let solid = Solid::placed(&body.hulls, &there);
            there.position.distance(start[k].position) <= FARTHEST_M
                && others.iter().all(|s| solid.depth(s).is_none_or(|d| d.depth <= 2.0 * LET_BE_M))
        };
        let steps = (BALANCE_FARTHEST_M / BALANCE_STEP_M) as usize;
        let found = (1..=steps)
            .flat_map(|step| ways().map(move |way| way * (step as f64 * BALANCE_STEP_M)))
            .find(|by| stands(*by) && free(*by));
        let Some(by) = found else { continue };
        reasons[k].push("its weight was not above what it stands on".to_owned());
        for g in group {
            places[g].position += by;
        }
    }
}

/// Takes the places where unstable objects came to rest, if they are near and upright; whether any was taken.
fn adopt(now: &Settled, start: &[Placed], places: &mut [Placed], reasons: &mut [Vec<String>]) -> bool {
    let mut any = false;
    for (k, o) in now.objects.iter().enumerate() {
        let near = o.settled.position.distance(start[k].position)
            <= NEAR_M.max(places[k].position.distance(start[k].position));
        if o.motion == Motion::Static || o.stable || o.exploded || o.tilt_deg > UPRIGHT_DEG || !near {
            continue;
        }
        let half = o.settled.yaw() / 2.0;
        places[k] = Placed { position: o.settled.position, rotation: [0.0, half.sin(), 0.0, half.cos()] };
        reasons[k].push("it takes the place where it came to rest".to_owned());
        any = true;
    }
    any
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use harmony_mesh::Mesh;
    use harmony_scene::{ObjectId, SceneObject};

    use super::*;
    use crate::bodies::{BodySettings, bodies};
    use crate::settle::places;
    use crate::testing::{cuboid, scene};

    fn repaired(things: Vec<(SceneObject, Arc<Mesh>)>) -> (Settled, Repaired) {
        let meshes: BTreeMap<ObjectId, Arc<Mesh>> = things.iter().map(|(o, m)| (o.id.clone(), Arc::clone(m))).collect();
        let scene = scene(things.into_iter().map(|(o, _)| o).collect());
        let bodies = bodies(&scene, &meshes, &BodySettings::default()).unwrap();
        let start = places(&scene);
        let before = settle(&scene, &bodies, &start);
        let after = repair(&scene, &bodies, &start, &before);
        (before, after)
    }

    #[test]
    fn sunk_and_floating_things_are_put_where_they_stand() {
        let id = ObjectId::new("table_01").unwrap();
        let on = || Support::Object { id: id.clone() };
        let (before, found) = repaired(vec![
            cuboid("table_01", "table", Vec3::new(1.0, 0.7, 0.6), Vec3::new(2.0, -0.03, 2.0), Support::Floor),
            cuboid("box_01", "box", Vec3::splat(0.2), Vec3::new(2.2, 0.64, 2.0), on()),
            cuboid("box_02", "box", Vec3::splat(0.2), Vec3::new(1.8, 0.75, 2.0), on()),
        ]);
        assert!(before.stable().0 < 3);
        assert_eq!(found.after.stable(), (3, 3), "{:?}", found.unrepaired);
        assert!(found.unrepaired.is_empty());
        for repair in &found.repairs {
            let top = if repair.id == "table_01" { 0.0 } else { 0.7 };
            assert!((repair.position.y - top).abs() < 3e-3, "{repair:?}");
            assert!(repair.moved_m < 0.1 && !repair.reasons.is_empty(), "{repair:?}");
            let x = match repair.id.as_str() {
                "table_01" => 2.0,
                "box_01" => 2.2,
                _ => 1.8,
            };
            assert!((repair.position.x - x).abs() < 1e-3, "straight up or down: {repair:?}");
        }
    }

    #[test]
    fn the_lighter_of_two_leaves_the_other_sideways() {
        let mut heavy = cuboid("box_01", "box", Vec3::splat(0.4), Vec3::new(2.0, 0.0, 2.0), Support::Floor);
        heavy.0.material.physical.weight_kg = 20.0;
        let mut light = cuboid("box_02", "box", Vec3::splat(0.4), Vec3::new(2.35, 0.0, 2.0), Support::Floor);
        light.0.material.physical.weight_kg = 5.0;
        let (_, found) = repaired(vec![heavy, light]);
        assert_eq!(found.after.stable(), (2, 2));
        assert_eq!(found.repairs.len(), 1, "{:?}", found.repairs);
        let r = &found.repairs[0];
        assert!(r.id == "box_02" && (r.moved_m - 0.05).abs() < 3e-3 && r.position.y.abs() < 1e-3, "{r:?}");
    }

    #[test]
    fn what_is_over_an_edge_moves_the_least_way_that_lets_it_stand() {
        let id = ObjectId::new("table_01").unwrap();
        let on = || Support::Object { id: id.clone() };
        // The table ends at x = 2.5; at the table's other end nothing is wrong.
        let (before, found) = repaired(vec![
            cuboid("table_01", "table", Vec3::new(1.0, 0.7, 0.6), Vec3::new(2.0, 0.0, 2.0), Support::Floor),
            cuboid("box_01", "box", Vec3::new(0.2, 0.1, 0.1), Vec3::new(2.53, 0.7, 2.0), on()),
            cuboid("box_02", "box", Vec3::new(0.2, 0.1, 0.1), Vec3::new(1.53, 0.7, 2.0), on()),
        ]);
        assert_eq!(before.stable(), (2, 3));
        assert_eq!(found.after.stable(), (3, 3), "{:?}", found.unrepaired);
        assert_eq!(found.repairs.len(), 1, "{:?}", found.repairs);
        let moved = &found.repairs[0];
        assert!(moved.id == "box_01" && (2.46..2.5).contains(&moved.position.x), "{moved:?}");
        assert!((moved.position.z - 2.0).abs() < 1e-3 && moved.reasons[0].contains("weight"), "{moved:?}");
    }

    #[test]
    fn what_cannot_stand_is_named_and_left_in_place() {
        let id = ObjectId::new("table_01").unwrap();
        let (_, found) = repaired(vec![
            cuboid("table_01", "table", Vec3::new(1.0, 0.7, 0.6), Vec3::new(2.0, 0.0, 2.0), Support::Floor),
            cuboid("box_01", "box", Vec3::new(0.4, 0.1, 0.1), Vec3::new(2.69, 0.7, 2.0), Support::Object { id }),
        ]);
        assert_eq!(found.unrepaired.len(), 1);
        assert!(
            found.unrepaired[0].id == "box_01" && found.unrepaired[0].reason.contains("falls over"),
            "{:?}",
            found.unrepaired
        );
        assert!(found.repairs.is_empty(), "{:?}", found.repairs);
    }

    #[test]
    fn a_sound_scene_is_left_alone() {
        let (_, found) =
            repaired(vec![cuboid("box_01", "box", Vec3::splat(0.4), Vec3::new(2.0, 0.0, 2.0), Support::Floor)]);
        assert!(found.repairs.is_empty() && found.unrepaired.is_empty());
    }
}
