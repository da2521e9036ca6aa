//! Review actions: typed, tried, measured, kept only if the evidence does not speak against them and the scene then shows what was
//! asked for.

mod effect;

use std::collections::BTreeSet;
use std::sync::Arc;

use harmony_scene::{Mask, ObjectId, Pose, Relations, Size, Support, Vec3, Wall, WallPlane};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::effect::missed;
use crate::accept::{accepts, odds, total};
use crate::contact::collision::{collisions, relax};
use crate::observe::Window;
use crate::scene::Energy;
use crate::scene::attachment::{Attachment, PoseConstraint, SAME_TURN, YawRule, angle_between, attachment_of};
use crate::scene::subtree::{subtree, take_along};
use crate::solve::local::solve;
use crate::stats::median;
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
        /// Factors on its present width, height and depth.
        factor: [f64; 3],
    },
    /// Give all members of an object's matched set one size, the median of theirs.
    Equalize {
        /// One of the set.
        object: ObjectId,
    },
    /// Exchange the places of two objects: each takes the other's mask and support, and keeps its shape and size.
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
    /// It belongs to no matched set with other members.
    #[error("{id} belongs to no matched set of which others are in the scene")]
    NoSet {
        /// The id.
        id: ObjectId,
    },
    /// One of the two carries the other, or they are held in different ways.
    #[error("{a} and {b} cannot exchange places: one carries the other, or they are of different levels")]
    NotExchangeable {
        /// One.
        a: ObjectId,
        /// The other.
        b: ObjectId,
    },
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
    /// Objects that are new, each with the one that it is a copy of.
    pub added: Vec<(ObjectId, ObjectId)>,
    /// What of the actions the scene does not show, in words: their supports hold objects where the actions would not.
    pub missed: Option<String>,
    /// Evidence of the touched ones after the action.
    pub evidence: Vec<Evidence>,
}

/// Tries actions together on a copy of the scene: the objects go where the actions say, one after the other, are put back onto
/// their supports and are measured there. What rests on them goes along.
///
/// # Errors
/// [`ActionError`] when an action names unknown objects or absurd numbers.
pub fn apply(
    scene: &PartialScene,
    actions: &[ReviewAction],
    settings: &PlacementSettings,
) -> Result<ReviewOutcome, ActionError> {
    let mut outcome = ReviewOutcome {
        scene: scene.clone(),
        touched: Vec::new(),
        removed: Vec::new(),
        added: Vec::new(),
        missed: None,
        evidence: Vec::new(),
    };
    for action in actions {
        step(&mut outcome, action, settings)?;
    }
    let ReviewOutcome { scene: after, touched, removed, evidence, .. } = &mut outcome;
    if settings.collision {
        // Its neighbours make room for it, and it for them.
        for (k, far) in relax(after, settings).into_iter().enumerate() {
            if far > 0.0 {
                touched.push(after.placed[k].item.id.clone());
            }
        }
    }
    let mut seen = BTreeSet::new();
    touched.retain(|id| seen.insert(id.clone()) && !removed.contains(id));
    for id in touched.iter() {
        if let Some(i) = after.position(id) {
            after.placed[i].evidence = measure(after, i, settings);
            evidence.push(after.placed[i].evidence);
        }
    }
    // In the end, when supports and neighbours have had their say.
    outcome.missed = missed(scene, &outcome.scene, actions);
    Ok(outcome)
}

