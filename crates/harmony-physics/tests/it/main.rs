//! A run folder as it lies on disk: read, settled, shaken; and another simulator's opinion.
#![expect(clippy::unwrap_used, reason = "tests, helpers included")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use harmony_io::write_json;
use harmony_mesh::Mesh;
use harmony_physics::hull::hull_mesh;
use harmony_physics::{
    BodySettings, Hull, LoadError, Motion, Quake, RunScene, animate, bodies, places, repair, settle, shake,
};
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, ObjectId, Pose, Scene, SceneObject, Size, Support, Vec3};
use harmony_testing::run::{object, room, scene, write};

fn block(size: [f64; 3]) -> Vec<Hull> {
    let half = Vec3::new(size[0] / 2.0, 0.0, size[2] / 2.0);
    vec![Hull::cuboid(-half, Vec3::from_array(size) - half)]
}

/// Four legs and a top.
fn table(width: f64, height: f64, depth: f64) -> Vec<Hull> {
    let (w, d) = (width / 2.0, depth / 2.0);
    let leg = |x: f64, z: f64| Hull::cuboid(Vec3::new(x, 0.0, z), Vec3::new(x + 0.05, height - 0.03, z + 0.05));
    vec![
        leg(-w, -d),
        leg(w - 0.05, -d),
        leg(-w, d - 0.05),
        leg(w - 0.05, d - 0.05),
        Hull::cuboid(Vec3::new(-w, height - 0.03, -d), Vec3::new(w, height, d)),
    ]
}

fn thing(id: &str, label: &str, at: [f64; 3], yaw: f64, support: Support, hulls: &[Hull]) -> (SceneObject, Arc<Mesh>) {
    let (low, high) = hulls
        .iter()
        .map(Hull::bounds)
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), (a, b)| (l.min(a), h.max(b)));
    let pose = Pose::new(Vec3::from_array(at), yaw, 1.0);
    (object(id, label, pose, Size::from_vec(high - low), support), Arc::new(hull_mesh(hulls, [0.5; 3])))
}

/// A room with a table, things on it, a shelf and a box that is sunk into the floor.
fn write_run(folder: &Path) {
    let on = |id: &str| Support::Object { id: ObjectId::new(id).unwrap() };
    let things = [
        thing("table_01", "dining table", [2.0, 0.0, 2.0], 0.4, Support::Floor, &table(1.4, 0.74, 0.8)),
        thing("box_01", "box", [2.1, 0.74, 2.0], 1.0, on("table_01"), &block([0.3, 0.2, 0.2])),
        thing("box_02", "box", [2.1, 0.94, 2.0], 0.3, on("box_01"), &block([0.2, 0.1, 0.15])),
        thing("bookshelf_01", "bookshelf", [4.0, 0.0, 0.2], 0.0, Support::Floor, &block([0.8, 1.9, 0.3])),
        thing("box_03", "box", [1.0, -0.02, 3.2], 0.0, Support::Floor, &block([0.4, 0.4, 0.4])),
        thing("rug_01", "rug", [2.0, 0.0, 2.0], 0.0, Support::Floor, &block([2.0, 0.012, 1.4])),
    ];
    let size = ImageSize::new(320, 240);
    let lens = Intrinsics::from_horizontal_fov(size, 1.2);
    let camera = Camera::looking(size, lens, Vec3::new(2.5, 1.6, 3.9), Vec3::new(0.0, -0.2, -1.0));
    let room = room(Extents { width: 5.0, height: 2.6, depth: 4.0 });
    let (objects, meshes): (Vec<SceneObject>, Vec<Arc<Mesh>>) = things.into_iter().unzip();
    write(folder, &scene(room, &camera, objects), &meshes, vec![]);
}

