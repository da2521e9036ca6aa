//! The frames of an arm's way: come, reach and straddle, close, move.

use glam::DVec3;

use super::carry::{Carried, Hand, Hold};
use super::stands::Stand;
use crate::model::Posture;
use crate::motion::{Frame, smooth};
use crate::room::{Other, Shapes, Surroundings};

/// How far before where it holds the hand is when it comes, metres.
pub(super) const ABOVE_M: f64 = 0.14;
/// Frames of the approach, the way down, the closing and the way with the object: 140, as in the paper.
const FRAMES: [usize; 4] = [20, 30, 15, 75];
/// Fingers touch when the nearer is this near, metres.
const TOUCH_M: f64 = 2e-4;

/// What came of it.
pub(super) struct Made {
    /// Postures.
    pub(super) frames: Vec<Frame>,
    /// How far each finger is open when it holds.
    pub(super) each: f64,
}

/// All frames from one place of the arm.
///
/// # Errors
/// The pose that is missed, with by how much.
pub(super) fn frames(
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
