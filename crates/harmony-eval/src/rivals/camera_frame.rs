//! Programs that leave their scene in the frame of the photo's camera: Gen3DSR, 3D-RE-GEN, CAST (FishWoWater).

use std::path::Path;

use glam::{DMat3, DVec3};
use harmony_io::npz::{Array, parse_npy, read_npz};
use harmony_io::read_bounded;
use harmony_scene::{Camera, ImageSize, Intrinsics};
use serde_json::Value;

use super::camera::{FLIP, lens, mat3, posed, usable, with_lens};
use super::frames::Axes;
use super::whole::ply_part;
use super::{Frame, PartKind, RivalError, RivalKind, RivalScene, Unit, files, glb};

/// Largest array file, bytes.
const MAX_NPY: u64 = 1 << 30;

fn layout(kind: RivalKind, folder: &Path, reason: impl Into<String>) -> RivalError {
    RivalError::Layout { kind, folder: folder.to_owned(), reason: reason.into() }
}

fn content(path: &Path, reason: impl Into<String>) -> RivalError {
    RivalError::Content { path: path.to_owned(), reason: reason.into() }
}

fn size_of(width: f64, height: f64) -> Option<ImageSize> {
    let fits = |v: f64| (1.0..=32_768.0).contains(&v);
    (fits(width) && fits(height)).then(|| ImageSize::new(width as u32, height as u32))
}

/// Gen3DSR: OpenCV axes; the placed meshes are those in `reconstruction`, the ones in `object_space` are not placed.
pub fn gen3dsr(folder: &Path) -> Result<RivalScene, RivalError> {
    let kind = RivalKind::Gen3dsr;
    let all = files::below(folder);
    let mut notes = Vec::new();
    let turn = Axes::OpenCv.turn();
    let mut read = files::with(&all, "glb", Some("reconstruction"));
    let mut parts = Vec::new();
    if read.is_empty() {
        let Some(whole) = files::named(&all, &["full_scene.glb"]) else {
            let unposed = all.iter().any(|f| f.parent().and_then(Path::file_name).is_some_and(|n| n == "object_space"));
            let reason = if unposed {
                "only object_space is there, whose meshes are not placed: each fills its own unit box"
            } else {
                "no reconstruction/*.glb and no full_scene.glb"
            };
            return Err(layout(kind, folder, reason));
        };
        read.push(whole);
    }
    for path in &read {
        let mut own = glb::parts(path, turn, &mut notes)?;
        // `3_arm chair.glb` holds a node of no telling name.
        if own.len() == 1 && files::stem(path) != "full_scene" {
            own[0].name = files::stem(path);
            own[0].kind = glb::kind_of(&own[0].name);
        }
        parts.extend(own);
    }
    let background = all.iter().find(|f| {
        f.file_name().is_some_and(|n| n == "background.ply")
            && f.parent().and_then(Path::file_name).is_some_and(|p| p == "reconstruction")
    });
    if let Some(path) = background.filter(|_| read[0].file_name().is_some_and(|n| n != "full_scene.glb")) {
        let mut part = ply_part(path, turn, &mut notes)?;
        part.kind = PartKind::Shell;
        parts.push(part);
        read.push(path.clone());
    }
    let path = files::named(&all, &["cam_params.json"]).ok_or_else(|| layout(kind, folder, "no cam_params.json"))?;
    let camera = gen3dsr_camera(&path, &mut notes)?;
    read.push(path);
    Ok(RivalScene { kind, parts, camera: Some(camera), frame: Frame::Camera, unit: Unit::Metres, files: read, notes })
}

fn gen3dsr_camera(path: &Path, notes: &mut Vec<String>) -> Result<Camera, RivalError> {
    let value: Value = harmony_io::read_json(path)?;
    let size = value["W"].as_f64().zip(value["H"].as_f64()).and_then(|(w, h)| size_of(w, h));
    let (Some(size), Some(k)) = (size, mat3(&value["K"])) else {
        return Err(content(path, "K, W or H is missing or no number"));
    };
    // `c2w` is a 4 x 4 matrix by rows, in OpenCV axes; the identity unless poses were given.
    let rows = |i: usize| value["c2w"].get(i);
    let turn = [rows(0), rows(1), rows(2)].map(|r| r.and_then(super::camera::vec3));
    let shift = [rows(0), rows(1), rows(2)].map(|r| r.and_then(|r| r.get(3)?.as_f64()));
    let mut camera = with_lens(size, lens(k));
    if let ([Some(a), Some(b), Some(c)], [Some(x), Some(y), Some(z)]) = (turn, shift) {
        let (world_from_camera, centre) = (DMat3::from_cols(a, b, c).transpose(), DVec3::new(x, y, z));
        if (world_from_camera - DMat3::IDENTITY).to_cols_array().iter().any(|v| v.abs() > 1e-9) || centre != DVec3::ZERO
        {
            notes.push("its world is not its camera's frame: c2w was applied".to_owned());
            let rotation = world_from_camera.transpose();
            camera.rotation = rotation * FLIP;
            camera.translation = -(rotation * centre);
        }
    }
    if usable(&camera) { Ok(camera) } else { Err(content(path, "its camera is mirrored, or not finite")) }
}

