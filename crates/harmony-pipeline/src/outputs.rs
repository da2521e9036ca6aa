//! The files of a finished (or broken off) run: scene, GLB, renders, the paper's annotations (key `data.objects`), the
//! report's data.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use harmony_calls::CallSummary;
use harmony_catalogue::light_slot;
use harmony_io::{
    GlbNode, GlbScene, NodeTransform, Segment, glb::TextureEncoding, picture, save_segmentation, write_json,
};
use harmony_mesh::{Material, Mesh};
use harmony_scene::{
    ImageSize, Lighting, Mask, ObjectId, Pose, SCENE_VERSION, Scene, SceneCamera, SceneObject, Surface, Warning,
};
use harmony_viewer::{CallRow, DroppedObject, Evidence, Fact, ObjectReport, ReportData};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::ctx::PhaseError;
use crate::relight::LitPictures;
use crate::state::SceneState;
use crate::views;

/// Name and version in files.
pub const GENERATOR: &str = concat!("harmony ", env!("CARGO_PKG_VERSION"));

/// The objects in scene order.
pub fn scene_objects(state: &SceneState) -> Vec<SceneObject> {
    state
        .partial
        .placed
        .iter()
        .filter_map(|placed| {
            let object = state.objects.get(&placed.item.id)?;
            let model = object.model.as_ref()?;
            let level = placed.item.level;
            Some(SceneObject {
                id: placed.item.id.clone(),
                index: placed.item.index,
                level,
                label: placed.item.label.clone(),
                description: object.said.description.clone(),
                source_phrase: object.detection.phrase.clone(),
                pose: Pose { yaw: half_turn(placed.pose.yaw), ..placed.pose },
                size: placed.size(),
                support: placed.support.clone(),
                relations: placed.item.relations.clone(),
                material: model.material,
                mesh: format!("{}/meshes/{}.glb", level.folder(), placed.item.id),
                mask: Some(format!("{}/masks/{}.png", level.folder(), placed.item.id)),
                seen_box: object.mask.bounds(),
                mesh_source: model.source.clone(),
                confidence: placed.confidence(),
            })
        })
        .collect()
}

/// A yaw as people read it: within half a turn.
fn half_turn(yaw: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if yaw > -PI && yaw <= PI { yaw } else { PI - (PI - yaw).rem_euclid(TAU) }
}

/// The scene as `scene.json` holds it. The camera speaks about the photo's original size.
pub fn scene(state: &SceneState, original: ImageSize, warnings: &[Warning]) -> Scene {
    Scene {
        version: SCENE_VERSION,
        generator: GENERATOR.to_owned(),
        room: state.partial.room.clone(),
        camera: SceneCamera::from(&state.partial.camera.resized(original)),
        objects: scene_objects(state),
        lighting: state.lighting.clone().unwrap_or(Lighting {
            lights: Vec::new(),
            ambient_color: [1.0; 3],
            ambient_intensity: 1.0,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::Standard,
        }),
        summary: state.summaries.join(" "),
        warnings: warnings.to_vec(),
    }
}

/// Writes everything that lies at the top of a run folder, but for `run.json` and `report.html`.
///
/// # Errors
/// Unwritable files.
pub fn write(
    run: &Path,
    state: &SceneState,
    original: ImageSize,
    lit: Option<&LitPictures>,
    warnings: &[Warning],
) -> Result<Scene, PhaseError> {
    let scene = scene(state, original, warnings);
    write_json(&run.join("scene.json"), &scene)?;
    write_json(&run.join("camera.json"), &camera_json(state, &scene))?;
    write_json(&run.join("objects.json"), &objects_json(&scene))?;
    let (meshes, pictures) =
        rayon::join(|| write_meshes(run, state, &scene), || write_pictures(run, state, original, lit, &scene));
    meshes.and(pictures)?;
    Ok(scene)
}

/// Every object as placed things are drawn, and the scene of them.
fn write_meshes(run: &Path, state: &SceneState, scene: &Scene) -> Result<(), PhaseError> {
    // Textures are compressed here, each on a core of its own.
    scene.objects.par_iter().try_for_each(|object| {
        let Some(mesh) = state.mesh_of(&object.id) else { return Ok(()) };
        let mesh = Arc::new(with_material(mesh, object, is_said(state, object)));
        harmony_io::glb::write_mesh_glb(&run.join(&object.mesh), object.id.as_str(), mesh, Value::Null)
    })?;
    write_scene_glb(&run.join("scene_full.glb"), state, Some(scene))
}

