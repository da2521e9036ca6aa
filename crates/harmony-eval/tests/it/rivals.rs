//! One chiral scene, written as each program leaves its scenes by the facts of its formats: axes, units, files. What is
//! read back must lie where it was, with its outside outside, and look the same from the camera that was read.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
use harmony_eval::rivals::{
    Axes, DrawOptions, PartKind, RivalError, RivalKind, RivalOptions, RivalScene, draw, load, write,
};
use harmony_io::npz::{NpyEntry, write_npz};
use harmony_io::{GlbNode, GlbScene, NodeTransform, write_glb, write_mesh_glb};
use harmony_mesh::{Group, Material, Mesh, ShellOptions, room_shell_with};
use harmony_render::{Instance, RenderOptions, render};
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Lighting, Room, Scene, SceneCamera, Surface, ViewTransform,
};
use image::DynamicImage;
use serde_json::{Value, json};

const SIZE: ImageSize = ImageSize { width: 160, height: 120 };
const HFOV: f64 = 1.0;
/// From OpenCV's camera axes to glTF's and back.
const FLIP: DMat3 = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);

fn lens() -> Intrinsics {
    Intrinsics::from_horizontal_fov(SIZE, HFOV)
}

/// Closed boxes, wound outwards.
fn boxes(list: &[([f64; 3], [f64; 3])], color: [f32; 3]) -> Mesh {
    let mut mesh =
        Mesh { materials: vec![Material::plain("paint", color)], groups: vec![Group::default()], ..Mesh::default() };
    for (min, size) in list {
        let base = mesh.positions.len() as u32;
        for i in 0..8_usize {
            let at = |axis: usize| (min[axis] + if i >> axis & 1 == 1 { size[axis] } else { 0.0 }) as f32;
            mesh.positions.push(Vec3::new(at(0), at(1), at(2)));
        }
        for q in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let q = q.map(|i| i + base);
            mesh.groups[0].triangles.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        }
    }
    mesh.uvs = vec![Vec2::ZERO; mesh.positions.len()];
    mesh.recompute_normals();
    mesh
}

/// In glTF's camera axes: two boxes, and three arms of unequal lengths, which no turn carries onto their mirror image.
fn truth() -> Vec<(String, Mesh)> {
    let arms = [
        ([-0.9, -0.5, -3.0], [0.9, 0.15, 0.15]),
        ([-0.9, -0.5, -3.0], [0.15, 0.6, 0.15]),
        ([-0.9, -0.5, -3.0], [0.15, 0.15, 0.4]),
    ];
    vec![
        ("1_arm chair".to_owned(), boxes(&[([0.3, -0.6, -3.4], [0.5, 0.9, 0.4])], [0.8, 0.1, 0.1])),
        ("2_low table".to_owned(), boxes(&[([-0.2, -0.7, -2.6], [0.3, 0.2, 0.35])], [0.1, 0.7, 0.1])),
        ("3_tripod".to_owned(), boxes(&arms, [0.1, 0.2, 0.9])),
    ]
}

/// The mesh elsewhere.
fn moved(mesh: &Mesh, by: &DAffine3) -> Mesh {
    assert!(by.matrix3.determinant() > 0.0, "a test that mirrors proves nothing");
    let mut mesh = mesh.clone();
    let normals = by.matrix3.inverse().transpose();
    mesh.map(
        |p| by.transform_point3(p.as_dvec3()).as_vec3(),
        |n| (normals * n.as_dvec3()).normalize_or_zero().as_vec3(),
    );
    mesh
}

fn turned(mesh: &Mesh, by: DMat3) -> Mesh {
    moved(mesh, &DAffine3::from_mat3(by))
}

fn one_glb(path: &Path, name: &str, mesh: &Mesh) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    write_mesh_glb(path, name, Arc::new(mesh.clone()), Value::Null).unwrap();
}

fn whole_glb(path: &Path, place: &DAffine3, camera: Option<Camera>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let node = |(name, mesh): (String, Mesh)| GlbNode {
        name,
        mesh: Arc::new(moved(&mesh, place)),
        transform: NodeTransform::IDENTITY,
        extras: Value::Null,
    };
    let scene = GlbScene {
        objects: truth().into_iter().map(node).collect(),
        camera,
        generator: "test".into(),
        ..GlbScene::default()
    };
    write_glb(&scene, path).unwrap();
}

fn put(path: &Path, value: &Value) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, value.to_string()).unwrap();
}

/// `.npy`, version 1.
fn npy(path: &Path, shape: &str, values: &[f64]) {
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\0".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, out).unwrap();
}

/// A pose of the camera in a world with glTF's axes: `world_from_camera`.
fn pose() -> DAffine3 {
    DAffine3 {
        matrix3: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(-0.2),
        translation: DVec3::new(1.5, 1.4, 4.0),
    }
}

