//! A run folder as a [`World`]. Nothing in the folder is trusted.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use harmony_io::{LoadedGlb, ReadLimits, load_glb, read_json};
use harmony_mesh::{Group, Mesh, room_shell, shell_material_name};
use harmony_scene::{Camera, SCENE_VERSION, Scene, SceneObject, Support, Surface};

use super::{Face, Item, Looks, World};
use crate::ExportError;

/// Farthest that the two files may put a corner of an object apart, metres: numbers of a GLB file have seven digits.
const SAME_PLACE: f64 = 1e-3;
/// Sizes of rooms and things that are plausible at all, metres.
const PLAUSIBLE: [f64; 2] = [1e-4, 1e3];

impl World {
    /// Reads a finished run: `scene.json`, and `scene_full.glb` or (without it) the objects' meshes in a bare shell.
    ///
    /// # Errors
    /// [`ExportError`] that names the file, the object and the value.
    pub fn read(run: &Path) -> Result<Self, ExportError> {
        let path = run.join("scene.json");
        if !path.is_file() {
            return Err(ExportError::NoRun { run: run.to_owned(), missing: "scene.json" });
        }
        let scene: Scene = read_json(&path)?;
        check(&scene)?;
        let glb = run.join("scene_full.glb");
        let mut notes = Vec::new();
        let (shell, items) = if glb.is_file() {
            let loaded = load_glb(&glb, &ReadLimits::default())
                .map_err(|source| ExportError::Glb { file: "scene_full.glb".to_owned(), source })?;
            from_scene_glb(run, &scene, loaded, &mut notes)?
        } else {
            notes.push("scene_full.glb is not there: the room's faces are plain and have no boards".to_owned());
            (bare_shell(&scene), from_meshes(run, &scene)?)
        };
        Ok(Self::new(scene, shell, items, notes))
    }

    /// A world of a scene with its meshes.
    pub fn new(scene: Scene, shell: Vec<Face>, items: Vec<Item>, notes: Vec<String>) -> Self {
        let faces = shell.iter().map(|f| (f.name.as_str(), &f.mesh));
        let looks = Looks::of(faces.chain(items.iter().map(|i| (i.name(), &i.mesh))));
        let camera = Camera::from(&scene.camera);
        Self { scene, camera, shell, items, looks, notes }
    }
}

/// Checks what later steps take for granted.
fn check(scene: &Scene) -> Result<(), ExportError> {
    if scene.version != SCENE_VERSION {
        return Err(ExportError::Version { found: scene.version, known: SCENE_VERSION });
    }
    let bad = |what, of: &str, value: String| Err(ExportError::Value { what, of: of.to_owned(), value });
    let plausible = |v: f64| v.is_finite() && (PLAUSIBLE[0]..=PLAUSIBLE[1]).contains(&v);
    let e = scene.room.extents;
    for (what, value) in [("the width", e.width), ("the height", e.height), ("the depth", e.depth)] {
        if !plausible(value) {
            return bad(what, "the room", value.to_string());
        }
    }
    for opening in &scene.room.openings {
        let ranges = [opening.u, opening.y];
        if ranges
            .iter()
            .any(|[a, b]| !(a.is_finite() && b.is_finite() && a <= b && a.abs().max(b.abs()) < PLAUSIBLE[1]))
        {
            return bad("an opening's range", surface_name(opening.wall.surface()), format!("{ranges:?}"));
        }
    }
    let k = scene.camera.intrinsics;
    let camera = Camera::from(&scene.camera);
    if !(k.fx > 0.0 && k.fy > 0.0 && [k.fx, k.fy, k.cx, k.cy].iter().all(|v| v.is_finite())) {
        return bad("the focal length", "the camera", format!("{} x {}", k.fx, k.fy));
    }
    if !((camera.rotation.determinant() - 1.0).abs() < 1e-3 && camera.centre().is_finite()) {
        return bad("the rotation's determinant", "the camera", camera.rotation.determinant().to_string());
    }
    let mut ids = BTreeSet::new();
    for object in &scene.objects {
        let id = object.id.as_str();
        if !ids.insert(id) {
            return Err(ExportError::Twice { object: id.to_owned() });
        }
        let p = &object.pose;
        if !(p.position.is_finite() && p.position.abs().max_element() <= PLAUSIBLE[1]) {
            return bad("the position", id, format!("{:?}", p.position.to_array()));
        }
        if !p.yaw.is_finite() {
            return bad("the yaw", id, p.yaw.to_string());
        }
        let scale = p.stretch * p.scale;
        if !(scale.is_finite() && scale.min_element() > 1e-9 && scale.max_element() < 1e9) {
            return bad("the scale", id, format!("{:?}", scale.to_array()));
        }
    }
    let lighting = &scene.lighting;
    for light in &lighting.lights {
        let numbers = light.position.iter().chain(&light.color).chain([&light.intensity]);
        if let Some(v) = numbers.into_iter().find(|v| !v.is_finite() || v.abs() > 1e9) {
            return bad("a number", &format!("light {}", light.id.chars().take(60).collect::<String>()), v.to_string());
        }
    }
    Ok(())
}

