//! Round trips, foreign files, and hostile ones. The Khronos validator judges the output in `tools/validate_glb.mjs`.

use glam::{DAffine3, Vec2, Vec3};
use harmony_mesh::{Group, Material};
use harmony_scene::{ImageSize, Intrinsics, Light, LightKind};
use image::{Rgba, RgbaImage};
use serde_json::json;

use harmony_testing::shared;

use super::*;

/// A unit box on y = 0 with flat faces; two materials, one textured.
pub(crate) fn crate_box(texture: RgbaImage) -> Mesh {
    let mut mesh = Mesh::default();
    let faces = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let mut groups = vec![Group { material: 0, triangles: Vec::new() }, Group { material: 1, triangles: Vec::new() }];
    for (k, n) in faces.into_iter().enumerate() {
        let u = if n.y == 0.0 { Vec3::Y.cross(n) } else { Vec3::X };
        let v = n.cross(u);
        let base = mesh.positions.len() as u32;
        for (a, b) in [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)] {
            mesh.positions.push(n * 0.5 + u * a + v * b + Vec3::Y * 0.5);
            mesh.normals.push(n);
            mesh.uvs.push(Vec2::new(a + 0.5, 0.5 - b));
        }
        groups[usize::from(k == 2)].triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    mesh.groups = groups;
    let mut glass = Material::plain("glass", [0.9, 0.95, 1.0]);
    (glass.transmission, glass.ior, glass.roughness) = (0.9, 1.45, 0.05);
    glass.emissive = [4.0, 2.0, 1.0];
    let mut wood = Material::plain("wood", [1.0, 0.8, 0.6]);
    wood.texture = Some(Arc::new(texture));
    wood.double_sided = true;
    mesh.materials = vec![wood, glass];
    mesh
}

fn chequer(size: u32) -> RgbaImage {
    RgbaImage::from_fn(size, size, |x, y| {
        if (x / 4 + y / 4) % 2 == 0 { Rgba([200, 40, 30, 255]) } else { Rgba([30, 60, 190, 255]) }
    })
}

fn scene(mesh: &Arc<Mesh>) -> GlbScene<'static> {
    let node = |name: &str, transform| GlbNode {
        name: name.to_owned(),
        mesh: Arc::clone(mesh),
        transform,
        extras: json!({ "label": "box", "text": "</script>\u{1F600}" }),
    };
    let size = ImageSize::new(640, 480);
    GlbScene {
        objects: vec![
            node(
                "box_01",
                NodeTransform { translation: DVec3::new(1.0, 0.0, 2.0), yaw: 0.7, scale: DVec3::new(2.0, 1.0, 0.5) },
            ),
            node("box_02", NodeTransform::IDENTITY),
        ],
        shell: vec![node("room_floor", NodeTransform::IDENTITY)],
        glow: 0.0,
        camera: Some(Camera::looking(
            size,
            Intrinsics::from_horizontal_fov(size, 1.1),
            DVec3::new(2.0, 1.5, 5.0),
            DVec3::NEG_Z,
        )),
        lighting: None,
        extras: json!({ "version": 1 }),
        generator: "HARMONY test".to_owned(),
        textures: TextureEncoding::Lossless,
    }
}

#[test]
fn groups_gather_objects_and_faces_and_leave_the_rest() {
    let mesh = Arc::new(crate_box(chequer(8)));
    let scene = scene(&mesh);
    let group = |name: &str, members: &[&str]| NodeGroup {
        name: name.to_owned(),
        members: members.iter().map(|m| (*m).to_owned()).collect(),
        extras: json!({ "room": name }),
    };
    let bytes =
        glb_bytes_grouped(&scene, &[group("kitchen", &["room_floor", "box_01"]), group("hall", &["nothing"])]).unwrap();
    let document = document(&bytes);
    let nodes = document["nodes"].as_array().unwrap();
    let named = |name: &str| nodes.iter().find(|n| n["name"] == name);
    let kitchen = named("kitchen").unwrap();
    let children: Vec<&str> = kitchen["children"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| nodes[c.as_u64().unwrap() as usize]["name"].as_str().unwrap())
        .collect();
    assert_eq!(children, ["room_floor", "box_01"]);
    assert_eq!(kitchen["extras"]["room"], "kitchen");
    assert!(named("hall").is_none() && named("room").is_none(), "empty nodes are not written");
    let apart = read_glb(&glb_bytes(&scene).unwrap(), &ReadLimits::default()).unwrap();
    let grouped = read_glb(&bytes, &ReadLimits::default()).unwrap();
    for node in &apart.nodes {
        let same = grouped.nodes.iter().find(|n| n.name == node.name).unwrap();
        assert_eq!(same.transform, node.transform, "{} stays where it was", node.name);
    }
}