/// Does what one action says.
fn step(outcome: &mut ReviewOutcome, action: &ReviewAction, settings: &PlacementSettings) -> Result<(), ActionError> {
    let ReviewOutcome { scene: after, touched, removed, added, .. } = outcome;
    match action {
        ReviewAction::Move { object, by_m } => {
            let i = find(after, object)?;
            for v in by_m {
                in_range("a move", *v, -LONGEST_MOVE, LONGEST_MOVE)?;
            }
            carry(after, i, settings, |pose| pose.position += Vec3::from_array(*by_m));
            touched.push(object.clone());
        }
        ReviewAction::Rotate { object, by_deg } => {
            let i = find(after, object)?;
            in_range("a rotation", *by_deg, -360.0, 360.0)?;
            let wanted = after.placed[i].pose.yaw + by_deg.to_radians();
            if let Support::Wall { wall } = after.placed[i].support {
                hang_elsewhere(after, i, wall, wanted, settings)?;
            } else {
                // The reviewer's answer takes the place of the one before.
                edit_item(after, i, |item| item.yaw = YawHint::About(wanted));
                carry(after, i, settings, |pose| pose.yaw = wanted);
            }
            touched.push(object.clone());
        }
        ReviewAction::Rescale { object, factor } => {
            let i = find(after, object)?;
            for f in factor {
                in_range("a scale factor", *f, SMALLEST_FACTOR, 1.0 / SMALLEST_FACTOR)?;
            }
            rescale(after, i, Vec3::from_array(*factor), settings);
            touched.push(object.clone());
        }
        ReviewAction::Equalize { object } => {
            let i = find(after, object)?;
            let no_set = || ActionError::NoSet { id: object.clone() };
            let set = after.placed[i].item.relations.matched_set.clone().ok_or_else(no_set)?;
            let member = |p: &Placed| p.item.relations.matched_set.as_ref() == Some(&set);
            let members: Vec<usize> = (0..after.placed.len()).filter(|k| member(&after.placed[*k])).collect();
            if members.len() < 2 {
                return Err(no_set());
            }
            let sizes: Vec<Vec3> = members.iter().map(|k| after.placed[*k].size().as_vec()).collect();
            let of = |axis: usize| median(&mut sizes.iter().map(|s| s[axis]).collect::<Vec<_>>());
            let wanted = Vec3::new(of(0), of(1), of(2));
            for (k, size) in members.into_iter().zip(sizes) {
                rescale(after, k, wanted / size, settings);
                touched.push(after.placed[k].item.id.clone());
            }
        }
        ReviewAction::Swap { object, with } => {
            let (i, j) = (find(after, object)?, find(after, with)?);
            exchange(after, i, j, settings)?;
            touched.extend([object.clone(), with.clone()]);
        }
        ReviewAction::Rehost { object, host } => {
            let i = find(after, object)?;
            find(after, host)?;
            rehost(after, i, host, settings);
            touched.push(object.clone());
        }
        ReviewAction::Add { like, at_m, yaw_deg } => {
            let i = find(after, like)?;
            for v in at_m {
                in_range("a position", *v, -LONGEST_MOVE, 30.0)?;
            }
            in_range("a yaw", *yaw_deg, -360.0, 360.0)?;
            let id = copy(after, i, Vec3::from_array(*at_m), yaw_deg.to_radians(), settings);
            added.push((id.clone(), like.clone()));
            touched.push(id);
        }
        ReviewAction::Remove { object } => {
            let i = find(after, object)?;
            let gone: Vec<ObjectId> = subtree(after, i).iter().map(|k| after.placed[*k].item.id.clone()).collect();
            after.placed.retain(|p| !gone.contains(&p.item.id));
            removed.extend(gone);
        }
    }
    Ok(())
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
    Ok(ReviewOutcome {
        scene: after,
        touched: vec![object.clone()],
        removed: Vec::new(),
        added: Vec::new(),
        missed: None,
        evidence,
    })
}

fn find(scene: &PartialScene, id: &ObjectId) -> Result<usize, ActionError> {
    scene.position(id).ok_or_else(|| ActionError::Unknown { id: id.clone() })
}

fn in_range(what: &'static str, value: f64, min: f64, max: f64) -> Result<(), ActionError> {
    if value >= min && value <= max { Ok(()) } else { Err(ActionError::Range { what, value, min, max }) }
}

/// Changes what is said of a placed object.
fn edit_item(scene: &mut PartialScene, object: usize, change: impl Fn(&mut Item)) {
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
        Attachment::AgainstWall(wall) if pulled_off(scene, &old, &wanted, wall) => Attachment::Floor,
        Attachment::OnHost { host, level } => {
            Attachment::OnHost { host, level: level + wanted.position.y - old.position.y }
        }
        other => other,
    };
    let yaw = YawRule::Fixed(wanted.yaw);
    let noise = &settings.noise;
    let constraint = PoseConstraint { fixed_size: true, ..PoseConstraint::new(scene, &item, attachment, yaw, noise) };
    let new = constraint.settle(&wanted);
    take_along(scene, object, new);
}

/// A move off a wall by more than this takes what stands at it away from it, metres.
const OFF_WALL: f64 = 0.03;

