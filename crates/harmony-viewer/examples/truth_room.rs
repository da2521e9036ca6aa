//! A room with known truth as a run folder: scene.json, camera.json, scene_full.glb, renders, id image and report.
//!
//! ```text
//! cargo run --release -p harmony-viewer --example truth_room -- ROOM_FOLDER OUT_FOLDER
//! ```
//!
//! ROOM_FOLDER holds camera.json, room.json, objects.json, meshes.npz and photo.jpg of a benchmark room. What comes out
//! is the input for the outside judges in `tools/`, and a report to look at.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3, Vec2, Vec3};
use harmony_io::npz::{Array, read_npz};
use harmony_io::{GlbNode, GlbScene, NodeTransform, TextureEncoding, picture, read_json, write_glb, write_json};
use harmony_mesh::{Group, Material, Mesh, room_shell};
use harmony_render::{Instance, Lighting as Shading, RenderOptions, render};
use harmony_scene::{
    Camera, Confidence, Extents, ImageSize, Intrinsics, Level, Light, LightKind, Lighting, MaterialCategory, ObjectId,
    Opening, OpeningKind, Physical, Pose, Relations, Room, SCENE_VERSION, Scene, SceneCamera, SceneObject, Size,
    Support, Surface, SurfaceMaterial, Wall, Warning, WarningKind,
};
use harmony_viewer::{CallRow, Evidence, Fact, ObjectReport, PhaseReport, PhaseStatus, ReportData, write_report};
use image::{ImageBuffer, Luma};
use serde_json::{Value, json};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1).map(PathBuf::from);
    let (Some(room), Some(out)) = (args.next(), args.next()) else {
        return Err("usage: truth_room ROOM_FOLDER OUT_FOLDER".into());
    };
    let meshes = read_npz(&room.join("meshes.npz"))?;
    let camera = camera(&read_json(&room.join("camera.json"))?)?;
    let (room_truth, lighting) = room_and_lights(&read_json(&room.join("room.json"))?)?;
    let truth: Value = read_json(&room.join("objects.json"))?;
    let mut objects = Vec::new();
    let mut bodies = BTreeMap::new();
    for o in truth["objects"].as_array().ok_or("objects")? {
        let id = o["id"].as_str().ok_or("id")?;
        if let (Some(v), Some(f)) = (meshes.get(&format!("{id}/v")), meshes.get(&format!("{id}/f"))) {
            let object = object(o)?;
            bodies.insert(object.id.clone(), Arc::new(mesh(&object.label, object.index, v, f)));
            objects.push(object);
        }
    }
    let scene = Scene {
        version: SCENE_VERSION,
        generator: "HARMONY truth_room example".to_owned(),
        room: room_truth,
        camera: SceneCamera::from(&camera),
        objects,
        lighting,
        summary: "A furnished benchmark room, put together from its truth.".to_owned(),
        warnings: vec![Warning {
            phase: "3_furniture".to_owned(),
            object: None,
            kind: WarningKind::NotAvailable,
            message: "the truth's meshes have no textures".to_owned(),
        }],
    };
    write_run(&room, &out, &scene, &camera, &bodies)
}

fn write_run(
    room: &Path,
    out: &Path,
    scene: &Scene,
    camera: &Camera,
    bodies: &BTreeMap<ObjectId, Arc<Mesh>>,
) -> Result<()> {
    std::fs::create_dir_all(out)?;
    std::fs::copy(room.join("photo.jpg"), out.join("input.jpg"))?;
    std::fs::copy(room.join("camera.json"), out.join("camera.json"))?;
    write_json(&out.join("scene.json"), scene)?;
    let shell = room_shell(&scene.room, &|_| None);
    let nodes = scene
        .objects
        .iter()
        .map(|o| GlbNode {
            name: o.id.to_string(),
            mesh: Arc::clone(&bodies[&o.id]),
            transform: NodeTransform::from(&o.pose),
            extras: json!({ "id": o.id, "label": o.label, "level": o.level, "size": o.size, "support": o.support }),
        })
        .collect();
    let glb = GlbScene {
        objects: nodes,
        shell: vec![GlbNode {
            name: "room_shell".to_owned(),
            mesh: Arc::new(shell.clone()),
            transform: NodeTransform::IDENTITY,
            extras: Value::Null,
        }],
        camera: Some(*camera),
        lighting: Some(&scene.lighting),
        glow: 0.0,
        extras: json!({ "room": scene.room.extents }),
        generator: scene.generator.clone(),
        textures: TextureEncoding::Compact,
    };
    write_glb(&glb, &out.join("scene_full.glb"))?;

    let mut instances = vec![Instance::in_room(&shell, 1)];
    instances.extend(scene.objects.iter().map(|o| Instance::posed(&bodies[&o.id], &o.pose, o.index)));
    let options = RenderOptions { lighting: Shading::HeadLight, multisample: true, ..RenderOptions::default() };
    let frame = render(camera, &instances, &options);
    picture::write_rgba_png(&out.join("render_flat.png"), &frame.color)?;
    let ids = ImageBuffer::<Luma<u16>, Vec<u16>>::from_raw(
        camera.size.width,
        camera.size.height,
        frame.ids.iter().map(|id| *id as u16).collect(),
    );
    ids.ok_or("ids")?.save(out.join("ids.png"))?;
    let mut data = report(scene);
    for o in &scene.objects {
        if let Some(b) = frame.mask(o.index).bounds() {
            let b = b.padded(0.1, camera.size);
            let crop =
                image::imageops::crop_imm(&frame.color, b.x0 as u32, b.y0 as u32, b.width() as u32, b.height() as u32);
            let path = format!("3_furniture/crops/{}.png", o.id);
            picture::write_rgba_png(&out.join(&path), &crop.to_image())?;
            data.objects.entry(o.id.clone()).or_default().mesh_view = Some(path);
        }
    }
    Ok(write_report(out, scene, &data)?)
}

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or(f64::NAN)
}

