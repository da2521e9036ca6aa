//! Verify, describe and relate all candidates of a level, up to eight with one question.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::sheet::{Cell, contact_sheet, crop_rgba};
use harmony_prompts::{DoubtedSize, InspectCandidate, InspectQuestion, InspectedObject, SizesQuestion};
use harmony_roles::Picture;
use harmony_scene::{Level, Mask, ObjectId, Size, WarningKind};
use image::RgbaImage;

use super::programs;
use crate::before::Before;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{DropReason, Left, Object, SceneState};
use crate::views;

/// Candidates on one question at most, as many as one can keep in mind; more make several questions.
pub const CANDIDATES_PER_QUESTION: usize = 8;
/// Crops on one contact sheet.
const CROPS_PER_SHEET: usize = 12;
/// Sides of a crop, pixels, and of a whole sheet: few crops are shown larger.
const CROP_PX: [u32; 2] = [300, 480];
const SHEET_PX: u32 = 1280;

/// What was said about a level.
#[derive(Debug, Clone, Default)]
pub struct Inspection {
    /// The objects that are wanted, with what was said about them, in the order in which they were found.
    pub objects: Vec<Object>,
    /// Those that are not.
    pub left: Vec<Left>,
    /// Labels and pixels of those.
    pub rejected: Vec<(String, Arc<Mask>)>,
    /// Placement order as reasoned.
    pub order: Vec<ObjectId>,
    /// In words.
    pub summary: String,
}

/// Asks about all candidates; the questions of a crowded level are asked beside each other.
///
/// # Errors
/// Fatal role errors only.
pub async fn all(
    ctx: &PhaseCtx<'_>,
    level: Level,
    before: &Before,
    candidates: Vec<Object>,
) -> Result<Inspection, PhaseError> {
    let programs = programs::wanted(ctx, &before.state, &candidates);
    let modelled: BTreeSet<&ObjectId> = programs.iter().flat_map(|(_, objects)| objects).map(|o| &o.id).collect();
    let mut questions = Vec::new();
    // All pictures are drawn before the first question is asked, so that the questions come in their order.
    for (part, batch) in batches(&candidates).into_iter().enumerate() {
        let name = if part == 0 { "inspect".to_owned() } else { format!("inspect_{}", part + 1) };
        let (shown, listed) = (Arc::clone(&before.state), batch.clone());
        let pictures = ctx.computed(move || pictures(&shown, &listed)).await?;
        let others: Vec<Object> = candidates.iter().filter(|c| batch.iter().all(|b| b.id != c.id)).cloned().collect();
        questions.push((name, question(ctx, level, before, [&batch, &others], &modelled), pictures));
    }
    let asked =
        questions.into_iter().map(|(name, question, pictures)| async move { ctx.ask(&name, question, pictures).await });
    let answers = join_all(asked).await;
    let mut inspection = Inspection::default();
    // The first that an answer says of an object holds: those of recordings of a time when more was asked at once speak of
    // the objects of later questions, too.
    let mut said: BTreeMap<String, InspectedObject> = BTreeMap::new();
    let mut ranks: BTreeMap<ObjectId, f64> = BTreeMap::new();
    for answer in answers {
        let answer = answer?;
        for object in answer.objects {
            said.entry(object.id.clone()).or_insert_with(|| tidied(object));
        }
        let of_order = (1..).map(|rank| f64::from(rank) / answer.placement_order.len() as f64);
        for (rank, id) in of_order.zip(answer.placement_order.iter().filter_map(|id| ObjectId::new(id).ok())) {
            ranks.entry(id).or_insert(rank);
        }
        if !answer.scene_summary.is_empty() {
            inspection.summary = answer.scene_summary;
        }
    }
    // What comes first in its batch comes first.
    inspection.order = ranks.keys().cloned().collect();
    inspection.order.sort_by(|a, b| ranks[a].total_cmp(&ranks[b]));
    for mut object in candidates {
        let reason = match said.remove(object.id.as_str()) {
            Some(said) if said.keep => {
                object.said = said;
                inspection.objects.push(object);
                continue;
            }
            Some(said) => DropReason::Refused(said.reason),
            None => {
                ctx.warn(WarningKind::ObjectDropped, Some(object.id.clone()), DropReason::NothingSaid.to_string());
                DropReason::NothingSaid
            }
        };
        inspection.left.push(Left { name: object.id.to_string(), phase: ctx.phase, reason });
        inspection.rejected.push((object.detection.label, object.mask));
    }
    ask_sizes(ctx, before, &mut inspection.objects).await?;
    Ok(inspection)
}

