//! One reconstructed room in another size: things keep their walls, relations and clearances. Key `home.adapt`.
//!
//! # Idea
//! Things that belong together are one **unit** and move as one: what rests on something, what is in one functional group,
//! what hangs over or above it. A unit near a wall keeps its distance to it; elsewhere it keeps the share of free room on its
//! two sides. What then cuts into another unit is moved off it by the least way; what cannot be is told.
//!
//! # Frames
//! Both rooms' own frames (`docs/conventions.md`); nothing is turned or scaled.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_export::World;
use harmony_export::world::Item;
use serde::{Deserialize, Serialize};

use crate::HomeError;
use crate::frame::{Place, Rect};
use crate::rooms::flat;
use crate::shell;
use harmony_scene::{
    Camera, Extents, Level, ObjectId, QuarterTurn, Relations, Room, SceneCamera, Support, Wall, WallAffinity,
};

/// Nearer to a wall than this a unit keeps its distance to it, metres.
const NEAR_M: f64 = 0.3;
/// Rooms that can be made, metres.
const ROOM_M: [f64; 2] = [1.2, 40.0];
/// Heights of them, metres.
const HEIGHT_M: [f64; 2] = [1.9, 10.0];
/// Things that face or stand before one another belong together when they are this near, metres.
const BESIDE_M: f64 = 0.8;
/// Things lower than this are in nobody's way, metres.
const FLAT_M: f64 = 0.05;
/// Units that share less than this do not collide, metres.
const TOUCH_M: f64 = 0.01;
/// Rounds of moving units off one another.
const ROUNDS: usize = 60;
/// Kept free under the ceiling, metres.
const BELOW_CEILING_M: f64 = 0.02;

/// What was moved, and what does not fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Adapted {
    /// Size before, metres.
    pub from: [f64; 3],
    /// Size after: width, height, depth, metres.
    pub to: [f64; 3],
    /// Objects that moved: id and by how much, metres.
    pub moved: Vec<(String, [f64; 3])>,
    /// Units that were moved off others, one sentence each.
    pub resolved: Vec<String>,
    /// What does not fit, with its size, one sentence each.
    pub conflicts: Vec<String>,
}

/// Things that move together.
#[derive(Debug, Clone)]
struct Unit {
    members: Vec<usize>,
    /// Around what of it stands or hangs, before.
    before: Rect,
    /// How far it goes.
    by: DVec2,
    /// The wall that holds it.
    wall: Option<Wall>,
}

/// The rectangle of an object seen from above, and its range of height.
fn reach(item: &Item) -> (Rect, [f64; 2]) {
    let b = item.mesh.bounds().unwrap_or(harmony_mesh::Bounds { min: DVec3::ZERO, max: DVec3::ZERO });
    let corners = (0..8).map(|i| {
        let share = DVec3::new(f64::from(i & 1), f64::from((i >> 1) & 1), f64::from((i >> 2) & 1));
        item.object.pose.point(b.min + (b.max - b.min) * share)
    });
    let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    (Rect { min: flat(low), max: flat(high) }, [low.y, high.y])
}

/// The wall that holds an object.
fn wall_of(item: &Item) -> Option<Wall> {
    match item.object.support {
        Support::Wall { wall } => Some(wall),
        _ => WallAffinity::wall(item.object.relations.wall_affinity),
    }
}