fn write_pictures(
    run: &Path,
    state: &SceneState,
    original: ImageSize,
    lit: Option<&LitPictures>,
    scene: &Scene,
) -> Result<(), PhaseError> {
    let drawn = views::drawn(state);
    picture::write_rgb_png(&run.join("render_flat.png"), &drawn.flat)?;
    let view = views::canonical(state, ImageSize::new(1280, 960));
    let canonical = views::scene_from(state, &view.camera, view.omit);
    picture::write_rgb_png(&run.join("render_canonical.png"), &canonical)?;
    if let Some(lit) = lit {
        picture::write_rgb_png(&run.join("render_lit.png"), &lit.photo_view)?;
        if let Some(canonical) = &lit.canonical {
            picture::write_rgb_png(&run.join("render_lit_canonical.png"), canonical)?;
        }
    }
    // The pixels that each has in the end: a swap exchanged them, a copy has none, all may have changed since detection.
    scene.objects.par_iter().try_for_each(|object| match (state.objects.get(&object.id), &object.mask) {
        (Some(known), Some(file)) => harmony_io::save_mask(&run.join(file), &known.mask),
        _ => Ok(()),
    })?;
    let masks: Vec<(ObjectId, Mask)> = scene
        .objects
        .par_iter()
        .filter_map(|o| Some((o.id.clone(), state.visible_mask(&o.id, &drawn.ids)?.resized(original))))
        .collect();
    let segments: Vec<Segment<'_>> = scene
        .objects
        .iter()
        .filter_map(|object| masks.iter().find(|(id, _)| *id == object.id).map(|(_, mask)| Segment { object, mask }))
        .collect();
    Ok(save_segmentation(run, original, &segments)?)
}

/// The whole scene as GLB: shell, objects, camera, lights.
///
/// # Errors
/// Unwritable files.
pub fn write_scene_glb(path: &Path, state: &SceneState, scene: Option<&Scene>) -> Result<(), PhaseError> {
    let objects = scene.map_or_else(|| scene_objects(state), |s| s.objects.clone());
    let nodes = objects
        .iter()
        .filter_map(|object| {
            let mut mesh = with_material(state.mesh_of(&object.id)?, object, is_said(state, object));
            if scene.is_none() {
                // What is path-traced gets real light, and mirrors mirror.
                mesh.colors.clear();
                let model = state.objects.get(&object.id).and_then(|o| o.model.as_ref());
                if let Some(model) = model {
                    mirror_again(&mut mesh, &model.mesh);
                }
            }
            Some(GlbNode {
                name: object.id.to_string(),
                mesh: Arc::new(mesh),
                transform: NodeTransform {
                    translation: object.pose.position,
                    yaw: object.pose.yaw,
                    scale: object.pose.stretch * object.pose.scale,
                },
                extras: json!({
                    "id": object.id, "label": object.label, "level": object.level, "description": object.description,
                    "size_m": object.size, "support": object.support, "relations": object.relations,
                    "material": object.material, "confidence": object.confidence, "mesh_source": object.mesh_source,
                    "index": object.index,
                }),
            })
        })
        .collect();
    let shell = if scene.is_some() { views::shell(state, Vec::new()) } else { views::shell_for_light(state) };
    let glb = GlbScene {
        objects: nodes,
        shell: shell_nodes(&shell),
        camera: Some(state.partial.camera),
        lighting: state.lighting.as_ref(),
        // What is path-traced gets real bounces.
        glow: if scene.is_some() { harmony_io::glb::AMBIENT_GLOW } else { 0.0 },
        extras: json!({
            "generator": GENERATOR,
            "room": state.partial.room,
            "frame": "right-handed, +X width, +Y up, +Z from the back wall to the viewer, metres",
        }),
        generator: GENERATOR.to_owned(),
        textures: TextureEncoding::Compact,
    };
    Ok(harmony_io::write_glb(&glb, path)?)
}

