//! What in a room can be grasped by a jaw, sat on, placed on and opened, with the measurements.
//!
//! All is measured on the triangles where the scene has them; other objects count as what is in the way. A verdict that says
//! no has the number that says so.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use harmony_catalogue::Trait;
use harmony_export::World;
use harmony_export::world::{Item, Jointed};
use harmony_physics::{Hull, Motion, matter};
use serde::Serialize;

use crate::arm::grasp_of;
use crate::measure::{self, CELL_M, JawSize};
use crate::room::{Shapes, Surroundings, Thing};

/// The hand above what it holds needs this much free way, metres.
const HAND_M: f64 = 0.25;
/// Free height above a seat for a person's upper body, metres.
const HEADROOM_M: f64 = 0.80;
/// Cells of a surface are this near to its height, metres.
const LEVEL_M: f64 = 0.015;
/// Radius of the smallest thing that is placed, metres.
const PLACE_M: f64 = 0.05;
/// Positions of a part that opens.
const SWEEP: usize = 12;
/// A part may touch its own neighbours this deep, metres.
const TOUCH_M: f64 = 0.005;

/// Yes or no, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// Whether it can be done.
    pub possible: bool,
    /// In words, with the number that decides.
    pub because: String,
    /// Measurements by name.
    pub measured: BTreeMap<&'static str, f64>,
}

/// A part that opens.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Opening {
    /// Name of the part.
    pub part: String,
    /// `hinge` or `slide`.
    pub kind: &'static str,
    /// How far it opens, radians or metres.
    pub range: f64,
    /// How far it opens before it meets something.
    pub free: f64,
    /// What it meets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub meets: Option<String>,
}

/// What can be done with an object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Affordances {
    /// The object.
    pub id: String,
    /// What it is.
    pub label: String,
    /// Held by a jaw from above.
    pub grasp: Verdict,
    /// Sat on.
    pub sit: Verdict,
    /// Something placed on it.
    pub place: Verdict,
    /// Parts that open.
    pub open: Vec<Opening>,
    /// Why nothing opens although things of its kind do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rigid: Option<String>,
}

/// Looks at every object.
pub fn affordances(world: &World, room: &Surroundings, jaw: &JawSize) -> Vec<Affordances> {
    world
        .items
        .iter()
        .filter_map(|item| {
            let k = room.things.iter().position(|t| t.id == item.name())?;
            Some(Affordances {
                id: item.name().to_owned(),
                label: item.object.label.clone(),
                grasp: grasp(room, k, item, jaw),
                sit: sit(room, k),
                place: place(room, k),
                open: item.opens.iter().map(|part| opening(room, k, item, part)).collect(),
                rigid: item.rigid.clone(),
            })
        })
        .collect()
}

fn no(because: String) -> Verdict {
    Verdict { possible: false, because, measured: BTreeMap::new() }
}

/// Free way straight up from a point until another object or the ceiling.
fn free_above(room: &Surroundings, own: usize, from: DVec3) -> (f64, String) {
    let hits = room.things.iter().enumerate().filter(|(k, _)| *k != own).filter_map(|(_, t)| {
        let inside = from.x >= t.low.x && from.x <= t.high.x && from.z >= t.low.z && from.z <= t.high.z;
        if !inside {
            return None;
        }
        t.bvh.raycast(from, DVec3::Y, 10.0).map(|hit| (hit.distance, t.id.clone()))
    });
    let ceiling = (room.free_of_room(from, DVec3::Y), "the ceiling".to_owned());
    hits.chain(std::iter::once(ceiling)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, String::new()))
}