fn document(bytes: &[u8]) -> Value {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

#[test]
fn vertex_colours_come_back_and_a_mesh_without_any_stays_without() {
    let plain = Arc::new(crate_box(chequer(16)));
    let mut mesh = (*plain).clone();
    mesh.colors = (0..mesh.positions.len()).map(|i| [i as f32 / 30.0, 0.5, 1.0]).collect();
    let bytes = glb_bytes(&scene(&Arc::new(mesh.clone()))).unwrap();
    let file = document(&bytes);
    let accessor = file["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize;
    let accessor = &file["accessors"][accessor];
    assert_eq!((&accessor["type"], &accessor["normalized"]), (&json!("VEC4"), &json!(true)));
    let back = read_glb(&bytes, &ReadLimits::default()).unwrap();
    let got = &back.nodes[1].mesh;
    for (i, j) in mesh.triangles().flatten().zip(got.triangles().flatten()) {
        for (a, b) in mesh.colors[i as usize].iter().zip(got.colors[j as usize]) {
            assert!((a - b).abs() <= 1.0 / 65_535.0, "{i} {j}: {a} {b}");
        }
    }
    let without = read_glb(&glb_bytes(&scene(&plain)).unwrap(), &ReadLimits::default()).unwrap();
    assert!(without.nodes.iter().all(|n| n.mesh.colors.is_empty()));
}

#[test]
fn a_scene_comes_back_as_it_was_written() {
    let mesh = Arc::new(crate_box(chequer(16)));
    let bytes = glb_bytes(&scene(&mesh)).unwrap();
    assert_eq!(bytes, glb_bytes(&scene(&Arc::new((*mesh).clone()))).unwrap(), "same scene, same bytes");
    let back = read_glb(&bytes, &ReadLimits::default()).unwrap();
    assert!(back.notes.is_empty(), "{:?}", back.notes);
    assert_eq!(back.nodes.iter().map(|n| n.name.as_str()).collect::<Vec<_>>(), ["room_floor", "box_01", "box_02"]);
    assert!(Arc::ptr_eq(&back.nodes[0].mesh, &back.nodes[2].mesh), "shared meshes stay shared");
    let got = &back.nodes[1];
    // room = t + Ry(yaw) (scale .* local), as Pose says.
    let pose = Pose { position: DVec3::new(1.0, 0.0, 2.0), yaw: 0.7, scale: 1.0, stretch: DVec3::new(2.0, 1.0, 0.5) };
    for p in [DVec3::new(0.5, 1.0, 0.5), DVec3::new(-0.5, 0.0, 0.2)] {
        assert!((got.transform.transform_point3(p) - pose.point(p)).length() <= 1e-12);
    }
    assert_eq!(got.extras["text"], "</script>\u{1F600}");
    assert_eq!(got.mesh.triangle_count(), mesh.triangle_count());
    for (a, b) in mesh.triangles().zip(got.mesh.triangles()) {
        for (i, j) in a.into_iter().zip(b) {
            let (i, j) = (i as usize, j as usize);
            assert_eq!(mesh.positions[i], got.mesh.positions[j]);
            assert_eq!(mesh.uvs[i], got.mesh.uvs[j]);
            assert!((mesh.normals[i] - got.mesh.normals[j]).length() <= 1e-6);
        }
    }
    for (a, b) in mesh.materials.iter().zip(&got.mesh.materials) {
        assert_eq!((&a.name, a.double_sided), (&b.name, b.double_sided));
        for (x, y) in
            [(a.roughness, b.roughness), (a.ior, b.ior), (a.transmission, b.transmission), (a.metallic, b.metallic)]
        {
            assert!((x - y).abs() <= 1e-6);
        }
        assert!(a.emissive.iter().zip(b.emissive).all(|(x, y)| (x - y).abs() <= 1e-5));
        assert!(a.base_color.iter().zip(b.base_color).all(|(x, y)| (x - y).abs() <= 1e-6));
        assert_eq!(a.texture, b.texture);
    }
}

#[test]
fn the_document_lists_what_it_uses() {
    let mesh = Arc::new(crate_box(chequer(16)));
    let lighting = Lighting {
        lights: vec![
            Light {
                id: "lamp_01".into(),
                kind: LightKind::Point { radius_m: 0.04 },
                position: [1.0, 2.0, 1.0],
                color: [1.0, 0.8, 0.6],
                intensity: 60.0,
                on: true,
                object: None,
                shade: None,
            },
            Light {
                id: "window_01".into(),
                kind: LightKind::Area { direction: [0.0, 0.0, 1.0], size_m: [1.2, 1.0] },
                position: [2.0, 1.5, 0.0],
                color: [0.8, 0.9, 1.0],
                intensity: 200.0,
                on: true,
                object: None,
                shade: None,
            },
        ],
        ambient_color: [1.0; 3],
        ambient_intensity: 0.3,
        exposure: 0.5,
        view: harmony_scene::ViewTransform::Agx,
    };
    let mut scene = scene(&mesh);
    scene.lighting = Some(&lighting);
    let doc = document(&glb_bytes(&scene).unwrap());
    let used =
        ["KHR_lights_punctual", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_transmission"];
    assert_eq!(doc["extensionsUsed"], json!(used));
    assert_eq!(doc["meshes"].as_array().unwrap().len(), 1);
    assert_eq!(doc["materials"].as_array().unwrap().len(), 2);
    assert_eq!(doc["scenes"][0]["extras"]["ambient"]["exposure"], 0.5);
    let lights = &doc["extensions"]["KHR_lights_punctual"]["lights"];
    assert_eq!((lights[0]["type"].as_str(), lights[1]["type"].as_str()), (Some("point"), Some("spot")));
    // The window shines along +Z: glTF lights shine along their local -Z, so the node is turned by half a turn.
    let node = doc["nodes"].as_array().unwrap().iter().find(|n| n["name"] == "window_01").unwrap();
    let q: Vec<f64> = node["rotation"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let q = glam::DQuat::from_slice(&q);
    assert!((q * DVec3::NEG_Z - DVec3::Z).length() <= 1e-9);
}

#[test]
fn a_glowing_scene_shows_its_textures_everywhere_and_reads_back_without_glow() {
    let mesh = Arc::new(crate_box(chequer(16)));
    let mut scene = scene(&mesh);
    scene.glow = 0.4;
    let bytes = glb_bytes(&scene).unwrap();
    let doc = document(&bytes);
    for m in doc["materials"].as_array().unwrap() {
        let lamp = m["extensions"].get("KHR_materials_emissive_strength").is_some();
        assert_eq!(m["extras"].get("ambient_glow").is_some(), !lamp, "{m}");
        if !lamp {
            assert_eq!(m["emissiveTexture"], m["pbrMetallicRoughness"]["baseColorTexture"]);
            let base = m["pbrMetallicRoughness"]["baseColorFactor"][1].as_f64().unwrap();
            assert!((m["emissiveFactor"][1].as_f64().unwrap() - 0.4 * base).abs() <= 1e-9);
        }
    }
    let back = read_glb(&bytes, &ReadLimits::default()).unwrap();
    for (a, b) in mesh.materials.iter().zip(&back.nodes[0].mesh.materials) {
        assert!(a.emissive.iter().zip(b.emissive).all(|(x, y)| (x - y).abs() <= 1e-5), "{a:?} {b:?}");
    }
}

#[test]
fn large_opaque_textures_become_jpeg_and_cut_outs_stay_png() {
    let mut state = 3_u32;
    let photo = RgbaImage::from_fn(256, 256, |x, y| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let n = (state >> 28) as u8;
        Rgba([(x / 2) as u8 + n, (y / 2) as u8 + n, 90 + n, 255])
    });
    let mut leaf = photo.clone();
    for (x, _, p) in leaf.enumerate_pixels_mut() {
        p.0[3] = if x < 100 { 0 } else { 255 };
    }
    for (texture, mime, alpha) in [(photo, "image/jpeg", Value::Null), (leaf, "image/png", json!("MASK"))] {
        let scene = GlbScene { textures: TextureEncoding::Compact, ..scene(&Arc::new(crate_box(texture))) };
        let doc = document(&glb_bytes(&scene).unwrap());
        assert_eq!(doc["images"][0]["mimeType"], mime);
        let wood = doc["materials"].as_array().unwrap().iter().find(|m| m["name"] == "wood").unwrap();
        assert_eq!(wood["alphaMode"], alpha);
    }
}

#[test]
fn merged_meshes_keep_their_outside_when_mirrored() {
    let mesh = Arc::new(crate_box(chequer(4)));
    let node = |transform| LoadedNode { name: "n".into(), mesh: Arc::clone(&mesh), transform, extras: Value::Null };
    let mirror = DAffine3::from_scale(DVec3::new(-2.0, 1.0, 1.0));
    let merged = LoadedGlb { nodes: vec![node(mirror)], notes: Vec::new() }.into_mesh().unwrap();
    for t in merged.triangles() {
        let [a, b, c] = t.map(|i| merged.positions[i as usize]);
        let normal = (b - a).cross(c - a).normalize();
        assert!(normal.dot(merged.normals[t[0] as usize]) >= 0.999);
        assert!(normal.dot((a + b + c) / 3.0 - Vec3::Y * 0.5) > 0.0, "outward");
    }
    assert!(matches!(LoadedGlb::default().into_mesh(), Err(GlbError::Empty)));
}

#[test]
fn unusable_scenes_are_refused_before_they_are_written() {
    let mut broken = crate_box(chequer(4));
    broken.positions[3].x = f32::NAN;
    let error = glb_bytes(&scene(&Arc::new(broken))).unwrap_err();
    assert!(matches!(&error, GlbError::Mesh { node, .. } if node == "room_floor"), "{error}");
    let mut flat = scene(&Arc::new(crate_box(chequer(4))));
    flat.objects[0].transform.scale = DVec3::ZERO;
    assert!(matches!(glb_bytes(&flat), Err(GlbError::Transform { .. })));
    // Bad numbers that need not stop anybody are repaired.
    let mut odd = crate_box(chequer(4));
    odd.normals[0] = Vec3::ZERO;
    odd.uvs[1] = Vec2::splat(f32::NAN);
    odd.materials[0].roughness = f32::INFINITY;
    let back = read_glb(&glb_bytes(&scene(&Arc::new(odd))).unwrap(), &ReadLimits::default()).unwrap();
    assert!(back.nodes[0].mesh.check().is_ok());
}

#[test]
fn what_was_read_is_written_to_the_bit() {
    // Directions all around, of lengths that are one only within rounding, and some that are not one at all.
    let mut mesh = crate_box(chequer(4));
    let corners = mesh.clone();
    (0..40).for_each(|_| mesh.append(&corners));
    for (i, n) in mesh.normals.iter_mut().enumerate() {
        let (a, b) = (i as f32 * 0.37, i as f32 * 0.11 - 3.0);
        *n = Vec3::new(a.cos() * b.cos(), b.sin(), a.sin() * b.cos()) * if i % 5 == 0 { 1.7 } else { 1.0 };
    }
    let once = |mesh: Mesh| read_glb(&glb_bytes(&scene(&Arc::new(mesh))).unwrap(), &ReadLimits::default()).unwrap();
    let first = (*once(mesh.clone()).nodes[0].mesh).clone();
    assert!(first.normals.iter().all(|n| n.is_normalized()));
    let kept = mesh.normals.iter().filter(|n| n.is_normalized());
    assert!(kept.clone().any(|n| n.normalize() != *n), "lengths are off by rounding, else nothing is shown");
    assert!(kept.clone().all(|n| first.normals.contains(n)));
    let mut again = first.clone();
    for round in 0..4 {
        again = (*once(again).nodes[0].mesh).clone();
        assert_eq!(again.positions.len(), mesh.positions.len(), "vertices that parts share are read once");
        assert_eq!(
            (&again.positions, &again.normals, &again.uvs),
            (&first.positions, &first.normals, &first.uvs),
            "{round}"
        );
    }
}

/// The box as before with a tile on its top: the sides have a texture, the top has metres.
fn tiled_box() -> Mesh {
    let mut mesh = crate_box(chequer(16));
    mesh.metric_uvs = mesh.positions.iter().map(|p| Vec2::new(p.x * 3.0 + 0.2, p.z * 3.0)).collect();
    let mut oak = Material::plain("oak", [1.0, 0.9, 0.8]);
    (oak.sheen, oak.roughness, oak.hairy) = (0.4, 0.8, true);
    let map = |k: u8| Arc::new(image::RgbImage::from_fn(32, 16, |x, y| image::Rgb([k, (x * 8) as u8, (y * 16) as u8])));
    oak.tile = Some(Arc::new(harmony_mesh::Tile {
        size: [1.2, 0.6],
        turn: 0.5,
        color: Arc::new(RgbaImage::from_fn(32, 16, |x, y| Rgba([(x * 7) as u8, (y * 15) as u8, 90, 255]))),
        normal: Some(map(128)),
        surface: Some(map(255)),
    }));
    mesh.materials[1] = oak;
    mesh
}

#[test]
fn a_dark_cloths_sheen_is_darker_than_the_cloth_and_of_its_hue() {
    let mut mesh = crate_box(chequer(16));
    let named = |name: &str, color: [f32; 3]| Material { sheen: 0.5, ..Material::plain(name, color) };
    mesh.materials = vec![named("wine", [0.11, 0.001, 0.03]), named("linen", [0.6, 0.55, 0.5])];
    let bytes = glb_bytes(&scene(&Arc::new(mesh))).unwrap();
    let doc = document(&bytes);
    let sheen = |name: &str| -> Vec<f64> {
        let all = doc["materials"].as_array().unwrap().iter();
        let found = all.clone().find(|m| m["name"] == name).unwrap();
        let color = &found["extensions"]["KHR_materials_sheen"]["sheenColorFactor"];
        color.as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).collect()
    };
    let wine = sheen("wine");
    assert!(wine[0] > 2.0 * wine[1] && wine.iter().all(|c| *c < 0.11), "{wine:?}");
    assert!((sheen("linen")[0] - 0.5).abs() <= 1e-6, "a bright cloth has the sheen that was said");
    let back = read_glb(&bytes, &ReadLimits::default()).unwrap();
    assert!(back.nodes[0].mesh.materials.iter().all(|m| (m.sheen - 0.5).abs() <= 1e-6), "the number comes back");
}

#[test]
fn tiles_come_back_with_their_metres() {
    let mesh = tiled_box();
    let bytes = glb_bytes(&scene(&Arc::new(mesh.clone()))).unwrap();
    let doc = document(&bytes);
    let oak = doc["materials"].as_array().unwrap().iter().find(|m| m["name"] == "oak").unwrap();
    for map in
        ["/normalTexture", "/pbrMetallicRoughness/baseColorTexture", "/pbrMetallicRoughness/metallicRoughnessTexture"]
    {
        assert!(oak.pointer(map).is_some_and(|t| t["index"].is_u64()), "{map}");
    }
    let sheen = &oak["extensions"]["KHR_materials_sheen"]["sheenColorFactor"];
    let most = sheen.as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).fold(0.0, f64::max);
    assert!(most > 0.0 && most <= 0.4 + 1e-6, "{sheen}");
    // The top's coordinates are metres, turned back by the tile's turn, in tiles; two corners by hand.
    let back = read_glb(&bytes, &ReadLimits::default()).unwrap();
    assert!(back.notes.is_empty(), "{:?}", back.notes);
    let got = &back.nodes[0].mesh;
    let (m, tile) = got.materials.iter().find_map(|m| m.tile.as_ref().map(|t| (m, t))).unwrap();
    let want = mesh.materials[1].tile.as_ref().unwrap();
    assert_eq!((m.name.as_str(), tile.size, tile.turn, m.hairy), ("oak", [1.2, 0.6], 0.5, true));
    assert!((m.sheen - 0.4).abs() <= 1e-6 && (m.roughness - 0.8).abs() <= 1e-6 && m.texture.is_none());
    assert_eq!((&tile.color, &tile.normal, &tile.surface), (&want.color, &want.normal, &want.surface));
    let (sin, cos) = 0.5_f32.sin_cos();
    let mut top = 0;
    for (p, (uv, metric)) in got.positions.iter().zip(got.uvs.iter().zip(&got.metric_uvs)) {
        let m = Vec2::new(p.x * 3.0 + 0.2, p.z * 3.0);
        if p.y == 1.0 && (*metric - m).length() <= 1e-4 {
            let by_hand = Vec2::new((cos * m.x + sin * m.y) / 1.2, (cos * m.y - sin * m.x) / 0.6);
            assert!((*uv - by_hand).length() <= 1e-4);
            top += 1;
        }
    }
    assert!(top >= 4, "{top}");
    assert_eq!(got.triangle_count(), mesh.triangle_count());
    // Sides keep their texture and its coordinates.
    assert!(got.materials.iter().any(|m| m.texture.is_some() && m.tile.is_none()));
    // Written once more it stays what it is.
    let again = read_glb(&glb_bytes(&scene(got)).unwrap(), &ReadLimits::default()).unwrap();
    let again = &again.nodes[0].mesh;
    assert_eq!((&again.positions, &again.groups.len()), (&got.positions, &got.groups.len()));
    assert!(again.metric_uvs.iter().zip(&got.metric_uvs).all(|(a, b)| (*a - *b).length() <= 1e-5));
}

/// With `HARMONY_GLB_OUT` the scene is kept for the Khronos validator.
#[test]
fn a_scene_of_tiles_and_glass_is_written() {
    let mut mesh = tiled_box();
    mesh.append(&crate_box(chequer(80)));
    let bytes = glb_bytes(&GlbScene { textures: TextureEncoding::Compact, ..scene(&Arc::new(mesh)) }).unwrap();
    assert!(read_glb(&bytes, &ReadLimits::default()).unwrap().notes.is_empty());
    if let Some(path) = std::env::var_os("HARMONY_GLB_OUT") {
        std::fs::write(path, bytes).unwrap();
    }
}

#[test]
fn tangents_run_along_u_and_know_the_images_top() {
    // A floor: u along +x, v along +z, so that the image's top is towards -z; and its mirror image.
    let positions = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 0.0, 1.0), Vec3::Z];
    let triangles = [0, 2, 1, 0, 3, 2];
    for side in [1.0, -1.0] {
        let uvs: Vec<Vec2> = positions.iter().map(|p| Vec2::new(side * p.x, p.z) * 3.0).collect();
        let got = normals::tangents(&positions, &[Vec3::Y; 4], &uvs, &triangles);
        for t in got {
            let (along, up) = (t.truncate(), Vec3::Y.cross(t.truncate()) * t.w);
            assert!((along - Vec3::X * side).length() <= 1e-6 && (up - Vec3::NEG_Z).length() <= 1e-6, "{t}");
        }
    }
    // Without coordinates there is still a tangent.
    let got = normals::tangents(&positions, &[Vec3::Y; 4], &[Vec2::ZERO; 4], &triangles);
    assert!(got.iter().all(|t| (t.truncate().length() - 1.0).abs() <= 1e-6 && t.y.abs() <= 1e-6 && t.w.abs() == 1.0));
}

