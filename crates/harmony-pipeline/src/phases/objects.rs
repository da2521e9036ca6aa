//! Phases 2 to 5: wall objects, furniture, ceiling objects, decorations. Paper Sec. 3.2, 3.3 and App. C.
//!
//! A level has two halves. [`prepare`] looks for its objects and makes them ready; [`place`] puts them into the scene,
//! in the paper's order. `graph.rs` says which half waits for what.

use std::sync::Arc;

use harmony_scene::{Level, Mask};
use image::RgbImage;
use serde_json::json;

use crate::before::{Before, Known};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Prepared, SceneState};
use crate::steps::inspect::Inspection;
use crate::steps::{detect, inspect, place, prepare, programs, review, second_look, shading, surfaces, texture};

/// A level that can be placed.
#[derive(Debug, Default)]
pub struct PreparedLevel {
    /// Candidates there were.
    candidates: usize,
    /// Objects, in order of their ids.
    ready: Vec<Prepared>,
    /// Left out: label or id, and reason, in the order in which it was found out.
    dropped: Vec<(String, String)>,
    /// Labels and pixels of what was found and is not made ready.
    rejected: Vec<(String, Arc<Mask>)>,
    /// What was said about the level.
    inspection: Inspection,
}

/// A level whose objects are named and inspected: what [`prepare`] goes on from, and what later levels may know of it.
pub struct Inspected {
    candidates: Vec<crate::state::Candidate>,
    dropped: Vec<(String, String)>,
    rejected: Vec<(String, Arc<Mask>)>,
    inspection: Inspection,
}

impl Inspected {
    /// The kept objects.
    pub fn known(&self, level: Level) -> Known {
        let kept = self.candidates.iter().filter_map(|candidate| {
            let object = self.inspection.objects.get(&candidate.id).filter(|o| o.keep)?;
            Some((candidate.clone(), object.clone()))
        });
        let mut objects: Vec<_> = kept.collect();
        objects.sort_by(|a, b| a.0.id.cmp(&b.0.id));
        Known { level, objects }
    }
}

/// Names and inspects what was found.
///
/// # Errors
/// Fatal role errors and unwritable files only.
pub async fn inspect(
    ctx: &PhaseCtx<'_>,
    level: Level,
    found: detect::Found,
    before: &Before,
) -> Result<Inspected, PhaseError> {
    let dropped = found.dropped.iter().map(|d| (d.label.clone(), d.reason.clone())).collect();
    let rejected = found.rejected.clone();
    let candidates = detect::name(ctx, level, found, before)?;
    let mut inspection = Inspection::default();
    if !candidates.is_empty() {
        ctx.step(&format!("inspecting {} candidates", candidates.len()));
        inspection = inspect::all(ctx, level, before, &candidates).await?;
    }
    Ok(Inspected { candidates, dropped, rejected, inspection })
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
    let Inspected { candidates, mut dropped, mut rejected, inspection } = inspected;
    let count = candidates.len();
    let masks: Vec<_> = candidates.iter().map(|c| (c.id.clone(), c.detection.label.clone(), c.mask.clone())).collect();
    let mut ready = Vec::new();
    if count > 0 {
        ctx.step("completing and meshing");
        let objects = prepare::all(ctx, level, state, candidates, &inspection).await?;
        dropped.extend(objects.dropped.into_iter().map(|(id, reason)| (id.to_string(), reason)));
        ready = objects.ready;
        let left_out = masks.into_iter().filter(|(id, _, _)| ready.iter().all(|r| r.candidate.id != *id));
        rejected.extend(left_out.map(|(_, label, mask)| (label, Arc::new(mask))));
    }
    Ok(PreparedLevel { candidates: count, ready, dropped, rejected, inspection })
}

/// Places a prepared level and reviews it. `bare` is the picture of the empty room that an image editor drew, for the
/// last level.
///
/// # Errors
/// Fatal role errors and unwritable files only; an object that cannot be placed is dropped with a warning.
pub async fn place(
    ctx: &PhaseCtx<'_>,
    level: Level,
    mut state: SceneState,
    prepared: PreparedLevel,
    bare: Option<Arc<RgbImage>>,
) -> Result<SceneState, PhaseError> {
    let mut outcome = json!({ "candidates": prepared.candidates });
    for (label, reason) in prepared.dropped {
        state.dropped.push((label, ctx.phase.to_owned(), reason));
    }
    state.rejected.extend(prepared.rejected);
    if prepared.candidates > 0 {
        let mut ids = Vec::new();
        for mut object in prepared.ready {
            object.index = state.next_index;
            state.next_index += 1;
            ids.push(object.candidate.id.clone());
            state.prepared.insert(object.candidate.id.clone(), object);
        }
        ctx.step(&format!("placing {} objects", ids.len()));
        let report = place::in_order(ctx, level, &mut state, ids.clone(), &prepared.inspection.order).await?;
        programs::refit(ctx, &mut state, &ids).await?;
        texture::level(ctx, &mut state, level).await?;
        if level == Level::Decoration {
            place::orient_decorations(ctx, &mut state).await?;
        }
        review::until_settled(ctx, level, &mut state).await?;
        second_look::until_settled(ctx, level, &mut state).await?;
        texture::level(ctx, &mut state, level).await?;
        if !prepared.inspection.summary.is_empty() {
            state.summaries.push(prepared.inspection.summary);
        }
        outcome = json!({ "placed": report.objects.len(), "unresolved": report.unresolved.len() });
    }
    // On every level: walls that are not seen move with what stands at them.
    state.partial.room.openings = surfaces::openings(&state);
    if level == Level::Decoration {
        let placed: Vec<_> = state.partial.placed.iter().map(|p| p.item.id.clone()).collect();
        programs::refit(ctx, &mut state, &placed).await?;
        ctx.step("room surfaces");
        surfaces::all(ctx, &mut state, bare).await?;
        texture::everything(ctx, &mut state).await?;
        shading::everything(ctx, &mut state).await?;
    }
    place::write_files(ctx, level, &state, &outcome).await?;
    Ok(state)
}
