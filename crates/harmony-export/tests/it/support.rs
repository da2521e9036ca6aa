//! A furnished room in a run folder, made of templates.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use glam::DVec3;
use harmony_export::Options;
use harmony_io::{GlbNode, NodeTransform};
use harmony_mesh::{Group, Mesh, TemplateParams, room_shell, template};
use harmony_scene::{
    Camera, Confidence, Extents, ImageSize, Intrinsics, Level, Light, LightKind, Lighting, ObjectId, Opening,
    OpeningKind, Physical, Pose, Room, Scene, SceneObject, Size, Support, Surface, SurfaceMaterial, ViewTransform,
    Wall,
};
use harmony_testing::run::{object, room, scene as bare, write};
use image::{Rgba, RgbaImage};
use serde_json::Value;

/// A thing of a category at a place.
fn thing(
    scene: &mut Vec<SceneObject>,
    label: &str,
    level: Level,
    size: [f64; 3],
    at: [f64; 3],
    yaw: f64,
    support: Support,
) {
    let number = scene.iter().filter(|o| o.label == label).count() + 1;
    let category = harmony_catalogue::material_category(label);
    let id = ObjectId::numbered(label, number);
    let pose = Pose::new(DVec3::from_array(at), yaw, 1.0);
    let size = Size { width: size[0], height: size[1], depth: size[2] };
    scene.push(SceneObject {
        index: 10 + scene.len() as u32,
        level,
        description: format!("A {label}."),
        material: SurfaceMaterial {
            category,
            pbr: category.defaults(),
            physical: Physical { weight_kg: 8.0, thickness_m: 0.02, elasticity: 0.1, rigid: None },
        },
        mesh: format!("{}/meshes/{id}.glb", level.folder()),
        mesh_source: "template".to_owned(),
        confidence: Confidence { overall: 0.6, ..Confidence::default() },
        ..object(id.as_str(), label, pose, size, support)
    });
}

/// The scene: 4.2 x 3.6 x 2.6 m, ten things, four lights, one of them on a chair that stands askew.
pub fn scene() -> Scene {
    let half_turn = std::f64::consts::PI;
    let mut o = Vec::new();
    let on = |id: &str| Support::Object { id: ObjectId::new(id).unwrap() };
    let wall = |wall| Support::Wall { wall };
    thing(&mut o, "window", Level::Wall, [1.2, 1.2, 0.1], [2.4, 0.9, 0.0], 0.0, wall(Wall::Back));
    thing(&mut o, "door", Level::Wall, [0.9, 2.05, 0.08], [0.0, 0.0, 2.6], Wall::Left.yaw(), wall(Wall::Left));
    thing(&mut o, "painting", Level::Wall, [0.8, 0.6, 0.03], [4.2, 1.3, 1.6], Wall::Right.yaw(), wall(Wall::Right));
    thing(&mut o, "desk", Level::Furniture, [1.4, 0.74, 0.7], [2.4, 0.0, 0.4], 0.0, Support::Floor);
    thing(&mut o, "chair", Level::Furniture, [0.46, 0.9, 0.5], [2.2, 0.0, 1.3], half_turn + 0.2, Support::Floor);
    thing(&mut o, "chair", Level::Furniture, [0.46, 0.9, 0.5], [3.4, 0.0, 2.4], -1.1, Support::Floor);
    thing(&mut o, "cabinet", Level::Furniture, [1.2, 0.8, 0.42], [3.98, 0.0, 1.6], Wall::Right.yaw(), Support::Floor);
    thing(&mut o, "rug", Level::Furniture, [2.0, 0.012, 1.4], [2.1, 0.0, 2.2], 0.0, Support::Floor);
    thing(&mut o, "vase", Level::Decoration, [0.14, 0.26, 0.14], [2.8, 0.74, 0.3], 0.0, on("desk_01"));
    thing(&mut o, "pendant lamp", Level::Ceiling, [0.4, 0.6, 0.4], [2.1, 2.0, 1.9], 0.0, Support::Ceiling);
    "A desk with \"quotes\", <angles> & an \u{e4}.".clone_into(&mut o[3].description);
    let room = Room {
        room_type: "study_room".to_owned(),
        seen: vec![Surface::Floor, Surface::Ceiling, Surface::Back, Surface::Left, Surface::Right],
        openings: vec![
            Opening {
                kind: OpeningKind::Window,
                wall: Wall::Back,
                u: [1.8, 3.0],
                y: [0.9, 2.1],
                inset: 0.0,
                rise: 0.0,
                object: Some(ObjectId::new("window_01").unwrap()),
            },
            Opening {
                kind: OpeningKind::Door,
                wall: Wall::Left,
                u: [2.15, 3.05],
                y: [0.0, 2.05],
                inset: 0.0,
                rise: 0.0,
                object: Some(ObjectId::new("door_01").unwrap()),
            },
        ],
        ..room(Extents { width: 4.2, height: 2.6, depth: 3.6 })
    };
    let size = ImageSize::new(960, 720);
    let lens = Intrinsics { fx: 640.0, fy: 644.0, cx: 470.0, cy: 371.0 };
    let camera = Camera::looking(size, lens, DVec3::new(2.3, 1.5, 3.4), DVec3::new(-0.12, -0.15, -1.0));
    let light = |id: &str, kind, position, intensity, on| Light {
        id: id.to_owned(),
        kind,
        position,
        color: [1.0, 0.9, 0.8],
        intensity,
        on,
        object: None,
        shade: None,
    };
    let spot = LightKind::Area { direction: [0.6, -0.8, 0.0], size_m: [0.1, 0.2] };
    let reading = Light {
        object: Some(ObjectId::new("chair_02").unwrap()),
        ..light("reading_light", spot, [3.3, 0.95, 2.2], 5.0, true)
    };
    Scene {
        generator: "harmony test".to_owned(),
        lighting: Lighting {
            lights: vec![
                light("table_lamp_01", LightKind::Point { radius_m: 0.04 }, [1.9, 1.1, 0.3], 15.0, true),
                light(
                    "window_01",
                    LightKind::Area { direction: [0.0, -0.3, 0.95], size_m: [1.2, 1.2] },
                    [2.4, 1.5, 0.05],
                    60.0,
                    true,
                ),
                light("sun", LightKind::Sun { direction: [0.2, -0.7, 0.6] }, [2.4, 2.0, -1.0], 2.0, false),
                reading,
            ],
            ambient_color: [1.0, 1.0, 1.0],
            ambient_intensity: 0.4,
            exposure: 0.3,
            view: ViewTransform::Agx,
        },
        summary: "A room for tests.".to_owned(),
        ..bare(room, &camera, o)
    }
}

