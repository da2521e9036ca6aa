//! Runs made from a known home.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};
use harmony_export::World;
use harmony_export::world::{Face, Item};
use harmony_home::frame::{Place, in_room, sides};
use harmony_home::layout::HomeLayout;
use harmony_home::rooms::RoomRun;
use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{
    Camera, Confidence, Extents, ImageSize, Intrinsics, Level, Lighting, MaterialCategory, ObjectId, Opening,
    OpeningKind, Physical, Pose, QuarterTurn, Relations, Room, RoomShape, SCENE_VERSION, Scene, SceneCamera,
    SceneObject, Size, Support, Surface, SurfaceMaterial, Wall, WallAffinity,
};

/// A box of a size, its bottom at y = 0, centred.
pub fn solid(size: DVec3) -> Mesh {
    let mut mesh = Mesh { materials: vec![Material::plain("body", [0.5, 0.4, 0.3])], ..Mesh::default() };
    let mut triangles = Vec::new();
    for n in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
        let u = if n.y == 0.0 { Vec3::Y.cross(n) } else { Vec3::X };
        let v = n.cross(u);
        let base = mesh.positions.len() as u32;
        for (a, b) in [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)] {
            mesh.positions.push((n * 0.5 + u * a + v * b + Vec3::Y * 0.5) * size.as_vec3());
            mesh.normals.push(n);
            mesh.uvs.push(glam::Vec2::new(a + 0.5, 0.5 - b));
        }
        triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    mesh.groups = vec![Group { material: 0, triangles }];
    mesh
}

/// An object of a run.
pub fn thing(id: &str, label: &str, size: [f64; 3], position: [f64; 3], yaw: f64) -> Item {
    let size = DVec3::from_array(size);
    let object = SceneObject {
        id: ObjectId::new(id).unwrap(),
        index: 10,
        level: Level::Furniture,
        label: label.to_owned(),
        description: String::new(),
        source_phrase: String::new(),
        pose: Pose::new(DVec3::from_array(position), yaw, 1.0),
        size: Size::from_vec(size),
        support: Support::Floor,
        relations: Relations::default(),
        material: SurfaceMaterial {
            category: MaterialCategory::Wood,
            pbr: MaterialCategory::Wood.defaults(),
            physical: Physical { weight_kg: 10.0, thickness_m: 0.02, elasticity: 0.1, rigid: None },
        },
        mesh: String::new(),
        mask: None,
        seen_box: None,
        mesh_source: "test".to_owned(),
        confidence: Confidence { overall: 0.5, ..Confidence::default() },
    };
    Item::new(object, Arc::new(solid(size)))
}

/// The same with its back to a wall.
pub fn at_wall(mut item: Item, wall: Wall) -> Item {
    item.object.relations.wall_affinity = WallAffinity::from(wall);
    item
}

/// The same on a wall.
pub fn on_wall(mut item: Item, wall: Wall) -> Item {
    item.object.level = Level::Wall;
    item.object.support = Support::Wall { wall };
    item.object.relations.wall_affinity = WallAffinity::from(wall);
    item
}

/// The same on another.
pub fn on(mut item: Item, host: &str) -> Item {
    item.object.level = Level::Decoration;
    item.object.support = Support::Object { id: ObjectId::new(host).unwrap() };
    item
}

/// A scene with its meshes.
pub fn world(extents: Extents, seen: Vec<Surface>, openings: Vec<Opening>, items: Vec<Item>) -> World {
    let size = ImageSize::new(640, 480);
    let eye = DVec3::new(extents.width / 2.0, 1.5, extents.depth - 0.3);
    let camera = Camera::looking(size, Intrinsics::from_horizontal_fov(size, 1.2), eye, DVec3::new(0.1, -0.2, -1.0));
    let scene = Scene {
        version: SCENE_VERSION,
        generator: "test".to_owned(),
        room: Room {
            room_type: "room".to_owned(),
            extents,
            shape: RoomShape::default(),
            seen,
            openings,
            floor_texture: None,
            wall_texture: None,
        },
        camera: SceneCamera::from(&camera),
        objects: items.iter().map(|i| i.object.clone()).collect(),
        lighting: Lighting {
            lights: Vec::new(),
            ambient_color: [1.0; 3],
            ambient_intensity: 0.5,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::default(),
        },
        summary: String::new(),
        warnings: Vec::new(),
    };
    let floor =
        Face { name: "floor".to_owned(), mesh: Arc::new(solid(DVec3::new(extents.width, 0.001, extents.depth))) };
    World::new(scene, vec![floor], items, Vec::new())
}

