//! A sound data set has no fault; each fault that is put in is found and named.

use std::path::Path;

use harmony_dataset::DatasetError;
use harmony_dataset::add::{add, init};
use harmony_dataset::check::{Kind, Severity, check};
use harmony_dataset::config::Config;
use harmony_dataset::layout::Split;
use harmony_dataset::sources::{self, Source, YesNo};
use harmony_io::{picture, read_json, write_json};
use serde_json::{Value, json};

use crate::fixture::{Set, origin, run, set};

fn faults(set: &Set) -> Vec<(String, Kind, String)> {
    let report = check(&set.root()).unwrap();
    report.findings.into_iter().filter(|f| f.severity == Severity::Fault).map(|f| (f.scene, f.kind, f.what)).collect()
}

#[test]
fn a_sound_data_set_has_no_fault() {
    let set = set();
    assert_eq!(faults(&set), []);
    let names: Vec<String> = set.scenes.iter().map(harmony_dataset::layout::SceneId::path).collect();
    assert_eq!(names, ["easy/living_room_01", "medium/bedroom_01", "medium/bedroom_02", "medium/home_office_01"]);
    let warnings = check(&set.root()).unwrap().findings;
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].scene == "medium/home_office_01" && warnings[0].what.contains("not physically lit"));
}

#[test]
fn a_published_photo_that_nobody_looked_at_for_faces_is_a_warning() {
    let set = set();
    let mut rows = sources::load(&set.root()).unwrap();
    for row in &mut rows {
        row.faces.clear();
    }
    // One with regions, one that is not published.
    rows[1].blur = "10 10 40 40".into();
    rows[2].redistributable = YesNo::No;
    sources::save(&set.root(), &rows).unwrap();
    assert_eq!(faults(&set), []);
    let found = check(&set.root()).unwrap().findings;
    let told: Vec<&str> = found.iter().filter(|f| f.what.contains("for faces")).map(|f| f.scene.as_str()).collect();
    assert_eq!(told, [rows[0].id().path(), rows[3].id().path()]);
}

#[test]
fn what_the_program_builds_is_its_own_whatever_the_source_is_called() {
    let set = set();
    json(&set.root().join("medium/bedroom_02/provenance.json"), |v| {
        v["mesh_sources"] = json!({"program of 13 lines": 1, "template cup": 2, "part model": 1});
        v["cast"]["lit_renderer"] = json!(["cycles", "5.0"]);
    });
    assert_eq!(faults(&set), []);
}

/// Changes one thing in a fresh data set and expects a fault of a kind with these words in this scene, alone.
fn finds(kind: Kind, words: &str, change: impl FnOnce(&Path)) {
    let set = set();
    change(&set.root().join("medium/bedroom_02"));
    let found = faults(&set);
    assert!(
        found.iter().any(|(scene, k, what)| scene == "medium/bedroom_02" && *k == kind && what.contains(words)),
        "{words}: {found:?}"
    );
    assert!(found.iter().all(|(scene, _, _)| scene == "medium/bedroom_02"), "{found:?}");
}

fn json(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut value: Value = read_json(path).unwrap();
    change(&mut value);
    write_json(path, &value).unwrap();
}

fn row(scene: &Path, change: impl FnOnce(&mut Source)) {
    let root = scene.parent().unwrap().parent().unwrap();
    let mut rows = sources::load(root).unwrap();
    change(rows.iter_mut().find(|r| r.id().path() == "medium/bedroom_02").unwrap());
    sources::save(root, &rows).unwrap();
}

#[test]
fn missing_files_are_found() {
    for file in harmony_dataset::layout::REQUIRED {
        finds(Kind::Missing, file, |scene| std::fs::remove_file(scene.join(file)).unwrap());
    }
    finds(Kind::Missing, "photo", |scene| std::fs::remove_file(scene.join("photo.jpg")).unwrap());
    finds(Kind::Missing, "folder is not there", |scene| std::fs::remove_dir_all(scene).unwrap());
}

#[test]
fn files_that_contradict_each_other_are_found() {
    finds(Kind::Wrong, "not the one whose hash", |s| {
        std::fs::copy(s.join("../bedroom_01/photo.jpg"), s.join("photo.jpg")).unwrap();
    });
    finds(Kind::Wrong, "colours that segmentation.json does not name", |s| {
        let mut image = picture::read(&s.join("segmentation.png")).unwrap().to_rgb8();
        image.put_pixel(0, 0, image::Rgb([1, 2, 3]));
        picture::write_rgb_png(&s.join("segmentation.png"), &image).unwrap();
    });
    finds(Kind::Wrong, "pixels in segmentation.png", |s| {
        json(&s.join("segmentation.json"), |v| v["objects"][0]["pixels"] = json!(5));
    });
    finds(Kind::Wrong, "unknown stage", |s| {
        json(&s.join("segmentation.json"), |v| v["objects"][1]["stage"] = json!("roof"));
    });
    finds(Kind::Wrong, "the mask of", |s| std::fs::remove_file(s.join("masks/lamp_01.png")).unwrap());
    finds(Kind::Wrong, "name other objects", |s| {
        json(&s.join("objects.json"), |v| v["objects"][0]["id"] = json!("sofa_01"));
    });
    finds(Kind::Wrong, "stands on sofa_09", |s| {
        json(&s.join("objects.json"), |v| v["objects"][1]["on_top_of"] = json!("sofa_09"));
    });
    finds(Kind::Wrong, "no size or no place", |s| {
        json(&s.join("objects.json"), |v| v["objects"][0]["size_m"]["width"] = json!(-1.0));
    });
    finds(Kind::Wrong, "unknown wall", |s| {
        json(&s.join("objects.json"), |v| v["objects"][0]["wall_affinity"] = json!("north"));
    });
    finds(Kind::Wrong, "no camera", |s| json(&s.join("camera.json"), |v| v["R"][0] = json!([2.0, 0.0, 0.0])));
    finds(Kind::Wrong, "camera.json has another size", |s| json(&s.join("camera.json"), |v| v["width"] = json!(97)));
    finds(Kind::Wrong, "scene.glb", |s| std::fs::write(s.join("scene.glb"), b"glTF nonsense").unwrap());
    finds(Kind::Wrong, "objects.json", |s| std::fs::write(s.join("objects.json"), b"{").unwrap());
    finds(Kind::Wrong, "another shape", |s| {
        picture::write_rgb_png(&s.join("render.png"), &image::RgbImage::new(64, 64)).unwrap();
    });
    finds(Kind::Wrong, "to blur reaches beyond", |s| row(s, |r| r.blur = "0 0 500 10".into()));
    finds(Kind::Wrong, "sources.csv says", |s| row(s, |r| r.width = 95));
}

