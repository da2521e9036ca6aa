use std::f64::consts::FRAC_PI_2;

use glam::Vec3;
use harmony_mesh::{Group, Material};
use harmony_scene::{
    Confidence, Extents, MaterialCategory, PixelBox, Pose, Relations, Size, Support, SurfaceMaterial, Wall,
};

use super::*;

fn of(mesh: &Mesh) -> Emitter<'_> {
    Emitter { mesh: Some(mesh), bulb: None }
}

fn room(openings: Vec<Opening>) -> Room {
    Room {
        room_type: "bedroom".into(),
        extents: Extents { width: 4.0, height: 2.6, depth: 5.0 },
        shape: harmony_scene::RoomShape::default(),
        seen: Vec::new(),
        openings,
        floor_texture: None,
        wall_texture: None,
    }
}

fn object(id: &str, label: &str, level: Level, position: DVec3, yaw: f64, size: DVec3) -> SceneObject {
    let (material, _) = crate::material_for(label, Size::from_vec(size), None);
    let SurfaceMaterial { category, .. } = material;
    assert!(MaterialCategory::ALL.contains(&category));
    SceneObject {
        id: ObjectId::new(id).unwrap(),
        index: 10,
        level,
        label: label.into(),
        description: String::new(),
        source_phrase: String::new(),
        pose: Pose::new(position, yaw, 1.0),
        size: Size::from_vec(size),
        support: Support::Floor,
        relations: Relations::default(),
        material,
        mesh: String::new(),
        mask: None,
        seen_box: None::<PixelBox>,
        mesh_source: String::new(),
        confidence: Confidence::default(),
    }
}

/// A lamp one unit high: a foot, and a shade slot between 0.7 and 1.
fn lamp_mesh() -> Mesh {
    let mut mesh = Mesh {
        materials: vec![Material::plain("body", [0.1; 3]), Material::plain("shade", [0.8; 3])],
        ..Mesh::default()
    };
    for (material, low, high, half) in [(0, 0.0, 0.7, 0.05), (1, 0.7, 1.0, 0.2)] {
        let base = mesh.positions.len() as u32;
        for y in [low, high] {
            for (x, z) in [(-half, -half), (half, -half), (half, half), (-half, half)] {
                mesh.positions.push(Vec3::new(x, y, z));
            }
        }
        mesh.groups
            .push(Group { material, triangles: vec![[base, base + 1, base + 5], [base + 2, base + 3, base + 7]] });
    }
    mesh
}

#[test]
fn a_cove_of_the_room_is_a_source_of_its_own() {
    let mut room = room(vec![]);
    let tray = |glow, from: f64, to: f64| harmony_scene::Niche {
        kind: "tray".into(),
        surface: harmony_scene::Surface::Ceiling,
        sides: None,
        glow,
        min: DVec3::new(0.6, from, 0.6),
        max: DVec3::new(3.4, to, 4.4),
    };
    room.shape.niches = vec![tray(None, 2.6, 2.64), tray(Some([0.5, 0.4, 0.25]), 2.64, 2.8)];
    let lights = lights_from_scene(&room, &[], |_| Emitter::default()).lights;
    let [cove] = lights.as_slice() else { panic!("{lights:?}") };
    assert!(is_cove(cove) && cove.on && !is_unseen_window(cove));
    assert!(DVec3::from(cove.color).distance(DVec3::new(1.0, 0.8, 0.5)) < 1e-6);
    assert!(room.is_free(DVec3::from(cove.position)), "{cove:?}");
    let LightKind::Area { direction, size_m } = cove.kind else { panic!("{cove:?}") };
    assert_eq!(direction, [0.0, -1.0, 0.0]);
    assert!((size_m[0] - 2.8).abs() < 1e-9 && (size_m[1] - 3.8).abs() < 1e-9);
}

#[test]
fn a_window_shines_into_the_room_from_just_inside_its_pane() {
    for (wall, into) in
        [(Wall::Back, DVec3::Z), (Wall::Left, DVec3::X), (Wall::Right, DVec3::NEG_X), (Wall::Front, DVec3::NEG_Z)]
    {
        let opening = Opening {
            kind: OpeningKind::Window,
            wall,
            u: [1.0, 2.0],
            y: [0.9, 2.1],
            inset: 0.0,
            rise: 0.0,
            object: None,
        };
        let leaf = ObjectId::new("door_01").unwrap();
        let door = Opening { kind: OpeningKind::Door, object: Some(leaf), ..opening.clone() };
        let room = room(vec![door, opening]);
        let lighting = lights_from_scene(&room, &[], |_| Emitter::default());
        assert_eq!(lighting.lights.len(), 1, "doors with a leaf give no light");
        let light = &lighting.lights[0];
        assert_eq!(light.id, "window_02");
        let LightKind::Area { direction, size_m } = light.kind else { panic!("{light:?}") };
        assert_eq!(DVec3::from_array(direction), into);
        assert!((size_m[0] - 1.0).abs() <= 1e-9 && (size_m[1] - 1.2).abs() <= 1e-9);
        let position = DVec3::from_array(light.position);
        assert!(room.extents.contains(position, 0.0));
        let gap = (position - wall.point(&room.extents, 1.5, 1.5)).dot(into);
        assert!((gap - PANE_GAP_M).abs() <= 1e-9);
        assert!((light.intensity - 1.2 * WINDOW_WATTS_PER_M2).abs() <= 1e-9);
    }
}

