//! What each look of a run mended and what it made worse, against the truth.
//!
//! A run tells which objects a look moved, from where to where (`harmony_pipeline::Came`). The error of a place, a turn and
//! a size is counted in the tolerances by which an object is right at all: 15 cm, 10 degrees, 12 %. Poses are those of
//! their time: what a later level moves together with camera and room is no look's.

use glam::{DMat3, DVec3};
use harmony_pipeline::{LookKind, Moved};
use harmony_scene::{Level, ObjectId, Pose};
use serde::{Deserialize, Serialize};

use super::objects::{matched, place, turn};
use super::prediction::{PredictedObject, Prediction};
use crate::summary::RIGHT;
use crate::truth::{TruthObject, TruthRoom};

/// A change of the error by less is neither mended nor made, tolerances.
const SAME: f64 = 0.1;

/// What came of one look in one run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LookScore {
    /// Which.
    pub look: LookKind,
    /// Questions asked.
    pub questions: usize,
    /// Faults that it was shown, where an oracle answered that counts them.
    #[serde(default)]
    pub there: usize,
    /// Those of them that it named.
    #[serde(default)]
    pub found: usize,
    /// Objects that the truth has, too, and that the look moved, turned or made another size.
    pub moved: usize,
    /// Those of them that are nearer to the truth since.
    pub mended: usize,
    /// Those that are farther from it.
    pub made: usize,
    /// Sum of their errors before it less after it, tolerances.
    pub gained: f64,
    /// Objects that it added and the truth has.
    pub added_right: usize,
    /// Objects that it added and the truth has not, or that went again.
    pub added_wrong: usize,
    /// Objects that it took out.
    pub removed: usize,
}

/// One score a look that was asked or changed something, all phases together.
///
/// `scale` is that by which the run was scaled before it was judged.
pub(super) fn looks(truth: &TruthRoom, run: &Prediction, scale: f64) -> Vec<LookScore> {
    let matched = matched(truth, run);
    let known = |id: &ObjectId| {
        let i = run.objects.iter().position(|o| o.object.id == *id)?;
        Some((&run.objects[i], &truth.objects[matched[i]?]))
    };
    let of_look = |look: LookKind| {
        let [there, found] = run.faults.of(look);
        let mut score = LookScore {
            look,
            questions: 0,
            there,
            found,
            moved: 0,
            mended: 0,
            made: 0,
            gained: 0.0,
            added_right: 0,
            added_wrong: 0,
            removed: 0,
        };
        for came in run.looks.iter().filter(|c| c.look == look) {
            score.questions += came.questions;
            score.removed += came.removed.len();
            let right = came.added.iter().filter(|id| known(id).is_some()).count();
            score.added_right += right;
            score.added_wrong += came.added.len() - right;
            for moved in &came.moved {
                let Some((object, truth)) = known(&moved.id) else { continue };
                let gained = gained(moved, object, truth, &run.corner, scale);
                score.moved += 1;
                score.gained += gained;
                score.mended += usize::from(gained >= SAME);
                score.made += usize::from(gained <= -SAME);
            }
        }
        score
    };
    let asked = |s: &LookScore| s.questions + s.moved + s.added_right + s.added_wrong + s.removed > 0;
    LookKind::ALL.into_iter().map(of_look).filter(asked).collect()
}

/// Error before a move less that after it, tolerances.
fn gained(moved: &Moved, object: &PredictedObject, truth: &TruthObject, corner: &DVec3, scale: f64) -> f64 {
    let [was, is] = [(&moved.before, &moved.size[0]), (&moved.after, &moved.size[1])].map(|(pose, size)| {
        let size = size.as_vec() * scale;
        let half = if object.object.level == Level::Wall { size.y / 2.0 } else { 0.0 };
        let at = pose.position * scale + *corner + DVec3::Y * half;
        let off = at.distance(place(object.object.level, &truth.mesh, Some(truth)));
        off / RIGHT.0 + turned(pose, object, truth) / RIGHT.1 + sized(size, truth) / RIGHT.2
    });
    was - is
}

/// Turn of an object in an earlier pose against the truth, degrees.
fn turned(pose: &Pose, object: &PredictedObject, truth: &TruthObject) -> f64 {
    if object.object.level == Level::Wall || !truth.has_front() {
        return 0.0;
    }
    let back = DMat3::from_rotation_y(pose.yaw - object.object.pose.yaw).as_mat3();
    let mut mesh = (*object.mesh).clone();
    mesh.map(|p| back * p, |n| back * n);
    turn(truth, &mesh).unwrap_or(0.0)
}

/// Mean relative error of the sides.
fn sized(size: DVec3, truth: &TruthObject) -> f64 {
    let ratio = size / truth.size.max(DVec3::splat(1e-4));
    (ratio - 1.0).abs().element_sum() / 3.0
}

/// All looks of several runs, one sum for each kind.
pub fn in_all<'a>(runs: impl Iterator<Item = &'a LookScore>) -> Vec<LookScore> {
    let mut out: Vec<LookScore> = Vec::new();
    for one in runs {
        match out.iter_mut().find(|s| s.look == one.look) {
            None => out.push(*one),
            Some(sum) => {
                sum.questions += one.questions;
                sum.there += one.there;
                sum.found += one.found;
                sum.moved += one.moved;
                sum.mended += one.mended;
                sum.made += one.made;
                sum.gained += one.gained;
                sum.added_right += one.added_right;
                sum.added_wrong += one.added_wrong;
                sum.removed += one.removed;
            }
        }
    }
    out.sort_by_key(|s| s.look);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_one_a_look_in_the_order_of_asking() {
        let one = |look: LookKind, mended: usize| LookScore {
            look,
            questions: 1,
            there: 3,
            found: 2,
            moved: 2,
            mended,
            made: 0,
            gained: 0.5,
            added_right: 1,
            added_wrong: 0,
            removed: 0,
        };
        let all = [one(LookKind::Review, 2), one(LookKind::Turns, 1), one(LookKind::Review, 1)];
        let sums = in_all(all.iter());
        assert_eq!(
            sums.iter().map(|s| (s.look, s.questions, s.mended)).collect::<Vec<_>>(),
            [(LookKind::Turns, 1, 1), (LookKind::Review, 2, 3),]
        );
        assert_eq!((sums[1].there, sums[1].found), (6, 4));
        assert!((sums[1].gained - 1.0).abs() < 1e-12);
    }
}
