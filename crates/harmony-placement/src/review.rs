//! Review actions: typed, tried, measured, kept only if the evidence does not speak against them.

use std::sync::Arc;

use harmony_scene::{Mask, Mat3, ObjectId, Pose, Support, Vec3, Wall};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::anchoring::{Anchoring, Frame, LARGEST_GAP, YawRule};
use crate::cost::angle_between;
use crate::level::{anchoring_of, neighbours};
use crate::solve::solve;
use crate::view::View;
use crate::{Evidence, Item, PartialScene, Placed, PlacementSettings, collision, measure};

/// Longest single move that is tried, metres.
const LONGEST_MOVE: f64 = 5.0;

/// Smallest scale factor that is tried; its inverse is the largest.
const SMALLEST_FACTOR: f64 = 0.3;

/// An action may cost this much silhouette IoU: the masks are not better than that.
const WORSE_IOU: f64 = 0.03;

/// An action may raise the depth residual by this, metres.
const WORSE_DEPTH: f64 = 0.03;

/// An action may raise the penetration by this, metres.
const DEEPER: f64 = 0.02;

/// From this IoU on an object counts as seen and is not removed.
const WELL_SEEN: f64 = 0.5;

/// Share of a seen object that an added one may hide.
const HIDES: f64 = 0.3;

/// Longest side of the image in which hiding is measured, pixels.
const COARSE: u32 = 320;

/// What a reviewer (the VLM) may ask for. Degrees and metres as it writes them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "action", rename_all = "snake_case", deny_unknown_fields)]
pub enum ReviewAction {
    /// Shift an object in the room.
    Move {
        /// The object.
        object: ObjectId,
        /// Metres along room x, y, z.
        by_m: [f64; 3],
    },
    /// Turn an object about the vertical, counter-clockwise seen from above.
    Rotate {
        /// The object.
        object: ObjectId,
        /// Degrees.
        by_deg: f64,
    },
    /// Change an object's size.
    Rescale {
        /// The object.
        object: ObjectId,
        /// Factor on its present size.
        factor: f64,
    },
    /// Exchange the places of two objects.
    Swap {
        /// One.
        object: ObjectId,
        /// The other.
        with: ObjectId,
    },
    /// Put a decoration onto another host.
    Rehost {
        /// The decoration.
        object: ObjectId,
        /// The new host.
        host: ObjectId,
    },
    /// Add a copy of an object where one is missing.
    Add {
        /// The object to copy.
        like: ObjectId,
        /// Where, room metres of the bottom centre.
        at_m: [f64; 3],
        /// Its yaw, degrees.
        yaw_deg: f64,
    },
    /// Take an object out.
    Remove {
        /// The object.
        object: ObjectId,
    },
    /// Place the level again in this order.
    Reorder {
        /// Ids in the new order.
        order: Vec<ObjectId>,
    },
}

/// Why an action could not even be tried.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ActionError {
    /// No such object in the scene.
    #[error("there is no object {id} in the scene")]
    Unknown {
        /// The id.
        id: ObjectId,
    },
    /// A number is not finite or out of range.
    #[error("{what} is {value}, allowed is {min} to {max}")]
    Range {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Smallest allowed.
        min: f64,
        /// Largest allowed.
        max: f64,
    },
    /// What hangs on a wall faces away from it.
    #[error("it hangs on a wall and is turned as that wall is")]
    HeldByWall,
    /// The action is not one that a scene change can express (reorder: place the level again).
    #[error("this action needs the level to be placed again")]
    NeedsPlacement,
}

/// The judgement of an action.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Verdict {
    /// Whether the change stays.
    pub kept: bool,
    /// Why, in one sentence.
    pub reason: String,
    /// Mean silhouette IoU of the objects concerned, before.
    pub iou_before: f64,
    /// And after.
    pub iou_after: f64,
    /// Mean depth residual before, metres, when there is depth.
    pub depth_before_m: Option<f64>,
    /// And after.
    pub depth_after_m: Option<f64>,
    /// Deepest penetration before, metres.
    pub penetration_before_m: f64,
    /// And after.
    pub penetration_after_m: f64,
}

/// An applied action: the changed scene and the objects it touched.
#[derive(Debug, Clone)]
pub struct ReviewOutcome {
    /// The scene after the action.
    pub scene: PartialScene,
    /// Objects that changed (new ones included).
    pub touched: Vec<ObjectId>,
    /// Objects that are gone.
    pub removed: Vec<ObjectId>,
    /// Evidence of the touched ones after the action.
    pub evidence: Vec<Evidence>,
}

