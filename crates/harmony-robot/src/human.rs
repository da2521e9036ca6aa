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

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3};

use crate::RobotError;
use crate::arm::{Done, chairs};
use crate::ik::{Found, Goal, Settings, Task, solve};
use crate::measure::{self, Chair, Window};
use crate::model::{Form, Model, Posture, upright};
use crate::motion::{Evidence, Frame, MISSED, Motion, evidence, smooth};
use crate::room::{Other, Shapes, Surroundings};
use crate::shapes::pieces;

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
/// Longest stride, metres.
const STRIDE_M: f64 = 0.22;
/// The pelvis is this much below where the legs are straight while standing, metres.
const EASY_M: f64 = 0.05;
/// And this much higher from the side of the chair on, where knees must not reach the desk.
const RISE_M: f64 = 0.03;
/// Farthest that an idle joint moves in a frame, radians.
const EASE_RAD: f64 = 0.06;
/// Elbows of who sits: the forearms are above the seat and its arms, radians.
const LAP_RAD: f64 = 0.35;
/// Offsets of the hands from the middle of the chair and the desk that are tried, metres.
const ASIDE_M: [f64; 4] = [0.22, 0.18, 0.27, 0.14];

/// The links of a humanoid that matter.
struct Body {
    feet: [usize; 2],
    hands: [usize; 2],
    /// Middle of each hand, its link's frame.
    palm: DVec3,
    /// Radius of the hand.
    radius: f64,
    /// Links that rest on a seat.
    seated: Vec<usize>,
    thighs: [usize; 2],
    /// Height of the pelvis above the hip axes, and how far those are before it and beside it.
    hip: DVec3,
    /// From the ankle to the sole.
    sole: f64,
    /// Heel and toe from the ankle along the foot.
    foot: [f64; 2],
    /// Half the width of a foot.
    foot_half: f64,
    /// Straight legs, from the hip axis to the ankle.
    leg: f64,
}

impl Body {
    fn of(model: &Model) -> Result<Self, RobotError> {
        let part = |name: &str| {
            model.link(name).ok_or_else(|| RobotError::NotThisRobot {
                model: model.name.clone(),
                part: format!("link {name}"),
                robot: "Unitree H1",
            })
        };
        let both = |name: &str| -> Result<[usize; 2], RobotError> {
            Ok([part(&format!("left_{name}"))?, part(&format!("right_{name}"))?])
        };
        let (feet, hands, thighs) = (both("ankle_link")?, both("elbow_link")?, both("hip_pitch_link")?);
        let mut seated = vec![part("pelvis")?];
        for name in ["hip_yaw_link", "hip_roll_link", "hip_pitch_link"] {
            seated.extend(both(name)?);
        }
        let ball = model.links[hands[0]].geoms.iter().rev().find_map(|g| match g.form {
            Form::Sphere(radius) if !g.visual => Some((g.link_from_geom.translation, radius)),
            _ => None,
        });
        let (palm, radius) = ball.ok_or_else(|| RobotError::NotThisRobot {
            model: model.name.clone(),
            part: "ball at the end of its forearm".to_owned(),
            robot: "Unitree H1",
        })?;
        let rest = Posture { root: DAffine3::IDENTITY, joints: vec![0.0; model.joints.len()] };
        let places = model.places(&rest);
        let hip = places[thighs[0]].translation;
        let leg = hip.z - places[feet[0]].translation.z;
        let shapes = Shapes::new(&pieces(model));
        let (low, high) = shapes
            .corners(feet[0], &DAffine3::IDENTITY)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        Ok(Self {
            feet,
            hands,
            palm,
            radius,
            seated,
            thighs,
            hip,
            sole: -low.z,
            foot: [low.x, high.x],
            foot_half: (high.y - low.y) / 2.0,
            leg,
        })
    }

    /// Height of the pelvis when standing.
    fn standing(&self) -> f64 {
        self.sole + self.leg - self.hip.z - EASY_M
    }
}

/// Where both feet stand: the middle between the ankles, and where the robot faces.
#[derive(Debug, Clone, Copy)]
struct Stance {
    at: DVec3,
    facing: DVec3,
}

impl Stance {
    fn left(&self) -> DVec3 {
        DVec3::Y.cross(self.facing)
    }
}

/// The room turned into the chair's: `front` is where one looks who sits on it.
struct Plan<'a> {
    room: &'a Surroundings,
    model: &'a Model,
    shapes: &'a Shapes,
    body: &'a Body,
    object: usize,
    chair: Chair,
    front: DVec3,
    /// How far the chair is drawn.
    draw: f64,
    easy: Vec<f64>,
    frames: Vec<Frame>,
    feet: [Stance; 2],
    /// How much higher than at first the pelvis is.
    rise: f64,
}