fn vector(v: &Value) -> DVec3 {
    DVec3::new(number(&v[0]), number(&v[1]), number(&v[2]))
}

fn camera(v: &Value) -> Result<Camera> {
    let side = |key: &str| v[key].as_u64().map(|n| n as u32).ok_or("camera size");
    let k = &v["K"];
    Ok(Camera {
        size: ImageSize::new(side("width")?, side("height")?),
        intrinsics: Intrinsics {
            fx: number(&k[0][0]),
            fy: number(&k[1][1]),
            cx: number(&k[0][2]),
            cy: number(&k[1][2]),
        },
        rotation: DMat3::from_cols(vector(&v["R"][0]), vector(&v["R"][1]), vector(&v["R"][2])).transpose(),
        translation: vector(&v["t"]),
    })
}

fn wall(name: &str) -> Option<Wall> {
    Wall::ALL.into_iter().find(|w| w.surface().name() == name)
}

fn room_and_lights(v: &Value) -> Result<(Room, Lighting)> {
    let extents = Extents { width: number(&v["W"]), height: number(&v["H"]), depth: number(&v["D"]) };
    let mut openings = Vec::new();
    for o in v["openings"].as_array().into_iter().flatten().filter(|o| o["cut"] == true) {
        openings.push(Opening {
            kind: if o["kind"] == "door" { OpeningKind::Door } else { OpeningKind::Window },
            wall: wall(o["wall"].as_str().unwrap_or_default()).ok_or("wall")?,
            u: [number(&o["u0"]), number(&o["u1"])],
            y: [number(&o["y0"]), number(&o["y1"])],
            inset: 0.0,
            rise: 0.0,
            object: None,
        });
    }
    let mut lights = Vec::new();
    for (k, l) in v["lights"].as_array().into_iter().flatten().enumerate() {
        let kind = if l["type"] == "area" {
            let direction = vector(&l["normal"]).normalize_or(DVec3::NEG_Y).to_array();
            LightKind::Area { direction, size_m: [number(&l["size"][0]), number(&l["size"][1])] }
        } else {
            LightKind::Point { radius_m: 0.05 }
        };
        let id = l["owner"].as_str().map_or_else(|| format!("light_{k:02}"), |o| format!("light_of_{o}"));
        let (position, color) = (vector(&l["position"]).to_array(), vector(&l["color"]).to_array());
        let intensity = number(&l["watts"]);
        lights.push(Light {
            id,
            kind,
            position,
            color,
            intensity,
            on: intensity.is_finite(),
            object: None,
            shade: None,
        });
    }
    lights.retain(|l| l.intensity.is_finite() && l.position.iter().all(|p| p.is_finite()));
    let room = Room {
        room_type: "benchmark_room".to_owned(),
        extents,
        shape: harmony_scene::RoomShape::default(),
        seen: vec![Surface::Floor, Surface::Back],
        openings,
        floor_texture: None,
        wall_texture: None,
    };
    Ok((
        room,
        Lighting {
            lights,
            ambient_color: [1.0; 3],
            ambient_intensity: 0.25,
            exposure: 1.0,
            view: harmony_scene::ViewTransform::Agx,
        },
    ))
}