/// Tries an action on a copy of the scene: the object goes where the action says, is put back onto its support
/// and is measured there. What rests on it goes along.
///
/// # Errors
/// [`ActionError`] when the action names unknown objects or absurd numbers.
pub fn apply(
    scene: &PartialScene,
    action: &ReviewAction,
    settings: &PlacementSettings,
) -> Result<ReviewOutcome, ActionError> {
    let mut after = scene.clone();
    let mut touched = Vec::new();
    let mut removed = Vec::new();
    match action {
        ReviewAction::Move { object, by_m } => {
            let i = find(scene, object)?;
            for v in by_m {
                in_range("a move", *v, -LONGEST_MOVE, LONGEST_MOVE)?;
            }
            carry(&mut after, i, settings, |pose| pose.position += Vec3::from_array(*by_m));
            touched.push(object.clone());
        }
        ReviewAction::Rotate { object, by_deg } => {
            let i = find(scene, object)?;
            in_range("a rotation", *by_deg, -360.0, 360.0)?;
            let wanted = scene.placed[i].pose.yaw + by_deg.to_radians();
            match &scene.placed[i].support {
                Support::Wall { wall } => hang_elsewhere(&mut after, i, *wall, wanted, settings)?,
                _ => carry(&mut after, i, settings, |pose| pose.yaw = wanted),
            }
            touched.push(object.clone());
        }
        ReviewAction::Rescale { object, factor } => {
            let i = find(scene, object)?;
            in_range("a scale factor", *factor, SMALLEST_FACTOR, 1.0 / SMALLEST_FACTOR)?;
            carry(&mut after, i, settings, |pose| pose.scale *= factor);
            touched.push(object.clone());
        }
        ReviewAction::Swap { object, with } => {
            let (i, j) = (find(scene, object)?, find(scene, with)?);
            let (a, b) = (scene.placed[i].item.shape.clone(), scene.placed[j].item.shape.clone());
            exchange(&mut after, i, j, &a, &b);
            touched.extend([object.clone(), with.clone()]);
        }
        ReviewAction::Rehost { object, host } => {
            let i = find(scene, object)?;
            find(scene, host)?;
            rehost(&mut after, i, host, settings);
            touched.push(object.clone());
        }
        ReviewAction::Add { like, at_m, yaw_deg } => {
            let i = find(scene, like)?;
            for v in at_m {
                in_range("a position", *v, -LONGEST_MOVE, 30.0)?;
            }
            in_range("a yaw", *yaw_deg, -360.0, 360.0)?;
            let id = copy(&mut after, i, Vec3::from_array(*at_m), yaw_deg.to_radians(), settings);
            touched.push(id);
        }
        ReviewAction::Remove { object } => {
            let i = find(scene, object)?;
            let gone = collision::body(scene, i);
            removed = gone.iter().map(|k| scene.placed[*k].item.id.clone()).collect();
            after.placed.retain(|p| !removed.contains(&p.item.id));
        }
        ReviewAction::Reorder { .. } => return Err(ActionError::NeedsPlacement),
    }
    if settings.collision {
        for id in touched.clone() {
            let Some(i) = after.position(&id) else { continue };
            // Its neighbours make room for it, and it for them.
            for (moved, _) in collision::resolve(&mut after, i, settings).moved {
                let id = &after.placed[moved].item.id;
                if !touched.contains(id) {
                    touched.push(id.clone());
                }
            }
        }
    }
    let mut evidence = Vec::new();
    for id in &touched {
        if let Some(i) = after.position(id) {
            after.placed[i].evidence = measure(&after, i, settings);
            evidence.push(after.placed[i].evidence);
        }
    }
    Ok(ReviewOutcome { scene: after, touched, removed, evidence })
}