/// The shell, one node a face.
pub fn shell_nodes(shell: &Mesh) -> Vec<GlbNode> {
    shell
        .groups
        .iter()
        .filter(|group| !group.triangles.is_empty())
        .map(|group| {
            let mut used: BTreeMap<u32, u32> = BTreeMap::new();
            for i in group.triangles.iter().flatten() {
                let next = used.len() as u32;
                used.entry(*i).or_insert(next);
            }
            let mut old: Vec<u32> = vec![0; used.len()];
            for (from, to) in &used {
                old[*to as usize] = *from;
            }
            let material = shell.materials[group.material].clone();
            let name = material.name.clone();
            let mesh = Mesh {
                positions: old.iter().map(|i| shell.positions[*i as usize]).collect(),
                normals: old.iter().map(|i| shell.normals[*i as usize]).collect(),
                uvs: old.iter().map(|i| shell.uvs[*i as usize]).collect(),
                metric_uvs: old.iter().filter_map(|i| shell.metric_uvs.get(*i as usize).copied()).collect(),
                colors: if is_lit(shell, &old) {
                    old.iter().map(|i| shell.colors[*i as usize]).collect()
                } else {
                    Vec::new()
                },
                groups: vec![harmony_mesh::Group {
                    material: 0,
                    triangles: group.triangles.iter().map(|t| t.map(|i| used[&i])).collect(),
                }],
                materials: vec![material],
            };
            GlbNode {
                name: name.clone(),
                mesh: Arc::new(mesh),
                transform: NodeTransform::IDENTITY,
                extras: json!({ "surface": name }),
            }
        })
        .collect()
}

/// Whether vertices of the shell have colours of their own: those of faces are all white.
fn is_lit(shell: &Mesh, vertices: &[u32]) -> bool {
    vertices.iter().any(|i| shell.colors.get(*i as usize).is_some_and(|color| *color != [1.0; 3]))
}

/// Metalness that a surface with the photo's pixels has at most: its reflections are in the pixels already, and a white
/// surface that mirrors the room takes the room's colour.
const PICTURED_METAL: f32 = 0.35;
/// Roughness that it has at least.
const PICTURED_ROUGHNESS: f32 = 0.25;

/// The object's PBR factors on its mesh, slot by slot.
///
/// Part models name their slots' materials. The answer is about the dominant material: it goes to a mesh of one slot and
/// to slots of its own kind, metal or not, so that a door does not turn metallic with its handle, nor the handle wooden.
/// Glass and light sources keep what their slot says, and so do all slots of a program (`said`), which says it of each: a
/// bed's cover does not get the gloss of its leather.
fn with_material(mesh: &Arc<Mesh>, object: &SceneObject, said: bool) -> Mesh {
    let mut mesh = (**mesh).clone();
    let emitting = light_slot(&object.label);
    let pbr = object.material.pbr;
    let one_slot = mesh.materials.len() == 1;
    for material in &mut mesh.materials {
        if material.transmission > 0.0 || Some(material.name.as_str()) == emitting {
            continue;
        }
        if one_slot && !said {
            material.metallic = pbr.metallic as f32;
        }
        let alike = one_slot || (material.metallic > 0.5) == (pbr.metallic > 0.5);
        if alike && !said {
            material.roughness = pbr.roughness as f32;
            material.ior = pbr.ior as f32;
        }
        if material.texture.is_some() {
            material.metallic = material.metallic.min(PICTURED_METAL);
            material.roughness = material.roughness.max(PICTURED_ROUGHNESS);
        } else if material.metallic <= 0.5 && !said {
            // A photo texture on clear glass would vanish: only plain slots of a glass object become clear.
            material.transmission = pbr.transmission as f32;
        }
    }
    mesh
}

/// Takes what the photo shows in mirrors off them.
fn mirror_again(mesh: &mut Mesh, bare: &Mesh) {
    let glasses: Vec<&Material> =
        bare.materials.iter().enumerate().filter(|(k, _)| bare.is_looking_glass(*k)).map(|(_, m)| m).collect();
    for material in &mut mesh.materials {
        if let Some(own) = glasses.iter().find(|m| m.name == material.name) {
            *material = (*own).clone();
        }
    }
}

