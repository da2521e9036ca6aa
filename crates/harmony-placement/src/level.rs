//! One level, from items to placed objects.

use std::sync::Arc;

use harmony_scene::{Level, Mask, ObjectId, Support, Wall, Warning, WarningKind};

use crate::anchoring::{Anchoring, Frame, LARGEST_GAP, YawRule};
use crate::cost::angle_between;
use crate::solve::{polish, solve};
use crate::view::{Neighbour, View};
use crate::{Evidence, GroupReport, Item, OrderReport, PartialScene, Placed, PlacementSettings, YawHint, collision};

/// Objects that agree less with their mask than this are placed anew when the level is complete.
const DOUBTFUL_IOU: f64 = 0.8;

/// Objects of less confidence get a warning.
const LOW_CONFIDENCE: f64 = 0.4;
/// So does a level whose named sizes are doubted by more than this factor.
const TOLD_DOUBT: f64 = 1.3;

/// Two objects that no move separated.
#[derive(Debug, Clone, PartialEq)]
pub struct Unresolved {
    /// One.
    pub a: ObjectId,
    /// The other; `None` for a wall or the floor.
    pub b: Option<ObjectId>,
    /// How deep they are in one another, metres.
    pub penetration: f64,
}

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
    /// Collisions that stay; the pipeline may ask for another order.
    pub unresolved: Vec<Unresolved>,
    /// Members of rows at a wall that were together longer than their place, and by what share each was narrowed.
    pub narrowed: Vec<(ObjectId, f64)>,
    /// What group refinement changed.
    pub groups: GroupReport,
    /// What the global refinement did, if it ran.
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
    for item in &mut items {
        crate::pieces::drop_strangers(scene, item);
    }
    let items: Vec<Arc<Item>> = items.into_iter().map(Arc::new).collect();
    report.order = crate::placement_order(scene, &items, given_order, settings);
    let mut waiting: Vec<Arc<Item>> = report.order.entries.iter().map(|e| Arc::clone(&items[e.item])).collect();
    waiting.reverse();
    let level = items.first().map(|i| i.level);
    let first = scene.placed.len();
    while let Some(item) = waiting.pop() {
        place_one(scene, &item, &waiting, settings, &mut report);
    }
    if settings.refinement && settings.second_look {
        look_again(scene, first, settings, &mut report);
    }
    if let Some(level) = level.filter(|_| settings.groups) {
        report.groups = crate::refine_groups(scene, level, settings);
        let changed = !report.groups.resized.is_empty() || !report.groups.turned.is_empty();
        if changed && settings.collision {
            for i in first..scene.placed.len() {
                separate(scene, i, settings, &mut report);
            }
        }
    }
    if let Some(level) = level {
        if settings.refinement && settings.global_refinement {
            crate::evidence::measure_all(scene, settings);
            report.global = crate::refine_globally(scene, settings);
            tracing::debug!(?level, report = ?report.global, "refined globally");
        }
        crate::plausible::fronts_from_walls(scene, settings);
        crate::plausible::between_curtains(scene, settings);
        crate::plausible::back_onto_hosts(scene);
        if settings.refinement {
            follow_hosts(scene, settings);
        }
        if settings.collision {
            part_all(scene, settings, &mut report);
        }
        report.shifted_x = scene.fit_loose_walls();
        // Collisions may have moved a host under what it carries.
        crate::global::settle_all(scene, settings);
        crate::evidence::measure_all(scene, settings);
    }
    for object in &mut report.objects {
        if let Some(p) = scene.find(&object.id) {
            object.evidence = p.evidence;
            let given = p.item.relations.on_top_of.as_ref();
            object.rehosted_to = match &p.support {
                Support::Object { id } if given.is_some_and(|g| g != id) => Some(id.clone()),
                _ => None,
            };
        }
    }
    report.warnings = level.map_or(Vec::new(), |level| warnings(scene, level, &report));
    report
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
        if global.doubt > TOLD_DOUBT {
            let message =
                format!("the named sizes contradict one another: they were believed {:.1} times less", global.doubt);
            tell(None, WarningKind::LowConfidence, message);
        }
        if !global.kept {
            let message = format!(
                "the refinement of camera, room and objects together was not kept: agreement with the masks {:.2} before, {:.2} after, {} lost theirs",
                global.iou[0], global.iou[1], global.lost
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
        if scene.position(&object.id).is_some_and(|i| crate::plausible::hangs_in_the_air(scene, i)) {
            let message = "nothing is under it: what it stands on was perhaps not found in the photo".to_owned();
            tell(Some(&object.id), WarningKind::LowConfidence, message);
        }
        let confidence = scene.find(&object.id).map_or(0.0, |p| p.confidence().overall);
        if confidence < LOW_CONFIDENCE {
            let message = format!("mask, depth and neighbours agree little with its pose ({confidence:.2})");
            tell(Some(&object.id), WarningKind::LowConfidence, message);
        }
    }
    out
}

