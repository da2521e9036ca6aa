//! Phases 2 to 5: wall objects, furniture, ceiling objects, decorations. Paper Sec. 3.2, 3.3 and App. C.

use harmony_scene::Level;
use serde_json::json;

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::steps::{detect, inspect, place, prepare, review, surfaces, texture};

/// Runs one level: from the list of objects to reviewed placements.
///
/// # Errors
/// Fatal role errors and unwritable files only; an object that fails is dropped with a warning.
pub async fn run(ctx: &PhaseCtx<'_>, level: Level, mut state: SceneState) -> Result<SceneState, PhaseError> {
    ctx.step(&format!("looking for {} objects", level.stage()));
    let candidates = detect::candidates(ctx, level, &mut state).await?;
    let mut outcome = json!({ "candidates": candidates.len() });
    if !candidates.is_empty() {
        ctx.step(&format!("inspecting {} candidates", candidates.len()));
        let inspection = inspect::all(ctx, level, &state, &candidates).await?;
        ctx.step("completing and meshing");
        let prepared = prepare::all(ctx, level, &mut state, candidates, &inspection).await?;
        ctx.step(&format!("placing {} objects", prepared.len()));
        let report = place::in_order(ctx, level, &mut state, prepared, &inspection.order).await?;
        texture::level(ctx, &mut state, level).await?;
        if level == Level::Decoration {
            place::orient_decorations(ctx, &mut state).await?;
        }
        review::until_settled(ctx, level, &mut state).await?;
        texture::level(ctx, &mut state, level).await?;
        if !inspection.summary.is_empty() {
            state.summaries.push(inspection.summary);
        }
        outcome = json!({ "placed": report.objects.len(), "unresolved": report.unresolved.len() });
    }
    // On every level: walls that are not seen move with what stands at them.
    state.partial.room.openings = surfaces::openings(&state);
    if level == Level::Decoration {
        ctx.step("room surfaces");
        surfaces::all(ctx, &mut state).await?;
        texture::everything(ctx, &mut state).await?;
    }
    place::write_files(ctx, level, &state, &outcome)?;
    Ok(state)
}