/// Tries another shape for a placed object, whose units are metres: it takes the old one's place, turn and support.
///
/// What rests on the object is lifted or lowered with its top.
///
/// # Errors
/// [`ActionError::Unknown`].
pub fn reshape(
    scene: &PartialScene,
    object: &ObjectId,
    shape: Arc<crate::Shape>,
    settings: &PlacementSettings,
) -> Result<ReviewOutcome, ActionError> {
    let i = find(scene, object)?;
    let mut after = scene.clone();
    let placed = &mut after.placed[i];
    let grown = shape.extent().y - placed.size().height;
    let hangs = matches!(placed.support, Support::Ceiling);
    let mut item = (*placed.item).clone();
    item.shape = shape;
    placed.item = Arc::new(item);
    placed.pose.scale = 1.0;
    placed.pose.stretch = Vec3::ONE;
    if hangs {
        placed.pose.position.y -= grown;
    }
    carry(&mut after, i, settings, |_| {});
    for k in collision::body(&after, i) {
        if k != i && !hangs {
            after.placed[k].pose.position.y += grown;
        }
    }
    after.placed[i].evidence = measure(&after, i, settings);
    let evidence = vec![after.placed[i].evidence];
    Ok(ReviewOutcome { scene: after, touched: vec![object.clone()], removed: Vec::new(), evidence })
}

fn find(scene: &PartialScene, id: &ObjectId) -> Result<usize, ActionError> {
    scene.position(id).ok_or_else(|| ActionError::Unknown { id: id.clone() })
}

fn in_range(what: &'static str, value: f64, min: f64, max: f64) -> Result<(), ActionError> {
    if value >= min && value <= max { Ok(()) } else { Err(ActionError::Range { what, value, min, max }) }
}

/// Changes an object's pose, puts it back onto its support, and takes along what rests on it.
fn carry(scene: &mut PartialScene, object: usize, settings: &PlacementSettings, change: impl Fn(&mut Pose)) {
    let old = scene.placed[object].pose;
    let mut wanted = old;
    change(&mut wanted);
    let item = Arc::clone(&scene.placed[object].item);
    // An object that is turned away from its wall stands free from then on.
    let anchoring = match anchoring_of(scene, object) {
        Anchoring::AgainstWall(wall) if angle_between(wanted.yaw, wall.yaw()).abs() > 0.02 => Anchoring::Floor,
        Anchoring::AgainstWall(wall) if pulled_off(scene, &wanted, &item, wall) => Anchoring::Floor,
        Anchoring::OnHost { host, level } => {
            Anchoring::OnHost { host, level: level + wanted.position.y - old.position.y }
        }
        other => other,
    };
    let yaw = YawRule::Fixed(wanted.yaw);
    let frame = Frame { scene, item: &item, anchoring, yaw, wall_gap: settings.wall_gap, fixed_size: true };
    let new = frame.settle(&wanted);
    let (turn, by) = (new.yaw - old.yaw, new.position - old.position);
    for i in collision::body(scene, object) {
        let pose = &mut scene.placed[i].pose;
        if i == object {
            *pose = new;
        } else {
            let arm = pose.position - old.position;
            pose.position = old.position + by + Mat3::from_rotation_y(turn) * arm;
            pose.yaw += turn;
        }
    }
}

/// Whether a wanted place is clearly off the wall.
fn pulled_off(scene: &PartialScene, pose: &Pose, item: &Item, wall: Wall) -> bool {
    let depth = item.shape.extent().z * pose.scale * pose.stretch.z;
    wall.distance(&scene.room.extents, pose.position) - depth / 2.0 > LARGEST_GAP + 0.05
}

/// Two objects exchange their shapes, each keeping its place and metric size.
fn exchange(scene: &mut PartialScene, i: usize, j: usize, a: &Arc<crate::Shape>, b: &Arc<crate::Shape>) {
    for (k, own, other) in [(i, a, b), (j, b, a)] {
        let placed = &mut scene.placed[k];
        let ratio = own.extent().y / other.extent().y;
        let mut item = (*placed.item).clone();
        item.shape = Arc::clone(other);
        placed.item = Arc::new(item);
        placed.pose.scale *= ratio;
    }
}

/// Places a decoration anew on another host.
fn rehost(scene: &mut PartialScene, object: usize, host: &ObjectId, settings: &PlacementSettings) {
    let mut item = (*scene.placed[object].item).clone();
    item.relations.on_top_of = Some(host.clone());
    place_anew(scene, object, item, settings);
}

