//! Orientation by comparison: four yaws of an object on a sheet (paper App. C, "Orientation correction"; key `deco.orient`), then
//! up to three fine steps, each half of the one before. Every turn is tried and measured; one that mask and depths contradict
//! is refused.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_imaging::sheet::{Cell, contact_sheet};
use harmony_placement::{Placed, ReviewAction};
use harmony_prompts::{FrontPanel, NamedObject, OrientQuestion, TurnPanel, TurnedObject, TurnsQuestion};
use harmony_roles::Picture;
use harmony_scene::{Level, ObjectId, Support};
use image::{RgbImage, RgbaImage};
use serde_json::json;

use super::review;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// Steps of the fine turns, degrees.
const STEPS_DEG: [f64; 3] = [30.0, 15.0, 7.5];
/// Objects on one question.
const PER_QUESTION: usize = 8;
/// Share of the photo that an object must have for its turn to be seen.
const SEEN_SHARE: f64 = 0.0008;
/// Side of a picture on the sheet, pixels.
const CELL: u32 = 240;

/// Quarter turns of a level's decorations.
///
/// # Errors
/// Fatal role errors only.
pub async fn quarters(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    if !ctx.is_looked_at("orient") {
        return Ok(());
    }
    let turning = to_turn(state, ctx.settings.asked_looks().turns);
    if turning.is_empty() {
        return Ok(());
    }
    let panels: Vec<(String, f64)> = FrontPanel::ALL.iter().map(|panel| (format!("{panel:?}"), panel.yaw())).collect();
    let turning: Vec<ObjectId> = turning.into_iter().map(|i| state.partial.placed[i].item.id.clone()).collect();
    let mut said: BTreeMap<String, FrontPanel> = BTreeMap::new();
    for (part, chunk) in turning.chunks(PER_QUESTION).enumerate() {
        let rows: Vec<usize> = chunk.iter().filter_map(|id| state.partial.position(id)).collect();
        let (shown, panels) = (state.clone(), panels.clone());
        let (sheet, objects) = ctx.computed(move || sheet(&shown, &rows, &panels)).await?;
        let objects = objects.into_iter().map(|o| NamedObject { id: o.id.to_string(), about: o.about }).collect();
        let sheet = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(sheet) };
        let answer = ctx.ask(&part_name("orient", part), OrientQuestion { objects }, vec![sheet]).await?;
        // The first that was said of an object holds: older recordings speak of those of later parts, too.
        for object in answer.objects {
            said.entry(object.id).or_insert(object.front_panel);
        }
        for object in chunk {
            let Some(panel) = said.get(object.as_str()).filter(|panel| **panel != FrontPanel::A) else { continue };
            turn(ctx, state, object, panel.yaw().to_degrees(), &format!("A turn to panel {panel:?}")).await?;
        }
    }
    Ok(())
}

/// Name of a part of a question that is too long for one.
fn part_name(name: &str, part: usize) -> String {
    if part == 0 { name.to_owned() } else { format!("{name}_part_{}", part + 1) }
}

