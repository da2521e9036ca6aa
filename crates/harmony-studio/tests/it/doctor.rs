//! `harmony doctor` asks each player with one call that costs nothing, and says what is missing.

use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use harmony_bench::oracle::NoiseLevel;
use harmony_studio::services::Service;
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{KEY, Studio, StudioOptions, rooms};
use serde_json::Value;

/// A key that no service accepts.
const WRONG: &str = "wrong-key-4711-that-opens-nothing";

/// Role, player, further settings, who plays it, the variable of its key.
const SERVICES: [(&str, &str, &str, Service, &str); 19] = [
    ("vision_language", "openai", "", Service::OpenAi, "OPENAI_API_KEY"),
    ("vision_language", "openai_chat", "", Service::OpenAi, "OPENAI_API_KEY"),
    ("vision_language", "gemini", "", Service::Gemini, "GEMINI_API_KEY"),
    ("vision_language", "anthropic", "model = \"some-claude\"", Service::Anthropic, "ANTHROPIC_API_KEY"),
    ("vision_language", "compatible", "", Service::Vllm, ""),
    ("vision_language", "compatible", "", Service::LlamaCpp, ""),
    ("image_editor", "gemini", "", Service::Gemini, "GEMINI_API_KEY"),
    ("image_editor", "openai", "", Service::OpenAi, "OPENAI_API_KEY"),
    ("image_editor", "local_edits", "", Service::SdServer, ""),
    ("mesh_generator", "hunyuan3d_2", "", Service::Hunyuan2, ""),
    ("mesh_generator", "hunyuan3d_2_1", "", Service::Hunyuan21, ""),
    ("mesh_generator", "trellis_nim", "", Service::TrellisNim, ""),
    ("mesh_generator", "trellis_localai", "model = \"trellis\"", Service::TrellisLocalAi, ""),
    ("mesh_generator", "fal", "", Service::Fal, "FAL_KEY"),
    ("mesh_generator", "replicate", "", Service::Replicate, "REPLICATE_API_TOKEN"),
    ("mesh_generator", "tripo", "", Service::Tripo, "TRIPO_API_KEY"),
    ("mesh_generator", "meshy", "", Service::Meshy, "MESHY_API_KEY"),
    ("detector", "locate_anything", "", Service::LocateAnything, ""),
    ("detector", "grounding_dino", "", Service::GroundingDino, ""),
];

const ROLES: [&str; 4] = ["vision_language", "image_editor", "mesh_generator", "detector"];

/// A configuration with one player; this program plays the other roles.
fn config(file: &Path, role: &str, section: &str) -> String {
    let mut text = String::from("profile = \"paper\"\n");
    for other in ROLES {
        let own = if other == role { section } else { "player = \"offline\"\n" };
        text.extend([format!("[players.{other}]\n{own}\n")]);
    }
    std::fs::write(file, text).unwrap();
    file.to_str().unwrap().to_owned()
}

/// What the doctor says, with a key in all variables.
async fn doctor(config: String, key: Option<&str>) -> (Output, Vec<Value>) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_harmony-studio"));
    command.args(["harmony", "doctor", "--json", "--config", &config]).env_remove("RUST_LOG");
    command.env("HARMONY_MODELS", std::env::temp_dir().join("harmony-studio-no-models"));
    for name in SERVICES.iter().map(|(.., variable)| *variable).filter(|variable| !variable.is_empty()) {
        match key {
            Some(key) => command.env(name, key),
            None => command.env_remove(name),
        };
    }
    let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"));
    let players = report["players"].as_array().unwrap_or_else(|| panic!("no players: {said}")).clone();
    assert!(!said.contains(KEY) && !said.contains(WRONG), "a key is told: {said}");
    (output, players)
}

/// The line of a player that is not this program.
fn line<'a>(report: &'a [Value], role: &str, player: &str) -> &'a Value {
    let own = |status: &&Value| {
        status["role"] == role && status["player"]["player"].as_str().is_some_and(|name| name.starts_with(player))
    };
    report.iter().find(own).unwrap_or_else(|| panic!("nothing is said of {player}: {report:#?}"))
}

