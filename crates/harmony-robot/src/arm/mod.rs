//! An arm with a jaw: draws a chair by its backrest, picks a thing up.
//!
//! # Idea
//! Where to hold is measured ([`crate::measure`]). The arm stands on a column beside the way of its hand; where, and how
//! high, is searched ([`stands`]): places are ranked by how far the joints stay from their limits at the key poses, and the
//! first from which the whole way is free of everything is taken ([`carry`]). The fingers are closed until the first touches
//! the triangles, and the hand is shifted until both do ([`frames`]).
//!
//! # Limits
//! Kinematics alone: whether friction holds what is gripped, and whether the arm is strong enough, is not asked. Chairs and
//! decorations are taken from straight above.

mod carry;
mod frames;
mod stands;

use glam::{DAffine3, DVec3};
use harmony_scene::{Level, Support};

use crate::RobotError;
use crate::jaw::Jaw;
use crate::measure::{self, Grasp, Window};
use crate::model::Model;
use crate::motion::Done;
use crate::room::Surroundings;
pub(crate) use carry::{Carried, Hold, Way, carry};

/// How far a chair is drawn, metres (the paper's).
pub const DRAW_M: f64 = 0.45;
/// How far a thing is lifted, metres.
pub const LIFT_M: f64 = 0.20;

/// Draws a chair back by its backrest.
///
/// # Errors
/// [`RobotError::Nothing`] without a chair, [`RobotError::Forbidden`] with the measurement that forbids it.
pub fn draw_chair(room: &Surroundings, model: &Model, object: Option<&str>) -> Result<Done, RobotError> {
    let chairs = match object {
        Some(id) => vec![room.named(id)?],
        None => room.chairs(),
    };
    let jaw = Jaw::of(model)?;
    let mut first = None;
    for k in chairs {
        let thing = &room.things[k];
        let forbidden = |why: String| RobotError::Forbidden { task: format!("{} cannot be drawn", thing.id), why };
        let tried = (|| {
            let chair = measure::chair(thing).map_err(&forbidden)?;
            let grasp = chair.grasp(thing, &jaw.size).map_err(|why| forbidden(format!("its backrest: {why}")))?;
            free_way(room, k, chair.back, DRAW_M).map_err(&forbidden)?;
            let steps = ["approach", "descend and straddle", "close", "draw"];
            let way = Way::Straight(chair.back * DRAW_M);
            let what = Carried { object: k, way, opened: 0.0, steps, task: "draw-chair" };
            carry(room, model, &jaw, &Hold::from_above(&grasp), &what).map_err(&forbidden)
        })();
        match tried {
            Ok(done) => return Ok(done),
            Err(e) => first = first.or(Some(e)),
        }
    }
    Err(first.unwrap_or_else(|| RobotError::Nothing { what: "chair".to_owned() }))
}

/// Whether an object can be moved along a way of the floor.
fn free_way(room: &Surroundings, thing: usize, along: DVec3, length: f64) -> Result<(), String> {
    let steps = (length / 0.03).ceil() as usize;
    for step in 1..=steps {
        let way = length * step as f64 / steps as f64;
        if let Some(other) = room.met_by(thing, DAffine3::from_translation(along * way)) {
            return Err(format!("it meets {} after {way:.2} m, the way is {length:.2} m", room.name(other)));
        }
    }
    Ok(())
}

/// Where a jaw from above can hold a thing that stands on something: the thinnest direction that it fits over.
///
/// # Errors
/// Why it cannot, by its thinnest direction.
pub fn grasp_of(room: &Surroundings, thing: usize, jaw: &measure::JawSize) -> Result<Grasp, String> {
    let thing = &room.things[thing];
    let middle = (thing.low + thing.high) / 2.0;
    let mut best: Option<Grasp> = None;
    let mut thinnest: Option<(f64, String)> = None;
    for k in 0..18 {
        let angle = thing.yaw + f64::from(k) * 10.0_f64.to_radians();
        let along = DVec3::new(angle.sin(), 0.0, angle.cos());
        let window = Window {
            origin: middle,
            along,
            across: DVec3::Y.cross(along),
            half_width: f64::INFINITY,
            from: f64::NEG_INFINITY,
        };
        match measure::grasp(thing, &window, jaw, thing.low.y + 0.003) {
            Ok(g) if best.as_ref().is_none_or(|b| g.section.straddle_m < b.section.straddle_m - 1e-6) => best = Some(g),
            Ok(_) => {}
            Err(why) => {
                let across = window.extent(thing, [thing.low.y, thing.high.y]).map_or(f64::INFINITY, |e| e[1] - e[0]);
                if thinnest.as_ref().is_none_or(|t| across < t.0) {
                    thinnest = Some((across, why));
                }
            }
        }
    }
    best.ok_or_else(|| thinnest.map_or_else(|| "it has no extent".to_owned(), |t| t.1))
}

/// Picks a thing that stands on another up.
///
/// # Errors
/// As [`draw_chair`].
pub fn pick(
    room: &Surroundings,
    model: &Model,
    object: Option<&str>,
    level: impl Fn(usize) -> Level,
) -> Result<Done, RobotError> {
    let jaw = Jaw::of(model)?;
    let stands =
        |k: &usize| matches!(room.things[*k].support, Support::Object { .. }) && level(*k) == Level::Decoration;
    let all: Vec<usize> = match object {
        Some(id) => vec![room.named(id)?],
        None => (0..room.things.len()).filter(stands).collect(),
    };
    let mut reasons: Vec<(String, RobotError)> = Vec::new();
    for k in all {
        let thing = &room.things[k];
        let forbidden = |why: String| RobotError::Forbidden { task: format!("{} cannot be picked up", thing.id), why };
        let tried = grasp_of(room, k, &jaw.size).map_err(&forbidden).and_then(|grasp| {
            let steps = ["approach", "descend and straddle", "close", "lift"];
            let way = Way::Straight(DVec3::Y * LIFT_M);
            let what = Carried { object: k, way, opened: 0.0, steps, task: "pick" };
            carry(room, model, &jaw, &Hold::from_above(&grasp), &what).map_err(&forbidden)
        });
        match tried {
            Ok(done) => return Ok(done),
            Err(e) => reasons.push((thing.id.clone(), e)),
        }
    }
    match reasons.len() {
        0 => Err(RobotError::Nothing { what: "decoration that stands on something".to_owned() }),
        1 => Err(reasons.remove(0).1),
        n => {
            let why = |(id, e): &(String, RobotError)| match e {
                RobotError::Forbidden { why, .. } => format!("{id}: {why}"),
                other => format!("{id}: {other}"),
            };
            let all: Vec<String> = reasons.iter().map(why).collect();
            Err(RobotError::Forbidden {
                task: format!("none of {n} decorations can be picked up"),
                why: all.join("; "),
            })
        }
    }
}
