//! Each object's own chain: complete -> mesh -> de-tilt -> front. Paper Sec. 3.2; key `inpaint.complete`.
//!
//! Chains are independent and run beside each other, those of other levels among them. Identical objects share one
//! chain: what is completed and meshed is the one that is seen best.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::sheet::{Cell, contact_sheet, crop_rgba};
use harmony_prompts::{CompletedQuestion, NamedObject, Occlusion};
use harmony_roles::{EditKind, EditRequest, GeneratedMesh, MeshRequest, Picture};
use harmony_scene::{Level, ObjectId, Vec3, WarningKind};
use image::RgbaImage;
use serde_json::{Value, json};

use super::canonical::{Canonical, assemble, canonicalise, shape_of};
use super::features::Feature;
use super::programs::{self, Program, Written};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{DropReason, Object, SceneState};

/// Largest ratio of the sizes, side by side, of objects that are taken for identical.
const SAME_SIZE: f64 = 1.25;

/// An object on its way to a mesh.
#[derive(Clone)]
pub struct Completed {
    /// The object; it has no model yet.
    pub object: Object,
    /// The object alone; alpha = object.
    pub image: Arc<RgbaImage>,
    /// The program that models it.
    pub program: Option<Arc<Program>>,
    /// Slots of the program that keep their look whatever the photo shows.
    pub plain_slots: Vec<String>,
    /// Those of them whose colour was said.
    pub said_slots: Vec<String>,
    /// Where its program has its light, in the mesh's frame.
    pub bulb: Option<Vec3>,
    /// Whether parts of it move on joints.
    pub moves: bool,
}

/// How one object came out of its chain: with a model, or without one and why.
pub type Outcome = Result<Object, (Object, DropReason)>;

/// Completes and models every object, in order of their ids; with what is built into the room.
///
/// # Errors
/// Fatal role errors only. All chains have come to their end by then: what is in flight is not dropped.
pub async fn all(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &Arc<SceneState>,
    objects: Vec<Object>,
) -> Result<(Vec<Outcome>, Vec<Feature>), PhaseError> {
    let Written { objects: programs, features } = programs::ask(ctx, state, &objects).await?;
    // What this program makes itself costs nothing, and a part model is made for each object's own mask.
    let groups =
        if ctx.can().makes_shapes { identical(objects) } else { objects.into_iter().map(|one| vec![one]).collect() };
    let chains = join_all(groups.into_iter().map(|group| chain(ctx, level, state, group, &programs))).await;
    let mut outcomes = Vec::new();
    let mut detilt = BTreeMap::new();
    for ended in chains {
        for (outcome, record) in ended? {
            if let (Ok(object), Some(record)) = (&outcome, record) {
                detilt.insert(object.id.clone(), record);
            }
            outcomes.push(outcome);
        }
    }
    outcomes.sort_by(|a, b| id_of(a).cmp(id_of(b)));
    ctx.write_json(&ctx.record("detilt_results.json"), &detilt)?;
    Ok((outcomes, features))
}

fn id_of(outcome: &Outcome) -> &ObjectId {
    match outcome {
        Ok(object) | Err((object, _)) => &object.id,
    }
}

/// Puts identical objects together: one named set, one kind, one size. The one seen best comes first.
fn identical(wanted: Vec<Object>) -> Vec<Vec<Object>> {
    let mut groups: Vec<Vec<Object>> = Vec::new();
    let mut sets: BTreeMap<(String, String), Vec<usize>> = BTreeMap::new();
    for object in wanted {
        let Some(set) = object.said.matched_set.clone().filter(|s| !s.trim().is_empty()) else {
            groups.push(vec![object]);
            continue;
        };
        let known = sets.entry((set, object.said.kind.clone())).or_default();
        if let Some(i) = known.iter().find(|i| same_size(&groups[**i][0], &object)) {
            groups[*i].push(object);
        } else {
            known.push(groups.len());
            groups.push(vec![object]);
        }
    }
    for group in &mut groups {
        let hidden = |o: &Object| match o.said.occlusion {
            Occlusion::None => 0,
            Occlusion::Partly => 1,
            Occlusion::Heavily => 2,
        };
        group.sort_by_cached_key(|o| (hidden(o), std::cmp::Reverse(o.mask.count()), o.id.clone()));
    }
    groups
}

fn same_size(a: &Object, b: &Object) -> bool {
    let (a, b) = (a.size().as_vec(), b.size().as_vec());
    a.max(b).cmple(a.min(b) * SAME_SIZE).all()
}

