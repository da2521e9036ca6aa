//! What cannot be exported is named, and nothing is written.

use harmony_export::{ExportError, Format, World, check, export};
use harmony_io::write_json;
use harmony_scene::Scene;

use crate::support::{cache, options, run, scene, write_run};

fn changed(change: impl FnOnce(&mut Scene)) -> ExportError {
    let run = run();
    let mut scene = scene();
    change(&mut scene);
    write_json(&run.path().join("scene.json"), &scene).unwrap();
    World::read(run.path()).unwrap_err()
}

#[test]
fn a_folder_without_a_scene_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let error = World::read(folder.path()).unwrap_err();
    assert!(error.to_string().contains("scene.json"), "{error}");
    assert!(error.hint().is_some());
    let error = World::read(&folder.path().join("nothing/here")).unwrap_err();
    assert!(error.to_string().contains("nothing/here"), "{error}");
}

#[test]
fn values_that_cannot_be_are_named_with_their_owner() {
    let room = changed(|s| s.room.extents.width = -1.0);
    assert!(room.to_string().contains("the width of the room is -1"), "{room}");
    let scale = changed(|s| s.objects[3].pose.scale = 0.0);
    assert!(scale.to_string().contains("desk_01"), "{scale}");
    let twice = changed(|s| s.objects[4].id = s.objects[3].id.clone());
    assert!(matches!(&twice, ExportError::Twice { object } if object == "desk_01"), "{twice}");
    let camera = changed(|s| s.camera.rotation = [[0.0; 3]; 3]);
    assert!(camera.to_string().contains("camera"), "{camera}");
    let version = changed(|s| s.version = 99);
    assert!(version.to_string().contains("99"), "{version}");
    let far = changed(|s| s.objects[3].pose.position.x = 1e9);
    assert!(far.to_string().contains("desk_01"), "{far}");
}

#[test]
fn files_that_do_not_belong_together_are_told() {
    let moved = changed(|s| s.objects[3].pose.position.x += 0.25);
    assert!(matches!(&moved, ExportError::Moved { object, .. } if object == "desk_01"), "{moved}");
    assert!(moved.to_string().contains("0.250 m"), "{moved}");
    let missing = changed(|s| s.objects[3].id = harmony_scene::ObjectId::new("desk_77").unwrap());
    assert!(matches!(&missing, ExportError::NoMesh { object, .. } if object == "desk_77"), "{missing}");
}

#[test]
fn foreign_and_broken_files_are_no_scenes() {
    let run = run();
    std::fs::write(run.path().join("scene_full.glb"), b"glTF\x02\0\0\0 not really").unwrap();
    let error = World::read(run.path()).unwrap_err();
    assert!(error.to_string().contains("scene_full.glb"), "{error}");
    std::fs::write(run.path().join("scene.json"), "{\"version\": 1").unwrap();
    let error = World::read(run.path()).unwrap_err();
    assert!(error.to_string().contains("scene.json"), "{error}");
    // A mesh path that leads out of the run is not followed.
    let mut scene = scene();
    scene.objects[0].mesh = "../../etc/passwd".to_owned();
    write_run(run.path(), &scene);
    std::fs::remove_file(run.path().join("scene_full.glb")).unwrap();
    let error = World::read(run.path()).unwrap_err();
    assert!(matches!(error, ExportError::NoMesh { .. }), "{error}");
}

#[test]
fn formats_are_named_and_an_empty_folder_has_nothing_to_check() {
    let error = "step".parse::<Format>().unwrap_err();
    assert!(error.to_string().contains("\"step\"") && error.to_string().contains("usdz"), "{error}");
    let run = run();
    let world = World::read(run.path()).unwrap();
    let error = check(&world, run.path(), None).unwrap_err();
    assert!(matches!(error, ExportError::NothingExported { .. }), "{error}");
}

#[test]
fn an_unwritable_folder_is_named_and_a_scene_without_objects_is_written() {
    let run = run();
    let world = World::read(run.path()).unwrap();
    let blocked = run.path().join("blocked");
    std::fs::write(&blocked, "a file").unwrap();
    let error = export(&world, &[Format::Obj], &blocked, &options()).unwrap_err();
    assert!(error.to_string().contains("blocked"), "{error}");

    let mut empty = scene();
    empty.objects.clear();
    empty.room.openings.iter_mut().for_each(|o| o.object = None);
    write_run(run.path(), &empty);
    let world = World::read(run.path()).unwrap();
    let formats: Vec<Format> = Format::ALL.into_iter().filter(|f| *f != Format::Blend).collect();
    let folder = run.path().join("empty");
    export(&world, &formats, &folder, &options()).unwrap();
    let report = check(&world, &folder, Some(&cache())).unwrap();
    assert!(report.differences.is_empty(), "{:?}", report.differences);
}