/// Places every object of the level once more, now that all its neighbours are there: what was excused as perhaps
/// hidden by an object to come can be checked by now.
fn look_again(scene: &mut PartialScene, first: usize, settings: &PlacementSettings, report: &mut LevelReport) {
    for i in first..scene.placed.len() {
        let item = Arc::clone(&scene.placed[i].item);
        let others = neighbours(scene, &item, &[], Some(i));
        let Some(view) = View::new(scene, Some(i), &item.mask, &others, settings.window_px) else { continue };
        let placed = &scene.placed[i];
        let seen = view.compare(item.shape.proxy(), &placed.pose);
        let yaw = match item.yaw {
            YawHint::Fixed(yaw) => YawRule::Fixed(yaw),
            _ => YawRule::About { yaw: placed.pose.yaw, sigma: 0.2 },
        };
        let (anchoring, wall_gap) = (anchoring_of(scene, i), settings.wall_gap);
        let frame = Frame { scene, item: &item, anchoring, yaw, wall_gap, fixed_size: false };
        let mut best = polish(frame, &placed.pose, &view, settings, settings.renders_per_object / 3);
        if seen.strict_iou < DOUBTFUL_IOU {
            let fresh = solve(scene, &item, &view, settings);
            if fresh.cost < best.cost {
                best = fresh;
            }
        }
        let (pose, support, renders) = (best.pose, best.support(), best.renders);
        let by = pose.position - scene.placed[i].pose.position;
        for dependant in collision::body(scene, i) {
            scene.placed[dependant].pose.position += by;
        }
        scene.placed[i].pose = pose;
        scene.placed[i].support = support;
        if let Some(object) = report.objects.iter_mut().find(|o| o.id == item.id) {
            object.renders += renders;
        }
    }
    report.unresolved.clear();
    if settings.collision {
        for i in first..scene.placed.len() {
            separate(scene, i, settings, report);
        }
    }
}

/// Places anew what hangs in the air because the global refinement took its host from under it.
fn follow_hosts(scene: &mut PartialScene, settings: &PlacementSettings) {
    for i in 0..scene.placed.len() {
        if !crate::plausible::hangs_in_the_air(scene, i) {
            continue;
        }
        let item = Arc::clone(&scene.placed[i].item);
        let others = neighbours(scene, &item, &[], Some(i));
        let Some(view) = View::new(scene, Some(i), &item.mask, &others, settings.window_px) else { continue };
        let anew = solve(scene, &item, &view, settings);
        let (pose, support) = (anew.pose, anew.support());
        let before = (scene.placed[i].pose, scene.placed[i].support.clone());
        (scene.placed[i].pose, scene.placed[i].support) = (pose, support);
        if crate::plausible::hangs_in_the_air(scene, i) {
            (scene.placed[i].pose, scene.placed[i].support) = before;
            continue;
        }
        // What stands on it goes along.
        let by = pose.position - before.0.position;
        for member in collision::body(scene, i).into_iter().filter(|member| *member != i) {
            scene.placed[member].pose.position += by;
        }
    }
}

/// Brings everything apart together, and reports what stays.
fn part_all(scene: &mut PartialScene, settings: &PlacementSettings, report: &mut LevelReport) {
    crate::evidence::measure_all(scene, settings);
    let gone = collision::relax(scene, settings);
    for (placed, far) in scene.placed.iter().zip(gone) {
        if let Some(object) = report.objects.iter_mut().find(|o| o.id == placed.item.id) {
            object.moved_by_collision += far;
        }
    }
    report.narrowed = crate::plausible::narrow_rows(scene, settings);
    report.unresolved = collision::collisions(scene, settings)
        .into_iter()
        .map(|c| Unresolved { a: c.a, b: Some(c.b), penetration: c.penetration })
        .collect();
}