/// The camera there.
fn camera_at(place: &DAffine3, size: ImageSize, intrinsics: Intrinsics) -> Camera {
    let rotation = FLIP * place.matrix3.transpose();
    Camera { size, intrinsics, rotation, translation: -(rotation * place.translation) }
}

/// Corners of all triangles in the camera's frame, and the volume that they enclose.
fn corners(mesh: &Mesh, camera: impl Fn(DVec3) -> DVec3) -> (Vec<DVec3>, f64) {
    let mut out = Vec::new();
    let mut volume = 0.0;
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|i| camera(mesh.positions[i as usize].as_dvec3()));
        volume += a.dot(b.cross(c)) / 6.0;
        out.extend([a, b, c]);
    }
    (out, volume)
}

/// That the objects lie where they were, are not mirrored and not inside out, and cover the same pixels.
fn assert_same(scene: &RivalScene, scale: f64) {
    let camera = scene.camera.expect("a camera");
    let objects: Vec<_> = scene.parts.iter().filter(|p| p.kind == PartKind::Object).collect();
    let truth = truth();
    assert_eq!(objects.len(), truth.len(), "{:?}", scene.parts.iter().map(|p| &p.name).collect::<Vec<_>>());
    for (part, (name, mesh)) in objects.iter().zip(&truth) {
        let (found, volume) = corners(&part.mesh, |p| camera.to_camera(p) / scale);
        let (wanted, known) = corners(mesh, |p| FLIP * p);
        let near = |p: &DVec3, all: &[DVec3]| all.iter().map(|q| q.distance(*p)).fold(f64::INFINITY, f64::min);
        let off =
            found.iter().map(|p| near(p, &wanted)).chain(wanted.iter().map(|p| near(p, &found))).fold(0.0, f64::max);
        assert!(off <= 1e-5, "{name}: {off}");
        assert!((volume - known).abs() <= 1e-5 && known > 0.0, "{name}: {volume} is not {known}");
    }
    let camera = if camera.size == SIZE { camera } else { camera.resized(SIZE) };
    let own: Vec<Instance<'_>> = objects.iter().zip(1..).map(|(p, id)| Instance::in_room(&p.mesh, id)).collect();
    let reference: Vec<Instance<'_>> = truth.iter().zip(1..).map(|((_, m), id)| Instance::in_room(m, id)).collect();
    let known = Camera { size: SIZE, intrinsics: lens(), rotation: FLIP, translation: DVec3::ZERO };
    let options = RenderOptions::default();
    let (a, b) = (render(&camera, &own, &options), render(&known, &reference, &options));
    let differ = a.ids.iter().zip(&b.ids).filter(|(a, b)| a != b).count();
    assert!(b.ids.iter().filter(|id| **id != 0).count() > 1000, "the scene is in the picture");
    // Corners are rounded to f32 in other places: a pixel on an edge may fall to its neighbour.
    assert!(differ <= 4, "{differ} pixels differ");
}

fn read(kind: RivalKind, folder: &Path) -> RivalScene {
    load(kind, folder, &RivalOptions::default()).unwrap_or_else(|e| panic!("{}: {e}", kind.name()))
}

fn refusal(kind: RivalKind, folder: &Path) -> String {
    let error = load(kind, folder, &RivalOptions::default()).expect_err(kind.name());
    assert!(error.hint().is_some(), "{error}");
    error.to_string()
}

#[test]
fn gen3dsr_has_opencv_axes_and_its_unposed_meshes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let rec = folder.path().join("rec_17");
    for (name, mesh) in truth() {
        one_glb(&rec.join(format!("object_space/{name}_model.glb")), "mesh", &boxes(&[([0.0; 3], [1.0; 3])], [0.5; 3]));
        let _ = mesh;
    }
    assert!(refusal(RivalKind::Gen3dsr, folder.path()).contains("not placed"));
    for (name, mesh) in truth() {
        one_glb(&rec.join(format!("reconstruction/{name}.glb")), "geometry_0", &turned(&mesh, FLIP));
    }
    fs::write(
        rec.join("reconstruction/background.ply"),
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
         -9 -9 6 9 9 9\n9 -9 6 9 9 9\n0 9 6 9 9 9\n3 0 1 2\n",
    )
    .unwrap();
    assert!(refusal(RivalKind::Gen3dsr, folder.path()).contains("cam_params.json"));
    let k = lens();
    let rows = json!([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]]);
    let identity = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    put(&rec.join("cam_params.json"), &json!({"K": rows, "c2w": identity, "W": 160, "H": 120}));
    let scene = read(RivalKind::Gen3dsr, folder.path());
    assert_same(&scene, 1.0);
    assert_eq!(scene.parts[0].name, "1_arm chair");
    let shell: Vec<_> = scene.parts.iter().filter(|p| p.kind == PartKind::Shell).collect();
    let camera = scene.camera.unwrap();
    assert!(shell.len() == 1 && (camera.depth(shell[0].mesh.positions[0].as_dvec3()) - 6.0).abs() < 1e-6);
    // With poses given, its files are in a world of OpenCV axes.
    let c2w = DAffine3 { matrix3: DMat3::from_rotation_y(0.3), translation: DVec3::new(0.5, -0.2, 1.0) };
    for (name, mesh) in truth() {
        one_glb(
            &rec.join(format!("reconstruction/{name}.glb")),
            "geometry_0",
            &moved(&mesh, &(c2w * DAffine3::from_mat3(FLIP))),
        );
    }
    let (r, t) = (c2w.matrix3.transpose(), c2w.translation);
    let row = |a: DVec3, t: f64| json!([a.x, a.y, a.z, t]);
    let rows4 = json!([row(r.x_axis, t.x), row(r.y_axis, t.y), row(r.z_axis, t.z), [0, 0, 0, 1]]);
    put(&rec.join("cam_params.json"), &json!({"K": rows, "c2w": rows4, "W": 160, "H": 120}));
    assert_same(&read(RivalKind::Gen3dsr, folder.path()), 1.0);
}