/// Groups of items that move together, by the number of their first.
fn units(items: &[Item]) -> Vec<Unit> {
    let reaches: Vec<(Rect, [f64; 2])> = items.iter().map(reach).collect();
    let mut group: Vec<usize> = (0..items.len()).collect();
    let join = |group: &mut Vec<usize>, a: usize, b: usize| {
        let (from, to) = (group[a].max(group[b]), group[a].min(group[b]));
        group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
    };
    let find = |id: &ObjectId| items.iter().position(|i| i.object.id == *id);
    for (k, item) in items.iter().enumerate() {
        let o = &item.object;
        if let Support::Object { id } = &o.support
            && let Some(host) = find(id)
        {
            join(&mut group, k, host);
        }
        for (j, other) in items.iter().enumerate().take(k) {
            let p = &other.object;
            if o.level == Level::Wall || p.level == Level::Wall {
                continue;
            }
            // What stands at two walls stays two units.
            let compatible = wall_of(item) == wall_of(other) || wall_of(item).is_none() || wall_of(other).is_none();
            let same_group = o.relations.group.is_some() && o.relations.group == p.relations.group;
            let names = |a: &Relations, id: &ObjectId| {
                [&a.facing_toward, &a.in_front_of, &a.behind].into_iter().any(|r| r.as_ref() == Some(id))
            };
            let related = names(&o.relations, &p.id) || names(&p.relations, &o.id);
            let near = reaches[k].0.grown(BESIDE_M).meet(&reaches[j].0).is_some();
            let solid = reaches[k].1[1] > FLAT_M && reaches[j].1[1] > FLAT_M;
            let tucked = solid && reaches[k].0.meet(&reaches[j].0).is_some();
            if compatible && (same_group || (related && near) || tucked) {
                join(&mut group, k, j);
            }
        }
    }
    for k in 0..items.len() {
        let over = |j: &usize| *j != k && reaches[*j].0.contains(reaches[k].0.centre(), 0.0);
        let o = &items[k].object;
        let host = match o.support {
            // A lamp over a table, a picture over a sofa, goes with it.
            Support::Ceiling => (0..items.len())
                .filter(over)
                .find(|j| items[*j].object.level == Level::Furniture && reaches[*j].1[1] > FLAT_M),
            Support::Wall { wall } if o.level == Level::Wall => (0..items.len()).find(|j| {
                let other = &items[*j];
                let u = wall.coordinates(o.pose.position).x;
                let (a, b) = (
                    wall.coordinates(DVec3::new(reaches[*j].0.min.x, 0.0, reaches[*j].0.min.y)).x,
                    wall.coordinates(DVec3::new(reaches[*j].0.max.x, 0.0, reaches[*j].0.max.y)).x,
                );
                other.object.level == Level::Furniture
                    && wall_of(other) == Some(wall)
                    && (a..=b).contains(&u)
                    && reaches[k].1[0] > reaches[*j].1[1] - 0.3
                    && !is_opening(&o.label)
            }),
            _ => None,
        };
        if let Some(host) = host {
            join(&mut group, k, host);
        }
    }
    // What lies flat under a unit, such as a rug, goes with the one that covers most of it.
    for k in 0..items.len() {
        let alone = group.iter().filter(|g| **g == group[k]).count() == 1;
        if alone && items[k].object.support == Support::Floor && reaches[k].1[1] < FLAT_M {
            let covered = |j: &usize| reaches[*j].0.meet(&reaches[k].0).map_or(0.0, |m| m.area());
            let most = (0..items.len())
                .filter(|j| *j != k && items[*j].object.level == Level::Furniture && covered(j) > 0.0)
                .max_by(|a, b| covered(a).total_cmp(&covered(b)));
            if let Some(host) = most {
                join(&mut group, k, host);
            }
        }
    }
    let mut roots = group.clone();
    roots.sort_unstable();
    roots.dedup();
    roots
        .into_iter()
        .map(|root| {
            let members: Vec<usize> = (0..items.len()).filter(|k| group[*k] == root).collect();
            let carrying = |k: &&usize| !matches!(items[**k].object.support, Support::Object { .. });
            let rect = members.iter().filter(carrying).map(|k| reaches[*k].0).reduce(|a, b| a.around(&b));
            let before = rect.unwrap_or(reaches[members[0]].0);
            let largest = members.iter().filter(|k| wall_of(&items[**k]).is_some());
            let holder = largest.max_by(|a, b| reaches[**a].0.area().total_cmp(&reaches[**b].0.area()));
            Unit { before, by: DVec2::ZERO, wall: holder.and_then(|k| wall_of(&items[*k])), members }
        })
        .collect()
}

