//! What the tests of the program share: running it, reading folders, small pictures.
#![allow(dead_code, clippy::unwrap_used, reason = "tests, each with its own part of these helpers")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// Root of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The program, in the root of the repository.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_harmony"));
    command.current_dir(root()).env_remove("RUST_LOG").env("NO_COLOR", "1");
    command
}

/// Runs the program to its end.
pub fn harmony(args: &[&str]) -> Output {
    program().args(args).output().unwrap()
}

/// What a process said on stderr.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Every file of a folder with its content.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                all.insert(path.strip_prefix(folder).unwrap().to_owned(), std::fs::read(&path).unwrap());
            }
        }
    }
    all
}

/// The files of a run with every time left out, as they must come out of any run of the same input.
pub fn timeless(run: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = files(run);
    all.retain(|path, _| !path.ends_with("timing.json"));
    if let Some(bytes) = all.get_mut(Path::new("run.json")) {
        let mut value: Value = serde_json::from_slice(bytes).unwrap();
        // The report tells times, so its hash differs; the report itself is compared below.
        value["files"].as_object_mut().unwrap().remove("report.html").unwrap();
        forget_latencies(&mut value["bill"]);
        for phase in value["phases"].as_object_mut().unwrap().values_mut().filter_map(Value::as_object_mut) {
            phase.remove("time");
        }
        *bytes = serde_json::to_vec_pretty(&value).unwrap();
    }
    if let Some(bytes) = all.get_mut(Path::new("report.html")) {
        *bytes = without_durations(&String::from_utf8(bytes.clone()).unwrap()).into_bytes();
    }
    all
}

fn forget_latencies(bill: &mut Value) {
    if let Value::Object(map) = bill {
        map.retain(|key, _| key != "latency_ms");
        map.values_mut().for_each(forget_latencies);
    }
}

/// A page without the cells that hold nothing but a duration, such as `>1.2 s<`.
fn without_durations(page: &str) -> String {
    let is_duration = |text: &str| {
        !text.is_empty()
            && text.split(' ').all(|w| matches!(w, "s" | "min" | "h") || w.parse::<f64>().is_ok())
            && text.split(' ').any(|w| matches!(w, "s" | "min" | "h"))
    };
    page.split('>')
        .map(|piece| match piece.split_once('<') {
            Some((text, rest)) if is_duration(text) => format!("<{rest}"),
            _ => piece.to_owned(),
        })
        .collect::<Vec<_>>()
        .join(">")
}

/// Fails with the names of the files that differ.
pub fn assert_same(found: &BTreeMap<PathBuf, Vec<u8>>, wanted: &BTreeMap<PathBuf, Vec<u8>>, when: &str) {
    let missing: Vec<_> = wanted.keys().filter(|path| !found.contains_key(*path)).collect();
    let extra: Vec<_> = found.keys().filter(|path| !wanted.contains_key(*path)).collect();
    let other: Vec<_> = found.iter().filter(|(p, b)| wanted.get(*p).is_some_and(|w| w != *b)).map(|(p, _)| p).collect();
    assert!(
        missing.is_empty() && extra.is_empty() && other.is_empty(),
        "{when}: missing {missing:?}, extra {extra:?}, other content {other:?}"
    );
}

pub mod drawn;