#[test]
fn equal_images_are_written_once() {
    let mesh = tiled_box();
    let mut other = tiled_box();
    other.materials[1].name = "oak of another object".into();
    let mut scene = scene(&Arc::new(mesh));
    let images = |scene: &GlbScene<'_>| document(&glb_bytes(scene).unwrap())["images"].as_array().unwrap().len();
    let before = images(&scene);
    scene.objects[1].mesh = Arc::new(other);
    assert_eq!((before, images(&scene)), (4, 4), "a texture, a tile of three");
    // A tile without metric coordinates cannot be laid: nothing of it is written.
    let mut bare = tiled_box();
    bare.metric_uvs.clear();
    scene.objects.clear();
    scene.shell[0].mesh = Arc::new(bare);
    assert_eq!(images(&scene), 1);
}

#[test]
fn clear_things_have_an_alpha_for_viewers_that_know_no_transmission() {
    let mut mesh = crate_box(chequer(8));
    mesh.materials[1].transmission = 1.0;
    let bytes = glb_bytes(&scene(&Arc::new(mesh))).unwrap();
    let doc = document(&bytes);
    let glass = doc["materials"].as_array().unwrap().iter().find(|m| m["name"] == "glass").unwrap();
    let alpha = glass["pbrMetallicRoughness"]["baseColorFactor"][3].as_f64().unwrap();
    assert!(glass["alphaMode"] == "BLEND" && (0.25..=0.4).contains(&alpha), "{glass}");
    assert_eq!(glass["extensions"]["KHR_materials_transmission"]["transmissionFactor"], 1.0);
    let back = read_glb(&bytes, &ReadLimits::default()).unwrap();
    let glass = back.nodes[0].mesh.materials.iter().find(|m| m.name == "glass").unwrap();
    assert_eq!((glass.base_color[3], glass.transmission), (1.0, 1.0));
    // Half transmission stands half way.
    let mut mesh = crate_box(chequer(8));
    mesh.materials[1].transmission = 0.5;
    let doc = document(&glb_bytes(&scene(&Arc::new(mesh))).unwrap());
    let glass = doc["materials"].as_array().unwrap().iter().find(|m| m["name"] == "glass").unwrap();
    assert!(
        (glass["pbrMetallicRoughness"]["baseColorFactor"][3].as_f64().unwrap() - f64::midpoint(1.0, alpha)).abs()
            <= 1e-6
    );
}