/// Looks at every object once more in the camera and room that the global refinement left.
pub(crate) fn polish_all(scene: &mut PartialScene, settings: &PlacementSettings) {
    use rayon::prelude::*;
    let still: &PartialScene = scene;
    let poses: Vec<(usize, harmony_scene::Pose)> = (0..still.placed.len())
        .into_par_iter()
        .filter_map(|i| {
            let item = Arc::clone(&still.placed[i].item);
            let others = neighbours(still, &item, &[], Some(i));
            let view = View::new(still, Some(i), &item.mask, &others, settings.window_px)?;
            let pose = still.placed[i].pose;
            let yaw = YawRule::About { yaw: pose.yaw, sigma: 0.04 };
            let (anchoring, wall_gap) = (anchoring_of(still, i), settings.wall_gap);
            let frame = Frame { scene: still, item: &item, anchoring, yaw, wall_gap, fixed_size: false };
            Some((i, polish(frame, &pose, &view, settings, settings.renders_per_object / 4).pose))
        })
        .collect();
    crate::global::take_poses(scene, poses, settings);
}

/// Resolves the collisions of one placed object.
fn separate(scene: &mut PartialScene, object: usize, settings: &PlacementSettings, report: &mut LevelReport) {
    let resolution = collision::resolve(scene, object, settings);
    for (who, far) in resolution.moved {
        let id = &scene.placed[who].item.id;
        if let Some(object) = report.objects.iter_mut().find(|o| o.id == *id) {
            object.moved_by_collision += far;
        }
    }
    for u in resolution.unresolved {
        let same = |v: &Unresolved| {
            let pair = |w: &Unresolved| (w.a.clone(), w.b.clone());
            pair(v) == pair(&u) || (u.b.as_ref() == Some(&v.a) && v.b.as_ref() == Some(&u.a))
        };
        if !report.unresolved.iter().any(same) {
            report.unresolved.push(u);
        }
    }
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
    let neighbours = neighbours(scene, item, waiting, None);
    let Some(view) = View::new(scene, None, &item.mask, &neighbours, settings.window_px) else {
        report.dropped.push((item.id.clone(), PlacementError::EmptyMask));
        return;
    };
    let solution = solve(scene, item, &view, settings);
    tracing::debug!(object = %item.id, cost = solution.cost, iou = solution.seen.iou, renders = solution.renders, "placed");
    let support = solution.support();
    let given = item.relations.on_top_of.as_ref();
    let rehosted_to = match &support {
        Support::Object { id } if given.is_some_and(|g| g != id) => Some(id.clone()),
        _ => None,
    };
    let evidence = crate::evidence::of_solution(&solution, &view);
    report.objects.push(ObjectReport {
        id: item.id.clone(),
        evidence,
        first_iou: Some(solution.first_iou),
        rounds: solution.rounds,
        renders: solution.renders,
        moved_by_collision: 0.0,
        rehosted_to,
    });
    let pose = solution.pose;
    scene.placed.push(Placed { item: Arc::clone(item), pose, support, evidence });
    if settings.collision {
        separate(scene, scene.placed.len() - 1, settings, report);
    }
}

/// How a placed object is held, from its support, its relations and where it stands.
pub(crate) fn anchoring_of(scene: &PartialScene, object: usize) -> Anchoring {
    let placed = &scene.placed[object];
    match &placed.support {
        Support::Wall { wall } => Anchoring::OnWall(*wall),
        Support::Ceiling => Anchoring::Ceiling,
        Support::Object { id } => match scene.position(id) {
            Some(host) if host != object => Anchoring::OnHost { host, level: placed.pose.position.y },
            _ => Anchoring::Floor,
        },
        Support::Floor => match placed.item.relations.wall_affinity.wall() {
            Some(wall) if !scene.is_loose(wall) && at_wall(scene, placed, wall) => Anchoring::AgainstWall(wall),
            _ => Anchoring::Floor,
        },
    }
}