#[test]
fn sam_3d_is_placed_by_its_poses_and_splats_by_their_points() {
    let folder = tempfile::tempdir().unwrap();
    let pytorch = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0));
    let mut objects = Vec::new();
    for (i, (_, mesh)) in truth().into_iter().enumerate() {
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3 + i as f64, -0.7, 0.2);
        let (scale, shift) = (0.4 + 0.1 * i as f64, DVec3::new(0.3, -0.1 * i as f64, 2.5));
        // p_cam = R^T (s v) + t, and the file holds v with +Y up.
        let local_from_camera = DMat3::from_quat(turn) * (1.0 / scale) * pytorch;
        let glb_from_local = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let place = DAffine3 {
            matrix3: glb_from_local * local_from_camera,
            translation: -(glb_from_local * DMat3::from_quat(turn) * shift / scale),
        };
        one_glb(&folder.path().join(format!("glbs/{}.glb", i + 1)), "world", &moved(&mesh, &place));
        objects.push(json!({
            "mesh": format!("/home/somebody/out/{}.glb", i + 1), "rotation": [[turn.w, turn.x, turn.y, turn.z]],
            "translation": [shift.to_array()], "scale": [[scale, scale, scale]],
        }));
    }
    let list = json!({"width": 160, "height": 120, "f": lens().fx, "objects": objects});
    put(&folder.path().join("glbs/poses.json"), &list);
    let scene = read(RivalKind::Sam3d, folder.path());
    assert_same(&scene, 1.0);
    // One of them as a splat: local frame with +Z up, two opaque points and a transparent one.
    let splat = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\nproperty float scale_0\n\
        property float scale_1\nproperty float scale_2\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\n\
        property float rot_3\nend_header\n0 0 0 1.7 -1.7 -1.7 4 -5 -5 -5 1 0 0 0\n0 0 1 0 0 0 4 -5 -5 -5 1 0 0 0\n\
        9 9 9 0 0 0 -4 -5 -5 -5 1 0 0 0\n";
    let own = tempfile::tempdir().unwrap();
    fs::write(own.path().join("splat.ply"), splat).unwrap();
    assert!(refusal(RivalKind::Sam3d, own.path()).contains("lost its pose"));
    let one = json!([{"mesh": "splat.ply", "rotation": [1, 0, 0, 0], "translation": [0.5, 0.0, 3.0], "scale": 2.0}]);
    put(&own.path().join("poses.json"), &one);
    let scene =
        load(RivalKind::Sam3d, own.path(), &RivalOptions { hfov: Some(HFOV), ..RivalOptions::default() }).unwrap();
    let bounds = scene.parts[0].mesh.bounds().unwrap();
    // (0, 0, 0) goes to t, (0, 0, 1) to t + (0, 0, 2); PyTorch3D's x and z are turned.
    let (low, high) = (DVec3::new(-0.5, 0.0, -5.0), DVec3::new(-0.5, 0.0, -3.0));
    assert!((bounds.min - low).length() < 0.1 && (bounds.max - high).length() < 0.1, "{bounds:?}");
    assert!(scene.notes.iter().any(|n| n.contains("2 of 3")), "{:?}", scene.notes);
    assert!(scene.camera.is_some() && scene.notes.iter().any(|n| n.contains("field of view")));
    assert!(load(RivalKind::Sam3d, own.path(), &RivalOptions::default()).unwrap().camera.is_none());
}