/// Candidates in batches of one question each: of about the same size, like things together, so that sets are seen whole.
fn batches(candidates: &[Object]) -> Vec<Vec<Object>> {
    let count = candidates.len().div_ceil(CANDIDATES_PER_QUESTION);
    if count <= 1 {
        return candidates.chunks(CANDIDATES_PER_QUESTION).map(<[Object]>::to_vec).collect();
    }
    let first = |label: &str| candidates.iter().position(|c| c.detection.label == label);
    let mut sorted = candidates.to_vec();
    sorted.sort_by_key(|c| first(&c.detection.label));
    sorted.chunks(candidates.len().div_ceil(count)).map(<[Object]>::to_vec).collect()
}

/// How far outside the usual range a size is doubted.
const BEYOND: (f64, f64) = (0.7, 1.4);

/// Sizes far outside what their kinds have: asked again, and kept with doubt when they are answered alike. They are not
/// cut, for a bean bag of a metre exists.
async fn ask_sizes(ctx: &PhaseCtx<'_>, before: &Before, objects: &mut [Object]) -> Result<(), PhaseError> {
    let doubted: Vec<DoubtedSize> = objects
        .iter()
        .filter(|object| is_unusual(object))
        .map(|object| {
            let (low, high) = harmony_catalogue::size_range(&object.said.kind);
            DoubtedSize {
                id: object.id.clone(),
                kind: object.said.kind.clone(),
                answered: object.size(),
                usual: [low, high],
                apparent: views::apparent_size(&before.state, object),
            }
        })
        .collect();
    if !doubted.is_empty() && ctx.is_looked_at("sizes") {
        let (shown, asked) = (Arc::clone(&before.state), doubted.iter().map(|d| d.id.clone()).collect::<Vec<_>>());
        let crops: Vec<Object> = objects.iter().filter(|o| asked.contains(&o.id)).cloned().collect();
        let mut pictures = ctx.computed(move || sheets(&shown, &crops, 1)).await?;
        pictures.truncate(1);
        let answer = ctx.ask("sizes", SizesQuestion { objects: doubted }, pictures).await?;
        for found in answer.objects {
            if let Some(object) = objects.iter_mut().find(|o| o.id.as_str() == found.id) {
                object.said.size_m = found.size_m;
            }
        }
    }
    for object in objects.iter().filter(|object| is_unusual(object)) {
        let Size { width, height, depth } = object.size();
        let message = format!(
            "size {width:.2} x {height:.2} x {depth:.2} m is unusual for a {}: it is doubted",
            object.said.kind
        );
        ctx.warn(WarningKind::LowConfidence, Some(object.id.clone()), message);
    }
    Ok(())
}

/// Whether a size is far outside what its kind has: placement thinks little of it.
pub fn is_unusual(object: &Object) -> bool {
    let (low, high) = harmony_catalogue::size_range(&object.said.kind);
    let size = object.size().as_vec();
    size.cmplt(low.as_vec() * BEYOND.0).any() || size.cmpgt(high.as_vec() * BEYOND.1).any()
}

