//! Group refinement: one size for a matched set, coherent facing, colours on the right sides. Paper App. C
//! "Post-placement group refinement", "Matched-group reordering".

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_scene::{Level, Mask, ObjectId, Pose};

use crate::anchoring::{Frame, YawRule};
use crate::cost::angle_between;
use crate::first_pose::facing;
use crate::formulas::median;
use crate::level::{anchoring_of, neighbours};
use crate::solve::polish;
use crate::view::{View, cut_by_border};
use crate::{Item, PartialScene, Placed, PlacementSettings, measure};

/// Members whose sizes differ by less than this factor belong to one size.
const SAME_KIND: f64 = 1.6;

/// Members that see less of themselves than this do not vote on the size.
const VOTING_IOU: f64 = 0.5;

/// A member that deviates more than this from facing its target, while the others don't, is turned, radians.
const INCOHERENT: f64 = 0.7;

/// Deviation at which the others count as facing the target, radians.
const COHERENT: f64 = 0.4;

/// IoU that a turn to coherence may cost: silhouettes of chairs say little about front and back.
const TURN_COST: f64 = 0.12;

/// Search steps for a member in its new size.
const BUDGET: usize = 60;

/// What group refinement changed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GroupReport {
    /// Members whose size was brought to the set's, with the factor.
    pub resized: Vec<(ObjectId, f64)>,
    /// Members that were turned to face what their set faces, radians.
    pub turned: Vec<(ObjectId, f64)>,
}

/// Brings the matched sets of a level into line.
pub fn refine_groups(scene: &mut PartialScene, level: Level, settings: &PlacementSettings) -> GroupReport {
    let mut report = GroupReport::default();
    let mut sets: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (i, p) in scene.placed.iter().enumerate() {
        if let Some(set) = p.item.relations.matched_set.as_ref().filter(|_| p.item.level == level) {
            sets.entry(set.clone()).or_default().push(i);
        }
    }
    for members in sets.values().filter(|m| m.len() > 1) {
        one_facing(scene, members, settings, &mut report);
        one_size(scene, members, settings, &mut report);
    }
    report
}

fn frame<'a>(scene: &'a PartialScene, item: &'a Item, object: usize, yaw: YawRule) -> Frame<'a> {
    let (anchoring, wall_gap) = (anchoring_of(scene, object), 0.003);
    Frame { scene, item, anchoring, yaw, wall_gap, fixed_size: true }
}

/// Searches the best place around a pose without changing the size; the pose itself when there is no mask.
fn replaced(scene: &PartialScene, object: usize, pose: &Pose, yaw: YawRule, settings: &PlacementSettings) -> Pose {
    let item = Arc::clone(&scene.placed[object].item);
    let frame = frame(scene, &item, object, yaw);
    let others = neighbours(scene, &item, &[], Some(object));
    match View::new(scene, Some(object), &item.mask, &others, settings.window_px) {
        Some(view) => polish(frame, pose, &view, settings, BUDGET).pose,
        None => frame.settle(pose),
    }
}

/// Cube root of the volume: one number for a size.
fn linear_size(scene: &PartialScene, object: usize) -> f64 {
    let s = scene.placed[object].size();
    (s.width * s.height * s.depth).cbrt()
}

fn one_size(scene: &mut PartialScene, members: &[usize], settings: &PlacementSettings, report: &mut GroupReport) {
    let votes = |least_iou: f64, whole: bool| -> Vec<f64> {
        let counts = |p: &Placed| {
            p.evidence.silhouette_iou.unwrap_or(0.0) >= least_iou && !(whole && touches_border(&p.item.mask))
        };
        members.iter().filter(|i| counts(&scene.placed[**i])).map(|i| linear_size(scene, *i)).collect()
    };
    // Who is whole in the picture knows the size; who is cut by its border guesses it.
    let Some(mut sizes) = [(VOTING_IOU, true), (VOTING_IOU, false), (0.0, false)]
        .into_iter()
        .map(|(l, w)| votes(l, w))
        .find(|v| !v.is_empty())
    else {
        return;
    };
    let common = median(&mut sizes);
    for &i in members {
        let factor = common / linear_size(scene, i);
        if !factor.is_finite() || !(1.0 / SAME_KIND..SAME_KIND).contains(&factor) || (factor - 1.0).abs() < 1e-3 {
            continue;
        }
        let mut pose = scene.placed[i].pose;
        pose.scale *= factor;
        // At another distance the new size has the old angular size.
        let camera = &scene.camera;
        let away = pose.position - camera.centre();
        pose.position += harmony_scene::Vec3::new(away.x, 0.0, away.z) * (factor - 1.0);
        let yaw = YawRule::About { yaw: pose.yaw, sigma: 0.1 };
        scene.placed[i].pose = replaced(scene, i, &pose, yaw, settings);
        report.resized.push((scene.placed[i].item.id.clone(), factor));
    }
}

fn touches_border(mask: &Mask) -> bool {
    mask.bounds().is_some_and(|b| cut_by_border(&b, mask.size()).contains(&true))
}

