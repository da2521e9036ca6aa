//! The program as a person runs it: the bundled example replayed, run again, and inputs that are no good.

use std::path::Path;

use crate::common::{files, harmony, said};

#[test]
fn the_bundled_example_replays_and_a_second_run_changes_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let args = [
        "reconstruct",
        "examples/home_office.jpg",
        "--out",
        run.to_str().unwrap(),
        "--replay",
        "examples/home_office_recording",
        "--no-lit",
    ];
    let first = harmony(&args);
    assert!(first.status.success(), "{}", said(&first));
    for file in [
        "scene.json",
        "scene_full.glb",
        "render_flat.png",
        "render_canonical.png",
        "segmentation.png",
        "segmentation.json",
        "objects.json",
        "camera.json",
        "report.html",
        "run.json",
    ] {
        assert!(run.join(file).is_file(), "{file} is missing");
    }
    let scene: serde_json::Value = serde_json::from_slice(&std::fs::read(run.join("scene.json")).unwrap()).unwrap();
    // What is asked of the photo alone is what the recording answered; if not, see `examples/README.md`.
    let warnings = scene["warnings"].as_array().unwrap();
    let about_layout: Vec<_> = warnings.iter().filter(|w| w["phase"] == "1_layout").collect();
    assert!(about_layout.is_empty(), "{about_layout:?}");
    let objects = scene["objects"].as_array().unwrap();
    assert!(objects.len() >= 15, "{} objects", objects.len());
    let desk = objects.iter().find(|o| o["id"] == "desk_01").unwrap();
    assert_eq!(desk["support"]["on"], "floor");
    let monitor = objects.iter().find(|o| o["id"] == "monitor_01").unwrap();
    assert_eq!(monitor["support"]["id"], "desk_01");

    let before = files(&run);
    let second = harmony(&args);
    assert!(second.status.success());
    assert!(String::from_utf8_lossy(&second.stdout).contains("finished already"));
    assert!(files(&run) == before, "the second run changed the run folder");
    the_scene_is_path_traced_from_above(&run);
    a_program_is_tried_before_there_is_a_scene(&run);
}

fn the_scene_is_path_traced_from_above(run: &Path) {
    let render = |more: &[&str], out: &Path| {
        let given = ["render", run.to_str().unwrap(), "--size", "160", "--out", out.to_str().unwrap()];
        harmony(&[&given, more].concat())
    };
    let (flat, lit) = (run.with_file_name("flat.png"), run.with_file_name("lit.png"));
    assert!(render(&[], &flat).status.success());
    let traced = render(&["--lit", "--samples", "16"], &lit);
    if said(&traced).contains("--lit needs Blender") {
        harmony_testing::skip("render --lit: no Blender here");
        return;
    }
    assert!(traced.status.success(), "{}", said(&traced));
    let [flat, lit] = [&flat, &lit].map(|path| image::open(path).unwrap().to_rgb8());
    assert_eq!(flat.dimensions(), lit.dimensions());
    // Nothing is outside; inside it is the same room in another light.
    let off = (0..3).map(|c| flat.get_pixel(6, 6)[c].abs_diff(lit.get_pixel(6, 6)[c])).max();
    assert!(off <= Some(3), "{off:?}");
    let centre = |picture: &image::RgbImage| *picture.get_pixel(80, 70);
    assert!(centre(&flat) != centre(&lit) && centre(&lit).0.iter().any(|v| *v > 20), "{:?}", centre(&lit));
}

fn a_program_is_tried_before_there_is_a_scene(run: &Path) {
    std::fs::remove_file(run.join("scene.json")).unwrap();
    let program = run.join("tried.py");
    std::fs::write(&program, "def build(w, h, d):\n    return group(\"crate\", body = box((w, h, d)))\n").unwrap();
    let model = |more: &[&str]| {
        let given = ["model", run.to_str().unwrap(), "crate_01", "--program", program.to_str().unwrap()];
        harmony(&[&given, more].concat())
    };
    let tried = model(&["--size", "1.2,0.5,0.6"]);
    assert!(tried.status.success(), "{}", said(&tried));
    let shown = String::from_utf8_lossy(&tried.stdout).into_owned();
    assert!(shown.contains("1.200 x 0.500 x 0.600 m"), "{shown}");
    let refused = model(&[]);
    assert!(!refused.status.success() && said(&refused).contains("--size W,H,D"), "{}", said(&refused));
    assert!(said(&model(&["--size", "1.2,0,0.6"])).contains("width, height and depth in metres"));
}

#[test]
fn what_is_not_a_photo_is_refused_with_exit_code_1_and_nothing_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    for (name, bytes) in [("text.jpg", &b"hello"[..]), ("empty.png", &b""[..]), ("cut.png", &b"\x89PNG\r\n\x1a\n"[..])]
    {
        let photo = folder.path().join(name);
        std::fs::write(&photo, bytes).unwrap();
        let output = harmony(&["reconstruct", photo.to_str().unwrap(), "--out", run.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(1), "{name}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("error:"), "{name}");
        assert!(!run.join("run.json").exists(), "{name}");
    }
    let absent = harmony(&["reconstruct", "no/such/photo.jpg", "--out", run.to_str().unwrap()]);
    assert_eq!(absent.status.code(), Some(1));
}
