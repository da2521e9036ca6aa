//! A small finished run, made without the pipeline.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use harmony_dataset::add::{Origin, add, init};
use harmony_dataset::config::Config;
use harmony_dataset::layout::{SceneId, Split};
use harmony_io::{
    GlbNode, GlbScene, NodeTransform, Segment, picture, save_mask, save_segmentation, write_glb, write_json,
};
use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{
    Camera, Confidence, Extents, ImageSize, Intrinsics, Level, Lighting, Mask, MaterialCategory, ObjectId, Physical,
    Pose, Relations, Room, SCENE_VERSION, Scene, SceneObject, Size, Support, Surface, SurfaceMaterial, Vec2, Vec3,
    WallAffinity,
};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};

pub const SIZE: ImageSize = ImageSize { width: 96, height: 72 };

fn mesh(corners: &[Vec3], quads: &[[u32; 4]], name: &str, color: [f32; 3]) -> Mesh {
    let mut mesh = Mesh {
        positions: corners.iter().map(|c| c.as_vec3()).collect(),
        uvs: vec![glam::Vec2::ZERO; corners.len()],
        groups: vec![Group {
            material: 0,
            triangles: quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect(),
        }],
        materials: vec![Material::plain(name, color)],
        ..Mesh::default()
    };
    mesh.recompute_normals();
    mesh
}

/// A box with its bottom centre at the origin, 1 m a side.
fn cube(color: [f32; 3]) -> Mesh {
    let corners: Vec<Vec3> = (0..8)
        .map(|i| {
            let side = |bit: usize| if i >> bit & 1 == 0 { -0.5 } else { 0.5 };
            Vec3::new(side(0), side(1) + 0.5, side(2))
        })
        .collect();
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    mesh(&corners, &quads, "body", color)
}

/// One face of the room, seen from inside.
fn face(surface: Surface, e: &Extents, color: [f32; 3]) -> GlbNode {
    let size = surface.size(e);
    let corners: Vec<Vec3> =
        [Vec2::ZERO, Vec2::new(size.x, 0.0), size, Vec2::new(0.0, size.y)].map(|uv| surface.point(e, uv)).to_vec();
    let inward = (corners[1] - corners[0]).cross(corners[3] - corners[0]).dot(surface.normal()) > 0.0;
    let quad = if inward { [0, 1, 2, 3] } else { [0, 3, 2, 1] };
    let name = harmony_mesh::shell_material_name(surface);
    GlbNode {
        name: name.to_owned(),
        mesh: Arc::new(mesh(&corners, &[quad], name, color)),
        transform: NodeTransform::IDENTITY,
        extras: Value::Null,
    }
}

fn object(id: &str, label: &str, index: u32, level: Level, position: Vec3, size: Vec3) -> SceneObject {
    let category = MaterialCategory::ALL[0];
    SceneObject {
        id: ObjectId::new(id).unwrap(),
        index,
        level,
        label: label.into(),
        description: String::new(),
        source_phrase: format!("the {label}"),
        pose: Pose { position, yaw: 0.3, scale: 1.0, stretch: size },
        size: Size::from_vec(size),
        support: Support::Floor,
        relations: Relations { wall_affinity: WallAffinity::Back, ..Relations::default() },
        material: SurfaceMaterial {
            category,
            pbr: category.defaults(),
            physical: Physical { weight_kg: 5.0, thickness_m: 0.01, elasticity: 0.1, rigid: None },
        },
        mesh: format!("{}/meshes/{id}.glb", level.folder()),
        mask: Some(format!("{}/masks/{id}.png", level.folder())),
        seen_box: None,
        mesh_source: "part model".into(),
        confidence: Confidence::default(),
    }
}

