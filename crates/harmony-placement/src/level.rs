//! One level, from items to placed objects.
//!
//! The items are ordered, each gets hypotheses and a local solve in the scene as it is by then, all are solved together
//! with camera, room and scale, and what that leaves is projected onto support and contact. Passes that follow one
//! another may only take back what costs energy: objects are held where they were, or placed anew, by the rule of
//! `accept`. No file, no model, no clock: the same items give the same scene. What could not be placed is in the report
//! with its reason, not an error.

use std::sync::Arc;

use harmony_scene::{Camera, Level, ObjectId, Pose, Support, Warning, WarningKind};

use crate::accept::{accepts, odds};
use crate::contact::collision::{Collision, collisions, deepest, relax, solids};
use crate::contact::layers::{hang_in_layers, yield_off_walls};
use crate::contact::rest::{back_onto_hosts, hangs_in_the_air, settle_all};
use crate::contact::rows::{join_rows, narrow_rows};
use crate::measure::{measure_all, measure_posterior};
use crate::observe::{Contour, Window, drop_strangers, neighbours};
use crate::propose::between_curtains;
use crate::scene::attachment::{PoseConstraint, YawRule, angle_between, attachment_of};
use crate::scene::subtree::{subtree, take_along};
use crate::solve::joint::refine_globally;
use crate::solve::local::solve;
use crate::terms::placed_energy;
use crate::{Evidence, Item, OrderReport, PartialScene, Placed, PlacementSettings, YawHint};

/// Objects of less confidence get a warning.
const LOW_CONFIDENCE: f64 = 0.05;
/// So does a level whose named sizes are believed less by more than this factor.
const TOLD_INFLATION: f64 = 1.3;

/// How deep an earlier object may come into others when it is placed anew, metres: they are parted after it.
const MAX_INTO_M: f64 = 0.1;

/// How one object fared.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectReport {
    /// The object.
    pub id: ObjectId,
    /// Evidence at its final pose.
    pub evidence: Evidence,
    /// IoU of the first pose.
    pub first_iou: Option<f64>,
    /// Silhouette and depth rounds done.
    pub rounds: usize,
    /// Renders spent.
    pub renders: usize,
    /// Displacement by collision resolution, metres.
    pub moved_by_collision: f64,
    /// Host that replaced the one that was given, if any.
    pub rehosted_to: Option<ObjectId>,
}

/// What happened on a level.
#[derive(Debug, Clone, Default)]
pub struct LevelReport {
    /// The order.
    pub order: OrderReport,
    /// One per placed item, in placement order.
    pub objects: Vec<ObjectReport>,
    /// Items that could not be placed at all, with the reason.
    pub dropped: Vec<(ObjectId, PlacementError)>,
    /// Collisions that stay, deepest first.
    pub unresolved: Vec<Collision>,
    /// Members of rows at a wall that were together longer than their place, and by what share each was narrowed.
    pub narrowed: Vec<(ObjectId, f64)>,
    /// What the joint solve did, if it ran.
    pub global: Option<crate::GlobalReport>,
    /// Shift of the whole scene along x, because the left wall was not seen and had to move, metres.
    pub shifted_x: f64,
    /// Everything that went another way than intended.
    pub warnings: Vec<Warning>,
}

/// Why an item could not be placed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlacementError {
    /// The mask is empty.
    #[error("the mask has no pixel")]
    EmptyMask,
    /// The mask is not of the camera's size.
    #[error("the mask is {width}x{height}, the camera {camera_width}x{camera_height}")]
    MaskSize {
        /// Mask columns.
        width: u32,
        /// Mask rows.
        height: u32,
        /// Camera columns.
        camera_width: u32,
        /// Camera rows.
        camera_height: u32,
    },
    /// The mesh has no extent, or is not finite.
    #[error("the mesh has no usable extent: {width} x {height} x {depth}")]
    Mesh {
        /// Along x.
        width: f64,
        /// Along y.
        height: f64,
        /// Along z.
        depth: f64,
    },
}