/// Fine turns of a level's objects.
///
/// # Errors
/// Fatal role errors and unwritable files only.
pub async fn fine(ctx: &PhaseCtx<'_>, level: Level, state: &mut SceneState) -> Result<(), PhaseError> {
    if !ctx.settings.asked_looks().turns {
        return Ok(());
    }
    let free = |p: &Placed| {
        let held = matches!(p.support, Support::Wall { .. }) || p.item.traits.flat;
        p.item.level == level && !held && is_seen(state, p)
    };
    let mut turning: Vec<ObjectId> =
        state.partial.placed.iter().filter(|p| free(p)).map(|p| p.item.id.clone()).collect();
    let mut results = Vec::new();
    for (pass, step_deg) in STEPS_DEG.into_iter().enumerate() {
        let name = format!("turn_{}", pass + 1);
        if turning.is_empty() || !ctx.is_looked_at(&name) {
            break;
        }
        ctx.step(&format!("fine turns {}", pass + 1));
        let step = step_deg.to_radians();
        let panels: Vec<(String, f64)> =
            TurnPanel::ALL.iter().map(|panel| (format!("{panel:?}"), panel.steps() * step)).collect();
        let mut moved = Vec::new();
        for (part, chunk) in turning.chunks(PER_QUESTION).enumerate() {
            let name = part_name(&name, part);
            let rows: Vec<usize> = chunk.iter().filter_map(|id| state.partial.position(id)).collect();
            let (shown, panels) = (state.clone(), panels.clone());
            let (sheet, objects) = ctx.computed(move || sheet(&shown, &rows, &panels)).await?;
            let sheet = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(sheet) };
            let answer = ctx.ask(&name, TurnsQuestion { objects, step_deg }, vec![sheet]).await?;
            for found in answer.objects.iter().filter(|o| o.panel != TurnPanel::A) {
                let Some(object) = chunk.iter().find(|id| id.as_str() == found.id) else { continue };
                let by_deg = found.panel.steps() * step_deg;
                let kept = turn(ctx, state, object, by_deg, &format!("A turn by {by_deg:.1} degrees")).await?;
                results.push(json!({ "id": object, "by_deg": by_deg, "kept": kept }));
                if kept {
                    moved.push(object.clone());
                }
            }
        }
        // A smaller step is asked for what a larger one has helped, and once for all.
        if pass > 0 {
            turning = moved;
        }
    }
    if results.is_empty() { Ok(()) } else { ctx.write_json("turns.json", &results) }
}

/// Decorations with a front of which the photo shows enough to tell it; soft ones only where they are asked about too.
fn to_turn(state: &SceneState, soft_too: bool) -> Vec<usize> {
    let asked = |p: &Placed| {
        let firm = soft_too || !p.item.traits.soft;
        p.item.level == Level::Decoration && p.item.traits.has_front && firm && is_seen(state, p)
    };
    (0..state.partial.placed.len()).filter(|i| asked(&state.partial.placed[*i])).collect()
}

/// Whether the photo shows enough of an object to tell its turn.
fn is_seen(state: &SceneState, p: &Placed) -> bool {
    p.item.mask.count() as f64 >= SEEN_SHARE * state.partial.camera.size.pixels() as f64
}

/// Tries a turn; tells whether it stays.
async fn turn(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    object: &ObjectId,
    by_deg: f64,
    name: &str,
) -> Result<bool, PhaseError> {
    let action = ReviewAction::Rotate { object: object.clone(), by_deg };
    Ok(review::try_on(ctx, state, action, object, name).await?.0)
}

/// A row an object: the photo around it and renders of the scene with it turned; and the objects shown.
fn sheet(state: &SceneState, turning: &[usize], panels: &[(String, f64)]) -> (RgbImage, Vec<TurnedObject>) {
    let mut pictures: Vec<(String, RgbaImage)> = Vec::new();
    let mut shown = Vec::new();
    for i in turning {
        let item = &state.partial.placed[*i].item;
        let Some(window) = views::window_around(state, *i) else { continue };
        pictures.push((format!("{} photo", item.id), views::photo_window(state, window)));
        for (letter, turn) in panels {
            pictures.push((format!("{} {letter}", item.id), views::turned(state, *i, *turn, window)));
        }
        let yaw_deg = state.partial.placed[*i].pose.yaw.to_degrees();
        shown.push(TurnedObject { id: item.id.clone(), about: item.label.clone(), yaw_deg });
    }
    let cells: Vec<Cell<'_>> = pictures.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
    (contact_sheet(&cells, 1 + panels.len() as u32, CELL), shown)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::testing::{add, empty_room, said};

    #[test]
    fn what_is_hardly_seen_is_not_asked_about_and_soft_things_only_when_they_are_wanted() {
        let mut state = empty_room();
        let floor = || Support::Floor;
        for (name, size, x) in [("clock_01", 0.4, 1.0), ("remote_01", 0.04, 2.0), ("pillow_01", 0.4, 3.0)] {
            let at = DVec3::new(x, 0.0, 1.5);
            let id = add(&mut state, name, Level::Decoration, DVec3::splat(size), at, floor());
            said(&mut state, &id, |item| {
                item.traits.has_front = true;
                item.traits.soft = name == "pillow_01";
            });
        }
        assert!(state.partial.placed[1].item.mask.count() > 0, "a little of it is seen");
        assert_eq!(to_turn(&state, false), [0]);
        assert_eq!(to_turn(&state, true), [0, 2]);
    }
}