/// Whether a program says what each slot is made of.
fn is_said(state: &SceneState, object: &SceneObject) -> bool {
    state.objects.get(&object.id).is_some_and(|o| o.program().is_some())
}

fn camera_json(state: &SceneState, scene: &Scene) -> Value {
    let c = &scene.camera;
    let camera = harmony_scene::Camera::from(c);
    json!({
        "convention": "OpenCV; x_cam = R x_room + t; the centre of the top-left pixel is (0.5, 0.5)",
        "width": c.size.width, "height": c.size.height,
        "K": [[c.intrinsics.fx, 0.0, c.intrinsics.cx], [0.0, c.intrinsics.fy, c.intrinsics.cy], [0.0, 0.0, 1.0]],
        "R": c.rotation, "t": c.translation, "centre": c.centre,
        "horizontal_fov_deg": camera.horizontal_fov().to_degrees(),
        "pitch_down_deg": (-camera.forward().y).clamp(-1.0, 1.0).asin().to_degrees(),
        "yaw_left_deg": (-camera.forward().x).atan2(-camera.forward().z).to_degrees(),
        "room_m": scene.room.extents,
        "method": state.layout.method, "confidence": state.layout.confidence, "because": state.layout.because,
        "evidence": state.layout.evidence,
    })
}

/// The paper's third annotation file: size, world position, wall affinity and relations of each object.
pub fn objects_json(scene: &Scene) -> Value {
    let rows: Vec<Value> = scene
        .objects
        .iter()
        .map(|o| {
            json!({
                "id": o.id, "type": o.label, "stage": o.level.stage(), "size_m": o.size,
                "position_m": o.pose.position.to_array(), "yaw_deg": o.pose.yaw.to_degrees(),
                "wall_affinity": o.relations.wall_affinity, "support": o.support,
                "facing": o.relations.facing_toward, "in_front_of": o.relations.in_front_of,
                "behind": o.relations.behind, "on_top_of": o.relations.on_top_of,
                "grouped_with": o.relations.group, "matched_set": o.relations.matched_set,
                "joined_row": o.relations.joined_row,
                "confidence": o.confidence.overall,
            })
        })
        .collect();
    json!({ "objects": rows })
}

/// What the report says beside the scene.
pub fn report_data(state: &SceneState, scene: &Scene, log: &[CallSummary], run: &Path) -> ReportData {
    let e = scene.room.extents;
    let camera = harmony_scene::Camera::from(&scene.camera);
    let exists = |path: String| run.join(&path).is_file().then_some(path);
    let objects = scene
        .objects
        .iter()
        .map(|o| {
            let folder = o.level.folder();
            let placed = state.partial.find(&o.id);
            let c = &o.confidence;
            let mut because = Vec::new();
            if let Some(iou) = c.silhouette_iou {
                because.push(format!("outline agreement {iou:.2}"));
            }
            if let Some(residual) = c.depth_residual_m {
                because.push(format!("depth residual {:.0} mm", residual * 1000.0));
            }
            if let Some(p) = placed {
                if p.evidence.penetration_m > 0.005 {
                    because.push(format!("penetrates a neighbour by {:.0} mm", p.evidence.penetration_m * 1000.0));
                }
                if p.evidence.size_log_ratio.abs() > 0.25 {
                    because.push(format!("{:.0} % of the expected size", p.evidence.size_log_ratio.exp() * 100.0));
                }
            }
            if c.detection.is_none() {
                because.push("the detector gave no score".to_owned());
            }
            let report = ObjectReport {
                crop: exists(format!("{folder}/crops/{}.png", o.id)),
                completed: exists(format!("{folder}/completed/{}.png", o.id)),
                mesh_view: exists(format!("{folder}/meshes/{}.png", o.id)),
                confidence_because: because.join(", "),
                facts: vec![Fact::new("mesh", o.mesh_source.clone())],
            };
            (o.id.clone(), report)
        })
        .collect();
    ReportData {
        objects,
        calls: log.iter().map(call_row).collect(),
        dropped: state
            .left
            .iter()
            .map(|left| DroppedObject {
                label: left.name.clone(),
                phase: left.phase.to_string(),
                reason: left.reason.to_string(),
            })
            .collect(),
        room: Evidence {
            method: state.layout.method.clone(),
            confidence: state.layout.confidence,
            because: state.layout.because.clone(),
            facts: vec![
                Fact::new("type", scene.room.room_type.clone()),
                Fact::new("size W x D x H", format!("{:.2} x {:.2} x {:.2} m", e.width, e.depth, e.height)),
                Fact::new(
                    "faces seen",
                    scene.room.seen.iter().map(|s: &Surface| s.name()).collect::<Vec<_>>().join(", "),
                ),
            ],
        },
        camera: Evidence {
            method: state.layout.method.clone(),
            confidence: state.layout.confidence,
            because: state.layout.because.clone(),
            facts: vec![
                Fact::new("horizontal field of view", format!("{:.1} deg", camera.horizontal_fov().to_degrees())),
                Fact::new("height", format!("{:.2} m", camera.centre().y)),
                Fact::new(
                    "position",
                    format!(
                        "({:.2}, {:.2}, {:.2}) m",
                        scene.camera.centre[0], scene.camera.centre[1], scene.camera.centre[2]
                    ),
                ),
            ],
        },
        ..ReportData::default()
    }
}

