//! Review actions: typed, tried, measured, kept only if the evidence does not speak against them.

use std::sync::Arc;

use harmony_scene::{Mask, Mat3, ObjectId, Pose, Size, Support, Vec3, Wall};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::accept::{accepts, odds, total};
use crate::contact::collision::{collisions, relax};
use crate::observe::Window;
use crate::scene::Energy;
use crate::scene::attachment::{Attachment, PoseConstraint, SAME_TURN, YawRule, angle_between, attachment_of};
use crate::scene::subtree::subtree;
use crate::solve::local::solve;
use crate::terms::{NAMED, absent_energy, scene_energy};
use crate::{Evidence, Item, PartialScene, Placed, PlacementSettings, YawHint, measure};

/// Longest single move that is tried, metres.
const LONGEST_MOVE: f64 = 5.0;

/// Smallest scale factor that is tried; its inverse is the largest.
const SMALLEST_FACTOR: f64 = 0.3;

/// One sigma of how deep a pair may be in one another after a change, metres.
const PENETRATION: f64 = 0.01;

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
    /// Energy of the whole scene after it, less than before: negative speaks for it, nats.
    pub energy_change: f64,
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
            if let Support::Wall { wall } = &scene.placed[i].support {
                hang_elsewhere(&mut after, i, *wall, wanted, settings)?;
            } else {
                // The reviewer's answer takes the place of the one before.
                renamed(&mut after, i, |item| item.yaw = YawHint::About(wanted));
                carry(&mut after, i, settings, |pose| pose.yaw = wanted);
            }
            touched.push(object.clone());
        }
        ReviewAction::Rescale { object, factor } => {
            let i = find(scene, object)?;
            in_range("a scale factor", *factor, SMALLEST_FACTOR, 1.0 / SMALLEST_FACTOR)?;
            renamed(&mut after, i, |item| item.size = Size::from_vec(item.size.as_vec() * *factor));
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
            let gone = subtree(scene, i);
            removed = gone.iter().map(|k| scene.placed[*k].item.id.clone()).collect();
            after.placed.retain(|p| !removed.contains(&p.item.id));
        }
        ReviewAction::Reorder { .. } => return Err(ActionError::NeedsPlacement),
    }
    if settings.collision {
        // Its neighbours make room for it, and it for them.
        for (k, far) in relax(&mut after, settings).into_iter().enumerate() {
            let id = &after.placed[k].item.id;
            if far > 0.0 && !touched.contains(id) {
                touched.push(id.clone());
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
    for k in subtree(&after, i) {
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

/// Changes what is said of a placed object.
fn renamed(scene: &mut PartialScene, object: usize, change: impl Fn(&mut Item)) {
    let mut item = (*scene.placed[object].item).clone();
    change(&mut item);
    scene.placed[object].item = Arc::new(item);
}

/// Changes an object's pose, puts it back onto its support, and takes along what rests on it.
fn carry(scene: &mut PartialScene, object: usize, settings: &PlacementSettings, change: impl Fn(&mut Pose)) {
    let old = scene.placed[object].pose;
    let mut wanted = old;
    change(&mut wanted);
    let item = Arc::clone(&scene.placed[object].item);
    // An object that is turned away from its wall stands free from then on.
    let attachment = match attachment_of(scene, object, &settings.noise) {
        Attachment::AgainstWall(wall) if angle_between(wanted.yaw, wall.yaw()).abs() > SAME_TURN => Attachment::Floor,
        Attachment::AgainstWall(wall) if pulled_off(scene, &wanted, &item, wall, settings) => Attachment::Floor,
        Attachment::OnHost { host, level } => {
            Attachment::OnHost { host, level: level + wanted.position.y - old.position.y }
        }
        other => other,
    };
    let yaw = YawRule::Fixed(wanted.yaw);
    let noise = &settings.noise;
    let constraint = PoseConstraint { fixed_size: true, ..PoseConstraint::new(scene, &item, attachment, yaw, noise) };
    let new = constraint.settle(&wanted);
    let (turn, by) = (new.yaw - old.yaw, new.position - old.position);
    for i in subtree(scene, object) {
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
fn pulled_off(scene: &PartialScene, pose: &Pose, item: &Item, wall: Wall, settings: &PlacementSettings) -> bool {
    let depth = item.shape.extent().z * pose.scale * pose.stretch.z;
    wall.distance(&scene.room.extents, pose.position) - depth / 2.0 > 1.3 * settings.noise.wall_gap_most
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
    let solution = Window::new(scene, &item, Some(object), &[], settings).map(|window| {
        let s = solve(scene, &item, &window, settings);
        (s.pose, s.objective.constraint.support())
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

/// Compares the scene before and after an action.
///
/// A change is kept when the energy of the whole scene does not rise by more than the word of a reviewer is worth: masks and
/// depths of everything that it touches, hides or uncovers, sizes, turns, places, and how deep things are in one another. The
/// mask of an object that is gone is not explained by anything.
pub fn judge(before: &PartialScene, after: &ReviewOutcome, settings: &PlacementSettings) -> Verdict {
    let concerned: Vec<&ObjectId> = after.touched.iter().chain(&after.removed).collect();
    let old = |id: &ObjectId| before.position(id).map(|i| measure(before, i, settings));
    let earlier: Vec<Evidence> = concerned.iter().filter_map(|id| old(id)).collect();
    let (was, is) = (scene_energy(before, settings), scene_energy(&after.scene, settings));
    let gone = before.placed.iter().enumerate().filter(|(_, p)| after.removed.contains(&p.item.id));
    let unexplained: f64 = gone.filter_map(|(i, _)| absent_energy(before, i, settings)).sum();
    let (pressed, presses) = (penetration(before, settings), penetration(&after.scene, settings));
    let change = total(&is) + presses + unexplained - total(&was) - pressed;
    let kept = accepts(0.0, change, odds(settings.noise.wrong_review));
    let iou = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.silhouette_iou));
    let depth = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.depth_residual_m));
    let deepest = |all: &[Evidence]| all.iter().map(|e| e.penetration_m).fold(0.0, f64::max);
    let reason = if kept {
        "the evidence does not speak against it".to_owned()
    } else if unexplained > 0.0 {
        format!("the photo shows it: without it {unexplained:.0} nats of its mask are not explained")
    } else {
        format!("the evidence speaks against it: {}", against(&was, &is, presses - pressed))
    };
    Verdict {
        kept,
        energy_change: change,
        reason,
        iou_before: iou(&earlier).unwrap_or(0.0),
        iou_after: iou(&after.evidence).unwrap_or(0.0),
        depth_before_m: depth(&earlier),
        depth_after_m: depth(&after.evidence),
        penetration_before_m: deepest(&earlier),
        penetration_after_m: deepest(&after.evidence),
    }
}

/// The name of a term, and the term.
type Term = (&'static str, fn(&Energy) -> f64);

/// The terms that rose most, in words.
fn against(was: &[Energy], is: &[Energy], deeper: f64) -> String {
    let sum = |all: &[Energy], of: fn(&Energy) -> f64| all.iter().map(of).sum::<f64>();
    let terms: [Term; 7] = [
        ("silhouettes", |e| e.silhouette),
        ("depths", |e| e.depth),
        ("sizes", |e| e.size),
        ("turns", |e| e.yaw),
        ("places", |e| e.place),
        ("supports", |e| e.support),
        ("relations", |e| e.prior),
    ];
    let risen = terms.iter().map(|(name, of)| (*name, sum(is, *of) - sum(was, *of)));
    let mut risen: Vec<(&str, f64)> = risen.chain([("things in one another", deeper)]).filter(|r| r.1 > 0.5).collect();
    risen.sort_by(|a, b| b.1.total_cmp(&a.1));
    let told: Vec<String> = risen.iter().map(|(name, by)| format!("{name} +{by:.1} nats")).collect();
    told.join(", ")
}

/// What things that are in one another cost.
fn penetration(scene: &PartialScene, settings: &PlacementSettings) -> f64 {
    collisions(scene, settings).iter().map(|c| NAMED.loss(c.penetration / PENETRATION)).sum()
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let all: Vec<f64> = values.collect();
    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
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
