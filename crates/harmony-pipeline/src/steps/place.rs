//! Placement of a level: items for the placement crate, and its report.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_catalogue::Trait;
use harmony_placement::{
    Collision, Item, LevelReport, PartialScene, PlacementSettings, Traits, YawHint, energy_change, place_level,
};
use harmony_prompts::{Occlusion, ReorderAnswer, ReorderQuestion, WallReach};
use harmony_roles::Picture;
use harmony_scene::{Level, ObjectId, OpeningKind, Placement, Relations, Support, WallAffinity, WarningKind};
use serde_json::{Value, json};

use super::inspect::is_unusual;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::looks::{LookKind, SceneBefore};
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
    settings: &PlacementSettings,
) -> Result<LevelReport, PhaseError> {
    let items: Vec<Item> =
        objects.iter().filter_map(|id| state.objects.get(id)).filter_map(|object| item(level, state, object)).collect();
    let (partial, mut report) = placed(ctx, &state.partial, items.clone(), order, settings).await?;
    let mut other = None;
    let persists = !report.unresolved.is_empty();
    if persists {
        other = in_another_order(ctx, level, state, (&partial, &report), items, settings).await?;
    }
    state.take(partial);
    if persists {
        let before = SceneBefore::of(state);
        if let Some(other) = other {
            state.take(other.scene);
            state.objects.extend(other.said.into_iter().map(|object| (object.id.clone(), object)));
            report = other.report;
        }
        before.came(ctx, LookKind::Reorder, state);
    }
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

async fn placed(
    ctx: &PhaseCtx<'_>,
    before: &PartialScene,
    items: Vec<Item>,
    order: &[ObjectId],
    settings: &PlacementSettings,
) -> Result<(PartialScene, LevelReport), PhaseError> {
    let (mut partial, settings, order) = (before.clone(), settings.clone(), order.to_vec());
    ctx.computed(move || {
        let report = place_level(&mut partial, items, Some(&order), &settings);
        (partial, report)
    })
    .await
}

/// A level placed otherwise.
struct Otherwise {
    scene: PartialScene,
    report: LevelReport,
    /// The level's objects with what was said of them now, where that is another host or size.
    said: Vec<Object>,
}

/// When a collision persists the model revises the placement order (paper Sec. 3.3), hosts and sizes, and the level is placed
/// again from the scene before it; `None` when that is no better.
async fn in_another_order(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &SceneState,
    (partial, report): (&PartialScene, &LevelReport),
    items: Vec<Item>,
    settings: &PlacementSettings,
) -> Result<Option<Otherwise>, PhaseError> {
    if !ctx.settings.asked_looks().reorder || !ctx.is_looked_at("reorder") {
        return Ok(None);
    }
    let mut shown = state.clone();
    shown.take(partial.clone());
    let collision = |c: &Collision| format!("- {} and {}: {:.0} mm", c.a, c.b, c.penetration * 1000.0);
    let question = ReorderQuestion {
        level,
        room: views::room_summary(&shown),
        placed: partial.placed.iter().map(views::placed_object).chain(views::ledges(&shown)).collect(),
        order: report.objects.iter().map(|o| o.id.clone()).collect(),
        collisions: report.unresolved.iter().map(collision).collect(),
    };
    let picture = ctx.computed(move || views::marked(&shown, |_| true)).await?;
    let pictures = vec![
        Picture { caption: "IMAGE 1: the photo".into(), image: state.photo.clone() },
        Picture { caption: "IMAGE 2: the reconstruction".into(), image: Arc::new(picture) },
    ];
    let answer = ctx.ask("reorder", question.clone(), pictures).await?;
    if answer.is_empty() {
        return Ok(None);
    }
    let order: Vec<ObjectId> = match answer.placement_order.as_slice() {
        [] => question.order.clone(),
        ids => ids.iter().filter_map(|id| ObjectId::new(id).ok()).collect(),
    };
    let (said, complaints) = said_otherwise(state, &question, &answer);
    for complaint in complaints {
        ctx.warn(WarningKind::AnswerRepaired, None, complaint);
    }
    let items = items
        .into_iter()
        .map(|old| {
            let new = said.iter().find(|o| o.id == old.id).and_then(|object| item(level, state, object));
            new.unwrap_or(old)
        })
        .collect();
    let (other, again) = placed(ctx, &state.partial, items, &order, settings).await?;
    let change = energy_change(partial, &other, settings);
    let fewer = again.unresolved.len() <= report.unresolved.len();
    let kept = change < 0.0 && fewer && again.dropped.len() <= report.dropped.len();
    ctx.write_json(
        &ctx.record("reorder.json"),
        &json!({
            "asked": answer, "kept": kept, "energy_change": change,
            "collisions_before": report.unresolved.len(), "collisions_after": again.unresolved.len(),
        }),
    )?;
    Ok(kept.then_some(Otherwise { scene: other, report: again, said }))
}

/// The objects to which an answer gives another host or size; and what is wrong with those that it cannot give one.
fn said_otherwise(
    state: &SceneState,
    question: &ReorderQuestion,
    answer: &ReorderAnswer,
) -> (Vec<Object>, Vec<String>) {
    let (mut said, mut complaints) = (BTreeMap::<ObjectId, Object>::new(), Vec::new());
    let mut change = |id: &str, complaint: Option<String>, change: &dyn Fn(&mut Object)| {
        let object = ObjectId::new(id).ok().and_then(|id| state.objects.get(&id));
        match (complaint, object) {
            (Some(complaint), _) => complaints.push(complaint),
            (None, Some(object)) => change(said.entry(object.id.clone()).or_insert_with(|| object.clone())),
            (None, None) => {}
        }
    };
    for host in &answer.hosts {
        change(&host.id, question.host_complaint(host), &|object| {
            object.said.on_top_of.clone_from(&host.on_top_of);
            object.host_hint = None;
        });
    }
    for size in &answer.sizes {
        change(&size.id, question.size_complaint(size), &|object| object.said.size_m = size.size_m);
    }
    (said.into_values().collect(), complaints)
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
        joined_row: o.joined_row.clone(),
    };
    let has_front = harmony_catalogue::has_front(&label) || o.faces_room;
    let yaw = match o.front_deg {
        Some(deg) => YawHint::About(deg.to_radians()),
        None => YawHint::Unknown,
    };
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
            drapes: is(Trait::Drapes),
            // A generated mesh has its own proportions; a slab of ours may be given others.
            planar: is(Trait::Planar) && object.is_modelled(),
            opening: opening.is_some(),
            to_floor: opening == Some(OpeningKind::Door) || o.reaches.contains(&WallReach::Floor),
            to_ceiling: o.reaches.contains(&WallReach::Ceiling),
            lit_from_above: is(Trait::LitFromAbove),
            hangs: level == Level::Ceiling || is(Trait::Hangs),
            may_stretch: object.is_modelled(),
            as_wide_as_deep: !is(Trait::Planar) && (o.size_m.width / o.size_m.depth - 1.0).abs() < 0.02,
            heavily_occluded: o.occlusion == Occlusion::Heavily,
            size_doubted: is_unusual(object),
            corrected: false,
            has_front,
        },
        yaw,
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

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_prompts::{InspectedSize, ReorderHost, ReorderSize};

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn sills_mantels_and_radiators_can_be_hosts_and_rugs_and_pendants_cannot() {
        let mut state = empty_room();
        let things = [
            ("window_01", Level::Wall),
            ("fireplace_mantel_01", Level::Wall),
            ("radiator_01", Level::Wall),
            ("rug_01", Level::Furniture),
            ("sideboard_01", Level::Furniture),
            ("pendant_01", Level::Ceiling),
            ("vase_01", Level::Decoration),
        ];
        for (k, (name, level)) in things.into_iter().enumerate() {
            let at = DVec3::new(0.3 + 0.5 * k as f64, 0.0, 1.0);
            add(&mut state, name, level, DVec3::splat(0.3), at, Support::Floor);
        }
        state.partial.placed.pop();
        let of = |name: &str, level| item(level, &state, &state.objects[&ObjectId::new(name).unwrap()]).unwrap();
        let hosts: Vec<String> =
            of("vase_01", Level::Decoration).host_candidates.iter().map(ToString::to_string).collect();
        assert_eq!(hosts, ["window_01", "fireplace_mantel_01", "radiator_01", "sideboard_01"]);
        assert!(of("sideboard_01", Level::Furniture).host_candidates.is_empty());
    }

    #[test]
    fn an_answer_may_give_another_host_or_size_and_only_to_what_is_of_the_level() {
        let mut state = empty_room();
        for (name, level) in [("table_01", Level::Furniture), ("vase_01", Level::Decoration)] {
            add(&mut state, name, level, DVec3::splat(0.5), DVec3::new(1.0, 0.0, 1.0), Support::Floor);
        }
        let vase = ObjectId::new("vase_01").unwrap();
        let question = ReorderQuestion {
            level: Level::Decoration,
            room: views::room_summary(&state),
            placed: state.partial.placed.iter().map(views::placed_object).collect(),
            order: vec![vase.clone()],
            collisions: Vec::new(),
        };
        let size_m = InspectedSize { width: 0.2, height: 0.3, depth: 0.2 };
        let host = |id: &str, on: &str| ReorderHost { id: id.into(), on_top_of: Some(on.into()) };
        let answer = ReorderAnswer {
            hosts: vec![host("vase_01", "table_01"), host("vase_01", "moon_01"), host("table_01", "vase_01")],
            sizes: vec![ReorderSize { id: "vase_01".into(), size_m }, ReorderSize { id: "sofa_01".into(), size_m }],
            ..ReorderAnswer::default()
        };
        let (said, complaints) = said_otherwise(&state, &question, &answer);
        assert_eq!(complaints.len(), 3);
        assert_eq!(said.len(), 1);
        let item = item(Level::Decoration, &state, &said[0]).unwrap();
        assert_eq!(item.relations.on_top_of.as_ref().map(ObjectId::as_str), Some("table_01"));
        assert_eq!([item.size.width, item.size.height, item.size.depth], [0.2, 0.3, 0.2]);
        assert_eq!(state.objects[&vase].said.on_top_of, None, "only what is kept is said");
    }
}