/// Places one level's items into the scene, in order, and reports.
///
/// `given_order` is the VLM's, if there is one. Items that cannot be placed are in [`LevelReport::dropped`]; the
/// others are appended to [`PartialScene::placed`] in placement order.
pub fn place_level(
    scene: &mut PartialScene,
    items: Vec<Item>,
    given_order: Option<&[ObjectId]>,
    settings: &PlacementSettings,
) -> LevelReport {
    let mut report = LevelReport::default();
    let mut items: Vec<Item> = items.into_iter().filter(|i| usable(scene, i, &mut report)).collect();
    let Some(level) = items.first().map(|i| i.level) else { return report };
    for item in &mut items {
        drop_strangers(scene, item);
    }
    let finished = Finished::of(scene);
    let ended = ends(scene, settings);
    let items: Vec<Arc<Item>> = items.into_iter().map(Arc::new).collect();
    report.order = crate::placement_order(scene, &items, given_order, settings);
    let mut waiting: Vec<Arc<Item>> = report.order.entries.iter().map(|e| Arc::clone(&items[e.item])).collect();
    waiting.reverse();
    while let Some(item) = waiting.pop() {
        place_one(scene, &item, &waiting, settings, &mut report);
    }
    let each = Finished::of(scene);
    if settings.refinement && settings.global_refinement {
        measure_all(scene, settings);
        report.global = refine_globally(scene, settings);
        tracing::debug!(?level, report = ?report.global, "solved jointly");
    }
    centre_windows(scene, settings);
    back_onto_hosts(scene);
    if settings.refinement {
        follow_hosts(scene, settings);
        see_again(scene, &ended, settings);
    }
    if settings.collision {
        part(scene, settings, &mut report);
    }
    settle_all(scene, settings);
    let scale = report.global.filter(|g| g.kept).map_or(1.0, |g| g.scale);
    finished.hold(scene, scale, 0.0, settings);
    // What all of them together, and what stands in what, moved too far from what is seen of it: a cushion onto an arm.
    each.hold(scene, scale, settings.noise.joint_slack, settings);
    report.shifted_x = scene.fit_loose_walls();
    settle_all(scene, settings);
    if join_rows(scene, settings) {
        settle_all(scene, settings);
    }
    hang_in_layers(scene, settings);
    if settings.collision {
        yield_off_walls(scene, settings);
        report.unresolved = collisions(scene, settings);
    }
    measure_posterior(scene, settings);
    for object in &mut report.objects {
        if let Some(p) = scene.find(&object.id) {
            object.evidence = p.evidence;
            object.rehosted_to = rehosted_to(p);
        }
    }
    report.warnings = warnings(scene, level, &report);
    report
}

/// Smaller changes are no drift: metres, radians, logarithm of the scale.
const STILL: (f64, f64, f64) = (0.01, 0.01, 0.01);

/// Where objects stood, and the camera that saw them so.
struct Finished {
    camera: Camera,
    poses: Vec<(ObjectId, Pose)>,
}

impl Finished {
    fn of(scene: &PartialScene) -> Self {
        Self { camera: scene.camera, poses: scene.placed.iter().map(|p| (p.item.id.clone(), p.pose)).collect() }
    }