#[test]
fn a_window_objects_frame_does_not_stand_before_its_light() {
    let id = ObjectId::new("window_01").unwrap();
    let opening = Opening {
        kind: OpeningKind::Window,
        wall: Wall::Left,
        u: [1.0, 2.0],
        y: [0.9, 2.1],
        inset: 0.0,
        rise: 0.0,
        object: Some(id.clone()),
    };
    // Its back touches the wall and it is 8 cm thick.
    let window = object(
        "window_01",
        "window",
        Level::Wall,
        DVec3::new(0.04, 0.9, 1.5),
        Wall::Left.yaw(),
        DVec3::new(1.0, 1.2, 0.08),
    );
    let lighting = lights_from_scene(&room(vec![opening]), &[window], |_| Emitter::default());
    assert_eq!(lighting.lights[0].object, Some(id));
    assert!((lighting.lights[0].position[0] - 0.09).abs() <= 1e-9, "{:?}", lighting.lights[0].position);
}

#[test]
fn a_bulb_sits_in_the_middle_of_its_shade() {
    let mut lamp = object(
        "floor_lamp_01",
        "floor lamp",
        Level::Furniture,
        DVec3::new(3.0, 0.0, 1.0),
        0.5,
        DVec3::new(0.4, 1.6, 0.4),
    );
    lamp.pose.scale = 1.6;
    let mesh = lamp_mesh();
    let lighting = lights_from_scene(&room(Vec::new()), std::slice::from_ref(&lamp), |_| of(&mesh));
    let light = &lighting.lights[0];
    assert!((DVec3::from_array(light.position) - DVec3::new(3.0, 0.85 * 1.6, 1.0)).length() <= 1e-6, "{light:?}");
    assert_eq!(light.intensity, FLOOR_LAMP_WATTS);
    let bare = lights_from_scene(&room(Vec::new()), &[lamp], |_| Emitter::default());
    assert!((bare.lights[0].position[1] - 0.88 * 1.6).abs() <= 1e-6, "by the label, without a mesh");
}

#[test]
fn a_program_says_where_its_bulb_is_and_that_a_thing_shines() {
    let at = DVec3::new(2.0, 0.0, 1.0);
    let lamp = object("lamp_01", "floor lamp", Level::Furniture, at, 0.0, DVec3::new(0.4, 1.6, 0.4));
    let shelf = object("shelf_01", "shelf", Level::Furniture, at, 0.0, DVec3::new(0.8, 1.6, 0.4));
    let bulb = DVec3::new(0.1, 1.2, 0.0);
    let mesh = lamp_mesh();
    for thing in [lamp, shelf] {
        let unsaid = lights_from_scene(&room(Vec::new()), std::slice::from_ref(&thing), |_| Emitter::default());
        assert_eq!(unsaid.lights.len(), usize::from(thing.id.as_str() == "lamp_01"));
        let said = Emitter { mesh: Some(&mesh), bulb: Some(bulb) };
        let lighting = lights_from_scene(&room(Vec::new()), std::slice::from_ref(&thing), |_| said);
        let position = DVec3::from_array(lighting.lights[0].position);
        assert!((position - thing.pose.point(bulb)).length() <= 1e-6, "{position} {:?}", thing.id);
    }
}

#[test]
fn ceiling_fixtures_shine_below_the_ceiling_and_never_outside() {
    let flush = object(
        "ceiling_light_01",
        "ceiling light",
        Level::Ceiling,
        DVec3::new(2.0, 2.5, 2.5),
        0.0,
        DVec3::new(0.4, 0.1, 0.4),
    );
    let lost =
        object("pendant_01", "pendant", Level::Ceiling, DVec3::new(9.0, 7.0, -3.0), 0.0, DVec3::new(0.4, 0.8, 0.4));
    let room = room(Vec::new());
    let lighting = lights_from_scene(&room, &[flush, lost], |_| Emitter::default());
    let y = lighting.lights[0].position[1];
    assert!((2.3..2.5).contains(&y), "{y}");
    assert!(room.extents.contains(DVec3::from_array(lighting.lights[1].position), 0.0));
}

