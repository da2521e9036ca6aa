//! An arm opens a drawer or a door of furniture.
//!
//! # Idea
//! What opens, along which axis and how far, the scene knows ([`harmony_export::world::Opens`]). Where to take hold is
//! measured on the part's own triangles: its handle is what stands before its front, looked at as if the front were the floor
//! ([`crate::measure::grasp`]), from both sides; without one, its upper edge from above. The part is moved along its joint
//! as far as its limit, or until it or the arm is stopped; what stops it is told.
//!
//! # Limits
//! Fronts have no box behind them, and nothing holds them back. A hand that has taken hold turns with a door: it does not
//! slip round a handle, so that a door opens less far than a person opens it.

use glam::{DAffine3, DVec3};
use harmony_export::World;
use harmony_export::world::{Item, Jointed, Opens, Select};
use harmony_mesh::Mesh;
use harmony_scene::Support;

use crate::RobotError;
use crate::arm::{Carried, Hold, Way, carry};
use crate::jaw::Jaw;
use crate::measure::{JawSize, Window, grasp};
use crate::model::Model;
use crate::motion::Done;
use crate::room::{Surroundings, Thing};

/// Finger tips stay this far before the front, metres.
const OFF_FRONT_M: f64 = 0.001;
/// What stands less far before the front is no handle but a moulding, metres.
const MOULDING_M: f64 = 0.004;
/// Height at which a front is laid to be looked at, metres: sections are looked for well above the floor.
const LAID_M: f64 = 1.0;
/// Shares of the free range that are tried.
const SHARES: [f64; 4] = [1.0, 0.7, 0.45, 0.25];
/// Steps in which a part is looked at on its way.
const SWEEP: usize = 12;

/// Opens a drawer or a door; `object` is a piece of furniture or a part of one, and the first that allows it without.
///
/// # Errors
/// [`RobotError::Nothing`] where nothing opens, [`RobotError::Forbidden`] with the measurement that forbids it.
pub fn open(world: &World, room: &Surroundings, model: &Model, object: Option<&str>) -> Result<Done, RobotError> {
    let jaw = Jaw::of(model)?;
    let furniture = |item: &&Item| harmony_catalogue::kind(&item.object.label).is_none_or(|k| k.opening.is_none());
    let all: Vec<(&Item, &Opens)> = world
        .items
        .iter()
        .filter(furniture)
        .flat_map(|item| item.opens.iter().map(move |part| (item, part)))
        .filter(|(item, part)| object.is_none_or(|id| id == item.name() || id == part.name))
        .collect();
    if all.is_empty() {
        return Err(closed(world, object));
    }
    let mut reasons: Vec<String> = Vec::new();
    for (item, part) in &all {
        match open_part(room, model, &jaw, item, part) {
            Ok(done) => return Ok(done),
            Err(why) => reasons.push(format!("{}: {why}", part.name)),
        }
    }
    let task = match all.as_slice() {
        [(_, part)] => format!("{} cannot be opened", part.name),
        _ => format!("none of {} drawers and doors can be opened", all.len()),
    };
    Err(RobotError::Forbidden { task, why: reasons.join("; ") })
}

/// Why nothing opens.
fn closed(world: &World, object: Option<&str>) -> RobotError {
    let item = world.items.iter().find(|i| Some(i.name()) == object);
    match (item, object) {
        (Some(item), _) => RobotError::Forbidden {
            task: format!("{} cannot be opened", item.name()),
            why: item.rigid.clone().unwrap_or_else(|| "no part of it is known to open".to_owned()),
        },
        (None, Some(id)) => RobotError::Nothing { what: format!("object {id}") },
        (None, None) => RobotError::Nothing { what: "furniture with a drawer or a door that opens".to_owned() },
    }
}