    /// Puts objects back that agree less with what is seen of them where they are now, by so many nats, and would not be in
    /// anything where they were: a later level moves them with camera and scale, and where it has reasons.
    fn hold(&self, scene: &mut PartialScene, scale: f64, by: f64, settings: &PlacementSettings) {
        let turn = scene.camera.rotation.transpose() * self.camera.rotation;
        let (from, to) = (self.camera.centre(), scene.camera.centre());
        for (id, pose) in &self.poses {
            let Some(i) = scene.position(id) else { continue };
            let now = scene.placed[i].pose;
            let yaw = pose.yaw + turn_about_vertical(&turn);
            let carried =
                Pose { position: to + turn * (pose.position - from) * scale, yaw, scale: pose.scale * scale, ..*pose };
            let grown = (now.scale * now.stretch / (carried.scale * carried.stretch)).map(f64::ln).abs().max_element();
            let turned = angle_between(now.yaw, carried.yaw).abs();
            if now.position.distance(carried.position) < STILL.0 && turned < STILL.1 && grown < STILL.2 {
                continue;
            }
            let (item, noise) = (Arc::clone(&scene.placed[i].item), &settings.noise);
            let (attachment, rule) = (attachment_of(scene, i, noise), YawRule::Fixed(carried.yaw));
            let held =
                PoseConstraint { fixed_size: true, ..PoseConstraint::new(scene, &item, attachment, rule, noise) };
            let back = held.settle(&carried);
            let energy = |scene: &PartialScene| placed_energy(scene, i, settings).map(|e| e.total());
            let depth = |scene: &PartialScene| deepest(scene, &solids(scene), i, settings);
            let Some(was) = energy(scene) else { continue };
            let mut tried = scene.clone();
            take_along(&mut tried, i, back);
            // A reviewer's word was worth this much when the correction was kept; it still is.
            let word = if item.traits.corrected { odds(noise.wrong_review) } else { 0.0 };
            let better = energy(&tried).is_some_and(|is| accepts(was, is, word - by));
            if better && depth(&tried) <= depth(scene) {
                tracing::debug!(object = %id, "held where it was");
                *scene = tried;
            }
        }
    }
}

/// The sides at which each placed object's mask ends by itself: left, top, right, bottom.
fn ends(scene: &PartialScene, settings: &PlacementSettings) -> Vec<(ObjectId, [bool; 4])> {
    let of = |(i, placed): (usize, &Placed)| {
        let others = neighbours(scene, &placed.item, &[], Some(i));
        (placed.item.id.clone(), Contour::new(scene, &placed.item, &others, settings).free_sides())
    };
    scene.placed.iter().enumerate().map(of).collect()
}

/// Places finished objects anew where this level showed that they do not end where their masks do: a window whose lower part
/// the sofa hides was placed when no sofa was known. What a reviewer has corrected stays.
fn see_again(scene: &mut PartialScene, ended: &[(ObjectId, [bool; 4])], settings: &PlacementSettings) {
    let now = ends(scene, settings);
    for (id, before) in ended {
        let hidden = |(other, free): &&(ObjectId, [bool; 4])| other == id && (0..4).any(|k| before[k] && !free[k]);
        let Some(i) = now.iter().find(hidden).and_then(|_| scene.position(id)) else { continue };
        let item = Arc::clone(&scene.placed[i].item);
        if item.traits.corrected {
            continue;
        }
        let Some(window) = Window::new(scene, &item, Some(i), &[], settings) else { continue };
        let anew = solve(scene, &item, &window, settings);
        if anew.objective.constraint.support() != scene.placed[i].support {
            continue;
        }
        let energy = |scene: &PartialScene| placed_energy(scene, i, settings).map(|e| e.total());
        let depth = |scene: &PartialScene| deepest(scene, &solids(scene), i, settings);
        let mut tried = scene.clone();
        take_along(&mut tried, i, anew.pose);
        let better = energy(scene).zip(energy(&tried)).is_some_and(|(was, is)| accepts(was, is, 0.0));
        if better && depth(&tried) <= depth(scene) + MAX_INTO_M {
            tracing::debug!(object = %id, "placed anew: this level hides a part of it");
            *scene = tried;
        }
    }
}

/// The turn about the vertical of a rotation that is nearly one.
fn turn_about_vertical(rotation: &harmony_scene::Mat3) -> f64 {
    (rotation.z_axis.x - rotation.x_axis.z).atan2(rotation.x_axis.x + rotation.z_axis.z)
}

