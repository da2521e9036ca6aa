//! An arm with a jaw: draws a chair by its backrest, picks a thing up.
//!
//! # Idea
//! Where to hold is measured ([`crate::measure`]). The arm stands on a column beside the way of its hand; where, and how
//! high, is searched: places are ranked by how far the joints stay from their limits at the key poses, and the first from
//! which the whole way is free of everything is taken. The fingers are closed until the first touches the triangles, and the
//! hand is shifted until both do.
//!
//! # Limits
//! Kinematics alone: whether friction holds what is gripped, and whether the arm is strong enough, is not asked. Chairs and
//! decorations are taken from straight above.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use harmony_physics::Hull;
use harmony_scene::{Level, Support};

use crate::RobotError;
use crate::ik::{Found, Goal, Settings, Task, solve};
use crate::jaw::Jaw;
use crate::measure::{self, Grasp, Window};
use crate::model::{Form, Geom, Model, Posture, upright};
use crate::motion::{Evidence, Frame, Motion, evidence, smooth};
use crate::room::{Other, Shapes, Surroundings};
use crate::shapes::pieces;

/// How far a chair is drawn, metres (the paper's).
pub const DRAW_M: f64 = 0.45;
/// How far a thing is lifted, metres.
pub const LIFT_M: f64 = 0.20;
/// From the pads back to the wrist, roughly, metres.
const WRIST_M: f64 = 0.2;
/// How far before where it holds the hand is when it comes, metres.
const ABOVE_M: f64 = 0.14;
/// Frames of the approach, the way down, the closing and the way with the object: 140, as in the paper.
const FRAMES: [usize; 4] = [20, 30, 15, 75];
/// Half the side of the column, metres.
const COLUMN_M: f64 = 0.12;
/// Heights of columns that are tried, metres.
const COLUMNS: [f64; 10] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];
/// Fingers touch when the nearer is this near, metres.
const TOUCH_M: f64 = 2e-4;
/// What is touched may be this deep in a finger, metres.
const DEEP_M: f64 = 1e-3;

/// Where and from where a jaw takes hold.
#[derive(Debug, Clone)]
pub(crate) struct Hold {
    /// Middle between the pads, room.
    pub centre: DVec3,
    /// Unit: where the fingers point.
    pub approach: DVec3,
    /// Unit, across: the fingers close along it.
    pub closing: DVec3,
    /// Measurements that belong to it.
    pub measured: BTreeMap<String, f64>,
    /// Why there.
    pub because: String,
}

impl Hold {
    fn from_above(grasp: &Grasp) -> Self {
        let measured = [
            ("grasp_height_m", grasp.section.height_m),
            ("grasp_thickness_m", grasp.section.thickness_m),
            ("top_m", grasp.top_m),
        ];
        Self {
            centre: grasp.centre,
            approach: DVec3::NEG_Y,
            closing: grasp.closing,
            measured: measured.map(|(name, v)| (name.to_owned(), v)).into(),
            because: grasp.because.clone(),
        }
    }
}

/// The way that an object is moved.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Way {
    /// Along a line, metres.
    Straight(DVec3),
    /// About an axis, radians.
    Turn {
        /// Unit.
        axis: DVec3,
        /// A point of it.
        pivot: DVec3,
        /// By how much.
        angle: f64,
    },
}

impl Way {
    /// `room_from_room` after a share of it.
    pub fn at(&self, share: f64) -> DAffine3 {
        match self {
            Self::Straight(way) => DAffine3::from_translation(*way * share),
            Self::Turn { axis, pivot, angle } => {
                let turn = DMat3::from_quat(DQuat::from_axis_angle(*axis, angle * share));
                DAffine3::from_mat3_translation(turn, *pivot - turn * *pivot)
            }
        }
    }

