//! Kinds counted in photo and scene after the last level: what is missing is added by reuse or made new, what is too much
//! is taken out where the evidence allows.

use std::sync::Arc;

use harmony_placement::ReviewAction;
use harmony_prompts::{CountedKind, CountsAnswer, CountsQuestion, MissingInstance};
use harmony_roles::Picture;
use harmony_scene::{Level, ObjectId, WarningKind};
use serde_json::json;

use super::added::{self, Wanted};
use super::review;
use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// The question about the counts of a scene, with its pictures; `None` where it is not asked.
///
/// # Errors
/// Only that of a computation that broke.
pub async fn question(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
) -> Result<Option<(CountsQuestion, Vec<Picture>)>, PhaseError> {
    if !ctx.settings.asked_looks().counts || !ctx.is_looked_at("counts") {
        return Ok(None);
    }
    ctx.step("counting");
    let question = CountsQuestion {
        room: views::room_summary(state),
        placed: state.partial.placed.iter().map(views::placed_object).collect(),
        unplaced: state.left.iter().map(|left| format!("- {}: {}", left.name, left.reason)).collect(),
    };
    let shown = state.clone();
    let pictures = ctx
        .computed(move || {
            let scene = views::marked(&shown, |_| true);
            [("IMAGE 1: the photo", views::ruled(&shown.photo)), ("IMAGE 2: the reconstruction with ids", scene)]
                .map(|(caption, image)| Picture { caption: caption.into(), image: Arc::new(image) })
        })
        .await?;
    Ok(Some((question, pictures.to_vec())))
}

/// Asks; it waits for nothing else, so that other questions may be asked beside it.
///
/// # Errors
/// Fatal role errors only.
pub async fn ask(
    ctx: &PhaseCtx<'_>,
    question: Option<(CountsQuestion, Vec<Picture>)>,
) -> Result<Option<(CountsQuestion, CountsAnswer)>, PhaseError> {
    let Some((question, pictures)) = question else { return Ok(None) };
    let answer = ctx.ask("counts", question.clone(), pictures).await?;
    Ok(Some((question, answer)))
}

/// Mends what the counts say.
///
/// # Errors
/// Fatal role errors and unwritable files only.
pub async fn settle(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    counted: Option<(CountsQuestion, CountsAnswer)>,
) -> Result<(), PhaseError> {
    let Some((question, mut answer)) = counted else { return Ok(()) };
    let sound = |complaint: Option<String>| {
        complaint.map(|complaint| ctx.warn(WarningKind::AnswerRepaired, None, complaint)).is_none()
    };
    for kind in &mut answer.kinds {
        kind.missing.retain(|missing| sound(question.missing_complaint(missing)));
        kind.surplus.retain(|id| sound(question.complaint(id)));
    }
    let mut surplus = Vec::new();
    for id in answer.kinds.iter().flat_map(|kind| &kind.surplus).filter_map(|id| ObjectId::new(id).ok()) {
        let remove = ReviewAction::Remove { object: id.clone() };
        let (kept, reason) = review::try_on(ctx, state, remove, &id, "Removal of one too many").await?;
        surplus.push(json!({ "id": id, "removed": kept, "reason": reason }));
    }
    let mut placed = Vec::new();
    for level in Level::ALL {
        let wanted: Vec<Wanted> =
            answer.kinds.iter().filter(|kind| kind.level == level).flat_map(|kind| wanted(state, kind)).collect();
        placed.extend(added::all(&ctx.inside(Phase::Objects(level), "counts_added"), level, state, wanted).await?);
    }
    ctx.write_json("counts.json", &json!({ "counts": answer, "surplus": surplus, "added": placed }))
}

fn wanted(state: &SceneState, kind: &CountedKind) -> Vec<Wanted> {
    let named = |m: &MissingInstance| Wanted::named(state, &kind.kind, m.bounds, m.like.as_ref(), m.host.as_ref());
    kind.missing.iter().map(named).collect()
}
