//! Generated rooms keep the rules that make them usable as truth.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use glam::{DMat3, DVec2, DVec3};
use harmony_bench::generate::{GeneratedObject, GeneratedRoom, GeneratorSettings, Level, RoomFeature, generate, write};
use harmony_bench::truth::TruthRoom;
use harmony_mesh::Bvh;
use harmony_scene::{ImageSize, Surface};

/// Small pictures: the rules don't depend on their size.
fn small() -> GeneratorSettings {
    GeneratorSettings {
        image: Some(ImageSize::new(240, 180)),
        points: 2000,
        shell_points: 500,
        ..GeneratorSettings::default()
    }
}

/// The rooms of so many seeds, each made when a test of this process first asks for it.
fn rooms(count: usize) -> impl Iterator<Item = &'static GeneratedRoom> {
    static ROOMS: [OnceLock<GeneratedRoom>; 20] = [const { OnceLock::new() }; 20];
    (100..).zip(&ROOMS[..count]).map(|(seed, room)| room.get_or_init(|| generate(seed, &small())))
}

fn files(room: &GeneratedRoom) -> BTreeMap<String, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    write(room, folder.path()).unwrap();
    let mut out = BTreeMap::new();
    let mut folders = vec![folder.path().to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap().map(Result::unwrap) {
            if entry.path().is_dir() {
                folders.push(entry.path());
                continue;
            }
            let path = entry.path();
            let name = path.strip_prefix(folder.path()).unwrap().to_str().unwrap().to_owned();
            out.insert(name, std::fs::read(entry.path()).unwrap());
        }
    }
    out
}

#[test]
fn a_seed_means_the_same_bytes_and_another_one_another_room() {
    let (a, b, c) = (files(&generate(3, &small())), files(&generate(3, &small())), files(&generate(4, &small())));
    let names: Vec<&str> = a.keys().map(String::as_str).collect();
    let expected = [
        "camera.json",
        "credits.txt",
        "depth.png",
        "instances.png",
        "meshes.npz",
        "objects.json",
        "photo.jpg",
        "points.npz",
        "room.json",
        "views/1/camera.json",
        "views/1/depth.png",
        "views/1/instances.png",
        "views/1/photo.jpg",
        "views/2/camera.json",
        "views/2/depth.png",
        "views/2/instances.png",
        "views/2/photo.jpg",
    ];
    assert_eq!(names, expected);
    for name in expected {
        assert_eq!(a[name], b[name], "{name}");
        assert_ne!(a[name], c[name], "{name}");
    }
}

#[test]
fn archives_are_read_back() {
    let room = rooms(1).next().unwrap();
    let files = files(room);
    let points = harmony_io::npz::parse_npz(&files["points.npz"], |_| true).unwrap();
    assert_eq!(points["xyz"].shape, [2000, 3]);
    assert_eq!(points["shell_xyz"].shape, [500, 3]);
    assert!(points["id"].integer && points["id"].values.iter().all(|id| *id >= 10.0));
    assert!(points["shell_id"].values.iter().all(|id| (1.0..=6.0).contains(id)));
    let meshes = harmony_io::npz::parse_npz(&files["meshes.npz"], |_| true).unwrap();
    let visible = room.objects.iter().filter(|o| o.visible_pixels > 0).count();
    assert_eq!(meshes.len(), 2 * visible);
}

/// One test, for making the rooms takes most of its time.
#[test]
fn twenty_rooms_keep_the_rules() {
    let rooms: Vec<_> = rooms(20).collect();
    rooms_hold_between_5_and_30_objects_of_few_triangles(&rooms);
    meshes_are_canonical_and_inside_the_room(&rooms);
    things_stand_on_what_carries_them(&rooms);
    cameras_face_the_back_wall_from_inside(&rooms);
}

fn rooms_hold_between_5_and_30_objects_of_few_triangles(rooms: &[&GeneratedRoom]) {
    for room in rooms {
        assert!((5..=30).contains(&room.objects.len()), "{}: {}", room.name, room.objects.len());
        for o in &room.objects {
            assert!((1..=2500).contains(&o.mesh.triangle_count()), "{} {}", room.name, o.id);
            o.mesh.check().unwrap();
        }
        // 500 pixels of 960 x 720 are 31 of 240 x 180
        assert!(room.objects.iter().filter(|o| o.visible_pixels > 31).count() >= 5, "{}", room.name);
    }
}

