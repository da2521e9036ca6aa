//! A small study: a desk at the back wall, a chair before it, a vase and a box on the desk.

use std::path::Path;
use std::sync::Arc;

use harmony_mesh::{Mesh, TemplateParams, template};
use harmony_physics::Hull;
use harmony_physics::hull::hull_mesh;
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, ObjectId, Pose, SceneObject, Size, Support, Vec3};
use harmony_testing::run::{object, room, scene, write};

/// What is in it.
pub struct Study {
    /// Thickness of the chair's back, metres.
    pub back_m: f64,
    /// Whether there is a chair.
    pub chair: bool,
    /// A bookshelf this far behind the chair, metres.
    pub wall_behind_m: Option<f64>,
    /// A dresser of three drawers at the left wall, with so much free floor before it until a bookshelf, metres.
    pub dresser_m: Option<f64>,
}

impl Default for Study {
    fn default() -> Self {
        Self { back_m: 0.03, chair: true, wall_behind_m: None, dresser_m: None }
    }
}

fn cuboid(low: [f64; 3], high: [f64; 3]) -> Hull {
    Hull::cuboid(low.into(), high.into())
}

fn thing(id: &str, label: &str, at: [f64; 3], yaw: f64, support: Support, hulls: &[Hull]) -> (SceneObject, Arc<Mesh>) {
    let (low, high) = hulls
        .iter()
        .map(Hull::bounds)
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), (a, b)| (l.min(a), h.max(b)));
    let pose = Pose::new(Vec3::from_array(at), yaw, 1.0);
    (object(id, label, pose, Size::from_vec(high - low), support), Arc::new(hull_mesh(hulls, [0.5, 0.45, 0.4])))
}

/// As part models make it: fronts and handles in slots of their own. It looks along +X.
fn dresser() -> (SceneObject, Arc<Mesh>) {
    let size = Size { width: 0.8, height: 0.9, depth: 0.45 };
    let params = TemplateParams { drawers: Some(3), ..TemplateParams::default() };
    let made = template("dresser", &params, size).build(size).unwrap().mesh;
    let pose = Pose::new(Vec3::new(0.25, 0.0, 2.6), std::f64::consts::FRAC_PI_2, 1.0);
    (object("dresser_01", "dresser", pose, size, Support::Floor), Arc::new(made))
}

/// Front +Z: four legs, a seat at 0.45 m, a back to 0.92 m.
fn chair(back: f64) -> Vec<Hull> {
    let leg = |x: f64, z: f64| cuboid([x - 0.02, 0.0, z - 0.02], [x + 0.02, 0.41, z + 0.02]);
    vec![
        leg(-0.28, -0.18),
        leg(0.28, -0.18),
        leg(-0.28, 0.18),
        leg(0.28, 0.18),
        cuboid([-0.30, 0.41, -0.20], [0.30, 0.45, 0.20]),
        cuboid([-0.30, 0.45, -0.20], [0.30, 0.92, back - 0.20]),
    ]
}

fn desk() -> Vec<Hull> {
    let leg = |x: f64, z: f64| cuboid([x - 0.025, 0.0, z - 0.025], [x + 0.025, 0.71, z + 0.025]);
    vec![
        leg(-0.77, -0.32),
        leg(0.77, -0.32),
        leg(-0.77, 0.32),
        leg(0.77, 0.32),
        cuboid([-0.8, 0.71, -0.35], [0.8, 0.74, 0.35]),
    ]
}

/// A run folder.
pub fn study(study: &Study) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let on = |id: &str| Support::Object { id: ObjectId::new(id).unwrap() };
    let half = |x: f64, y: f64, z: f64| vec![cuboid([-x, 0.0, -z], [x, y, z])];
    let mut things = vec![
        thing("desk_01", "desk", [2.5, 0.0, 0.37], 0.0, Support::Floor, &desk()),
        thing("vase_01", "vase", [3.0, 0.74, 0.45], 0.3, on("desk_01"), &half(0.03, 0.2, 0.03)),
        thing("box_01", "box", [1.9, 0.74, 0.3], 0.0, on("desk_01"), &half(0.075, 0.12, 0.1)),
    ];
    if study.chair {
        // It faces the desk: its front is at -Z.
        let at = [2.5, 0.0, 0.82];
        things.push(thing("chair_01", "chair", at, std::f64::consts::PI, Support::Floor, &chair(study.back_m)));
    }
    if let Some(behind) = study.wall_behind_m {
        let at = [2.5, 0.0, 0.82 + 0.2 + behind + 0.15];
        things.push(thing("bookshelf_01", "bookshelf", at, 0.0, Support::Floor, &half(0.5, 1.8, 0.15)));
    }
    if let Some(before) = study.dresser_m {
        things.push(dresser());
        let at = [0.25 + 0.225 + before + 0.15, 0.0, 2.6];
        if before < 2.0 {
            things.push(thing("bookshelf_02", "bookshelf", at, 0.0, Support::Floor, &half(0.15, 1.8, 0.5)));
        }
    }
    write_run(folder.path(), &things);
    folder
}

fn write_run(folder: &Path, things: &[(SceneObject, Arc<Mesh>)]) {
    let size = ImageSize::new(320, 240);
    let lens = Intrinsics::from_horizontal_fov(size, 1.2);
    let camera = Camera::looking(size, lens, Vec3::new(2.5, 1.6, 4.4), Vec3::new(0.0, -0.2, -1.0));
    let room = room(Extents { width: 5.0, height: 2.6, depth: 4.5 });
    let (objects, meshes): (Vec<SceneObject>, Vec<Arc<Mesh>>) = things.iter().cloned().unzip();
    write(folder, &scene(room, &camera, objects), &meshes, vec![]);
}
