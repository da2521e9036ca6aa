//! Truth of 3D-FRONT and of the list FRONT3D, made here by the facts of their formats, and runs that are as good as known.

use std::fs;
use std::path::Path;

use glam::{DMat3, DVec3};
use harmony_bench::metrics::soup::Triangle;
use harmony_bench::protocols::{
    Protocol, ProtocolOptions, RunPiece, RunSurfaces, TruthSurfaces, csv, objects_csv, pair_runs, pieces, score_run,
    text, truths_in,
};
use harmony_scene::{Camera, ImageSize, Intrinsics};
use serde_json::json;

/// A chair of two boxes, from x = -0.2 to 0.3: no plane mirrors it onto itself but the floor's.
const CHAIR: [([f64; 3], [f64; 3]); 2] =
    [([-0.2, 0.0, -0.25], [0.3, 0.45, 0.25]), ([0.2, 0.45, -0.25], [0.3, 0.9, 0.05])];
const TABLE: [([f64; 3], [f64; 3]); 2] =
    [([-0.8, 0.7, -0.4], [0.8, 0.75, 0.4]), ([-0.8, 0.0, -0.4], [-0.7, 0.7, -0.3])];

fn corners((min, max): ([f64; 3], [f64; 3])) -> [DVec3; 8] {
    std::array::from_fn(|i| DVec3::from_array([0, 1, 2].map(|k| if i >> k & 1 == 1 { max[k] } else { min[k] })))
}

const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

fn soup(boxes: &[([f64; 3], [f64; 3])], place: impl Fn(DVec3) -> DVec3) -> Vec<Triangle> {
    let mut out = Vec::new();
    for b in boxes {
        let c = corners(*b).map(&place);
        out.extend(FACES.iter().flat_map(|f| [[c[f[0]], c[f[1]], c[f[2]]], [c[f[0]], c[f[2]], c[f[3]]]]));
    }
    out
}

fn obj(boxes: &[([f64; 3], [f64; 3])]) -> String {
    let mut text = "mtllib model.mtl\nusemtl wood\n".to_owned();
    for b in boxes {
        for c in corners(*b) {
            text += &format!("v {} {} {}\n", c.x, c.y, c.z);
        }
    }
    for i in 0..boxes.len() {
        for f in FACES {
            text += &format!("f {} {} {} {}\n", f[0] + 1 + 8 * i, f[1] + 1 + 8 * i, f[2] + 1 + 8 * i, f[3] + 1 + 8 * i);
        }
    }
    text
}

fn camera() -> Camera {
    let size = ImageSize::new(640, 480);
    let lens = Intrinsics::from_horizontal_fov(size, 1.1);
    Camera::looking(size, lens, DVec3::new(0.5, 1.5, 5.0), DVec3::new(0.1, -0.25, -1.0))
}

/// Where the pieces stand in the house: name, model, place, yaw, scale.
fn pieces_of_the_house() -> Vec<(&'static str, &'static [([f64; 3], [f64; 3])], DVec3, f64, DVec3)> {
    vec![
        ("chair-1", &CHAIR[..], DVec3::new(-0.8, 0.0, 1.0), 0.7, DVec3::ONE),
        ("chair-2", &CHAIR[..], DVec3::new(1.4, 0.0, 0.4), -1.2, DVec3::new(1.1, 1.0, 0.9)),
        ("table-1", &TABLE[..], DVec3::new(0.3, 0.0, -0.6), 0.3, DVec3::ONE),
    ]
}

