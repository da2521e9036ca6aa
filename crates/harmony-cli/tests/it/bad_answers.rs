//! Answers that are empty, absurd or hostile, and run folders that were damaged.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::{self, harmony, program, root, said, timeless};
use serde_json::{Value, json};

const SETTINGS: &str = "[settings]\nworking_px = 256\nsurface_px_per_m = 20.0\n";

/// The new text of an answer, by call name and old answer; `None` = as it was.
type Change<'a> = &'a dyn Fn(&str, &Value) -> Option<String>;

/// What is done to a file.
type Damage<'a> = &'a dyn Fn(&Path);

/// A recording of the bundled example in which answers were replaced.
struct Recording {
    folder: tempfile::TempDir,
}

impl Recording {
    /// Copies the recording; `change` gives each answer's new text by call name, `None` = as it is.
    fn changed(change: impl Fn(&str, &Value) -> Option<String>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let from = root().join("examples/home_office_recording");
        let to = folder.path().join("recording");
        for (path, bytes) in common::files(&from) {
            let target = to.join(&path);
            fs::create_dir_all(target.parent().unwrap()).unwrap();
            let name = path.parent().unwrap().strip_prefix("vision_language").map(|p| p.to_str().unwrap().to_owned());
            let text = match name {
                Ok(name) => change(&name, &serde_json::from_slice(&bytes).unwrap()),
                Err(_) => None,
            };
            fs::write(target, text.map_or(bytes, String::into_bytes)).unwrap();
        }
        fs::write(folder.path().join("settings.toml"), SETTINGS).unwrap();
        Self { folder }
    }

    fn run(&self) -> PathBuf {
        self.folder.path().join("a/b/run")
    }

    fn replay(&self, until: &str) -> Output {
        let before = self.outside();
        let output = program()
            .args(["reconstruct", "examples/home_office.jpg", "--no-lit", "--until", until, "--replay"])
            .arg(self.folder.path().join("recording"))
            .arg("--out")
            .arg(self.run())
            .arg("--config")
            .arg(self.folder.path().join("settings.toml"))
            .output()
            .unwrap();
        let said = said(&output);
        assert!(!said.contains("panicked"), "{said}");
        assert!(matches!(output.status.code(), Some(0 | 3)), "{:?}: {said}", output.status);
        assert_eq!(self.outside(), before, "files outside of the run folder");
        output
    }

    fn outside(&self) -> BTreeSet<PathBuf> {
        common::files(self.folder.path()).into_keys().filter(|path| !path.starts_with("a/b/run")).collect()
    }

    fn scene(&self) -> Value {
        serde_json::from_slice(&fs::read(self.run().join("scene.json")).unwrap()).unwrap()
    }

    /// The scene is complete, finite, and its ids are plain.
    fn sound(&self) -> Value {
        let scene = self.scene();
        finite(&scene);
        for object in scene["objects"].as_array().unwrap() {
            let id = object["id"].as_str().unwrap();
            let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_';
            assert!(id.len() <= 80 && id.bytes().all(plain), "{id:?}");
            assert!(object["mesh"].as_str().unwrap().ends_with(&format!("/{id}.glb")));
        }
        scene
    }
}

/// No number is absurd.
fn finite(value: &Value) {
    match value {
        Value::Number(n) => assert!(n.as_f64().is_some_and(|v| v.is_finite() && v.abs() < 1e9), "{n}"),
        Value::Array(list) => list.iter().for_each(finite),
        Value::Object(map) => map.values().for_each(finite),
        _ => {}
    }
}

/// Every number of a value replaced.
fn with_numbers(value: &Value, number: &Value) -> Value {
    match value {
        Value::Number(_) => number.clone(),
        Value::Array(list) => list.iter().map(|v| with_numbers(v, number)).collect(),
        Value::Object(map) => map.iter().map(|(k, v)| (k.clone(), with_numbers(v, number))).collect(),
        other => other.clone(),
    }
}

/// Every text of a value replaced that `which` picks by its key.
fn with_texts(value: &Value, key: &str, text: &dyn Fn(&str, &str) -> Option<String>) -> Value {
    match value {
        Value::String(old) => text(key, old).map_or_else(|| value.clone(), Value::String),
        Value::Array(list) => list.iter().map(|v| with_texts(v, key, text)).collect(),
        Value::Object(map) => map.iter().map(|(k, v)| (k.clone(), with_texts(v, k, text))).collect(),
        other => other.clone(),
    }
}

