//! Parts and cameras of GLB files.

use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use harmony_io::{ReadLimits, load_glb, read_bounded};
use harmony_scene::{Camera, ImageSize, Intrinsics, SceneCamera};
use serde_json::Value;

use super::frames::baked;
use super::{Part, PartKind, RivalError, camera};

/// Most nodes that are looked at for a camera.
const MAX_NODES: usize = 20_000;

/// The nodes of a file as parts, turned by `turn`; what was repaired goes to `notes`.
pub fn parts(path: &Path, turn: DMat3, notes: &mut Vec<String>) -> Result<Vec<Part>, RivalError> {
    let glb =
        load_glb(path, &ReadLimits::default()).map_err(|source| RivalError::Glb { path: path.to_owned(), source })?;
    let file = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    notes.extend(glb.notes.iter().map(|n| format!("{file}: {n}")));
    let mut mirrored = Vec::new();
    let turn = DAffine3::from_mat3(turn);
    let parts = glb
        .nodes
        .iter()
        .map(|node| {
            if node.transform.matrix3.determinant() < 0.0 {
                mirrored.push(node.name.as_str());
            }
            let mesh = Arc::new(baked(&node.mesh, &(turn * node.transform)));
            Part { name: node.name.clone(), kind: kind_of(&node.name), mesh }
        })
        .collect();
    if !mirrored.is_empty() {
        notes.push(format!("{file}: nodes mirror their meshes: {}", mirrored.join(", ")));
    }
    Ok(parts)
}

/// Whether a name is that of walls, floor or ceiling. `wallobj_01_window` and `wall_lamp` are things on a wall.
pub fn kind_of(name: &str) -> PartKind {
    let name = name.to_lowercase();
    let name = name.trim_end_matches(|c: char| c.is_ascii_digit() || c == '_' || c == '.');
    let shell =
        matches!(name, "floor" | "ceiling" | "room" | "background" | "ground" | "wall" | "walls" | "ground_aligned")
            || name.strip_prefix("wall_").is_some_and(|w| matches!(w, "back" | "left" | "right" | "front"));
    if shell { PartKind::Shell } else { PartKind::Object }
}

/// The camera of a GLB; `None` when it has none.
///
/// A camera of ours holds the whole lens in its `extras`; others tell the vertical field of view and perhaps the aspect.
///
/// # Errors
/// Several cameras and no name, or a file that cannot be read.
pub fn camera_of(
    path: &Path,
    name: Option<&str>,
    photo: Option<ImageSize>,
    notes: &mut Vec<String>,
) -> Result<Option<Camera>, RivalError> {
    let bytes = read_bounded(path, ReadLimits::default().bytes)?;
    let bad = |reason: &str| RivalError::Content { path: path.to_owned(), reason: reason.to_owned() };
    let document = document(&bytes).ok_or_else(|| bad("this is no GLB file with readable JSON"))?;
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let mut found: Vec<(usize, String)> = Vec::new();
    for (i, node) in nodes.iter().take(MAX_NODES).enumerate() {
        if node["camera"].is_u64() {
            found.push((i, node["name"].as_str().map_or_else(|| format!("node_{i}"), str::to_owned)));
        }
    }
    let chosen = match (name, &found[..]) {
        (_, []) => return Ok(None),
        (None, [one]) => one.0,
        (None, _) => {
            return Err(RivalError::Cameras { path: path.to_owned(), names: found.into_iter().map(|f| f.1).collect() });
        }
        (Some(name), _) => {
            let named = found.iter().find(|f| f.1 == name);
            named.ok_or_else(|| bad(&format!("no camera is named {name:?}")))?.0
        }
    };
    let node = &nodes[chosen];
    let own: Option<SceneCamera> = serde_json::from_value(node["extras"]["camera"].clone()).ok();
    if let Some(camera) = own.as_ref().map(Camera::from).filter(camera::usable) {
        return Ok(Some(camera));
    }
    let place = place_of(nodes, chosen).ok_or_else(|| bad("its camera lies at no finite place"))?;
    let about = &document["cameras"][node["camera"].as_u64().unwrap_or(0) as usize]["perspective"];
    let yfov = about["yfov"].as_f64().filter(|f| (0.02..3.1).contains(f));
    let yfov = yfov.ok_or_else(|| bad("its camera is no perspective one"))?;
    let size = match (photo, about["aspectRatio"].as_f64().filter(|a| (0.05..20.0).contains(a))) {
        // Its own shape, at the photo's width.
        (photo, Some(aspect)) => {
            let width = photo.map_or(1024, |p| p.width);
            ImageSize::new(width, ((f64::from(width) / aspect).round() as u32).max(1))
        }
        (Some(photo), None) => photo,
        (None, None) => return Err(bad("its camera tells no aspect, and no photo was named")),
    };
    let f = f64::from(size.height) / 2.0 / (yfov / 2.0).tan();
    let m = place.matrix3;
    let turn = DMat3::from_cols(
        m.x_axis.normalize_or(DVec3::X),
        m.y_axis.normalize_or(DVec3::Y),
        m.z_axis.normalize_or(DVec3::Z),
    );
    let camera = camera::posed(size, Intrinsics::centred(size, f), turn, place.translation);
    if !camera::usable(&camera) {
        return Err(bad("its camera is mirrored or sheared"));
    }
    notes.push("the camera is that of the GLB file; a shifted lens is not in it".to_owned());
    Ok(Some(camera))
}

