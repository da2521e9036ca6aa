//! Phases 2 to 5: wall objects, furniture, ceiling objects, decorations. Paper Sec. 3.2, 3.3 and App. C.
//!
//! A level has two halves. [`prepare`] looks for its objects and makes them ready; [`place`] puts them into the scene,
//! in the paper's order. `graph.rs` says which half waits for what.

use std::sync::Arc;

use futures::future::join;
use harmony_scene::{Level, Mask, ObjectId};
use serde_json::json;

use crate::before::{Before, Known};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::looks::{LookKind, SceneBefore, missing_came};
use crate::state::{DropReason, Left, Object, SceneState};
use crate::steps::features::Feature;
use crate::steps::inspect::Inspection;
use crate::steps::{
    counts, detect, doubt, features, form, groups, hosts, inspect, place, prepare, programs, relief, review,
    second_look, shading, surfaces, texture, turns,
};

/// A level that can be placed.
#[derive(Debug, Default)]
pub struct PreparedLevel {
    /// Candidates there were.
    candidates: usize,
    /// Objects, in order of their ids.
    ready: Vec<Object>,
    /// Left out, in the order in which it was found out.
    left: Vec<Left>,
    /// Labels and pixels of what was found and is not made ready.
    rejected: Vec<(String, Arc<Mask>)>,
    /// What is built into the room.
    features: Vec<Feature>,
    /// Placement order as reasoned.
    order: Vec<ObjectId>,
    /// The level in words.
    summary: String,
}

/// A level whose objects are named and inspected: what [`prepare`] goes on from, and what later levels may know of it.
pub struct Inspected {
    candidates: usize,
    left: Vec<Left>,
    rejected: Vec<(String, Arc<Mask>)>,
    inspection: Inspection,
}

impl Inspected {
    /// The kept objects.
    pub fn known(&self, level: Level) -> Known {
        let mut objects = self.inspection.objects.clone();
        objects.sort_by(|a, b| a.id.cmp(&b.id));
        Known { level, objects }
    }
}

/// Names what was found, and inspects what no earlier level has.
///
/// # Errors
/// Fatal role errors and unwritable files only.
pub async fn inspect(
    ctx: &PhaseCtx<'_>,
    level: Level,
    found: detect::Found,
    before: &Before,
) -> Result<Inspected, PhaseError> {
    let dropped = found.dropped.clone();
    let filtered = dropped.iter();
    let mut left: Vec<Left> =
        filtered.map(|d| Left { name: d.label.clone(), phase: ctx.phase, reason: d.reason.clone().into() }).collect();
    let mut rejected = found.rejected.clone();
    let named = detect::name(level, found, before);
    let mut wanted = Vec::new();
    for candidate in named.iter().cloned() {
        match before.same_as(&candidate, ctx.settings.filters.mask_iou) {
            None => wanted.push(candidate),
            Some(known) => {
                let reason = DropReason::Known(known.clone());
                left.push(Left { name: candidate.id.to_string(), phase: ctx.phase, reason });
                rejected.push((candidate.detection.label, candidate.mask));
            }
        }
    }
    let candidates = wanted.len();
    let mut inspection = Inspection::default();
    if candidates > 0 {
        ctx.step(&format!("inspecting {candidates} candidates"));
        inspection = inspect::all(ctx, level, before, wanted).await?;
    }
    detect::write_files(ctx, &named, &dropped, &inspection.objects)?;
    Ok(Inspected { candidates, left, rejected, inspection })
}

/// Completes and meshes the kept objects.
///
/// # Errors
/// Fatal role errors and unwritable files only; an object that fails is dropped with a warning.
pub async fn prepare(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &Arc<SceneState>,
    inspected: Inspected,
) -> Result<PreparedLevel, PhaseError> {
    let Inspected { candidates, mut left, mut rejected, inspection } = inspected;
    let Inspection { objects, left: refused, rejected: unwanted, order, summary } = inspection;
    left.extend(refused);
    rejected.extend(unwanted);
    let (mut ready, mut features) = (Vec::new(), Vec::new());
    if candidates > 0 {
        ctx.step("completing and meshing");
        let (outcomes, built) = prepare::all(ctx, level, state, objects).await?;
        features = built;
        for outcome in outcomes {
            match outcome {
                Ok(object) => ready.push(object),
                Err((object, reason)) => {
                    left.push(Left { name: object.id.to_string(), phase: ctx.phase, reason });
                    rejected.push((object.detection.label, object.mask));
                }
            }
        }
    }
    Ok(PreparedLevel { candidates, ready, left, rejected, features, order, summary })
}

