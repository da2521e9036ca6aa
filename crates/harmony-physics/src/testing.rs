//! Small scenes for the tests of this crate.

use std::sync::Arc;

use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{
    Camera, Confidence, Extents, ImageSize, Intrinsics, Level, Lighting, MaterialCategory, ObjectId, Pose, Relations,
    Room, SCENE_VERSION, Scene, SceneObject, Size, Support, SurfaceMaterial, Vec3,
};

use crate::hull::Hull;

pub(crate) fn room() -> Room {
    Room {
        room_type: "study".into(),
        extents: Extents { width: 5.0, height: 2.6, depth: 4.0 },
        shape: harmony_scene::RoomShape::default(),
        seen: vec![],
        openings: vec![],
        floor_texture: None,
        wall_texture: None,
    }
}

pub(crate) fn object(id: &str, label: &str, level: Level, support: Support) -> SceneObject {
    let category = harmony_catalogue::material_category(label);
    let size = harmony_catalogue::default_size(label);
    SceneObject {
        id: ObjectId::new(id).unwrap(),
        index: 10,
        level,
        label: label.into(),
        description: String::new(),
        source_phrase: label.into(),
        pose: Pose::new(Vec3::new(2.0, 0.0, 2.0), 0.0, 1.0),
        size,
        support,
        relations: Relations::default(),
        material: SurfaceMaterial {
            category,
            pbr: category.defaults(),
            physical: harmony_scene::Physical { weight_kg: f64::NAN, thickness_m: 0.01, elasticity: 0.1, rigid: None },
        },
        mesh: String::new(),
        mask: None,
        seen_box: None,
        mesh_source: "test".into(),
        confidence: Confidence::default(),
    }
}

pub(crate) fn scene(objects: Vec<SceneObject>) -> Scene {
    let size = ImageSize::new(64, 48);
    let lens = Intrinsics::from_horizontal_fov(size, 1.1);
    let camera = Camera::looking(size, lens, Vec3::new(2.5, 1.5, 3.9), Vec3::NEG_Z);
    Scene {
        version: SCENE_VERSION,
        generator: "test".into(),
        room: room(),
        camera: (&camera).into(),
        objects,
        lighting: Lighting {
            lights: vec![],
            ambient_color: [1.0; 3],
            ambient_intensity: 1.0,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::default(),
        },
        summary: String::new(),
        warnings: vec![],
    }
}

/// A box with its bottom centre at the origin.
pub(crate) fn cuboid_mesh(size: Vec3) -> Mesh {
    let half = Vec3::new(size.x / 2.0, 0.0, size.z / 2.0);
    hull_mesh(&[Hull::cuboid(-half, size - half)])
}

pub(crate) fn hull_mesh(hulls: &[Hull]) -> Mesh {
    let mut mesh = Mesh { materials: vec![Material::plain("body", [0.5; 3])], ..Mesh::default() };
    let mut group = Group::default();
    for hull in hulls {
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(hull.vertices.iter().map(|v| v.as_vec3()));
        group.triangles.extend(hull.faces.iter().map(|f| f.map(|i| i + base)));
    }
    mesh.groups.push(group);
    mesh.uvs = vec![glam::Vec2::ZERO; mesh.positions.len()];
    mesh.recompute_normals();
    mesh
}

/// An upright box of a label, with its mesh.
pub(crate) fn cuboid(id: &str, label: &str, size: Vec3, position: Vec3, support: Support) -> (SceneObject, Arc<Mesh>) {
    let level = if support == Support::Floor { Level::Furniture } else { Level::Decoration };
    let mut o = object(id, label, level, support);
    o.size = Size::from_vec(size);
    o.pose.position = position;
    o.material.category = MaterialCategory::Wood;
    (o, Arc::new(cuboid_mesh(size)))
}
