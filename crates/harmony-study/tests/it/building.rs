//! What a site holds, and what it must not.

use std::collections::BTreeSet;
use std::path::Path;

use harmony_study::StudyError;
use harmony_study::build::build;
use harmony_study::private::{PrivateStudy, TrialKind};

use crate::fixture::{METHODS, options, picture, study};

fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
                found.push((name, std::fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn nothing_on_the_site_tells_a_method_or_a_scene() {
    let study = study(6, 4, |o| (o.checks, o.repeats) = (1, 1));
    let files = files(&study.site());
    // Page, and photo and panels of each trial.
    assert_eq!(files.len(), 1 + 6 * 7);
    let mut names = METHODS.map(str::to_lowercase).to_vec();
    names.extend(["room_0".to_owned(), "(photo)".to_owned(), study.secret().secret.clone()]);
    for (name, bytes) in &files {
        let text = format!("{name}\n{}", String::from_utf8_lossy(bytes)).to_lowercase();
        for secret in &names {
            assert!(!text.contains(secret.as_str()), "{name} holds {secret}");
        }
    }
    // Kinds of trials do not show in the order of the list, nor in the number of panels.
    let kinds: BTreeSet<usize> = study.secret().trials.iter().map(|t| t.panels.len()).collect();
    assert_eq!(kinds, BTreeSet::from([6]));
    assert!(study.secret().trials.windows(2).all(|w| w[0].id < w[1].id));
    assert!(study.secret().trials.iter().all(|t| t.panels.windows(2).all(|w| w[0].id < w[1].id)));
    let count = |kind| study.secret().trials.iter().filter(|t| t.kind == kind).count();
    assert_eq!([count(TrialKind::Scene), count(TrialKind::Repeat), count(TrialKind::Check)], [4, 1, 1]);
    assert_eq!(PrivateStudy::load(&study.private()).unwrap(), *study.secret());
}

#[test]
fn panels_show_the_methods_that_the_private_folder_names() {
    let study = study(6, 3, |_| {});
    for trial in &study.secret().trials {
        let scene: usize = trial.scene[5..].parse().unwrap();
        for panel in &trial.panels {
            let image = image::open(study.site().join(format!("pictures/{}-0.jpg", panel.id))).unwrap().to_rgb8();
            // All panels of a trial have the photo's size.
            assert_eq!(image.dimensions(), (48, 36));
            let method = METHODS.iter().position(|m| *m == panel.method).unwrap();
            let [r, g, _] = image.get_pixel(40, 5).0.map(i32::from);
            assert!((r - (40 + 30 * scene as i32)).abs() < 8 && (g - (20 + 35 * method as i32)).abs() < 8, "{r} {g}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_secret_other_names() {
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(folder.path(), 3, 2);
    let path = |name: &str| folder.path().join(name);
    build(&options, &path("a"), &path("a.private")).unwrap();
    build(&options, &path("b"), &path("b.private")).unwrap();
    assert_eq!(files(&path("a")), files(&path("b")));
    options.seed = None;
    build(&options, &path("c"), &path("c.private")).unwrap();
    let names = |f: &str| files(&path(f)).into_iter().map(|(n, _)| n).collect::<Vec<_>>();
    assert_ne!(names("a"), names("c"));
}

#[test]
fn one_file_holds_everything() {
    let study = study(3, 2, |o| o.single_file = true);
    let files = files(&study.site());
    assert_eq!(files.len(), 1);
    let page = String::from_utf8_lossy(&files[0].1);
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 2 * 4);
    assert!(!page.contains("pictures/"));
}

#[test]
fn bars_give_a_method_away_and_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(folder.path(), 3, 2);
    picture(&folder.path().join(METHODS[1]).join("room_01.png"), 1, 1, (64, 64));
    let built = build(&options, &folder.path().join("site"), &folder.path().join("private")).unwrap();
    assert_eq!(built.study.notes.len(), 1);
    assert!(built.study.notes[0].contains(METHODS[1]) && built.study.notes[0].contains("room_01"));
}

#[test]
fn only_complete_scenes_are_shown_and_the_others_named() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(folder.path(), 3, 3);
    std::fs::remove_file(folder.path().join(METHODS[2]).join("room_01.png")).unwrap();
    std::fs::remove_file(folder.path().join("photos/room_02.png")).unwrap();
    let built = build(&options, &folder.path().join("site"), &folder.path().join("private")).unwrap();
    assert_eq!(built.study.trials.len(), 1);
    assert_eq!(built.study.left_out, [format!("room_01: nothing of {}", METHODS[2]), "room_02: no photo".to_owned()]);
}

#[test]
fn what_cannot_be_built_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let good = options(folder.path(), 3, 2);
    let (site, private) = (folder.path().join("site"), folder.path().join("private"));
    let refused = |options: &_, wanted: &str| {
        let error = build(options, &site, &private).unwrap_err();
        assert!(error.to_string().contains(wanted), "{error}");
        assert!(!site.exists() && !private.exists());
        let litter = std::fs::read_dir(folder.path())
            .unwrap()
            .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().ends_with(".tmp"));
        assert_eq!(litter.count(), 0);
        error
    };
    let mut o = good.clone();
    o.sets.truncate(1);
    refused(&o, "2 to 9 sets");
    let mut o = good.clone();
    o.photos = Some(folder.path().join(METHODS[0]));
    std::fs::create_dir_all(folder.path().join("empty")).unwrap();
    o.photos = Some(folder.path().join("empty"));
    let error = refused(&o, "no scene has a photo");
    assert!(error.hint().is_some());
    let mut o = good.clone();
    o.sets[1].1 = folder.path().join("empty");
    assert!(matches!(refused(&o, "no run and no picture"), StudyError::EmptySet { .. }));
    let mut o = good.clone();
    o.sets[1].1 = folder.path().join("nowhere");
    refused(&o, "nowhere");
    let mut o = good.clone();
    o.scenes = Some(3);
    refused(&o, "3 scenes were asked for, 2");
    let mut o = good.clone();
    o.study = "Not A Name".to_owned();
    refused(&o, "Not A Name");
    let mut o = good.clone();
    o.reference = Some("nobody".to_owned());
    refused(&o, "nobody");
    std::fs::write(folder.path().join(METHODS[1]).join("room_01.png"), b"no picture").unwrap();
    refused(&good, "room_01.png");
    // A folder that is there is never written into.
    std::fs::create_dir_all(&site).unwrap();
    std::fs::write(site.join("mine.txt"), "mine").unwrap();
    assert!(matches!(build(&good, &site, &private), Err(StudyError::Exists(_))));
    assert_eq!(std::fs::read_to_string(site.join("mine.txt")).unwrap(), "mine");
}