#[test]
fn emissive_materials_beat_names() {
    let mut mesh = lamp_mesh();
    mesh.materials[0].emissive = [1.0; 3];
    assert!(emitter_bounds(&mesh).unwrap().max.y <= 0.71);
    mesh.materials[0].emissive = [0.0; 3];
    assert!(emitter_bounds(&mesh).unwrap().min.y >= 0.69);
    mesh.materials[1].name = "metal".into();
    assert!(emitter_bounds(&mesh).is_none());
}

/// A box whose material emits warm light.
fn glowing(size: DVec3) -> Mesh {
    let mut mesh = Mesh { materials: vec![Material::plain("led", [1.0; 3])], ..Mesh::default() };
    mesh.materials[0].emissive = [8.0, 6.0, 4.0];
    let h = (size / 2.0).as_vec3();
    let corner = |i: u32| {
        let pick = |bit: u32, v: f32| if i >> bit & 1 == 0 { -v } else { v };
        glam::Vec3::new(pick(0, h.x), pick(1, h.y) + h.y, pick(2, h.z))
    };
    mesh.positions = (0..8).map(corner).collect();
    mesh.groups.push(Group { material: 0, triangles: vec![[0, 1, 7], [2, 4, 6], [3, 5, 0]] });
    mesh
}

#[test]
fn what_shines_by_its_material_is_a_source_whatever_it_is_called() {
    let (strip, size) = (Wall::Left.yaw(), DVec3::new(0.03, 2.4, 0.02));
    let led = object("panel_01", "wall panel", Level::Wall, DVec3::new(0.01, 0.1, 1.5), strip, size);
    let lighting = lights_from_scene(&room(Vec::new()), std::slice::from_ref(&led), |_| Emitter::default());
    assert!(lighting.lights.is_empty(), "nothing says that it shines");
    let mesh = glowing(size);
    let lighting = lights_from_scene(&room(Vec::new()), &[led], |_| of(&mesh));
    let light = &lighting.lights[0];
    let LightKind::Area { direction, size_m } = light.kind else { panic!("{light:?}") };
    assert!((DVec3::from_array(direction) - DVec3::X).length() < 1e-9);
    assert!((size_m[0] - 0.03).abs() < 1e-6 && (size_m[1] - 2.4).abs() < 1e-6, "{size_m:?}");
    assert!(light.position[0] > 0.02 && (light.position[1] - 1.3).abs() < 1e-6, "{:?}", light.position);
    assert_eq!(light.color, [1.0, 0.75, 0.5]);
    let digits = glowing(DVec3::new(0.06, 0.02, 0.002));
    let clock = object("clock_01", "thermostat", Level::Wall, DVec3::new(1.0, 1.4, 0.01), 0.0, DVec3::splat(0.06));
    assert!(lights_from_scene(&room(Vec::new()), &[clock], |_| of(&digits)).lights.is_empty());
}

#[test]
fn a_luminous_ceiling_field_shines_down_as_wide_as_it_is() {
    let size = DVec3::new(1.6, 0.06, 0.8);
    let quarter = std::f64::consts::FRAC_PI_2;
    let cove = object("cove_01", "ceiling light", Level::Ceiling, DVec3::new(2.0, 2.4, 2.5), quarter, size);
    let mesh = glowing(size);
    let lighting = lights_from_scene(&room(Vec::new()), &[cove], |_| of(&mesh));
    let light = &lighting.lights[0];
    let LightKind::Area { direction, size_m } = light.kind else { panic!("{light:?}") };
    assert_eq!(direction, [0.0, -1.0, 0.0]);
    assert!((size_m[0] - 0.8).abs() < 1e-6 && (size_m[1] - 1.6).abs() < 1e-6, "turned by a quarter: {size_m:?}");
    assert!(light.position[1] < 2.4);
}

#[test]
fn bulbs_on_a_ring_are_a_lamp_and_no_field() {
    let bulb = DVec3::splat(0.08);
    let mut ring = Mesh { materials: glowing(bulb).materials, ..Mesh::default() };
    ring.groups.push(Group { material: 0, triangles: Vec::new() });
    for at in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
        let one = glowing(bulb);
        let first = ring.positions.len() as u32;
        ring.positions.extend(one.positions.iter().map(|p| *p + (0.3 * at).as_vec3()));
        ring.groups[0].triangles.extend(one.groups[0].triangles.iter().map(|t| t.map(|i| first + i)));
    }
    let size = DVec3::new(0.68, 0.08, 0.68);
    let chandelier = object("chandelier_01", "chandelier", Level::Ceiling, DVec3::new(2.0, 1.9, 2.5), 0.0, size);
    let lighting = lights_from_scene(&room(Vec::new()), &[chandelier], |_| of(&ring));
    assert!(matches!(lighting.lights[0].kind, LightKind::Point { .. }), "{lighting:?}");
}

