//! Programs that leave one scene file: the paper's release, MIDI-3D, SceneGen, VIGA's export, anything else.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use harmony_bench::ply::parse_ply;
use harmony_io::read_bounded;
use harmony_scene::{ImageSize, Intrinsics};

use super::frames::{Axes, baked};
use super::splat::points_mesh;
use super::{Frame, Part, PartKind, RivalError, RivalKind, RivalOptions, RivalScene, Unit, camera, files, glb};

/// Largest PLY or OBJ that is read, bytes.
const MAX_BYTES: u64 = 1 << 30;

fn layout(kind: RivalKind, folder: &Path, reason: impl Into<String>) -> RivalError {
    RivalError::Layout { kind, folder: folder.to_owned(), reason: reason.into() }
}

/// `scene_full.glb` and `camera_vggt.json` of the paper's release; its room frame is ours.
pub fn release(folder: &Path) -> Result<RivalScene, RivalError> {
    let kind = RivalKind::HarmonyRelease;
    let all = files::below(folder);
    let scene =
        files::named(&all, &["scene_full.glb", "scene_full_with_ceiling.glb", "scene_with_furniture.glb", "scene.glb"]);
    let scene = scene.ok_or_else(|| layout(kind, folder, "no scene_full.glb"))?;
    let mut notes = Vec::new();
    let parts = glb::parts(&scene, DMat3::IDENTITY, &mut notes)?;
    let mut read = vec![scene];
    let camera = files::named(&all, &["camera_vggt.json", "camera.json"]);
    let camera = camera
        .map(|path| {
            read.push(path.clone());
            camera::sidecar(&path, None)
        })
        .transpose()?;
    notes
        .push("its textures were made with a two-point perspective; the picture is drawn with the full one".to_owned());
    Ok(RivalScene { kind, parts, camera, frame: Frame::Room, unit: Unit::Metres, files: read, notes })
}

/// A camera beside a scene file: `<scene>_cam.json` or one of the common names.
fn beside(scene: &Path, all: &[PathBuf]) -> Option<PathBuf> {
    let own = scene.with_file_name(format!("{}_cam.json", files::stem(scene)));
    Some(own).filter(|p| p.is_file()).or_else(|| files::named(all, &["camera.json", "camera_vggt.json"]))
}

/// MIDI-3D has no camera: its evaluation looks from a fixed place.
pub fn midi(folder: &Path) -> Result<RivalScene, RivalError> {
    let kind = RivalKind::Midi;
    let all = files::below(folder);
    let scene = files::named(&all, &["textured_scene.glb", "output.glb", "scene_notextured.glb"]);
    let scene = scene.ok_or_else(|| layout(kind, folder, "no textured_scene.glb or output.glb"))?;
    let mut notes = Vec::new();
    let parts = glb::parts(&scene, DMat3::IDENTITY, &mut notes)?;
    let mut read = vec![scene.clone()];
    let camera = if let Some(path) = beside(&scene, &all) {
        read.push(path.clone());
        camera::sidecar(&path, None)?
    } else {
        notes.push(
            "it recovers no camera: the picture is from (0, 0.5, 2.5), 10 degrees down, field of view 0.7, as in the \
             paper's release; picture figures say little"
                .to_owned(),
        );
        let size = ImageSize::new(1024, 1024);
        let pitch = (-10.0_f64).to_radians();
        let turn = DMat3::from_rotation_x(pitch);
        camera::posed(size, Intrinsics::from_horizontal_fov(size, 0.7), turn, DVec3::new(0.0, 0.5, 2.5))
    };
    Ok(RivalScene { kind, parts, camera: Some(camera), frame: Frame::Room, unit: Unit::Relative, files: read, notes })
}

/// SceneGen leaves its scene in the frame of its largest object.
pub fn scenegen(folder: &Path) -> Result<RivalScene, RivalError> {
    let kind = RivalKind::SceneGen;
    let all = files::below(folder);
    let scenes = files::with(&all, "glb", None);
    let scene = match &scenes[..] {
        [one] => one.clone(),
        [] => return Err(layout(kind, folder, "no <id>.glb")),
        many => return Err(layout(kind, folder, format!("{} GLB files; name the one of the scene", many.len()))),
    };
    let mut notes = Vec::new();
    let parts = glb::parts(&scene, DMat3::IDENTITY, &mut notes)?;
    let mut read = vec![scene.clone()];
    let camera = beside(&scene, &all)
        .map(|path| {
            read.push(path.clone());
            camera::sidecar(&path, None)
        })
        .transpose()?;
    if camera.is_none() {
        notes.push("it recovers no camera and no gravity: only its geometry can be compared".to_owned());
    }
    Ok(RivalScene { kind, parts, camera, frame: Frame::Object, unit: Unit::Relative, files: read, notes })
}