    /// How far a point goes on it, metres.
    fn length(&self, from: DVec3) -> f64 {
        match self {
            Self::Straight(way) => way.length(),
            Self::Turn { axis, pivot, angle } => {
                let arm = from - *pivot;
                (arm - *axis * arm.dot(*axis)).length() * angle.abs()
            }
        }
    }
}

/// What is done with an object.
pub(crate) struct Carried<'a> {
    /// Its number.
    pub object: usize,
    /// Its way.
    pub way: Way,
    /// What its joint has at the end; 0 without one.
    pub opened: f64,
    /// Names of the four steps.
    pub steps: [&'static str; 4],
    /// Name of the task.
    pub task: &'a str,
}

/// A task of an arm, done.
pub struct Done {
    /// Postures.
    pub motion: Motion,
    /// Measured of them.
    pub evidence: Evidence,
    /// Measurements of the task.
    pub measured: BTreeMap<String, f64>,
    /// Why so.
    pub because: Vec<String>,
}

/// Chairs of a room, by what they are called.
pub fn chairs(room: &Surroundings) -> Vec<usize> {
    let is = |label: &str| harmony_catalogue::kind(label).is_some_and(|k| k.name.ends_with("chair"));
    (0..room.things.len()).filter(|k| is(&room.things[*k].label)).collect()
}

