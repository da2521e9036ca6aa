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

/// An armchair whose back is rounded at its top, 0.98 m high there; its upholstery comes 0.13 m before it.
pub(crate) fn armchair() -> Shape {
    let round = |k: i32| {
        let half = 0.1 * (1.0 - (f64::from(k) / 10.0).powi(2)).sqrt();
        (Vec3::new(0.7, 0.01, 2.0 * half), Vec3::new(0.0, 0.88 + 0.01 * f64::from(k), BACK_Z))
    };
    let arms = [-0.4, 0.4].map(|x| (Vec3::new(0.15, 0.62, 0.85), Vec3::new(x, 0.0, 0.0)));
    let mut parts = vec![
        (Vec3::new(0.65, 0.45, 0.8), Vec3::ZERO),
        (Vec3::new(0.7, 0.88, 0.2), Vec3::new(0.0, 0.0, BACK_Z)),
        (Vec3::new(0.5, 0.4, 0.14), Vec3::new(0.0, 0.4, BACK_Z + 0.16)),
    ];
    parts.extend((0..10).map(round));
    parts.extend(arms);
    of_boxes(&parts)
}

/// Middle of the armchair's back.
pub(crate) const BACK_Z: f64 = -0.33;

/// A throw that hangs 0.32 m down before an edge and 0.6 m behind it, 0.26 m apart and straight, of strips 4 cm high, with
/// shoulders; and what of it is not behind what it hangs over.
pub(crate) fn throw_over_an_edge() -> [Shape; 2] {
    let leaf = |strips: i32, z: f64| {
        (1..=strips).map(move |k| (Vec3::new(0.46, 0.04, 0.014), Vec3::new(0.0, 0.6 - 0.04 * f64::from(k + 1), z)))
    };
    let level = |y: f64, z: f64, depth: f64| (Vec3::new(0.46, 0.014, depth), Vec3::new(0.0, y - 0.014, z));
    let top = [level(0.6, 0.0, 0.13), level(0.55, 0.095, 0.07), level(0.55, -0.095, 0.07)];
    let before: Vec<_> = leaf(7, 0.123).chain(top).collect();
    let whole: Vec<_> = leaf(14, -0.123).chain(before.iter().copied()).collect();
    [of_boxes(&whole), of_boxes(&before)]
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