/// Any GLB, PLY or OBJ; `folder` may be the file itself.
pub fn generic(kind: RivalKind, folder: &Path, options: &RivalOptions) -> Result<RivalScene, RivalError> {
    let all = files::below(folder);
    let mut notes = Vec::new();
    let scene = one_scene(kind, folder, &all)?;
    let extension = scene.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let axes = options.axes.unwrap_or(Axes::YUp);
    if options.axes.is_none() && extension != "glb" {
        notes.push(format!("{extension} files tell no axes: +Y is taken for up (--axes says otherwise)"));
    }
    let turn = axes.turn();
    let parts = match extension.as_str() {
        "glb" => glb::parts(&scene, turn, &mut notes)?,
        "ply" => vec![ply_part(&scene, turn, &mut notes)?],
        _ => vec![obj_part(&scene, turn)?],
    };
    let mut read = vec![scene.clone()];
    let mut camera = None;
    if options.camera.is_none() {
        if extension == "glb" {
            camera = glb::camera_of(&scene, options.camera_name.as_deref(), options.photo, &mut notes)?;
            // The camera turns with its scene.
            camera = camera.map(|c| harmony_scene::Camera { rotation: c.rotation * turn.transpose(), ..c });
        }
        if camera.is_none() {
            let path = beside(&scene, &all);
            read.extend(path.clone());
            camera = path.map(|p| camera::sidecar(&p, options.photo)).transpose()?;
        }
    }
    if kind == RivalKind::Viga {
        notes.push("scenes that began with SAM 3D mirror their objects in its own conversion".to_owned());
    }
    let frame = if axes.is_camera() { Frame::Camera } else { Frame::Room };
    Ok(RivalScene { kind, parts, camera, frame, unit: Unit::Relative, files: read, notes })
}

/// The scene file: by its usual names, or the only one there is.
fn one_scene(kind: RivalKind, folder: &Path, all: &[PathBuf]) -> Result<PathBuf, RivalError> {
    if let Some(found) = files::named(all, &["scene_full.glb", "scene_objects.glb", "scene.glb", "output.glb"]) {
        return Ok(found);
    }
    let mut found: Vec<PathBuf> = Vec::new();
    for extension in ["glb", "ply", "obj"] {
        if found.is_empty() {
            found = files::with(all, extension, None);
        }
    }
    match &found[..] {
        [one] => Ok(one.clone()),
        [] if !files::with(all, "blend", None).is_empty() => {
            Err(layout(kind, folder, "only a .blend file is there, which nothing but Blender reads"))
        }
        [] => Err(layout(kind, folder, "no GLB, PLY or OBJ file")),
        many => Err(layout(kind, folder, format!("{} files could be the scene; name the one", many.len()))),
    }
}

/// A PLY file as a part.
pub fn ply_part(path: &Path, turn: DMat3, notes: &mut Vec<String>) -> Result<Part, RivalError> {
    let bytes = read_bounded(path, MAX_BYTES)?;
    let ply = parse_ply(&bytes).map_err(|source| RivalError::Ply { path: path.to_owned(), source })?;
    let name = files::stem(path);
    let mesh = ply.mesh().unwrap_or_else(|| {
        let (mesh, note) = points_mesh(&ply);
        notes.push(format!("{name}: {note}"));
        mesh
    });
    let mesh = Arc::new(baked(&mesh, &DAffine3::from_mat3(turn)));
    Ok(Part { kind: glb::kind_of(&name), name, mesh })
}

fn obj_part(path: &Path, turn: DMat3) -> Result<Part, RivalError> {
    let bytes = read_bounded(path, MAX_BYTES)?;
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    // Names in an OBJ lead nowhere but below its own folder.
    let mut inside = |name: &str| {
        let path = Path::new(name);
        let plain =
            path.components().all(|c| matches!(c, std::path::Component::Normal(_) | std::path::Component::CurDir));
        plain.then(|| read_bounded(&folder.join(path), MAX_BYTES).ok()).flatten()
    };
    let mesh = harmony_players::given::obj::read_obj(&String::from_utf8_lossy(&bytes), &mut inside);
    let mut mesh = mesh.map_err(|reason| RivalError::Content { path: path.to_owned(), reason })?;
    if let Some(i) = mesh.positions.iter().position(|p| !p.is_finite()) {
        return Err(RivalError::Content { path: path.to_owned(), reason: format!("vertex {i} is not finite") });
    }
    mesh.recompute_normals();
    mesh.materials.iter_mut().for_each(|m| m.double_sided = true);
    let mesh = Arc::new(baked(&mesh, &DAffine3::from_mat3(turn)));
    Ok(Part { name: files::stem(path), kind: PartKind::Object, mesh })
}
