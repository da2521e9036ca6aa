//! Things that a second look found in the photo after their level was placed: masked, checked against what is there,
//! modelled or given the shape of one that looks just like them, and placed.

use std::collections::BTreeSet;
use std::sync::Arc;

use harmony_placement::{Placed, PlacementSettings, ReviewAction};
use harmony_roles::{Detection, SegmentPrompt, SegmentRequest};
use harmony_scene::{Level, Mask, ObjectId, PixelBox, WarningKind};

use super::{inspect, place, prepare, review, texture};
use crate::before::Before;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Left, Look, Object, SceneState, is_flat};
use crate::views;

/// Overlap from which a box or mask shows what is in the scene already.
const SAME: f64 = 0.5;
/// Share of a mask that may belong to a placed object of its level.
const TAKEN: f64 = 0.6;

/// Agreement with its mask below which a thing stands elsewhere than it is seen.
const ASTRAY_IOU: f64 = 0.3;

/// Something that the photo shows and the scene lacks.
#[derive(Debug, Clone)]
pub struct Wanted {
    /// Box in the photo, with its label.
    pub detection: Detection,
    /// The object whose shape it has.
    pub like: Option<ObjectId>,
    /// What it rests on.
    pub host: Option<ObjectId>,
}

impl Wanted {
    /// Something of a label in a box of the photo (thousandths), with the ids that were named for it.
    pub fn named(
        state: &SceneState,
        label: &str,
        bounds: [f64; 4],
        like: Option<&String>,
        host: Option<&String>,
    ) -> Self {
        let label = label.trim().to_lowercase();
        let id = |text: Option<&String>| text.and_then(|text| ObjectId::new(text).ok());
        let bounds = views::pixels(state.partial.camera.size, bounds);
        let detection = Detection { phrase: label.clone(), label, bounds, score: None, outline: None };
        Self { detection, like: id(like), host: id(host) }
    }
}

/// Adds what is wanted of a level; the ids of what was placed. `ctx` is that of a look within the level's phase.
///
/// # Errors
/// Fatal role errors and unwritable files only; what cannot be added is left out with its reason.
pub async fn all(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &mut SceneState,
    wanted: Vec<Wanted>,
) -> Result<Vec<ObjectId>, PhaseError> {
    let wanted: Vec<Wanted> = wanted.into_iter().filter(|w| !is_there(state, level, w)).collect();
    if wanted.is_empty() {
        return Ok(Vec::new());
    }
    let found = masked(ctx, level, state, wanted).await?;
    let (mut copies, mut new) = (Vec::new(), Vec::new());
    for (object, like) in found {
        match like.and_then(|like| state.objects.get(&like)).cloned() {
            Some(like) => copies.push(copy_of(&like, object)),
            None => new.push(object),
        }
    }
    let mut order = Vec::new();
    if !new.is_empty() {
        let shown = Arc::new(state.clone());
        let before = Before { state: Arc::clone(&shown), found: Vec::new() };
        let inspection = inspect::all(ctx, level, &before, new).await?;
        state.left.extend(inspection.left);
        state.rejected.extend(inspection.rejected);
        order = inspection.order;
        let (outcomes, _) = prepare::all(ctx, level, &shown, inspection.objects).await?;
        for outcome in outcomes {
            match outcome {
                Ok(object) => copies.push(object),
                Err((object, reason)) => {
                    state.left.push(Left { name: object.id.to_string(), phase: ctx.phase, reason });
                    state.rejected.push((object.detection.label, object.mask));
                }
            }
        }
    }
    let mut ids = Vec::new();
    for mut object in copies {
        object.index = state.next_index;
        state.next_index += 1;
        harmony_io::save_mask(&ctx.file(&format!("masks/{}.png", object.id))?, &object.mask)?;
        ids.push(object.id.clone());
        state.objects.insert(object.id.clone(), object);
    }
    if !ids.is_empty() {
        // By itself: camera, scale and all others were solved without it, and one more thing is no reason to move them.
        let settings = PlacementSettings { global_refinement: false, ..ctx.settings.placement.clone() };
        place::in_order(ctx, level, state, ids.clone(), &order, &settings).await?;
        rehosted(ctx, state, &ids).await?;
        texture::bare(ctx, state).await?;
    }
    ids.retain(|id| state.partial.find(id).is_some());
    Ok(ids)
}

