//! Real photos: the recordings in `examples/recordings` are replayed on the pictures of the test material, and photos

//! without any recording go through this program alone. Skipped, with the reason, where the material is absent.

#![allow(clippy::print_stdout, reason = "tests")]

use std::path::Path;

use crate::common::{harmony, said};
use harmony_scene::{Scene, Support};
use harmony_testing::shared;

fn scene_of(run: &Path) -> Scene {
    serde_json::from_slice(&std::fs::read(run.join("scene.json")).unwrap()).unwrap()
}

/// What must hold in any scene: things stand on the floor, inside the room, and have sane sizes.
fn assert_plausible(scene: &Scene) {
    let e = scene.room.extents;
    assert!((2.0..5.0).contains(&e.height) && e.width > 1.0 && e.depth > 1.0, "{e:?}");
    for o in &scene.objects {
        let p = o.pose.position;
        assert!(p.is_finite(), "{}: {p}", o.id);
        assert!((-0.3..e.width + 0.3).contains(&p.x) && (-0.3..e.depth + 0.3).contains(&p.z), "{} is at {p}", o.id);
        if matches!(o.support, Support::Floor) {
            assert!(p.y.abs() < 0.02, "{} floats: {p}", o.id);
        }
    }
}

/// Replays a recording. `on` lists objects and what they must stand on or hang at.
fn replayed(name: &str, photo: &str, more: &[String], least_objects: usize, least_iou: f64, on: &[(&str, &str)]) {
    let Some(photo) = shared(photo) else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let recording = format!("examples/recordings/{name}");
    let mut args = vec!["reconstruct", photo.to_str().unwrap(), "--out", run.to_str().unwrap()];
    args.extend(["--replay", &recording, "--no-lit"]);
    args.extend(more.iter().map(String::as_str));
    let output = harmony(&args);
    assert!(output.status.success(), "{}", said(&output));
    let scene = scene_of(&run);
    assert_plausible(&scene);
    assert!(scene.objects.len() >= least_objects, "{} objects", scene.objects.len());
    let mut agreement: Vec<f64> = scene.objects.iter().filter_map(|o| o.confidence.silhouette_iou).collect();
    agreement.sort_by(f64::total_cmp);
    let median = agreement[agreement.len() / 2];
    println!("{name}: {} objects, median silhouette IoU {median:.2}", scene.objects.len());
    assert!(median >= least_iou, "median silhouette IoU {median:.2}");
    for (id, host) in on {
        let object = scene.objects.iter().find(|o| o.id.as_str() == *id).unwrap_or_else(|| panic!("no {id}"));
        let found = match &object.support {
            Support::Floor => "floor".to_owned(),
            Support::Ceiling => "ceiling".to_owned(),
            Support::Wall { wall } => format!("{wall:?}").to_lowercase(),
            Support::Object { id } => id.to_string(),
            Support::Block { block } => harmony_scene::Ledge::Block(*block).id().to_string(),
            Support::Niche { niche } => harmony_scene::Ledge::Niche(*niche).id().to_string(),
        };
        assert_eq!(found, *host, "{id}");
    }
}

#[test]
fn a_living_room() {
    let on = [("painting_01", "back"), ("sofa_01", "floor"), ("pillow_02", "sofa_01"), ("tray_01", "coffee_table_01")];
    // A throw and a pillow are in the sofa's program.
    replayed("living_room_01", "photos/living_room_01.jpg", &[], 12, 0.65, &on);
}

#[test]
fn a_room_of_leather_and_signs() {
    // Not the throw over the armchair's back: millimetres of other things decide whether it finds its place there.
    let on = [
        ("sofa_01", "floor"),
        ("framed_sign_01", "left"),
        ("horse_pillow_01", "armchair_01"),
        ("ceiling_fan_01", "ceiling"),
    ];
    replayed("living_room_02", "photos/living_room_02.jpg", &[], 35, 0.7, &on);
}

#[test]
fn a_bedroom() {
    let on = [("bed_01", "floor"), ("pillow_01", "bed_01"), ("painting_01", "right"), ("window_02", "back")];
    replayed("bedroom_01", "photos/bedroom_01.jpg", &[], 19, 0.65, &on);
}

#[test]
fn a_dining_room_with_sensor_depth() {
    let Some(depth) = shared("rgbd/home_dining_1_depth.pgm") else { return };
    let more = ["--points", depth.to_str().unwrap(), "--intrinsics", "518.0,519.0,325.5,253.5"].map(str::to_owned);
    let on = [("dining_table_01", "floor"), ("candle_01", "dining_table_01"), ("ceiling_fan_01", "ceiling")];
    replayed("home_dining_1", "rgbd/home_dining_1_rgb.png", &more, 25, 0.6, &on);
}

#[test]
fn an_older_bedroom_and_living_room() {
    // The answers have the cushions in the bed's program: bed, picture, wall pier.
    replayed("bedroom_07", "photos/bedroom_07.png", &[], 3, 0.6, &[("bed_01", "floor")]);
    replayed("living_room_04", "photos/living_room_04.jpg", &[], 13, 0.55, &[("sofa_01", "floor")]);
}

#[test]
fn photos_without_any_answer_give_a_valid_scene_and_a_frank_report() {
    for photo in ["bathroom_02.png", "hallway_console_01.png", "living_room_06.jpg", "library_room_01.jpg"] {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        let Some(photo) = shared(&format!("photos/{photo}")) else { return };
        let output = harmony(&[
            "reconstruct",
            photo.to_str().unwrap(),
            "--out",
            run.to_str().unwrap(),
            "--offline-only",
            "--no-lit",
        ]);
        assert!(output.status.success(), "{}: {}", photo.display(), said(&output));
        let scene = scene_of(&run);
        assert_plausible(&scene);
        assert!(!scene.warnings.is_empty(), "{}: nothing is said about what is missing", photo.display());
        for file in ["scene_full.glb", "render_flat.png", "render_canonical.png", "report.html", "camera.json"] {
            assert!(run.join(file).is_file(), "{}: {file} is missing", photo.display());
        }
    }
}
