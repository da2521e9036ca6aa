//! Second looks at shapes: the model sees what its programs and templates became, from several sides, and corrects
//! them. A correction is measured against the photo and kept only when the evidence does not speak against it.

use std::collections::BTreeMap;
use std::slice;
use std::sync::Arc;

use harmony_imaging::sheet::{Cell, contact_sheet};
use harmony_placement::{Placed, Shape, Verdict, fit_shape, judge};
use harmony_program::GUIDE;
use harmony_prompts::{LookVerdict, LookedAt, ModelledObject, SecondLookAnswer, SecondLookQuestion, ShownProgram};
use harmony_roles::Picture;
use harmony_scene::{Level, ObjectId, Size, WarningKind};
use image::{RgbImage, RgbaImage};
use serde::Serialize;
use serde_json::{Value, json};

use super::programs::{self, Program};
use super::{colour, surfaces};
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Object, SceneState};
use crate::views;

/// Side of a picture on the sheet, pixels.
const CELL: u32 = 300;

/// Looks again at the objects of a level that matter, until nothing is changed or the rounds are used up.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn until_settled(ctx: &PhaseCtx<'_>, level: Level, state: &mut SceneState) -> Result<(), PhaseError> {
    if ctx.can().makes_shapes {
        return Ok(());
    }
    let mut tried = Vec::new();
    for round in 1..=ctx.settings.programs.second_looks {
        let name = format!("second_look_{round}");
        let chosen = worth_a_look(ctx, level, state);
        if chosen.is_empty() || !ctx.is_looked_at(&name) {
            return Ok(());
        }
        ctx.step(&format!("second look {round}"));
        surfaces::keep_walls_open(state);
        let answer = ask(ctx, state, &chosen, &name, std::mem::take(&mut tried)).await?;
        let mut results = Vec::new();
        let mut kept = 0;
        let unseen = followers(state, level, &chosen);
        for object in answer.objects.iter().filter(|o| o.verdict == LookVerdict::Change) {
            let changes = with_followers(&answer, object, state, &unseen);
            for (nth, (id, program)) in changes.into_iter().enumerate() {
                let (result, refused) = try_change(ctx, state, &id, program).await?;
                let stays = refused.is_none();
                kept += usize::from(stays);
                let came = refused.map_or("kept".to_owned(), |reason| format!("refused, {reason}"));
                tried.push(format!("- another program of {id}: {came}"));
                results.push(result);
                // Who is of the same design follows what was found good.
                if nth == 0 && !stays {
                    break;
                }
            }
        }
        ctx.write_json(&format!("{name}.json"), &json!({ "objects": answer.objects, "tried": results }))?;
        if kept == 0 {
            return Ok(());
        }
        super::texture::bare(ctx, state).await?;
    }
    Ok(())
}

/// Objects of the level that matter: those that are large in the photo, and those whose outline the scene does not meet.
fn worth_a_look(ctx: &PhaseCtx<'_>, level: Level, state: &SceneState) -> Vec<usize> {
    let smallest = ctx.settings.programs.smallest_share * state.partial.camera.size.pixels() as f64;
    let mut chosen: Vec<usize> = (0..state.partial.placed.len())
        .filter(|i| {
            let p = &state.partial.placed[*i];
            p.item.level == level && p.item.mask.count() as f64 >= smallest
        })
        .collect();
    chosen.sort_by(|a, b| {
        let [a, b] = [a, b].map(|i| &state.partial.placed[*i]);
        matters(b).total_cmp(&matters(a)).then_with(|| a.item.id.cmp(&b.item.id))
    });
    chosen.truncate(ctx.settings.programs.looks_per_question);
    chosen
}

/// How many times a pixel counts in which outline and photo disagree, beside those that an object has.
const DISAGREES: f64 = 2.0;

/// How much a second look at an object may mend, pixels.
fn matters(placed: &Placed) -> f64 {
    let off = placed.evidence.silhouette_iou.map_or(0.0, |iou| 1.0 - iou);
    placed.item.mask.count() as f64 * (1.0 + DISAGREES * off)
}