/// Whether a wanted place is farther from the wall than the present one.
fn pulled_off(scene: &PartialScene, old: &Pose, wanted: &Pose, wall: WallPlane) -> bool {
    let far = |pose: &Pose| wall.distance(&scene.room.extents, pose.position);
    far(wanted) - far(old) > OFF_WALL
}

/// Multiplies the sides of an object; what was said about its size follows.
fn rescale(scene: &mut PartialScene, object: usize, factor: Vec3, settings: &PlacementSettings) {
    let common = (factor.x * factor.y * factor.z).cbrt();
    edit_item(scene, object, |item| item.size = Size::from_vec(item.size.as_vec() * factor));
    carry(scene, object, settings, |pose| {
        pose.scale *= common;
        pose.stretch *= factor / common;
    });
}

/// Two objects exchange their places: what is seen there, what carries them and what they carry. Each keeps its
/// shape and what is said about its size, and is fitted to its new place.
fn exchange(scene: &mut PartialScene, i: usize, j: usize, settings: &PlacementSettings) -> Result<(), ActionError> {
    let (p, q) = (scene.placed[i].clone(), scene.placed[j].clone());
    let carried = |a: &Placed, b: &Placed| matches!(&a.support, Support::Object { id } if *id == b.item.id);
    if i == j || p.item.level != q.item.level || carried(&p, &q) || carried(&q, &p) {
        return Err(ActionError::NotExchangeable { a: p.item.id.clone(), b: q.item.id.clone() });
    }
    let moved = |own: &Placed, place: &Placed| {
        let there = &place.item;
        let mut item = (*own.item).clone();
        item.mask = Arc::clone(&there.mask);
        item.detection = there.detection;
        item.placement = there.placement;
        item.host_candidates.clone_from(&there.host_candidates);
        item.yaw = there.yaw;
        item.traits.heavily_occluded = there.traits.heavily_occluded;
        item.relations = Relations {
            group: own.item.relations.group.clone(),
            matched_set: own.item.relations.matched_set.clone(),
            ..there.relations.clone()
        };
        let pose = Pose { scale: own.pose.scale, stretch: own.pose.stretch, ..place.pose };
        Placed { item: Arc::new(item), pose, support: place.support.clone(), evidence: place.evidence }
    };
    (scene.placed[i], scene.placed[j]) = (moved(&p, &q), moved(&q, &p));
    // What rests there stays, on whoever is there now.
    let (a, b) = (&p.item.id, &q.item.id);
    for k in (0..scene.placed.len()).filter(|k| *k != i && *k != j) {
        let Support::Object { id } = &scene.placed[k].support else { continue };
        let Some(now) = (if id == a { Some(b) } else { (id == b).then_some(a) }) else { continue };
        scene.placed[k].support = Support::Object { id: now.clone() };
        edit_item(scene, k, |item| item.relations.on_top_of = Some(now.clone()));
    }
    for k in [i, j] {
        let item = (*scene.placed[k].item).clone();
        place_anew(scene, k, item, settings);
    }
    Ok(())
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
    item.mask = Mask::empty(scene.camera.size).into();
    scene.placed.push(Placed { item: Arc::new(item), ..model });
    let last = scene.placed.len() - 1;
    carry(scene, last, settings, |pose| {
        pose.position = at;
        pose.yaw = yaw;
    });
    id
}