#[test]
fn a_screen_shines_ahead_and_a_fireplace_waits_to_be_lit() {
    let size = DVec3::new(1.0, 0.6, 0.1);
    let tv = object("tv_01", "flat-screen TV", Level::Furniture, DVec3::new(2.0, 0.5, 1.0), FRAC_PI_2, size);
    let fire = object("fireplace_01", "Fireplace", Level::Furniture, DVec3::new(1.0, 0.0, 1.0), 0.0, size);
    let lighting = lights_from_scene(&room(Vec::new()), &[tv, fire], |_| Emitter::default());
    assert_eq!(lighting.lights.len(), 2);
    let LightKind::Area { direction, size_m } = lighting.lights[0].kind else { panic!("{lighting:?}") };
    assert!((DVec3::from_array(direction) - DVec3::X).length() <= 1e-9, "a quarter turn takes +Z to +X");
    assert!((size_m[0] - 0.9).abs() <= 1e-9);
    assert!(lighting.lights[0].position[0] > 2.05, "before its front: {:?}", lighting.lights[0].position);
    assert!(!lighting.lights[1].on);
}

#[test]
fn windows_are_assumed_where_the_photo_does_not_look() {
    use harmony_scene::{Camera, ImageSize, Intrinsics};
    let room = room(Vec::new());
    let size = ImageSize::new(640, 480);
    let intrinsics = Intrinsics::from_horizontal_fov(size, 1.0);
    // From near the front wall, straight at the back one: the near ends of both side walls are out of sight.
    let camera = Camera::looking(size, intrinsics, DVec3::new(2.0, 1.5, 4.8), DVec3::NEG_Z);
    let found = unseen_windows(&room, &camera, &[]);
    let ids: Vec<&str> = found.iter().map(|l| l.id.as_str()).collect();
    assert_eq!(ids, ["daylight_front", "daylight_left", "daylight_right"]);
    for light in &found {
        assert!(is_unseen_window(light) && light.on);
        let at = DVec3::from_array(light.position);
        assert!(room.extents.contains(at, 0.0));
        let LightKind::Area { direction, size_m } = light.kind.clone() else { panic!("{light:?}") };
        let seen = |p: DVec3| camera.project(p).is_some_and(|p| camera.contains(p));
        // Neither its middle nor an end of it can be seen.
        let along = DVec3::from_array(direction).cross(DVec3::Y) * (size_m[0] / 2.0);
        for p in [at, at + along, at - along] {
            assert!(!seen(p), "{light:?}");
        }
    }
    // Before a curtain that hangs over its place, not in it.
    let left = DVec3::from_array(found[1].position);
    let curtain = Bounds { min: DVec3::new(0.01, 0.0, left.z - 0.3), max: DVec3::new(0.09, 2.4, left.z + 2.0) };
    let beside = Bounds { min: DVec3::new(0.01, 0.0, 0.2), max: DVec3::new(0.2, 2.4, 0.5) };
    let hung = unseen_windows(&room, &camera, &[curtain, beside]);
    assert!((hung[1].position[0] - 0.09 - PANE_GAP_M).abs() < 1e-9, "{:?}", hung[1]);
    assert_eq!((hung[0].position, hung[2].position), (found[0].position, found[2].position));
    // A wide lens in the front wall sees all of both side walls.
    let wide = Intrinsics::from_horizontal_fov(size, 3.0);
    let camera = Camera::looking(size, wide, DVec3::new(2.0, 1.5, 5.0), DVec3::NEG_Z);
    let ids: Vec<String> = unseen_windows(&room, &camera, &[]).into_iter().map(|l| l.id).collect();
    assert_eq!(ids, ["daylight_front"]);
}

#[test]
fn a_passage_lets_in_light_as_a_window_of_its_size_does_but_less() {
    let opening = |kind: OpeningKind| Opening {
        kind,
        wall: Wall::Back,
        u: [1.0, 2.0],
        y: [0.0, 2.1],
        inset: 0.0,
        rise: 0.0,
        object: None,
    };
    let lights = |kind| lights_from_scene(&room(vec![opening(kind)]), &[], |_| Emitter::default()).lights;
    let (passage, window) = (lights(OpeningKind::Door), lights(OpeningKind::Window));
    assert!(passage.len() == 1 && is_passage_light(&passage[0]) && !is_passage_light(&window[0]), "{passage:?}");
    assert!(passage[0].on && (passage[0].intensity - PASSAGE_SHARE * window[0].intensity).abs() < 1e-9);
    assert_eq!(passage[0].position, window[0].position);
}
