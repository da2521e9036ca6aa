//! Readers of other programs: usd-core, MuJoCo, ezdxf, the Khronos validator, Blender.

use std::process::Command;

use harmony_export::{Budget, Format, GlbOptions, Options, World, check, export};
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
