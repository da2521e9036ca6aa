//! The reflective feedback loop. Paper Sec. 3.3 (key `review.loop`): ask, try each action, measure, keep or refuse.

use std::sync::Arc;

use harmony_placement::{ActionError, ReviewAction, Verdict, apply, judge};
use harmony_prompts::{ReviewActionAnswer, ReviewActionKind, ReviewAnswer, ReviewQuestion};
use harmony_roles::Picture;
use harmony_scene::{Level, ObjectId, WarningKind};
use serde_json::{Value, json};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// Reviews a level until nothing is asked for, nothing is kept, or the rounds are used up.
///
/// # Errors
/// Fatal role errors only.
pub async fn until_settled(ctx: &PhaseCtx<'_>, level: Level, state: &mut SceneState) -> Result<(), PhaseError> {
    for round in 1..=ctx.settings.review_rounds {
        if state.partial.placed.iter().all(|p| p.item.level != level) {
            return Ok(());
        }
        ctx.step(&format!("review {round}"));
        let answer = ask(ctx, level, state, round).await?;
        let mut results = Vec::new();
        let mut kept = 0;
        for action in &answer.actions {
            let result = try_action(ctx, state, action).await?;
            kept += usize::from(result.1);
            results.push(result.0);
        }
        ctx.write_json(
            &format!("review_{round}.json"),
            &json!({ "issues": answer.issues, "converged": answer.converged, "actions": results, "kept": kept }),
        )?;
        if answer.converged || kept == 0 {
            return Ok(());
        }
    }
    Ok(())
}

async fn ask(ctx: &PhaseCtx<'_>, level: Level, state: &SceneState, round: usize) -> Result<ReviewAnswer, PhaseError> {
    let findings: Vec<String> = state
        .partial
        .placed
        .iter()
        .filter(|p| p.item.level == level)
        .filter_map(|p| {
            let iou = p.evidence.silhouette_iou?;
            let poor = iou < 0.6 && !p.item.traits.heavily_occluded;
            let deep = p.evidence.penetration_m > 0.02;
            (poor || deep).then(|| {
                format!(
                    "- {}: outline agreement {:.2}, penetration {:.0} mm",
                    p.item.id,
                    iou,
                    p.evidence.penetration_m * 1000.0
                )
            })
        })
        .collect();
    let question = ReviewQuestion {
        level,
        room: views::room_summary(state),
        placed: state.partial.placed.iter().map(views::placed_object).collect(),
        unplaced: state
            .dropped
            .iter()
            .filter(|(_, phase, _)| phase == ctx.phase)
            .map(|(label, _, reason)| format!("- {label}: {reason}"))
            .collect(),
        findings,
    };
    let shown = state.clone();
    let (reconstruction, both) = ctx
        .computed(move || {
            let drawn = views::drawn(&shown);
            (views::with_room(&shown, Arc::clone(&drawn.flat)), views::blend(&shown, &drawn))
        })
        .await?;
    let pictures = vec![
        Picture { caption: "IMAGE 1: the photo".into(), image: state.photo.clone() },
        Picture { caption: "IMAGE 2: the reconstruction".into(), image: reconstruction },
        Picture { caption: "IMAGE 3: both, with outlines".into(), image: both },
    ];
    ctx.ask(&format!("review_{round}"), question, pictures).await
}

/// Tries one action; the scene changes only when the evidence does not speak against it.
async fn try_action(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    answer: &ReviewActionAnswer,
) -> Result<(Value, bool), PhaseError> {
    let Some(action) = typed(state, answer) else {
        return Ok((json!({ "asked": answer, "kept": false, "reason": "it says too little to be tried" }), false));
    };
    let object = ObjectId::new(&answer.id).ok();
    Ok(match try_on(ctx, state, action, object, &format!("{:?}", answer.action)).await? {
        Err(error) => (json!({ "asked": answer, "kept": false, "reason": error.to_string() }), false),
        Ok(verdict) => (json!({ "asked": answer, "kept": verdict.kept, "verdict": verdict }), verdict.kept),
    })
}

