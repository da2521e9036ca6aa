//! Modelling programs: what the language model writes instead of a template (`docs/decisions/0026-modelling-programs.md`).
//!
//! One question for several objects of a level; an answer whose programs do not run is asked for again with the line and
//! the hint. Programs yield shape trees; the mesh is built from the tree, at the size at hand.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::future::join_all;
use harmony_imaging::sheet::{grid_overlay, ruled_window};
use harmony_placement::{Shape, reshape};
use harmony_program::{ChildCommand, GUIDE, Inputs, Limits};
use harmony_prompts::{ProgramsAnswer, ProgramsQuestion, ToModel, WithoutProgram};
use harmony_roles::{GeneratedMesh, MeshFrame, Picture, Usage};
use harmony_scene::{ImageSize, Level, Motion, MovingPart, ObjectId, Size, Vec3, WarningKind};
use harmony_shape::ShapeTree;
use harmony_shape::build::{BuildContext, BuiltJoint, BuiltLight, BuiltShape, lazy_signs};
use harmony_shape::tree::JointKind;
use image::RgbImage;

use super::features::{self, Feature};
use super::{detect, prints};
use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Model, Object, SceneState};
use crate::views;

/// Longest side of an object's crop, pixels.
const CROP_PX: u32 = 720;
/// The name of a level's first question.
const FIRST: &str = "programs";
/// Change of size below which a shape is not built anew.
const NO_CHANGE: f64 = 0.01;

/// A program with what it was called with.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// Its text.
    pub source: String,
    /// Values for further parameters of `build`.
    pub params: BTreeMap<String, f64>,
}

/// Runs a program for an object of a size. It knows its own frame alone: where it will stand is found afterwards, so that it
/// is given neither room nor camera.
///
/// # Errors
/// What is wrong with it, with the line and a hint, for whoever wrote it.
pub fn run(program: &Program, size: Size) -> Result<ShapeTree, String> {
    evaluated(program, Inputs::object(size))
}

/// Runs a program with its own parameters beside others, in a child process.
///
/// # Errors
/// As [`run`].
pub fn evaluated(program: &Program, mut inputs: Inputs) -> Result<ShapeTree, String> {
    let child = ChildCommand::this_program().map_err(|error| format!("this program cannot be found: {error}"))?;
    for (name, value) in &program.params {
        inputs = inputs.with(name, *value);
    }
    let tree = harmony_program::run(&program.source, &inputs, &Limits::default(), &child)
        .map_err(|error| error.to_string())?;
    tree.check().map_err(|error| error.to_string())?;
    Ok(tree)
}

/// A program's shape, built.
#[derive(Debug)]
pub struct Built {
    /// The shape, made as large as it was asked for.
    pub shape: BuiltShape,
    /// What the program made.
    pub tree: ShapeTree,
    /// Width, height and depth that the program gave it, metres.
    pub raw: Vec3,
    /// Materials of pieces of the photo that took the colour of what they lie on ([`prints`]).
    printed: Vec<String>,
}

/// A program's mesh for an object of a size, metres.
///
/// # Errors
/// As [`run`], and shapes that cannot be built.
pub fn built(program: &Program, size: Size, photo: &RgbImage) -> Result<Built, String> {
    let tree = run(program, size)?;
    // A fault of ours in one shape costs one object, not the run.
    let build = std::panic::AssertUnwindSafe(|| meshed(&tree, size, photo));
    let (shape, printed, raw) =
        std::panic::catch_unwind(build).unwrap_or_else(|_| Err("its shape cannot be meshed (a fault here)".into()))?;
    Ok(Built { shape, tree, raw, printed })
}

fn meshed(tree: &ShapeTree, size: Size, photo: &RgbImage) -> Result<(BuiltShape, Vec<String>, Vec3), String> {
    let wanted = size.as_vec();
    let context = BuildContext { size: Some(wanted.to_array()), material: harmony_shape::material::material };
    let mut shape = tree.build(&context).map_err(|error| error.to_string())?;
    let raw = shape.size();
    let fit = shape.fit_to(wanted);
    let printed = prints::lay(&mut shape, tree, photo, fit.length);
    Ok((shape, printed, raw))
}

/// What a program made.
#[derive(Debug, Clone)]
pub struct Modelled {
    /// The mesh as a generator would have made it.
    pub mesh: GeneratedMesh,
    /// Slots that keep their look whatever the photo shows.
    pub plain_slots: Vec<String>,
    /// Those of them whose colour was said, or that took one that was; not those cut from the photo as they are.
    pub said_slots: Vec<String>,
    /// The parts that it was built from.
    tree: ShapeTree,
    /// Those of them that move.
    moving: Vec<MovingPart>,
    /// Where its light comes from, in the mesh's frame.
    pub bulb: Option<Vec3>,
}