fn house(folder: &Path, mirror: &str) {
    fs::create_dir_all(folder).unwrap();
    for (jid, boxes, category) in [("aaaa-1", &CHAIR, "Chair"), ("bbbb-2", &TABLE, "Table")] {
        let model = folder.join("future").join(jid);
        fs::create_dir_all(&model).unwrap();
        fs::write(model.join("raw_model.obj"), obj(boxes)).unwrap();
        fs::write(model.join("model_info.json"), json!({"model_id": jid, "super-category": category}).to_string())
            .unwrap();
    }
    let jid = |boxes: &[([f64; 3], [f64; 3])]| if boxes == CHAIR { "aaaa-1" } else { "bbbb-2" };
    let mut children: Vec<_> = pieces_of_the_house()
        .into_iter()
        .map(|(name, boxes, pos, yaw, scale)| {
            let (s, c) = (yaw / 2.0).sin_cos();
            json!({"ref": format!("f/{}", jid(boxes)), "instanceid": name, "pos": pos.to_array(), "rot": [0.0, s, 0.0, c], "scale": scale.to_array()})
        })
        .collect();
    let at = json!([0.0, 0.0, 0.0]);
    children.push(
        json!({"ref": "f/aaaa-1", "instanceid": "broken", "pos": at, "rot": [0, 0, 0, 1], "scale": [0.0, 1.0, 1.0]}),
    );
    children
        .push(json!({"ref": "f/cccc-3", "instanceid": "absent", "pos": at, "rot": [0, 0, 0, 1], "scale": [1, 1, 1]}));
    children
        .push(json!({"ref": "f/invalid", "instanceid": "invalid", "pos": at, "rot": [0, 0, 0, 1], "scale": [1, 1, 1]}));
    let furniture = json!([
        {"uid": "f/aaaa-1", "jid": "aaaa-1", "valid": true}, {"uid": "f/bbbb-2", "jid": "bbbb-2", "valid": true},
        {"uid": "f/cccc-3", "jid": "cccc-3", "valid": true}, {"uid": "f/invalid", "jid": "aaaa-1", "valid": false},
    ]);
    let rooms = json!([
        {"type": "Bedroom", "instanceid": "Bedroom-1", "children": []},
        {"type": "LivingRoom", "instanceid": "LivingRoom-7", "children": children},
    ]);
    fs::write(
        folder.join("house.json"),
        json!({"uid": "x", "furniture": furniture, "scene": {"room": rooms}}).to_string(),
    )
    .unwrap();
    let (k, r, t) = (camera().intrinsics, camera().rotation.transpose(), camera().translation);
    let about = json!({
        "house": "house.json", "future": "future", "room": "LivingRoom", "mirror": mirror,
        "camera": {"width": 640, "height": 480, "K": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
            "R": [r.x_axis.to_array(), r.y_axis.to_array(), r.z_axis.to_array()], "t": t.to_array()},
    });
    fs::write(folder.join("front3d.json"), about.to_string()).unwrap();
}

/// Farthest that a corner of one surface is from the nearest corner of the other, and how far their areas are apart:
/// readers cut quadrilaterals along either diagonal.
fn same(found: &[Triangle], wanted: &[Triangle]) -> f64 {
    assert_eq!(found.len(), wanted.len());
    let nearest = |p: &DVec3, all: &[Triangle]| all.iter().flatten().map(|q| p.distance(*q)).fold(f64::MAX, f64::min);
    let off = |a: &[Triangle], b: &[Triangle]| a.iter().flatten().map(|p| nearest(p, b)).fold(0.0, f64::max);
    let area = |all: &[Triangle]| all.iter().map(harmony_bench::metrics::soup::area).sum::<f64>();
    off(found, wanted).max(off(wanted, found)).max((area(found) - area(wanted)).abs())
}

#[test]
fn a_house_of_3d_front_is_read_with_its_models() {
    let folder = tempfile::tempdir().unwrap();
    house(&folder.path().join("living"), "none");
    let truths = truths_in(folder.path()).unwrap();
    assert_eq!((truths.len(), truths[0].name.as_str(), truths[0].pieces.len()), (1, "living", 3));
    for (piece, (name, boxes, pos, yaw, scale)) in truths[0].pieces.iter().zip(pieces_of_the_house()) {
        let wanted = soup(boxes, |p| camera().to_camera(DMat3::from_rotation_y(yaw) * (p * scale) + pos));
        assert_eq!(piece.id, name);
        // Models are read as f32.
        assert!(same(&piece.triangles, &wanted) < 1e-5, "{name}");
    }
    let notes = truths[0].notes.join("; ");
    assert!(notes.contains("broken") && notes.contains("absent") && !notes.contains("invalid"), "{notes}");
}

#[test]
fn the_mirrored_house_keeps_the_handedness_of_its_pieces() {
    let folder = tempfile::tempdir().unwrap();
    house(folder.path(), "blenderproc");
    let truth = &truths_in(folder.path()).unwrap()[0];
    for (piece, (name, boxes, pos, yaw, scale)) in truth.pieces.iter().zip(pieces_of_the_house()) {
        // M R(yaw) N with M, N the mirrors of z and of x is a turn by 180 degrees minus yaw.
        let turn = DMat3::from_rotation_y(std::f64::consts::PI - yaw);
        let wanted = soup(boxes, |p| camera().to_camera(turn * (p * scale) + DVec3::new(pos.x, pos.y, -pos.z)));
        assert!(same(&piece.triangles, &wanted) < 1e-5, "{name}");
    }
}