/// How a run's room is off.
#[derive(Debug, Clone, Copy)]
pub struct Off {
    /// Everything of the run is too large by this factor.
    pub scale: f64,
    /// The front wall, which no photo shows, is guessed too far by so much, metres.
    pub front: f64,
    /// Doors are off along their walls, metres.
    pub door: f64,
}

/// A run that would be an exact photo of a layout's room but for `off`; a cabinet stands in the middle of its back wall.
///
/// The photo shows all but the front wall, and doors in it.
pub fn run(layout: &HomeLayout, room: usize, turn: QuarterTurn, off: Off) -> RoomRun {
    let wanted = &layout.rooms[room];
    let rect = wanted.bounds();
    let height = wanted.height.unwrap();
    let size = sides(turn, &Extents { width: rect.size().x, height, depth: rect.size().y });
    let k = off.scale;
    let extents = Extents { width: size.x * k, height: height * k, depth: size.y * k + off.front };
    let mut openings = Vec::new();
    let mut items = Vec::new();
    for (n, door) in layout.doors.iter().enumerate() {
        let Some(seat) = layout.sides(n).unwrap().into_iter().find(|s| s.room == room) else { continue };
        let at = if matches!(seat.side, Wall::Left | Wall::Right) { door.at.y } else { door.at.x };
        let (wall, u) = in_room(&rect, turn, seat.side, at);
        if wall == Wall::Front {
            continue;
        }
        let (u, width, top) = (u * k + off.door, door.width * k, door.height.unwrap() * k);
        let id = format!("door_{:02}", n + 1);
        let foot = wall.point(&extents, u, 0.0) + wall.normal() * 0.03;
        items.push(on_wall(thing(&id, "door", [width, top, 0.06], foot.to_array(), wall.yaw()), wall));
        openings.push(Opening {
            kind: OpeningKind::Door,
            wall,
            u: [u - width / 2.0, u + width / 2.0],
            y: [0.0, top],
            inset: 0.0,
            rise: 0.0,
            object: Some(ObjectId::new(&id).unwrap()),
        });
    }
    let cabinet = [1.0 * k, 0.8 * k, 0.4 * k];
    let at = [extents.width / 2.0, 0.0, 0.25 * k];
    items.push(at_wall(thing("cabinet_01", "cabinet", cabinet, at, 0.0), Wall::Back));
    items.push(on(
        thing("vase_01", "vase", [0.1 * k, 0.3 * k, 0.1 * k], [at[0] + 0.2 * k, 0.8 * k, at[2]], 0.3),
        "cabinet_01",
    ));
    let seen = Surface::ALL.into_iter().filter(|s| *s != Surface::Front).collect();
    let name = wanted.name.clone();
    RoomRun {
        run: PathBuf::from(format!("runs/{name}")),
        name,
        named: false,
        world: world(extents, seen, openings, items),
    }
}

/// Where that cabinet's middle is in the home, its floor.
pub fn cabinet(layout: &HomeLayout, room: usize, turn: QuarterTurn) -> DVec2 {
    let rect = layout.rooms[room].bounds();
    let size = sides(turn, &Extents { width: rect.size().x, height: 2.5, depth: rect.size().y });
    let extents = Extents { width: size.x, height: 2.5, depth: size.y };
    let place = Place { turn, yaw: 0.0, scale: 1.0, at: rect.centre(), floor: 0.0 };
    let p = place.point(&extents, DVec3::new(extents.width / 2.0, 0.0, 0.25));
    DVec2::new(p.x, p.z)
}

/// A flat of three rooms: living room and kitchen side by side, a bedroom behind the kitchen.
pub fn flat() -> HomeLayout {
    HomeLayout::parse(
        r#"{"version": 1, "wall_thickness": 0.12, "rooms": [
            {"name": "living", "rectangle": {"min": [0, 0], "max": [5.0, 6.12]}, "height": 2.6},
            {"name": "kitchen", "rectangle": {"min": [5.12, 0], "max": [8.3, 2.9]}, "height": 2.6},
            {"name": "bedroom", "rectangle": {"min": [5.12, 3.02], "max": [9.4, 6.12]}, "height": 2.6}],
          "doors": [{"rooms": ["living", "kitchen"], "at": [5.06, 1.2], "width": 0.9, "height": 2.05},
                    {"rooms": ["living", "bedroom"], "at": [5.06, 4.1], "width": 0.82, "height": 2.0}]}"#,
    )
    .unwrap()
}

/// Turns in which the photos of the flat's rooms show all their doors.
pub fn turns() -> [QuarterTurn; 3] {
    let facing = |side: Wall| QuarterTurn::bringing(Wall::Back, side);
    assert_eq!(Wall::Left.opposite(), Wall::Right);
    [facing(Wall::Right), facing(Wall::Left), facing(Wall::Back)]
}