fn is_opening(label: &str) -> bool {
    ["window", "door"].iter().any(|w| label.contains(w))
}

/// Where a range along an axis goes when the axis gets another length.
///
/// Near an end its distance to that end stays; elsewhere the shares of what is free on both sides.
fn shifted(low: f64, high: f64, from: f64, to: f64, held: Option<bool>) -> f64 {
    let (before, after) = (low, from - high);
    let at_low = held.unwrap_or(before <= after);
    if held.is_some() || before.min(after) < NEAR_M {
        return if at_low { 0.0 } else { to - from };
    }
    let share = before / (before + after);
    (to - (high - low)).max(0.0) * share - low
}

/// A room in another size.
///
/// # Errors
/// [`HomeError::Size`] for sizes that are no room's.
pub fn adapt(world: &World, to: Extents) -> Result<(World, Adapted), HomeError> {
    let size = |why: &str| HomeError::Size { width: to.width, depth: to.depth, height: to.height, why: why.to_owned() };
    let plausible = |v: f64, range: [f64; 2]| v.is_finite() && (range[0]..=range[1]).contains(&v);
    if !(plausible(to.width, ROOM_M) && plausible(to.depth, ROOM_M) && plausible(to.height, HEIGHT_M)) {
        return Err(size("rooms have 1.2 to 40 m a side and 1.9 to 10 m of height"));
    }
    let scene = &world.scene;
    let from = scene.room.extents;
    let mut units = units(&world.items);
    for unit in &mut units {
        let held = |low: Wall, high: Wall| unit.wall.filter(|w| *w == low || *w == high).map(|w| w == low);
        unit.by = DVec2::new(
            shifted(unit.before.min.x, unit.before.max.x, from.width, to.width, held(Wall::Left, Wall::Right)),
            shifted(unit.before.min.y, unit.before.max.y, from.depth, to.depth, held(Wall::Back, Wall::Front)),
        );
    }
    let mut resolved = Vec::new();
    let mut conflicts = Vec::new();
    settle(&mut units, &world.items, &to, &mut resolved, &mut conflicts);
    let mut by = vec![DVec3::ZERO; world.items.len()];
    for unit in &units {
        for k in &unit.members {
            by[*k] = DVec3::new(unit.by.x, 0.0, unit.by.y);
        }
    }
    heights(world, &to, &mut by, &mut conflicts);
    let items: Vec<Item> = world
        .items
        .iter()
        .zip(&by)
        .map(|(item, by)| {
            let mut object = item.object.clone();
            object.pose.position += *by;
            object.seen_box = None;
            object.mask = None;
            item.with(object, Arc::clone(&item.mesh))
        })
        .collect();
    let room = room(world, to, &by);
    let whole = Place {
        turn: QuarterTurn::default(),
        yaw: 0.0,
        scale: 1.0,
        at: DVec2::new(to.width, to.depth) / 2.0,
        floor: 0.0,
    };
    let faces = shell::faces("", &room, &whole, &world.shell, 0.1);
    let camera = camera(&world.camera, &from, &to);
    let mut lighting = scene.lighting.clone();
    for light in &mut lighting.lights {
        let owner = light.object.as_ref().and_then(|id| items.iter().position(|i| i.object.id == *id));
        let free = DVec3::from_array(light.position) / from.as_vec() * to.as_vec() - DVec3::from_array(light.position);
        let p = DVec3::from_array(light.position) + owner.map_or(free, |k| by[k]);
        light.position = p.to_array();
    }
    let mut adapted = scene.clone();
    adapted.room = room;
    adapted.camera = SceneCamera::from(&camera);
    adapted.objects = items.iter().map(|i| i.object.clone()).collect();
    adapted.lighting = lighting;
    let moved = items.iter().zip(&by).filter(|(_, by)| by.length() > 1e-3);
    let report = Adapted {
        from: from.as_vec().to_array(),
        to: to.as_vec().to_array(),
        moved: moved.map(|(i, by)| (i.object.id.to_string(), by.to_array())).collect(),
        resolved,
        conflicts,
    };
    Ok((World::new(adapted, faces, items, world.notes.clone()), report))
}