#[test]
fn what_cannot_be_read_of_3d_front_is_named() {
    let folder = tempfile::tempdir().unwrap();
    house(folder.path(), "none");
    let file = folder.path().join("front3d.json");
    let good = fs::read_to_string(&file).unwrap();
    let error = |from: &str, to: &str| {
        fs::write(&file, good.replacen(from, to, 1)).unwrap();
        let error = truths_in(folder.path()).unwrap_err();
        assert!(error.hint().is_some());
        error.to_string()
    };
    assert!(error("\"LivingRoom\"", "\"Kitchen\"").contains("LivingRoom-7"));
    assert!(error("\"LivingRoom\"", "\"Bedroom\"").contains("0 usable pieces"));
    assert!(error("\"none\"", "\"upside_down\"").contains("mirror"));
    assert!(error("house.json", "nowhere.json").contains("nowhere.json"));
    assert!(error("\"K\"", "\"k\"").contains("camera"));
    fs::write(folder.path().join("house.json"), "{}").unwrap();
    fs::write(&file, &good).unwrap();
    assert!(truths_in(folder.path()).unwrap_err().to_string().contains("no house of 3D-FRONT"));
}

/// The list FRONT3D: one PLY a scene, in the camera's frame.
fn list(folder: &Path, id: &str) -> Vec<Triangle> {
    let mut all = Vec::new();
    for (_, boxes, pos, yaw, scale) in pieces_of_the_house() {
        all.extend(soup(boxes, |p| camera().to_camera(DMat3::from_rotation_y(yaw) * (p * scale) + pos)));
    }
    let place = |name: &str| {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    };
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty \
         list uchar int vertex_indices\nend_header\n",
        all.len() * 3,
        all.len()
    );
    all.iter().flatten().for_each(|p| ply += &format!("{} {} {}\n", p.x, p.y, p.z));
    (0..all.len()).for_each(|i| ply += &format!("3 {} {} {}\n", 3 * i, 3 * i + 1, 3 * i + 2));
    fs::write(place(&format!("sceneobjgt/sceneobjgt_{id}.ply")), ply).unwrap();
    let k = camera().intrinsics;
    let about =
        json!({"camera_intrinsics": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]], "camera_extrinsics": []});
    fs::write(place(&format!("annotation/annotation_00{id}.json")), about.to_string()).unwrap();
    image::RgbImage::new(640, 480).save(place(&format!("rgb/rgb_00{id}.png"))).unwrap();
    all
}

fn perfect() -> RunSurfaces {
    let pieces = pieces_of_the_house().into_iter().map(|(name, boxes, pos, yaw, scale)| RunPiece {
        id: name.replace('-', "_"),
        furniture: true,
        triangles: soup(boxes, |p| DMat3::from_rotation_y(yaw) * (p * scale) + pos),
    });
    RunSurfaces { camera: camera(), pieces: pieces.collect() }
}

fn options() -> ProtocolOptions {
    ProtocolOptions { protocols: Protocol::ALL.to_vec(), points: 4000, seed: 5 }
}

#[test]
fn a_perfect_run_reaches_the_floor_of_every_protocol() {
    let folder = tempfile::tempdir().unwrap();
    list(folder.path(), "0017");
    house(&folder.path().join("front/living"), "none");
    let from_list = truths_in(folder.path()).unwrap();
    assert_eq!((from_list[0].name.as_str(), from_list[0].camera.size), ("rgb_0017", ImageSize::new(640, 480)));
    let from_house = truths_in(&folder.path().join("front")).unwrap();
    for truth in [&from_list[0], &from_house[0]] {
        let scores = score_run(truth, &perfect(), Path::new("run"), &options());
        assert_eq!(scores.len(), 4);
        for s in &scores {
            assert_eq!(s.failure, None, "{:?}", s.protocol);
            let (score, floor) = (s.score.as_ref().unwrap(), s.floor.as_ref().unwrap());
            match s.protocol {
                Protocol::Gen3dsr => {
                    assert!((score.chamfer / floor.chamfer - 1.0).abs() < 0.15, "{score:?} {floor:?}");
                    assert!(score.at[0].f1 > 99.0 && s.floor_in_run_frame.is_none());
                }
                // Points are drawn by the object; where the truth is one mesh, they lie otherwise.
                Protocol::Midi => {
                    assert!(score.chamfer < 2.0 * floor.chamfer && score.at[0].f1 > 99.0, "{score:?} {floor:?}");
                }
                Protocol::Harmony | Protocol::HarmonyIso => {
                    // The run is in its room's frame: what it gets is the floor there.
                    let own = s.floor_in_run_frame.as_ref().unwrap();
                    assert!((score.chamfer / own.chamfer - 1.0).abs() < 0.15, "{:?} {score:?} {own:?}", s.protocol);
                }
            }
        }
        let table = text(&scores, &pieces(truth, &perfect(), 1));
        assert!(table.contains("harmony-iso") && table.contains("truth in the run's frame"), "{table}");
        let lines = csv(&scores);
        assert!(
            lines.lines().all(|l| l.split(',').count() == lines.lines().next().unwrap().split(',').count()),
            "{lines}"
        );
        assert_eq!(scores, score_run(truth, &perfect(), Path::new("run"), &options()), "same seed, same numbers");
    }
    assert!(pieces(&from_list[0], &perfect(), 1).is_empty(), "its objects are one mesh");
    let objects = pieces(&from_house[0], &perfect(), 1);
    assert_eq!(objects.len(), 3);
    for o in &objects {
        assert_eq!(o.found.as_deref(), Some(o.id.replace('-', "_").as_str()));
        assert!(o.within_tenth() && o.iou > 0.9 && o.rotation_deg.unwrap() < 3.0, "{o:?}");
    }
    assert_eq!(objects_csv(&objects).lines().count(), 4);
}