impl Modelled {
    /// Whether parts of it move on joints.
    pub fn moves(&self) -> bool {
        !self.moving.is_empty()
    }

    /// Writes the parts and the program beside the meshes of the object's level, whichever level it is made anew in.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write(&self, ctx: &PhaseCtx<'_>, level: Level, id: &ObjectId, program: &Program) -> Result<(), PhaseError> {
        let phase = Phase::Objects(level);
        ctx.write_json_in(phase, &format!("meshes/{id}.tree.json"), &self.tree)?;
        ctx.write_json_in(phase, &format!("meshes/{id}.joints.json"), &self.moving)?;
        ctx.write_text_in(phase, &format!("meshes/{id}.program.py"), &program.source)
    }
}

fn modelled(Built { shape, tree, printed, .. }: Built, program: &Program) -> Modelled {
    let lines = program.source.lines().filter(|l| !l.trim().is_empty()).count();
    let plain = tree.materials.iter().filter(|m| !m.paint);
    let plain_slots = plain.map(|m| m.name.clone()).collect();
    let said_slots = said_of(&tree, &printed);
    let moving = shape.joints.iter().filter_map(moving_part).collect();
    let bulb = middle_of(&shape.lights);
    let mesh = GeneratedMesh {
        mesh: Arc::new(shape.mesh),
        convex: Some(shape.convex),
        frame: MeshFrame::Canonical,
        part_model: None,
        source: format!("program of {lines} lines"),
        notes: Vec::new(),
        usage: Usage::default(),
    };
    Modelled { mesh, plain_slots, said_slots, tree, moving, bulb }
}

/// Slots whose colour was said, or that took one that was (`printed`): not what the photo paints, nor pieces of it as they are.
pub fn said_of(tree: &ShapeTree, printed: &[String]) -> Vec<String> {
    let plain = tree.materials.iter().filter(|m| !m.paint);
    plain.filter(|m| m.photo.is_none() || printed.contains(&m.name)).map(|m| m.name.clone()).collect()
}

/// The middle of a shape's lights, weighted by what they give.
fn middle_of(lights: &[BuiltLight]) -> Option<Vec3> {
    let flux: f64 = lights.iter().map(|l| l.lumens).sum();
    (flux > 0.0).then(|| lights.iter().map(|l| l.position * l.lumens).sum::<Vec3>() / flux)
}

/// A joint as exports take it; a ball is none that a room's things have.
fn moving_part(joint: &BuiltJoint) -> Option<MovingPart> {
    let motion = match joint.kind {
        JointKind::Hinge => Motion::Hinge,
        JointKind::Slide => Motion::Slide,
        JointKind::Ball => return None,
    };
    let BuiltJoint { name, axis, pivot, range, boxes, .. } = joint.clone();
    Some(MovingPart { name, motion, axis, pivot, range, boxes })
}

/// What came of the questions for programs.
#[derive(Debug, Default)]
pub struct Written {
    /// Programs of objects.
    pub objects: BTreeMap<ObjectId, Program>,
    /// What is built into the room.
    pub features: Vec<Feature>,
}

/// Asks for programs for the objects of a level that matter, where no generator makes the meshes.
///
/// # Errors
/// Fatal role errors only.
pub async fn ask(ctx: &PhaseCtx<'_>, state: &Arc<SceneState>, objects: &[Object]) -> Result<Written, PhaseError> {
    let wanted = wanted(ctx, state, objects);
    let answers = join_all(wanted.iter().map(|(name, chunk)| ask_for(ctx, state, chunk, name))).await;
    let mut written = Written::default();
    for answer in answers {
        let answer = answer?;
        let named = |o: &Object| {
            let (source, params) = answer.program_of(o.id.as_str())?;
            Some((o.id.clone(), Program { source: source.to_owned(), params: params.clone() }))
        };
        written.objects.extend(objects.iter().filter_map(named));
        written.features.extend(features::of_answer(ctx, state, &answer).await?);
    }
    share(objects, &mut written.objects);
    Ok(written)
}

/// Gives those of a set that were not asked about, for they are small in the photo, the program of the one that is seen
/// largest.
fn share(objects: &[Object], programs: &mut BTreeMap<ObjectId, Program>) {
    let set = |o: &Object| {
        o.said.matched_set.clone().filter(|set| !set.trim().is_empty()).map(|set| (set, o.said.kind.clone()))
    };
    let mut modelled: Vec<&Object> = objects.iter().filter(|o| programs.contains_key(&o.id)).collect();
    modelled.sort_by_key(|o| (std::cmp::Reverse(o.mask.count()), o.id.clone()));
    for object in objects.iter().filter(|o| set(o).is_some()) {
        let Some(like) = modelled.iter().find(|o| set(o) == set(object)) else { continue };
        if !programs.contains_key(&object.id) {
            programs.insert(object.id.clone(), programs[&like.id].clone());
        }
    }
}