fn meshes_are_canonical_and_inside_the_room(rooms: &[&GeneratedRoom]) {
    for room in rooms {
        let size = room.extents.as_vec();
        for o in &room.objects {
            let b = o.mesh.bounds().unwrap();
            let low = if o.level == Level::Wall { b.centre().y } else { b.min.y };
            assert!(low.abs() <= 1e-4 && b.centre().x.abs() <= 1e-4 && b.centre().z.abs() <= 1e-4, "{}", o.id);
            assert!((b.size() - o.size).abs().max_element() <= 1e-4, "{}", o.id);
            // a window's pane lies behind the wall
            let slack = if o.label == "window" { 0.12 } else { 1e-4 };
            for p in &o.mesh.positions {
                let p = o.to_room(p.as_dvec3());
                let inside = p.cmpge(DVec3::splat(-slack)).all() && p.cmple(size + slack).all();
                assert!(inside, "{} {} {p}", room.name, o.id);
            }
        }
    }
}

fn things_stand_on_what_carries_them(rooms: &[&GeneratedRoom]) {
    let mut carried = 0;
    for room in rooms {
        for o in &room.objects {
            match o.level {
                Level::Furniture => assert!(o.position.y.abs() <= 1e-9),
                Level::Ceiling => {
                    let gap = room.extents.height - o.position.y - o.size.y;
                    assert!((0.0..=0.005).contains(&gap), "{gap}");
                }
                Level::Wall => assert!(o.support.starts_with("wall_")),
                Level::Decoration => {
                    let host = room.objects.iter().find(|h| h.id == o.support).unwrap();
                    let under = surface_below(host, o.position + DVec3::Y * 0.05);
                    assert!((under - o.position.y).abs() <= 1e-3, "{} {} on {}", room.name, o.id, host.id);
                    assert_eq!(o.relations[0], ("on_top_of", host.id.clone()));
                    carried += 1;
                }
            }
        }
    }
    assert!(carried > 50, "{carried}");
}

fn cameras_face_the_back_wall_from_inside(rooms: &[&GeneratedRoom]) {
    for room in rooms {
        let c = room.camera.centre();
        assert!(room.extents.contains(c, 0.0) && (1.2..=1.75).contains(&c.y), "{c}");
        assert!(room.camera_yaw.to_degrees().abs() < 40.0);
        assert!((0.0..=18.0).contains(&room.camera_pitch.to_degrees()));
        assert!((59.9..=90.1).contains(&room.camera.horizontal_fov().to_degrees()));
    }
}

/// Highest surface of an object below a room point.
fn surface_below(host: &GeneratedObject, point: DVec3) -> f64 {
    let local = DMat3::from_rotation_y(-host.yaw) * (point - host.position);
    Bvh::new(&host.mesh).raycast(local, DVec3::NEG_Y, 3.0).map_or(f64::NAN, |h| point.y - h.distance)
}

#[test]
fn objects_do_not_cut_each_other() {
    for room in rooms(10) {
        for (i, a) in room.objects.iter().enumerate() {
            for b in &room.objects[..i] {
                let meet = a.aabb.min.cmple(b.aabb.max).all() && b.aabb.min.cmple(a.aabb.max).all();
                if !meet || a.label == "rug" || b.label == "rug" {
                    continue;
                }
                let depth = a.penetration(b);
                assert!(depth <= 0.005, "{}: {} and {} by {depth:.4} m", room.name, a.id, b.id);
                assert!(a.boxes_may_overlap.contains(&b.id) && b.boxes_may_overlap.contains(&a.id));
            }
        }
    }
}

#[test]
fn a_cut_is_measured() {
    let room = rooms(1).next().unwrap();
    let o = room.objects.iter().find(|o| o.level == Level::Furniture && o.label != "rug").unwrap();
    let mut other = o.clone();
    other.position += DVec3::new(0.01, 0.012, 0.009);
    assert!(o.penetration(&other) > 0.004);
    other.position.y += 10.0;
    assert_eq!(o.penetration(&other), 0.0);
}

