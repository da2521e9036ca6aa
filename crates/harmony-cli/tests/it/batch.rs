//! `harmony batch` with the program itself as the maker of scenes.

use std::path::Path;
use std::process::Output;

use serde_json::Value;

use crate::common::{files, harmony, root, said, timeless};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn told(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), said(output))
}

#[test]
fn the_bundled_example_in_a_batch_is_what_it_is_alone_and_a_second_batch_adds_to_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let root = root();
    let (set, photos, alone) = (folder.path().join("set"), folder.path().join("photos"), folder.path().join("alone"));
    std::fs::create_dir(&photos).unwrap();
    std::fs::copy(root.join("examples/home_office.jpg"), photos.join("home_office.jpg")).unwrap();
    std::fs::write(photos.join("letter.jpg"), "this is no picture").unwrap();
    let recording = root.join("examples/home_office_recording");
    let rest = ["--replay", text(&recording), "--attempts", "1", "--", "--no-lit", "--until", "wall"];
    let batch =
        |photos: &Path, out: &Path| harmony(&[&["batch", text(photos), "--out", text(out)][..], &rest[..]].concat());
    let first = batch(&photos, &set);
    assert_eq!(first.status.code(), Some(3), "one of two has failed: {}", told(&first));
    assert!(told(&first).contains("1 of 2 done") && told(&first).contains("input"), "{}", told(&first));

    // The same by hand, with the same configuration and the photo under the same name.
    let config = set.join("harmony.toml");
    let photo = set.join("photos/home_office.jpg");
    let by_hand = harmony(&[
        "reconstruct",
        text(&photo),
        "--out",
        text(&alone),
        "--config",
        text(&config),
        "--replay",
        text(&recording),
        "--no-lit",
        "--until",
        "wall",
    ]);
    assert!(by_hand.status.success(), "{}", told(&by_hand));
    let run = set.join("scenes/home_office");
    assert!(run.join("scene.json").is_file());
    let (one, other) = (timeless(&alone), timeless(&run));
    assert!(one.keys().eq(other.keys()), "{:?} and {:?}", one.keys(), other.keys());
    let differs: Vec<_> = one.keys().filter(|name| one[*name] != other[*name]).collect();
    assert!(differs.is_empty(), "{differs:?}");
    let status: Value = serde_json::from_slice(&std::fs::read(set.join("status.json")).unwrap()).unwrap();
    assert_eq!((&status["counts"]["done"], &status["counts"]["failed"]), (&1.into(), &1.into()));
    assert!(std::fs::read_to_string(set.join("status.html")).unwrap().contains("thumbs/home_office.jpg"));
    assert!(set.join("thumbs/home_office.jpg").is_file());

    // Again: nothing is made anew. Another set beside it: the first one's words stay.
    let before = files(&run);
    let again = batch(&photos, &set);
    assert!(told(&again).contains("0 scenes queued, 2 were there already"), "{}", told(&again));
    assert!(files(&run) == before);
    let summary = std::fs::read(set.join("scenes.csv")).unwrap();
    let other = folder.path().join("other");
    let more = folder.path().join("more.txt");
    std::fs::write(&more, "photos/letter.jpg\n").unwrap();
    assert_eq!(batch(&more, &other).status.code(), Some(3));
    assert_eq!(std::fs::read(set.join("scenes.csv")).unwrap(), summary);

    let retried = harmony(&["batch", "retry", text(&set), "--stage", "input"]);
    assert!(told(&retried).contains("1 scenes queued again"), "{}", told(&retried));
    let worker = harmony(&["worker", "--set", text(&set), "--until-idle"]);
    assert!(worker.status.success() && told(&worker).contains("1 turns failed"), "{}", told(&worker));
}

#[test]
fn what_cannot_be_batched_is_refused_and_nothing_is_changed() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("list"), "a.png\n").unwrap();
    std::fs::create_dir(path("mine")).unwrap();
    std::fs::write(path("mine/letter"), "x").unwrap();
    std::fs::write(path("a.jpg"), "x").unwrap();
    std::fs::write(path("notes.sqlite"), "not a database, and rather longer than a header would be ".repeat(9))
        .unwrap();
    let (set, photo) = (path("set"), path("a.jpg"));
    let refused = |args: &[&str], what: &str| {
        let output = harmony(&[&["batch"], args].concat());
        assert_eq!(output.status.code(), Some(1), "{args:?}: {}", told(&output));
        let said = said(&output);
        assert!(said.contains(what) && said.contains("hint:"), "{args:?}: {said}");
    };
    refused(&[text(&path("list")), "--out", text(&set)], "1 of 1 photos are not there");
    refused(&[text(&path("mine")), "--out", text(&set)], "no photo");
    refused(&[text(&photo), "--out", text(&path("mine"))], "not empty");
    refused(&[text(&photo), "--out", text(&set), "--queue", text(&path("notes.sqlite"))], "no SQLite database");
    refused(&[text(&photo), "--out", text(&set), "--queue", "mysql://x/y"], "neither a file nor postgres");
    refused(&[text(&photo), "--out", text(&path("a.jpg"))], "set folder");
    refused(&["status", text(&path("mine"))], "no batch.json");
    assert!(!set.exists());
    let names: Vec<_> = std::fs::read_dir(path("mine")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["letter"]);
}