/// The questions for programs, by name, with the objects of each: those that matter, the largest in the photo first.
pub fn wanted<'o>(ctx: &PhaseCtx<'_>, state: &SceneState, objects: &'o [Object]) -> Vec<(String, Vec<&'o Object>)> {
    let settings = ctx.settings.programs;
    if ctx.can().makes_shapes || settings.most_objects == 0 {
        return Vec::new();
    }
    let smallest = settings.smallest_share * f64::from(state.photo.width()) * f64::from(state.photo.height());
    let mut wanted: Vec<&Object> = objects.iter().filter(|o| o.mask.count() as f64 >= smallest).collect();
    wanted.sort_by_key(|o| (std::cmp::Reverse(o.mask.count()), o.id.clone()));
    wanted.truncate(settings.most_objects);
    let wanted = sets_together(&wanted);
    let chunks = wanted.chunks(settings.objects_per_question).enumerate();
    let named = chunks.map(|(part, chunk)| {
        let name = if part == 0 { FIRST.to_owned() } else { format!("programs_{}", part + 1) };
        (name, chunk.to_vec())
    });
    named.filter(|(name, _)| ctx.is_looked_at(name)).collect()
}

/// The same objects, those of a set after its first, so that one question asks about them where it can.
fn sets_together<'o>(objects: &[&'o Object]) -> Vec<&'o Object> {
    let set = |o: &Object| {
        o.said.matched_set.clone().filter(|set| !set.trim().is_empty()).map(|set| (set, o.said.kind.clone()))
    };
    let first = |o: &Object| set(o).and_then(|own| objects.iter().position(|other| set(other).as_ref() == Some(&own)));
    let mut keyed: Vec<(usize, usize)> = (0..objects.len()).map(|i| (first(objects[i]).unwrap_or(i), i)).collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, i)| objects[i]).collect()
}

async fn ask_for(
    ctx: &PhaseCtx<'_>,
    state: &Arc<SceneState>,
    objects: &[&Object],
    name: &str,
) -> Result<ProgramsAnswer, PhaseError> {
    ctx.step(&format!("modelling {} objects", objects.len()));
    let question = ProgramsQuestion {
        room: views::room_summary(state),
        objects: objects.iter().map(|o| to_model(o, state.partial.camera.size)).collect(),
        // Once: what is built into the walls is there before what stands at them.
        features: ctx.phase == Phase::Objects(Level::Wall) && ctx.within.is_none() && name == FIRST,
        guide: GUIDE.to_owned(),
    };
    let (shown, listed) = (Arc::clone(state), objects.iter().map(|o| (*o).clone()).collect::<Vec<_>>());
    let pictures = ctx.computed(move || pictures(&shown, &listed)).await?;
    let sizes: BTreeMap<String, Size> = objects.iter().map(|o| (o.id.to_string(), o.size())).collect();
    let photo = Arc::clone(&state.photo);
    let (room, camera) = (state.partial.room.extents, state.partial.camera);
    ctx.ask_and_try(name, question, pictures, move |answer: &ProgramsAnswer| {
        for (id, size) in &sizes {
            let Some((source, params)) = answer.program_of(id) else { continue };
            let program = Program { source: source.to_owned(), params: params.clone() };
            built(&program, *size, &photo).map_err(|error| format!("program of {id}: {error}"))?;
        }
        features::check(answer, (&room, &camera), &photo)
    })
    .await
}

fn to_model(o: &Object, image: ImageSize) -> ToModel {
    ToModel {
        id: o.id.clone(),
        kind: o.said.kind.clone(),
        size: o.size(),
        bounds: o.detection.bounds,
        image,
        otherwise: match (&o.said.part_model, &o.said.template) {
            (Some(_), _) => WithoutProgram::PartModel,
            (None, Some(name)) => WithoutProgram::Template(name.clone()),
            (None, None) => WithoutProgram::Unnamed,
        },
        matched_set: o.said.matched_set.clone(),
        description: o.said.description.clone(),
    }
}

/// The photo with the objects boxed and a grid, and a ruled crop of each.
fn pictures(state: &SceneState, objects: &[Object]) -> Vec<Picture> {
    let boxed = detect::boxed(&state.photo, objects);
    let mut pictures = vec![Picture {
        caption: "IMAGE 1: the photo, boxed, with thousandths along its border".into(),
        image: Arc::new(grid_overlay(&boxed, 100).picture),
    }];
    for (i, c) in objects.iter().enumerate() {
        let Some(bounds) = c.mask.bounds() else { continue };
        let window = bounds.padded(0.12, state.partial.camera.size);
        pictures.push(Picture {
            caption: format!("IMAGE {}: {}", i + 2, c.id),
            image: Arc::new(ruled_window(&state.photo, window, CROP_PX)),
        });
    }
    pictures
}