/// Whether an object stands with its back to a wall.
fn at_wall(scene: &PartialScene, placed: &Placed, wall: Wall) -> bool {
    let gap = wall.distance(&scene.room.extents, placed.pose.position) - placed.size().depth / 2.0;
    gap < LARGEST_GAP + 0.01 && angle_between(placed.pose.yaw, wall.yaw()).abs() < 0.02
}

/// Masks of all other objects, with whether they may hide this one.
pub(crate) fn neighbours<'a>(
    scene: &'a PartialScene,
    item: &'a Item,
    waiting: &'a [Arc<Item>],
    skip: Option<usize>,
) -> Vec<Neighbour<'a>> {
    let bottom = |mask: &Mask| mask.bounds().map_or(0.0, |b| b.y1);
    let own_bottom = bottom(&item.mask);
    let slack = 0.02 * f64::from(scene.camera.size.height);
    let own_box = item.mask.bounds();
    // What is seen inside an object's box most often stands before it, whatever its lowest row says.
    let inside = |mask: &Mask| match (mask.bounds(), &own_box) {
        (Some(b), Some(own)) => b.covered_by(own) > 0.5,
        _ => false,
    };
    let may_hide = |level: Level, flat: bool, hangs: bool, mask: &Mask| {
        if item.occluders.is_some() || flat {
            return false;
        }
        match (item.level, level) {
            // What stands lower in the image stands nearer.
            (Level::Furniture, Level::Furniture) => {
                item.traits.flat || bottom(mask) >= own_bottom - slack || inside(mask)
            }
            (Level::Wall, Level::Wall) => hangs,
            (Level::Decoration, Level::Decoration) => bottom(mask) >= own_bottom - slack,
            (_, Level::Wall) => false,
            _ => true,
        }
    };
    let mut out: Vec<Neighbour<'a>> = Vec::new();
    for (i, p) in scene.placed.iter().enumerate() {
        if Some(i) != skip {
            out.push(Neighbour { mask: &p.item.mask, may_hide: false });
        }
    }
    for other in waiting.iter().filter(|o| o.id != item.id) {
        let hides = may_hide(other.level, other.traits.flat, other.traits.hangs, &other.mask);
        out.push(Neighbour { mask: &other.mask, may_hide: hides });
    }
    for other in scene.upcoming.iter().filter(|o| o.mask.size() == scene.camera.size && o.id != item.id) {
        // An upcoming object may have become an item or a placed one by now.
        let known = scene.position(&other.id).is_some() || waiting.iter().any(|w| w.id == other.id);
        if !known {
            out.push(Neighbour { mask: &other.mask, may_hide: may_hide(other.level, other.flat, false, &other.mask) });
        }
    }
    if let Some(mask) = item.occluders.as_ref().filter(|m| m.size() == scene.camera.size) {
        out.push(Neighbour { mask, may_hide: true });
    }
    out
}

#[cfg(test)]
mod tests {
    use harmony_scene::Vec3;

    use super::*;
    use crate::testing::{boxed, empty_room};

    #[test]
    fn what_the_global_refinement_doubted_or_refused_is_told() {
        let told = |doubt: f64, kept: bool| {
            let global = crate::GlobalReport {
                iou: [0.8, 0.6],
                lost: 2,
                camera_moved_m: 0.0,
                camera_turned_deg: 0.0,
                scale: 1.0,
                doubt,
                objects_moved_m: 0.0,
                kept,
            };
            let report = LevelReport { global: Some(global), ..LevelReport::default() };
            warnings(&empty_room(), Level::Furniture, &report).into_iter().map(|w| w.message).collect::<Vec<_>>()
        };
        assert!(told(1.0, true).is_empty());
        let all = told(2.04, false);
        assert!(
            all.len() == 2
                && all[0].contains("2.0 times less")
                && all[1].ends_with("0.80 before, 0.60 after, 2 lost theirs"),
            "{all:?}"
        );
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
        assert!(crate::plausible::hangs_in_the_air(&scene, 1));
        follow_hosts(&mut scene, &PlacementSettings::default());
        assert!(!crate::plausible::hangs_in_the_air(&scene, 1));
        let found = scene.placed[1].pose.position;
        assert!(found.distance(on_table) < 0.05, "{found}");
        let cap = scene.placed[2].pose.position;
        assert!(cap.distance(found + Vec3::Y * 0.4) < 1e-9, "{cap}");
    }
}