/// Compares the scene before and after actions that were tried together.
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
    let kept = after.missed.is_none() && accepts(0.0, change, odds(settings.noise.wrong_review));
    let iou = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.silhouette_iou));
    let depth = |all: &[Evidence]| mean(all.iter().filter_map(|e| e.depth_residual_m));
    let deepest = |all: &[Evidence]| all.iter().map(|e| e.penetration_m).fold(0.0, f64::max);
    let reason = if let Some(missed) = &after.missed {
        missed.clone()
    } else if kept {
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

/// Compares two placements of the same objects.
///
/// Negative: the second one explains more, nats.
pub fn energy_change(before: &PartialScene, after: &PartialScene, settings: &PlacementSettings) -> f64 {
    let of = |scene: &PartialScene| total(&scene_energy(scene, settings)) + penetration(scene, settings);
    of(after) - of(before)
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
        judge(scene, &apply(scene, std::slice::from_ref(action), &settings).unwrap(), &settings)
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
        assert!(verdict(&scene, &ReviewAction::Rescale { object, factor: [1.4; 3] }).kept);
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
        let after = apply(&scene, &[rotate(90.0)], &settings).unwrap();
        assert!(judge(&scene, &after, &settings).kept);
        let found = &after.scene.placed[0];
        assert_eq!(found.support, Support::Wall { wall: Wall::Left });
        assert!(found.pose.position.distance(at) < 0.03, "{:?}", found.pose.position);
        // Askew on the same wall it cannot hang.
        assert_eq!(apply(&scene, &[rotate(20.0)], &settings).err(), Some(ActionError::HeldByWall));
    }

    #[test]
    fn a_move_into_a_neighbour_makes_room() {
        let scene = scene();
        let object = ObjectId::numbered("box", 0);
        // 0.8 wide, 1.6 apart: moved by 0.85 it is 5 cm deep in the other one.
        let action = ReviewAction::Move { object, by_m: [0.85, 0.0, 0.0] };
        let after = apply(&scene, &[action], &PlacementSettings::default()).unwrap();
        assert!(crate::collisions(&after.scene, &PlacementSettings::default()).is_empty());
        let moved = after.scene.placed.iter().zip(&scene.placed).filter(|(a, b)| a.pose.position != b.pose.position);
        assert!(moved.map(|(a, _)| &a.item.id).all(|id| after.touched.contains(id)), "who moves is measured");
    }

    #[test]
    fn nonsense_is_an_error_and_actions_read_as_a_model_writes_them() {
        let scene = scene();
        let settings = PlacementSettings::default();
        let unknown = ReviewAction::Rotate { object: ObjectId::numbered("ghost", 1), by_deg: 10.0 };
        assert!(matches!(apply(&scene, &[unknown], &settings), Err(ActionError::Unknown { .. })));
        let object = ObjectId::numbered("box", 0);
        let wild = ReviewAction::Rescale { object, factor: [1.0, f64::NAN, 1.0] };
        assert!(matches!(apply(&scene, &[wild], &settings), Err(ActionError::Range { .. })));
        let text = r#"{"action": "rotate", "object": "box_00", "by_deg": -15}"#;
        let read: ReviewAction = serde_json::from_str(text).unwrap();
        assert_eq!(read, ReviewAction::Rotate { object: ObjectId::numbered("box", 0), by_deg: -15.0 });
        assert!(apply(&scene, &[read], &settings).is_ok());
    }

    #[test]
    fn what_only_together_agrees_is_kept_together() {
        // Turned by a quarter, too small, and beside its mask: each correction alone leaves the others wrong.
        let mut scene = scene();
        let object = ObjectId::numbered("box", 0);
        let right = scene.placed[0].pose;
        scene.placed[0].pose.yaw += 0.6;
        scene.placed[0].pose.scale = 0.6;
        scene.placed[0].pose.position.x -= 0.35;
        let actions = [
            ReviewAction::Rotate { object: object.clone(), by_deg: -0.6_f64.to_degrees() },
            ReviewAction::Rescale { object: object.clone(), factor: [1.0 / 0.6; 3] },
            ReviewAction::Move { object: object.clone(), by_m: [0.35, 0.0, 0.0] },
        ];
        let settings = PlacementSettings::default();
        let after = apply(&scene, &actions, &settings).unwrap();
        let v = judge(&scene, &after, &settings);
        assert!(v.kept && v.iou_after > 0.9, "{v:?}");
        let found = after.scene.find(&object).unwrap().pose;
        assert!(found.position.distance(right.position) < 0.02 && angle_between(found.yaw, right.yaw).abs() < 0.02);
    }

    #[test]
    fn sides_take_their_own_factors() {
        let scene = scene();
        let object = ObjectId::numbered("box", 0);
        let action = ReviewAction::Rescale { object: object.clone(), factor: [1.0, 1.5, 0.8] };
        let after = apply(&scene, &[action], &PlacementSettings::default()).unwrap();
        let size = after.scene.find(&object).unwrap().size();
        let far = (size.as_vec() - Vec3::new(0.8, 0.9, 0.4)).abs().max_element();
        assert!(far < 1e-6, "{size:?}");
    }

    #[test]
    fn exchanged_objects_take_masks_and_places_and_keep_shapes_and_what_rests_there_stays() {
        let mut scene = empty_room();
        // Each stands where the other's mask is.
        let (tall, low) = (Vec3::new(0.5, 1.4, 0.5), Vec3::new(0.9, 0.5, 0.6));
        let places = [Vec3::new(1.0, 0.0, 2.0), Vec3::new(3.0, 0.0, 2.0)];
        for (k, (size, at)) in [(tall, places[0]), (low, places[1])].into_iter().enumerate() {
            let there = boxed(&scene, [low, tall][k], at, 0.0);
            let mut item = boxed(&scene, size, at, 0.0);
            item.id = ObjectId::numbered("box", k);
            item.mask = there.mask;
            let pose = Pose::new(at, 0.0, 1.0);
            scene.placed.push(Placed {
                item: Arc::new(item),
                pose,
                support: Support::Floor,
                evidence: Evidence::default(),
            });
        }
        let mut book = boxed(&scene, Vec3::new(0.2, 0.05, 0.2), places[0] + Vec3::Y * 1.4, 0.0);
        book.id = ObjectId::numbered("book", 0);
        let on = Support::Object { id: ObjectId::numbered("box", 0) };
        let pose = Pose::new(places[0] + Vec3::Y * 1.4, 0.0, 1.0);
        scene.placed.push(Placed { item: Arc::new(book), pose, support: on, evidence: Evidence::default() });

        let (a, b) = (ObjectId::numbered("box", 0), ObjectId::numbered("box", 1));
        let settings = PlacementSettings::default();
        let swap = ReviewAction::Swap { object: a.clone(), with: b.clone() };
        let after = apply(&scene, &[swap], &settings).unwrap();
        assert!(judge(&scene, &after, &settings).kept);
        let (p, q) = (after.scene.find(&a).unwrap(), after.scene.find(&b).unwrap());
        assert!(p.pose.position.distance(places[1]) < 0.05, "{:?}", p.pose);
        assert!(q.pose.position.distance(places[0]) < 0.05, "{:?}", q.pose);
        assert!((p.size().height - 1.4).abs() < 0.1 && (q.size().height - 0.5).abs() < 0.05);
        assert_eq!(p.item.mask, scene.placed[1].item.mask);
        assert_eq!(after.scene.placed[2].support, Support::Object { id: b.clone() });
        let on_itself = ReviewAction::Swap { object: b, with: ObjectId::numbered("book", 0) };
        assert!(matches!(apply(&after.scene, &[on_itself], &settings), Err(ActionError::NotExchangeable { .. })));
    }

    #[test]
    fn a_set_gets_the_median_of_its_sizes() {
        let mut scene = empty_room();
        for (k, height) in [0.8, 0.9, 1.3].into_iter().enumerate() {
            let at = Vec3::new(0.8 + k as f64, 0.0, 2.0);
            let mut item = boxed(&scene, Vec3::new(0.5, height, 0.5), at, 0.0);
            item.id = ObjectId::numbered("chair", k);
            item.relations.matched_set = Some("chairs".to_owned());
            let (pose, support) = (Pose::new(at, 0.0, 1.0), Support::Floor);
            scene.placed.push(Placed { item: Arc::new(item), pose, support, evidence: Evidence::default() });
        }
        let settings = PlacementSettings::default();
        let object = ObjectId::numbered("chair", 2);
        let after = apply(&scene, &[ReviewAction::Equalize { object: object.clone() }], &settings).unwrap();
        assert!(after.scene.placed.iter().all(|p| (p.size().height - 0.9).abs() < 1e-6));
        assert_eq!(after.touched.len(), 3);
        scene.placed.truncate(2);
        let alone = ReviewAction::Equalize { object };
        assert!(matches!(apply(&scene, &[alone], &settings), Err(ActionError::Unknown { .. })));
        let item = Arc::make_mut(&mut scene.placed[1].item);
        item.relations.matched_set = None;
        let lone = ReviewAction::Equalize { object: ObjectId::numbered("chair", 1) };
        assert!(matches!(apply(&scene, &[lone], &settings), Err(ActionError::NoSet { .. })));
    }

    #[test]
    fn what_its_support_undoes_is_not_kept() {
        let scene = scene();
        let object = ObjectId::numbered("box", 0);
        // What stands on the floor does not go up.
        let up = ReviewAction::Move { object, by_m: [0.0, 0.4, 0.0] };
        let settings = PlacementSettings::default();
        let after = apply(&scene, std::slice::from_ref(&up), &settings).unwrap();
        let v = judge(&scene, &after, &settings);
        assert!(!v.kept && v.reason.contains("held by its support"), "{v:?}");
    }
}
