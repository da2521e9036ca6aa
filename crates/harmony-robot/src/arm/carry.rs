//! A thing taken hold of and moved along a way, from the first place of the arm that allows it.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::frames::frames;
use super::stands::{Stand, stand_on, stands, with_column};
use crate::ik::{Found, Goal, Settings, Task, solve};
use crate::jaw::Jaw;
use crate::measure::Grasp;
use crate::model::{Model, Posture};
use crate::motion::{Done, Frame, Motion, evidence};
use crate::room::{Other, Shapes, Surroundings};
use crate::shapes::pieces;

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
    pub(super) fn from_above(grasp: &Grasp) -> Self {
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
    pub(super) fn length(&self, from: DVec3) -> f64 {
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

/// Solves hand poses of one arm.
pub(super) struct Hand<'a> {
    pub(super) model: &'a Model,
    pub(super) jaw: &'a Jaw,
}

impl Hand<'_> {
    pub(super) fn at(&self, start: &Posture, target: DVec3, turn: DMat3, steps: usize) -> Found {
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
    let own = pieces(model);
    let bare = Shapes::new(&own);
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
        let shapes = Shapes::new(&with_column(&own, stand.column));
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
        return Ok(Done { motion, shapes: Arc::new(shapes), evidence: found, measured, because });
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