#[test]
fn regen_has_a_blender_pose_and_a_shell() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("output");
    whole_glb(&out.join("glb/scene/combined_scene.glb"), &DAffine3::from_scale(DVec3::splat(2.0)), None);
    one_glb(
        &out.join("pointclouds/meshed/ground_aligned.glb"),
        "mesh",
        &boxes(&[([-4.0, -1.0, -9.0], [8.0, 0.1, 9.0])], [0.5; 3]),
    );
    let entries = [
        NpyEntry::f64("focal", &[], [lens().fx]),
        NpyEntry::f64("image_size", &[2], [160.0, 120.0]),
        // Blender's camera at the origin, looking along +Y, +Z up.
        NpyEntry::f64("extrinsic", &[4, 4], [1., 0., 0., 0., 0., 0., -1., 0., 0., 1., 0., 0., 0., 0., 0., 1.]),
    ];
    fs::create_dir_all(out.join("pre_3D")).unwrap();
    assert!(refusal(RivalKind::ReGen, folder.path()).contains("camera.npz"));
    write_npz(&out.join("pre_3D/camera.npz"), &entries).unwrap();
    let scene = read(RivalKind::ReGen, folder.path());
    assert_eq!(scene.parts.iter().filter(|p| p.kind == PartKind::Shell).count(), 1);
    assert_same(&scene, 2.0);
}

#[test]
fn cast_tells_what_it_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("photo/photo");
    for (i, (name, mesh)) in truth().into_iter().enumerate() {
        one_glb(&out.join(format!("positioned_objects/object_{i}_positioned.glb")), &name, &mesh);
        one_glb(&out.join(format!("object_{i}.glb")), &name, &boxes(&[([0.0; 3], [1.0; 3])], [0.5; 3]));
    }
    let k = lens();
    npy(&out.join("depth/intrinsics.npy"), "(3, 3)", &[k.fx / 160.0, 0.0, 0.5, 0.0, k.fy / 120.0, 0.5, 0.0, 0.0, 1.0]);
    assert!(refusal(RivalKind::Cast, folder.path()).contains("depth_map.npy"));
    npy(&out.join("depth/depth_map.npy"), "(120, 160)", &vec![1.0; 160 * 120]);
    put(&out.join("estimated_poses.json"), &json!({"poses": [{}, {}, {}, {}]}));
    let scene = read(RivalKind::Cast, folder.path());
    assert_same(&scene, 1.0);
    assert!(scene.notes.iter().any(|n| n.starts_with("1 of 4")), "{:?}", scene.notes);
}

/// The JSON of a GLB, changed.
fn with_json(path: &Path, change: impl Fn(&mut Value)) {
    let bytes = fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut value: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    change(&mut value);
    let mut text = value.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &bytes[20 + length..];
    let mut out = bytes[..8].to_vec();
    out.extend(((20 + text.len() + rest.len()) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(&bytes[16..20]);
    out.extend(text);
    out.extend(rest);
    fs::write(path, out).unwrap();
}

#[test]
fn a_glb_with_its_camera_is_read_whoever_made_it() {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("scene.glb");
    whole_glb(&glb, &pose(), Some(camera_at(&pose(), SIZE, lens())));
    assert_same(&read(RivalKind::Generic, folder.path()), 1.0);
    // Without our extras: the camera as every exporter writes it.
    with_json(&glb, |v| {
        for node in v["nodes"].as_array_mut().unwrap() {
            node.as_object_mut().unwrap().remove("extras");
        }
        for camera in v["cameras"].as_array_mut().unwrap() {
            camera.as_object_mut().unwrap().remove("extras");
        }
    });
    for kind in [RivalKind::Generic, RivalKind::Viga] {
        let options = RivalOptions { photo: Some(SIZE), ..RivalOptions::default() };
        assert_same(&load(kind, folder.path(), &options).unwrap(), 1.0);
    }
    // Two of them: one must be named.
    with_json(&glb, |v| {
        let nodes = v["nodes"].as_array_mut().unwrap();
        let mut second = nodes.iter().find(|n| n["camera"].is_u64()).unwrap().clone();
        second["name"] = json!("Camera.002");
        nodes.push(second);
    });
    assert!(refusal(RivalKind::Viga, folder.path()).contains("Camera.002"));
    let options = RivalOptions { camera_name: Some("camera".into()), ..RivalOptions::default() };
    assert_same(&load(RivalKind::Viga, folder.path(), &options).unwrap(), 1.0);
    let blend = tempfile::tempdir().unwrap();
    fs::write(blend.path().join("blender_file.blend"), "BLENDER").unwrap();
    assert!(refusal(RivalKind::Viga, blend.path()).contains(".blend"));
}

#[test]
fn files_without_axes_are_read_as_told() {
    // PLY with Blender's axes and OBJ with OpenCV's, cameras beside them.
    let folder = tempfile::tempdir().unwrap();
    let place = pose();
    let camera = camera_at(&place, SIZE, lens());
    let r = camera.rotation.transpose();
    let k = camera.intrinsics;
    let about = json!({
        "width": 160, "height": 120, "K": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
        "R": [r.x_axis.to_array(), r.y_axis.to_array(), r.z_axis.to_array()], "t": camera.translation.to_array(),
    });
    let camera_file = folder.path().join("camera.json");
    put(&camera_file, &about);
    for (axes, file_from_world, extension) in [
        ("z-up", DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y), "ply"),
        ("opencv", FLIP, "obj"),
        ("y-up", DMat3::IDENTITY, "obj"),
    ] {
        let file = folder.path().join(format!("{}.{extension}", axes.replace('-', "_")));
        let mut all = Mesh::default();
        for (_, mesh) in truth() {
            all.append(&moved(&mesh, &(DAffine3::from_mat3(file_from_world) * place)));
        }
        let text = |sep: &str, p: &Vec3| format!("{sep}{} {} {}\n", p.x, p.y, p.z);
        let content = if extension == "ply" {
            let head = format!(
                "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
                 property list uchar int vertex_indices\nend_header\n",
                all.positions.len(),
                all.triangle_count()
            );
            let points: String = all.positions.iter().map(|p| text("", p)).collect();
            let faces: String = all.triangles().map(|t| format!("3 {} {} {}\n", t[0], t[1], t[2])).collect();
            head + &points + &faces
        } else {
            let points: String = all.positions.iter().map(|p| text("v ", p)).collect();
            let faces: String =
                all.triangles().map(|t| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1)).collect();
            points + &faces
        };
        fs::write(&file, content).unwrap();
        let axes: Axes = axes.parse().unwrap();
        let options = RivalOptions { axes: Some(axes), camera: Some(camera_file.clone()), ..RivalOptions::default() };
        let scene = load(RivalKind::Generic, &file, &options).unwrap();
        let (found, volume) = corners(&scene.parts[0].mesh, |p| scene.camera.unwrap().to_camera(p));
        let mut whole = Mesh::default();
        for (_, mesh) in &truth() {
            whole.append(mesh);
        }
        let (wanted, known) = corners(&whole, |p| FLIP * p);
        let off = found.iter().zip(&wanted).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(
            found.len() == wanted.len() && off <= 1e-5 && (volume - known).abs() < 1e-5,
            "{axes:?}: {off} {volume}"
        );
    }
}