/// The host that carries an object, where it is not the given one.
fn rehosted_to(placed: &Placed) -> Option<ObjectId> {
    let given = placed.item.relations.on_top_of.as_ref()?;
    match &placed.support {
        Support::Object { id } if given != id => Some(id.clone()),
        _ => None,
    }
}

/// How far an object is turned from the front that was answered for it, radians, where that is another side of it.
fn off_its_answer(placed: &Placed) -> Option<f64> {
    let YawHint::About(yaw) = placed.item.yaw else { return None };
    let off = angle_between(placed.pose.yaw, yaw).abs();
    (off > std::f64::consts::FRAC_PI_4 && placed.item.traits.has_front).then_some(off)
}

/// What a person should know about a level, beside what was dropped and what stays unresolved: those are lists of
/// the report on which the caller acts.
fn warnings(scene: &PartialScene, level: Level, report: &LevelReport) -> Vec<Warning> {
    let mut out = Vec::new();
    let mut tell = |object: Option<&ObjectId>, kind: WarningKind, message: String| {
        out.push(Warning { phase: level.folder().to_owned(), object: object.cloned(), kind, message });
    };
    for id in &report.order.broken_cycles {
        let message = "its relations go in a circle; one was left out of the placement order".to_owned();
        tell(Some(id), WarningKind::AnswerRepaired, message);
    }
    for id in &report.order.ignored {
        let message = format!("the given placement order names {id}, which is unknown or named twice");
        tell(None, WarningKind::AnswerRepaired, message);
    }
    if let Some(global) = &report.global {
        if global.size_inflation > TOLD_INFLATION {
            let message = format!(
                "the named sizes contradict one another: they were believed {:.1} times less",
                global.size_inflation
            );
            tell(None, WarningKind::LowConfidence, message);
        }
        if !global.kept {
            let [before, after] = global.energy;
            let message = format!(
                "the refinement of camera, room and objects together was not kept: its energy rose from {before:.0} to {after:.0} nats"
            );
            tell(None, WarningKind::Fallback, message);
        }
    }
    for (id, share) in &report.narrowed {
        let message = format!("made {:.0} % narrower: its row is longer than its place at the wall", share * 100.0);
        tell(Some(id), WarningKind::LowConfidence, message);
    }
    for object in &report.objects {
        if let Some(host) = &object.rehosted_to {
            let message = format!("it was placed on {host}, where its box lies, not on the given host");
            tell(Some(&object.id), WarningKind::AnswerRepaired, message);
        }
        if let Some(off) = scene.find(&object.id).and_then(off_its_answer) {
            let message = format!(
                "it is turned by {:.0} degrees from the front that was answered: its outline and place say so",
                off.to_degrees()
            );
            tell(Some(&object.id), WarningKind::AnswerRepaired, message);
        }
        if scene.position(&object.id).is_some_and(|i| hangs_in_the_air(scene, i)) {
            let message = "nothing is under it: what it stands on was perhaps not found in the photo".to_owned();
            tell(Some(&object.id), WarningKind::LowConfidence, message);
        }
        let confidence = scene.find(&object.id).map_or(0.0, |p| p.confidence().overall);
        if confidence < LOW_CONFIDENCE {
            let message =
                format!("it is probably not within 15 cm, 10 degrees and 12 % of where it should be ({confidence:.2})");
            tell(Some(&object.id), WarningKind::LowConfidence, message);
        }
    }
    out
}

/// Centres windows of which both ends are hidden between the curtains that hide them.
fn centre_windows(scene: &mut PartialScene, settings: &PlacementSettings) {
    for i in 0..scene.placed.len() {
        let Some(pose) = between_curtains(scene, i, settings) else { continue };
        let before = placed_energy(scene, i, settings).unwrap_or_default().total();
        let old = std::mem::replace(&mut scene.placed[i].pose, pose);
        let after = placed_energy(scene, i, settings).unwrap_or_default().total();
        if !accepts(before, after, odds(settings.noise.off_curtains)) {
            scene.placed[i].pose = old;
        }
    }
}

