//! List -> boxes -> filter -> masks -> filter: the candidates of a level. Paper Sec. 3.2 "Object Detection".

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use harmony_imaging::polygon::joined;
use harmony_imaging::sheet::{LabelledBox, draw_boxes, grid_overlay, palette};
use harmony_prompts::{ListAnswer, ListQuestion, ListedItem, PlacedObject, RoomView};
use harmony_roles::{DetectRequest, Detection, PhraseRequest, Picture, SegmentPrompt, SegmentRequest};
use harmony_scene::{ImageSize, Level, Mask, ObjectId, Room, Surface, WarningKind};
use image::RgbImage;
use serde_json::{Value, json};

use super::missing;
use crate::before::{Before, stem};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::filter::{Dropped, cut_to_boxes, filter_boxes, filter_masks, part_merged, unveil};
use crate::looks::LookKind;
use crate::state::{Object, SceneState};

/// Overlap from which two boxes show one object.
const SAME_BOX: f64 = 0.5;
/// Smaller boxes show nothing, pixels.
const SMALLEST_BOX: f64 = 4.0;

/// What was found for a level: boxes with masks, not yet named.
#[derive(Debug, Clone)]
pub struct Found {
    /// In the order of their places in the photo.
    kept: Vec<((Detection, Mask), Option<f64>)>,
    /// What a filter took out.
    pub dropped: Vec<Dropped>,
    /// Labels and pixels of what a filter took out after it had a mask.
    pub rejected: Vec<(String, Arc<Mask>)>,
    /// Hosts that the list named, by box.
    hosts: BTreeMap<[i64; 4], String>,
    /// Boxes that only the question of what is missing on a piece of furniture named.
    missed: BTreeSet<[i64; 4]>,
}