#[test]
fn answers_that_are_none_leave_what_the_program_finds_alone() {
    let texts = ["", "null", "{}", "[]", "\"yes\"", "{\"items\": ", "NaN", "{\"room\": NaN}", "\u{feff}\u{0}", "17"];
    for shift in 0..2 {
        let recording = Recording::changed(|name, _| {
            let n: usize = name.bytes().map(usize::from).sum();
            Some(texts[(n + shift * 3) % texts.len()].to_owned())
        });
        let output = recording.replay("lighting");
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        let scene = recording.sound();
        let warnings = scene["warnings"].to_string();
        assert!(warnings.contains("cannot be used"), "the scene is silent about it: {warnings}");
    }
}

#[test]
fn numbers_out_of_this_world_do_not_reach_the_scene() {
    for number in [json!(1e308), json!(-1e308), json!(0), json!(5e-324), json!(999.999)] {
        let recording = Recording::changed(|name, value| {
            // Half of the answers, so that the absurd meet the sane.
            let odd = name.len() % 2 == 1 || name.starts_with('1');
            odd.then(|| with_numbers(value, &number).to_string())
        });
        recording.replay("furniture");
        recording.sound();
    }
    // Beyond what a double holds: no JSON of ours at all.
    let recording =
        Recording::changed(|_, value| Some(with_numbers(value, &json!(7)).to_string().replace('7', "1e999")));
    recording.replay("wall");
    recording.sound();
}

#[test]
fn ten_thousand_objects_and_endless_texts_are_refused_in_time() {
    let many = |item: &Value, count: usize| Value::Array(vec![item.clone(); count]);
    let deep = format!("{}{}", "[".repeat(200_000), "]".repeat(200_000));
    let cases: [(&str, Change<'_>); 4] = [
        ("many kinds", &|name, value| {
            name.ends_with("list").then(|| json!({"items": many(&value["items"][0], 10_000)}).to_string())
        }),
        ("many instances", &|name, value| {
            let mut item = value["items"][0].clone();
            item["instances"] = many(&value["items"][0]["instances"][0], 10_000);
            item["count"] = json!(4_000_000_000_u32);
            name.ends_with("list").then(|| json!({"items": [item]}).to_string())
        }),
        ("many entries", &|name, value| {
            name.ends_with("inspect").then(|| json!({"objects": many(&value["objects"][0], 10_000)}).to_string())
        }),
        ("endless", &|name, value| {
            if name.ends_with("review_1") || name.starts_with('4') {
                return Some(deep.clone());
            }
            let long = "very ".repeat(400_000);
            Some(with_texts(value, "", &|key, _| (key != "id").then(|| long.clone())).to_string())
        }),
    ];
    for (case, change) in cases {
        let recording = Recording::changed(change);
        let clock = std::time::Instant::now();
        let output = recording.replay("furniture");
        assert_eq!(output.status.code(), Some(0), "{case}: {}", said(&output));
        let scene = recording.sound();
        assert!(scene["objects"].as_array().unwrap().len() <= 400, "{case}");
        assert!(clock.elapsed().as_secs() < 120, "{case}: {:?}", clock.elapsed());
        let size = fs::metadata(recording.run().join("scene.json")).unwrap().len();
        assert!(size < 4 << 20, "{case}: scene.json has {size} bytes");
    }
}

#[test]
fn names_that_are_paths_or_markup_stay_words() {
    let hostile =
        ["../../../evil", "/etc/passwd", "..", "a\u{0}b", "<script>alert(1)</script>", "con\\..\\x", "\u{202e}kcab"];
    let recording = Recording::changed(|name, value| {
        let text = |key: &str, old: &str| {
            let free = matches!(
                key,
                "type"
                    | "gdino"
                    | "description"
                    | "room_type"
                    | "surface"
                    | "scene_summary"
                    | "reason"
                    | "facing"
                    | "label"
                    | "summary"
                    | "material"
                    | "color"
                    | "differences"
                    | "group"
                    | "matched_set"
                    | "template"
            );
            free.then(|| hostile[(old.len() + name.len()) % hostile.len()].to_owned())
        };
        Some(with_texts(value, "", &text).to_string())
    });
    let output = recording.replay("lighting");
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let scene = recording.sound();
    assert!(!scene["objects"].as_array().unwrap().is_empty(), "the boxes were sane: {}", scene["warnings"]);
    let page = fs::read_to_string(recording.run().join("report.html")).unwrap();
    assert!(!page.contains("<script>alert(1)"), "a label came into the report as markup");
    for line in String::from_utf8_lossy(&harmony(&["show", recording.run().to_str().unwrap()]).stdout).lines() {
        assert!(line.chars().all(|c| !c.is_control()), "{line:?}");
    }
}

#[test]
fn a_recording_that_is_none_is_refused_with_a_hint() {
    let recording = Recording::changed(|_, _| None);
    let manifest = recording.folder.path().join("recording/recording.json");
    for text in ["", "{}", "[1]", r#"{"version": 99, "label": "x", "made_by": "y", "license": "z"}"#] {
        fs::write(&manifest, text).unwrap();
        let output = program()
            .args(["reconstruct", "examples/home_office.jpg", "--replay"])
            .arg(recording.folder.path().join("recording"))
            .arg("--out")
            .arg(recording.run())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1), "{text:?}");
        assert!(said(&output).contains("hint: ") && said(&output).contains("not a recording"), "{}", said(&output));
    }
}