/// The mesh of an object's program; a program that fails at this size gives way to the template, with a warning.
///
/// Its files are the caller's to write ([`Modelled::write`]), once it stays.
///
/// # Errors
/// Only that of a computation that broke.
pub async fn mesh(
    ctx: &PhaseCtx<'_>,
    id: &ObjectId,
    program: &Program,
    size: Size,
    state: &Arc<SceneState>,
) -> Result<Option<Modelled>, PhaseError> {
    let (shown, written) = (Arc::clone(state), program.clone());
    let made = ctx.computed(move || built(&written, size, &shown.photo)).await?;
    match made {
        Ok(built) => {
            for sign in lazy_signs(&built.shape, Some(size.as_vec())) {
                ctx.warn(WarningKind::AnswerRepaired, Some(id.clone()), format!("its program: {sign}"));
            }
            Ok(Some(modelled(built, program)))
        }
        Err(error) => {
            ctx.warn(WarningKind::PlayerReplaced, Some(id.clone()), format!("its program cannot be used: {error}"));
            Ok(None)
        }
    }
}

/// Builds the programs of a level anew at the sizes that its objects were placed with: proportions are the program's
/// business, and patterns, bevels and edges keep their scale.
///
/// # Errors
/// Unwritable files and computations that broke.
pub async fn refit(ctx: &PhaseCtx<'_>, state: &mut SceneState, ids: &[ObjectId]) -> Result<(), PhaseError> {
    for id in ids {
        let Some(placed) = state.partial.find(id) else { continue };
        let Some(program) = state.objects.get(id).and_then(|o| o.program().cloned()) else { continue };
        let change = placed.pose.stretch * placed.pose.scale;
        if (change - glam::DVec3::ONE).abs().max_element() < NO_CHANGE {
            continue;
        }
        let (size, level) = (placed.size(), placed.item.level);
        let shown = Arc::new(state.clone());
        let Some(made) = mesh(ctx, id, &program, size, &shown).await? else { continue };
        let (settings, wanted) = (ctx.settings.placement.clone(), id.clone());
        let refitted = ctx
            .computed(move || {
                let longest = size.as_vec().max_element();
                let shape = Shape::from_parts(Arc::clone(&made.mesh.mesh), made.mesh.convex.as_deref(), longest);
                let shape = Arc::new(shape);
                let outcome = reshape(&shown.partial, &wanted, Arc::clone(&shape), &settings)?;
                Ok::<_, harmony_placement::ActionError>((made, shape, outcome))
            })
            .await?;
        let Ok((made, shape, outcome)) = refitted else { continue };
        state.partial = outcome.scene;
        made.write(ctx, level, id, &program)?;
        adopt(state, id, made, shape, program);
    }
    Ok(())
}

/// Gives an object the shape that a program made.
pub fn adopt(state: &mut SceneState, id: &ObjectId, made: Modelled, shape: Arc<Shape>, program: Arc<Program>) {
    state.forget_look(id);
    if let Some(model) = state.objects.get_mut(id).and_then(|object| object.model.as_mut()) {
        *model = Model {
            moves: made.moves(),
            mesh: made.mesh.mesh,
            shape,
            part_model: None,
            program: Some(program),
            plain_slots: made.plain_slots,
            said_slots: made.said_slots,
            bulb: made.bulb,
            source: made.mesh.source,
            material: model.material,
        };
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Level, Support};

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn the_small_ones_of_a_set_get_the_program_of_the_largest() {
        let mut state = empty_room();
        let chair = |state: &mut SceneState, n: usize, z: f64, set: Option<&str>| {
            let (size, at) = (Vec3::splat(0.5), Vec3::new(0.8 + 0.7 * n as f64, 0.0, z));
            let id = add(state, &format!("chair_{n:02}"), Level::Furniture, size, at, Support::Floor);
            state.objects.get_mut(&id).unwrap().said.matched_set = set.map(str::to_owned);
            id
        };
        let near = chair(&mut state, 1, 3.2, Some("dining chairs"));
        let other = chair(&mut state, 2, 2.6, Some("dining chairs"));
        let far = chair(&mut state, 3, 0.8, Some("dining chairs"));
        let lone = chair(&mut state, 4, 0.8, None);
        let named = |name: &str| Program { source: name.to_owned(), params: BTreeMap::new() };
        let mut programs = BTreeMap::from([(near.clone(), named("near")), (other.clone(), named("other"))]);
        let objects: Vec<Object> = state.objects.values().cloned().collect();
        share(&objects, &mut programs);
        assert_eq!(programs.get(&far), Some(&named("near")));
        assert_eq!(programs.get(&other), Some(&named("other")), "what was answered stays");
        assert_eq!(programs.get(&lone), None);
    }
}
