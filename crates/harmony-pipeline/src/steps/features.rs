//! What is built into the room and is no object: modelled by programs in the frames of the room's faces.
//!
//! A border in the floor, mouldings on a wall, laths under the ceiling: part of the shell, so that views, exports and the
//! path tracer have them with the faces that they are on, and built anew when camera and room have changed, for a program
//! asks where the photo shows things. Nothing collides with them, and nothing stands on them.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use harmony_mesh::Mesh;
use harmony_program::Inputs;
use harmony_prompts::ProgramsAnswer;
use harmony_render::{Glass, Instance, RenderOptions, render_depth_ids};
use harmony_scene::{Camera, Extents, Mask, ObjectId, Size, Surface, WarningKind};
use harmony_shape::ShapeTree;
use harmony_shape::build::BuildContext;
use image::RgbImage;
use serde_json::json;

use super::prints;
use super::programs::{Program, evaluated, said_of};
use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// How far a feature may reach beyond its face, metres: a board ends in the wall beside it.
const BEYOND_M: f64 = 0.1;

/// Something that is built into the room.
#[derive(Debug, Clone)]
pub struct Feature {
    /// How its nodes, materials and files are called.
    pub name: String,
    /// The face that it is on.
    pub on: Surface,
    /// What models it, in that face's frame.
    pub program: Arc<Program>,
    /// Its mesh in the room's frame.
    pub mesh: Arc<Mesh>,
    /// The same in the photo's light.
    pub lit: Option<Arc<Mesh>>,
    /// Materials whose colour was said.
    pub said: Vec<String>,
}

impl Feature {
    /// The mesh to draw.
    pub fn shown(&self) -> &Arc<Mesh> {
        self.lit.as_ref().unwrap_or(&self.mesh)
    }
}

/// A feature's mesh in the room's frame, and its materials whose colour was said.
#[derive(Debug)]
pub struct BuiltFeature {
    mesh: Mesh,
    said: Vec<String>,
}

/// Builds a program of a feature on a face, its materials named after it.
///
/// # Errors
/// What is wrong with it, in words for whoever wrote it.
pub fn built(
    name: &str,
    on: Surface,
    program: &Program,
    (room, camera): (&Extents, &Camera),
    photo: &RgbImage,
) -> Result<BuiltFeature, String> {
    let inputs = inputs(on, room, camera);
    meshed(name, on, &evaluated(program, inputs.clone())?, &inputs, photo)
}

/// What a program is given that models on a face.
fn inputs(on: Surface, room: &Extents, camera: &Camera) -> Inputs {
    Inputs { size: Some(size_of(on, room)), ..Inputs::feature(*room, Some(*camera)).in_frame(on) }
}

/// The mesh of what a program made of its inputs.
fn meshed(
    name: &str,
    on: Surface,
    tree: &ShapeTree,
    inputs: &Inputs,
    photo: &RgbImage,
) -> Result<BuiltFeature, String> {
    let size = inputs.size.ok_or("no face was given")?;
    let to_room = inputs.room_from_program.map_or(DAffine3::IDENTITY, |[x, y, z, at]| DAffine3 {
        matrix3: DMat3::from_cols(x.into(), y.into(), z.into()),
        translation: at.into(),
    });
    let build = std::panic::AssertUnwindSafe(|| {
        let context = BuildContext { size: None, material: harmony_shape::material::material };
        let mut shape = tree.build(&context).map_err(|error| error.to_string())?;
        let printed = prints::lay(&mut shape, tree, photo, 1.0);
        Ok::<_, String>((shape, printed))
    });
    let (shape, printed) =
        std::panic::catch_unwind(build).unwrap_or_else(|_| Err("its shape cannot be meshed (a fault here)".into()))?;
    let mut mesh = shape.mesh;
    // The mesh stands on its own ground.
    mesh.map(|p| p - shape.origin.as_vec3(), |n| n);
    let bounds = mesh.bounds().ok_or("it has no part")?;
    within(&size, bounds.min, bounds.max)?;
    let own = |slot: &str| format!("{}{name}_{slot}", views::built_into(on));
    let said = said_of(tree, &printed).iter().map(|slot| own(slot)).collect();
    for material in &mut mesh.materials {
        material.name = own(&material.name);
    }
    let turn = to_room.matrix3.as_mat3();
    mesh.map(|p| to_room.transform_point3(p.as_dvec3()).as_vec3(), |n| turn * n);
    Ok(BuiltFeature { mesh, said })
}

/// A face's lengths along its frame, and the distance to the face across, metres.
fn size_of(on: Surface, room: &Extents) -> Size {
    let Extents { width: w, height: h, depth: d } = *room;
    let (width, height, depth) = match on {
        Surface::Back | Surface::Front => (w, h, d),
        Surface::Left | Surface::Right => (d, h, w),
        Surface::Floor | Surface::Ceiling => (w, d, h),
    };
    Size { width, height, depth }
}

