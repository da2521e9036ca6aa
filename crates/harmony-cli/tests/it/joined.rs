//! `harmony join` refuses what it cannot join, with what to do about it, and writes nothing then.

use std::path::Path;

use crate::common::{harmony, said};

#[test]
fn folders_that_are_no_runs_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (a, b, out) = (path("a"), path("b"), path("out"));
    let output = harmony(&["join", &a, &b, "--out", &out]);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("holds no scene") && text.contains(&a) && text.contains("hint:"), "{text}");
    assert!(!Path::new(&out).exists());
}

#[test]
fn one_run_or_one_run_twice_is_not_several() {
    let folder = tempfile::tempdir().unwrap();
    let (a, out) = (folder.path().display().to_string(), folder.path().join("out").display().to_string());
    assert_eq!(harmony(&["join", &a, "--out", &out]).status.code(), Some(2));
    let output = harmony(&["join", &a, &a, "--out", &out]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("twice"), "{}", said(&output));
}

#[test]
fn what_is_about_one_photo_is_refused_with_several() {
    let output = harmony(&["reconstruct", "a.jpg", "b.jpg", "--out", "nowhere", "--points", "a.npz"]);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("--points") && text.contains("hint:"), "{text}");
}
