//! Readers of other programs: usd-core, MuJoCo, ezdxf, the Khronos validator, Blender.

use std::process::Command;

use harmony_export::animation::Animation;
use harmony_export::{Budget, Format, GlbOptions, Options, World, check, export};
use harmony_physics::quake::Trajectory;
use harmony_physics::{Motion, Quake, Shaken};
use harmony_testing::skip;

use crate::support::{cache, checkers, judged, options, run};

#[test]
fn usd_passes_all_validators_and_its_physics_is_the_scenes() {
    let Some(python) = checkers() else { return };
    let run = run();
    let world = World::read(run.path()).unwrap();
    export(&world, &[Format::Usd, Format::Usdz], &run.path().join("export"), &options()).unwrap();
    let said = judged(&python, "usd", run.path());
    assert!(said.contains("0 issues") && said.contains("scene.usdz"), "{said}");
}

/// Everything that is dynamic slides, rises and turns over two frames, and the ground goes the other way.
#[test]
fn the_time_samples_of_an_earthquake_are_its_trajectories() {
    let Some(python) = checkers() else { return };
    let run = run();
    let world = World::read(run.path()).unwrap();
    let folder = run.path().join("export");
    export(&world, &[Format::Usd], &folder, &options()).unwrap();
    let frames = 3;
    let object = |item: &harmony_export::world::Item| {
        let moves = harmony_physics::matter::motion(&item.object) == Motion::Dynamic;
        let at = item.object.pose.position;
        let turn = |k: usize| {
            let leant = glam::DQuat::from_axis_angle(glam::DVec3::new(0.6, 0.0, 0.8), 0.2 * k as f64);
            (leant * glam::DQuat::from_rotation_y(item.object.pose.yaw)).to_array()
        };
        let place = |k: usize| (at + glam::DVec3::new(0.1, 0.05, -0.2) * k as f64).to_array();
        Trajectory {
            id: item.name().to_owned(),
            motion: if moves { Motion::Dynamic } else { Motion::Static },
            mass_kg: 1.0,
            friction: 0.4,
            farthest_m: 0.0,
            moved_m: 0.0,
            tilt_deg: 0.0,
            toppled: false,
            fallen: false,
            positions: if moves { (0..frames).map(place).collect() } else { vec![] },
            rotations: if moves { (0..frames).map(turn).collect() } else { vec![] },
        }
    };
    let shaken = Shaken {
        quake: Quake { intensity: 7.0, seconds: 1.0, seed: 0 },
        peak_acceleration: 2.4,
        frames_per_second: 30,
        ground: (0..frames).map(|k| [0.02 * k as f64, 0.0, -0.03 * k as f64]).collect(),
        objects: world.items.iter().map(object).collect(),
    };
    let moving = shaken.objects.iter().filter(|o| !o.positions.is_empty()).count();
    assert!(moving > 0, "the fixture has something that moves");
    let layer = Animation::of_earthquake(&world, &shaken).layer(&world);
    std::fs::write(folder.join("usd/earthquake.usda"), layer).unwrap();
    std::fs::write(folder.join("earthquake.json"), serde_json::to_vec(&shaken).unwrap()).unwrap();
    let told = |name: &str| {
        Command::new(&python)
            .arg(harmony_testing::root().join("tools/usd_motion.py"))
            .args([folder.join("usd/earthquake.usda"), folder.join(name)])
            .output()
            .unwrap()
    };
    let found = told("earthquake.json");
    let said = format!("{}{}", String::from_utf8_lossy(&found.stdout), String::from_utf8_lossy(&found.stderr));
    assert!(found.status.success(), "{said}");
    assert!(said.contains("\"frames\": 3") && said.contains("\"frames_per_second\": 30.0"), "{said}");
    // Another way than the layer's is noticed.
    let mut other = shaken;
    other.ground[2][0] += 0.001;
    std::fs::write(folder.join("other.json"), serde_json::to_vec(&other).unwrap()).unwrap();
    assert!(!told("other.json").status.success());
}

#[test]
fn mujoco_loads_all_files_without_a_warning() {
    let Some(python) = checkers() else { return };
    let run = run();
    let world = World::read(run.path()).unwrap();
    export(&world, &[Format::Mjcf, Format::Urdf], &run.path().join("export"), &options()).unwrap();
    let said = judged(&python, "mujoco", run.path());
    assert!(said.contains("0 warnings"), "{said}");
}

#[test]
fn a_cad_library_opens_the_drawings() {
    let Some(python) = checkers() else { return };
    let run = run();
    let world = World::read(run.path()).unwrap();
    export(&world, &[Format::Plan], &run.path().join("export"), &options()).unwrap();
    let said = judged(&python, "dxf", run.path());
    assert!(said.contains("0 errors"), "{said}");
}

#[test]
fn the_khronos_validator_has_nothing_against_any_glb() {
    let tools = harmony_testing::root().join("tools");
    if !tools.join("node_modules/gltf-validator").is_dir() {
        return skip("no gltf-validator in tools/node_modules (tools/setup.sh node)");
    }
    let run = run();
    let world = World::read(run.path()).unwrap();
    export(&world, &[Format::Glb], &run.path().join("plain"), &options()).unwrap();
    let glb = GlbOptions { lods: true, webp: true, meshopt: true };
    let budget = Budget { faces: Some(20_000), texture: Some(64) };
    export(&world, &[Format::Glb], &run.path().join("packed"), &Options { glb, budget, ..options() }).unwrap();
    let files = ["plain/glb/scene.glb", "plain/glb/shell.glb", "plain/glb/level_furniture.glb", "packed/glb/scene.glb"];
    let mut command = Command::new("node");
    command.arg(tools.join("validate_glb.mjs")).args(files.map(|f| run.path().join(f)));
    let output = command.output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}");
}

#[test]
fn blender_makes_its_file_and_reads_the_scene_in_it() {
    let (found, why) = harmony_lighting::CyclesRenderer::find_saying_why();
    if found.is_none() {
        return skip(format_args!("no Blender here ({})", why.join("; ")));
    }
    let run = run();
    let world = World::read(run.path()).unwrap();
    let folder = run.path().join("export");
    export(&world, &[Format::Blend], &folder, &options()).unwrap();
    let report = check(&world, &folder, Some(&cache())).unwrap();
    assert!(report.differences.is_empty(), "{:#?}", report.differences);
    assert_eq!(report.files[0].objects, world.items.len() + world.shell.len());
}