#[test]
fn a_run_folder_is_settled_repaired_and_shaken_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    write_run(folder.path());
    let loaded = RunScene::read(folder.path()).unwrap();
    let made = bodies(&loaded.scene, &loaded.meshes, &BodySettings::default()).unwrap();
    let table = &made.objects[0];
    assert_eq!(table.hulls.len(), 5);
    assert!(table.fit_m < 1e-3, "{}", table.fit_m);
    assert_eq!(made.objects[5].motion, Motion::Static, "a rug");
    assert!(made.objects[5].hulls.is_empty(), "the table's legs stand through it");
    let start = places(&loaded.scene);
    let settled = settle(&loaded.scene, &made, &start);
    let unstable: Vec<&str> = settled.dynamic().filter(|o| !o.stable).map(|o| o.id.as_str()).collect();
    assert_eq!(unstable, ["box_03"], "{settled:#?}");
    let repaired = repair(&loaded.scene, &made, &start, &settled);
    assert_eq!(repaired.after.stable(), (5, 5), "{:?}", repaired.unrepaired);
    let moved: Vec<&str> = repaired.repairs.iter().filter(|r| r.moved_m > 0.005).map(|r| r.id.as_str()).collect();
    assert!(moved.contains(&"box_03"), "{moved:?}");
    assert!(repaired.repairs.iter().all(|r| r.moved_m <= 0.3));
    let quake = Quake { intensity: 8.0, seconds: 2.0, seed: 3 };
    let glb = std::fs::read(folder.path().join("scene_full.glb")).unwrap();
    let film = || animate::animated_glb(&glb, &shake(&loaded.scene, &made, &quake).unwrap()).unwrap();
    assert_eq!(film(), film());
}

#[test]
fn folders_without_a_usable_scene_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(RunScene::read(folder.path()), Err(LoadError::Scene(_))));
    write_run(folder.path());
    let scene: Scene = harmony_io::read_json(&folder.path().join("scene.json")).unwrap();
    let mut moved = scene.clone();
    moved.objects[3].pose.position.x += 0.5;
    write_json(&folder.path().join("scene.json"), &moved).unwrap();
    let said = RunScene::read(folder.path()).unwrap_err();
    assert!(said.to_string().contains("bookshelf_01") && said.hint().is_some(), "{said}");
    let mut more = scene;
    let mut ghost = more.objects[0].clone();
    ghost.id = ObjectId::new("ghost_01").unwrap();
    more.objects.push(ghost);
    write_json(&folder.path().join("scene.json"), &more).unwrap();
    assert!(RunScene::read(folder.path()).unwrap_err().to_string().contains("ghost_01"));
    std::fs::write(folder.path().join("scene_full.glb"), b"no glb").unwrap();
    assert!(matches!(RunScene::read(folder.path()), Err(LoadError::Glb(_))));
}

/// The Python of the outside judges, as `tools/setup.sh` makes it.
fn judges() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let cache = set("HARMONY_CACHE").or_else(|| set("HOME").map(|home| home.join(".cache").join("harmony")))?;
    let python = cache.join("checkers").join("bin").join("python");
    let probe = Command::new(&python).args(["-c", "import mujoco"]).output();
    if probe.is_ok_and(|o| o.status.success()) {
        return Some(python);
    }
    harmony_testing::skip("MuJoCo is not installed (tools/setup.sh)");
    None
}

#[test]
fn mujoco_leaves_the_objects_where_they_are_left_here() {
    let Some(python) = judges() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_run(folder.path());
    let loaded = RunScene::read(folder.path()).unwrap();
    let made = bodies(&loaded.scene, &loaded.meshes, &BodySettings::default()).unwrap();
    let start = places(&loaded.scene);
    let settled = settle(&loaded.scene, &made, &start);
    let repaired = repair(&loaded.scene, &made, &start, &settled);
    let world = folder.path().join("7_world");
    std::fs::create_dir_all(&world).unwrap();
    write_json(&world.join("bodies.json"), &made).unwrap();
    write_json(&world.join("settle.json"), &serde_json::json!({ "settled": settled, "repaired": repaired })).unwrap();
    let script = harmony_testing::root().join("tools").join("settle_in_mujoco.py");
    let out = Command::new(python).arg(script).arg(folder.path()).args(["--least", "1"]).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && said.contains("5 of 5 within 1 cm"), "{said}");
}
