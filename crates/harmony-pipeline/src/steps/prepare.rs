//! Each object's own chain: complete -> mesh -> de-tilt -> front. Paper Sec. 3.2; key `inpaint.complete`.
//!
//! Chains are independent and run beside each other, those of other levels among them. Identical objects share one
//! chain: what is completed and meshed is the one that is seen best.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::sheet::{Cell, contact_sheet, crop_rgba};
use harmony_prompts::{CompletedQuestion, InspectedObject, NamedObject, Occlusion};
use harmony_roles::{EditKind, EditRequest, GeneratedMesh, MeshRequest, Picture};
use harmony_scene::{Level, ObjectId, Size, WarningKind};
use image::RgbaImage;
use serde_json::{Value, json};

use super::canonical::{Canonical, assemble, canonicalise, shape_of};
use super::inspect::Inspection;
use super::programs::{self, Program};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Candidate, Prepared, SceneState};

/// Largest ratio of the sizes, side by side, of objects that are taken for identical.
const SAME_SIZE: f64 = 1.25;

/// A candidate with its completed picture.
#[derive(Clone)]
pub struct Completed {
    /// The candidate.
    pub candidate: Candidate,
    /// What was said about it.
    pub inspected: InspectedObject,
    /// The object alone; alpha = object.
    pub image: Arc<RgbaImage>,
    /// The program that models it.
    pub program: Option<Arc<Program>>,
    /// Slots of the program that keep their look whatever the photo shows.
    pub plain_slots: Vec<String>,
    /// Those of them whose colour was said.
    pub said_slots: Vec<String>,
}

/// What comes out of the chains of a level.
#[derive(Debug, Default)]
pub struct Objects {
    /// Ready to be placed, in order of their ids; without indices.
    pub ready: Vec<Prepared>,
    /// Left out: id and reason.
    pub dropped: Vec<(ObjectId, String)>,
}

/// How one object came out of its chain.
enum Outcome {
    Ready(Box<Prepared>, Value),
    Dropped(ObjectId, String),
}

/// Prepares every kept candidate; those that are not kept, or fail, are dropped with the reason.
///
/// # Errors
/// Fatal role errors only. All chains have come to their end by then: what is in flight is not dropped.
pub async fn all(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &Arc<SceneState>,
    candidates: Vec<Candidate>,
    inspection: &Inspection,
) -> Result<Objects, PhaseError> {
    let programs = programs::ask(ctx, state, &candidates, inspection).await?;
    let mut objects = Objects::default();
    let mut wanted = Vec::new();
    for candidate in candidates {
        match inspection.objects.get(&candidate.id) {
            Some(object) if object.keep => wanted.push((candidate, object.clone())),
            Some(object) => {
                let reason = if object.reason.is_empty() { "rejected".to_owned() } else { object.reason.clone() };
                objects.dropped.push((candidate.id, reason));
            }
            None => {
                let reason = "nothing was said about it".to_owned();
                ctx.warn(WarningKind::ObjectDropped, Some(candidate.id.clone()), reason.clone());
                objects.dropped.push((candidate.id, reason));
            }
        }
    }
    // What this program makes itself costs nothing, and a part model is made for each object's own mask.
    let groups =
        if ctx.can().makes_shapes { identical(wanted) } else { wanted.into_iter().map(|one| vec![one]).collect() };
    let outcomes = join_all(groups.into_iter().map(|group| chain(ctx, level, state, group, &programs))).await;
    let mut ready = Vec::new();
    for outcome in outcomes.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten() {
        match outcome {
            Outcome::Ready(prepared, detilt) => ready.push((*prepared, detilt)),
            Outcome::Dropped(id, reason) => objects.dropped.push((id, reason)),
        }
    }
    ready.sort_by(|a, b| a.0.candidate.id.cmp(&b.0.candidate.id));
    let detilt: serde_json::Map<String, Value> =
        ready.iter().map(|(p, d)| (p.candidate.id.to_string(), d.clone())).collect();
    ctx.write_json("detilt_results.json", &detilt)?;
    objects.ready = ready.into_iter().map(|(prepared, _)| prepared).collect();
    Ok(objects)
}