#[test]
fn metres_count_where_they_should_and_only_there() {
    let folder = tempfile::tempdir().unwrap();
    house(folder.path(), "none");
    let truth = &truths_in(folder.path()).unwrap()[0];
    // A run that is too large by a tenth about its camera: the photo looks the same.
    let mut large = perfect();
    let centre = large.camera.centre();
    for p in &mut large.pieces {
        p.triangles = p.triangles.iter().map(|t| t.map(|q| centre + (q - centre) * 1.1)).collect();
    }
    let score = |run: &RunSurfaces| -> Vec<f64> {
        score_run(truth, run, Path::new("run"), &options()).iter().map(|s| s.score.as_ref().unwrap().chamfer).collect()
    };
    let (good, bad) = (score(&perfect()), score(&large));
    assert!(bad[0] > 3.0 * good[0] && bad[0] > 0.1, "gen3dsr is in metres: {good:?} {bad:?}");
    assert!((bad[1] / good[1] - 1.0).abs() < 0.1, "harmony does not see scale: {good:?} {bad:?}");
    assert!((bad[2] / good[2] - 1.0).abs() < 0.1, "nor does harmony-iso: {good:?} {bad:?}");
    // A run without furniture fails where only furniture counts, and is not left out in silence.
    let mut bare = perfect();
    bare.pieces.iter_mut().for_each(|p| p.furniture = false);
    let scores = score_run(truth, &bare, Path::new("run"), &options());
    let failed: Vec<bool> = scores.iter().map(|s| s.failure.is_some()).collect();
    assert_eq!(failed, [false, true, true, false]);
    assert!(text(&scores, &[]).lines().any(|l| l.starts_with("harmony ") && l.contains(" 1 ")));
}

#[test]
fn runs_find_their_truth_by_name_number_and_photo() {
    let folder = tempfile::tempdir().unwrap();
    for id in ["0017", "0018"] {
        list(&folder.path().join("list"), id);
    }
    let photo = folder.path().join("list/rgb/rgb_000018.png");
    fs::copy(folder.path().join("list/rgb/rgb_000018.png"), folder.path().join("photo.png")).unwrap();
    image::RgbImage::from_pixel(640, 480, image::Rgb([7; 3])).save(&photo).unwrap();
    let truths: Vec<TruthSurfaces> = truths_in(&folder.path().join("list")).unwrap();
    assert_eq!(truths.len(), 2);
    let runs = folder.path().join("runs");
    for name in ["rgb_000017", "somewhere", "elsewhere"] {
        fs::create_dir_all(runs.join(name)).unwrap();
        fs::write(runs.join(name).join("scene.json"), "{}").unwrap();
    }
    fs::copy(&photo, runs.join("somewhere/input.png")).unwrap();
    let found: Vec<(String, Option<usize>)> = pair_runs(&runs, &truths)
        .into_iter()
        .map(|(p, t)| (p.file_name().unwrap().to_string_lossy().into_owned(), t))
        .collect();
    let wanted = [("elsewhere", None), ("rgb_000017", Some(0)), ("somewhere", Some(1))];
    assert_eq!(found, wanted.map(|(n, t)| (n.to_owned(), t)));
    fs::write(folder.path().join("list/scene_ids.txt"), "17\n99\n").unwrap();
    assert!(truths_in(&folder.path().join("list")).unwrap_err().to_string().contains("99"));
}