/// 3D-RE-GEN: glTF's camera axes, the estimator's unit.
pub fn regen(folder: &Path) -> Result<RivalScene, RivalError> {
    let kind = RivalKind::ReGen;
    let all = files::below(folder);
    let scene =
        files::named(&all, &["combined_scene.glb"]).ok_or_else(|| layout(kind, folder, "no combined_scene.glb"))?;
    let path = files::named(&all, &["camera.npz"]).ok_or_else(|| layout(kind, folder, "no camera.npz"))?;
    let mut notes = Vec::new();
    let mut parts = glb::parts(&scene, DMat3::IDENTITY, &mut notes)?;
    let mut read = vec![scene];
    if let Some(ground) = files::named(&all, &["ground_aligned.glb"]) {
        let mut shell = glb::parts(&ground, DMat3::IDENTITY, &mut notes)?;
        for part in &mut shell {
            part.kind = PartKind::Shell;
        }
        notes
            .push("the room's mesh has no texture outside its .blend file: it is drawn in its plain colour".to_owned());
        parts.extend(shell);
        read.push(ground);
    }
    let camera = regen_camera(&path)?;
    read.push(path);
    Ok(RivalScene { kind, parts, camera: Some(camera), frame: Frame::Camera, unit: Unit::Relative, files: read, notes })
}

/// `extrinsic` is Blender's matrix_world of the camera (+Z up), `focal` is in pixels of `image_size`.
fn regen_camera(path: &Path) -> Result<Camera, RivalError> {
    let arrays = read_npz(path).map_err(|e| content(path, e.to_string()))?;
    let values = |name: &str| arrays.get(name).map(|a| a.values.as_slice());
    let size = values("image_size").and_then(|v| size_of(*v.first()?, *v.get(1)?));
    let size = size.ok_or_else(|| content(path, "image_size is missing or no size"))?;
    let focal = values("focal").and_then(|v| v.first().copied());
    let angle = values("camera_angle_x").and_then(|v| v.first().copied());
    let focal = focal.or_else(|| angle.map(|a| f64::from(size.width) / 2.0 / (a / 2.0).tan()));
    let focal = focal.filter(|f| f.is_finite() && *f > 0.0).ok_or_else(|| content(path, "it tells no focal length"))?;
    let intrinsics = Intrinsics::centred(size, focal);
    let Some(m) = values("extrinsic").filter(|m| m.len() >= 12) else { return Ok(with_lens(size, intrinsics)) };
    // By rows; three or four columns of a row belong to the pose.
    let row = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
    let turn = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let centre = DVec3::new(m[3], m[7], m[11]);
    let up = Axes::ZUp.turn();
    let camera = posed(size, intrinsics, up * turn, up * centre);
    if usable(&camera) { Ok(camera) } else { Err(content(path, "its extrinsic is no pose of a camera")) }
}

/// CAST, the public implementation: glTF's camera axes, metres of its depth model.
pub fn cast(folder: &Path) -> Result<RivalScene, RivalError> {
    let kind = RivalKind::Cast;
    let all = files::below(folder);
    let mut notes = Vec::new();
    let mut read = files::with(&all, "glb", Some("positioned_objects"));
    if read.is_empty() {
        let whole = files::named(&all, &["reconstructed_scene.glb"]);
        read.extend(whole);
    }
    if read.is_empty() {
        return Err(layout(kind, folder, "no positioned_objects/*.glb and no reconstructed_scene.glb"));
    }
    let mut parts = Vec::new();
    for path in &read {
        let mut own = glb::parts(path, DMat3::IDENTITY, &mut notes)?;
        if own.len() == 1 && read.len() > 1 {
            own[0].name = files::stem(path);
        }
        parts.extend(own);
    }
    if let Some(path) = files::named(&all, &["estimated_poses.json"]) {
        let poses: Value = harmony_io::read_json(&path)?;
        let wanted = poses["poses"].as_array().map_or(0, Vec::len);
        if wanted > parts.len() {
            notes.push(format!("{} of {wanted} objects have no pose it trusted and are missing", wanted - parts.len()));
        }
    }
    let path = files::named(&all, &["intrinsics.npy"]).ok_or_else(|| layout(kind, folder, "no intrinsics.npy"))?;
    let size = files::named(&all, &["depth_map.npy"]).map(|p| npy(&p).map(|a| (p, a))).transpose()?;
    let size = size.and_then(|(_, a)| match a.shape[..] {
        [height, width] | [1, height, width] | [height, width, 1] => size_of(width as f64, height as f64),
        _ => None,
    });
    let size = size.ok_or_else(|| layout(kind, folder, "no depth_map.npy that tells the image's size"))?;
    let k = npy(&path)?;
    let [fx, _, cx, _, fy, cy, ..] = k.values[..] else { return Err(content(&path, "it is no 3 x 3 matrix")) };
    let (w, h) = (f64::from(size.width), f64::from(size.height));
    // In shares of the image's sides, as its depth model gives them.
    let camera = with_lens(size, Intrinsics { fx: fx * w, fy: fy * h, cx: cx * w, cy: cy * h });
    if !usable(&camera) {
        return Err(content(&path, "its camera is not finite"));
    }
    read.push(path);
    Ok(RivalScene { kind, parts, camera: Some(camera), frame: Frame::Camera, unit: Unit::Metres, files: read, notes })
}

fn npy(path: &Path) -> Result<Array, RivalError> {
    let bytes = read_bounded(path, MAX_NPY)?;
    parse_npy(&files::stem(path), &bytes).map_err(|e| content(path, e.to_string()))
}