/// Places anew what hangs in the air because the joint solve took its host from under it.
fn follow_hosts(scene: &mut PartialScene, settings: &PlacementSettings) {
    for i in 0..scene.placed.len() {
        if !hangs_in_the_air(scene, i) {
            continue;
        }
        let item = Arc::clone(&scene.placed[i].item);
        let Some(window) = Window::new(scene, &item, Some(i), &[], settings) else { continue };
        let anew = solve(scene, &item, &window, settings);
        let (pose, support) = (anew.pose, anew.objective.constraint.support());
        let energy = |scene: &PartialScene| placed_energy(scene, i, settings).unwrap_or_default().total();
        let was = energy(scene);
        let before = (scene.placed[i].pose, scene.placed[i].support.clone());
        (scene.placed[i].pose, scene.placed[i].support) = (pose, support);
        if hangs_in_the_air(scene, i) || !accepts(was, energy(scene), odds(settings.noise.in_the_air)) {
            (scene.placed[i].pose, scene.placed[i].support) = before;
            continue;
        }
        // What stands on it goes along.
        let by = pose.position - before.0.position;
        for member in subtree(scene, i).into_iter().filter(|member| *member != i) {
            scene.placed[member].pose.position += by;
        }
    }
}

/// Brings everything apart together, and reports what stays.
fn part(scene: &mut PartialScene, settings: &PlacementSettings, report: &mut LevelReport) {
    measure_all(scene, settings);
    let gone = relax(scene, settings);
    for (placed, far) in scene.placed.iter().zip(gone) {
        if let Some(object) = report.objects.iter_mut().find(|o| o.id == placed.item.id) {
            object.moved_by_collision += far;
        }
    }
    report.narrowed = narrow_rows(scene, settings);
}

/// Whether an item can be placed at all; if not, it is reported as dropped.
fn usable(scene: &PartialScene, item: &Item, report: &mut LevelReport) -> bool {
    let (mask, camera) = (item.mask.size(), scene.camera.size);
    let extent = item.shape.bounds().size();
    let error = if mask != camera {
        PlacementError::MaskSize {
            width: mask.width,
            height: mask.height,
            camera_width: camera.width,
            camera_height: camera.height,
        }
    } else if item.mask.bounds().is_none() {
        PlacementError::EmptyMask
    } else if !(extent.is_finite() && extent.max_element() > 1e-6) {
        PlacementError::Mesh { width: extent.x, height: extent.y, depth: extent.z }
    } else {
        return true;
    };
    report.dropped.push((item.id.clone(), error));
    false
}

/// Solves one object against what is placed, and appends it.
fn place_one(
    scene: &mut PartialScene,
    item: &Arc<Item>,
    waiting: &[Arc<Item>],
    settings: &PlacementSettings,
    report: &mut LevelReport,
) {
    let Some(window) = Window::new(scene, item, None, waiting, settings) else {
        report.dropped.push((item.id.clone(), PlacementError::EmptyMask));
        return;
    };
    let solution = solve(scene, item, &window, settings);
    tracing::debug!(object = %item.id, energy = ?solution.energy, iou = solution.seen.iou, renders = solution.renders, "placed");
    let (pose, evidence) = (solution.pose, solution.evidence());
    report.objects.push(ObjectReport {
        id: item.id.clone(),
        evidence,
        first_iou: Some(solution.first_iou),
        rounds: solution.rounds,
        renders: solution.renders,
        moved_by_collision: 0.0,
        rehosted_to: None,
    });
    let support = solution.objective.constraint.support();
    scene.placed.push(Placed { item: Arc::clone(item), pose, support, evidence });
}

#[cfg(test)]
mod tests {
    use harmony_scene::Vec3;