/// Puts identical objects together: one named set, one kind, one size. The one seen best comes first.
fn identical(wanted: Vec<(Candidate, InspectedObject)>) -> Vec<Vec<(Candidate, InspectedObject)>> {
    let mut groups: Vec<Vec<(Candidate, InspectedObject)>> = Vec::new();
    let mut sets: BTreeMap<(String, String), Vec<usize>> = BTreeMap::new();
    for (candidate, object) in wanted {
        let Some(set) = object.matched_set.clone().filter(|s| !s.trim().is_empty()) else {
            groups.push(vec![(candidate, object)]);
            continue;
        };
        let known = sets.entry((set, object.kind.clone())).or_default();
        if let Some(i) = known.iter().find(|i| same_size(&groups[**i][0].1, &object)) {
            groups[*i].push((candidate, object));
        } else {
            known.push(groups.len());
            groups.push(vec![(candidate, object)]);
        }
    }
    for group in &mut groups {
        let hidden = |o: &InspectedObject| match o.occlusion {
            Occlusion::None => 0,
            Occlusion::Partly => 1,
            Occlusion::Heavily => 2,
        };
        group.sort_by_cached_key(|(c, o)| (hidden(o), std::cmp::Reverse(c.mask.count()), c.id.clone()));
    }
    groups
}

fn same_size(a: &InspectedObject, b: &InspectedObject) -> bool {
    let (a, b) = (a.size_m, b.size_m);
    [(a.width, b.width), (a.height, b.height), (a.depth, b.depth)]
        .into_iter()
        .all(|(a, b)| a.max(b) <= SAME_SIZE * a.min(b))
}

/// The chain of one object, or of several identical ones.
async fn chain(
    ctx: &PhaseCtx<'_>,
    level: Level,
    state: &Arc<SceneState>,
    group: Vec<(Candidate, InspectedObject)>,
    programs: &BTreeMap<ObjectId, Program>,
) -> Result<Vec<Outcome>, PhaseError> {
    let mut outcomes = Vec::new();
    let mut members = Vec::new();
    for (candidate, inspected) in group {
        let (shown, mask) = (Arc::clone(state), candidate.mask.clone());
        let crop = ctx.computed(move || crop_rgba(&shown.photo, &mask, 0.08)).await?;
        let Some((crop, _)) = crop else {
            outcomes.push(Outcome::Dropped(candidate.id, "no pixel of it is left".into()));
            continue;
        };
        ctx.write_picture_rgba(&format!("crops/{}.png", candidate.id), &crop)?;
        let program = programs.get(&candidate.id).cloned().map(Arc::new);
        let (plain_slots, said_slots) = (Vec::new(), Vec::new());
        members.push(Completed { candidate, inspected, image: Arc::new(crop), program, plain_slots, said_slots });
    }
    let mut made = None;
    for member in &mut members {
        complete(ctx, state, member).await?;
        ctx.write_picture_rgba(&format!("completed/{}.png", member.candidate.id), &member.image)?;
        let programmed = match &member.program {
            Some(program) => programs::mesh(ctx, &member.candidate.id, program, size_of(member), state).await?,
            None => None,
        };
        let mesh = if let Some(modelled) = programmed {
            member.plain_slots = modelled.plain_slots;
            member.said_slots = modelled.said_slots;
            Some(modelled.mesh)
        } else {
            member.program = None;
            generate(ctx, level, member).await?
        };
        if let Some(mesh) = mesh {
            made = Some((member.candidate.id.clone(), canonicalise(ctx, member, mesh).await?, member.inspected.size_m));
            break;
        }
        // Of identical objects the next one is tried.
    }
    let Some((maker, canonical, size)) = made else {
        for member in members {
            let (id, reason) = (member.candidate.id, "no mesh could be made of it".to_owned());
            ctx.warn(WarningKind::ObjectDropped, Some(id.clone()), reason.clone());
            outcomes.push(Outcome::Dropped(id, reason));
        }
        return Ok(outcomes);
    };
    let made = canonical.mesh.clone();
    let shape = ctx.computed(move || shape_of(&made, &size)).await?;
    for member in members {
        let Canonical { mut mesh, record: mut detilt, view } = canonical.clone();
        if member.candidate.id != maker {
            mesh.source = format!("{}, the mesh of {maker}", mesh.source);
            detilt["mesh_of"] = json!(maker);
        }
        let ready = assemble(ctx, member, mesh, Arc::clone(&shape), view).await?;
        outcomes.push(Outcome::Ready(Box::new(ready), detilt));
    }
    Ok(outcomes)
}