/// Canonical meshes in the scene's order: chairs share one; the desk's top is textured; shelves have a plain look.
pub fn meshes(scene: &Scene) -> Vec<Arc<Mesh>> {
    let mut made: Vec<(String, Arc<Mesh>)> = Vec::new();
    scene
        .objects
        .iter()
        .map(|o| {
            if let Some((_, mesh)) = made.iter().find(|(label, _)| *label == o.label) {
                return Arc::clone(mesh);
            }
            let model = template(&o.label, &TemplateParams::default(), o.size);
            let mut mesh = model.build(o.size).unwrap().mesh;
            if o.label == "desk" {
                mesh.materials[0].texture = Some(Arc::new(checks([150, 110, 70], 255)));
                mesh.colors = vec![[0.5, 0.5, 0.5]; mesh.positions.len()];
            }
            if o.label == "rug" {
                mesh.materials[0].texture = Some(Arc::new(checks([120, 40, 40], 0)));
            }
            let mesh = Arc::new(mesh);
            made.push((o.label.clone(), Arc::clone(&mesh)));
            mesh
        })
        .collect()
}

/// A checked picture, transparent in one of its colours when `alpha` is 0.
fn checks(color: [u8; 3], alpha: u8) -> RgbaImage {
    RgbaImage::from_fn(128, 96, |x, y| {
        // Grain, as photos have it: files of flat colours are small in any format.
        let grain = ((x * 7919 + y * 104_729) % 31) as u8;
        let [r, g, b] = color.map(|c| c.saturating_add(grain));
        if (x / 16 + y / 16) % 2 == 0 { Rgba([r, g, b, 255]) } else { Rgba([g, b, r, alpha]) }
    })
}

/// A run folder with all of it.
pub fn run() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_run(folder.path(), &scene());
    folder
}

/// Writes `scene.json` and `scene_full.glb`.
pub fn write_run(folder: &Path, scene: &Scene) {
    let all = room_shell(&scene.room, &|_| None);
    let shell = all
        .groups
        .iter()
        .map(|group| {
            let material = all.materials[group.material].clone();
            let corners: Vec<u32> = group.triangles.iter().flatten().copied().collect();
            let pick = |i: &u32| *i as usize;
            let mesh = Mesh {
                positions: corners.iter().map(|i| all.positions[pick(i)]).collect(),
                normals: corners.iter().map(|i| all.normals[pick(i)]).collect(),
                uvs: corners.iter().map(|i| all.uvs[pick(i)]).collect(),
                groups: vec![Group {
                    material: 0,
                    triangles: (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
                }],
                materials: vec![material.clone()],
                ..Mesh::default()
            };
            GlbNode {
                name: material.name,
                mesh: Arc::new(mesh),
                transform: NodeTransform::IDENTITY,
                extras: Value::Null,
            }
        })
        .collect();
    write(folder, scene, &meshes(scene), shell);
}

/// Python with the readers of other programs, installed by `tools/setup.sh`.
pub fn checkers() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let cache = set("HARMONY_CACHE").or_else(|| set("HOME").map(|h| h.join(".cache/harmony")))?;
    let python = cache.join("checkers/bin/python");
    if python.is_file() {
        return Some(python);
    }
    harmony_testing::skip(format_args!("{} is not there (tools/setup.sh checkers)", python.display()));
    None
}

/// Runs `tools/check_export.py` on a folder; what it said.
pub fn judged(python: &Path, what: &str, folder: &Path) -> String {
    let script = harmony_testing::root().join("tools/check_export.py");
    let output = Command::new(python).arg(script).arg(what).arg(folder).output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{what}: {said}");
    said
}

/// Decompositions of the scene's meshes, kept by their content between tests and runs of them.
pub fn cache() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("bodies")
}

/// How tests export: with the decompositions that are there.
pub fn options() -> Options {
    Options { cache: Some(cache()), ..Options::default() }
}