    use super::*;
    use crate::Traits;
    use crate::testing::{boxed, empty_room};

    #[test]
    fn what_the_global_refinement_doubted_or_refused_is_told() {
        let told = |doubt: f64, kept: bool| {
            let global = crate::GlobalReport {
                energy: [80.0, 60.0 + if kept { 0.0 } else { 100.0 }],
                camera_moved_m: 0.0,
                camera_turned_deg: 0.0,
                scale: 1.0,
                size_inflation: doubt,
                objects_moved_m: 0.0,
                kept,
            };
            let report = LevelReport { global: Some(global), ..LevelReport::default() };
            warnings(&empty_room(), Level::Furniture, &report).into_iter().map(|w| w.message).collect::<Vec<_>>()
        };
        assert!(told(1.0, true).is_empty());
        let all = told(2.04, false);
        assert!(
            all.len() == 2 && all[0].contains("2.0 times less") && all[1].ends_with("from 80 to 160 nats"),
            "{all:?}"
        );
    }

    /// A window from 0.9 m up to 2.1 m, before which a sofa of 1.3 m stands.
    #[test]
    fn what_a_later_level_hides_gets_its_whole_size_back() {
        let settings = PlacementSettings { point_map: false, ..PlacementSettings::default() };
        let mut scene = empty_room();
        let mut window = boxed(&scene, Vec3::new(1.4, 1.2, 0.06), Vec3::new(2.0, 0.9, 0.03), 0.0);
        (window.id, window.level) = (ObjectId::numbered("window", 1), Level::Wall);
        window.traits = Traits { planar: true, opening: true, may_stretch: true, ..Traits::default() };
        let mut sofa = boxed(&scene, Vec3::new(2.2, 1.3, 0.8), Vec3::new(2.0, 0.0, 1.0), 0.0);
        (sofa.id, sofa.level) = (ObjectId::numbered("sofa", 1), Level::Furniture);
        let whole = window.mask.clone();
        window.mask = window.mask.minus(&sofa.mask).into();
        assert!(window.mask.count() * 10 < whole.count() * 9, "the sofa hides a part of it");
        place_level(&mut scene, vec![window], None, &settings);
        let first = scene.placed[0].size().height;
        place_level(&mut scene, vec![sofa], None, &settings);
        let then = scene.find(&ObjectId::numbered("window", 1)).unwrap().size().height;
        assert!(
            (then - 1.2).abs() < (first - 1.2).abs() - 0.03 && (then - 1.2).abs() < 0.1,
            "{first} m, then {then} m"
        );
    }

    #[test]
    fn what_is_on_a_ledge_of_the_room_stands_there_whether_it_was_said_or_is_seen() {
        let settings = PlacementSettings { point_map: false, ..PlacementSettings::default() };
        let ledge =
            harmony_scene::Block { kind: "half-high wall".to_owned(), min: Vec3::ZERO, max: Vec3::new(4.0, 0.8, 0.4) };
        let at = Vec3::new(2.4, 0.8, 0.2);
        let name = ObjectId::numbered("vase", 1);
        for said in [true, false] {
            let mut scene = empty_room();
            scene.room.shape.blocks = vec![ledge.clone()];
            let mut vase = boxed(&scene, Vec3::new(0.2, 0.3, 0.2), at, 0.0);
            (vase.id, vase.level) = (name.clone(), Level::Decoration);
            vase.relations.on_top_of = said.then(|| harmony_scene::Ledge::Block(0).id());
            place_level(&mut scene, vec![vase], None, &settings);
            let placed = scene.find(&name).unwrap();
            assert_eq!(placed.support, Support::Block { block: 0 }, "{said}");
            assert!(placed.pose.position.distance(at) < 0.03, "{said}: {}", placed.pose.position);
            // A later level finds it there.
            let chair = boxed(&scene, Vec3::new(0.5, 0.9, 0.5), Vec3::new(1.2, 0.0, 2.5), 0.0);
            place_level(&mut scene, vec![Item { level: Level::Decoration, ..chair }], None, &settings);
            assert!(scene.find(&name).unwrap().pose.position.distance(at) < 0.03);
        }
        // What hangs above it hangs on the wall, not before its front.
        let mut scene = empty_room();
        scene.room.shape.blocks = vec![ledge];
        let mut board = boxed(&scene, Vec3::new(1.0, 0.04, 0.3), Vec3::new(1.5, 0.8, 0.15), 0.0);
        (board.id, board.level) = (ObjectId::numbered("board", 1), Level::Wall);
        board.relations.wall_affinity = harmony_scene::WallAffinity::Back;
        place_level(&mut scene, vec![board], None, &settings);
        let z = scene.placed[0].pose.position.z;
        assert!((z - 0.15).abs() < 0.03, "{z}");
    }