/// Draws a chair back by its backrest.
///
/// # Errors
/// [`RobotError::Nothing`] without a chair, [`RobotError::Forbidden`] with the measurement that forbids it.
pub fn draw_chair(room: &Surroundings, model: &Model, object: Option<&str>) -> Result<Done, RobotError> {
    let chairs = match object {
        Some(id) => vec![room.named(id)?],
        None => chairs(room),
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
        if let Some((other, distance)) = room.nearest_of_thing(thing, DAffine3::from_translation(along * way))
            && distance <= 0.0
        {
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

/// A place of the arm's base and how the hand is turned.
#[derive(Clone)]
struct Stand {
    root: DAffine3,
    column: f64,
    closing: DVec3,
    margin: f64,
    /// Postures above the object, at it, midway and at the end.
    keys: Vec<Posture>,
}

/// Solves hand poses of one arm.
struct Hand<'a> {
    model: &'a Model,
    jaw: &'a Jaw,
}

impl Hand<'_> {
    fn at(&self, start: &Posture, target: DVec3, turn: DMat3, steps: usize) -> Found {
        let mut home = self.model.rest();
        // The arm's own first joint is free to face where it works.
        home[0] = start.joints[0];
        let tasks = [
            Task::new(0, Goal::Point { link: self.jaw.hand, point: self.jaw.centre, target }),
            Task::new(0, Goal::Turn { link: self.jaw.hand, target: turn }),
            Task::new(1, Goal::Joints { target: home }),
        ];
        let settings = Settings { steps, tolerance: 1e-6, ..Settings::default() };
        solve(self.model, start, &tasks, &settings)
    }
}

/// Takes hold of an object and moves it, from the first place of the arm that allows it.
///
/// # Errors
/// Why none does: the measurement of the one that came nearest to it.
pub(crate) fn carry(
    room: &Surroundings,
    model: &Model,
    jaw: &Jaw,
    hold: &Hold,
    what: &Carried<'_>,
) -> Result<Done, String> {
    let object = what.object;
    let hand = Hand { model, jaw };
    let stands = stands(room, &hand, hold, &what.way)?;
    let count = stands.len();
    let mut best: Option<(f64, String)> = None;
    let bare = Shapes::new(&pieces(model));
    for stand in stands {
        // The key poses first: most places are out by them.
        if let Some((distance, why)) = in_the_way(room, &hand, &bare, what, &stand) {
            if best.as_ref().is_none_or(|b| distance > b.0) {
                best = Some((distance, why));
            }
            continue;
        }
        let mut standing = model.clone();
        stand_on(&mut standing, stand.column);
        let shapes = Shapes::new(&pieces(&standing));
        let hand = Hand { model: &standing, jaw };
        let made = match frames(room, &hand, &shapes, hold, what, &stand) {
            Ok(made) => made,
            Err(why) => {
                best = best.or(Some((f64::NEG_INFINITY, why)));
                continue;
            }
        };
        let motion = Motion {
            task: what.task.to_owned(),
            object,
            steps: what.steps.to_vec(),
            frames: made.frames,
            column_m: stand.column,
            model: standing,
        };
        let bears = |_: &Frame, link: usize, other: Other| link == 0 && other == Other::Face("floor");
        let found = evidence(room, &shapes, &motion, &bears);
        if found.smallest_clearance_m < 0.0 || found.failed_frames > 0 || found.deepest_touch_m > DEEP_M {
            let why = format!("{}, {:.1} mm apart", found.nearest, 1e3 * found.smallest_clearance_m);
            if best.as_ref().is_none_or(|b| found.smallest_clearance_m > b.0) {
                best = Some((found.smallest_clearance_m, why));
            }
            continue;
        }
        let mut measured = hold.measured.clone();
        measured.extend([
            ("jaw_m".to_owned(), jaw.size.opening_m),
            ("jaw_closed_to_m".to_owned(), 2.0 * made.each),
            ("way_m".to_owned(), what.way.length(hold.centre)),
            ("column_m".to_owned(), stand.column),
            ("fingertip_off_its_line_m".to_owned(), off_line(&motion, jaw)),
        ]);
        let base = stand.root.translation;
        let because = vec![
            hold.because.clone(),
            format!(
                "the arm stands on a column of {:.2} m at x {:.2}, z {:.2}: of {count} places from which all key poses are \
                 reached, the first whose whole way is free, by the joints' distance to their limits",
                stand.column, base.x, base.z
            ),
        ];
        return Ok(Done { motion, evidence: found, measured, because });
    }
    Err(match best {
        Some((_, why)) => format!("from none of {count} places of the base is the way free; the best: {why}"),
        None => format!("no way from any of {count} places"),
    })
}

/// What a link is in at a key pose, with the fingers open.
fn in_the_way(
    room: &Surroundings,
    hand: &Hand<'_>,
    shapes: &Shapes,
    what: &Carried<'_>,
    stand: &Stand,
) -> Option<(f64, String)> {
    let object = what.object;
    let mut worst: Option<(f64, String)> = None;
    for (posture, share) in stand.keys.iter().zip([0.0, 0.0, 0.5, 1.0]) {
        let looks = |link: usize, other: Other| {
            (link != 0 || other != Other::Face("floor"))
                && (other != Other::Thing(object) || !hand.jaw.fingers.contains(&link))
        };
        let moved = Some((object, what.way.at(share)));
        if let Some(near) = room.nearest(shapes, &hand.model.places(posture), moved, 0.02, &looks)
            && near.distance < 0.0
            && worst.as_ref().is_none_or(|w| near.distance < w.0)
        {
            let link = &hand.model.links[near.link].name;
            let why = format!("{link} is {:.0} mm in {}", -1e3 * near.distance, room.name(near.other));
            worst = Some((near.distance, why));
        }
    }
    worst
}

/// How far the middle between the pads leaves the way of what it holds, metres.
fn off_line(motion: &Motion, jaw: &Jaw) -> f64 {
    let held: Vec<(DVec3, DAffine3)> = motion
        .frames
        .iter()
        .filter(|f| f.step == 3)
        .map(|f| (motion.model.places(&f.posture)[jaw.hand].transform_point3(jaw.centre), f.moved))
        .collect();
    let Some((first, from)) = held.first() else { return 0.0 };
    let start = from.inverse().transform_point3(*first);
    held.iter().map(|(tip, moved)| tip.distance(moved.transform_point3(start))).fold(0.0, f64::max)
}

/// Puts a column under the root link.
fn stand_on(model: &mut Model, column: f64) {
    if column <= 0.0 {
        return;
    }
    for visual in [true, false] {
        model.links[0].geoms.push(Geom {
            link_from_geom: DAffine3::from_translation(DVec3::NEG_Z * column / 2.0),
            form: Form::Box(DVec3::new(COLUMN_M, COLUMN_M, column / 2.0)),
            visual,
            color: [0.25, 0.27, 0.3],
        });
    }
}

/// Places from which the key poses are reached, best first.
fn stands(room: &Surroundings, hand: &Hand<'_>, hold: &Hold, way: &Way) -> Result<Vec<Stand>, String> {
    // The wrist midway.
    let middle = way.at(0.5).transform_point3(hold.centre - hold.approach * WRIST_M);
    let mut out: Vec<Stand> = Vec::new();
    let e = &room.extents;
    let mut looked = 0;
    let columns = Shapes::new(&[vec![Hull::cuboid(DVec3::new(-0.16, -0.10, 0.05), DVec3::new(0.09, 0.10, 0.3))]]);
    for angle in (0..16).map(|k| std::f64::consts::TAU * f64::from(k) / 16.0) {
        for distance in [0.35, 0.45, 0.55, 0.65, 0.72] {
            let out_there = DVec3::new(angle.cos(), 0.0, angle.sin()) * distance;
            for column in COLUMNS {
                let at = DVec3::new(middle.x, column, middle.z) + out_there;
                let inside = at.x > 0.2 && at.z > 0.2 && at.x < e.width - 0.2 && at.z < e.depth - 0.2;
                // From the shoulder to the wrist, roughly, and neither far above nor below.
                let up = middle.y - (column + 0.33);
                if !inside || !(-0.55..=0.55).contains(&up) {
                    continue;
                }
                let root = upright(at, -out_there);
                let place = [root];
                let free = |s: &Shapes| room.nearest(s, &place, None, 0.01, &|_, _| true).is_none();
                if !free(&columns) || !column_is_free(room, at, column) {
                    continue;
                }
                looked += 1;
                out.extend(stand(hand, hold, way, root, column));
            }
        }
    }
    if out.is_empty() {
        return Err(format!(
            "the arm reaches the hand's way at {:.2} m height, {:.2} m long, from none of {looked} free places within 0.72 m",
            hold.centre.y,
            way.length(hold.centre)
        ));
    }
    out.sort_by(|a, b| b.margin.total_cmp(&a.margin));
    Ok(out)
}

fn column_is_free(room: &Surroundings, at: DVec3, column: f64) -> bool {
    if column <= 0.0 {
        return true;
    }
    let shape = Hull::cuboid(DVec3::new(-COLUMN_M, 0.02, -COLUMN_M), DVec3::new(COLUMN_M, column, COLUMN_M));
    let place = [DAffine3::from_translation(DVec3::new(at.x, 0.0, at.z))];
    room.nearest(&Shapes::new(&[vec![shape]]), &place, None, 0.01, &|_, _| true).is_none()
}

/// A place, when all key poses are reached from it.
fn stand(hand: &Hand<'_>, hold: &Hold, way: &Way, root: DAffine3, column: f64) -> Option<Stand> {
    let mut best: Option<Stand> = None;
    for closing in [hold.closing, -hold.closing] {
        let mut posture = Posture { root, joints: hand.model.rest() };
        let mut margin = f64::INFINITY;
        let mut made: Vec<Posture> = Vec::new();
        let turn = hand.jaw.turned(hold.approach, closing);
        let before = hold.centre - hold.approach * ABOVE_M;
        let keys = [(before, 0.0), (hold.centre, 0.0), (hold.centre, 0.5), (hold.centre, 1.0)];
        for (point, share) in keys {
            let moved = way.at(share);
            let found = hand.at(&posture, moved.transform_point3(point), moved.matrix3 * turn, 60);
            if found.error > 1e-4 {
                margin = f64::NEG_INFINITY;
                break;
            }
            posture = found.posture;
            made.push(posture.clone());
            margin = margin.min(hand.model.margin(&posture.joints).0);
        }
        if made.len() == keys.len() && margin > 0.02 && best.as_ref().is_none_or(|b| margin > b.margin) {
            best = Some(Stand { root, column, closing, margin, keys: made });
        }
    }
    best
}

struct Made {
    frames: Vec<Frame>,
    /// How far each finger is open when it holds.
    each: f64,
}

fn frames(
    room: &Surroundings,
    hand: &Hand<'_>,
    shapes: &Shapes,
    hold: &Hold,
    what: &Carried<'_>,
    stand: &Stand,
) -> Result<Made, String> {
    let (model, jaw, object) = (hand.model, hand.jaw, what.object);
    let turn = jaw.turned(hold.approach, stand.closing);
    let open = model.joints[jaw.joints[0]].range[1];
    let finger_gap = |posture: &Posture, finger: usize| {
        let only = |l: usize, o: Other| l == finger && o == Other::Thing(object);
        room.nearest(shapes, &model.places(posture), None, 0.1, &only).map_or(0.1, |n| n.distance)
    };
    // Close until the nearer finger touches, then shift the hand until both do.
    let mut centre = hold.centre;
    let mut held = hand.at(&stand.keys[0], centre, turn, 120);
    let mut each = open;
    for _ in 0..6 {
        let gaps = |v: f64| {
            let mut posture = held.posture.clone();
            jaw.open(model, &mut posture.joints, v);
            jaw.fingers.map(|f| finger_gap(&posture, f))
        };
        let (mut low, mut high) = (0.0, open);
        for _ in 0..24 {
            let v = f64::midpoint(low, high);
            let [a, b] = gaps(v);
            if a.min(b) > TOUCH_M { high = v } else { low = v }
        }
        each = high;
        let [a, b] = gaps(each);
        if (a - b).abs() < TOUCH_M {
            break;
        }
        // The first finger opens along the hand's closing direction: where its gap is the larger, the hand is too far there.
        centre -= stand.closing * ((a - b) / 2.0).clamp(-0.005, 0.005);
        held = hand.at(&held.posture, centre, turn, 120);
    }
    let mut frames: Vec<Frame> = Vec::new();
    let mut posture = stand.keys[0].clone();
    let mut put = |frames: &mut Vec<Frame>, step: usize, at: DVec3, each: f64, share: f64, touching: &[usize]| {
        let moved = what.way.at(share);
        let found = hand.at(&posture, moved.transform_point3(at), moved.matrix3 * turn, 60);
        posture = found.posture;
        jaw.open(model, &mut posture.joints, each);
        let (error, touching, opened) = (found.error, touching.to_vec(), what.opened * share);
        frames.push(Frame { step, posture: posture.clone(), moved, opened, error, touching, held: false });
    };
    let before = centre - hold.approach * ABOVE_M;
    let part = |k: usize, n: usize| smooth(k as f64 / (n - 1) as f64);
    for k in 0..FRAMES[0] {
        put(&mut frames, 0, before - hold.approach * 0.08 * (1.0 - part(k, FRAMES[0])), open, 0.0, &[]);
    }
    for k in 0..FRAMES[1] {
        put(&mut frames, 1, before.lerp(centre, part(k, FRAMES[1])), open, 0.0, &[]);
    }
    for k in 0..FRAMES[2] {
        let last = k + 1 == FRAMES[2];
        let touching: &[usize] = if last { &jaw.fingers } else { &[] };
        put(&mut frames, 2, centre, open + (each - open) * part(k, FRAMES[2]), 0.0, touching);
    }
    for k in 0..FRAMES[3] {
        put(&mut frames, 3, centre, each, part(k, FRAMES[3]), &jaw.fingers);
    }
    match frames.iter().find(|f| f.error > 1e-4) {
        Some(f) => Err(format!("the arm misses a pose of the way by {:.1} mm", 1e3 * f.error)),
        None => Ok(Made { frames, each }),
    }
}
