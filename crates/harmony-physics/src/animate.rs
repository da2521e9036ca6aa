//! An animated GLB: the scene's own file with channels of translation and rotation on its nodes.
//!
//! The file's meshes, materials and textures stay byte for byte; the JSON gets an animation, the binary chunk its numbers.
//! Frame: the one that does not move. The node of the room, the lights and the camera follow the ground; objects have their
//! own motion, and a lamp that moves takes its light along. [`still_glb`] is one frame of it, in the room's frame, for renderers that know no animation.

use glam::{DQuat, DVec3};
use serde_json::{Map, Value, json};

use crate::quake::{Shaken, Trajectory};
use crate::world::Placed;

/// A file that cannot be animated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnimateError {
    /// Not a GLB of glTF 2.0.
    #[error("this is not a GLB file of glTF 2.0")]
    NotGlb,
    /// The JSON chunk cannot be read.
    #[error("the GLB file's JSON is broken: {0}")]
    Json(#[from] serde_json::Error),
    /// An object has no node.
    #[error("{object} has no node in the GLB file")]
    NoNode {
        /// Which.
        object: String,
    },
}

impl AnimateError {
    /// What a person can do about it.
    pub fn hint(&self) -> &'static str {
        "scene_full.glb is damaged or of another run; run reconstruct again"
    }
}

const JSON_CHUNK: u32 = 0x4e4f_534a;
const BIN_CHUNK: u32 = 0x004e_4942;
const FLOAT: u32 = 5126;

/// The scene's GLB with an earthquake's animation.
///
/// # Errors
/// [`AnimateError`].
pub fn animated_glb(glb: &[u8], shaken: &Shaken) -> Result<Vec<u8>, AnimateError> {
    let (mut doc, mut binary) = parse(glb)?;
    let roots = root_nodes(&doc);
    let times: Vec<f32> = (0..shaken.frames()).map(|f| f as f32 / shaken.frames_per_second as f32).collect();
    let input = floats(&mut doc, &mut binary, &times, "SCALAR");
    let lit = lights_of(&doc, shaken);
    let mut samplers = Vec::new();
    let mut channels = Vec::new();
    let mut channel = |node: usize, path: &str, output: usize| {
        channels.push(json!({ "sampler": samplers.len(), "target": { "node": node, "path": path } }));
        samplers.push(json!({ "input": input, "output": output, "interpolation": "LINEAR" }));
    };
    for node in roots {
        let name = doc["nodes"][node]["name"].as_str().unwrap_or_default().to_owned();
        let object = shaken.objects.iter().find(|o| o.id == name && !o.positions.is_empty());
        let base = translation(&doc["nodes"][node]);
        let moved: Vec<f32> = shaken
            .ground
            .iter()
            .enumerate()
            .flat_map(|(f, g)| {
                let at = object.and_then(|o| o.positions.get(f)).copied().unwrap_or(base);
                std::array::from_fn::<f32, 3, _>(|k| (at[k] + g[k]) as f32)
            })
            .collect();
        channel(node, "translation", floats(&mut doc, &mut binary, &moved, "VEC3"));
        if let Some(object) = object {
            let turned: Vec<f32> = object.rotations.iter().flat_map(|q| unit(*q)).collect();
            channel(node, "rotation", floats(&mut doc, &mut binary, &turned, "VEC4"));
        }
    }
    // Below the node of all lights, which follows the ground.
    for (node, object) in lit {
        let (Some(first), base) = (object.at(0), translation(&doc["nodes"][node])) else { continue };
        let base_turn = rotation(&doc["nodes"][node]);
        let (mut moved, mut turned) = (Vec::new(), Vec::new());
        for frame in 0..shaken.frames() {
            let now = object.at(frame).unwrap_or(first);
            let turn =
                DQuat::from_array(now.rotation).normalize() * DQuat::from_array(first.rotation).normalize().inverse();
            let at = now.position + turn * (DVec3::from_array(base) - first.position);
            moved.extend(at.to_array().map(|v| v as f32));
            turned.extend(unit((turn * base_turn).to_array()));
        }
        channel(node, "translation", floats(&mut doc, &mut binary, &moved, "VEC3"));
        channel(node, "rotation", floats(&mut doc, &mut binary, &turned, "VEC4"));
    }
    let missing = shaken.objects.iter().find(|o| find_node(&doc, &o.id).is_none());
    if let Some(object) = missing {
        return Err(AnimateError::NoNode { object: object.id.clone() });
    }
    push(&mut doc, "animations", json!({ "name": "earthquake", "samplers": samplers, "channels": channels }));
    assemble(&mut doc, binary)
}