    #[test]
    fn what_is_in_a_windows_recess_stands_on_its_sill() {
        let settings = PlacementSettings { point_map: false, ..PlacementSettings::default() };
        let at = Vec3::new(2.4, 0.7, -0.15);
        for said in [true, false] {
            let mut scene = empty_room();
            scene.room.shape.niches = vec![harmony_scene::Niche {
                kind: "window recess".to_owned(),
                surface: harmony_scene::Surface::Back,
                sides: None,
                glow: None,
                min: Vec3::new(1.8, 0.7, -0.3),
                max: Vec3::new(3.0, 2.0, 0.0),
            }];
            let mut vase = boxed(&scene, Vec3::new(0.2, 0.3, 0.2), at, 0.0);
            (vase.id, vase.level) = (ObjectId::numbered("vase", 1), Level::Decoration);
            vase.relations.on_top_of = said.then(|| harmony_scene::Ledge::Niche(0).id());
            place_level(&mut scene, vec![vase], None, &settings);
            let placed = &scene.placed[0];
            assert_eq!(placed.support, Support::Niche { niche: 0 }, "{said}");
            assert!(placed.pose.position.distance(at) < 0.05, "{said}: {}", placed.pose.position);
        }
    }

    #[test]
    fn a_finished_object_goes_back_to_its_mask_and_takes_along_what_it_carries() {
        let mut scene = empty_room();
        let at = Vec3::new(2.0, 0.0, 2.0);
        for (name, size, base, support) in [
            ("table", Vec3::new(1.0, 0.7, 0.6), at, Support::Floor),
            (
                "vase",
                Vec3::new(0.2, 0.3, 0.2),
                at + Vec3::Y * 0.7,
                Support::Object { id: ObjectId::numbered("table", 1) },
            ),
        ] {
            let mut item = boxed(&scene, size, base, 0.0);
            item.id = ObjectId::numbered(name, 1);
            let pose = Pose::new(base, 0.0, 1.0);
            scene.placed.push(Placed { item: Arc::new(item), pose, support, evidence: Evidence::default() });
        }
        let finished = Finished::of(&scene);
        let settings = PlacementSettings::default();
        let slack = settings.noise.joint_slack;
        // A later level shifts both.
        let shift = Vec3::new(0.25, 0.0, 0.0);
        scene.placed.iter_mut().for_each(|p| p.pose.position += shift);
        let mut slightly = scene.clone();
        slightly.placed.iter_mut().for_each(|p| p.pose.position -= shift * 0.9);
        let there = slightly.placed[0].pose.position;
        finished.hold(&mut slightly, 1.0, slack, &settings);
        assert!(slightly.placed[0].pose.position.distance(there) < 1e-6, "a few centimetres are no {slack} nats");
        let mut far = scene.clone();
        finished.hold(&mut far, 1.0, slack, &settings);
        assert!(far.placed[0].pose.position.distance(at) < 1e-6, "{:?}", far.placed[0].pose);
        finished.hold(&mut scene, 1.0, 0.0, &settings);
        assert!(scene.placed[0].pose.position.distance(at) < 1e-6, "{:?}", scene.placed[0].pose);
        assert!(scene.placed[1].pose.position.distance(at + Vec3::Y * 0.7) < 1e-6);
        // Where it agrees better than before, it stays.
        let elsewhere = Finished {
            camera: scene.camera,
            poses: vec![(scene.placed[0].item.id.clone(), Pose::new(at + shift, 0.0, 1.0))],
        };
        elsewhere.hold(&mut scene, 1.0, 0.0, &settings);
        assert!(scene.placed[0].pose.position.distance(at) < 1e-6);
        // What a reviewer has put a little beside its mask goes back there as long as that is worth the reviewer's word.
        let beside = Finished {
            camera: scene.camera,
            poses: vec![(scene.placed[0].item.id.clone(), Pose::new(at + Vec3::X * 0.015, 0.0, 1.0))],
        };
        beside.hold(&mut scene, 1.0, 0.0, &settings);
        assert!(scene.placed[0].pose.position.distance(at) < 1e-6, "nobody said so");
        let mut told = scene.clone();
        Arc::make_mut(&mut told.placed[0].item).traits.corrected = true;
        beside.hold(&mut told, 1.0, 0.0, &settings);
        assert!((told.placed[0].pose.position.x - at.x - 0.015).abs() < 1e-6, "{:?}", told.placed[0].pose);
        elsewhere.hold(&mut told, 1.0, 0.0, &settings);
        assert!((told.placed[0].pose.position.x - at.x - 0.015).abs() < 1e-6, "a word is not worth everything");
        // A camera that turned takes the scene with it.
        let turn = harmony_scene::Mat3::from_rotation_y(0.3);
        assert!((turn_about_vertical(&turn) - 0.3).abs() < 1e-9);
    }