/// Sits down at the desk.
///
/// # Errors
/// [`RobotError::Nothing`] without a chair, [`RobotError::NotThisRobot`] for a model that is no H1,
/// [`RobotError::Forbidden`] with the measurement that forbids it.
pub fn sit(room: &Surroundings, model: &Model, object: Option<&str>) -> Result<Done, RobotError> {
    let body = Body::of(model)?;
    let shapes = Shapes::new(&pieces(model));
    let all = match object {
        Some(id) => vec![room.named(id)?],
        None => chairs(room),
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

fn sit_on(room: &Surroundings, model: &Model, body: &Body, shapes: &Shapes, object: usize) -> Result<Done, String> {
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
        if let Some((other, distance)) = room.nearest_of_thing(object, chair.back * way)
            && distance <= 0.0
        {
            return Err(format!(
                "the feet need {needed:.2} m between its seat and the desk, so it must be drawn {draw:.2} m, and after \
                 {way:.2} m it meets {}",
                room.name(other)
            ));
        }
    }
    let mut why: Vec<String> = Vec::new();
    for side in [1.0, -1.0] {
        for turn in [0.66, 0.33, 0.0] {
            let start = Stance { at: DVec3::ZERO, facing: front };
            let mut plan = Plan {
                room,
                model,
                shapes,
                body,
                object,
                chair: chair.clone(),
                front,
                draw,
                easy: easy(model),
                frames: vec![],
                feet: [start; 2],
                rise: 0.0,
            };
            match plan.all(&desk, side, turn) {
                Ok(done) => return Ok(done),
                Err(e) => why.push(e),
            }
        }
    }
    why.sort();
    why.dedup();
    Err(why.join("; or: "))
}

/// Arms beside the body.
fn easy(model: &Model) -> Vec<f64> {
    let mut out = model.rest();
    for (name, value) in
        [("left_elbow", 1.35), ("right_elbow", 1.35), ("left_shoulder_pitch", 0.12), ("right_shoulder_pitch", 0.12)]
    {
        if let Some(k) = model.joint(name) {
            out[k] = model.joints[k].clamped(value);
        }
    }
    out
}

/// What is wanted of a frame besides the feet.
#[derive(Clone)]
struct Want {
    /// Where the pelvis is.
    pelvis: DVec3,
    /// Its level: 1 where it decides, 3 where it follows.
    level: usize,
    facing: DVec3,
    /// Lean forward, radians.
    lean: f64,
    hands: Option<[DVec3; 2]>,
    /// Whether the hands are only on their way there.
    passing: bool,
    balance: bool,
}

impl Plan<'_> {
    /// Middle of the hip axes, the pelvis' frame.
    fn hip_axes(&self) -> DVec3 {
        DVec3::new(self.body.hip.x, 0.0, self.body.hip.z)
    }

    /// Where a foot's ankle is.
    fn ankle(&self, foot: usize, stance: &Stance) -> DVec3 {
        let side = if foot == 0 { self.body.hip.y.abs() } else { -self.body.hip.y.abs() };
        stance.at + stance.left() * side + DVec3::Y * self.body.sole
    }

    /// A point from the middle of the drawn seat: towards the front, and to the left of who sits.
    fn spot(&self, front: f64, left: f64) -> DVec3 {
        let c = self.chair.seat.centre + self.chair.back * self.draw;
        let p = c + self.front * front + self.chair.left * left;
        DVec3::new(p.x, 0.0, p.z)
    }

    fn solve(&self, start: &Posture, want: &Want) -> Found {
        self.solve_near(start, want, &self.easy)
    }

    /// With another easy posture.
    fn solve_near(&self, start: &Posture, want: &Want, easy: &[f64]) -> Found {
        let mut tasks = Vec::new();
        for (k, link) in self.body.feet.into_iter().enumerate() {
            let stance = &self.feet[k];
            tasks.push(Task::new(0, Goal::Point { link, point: DVec3::ZERO, target: self.ankle(k, stance) }));
            tasks.push(Task::new(0, Goal::Turn { link, target: upright(DVec3::ZERO, stance.facing).matrix3 }));
        }
        // The pelvis is held where its hip axes are: it may lean about them.
        let hip = self.hip_axes();
        let level = upright(DVec3::ZERO, want.facing).matrix3;
        let hips = want.pelvis + level * hip;
        tasks.push(Task::new(want.level, Goal::Point { link: 0, point: hip, target: hips }));
        if let Some(hands) = want.hands {
            for (k, target) in hands.into_iter().enumerate() {
                tasks.push(Task::new(2, Goal::Point { link: self.body.hands[k], point: self.body.palm, target }));
            }
        }
        if want.balance {
            let target = self.middle();
            tasks.push(Task::weighted(3, Goal::CentreOfMass { target }, DVec3::ONE));
        }
        let leaning = level * DMat3::from_rotation_y(want.lean);
        tasks.push(Task::weighted(4, Goal::Turn { link: 0, target: leaning }, DVec3::splat(0.5)));
        tasks.push(Task::new(5, Goal::Joints { target: easy.to_vec() }));
        let must = if want.hands.is_some() && !want.passing { 3 } else { 1 + usize::from(want.level == 1) };
        solve(self.model, start, &tasks, &Settings { steps: 150, must, tolerance: 1e-5 })
    }

    /// Middle of the feet's soles.
    fn middle(&self) -> DVec3 {
        let along = f64::midpoint(self.body.foot[0], self.body.foot[1]);
        (0..2).map(|k| self.ankle(k, &self.feet[k]) + self.feet[k].facing * along).sum::<DVec3>() / 2.0
    }

    fn put(&mut self, step: usize, want: &Want, moved: f64, touching: &[usize], held: bool) -> Result<(), String> {
        let start = match self.frames.last() {
            Some(f) => f.posture.clone(),
            None => Posture { root: upright(want.pelvis, want.facing), joints: self.easy.clone() },
        };
        // Joints that nothing asks for go to the easy posture by a little a frame.
        let near = |(easy, now): (&f64, &f64)| now + (easy - now).clamp(-EASE_RAD, EASE_RAD);
        let easy: Vec<f64> = self.easy.iter().zip(&start.joints).map(near).collect();
        let found = self.solve_near(&start, want, &easy);
        if found.error > 1e-3 {
            return Err(format!(
                "in step {} (\"{}\") the robot misses its goal by {:.1} mm",
                step + 1,
                STEPS[step],
                1e3 * found.error
            ));
        }
        let moved = self.chair.back * moved;
        self.frames.push(Frame {
            step,
            posture: found.posture,
            moved,
            error: found.error,
            touching: touching.to_vec(),
            held,
        });
        Ok(())
    }

    fn upright_at(&self, stance: &Stance) -> Want {
        Want {
            pelvis: stance.at + DVec3::Y * (self.body.standing() + self.rise),
            level: 1,
            facing: stance.facing,
            lean: 0.0,
            hands: None,
            passing: false,
            balance: false,
        }
    }

    /// Shuffles from where the feet are along stances; `hands` are taken along when the chair is drawn.
    fn shuffle(
        &mut self,
        step: usize,
        frames: usize,
        way: &[Stance],
        drawn: Option<([DVec3; 2], f64)>,
    ) -> Result<(), String> {
        let from = Stance {
            at: (self.feet[0].at + self.feet[1].at) / 2.0,
            facing: (self.feet[0].facing + self.feet[1].facing).normalize_or(self.front),
        };
        let mut all = vec![from];
        all.extend_from_slice(way);
        let strides = strides(&all);
        for k in 0..frames {
            let t = (k + 1) as f64 / frames as f64 * (strides.len() - 1) as f64;
            let n = (t.floor() as usize).min(strides.len() - 2);
            let part = t - n as f64;
            let between = |p: f64| mix(&strides[n], &strides[n + 1], smooth(p));
            let body = mix(&strides[n], &strides[n + 1], part);
            // Forwards the left foot goes in the first half of a stride and the right in the second; sideways and in turns
            // both go with the body, for they must stay as far apart as the hips.
            let foot = |p: f64| {
                let ahead = (between(p.clamp(0.0, 1.0)).at - body.at).dot(body.facing);
                Stance { at: body.at + body.facing * ahead, facing: body.facing }
            };
            self.feet = [foot(2.0 * part), foot(2.0 * part - 1.0)];
            if step == 3 {
                self.rise = RISE_M * smooth((k + 1) as f64 / frames as f64);
            }
            let mut want = self.upright_at(&body);
            let mut moved = self.frames.last().map_or(0.0, |f| f.moved.dot(self.chair.back));
            let mut touching: Vec<usize> = Vec::new();
            if let Some((hands, height)) = drawn {
                moved = (body.at - from.at).dot(self.chair.back);
                want.hands = Some(hands.map(|h| h + self.chair.back * moved));
                want.pelvis.y = height;
                want.level = 3;
                touching = self.body.hands.to_vec();
            }
            let held = k + 1 == frames;
            want.balance = drawn.is_some();
            self.put(step, &want, moved, &touching, held)?;
        }
        Ok(())
    }

    /// Distance of one link to a thing where it is in a frame.
    fn gap(&self, posture: &Posture, links: &[usize], thing: usize, moved: f64) -> f64 {
        let only = |l: usize, o: Other| links.contains(&l) && o == Other::Thing(thing);
        let moved = Some((self.object, self.chair.back * moved));
        self.room.nearest(self.shapes, &self.model.places(posture), moved, 0.3, &only).map_or(0.3, |n| n.distance)
    }

    /// Targets of both hands, each lowered or raised until its link lies on a thing.
    fn lay(&self, start: &Posture, want: &Want, thing: usize, moved: f64) -> (Want, Found) {
        let mut want = want.clone();
        let mut found = self.solve(start, &want);
        for _ in 0..8 {
            let gaps = self.body.hands.map(|h| self.gap(&found.posture, &[h], thing, moved) - 0.001);
            if let Some(hands) = &mut want.hands {
                for (h, gap) in hands.iter_mut().zip(gaps) {
                    h.y -= gap.clamp(-0.05, 0.05);
                }
            }
            if gaps.iter().all(|g| g.abs() < 5e-4) {
                break;
            }
            found = self.solve(&found.posture, &want);
        }
        (want, found)
    }

    /// Points on top of a thing for both hands, room, as it stands; the measured top.
    fn tops(&self, thing: usize, at: DVec3, along: DVec3, across: DVec3, band: f64) -> Option<[DVec3; 2]> {
        ASIDE_M.into_iter().find_map(|aside| {
            let one = |sign: f64| -> Option<DVec3> {
                let origin = at + across * (sign * aside);
                let window = Window { origin, along, across, half_width: 0.02, from: -0.05 };
                let t = &self.room.things[thing];
                let top = window.top(t)?;
                let [a, b] = window.extent(t, [top - band, top])?;
                let p = origin + along * f64::midpoint(a, b);
                Some(DVec3::new(p.x, top, p.z))
            };
            Some([one(1.0)?, one(-1.0)?])
        })
    }

    fn all(&mut self, desk: &Desk, side: f64, turn: f64) -> Result<Done, String> {
        // 1 and 2: reach and draw.
        let (hands, drawn) = self.reach_and_draw()?;
        // 3: release and stand.
        let last = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
        // Where an upright pelvis has its hip axes where those of the leaning one are: from there it goes on without a jump.
        let hip = self.hip_axes();
        let pelvis = last.root.transform_point3(hip) - upright(DVec3::ZERO, drawn.facing).matrix3 * hip;
        let beside = {
            let places = self.model.places(&self.solve(&last, &self.upright_at(&drawn)).posture);
            self.body.hands.map(|h| places[h].transform_point3(self.body.palm))
        };
        for k in 0..FRAMES[2] {
            let part = smooth((k + 1) as f64 / FRAMES[2] as f64);
            let mut want = self.upright_at(&drawn);
            want.pelvis = pelvis.lerp(want.pelvis, part);
            // Up first, then back behind the backrest, then down beside the body.
            let t = (k + 1) as f64 / FRAMES[2] as f64;
            let (up, back, down) = (smooth(t / 0.3), smooth((t - 0.2) / 0.4), smooth((t - 0.55) / 0.45));
            want.hands = Some(std::array::from_fn(|i| {
                let free = hands[i] + self.chair.back * (self.draw + 0.22 * back) + DVec3::Y * 0.15 * up;
                free.lerp(beside[i], down)
            }));
            want.passing = true;
            self.put(2, &want, self.draw, &[], k + 1 == FRAMES[2])?;
        }
        // 4 to 6: around it, across, and turned to the desk.
        let thing = &self.room.things[self.object];
        let corners = [thing.low.x, thing.high.x]
            .into_iter()
            .flat_map(|x| [thing.low.z, thing.high.z].map(|z| DVec3::new(x, 0.0, z)));
        let from = self.chair.seat.centre;
        let half = corners.clone().map(|c| ((c - from).dot(self.chair.left) * side).max(0.0)).fold(0.0, f64::max);
        let own = self.body.hip.y.abs() + self.body.foot_half + 0.03;
        let aside = side * (half + own + 0.05);
        let behind = (drawn.at - self.spot(0.0, 0.0)).dot(self.front);
        // The heels are free of the seat's front.
        let ahead = self.chair.front_m + PASS_M - self.body.foot[0];
        let across = -self.chair.left * side;
        let turned = (self.front * (1.0 - turn) + across * turn).normalize_or(self.front);
        let along = |f: f64, l: f64, facing| Stance { at: self.spot(f, l), facing };
        let way = [along(behind, aside, self.front), along(ahead, aside, self.front), along(ahead, aside, turned)];
        let (cross, seat) = (along(ahead, 0.0, turned), along(ahead, 0.0, self.front));
        self.shuffle(3, FRAMES[3], &way, None)?;
        self.shuffle(4, FRAMES[4], &[cross], None)?;
        self.shuffle(5, FRAMES[5], &[seat], None)?;
        self.clear(0..6)?;
        self.met()?;
        let (sitting, depth) = self.sit_down(desk, &seat)?;
        self.finish(desk, &sitting, depth, turn)
    }

    /// Steps 1 and 2: where to stand, the hands on the backrest, and the chair drawn; the first place from which the way
    /// back is free, too.
    fn reach_and_draw(&mut self) -> Result<([DVec3; 2], Stance), String> {
        let top_at = self.chair.seat.centre;
        let tops = self
            .tops(self.object, DVec3::new(top_at.x, 0.0, top_at.z), self.chair.back, self.chair.left, 0.01)
            .ok_or("there is no backrest 0.14 m to the left and right of its middle")?;
        let rear = tops.iter().map(|t| (*t - top_at).dot(self.chair.back)).fold(0.0, f64::max);
        let high = tops[0].y.max(tops[1].y);
        // The robot faces the chair's back: its left is the sitter's left.
        let (mut why, mut least) = (String::new(), f64::INFINITY);
        for away in [0.36, 0.32, 0.40, 0.44, 0.48, 0.28] {
            for crouch in [0.10, 0.16, 0.22, 0.05] {
                let p = top_at + self.chair.back * (rear + away);
                let stance = Stance { at: DVec3::new(p.x, 0.0, p.z), facing: self.front };
                self.feet = [stance; 2];
                let mut want = self.upright_at(&stance);
                let standing = want.pelvis;
                let first = Posture { root: upright(standing, self.front), joints: self.easy.clone() };
                let stood = self.solve(&first, &want);
                want.pelvis.y -= crouch;
                want.level = 3;
                want.balance = true;
                want.hands = Some(tops.map(|t| t + DVec3::Y * self.body.radius));
                let (want, found) = self.lay(&stood.posture, &want, self.object, 0.0);
                let gaps = self.body.hands.map(|h| self.gap(&found.posture, &[h], self.object, 0.0));
                let rest = |l: usize, o: Other| match o {
                    Other::Thing(k) => k != self.object || !self.body.hands.contains(&l),
                    Other::Face(name) => name != "floor" || !self.body.feet.contains(&l),
                };
                let near = self.room.nearest(self.shapes, &self.model.places(&found.posture), None, 0.1, &rest);
                let clear = near.map_or(0.1, |n| n.distance);
                if found.error > 1e-4 || gaps.iter().any(|g| g.abs() > HANDS_M) || clear < 0.0 {
                    // The one that came nearest to being possible speaks.
                    let short = found.error.max(-clear).max(gaps[0].abs() - HANDS_M);
                    if short < least {
                        least = short;
                        let near = near.map_or_else(String::new, |n| {
                            format!(
                                "; {:.0} mm from {} to {}",
                                1e3 * n.distance,
                                self.model.links[n.link].name,
                                self.room.name(n.other)
                            )
                        });
                        why = format!(
                            "with the feet {away:.2} m behind its backrest the hands miss its top at {high:.2} m by {:.0} mm{near}",
                            1e3 * (found.error + gaps[0].abs().max(gaps[1].abs()))
                        );
                    }
                    continue;
                }
                let (Some(hands), crouched) = (want.hands, found.posture.root.translation.y) else { continue };
                // From standing to there, the hands from above.
                let easy_hands = {
                    let places = self.model.places(&stood.posture);
                    self.body.hands.map(|h| places[h].transform_point3(self.body.palm))
                };
                let mut reached = Ok(());
                for k in 0..FRAMES[0] {
                    let t = k as f64 / (FRAMES[0] - 1) as f64;
                    let (down, over) = (smooth((t - 0.5) * 2.0), smooth(t * 2.0));
                    let mut want = want.clone();
                    want.pelvis = standing.lerp(want.pelvis, smooth(t));
                    let above = |h: DVec3| h + DVec3::Y * 0.10 + self.chair.back * 0.02;
                    let at: [DVec3; 2] =
                        std::array::from_fn(|i| easy_hands[i].lerp(above(hands[i]), over).lerp(hands[i], down));
                    want.hands = Some(at);
                    let last = k + 1 == FRAMES[0];
                    want.passing = !last;
                    let touching = if last { self.body.hands.to_vec() } else { vec![] };
                    reached = reached.and_then(|()| self.put(0, &want, 0.0, &touching, last || k == 0));
                }
                let drawn = Stance { at: stance.at + self.chair.back * self.draw, ..stance };
                let all = reached
                    .and_then(|()| self.shuffle(1, FRAMES[1], &[drawn], Some((hands, crouched))))
                    .and_then(|()| self.clear(0..2))
                    .and_then(|()| self.met());
                match all {
                    Ok(()) => return Ok((hands, drawn)),
                    // It came further than those that do not reach the backrest: it speaks.
                    Err(e) => (why, least) = (e, f64::NEG_INFINITY),
                }
                self.frames.clear();
            }
        }
        Err(why)
    }

    /// Whether frames so far meet their goals, else how far the worst is off.
    fn met(&self) -> Result<(), String> {
        let worst = self.frames.iter().enumerate().max_by(|a, b| a.1.error.total_cmp(&b.1.error));
        match worst.filter(|(_, f)| f.error > MISSED) {
            None => Ok(()),
            Some((number, frame)) => Err(format!(
                "in step {} (\"{}\") the robot misses its goal by {:.1} mm (frame {number})",
                frame.step + 1,
                STEPS[frame.step],
                1e3 * frame.error
            )),
        }
    }

    /// Whether frames so far are free, else which is not.
    fn clear(&self, steps: std::ops::Range<usize>) -> Result<(), String> {
        for (number, frame) in self.frames.iter().enumerate().filter(|(_, f)| steps.contains(&f.step)) {
            let looks = |l: usize, o: Other| !self.bears(frame, l, o) && !self.touches(frame, l, o);
            let moved = Some((self.object, frame.moved));
            let places = self.model.places(&frame.posture);
            if let Some(near) = self.room.nearest(self.shapes, &places, moved, 0.05, &looks)
                && near.distance < -DEEP_M
            {
                return Err(format!(
                    "in step {} (\"{}\") {} is {:.0} mm in {} (frame {number})",
                    frame.step + 1,
                    STEPS[frame.step],
                    self.model.links[near.link].name,
                    -1e3 * near.distance,
                    self.room.name(near.other)
                ));
            }
        }
        Ok(())
    }

    fn touches(&self, frame: &Frame, link: usize, other: Other) -> bool {
        other == Other::Thing(self.object) && frame.touching.contains(&link)
    }

    /// What bears the robot: the floor its feet, the seat what sits on it.
    fn bears(&self, frame: &Frame, link: usize, other: Other) -> bool {
        bears(self.body, self.object, frame, link, other)
    }

    /// Steps 7: how deep on the seat, and the postures down to it.
    fn sit_down(&mut self, desk: &Desk, seat: &Stance) -> Result<(Posture, f64), String> {
        let stood = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
        for name in ["left_elbow", "right_elbow"] {
            if let Some(k) = self.model.joint(name) {
                self.easy[k] = LAP_RAD;
            }
        }
        let standing = self.upright_at(seat).pelvis;
        let mut why = String::new();
        for depth in [0.24, 0.20, 0.16, 0.12, 0.09] {
            // The hip axes are this far behind the front edge of the seat.
            let on = self.spot(self.chair.front_m - depth, 0.0) - self.front * self.body.hip.x;
            let (mut low, mut high) =
                (self.chair.seat.height_m - self.body.hip.z - 0.05, self.chair.seat.height_m - self.body.hip.z + 0.25);
            let mut found: Option<Found> = None;
            let mut from = stood.clone();
            // Part of the way first: a seat is far from standing.
            for part in [0.3, 0.6, 0.85] {
                let mut want = self.upright_at(seat);
                want.pelvis = standing.lerp(DVec3::new(on.x, high, on.z), part);
                from = self.solve(&from, &want).posture;
            }
            for _ in 0..14 {
                let y = f64::midpoint(low, high);
                let mut want = self.upright_at(seat);
                want.pelvis = DVec3::new(on.x, y, on.z);
                let tried = self.solve(&from, &want);
                if self.gap(&tried.posture, &self.body.seated, self.object, self.draw) > 5e-4 {
                    high = y;
                } else {
                    low = y;
                }
                if tried.error < 1e-4 {
                    from = tried.posture.clone();
                }
                found = Some(tried);
            }
            let Some(found) = found.filter(|f| f.error < 1e-4) else {
                why =
                    format!("with the hips {depth:.2} m behind the front of the seat the feet do not reach the floor");
                continue;
            };
            let gap = self.gap(&found.posture, &self.body.thighs, self.object, self.draw);
            if gap > DEEP_M {
                why = format!(
                    "with the hips {depth:.2} m behind the front of the seat at {:.2} m the thighs are {:.0} mm above it",
                    self.chair.seat.height_m,
                    1e3 * gap
                );
                continue;
            }
            let target = DVec3::new(on.x, high, on.z);
            if let Err(e) = self.desk_hands(desk, &found.posture, target, seat) {
                why = e;
                continue;
            }
            for k in 0..FRAMES[6] {
                let t = (k + 1) as f64 / FRAMES[6] as f64;
                let mut want = self.upright_at(seat);
                // Back first, then down.
                let (out, down) = (smooth((1.25 * t).min(1.0)), smooth(t));
                want.pelvis = DVec3::new(
                    standing.x + (target.x - standing.x) * out,
                    standing.y + (target.y - standing.y) * down,
                    standing.z + (target.z - standing.z) * out,
                );
                want.lean = 0.35 * (std::f64::consts::PI * t).sin();
                self.put(6, &want, self.draw, &[], k + 1 == FRAMES[6])?;
            }
            let last = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
            return Ok((last, depth));
        }
        Err(why)
    }

    /// Postures with both hands on the desk.
    fn desk_hands(&self, desk: &Desk, seated: &Posture, pelvis: DVec3, seat: &Stance) -> Result<(Want, Found), String> {
        let thing = &self.room.things[desk.thing];
        let mut best: Option<(f64, String)> = None;
        for inward in [0.05, 0.08, 0.11, 0.14] {
            for aside in ASIDE_M {
                let at = |sign: f64| {
                    let p =
                        self.chair.seat.centre + self.front * (desk.edge + inward) + self.chair.left * (sign * aside);
                    DVec3::new(p.x, thing.high.y + self.body.radius, p.z)
                };
                let hands = [at(1.0), at(-1.0)];
                let taken = hands.iter().find_map(|h| {
                    let over = |t: &&crate::room::Thing| {
                        let flat = DVec3::new(h.x, t.low.y, h.z);
                        t.low.y > thing.high.y - 0.05
                            && t.low.y < h.y + 0.1
                            && flat.distance(flat.clamp(t.low, t.high)) < 0.06
                    };
                    self.room.things.iter().find(over)
                });
                if let Some(t) = taken {
                    best = best.or(Some((f64::INFINITY, format!("{} lies where a hand would on {}", t.id, thing.id))));
                    continue;
                }
                let mut want = self.upright_at(seat);
                want.pelvis = pelvis;
                want.lean = 0.1;
                want.hands = Some(hands);
                let (want, found) = self.lay(seated, &want, desk.thing, self.draw);
                let gaps = self.body.hands.map(|h| self.gap(&found.posture, &[h], desk.thing, self.draw));
                if found.error < 1e-4 && gaps.iter().all(|g| g.abs() < HANDS_M) {
                    return Ok((want, found));
                }
                if best.as_ref().is_none_or(|b| found.error < b.0) {
                    best = Some((
                        found.error,
                        format!(
                            "seated, the hands miss {} by {:.0} mm {:.2} m behind its edge",
                            thing.id,
                            1e3 * found.error,
                            inward
                        ),
                    ));
                }
            }
        }
        Err(best.map_or_else(|| "there is no room for the hands on the desk".to_owned(), |b| b.1))
    }

    fn finish(&mut self, desk: &Desk, sitting: &Posture, depth: f64, turn: f64) -> Result<Done, String> {
        let seat = self.feet[0];
        let places = self.model.places(sitting);
        let start_hands = self.body.hands.map(|h| places[h].transform_point3(self.body.palm));
        let pelvis = {
            let hip = DVec3::new(self.body.hip.x, 0.0, self.body.hip.z);
            sitting.root.transform_point3(hip) - upright(DVec3::ZERO, self.front).matrix3 * hip
        };
        let (want, _) = self.desk_hands(desk, sitting, pelvis, &seat)?;
        let goal = want.hands.ok_or("no hands")?;
        for k in 0..FRAMES[7] {
            let t = (k + 1) as f64 / FRAMES[7] as f64;
            let (over, down) = (smooth((1.5 * t).min(1.0)), smooth((t - 0.6) / 0.4));
            let mut want = want.clone();
            want.hands = Some(std::array::from_fn(|i| {
                let above = goal[i] + DVec3::Y * 0.08;
                start_hands[i].lerp(above, over).lerp(goal[i], down)
            }));
            want.lean *= smooth(t);
            want.passing = k + 1 < FRAMES[7];
            self.put(7, &want, self.draw, &[], k + 1 == FRAMES[7])?;
        }
        self.clear(0..8)?;
        let last = self.frames.last().map(|f| f.posture.clone()).ok_or("no frame")?;
        let on_desk = self.body.hands.map(|h| self.gap(&last, &[h], desk.thing, self.draw));
        let thighs = self.body.thighs.map(|t| self.gap(&last, &[t], self.object, self.draw));
        let motion = Motion {
            model: self.model.clone(),
            task: "sit".to_owned(),
            object: self.object,
            steps: STEPS.to_vec(),
            frames: std::mem::take(&mut self.frames),
            column_m: 0.0,
        };
        let bears = |f: &Frame, l: usize, o: Other| {
            bears(self.body, self.object, f, l, o)
                || o == Other::Thing(desk.thing) && f.step == 7 && f.held && self.body.hands.contains(&l)
        };
        let found: Evidence = evidence(self.room, self.shapes, &motion, &bears);
        if found.smallest_clearance_m < -DEEP_M {
            return Err(format!("{} are {:.0} mm in each other", found.nearest, -1e3 * found.smallest_clearance_m));
        }
        let (off_floor, deepest_seat) = self.floor_and_seat(&motion);
        let measured = BTreeMap::from([
            ("drawn_m".to_owned(), self.draw),
            ("seat_height_m".to_owned(), self.chair.seat.height_m),
            ("hips_behind_seat_front_m".to_owned(), depth),
            ("backrest_top_m".to_owned(), self.chair.top_m),
            ("hands_to_backrest_m".to_owned(), found.largest_gap_m.max(found.deepest_touch_m)),
            ("hands_to_desk_m".to_owned(), on_desk[0].abs().max(on_desk[1].abs())),
            ("thighs_to_seat_m".to_owned(), thighs[0].abs().max(thighs[1].abs())),
            ("deepest_in_seat_m".to_owned(), deepest_seat),
            ("feet_off_floor_m".to_owned(), off_floor),
            ("balance_margin_m".to_owned(), self.balance(&motion)),
            ("turned_while_crossing_rad".to_owned(), turn * std::f64::consts::FRAC_PI_2),
        ]);
        let because = vec![
            format!(
                "the chair is drawn {:.2} m: the feet are {:.2} m long and need {PASS_M} m before and behind them between the \
                 front of the seat and {}",
                self.draw,
                self.body.foot[1] - self.body.foot[0],
                self.room.things[desk.thing].id
            ),
            format!("the seat is at {:.3} m, {:.2} m2 of it level", self.chair.seat.height_m, self.chair.seat.area_m2),
            "the feet slide on the floor one after the other and are as far apart as the hips: the ankles have one joint".to_owned(),
        ];
        Ok(Done { motion, evidence: found, measured, because })
    }

    /// Farthest that a sole is from the floor, and deepest that what sits is in the seat.
    fn floor_and_seat(&self, motion: &Motion) -> (f64, f64) {
        let (mut floor, mut seat) = (0.0_f64, 0.0_f64);
        for frame in &motion.frames {
            let places = self.model.places(&frame.posture);
            for foot in self.body.feet {
                let low = self.shapes.corners(foot, &places[foot]).map(|p| p.y).fold(f64::INFINITY, f64::min);
                floor = floor.max(low.abs());
            }
            if frame.step >= 6 {
                seat = seat.max(-self.gap(&frame.posture, &self.body.seated, self.object, self.draw));
            }
        }
        (floor, seat)
    }

    /// Smallest distance of the centre of mass to the edge of what bears the robot, in poses that are held.
    fn balance(&self, motion: &Motion) -> f64 {
        let mut least = f64::INFINITY;
        for frame in motion.frames.iter().filter(|f| f.held) {
            let places = self.model.places(&frame.posture);
            let mut points: Vec<DVec3> = Vec::new();
            for foot in self.body.feet {
                points.extend(self.shapes.corners(foot, &places[foot]).filter(|p| p.y < 0.01));
            }
            if frame.step >= 6 {
                // What lies on the seat.
                let top = self.chair.seat.height_m + 0.03;
                for link in &self.body.seated {
                    points.extend(self.shapes.corners(*link, &places[*link]).filter(|p| p.y < top && p.y > 0.3));
                }
            }
            least = least.min(inside(&points, self.model.centre_of_mass(&places)));
        }
        least
    }
}