#[test]
fn transmission_textures_are_averaged() {
    let mesh = crate_box(chequer(8));
    let bytes = glb_bytes(&scene(&Arc::new(mesh))).unwrap();
    let mut doc = document(&bytes);
    // The chequer's red is 200 and 30 in equal parts.
    for m in doc["materials"].as_array_mut().unwrap() {
        if m["name"] == "glass" {
            m["extensions"]["KHR_materials_transmission"]["transmissionTexture"] = json!({ "index": 0 });
        }
    }
    let text = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let back = read_glb(&glb(&doc, &bytes[28 + text..]), &ReadLimits::default()).unwrap();
    let glass = back.nodes[0].mesh.materials.iter().find(|m| m.name == "glass").unwrap();
    assert!((glass.transmission - 0.9 * 115.0 / 255.0).abs() <= 1e-3, "{}", glass.transmission);
}

/// A GLB file from a JSON document and a binary chunk.
fn glb(doc: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = serde_json::to_vec(doc).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(((12 + 8 + text.len() + 8 + binary.len()) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(binary);
    out
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// One quad as a triangle strip without indices, normals, coordinates or material.
fn bare_quad() -> (Value, Vec<u8>) {
    let binary = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
    let doc = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "matrix": [0,0,-2,0, 0,2,0,0, 2,0,0,0, 5,6,7,1] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "mode": 5 }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }],
        "buffers": [{ "byteLength": 48 }],
    });
    (doc, binary)
}