#[test]
fn the_papers_release_is_in_its_room() {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    whole_glb(&f.join("scene_full.glb"), &pose(), None);
    let (centre, forward) = (pose().translation, pose().matrix3 * DVec3::NEG_Z);
    let about = json!({
        "position_m": centre.to_array(), "look_at_m": (centre + 2.0 * forward).to_array(), "up": [0, 1, 0],
        "width_px": 160, "height_px": 120, "hfov_deg": HFOV.to_degrees(),
    });
    put(&f.join("camera_vggt.json"), &about);
    assert_same(&read(RivalKind::HarmonyRelease, f), 1.0);
    fs::remove_file(f.join("scene_full.glb")).unwrap();
    assert!(refusal(RivalKind::HarmonyRelease, f).contains("scene_full.glb"));
}

#[test]
fn programs_without_a_camera_get_the_one_of_the_papers_scripts_or_none() {
    let folder = tempfile::tempdir().unwrap();
    let midi = folder.path().join("midi/output.glb");
    let place =
        DAffine3 { matrix3: DMat3::from_rotation_x((-10.0_f64).to_radians()), translation: DVec3::new(0.0, 0.5, 2.5) };
    whole_glb(&midi, &place, None);
    let scene = read(RivalKind::Midi, &folder.path().join("midi"));
    let camera = scene.camera.unwrap();
    assert_eq!((camera.size, (camera.horizontal_fov() - 0.7).abs() < 1e-9), (ImageSize::new(1024, 1024), true));
    let (found, volume) = corners(&scene.parts[2].mesh, |p| camera.to_camera(p));
    let (wanted, known) = corners(&truth()[2].1, |p| FLIP * p);
    assert!(found.iter().zip(&wanted).all(|(a, b)| a.distance(*b) < 1e-5) && (volume - known).abs() < 1e-5);
    assert!(scene.notes.iter().any(|n| n.contains("no camera")));
    let gen_folder = folder.path().join("scenegen");
    let place = DAffine3 {
        matrix3: DMat3::from_rotation_z(0.2) * DMat3::from_rotation_x(1.3),
        translation: DVec3::new(0.1, 0.9, -0.4),
    };
    whole_glb(&gen_folder.join("17.glb"), &place, None);
    assert!(read(RivalKind::SceneGen, &gen_folder).camera.is_none());
    let about = json!({
        "camera_pos": [0.1, 0.9, -0.4], "camera_rotation_euler_xyz_deg": [1.3_f64.to_degrees(), 0.0, 0.2_f64.to_degrees()],
        "fov": HFOV, "width": 160, "height": 120,
    });
    put(&gen_folder.join("17_cam.json"), &about);
    assert_same(&read(RivalKind::SceneGen, &gen_folder), 1.0);
    whole_glb(&gen_folder.join("18.glb"), &place, None);
    assert!(refusal(RivalKind::SceneGen, &gen_folder).contains("2 GLB files"));
}

