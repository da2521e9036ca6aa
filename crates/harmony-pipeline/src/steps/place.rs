//! Placement of a level: items for the placement crate, and its report.

use std::sync::Arc;

use harmony_catalogue::Trait;
use harmony_placement::{Item, LevelReport, Traits, YawHint, place_level};
use harmony_prompts::Occlusion;
use harmony_scene::{
    Level, ObjectId, OpeningKind, Placement, Relations, Support, WallAffinity, WarningKind,
};
use serde_json::{Value, json};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Left, Object, SceneState, is_flat};
use crate::views;

/// Places the modelled objects of a level.
///
/// # Errors
/// None of its own; the type is that of the steps.
pub async fn in_order(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &mut SceneState,
    objects: Vec<ObjectId>,
    order: &[ObjectId],
) -> Result<LevelReport, PhaseError> {
    let items: Vec<Item> =
        objects.iter().filter_map(|id| state.objects.get(id)).filter_map(|object| item(level, state, object)).collect();
    let mut partial = state.partial.clone();
    let settings = ctx.settings.placement.clone();
    let order = order.to_vec();
    let (partial, report) = tokio::task::spawn_blocking(move || {
        let report = place_level(&mut partial, items, Some(&order), &settings);
        (partial, report)
    })
    .await
    .map_err(|e| PhaseError::internal(ctx.phase, &e))?;
    state.take(partial);
    for warning in &report.warnings {
        ctx.warn(warning.kind, warning.object.clone(), warning.message.clone());
    }
    for (id, error) in &report.dropped {
        ctx.warn(WarningKind::ObjectDropped, Some(id.clone()), error.to_string());
        state.left.push(Left { name: id.to_string(), phase: ctx.phase, reason: error.clone().into() });
    }
    for u in &report.unresolved {
        ctx.warn(
            WarningKind::LowConfidence,
            Some(u.a.clone()),
            format!("stays {:.0} mm inside {}", u.penetration * 1000.0, u.b),
        );
    }
    Ok(report)
}

/// What placement needs to know about a modelled object.
fn item(level: Level, state: &SceneState, object: &Object) -> Option<Item> {
    let (o, model) = (&object.said, object.model.as_ref()?);
    let label = o.kind.clone();
    let is = |wanted: Trait| harmony_catalogue::has(&label, wanted);
    let opening = harmony_catalogue::opening(&label).filter(|_| level == Level::Wall);
    let known = |id: &Option<String>| id.as_deref().and_then(|id| ObjectId::new(id).ok());
    let wall_affinity = match (level, o.wall) {
        (Level::Wall, Some(wall)) => WallAffinity::from(wall),
        _ => o.wall_affinity,
    };
    let on_top_of = known(&o.on_top_of).or_else(|| object.host_hint.clone());
    let relations = Relations {
        wall_affinity,
        on_top_of: (level == Level::Decoration || o.on_top_of.is_some()).then_some(on_top_of).flatten(),
        in_front_of: known(&o.in_front_of),
        behind: known(&o.behind),
        facing_toward: known(&o.facing_toward),
        group: o.group.clone(),
        matched_set: o.matched_set.clone(),
    };
    let has_front = harmony_catalogue::has_front(&label) || o.faces_room;
    let yaw = match o.front_deg {
        Some(deg) => YawHint::About(deg.to_radians()),
        None => YawHint::Unknown,
    };
    let mean = harmony_imaging::color::median_color(&state.photo, &object.mask)
        .map(harmony_imaging::color::linear_from_rgb8);
    let hosts = if level == Level::Decoration {
        state
            .partial
            .placed
            .iter()
            .filter(|q| q.item.level != Level::Ceiling && !is_flat(&q.item.label))
            .map(|q| q.item.id.clone())
            .collect()
    } else {
        Vec::new()
    };
    Some(Item {
        id: object.id.clone(),
        index: object.index,
        level,
        shape: Arc::clone(&model.shape),
        size: object.size(),
        mask: Arc::clone(&object.mask),
        relations,
        placement: Placement {
            placement_type: o.placement_type,
            surface_position: o.surface_position,
            depth_position: o.depth_position,
            faces_room: o.faces_room,
        },
        host_candidates: hosts,
        traits: Traits {
            flat: is(Trait::Flat),
            soft: is(Trait::Soft),
            // A generated mesh has its own proportions; a slab of ours may be given others.
            planar: is(Trait::Planar) && object.is_modelled(),
            opening: opening.is_some(),
            to_floor: opening == Some(OpeningKind::Door),
            hangs: level == Level::Ceiling || is(Trait::Hangs),
            may_stretch: object.is_modelled(),
            as_wide_as_deep: !is(Trait::Planar) && (o.size_m.width / o.size_m.depth - 1.0).abs() < 0.02,
            heavily_occluded: o.occlusion == Occlusion::Heavily,
            size_doubted: object.size_doubted,
            has_front,
        },
        yaw,
        mean_color: mean,
        detection: object.detection.score,
        label,
    })
}

/// Writes `placements.json` and the level's renders.
///
/// # Errors
/// Unwritable files.
pub async fn write_files(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &SceneState,
    outcome: &Value,
) -> Result<(), PhaseError> {
    let rows: Vec<Value> = state
        .partial
        .placed
        .iter()
        .filter(|p| p.item.level == level)
        .map(|p| {
            json!({
                "id": p.item.id, "label": p.item.label, "pose": p.pose, "size": p.size(), "support": support(&p.support),
                "evidence": p.evidence, "confidence": p.confidence(), "relations": p.item.relations,
            })
        })
        .collect();
    ctx.write_json("placements.json", &json!({ "outcome": outcome, "objects": rows }))?;
    let shown = state.clone();
    let (flat, blend) = ctx
        .computed(move || {
            let drawn = views::drawn(&shown);
            let blend = views::blend(&shown, &drawn);
            (drawn.flat, blend)
        })
        .await?;
    ctx.write_picture("render_flat.png", &flat)?;
    ctx.write_picture("render_blend.png", &blend)
}

fn support(s: &Support) -> Value {
    json!(s)
}