/// What could not stand where it is seen, because what carries it was not there, is tried on what came beneath its pixels; it
/// stays there where the evidence is better for it.
async fn rehosted(ctx: &PhaseCtx<'_>, state: &mut SceneState, came: &[ObjectId]) -> Result<(), PhaseError> {
    for (object, host) in astray(state, came) {
        if state.partial.find(&object).is_some_and(is_astray) {
            let action = ReviewAction::Rehost { object, host };
            review::try_quietly(ctx, state, vec![action]).await?;
        }
    }
    Ok(())
}

/// Decorations that stand elsewhere than they are seen, each with those that came of which pixels are beneath its own.
fn astray(state: &SceneState, came: &[ObjectId]) -> Vec<(ObjectId, ObjectId)> {
    let size = state.partial.camera.size;
    let carries = |p: &&Placed| p.item.level != Level::Ceiling && !is_flat(&p.item.label);
    let hosts: Vec<&Placed> = came.iter().filter_map(|id| state.partial.find(id)).filter(carries).collect();
    let lost = state.partial.placed.iter().filter(|p| p.item.level == Level::Decoration && is_astray(p));
    let beneath = |own: PixelBox, host: &Placed| {
        let foot = PixelBox { y0: own.y1 - 0.2 * own.height(), y1: own.y1 + 0.5 * own.height(), ..own };
        host.item.mask.bounds().is_some_and(|b| b.intersection(&foot.clamped(size)).area() > 0.0)
    };
    lost.filter_map(|p| Some((p, p.item.mask.bounds()?)))
        .flat_map(|(p, own)| {
            hosts.iter().filter(move |h| beneath(own, h)).map(|h| (p.item.id.clone(), h.item.id.clone()))
        })
        .filter(|(object, host)| object != host)
        .collect()
}

fn is_astray(placed: &Placed) -> bool {
    placed.evidence.silhouette_iou.is_some_and(|iou| iou < ASTRAY_IOU)
}

/// Whether a placed object of the level is what a box shows.
fn is_there(state: &SceneState, level: Level, wanted: &Wanted) -> bool {
    let of_level = state.partial.placed.iter().filter(|p| p.item.level == level);
    of_level.filter_map(|p| p.item.mask.bounds()).any(|b| b.iou(&wanted.detection.bounds) >= SAME)
}

/// Objects with masks and ids of their own, each with the one that it looks like.
async fn masked(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &SceneState,
    wanted: Vec<Wanted>,
) -> Result<Vec<(Object, Option<ObjectId>)>, PhaseError> {
    let prompt = |(i, w): (usize, &Wanted)| SegmentPrompt {
        key: format!("{i:03}"),
        label: w.detection.label.clone(),
        bounds: w.detection.bounds,
        outline: None,
    };
    let prompts = wanted.iter().enumerate().map(prompt).collect();
    let request = SegmentRequest { name: ctx.call("segment"), image: state.photo.clone(), prompts };
    let masks = ctx.calls.segment(&request).await?;
    let mut taken: BTreeSet<ObjectId> = state.objects.keys().cloned().collect();
    let mut found: Vec<(Object, Option<ObjectId>)> = Vec::new();
    for (wanted, segmented) in wanted.into_iter().zip(masks) {
        let label = wanted.detection.label.clone();
        if let Some(reason) = not_new(ctx, level, state, &segmented.mask) {
            ctx.warn(WarningKind::ObjectDropped, None, format!("a {label} that a second look named: {reason}"));
            continue;
        }
        let mut number = 0;
        let id = loop {
            number += 1;
            let id = ObjectId::numbered(&label, number);
            if taken.insert(id.clone()) {
                break id;
            }
        };
        let object = Object::found(id, level, wanted.detection, segmented.mask);
        found.push((Object { mask_score: segmented.score, host_hint: wanted.host, ..object }, wanted.like));
    }
    Ok(found)
}