/// Tries an action on the scene and keeps it, if the evidence does not speak against it; if it does, a warning about
/// the object says so.
///
/// # Errors
/// Only that of a computation that broke; inside, that of an action that cannot be tried.
pub async fn try_on(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    action: ReviewAction,
    object: Option<ObjectId>,
    name: &str,
) -> Result<Result<Verdict, ActionError>, PhaseError> {
    let (partial, settings) = (state.partial.clone(), ctx.settings.placement.clone());
    let tried = ctx
        .computed(move || {
            let outcome = apply(&partial, &action, &settings)?;
            let verdict = judge(&partial, &outcome, &settings);
            Ok::<_, ActionError>((outcome, verdict))
        })
        .await?;
    Ok(tried.map(|(outcome, verdict)| {
        if verdict.kept {
            for id in &outcome.touched {
                state.forget_look(id);
            }
            adopt_copies(state, &outcome.scene);
            state.partial = outcome.scene;
        } else {
            let message = format!("{name} was proposed and refused: {}", verdict.reason);
            ctx.warn(WarningKind::ActionRefused, object, message);
        }
        verdict
    }))
}

/// Copies that an action added get an entry among the prepared objects, like the one they copy.
fn adopt_copies(state: &mut SceneState, scene: &harmony_placement::PartialScene) {
    for placed in &scene.placed {
        let id = &placed.item.id;
        if state.prepared.contains_key(id) {
            continue;
        }
        let original = state
            .prepared
            .values()
            .find(|p| p.inspected.kind == placed.item.label && p.candidate.level == placed.item.level)
            .cloned();
        if let Some(mut copy) = original {
            copy.candidate.id = id.clone();
            copy.candidate.mask = placed.item.mask.clone();
            copy.index = placed.item.index;
            copy.mesh_source = format!("copy of {}", copy.mesh_source);
            state.next_index = state.next_index.max(copy.index + 1);
            state.prepared.insert(id.clone(), copy);
        }
    }
}

fn typed(state: &SceneState, a: &ReviewActionAnswer) -> Option<ReviewAction> {
    let object = ObjectId::new(&a.id).ok()?;
    let other = a.other.as_deref().and_then(|o| ObjectId::new(o).ok());
    Some(match a.action {
        ReviewActionKind::Move => ReviewAction::Move { object, by_m: a.delta_m? },
        ReviewActionKind::Rotate => ReviewAction::Rotate { object, by_deg: a.angle_deg? },
        ReviewActionKind::Rescale => {
            let f = a.factor?;
            ReviewAction::Rescale { object, factor: (f[0] * f[1] * f[2]).cbrt() }
        }
        ReviewActionKind::Swap => ReviewAction::Swap { object, with: other? },
        ReviewActionKind::Rehost => ReviewAction::Rehost { object, host: other? },
        ReviewActionKind::Add => {
            let yaw = state.partial.find(&object)?.pose.yaw.to_degrees();
            ReviewAction::Add { like: object, at_m: a.position_m?, yaw_deg: a.angle_deg.unwrap_or(yaw) }
        }
        ReviewActionKind::Remove => ReviewAction::Remove { object },
        // Sets are made equal by the placement's group rules; here the member is brought to the median of its set.
        ReviewActionKind::EqualizeGroup => {
            let set = state.partial.find(&object)?.item.relations.matched_set.clone()?;
            let own = state.partial.find(&object)?.size().height;
            let mut heights: Vec<f64> = state
                .partial
                .placed
                .iter()
                .filter(|p| p.item.relations.matched_set.as_ref() == Some(&set))
                .map(|p| p.size().height)
                .collect();
            heights.sort_by(f64::total_cmp);
            let median = heights.get(heights.len() / 2)?;
            ReviewAction::Rescale { object, factor: median / own }
        }
    })
}