/// The JSON chunk.
fn document(bytes: &[u8]) -> Option<Value> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    if !bytes.starts_with(b"glTF") || word(16)? != 0x4e4f_534a {
        return None;
    }
    serde_json::from_slice(bytes.get(20..20_usize.checked_add(word(12)? as usize)?)?).ok()
}

/// `scene_from_node`, all parents included.
fn place_of(nodes: &[Value], node: usize) -> Option<DAffine3> {
    let mut place = local(&nodes[node]);
    let mut at = node;
    // A chain longer than there are nodes runs in a circle.
    for _ in 0..nodes.len().min(MAX_NODES) {
        let parent = nodes
            .iter()
            .take(MAX_NODES)
            .position(|n| n["children"].as_array().is_some_and(|c| c.iter().any(|c| c.as_u64() == Some(at as u64))));
        let Some(parent) = parent else { return place.is_finite().then_some(place) };
        place = local(&nodes[parent]) * place;
        at = parent;
    }
    None
}

fn local(node: &Value) -> DAffine3 {
    let numbers = |key: &str| -> Option<Vec<f64>> { node[key].as_array()?.iter().map(Value::as_f64).collect() };
    if let Some(m) = numbers("matrix").and_then(|m| <[f64; 16]>::try_from(m).ok()) {
        return DAffine3::from_mat4(DMat4::from_cols_array(&m));
    }
    let three =
        |key: &str, or: DVec3| numbers(key).and_then(|v| <[f64; 3]>::try_from(v).ok()).map_or(or, DVec3::from_array);
    let turn = numbers("rotation").and_then(|v| <[f64; 4]>::try_from(v).ok()).map(DQuat::from_array);
    let turn = turn.filter(|q| q.is_finite() && q.length() > 1e-9).map_or(DQuat::IDENTITY, DQuat::normalize);
    DAffine3::from_scale_rotation_translation(three("scale", DVec3::ONE), turn, three("translation", DVec3::ZERO))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shells_are_told_from_things_on_walls() {
        for name in ["floor", "Ceiling", "wall_back", "wall_left", "Wall.003", "wall_2", "background", "ground_aligned"]
        {
            assert_eq!(kind_of(name), PartKind::Shell, "{name}");
        }
        for name in
            ["wallobj_01_window", "wall_lamp", "floor_lamp_01", "furniture_1_bed", "wallpaper_roll", "geometry_0"]
        {
            assert_eq!(kind_of(name), PartKind::Object, "{name}");
        }
    }
}