/// Objects of the level that are not shown and have a program.
fn followers(state: &SceneState, level: Level, shown: &[usize]) -> Vec<ObjectId> {
    let placed = state.partial.placed.iter().enumerate();
    let of_level = placed.filter(|(i, p)| p.item.level == level && !shown.contains(i)).map(|(_, p)| &p.item.id);
    of_level.filter(|id| source_of(state, id).is_some()).cloned().collect()
}

fn source_of<'s>(state: &'s SceneState, id: &ObjectId) -> Option<&'s Program> {
    state.objects.get(id).and_then(Object::program).map(Arc::as_ref)
}

/// An object's corrected program, then the same for those of `unseen` that had its old one, each with its own parameters.
fn with_followers(
    answer: &SecondLookAnswer,
    object: &LookedAt,
    state: &SceneState,
    unseen: &[ObjectId],
) -> Vec<(String, Program)> {
    let Some(source) = answer.program_of(object) else { return Vec::new() };
    let program = |params: &BTreeMap<String, f64>| Program { source: source.to_owned(), params: params.clone() };
    let mut changes = vec![(object.id.clone(), program(&object.params))];
    let id = ObjectId::new(&object.id).ok();
    if let Some(old) = id.and_then(|id| source_of(state, &id)) {
        let alike = unseen.iter().filter_map(|id| Some((id, source_of(state, id)?)));
        let alike = alike.filter(|(_, program)| program.source == old.source);
        changes.extend(alike.map(|(id, own)| (id.to_string(), program(&own.params))));
    }
    changes
}

async fn ask(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    chosen: &[usize],
    name: &str,
    tried: Vec<String>,
) -> Result<SecondLookAnswer, PhaseError> {
    let placed = |i: &usize| &state.partial.placed[*i];
    let mut texts: BTreeMap<&str, &ObjectId> = BTreeMap::new();
    let objects = chosen.iter().map(|i| {
        let id = &placed(i).item.id;
        let program = source_of(state, id);
        ModelledObject {
            object: views::placed_object(placed(i)),
            made_as: state.objects.get(id).and_then(|o| o.model.as_ref()).map_or(String::new(), |m| m.source.clone()),
            params: program.map(|p| p.params.clone()).unwrap_or_default(),
            program: program.map(|p| match *texts.entry(&p.source).or_insert(id) {
                first if first == id => ShownProgram::Text(p.source.clone()),
                first => ShownProgram::SameAs(first.clone()),
            }),
        }
    });
    let question = SecondLookQuestion { objects: objects.collect(), tried, guide: GUIDE.to_owned() };
    let (shown, rows) = (state.clone(), chosen.to_vec());
    let sheet = ctx.computed(move || sheet(&shown, &rows)).await?;
    let pictures = vec![Picture { caption: "IMAGE 1: the rows".into(), image: Arc::new(sheet) }];
    let sizes: Vec<(String, Size)> = chosen.iter().map(|i| (placed(i).item.id.to_string(), placed(i).size())).collect();
    let photo = Arc::clone(&state.photo);
    ctx.ask_and_try(name, question, pictures, move |answer: &SecondLookAnswer| {
        for (id, size) in &sizes {
            let Some(object) = answer.objects.iter().find(|o| o.id == *id) else { continue };
            let Some(source) = answer.program_of(object) else { continue };
            let program = Program { source: source.to_owned(), params: object.params.clone() };
            programs::built(&program, *size, &photo).map_err(|error| format!("program of {id}: {error}"))?;
        }
        Ok(())
    })
    .await
}

/// A row an object: photo, the same window of the scene, and the mesh from its front, its left and its back.
fn sheet(state: &SceneState, rows: &[usize]) -> RgbImage {
    let mut pictures: Vec<(String, RgbaImage)> = Vec::new();
    for i in rows {
        let id = &state.partial.placed[*i].item.id;
        let (Some(window), Some(mesh)) = (views::window_around(state, *i), state.mesh_of(id)) else { continue };
        pictures.push((format!("{id} photo"), views::photo_window(state, window)));
        pictures.push((format!("{id} model"), views::turned(state, *i, 0.0, window)));
        for (k, side) in [(0, "front"), (1, "side"), (2, "back")] {
            pictures.push((format!("{id} {side}"), views::mesh_view(mesh, k, CELL)));
        }
    }
    let cells: Vec<Cell<'_>> = pictures.iter().map(|(label, image)| Cell { label: label.clone(), image }).collect();
    contact_sheet(&cells, 5, CELL)
}