/// Why a mask shows nothing new.
fn not_new(ctx: &PhaseCtx<'_>, level: Level, state: &SceneState, mask: &Mask) -> Option<&'static str> {
    let area = mask.count() as f64;
    if area < (ctx.settings.filters.min_area * mask.size().pixels() as f64).max(4.0) {
        return Some("hardly a pixel of it is seen");
    }
    let taken = |p: &harmony_placement::Placed| p.item.mask.and(mask).count() as f64 > TAKEN * area;
    let of_level = state.partial.placed.iter().filter(|p| p.item.level == level);
    of_level.into_iter().any(taken).then_some("its pixels are those of something that is placed")
}

/// An object with the shape of another, and what was said about that.
fn copy_of(like: &Object, object: Object) -> Object {
    let mut said = like.said.clone();
    said.id = object.id.to_string();
    said.on_top_of = object.host_hint.as_ref().map(ToString::to_string);
    (said.in_front_of, said.behind) = (None, None);
    let mut model = like.model.clone();
    if let Some(model) = &mut model {
        model.source = format!("copy of {}: {}", like.id, model.source);
    }
    Object { said, model, look: Look::default(), ..object }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::{PixelBox, Support};

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn what_is_placed_already_is_not_added_and_a_copy_takes_shape_and_words_of_its_twin() {
        let mut state = empty_room();
        let size = DVec3::new(0.4, 0.8, 0.4);
        let chair = add(&mut state, "chair_01", Level::Furniture, size, DVec3::new(2.0, 0.0, 1.5), Support::Floor);
        let twin = state.objects[&chair].clone();
        let wanted = |bounds: PixelBox| Wanted {
            detection: Detection { bounds, ..twin.detection.clone() },
            like: Some(chair.clone()),
            host: None,
        };
        assert!(is_there(&state, Level::Furniture, &wanted(twin.detection.bounds)));
        assert!(!is_there(&state, Level::Decoration, &wanted(twin.detection.bounds)), "another level");
        let elsewhere = PixelBox { x0: 5.0, y0: 150.0, x1: 45.0, y1: 220.0 };
        assert!(!is_there(&state, Level::Furniture, &wanted(elsewhere)));

        let id = ObjectId::new("chair_02").unwrap();
        let mask = Mask::from_fn(state.partial.camera.size, |x, y| x < 45 && y > 150);
        let found = Object::found(id.clone(), Level::Furniture, wanted(elsewhere).detection, mask.clone());
        let copy = copy_of(&twin, found);
        assert_eq!((&copy.id, copy.said.id.as_str()), (&id, "chair_02"));
        assert_eq!(*copy.mask, mask, "its own pixels");
        let model = copy.model.unwrap();
        assert!(Arc::ptr_eq(&model.mesh, &twin.model.unwrap().mesh));
        assert!(model.source.starts_with("copy of chair_01"));
    }
    #[test]
    fn what_is_seen_on_something_that_came_is_tried_there_where_it_stands_elsewhere() {
        let mut state = empty_room();
        let table = DVec3::new(0.8, 0.5, 0.6);
        let came = add(&mut state, "table_01", Level::Furniture, table, DVec3::new(2.0, 0.0, 1.5), Support::Floor);
        let on_it = || Support::Object { id: came.clone() };
        let small = DVec3::new(0.1, 0.2, 0.1);
        let vase = add(&mut state, "vase_01", Level::Decoration, small, DVec3::new(2.0, 0.5, 1.5), on_it());
        let far = add(&mut state, "cup_01", Level::Decoration, small, DVec3::new(0.3, 0.0, 0.3), Support::Floor);
        let mut agrees = |id: &ObjectId, iou: f64| {
            let i = state.partial.position(id).unwrap();
            state.partial.placed[i].evidence.silhouette_iou = Some(iou);
        };
        agrees(&vase, 0.8);
        agrees(&far, 0.0);
        assert_eq!(
            astray(&state, std::slice::from_ref(&came)),
            [],
            "one stands where it is seen, the other is seen elsewhere"
        );
        let i = state.partial.position(&vase).unwrap();
        state.partial.placed[i].evidence.silhouette_iou = Some(0.0);
        assert_eq!(astray(&state, std::slice::from_ref(&came)), [(vase, came)]);
        assert_eq!(astray(&state, &[]), [], "nothing came");
    }
}