fn call_row(c: &CallSummary) -> CallRow {
    CallRow {
        name: c.name.clone(),
        role: c.role.folder().to_owned(),
        player: format!("{} / {}", c.player, c.model),
        seconds: c.timing.latency_ms as f64 / 1000.0,
        tokens_in: c.usage.input_tokens,
        tokens_out: c.usage.output_tokens,
        cost_usd: c.usage.cost_usd,
        tries: c.tries as u32,
        from_record: matches!(c.source, harmony_calls::Source::Recording { .. }),
        problem: match &c.source {
            harmony_calls::Source::Replaced { reason } => format!("replaced by this program: {reason}"),
            _ => String::new(),
        },
    }
}

#[cfg(test)]
mod tests {

    use harmony_scene::{
        Confidence, Level, MaterialCategory, PbrFactors, Physical, Pose, Relations, Size, Support, SurfaceMaterial,
    };
    use image::RgbaImage;

    use super::*;
    use crate::testing::{add, empty_room};

    fn door(pbr: PbrFactors) -> SceneObject {
        let physical = Physical { weight_kg: 20.0, thickness_m: 0.04, elasticity: 0.1, rigid: None };
        SceneObject {
            id: ObjectId::numbered("door", 1),
            index: 10,
            level: Level::Wall,
            label: "door".into(),
            description: String::new(),
            source_phrase: String::new(),
            pose: Pose::new(glam::DVec3::ZERO, 0.0, 1.0),
            size: Size { width: 0.9, height: 2.0, depth: 0.05 },
            support: Support::Floor,
            relations: Relations::default(),
            material: SurfaceMaterial { category: MaterialCategory::Metal, pbr, physical },
            mesh: String::new(),
            mask: None,
            seen_box: None,
            mesh_source: String::new(),
            confidence: Confidence::default(),
        }
    }

    #[test]
    fn a_looking_glass_that_shows_the_photo_mirrors_again_for_the_path_tracer() {
        let sheet = |thin: f32| Mesh {
            positions: vec![
                glam::Vec3::ZERO,
                glam::Vec3::X,
                glam::Vec3::new(1.0, 1.0, 0.0),
                glam::Vec3::new(0.0, 1.0, thin),
            ],
            groups: vec![harmony_mesh::Group { material: 0, triangles: vec![[0, 1, 2], [0, 2, 3]] }],
            materials: vec![Material { metallic: 1.0, roughness: 0.03, ..Material::plain("glass", [0.9; 3]) }],
            ..Mesh::default()
        };
        let bare = sheet(0.0);
        let mut shown = bare.clone();
        (shown.materials[0].texture, shown.materials[0].base_color) = (Some(Arc::new(RgbaImage::new(2, 2))), [1.0; 4]);
        mirror_again(&mut shown, &bare);
        assert!(shown.materials[0].texture.is_none() && shown.materials[0].base_color[0] < 1.0);
        let mut steel = sheet(0.0);
        steel.materials[0].roughness = 0.3;
        assert!(!steel.is_looking_glass(0), "brushed");
    }