/// Amodal completion of what is hidden, inspected, with one more try.
async fn complete(ctx: &PhaseCtx<'_>, state: &Arc<SceneState>, c: &mut Completed) -> Result<(), PhaseError> {
    // This program's own fill can't invent what is hidden, so for part models the masked crop is enough.
    if !ctx.can().draws || c.inspected.occlusion == Occlusion::None {
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
        name: ctx.call(&format!("{}/{step}", c.candidate.id)),
        kind: EditKind::Amodal,
        image: state.photo.clone(),
        mask: None,
        object: Some(Arc::new(c.candidate.mask.clone())),
        instruction: format!(
            "Draw the complete {} alone on a plain grey background, as seen from this camera: {}. \
             Keep the visible parts as they are and complete what other objects hide.{hint}",
            c.inspected.kind, c.inspected.description
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
    let id = c.candidate.id.to_string();
    let (shown, mask, done, label) = (Arc::clone(state), c.candidate.mask.clone(), Arc::clone(&c.image), id.clone());
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
    let shown = NamedObject { id: id.clone(), about: c.inspected.description.clone() };
    let question = CompletedQuestion { objects: vec![shown] };
    let sheet = Picture { caption: "IMAGE 1: the sheet".into(), image: Arc::new(sheet) };
    let answer = ctx.ask(&format!("{id}/completed"), question, vec![sheet]).await?;
    Ok(answer.objects.into_iter().find(|o| o.id == id).filter(|o| !o.matches).map(|o| o.hint))
}

fn size_of(c: &Completed) -> Size {
    let size = c.inspected.size_m;
    Size { width: size.width, height: size.height, depth: size.depth }
}

async fn generate(ctx: &PhaseCtx<'_>, level: Level, c: &Completed) -> Result<Option<GeneratedMesh>, PhaseError> {
    let request = MeshRequest {
        name: ctx.call(&format!("{}/mesh", c.candidate.id)),
        crop: c.image.clone(),
        label: c.inspected.kind.clone(),
        description: c.inspected.description.clone(),
        level,
        size: size_of(c),
        template: c.inspected.template.clone(),
        params: c.inspected.params.clone().unwrap_or_default(),
        part_model: c.inspected.part_model.clone(),
        settings: ctx.settings.mesh,
    };
    match ctx.calls.generate_mesh(&request).await {
        Ok(mesh) => {
            for note in &mesh.notes {
                ctx.warn(WarningKind::AnswerRepaired, Some(c.candidate.id.clone()), note.clone());
            }
            Ok(Some(mesh))
        }
        Err(error) if error.is_fatal() => Err(error.into()),
        Err(error) => {
            ctx.warn(WarningKind::PlayerReplaced, Some(c.candidate.id.clone()), error.to_string());
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

    fn one(id: &str, pixels: u32, occlusion: Occlusion, set: Option<&str>, width: f64) -> (Candidate, InspectedObject) {
        let bounds = PixelBox { x0: 0.0, y0: 0.0, x1: 9.0, y1: 9.0 };
        let detection = Detection { label: "chair".into(), phrase: "chair".into(), bounds, score: None, outline: None };
        let mask = Mask::from_fn(ImageSize::new(16, 16), |x, y| y * 16 + x < pixels);
        let id = ObjectId::new(id).unwrap();
        let mut object = InspectedObject::plain(id.as_str(), "chair", InspectedSize { width, height: 0.9, depth: 0.5 });
        object.occlusion = occlusion;
        object.matched_set = set.map(str::to_owned);
        (Candidate { id, level: Level::Furniture, detection, mask, mask_score: None, host_hint: None }, object)
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
        let ids: Vec<Vec<&str>> = groups.iter().map(|g| g.iter().map(|(c, _)| c.id.as_str()).collect()).collect();
        assert_eq!(
            ids,
            [vec!["chair_03", "chair_01", "chair_02"], vec!["chair_04"], vec!["chair_05"], vec!["chair_06"]],
            "another size, no set and an empty name are objects of their own"
        );
    }
}