fn one_facing(scene: &mut PartialScene, members: &[usize], settings: &PlacementSettings, report: &mut GroupReport) {
    let mut by_target: BTreeMap<ObjectId, Vec<(usize, f64)>> = BTreeMap::new();
    for &i in members {
        let p = &scene.placed[i];
        let Some(target) = p.item.relations.facing_toward.as_ref().and_then(|id| scene.find(id)) else { continue };
        if let Some(yaw) = facing(p.pose.position, target) {
            by_target.entry(target.item.id.clone()).or_default().push((i, angle_between(yaw, p.pose.yaw)));
        }
    }
    for deviations in by_target.values().filter(|d| d.len() > 1) {
        let coherent = deviations.iter().filter(|(_, d)| d.abs() < COHERENT).count();
        if coherent * 2 < deviations.len() {
            continue;
        }
        for &(i, d) in deviations.iter().filter(|(_, d)| d.abs() > INCOHERENT) {
            let old = scene.placed[i].pose;
            let before = measure(scene, i, settings).silhouette_iou.unwrap_or(0.0);
            let yaw = old.yaw + d;
            let about = YawRule::About { yaw, sigma: 0.2 };
            scene.placed[i].pose = replaced(scene, i, &Pose { yaw, ..old }, about, settings);
            let after = measure(scene, i, settings).silhouette_iou.unwrap_or(0.0);
            if after + TURN_COST < before {
                scene.placed[i].pose = old;
            } else {
                report.turned.push((scene.placed[i].item.id.clone(), d));
            }
        }
    }
}

/// Which members of a matched set should exchange their looks so that colours stand where the photo shows them.
///
/// `wanted` are the mean colours under the masks, `shown` those of the rendered objects, in one order. Returns
/// index pairs to swap one after the other; each one lowers the summed colour distance by more than `margin`.
pub fn color_swaps(wanted: &[[f32; 3]], shown: &[[f32; 3]], margin: f32) -> Vec<(usize, usize)> {
    let n = wanted.len().min(shown.len());
    let distance = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f32>().sqrt();
    let mut shown: Vec<[f32; 3]> = shown[..n].to_vec();
    let mut out = Vec::new();
    for _ in 0..n {
        let mut best: Option<(f32, usize, usize)> = None;
        for i in 0..n {
            for j in i + 1..n {
                let now = distance(&wanted[i], &shown[i]) + distance(&wanted[j], &shown[j]);
                let then = distance(&wanted[i], &shown[j]) + distance(&wanted[j], &shown[i]);
                let gain = now - then;
                if gain > margin && best.is_none_or(|(g, _, _)| gain > g) {
                    best = Some((gain, i, j));
                }
            }
        }
        let Some((_, i, j)) = best else { break };
        shown.swap(i, j);
        out.push((i, j));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Evidence;
    use crate::testing::{boxed, empty_room};
    use harmony_scene::{Relations, Support, Vec3};

    #[test]
    fn light_and_dark_chairs_go_back_to_their_sides() {
        let (light, dark) = ([0.8_f32; 3], [0.1_f32; 3]);
        assert_eq!(color_swaps(&[light, dark], &[dark, light], 0.05), vec![(0, 1)]);
        assert!(color_swaps(&[light, dark], &[light, dark], 0.05).is_empty());
        assert!(color_swaps(&[light, light], &[light, [0.79; 3]], 0.05).is_empty());
        let three = [[0.9, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.9]];
        let mut turned = three;
        turned.rotate_left(1);
        for (i, j) in color_swaps(&three, &turned, 0.05) {
            turned.swap(i, j);
        }
        assert_eq!(turned, three);
    }

    #[test]
    fn a_member_that_the_border_cuts_has_no_say_on_the_size() {
        let mut scene = empty_room();
        let size = Vec3::new(0.5, 0.9, 0.5);
        for (i, (x, scale)) in [(1.6, 1.0), (4.4, 1.4)].into_iter().enumerate() {
            let position = Vec3::new(x, 0.0, 2.2);
            let mut item = boxed(&scene, size, position, 0.0);
            item.id = ObjectId::numbered("chair", i);
            item.relations = Relations { matched_set: Some("chairs".to_owned()), ..Relations::default() };
            let evidence = Evidence { silhouette_iou: Some(0.9), ..Evidence::default() };
            let pose = Pose::new(position, 0.0, scale);
            scene.placed.push(Placed { item: Arc::new(item), pose, support: Support::Floor, evidence });
        }
        let cut = |i: usize| touches_border(&scene.placed[i].item.mask);
        assert!(!cut(0) && cut(1), "{:?}", scene.placed[1].item.mask.bounds());
        refine_groups(&mut scene, Level::Furniture, &PlacementSettings::default());
        assert!(scene.placed.iter().all(|p| (p.pose.scale - 1.0).abs() < 1e-9));
    }

    #[test]
    fn a_set_gets_its_median_size() {
        let settings = PlacementSettings::default();
        let mut scene = empty_room();
        for (i, scale) in [1.0, 1.02, 1.3].into_iter().enumerate() {
            let position = Vec3::new(0.8 + 1.2 * i as f64, 0.0, 2.2);
            let mut item = boxed(&scene, Vec3::new(0.5, 0.9, 0.5), position, 0.0);
            item.id = ObjectId::numbered("chair", i);
            item.relations = Relations { matched_set: Some("chairs".to_owned()), ..Relations::default() };
            let evidence = Evidence { silhouette_iou: Some(0.9), ..Evidence::default() };
            let pose = Pose::new(position, 0.0, scale);
            scene.placed.push(Placed { item: Arc::new(item), pose, support: Support::Floor, evidence });
        }
        let report = refine_groups(&mut scene, Level::Furniture, &settings);
        assert_eq!(report.resized.len(), 2);
        for p in &scene.placed {
            assert!((p.pose.scale - 1.02).abs() <= 1e-9);
        }
        // The masks are those of scale 1: each place stays near where it was.
        assert!((scene.placed[2].pose.position - Vec3::new(3.2, 0.0, 2.2)).length() < 0.2);
    }
}