fn open_part(room: &Surroundings, model: &Model, jaw: &Jaw, item: &Item, part: &Opens) -> Result<Done, String> {
    let object = room.named(&part.name).map_err(|e| e.to_string())?;
    // A door's range ends at 0 on either side: what is farther from it is open.
    let limit = if part.range[0].abs() > part.range[1].abs() { part.range[0] } else { part.range[1] };
    let way = |value: f64| way(item, part, value);
    let mut free = 0.0;
    let mut meets = None;
    for k in 1..=SWEEP {
        let share = k as f64 / SWEEP as f64;
        if let Some(other) = room.met_by(object, way(limit).at(share)) {
            meets = Some(room.name(other));
            break;
        }
        free = share;
    }
    let unit = if matches!(part.joint, Jointed::Slide { .. }) { "m" } else { "rad" };
    let stopped = meets.map(|what| {
        format!("it meets {what} after {:.2} {unit}, its joint allows {:.2}", free * limit.abs(), limit.abs())
    });
    if free <= 0.0 {
        return Err(stopped.unwrap_or_default());
    }
    let mut why: Vec<String> = Vec::new();
    let (mut holds, refused) = holds(room, item, part, &room.things[object], &jaw.size);
    why.extend(refused);
    for hold in &mut holds {
        let mut first = None;
        for share in SHARES {
            let value = limit * free * share;
            let steps = ["approach", "reach and straddle", "close", "open"];
            let what = Carried { object, way: way(value), opened: value, steps, task: "open-drawer" };
            match carry(room, model, jaw, hold, &what) {
                Ok(mut done) => {
                    done.measured.insert(format!("opened_{unit}"), value.abs());
                    done.measured.insert(format!("joint_limit_{unit}"), limit.abs());
                    if value.abs() < limit.abs() - 1e-9 {
                        let rest = first.map(|why| format!("farther, {why}")).or(stopped);
                        done.because.extend(rest);
                    }
                    return Ok(done);
                }
                Err(e) => first = first.or(Some(e)),
            }
        }
        why.push(format!("{}: {}", hold.because, first.unwrap_or_default()));
    }
    why.extend(stopped);
    Err(why.join("; "))
}

/// The way of a part in the room when its joint goes from closed to a value.
fn way(item: &Item, part: &Opens, value: f64) -> Way {
    let turn = item.rotation();
    match part.joint {
        Jointed::Slide { axis } => Way::Straight(turn * axis * value),
        Jointed::Hinge { axis, pivot } => {
            let room_from_body = DAffine3::from_mat3_translation(turn, item.object.pose.position);
            Way::Turn { axis: turn * axis, pivot: room_from_body.transform_point3(pivot), angle: value }
        }
    }
}

