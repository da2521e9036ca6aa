//! SAM 3D Objects: a list of poses and the objects' files, or an assembled scene.
//!
//! The program leaves nothing placed. What can be kept of its results is a list (any `.json` in the folder):
//!
//! ```json
//! {"width": 1200, "height": 800, "f": 1010.5,
//!  "objects": [{"mask": 1, "mesh": "1.glb", "rotation": [1, 0, 0, 0], "translation": [0, 0, 2], "scale": [0.5, 0.5, 0.5]}]}
//! ```
//!
//! `rotation` is a quaternion w, x, y, z, and a point goes to `R^T (s v) + t` (its row form is `(s v) R + t`), in
//! PyTorch3D's camera axes, `v` in the local frame with +Z up. GLB files are written with +Y up and are turned back
//! first; splat files are in the local frame as they are.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use harmony_scene::{ImageSize, Intrinsics};
use serde_json::Value;

use super::camera::with_lens;
use super::frames::{Axes, baked};
use super::whole::ply_part;
use super::{Frame, Part, PartKind, RivalError, RivalKind, RivalOptions, RivalScene, Unit, camera, files, glb};

const KIND: RivalKind = RivalKind::Sam3d;

/// Local, +Z up, from its GLB, +Y up: `(gx, -gz, gy)`.
const LOCAL_FROM_GLB: DMat3 = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);

/// Reads either form.
pub fn load(folder: &Path, options: &RivalOptions) -> Result<RivalScene, RivalError> {
    let all = files::below(folder);
    if let Some(list) = files::with(&all, "json", None).into_iter().find_map(|p| Some((objects_of(&p)?, p))) {
        let ((value, objects), path) = list;
        return placed(folder, &path, &value, &objects, options);
    }
    if let Some(scene) = files::named(&all, &["assembled_scene_room.glb", "assembled_scene.glb"]) {
        let mut notes = vec!["an assembled scene: taken for glTF's camera axes, unit unknown".to_owned()];
        let parts = glb::parts(&scene, DMat3::IDENTITY, &mut notes)?;
        let own = scene.with_file_name(format!("{}_cam.json", files::stem(&scene)));
        let mut read = vec![scene];
        let camera = if own.is_file() {
            read.push(own.clone());
            Some(camera::sidecar(&own, options.photo)?)
        } else {
            None
        };
        return Ok(RivalScene {
            kind: KIND,
            parts,
            camera,
            frame: Frame::Camera,
            unit: Unit::Relative,
            files: read,
            notes,
        });
    }
    let splat = !files::with(&all, "ply", None).is_empty();
    let reason = if splat {
        "only splat files are there: the merged one is scaled to a unit box and has lost its pose, and single ones need a \
         list of poses"
    } else {
        "no list of poses and no assembled_scene.glb"
    };
    Err(RivalError::Layout { kind: KIND, folder: folder.to_owned(), reason: reason.to_owned() })
}

/// The list of a file, when it is one.
fn objects_of(path: &Path) -> Option<(Value, Vec<Value>)> {
    let value: Value = harmony_io::read_json(path).ok()?;
    let list = value.as_array().or_else(|| value["objects"].as_array())?.clone();
    let posed = |o: &Value| o["rotation"].is_array() && o["translation"].is_array();
    (!list.is_empty() && list.iter().all(posed)).then_some((value, list))
}

/// All numbers of a value, however deep they lie: `[[1, 2, 3]]` is `1, 2, 3`.
fn numbers(value: &Value, out: &mut Vec<f64>) {
    match value {
        Value::Array(items) if out.len() < 64 => items.iter().for_each(|v| numbers(v, out)),
        Value::Number(n) => out.extend(n.as_f64()),
        _ => {}
    }
}

fn placed(
    folder: &Path,
    path: &Path,
    value: &Value,
    objects: &[Value],
    options: &RivalOptions,
) -> Result<RivalScene, RivalError> {
    let bad = |reason: String| RivalError::Content { path: path.to_owned(), reason };
    let mut notes = Vec::new();
    let mut read = vec![path.to_owned()];
    let mut parts = Vec::new();
    let base = path.parent().unwrap_or(folder);
    for (i, object) in objects.iter().enumerate() {
        let list = |key: &str| {
            let mut out = Vec::new();
            numbers(&object[key], &mut out);
            out
        };
        let (q, t, s) = (list("rotation"), list("translation"), list("scale"));
        let ([w, x, y, z], [tx, ty, tz]) = (&q[..], &t[..]) else {
            return Err(bad(format!("object {i} has no rotation of 4 and translation of 3 numbers")));
        };
        let scale = match s[..] {
            [] => DVec3::ONE,
            [s] => DVec3::splat(s),
            [a, b, c] => DVec3::new(a, b, c),
            _ => return Err(bad(format!("object {i} has a scale of {} numbers", s.len()))),
        };
        let turn = DQuat::from_xyzw(*x, *y, *z, *w);
        if !(turn.is_finite() && turn.length() > 1e-6 && scale.is_finite() && scale.min_element() > 0.0) {
            return Err(bad(format!("object {i} has no usable rotation and scale")));
        }
        let file =
            mesh_file(object, i, base).ok_or_else(|| bad(format!("object {i} names no GLB or PLY that is there")))?;
        let camera_from_local = DAffine3 {
            matrix3: DMat3::from_quat(turn.normalize()).transpose() * DMat3::from_diagonal(scale),
            translation: DVec3::new(*tx, *ty, *tz),
        };
        let world_from_local = DAffine3::from_mat3(Axes::PyTorch3d.turn()) * camera_from_local;
        let splat = file.extension().is_some_and(|e| e == "ply");
        let local = if splat {
            vec![ply_part(&file, DMat3::IDENTITY, &mut notes)?]
        } else {
            glb::parts(&file, LOCAL_FROM_GLB, &mut notes)?
        };
        let name = object["label"].as_str().map_or_else(|| format!("object_{i}"), str::to_owned);
        parts.extend(local.into_iter().map(|part| Part {
            name: name.clone(),
            kind: PartKind::Object,
            mesh: Arc::new(baked(&part.mesh, &world_from_local)),
        }));
        read.push(file);
    }
    let number = |key: &str| value[key].as_f64().filter(|v| *v > 0.0 && *v < 1e6);
    let size = number("width").zip(number("height")).map(|(w, h)| ImageSize::new(w as u32, h as u32)).or(options.photo);
    let focal = number("f").or_else(|| number("focal"));
    let camera = size.zip(focal).map(|(size, f)| with_lens(size, Intrinsics::centred(size, f)));
    Ok(RivalScene { kind: KIND, parts, camera, frame: Frame::Camera, unit: Unit::Relative, files: read, notes })
}

/// The file of an object: named by it, or by its mask's number or its place in the list.
fn mesh_file(object: &Value, place: usize, base: &Path) -> Option<PathBuf> {
    let named = ["mesh", "glb", "splat"].iter().find_map(|key| object[*key].as_str());
    // A path of another machine is looked for by its file name.
    let by_name = named.map(|n| vec![base.join(n), base.join(Path::new(n).file_name().unwrap_or_default())]);
    let number = object["mask"].as_u64().unwrap_or(place as u64);
    let guesses =
        by_name.unwrap_or_else(|| vec![base.join(format!("{number}.glb")), base.join(format!("{number}.ply"))]);
    guesses.into_iter().find(|p| p.is_file())
}
