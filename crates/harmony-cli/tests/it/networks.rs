//! Networks inside the program: weights that are absent, wrong or random must end in words or in a finished run.
#![cfg(feature = "nets")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::{self, drawn, program, root, said};
use harmony_scene::Scene;
use serde_json::{Map, Value, json};

/// Nobody outside plays: only the networks are looked at.
const ALONE: &str = "\
profile = \"local\"
[players.vision_language]\nplayer = \"offline\"\n[players.image_editor]\nplayer = \"offline\"
[players.mesh_generator]\nplayer = \"offline\"\n[players.detector]\nplayer = \"offline\"\n";

struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new(settings: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("harmony.toml"), format!("{ALONE}{settings}")).unwrap();
        drawn::empty_room(320, 240).save(folder.path().join("photo.png")).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn harmony(&self, args: &[&str]) -> Output {
        let models = self.path("models");
        program().args(args).env("HARMONY_MODELS", models).env_remove("HF_TOKEN").output().unwrap()
    }

    fn reconstruct(&self) -> Output {
        let [photo, run, config] = ["photo.png", "run", "harmony.toml"].map(|n| self.path(n).display().to_string());
        self.harmony(&["reconstruct", &photo, "--out", &run, "--config", &config, "--no-lit"])
    }

    fn scene(&self) -> Scene {
        serde_json::from_slice(&std::fs::read(self.path("run/scene.json")).unwrap()).unwrap()
    }
}

/// `u` in -1..1 by a hash of key and index.
fn uniform(key: &str, i: u64) -> f32 {
    let mut x = key.bytes().fold(i ^ 0x7ea, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    x ^= x >> 33;
    x = x.wrapping_mul(0xff51_afd7_ed55_8ccd);
    x ^= x >> 33;
    (x >> 40) as f32 / (1 << 23) as f32 - 1.0
}

/// Random weights of a small VGGT, in the published key layout; `change` may spoil a shape.
fn small_vggt(path: &Path, change: impl Fn(&str, &mut Vec<u64>)) {
    let keys = root().join("crates/harmony-nets/tests/parity/vggt_small.json");
    let keys: Map<String, Value> = serde_json::from_slice(&std::fs::read(keys).unwrap()).unwrap();
    let (mut header, mut data) = (Map::new(), Vec::<u8>::new());
    for (key, shape) in &keys {
        let mut shape: Vec<u64> = serde_json::from_value(shape.clone()).unwrap();
        change(key, &mut shape);
        let (count, inputs) = (shape.iter().product::<u64>(), shape.iter().skip(1).product::<u64>().max(1));
        let (offset, factor) = match key.rsplit('.').next() {
            Some("gamma") => (0.2, 0.1),
            Some("bias") => (0.0, 0.1),
            Some("weight") if shape.len() == 1 => (1.0, 0.2),
            Some("weight") => (0.0, (3.0 / inputs as f32).sqrt()),
            _ => (0.0, 0.5),
        };
        let start = data.len();
        data.extend((0..count).flat_map(|i| (offset + factor * uniform(key, i)).to_le_bytes()));
        header.insert(key.clone(), json!({ "dtype": "F32", "shape": shape, "data_offsets": [start, data.len()] }));
    }
    let header = serde_json::to_vec(&header).unwrap();
    let mut file = std::fs::File::create(path).unwrap();
    for part in [&(header.len() as u64).to_le_bytes()[..], &header, &data] {
        file.write_all(part).unwrap();
    }
}

fn own_vggt(path: &Path) -> String {
    format!(
        "[players.geometry_estimator]\nplayer = \"vggt\"\nweights = {:?}\ndevice = \"cpu\"\n",
        path.display().to_string()
    )
}

#[test]
fn a_run_with_random_weights_ends_cleanly_and_says_what_it_thinks_of_them() {
    let weights = tempfile::tempdir().unwrap();
    let file = weights.path().join("random.safetensors");
    small_vggt(&file, |_, _| {});
    let case = Case::new(&own_vggt(&file));
    let output = case.reconstruct();
    assert!(output.status.success(), "{}", said(&output));
    let scene = case.scene();
    assert!(scene.room.extents.width.is_finite() && scene.room.extents.height > 1.0, "{:?}", scene.room.extents);
    // The network was asked and recorded, and its nonsense was told as such.
    let asked = common::files(&case.path("run/calls/geometry_estimator"));
    let text: String = asked.values().map(|bytes| String::from_utf8_lossy(bytes)).collect();
    assert!(text.contains("random.safetensors"), "no record names the weights: {:?}", asked.keys().collect::<Vec<_>>());
    let told: Vec<&str> = scene.warnings.iter().map(|w| w.message.as_str()).collect();
    let doubts = ["vggt", "point map", "depth", "calibrat", "inlier", "axes", "scale"];
    assert!(told.iter().any(|t| doubts.iter().any(|d| t.to_lowercase().contains(d))), "{told:#?}");
}

#[test]
fn a_shape_that_does_not_fit_is_told_before_anything_is_run() {
    let weights = tempfile::tempdir().unwrap();
    let file = weights.path().join("spoilt.safetensors");
    small_vggt(&file, |key, shape| {
        if key == "camera_head.token_norm.bias" {
            shape[0] += 1;
        }
    });
    let case = Case::new(&own_vggt(&file));
    let output = case.reconstruct();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let text = said(&output);
    for word in ["camera_head.token_norm.bias", "[129]", "[128]", "spoilt.safetensors", "hint"] {
        assert!(text.contains(word), "{word} is not in: {text}");
    }
    assert!(!case.path("run/scene.json").exists());
}

#[test]
fn without_weights_the_offline_players_play_and_it_is_said() {
    let case = Case::new("");
    let output = case.reconstruct();
    assert!(output.status.success(), "{}", said(&output));
    let told: Vec<String> = case.scene().warnings.into_iter().map(|w| w.message).collect();
    for (role, name) in [("geometry_estimator", "vggt-1b"), ("segmenter", "sam2.1-large")] {
        let found = told.iter().any(|t| t.starts_with(role) && t.contains("no weights in") && t.contains(name));
        assert!(found, "{role}: {told:#?}");
    }
    assert!(!told.iter().any(|t| t.starts_with("detector")), "another one was named: {told:#?}");
}

#[test]
fn weights_that_are_named_and_missing_end_the_command() {
    let case = Case::new("[players.segmenter]\nplayer = \"sam2\"\nmodel = \"sam2.1-tiny\"\n");
    let output = case.reconstruct();
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("harmony models pull sam2.1-tiny"), "{}", said(&output));
}

