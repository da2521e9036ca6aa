//! Runs of a made-up room, as reconstructions of its photos would have it.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use harmony_mesh::{Group, Material, Mesh, room_shell};
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::{
    Camera, Confidence, Extents, ImageSize, Intrinsics, Level, Lighting, MaterialCategory, ObjectId, PbrFactors,
    Physical, Pose, QuarterTurn, Relations, Room, RoomShape, Scene, SceneCamera, SceneObject, Size, Support, Surface,
    SurfaceMaterial, ViewTransform,
};

use crate::depth::SeenDepth;
use crate::source::{SeenObject, Source, kind_of};

/// A box on the floor: label, `(x, z)`, yaw, size.
pub struct Box3 {
    pub label: &'static str,
    pub at: [f64; 2],
    pub yaw: f64,
    pub size: [f64; 3],
}

pub fn thing(label: &'static str, at: [f64; 2], yaw: f64, size: [f64; 3]) -> Box3 {
    Box3 { label, at, yaw, size }
}

/// 4.2 m by 3.4 m.
pub const ROOM: Extents = Extents { width: 4.2, height: 2.5, depth: 3.4 };

/// Six different things.
pub fn furnished() -> Vec<Box3> {
    vec![
        thing("sofa", [1.2, 0.5], 0.0, [1.9, 0.8, 0.9]),
        thing("bookcase", [3.9, 0.9], -std::f64::consts::FRAC_PI_2, [0.9, 1.9, 0.35]),
        thing("coffee table", [1.5, 1.6], 0.0, [1.0, 0.42, 0.6]),
        thing("armchair", [3.0, 2.2], 2.4, [0.8, 0.85, 0.8]),
        thing("desk", [0.4, 2.6], std::f64::consts::FRAC_PI_2, [1.3, 0.74, 0.6]),
        thing("waste bin", [0.3, 1.3], 0.0, [0.25, 0.3, 0.25]),
    ]
}

/// A run of a photo that faces the wall which `turn` makes the back wall: scaled by `scale`, each place off by its
/// number in `off` (metres along the line of sight).
pub fn source(name: &str, extents: Extents, things: &[Box3], turn: QuarterTurn, scale: f64, off: &[f64]) -> Source {
    let own = turn.extents(&extents);
    let size = ImageSize::new(640, 480);
    let eye = DVec3::new(own.width * 0.45, 1.5, own.depth - 0.2);
    let aim = DVec3::new(own.width * 0.5, 0.6, own.depth * 0.3);
    let camera = Camera::looking(size, Intrinsics::from_horizontal_fov(size, 1.5), eye, aim - eye);
    let mut objects: Vec<SceneObject> = Vec::new();
    for (k, t) in things.iter().enumerate() {
        let true_place = turn.point(&extents, DVec3::new(t.at[0], 0.0, t.at[1]));
        if camera.project(true_place).is_none_or(|p| !camera.contains(p)) {
            continue;
        }
        let way = (true_place - eye) * DVec3::new(1.0, 0.0, 1.0);
        let place = (true_place + way.normalize() * off.get(k).copied().unwrap_or(0.0)) * scale;
        objects.push(object(t, objects.len(), Pose::new(place, turn.yaw(t.yaw), scale)));
    }
    let room = Room {
        room_type: "living_room".to_owned(),
        extents: Extents { width: own.width * scale, height: own.height * scale, depth: own.depth * scale },
        shape: RoomShape::default(),
        seen: vec![Surface::Floor, Surface::Ceiling, Surface::Back, Surface::Left, Surface::Right],
        openings: Vec::new(),
        floor_texture: None,
        wall_texture: None,
    };
    let camera = Camera { translation: camera.translation * scale, ..camera };
    let shell = room_shell(&room, &|_| None);
    let meshes: Vec<Arc<Mesh>> = objects.iter().map(|o| Arc::new(cuboid(o.size.as_vec() / scale))).collect();
    let small = camera.resized(size.fit_within(160));
    let mut instances = vec![Instance::in_room(&shell, 1)];
    instances.extend(objects.iter().zip(&meshes).map(|(o, mesh)| Instance::posed(mesh, &o.pose, o.index)));
    let depth = render_depth_ids(&small, &instances, &RenderOptions::default()).depth;
    let seen = objects
        .iter()
        .zip(&meshes)
        .map(|(object, mesh)| SeenObject {
            object: object.clone(),
            mesh: Arc::clone(mesh),
            kind: kind_of(&object.label),
            share: 0.02,
            hidden: 0.0,
            cut: false,
            lab: None,
            spread: None,
        })
        .collect();
    let scene = Scene {
        version: 1,
        generator: String::new(),
        room,
        camera: SceneCamera::from(&camera),
        objects,
        lighting: Lighting {
            lights: Vec::new(),
            ambient_color: [1.0; 3],
            ambient_intensity: 1.0,
            exposure: 0.0,
            view: ViewTransform::Standard,
        },
        summary: String::new(),
        warnings: Vec::new(),
    };
    Source {
        folder: PathBuf::from(name),
        name: name.to_owned(),
        camera,
        objects: seen,
        depth: SeenDepth { camera: small, depth, measured: true },
        passages: Vec::new(),
        scene,
    }
}

fn object(t: &Box3, number: usize, pose: Pose) -> SceneObject {
    let pbr = PbrFactors { roughness: 0.7, metallic: 0.0, ior: 1.5, transmission: 0.0 };
    let physical = Physical { weight_kg: 10.0, thickness_m: 0.02, elasticity: 0.1, rigid: None };
    SceneObject {
        id: ObjectId::numbered(t.label, number + 1),
        index: 10 + number as u32,
        level: Level::Furniture,
        label: t.label.to_owned(),
        description: String::new(),
        source_phrase: t.label.to_owned(),
        size: Size::from_vec(DVec3::from_array(t.size) * pose.scale),
        pose,
        support: Support::Floor,
        relations: Relations::default(),
        material: SurfaceMaterial { category: MaterialCategory::Wood, pbr, physical },
        mesh: String::new(),
        mask: None,
        seen_box: None,
        mesh_source: String::new(),
        confidence: Confidence { overall: 0.8, ..Confidence::default() },
    }
}

/// A box with its bottom at y = 0, centred.
fn cuboid(size: DVec3) -> Mesh {
    let corner = |k: usize| {
        let sign = |bit: usize| if k & bit == 0 { -0.5 } else { 0.5 };
        let p = DVec3::new(sign(1) * size.x, (sign(2) + 0.5) * size.y, sign(4) * size.z);
        p.as_vec3()
    };
    let quads = [[0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    let positions: Vec<Vec3> = (0..8).map(corner).collect();
    let mut mesh = Mesh {
        uvs: vec![glam::Vec2::ZERO; positions.len()],
        positions,
        groups: vec![Group { material: 0, triangles }],
        materials: vec![Material::plain("grey", [0.5; 3])],
        ..Mesh::default()
    };
    mesh.recompute_normals();
    mesh
}