/// Tries one corrected program; what came of it, and why it does not stay, if so.
async fn try_change(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    id: &str,
    program: Program,
) -> Result<(Value, Option<String>), PhaseError> {
    let refused = |reason: String| (json!({ "id": id, "kept": false, "reason": &reason }), Some(reason));
    let Ok(object) = ObjectId::new(id) else {
        return Ok(refused("there is no such object".to_owned()));
    };
    let tried = try_program(ctx, state, &object, program).await?;
    Ok(match tried {
        Ok(tried) => {
            let record = json!({ "id": id, "kept": tried.verdict.kept, "tried": &tried });
            (record, (!tried.verdict.kept).then_some(tried.verdict.reason))
        }
        Err(reason) => refused(reason),
    })
}

/// What came of a program that was tried.
#[derive(Debug, Clone, Serialize)]
pub struct Tried {
    /// Whether it stays, and why.
    pub verdict: Verdict,
    /// Distance of the object's colours from the photo's, before and after ([`colour::distance`]).
    pub colour: [Option<f64>; 2],
}

/// Gives a placed object the shape of another program, where it stands or where it agrees better with the photo, if neither
/// evidence nor colours speak against it; if they do, a warning says so.
///
/// # Errors
/// Unwritable files and computations that broke; inside, why it cannot be tried.
pub async fn try_program(
    ctx: &PhaseCtx<'_>,
    state: &mut SceneState,
    id: &ObjectId,
    program: Program,
) -> Result<Result<Tried, String>, PhaseError> {
    let Some(size) = state.partial.find(id).map(harmony_placement::Placed::size) else {
        return Ok(Err(format!("there is no object {id} in the scene")));
    };
    let shown = Arc::new(state.clone());
    let Some(made) = programs::mesh(ctx, id, &program, size, &shown).await? else {
        return Ok(Err("its program cannot be used".to_owned()));
    };
    let settings = ctx.settings.placement.clone();
    let (wanted, before) = (id.clone(), Arc::clone(&shown));
    let fitted = ctx
        .computed(move || {
            let longest = size.as_vec().max_element();
            let mesh = &made.mesh;
            let shape = Arc::new(Shape::from_parts(Arc::clone(&mesh.mesh), mesh.convex.as_deref(), longest));
            let outcome = fit_shape(&before.partial, &wanted, Arc::clone(&shape), &settings)?;
            let verdict = judge(&before.partial, &outcome, &settings);
            Ok::<_, harmony_placement::ActionError>((made, shape, outcome, verdict))
        })
        .await?;
    let (made, shape, outcome, mut verdict) = match fitted {
        Ok(fitted) => fitted,
        Err(error) => return Ok(Err(error.to_string())),
    };
    let mut colour = [None; 2];
    if verdict.kept {
        let mut changed = state.clone();
        changed.partial = outcome.scene;
        let written = made.clone();
        programs::adopt(&mut changed, id, made, shape, Arc::new(program.clone()));
        colour = [colour::distance(ctx, &shown, id).await?, colour::distance(ctx, &changed, id).await?];
        match colour::against(colour[0], colour[1]) {
            None => {
                let level = changed.objects[id].level;
                written.write(ctx, level, id, &program)?;
                *state = changed;
                programs::refit(ctx, state, slice::from_ref(id)).await?;
            }
            Some(reason) => (verdict.kept, verdict.reason) = (false, reason),
        }
    }
    if !verdict.kept {
        let message = format!("another shape was proposed and refused: {}", verdict.reason);
        ctx.warn(WarningKind::ActionRefused, Some(id.clone()), message);
    }
    Ok(Ok(Tried { verdict, colour }))
}