#[test]
fn a_damaged_run_folder_is_made_whole_by_the_same_command() {
    let recording = Recording::changed(|_, _| None);
    let first = recording.replay("wall");
    assert_eq!(first.status.code(), Some(0), "{}", said(&first));
    let run = recording.run();
    let wanted = timeless(&run);
    let inside = |folder: &str, wanted: &str| -> PathBuf {
        let mut found: Vec<PathBuf> = common::files(&run.join(folder))
            .into_keys()
            .filter(|p| p.to_str().unwrap().ends_with(wanted))
            .map(|p| Path::new(folder).join(p))
            .collect();
        found.sort();
        found.first().unwrap_or_else(|| panic!("no {wanted} in {folder}")).clone()
    };
    let remove = |path: &Path| fs::remove_file(path).unwrap();
    let halve = |path: &Path| {
        let bytes = fs::read(path).unwrap();
        fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    };
    let spoil = |path: &Path| fs::write(path, b"{\"not\": \"what it was\"}").unwrap();
    let damages: [(PathBuf, Damage<'_>); 12] = [
        ("scene.json".into(), &remove),
        ("scene_full.glb".into(), &halve),
        ("run.json".into(), &halve),
        ("run.json".into(), &spoil),
        (inside("2_wall", ".glb"), &remove),
        (inside("1_layout", "room.json"), &spoil),
        (inside("calls/vision_language", "answer.json"), &halve),
        (inside("calls/vision_language", "record.json"), &remove),
        (inside("calls/segmenter", "record.json"), &halve),
        (inside("calls/segmenter", ".png"), &halve),
        (inside("calls/mesh_generator", "answer.glb"), &spoil),
        (inside("calls/mesh_generator", "answer.json"), &spoil),
    ];
    for (file, damage) in damages {
        damage(&run.join(&file));
        if file.starts_with("scene.json") || file.starts_with("scene_full.glb") {
            let output = harmony(&["render", run.to_str().unwrap(), "--size", "64"]);
            assert_eq!(output.status.code(), Some(1), "render without {}", file.display());
            assert!(said(&output).contains("error: ") && !said(&output).contains("panicked"), "{}", said(&output));
        }
        let output = recording.replay("wall");
        assert_eq!(output.status.code(), Some(0), "{}: {}", file.display(), said(&output));
        let mut found = timeless(&run);
        let mut wanted = wanted.clone();
        if file.starts_with("calls") {
            // A call whose record was damaged is made again, and says so: the answers are the same, the warnings not.
            let told = |path: &PathBuf| {
                path.ends_with("record.json")
                    || ["scene.json", "report.html", "run.json"].iter().any(|f| path.ends_with(f))
            };
            found.retain(|path, _| !told(path));
            wanted.retain(|path, _| !told(path));
        }
        common::assert_same(&found, &wanted, &format!("after damage to {}", file.display()));
    }
}

#[test]
fn a_run_that_is_damaged_or_unfinished_is_shown_for_what_it_is() {
    let recording = Recording::changed(|_, _| None);
    recording.replay("layout");
    let run = recording.run();
    let path = run.to_str().unwrap();
    assert_eq!(harmony(&["show", path]).status.code(), Some(3), "five phases were not run");
    fs::write(run.join("scene.json"), "{\"version\": 1}").unwrap();
    assert_eq!(harmony(&["show", path]).status.code(), Some(3));
    let render = harmony(&["render", path]);
    assert_eq!(render.status.code(), Some(1));
    assert!(said(&render).contains("no scene yet"), "{}", said(&render));
    fs::write(run.join("run.json"), "[]").unwrap();
    let show = harmony(&["show", path]);
    assert_eq!(show.status.code(), Some(1));
    assert!(said(&show).contains("run.json"), "{}", said(&show));
}
