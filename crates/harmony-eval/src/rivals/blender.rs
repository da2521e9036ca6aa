//! SceneConductor: a description in Blender's world (+Z up, metres) and the objects' meshes.
//!
//! # Reading of the description
//! An object's mesh is centred and scaled to a cube of side 1 along its longest side before `scale`, `rotation_euler`
//! (radians, XYZ) and `location` are applied; GLB files come into Blender with their +Y as +Z. The room is a polygon
//! with a floor and a ceiling height; walls stand on its edges and are drawn from inside.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec2, DVec3, Vec2};
use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{Camera, ImageSize, Intrinsics};
use serde_json::Value;

use super::camera::{euler_xyz, posed, usable, vec3};
use super::frames::{Axes, baked};
use super::{Frame, Part, PartKind, RivalError, RivalKind, RivalScene, Unit, files, glb};

const KIND: RivalKind = RivalKind::SceneConductor;

/// Most corners of a room's polygon.
const MAX_CORNERS: usize = 1000;

/// Reads `blender_scene.json`.
pub fn sceneconductor(folder: &Path) -> Result<RivalScene, RivalError> {
    let all = files::below(folder);
    let path = files::named(&all, &["blender_scene.json"]).ok_or_else(|| RivalError::Layout {
        kind: KIND,
        folder: folder.to_owned(),
        reason: "no blender_scene.json".to_owned(),
    })?;
    let value: Value = harmony_io::read_json(&path)?;
    let bad = |reason: String| RivalError::Content { path: path.clone(), reason };
    let mut notes = Vec::new();
    let mut read = vec![path.clone()];
    let mut parts = Vec::new();
    let up = DAffine3::from_mat3(Axes::ZUp.turn());
    for (i, object) in value["objects"].as_array().into_iter().flatten().enumerate() {
        let id = match (&object["id"], &object["class"]) {
            (Value::String(id), _) => id.clone(),
            (Value::Number(id), Value::String(class)) => format!("{class}_{id}"),
            _ => format!("object_{i}"),
        };
        let Some(mesh) = mesh_file(object["mesh_path"].as_str().unwrap_or_default(), &path, &all) else {
            notes.push(format!("{id}: no file {} in the folder", object["mesh_path"]));
            continue;
        };
        let (location, angles) = (vec3(&object["location"]), vec3(&object["rotation_euler"]));
        let (Some(location), Some(angles)) = (location, angles) else {
            return Err(bad(format!("{id} has no location or rotation_euler")));
        };
        let scale = vec3(&object["scale"]).or_else(|| object["scale"].as_f64().map(DVec3::splat)).unwrap_or(DVec3::ONE);
        // As Blender imports a GLB: +Y becomes +Z.
        let imported = glb::parts(&mesh, Axes::ZUp.turn().transpose(), &mut notes)?;
        let Some(unit) = unit_cube(&imported) else {
            notes.push(format!("{id}: its mesh is empty"));
            continue;
        };
        let place = DAffine3 { matrix3: euler_xyz(angles) * DMat3::from_diagonal(scale), translation: location };
        if !place.is_finite() {
            return Err(bad(format!("{id} lies at no finite place")));
        }
        for part in imported {
            let mesh = Arc::new(baked(&part.mesh, &(up * place * unit)));
            parts.push(Part { name: id.clone(), kind: PartKind::Object, mesh });
        }
        read.push(mesh);
    }
    if let Some(shell) = stage(&value["stage"]) {
        if value["stage"]["openings"].as_array().is_some_and(|o| !o.is_empty()) {
            notes.push("doors and windows of its stage are not cut into the walls".to_owned());
        }
        parts.extend(shell);
    }
    let camera = camera(&value["camera"]).ok_or_else(|| bad("its camera is not complete".to_owned()))?;
    Ok(RivalScene {
        kind: KIND,
        parts,
        camera: Some(camera),
        frame: Frame::Room,
        unit: Unit::Metres,
        files: read,
        notes,
    })
}

