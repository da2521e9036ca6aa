//! Verify, describe and relate all candidates of a level with one question (a few for crowded levels).

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::sheet::{Cell, contact_sheet, crop_rgba};
use harmony_prompts::{InspectAnswer, InspectCandidate, InspectQuestion, InspectedObject, InspectedSize};
use harmony_roles::Picture;
use harmony_scene::{Level, Mask, ObjectId, Size, WarningKind};
use image::RgbaImage;

use crate::before::Before;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{DropReason, Left, Object, SceneState};
use crate::views;

/// Candidates on one question at most; more make several questions.
const CANDIDATES_PER_QUESTION: usize = 24;
/// Crops on one contact sheet.
const CROPS_PER_SHEET: usize = 12;

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
    let answers = join_all(candidates.chunks(CANDIDATES_PER_QUESTION).enumerate().map(|(part, chunk)| async move {
        let name = if part == 0 { "inspect".to_owned() } else { format!("inspect_{}", part + 1) };
        ask(ctx, level, before, chunk, &name).await
    }))
    .await;
    let mut inspection = Inspection::default();
    let mut said = BTreeMap::new();
    for answer in answers {
        let answer = answer?;
        said.extend(answer.objects.into_iter().map(|object| (object.id.clone(), sensible(ctx, object))));
        inspection.order.extend(answer.placement_order.iter().filter_map(|id| ObjectId::new(id).ok()));
        if !answer.scene_summary.is_empty() {
            inspection.summary = answer.scene_summary;
        }
    }
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
    Ok(inspection)
}

async fn ask(
    ctx: &PhaseCtx<'_>,
    level: Level,
    before: &Before,
    candidates: &[Object],
    name: &str,
) -> Result<InspectAnswer, PhaseError> {
    let state = &before.state;
    let question = InspectQuestion {
        level,
        room_type: state.layout.answer.room.room_type.clone(),
        room: views::room_summary(state),
        candidates: candidates
            .iter()
            .map(|c| InspectCandidate {
                id: c.id.clone(),
                label: c.detection.label.clone(),
                phrase: c.detection.phrase.clone(),
                bounds: c.detection.bounds,
                image: state.partial.camera.size,
                estimated_size_m: views::apparent_size(state, c),
                host: c.host_hint.clone(),
            })
            .collect(),
        placed: before.objects(),
        templates: harmony_catalogue::templates().map(str::to_owned).collect(),
        with_models: !ctx.can().makes_shapes,
    };
    let (shown, listed) = (Arc::clone(state), candidates.to_vec());
    let pictures = ctx.computed(move || pictures(&shown, &listed)).await?;
    ctx.ask(name, question, pictures).await
}

/// The photo with the candidates, the empty room, and sheets of crops.
fn pictures(state: &SceneState, candidates: &[Object]) -> Vec<Picture> {
    let crops: Vec<(String, RgbaImage)> = candidates
        .iter()
        .filter_map(|c| crop_rgba(&state.photo, &c.mask, 0.1).map(|(image, _)| (c.id.to_string(), image)))
        .collect();
    let mut pictures = vec![
        Picture {
            caption: "IMAGE 1: the photo with all candidates".into(),
            image: Arc::new(super::detect::boxed(&state.photo, candidates)),
        },
        Picture { caption: "IMAGE 2: the empty room".into(), image: views::empty_room(state) },
    ];
    for (i, sheet) in crops.chunks(CROPS_PER_SHEET).enumerate() {
        let cells: Vec<Cell<'_>> = sheet.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
        let columns = (cells.len() as u32).min(4);
        pictures.push(Picture {
            caption: format!("IMAGE {}: crops", i + 3),
            image: Arc::new(contact_sheet(&cells, columns, 300)),
        });
    }
    pictures
}

/// Sizes far outside what the category can be are pulled back, with a warning.
fn sensible(ctx: &PhaseCtx<'_>, mut object: InspectedObject) -> InspectedObject {
    let (low, high) = harmony_catalogue::size_range(&object.kind);
    let given = Size { width: object.size_m.width, height: object.size_m.height, depth: object.size_m.depth };
    let clamped = given.as_vec().max(low.as_vec() * 0.7).min(high.as_vec() * 1.4);
    if (clamped - given.as_vec()).abs().max_element() > 1e-9 {
        let id = ObjectId::new(&object.id).ok();
        ctx.warn(
            WarningKind::AnswerRepaired,
            id,
            format!(
                "size {:.2} x {:.2} x {:.2} m is not plausible for a {}; taken as {:.2} x {:.2} x {:.2} m",
                given.width, given.height, given.depth, object.kind, clamped.x, clamped.y, clamped.z
            ),
        );
        object.size_m = InspectedSize { width: clamped.x, height: clamped.y, depth: clamped.z };
    }
    object.kind = object.kind.trim().to_lowercase();
    object
}