fn surface_name(surface: Surface) -> &'static str {
    shell_material_name(surface)
}

/// Objects and shell of `scene_full.glb`, compared with `scene.json`.
fn from_scene_glb(
    run: &Path,
    scene: &Scene,
    glb: LoadedGlb,
    notes: &mut Vec<String>,
) -> Result<(Vec<Face>, Vec<Item>), ExportError> {
    notes.extend(glb.notes.iter().take(20).map(|n| format!("scene_full.glb: {n}")));
    let objects: BTreeSet<&str> = scene.objects.iter().map(|o| o.id.as_str()).collect();
    let mut by_name = BTreeMap::new();
    let mut shell = Vec::new();
    for node in glb.nodes {
        if objects.contains(node.name.as_str()) {
            by_name.insert(node.name.clone(), node);
        } else {
            let mut mesh = (*node.mesh).clone();
            if node.transform != glam::DAffine3::IDENTITY {
                let linear = node.transform.matrix3;
                mesh.map(
                    |p| node.transform.transform_point3(p.as_dvec3()).as_vec3(),
                    |n| (linear * n.as_dvec3()).as_vec3(),
                );
            }
            mesh.colors.clear();
            let mut name = super::looks::identifier(&node.name);
            while shell.iter().any(|f: &Face| f.name == name) || objects.contains(name.as_str()) {
                name.push('_');
            }
            shell.push(Face { name, mesh: Arc::new(mesh) });
        }
    }
    let mut items = Vec::new();
    for object in &scene.objects {
        let missing = || ExportError::NoMesh { object: object.id.to_string(), file: "scene_full.glb".to_owned() };
        let node = by_name.get(object.id.as_str()).ok_or_else(missing)?;
        let item = item(run, object, Arc::clone(&node.mesh))?;
        let bounds = node.mesh.bounds().ok_or_else(missing)?;
        let apart = [bounds.min, bounds.max, DVec3::new(bounds.min.x, bounds.max.y, bounds.min.z)]
            .into_iter()
            .map(|p| (object.pose.point(p) - node.transform.transform_point3(p)).length())
            .fold(0.0, f64::max);
        if apart > SAME_PLACE {
            return Err(ExportError::Moved { object: object.id.to_string(), apart });
        }
        if let Support::Object { id } = &object.support
            && !objects.contains(id.as_str())
        {
            notes.push(format!("{} rests on {id}, which is not in the scene", object.id));
        }
        items.push(item);
    }
    Ok((shell, items))
}

fn item(run: &Path, object: &SceneObject, mesh: Arc<Mesh>) -> Result<Item, ExportError> {
    mesh.check().map_err(|source| ExportError::Glb {
        file: object.mesh.clone(),
        source: harmony_io::GlbError::Mesh { node: object.id.to_string(), source },
    })?;
    // Beside the mesh of a program; a folder from elsewhere may have none.
    let file = run.join(object.level.folder()).join("meshes").join(format!("{}.joints.json", object.id));
    let moving =
        if file.is_file() && object.mesh_source.starts_with("program") { read_json(&file)? } else { Vec::new() };
    Ok(Item::moving(object.clone(), mesh, moving))
}

/// Each object's own file; equal paths are read once.
fn from_meshes(run: &Path, scene: &Scene) -> Result<Vec<Item>, ExportError> {
    scene
        .objects
        .iter()
        .map(|object| {
            let relative = Path::new(&object.mesh);
            let plain = relative.components().all(|c| matches!(c, std::path::Component::Normal(_)));
            let path = run.join(relative);
            if !plain || !path.is_file() {
                return Err(ExportError::NoMesh { object: object.id.to_string(), file: object.mesh.clone() });
            }
            let mesh = harmony_io::load_mesh_glb(&path, &ReadLimits::default())
                .map_err(|source| ExportError::Glb { file: object.mesh.clone(), source })?;
            item(run, object, Arc::new(mesh))
        })
        .collect()
}

/// The room's faces without textures.
fn bare_shell(scene: &Scene) -> Vec<Face> {
    let shell = room_shell(&scene.room, &|_| None);
    shell
        .groups
        .iter()
        .filter(|group| !group.triangles.is_empty())
        .map(|group| {
            let material = shell.materials[group.material].clone();
            let name = material.name.clone();
            let mut place: BTreeMap<u32, u32> = BTreeMap::new();
            let mut mesh = Mesh { materials: vec![material], ..Mesh::default() };
            let triangles = group
                .triangles
                .iter()
                .map(|t| {
                    t.map(|i| {
                        *place.entry(i).or_insert_with(|| {
                            mesh.positions.push(shell.positions[i as usize]);
                            mesh.normals.push(shell.normals[i as usize]);
                            mesh.uvs.push(shell.uvs[i as usize]);
                            mesh.positions.len() as u32 - 1
                        })
                    })
                })
                .collect();
            mesh.groups = vec![Group { material: 0, triangles }];
            Face { name, mesh: Arc::new(mesh) }
        })
        .collect()
}
