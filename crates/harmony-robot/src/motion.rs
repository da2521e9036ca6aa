//! What a robot does over time, and what was measured of it.
//!
//! A task is scripted kinematics, as in the paper: a posture a frame, found by inverse kinematics, and how far the object
//! that is held has been moved. Nothing is simulated. What holds of every frame is measured afterwards on the postures
//! themselves ([`evidence`]), not taken from the solver.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DAffine3, DQuat};
use serde::{Deserialize, Serialize};

use crate::model::{Model, Posture};
use crate::room::{Near, Other, Shapes, Surroundings};

/// Frames a second.
pub const FRAMES_PER_SECOND: u32 = 30;
/// Clearances above this are not looked for, metres.
const FAR_M: f64 = 0.10;

/// One frame.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Which step of the task.
    pub step: usize,
    /// The robot.
    pub posture: Posture,
    /// `room_from_room` of the held object: from where the scene has it to where it is.
    pub moved: DAffine3,
    /// Value of its joint when it is a part that opens, radians or metres; 0 else.
    pub opened: f64,
    /// Largest error of the goals that had to be reached, metres or radians.
    pub error: f64,
    /// Links that are meant to touch the object in this frame.
    pub touching: Vec<usize>,
    /// Whether the pose is held: a static pose, which must balance.
    pub held: bool,
}

/// A task as postures.
pub struct Motion {
    /// The robot, with what it stands on.
    pub model: Model,
    /// Name of the task.
    pub task: String,
    /// The object that is moved.
    pub object: usize,
    /// Names of the steps.
    pub steps: Vec<&'static str>,
    /// Frames.
    pub frames: Vec<Frame>,
    /// Height of the column under the robot's base, metres; 0 when it stands on the floor.
    pub column_m: f64,
}

/// A task, done.
pub struct Done {
    /// Postures.
    pub motion: Motion,
    /// Convex pieces of the robot's links.
    pub shapes: Arc<Shapes>,
    /// Measured of them.
    pub evidence: Evidence,
    /// Measurements of the task.
    pub measured: BTreeMap<String, f64>,
    /// Why so.
    pub because: Vec<String>,
}

/// A goal that is missed by more than this is missed, metres or radians.
pub(crate) const MISSED: f64 = 1e-4;

/// What holds of a whole motion.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Frames.
    pub frames: usize,
    /// Frames whose goals were missed by more than a tenth of a millimetre or milliradian.
    pub failed_frames: usize,
    /// The largest miss, metres or radians.
    pub largest_miss: f64,
    /// Smallest distance of a hinge to a limit, as a share of its half range.
    pub smallest_margin: f64,
    /// That joint.
    pub tightest_joint: String,
    /// Smallest distance of a link to the scene where it is not meant to touch, metres; below 0 they are in each other.
    /// 0.1 stands for all that is farther.
    pub smallest_clearance_m: f64,
    /// Which link, what, in which frame.
    pub nearest: String,
    /// Of links that are meant to touch: the largest gap to the object in a frame, metres.
    pub largest_gap_m: f64,
    /// The deepest that they are in it, metres (positive).
    pub deepest_touch_m: f64,
    /// Fastest joint, radians or metres a second at the frames' rate.
    pub fastest_joint: f64,
}

/// Measures a motion, frame by frame.
///
/// `supports` says which pairs bear the robot (feet on the floor, thighs on a seat): they are not clearances.
pub fn evidence(
    room: &Surroundings,
    shapes: &Shapes,
    motion: &Motion,
    supports: &dyn Fn(&Frame, usize, Other) -> bool,
) -> Evidence {
    let model = &motion.model;
    let mut out = Evidence {
        frames: motion.frames.len(),
        smallest_margin: f64::INFINITY,
        smallest_clearance_m: FAR_M,
        ..Evidence::default()
    };
    for (number, frame) in motion.frames.iter().enumerate() {
        out.largest_miss = out.largest_miss.max(frame.error);
        out.failed_frames += usize::from(frame.error > MISSED);
        let (margin, joint) = model.margin(&frame.posture.joints);
        if margin < out.smallest_margin {
            (out.smallest_margin, out.tightest_joint) = (margin, model.joints[joint].name.clone());
        }
        if let Some(before) = number.checked_sub(1).map(|k| &motion.frames[k].posture.joints) {
            let fastest = frame.posture.joints.iter().zip(before).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            out.fastest_joint = out.fastest_joint.max(fastest * f64::from(FRAMES_PER_SECOND));
        }
        let places = model.places(&frame.posture);
        let moved = Some((motion.object, frame.moved));
        let touches =
            |link: usize, other: Other| other == Other::Thing(motion.object) && frame.touching.contains(&link);
        let free = |link: usize, other: Other| !touches(link, other) && !supports(frame, link, other);
        // Only what is nearer than all before says something new.
        if let Some(near) = room.nearest(shapes, &places, moved, out.smallest_clearance_m, &free)
            && near.distance < out.smallest_clearance_m
        {
            out.smallest_clearance_m = near.distance;
            out.nearest = describe(room, model, &near, number);
        }
        for link in &frame.touching {
            let one = |l: usize, other: Other| l == *link && other == Other::Thing(motion.object);
            let gap = room.nearest(shapes, &places, moved, FAR_M, &one).map_or(FAR_M, |n| n.distance);
            out.largest_gap_m = out.largest_gap_m.max(gap);
            out.deepest_touch_m = out.deepest_touch_m.max(-gap);
        }
    }
    out
}