/// Places an object anew by changed relations.
fn place_anew(scene: &mut PartialScene, object: usize, item: Item, settings: &PlacementSettings) {
    let item = Arc::new(item);
    let others = neighbours(scene, &item, &[], Some(object));
    let solution = View::new(scene, Some(object), &item.mask, &others, settings.window_px).map(|view| {
        let s = solve(scene, &item, &view, settings);
        (s.pose, s.support())
    });
    let placed = &mut scene.placed[object];
    placed.item = item;
    if let Some((pose, support)) = solution {
        placed.pose = pose;
        placed.support = support;
    }
}

/// Turns what hangs on a wall: it hangs on the wall that faces so, if that is another one.
fn hang_elsewhere(
    scene: &mut PartialScene,
    object: usize,
    from: Wall,
    yaw: f64,
    settings: &PlacementSettings,
) -> Result<(), ActionError> {
    let off = |w: &Wall| angle_between(yaw, w.yaw()).abs();
    let wall = Wall::ALL.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).filter(|w| *w != from);
    let wall = wall.ok_or(ActionError::HeldByWall)?;
    let mut item = (*scene.placed[object].item).clone();
    item.relations.wall_affinity = wall.into();
    place_anew(scene, object, item, settings);
    Ok(())
}

/// Adds a copy of an object, without a mask of its own; returns its id.
fn copy(scene: &mut PartialScene, like: usize, at: Vec3, yaw: f64, settings: &PlacementSettings) -> ObjectId {
    let model = scene.placed[like].clone();
    let mut number = 2;
    let id = loop {
        let id = ObjectId::numbered(&model.item.label, number);
        if scene.position(&id).is_none() {
            break id;
        }
        number += 1;
    };
    let mut item = (*model.item).clone();
    item.id = id.clone();
    item.index = scene.placed.iter().map(|p| p.item.index).max().unwrap_or(9) + 1;
    item.mask = Mask::empty(scene.camera.size);
    scene.placed.push(Placed { item: Arc::new(item), ..model });
    let last = scene.placed.len() - 1;
    carry(scene, last, settings, |pose| {
        pose.position = at;
        pose.yaw = yaw;
    });
    id
}

/// Compares the scene before and after an action on the objects it touched.
///
/// A change is kept unless the evidence speaks against it: the masks must not agree clearly less, the depths not
/// clearly worse, and nothing may go deeper into anything. An object that the photo shows well is not removed, and
/// none is added where it would hide others that the photo shows.
pub fn judge(before: &PartialScene, after: &ReviewOutcome, settings: &PlacementSettings) -> Verdict {
    let old = |id: &ObjectId| before.position(id).map(|i| measure(before, i, settings));
    let concerned: Vec<&ObjectId> = after.touched.iter().chain(&after.removed).collect();
    let earlier: Vec<Evidence> = concerned.iter().filter_map(|id| old(id)).collect();
    let iou = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.silhouette_iou));
    let depth = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.depth_residual_m));
    let deepest = |all: &[Evidence]| all.iter().map(|e| e.penetration_m).fold(0.0, f64::max);
    let mut verdict = Verdict {
        kept: true,
        reason: "the evidence does not speak against it".to_owned(),
        iou_before: iou(&earlier).unwrap_or(0.0),
        iou_after: iou(&after.evidence).unwrap_or(0.0),
        depth_before_m: depth(&earlier),
        depth_after_m: depth(&after.evidence),
        penetration_before_m: deepest(&earlier),
        penetration_after_m: deepest(&after.evidence),
    };
    let mut refuse = |reason: String| {
        verdict.kept = false;
        verdict.reason = reason;
    };
    let added = after.touched.iter().any(|id| before.find(id).is_none());
    if !after.removed.is_empty() {
        let (now, limit) = (iou(&earlier).unwrap_or(0.0), WELL_SEEN);
        if now >= limit {
            refuse(format!("the photo shows it: its silhouette agrees with an IoU of {now:.2}"));
        }
    } else if verdict.penetration_after_m > verdict.penetration_before_m + DEEPER {
        let deep = verdict.penetration_after_m;
        refuse(format!("it would be {deep:.3} m deep in something"));
    } else if added {
        let hidden = after.touched.iter().map(|id| hides(before, &after.scene, id)).fold(0.0, f64::max);
        if hidden > HIDES {
            refuse(format!("it would hide {:.0} % of an object that the photo shows", 100.0 * hidden));
        }
    } else if verdict.iou_after < verdict.iou_before - WORSE_IOU {
        let (a, b) = (verdict.iou_before, verdict.iou_after);
        refuse(format!("silhouette IoU would fall from {a:.3} to {b:.3}"));
    } else if let (Some(a), Some(b)) = (verdict.depth_before_m, verdict.depth_after_m)
        && b > a + WORSE_DEPTH
    {
        refuse(format!("the depth residual would grow from {a:.3} m to {b:.3} m"));
    }
    verdict
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let all: Vec<f64> = values.collect();
    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
}