/// Looks for the objects of a level.
///
/// The lists of walls, furniture and ceilings need the photo only; that of decorations shows the furniture placed so
/// far, for what rests on it is what the photo shows and the reconstruction does not.
///
/// # Errors
/// Fatal role errors only; a player that fails is replaced.
pub async fn find(ctx: &PhaseCtx<'_>, level: Level, state: &Arc<SceneState>) -> Result<Found, PhaseError> {
    let with_boxes = !ctx.can().gives_boxes;
    let wanted = ask_list(ctx, "list", level, state, with_boxes).await?;
    let size = state.partial.camera.size;
    let (found, mut hosts) = if with_boxes {
        listed_boxes(&wanted, size)
    } else {
        (detect(ctx, level, state, &wanted).await?, BTreeMap::new())
    };
    let (mut found, mut dropped) = filter_boxes(found, size, &ctx.settings.filters);
    if !with_boxes {
        let (missing, named) = ask_missing(ctx, level, state, &wanted, &found).await?;
        hosts = named;
        // A box around two that were found singly is none of one that was not.
        let (all, more) = filter_boxes(found.into_iter().chain(missing).collect(), size, &ctx.settings.filters);
        found = all;
        dropped.extend(more);
    }
    let mut missed = BTreeSet::new();
    if level == Level::Decoration {
        for (detection, host) in missing::decorations(ctx, state, &found).await? {
            hosts.insert(host_key(&detection), host.to_string());
            missed.insert(host_key(&detection));
            found.push(detection);
        }
    }

    let prompts: Vec<SegmentPrompt> = found
        .iter()
        .enumerate()
        .map(|(i, d)| SegmentPrompt {
            key: format!("{i:03}"),
            label: d.label.clone(),
            bounds: d.bounds,
            outline: d.outline.clone(),
        })
        .collect();
    let masks = if prompts.is_empty() {
        Vec::new()
    } else {
        let request = SegmentRequest { name: ctx.call("segment"), image: state.photo.clone(), prompts };
        ctx.calls.segment(&request).await?
    };
    let filters = ctx.settings.filters;
    let (pairs, verdicts, (parted, cut)) = ctx
        .computed(move || {
            let pairs: Vec<_> = found.into_iter().zip(masks).map(|(d, m)| ((d, m.mask), m.score)).collect();
            let (mut pairs, scores): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
            let parted = part_merged(&mut pairs);
            let cut = cut_to_boxes(&mut pairs);
            unveil(&mut pairs);
            let verdicts = filter_masks(&pairs, &filters);
            (pairs.into_iter().zip(scores).collect::<Vec<_>>(), verdicts, (parted, cut))
        })
        .await?;
    for [label, other] in parted {
        let message = format!("the mask of a {label} also showed the {other} beside it, which was taken out");
        ctx.warn(WarningKind::AnswerRepaired, None, message);
    }
    for label in cut {
        let message = format!("the mask of a {label} reached far beyond its box, and was cut there");
        ctx.warn(WarningKind::AnswerRepaired, None, message);
    }

    let mut kept: Vec<((Detection, Mask), Option<f64>)> = Vec::new();
    let mut rejected = Vec::new();
    for ((pair, score), verdict) in pairs.into_iter().zip(verdicts) {
        match verdict {
            None => kept.push((pair, score)),
            Some(reason) => {
                rejected.push((pair.0.label.clone(), Arc::new(pair.1)));
                dropped.push(Dropped { label: pair.0.label, bounds: pair.0.bounds, reason });
            }
        }
    }
    // Ids count from left to right, so that they are the same whatever order the detector gives.
    kept.sort_by(|a, b| {
        let key = |d: &Detection| (d.bounds.x0, d.bounds.y0);
        key(&a.0.0).partial_cmp(&key(&b.0.0)).unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(Found { kept, dropped, rejected, hosts, missed })
}

/// Names what was found, with numbers that earlier levels have not taken.
pub fn name(level: Level, found: Found, before: &Before) -> Vec<Object> {
    let mut counters = before.counts();
    let mut taken: BTreeSet<ObjectId> = before.ids().cloned().collect();
    let mut candidates = Vec::new();
    for ((detection, mask), mask_score) in found.kept {
        let first = ObjectId::numbered(&detection.label, 1);
        let number = counters.entry(stem(first.as_str())).or_default();
        // Earlier levels keep the numbers of what they kept, which need not be the lowest.
        let id = loop {
            *number += 1;
            let id = ObjectId::numbered(&detection.label, *number);
            if taken.insert(id.clone()) {
                break id;
            }
        };
        let host_hint = found.hosts.get(&host_key(&detection)).cloned().and_then(|h: String| ObjectId::new(&h).ok());
        let found_by = found.missed.contains(&host_key(&detection)).then_some(LookKind::Missing);
        candidates.push(Object { mask_score, host_hint, found_by, ..Object::found(id, level, detection, mask) });
    }
    candidates
}

/// The pictures that go with a list question.
fn list_pictures(level: Level, state: &SceneState) -> Vec<Picture> {
    let photo = state.photo.clone();
    let grid = Arc::new(grid_overlay(&photo, 50).picture);
    if level != Level::Decoration {
        return vec![
            Picture { caption: "IMAGE 1: the photo".into(), image: photo },
            Picture { caption: "IMAGE 2: the photo with a coordinate grid (thousandths)".into(), image: grid },
        ];
    }
    let boxes: Vec<LabelledBox> = state
        .partial
        .placed
        .iter()
        .enumerate()
        .filter_map(|(i, p)| {
            let bounds = p.item.mask.bounds()?;
            Some(LabelledBox { bounds, label: p.item.id.to_string(), color: palette(i) })
        })
        .collect();
    vec![
        Picture {
            caption: "IMAGE 1: the photo with the furniture placed so far".into(),
            image: Arc::new(draw_boxes(&photo, &boxes)),
        },
        Picture { caption: "IMAGE 2: the photo with a coordinate grid (thousandths)".into(), image: grid },
        Picture { caption: "IMAGE 3: the furniture-only reconstruction".into(), image: crate::views::flat(state) },
    ]
}

async fn ask_list(
    ctx: &PhaseCtx<'_>,
    call: &str,
    level: Level,
    state: &Arc<SceneState>,
    with_boxes: bool,
) -> Result<ListAnswer, PhaseError> {
    let placed: Vec<PlacedObject> = if level == Level::Decoration {
        let below = state.partial.placed.iter().filter(|p| p.item.level != Level::Ceiling);
        below.map(crate::views::placed_object).chain(crate::views::ledges(state)).collect()
    } else {
        Vec::new()
    };
    let trays = if level == Level::Ceiling { trays(&state.partial.room) } else { Vec::new() };
    let question = ListQuestion {
        level,
        room_type: state.layout.answer.room.room_type.clone(),
        with_boxes,
        placed,
        trays,
        view: Some(RoomView {
            camera: harmony_scene::SceneCamera::from(&state.partial.camera),
            extents: state.partial.room.extents,
        }),
    };
    let shown = Arc::clone(state);
    let pictures = ctx.computed(move || list_pictures(level, &shown)).await?;
    ctx.ask(call, question, pictures).await
}

/// The label of a listed kind's objects.
fn label_of(item: &ListedItem) -> String {
    item.kind.trim().to_lowercase()
}

/// Boxes given with the list, in working pixels, and the hosts named with them.
fn listed_boxes(wanted: &ListAnswer, size: ImageSize) -> (Vec<Detection>, BTreeMap<[i64; 4], String>) {
    let (kx, ky) = (f64::from(size.width) / 1000.0, f64::from(size.height) / 1000.0);
    let mut found = Vec::new();
    let mut hosts = BTreeMap::new();
    for item in &wanted.items {
        for instance in &item.instances {
            let bounds = crate::views::pixels(size, instance.bounds);
            let pieces: Vec<_> = [&instance.outline].into_iter().chain(&instance.pieces).cloned().collect();
            let outline = joined(&pieces).map(|o| o.iter().map(|p| [p[0] * kx, p[1] * ky]).collect());
            let detection =
                Detection { label: label_of(item), phrase: item.gdino.clone(), bounds, score: None, outline };
            if let Some(host) = &instance.host {
                hosts.insert(host_key(&detection), host.clone());
            }
            found.push(detection);
        }
    }
    (found, hosts)
}

/// Boxes that the VLM gives for what the list counts and the detector did not find, and the hosts it names with them.
///
/// Without them a lamp would stand on a nightstand that nobody placed.
async fn ask_missing(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &Arc<SceneState>,
    wanted: &ListAnswer,
    found: &[Detection],
) -> Result<(Vec<Detection>, BTreeMap<[i64; 4], String>), PhaseError> {
    let missing = missing_of(wanted, found);
    if missing.is_empty() {
        return Ok((Vec::new(), BTreeMap::new()));
    }
    let shown = ask_list(ctx, "list_missing", level, state, true).await?;
    let (boxes, hosts) = listed_boxes(&shown, state.partial.camera.size);
    let new = not_found(boxes, found, missing, ctx.settings.filters.box_containment);
    for d in &new {
        let message = format!("the detector did not find a {}; its box is the VLM's", d.label);
        ctx.warn(WarningKind::AnswerRepaired, None, message);
    }
    Ok((new, hosts))
}

/// Those of the boxes that show what is missing, and nothing that was found: as many of a kind as are missing.
fn not_found(
    boxes: Vec<Detection>,
    found: &[Detection],
    mut missing: BTreeMap<String, usize>,
    containment: f64,
) -> Vec<Detection> {
    let mut new: Vec<Detection> = Vec::new();
    for d in boxes {
        let Some(left) = missing.get_mut(&d.label).filter(|left| **left > 0) else { continue };
        let known = found.iter().chain(&new).any(|other| {
            let inside = d.bounds.covered_by(&other.bounds) >= containment;
            d.bounds.iou(&other.bounds) >= SAME_BOX || (other.label == d.label && inside)
        });
        if d.bounds.area() >= SMALLEST_BOX && !known {
            *left -= 1;
            new.push(d);
        }
    }
    new
}

/// How many of each listed kind were not found.
fn missing_of(wanted: &ListAnswer, found: &[Detection]) -> BTreeMap<String, usize> {
    let mut missing: BTreeMap<String, usize> = BTreeMap::new();
    for item in &wanted.items {
        *missing.entry(label_of(item)).or_default() += item.count as usize;
    }
    for d in found {
        if let Some(left) = missing.get_mut(&d.label) {
            *left = left.saturating_sub(1);
        }
    }
    missing.retain(|_, left| *left > 0);
    missing
}

fn host_key(d: &Detection) -> [i64; 4] {
    [d.bounds.x0, d.bounds.y0, d.bounds.x1, d.bounds.y1].map(|v| (v * 16.0).round() as i64)
}

async fn detect(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &SceneState,
    wanted: &ListAnswer,
) -> Result<Vec<Detection>, PhaseError> {
    let request = DetectRequest {
        name: ctx.call("detect"),
        image: state.photo.clone(),
        level,
        phrases: wanted
            .items
            .iter()
            .map(|item| PhraseRequest { label: label_of(item), phrase: item.gdino.clone(), count: item.count as usize })
            .collect(),
    };
    let size = state.partial.camera.size;
    let mut found = ctx.calls.detect(&request).await?.detections;
    found.retain_mut(|d| {
        let sound = [d.bounds.x0, d.bounds.y0, d.bounds.x1, d.bounds.y1].iter().all(|v| v.is_finite());
        d.bounds = d.bounds.clamped(size);
        let keep = sound && d.bounds.area() >= SMALLEST_BOX;
        if !keep {
            ctx.warn(WarningKind::AnswerRepaired, None, format!("an unusable box for {} was dropped", d.label));
        }
        keep
    });
    Ok(found)
}

/// Writes what became of a level's candidates, and the masks of those that an inspection kept: what was refused leaves no
/// mask behind, as in the paper.
///
/// # Errors
/// Unwritable files.
pub fn write_files(
    ctx: &PhaseCtx<'_>,
    candidates: &[Object],
    dropped: &[Dropped],
    kept: &[Object],
) -> Result<(), PhaseError> {
    let wanted: BTreeSet<&ObjectId> = kept.iter().map(|object| &object.id).collect();
    let rows: Vec<Value> = candidates.iter().map(|c| row(c, wanted.contains(&c.id))).collect();
    ctx.write_json(&ctx.record("detections.json"), &json!({ "kept": rows, "dropped": dropped }))?;
    for object in kept {
        harmony_io::save_mask(&ctx.file(&mask_file(&object.id))?, &object.mask)?;
    }
    Ok(())
}

/// A candidate's row in `detections.json`.
fn row(c: &Object, has_mask: bool) -> Value {
    json!({
        "id": c.id, "label": c.detection.label, "phrase": c.detection.phrase, "box": c.detection.bounds,
        "score": c.detection.score, "mask": has_mask.then(|| mask_file(&c.id)), "mask_score": c.mask_score,
        "mask_pixels": c.mask.count(),
    })
}

/// File of an object's mask in its phase's folder.
fn mask_file(id: &ObjectId) -> String {
    format!("masks/{id}.png")
}

/// The photo with boxes and ids of candidates, for the inspect question.
pub fn boxed(photo: &RgbImage, candidates: &[Object]) -> RgbImage {
    let boxes: Vec<LabelledBox> = candidates
        .iter()
        .enumerate()
        .filter_map(|(i, c)| Some(LabelledBox { bounds: c.mask.bounds()?, label: c.id.to_string(), color: palette(i) }))
        .collect();
    draw_boxes(photo, &boxes)
}

/// Recesses of a room's ceiling in words, each once.
fn trays(room: &Room) -> Vec<String> {
    let own = || room.shape.niches.iter().filter(|n| n.surface == Surface::Ceiling);
    let words = own().map(|n| {
        let lit = own().any(|o| o.kind == n.kind && o.glow.is_some());
        if lit { format!("{} with the light from behind its edge", n.kind) } else { n.kind.clone() }
    });
    words.collect::<BTreeSet<_>>().into_iter().collect()
}

#[cfg(test)]
mod tests {
    use harmony_scene::PixelBox;

    use super::*;

    fn at(label: &str, x0: f64, x1: f64) -> Detection {
        let bounds = PixelBox { x0, y0: 0.0, x1, y1: 100.0 };
        Detection { label: label.into(), phrase: label.into(), bounds, score: None, outline: None }
    }

    #[test]
    fn what_was_listed_and_not_found_is_missing() {
        let item = |kind: &str, count| ListedItem { kind: kind.into(), gdino: kind.into(), count, instances: vec![] };
        let wanted = ListAnswer { items: vec![item("Nightstand ", 2), item("bed", 1), item("lamp", 1)] };
        let found = ["nightstand", "bed", "bed", "rug"].map(|label| at(label, 0.0, 100.0));
        // More than listed is not too few of another kind.
        let missing = missing_of(&wanted, &found);
        assert_eq!(missing, BTreeMap::from([("nightstand".to_owned(), 1), ("lamp".to_owned(), 1)]));
    }

    #[test]
    fn what_an_inspection_refused_has_a_row_and_no_mask() {
        let id = ObjectId::numbered("chair", 1);
        let mask = Mask::from_fn(ImageSize::new(20, 10), |x, _| x < 3);
        let chair = Object::found(id, Level::Furniture, at("chair", 0.0, 3.0), mask);
        assert_eq!(row(&chair, true)["mask"], "masks/chair_01.png");
        let refused = row(&chair, false);
        assert!(refused["mask"].is_null());
        assert_eq!(refused["mask_pixels"], 30);
    }

    #[test]
    fn only_what_no_box_shows_yet_is_taken_and_no_more_than_are_missing() {
        let found = [at("nightstand", 0.0, 100.0), at("bed", 200.0, 600.0)];
        let taken = |boxes: Vec<Detection>| -> Vec<f64> {
            let missing = BTreeMap::from([("nightstand".to_owned(), 1)]);
            not_found(boxes, &found, missing, 0.85).iter().map(|d| d.bounds.x0).collect()
        };
        // The one that was found, once a little off and once a part of it; a kind that nobody misses.
        assert!(taken(vec![at("nightstand", 10.0, 105.0), at("nightstand", 20.0, 50.0)]).is_empty());
        assert!(taken(vec![at("lamp", 800.0, 850.0)]).is_empty());
        // A bed by another name.
        assert!(taken(vec![at("nightstand", 210.0, 590.0)]).is_empty());
        assert_eq!(taken(vec![at("nightstand", 700.0, 800.0), at("nightstand", 900.0, 950.0)]), [700.0]);
        // Seen through a bed's box, it is no bed.
        assert_eq!(taken(vec![at("nightstand", 580.0, 680.0)]), [580.0]);
    }
}