    #[test]
    fn a_door_with_a_metal_handle_does_not_turn_metallic() {
        let steel = PbrFactors { roughness: 0.2, metallic: 1.0, ior: 1.5, transmission: 0.0 };
        let mut leaf = Material::plain("body", [0.9; 3]);
        leaf.roughness = 0.55;
        let mut handle = Material::plain("handle", [0.6; 3]);
        handle.metallic = 1.0;
        let mesh = Arc::new(Mesh { materials: vec![leaf.clone(), handle], ..Mesh::default() });
        let made = with_material(&mesh, &door(steel), false);
        let said = with_material(&mesh, &door(PbrFactors { roughness: 0.3, ..steel }), true);
        let of = |mesh: &Mesh| mesh.materials.iter().map(|m| (m.roughness, m.metallic, m.ior)).collect::<Vec<_>>();
        assert_eq!(of(&said), of(&mesh), "a program says it of each slot");
        assert_eq!((made.materials[0].metallic, made.materials[0].roughness), (0.0, 0.55));
        assert_eq!((made.materials[1].metallic, made.materials[1].roughness), (1.0, 0.2));
        // A generator's one material with the photo on it: it would mirror the room instead.
        leaf.texture = Some(Arc::new(RgbaImage::new(2, 2)));
        let one = with_material(&Arc::new(Mesh { materials: vec![leaf], ..Mesh::default() }), &door(steel), false);
        assert!(one.materials[0].metallic <= PICTURED_METAL && one.materials[0].roughness >= PICTURED_ROUGHNESS);
    }

    #[test]
    fn yaws_are_written_within_half_a_turn() {
        use std::f64::consts::PI;
        for (yaw, wanted) in [(0.5, 0.5), (PI, PI), (-PI, PI), (1.5 * PI, -0.5 * PI), (-5.0 * PI - 0.25, PI - 0.25)] {
            assert!((half_turn(yaw) - wanted).abs() < 1e-12, "{yaw}: {}", half_turn(yaw));
        }
    }

    #[test]
    fn a_scene_has_what_was_modelled_and_speaks_of_the_photo_as_it_was() {
        let mut state = empty_room();
        let at = glam::DVec3::new(2.0, 0.0, 2.0);
        let chair = add(&mut state, "chair_01", Level::Furniture, glam::DVec3::splat(0.5), at, Support::Floor);
        let other = add(&mut state, "stool_01", Level::Furniture, glam::DVec3::splat(0.4), at, Support::Floor);
        state.objects.get_mut(&other).unwrap().model = None;
        let original = ImageSize::new(3200, 2400);
        let scene = scene(&state, original, &[]);
        assert_eq!(scene.objects.iter().map(|o| &o.id).collect::<Vec<_>>(), [&chair]);
        assert_eq!(scene.objects[0].mesh, format!("{}/meshes/chair_01.glb", Level::Furniture.folder()));
        assert_eq!(scene.camera.size, original);
        let fx = state.partial.camera.intrinsics.fx;
        assert!((harmony_scene::Camera::from(&scene.camera).intrinsics.fx - 10.0 * fx).abs() < 1e-6);
    }

    #[test]
    fn the_files_of_a_run_are_there_and_lit_pictures_only_where_somebody_traced() {
        let mut state = empty_room();
        let at = glam::DVec3::new(2.0, 0.0, 2.0);
        add(&mut state, "chair_01", Level::Furniture, glam::DVec3::splat(0.5), at, Support::Floor);
        let size = state.partial.camera.size;
        let lit = LitPictures { photo_view: image::RgbImage::new(size.width, size.height), canonical: None };
        for (lit, there) in [(None, false), (Some(&lit), true)] {
            let run = tempfile::tempdir().unwrap();
            write(run.path(), &state, size, lit, &[]).unwrap();
            let is = |path: &str| run.path().join(path).is_file();
            for path in ["scene.json", "camera.json", "objects.json", "scene_full.glb", "segmentation.png"] {
                assert!(is(path), "{path}");
            }
            assert!(is("render_flat.png") && is("render_canonical.png"));
            assert!(is(&format!("{}/meshes/chair_01.glb", Level::Furniture.folder())));
            assert_eq!((is("render_lit.png"), is("render_lit_canonical.png")), (there, false));
        }
    }
}
