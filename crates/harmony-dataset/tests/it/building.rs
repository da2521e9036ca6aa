//! A release, read back by programs of others.

use std::collections::BTreeSet;
use std::process::Command;

use harmony_dataset::DatasetError;
use harmony_dataset::check::check;
use harmony_dataset::release::{build, files};
use harmony_dataset::sources::{self, YesNo};

use crate::fixture::set;

#[test]
fn a_release_is_whole_and_others_read_it() {
    let set = set();
    let mut rows = sources::load(&set.root()).unwrap();
    rows[0].redistributable = YesNo::No;
    rows[2].blur = "10 10 40 40".into();
    sources::save(&set.root(), &rows).unwrap();
    let out = set.folder.path().join("release");
    let released = build(&set.root(), &out).unwrap();
    assert_eq!((released.scenes, released.photos_left_out, released.shards), (4, 1, 3));
    // The release passes its own check; the same folder gives the same bytes.
    assert_eq!(check(&out).unwrap().faults(), 0);
    let again = set.folder.path().join("again");
    build(&set.root(), &again).unwrap();
    assert_eq!(files(&out), files(&again));
    for file in files(&out) {
        assert!(std::fs::read(out.join(&file)).unwrap() == std::fs::read(again.join(&file)).unwrap(), "{file}");
    }
    assert!(!out.join("easy/living_room_01/photo.jpg").exists());
    // A photo that need not change keeps its pixels, a blurred one does not.
    let photo = |root: &std::path::Path, scene: &str| {
        harmony_io::picture::read(&root.join(scene).join("photo.jpg")).unwrap().to_rgb8()
    };
    assert_eq!(photo(&out, "medium/bedroom_01"), photo(&set.root(), "medium/bedroom_01"));
    assert_ne!(photo(&out, "medium/bedroom_02"), photo(&set.root(), "medium/bedroom_02"));
    // Lists: each scene once, whatever the split.
    let list = |name: &str| {
        let text = std::fs::read_to_string(out.join(format!("splits/{name}.txt"))).unwrap();
        text.lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let folds: Vec<String> = ["train", "val", "test"].iter().flat_map(|f| list(f)).collect();
    let all: BTreeSet<String> = set.scenes.iter().map(harmony_dataset::layout::SceneId::path).collect();
    assert_eq!((folds.len(), folds.into_iter().collect::<BTreeSet<_>>()), (4, all));
    assert_eq!(list("easy"), ["easy/living_room_01"]);
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.starts_with("---\nlicense: cc-by-nc-4.0\n") && card.contains("1 photos are not included"));
    let attribution = std::fs::read_to_string(out.join("ATTRIBUTION.md")).unwrap();
    assert!(attribution.contains("by A. Photographer") && attribution.contains("regions blurred"));
    read_by_python(&out);
    // A changed file shows.
    std::fs::write(out.join("easy/living_room_01/objects.json"), "{}").unwrap();
    std::fs::write(out.join("stranger.txt"), "x").unwrap();
    let found = check(&out).unwrap().findings;
    assert!(found.iter().any(|f| f.what.contains("objects.json is not the file that was released")));
    assert!(found.iter().any(|f| f.what.contains("stranger.txt is not part of the release")));
}

fn read_by_python(out: &std::path::Path) {
    let cache = std::env::var_os("HARMONY_CACHE")
        .map(std::path::PathBuf::from)
        .or_else(|| Some(std::path::PathBuf::from(std::env::var_os("HOME")?).join(".cache/harmony")));
    let Some(python) = cache.map(|c| c.join("checkers/bin/python")).filter(|p| p.is_file()) else {
        return harmony_testing::skip("the checkers are not installed (tools/setup.sh checkers)");
    };
    let script = harmony_testing::root().join("tools/read_dataset.py");
    let output = Command::new(python).arg(script).arg(out).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("4 scenes, 8 objects, 3 shards"), "{said}");
}

#[test]
fn a_data_set_with_faults_is_not_released() {
    let set = set();
    std::fs::remove_file(set.root().join("medium/bedroom_01/camera.json")).unwrap();
    let out = set.folder.path().join("release");
    assert!(matches!(build(&set.root(), &out).unwrap_err(), DatasetError::Faults(1)));
    assert!(!out.exists());
    std::fs::create_dir(&out).unwrap();
    assert!(matches!(build(&set.root(), &out).unwrap_err(), DatasetError::Exists(_)));
}