#[test]
fn what_is_not_licensed_is_found() {
    finds(Kind::Licence, "names no licence", |s| row(s, |r| r.licence = String::new()));
    finds(Kind::Licence, "no known licence", |s| row(s, |r| r.licence = "found on the web".into()));
    finds(Kind::Licence, "no address", |s| row(s, |r| r.source_url = String::new()));
    finds(Kind::Licence, "no web address", |s| row(s, |r| r.source_url = "C:/photos/1.jpg".into()));
    finds(Kind::Licence, "does not let the photo be published", |s| row(s, |r| r.licence = "3D-FRONT-research".into()));
    finds(Kind::Licence, "asks for the author", |s| {
        row(s, |r| (r.licence, r.author) = ("CC-BY-4.0".into(), String::new()));
    });
    finds(Kind::Licence, "forbids changed copies", |s| row(s, |r| r.licence = "CC-BY-ND-4.0".into()));
    finds(Kind::Licence, "does not go into", |s| row(s, |r| r.licence = "CC-BY-NC-SA-4.0".into()));
    finds(Kind::Licence, "does not say what may be done with what strange-net", |s| {
        json(&s.join("provenance.json"), |v| v["mesh_sources"]["strange-net"] = json!(1));
    });
    let set = set();
    let mut rows = sources::load(&set.root()).unwrap();
    rows.pop();
    sources::save(&set.root(), &rows).unwrap();
    assert!(faults(&set).iter().any(|(_, k, what)| *k == Kind::Licence && what.contains("no row")));
}

#[test]
fn a_folder_with_another_name_and_a_photo_twice_are_found() {
    let set = set();
    let medium = set.root().join("medium");
    std::fs::rename(medium.join("bedroom_02"), medium.join("Bedroom 2")).unwrap();
    let mut rows = sources::load(&set.root()).unwrap();
    let hash = rows[0].sha256.clone();
    rows[1].sha256 = hash;
    sources::save(&set.root(), &rows).unwrap();
    let found = faults(&set);
    for words in ["<room_type>_NN", "its folder is not there", "have the same photo"] {
        assert!(found.iter().any(|(_, _, what)| what.contains(words)), "{words}: {found:?}");
    }
}

#[test]
fn what_cannot_be_added_is_refused_and_changes_nothing() {
    let set = set();
    let before = std::fs::read(set.root().join("sources.csv")).unwrap();
    let refused = |run: &Path, change: &dyn Fn(&mut harmony_dataset::add::Origin)| {
        let mut origin = origin();
        change(&mut origin);
        let error = add(&set.root(), run, Split::Easy, Some("kitchen"), &origin).unwrap_err();
        assert_eq!(std::fs::read(set.root().join("sources.csv")).unwrap(), before);
        assert!(!set.root().join("easy/kitchen_01").exists());
        error
    };
    assert!(matches!(refused(&set.run(0), &|_| {}), DatasetError::Doubled { .. }));
    assert!(matches!(refused(set.folder.path(), &|_| {}), DatasetError::NoRun { .. }));
    let other = set.folder.path().join("other");
    run(&other, "kitchen", 222, true);
    assert!(refused(&other, &|o| o.blur = "1 2 3".into()).to_string().contains("regions are"));
    std::fs::remove_file(other.join("objects.json")).unwrap();
    assert!(refused(&other, &|_| {}).to_string().contains("objects.json is missing"));
    std::fs::write(set.root().join("sources.csv"), "split;name\n").unwrap();
    assert!(add(&set.root(), &other, Split::Easy, None, &origin()).is_err());
    // A folder that holds something is not made a data set.
    let error = init(&set.root(), &Config::new("other", "CC0-1.0")).unwrap_err();
    assert!(matches!(error, DatasetError::Exists(_)));
    assert!(init(&set.folder.path().join("new"), &Config::new("two words", "CC0-1.0")).is_err());
    assert!(matches!(check(&set.folder.path().join("nowhere")).unwrap_err(), DatasetError::NoDataset(_)));
    // Unless its licence is known to allow it, a photo is not published.
    let mut unknown = origin();
    (unknown.licence, unknown.licence_url) = ("house rules".into(), "https://example.org/rules".into());
    let fresh = crate::fixture::set();
    run(&other, "kitchen", 222, true);
    add(&fresh.root(), &other, Split::Complicated, None, &unknown).unwrap();
    let rows = sources::load(&fresh.root()).unwrap();
    let added = rows.iter().find(|r| r.name == "kitchen_01").unwrap();
    assert_eq!(added.redistributable, YesNo::No);
}
