//! What is exported holds what the scene holds.

use std::path::Path;

use harmony_export::{Budget, Format, GlbOptions, Manifest, Options, World, check, export};

use crate::support::{cache, options, run};

fn no_blender() -> Vec<Format> {
    Format::ALL.into_iter().filter(|f| *f != Format::Blend).collect()
}

fn exported(options: &Options) -> (tempfile::TempDir, World) {
    let run = run();
    let world = World::read(run.path()).unwrap();
    export(&world, &no_blender(), &run.path().join("export"), options).unwrap();
    (run, world)
}

fn said(world: &World, folder: &Path) -> Vec<String> {
    check(world, folder, Some(&cache())).unwrap().differences.iter().map(ToString::to_string).collect()
}

#[test]
fn all_formats_hold_the_scene_and_twice_the_same_bytes() {
    let (run, world) = exported(&options());
    let folder = run.path().join("export");
    let report = check(&world, &folder, Some(&cache())).unwrap();
    assert!(report.differences.is_empty(), "{:#?}", report.differences);
    let n = world.items.len();
    let file =
        |name: &str| report.files.iter().find(|f| f.file == name).unwrap_or_else(|| panic!("{name} was not checked"));
    for whole in
        ["glb/scene.glb", "usd/scene.usda", "usd/scene.usdz", "mjcf/scene.xml", "obj/scene.obj", "plan/furniture.csv"]
    {
        assert!(file(whole).objects >= n, "{whole}: {}", file(whole).objects);
    }
    assert!(file("mjcf/scene.xml").colliders > n);
    assert_eq!(file("glb/level_ceiling.glb").objects, 1);
    assert_eq!(file("urdf/desk_01/desk_01.urdf").objects, 1);
    assert_eq!(file("mjcf/objects/desk_01.xml").objects, 1);

    let again = run.path().join("again");
    export(&world, &no_blender(), &again, &options()).unwrap();
    assert_eq!(Manifest::read(&folder).unwrap(), Manifest::read(&again).unwrap());
}

#[test]
fn a_difference_names_the_object() {
    let (run, world) = exported(&options());
    let folder = run.path().join("export");
    let change = |file: &str, from: &str, to: &str| {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{file} has no {from}");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    };
    change("plan/furniture.csv", ",desk_01,", ",desk_99,");
    change("obj/scene.obj", "o vase_01\nv ", "o vase_01\nv 9 9 9\nv ");
    change("mjcf/scene.xml", "<freejoint name=\"chair_02_free\"/>", "");
    let usda = std::fs::read_to_string(folder.join("usd/scene.usda")).unwrap();
    let at = usda.find("def Xform \"cabinet_01\"").unwrap();
    let mass = usda[at..].find("physics:mass = ").unwrap() + at;
    let mut heavy = usda.clone();
    heavy.insert(mass + "physics:mass = ".len(), '9');
    std::fs::write(folder.join("usd/scene.usda"), heavy).unwrap();
    std::fs::remove_file(folder.join("glb/shell.glb")).unwrap();
    let said = said(&world, &folder);
    for (file, object) in [
        ("plan/furniture.csv", "desk_01: is missing"),
        ("plan/furniture.csv", "desk_99: is not in the scene"),
        ("obj/scene.obj", "vase_01: fills"),
        ("mjcf/scene.xml", "chair_02: cannot move"),
        ("usd/scene.usda", "cabinet_01: weighs"),
        ("glb/shell.glb", "cannot be read"),
    ] {
        assert!(said.iter().any(|s| s.starts_with(file) && s.contains(object)), "{file} {object} not in {said:#?}");
    }
}

#[test]
fn budgets_hold_and_packed_files_unpack_to_the_scene() {
    let run = run();
    let world = World::read(run.path()).unwrap();
    let half = world.triangles() / 2;
    let budget = Budget { faces: Some(half), texture: Some(32) };
    let glb = GlbOptions { lods: true, webp: true, meshopt: true };
    let folder = run.path().join("small");
    export(&world, &[Format::Glb], &folder, &Options { budget, glb, ..options() }).unwrap();
    let report = check(&world, &folder, Some(&cache())).unwrap();
    assert!(report.differences.is_empty(), "{:#?}", report.differences);
    let small = world.within(&budget);
    // A few meshes are as simple as they get.
    assert!(small.triangles() * 10 < half * 12, "{} of {half}", small.triangles());
    assert!(small.looks.pictures.iter().all(|p| p.pixels.width().max(p.pixels.height()) <= 32));
    let bytes = std::fs::read(folder.join("glb/scene.glb")).unwrap();
    let text = String::from_utf8_lossy(&bytes[20..]).into_owned();
    for word in ["MSFT_lod", "EXT_meshopt_compression", "EXT_texture_webp", "_lod1\"", "MSFT_screencoverage"] {
        assert!(text.contains(word), "{word}");
    }
}

#[test]
fn exports_of_other_formats_are_kept_in_the_list() {
    let run = run();
    let world = World::read(run.path()).unwrap();
    let folder = run.path().join("export");
    export(&world, &[Format::Obj], &folder, &options()).unwrap();
    export(&world, &[Format::Plan], &folder, &options()).unwrap();
    let manifest = Manifest::read(&folder).unwrap();
    assert!(manifest.files.contains_key("obj/scene.obj") && manifest.files.contains_key("plan/furniture.csv"));
    assert!(said(&world, &folder).is_empty());
}

#[test]
fn without_the_scene_glb_the_objects_own_meshes_do() {
    let run = run();
    let scene = crate::support::scene();
    for (o, mesh) in scene.objects.iter().zip(crate::support::meshes(&scene)) {
        harmony_io::write_mesh_glb(&run.path().join(&o.mesh), o.id.as_str(), mesh, serde_json::Value::Null).unwrap();
    }
    std::fs::remove_file(run.path().join("scene_full.glb")).unwrap();
    let world = World::read(run.path()).unwrap();
    assert_eq!(world.items.len(), scene.objects.len());
    assert_eq!(world.shell.len(), 6);
    assert!(world.notes.iter().any(|n| n.contains("scene_full.glb")));
}