/// The scene's GLB at one frame of an earthquake, room frame.
///
/// # Errors
/// [`AnimateError`].
pub fn still_glb(glb: &[u8], shaken: &Shaken, frame: usize) -> Result<Vec<u8>, AnimateError> {
    let places = shaken.objects.iter().filter_map(|o| Some((o.id.as_str(), o.at(frame)?)));
    posed_glb(glb, &places.collect::<Vec<_>>())
}

/// A GLB some of whose nodes, by their names, are elsewhere; what hangs on them and how large they are stays.
///
/// # Errors
/// [`AnimateError`].
pub fn posed_glb(glb: &[u8], places: &[(&str, Placed)]) -> Result<Vec<u8>, AnimateError> {
    let (mut doc, binary) = parse(glb)?;
    for (name, place) in places {
        let node = find_node(&doc, name).ok_or_else(|| AnimateError::NoNode { object: (*name).to_owned() })?;
        let node = &mut doc["nodes"][node];
        node["translation"] = json!(place.position.to_array());
        node["rotation"] = json!(unit(place.rotation));
    }
    assemble(&mut doc, binary)
}

/// A unit quaternion in single precision, as validators want it.
fn unit(q: [f64; 4]) -> [f32; 4] {
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-12);
    q.map(|v| (v / length) as f32)
}

/// Nodes of lights that are below another node and belong to what moves, with what they belong to.
fn lights_of<'a>(doc: &Value, shaken: &'a Shaken) -> Vec<(usize, &'a Trajectory)> {
    let roots = root_nodes(doc);
    let nodes = doc["nodes"].as_array().map(Vec::as_slice).unwrap_or_default();
    let owner = |node: &Value| {
        let id = node["extras"]["light"]["object"].as_str()?;
        shaken.objects.iter().find(|o| o.id == id && !o.positions.is_empty())
    };
    nodes.iter().enumerate().filter(|(k, _)| !roots.contains(k)).filter_map(|(k, n)| Some((k, owner(n)?))).collect()
}

fn rotation(node: &Value) -> DQuat {
    let q: [f64; 4] = std::array::from_fn(|k| node["rotation"][k].as_f64().unwrap_or(if k == 3 { 1.0 } else { 0.0 }));
    if q.iter().map(|v| v * v).sum::<f64>() > 1e-12 { DQuat::from_array(q).normalize() } else { DQuat::IDENTITY }
}

fn translation(node: &Value) -> [f64; 3] {
    std::array::from_fn(|k| node["translation"][k].as_f64().unwrap_or(0.0))
}

fn find_node(doc: &Value, name: &str) -> Option<usize> {
    doc["nodes"].as_array()?.iter().position(|n| n["name"] == name)
}

/// Nodes of the first scene.
fn root_nodes(doc: &Value) -> Vec<usize> {
    let count = doc["nodes"].as_array().map_or(0, Vec::len);
    let scene = doc["scene"].as_u64().unwrap_or(0) as usize;
    let roots = doc["scenes"][scene]["nodes"].as_array();
    roots.into_iter().flatten().filter_map(|n| Some(n.as_u64()? as usize)).filter(|n| *n < count).collect()
}

fn push(doc: &mut Value, list: &str, value: Value) -> usize {
    if !doc[list].is_array() {
        doc[list] = json!([]);
    }
    let Some(items) = doc[list].as_array_mut() else { return 0 };
    items.push(value);
    items.len() - 1
}