#[test]
fn foreign_files_with_the_bare_minimum_load() {
    let (doc, binary) = bare_quad();
    let found = read_glb(&glb(&doc, &binary), &ReadLimits::default()).unwrap();
    assert_eq!(found.nodes[0].name, "node_0");
    let mesh = found.into_mesh().unwrap();
    assert_eq!(mesh.triangle_count(), 2);
    // Columns of the matrix: x -> -2 z, y -> 2 y, z -> 2 x, moved by (5, 6, 7).
    assert!(mesh.positions.iter().any(|p| (*p - Vec3::new(5.0, 8.0, 5.0)).length() <= 1e-5));
    // The quad's face, +Z in its frame, is +X in the scene; the strip's second triangle is not turned over.
    assert!(mesh.normals.iter().all(|n| (*n - Vec3::X).length() <= 1e-5));
}

#[test]
fn packed_and_sparse_arrays_are_decoded() {
    // Positions as normalised 16-bit integers with a stride, one of them replaced sparsely.
    let mut binary: Vec<u8> = Vec::new();
    for v in [[0_i16, 0, 0], [32_767, 0, 0], [0, 32_767, 0]] {
        binary.extend(v.iter().flat_map(|c| c.to_le_bytes()));
        binary.extend([0, 0]);
    }
    binary.extend([2, 0, 0, 0]);
    binary.extend([0_i16, -32_767, 0, 0].iter().flat_map(|c| c.to_le_bytes()));
    let doc = json!({
        "asset": { "version": "2.0" },
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{ "mesh": 0, "name": "tri" }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{
            "bufferView": 0, "componentType": 5122, "count": 3, "type": "VEC3", "normalized": true,
            "sparse": { "count": 1, "indices": { "bufferView": 1, "componentType": 5121 }, "values": { "bufferView": 2 } },
        }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 24, "byteStride": 8 },
            { "buffer": 0, "byteOffset": 24, "byteLength": 1 },
            { "buffer": 0, "byteOffset": 28, "byteLength": 8 },
        ],
        "buffers": [{ "byteLength": 36 }],
    });
    let found = read_glb(&glb(&doc, &binary), &ReadLimits::default()).unwrap();
    assert!(found.notes.is_empty());
    assert!(found.nodes[0].mesh.positions.contains(&Vec3::new(1.0, 0.0, 0.0)));
    assert!(found.nodes[0].mesh.positions.contains(&Vec3::new(0.0, -1.0, 0.0)));
}