/// The paths are absolute ones of another machine: the last parts of them are looked for.
fn mesh_file(path: &str, beside: &Path, all: &[PathBuf]) -> Option<PathBuf> {
    let path = Path::new(path);
    let near = beside.parent().map(|p| p.join(path)).filter(|p| !path.is_absolute() && p.is_file());
    let name = path.file_name()?;
    let folder = path.parent().and_then(Path::file_name);
    let same_name = || all.iter().filter(|f| f.file_name() == Some(name));
    near.or_else(|| same_name().find(|f| f.parent().and_then(Path::file_name) == folder).cloned())
        .or_else(|| same_name().next().cloned())
}

/// Centres the parts and scales their longest side to 1.
fn unit_cube(parts: &[Part]) -> Option<DAffine3> {
    let bounds = parts.iter().filter_map(|p| p.mesh.bounds());
    let (min, max) = bounds.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), b| (l.min(b.min), h.max(b.max)));
    let side = (max - min).max_element();
    if !(side > 0.0 && side.is_finite()) {
        return None;
    }
    Some(DAffine3::from_scale(DVec3::splat(1.0 / side)) * DAffine3::from_translation(-(min + max) / 2.0))
}

fn camera(v: &Value) -> Option<Camera> {
    let resolution = v["resolution"].as_array()?;
    let side = |i: usize| resolution.get(i)?.as_f64().filter(|s| (1.0..=32_768.0).contains(s)).map(|s| s as u32);
    let size = ImageSize::new(side(0)?, side(1)?);
    let lens = v["lens"].as_f64().filter(|l| *l > 0.0)?;
    let sensor = v["sensor_width"].as_f64().filter(|s| *s > 0.0).unwrap_or(36.0);
    // The sensor's width lies along the longer side, unless told.
    let along = match v["sensor_fit"].as_str() {
        Some("VERTICAL") => size.height,
        Some("HORIZONTAL") => size.width,
        _ => size.width.max(size.height),
    };
    let intrinsics = Intrinsics::centred(size, lens / sensor * f64::from(along));
    let up = Axes::ZUp.turn();
    let turn = up * euler_xyz(vec3(&v["rotation_euler"])?);
    let camera = posed(size, intrinsics, turn, up * vec3(&v["location"])?);
    usable(&camera).then_some(camera)
}

/// Floor, ceiling and walls of a polygon.
fn stage(v: &Value) -> Option<Vec<Part>> {
    let corners: Vec<DVec2> = v["polygon_vertices"]
        .as_array()?
        .iter()
        .take(MAX_CORNERS)
        .filter_map(|c| Some(DVec2::new(c.get(0)?.as_f64()?, c.get(1)?.as_f64()?)))
        .filter(|c| c.is_finite())
        .collect();
    let (floor, ceiling) = (v["floor_z"].as_f64().unwrap_or(0.0), v["ceiling_z"].as_f64()?);
    if corners.len() < 3 || !(ceiling - floor).is_finite() {
        return None;
    }
    let up = Axes::ZUp.turn();
    let at = |c: DVec2, z: f64| (up * DVec3::new(c.x, c.y, z)).as_vec3();
    let n = corners.len();
    let ring = |z: f64| corners.iter().map(|c| at(*c, z)).collect::<Vec<_>>();
    let fan: Vec<[u32; 3]> = (1..n as u32 - 1).map(|i| [0, i, i + 1]).collect();
    let mut parts = vec![sheet("floor", ring(floor), fan.clone()), sheet("ceiling", ring(ceiling), fan)];
    for i in 0..n {
        let (a, b) = (corners[i], corners[(i + 1) % n]);
        let quad = vec![at(a, floor), at(b, floor), at(b, ceiling), at(a, ceiling)];
        parts.push(sheet(&format!("wall_{i}"), quad, vec![[0, 1, 2], [0, 2, 3]]));
    }
    Some(parts)
}

fn sheet(name: &str, positions: Vec<glam::Vec3>, triangles: Vec<[u32; 3]>) -> Part {
    let mut mesh = Mesh {
        uvs: vec![Vec2::ZERO; positions.len()],
        positions,
        groups: vec![Group { material: 0, triangles }],
        materials: vec![Material { double_sided: true, ..Material::plain(name, [0.7; 3]) }],
        ..Mesh::default()
    };
    mesh.recompute_normals();
    Part { name: name.to_owned(), kind: PartKind::Shell, mesh: Arc::new(mesh) }
}
