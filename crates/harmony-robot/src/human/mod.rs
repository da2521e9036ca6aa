//! A humanoid that draws a chair, goes around it and sits down at the desk: the paper's eight steps.
//!
//! # Idea
//! Every place is measured: where the hands take the backrest, how far the chair must be drawn so that the legs pass
//! between it and the desk, where the seat carries the thighs, where the hands lie on the desk. A posture a frame is found
//! with the feet first, then the pelvis or the hands, then balance, then an easy posture ([`crate::ik`]).
//!
//! # Feet
//! The ankles have one joint: with a level pelvis both soles are flat only at the width of the hips. Feet slide on the
//! floor, one after the other, and never leave it, as in the paper ("both feet remain on the floor across all frames"): a
//! shuffle, not a gait.
//!
//! # Limits
//! Kinematics alone. The hands are balls that cannot grip: they lie on the backrest, and friction is taken to draw it.

mod body;
mod checks;
mod poses;
mod steps;

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use crate::RobotError;
use crate::measure::{self, Chair, Window};
use crate::model::Model;
use crate::motion::Done;
use crate::room::{Shapes, Surroundings};
use body::{Body, Stance, easy, like_a_person};
use poses::Plan;

/// The paper's steps.
const STEPS: [&str; 8] = [
    "crouch and reach the backrest",
    "draw the chair",
    "release and stand",
    "step around the chair",
    "cross to its front",
    "turn",
    "sit",
    "both hands on the desk",
];
/// Frames of each: 230, as in the paper.
const FRAMES: [usize; 8] = [30, 55, 20, 50, 25, 10, 25, 15];
/// Deepest that a link may be in anything, metres.
const DEEP_M: f64 = 0.01;
/// Hands are at the backrest when they are this near, metres.
const HANDS_M: f64 = 0.01;
/// Free way before and behind the feet between chair and desk, metres.
const PASS_M: f64 = 0.04;

/// Sits down at the desk.
///
/// # Errors
/// [`RobotError::Nothing`] without a chair, [`RobotError::NotThisRobot`] for a model that is no H1,
/// [`RobotError::Forbidden`] with the measurement that forbids it.
pub fn sit(room: &Surroundings, model: &Model, object: Option<&str>) -> Result<Done, RobotError> {
    let shapes = Arc::new(Shapes::of(model));
    let body = Body::of(model, &shapes)?;
    let all = match object {
        Some(id) => vec![room.named(id)?],
        None => room.chairs(),
    };
    let mut first = None;
    for k in all {
        let forbidden =
            |why: String| RobotError::Forbidden { task: format!("the robot cannot sit on {}", room.things[k].id), why };
        match sit_on(room, model, &body, &shapes, k).map_err(forbidden) {
            Ok(done) => return Ok(done),
            Err(e) => first = first.or(Some(e)),
        }
    }
    Err(first.unwrap_or_else(|| RobotError::Nothing { what: "chair".to_owned() }))
}

/// The desk in front of a chair.
struct Desk {
    thing: usize,
    /// Its near edge, from the middle of the seat towards the front, metres.
    edge: f64,
}

fn desk(room: &Surroundings, chair: &Chair, object: usize) -> Result<Desk, String> {
    let front = -chair.back;
    let mut best: Option<Desk> = None;
    for (k, thing) in room.things.iter().enumerate().filter(|(k, t)| *k != object && !t.flat) {
        if !harmony_catalogue::has(&thing.label, harmony_catalogue::Trait::Carries)
            || !(0.6..=0.9).contains(&thing.high.y)
        {
            continue;
        }
        let window = Window { origin: chair.seat.centre, along: front, across: chair.left, half_width: 0.3, from: 0.0 };
        if let Some([edge, _]) = window.extent(thing, [thing.high.y - 0.04, thing.high.y])
            && edge < 1.5
            && best.as_ref().is_none_or(|b| edge < b.edge)
        {
            best = Some(Desk { thing: k, edge });
        }
    }
    best.ok_or_else(|| {
        "within 1.5 m of the front of its seat is no desk or table between 0.6 and 0.9 m high".to_owned()
    })
}

fn sit_on(
    room: &Surroundings,
    model: &Model,
    body: &Body,
    shapes: &Arc<Shapes>,
    object: usize,
) -> Result<Done, String> {
    let person = like_a_person(model);
    let thing = &room.things[object];
    let chair = measure::chair(thing)?;
    let desk = desk(room, &chair, object)?;
    let front = -chair.back;
    // The gap between the seat's front and the desk that the feet need.
    let needed = body.foot[1] - body.foot[0] + 2.0 * PASS_M;
    let draw = (needed - (desk.edge - chair.front_m)).max(0.0);
    let steps = (draw / 0.03).ceil() as usize;
    for step in 1..=steps {
        let way = draw * step as f64 / steps as f64;
        if let Some(other) = room.met_by(object, DAffine3::from_translation(chair.back * way)) {
            return Err(format!(
                "the feet need {needed:.2} m between its seat and the desk, so it must be drawn {draw:.2} m, and after \
                 {way:.2} m it meets {}",
                room.name(other)
            ));
        }
    }
    let mut plan = Plan {
        room,
        whole: model,
        model: &person,
        shapes,
        body,
        object,
        chair: chair.clone(),
        front,
        draw,
        easy: easy(model),
        first: None,
        frames: vec![],
        feet: [Stance { at: DVec3::ZERO, facing: front }; 2],
        rise: 0.0,
    };
    let reached = plan.reach_and_draw()?;
    let mut why: Vec<String> = Vec::new();
    for side in [1.0, -1.0] {
        for turn in [0.66, 0.33, 0.0] {
            match plan.clone().go_around_and_sit(&desk, &reached, side, turn) {
                Ok(done) => return Ok(done),
                Err(e) => why.push(e),
            }
        }
    }
    why.sort();
    why.dedup();
    Err(why.join("; or: "))
}