#[test]
fn hostile_documents_are_refused_or_repaired() {
    type Change = fn(&mut Value);
    let refused: [(&str, Change); 14] = [
        ("buffer view past the end", |d| d["bufferViews"][0]["byteLength"] = json!(4_000_000_000_u64)),
        ("offset that overflows", |d| d["bufferViews"][0]["byteOffset"] = json!(u64::MAX)),
        ("too many elements", |d| d["accessors"][0]["count"] = json!(5)),
        ("absurd count", |d| d["accessors"][0]["count"] = json!(u64::MAX)),
        ("absurd count without bytes", |d| {
            d["accessors"][0]["bufferView"] = Value::Null;
            d["accessors"][0]["count"] = json!(4_000_000_000_u64);
        }),
        ("stride smaller than the element", |d| d["bufferViews"][0]["byteStride"] = json!(4)),
        ("no such accessor", |d| d["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(9)),
        ("no such mesh", |d| d["nodes"][0]["mesh"] = json!(9)),
        ("no such node", |d| d["scenes"][0]["nodes"] = json!([7])),
        ("no such material", |d| d["meshes"][0]["primitives"][0]["material"] = json!(3)),
        ("draco", |d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])),
        ("outside buffer", |d| d["buffers"][0]["uri"] = json!("/etc/passwd")),
        ("negative index", |d| d["nodes"][0]["mesh"] = json!(-1)),
        ("glTF 1", |d| d["asset"]["version"] = json!("1.0")),
    ];
    for (name, change) in refused {
        let (mut doc, binary) = bare_quad();
        change(&mut doc);
        let error = read_glb(&glb(&doc, &binary), &ReadLimits::default()).and_then(LoadedGlb::into_mesh);
        assert!(error.is_err(), "{name}");
    }
    let repaired: [(&str, Change); 4] = [
        ("cycle", |d| d["nodes"][0]["children"] = json!([0, 0])),
        ("zero quaternion", |d| d["nodes"] = json!([{ "mesh": 0, "rotation": [0, 0, 0, 0] }])),
        ("missing texture", |d| {
            d["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 4 } } }]);
            d["meshes"][0]["primitives"][0]["material"] = json!(0);
        }),
        ("unknown required extension", |d| d["extensionsRequired"] = json!(["ACME_x"])),
    ];
    for (name, change) in repaired {
        let (mut doc, binary) = bare_quad();
        change(&mut doc);
        let mesh = read_glb(&glb(&doc, &binary), &ReadLimits::default()).and_then(LoadedGlb::into_mesh);
        assert!(mesh.is_ok_and(|m| m.check().is_ok()), "{name}");
    }
}

#[test]
fn triangles_with_impossible_points_are_dropped_and_bad_indices_refused() {
    let (doc, mut binary) = bare_quad();
    binary[36..40].copy_from_slice(&f32::NAN.to_le_bytes());
    let found = read_glb(&glb(&doc, &binary), &ReadLimits::default()).unwrap();
    assert_eq!(found.nodes[0].mesh.triangle_count(), 1);
    assert!(found.notes[0].contains("1 of 2"));
    let (mut doc, mut binary) = bare_quad();
    binary.extend([0, 0, 1, 0, 4, 0, 0, 0]);
    doc["accessors"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" }));
    doc["bufferViews"].as_array_mut().unwrap().push(json!({ "buffer": 0, "byteOffset": 48, "byteLength": 6 }));
    doc["meshes"][0]["primitives"][0] = json!({ "attributes": { "POSITION": 0 }, "indices": 1 });
    let error = read_glb(&glb(&doc, &binary), &ReadLimits::default()).unwrap_err();
    assert!(matches!(error, GlbError::BadIndex { index: 4, count: 4 }), "{error}");
}

#[test]
fn limits_hold() {
    let bytes = glb_bytes(&scene(&Arc::new(crate_box(chequer(64))))).unwrap();
    let limits = ReadLimits::default();
    let too_large = |limits: ReadLimits| matches!(read_glb(&bytes, &limits), Err(GlbError::TooLarge { .. }));
    assert!(too_large(ReadLimits { bytes: 100, ..limits }));
    assert!(too_large(ReadLimits { triangles: 35, ..limits }), "three instances of twelve triangles");
    assert!(too_large(ReadLimits { vertices: 20, ..limits }));
    assert!(too_large(ReadLimits { nodes: 3, ..limits }));
    let found = read_glb(&bytes, &ReadLimits { texture_pixels: 64 * 64 - 1, ..limits }).unwrap();
    assert!(found.nodes[0].mesh.materials.iter().all(|m| m.texture.is_none()));
    assert!(found.notes.iter().any(|n| n.contains("too many")), "{:?}", found.notes);
}

#[test]
fn damaged_bytes_never_panic() {
    let bytes = glb_bytes(&scene(&Arc::new(crate_box(chequer(16))))).unwrap();
    for cut in (0..bytes.len()).step_by(37) {
        assert!(read_glb(&bytes[..cut], &ReadLimits::default()).is_err(), "cut at {cut}");
    }
    let mut state = 11_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    let text_end = 20 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    for round in 0..3000 {
        let mut broken = bytes.clone();
        for _ in 0..3 {
            // Mostly digits in the JSON: numbers that point somewhere else.
            let at = 20 + next() % (text_end - 20);
            if round % 3 == 0 {
                broken[next() % bytes.len()] = next() as u8;
            } else if broken[at].is_ascii_digit() {
                broken[at] = b'0' + (next() % 10) as u8;
            }
        }
        if let Ok(found) = read_glb(&broken, &ReadLimits::default()) {
            for n in &found.nodes {
                n.mesh.check().unwrap();
            }
            let _ = found.into_mesh();
        }
    }
}

#[test]
fn meshes_without_normals_are_smooth_but_for_creases() {
    // A box with shared corners: every face stays flat. A fine cylinder side: shared normals.
    let mut shared_box = Mesh::default();
    for i in 0..8 {
        let bit = |k: i32| if i >> k & 1 == 1 { 0.5 } else { -0.5 };
        shared_box.positions.push(Vec3::new(bit(0), bit(1), bit(2)));
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    shared_box.uvs = vec![Vec2::ZERO; 8];
    shared_box.groups = vec![Group {
        material: 0,
        triangles: quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect(),
    }];
    let out = normals::creased(&shared_box);
    assert_eq!(out.positions.len(), 24);
    assert!(
        out.positions
            .iter()
            .zip(&out.normals)
            .all(|(p, n)| (n.abs().max_element() - 1.0).abs() <= 1e-6 && p.dot(*n) > 0.0)
    );
    let mut side = Mesh { uvs: vec![Vec2::ZERO; 64], ..Mesh::default() };
    for k in 0..32 {
        let a = k as f32 / 32.0 * std::f32::consts::TAU;
        side.positions.push(Vec3::new(a.cos(), 0.0, a.sin()));
        side.positions.push(Vec3::new(a.cos(), 1.0, a.sin()));
    }
    let tris = (0..32_u32).flat_map(|k| {
        let (a, b, c, d) = (2 * k, 2 * k + 1, (2 * k + 2) % 64, (2 * k + 3) % 64);
        [[a, b, c], [c, b, d]]
    });
    side.groups = vec![Group { material: 0, triangles: tris.collect() }];
    let out = normals::creased(&side);
    assert_eq!(out.positions.len(), 64);
    for (p, n) in out.positions.iter().zip(&out.normals) {
        let radial = Vec3::new(p.x, 0.0, p.z).normalize();
        assert!(n.dot(radial) >= 0.99, "{p} {n}");
    }
}

#[test]
fn furniture_of_another_project_loads_and_draco_is_named() {
    let (Some(house), Some(page)) = (shared("models3d/scene_185"), shared("gt/README.md")) else { return };
    let packed = load_glb(&house.join("scene_named.glb"), &ReadLimits::default());
    assert!(matches!(packed, Err(GlbError::Unsupported { what: "Draco compression" })), "{packed:?}");
    // Rough sizes that anybody expects of the things, metres.
    for (name, low, high) in [("bed_0", 1.5, 2.6), ("coffee_table_0", 0.5, 1.6), ("hardcover_book_0", 0.1, 0.4)] {
        let mesh = load_mesh_glb(&house.join(format!("collision/{name}.glb")), &ReadLimits::default()).unwrap();
        let size = mesh.bounds().unwrap().size().max_element();
        assert!((low..high).contains(&size), "{name} is {size} m large");
    }
    assert!(matches!(load_glb(&page, &ReadLimits::default()), Err(GlbError::NotGlb)));
}