/// The camera as far from the walls, in shares, as before.
fn camera(camera: &Camera, from: &Extents, to: &Extents) -> Camera {
    let k = (to.as_vec() / from.as_vec()).with_y(1.0);
    let mut centre = camera.centre() * k;
    centre.y = centre.y.min(to.height - 0.1);
    Camera { translation: -(camera.rotation * centre), ..*camera }
}

/// The room at its new size; openings go with what fills them.
fn room(world: &World, to: Extents, by: &[DVec3]) -> Room {
    let own = &world.scene.room;
    let from = own.extents;
    let mut room = own.clone();
    room.extents = to;
    let k = to.as_vec() / from.as_vec();
    for block in &mut room.shape.blocks {
        block.min *= k;
        block.max *= k;
    }
    for niche in &mut room.shape.niches {
        niche.min *= k;
        niche.max *= k;
    }
    for slope in &mut room.shape.slopes {
        slope.low *= k.y;
        slope.run *= if matches!(slope.wall, Wall::Left | Wall::Right) { k.x } else { k.z };
    }
    for opening in &mut room.openings {
        let filled = opening.object.as_ref().and_then(|id| world.items.iter().position(|i| i.object.id == *id));
        let (old, new) = (opening.wall.length(&from), opening.wall.length(&to));
        let move_by = match filled {
            Some(item) => opening.wall.coordinates(by[item]),
            None => DVec2::new(shifted(opening.u[0], opening.u[1], old, new, None), 0.0),
        };
        opening.u = opening.u.map(|u| u + move_by.x);
        opening.y = opening.y.map(|y| (y + move_by.y).clamp(0.0, to.height));
    }
    room
}

