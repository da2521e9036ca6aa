//! The links of a humanoid that matter for its tasks, and where its feet stand.

use glam::{DAffine3, DVec3};

use crate::RobotError;
use crate::model::{Form, Model, Posture};
use crate::room::Shapes;

/// Longest stride, metres.
const STRIDE_M: f64 = 0.22;
/// The pelvis is this much below where the legs are straight while standing, metres.
const EASY_M: f64 = 0.05;

/// The links of a humanoid that matter.
pub(super) struct Body {
    pub(super) feet: [usize; 2],
    pub(super) hands: [usize; 2],
    /// Middle of each hand, its link's frame.
    pub(super) palm: DVec3,
    /// Radius of the hand.
    pub(super) radius: f64,
    /// Links that rest on a seat.
    pub(super) seated: Vec<usize>,
    pub(super) thighs: [usize; 2],
    /// Height of the pelvis above the hip axes, and how far those are before it and beside it.
    pub(super) hip: DVec3,
    /// From the ankle to the sole.
    pub(super) sole: f64,
    /// Heel and toe from the ankle along the foot.
    pub(super) foot: [f64; 2],
    /// Half the width of a foot.
    pub(super) foot_half: f64,
    /// Straight legs, from the hip axis to the ankle.
    pub(super) leg: f64,
}

impl Body {
    pub(super) fn of(model: &Model, shapes: &Shapes) -> Result<Self, RobotError> {
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
    pub(super) fn standing(&self) -> f64 {
        self.sole + self.leg - self.hip.z - EASY_M
    }
}

/// Where both feet stand: the middle between the ankles, and where the robot faces.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stance {
    pub(super) at: DVec3,
    pub(super) facing: DVec3,
}

impl Stance {
    pub(super) fn left(&self) -> DVec3 {
        DVec3::Y.cross(self.facing)
    }
}

/// Elbows go no farther than this, radians: 1.57 is the straight arm, where both ways of bending meet. Which of them a hand's
/// goal takes from there is chance, and the backward one ends at the joint's limit (2.61) before hands are where they are
/// wanted: the arm then goes over to the other in one frame.
const BENT_RAD: f64 = 1.45;

/// How fast a joint turns at most, radians a second: the maker's description (unitree_ros, `h1_description/urdf/h1.urdf`), for
/// the MJCF file has no speeds.
pub(super) fn fastest(joint: &str) -> f64 {
    match joint {
        "torso" => 23.0,
        name if name.contains("hip") => 23.0,
        name if name.contains("knee") => 14.0,
        name if name.contains("shoulder_yaw") || name.contains("elbow") => 20.0,
        // Ankles, and shoulders' pitch and roll.
        _ => 9.0,
    }
}

/// The model with elbows that bend forward only, as a person's, and a torso that does not turn against the pelvis: both
/// hands do the same, and a search that may turn it swings the arms aside to bring the centre of mass over the feet.
pub(super) fn like_a_person(model: &Model) -> Model {
    let mut out = model.clone();
    for joint in &mut out.joints {
        if joint.name.ends_with("elbow") {
            joint.range[1] = joint.range[1].min(BENT_RAD);
        } else if joint.name == "torso" {
            joint.range = [0.0; 2];
        }
    }
    out
}

/// Arms beside the body.
pub(super) fn easy(model: &Model) -> Vec<f64> {
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

pub(super) fn mix(a: &Stance, b: &Stance, t: f64) -> Stance {
    Stance { at: a.at.lerp(b.at, t), facing: a.facing.lerp(b.facing, t).normalize_or(b.facing) }
}

/// Stances no farther apart than a stride.
pub(super) fn strides(way: &[Stance]) -> Vec<Stance> {
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