#[test]
fn sceneconductor_is_a_description_in_blenders_world() {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    let z_up = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    let blender_from_camera = DAffine3::from_mat3(z_up) * pose();
    let mut objects = Vec::new();
    for (i, (name, mesh)) in truth().into_iter().enumerate() {
        let angles = DVec3::new(0.2, -0.1 * i as f64, 0.9);
        let turn =
            DMat3::from_rotation_z(angles.z) * DMat3::from_rotation_y(angles.y) * DMat3::from_rotation_x(angles.x);
        let world = moved(&mesh, &blender_from_camera);
        let local = turned(&world, turn.transpose());
        let (centre, side) = (local.bounds().unwrap().centre(), local.bounds().unwrap().size().max_element());
        let unit =
            moved(&local, &(DAffine3::from_scale(DVec3::splat(1.0 / side)) * DAffine3::from_translation(-centre)));
        // In the file it is of any size, anywhere, +Y up.
        let y_up = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let any = DAffine3 { matrix3: y_up * 3.7, translation: DVec3::new(5.0, -2.0, 0.3) };
        one_glb(&f.join(format!("inputs/object/{i}.glb")), "geometry", &moved(&unit, &any));
        objects.push(json!({
            "id": name, "mesh_path": format!("/data/scene/inputs/object/{i}.glb"), "location": (turn * centre).to_array(),
            "rotation_euler": angles.to_array(), "scale": [side, side, side], "class": "x",
        }));
    }
    // Its camera looks along its -Z with +Y up; XYZ angles of blender_from_camera.
    let m = blender_from_camera.matrix3;
    let (x, y, z) = ((m.y_axis.z).atan2(m.z_axis.z), (-m.x_axis.z).asin(), (m.x_axis.y).atan2(m.x_axis.x));
    let lens_mm = 36.0 / 2.0 / (HFOV / 2.0).tan();
    let camera = json!({
        "location": blender_from_camera.translation.to_array(), "rotation_euler": [x, y, z], "lens": lens_mm,
        "sensor_width": 36.0, "sensor_fit": "AUTO", "resolution": [160, 120],
    });
    let stage = json!({"polygon_vertices": [[-3, -3], [5, -3], [5, 4], [-3, 4]], "floor_z": 0.0, "ceiling_z": 2.6, "openings": [{}]});
    let whole = json!({"objects": objects, "camera": camera, "stage": stage});
    put(&f.join("json/blender_scene.json"), &whole);
    let scene = read(RivalKind::SceneConductor, f);
    assert_same(&scene, 1.0);
    let shell: Vec<_> = scene.parts.iter().filter(|p| p.kind == PartKind::Shell).collect();
    assert_eq!(shell.len(), 6);
    let ceiling = shell.iter().find(|p| p.name == "ceiling").unwrap().mesh.bounds().unwrap();
    assert!(
        (ceiling.min.y - 2.6).abs() < 1e-5 && (ceiling.max.x - 5.0).abs() < 1e-5 && (ceiling.min.z + 4.0).abs() < 1e-5
    );
    assert!(scene.notes.iter().any(|n| n.contains("not cut")));
}

#[test]
fn folders_of_another_layout_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("notes.txt"), "x").unwrap();
    for kind in RivalKind::ALL {
        let text = refusal(kind, folder.path());
        assert!(text.contains(kind.name()), "{text}");
        assert_eq!(kind.name().parse::<RivalKind>().unwrap(), kind);
        assert!(refusal(kind, &folder.path().join("nowhere")).contains("not there"));
    }
    // Broken files of the right name end in an error, not in a panic.
    for (kind, file) in [
        (RivalKind::HarmonyRelease, "scene_full.glb"),
        (RivalKind::Midi, "output.glb"),
        (RivalKind::SceneConductor, "blender_scene.json"),
        (RivalKind::Generic, "scene.ply"),
    ] {
        let own = tempfile::tempdir().unwrap();
        fs::write(own.path().join(file), b"glTF\x02\0\0\0\xff\xff\xff\xff\xff\xff\xff\xffJSON{").unwrap();
        assert!(load(kind, own.path(), &RivalOptions::default()).is_err(), "{}", kind.name());
    }
}

