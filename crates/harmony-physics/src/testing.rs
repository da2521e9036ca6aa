//! Small scenes for the tests of this crate.

use std::sync::Arc;

use harmony_mesh::Mesh;
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Level, Physical, Pose, Room, Scene, SceneObject, Size, Support,
    SurfaceMaterial, Vec3,
};

use crate::hull::Hull;

pub(crate) fn room() -> Room {
    harmony_testing::run::room(Extents { width: 5.0, height: 2.6, depth: 4.0 })
}

/// A thing of its kind's size and matter, of unknown weight.
pub(crate) fn object(id: &str, label: &str, level: Level, support: Support) -> SceneObject {
    let category = harmony_catalogue::material_category(label);
    let pose = Pose::new(Vec3::new(2.0, 0.0, 2.0), 0.0, 1.0);
    let size = harmony_catalogue::default_size(label);
    let physical = Physical { weight_kg: f64::NAN, thickness_m: 0.01, elasticity: 0.1, rigid: None };
    SceneObject {
        level,
        material: SurfaceMaterial { category, pbr: category.defaults(), physical },
        ..harmony_testing::run::object(id, label, pose, size, support)
    }
}

pub(crate) fn scene(objects: Vec<SceneObject>) -> Scene {
    let size = ImageSize::new(64, 48);
    let lens = Intrinsics::from_horizontal_fov(size, 1.1);
    let camera = Camera::looking(size, lens, Vec3::new(2.5, 1.5, 3.9), Vec3::NEG_Z);
    harmony_testing::run::scene(room(), &camera, objects)
}

/// A box with its bottom centre at the origin.
pub(crate) fn cuboid_mesh(size: Vec3) -> Mesh {
    let half = Vec3::new(size.x / 2.0, 0.0, size.z / 2.0);
    hull_mesh(&[Hull::cuboid(-half, size - half)])
}

pub(crate) fn hull_mesh(hulls: &[Hull]) -> Mesh {
    crate::hull::hull_mesh(hulls, [0.5; 3])
}

/// An upright box of a label, with its mesh.
pub(crate) fn cuboid(id: &str, label: &str, size: Vec3, position: Vec3, support: Support) -> (SceneObject, Arc<Mesh>) {
    let level = if support == Support::Floor { Level::Furniture } else { Level::Decoration };
    let mut o = object(id, label, level, support);
    o.size = Size::from_vec(size);
    o.pose.position = position;
    o.material.category = harmony_scene::MaterialCategory::Wood;
    (o, Arc::new(cuboid_mesh(size)))
}