#[test]
fn weights_of_another_length_are_told_and_not_used() {
    let case = Case::new("");
    std::fs::create_dir_all(case.path("models/sam2.1-tiny")).unwrap();
    std::fs::write(case.path("models/sam2.1-tiny/sam2.1_hiera_tiny.pt"), b"PK\x03\x04 cut off").unwrap();
    let output = case.reconstruct();
    assert!(output.status.success(), "{}", said(&output));
    let told: Vec<String> = case.scene().warnings.into_iter().map(|w| w.message).collect();
    assert!(told.iter().any(|t| t.contains("has 12 bytes, wanted 156008466")), "{told:#?}");
    let output = case.harmony(&["models", "verify"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1));
    assert!(text.contains("CUT OFF") && text.contains("has 12 bytes, wanted 156008466"), "{text}");
}

#[test]
fn the_list_tells_terms_and_pins() {
    let case = Case::new("");
    let output = case.harmony(&["models", "list"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for words in [
        "NON-COMMERCIAL USE ONLY",
        "not accepted: --accept-licence cc-by-nc-4.0",
        "checksum not known: pinned at the first pull",
        "at 860abec7937d",
        "not here",
    ] {
        assert!(text.contains(words), "{words} is not in {text}");
    }
    let json = case.harmony(&["models", "list", "--json"]).stdout;
    let json: Value = serde_json::from_slice(&json).unwrap();
    assert!(json["models"].as_array().unwrap().iter().any(|m| m["licence"]["non_commercial"] == true));
}

#[test]
fn a_licence_is_asked_for_before_anything_is_fetched() {
    let case = Case::new("");
    // No terminal here, so nobody can say yes; and no hub either, should it ask all the same.
    let output = program()
        .args(["models", "pull", "vggt-1b", "--local-only"])
        .env("HARMONY_MODELS", case.path("models"))
        .env("HARMONY_HUB", "http://127.0.0.1:9")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let text = said(&output);
    assert!(text.contains("NON-COMMERCIAL") && text.contains("--accept-licence cc-by-nc-4.0"), "{text}");
    assert!(!case.path("models/vggt-1b").exists());
    let output = case.harmony(&["models", "pull", "vggt"]);
    assert!(said(&output).contains("sam2.1-base-plus"), "{}", said(&output));
}

#[test]
fn the_doctor_tells_of_devices_weights_and_times() {
    let case = Case::new("");
    let config = case.path("harmony.toml").display().to_string();
    let output = case.harmony(&["doctor", "--config", &config]);
    assert!(output.status.success(), "{}", said(&output));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for words in ["GFLOP/s", "no GPU", "no weights there", "ESTIMATE", "vggt-1b", "geometry_estimator: no network"] {
        assert!(text.contains(words), "{words} is not in {text}");
    }

    // The same for programs.
    let output = case.harmony(&["doctor", "--json", "--config", &config]);
    assert!(output.status.success(), "{}", said(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let roles = report["players"].as_array().unwrap();
    assert!(roles.iter().any(|p| p["role"] == "geometry_estimator" && p["available"] == true), "{report}");
    assert!(report["notes"].as_array().unwrap().iter().any(|n| n.as_str().unwrap().contains("geometry_estimator")));
    let networks = &report["networks"];
    assert!(networks["devices"][0]["operations_per_s"].as_f64().unwrap() > 1e6, "{report}");
    assert_eq!(networks["devices"][1]["name"], "no GPU");
    assert!(networks["devices"][1]["problem"].is_string(), "{report}");
    assert_eq!(networks["folder"], case.path("models").display().to_string());
    assert_eq!(networks["weights"], serde_json::json!([]));
    let expected = networks["expected"].as_array().unwrap();
    let vggt = expected.iter().find(|e| e["model"] == "vggt-1b").unwrap();
    assert!(vggt["seconds"].as_f64().unwrap() > 0.0 && vggt["here"] == false, "{report}");
}