/// Whether a feature lies within its face.
fn within(face: &Size, low: DVec3, high: DVec3) -> Result<(), String> {
    for (axis, (end, low, high)) in ["x", "y", "z"].into_iter().zip([
        (face.width, low.x, high.x),
        (face.height, low.y, high.y),
        (face.depth, low.z, high.z),
    ]) {
        if low < -BEYOND_M || high > end + BEYOND_M {
            return Err(format!(
                "along {axis} it reaches from {low:.2} to {high:.2} m, and its face from 0 to {end:.2} m: the origin is in a \
                 corner of the face"
            ));
        }
    }
    Ok(())
}

/// A name as files and nodes have it.
fn file_name(name: &str) -> String {
    let name = ObjectId::numbered(name, 1).to_string();
    name.strip_suffix("_01").unwrap_or(&name).to_owned()
}

/// Whether all features of an answer can be built.
///
/// # Errors
/// What is wrong with the first that cannot, by its name.
pub fn check(answer: &ProgramsAnswer, room: (&Extents, &Camera), photo: &RgbImage) -> Result<(), String> {
    let mut names = BTreeSet::new();
    for feature in &answer.features {
        let Some(source) = answer.program_of_feature(feature) else { continue };
        let program = Program { source: source.to_owned(), params: feature.params.clone() };
        let name = file_name(&feature.name);
        if !names.insert(name.clone()) {
            return Err(format!(
                "feature {:?}: another one has the same letters and figures in its name",
                feature.name
            ));
        }
        built(&name, feature.on.surface(), &program, room, photo)
            .map_err(|error| format!("feature {:?}: {error}", feature.name))?;
    }
    Ok(())
}

/// The features of an answer in the room as it is; one that cannot be built is left out with a warning.
///
/// # Errors
/// Computations that broke.
pub async fn of_answer(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    answer: &ProgramsAnswer,
) -> Result<Vec<Feature>, PhaseError> {
    let wanted: Vec<Feature> = answer
        .features
        .iter()
        .filter_map(|feature| {
            let source = answer.program_of_feature(feature)?.to_owned();
            Some(Feature {
                name: file_name(&feature.name),
                on: feature.on.surface(),
                program: Arc::new(Program { source, params: feature.params.clone() }),
                mesh: Arc::default(),
                lit: None,
                said: Vec::new(),
            })
        })
        .collect();
    let mut made = Vec::new();
    for feature in wanted {
        match anew(ctx, state, &feature).await? {
            Ok(feature) => made.push(feature),
            Err(error) => {
                ctx.warn(WarningKind::ObjectDropped, None, format!("{}, built into the room: {error}", feature.name));
            }
        }
    }
    Ok(made)
}

/// A feature built in the room as it is.
async fn anew(ctx: &PhaseCtx<'_>, state: &SceneState, old: &Feature) -> Result<Result<Feature, String>, PhaseError> {
    let (feature, photo) = (old.clone(), Arc::clone(&state.photo));
    let (room, camera) = (state.partial.room.extents, state.partial.camera);
    ctx.computed(move || {
        let BuiltFeature { mesh, said } = built(&feature.name, feature.on, &feature.program, (&room, &camera), &photo)?;
        Ok(Feature { mesh: Arc::new(mesh), said, lit: None, ..feature })
    })
    .await
}

/// Builds all features anew for the room and the camera as they are now; one that cannot be stays as it was.
///
/// # Errors
/// Computations that broke, unwritable files.
pub async fn refit(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    for i in 0..state.features.len() {
        match anew(ctx, state, &state.features[i]).await? {
            Ok(feature) => state.features[i] = feature,
            Err(error) => {
                let message = format!("{}: stays as it was built in the first room: {error}", state.features[i].name);
                ctx.warn(WarningKind::LowConfidence, None, message);
            }
        }
    }
    write(ctx, state)
}

/// Writes what is built into the room, and the programs.
fn write(ctx: &PhaseCtx<'_>, state: &SceneState) -> Result<(), PhaseError> {
    if state.features.is_empty() {
        return Ok(());
    }
    let rows: Vec<_> = state
        .features
        .iter()
        .map(|f| {
            let materials: Vec<&str> = f.mesh.materials.iter().map(|m| m.name.as_str()).collect();
            json!({ "name": f.name, "on": f.on, "params": f.program.params, "nodes": materials })
        })
        .collect();
    ctx.write_json_in(Phase::Layout, "features.json", &rows)?;
    for feature in &state.features {
        let name = format!("features/{}.program.py", feature.name);
        ctx.write_text_in(Phase::Layout, &name, &feature.program.source)?;
    }
    Ok(())
}