fn bears(body: &Body, object: usize, frame: &Frame, link: usize, other: Other) -> bool {
    match other {
        Other::Face(name) => name == "floor" && body.feet.contains(&link),
        Other::Thing(k) => k == object && frame.step >= 6 && body.seated.contains(&link),
    }
}

/// How far a point is inside the convex outline of points on the floor, metres; below 0 outside.
fn inside(points: &[DVec3], p: DVec3) -> f64 {
    // The outline's supporting lines in 72 directions: a margin that is at most a part in a thousand too large.
    (0..72)
        .map(|k| {
            let a = std::f64::consts::TAU * f64::from(k) / 72.0;
            let d = DVec3::new(a.cos(), 0.0, a.sin());
            points.iter().map(|q| (*q - p).dot(d)).fold(f64::NEG_INFINITY, f64::max)
        })
        .fold(f64::INFINITY, f64::min)
}

fn mix(a: &Stance, b: &Stance, t: f64) -> Stance {
    Stance { at: a.at.lerp(b.at, t), facing: a.facing.lerp(b.facing, t).normalize_or(b.facing) }
}

/// Stances no farther apart than a stride.
fn strides(way: &[Stance]) -> Vec<Stance> {
    let mut out = vec![way[0]];
    for pair in way.windows(2) {
        let far = pair[0].at.distance(pair[1].at) / STRIDE_M;
        let turned = pair[0].facing.dot(pair[1].facing).clamp(-1.0, 1.0).acos() / 0.35;
        let count = far.max(turned).ceil().max(1.0) as usize;
        out.extend((1..=count).map(|k| mix(&pair[0], &pair[1], k as f64 / count as f64)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balance_is_how_far_inside_the_feet_the_mass_is() {
        let square = [DVec3::ZERO, DVec3::X, DVec3::Z, DVec3::new(1.0, 0.0, 1.0)];
        assert!((inside(&square, DVec3::new(0.3, 1.0, 0.5)) - 0.3).abs() < 1e-9);
        assert!(inside(&square, DVec3::new(-0.2, 1.0, 0.5)) < -0.19);
    }

    #[test]
    fn strides_are_short_in_way_and_turn() {
        let a = Stance { at: DVec3::ZERO, facing: DVec3::X };
        let b = Stance { at: DVec3::X, facing: DVec3::X };
        let c = Stance { at: DVec3::X, facing: DVec3::Z };
        let all = strides(&[a, b, c]);
        assert!(all.windows(2).all(|p| p[0].at.distance(p[1].at) <= STRIDE_M + 1e-9));
        assert!(all.windows(2).all(|p| p[0].facing.dot(p[1].facing) > 0.9));
        assert_eq!(all.last().unwrap().facing, DVec3::Z);
    }
}