/// Keeps units in the room and off one another.
fn settle(units: &mut [Unit], items: &[Item], to: &Extents, resolved: &mut Vec<String>, conflicts: &mut Vec<String>) {
    let room = Rect { min: DVec2::ZERO, max: DVec2::new(to.width, to.depth) };
    let stands = |u: &Unit| {
        u.members.iter().any(|k| items[*k].object.support == Support::Floor && reach(&items[*k]).1[1] > FLAT_M)
    };
    let name = |u: &Unit| {
        let first = items[u.members[0]].object.id.to_string();
        if u.members.len() == 1 { first } else { format!("{first} and what goes with it") }
    };
    let at = |u: &Unit| Rect { min: u.before.min + u.by, max: u.before.max + u.by };
    for unit in units.iter_mut() {
        let rect = at(unit);
        let over = (rect.size() - room.size()).max(DVec2::ZERO);
        if over.max_element() > TOUCH_M {
            conflicts.push(format!("{} is {:.2} m larger than the room", name(unit), over.max_element()));
        }
        let inward = (room.min - rect.min).max(DVec2::ZERO) - (rect.max - room.max).max(DVec2::ZERO);
        // What was in the wall before (a door's frame, a window) may be.
        let was = unit.before.min.min(DVec2::ZERO).abs().max_element() + TOUCH_M;
        if inward.abs().max_element() > was && over.max_element() <= TOUCH_M {
            unit.by += inward;
        }
    }
    let solid: Vec<usize> = (0..units.len()).filter(|k| stands(&units[*k])).collect();
    let parts = |u: &Unit| -> Vec<(Rect, [f64; 2])> {
        let own = u.members.iter().filter(|k| !matches!(items[**k].object.support, Support::Object { .. }));
        own.map(|k| reach(&items[*k]))
            .filter(|(_, y)| y[1] > FLAT_M)
            .map(|(r, y)| (Rect { min: r.min + u.by, max: r.max + u.by }, y))
            .collect()
    };
    let cut = |a: &Unit, b: &Unit| -> Option<DVec2> {
        let (pa, pb) = (parts(a), parts(b));
        let met = pa.iter().flat_map(|(ra, ya)| {
            pb.iter().filter(move |(_, yb)| ya[0] < yb[1] && yb[0] < ya[1]).filter_map(move |(rb, _)| ra.meet(rb))
        });
        let met = met.filter(|m| m.size().min_element() > TOUCH_M);
        met.map(|m| m.size()).max_by(|x, y| x.min_element().total_cmp(&y.min_element()))
    };
    let unmoved = |u: &Unit| Unit { by: DVec2::ZERO, ..u.clone() };
    let mut touched = std::collections::BTreeSet::new();
    for _ in 0..ROUNDS {
        let mut quiet = true;
        for (n, i) in solid.iter().enumerate() {
            for j in &solid[n + 1..] {
                let (a, b) = (units[*i].clone(), units[*j].clone());
                let before = cut(&unmoved(&a), &unmoved(&b)).map_or(0.0, DVec2::min_element);
                let Some(size) = cut(&a, &b).filter(|m| m.min_element() > before + TOUCH_M) else { continue };
                quiet = false;
                touched.insert((*i, *j));
                // The one that no wall holds moves, else the smaller one along its wall.
                let (mover, other) = match (a.wall, b.wall) {
                    (None, Some(_)) => (*i, &b),
                    (Some(_), None) => (*j, &a),
                    _ if a.before.area() <= b.before.area() => (*i, &b),
                    _ => (*j, &a),
                };
                let free = match units[mover].wall {
                    Some(Wall::Left | Wall::Right) => DVec2::Y,
                    Some(Wall::Back | Wall::Front) => DVec2::X,
                    None if size.x < size.y => DVec2::X,
                    None => DVec2::Y,
                };
                let way = (at(&units[mover]).centre() - at(other).centre()).dot(free);
                let step = (size.dot(free) + TOUCH_M) * if way < 0.0 { -1.0 } else { 1.0 };
                let mut trial = units[mover].clone();
                trial.by += free * step;
                let rect = at(&trial);
                if !(room.contains(rect.min, TOUCH_M) && room.contains(rect.max, TOUCH_M)) {
                    trial.by -= free * (step + step.signum() * (at(other).size().dot(free) + rect.size().dot(free)));
                }
                let rect = at(&trial);
                if room.contains(rect.min, TOUCH_M) && room.contains(rect.max, TOUCH_M) {
                    units[mover] = trial;
                }
            }
        }
        if quiet {
            break;
        }
    }
    for (i, j) in touched {
        let before = cut(&unmoved(&units[i]), &unmoved(&units[j])).map_or(0.0, DVec2::min_element);
        match cut(&units[i], &units[j]).map(DVec2::min_element).filter(|m| *m > before + TOUCH_M) {
            Some(m) => {
                conflicts.push(format!("{} and {} overlap by {m:.2} m", name(&units[i]), name(&units[j])));
            }
            None => resolved.push(format!("{} and {} were moved apart", name(&units[i]), name(&units[j]))),
        }
    }
}

/// What hangs keeps its distance to the ceiling; what is too high for the room is lowered, or told.
fn heights(world: &World, to: &Extents, by: &mut [DVec3], conflicts: &mut Vec<String>) {
    let from = world.scene.room.extents;
    for (item, by) in world.items.iter().zip(by) {
        let o = &item.object;
        let [low, high] = reach(item).1;
        if o.support == Support::Ceiling {
            by.y = to.height - from.height;
            continue;
        }
        let over = high + BELOW_CEILING_M - to.height;
        if over <= 0.0 {
            continue;
        }
        if matches!(o.support, Support::Wall { .. }) && low - over >= 0.0 {
            by.y = -over;
        } else {
            conflicts.push(format!("{} is {over:.2} m too high for the room", o.id));
        }
    }
}