/// Places a prepared level and reviews it.
///
/// # Errors
/// Fatal role errors and unwritable files only; an object that cannot be placed is dropped with a warning.
pub async fn place(
    ctx: &PhaseCtx<'_>,
    level: Level,
    mut state: SceneState,
    prepared: PreparedLevel,
) -> Result<SceneState, PhaseError> {
    let mut outcome = json!({ "candidates": prepared.candidates });
    let mut counted = None;
    state.left.extend(prepared.left);
    state.rejected.extend(prepared.rejected);
    state.features.extend(prepared.features);
    if prepared.candidates > 0 {
        let mut ids = Vec::new();
        for mut object in prepared.ready {
            object.index = state.next_index;
            state.next_index += 1;
            ids.push(object.id.clone());
            state.objects.insert(object.id.clone(), object);
        }
        ctx.step(&format!("placing {} objects", ids.len()));
        let report =
            place::in_order(ctx, level, &mut state, ids.clone(), &prepared.order, &ctx.settings.placement).await?;
        doubt::leave_as_paint(ctx, &mut state, &ids);
        programs::refit(ctx, &mut state, &ids).await?;
        texture::bare(ctx, &mut state).await?;
        if level == Level::Decoration {
            let before = SceneBefore::of(&state);
            hosts::verify(ctx, &mut state).await?;
            let before = before.came(ctx, LookKind::Hosts, &mut state);
            turns::quarters(ctx, &mut state).await?;
            before.came(ctx, LookKind::Quarters, &mut state);
        }
        let before = SceneBefore::of(&state);
        turns::fine(ctx, level, &mut state).await?;
        let before = before.came(ctx, LookKind::Turns, &mut state);
        groups::order(ctx, level, &mut state).await?;
        let before = before.came(ctx, LookKind::Groups, &mut state);
        texture::bare(ctx, &mut state).await?;
        let is_last = level == Level::Decoration;
        let question = if is_last { counts::question(ctx, &state).await? } else { None };
        let looks = async {
            review::until_settled(ctx, level, &mut state).await?;
            let before = before.came(ctx, LookKind::Review, &mut state);
            second_look::until_settled(ctx, level, &mut state).await?;
            before.came(ctx, LookKind::SecondLook, &mut state);
            Ok::<_, PhaseError>(())
        };
        // Kinds are counted while places and shapes are looked at: neither waits for the other.
        let (asked, looked) = join(counts::ask(ctx, question), Box::pin(looks)).await;
        looked?;
        if is_last {
            counted = Some(asked?);
        }
        texture::bare(ctx, &mut state).await?;
        if !prepared.summary.is_empty() {
            state.summaries.push(prepared.summary);
        }
        let placed = ids.iter().filter(|id| state.partial.find(id).is_some()).count();
        outcome = json!({ "placed": placed, "unresolved": report.unresolved.len() });
    }
    if level == Level::Decoration {
        missing_came(ctx, &mut state);
        let before = SceneBefore::of(&state);
        let counted = match counted {
            Some(counted) => counted,
            None => counts::ask(ctx, counts::question(ctx, &state).await?).await?,
        };
        counts::settle(ctx, &mut state, counted).await?;
        before.came(ctx, LookKind::Counts, &mut state);
        relief::stand(ctx, &mut state).await?;
    }
    // On every level: walls that are not seen move with what stands at them, and with what looks have moved or lengthened.
    state.partial.fit_loose_walls();
    surfaces::open_walls(&mut state);
    if level == Level::Decoration {
        let placed: Vec<_> = state.partial.placed.iter().map(|p| p.item.id.clone()).collect();
        programs::refit(ctx, &mut state, &placed).await?;
        form::follow_depth(ctx, &mut state).await?;
        form::lie_on_hosts(ctx, &mut state, None).await?;
        features::refit(ctx, &mut state).await?;
        ctx.step("room surfaces");
        surfaces::all(ctx, &mut state).await?;
        texture::everything(ctx, &mut state).await?;
        shading::everything(ctx, &mut state).await?;
    }
    place::write_files(ctx, level, &state, &outcome).await?;
    Ok(state)
}
