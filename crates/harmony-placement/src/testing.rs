//! A small room and boxes for the tests of this crate.

use std::sync::Arc;

use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Level, Mask, ObjectId, Placement, Pose, Relations, Room, Size, Support,
    Vec3,
};

use crate::{Evidence, Item, PartialScene, Placed, Shape, Traits, YawHint};

/// A closed box: bottom at y = 0, centred in x and z.
pub(crate) fn box_mesh(size: Vec3) -> Mesh {
    let h = (size / 2.0).as_vec3();
    let mut mesh = Mesh { materials: vec![Material::plain("box", [0.5; 3])], ..Mesh::default() };
    for i in 0..8_u32 {
        let pick = |bit: u32, v: f32| if i & bit == 0 { -v } else { v };
        mesh.positions.push(glam::Vec3::new(pick(1, h.x), pick(2, h.y) + h.y, pick(4, h.z)));
        mesh.uvs.push(glam::Vec2::ZERO);
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    mesh.groups.push(Group { material: 0, triangles });
    mesh.recompute_normals();
    mesh
}

/// Boxes, each with its size and the place of its bottom's centre, as one thing whose hulls are the boxes.
pub(crate) fn of_boxes(parts: &[(Vec3, Vec3)]) -> Shape {
    let mut all = Mesh::default();
    for (size, at) in parts {
        let mesh = box_mesh(*size);
        let first = all.positions.len() as u32;
        all.positions.extend(mesh.positions.iter().map(|p| *p + at.as_vec3()));
        all.uvs.extend(&mesh.uvs);
        all.materials = mesh.materials;
        let triangles = mesh.groups[0].triangles.iter().map(|t| t.map(|i| i + first)).collect();
        all.groups.push(Group { material: 0, triangles });
    }
    all.recompute_normals();
    let hulls = all.positions.chunks(8).map(|part| part.iter().map(|p| p.as_dvec3()).collect()).collect();
    Shape::new(Arc::new(all), hulls)
}

/// A room of 4 x 2.5 x 5 metres, seen from its front.
pub(crate) fn empty_room() -> PartialScene {
    let size = ImageSize::new(640, 480);
    let camera = Camera::looking(
        size,
        Intrinsics::from_horizontal_fov(size, 1.25),
        Vec3::new(2.2, 1.5, 4.8),
        Vec3::new(-0.05, -0.2, -1.0),
    );
    let room = Room {
        room_type: "test".to_owned(),
        extents: Extents { width: 4.0, height: 2.5, depth: 5.0 },
        shape: harmony_scene::RoomShape::default(),
        seen: Vec::new(),
        openings: Vec::new(),
        floor_texture: None,
        wall_texture: None,
    };
    PartialScene::new(room, camera, None, None)
}

/// A box as an item: seen at a pose, alone.
pub(crate) fn boxed(scene: &PartialScene, size: Vec3, position: Vec3, yaw: f64) -> Item {
    let shape = Arc::new(Shape::new(Arc::new(box_mesh(size)), Vec::new()));
    let mask = seen(scene, &shape, &Pose::new(position, yaw, 1.0));
    Item {
        id: ObjectId::numbered("box", 1),
        index: 10,
        level: Level::Furniture,
        label: "box".to_owned(),
        shape,
        size: Size::from_vec(size),
        mask: mask.into(),
        relations: Relations::default(),
        placement: Placement::default(),
        host_candidates: Vec::new(),
        traits: Traits::default(),
        yaw: YawHint::Unknown,
        detection: None,
    }
}

/// The mask of a shape at a pose, alone in the image.
pub(crate) fn seen(scene: &PartialScene, shape: &Shape, pose: &Pose) -> Mask {
    let mut depth = vec![0.0; scene.camera.size.pixels()];
    crate::observe::raster::rasterise(&scene.camera, shape.proxy(), pose, &mut depth);
    let width = scene.camera.size.width;
    Mask::from_fn(scene.camera.size, |x, y| depth[(y * width + x) as usize] > 0.0)
}

/// Adds a box to a scene, on the floor unless `change` says otherwise, with the mask that it has there alone.
pub(crate) fn add(scene: &mut PartialScene, name: &str, size: Vec3, at: Vec3, change: impl FnOnce(&mut Placed)) {
    let mut item = boxed(scene, size, at, 0.0);
    item.id = ObjectId::new(name).unwrap();
    let (pose, evidence) = (Pose::new(at, 0.0, 1.0), Evidence::default());
    let mut placed = Placed { item: Arc::new(item), pose, support: Support::Floor, evidence };
    change(&mut placed);
    scene.placed.push(placed);
}