/// A run of ours: a room of 4 x 2.6 x 5 m with an object that is the middle of the scene.
fn run(folder: &Path) -> Camera {
    let extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };
    let room = Room {
        room_type: "study".into(),
        extents,
        shape: harmony_scene::RoomShape::default(),
        seen: Vec::new(),
        openings: Vec::new(),
        floor_texture: None,
        wall_texture: None,
    };
    let camera = Camera::looking(SIZE, lens(), DVec3::new(2.0, 1.4, 4.5), DVec3::new(0.0, -0.1, -1.0));
    let shell = Surface::ALL.map(|surface| {
        let omit = Surface::ALL.into_iter().filter(|s| *s != surface).collect();
        let i = surface as u8;
        let plain = [0.2 + 0.1 * f32::from(i), 0.5, 0.9 - 0.1 * f32::from(i)];
        let options = ShellOptions { omit, plain, ..ShellOptions::default() };
        GlbNode {
            name: harmony_mesh::shell_material_name(surface).to_owned(),
            mesh: Arc::new(room_shell_with(&room, &|_| None, &options)),
            transform: NodeTransform::IDENTITY,
            extras: Value::Null,
        }
    });
    let scene = GlbScene { shell: shell.to_vec(), generator: "test".into(), ..GlbScene::default() };
    fs::create_dir_all(folder).unwrap();
    write_glb(&scene, &folder.join("scene_full.glb")).unwrap();
    let scene = Scene {
        version: 1,
        generator: "HARMONY test".into(),
        room,
        camera: SceneCamera::from(&camera),
        objects: Vec::new(),
        lighting: Lighting {
            lights: Vec::new(),
            ambient_color: [1.0; 3],
            ambient_intensity: 1.0,
            exposure: 0.0,
            view: ViewTransform::default(),
        },
        summary: String::new(),
        warnings: Vec::new(),
    };
    harmony_io::write_json(&folder.join("scene.json"), &scene).unwrap();
    image::RgbImage::from_pixel(160, 120, image::Rgb([90; 3])).save(folder.join("input.png")).unwrap();
    camera
}

#[test]
fn a_lent_background_is_where_our_camera_sees_it_and_behind_everything() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    let camera = run(&run_folder);
    // The rival has another lens, and its objects reach through our back wall.
    let theirs = folder.path().join("theirs/scene.glb");
    let other = Intrinsics::from_horizontal_fov(SIZE, 0.7);
    let place = DAffine3 { matrix3: DMat3::from_rotation_y(1.0), translation: DVec3::new(7.0, 0.0, -3.0) };
    whole_glb(&theirs, &(place * DAffine3::from_scale(DVec3::splat(40.0))), Some(camera_at(&place, SIZE, other)));
    let scene = read(RivalKind::Generic, theirs.parent().unwrap());
    let options = DrawOptions { run: Some(run_folder.clone()), lend_background: true, ..DrawOptions::default() };
    let drawn = draw(&scene, theirs.parent().unwrap(), &options).unwrap();
    assert!(drawn.report.background_lent);
    let bare =
        draw(&scene, theirs.parent().unwrap(), &DrawOptions { lend_background: false, ..options.clone() }).unwrap();
    assert!(!bare.report.background_lent && bare.report.coverage < 0.5 && bare.report.coverage > 0.02);
    let own = harmony_io::load_glb(&run_folder.join("scene_full.glb"), &harmony_io::ReadLimits::default()).unwrap();
    let instances: Vec<Instance<'_>> = own.nodes.iter().map(|n| Instance::in_room(&n.mesh, 1)).collect();
    let options_ = RenderOptions { multisample: true, background: [255; 4], ..RenderOptions::default() };
    let ours = DynamicImage::ImageRgba8(render(&camera, &instances, &options_).color).into_rgb8();
    let (mut shell, mut theirs_seen, mut wrong) = (0, 0, 0);
    for ((p, alone), own) in drawn.flat.pixels().zip(bare.flat.pixels()).zip(ours.pixels()) {
        if alone.0 == [255; 3] {
            shell += 1;
            wrong += usize::from(p != own);
        } else if p == alone {
            theirs_seen += 1;
        }
    }
    assert!(shell > 5000 && wrong <= shell / 50, "{wrong} of {shell} pixels are not our background");
    assert!(theirs_seen > 300, "what the rival made is seen");
    let out = folder.path().join("out");
    write(&out, &drawn).unwrap();
    assert!(["input.png", "render_flat.png", "rival.json"].iter().all(|f| out.join(f).is_file()));
    assert!(matches!(write(&run_folder, &drawn), Err(RivalError::Run { .. })), "a run of ours is not written over");
}