#[tokio::test(flavor = "multi_thread")]
async fn each_service_is_asked_and_what_is_missing_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let room = rooms::small(folder.path()).unwrap();
    let truth_oracle = Arc::new(TruthOracle::new(room, NoiseLevel::Clean.noise(), 1, false).unwrap());
    let file = folder.path().join("harmony.toml");
    for (role, player, more, service, variable) in SERVICES {
        let studio = Studio::start(Arc::clone(&truth_oracle), StudioOptions::default(), 0).await.unwrap();
        let section = format!("player = \"{player}\"\naddress = \"{}\"\n{more}", studio.base(service));
        let config = || config(&file, role, &section);
        let name = format!("{role}, {player}");

        let (output, report) = doctor(config(), Some(KEY)).await;
        let status = line(&report, role, player);
        assert_eq!((status["available"].as_bool(), output.status.code()), (Some(true), Some(0)), "{name}: {status}");
        // A zero-shot detector has no other route than the one that finds boxes; without a key it costs nothing.
        let entries = studio.ledger.entries();
        let works = usize::from(service == Service::GroundingDino);
        assert_eq!(entries.len(), works, "{name}: {entries:?}");

        if !variable.is_empty() {
            let (output, report) = doctor(config(), Some(WRONG)).await;
            let status = line(&report, role, player);
            assert_eq!((status["available"].as_bool(), output.status.code()), (Some(false), Some(1)), "{name}");
            assert!(status["hint"].as_str().unwrap().contains(variable), "{name}: {status}");
            let (output, report) = doctor(config(), None).await;
            let status = line(&report, role, player);
            assert_eq!((status["available"].as_bool(), output.status.code()), (Some(false), Some(1)), "{name}");
            assert!(status["hint"].as_str().unwrap().contains(variable), "{name}: {status}");
        }

        drop(studio);
        let (output, report) = doctor(config(), Some(KEY)).await;
        let status = line(&report, role, player);
        assert_eq!((status["available"].as_bool(), output.status.code()), (Some(false), Some(1)), "{name}: {status}");
        assert!(status["hint"].as_str().is_some_and(|hint| !hint.is_empty()), "{name}: {status}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn players_without_a_service_of_their_own_are_told_of_too() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("harmony.toml");
    let meshes = folder.path().join("meshes");
    std::fs::create_dir(&meshes).unwrap();
    for player in ["folder", "catalogue"] {
        let section = format!("player = \"{player}\"\npath = {:?}\n", meshes.to_str().unwrap());
        let (output, report) = doctor(config(&file, "mesh_generator", &section), None).await;
        let found = report.iter().find(|s| s["role"] == "mesh_generator" && s["player"]["offline"] == false).unwrap();
        let there = found["available"].as_bool().unwrap();
        assert_eq!(output.status.code(), Some(i32::from(!there)), "{found}");
        // An empty folder has no index, and no mesh either.
        assert!(!there && !found["hint"].as_str().unwrap().is_empty(), "{player}: {found}");
    }
    let ball = harmony_studio::glb::plain(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]]);
    std::fs::write(meshes.join("chair.glb"), ball).unwrap();
    std::fs::write(
        meshes.join("index.json"),
        r#"{"models": [{"file": "chair.glb", "category": "chair", "width": 0.5, "height": 0.9, "depth": 0.5}]}"#,
    )
    .unwrap();
    for (player, detail) in [("folder", "mesh folder"), ("catalogue", "catalogue")] {
        let section = format!("player = \"{player}\"\npath = {:?}\n", meshes.to_str().unwrap());
        let (output, report) = doctor(config(&file, "mesh_generator", &section), None).await;
        let status = line(&report, "mesh_generator", detail);
        assert_eq!((status["available"].as_bool(), output.status.code()), (Some(true), Some(0)), "{player}: {status}");
    }
}