fn grasp(room: &Surroundings, k: usize, item: &Item, jaw: &JawSize) -> Verdict {
    if matter::motion(&item.object) == Motion::Static {
        return no("it does not move".to_owned());
    }
    let thing = &room.things[k];
    let found = match measure::chair(thing) {
        Ok(chair) => chair.grasp(thing, jaw).map_err(|why| format!("its backrest: {why}")),
        Err(_) => grasp_of(room, k, jaw),
    };
    match found {
        Err(why) => no(why),
        Ok(g) => {
            let (free, what) = free_above(room, k, DVec3::new(g.centre.x, g.top_m + 0.002, g.centre.z));
            let measured = BTreeMap::from([
                ("height_m", g.section.height_m),
                ("thickness_m", g.section.thickness_m),
                ("free_above_m", free),
            ]);
            if free < HAND_M {
                let because = format!("{what} is {free:.2} m above it, the hand needs {HAND_M} m");
                return Verdict { possible: false, because, measured };
            }
            Verdict { possible: true, because: g.because, measured }
        }
    }
}

fn sit(room: &Surroundings, k: usize) -> Verdict {
    match measure::seat(&room.things[k]) {
        Err(why) => no(why),
        Ok(seat) => {
            let (free, what) = free_above(room, k, seat.centre + DVec3::Y * 0.05);
            let free = free + 0.05;
            let measured =
                BTreeMap::from([("height_m", seat.height_m), ("area_m2", seat.area_m2), ("headroom_m", free)]);
            let possible = free >= HEADROOM_M;
            let because = if possible {
                format!("{:.2} m2 level at {:.2} m", seat.area_m2, seat.height_m)
            } else {
                format!("{what} is {free:.2} m above its seat, who sits needs {HEADROOM_M} m")
            };
            Verdict { possible, because, measured }
        }
    }
}

fn place(room: &Surroundings, k: usize) -> Verdict {
    let thing = &room.things[k];
    if !harmony_catalogue::has(&thing.label, Trait::Carries) {
        return no("things of its kind carry nothing".to_owned());
    }
    let cells = measure::cells(thing);
    let flat: Vec<(DVec2, f64)> = cells.iter().filter(|c| c.2).map(|c| (c.0, c.1)).collect();
    let height = measure::fullest_height(flat.iter().map(|c| c.1), LEVEL_M);
    let level: Vec<DVec2> = flat.iter().filter(|c| (c.1 - height).abs() <= LEVEL_M).map(|c| c.0).collect();
    let taken = |c: &DVec2| room.things.iter().enumerate().any(|(other, t)| other != k && covers(t, c, height));
    let (mut free, mut blocked) = (Vec::new(), Vec::new());
    for c in &level {
        if taken(c) { blocked.push(*c) } else { free.push(*c) }
    }
    let area = free.len() as f64 * CELL_M * CELL_M;
    let whole = level.len() as f64 * CELL_M * CELL_M;
    // The largest free circle: cells that are not in the level are its border.
    let is_free: std::collections::BTreeSet<(i64, i64)> = free.iter().map(|c| key(thing, c)).collect();
    let radius = free.iter().map(|c| clear(&is_free, key(thing, c))).fold(0.0, f64::max);
    let measured = BTreeMap::from([
        ("height_m", height),
        ("level_m2", whole),
        ("free_m2", area),
        ("largest_free_circle_m", 2.0 * radius),
    ]);
    let possible = radius >= PLACE_M;
    let because = if possible {
        format!("{area:.2} of {whole:.2} m2 at {:.2} m are free, a disc of {:.2} m fits", height, 2.0 * radius)
    } else {
        format!("the largest free disc is {:.2} m, {:.2} m are needed", 2.0 * radius, 2.0 * PLACE_M)
    };
    Verdict { possible, because, measured }
}

fn key(thing: &Thing, c: &DVec2) -> (i64, i64) {
    (((c.x - thing.low.x) / CELL_M).floor() as i64, ((c.y - thing.low.z) / CELL_M).floor() as i64)
}

/// Whether another thing stands over a cell of a surface.
fn covers(t: &Thing, c: &DVec2, height: f64) -> bool {
    let near = t.low.y < height + 0.10 && t.high.y > height + 0.002;
    let inside = c.x >= t.low.x && c.x <= t.high.x && c.y >= t.low.z && c.y <= t.high.z;
    near && inside && t.top_at(c.x, c.y, t.high.y + 0.1).is_some_and(|(top, _)| top > height + 0.002)
}

