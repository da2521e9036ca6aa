//! Right hosts: a decoration that could stand on several things, or stands badly, is asked about with a crop of the photo and
//! of the scene, and put onto the piece that is named where the evidence allows. Paper App. C "Placement" (key `deco.host`).

use std::sync::Arc;

use harmony_imaging::sheet::{Cell, LabelledBox, contact_sheet, draw_boxes, palette};
use harmony_placement::{Placed, ReviewAction};
use harmony_prompts::{HostedObject, HostsQuestion};
use harmony_roles::Picture;
use harmony_scene::{Level, ObjectId, PixelBox, Support, WarningKind};
use image::{DynamicImage, RgbImage, RgbaImage};
use serde_json::json;

use super::review;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{SceneState, is_flat};
use crate::views;

/// Decorations on one question.
const PER_QUESTION: usize = 8;
/// Hosts that one decoration can be offered.
const MAX_HOSTS: usize = 5;
/// Outline agreement below which a place is doubted.
const POOR_IOU: f64 = 0.6;
/// Side of a picture on the sheet, pixels.
const CELL: u32 = 360;

/// Asks about the hosts of decorations that are in doubt.
///
/// # Errors
/// Fatal role errors and unwritable files only.
pub async fn verify(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    if !ctx.settings.asked_looks().hosts {
        return Ok(());
    }
    let doubted = doubted(state);
    let mut results = Vec::new();
    for (part, chunk) in doubted.chunks(PER_QUESTION).enumerate() {
        let name = if part == 0 { "hosts".to_owned() } else { format!("hosts_{}", part + 1) };
        if !ctx.is_looked_at(&name) {
            break;
        }
        ctx.step("verifying hosts");
        let (shown, rows) = (state.clone(), chunk.to_vec());
        let sheet = ctx.computed(move || sheet(&shown, &rows)).await?;
        let picture = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(sheet) };
        let question = HostsQuestion { objects: chunk.to_vec() };
        let answer = ctx.ask(&name, question.clone(), vec![picture]).await?;
        for found in &answer.objects {
            if let Some(complaint) = question.complaint(found) {
                ctx.warn(WarningKind::AnswerRepaired, None, complaint);
                continue;
            }
            let (Ok(object), Ok(host)) = (ObjectId::new(&found.id), ObjectId::new(&found.host)) else { continue };
            if state.partial.find(&object).is_none_or(|p| on(p) == Some(&host)) {
                continue;
            }
            let action = ReviewAction::Rehost { object: object.clone(), host };
            let (kept, reason) = review::try_on(ctx, state, action, &object, "Another host").await?;
            results.push(json!({ "asked": found, "kept": kept, "reason": reason }));
        }
    }
    if doubted.is_empty() { Ok(()) } else { ctx.write_json("hosts.json", &results) }
}

fn on(placed: &Placed) -> Option<&ObjectId> {
    match &placed.support {
        Support::Object { id } => Some(id),
        Support::Floor | Support::Ceiling | Support::Wall { .. } | Support::Block { .. } | Support::Niche { .. } => {
            None
        }
    }
}

/// Decorations whose host another one could be, or which do not agree with their masks.
fn doubted(state: &SceneState) -> Vec<HostedObject> {
    let placed = &state.partial.placed;
    let decorations = placed.iter().filter(|p| p.item.level == Level::Decoration && !is_flat(&p.item.label));
    decorations
        .filter_map(|p| {
            let near = p.item.mask.bounds()?.padded(1.0, state.partial.camera.size);
            let could = |q: &&Placed| {
                let carries = q.item.id != p.item.id && q.item.level != Level::Ceiling && !is_flat(&q.item.label);
                carries && q.item.mask.bounds().is_some_and(|b| b.intersection(&near).area() > 0.0)
            };
            let gap = |q: &Placed| q.pose.position.distance(p.pose.position);
            let mut hosts: Vec<&Placed> = placed.iter().filter(could).filter(|q| on(q) != Some(&p.item.id)).collect();
            hosts.sort_by(|a, b| gap(a).total_cmp(&gap(b)));
            let current = on(p).cloned();
            let mut candidates: Vec<ObjectId> = current.iter().cloned().collect();
            candidates.extend(hosts.iter().map(|q| q.item.id.clone()).filter(|id| Some(id) != current.as_ref()));
            candidates.truncate(MAX_HOSTS);
            let named = &p.item.relations.on_top_of;
            let label = |id: &ObjectId| state.partial.find(id).map(|q| q.item.label.as_str());
            let twins = current
                .as_ref()
                .is_some_and(|now| candidates.iter().any(|other| other != now && label(other) == label(now)));
            let poor = p.evidence.silhouette_iou.is_some_and(|iou| iou < POOR_IOU) && !p.item.traits.heavily_occluded;
            let elsewhere = named.is_some() && *named != current;
            (candidates.len() > 1 && (twins || poor || elsewhere || named.is_none())).then(|| HostedObject {
                id: p.item.id.clone(),
                about: p.item.label.clone(),
                current,
                candidates,
            })
        })
        .collect()
}