/// The chain of one object, or of several identical ones; with each, how it was set upright.
async fn chain(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &Arc<SceneState>,
    group: Vec<Object>,
    programs: &BTreeMap<ObjectId, Program>,
) -> Result<Vec<(Outcome, Option<Value>)>, PhaseError> {
    let mut outcomes = Vec::new();
    let mut members = Vec::new();
    for object in group {
        let (shown, mask) = (Arc::clone(state), Arc::clone(&object.mask));
        let crop = ctx.computed(move || crop_rgba(&shown.photo, &mask, 0.08)).await?;
        let Some((crop, _)) = crop else {
            outcomes.push((Err((object, DropReason::NoPixels)), None));
            continue;
        };
        ctx.write_picture_rgba(&format!("crops/{}.png", object.id), &crop)?;
        let program = programs.get(&object.id).cloned().map(Arc::new);
        let (plain_slots, said_slots) = (Vec::new(), Vec::new());
        let image = Arc::new(crop);
        members.push(Completed { object, image, program, plain_slots, said_slots, bulb: None, moves: false });
    }
    let mut made = None;
    for member in &mut members {
        complete(ctx, state, member).await?;
        let id = member.object.id.clone();
        ctx.write_picture_rgba(&format!("completed/{id}.png"), &member.image)?;
        let mut programmed = None;
        if let Some(program) = &member.program {
            programmed = programs::mesh(ctx, &id, program, member.object.size(), state).await?;
            programmed.iter().try_for_each(|modelled| modelled.write(ctx, level, &id, program))?;
        }
        let mesh = if let Some(modelled) = programmed {
            member.moves = modelled.moves();
            member.plain_slots = modelled.plain_slots;
            member.said_slots = modelled.said_slots;
            member.bulb = modelled.bulb;
            Some(modelled.mesh)
        } else {
            member.program = None;
            generate(ctx, level, member).await?
        };
        if let Some(mesh) = mesh {
            made = Some((id, canonicalise(ctx, member, mesh).await?, member.object.said.size_m));
            break;
        }
        // Of identical objects the next one is tried.
    }
    let Some((maker, canonical, size)) = made else {
        for member in members {
            ctx.warn(WarningKind::ObjectDropped, Some(member.object.id.clone()), DropReason::NoMesh.to_string());
            outcomes.push((Err((member.object, DropReason::NoMesh)), None));
        }
        return Ok(outcomes);
    };
    let made = canonical.mesh.clone();
    let shape = ctx.computed(move || shape_of(&made, &size)).await?;
    for member in members {
        let Canonical { mut mesh, mut record, view } = canonical.clone();
        if member.object.id != maker {
            mesh.source = format!("{}, the mesh of {maker}", mesh.source);
            record["mesh_of"] = json!(maker);
        }
        outcomes.push((Ok(assemble(ctx, member, mesh, Arc::clone(&shape), view).await?), Some(record)));
    }
    Ok(outcomes)
}

/// Amodal completion of what is hidden, inspected, with one more try.
async fn complete(ctx: &PhaseCtx<'_>, state: &Arc<SceneState>, c: &mut Completed) -> Result<(), PhaseError> {
    // This program's own fill can't invent what is hidden, so for part models the masked crop is enough.
    if !ctx.can().draws || c.object.said.occlusion == Occlusion::None {
        return Ok(());
    }
    c.image = edit(ctx, state, c, "complete", "").await?;
    if let Some(hint) = inspect_completed(ctx, state, c).await? {
        c.image = edit(ctx, state, c, "complete_again", &format!(" Hints: {hint}.")).await?;
    }
    Ok(())
}

async fn edit(
    ctx: &PhaseCtx<'_>,
    state: &Arc<SceneState>,
    c: &Completed,
    step: &str,
    hint: &str,
) -> Result<Arc<RgbaImage>, PhaseError> {
    let request = EditRequest {
        name: ctx.call(&format!("{}/{step}", c.object.id)),
        kind: EditKind::Amodal,
        image: state.photo.clone(),
        mask: None,
        object: Some(Arc::clone(&c.object.mask)),
        instruction: format!(
            "Draw the complete {} alone on a plain grey background, as seen from this camera: {}. \
             Keep the visible parts as they are and complete what other objects hide.{hint}",
            c.object.said.kind, c.object.said.description
        ),
    };
    Ok(Arc::new(ctx.calls.edit(&request).await?.image))
}

