//! Our figures of other views agree with those of the independent judge, a script for Blender's module.
//!
//! It needs `tools/novel_views/novel.py` of the shared test material (`HARMONY_SHARED`) and a python that can import

//! bpy (`HARMONY_BPY_PYTHON`, or the one in HARMONY's cache); without them it says so and passes.

use std::path::{Path, PathBuf};
use std::process::Command;

use harmony_bench::generate::{GeneratorSettings, generate, write};
use harmony_bench::metrics::similarity::Looking;
use harmony_bench::score::Prediction;
use harmony_bench::truth::TruthRoom;
use harmony_bench::views::{RegionScore, judge};
use harmony_io::{GlbNode, GlbScene, NodeTransform, write_glb};
use harmony_mesh::{ShellOptions, room_shell_with};
use harmony_scene::{ImageSize, Lighting, Room, SCENE_VERSION, Scene, SceneCamera, Surface};
use image::{Rgba, RgbaImage};
use std::sync::Arc;

/// A python that can import bpy, numpy and pillow.
fn python() -> Option<PathBuf> {
    let cache = std::env::var_os("HOME").map(|h| Path::new(&h).join(".cache/harmony/bpy/bin/python"));
    let named = std::env::var_os("HARMONY_BPY_PYTHON").map(PathBuf::from);
    named.into_iter().chain(cache).find(|p| {
        let tried = Command::new(p).args(["-c", "import bpy, numpy, PIL"]).output();
        tried.is_ok_and(|o| o.status.success())
    })
}

/// A run of a generated room: its true objects in an empty box with patterned faces.
fn run_of(truth: &TruthRoom, made: &harmony_bench::generate::GeneratedRoom, folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    let room = Room {
        room_type: "room".to_owned(),
        extents: truth.extents,
        shape: harmony_scene::RoomShape::default(),
        seen: Vec::new(),
        openings: Vec::new(),
        floor_texture: None,
        wall_texture: None,
    };
    let texture = |surface: Surface| {
        let k = surface.name().len() as u8 * 17;
        Some(Arc::new(RgbaImage::from_fn(256, 256, |x, y| {
            let check = ((x / 32 + y / 32) % 2) as u8 * 60;
            Rgba([60 + k + check, 120, 200 - check, 255])
        })))
    };
    let mut shell = room_shell_with(&room, &texture, &ShellOptions::default());
    shell.recompute_normals();
    let node = |name: &str, mesh, transform| GlbNode {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        transform,
        extras: serde_json::Value::Null,
    };
    let objects = made.objects.iter().map(|o| {
        let transform = NodeTransform { translation: o.position, yaw: o.yaw, scale: glam::DVec3::ONE };
        node(&o.id, (*o.mesh).clone(), transform)
    });
    let glb = GlbScene {
        objects: objects.collect(),
        shell: vec![node("shell", shell, NodeTransform::IDENTITY)],
        generator: "test".to_owned(),
        ..GlbScene::default()
    };
    write_glb(&glb, &folder.join("scene_full.glb")).unwrap();
    let lighting = Lighting {
        lights: Vec::new(),
        ambient_color: [1.0; 3],
        ambient_intensity: 1.0,
        exposure: 0.0,
        view: harmony_scene::ViewTransform::Agx,
    };
    let scene = Scene {
        version: SCENE_VERSION,
        generator: "test".to_owned(),
        room,
        camera: SceneCamera::from(&truth.camera),
        objects: Vec::new(),
        lighting,
        summary: String::new(),
        warnings: Vec::new(),
    };
    harmony_io::write_json(&folder.join("scene.json"), &scene).unwrap();
}

/// `VIEW 1 PL 0.0365 PL_gain 0.0361 SSIM 0.575 | seen 0.59 PL ...`: the numbers in order.
fn numbers(line: &str) -> Vec<f64> {
    line.split_whitespace().skip(2).filter_map(|w| w.parse().ok()).collect()
}

#[test]
fn figures_of_views_are_those_of_the_independent_judge() {
    let Some(script) = harmony_testing::shared("tools/novel_views/novel.py") else { return };
    let Some(python) = python() else {
        return harmony_testing::skip("no python with bpy, numpy and pillow (HARMONY_BPY_PYTHON names one)");
    };
    let folder = tempfile::tempdir().unwrap();
    let settings = GeneratorSettings {
        image: Some(ImageSize::new(480, 360)),
        points: 100,
        shell_points: 100,
        ..GeneratorSettings::default()
    };
    let made = generate(7, &settings);
    let room = folder.path().join("room");
    write(&made, &room).unwrap();
    let truth = TruthRoom::load(&room).unwrap();
    let run = folder.path().join("run");
    run_of(&truth, &made, &run);
    let prediction = Prediction::load(&run).unwrap();
    let ours = judge(&truth, &prediction, &[], 0.0, &Looking::default()).unwrap();
    let out = Command::new(python)
        .arg(script)
        .args([&run, &room.join("views"), &folder.path().join("out")])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&out.stdout);
    let theirs: Vec<Vec<f64>> = text.lines().filter(|l| l.starts_with("VIEW ")).map(numbers).collect();
    assert_eq!(theirs.len(), ours.len(), "{text}\n{}", String::from_utf8_lossy(&out.stderr));
    for (view, theirs) in ours.iter().zip(&theirs) {
        let p = &view.score.flat;
        let (seen, unseen) = (p.seen.unwrap(), p.unseen.unwrap());
        let ssim = |r: RegionScore| r.ssim.unwrap();
        let ours = [p.all.pl, p.pl_gain, ssim(p.all), seen.share, seen.pl, ssim(seen), unseen.pl, ssim(unseen)];
        // It filters pixels over 1.5 of their width with 8 random samples, we take 4 fixed ones; it prints 2 to 4
        // digits.
        let tolerances = [0.001, 0.001, 0.012, 0.0051, 0.001, 0.012, 0.001, 0.012];
        assert_eq!(theirs.len(), ours.len());
        for ((a, b), t) in ours.iter().zip(theirs).zip(tolerances) {
            assert!((a - b).abs() <= t + 0.01 * b.abs(), "view {}: {ours:?} against {theirs:?}", view.score.view);
        }
    }
}
