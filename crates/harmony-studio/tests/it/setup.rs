//! `harmony setup` finds servers and keys, writes a configuration that plays, and changes only what changed.

use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use harmony_bench::oracle::NoiseLevel;
use harmony_studio::services::Service;
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{KEY, Studio, StudioOptions, rooms};
use serde_json::Value;

/// The program with these arguments and keys in its environment, in a folder of its own.
async fn setup(folder: &Path, args: &[&str], keys: &[(&'static str, &'static str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_harmony-studio"));
    command.args(["harmony", "setup", "--no-ports"]).args(args).current_dir(folder);
    command.env("NO_COLOR", "1").env_remove("RUST_LOG").stdin(std::process::Stdio::null());
    command.env("HARMONY_MODELS", folder.join("no-models"));
    for (variable, ..) in harmony_cli::survey::KEYS {
        command.env_remove(variable);
    }
    command.envs(keys.iter().copied());
    tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap()
}

fn said(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(!said.contains(KEY), "a key is told: {said}");
    said
}

fn report(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", said(output)))
}

async fn studio(folder: &Path) -> Studio {
    let room = rooms::small(folder).unwrap();
    let truth_oracle = Arc::new(TruthOracle::new(room, NoiseLevel::Clean.noise(), 1, false).unwrap());
    Studio::start(truth_oracle, StudioOptions::default(), 0).await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn servers_are_recognised_and_the_local_profile_is_written_and_plays() {
    let work = tempfile::tempdir().unwrap();
    let studio = studio(work.path()).await;
    let base = |service: Service| studio.base(service).trim_end_matches("/v1").to_owned();
    let servers = [Service::Vllm, Service::SdServer, Service::Hunyuan2].map(base);
    let mut args: Vec<&str> = servers.iter().flat_map(|server| ["--server", server]).collect();
    args.push("--yes");
    let output = setup(work.path(), &args, &[]).await;
    let text = said(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    for word in ["vLLM", "sd-server", "Hunyuan3D-2", "profile local", "Trying each player once", "harmony reconstruct"]
    {
        assert!(text.contains(word), "{word}: {text}");
    }
    let file = std::fs::read_to_string(work.path().join("harmony.toml")).unwrap();
    for server in &servers {
        assert!(file.contains(server.as_str()), "{server}: {file}");
    }
    // Nothing was paid.
    assert!(studio.ledger.entries().is_empty());
    // Again: found through the file, nothing to change.
    let again = setup(work.path(), &["--yes"], &[]).await;
    assert!(said(&again).contains("nothing is changed"), "{}", said(&again));
    assert_eq!(std::fs::read_to_string(work.path().join("harmony.toml")).unwrap(), file);
    drop(studio);
    // The servers are gone: it is said, with what to do; the file stays.
    let gone = setup(work.path(), &["--yes"], &[]).await;
    assert_eq!(gone.status.code(), Some(1), "{}", said(&gone));
    assert!(said(&gone).contains("missing: no such server answers: start"), "{}", said(&gone));
    assert_eq!(std::fs::read_to_string(work.path().join("harmony.toml")).unwrap(), file);
}

#[tokio::test(flavor = "multi_thread")]
async fn keys_make_the_hosted_profile_and_wrong_ones_are_said() {
    let work = tempfile::tempdir().unwrap();
    let studio = studio(work.path()).await;
    // A user's file with other addresses: services are the studio's.
    let own = format!(
        "# mine\n[players.vision_language]\naddress = \"{0}\"\n[players.image_editor]\naddress = \"{0}\"\n\
         [players.mesh_generator]\naddress = \"{1}\"\n[budget]\nusd = 3.0\n",
        studio.base(Service::Gemini),
        studio.base(Service::Fal)
    );
    let file = work.path().join("harmony.toml");
    let keys = [("GEMINI_API_KEY", KEY), ("FAL_KEY", KEY)];
    for (keys, code) in [(keys, 0), ([("GEMINI_API_KEY", "wrong-key-4711"), ("FAL_KEY", KEY)], 1)] {
        std::fs::write(&file, &own).unwrap();
        let output = setup(work.path(), &["--yes"], &keys).await;
        let text = said(&output);
        assert_eq!(output.status.code(), Some(code), "{text}");
        assert!(text.contains("profile hosted") && text.contains("US$"), "{text}");
        // Gemini says it with status 400.
        assert_eq!(text.contains("API key not valid") && text.contains("check GEMINI_API_KEY"), code == 1, "{text}");
        let written = std::fs::read_to_string(&file).unwrap();
        assert!(written.contains("# mine") && written.contains("usd = 3.0"), "{written}");
        assert!(written.contains("player = \"fal\"") && !written.contains(KEY), "{written}");
    }
    assert!(studio.ledger.entries().is_empty(), "trying costs nothing");
}

#[tokio::test(flavor = "multi_thread")]
async fn showing_writes_nothing_and_wishes_are_kept() {
    let work = tempfile::tempdir().unwrap();
    let output = setup(work.path(), &["--show", "--json", "--meshes", "meshy"], &[("MESHY_API_KEY", KEY)]).await;
    let found = report(&output);
    assert_eq!((found["profile"].as_str(), found["written"].as_bool()), (Some("hosted"), Some(false)));
    assert!(found["text"].as_str().unwrap().contains("player = \"meshy\""));
    assert!(found["cost"]["unpriced"].to_string().contains("mesh_generator"), "credits have no price: {found}");
    assert!(!work.path().join("harmony.toml").exists());

    let missing = setup(work.path(), &["--show", "--json", "--language", "gemini"], &[]).await;
    assert!(report(&missing)["missing"][0].as_str().unwrap().contains("export GEMINI_API_KEY"));
    let wrong = setup(work.path(), &["--language", "gpt"], &[]).await;
    assert_eq!(wrong.status.code(), Some(2));
    assert!(said(&wrong).contains("openai_chat"), "{}", said(&wrong));

    // What is there and does not fit is told of and not touched.
    std::fs::write(work.path().join("harmony.toml"), "profil = 1\n").unwrap();
    let broken = setup(work.path(), &["--yes"], &[]).await;
    assert_eq!(broken.status.code(), Some(1));
    assert!(said(&broken).contains("profil") && said(&broken).contains("line 1"), "{}", said(&broken));
    assert_eq!(std::fs::read_to_string(work.path().join("harmony.toml")).unwrap(), "profil = 1\n");
}

#[tokio::test(flavor = "multi_thread")]
async fn with_nothing_at_all_this_program_plays_alone() {
    let work = tempfile::tempdir().unwrap();
    let output = setup(work.path(), &["--yes"], &[]).await;
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let file = std::fs::read_to_string(work.path().join("harmony.toml")).unwrap();
    assert!(file.contains("profile = \"offline\""), "{file}");
    assert!(said(&output).contains("no keys in the environment"), "{}", said(&output));
}