#[test]
fn depth_and_ids_agree_with_the_meshes() {
    for room in rooms(6) {
        let camera = &room.camera;
        let width = camera.size.width as usize;
        for o in room.objects.iter().filter(|o| o.visible_pixels > 0) {
            let tree = Bvh::new(&o.mesh);
            let mine: Vec<usize> = (0..room.ids.len()).filter(|i| room.ids[*i] == o.index).collect();
            assert_eq!(mine.len(), o.visible_pixels);
            for i in mine.iter().step_by(17) {
                let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                let point = camera.unproject(pixel, f64::from(room.depth[*i]));
                let local = DMat3::from_rotation_y(-o.yaw) * (point - o.position);
                let off = tree.closest_point(local).unwrap().distance;
                assert!(off <= 0.01, "{} {}: {off}", room.name, o.id);
            }
        }
        assert!(room.ids.iter().zip(&room.depth).all(|(id, z)| (*id > 0) == (*z > 0.0)));
    }
}

/// What the photo and a view both show looks alike in both, for light, exposure and frames are one room's.
#[test]
fn views_show_the_same_room_at_the_photos_exposure() {
    let folder = tempfile::tempdir().unwrap();
    let mut shares = Vec::new();
    for room in rooms(6) {
        let folder = folder.path().join(&room.name);
        write(room, &folder).unwrap();
        let truth = harmony_bench::truth::TruthRoom::load(&folder).unwrap();
        let views = truth.views().unwrap();
        assert_eq!(views.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), ["1", "2"], "{}", room.name);
        for (view, made) in views.iter().zip(&room.views) {
            let eye = view.camera.centre();
            let inside = eye.cmpgt(DVec3::ZERO).all() && eye.cmplt(room.extents.as_vec()).all();
            assert!(inside && eye.distance(room.camera.centre()) > 0.4, "{} {}: {eye}", room.name, view.name);
            let seen = harmony_bench::views::seen_by_photo(&truth, view);
            shares.push(seen.count() as f64 / seen.size().pixels() as f64);
            let mut off = Vec::new();
            for y in 0..seen.size().height {
                for x in 0..seen.size().width {
                    let i = (y * seen.size().width + x) as usize;
                    if !seen.get(i64::from(x), i64::from(y)) {
                        continue;
                    }
                    let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let point = view.camera.unproject(pixel, f64::from(view.depth[i]));
                    if view.ids[i] == 1 {
                        assert!(point.y.abs() < 0.01, "the floor lies at {point}");
                    }
                    let p = truth.camera.project(point).unwrap();
                    let there = room.photo.get_pixel(p.x as u32, p.y as u32).0;
                    let here = made.photo.get_pixel(x, y).0;
                    off.push(f64::from(here[1].abs_diff(there[1])));
                }
            }
            off.sort_by(f64::total_cmp);
            let median = off[off.len() / 2];
            // Noise of the sensor is about 2 of 255, light is noisy by as much again at this size.
            assert!(median <= 8.0, "{} {}: {median} of 255", room.name, view.name);
        }
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    assert!((0.3..0.9).contains(&mean), "{shares:?}");
}

/// Rooms that are no boxes, two of each feature and two of mixed ones. A passage leaves a box a box.
fn shaped() -> &'static [GeneratedRoom] {
    static ROOMS: OnceLock<Vec<GeneratedRoom>> = OnceLock::new();
    ROOMS.get_or_init(|| {
        let features: Vec<RoomFeature> = RoomFeature::ALL.into_iter().filter(|f| *f != RoomFeature::Passage).collect();
        let choices = features.iter().map(|f| vec![*f]).chain([features.clone()]);
        let rooms = choices.enumerate().flat_map(|(k, shapes)| {
            let settings = GeneratorSettings { shapes, ..small() };
            [0, 1].map(|i| generate(500 + 2 * k as u64 + i, &settings))
        });
        rooms.collect()
    })
}