/// Where a jaw can take hold of a part, and why not elsewhere.
fn holds(room: &Surroundings, item: &Item, part: &Opens, thing: &Thing, jaw: &JawSize) -> (Vec<Hold>, Vec<String>) {
    let room_from_body = DAffine3::from_mat3_translation(item.rotation(), item.object.pose.position);
    let (mut holds, mut refused) = (Vec::new(), Vec::new());
    match handle(item, part, &room_from_body, jaw) {
        Ok(hold) => holds.push(hold),
        Err(why) => refused.push(why),
    }
    // By its upper edge from above, between front and back of its panel.
    let (front, side) = (item.rotation() * DVec3::Z, item.rotation() * DVec3::X);
    let middle = room_from_body.transform_point3((part.low + part.high) / 2.0);
    let window = Window {
        origin: middle,
        along: front,
        across: side,
        half_width: jaw.pad_half_width_m,
        from: f64::NEG_INFINITY,
    };
    let edge = room_from_body.transform_point3(DVec3::new(middle_of(part).x, part.high.y, middle_of(part).z));
    // What the fingers pass has to be free: a top that covers the front is nearer.
    let above = DVec3::new(edge.x, edge.y + 0.001, edge.z);
    let covered = room
        .things
        .iter()
        .filter(|t| t.id != part.name && !t.flat)
        .filter_map(|t| Some((t.bvh.raycast(above, DVec3::Y, 0.5)?.distance, &t.id)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let needed = jaw.tip_m + jaw.palm_m;
    match (covered, grasp(thing, &window, jaw, room_from_body.transform_point3(part.low).y)) {
        (Some((gap, what)), _) if gap < needed => refused.push(format!(
            "by its upper edge: {what} is {:.0} mm above it, the fingers need {:.0} mm",
            1e3 * gap,
            1e3 * needed
        )),
        (_, Err(why)) => refused.push(format!("by its upper edge: {why}")),
        (_, Ok(g)) => holds.push(Hold {
            centre: g.centre,
            approach: DVec3::NEG_Y,
            closing: g.closing,
            measured: [("grasp_height_m", g.section.height_m), ("grasp_thickness_m", g.section.thickness_m)]
                .map(|(n, v)| (n.to_owned(), v))
                .into(),
            because: format!("by its upper edge: {}", g.because),
        }),
    }
    (holds, refused)
}

fn middle_of(part: &Opens) -> DVec3 {
    (part.low + part.high) / 2.0
}

/// The handle of a part, taken from the front.
fn handle(item: &Item, part: &Opens, room_from_body: &DAffine3, jaw: &JawSize) -> Result<Hold, String> {
    let number = item.opens.iter().position(|o| o.name == part.name).ok_or("it has no mesh of its own")?;
    let mut mesh: Mesh = item.selected(Select::Part(number));
    // Laid on its back: x stays, what was before the front is above it.
    let laid = |p: DVec3| DVec3::new(p.x, p.z - part.high.z + LAID_M, -p.y);
    let stood = |p: DVec3| DVec3::new(p.x, -p.z, p.y - LAID_M + part.high.z);
    for p in &mut mesh.positions {
        *p = laid(item.body_point(*p)).as_vec3();
    }
    let front = Thing::new(&part.name, "front", Support::Floor, 0.0, &mesh).ok_or("its front has no triangle")?;
    let proud = front.high.y - LAID_M;
    if proud < MOULDING_M {
        return Err(format!(
            "it has no handle: nothing stands more than {:.1} mm before its front",
            1e3 * proud.max(0.0)
        ));
    }
    let bounds = front
        .triangles
        .iter()
        .filter(|t| t.iter().all(|p| p.y > LAID_M - 2e-3) && t.iter().any(|p| p.y > LAID_M + MOULDING_M))
        .flatten()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let origin = (bounds.0 + bounds.1) / 2.0;
    let mut best: Option<Hold> = None;
    let mut why = None;
    for (along, across) in [(DVec3::Z, DVec3::X), (DVec3::X, DVec3::NEG_Z)] {
        let half_width = jaw.pad_half_width_m;
        let window = Window { origin, along, across, half_width, from: f64::NEG_INFINITY };
        match grasp(&front, &window, jaw, LAID_M + OFF_FRONT_M) {
            Ok(g) => {
                let body = |v: DVec3| DVec3::new(v.x, -v.z, v.y);
                let thickness = g.section.thickness_m;
                if best.as_ref().is_some_and(|b| b.measured["grasp_thickness_m"] <= thickness) {
                    continue;
                }
                let measured = [
                    ("grasp_before_front_m", g.section.height_m - LAID_M),
                    ("grasp_thickness_m", thickness),
                    ("handle_proud_m", proud),
                ];
                best = Some(Hold {
                    centre: room_from_body.transform_point3(stood(g.centre)),
                    approach: room_from_body.transform_vector3(DVec3::NEG_Z),
                    closing: room_from_body.transform_vector3(body(g.closing)),
                    measured: measured.map(|(n, v)| (n.to_owned(), v)).into(),
                    because: format!(
                        "by its handle, which stands {:.0} mm before its front: {:.0} mm before it, it is {:.0} mm thick \
                         within the {:.0} mm jaw",
                        1e3 * proud,
                        1e3 * (g.section.height_m - LAID_M),
                        1e3 * thickness,
                        1e3 * jaw.opening_m
                    ),
                });
            }
            Err(e) => why = why.or(Some(e)),
        }
    }
    best.ok_or_else(|| format!("by its handle, with its front as the ground: {}", why.unwrap_or_default()))
}