/// Largest loss of silhouette IoU that a new object causes to an old one.
fn hides(before: &PartialScene, after: &PartialScene, id: &ObjectId) -> f64 {
    let Some(new) = after.find(id) else { return 0.0 };
    let camera = before.camera.resized(before.camera.size.fit_within(COARSE));
    let mut depth = vec![0.0; camera.size.pixels()];
    crate::raster::rasterise(&camera, new.item.shape.proxy(), &new.pose, &mut depth);
    let mut worst = 0.0_f64;
    for old in &before.placed {
        let mut own = vec![0.0; camera.size.pixels()];
        crate::raster::rasterise(&camera, old.item.shape.proxy(), &old.pose, &mut own);
        let mask = old.item.mask.resized(camera.size);
        let (mut seen, mut lost) = (0.0, 0.0);
        for (i, on) in mask.bits().iter().enumerate() {
            if *on && own[i] > 0.0 {
                seen += 1.0;
                lost += f64::from(u8::from(depth[i] > 0.0 && depth[i] < own[i] - 0.02));
            }
        }
        if seen > 0.0 {
            worst = worst.max(lost / seen);
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{boxed, empty_room};

    #[test]
    fn another_shape_takes_the_place_of_the_old_one_and_what_stands_on_it_goes_along() {
        let mut scene = scene();
        let host = scene.placed[0].item.id.clone();
        let on = |scene: &PartialScene| scene.placed[1].pose.position.y;
        scene.placed[1].support = Support::Object { id: host.clone() };
        scene.placed[1].pose.position = scene.placed[0].pose.position + Vec3::Y * 0.6;
        let mut item = boxed(&scene, Vec3::new(0.8, 0.75, 0.5), scene.placed[0].pose.position, 0.0);
        item.id = host.clone();
        let outcome = reshape(&scene, &host, item.shape.clone(), &PlacementSettings::default()).unwrap();
        let placed = outcome.scene.find(&host).unwrap();
        assert!((placed.size().height - 0.75).abs() < 1e-6);
        assert!((placed.pose.position - scene.placed[0].pose.position).length() < 1e-6);
        assert!((on(&outcome.scene) - on(&scene) - 0.15).abs() < 1e-6, "{}", on(&outcome.scene));
        let gone = ObjectId::numbered("ghost", 1);
        assert!(reshape(&scene, &gone, item.shape, &PlacementSettings::default()).is_err());
    }

    fn scene() -> PartialScene {
        let mut scene = empty_room();
        for (i, x) in [1.0, 2.6].into_iter().enumerate() {
            let position = Vec3::new(x, 0.0, 2.2);
            let mut item = boxed(&scene, Vec3::new(0.8, 0.6, 0.5), position, 0.0);
            item.id = ObjectId::numbered("box", i);
            let pose = Pose::new(position, 0.0, 1.0);
            let evidence = Evidence::default();
            scene.placed.push(Placed { item: Arc::new(item), pose, support: Support::Floor, evidence });
        }
        scene
    }

    fn verdict(scene: &PartialScene, action: &ReviewAction) -> Verdict {
        let settings = PlacementSettings::default();
        judge(scene, &apply(scene, action, &settings).unwrap(), &settings)
    }

    #[test]
    fn what_the_mask_contradicts_is_refused_and_what_it_confirms_is_kept() {
        let mut scene = scene();
        let object = ObjectId::numbered("box", 0);
        let away = ReviewAction::Move { object: object.clone(), by_m: [0.4, 0.0, 0.0] };
        let v = verdict(&scene, &away);
        assert!(!v.kept && v.iou_after < v.iou_before, "{v:?}");
        scene.placed[0].pose.position.x -= 0.3;
        let back = ReviewAction::Move { object: object.clone(), by_m: [0.3, 0.0, 0.0] };
        assert!(verdict(&scene, &back).kept);
        let into = ReviewAction::Move { object: object.clone(), by_m: [1.4, 0.0, 0.0] };
        assert!(!verdict(&scene, &into).kept);
        scene.placed[0].pose.scale = 0.7;
        assert!(verdict(&scene, &ReviewAction::Rescale { object, factor: 1.4 }).kept);
    }

    #[test]
    fn an_object_that_is_seen_stays_and_one_that_is_not_goes() {
        let mut scene = scene();
        let object = ObjectId::numbered("box", 1);
        let remove = ReviewAction::Remove { object };
        assert!(!verdict(&scene, &remove).kept);
        scene.placed[1].pose.position = Vec3::new(0.6, 0.0, 0.6);
        assert!(verdict(&scene, &remove).kept);
    }

    #[test]
    fn a_copy_may_stand_where_nothing_is_hidden() {
        let scene = scene();
        let like = ObjectId::numbered("box", 0);
        let free = ReviewAction::Add { like: like.clone(), at_m: [1.8, 0.0, 1.0], yaw_deg: 90.0 };
        assert!(verdict(&scene, &free).kept);
        let before_it = ReviewAction::Add { like, at_m: [1.2, 0.0, 3.0], yaw_deg: 0.0 };
        assert!(!verdict(&scene, &before_it).kept);
    }

    #[test]
    fn what_hangs_on_a_wall_turns_by_hanging_on_another_one() {
        let mut scene = empty_room();
        let at = Vec3::new(0.02, 1.2, 2.0);
        let mut item = boxed(&scene, Vec3::new(0.8, 0.6, 0.03), at, Wall::Left.yaw());
        item.level = harmony_scene::Level::Wall;
        item.relations.wall_affinity = Wall::Back.into();
        // Named for the wrong wall, it hangs there, far from its mask.
        let pose = Pose::new(Vec3::new(2.0, 1.2, 0.02), Wall::Back.yaw(), 1.0);
        let (object, support) = (item.id.clone(), Support::Wall { wall: Wall::Back });
        scene.placed.push(Placed { item: Arc::new(item), pose, support, evidence: Evidence::default() });
        let rotate = |by_deg| ReviewAction::Rotate { object: object.clone(), by_deg };
        let settings = PlacementSettings::default();
        let after = apply(&scene, &rotate(90.0), &settings).unwrap();
        assert!(judge(&scene, &after, &settings).kept);
        let found = &after.scene.placed[0];
        assert_eq!(found.support, Support::Wall { wall: Wall::Left });
        assert!(found.pose.position.distance(at) < 0.03, "{:?}", found.pose.position);
        // Askew on the same wall it cannot hang.
        assert_eq!(apply(&scene, &rotate(20.0), &settings).err(), Some(ActionError::HeldByWall));
    }

    #[test]
    fn a_move_into_a_neighbour_makes_room() {
        let scene = scene();
        let object = ObjectId::numbered("box", 0);
        // 0.8 wide, 1.6 apart: moved by 0.85 it is 5 cm deep in the other one.
        let action = ReviewAction::Move { object, by_m: [0.85, 0.0, 0.0] };
        let after = apply(&scene, &action, &PlacementSettings::default()).unwrap();
        assert!(crate::collisions(&after.scene, &PlacementSettings::default()).is_empty());
        let moved = after.scene.placed.iter().zip(&scene.placed).filter(|(a, b)| a.pose.position != b.pose.position);
        assert!(moved.map(|(a, _)| &a.item.id).all(|id| after.touched.contains(id)), "who moves is measured");
    }

    #[test]
    fn nonsense_is_an_error_and_actions_read_as_a_model_writes_them() {
        let scene = scene();
        let settings = PlacementSettings::default();
        let unknown = ReviewAction::Rotate { object: ObjectId::numbered("ghost", 1), by_deg: 10.0 };
        assert!(matches!(apply(&scene, &unknown, &settings), Err(ActionError::Unknown { .. })));
        let object = ObjectId::numbered("box", 0);
        let wild = ReviewAction::Rescale { object, factor: f64::NAN };
        assert!(matches!(apply(&scene, &wild, &settings), Err(ActionError::Range { .. })));
        let text = r#"{"action": "rotate", "object": "box_00", "by_deg": -15}"#;
        let read: ReviewAction = serde_json::from_str(text).unwrap();
        assert_eq!(read, ReviewAction::Rotate { object: ObjectId::numbered("box", 0), by_deg: -15.0 });
        assert!(apply(&scene, &read, &settings).is_ok());
    }
}