/// Writes a run folder; `tint` makes its photo another one.
pub fn run(folder: &Path, room_type: &str, tint: u8, lit: bool) {
    let room = Room {
        room_type: room_type.into(),
        extents: Extents { width: 4.0, height: 2.6, depth: 3.5 },
        shape: harmony_scene::RoomShape::default(),
        seen: vec![],
        openings: vec![],
        floor_texture: None,
        wall_texture: None,
    };
    let lens = Intrinsics::from_horizontal_fov(SIZE, 1.1);
    let camera = Camera::looking(SIZE, lens, Vec3::new(2.0, 1.5, 3.4), Vec3::new(0.1, -0.15, -1.0));
    let mut lamp = object("lamp_01", "lamp", 11, Level::Decoration, Vec3::new(1.2, 0.5, 0.6), Vec3::new(0.2, 0.4, 0.2));
    lamp.relations.on_top_of = Some(ObjectId::new("table_01").unwrap());
    let scene = Scene {
        version: SCENE_VERSION,
        generator: "harmony test".into(),
        room: room.clone(),
        camera: (&camera).into(),
        objects: vec![
            object("table_01", "table", 10, Level::Furniture, Vec3::new(1.2, 0.0, 0.6), Vec3::new(1.2, 0.5, 0.7)),
            lamp,
        ],
        lighting: Lighting {
            lights: vec![],
            ambient_color: [1.0; 3],
            ambient_intensity: 1.0,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::default(),
        },
        summary: String::new(),
        warnings: vec![],
    };
    let photo = RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| Rgb([(x * 2) as u8, (y * 3) as u8, tint]));
    harmony_io::write_atomic(&folder.join("input.jpg"), &picture::rgb_jpeg(&photo, 90).unwrap()).unwrap();
    for name in ["render_flat.png", "render_canonical.png"] {
        picture::write_rgb_png(&folder.join(name), &photo).unwrap();
    }
    if lit {
        picture::write_rgb_png(&folder.join("render_lit.png"), &photo).unwrap();
        picture::write_rgb_png(&folder.join("render_lit_canonical.png"), &photo).unwrap();
    }
    let masks: Vec<Mask> = [(10, 30), (40, 60)]
        .iter()
        .map(|(a, b)| Mask::from_fn(SIZE, |x, y| (*a..*b).contains(&x) && (20..50).contains(&y)))
        .collect();
    let segments: Vec<Segment<'_>> =
        scene.objects.iter().zip(&masks).map(|(object, mask)| Segment { object, mask }).collect();
    save_segmentation(folder, SIZE, &segments).unwrap();
    for (object, mask) in scene.objects.iter().zip(&masks) {
        save_mask(&folder.join(object.mask.as_ref().unwrap()), mask).unwrap();
    }
    let rows: Vec<Value> = scene
        .objects
        .iter()
        .map(|o| {
            json!({
                "id": o.id, "type": o.label, "stage": o.level.stage(), "size_m": o.size,
                "position_m": o.pose.position.to_array(), "yaw_deg": o.pose.yaw.to_degrees(),
                "wall_affinity": o.relations.wall_affinity, "support": o.support, "facing": null, "in_front_of": null,
                "behind": null, "on_top_of": o.relations.on_top_of, "grouped_with": null, "matched_set": null,
                "confidence": 0.5,
            })
        })
        .collect();
    write_json(&folder.join("objects.json"), &json!({ "objects": rows })).unwrap();
    let c = &scene.camera;
    let k = [[c.intrinsics.fx, 0.0, c.intrinsics.cx], [0.0, c.intrinsics.fy, c.intrinsics.cy], [0.0, 0.0, 1.0]];
    let file = json!({ "width": SIZE.width, "height": SIZE.height, "K": k, "R": c.rotation, "t": c.translation });
    write_json(&folder.join("camera.json"), &file).unwrap();
    let card = json!({ "player": "offline", "model": "part models", "offline": true, "concurrency": 0 });
    write_json(&folder.join("run.json"), &json!({ "profile": "offline", "cast": [["mesh_generator", card]] })).unwrap();
    let colors = [[0.5, 0.4, 0.3], [0.9; 3], [0.8, 0.8, 0.7], [0.6, 0.7, 0.8], [0.8, 0.7, 0.6], [0.7; 3]];
    let glb = GlbScene {
        objects: scene
            .objects
            .iter()
            .zip([[0.7, 0.2, 0.1], [0.1, 0.3, 0.8]])
            .map(|(o, color)| GlbNode {
                name: o.id.to_string(),
                mesh: Arc::new(cube(color)),
                transform: NodeTransform::from(&o.pose),
                extras: Value::Null,
            })
            .collect(),
        shell: Surface::ALL.iter().zip(colors).map(|(s, c)| face(*s, &room.extents, c)).collect(),
        camera: Some(camera),
        generator: "test".into(),
        ..GlbScene::default()
    };
    write_glb(&glb, &folder.join("scene_full.glb")).unwrap();
    write_json(&folder.join("scene.json"), &scene).unwrap();
}

pub fn origin() -> Origin {
    Origin {
        source: "pexels".into(),
        source_id: "1".into(),
        source_url: "https://www.pexels.com/photo/1/".into(),
        author: "A. Photographer".into(),
        licence: "pexels".into(),
        retrieved_at: "2026-01-02".into(),
        faces: "by hand".into(),
        ..Origin::default()
    }
}

pub struct Set {
    pub folder: tempfile::TempDir,
    pub scenes: Vec<SceneId>,
}

impl Set {
    pub fn root(&self) -> PathBuf {
        self.folder.path().join("set")
    }

    pub fn run(&self, i: usize) -> PathBuf {
        self.folder.path().join(format!("run_{i}"))
    }
}

/// A data set of four scenes without faults.
pub fn set() -> Set {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("set");
    let mut config = Config::new("test-rooms", "CC-BY-NC-4.0");
    config.description = "Rooms of a test.".into();
    config.url = "https://example.org/test-rooms".into();
    config.creators = vec!["A. Tester".into()];
    config.scenes_per_shard = 2;
    init(&root, &config).unwrap();
    let mut scenes = Vec::new();
    for (i, (room, split)) in [
        ("Living room", Split::Easy),
        ("bedroom", Split::Medium),
        ("bedroom", Split::Medium),
        ("home office", Split::Medium),
    ]
    .into_iter()
    .enumerate()
    {
        let run_folder = folder.path().join(format!("run_{i}"));
        run(&run_folder, room, 40 * i as u8, i != 3);
        scenes.push(add(&root, &run_folder, split, None, &origin()).unwrap());
    }
    Set { folder, scenes }
}