    #[test]
    fn what_lost_its_host_is_placed_on_it_anew() {
        let mut scene = empty_room();
        let put = |scene: &mut PartialScene, item: Item, at: Vec3, support: Support| {
            let pose = harmony_scene::Pose::new(at, 0.0, 1.0);
            scene.placed.push(Placed { item: Arc::new(item), pose, support, evidence: Evidence::default() });
        };
        let at = Vec3::new(2.0, 0.0, 2.0);
        let mut table = boxed(&scene, Vec3::new(0.8, 0.7, 0.6), at, 0.0);
        table.id = ObjectId::numbered("table", 1);
        let on_table = at + Vec3::Y * 0.7;
        let mut lamp = boxed(&scene, Vec3::new(0.2, 0.4, 0.2), on_table, 0.0);
        lamp.id = ObjectId::numbered("lamp", 1);
        lamp.level = Level::Decoration;
        lamp.relations.on_top_of = Some(table.id.clone());
        let support = Support::Object { id: table.id.clone() };
        put(&mut scene, table, at, Support::Floor);
        // The table has come nearer by 0.9 m since the lamp was put there.
        let mut cap = boxed(&scene, Vec3::splat(0.1), on_table + Vec3::Y * 0.4, 0.0);
        cap.id = ObjectId::numbered("cap", 1);
        let on_lamp = Support::Object { id: lamp.id.clone() };
        put(&mut scene, lamp, on_table - Vec3::Z * 0.9, support);
        put(&mut scene, cap, on_table + Vec3::Y * 0.4 - Vec3::Z * 0.9, on_lamp);
        assert!(hangs_in_the_air(&scene, 1));
        follow_hosts(&mut scene, &PlacementSettings::default());
        assert!(!hangs_in_the_air(&scene, 1));
        let found = scene.placed[1].pose.position;
        assert!(found.distance(on_table) < 0.05, "{found}");
        let cap = scene.placed[2].pose.position;
        assert!(cap.distance(found + Vec3::Y * 0.4) < 1e-9, "{cap}");
    }
}
