//! A small furnished room as meshes and as a GLB file, for the tests with Blender.

use std::path::Path;

use glam::{DVec3, Vec2, Vec3};
use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Light, LightKind, Lighting};
use serde_json::{Value, json};

pub const ROOM: Extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };

/// A named mesh in room coordinates, with its id.
pub struct Node {
    pub name: &'static str,
    pub id: u32,
    pub mesh: Mesh,
}

fn quad(mesh: &mut Mesh, corners: [DVec3; 4]) {
    let base = mesh.positions.len() as u32;
    let c = [corners[0].as_vec3(), corners[1].as_vec3(), corners[2].as_vec3(), corners[3].as_vec3()];
    let normal = (c[1] - c[0]).cross(c[3] - c[0]).normalize_or(Vec3::Y);
    mesh.positions.extend(c);
    mesh.normals.extend([normal; 4]);
    mesh.uvs.extend([Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(1.0, 0.0), Vec2::new(0.0, 0.0)]);
    let group = mesh.groups.last_mut().unwrap();
    group.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
}

fn start(mesh: &mut Mesh, name: &str, colour: [f32; 3]) {
    mesh.materials.push(Material::plain(name, colour));
    mesh.groups.push(Group { material: mesh.materials.len() - 1, triangles: Vec::new() });
}

fn add_box(mesh: &mut Mesh, name: &str, colour: [f32; 3], min: DVec3, max: DVec3) {
    start(mesh, name, colour);
    let p = |x: bool, y: bool, z: bool| {
        DVec3::new(if x { max.x } else { min.x }, if y { max.y } else { min.y }, if z { max.z } else { min.z })
    };
    let (f, t) = (false, true);
    quad(mesh, [p(f, f, t), p(t, f, t), p(t, t, t), p(f, t, t)]);
    quad(mesh, [p(t, f, f), p(f, f, f), p(f, t, f), p(t, t, f)]);
    quad(mesh, [p(t, f, t), p(t, f, f), p(t, t, f), p(t, t, t)]);
    quad(mesh, [p(f, f, f), p(f, f, t), p(f, t, t), p(f, t, f)]);
    quad(mesh, [p(f, t, t), p(t, t, t), p(t, t, f), p(f, t, f)]);
    quad(mesh, [p(f, f, f), p(t, f, f), p(t, f, t), p(f, f, t)]);
}

fn boxed(name: &'static str, id: u32, colour: [f32; 3], min: [f64; 3], max: [f64; 3]) -> Node {
    let mut mesh = Mesh::default();
    add_box(&mut mesh, name, colour, min.into(), max.into());
    Node { name, id, mesh }
}

fn face(name: &'static str, id: u32, colour: [f32; 3], corners: [[f64; 3]; 4]) -> Node {
    let mut mesh = Mesh::default();
    start(&mut mesh, name, colour);
    quad(&mut mesh, corners.map(DVec3::from_array));
    Node { name, id, mesh }
}