/// A row a decoration: the photo around it and its hosts, and the same window of the scene with ids.
fn sheet(state: &SceneState, rows: &[HostedObject]) -> RgbImage {
    let size = state.partial.camera.size;
    let mut pictures: Vec<(String, RgbaImage)> = Vec::new();
    for row in rows {
        let named: Vec<&ObjectId> = std::iter::once(&row.id).chain(&row.candidates).collect();
        let seen = named.iter().filter_map(|id| state.partial.find(id)?.item.mask.bounds());
        let own = state.partial.find(&row.id).and_then(|p| p.item.mask.bounds());
        let Some(own) = own else { continue };
        // As much of the hosts as is near.
        let near = own.padded(2.0, size);
        let window = seen.map(|b| b.intersection(&near)).filter(|b| b.area() > 0.0).fold(own, |all, b| PixelBox {
            x0: all.x0.min(b.x0),
            y0: all.y0.min(b.y0),
            x1: all.x1.max(b.x1),
            y1: all.y1.max(b.y1),
        });
        let window = window.padded(0.1, size);
        let boxed = |id: &ObjectId, k: usize| {
            let bounds = state.partial.find(id)?.item.mask.bounds()?;
            Some(LabelledBox { bounds, label: id.to_string(), color: palette(k) })
        };
        let item = boxed(&row.id, 0).into_iter().collect::<Vec<_>>();
        let photo = views::cut(&draw_boxes(&state.photo, &item), window);
        let scene = views::cut(&views::marked(state, |id| named.contains(&id)), window);
        for (what, picture) in [("photo", photo), ("scene", scene)] {
            pictures.push((format!("{} {what}", row.id), DynamicImage::ImageRgb8(picture).to_rgba8()));
        }
    }
    let cells: Vec<Cell<'_>> = pictures.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
    contact_sheet(&cells, 2, CELL)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::testing::{add, empty_room, said};

    #[test]
    fn what_could_stand_on_two_tables_of_one_kind_is_asked_about_and_nothing_else() {
        let mut state = empty_room();
        let table = DVec3::new(0.7, 0.5, 0.5);
        let near = add(&mut state, "table_01", Level::Furniture, table, DVec3::new(1.6, 0.0, 2.0), Support::Floor);
        let on = |id: &ObjectId| Support::Object { id: id.clone() };
        let small = DVec3::new(0.15, 0.3, 0.15);
        let at = DVec3::new(1.85, 0.5, 2.0);
        let vase = add(&mut state, "vase_01", Level::Decoration, small, at, on(&near));
        said(&mut state, &vase, |item| item.relations.on_top_of = Some(ObjectId::new("table_01").unwrap()));
        assert_eq!(doubted(&state), [], "there is no other table");
        let other = add(&mut state, "table_02", Level::Furniture, table, DVec3::new(2.35, 0.0, 2.0), Support::Floor);
        let asked = doubted(&state);
        assert_eq!(asked.len(), 1);
        assert_eq!((&asked[0].id, &asked[0].current), (&vase, &Some(near.clone())));
        assert_eq!(asked[0].candidates, [near, other]);
        let sheet = sheet(&state, &asked);
        assert!(sheet.width() >= 2 * CELL && sheet.height() >= CELL);
    }
}