/// Pixels of the photo in which each feature is the nearest thing of the scene, and nothing that was found is seen.
pub fn pixels(state: &SceneState) -> Vec<Mask> {
    if state.features.is_empty() {
        return Vec::new();
    }
    let shell = views::shell_alone(state);
    let things =
        state.partial.placed.iter().filter_map(|placed| {
            Some(Instance::posed(state.mesh_of(&placed.item.id)?, &placed.pose, placed.item.index))
        });
    // Ids of features are such as no object has.
    let id_of = |k: usize| u32::MAX - 1 - k as u32;
    let own = state.features.iter().enumerate().map(|(k, f)| Instance::in_room(&f.mesh, id_of(k)));
    let all: Vec<Instance<'_>> = std::iter::once(Instance::in_room(&shell, 1)).chain(things).chain(own).collect();
    let options = RenderOptions { glass: Glass::Solid, ..RenderOptions::default() };
    let frame = render_depth_ids(&state.partial.camera, &all, &options);
    let covered = state.all_objects().or(&state.photo_frame);
    (0..state.features.len()).map(|k| frame.mask(id_of(k)).minus(&covered)).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::testing::empty_room;

    const BORDER: &str = r##"def build(w, h, d):
    dark = mat("dark", "#402810")
    near = box((w, 0.2, 0.002), mat=dark).at(w / 2, 0, 0.001)
    return group("border", near=near)
"##;

    fn program(source: &str) -> Program {
        Program { source: source.to_owned(), params: BTreeMap::new() }
    }

    fn build(state: &SceneState, on: Surface, source: &str) -> Result<BuiltFeature, String> {
        let inputs = inputs(on, &state.partial.room.extents, &state.partial.camera);
        // In this process: a test has no program beside it that could be its child.
        let tree = harmony_program::evaluate(source, &inputs, &harmony_program::Limits::default()).unwrap();
        meshed("border", on, &tree, &inputs, &state.photo)
    }

    #[test]
    fn a_border_in_the_floor_lies_along_the_near_wall_and_its_materials_are_named_after_it() {
        let state = empty_room();
        let Extents { width, depth, .. } = state.partial.room.extents;
        let made = build(&state, Surface::Floor, BORDER).unwrap();
        let bounds = made.mesh.bounds().unwrap();
        let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-4;
        assert!(near(bounds.min, DVec3::new(0.0, 0.0, depth - 0.2)), "{bounds:?}");
        assert!(near(bounds.max, DVec3::new(width, 0.002, depth)), "{bounds:?}");
        assert_eq!(made.said, ["feature_floor_border_dark"]);
        let up = made.mesh.normals.iter().filter(|n| n.y > 0.9).count();
        assert!(up >= 4, "its upper side looks into the room");
    }

    #[test]
    fn a_mark_stands_where_the_photo_shows_it() {
        let state = empty_room();
        let source = r#"def build(w, h, d):
    p = pixel(500, 400, wall("back"))
    return group("mark", dot=box((0.1, 0.1, 0.02)).at(p.x, p.y - 0.05, 0.01))
"#;
        let made = build(&state, Surface::Back, source).unwrap();
        let bounds = made.mesh.bounds().unwrap();
        let seen = state.partial.camera.project((bounds.min + bounds.max) / 2.0).unwrap();
        let size = state.partial.camera.size;
        assert!((seen.x / f64::from(size.width) - 0.5).abs() < 0.01, "{seen}");
        assert!((seen.y / f64::from(size.height) - 0.4).abs() < 0.01, "{seen}");
    }

    #[test]
    fn what_leaves_its_face_is_told_where_the_origin_is() {
        let state = empty_room();
        let source = BORDER.replace(".at(w / 2, 0, 0.001)", "");
        assert!(build(&state, Surface::Floor, &source).unwrap_err().contains("in a corner of the face"));
    }

    #[test]
    fn features_are_drawn_with_their_face_and_go_with_it() {
        let mut state = empty_room();
        let far = BORDER.replace(".at(w / 2, 0, 0.001)", ".at(w / 2, h - 0.5, 0.001)");
        let made = build(&state, Surface::Floor, &far).unwrap();
        state.features = vec![Feature {
            name: "border".to_owned(),
            on: Surface::Floor,
            program: Arc::new(program(&far)),
            mesh: Arc::new(made.mesh),
            lit: None,
            said: made.said,
        }];
        let names = |omit: Vec<Surface>| -> Vec<String> {
            views::shell(&state, omit).materials.into_iter().map(|m| m.name).collect()
        };
        assert!(names(Vec::new()).iter().any(|n| n == "feature_floor_border_dark"));
        assert!(!names(vec![Surface::Floor]).iter().any(|n| n == "feature_floor_border_dark"));
        let hidden =
            |omit| views::hidden_nodes(&[omit], &BTreeSet::new(), ["floor", "feature_floor_border_dark"].into_iter());
        assert_eq!(hidden(Surface::Floor), ["floor", "feature_floor_border_dark"]);
        assert_eq!(hidden(Surface::Ceiling), ["ceiling"]);
        let seen = pixels(&state);
        assert_eq!(seen.len(), 1);
        // Before the back wall, where the camera looks.
        let shown = DVec3::new(state.partial.room.extents.width / 2.0, 0.002, 0.4);
        let p = state.partial.camera.project(shown).unwrap();
        assert!(seen[0].get(p.x as i64, p.y as i64), "{p}");
    }
}