fn object(o: &Value) -> Result<SceneObject> {
    let text = |key: &str| o[key].as_str().unwrap_or_default();
    let level = match text("level") {
        "wall" => Level::Wall,
        "ceiling" => Level::Ceiling,
        "decoration" => Level::Decoration,
        _ => Level::Furniture,
    };
    let support = match text("support") {
        "floor" => Support::Floor,
        "ceiling" => Support::Ceiling,
        s => match s.strip_prefix("wall_").and_then(wall) {
            Some(wall) => Support::Wall { wall },
            None => Support::Object { id: ObjectId::new(s)? },
        },
    };
    let size = vector(&o["size_whd"]);
    Ok(SceneObject {
        id: ObjectId::new(text("id"))?,
        index: o["index"].as_u64().ok_or("index")? as u32,
        level,
        label: text("label").to_owned(),
        description: String::new(),
        source_phrase: text("label").to_owned(),
        // The truth's origin is the mesh's own: at the centre for wall objects, at the bottom else.
        pose: Pose::new(vector(&o["position"]), number(&o["yaw_deg"]).to_radians(), 1.0),
        size: Size::from_vec(size),
        support,
        relations: Relations::default(),
        material: SurfaceMaterial {
            category: MaterialCategory::Other,
            pbr: MaterialCategory::Other.defaults(),
            physical: Physical { weight_kg: 10.0, thickness_m: 0.01, elasticity: 0.1, rigid: None },
        },
        mesh: String::new(),
        mask: None,
        seen_box: None,
        mesh_source: "truth".to_owned(),
        confidence: Confidence { overall: 1.0, ..Confidence::default() },
    })
}

fn mesh(name: &str, index: u32, v: &Array, f: &Array) -> Mesh {
    let positions: Vec<Vec3> =
        v.values.chunks_exact(3).map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32)).collect();
    let [r, g, b] = harmony_io::index_color(index).map(|c| (f32::from(c) / 255.0).powf(2.2));
    let mut material = Material::plain(name, [r, g, b]);
    material.double_sided = true;
    let mut mesh = Mesh {
        metric_uvs: Vec::new(),
        colors: Vec::new(),
        normals: vec![Vec3::Y; positions.len()],
        uvs: vec![Vec2::ZERO; positions.len()],
        groups: vec![Group {
            material: 0,
            triangles: f.values.chunks_exact(3).map(|t| [t[0] as u32, t[1] as u32, t[2] as u32]).collect(),
        }],
        materials: vec![material],
        positions,
    };
    mesh.recompute_normals();
    mesh
}

fn report(scene: &Scene) -> ReportData {
    let names = ["1_layout", "2_wall", "3_furniture", "4_ceiling", "5_decoration", "6_lighting"];
    let phase = |(k, name): (usize, &&str)| PhaseReport {
        name: (*name).to_owned(),
        status: if k < 5 { PhaseStatus::Done } else { PhaseStatus::Skipped },
        seconds: [12.4, 31.0, 184.2, 3.1, 66.0, 0.0][k],
        outcome: if k < 5 { "from the truth".to_owned() } else { String::new() },
        ..PhaseReport::default()
    };
    let call = |(k, o): (usize, &SceneObject)| CallRow {
        name: format!("{}/{}/describe", o.level.folder(), o.id),
        role: if k % 3 == 0 { "mesh_generator" } else { "vision_language" }.to_owned(),
        player: "oracle".to_owned(),
        seconds: 0.4 + k as f64,
        tokens_in: 900 + 37 * k as u64,
        tokens_out: 80,
        cost_usd: Some(0.004),
        tries: 1,
        from_record: k % 4 == 0,
        problem: String::new(),
    };
    let evidence = |method: &str| Evidence {
        method: method.to_owned(),
        confidence: Some(0.86),
        because: "known, this is an example".to_owned(),
        facts: vec![Fact::new("Residual", "0.4 px")],
    };
    ReportData {
        title: "Truth room".to_owned(),
        finished: String::new(),
        profile: "oracle".to_owned(),
        facts: vec![Fact::new("Seed", "0")],
        phases: names.iter().enumerate().map(phase).collect(),
        calls: scene.objects.iter().enumerate().map(call).collect(),
        objects: scene
            .objects
            .iter()
            .map(|o| {
                let because = "the object stands where the truth says".to_owned();
                (o.id.clone(), ObjectReport { confidence_because: because, ..ObjectReport::default() })
            })
            .collect(),
        room: evidence("Truth"),
        camera: evidence("Truth"),
        ..ReportData::default()
    }
}