/// Appends numbers to the binary chunk; their accessor.
fn floats(doc: &mut Value, binary: &mut Vec<u8>, values: &[f32], kind: &str) -> usize {
    binary.resize(binary.len().next_multiple_of(4), 0);
    let offset = binary.len();
    binary.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    let view = push(doc, "bufferViews", json!({ "buffer": 0, "byteOffset": offset, "byteLength": 4 * values.len() }));
    let width = match kind {
        "SCALAR" => 1,
        "VEC3" => 3,
        _ => 4,
    };
    let mut accessor =
        json!({ "bufferView": view, "componentType": FLOAT, "count": values.len() / width, "type": kind });
    if kind == "SCALAR" {
        let fold = |f: fn(f32, f32) -> f32| values.iter().copied().reduce(f).unwrap_or(0.0);
        accessor["min"] = json!([fold(f32::min)]);
        accessor["max"] = json!([fold(f32::max)]);
    }
    push(doc, "accessors", accessor)
}

/// The JSON and the binary chunk.
fn parse(glb: &[u8]) -> Result<(Value, Vec<u8>), AnimateError> {
    let word = |at: usize| Some(u32::from_le_bytes(glb.get(at..at.checked_add(4)?)?.try_into().ok()?));
    if !glb.starts_with(b"glTF") || word(4) != Some(2) {
        return Err(AnimateError::NotGlb);
    }
    let (mut at, mut text, mut binary) = (12_usize, None, Vec::new());
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let end = (at + 8).checked_add(length as usize).ok_or(AnimateError::NotGlb)?;
        let data = glb.get(at + 8..end).ok_or(AnimateError::NotGlb)?;
        match kind {
            JSON_CHUNK if text.is_none() => text = Some(data),
            BIN_CHUNK if binary.is_empty() => binary = data.to_vec(),
            _ => {}
        }
        at = end.next_multiple_of(4);
    }
    let doc: Value = serde_json::from_slice(text.ok_or(AnimateError::NotGlb)?)?;
    if !doc.is_object() {
        return Err(AnimateError::NotGlb);
    }
    Ok((doc, binary))
}