/// Radius of the free disc about a cell, metres.
fn clear(free: &std::collections::BTreeSet<(i64, i64)>, at: (i64, i64)) -> f64 {
    let mut radius = 0;
    'grow: for r in 1..60_i64 {
        for dx in -r..=r {
            for dz in [-r, r] {
                let corner = dx * dx + dz * dz <= (r + 1) * (r + 1);
                if corner && (!free.contains(&(at.0 + dx, at.1 + dz)) || !free.contains(&(at.0 + dz, at.1 + dx))) {
                    break 'grow;
                }
            }
        }
        radius = r;
    }
    (radius as f64 + 0.5) * CELL_M
}

fn opening(room: &Surroundings, own: usize, item: &Item, part: &harmony_export::world::Opens) -> Opening {
    let range = part.range[1] - part.range[0];
    let room_from_body = DAffine3::from_mat3_translation(item.rotation(), item.object.pose.position);
    let shape = Shapes::new(&[vec![Hull::cuboid(part.low, part.high)]]);
    let moved = |value: f64| -> DAffine3 {
        match part.joint {
            Jointed::Slide { axis } => DAffine3::from_translation(axis * value),
            Jointed::Hinge { axis, pivot } => {
                let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, value));
                DAffine3::from_mat3_translation(turn, pivot - turn * pivot)
            }
        }
    };
    let mut free = 0.0;
    let mut meets = None;
    for k in 1..=SWEEP {
        let value = part.range[0] + range * k as f64 / SWEEP as f64;
        let place = [room_from_body * moved(value)];
        let others = |_: usize, o: crate::room::Other| match o {
            crate::room::Other::Thing(t) => t != own && !(room.things[t].part && room.rides(t, own)),
            crate::room::Other::Face(_) => k > 1,
        };
        if let Some(near) = room.nearest(&shape, &place, None, 0.01, &others)
            && near.distance < -TOUCH_M
        {
            meets = Some(room.name(near.other));
            break;
        }
        free = range * k as f64 / SWEEP as f64;
    }
    let kind = if matches!(part.joint, Jointed::Slide { .. }) { "slide" } else { "hinge" };
    Opening { part: part.name.clone(), kind, range, free, meets }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::room::tests::{room, thing};

    #[test]
    fn a_table_with_a_box_on_it_has_that_much_less_room() {
        let table = thing("table_01", "dining table", &[([1.0, 0.7, 1.0], [2.4, 0.74, 1.8])]);
        let clutter = thing("box_01", "box", &[([1.0, 0.74, 1.0], [1.7, 0.9, 1.8])]);
        let alone = place(&room(vec![table]), 0);
        assert!(alone.possible && (alone.measured["free_m2"] - 1.12).abs() < 0.02, "{alone:?}");
        assert!((alone.measured["largest_free_circle_m"] - 0.8).abs() < 0.08, "{alone:?}");
        let table = thing("table_01", "dining table", &[([1.0, 0.7, 1.0], [2.4, 0.74, 1.8])]);
        let half = place(&room(vec![table, clutter]), 0);
        assert!((half.measured["free_m2"] - 0.56).abs() < 0.03, "{half:?}");
        assert!((half.measured["largest_free_circle_m"] - 0.7).abs() < 0.08, "{half:?}");
    }

    #[test]
    fn nobody_sits_under_a_table() {
        let stool = || thing("stool_01", "stool", &[([1.2, 0.0, 1.2], [1.6, 0.45, 1.6])]);
        let table = thing("table_01", "dining table", &[([1.0, 0.7, 1.0], [2.4, 0.74, 1.8])]);
        assert!(sit(&room(vec![stool()]), 0).possible);
        let under = sit(&room(vec![stool(), table]), 0);
        assert!(!under.possible && under.because.contains("0.25 m above"), "{under:?}");
    }
}