fn question(
    ctx: &PhaseCtx<'_>,
    level: Level,
    before: &Before,
    [asked, others]: [&[Object]; 2],
    modelled: &BTreeSet<&ObjectId>,
) -> InspectQuestion {
    let state = &before.state;
    let candidate = |c: &Object| InspectCandidate {
        id: c.id.clone(),
        label: c.detection.label.clone(),
        phrase: c.detection.phrase.clone(),
        bounds: c.detection.bounds,
        image: state.partial.camera.size,
        estimated_size_m: views::apparent_size(state, c),
        host: c.host_hint.clone(),
        program_follows: modelled.contains(&c.id),
    };
    InspectQuestion {
        level,
        room_type: state.layout.answer.room.room_type.clone(),
        room: views::room_summary(state),
        candidates: asked.iter().map(candidate).collect(),
        others: others.iter().map(candidate).collect(),
        placed: before.objects(),
        templates: harmony_catalogue::templates().map(str::to_owned).collect(),
        with_models: !ctx.can().makes_shapes,
    }
}

/// The photo with the candidates, the empty room, and sheets of crops.
fn pictures(state: &SceneState, candidates: &[Object]) -> Vec<Picture> {
    let mut pictures = vec![
        Picture {
            caption: "IMAGE 1: the photo with all candidates".into(),
            image: Arc::new(super::detect::boxed(&state.photo, candidates)),
        },
        Picture { caption: "IMAGE 2: the empty room".into(), image: views::empty_room(state) },
    ];
    pictures.extend(sheets(state, candidates, 3));
    pictures
}

/// Sheets of crops, captioned from a number on.
fn sheets(state: &SceneState, candidates: &[Object], first: usize) -> Vec<Picture> {
    let crops: Vec<(String, RgbaImage)> = candidates
        .iter()
        .filter_map(|c| crop_rgba(&state.photo, &c.mask, 0.1).map(|(image, _)| (c.id.to_string(), image)))
        .collect();
    let sheet = |(i, sheet): (usize, &[(String, RgbaImage)])| {
        let cells: Vec<Cell<'_>> = sheet.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
        let columns = (cells.len() as u32).min(4);
        let crop = (SHEET_PX / columns.max(1)).clamp(CROP_PX[0], CROP_PX[1]);
        let image = Arc::new(contact_sheet(&cells, columns, crop));
        Picture { caption: format!("IMAGE {}: crops", i + first), image }
    };
    crops.chunks(CROPS_PER_SHEET).enumerate().map(sheet).collect()
}

fn tidied(mut object: InspectedObject) -> InspectedObject {
    object.kind = object.kind.trim().to_lowercase();
    object
}

#[cfg(test)]
mod tests {
    use harmony_roles::Detection;
    use harmony_scene::{ImageSize, PixelBox};

    use super::*;

    fn candidates(labels: &[&str]) -> Vec<Object> {
        let object = |(k, label): (usize, &&str)| {
            let bounds = PixelBox { x0: 0.0, y0: 0.0, x1: 4.0, y1: 4.0 };
            let detection =
                Detection { label: (*label).into(), phrase: String::new(), bounds, score: None, outline: None };
            let mask = Mask::empty(ImageSize::new(8, 8));
            Object::found(ObjectId::numbered(label, k + 1), Level::Furniture, detection, mask)
        };
        labels.iter().enumerate().map(object).collect()
    }

    fn ids(batches: &[Vec<Object>]) -> Vec<Vec<String>> {
        batches.iter().map(|batch| batch.iter().map(|o| o.id.to_string()).collect()).collect()
    }

    #[test]
    fn batches_are_alike_in_size_and_hold_sets_together() {
        assert_eq!(ids(&batches(&candidates(&[]))), Vec::<Vec<String>>::new());
        let few = candidates(&["sofa", "chair", "table", "chair"]);
        assert_eq!(ids(&batches(&few)), [["sofa_01", "chair_02", "table_03", "chair_04"]], "as they were found");
        let many = candidates(&["chair", "lamp", "chair", "bed", "chair", "rug", "chair", "desk", "lamp"]);
        let of = ids(&batches(&many));
        assert_eq!(of[0], ["chair_01", "chair_03", "chair_05", "chair_07", "lamp_02"]);
        assert_eq!(of[1], ["lamp_09", "bed_04", "rug_06", "desk_08"]);
        let level: Vec<&str> = std::iter::repeat_n("cup", 17).collect();
        assert_eq!(batches(&candidates(&level)).iter().map(Vec::len).collect::<Vec<_>>(), [6, 6, 5]);
    }
}