fn assemble(doc: &mut Value, mut binary: Vec<u8>) -> Result<Vec<u8>, AnimateError> {
    binary.resize(binary.len().next_multiple_of(4), 0);
    if !binary.is_empty() {
        if !doc["buffers"][0].is_object() {
            doc["buffers"] = json!([Map::new()]);
        }
        doc["buffers"][0]["byteLength"] = json!(binary.len());
    }
    let mut text = serde_json::to_vec(doc)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let binary_chunk = if binary.is_empty() { 0 } else { 8 + binary.len() };
    let mut out = Vec::with_capacity(20 + text.len() + binary_chunk);
    out.extend(b"glTF");
    out.extend(2_u32.to_le_bytes());
    out.extend((20 + text.len() as u32 + binary_chunk as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(JSON_CHUNK.to_le_bytes());
    out.extend(text);
    if !binary.is_empty() {
        out.extend((binary.len() as u32).to_le_bytes());
        out.extend(BIN_CHUNK.to_le_bytes());
        out.extend(binary);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_io::{GlbNode, GlbScene, NodeTransform, ReadLimits, glb_bytes, read_glb};
    use harmony_scene::{Light, LightKind, Lighting, ObjectId, Vec3, ViewTransform};

    use super::*;
    use crate::matter::Motion;
    use crate::quake::Quake;
    use crate::testing::cuboid_mesh;

    fn track(id: &str, positions: Vec<[f64; 3]>) -> Trajectory {
        let rotations = positions
            .iter()
            .enumerate()
            .map(|(k, _)| [0.0, 0.0, (0.1 * k as f64).sin(), (0.1 * k as f64).cos()])
            .collect();
        Trajectory {
            id: id.into(),
            motion: Motion::Dynamic,
            mass_kg: 1.0,
            friction: 0.4,
            farthest_m: 0.0,
            moved_m: 0.0,
            tilt_deg: 0.0,
            toppled: false,
            fallen: false,
            positions,
            rotations,
        }
    }

    fn file_and_motion() -> (Vec<u8>, Shaken) {
        let mesh = Arc::new(cuboid_mesh(Vec3::ONE));
        let node = |name: &str, x: f64| GlbNode {
            name: name.into(),
            mesh: Arc::clone(&mesh),
            transform: NodeTransform { translation: Vec3::new(x, 0.0, 0.0), yaw: 0.0, scale: Vec3::splat(0.5) },
            extras: Value::Null,
        };
        let scene = GlbScene {
            objects: vec![node("box_01", 1.0), node("box_02", 2.0)],
            shell: vec![node("floor", 0.0)],
            ..GlbScene::default()
        };
        let still =
            Trajectory { motion: Motion::Static, positions: vec![], rotations: vec![], ..track("box_02", vec![]) };
        let shaken = Shaken {
            quake: Quake { intensity: 8.0, seconds: 0.1, seed: 0 },
            peak_acceleration: 1.0,
            frames_per_second: 30,
            ground: vec![[0.0; 3], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]],
            objects: vec![track("box_01", vec![[1.0, 0.0, 0.0], [1.5, 0.0, 0.0], [1.5, 0.25, 0.0]]), still],
        };
        (glb_bytes(&scene).unwrap(), shaken)
    }

    #[test]
    fn the_animation_says_what_moved_and_the_rest_is_as_it_was() {
        let (file, shaken) = file_and_motion();
        let out = animated_glb(&file, &shaken).unwrap();
        assert_eq!(out, animated_glb(&file, &shaken).unwrap());
        // Read by the gltf crate.
        let (doc, buffers) = {
            let gltf = gltf::Gltf::from_slice(&out).unwrap();
            let blob = gltf.blob.clone().unwrap();
            (gltf.document, vec![blob])
        };
        let animation = doc.animations().next().unwrap();
        assert_eq!(animation.name(), Some("earthquake"));
        let mut seen = Vec::new();
        for channel in animation.channels() {
            let reader = channel.reader(|b| buffers.get(b.index()).map(Vec::as_slice));
            let times: Vec<f32> = reader.read_inputs().unwrap().collect();
            assert_eq!(times.len(), 3);
            assert!((times[2] - 2.0 / 30.0).abs() < 1e-6);
            let name = channel.target().node().name().unwrap().to_owned();
            match reader.read_outputs().unwrap() {
                gltf::animation::util::ReadOutputs::Translations(t) => seen.push((name, t.last().unwrap())),
                gltf::animation::util::ReadOutputs::Rotations(r) => {
                    let last = r.into_f32().last().unwrap();
                    assert!(name == "box_01" && (last[2] - 0.2_f32.sin()).abs() < 1e-6);
                }
                _ => panic!(),
            }
        }
        seen.sort_by(|a, b| a.0.cmp(&b.0));
        assert_eq!(seen.len(), 3);
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
        assert!(near(seen[0].1, [1.7, 0.25, 0.0]), "its own way and the ground's: {:?}", seen[0]);
        assert!(near(seen[1].1, [2.2, 0.0, 0.0]) && near(seen[2].1, [0.2, 0.0, 0.0]), "the room moves");
        let (a, b) =
            (read_glb(&file, &ReadLimits::default()).unwrap(), read_glb(&out, &ReadLimits::default()).unwrap());
        assert_eq!(a.nodes.len(), b.nodes.len());
        assert!(a.nodes.iter().zip(&b.nodes).all(|(x, y)| x.name == y.name && x.transform == y.transform));
    }

    #[test]
    fn a_lamp_takes_its_light_along() {
        let (_, shaken) = file_and_motion();
        let light = |id: &str, object: Option<&str>, position| Light {
            id: id.into(),
            kind: LightKind::Area { direction: [0.0, -1.0, 0.0], size_m: [0.1, 0.1] },
            position,
            color: [1.0; 3],
            intensity: 5.0,
            on: true,
            object: object.map(|o| ObjectId::new(o).unwrap()),
            shade: None,
        };
        let lighting = Lighting {
            lights: vec![
                light("lamp", Some("box_01"), [1.0, 0.5, 0.0]),
                light("other", Some("box_02"), [2.0, 0.5, 0.0]),
                light("sky", None, [0.0, 2.0, 0.0]),
            ],
            ambient_color: [1.0; 3],
            ambient_intensity: 0.0,
            exposure: 0.0,
            view: ViewTransform::Standard,
        };
        let mesh = Arc::new(cuboid_mesh(Vec3::ONE));
        let node = |name: &str| GlbNode {
            name: name.into(),
            mesh: Arc::clone(&mesh),
            transform: NodeTransform { translation: Vec3::ZERO, yaw: 0.0, scale: Vec3::ONE },
            extras: Value::Null,
        };
        let objects = vec![node("box_01"), node("box_02")];
        let scene = GlbScene { objects, lighting: Some(&lighting), ..GlbScene::default() };
        let out = animated_glb(&glb_bytes(&scene).unwrap(), &shaken).unwrap();
        let gltf = gltf::Gltf::from_slice(&out).unwrap();
        let blob = gltf.blob.clone().unwrap();
        let (mut places, mut turns) = (Vec::new(), Vec::new());
        let animation = gltf.animations().next().unwrap();
        for channel in animation.channels().filter(|c| c.target().node().light().is_some()) {
            assert_eq!(channel.target().node().name(), Some("lamp"), "others stay in their room");
            let reader = channel.reader(|_| Some(blob.as_slice()));
            match reader.read_outputs().unwrap() {
                gltf::animation::util::ReadOutputs::Translations(t) => places.extend(t),
                gltf::animation::util::ReadOutputs::Rotations(r) => turns.extend(r.into_f32()),
                _ => panic!(),
            }
        }
        // Half a metre above what goes to (1.5, 0.25) and turns by 0.4 rad; the ground comes from the node above.
        let wanted = Vec3::new(1.5 - 0.5 * 0.4_f64.sin(), 0.25 + 0.5 * 0.4_f64.cos(), 0.0);
        assert!(Vec3::from_array(places[2].map(f64::from)).distance(wanted) < 1e-6, "{:?}", places[2]);
        let down = DQuat::from_array(turns[2].map(f64::from)) * Vec3::NEG_Z;
        assert!(down.distance(Vec3::new(0.4_f64.sin(), -(0.4_f64.cos()), 0.0)) < 1e-6, "{down}");
    }

    #[test]
    fn a_still_is_one_frame_in_the_room() {
        let (file, shaken) = file_and_motion();
        let out = read_glb(&still_glb(&file, &shaken, 2).unwrap(), &ReadLimits::default()).unwrap();
        let node = out.nodes.iter().find(|n| n.name == "box_01").unwrap();
        assert!(node.transform.translation.distance(Vec3::new(1.5, 0.25, 0.0)) < 1e-6);
        let up = node.transform.matrix3 * Vec3::Y;
        assert!(
            up.distance(Vec3::new(-(0.4_f64.sin()), 0.4_f64.cos(), 0.0) * 0.5) < 1e-6,
            "turned and still half the size: {up}"
        );
    }

    #[test]
    fn broken_files_are_refused() {
        let (file, mut shaken) = file_and_motion();
        assert!(matches!(animated_glb(b"glTF", &shaken), Err(AnimateError::NotGlb)));
        assert!(matches!(animated_glb(&file[..file.len() / 2], &shaken), Err(AnimateError::NotGlb)));
        shaken.objects[0].id = "nobody_01".into();
        let said = animated_glb(&file, &shaken).unwrap_err().to_string();
        assert!(said.contains("nobody_01"), "{said}");
        assert!(still_glb(&file, &shaken, 0).is_err());
    }
}