/// Asks whether the completed picture shows the object; hints for another try when it does not.
async fn inspect_completed(
    ctx: &PhaseCtx<'_>,
    state: &Arc<SceneState>,
    c: &Completed,
) -> Result<Option<String>, PhaseError> {
    let id = c.object.id.to_string();
    let (shown, mask, done, label) = (Arc::clone(state), Arc::clone(&c.object.mask), Arc::clone(&c.image), id.clone());
    let sheet = ctx
        .computed(move || {
            let (crop, _) = crop_rgba(&shown.photo, &mask, 0.1)?;
            let cells = [
                Cell { label: format!("{label} photo"), image: &crop },
                Cell { label: format!("{label} completed"), image: &done },
            ];
            Some(contact_sheet(&cells, 2, 300))
        })
        .await?;
    let Some(sheet) = sheet else { return Ok(None) };
    let shown = NamedObject { id: id.clone(), about: c.object.said.description.clone() };
    let question = CompletedQuestion { objects: vec![shown] };
    let sheet = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(sheet) };
    let answer = ctx.ask(&format!("{id}/completed"), question, vec![sheet]).await?;
    Ok(answer.objects.into_iter().find(|o| o.id == id).filter(|o| !o.matches).map(|o| o.hint))
}

async fn generate(ctx: &PhaseCtx<'_>, level: Level, c: &Completed) -> Result<Option<GeneratedMesh>, PhaseError> {
    let request = MeshRequest {
        name: ctx.call(&format!("{}/mesh", c.object.id)),
        crop: c.image.clone(),
        label: c.object.said.kind.clone(),
        description: c.object.said.description.clone(),
        level,
        size: c.object.size(),
        template: c.object.said.template.clone(),
        params: c.object.said.params.clone().unwrap_or_default(),
        part_model: c.object.said.part_model.clone(),
        settings: ctx.settings.mesh,
    };
    match ctx.calls.generate_mesh(&request).await {
        Ok(mesh) => {
            for note in &mesh.notes {
                ctx.warn(WarningKind::AnswerRepaired, Some(c.object.id.clone()), note.clone());
            }
            Ok(Some(mesh))
        }
        Err(error) if error.is_fatal() => Err(error.into()),
        Err(error) => {
            ctx.warn(WarningKind::PlayerReplaced, Some(c.object.id.clone()), error.to_string());
            Ok(None)
        }
    }
}

#[cfg(test)]
mod tests {
    use harmony_prompts::InspectedSize;
    use harmony_roles::Detection;
    use harmony_scene::{ImageSize, Mask, PixelBox};

    use super::*;

    fn one(id: &str, pixels: u32, occlusion: Occlusion, set: Option<&str>, width: f64) -> Object {
        let bounds = PixelBox { x0: 0.0, y0: 0.0, x1: 9.0, y1: 9.0 };
        let detection = Detection { label: "chair".into(), phrase: "chair".into(), bounds, score: None, outline: None };
        let mask = Mask::from_fn(ImageSize::new(16, 16), |x, y| y * 16 + x < pixels);
        let id = ObjectId::new(id).unwrap();
        let mut object = Object::found(id, Level::Furniture, detection, mask);
        object.said.size_m = InspectedSize { width, height: 0.9, depth: 0.5 };
        object.said.occlusion = occlusion;
        object.said.matched_set = set.map(str::to_owned);
        object
    }

    #[test]
    fn identical_objects_share_a_chain_and_the_one_seen_best_is_meshed() {
        let set = Some("dining chairs");
        let groups = identical(vec![
            one("chair_01", 50, Occlusion::Partly, set, 0.45),
            one("chair_02", 90, Occlusion::Heavily, set, 0.45),
            one("chair_03", 40, Occlusion::None, set, 0.47),
            one("chair_04", 60, Occlusion::Partly, set, 0.9),
            one("chair_05", 60, Occlusion::None, None, 0.45),
            one("chair_06", 60, Occlusion::None, Some(" "), 0.45),
        ]);
        let ids: Vec<Vec<&str>> = groups.iter().map(|g| g.iter().map(|o| o.id.as_str()).collect()).collect();
        assert_eq!(
            ids,
            [vec!["chair_03", "chair_01", "chair_02"], vec!["chair_04"], vec!["chair_05"], vec!["chair_06"]],
            "another size, no set and an empty name are objects of their own"
        );
    }
}