/// Walls facing in, a bed, a cabinet, a table with a lamp (closed shade), a window pane on the left wall.
pub fn nodes() -> Vec<Node> {
    let (w, h, d) = (ROOM.width, ROOM.height, ROOM.depth);
    let mut bed = Mesh::default();
    add_box(&mut bed, "frame", [0.7, 0.66, 0.6], DVec3::new(0.9, 0.0, 0.1), DVec3::new(2.5, 0.4, 2.1));
    add_box(&mut bed, "cover", [0.5, 0.4, 0.42], DVec3::new(0.9, 0.4, 0.1), DVec3::new(2.5, 0.5, 2.1));
    let mut lamp = Mesh::default();
    add_box(&mut lamp, "body", [0.2, 0.2, 0.2], DVec3::new(3.33, 0.6, 0.63), DVec3::new(3.37, 0.85, 0.67));
    add_box(&mut lamp, "shade", [0.8, 0.7, 0.5], DVec3::new(3.2, 0.85, 0.5), DVec3::new(3.5, 1.1, 0.8));
    vec![
        face("floor", 1, [0.35, 0.22, 0.13], [[0.0, 0.0, d], [w, 0.0, d], [w, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        face("ceiling", 2, [0.8, 0.8, 0.8], [[0.0, h, 0.0], [w, h, 0.0], [w, h, d], [0.0, h, d]]),
        face("back", 3, [0.6, 0.62, 0.58], [[0.0, 0.0, 0.0], [w, 0.0, 0.0], [w, h, 0.0], [0.0, h, 0.0]]),
        face("right", 4, [0.7, 0.7, 0.7], [[w, 0.0, 0.0], [w, 0.0, d], [w, h, d], [w, h, 0.0]]),
        face("front", 5, [0.7, 0.7, 0.7], [[w, 0.0, d], [0.0, 0.0, d], [0.0, h, d], [w, h, d]]),
        face("left", 6, [0.7, 0.7, 0.7], [[0.0, 0.0, d], [0.0, 0.0, 0.0], [0.0, h, 0.0], [0.0, h, d]]),
        Node { name: "bed_01", id: 10, mesh: bed },
        boxed("cabinet_01", 11, [0.3, 0.15, 0.08], [3.4, 0.0, 1.6], [3.95, 1.4, 2.8]),
        boxed("table_01", 12, [0.4, 0.3, 0.2], [3.0, 0.0, 0.35], [3.7, 0.6, 0.95]),
        Node { name: "lamp_01", id: 13, mesh: lamp },
        boxed("window_01", 14, [0.9, 0.9, 0.9], [0.0, 0.9, 1.4], [0.04, 2.0, 2.6]),
    ]
}

/// A red cupboard in the left corner, up to the ceiling.
pub fn tall_cupboard() -> Node {
    boxed("cupboard_01", 16, [0.6, 0.3, 0.2], [0.05, 0.0, 0.05], [1.0, 2.59, 1.0])
}

/// Red boards along the front wall and the back wall, one mesh.
pub fn skirting() -> Node {
    let (w, d) = (ROOM.width, ROOM.depth);
    let mut mesh = Mesh::default();
    add_box(&mut mesh, "red", [0.8, 0.05, 0.05], DVec3::new(0.0, 0.0, d - 0.03), DVec3::new(w, 0.3, d));
    add_box(&mut mesh, "red_too", [0.8, 0.05, 0.05], DVec3::new(0.0, 0.0, 0.0), DVec3::new(w, 0.3, 0.03));
    Node { name: "skirting", id: 17, mesh }
}

/// A board under the ceiling with a strip on it that shines up.
pub fn cove() -> Node {
    let mut mesh = Mesh::default();
    add_box(&mut mesh, "board", [0.6, 0.6, 0.6], DVec3::new(1.0, 2.28, 0.6), DVec3::new(3.0, 2.3, 1.0));
    add_box(&mut mesh, "strip", [0.9, 0.9, 0.9], DVec3::new(1.1, 2.3, 0.75), DVec3::new(2.9, 2.31, 0.85));
    mesh.materials[1].emissive = [1.0, 0.8, 0.5];
    Node { name: "cove_01", id: 15, mesh }
}

/// The frame and the bar of the window alone, 12 cm deep: what its rectangle of daylight lies within.
pub fn window_frame() -> Node {
    let mut mesh = Mesh::default();
    let sides = [
        [0.9, 1.0, 1.4, 2.6],
        [1.9, 2.0, 1.4, 2.6],
        [1.0, 1.9, 1.4, 1.5],
        [1.0, 1.9, 2.5, 2.6],
        [1.0, 1.9, 1.95, 2.05],
    ];
    for [bottom, top, from, to] in sides {
        add_box(&mut mesh, "frame", [0.8; 3], DVec3::new(0.0, bottom, from), DVec3::new(0.12, top, to));
    }
    Node { name: "window_01", id: 14, mesh }
}

/// A rug of twelve sheets on the bed, red ones and a green one at last, each a fifth of a millimetre above the one before; and
/// two green sheets more that share the top's plane.
pub fn layered_rug() -> Node {
    let mut mesh = Mesh::default();
    let sheet = |mesh: &mut Mesh, name, colour, top: f64| {
        add_box(mesh, name, colour, DVec3::new(1.0, 0.5, 0.6), DVec3::new(2.4, 0.502 + top, 1.9));
    };
    for k in 0..12 {
        sheet(&mut mesh, "red", [0.8, 0.02, 0.02], 2e-4 * f64::from(k));
    }
    for _ in 0..3 {
        sheet(&mut mesh, "green", [0.02, 0.8, 0.02], 2e-4 * 12.0);
    }
    Node { name: "rug_01", id: 18, mesh }
}

/// Looks into the back of the room, a little down, with an off-centre lens and unequal focal lengths.
pub fn camera(width: u32) -> Camera {
    let size = ImageSize::new(640, 480);
    let lens = Intrinsics { fx: 470.0, fy: 500.0, cx: 335.0, cy: 222.0 };
    Camera::looking(size, lens, DVec3::new(2.3, 1.6, 4.7), DVec3::new(-0.12, -0.18, -1.0))
        .resized(ImageSize::new(width, width * 3 / 4))
}

/// The lights of the room: a window, the lamp, some ambient light.
pub fn lighting() -> Lighting {
    let light = |id: &str, kind, position, color, intensity| Light {
        id: id.to_owned(),
        kind,
        position,
        color,
        intensity,
        on: true,
        object: Some(harmony_scene::ObjectId::new(id).unwrap()),
        shade: None,
    };
    Lighting {
        lights: vec![
            light(
                "window_01",
                LightKind::Area { direction: [1.0, 0.0, 0.0], size_m: [1.2, 1.1] },
                [0.06, 1.45, 2.0],
                [0.86, 0.93, 1.0],
                35.0,
            ),
            light("lamp_01", LightKind::Point { radius_m: 0.04 }, [3.35, 0.98, 0.65], [1.0, 0.8, 0.6], 12.0),
        ],
        ambient_color: [1.0; 3],
        ambient_intensity: 0.15,
        exposure: 0.0,
        view: harmony_scene::ViewTransform::Agx,
    }
}

/// Writes nodes as a GLB: positions and normals, one plain material a group.
pub fn write_glb(nodes: &[Node], path: &Path) {
    let (mut bin, mut views, mut accessors, mut meshes, mut gltf_nodes, mut materials) =
        (Vec::<u8>::new(), Vec::<Value>::new(), Vec::<Value>::new(), Vec::new(), Vec::new(), Vec::<Value>::new());
    let mut push = |bytes: Vec<u8>, kind: u32, count: usize, shape: &str, bounds: Option<(Vec3, Vec3)>| -> usize {
        views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len()}));
        bin.extend(bytes);
        let mut a = json!({"bufferView": views.len() - 1, "componentType": kind, "count": count, "type": shape});
        if let Some((min, max)) = bounds {
            a["min"] = json!(min.to_array());
            a["max"] = json!(max.to_array());
        }
        accessors.push(a);
        accessors.len() - 1
    };
    let floats =
        |v: &[Vec3]| v.iter().copied().flat_map(<[f32; 3]>::from).flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    for node in nodes {
        let m = &node.mesh;
        let min = m.positions.iter().copied().reduce(Vec3::min).unwrap();
        let max = m.positions.iter().copied().reduce(Vec3::max).unwrap();
        let position = push(floats(&m.positions), 5126, m.positions.len(), "VEC3", Some((min, max)));
        let normal = push(floats(&m.normals), 5126, m.normals.len(), "VEC3", None);
        let mut primitives = Vec::new();
        for group in &m.groups {
            let flat: Vec<u32> = group.triangles.iter().flatten().copied().collect();
            let bytes = flat.iter().flat_map(|i| i.to_le_bytes()).collect();
            let indices = push(bytes, 5125, flat.len(), "SCALAR", None);
            let material = &m.materials[group.material];
            materials.push(json!({"name": material.name, "emissiveFactor": material.emissive, "pbrMetallicRoughness":
                {"baseColorFactor": material.base_color, "metallicFactor": 0.0, "roughnessFactor": material.roughness}}));
            primitives.push(json!({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices,
                "material": materials.len() - 1}));
        }
        meshes.push(json!({"primitives": primitives}));
        gltf_nodes.push(json!({"name": node.name, "mesh": meshes.len() - 1}));
    }
    let roots: Vec<usize> = (0..nodes.len()).collect();
    let document = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "nodes": gltf_nodes,
        "meshes": meshes, "materials": materials, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": bin.len()}]});
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let total = 12 + 8 + text.len() + 8 + bin.len();
    let mut file = Vec::with_capacity(total);
    file.extend(b"glTF");
    for v in [2, total as u32, text.len() as u32] {
        file.extend(v.to_le_bytes());
    }
    file.extend(b"JSON");
    file.extend(text);
    file.extend((bin.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(bin);
    std::fs::write(path, file).unwrap();
}