/// A nearest pair in words.
pub fn describe(room: &Surroundings, model: &Model, near: &Near, frame: usize) -> String {
    format!("{} and {} in frame {frame}", model.links[near.link].name, room.name(near.other))
}

/// `trajectory.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// Who wrote it.
    pub generator: String,
    /// The robot's model.
    pub robot: String,
    /// Task.
    pub task: String,
    /// The object that is moved.
    pub object: String,
    /// Frames a second.
    pub frames_per_second: u32,
    /// Frame of all places: `room` (+Y up, metres).
    pub frame: String,
    /// Names of the joints, in the order of the values.
    pub joints: Vec<String>,
    /// Height of the column under the robot's base, metres.
    pub column_m: f64,
    /// Steps with their first frames.
    pub steps: Vec<StepRow>,
    /// What was measured.
    pub evidence: Evidence,
    /// Further measurements of the task, by name.
    pub measured: BTreeMap<String, f64>,
    /// Why it is done as it is, sentence by sentence.
    pub because: Vec<String>,
    /// Frames.
    pub frames: Vec<FrameRow>,
}

/// A step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRow {
    /// What is done.
    pub name: String,
    /// Its first frame.
    pub first_frame: usize,
}

/// A frame as it is written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameRow {
    /// Of the robot's root, room.
    pub root_position: [f64; 3],
    /// Of the robot's root, whose axes are those of its model (+Z up): x, y, z, w.
    pub root_rotation: [f64; 4],
    /// Radians or metres.
    pub joints: Vec<f64>,
    /// Of the object from where the scene has it: turned about the room's origin by `object_rotation`, then moved by this.
    pub object_offset: [f64; 3],
    /// See `object_offset`: x, y, z, w.
    #[serde(default = "no_turn")]
    pub object_rotation: [f64; 4],
    /// Value of the object's joint when it is a part that opens, radians or metres.
    #[serde(default)]
    pub object_joint: f64,
}

impl Motion {
    /// As it is written.
    pub fn trajectory(
        &self,
        room: &Surroundings,
        evidence: Evidence,
        measured: BTreeMap<String, f64>,
        because: Vec<String>,
    ) -> Trajectory {
        let first = |k: usize| self.frames.iter().position(|f| f.step == k);
        Trajectory {
            generator: concat!("HARMONY ", env!("CARGO_PKG_VERSION")).to_owned(),
            robot: self.model.name.clone(),
            task: self.task.clone(),
            object: room.things[self.object].id.clone(),
            frames_per_second: FRAMES_PER_SECOND,
            frame: "room".to_owned(),
            joints: self.model.joints.iter().map(|j| j.name.clone()).collect(),
            column_m: self.column_m,
            steps: self
                .steps
                .iter()
                .enumerate()
                .filter_map(|(k, name)| Some(StepRow { name: (*name).to_owned(), first_frame: first(k)? }))
                .collect(),
            evidence,
            measured,
            because,
            frames: self.frames.iter().map(row).collect(),
        }
    }
}

fn no_turn() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

fn row(frame: &Frame) -> FrameRow {
    let root: &DAffine3 = &frame.posture.root;
    let q = DQuat::from_mat3(&root.matrix3).normalize();
    FrameRow {
        root_position: root.translation.to_array(),
        root_rotation: [q.x, q.y, q.z, q.w],
        joints: frame.posture.joints.clone(),
        object_offset: frame.moved.translation.to_array(),
        object_rotation: DQuat::from_mat3(&frame.moved.matrix3).normalize().to_array(),
        object_joint: frame.opened,
    }
}

/// From 0 to 1 with no speed at the ends.
pub fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}