#[test]
fn a_camera_that_looks_elsewhere_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    run(&run_folder);
    let theirs = folder.path().join("theirs/scene.glb");
    let away = DAffine3::from_mat3(DMat3::from_rotation_y(std::f64::consts::PI));
    whole_glb(&theirs, &DAffine3::IDENTITY, Some(camera_at(&away, SIZE, lens())));
    let scene = read(RivalKind::Generic, theirs.parent().unwrap());
    let options = DrawOptions { run: Some(run_folder), ..DrawOptions::default() };
    let error = draw(&scene, folder.path(), &options).unwrap_err();
    assert!(error.to_string().contains("axes or camera"), "{error}");
    let anyway = draw(&scene, folder.path(), &DrawOptions { anyway: true, ..options.clone() }).unwrap();
    assert_eq!(anyway.report.share_inside, 0.0);
    let without = RivalScene { camera: None, ..scene };
    assert!(matches!(draw(&without, folder.path(), &options), Err(RivalError::NoCamera { .. })));
}

#[test]
fn a_baked_export_has_no_transforms_and_keeps_every_object() {
    use harmony_eval::baked::{BakedOptions, export_baked};
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    run(&run_folder);
    // An object with a pose, of a name that scripts would drop.
    let path = run_folder.join("scene.json");
    let mut scene: Value = harmony_io::read_json(&path).unwrap();
    let object = |id: &str, level: &str| {
        json!({
            "id": id, "index": 10, "level": level, "label": "lamp", "description": "", "source_phrase": "",
            "pose": {"position": [1.0, 0.0, 2.0], "yaw": 0.5, "scale": 2.0, "stretch": [1.0, 1.0, 1.0]},
            "size": {"width": 1.0, "height": 1.0, "depth": 1.0}, "support": {"on": "floor"},
            "relations": {"wall_affinity": "centre", "on_top_of": null, "in_front_of": null, "behind": null,
                "facing_toward": null, "group": null, "matched_set": null},
            "material": {
                "category": "wood", "pbr": {"roughness": 0.5, "metallic": 0.0, "ior": 1.5, "transmission": 0.0},
                "physical": {"weight_kg": 1.0, "thickness_m": 0.01, "elasticity": 0.1},
            },
            "mesh": "", "mask": null, "seen_box": null, "mesh_source": "",
            "confidence": {"overall": 1.0, "detection": null, "silhouette_iou": null, "depth_residual_m": null},
        })
    };
    scene["objects"] = json!([object("floor_lamp_01", "furniture"), object("vase_01", "decoration")]);
    fs::write(&path, scene.to_string()).unwrap();
    let glb = run_folder.join("scene_full.glb");
    let shell = harmony_io::load_glb(&glb, &harmony_io::ReadLimits::default()).unwrap();
    let pose = NodeTransform { translation: DVec3::new(1.0, 0.0, 2.0), yaw: 0.5, scale: DVec3::splat(2.0) };
    let block = Arc::new(boxes(&[([-0.5, 0.0, -0.5], [1.0, 1.0, 1.0])], [0.5; 3]));
    let node =
        |name: &str| GlbNode { name: name.into(), mesh: Arc::clone(&block), transform: pose, extras: Value::Null };
    let shell = shell.nodes.iter().map(|n| GlbNode {
        name: n.name.clone(),
        mesh: Arc::clone(&n.mesh),
        transform: NodeTransform::IDENTITY,
        extras: Value::Null,
    });
    let whole = GlbScene {
        objects: vec![node("floor_lamp_01"), node("vase_01")],
        shell: shell.collect(),
        ..GlbScene::default()
    };
    write_glb(&whole, &glb).unwrap();
    let out = folder.path().join("baked.glb");
    let names = export_baked(&run_folder, &out, BakedOptions { furniture_only: true }).unwrap();
    assert!(
        names.contains(&"object_floor_lamp_01".to_owned()) && !names.iter().any(|n| n.contains("vase")),
        "{names:?}"
    );
    with_json(&out, |v| {
        for n in v["nodes"].as_array().unwrap().iter().filter(|n| n["mesh"].is_u64()) {
            assert!(["translation", "rotation", "scale", "matrix"].iter().all(|k| n.get(k).is_none()), "{n}");
        }
    });
    let back = harmony_io::load_glb(&out, &harmony_io::ReadLimits::default()).unwrap();
    let lamp = back.nodes.iter().find(|n| n.name == "object_floor_lamp_01").unwrap().mesh.bounds().unwrap();
    // A cube of 2 m turned by 0.5 about the vertical.
    let half = 0.5_f64.cos() + 0.5_f64.sin();
    assert!((lamp.min - DVec3::new(1.0 - half, 0.0, 2.0 - half)).length() < 1e-5, "{lamp:?}");
    assert!((lamp.max - DVec3::new(1.0 + half, 2.0, 2.0 + half)).length() < 1e-5, "{lamp:?}");
    assert_eq!(export_baked(&run_folder, &out, BakedOptions::default()).unwrap().len(), names.len() + 1);
    assert!(export_baked(folder.path(), &out, BakedOptions::default()).unwrap_err().hint().is_some());
}