#[test]
fn rooms_that_are_no_boxes_are_read_back_as_they_were_made() {
    for room in shaped() {
        assert!(!room.shape.is_box(), "{}", room.name);
        let folder = tempfile::tempdir().unwrap();
        write(room, folder.path()).unwrap();
        let truth = TruthRoom::load(folder.path()).unwrap();
        // Linings become the walls that one sees; what is free is the same.
        let made = harmony_scene::Room { extents: room.extents, shape: room.shape.clone(), ..truth.room() };
        let read = truth.room();
        for k in 0..20 * 12 * 20 {
            let share = DVec3::new(f64::from(k % 20), f64::from(k / 20 % 12), f64::from(k / 240)) + 0.41;
            let p = share / DVec3::new(20.0, 12.0, 20.0) * room.extents.as_vec();
            assert_eq!(made.is_free(p), read.is_free(p - truth.origin), "{} {p}", room.name);
        }
        // Each opening lies in a plane of the room that was read, and in none that was not.
        for opening in &truth.openings {
            let plane = read.planes(opening.wall).into_iter().find(|p| (p.inset - opening.inset).abs() < 1e-3);
            assert!(plane.is_some(), "{} {opening:?}", room.name);
        }
    }
}

#[test]
fn nothing_is_inside_a_block_or_above_a_slope() {
    let mut at_faces = 0;
    for room in shaped() {
        let empty = harmony_scene::Room {
            room_type: String::new(),
            extents: room.extents,
            shape: room.shape.clone(),
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        };
        assert!(empty.is_free(room.camera.centre()), "{}: the camera", room.name);
        for view in &room.views {
            assert!(empty.is_free(view.camera.centre()), "{}: view {}", room.name, view.name);
        }
        for o in &room.objects {
            at_faces += usize::from(o.wall_plane.is_some());
            for p in &o.mesh.positions {
                let p = o.to_room(p.as_dvec3());
                // What is on a wall touches it, and panes lie behind it.
                let out = o.wall.filter(|_| o.level == Level::Wall).map_or(DVec3::ZERO, |w| w.normal() * 0.12);
                assert!(empty.is_free(p + out) || empty.is_free(p + DVec3::Y * 1e-6), "{} {} {p}", room.name, o.id);
            }
        }
    }
    assert!(at_faces >= 5, "{at_faces} things at the faces of blocks and linings");
}

#[test]
fn pictures_show_the_faces_with_the_ids_of_the_walls_that_look_the_same_way() {
    for room in shaped() {
        let folder = tempfile::tempdir().unwrap();
        write(room, folder.path()).unwrap();
        let truth = TruthRoom::load(folder.path()).unwrap();
        let faces = truth.room().faces();
        let width = room.camera.size.width as usize;
        let (mut right, mut all) = (0, 0);
        for (i, id) in room.ids.iter().enumerate().filter(|(_, id)| (1..=9).contains(*id) && **id != 7) {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let exit = faces.exit(&truth.camera.ray(pixel)).unwrap();
            let expected = match exit.wall() {
                Some(wall) => [3, 6, 4, 5][harmony_scene::Wall::ALL.iter().position(|w| *w == wall).unwrap()],
                None if exit.side_of.is_some() && exit.surface != Surface::Ceiling => 9,
                None if exit.normal.y > 0.0 => 1,
                None => 2,
            };
            let off = (truth.camera.depth(exit.point) - f64::from(room.depth[i])).abs();
            all += 1;
            right += i32::from(off < 0.03 && expected == *id);
        }
        // Reveals of windows apart.
        assert!(f64::from(right) > 0.97 * f64::from(all), "{}: {right} of {all}", room.name);
    }
}

#[test]
fn photos_show_what_makes_a_room_no_box() {
    // Of a block or a slope its faces, of a niche its bottom.
    let shown = shaped().iter().filter(|room| {
        let folder = tempfile::tempdir().unwrap();
        write(room, folder.path()).unwrap();
        let truth = TruthRoom::load(folder.path()).unwrap();
        let (faces, e) = (truth.room().faces(), truth.extents);
        let width = room.camera.size.width as usize;
        let off_the_box = (0..room.ids.len()).filter(|i| room.ids[*i] < 10).filter(|i| {
            let ray = truth.camera.ray(DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5));
            let (with, without) = (faces.exit(&ray).unwrap().point, e.exit(&ray).unwrap().1);
            with.distance(without) > 0.05
        });
        off_the_box.count() > room.ids.len() / 200
    });
    let shown = shown.count();
    assert!(shown >= 10, "{shown} of 12");
}
