//! The profiles with all their services on loopback end in the scene of the truth inside the process.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;

use harmony_bench::oracle::NoiseLevel;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls};
use harmony_cli::cast::{CastRequest, cast};
use harmony_cli::config::{Profile as CliProfile, parse};
use harmony_pipeline::{Phase, RunRequest, Warnings};
use harmony_scene::{ImageSize, Scene};
use harmony_studio::profile::{Profile, config};
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{KEY, Studio, StudioOptions, players, rooms};

/// Seed of the room: four levels, some objects partly hidden.
const ROOM: u64 = 11;

/// Settings under which a run takes seconds; placement is whole.
const SETTINGS: &str = "\n[settings]\nworking_px = 480\nsurface_px_per_m = 40.0\n[settings.mesh]\nfaces = 4000\n";

/// What the way over HTTP may change in a position, metres, and in a yaw, degrees.
///
/// Boxes come in thousandths of the picture, half a pixel here, without scores; reviews read positions to the
/// centimetre and sizes to the centimetre, and move by what they read. Everything else travels exactly: JSON numbers,
/// meshes in 32-bit floats, pictures as PNG.
const POSITION_M: f64 = 0.015;
const YAW_DEG: f64 = 1.0;
/// And in the sides of a box, relative.
const SIZE: f64 = 0.02;

struct Room {
    _folder: tempfile::TempDir,
    at: PathBuf,
    truth_oracle: Arc<TruthOracle>,
}

fn room(level: NoiseLevel) -> Room {
    let folder = tempfile::tempdir().unwrap();
    let truth = rooms::make(ROOM, ImageSize::new(480, 360), 9, folder.path()).unwrap();
    let at = truth.folder.clone();
    Room { truth_oracle: Arc::new(TruthOracle::new(truth, level.noise(), 7, false).unwrap()), _folder: folder, at }
}

fn intrinsics(room: &Room) -> String {
    let k = room.truth_oracle.room().camera.intrinsics;
    format!("{},{},{},{}", k.fx, k.fy, k.cx, k.cy)
}

/// The program in a process of its own, with keys in its environment only.
async fn harmony(args: Vec<String>, keys: bool) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_harmony-studio"));
    command.arg("harmony").args(args).env("NO_COLOR", "1").env_remove("RUST_LOG");
    // Weights that this machine may have would play too.
    command.env("HARMONY_MODELS", std::env::temp_dir().join("harmony-studio-no-models"));
    for name in ["OPENAI_API_KEY", "GEMINI_API_KEY", "FAL_KEY"] {
        if keys {
            command.env(name, KEY)
        } else {
            command.env_remove(name)
        };
    }
    tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap()
}

fn reconstruct(room: &Room, config: &Path, out: &Path) -> Vec<String> {
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    vec![
        "reconstruct".into(),
        text(&room.at.join("photo.jpg")),
        "--out".into(),
        text(out),
        "--config".into(),
        text(config),
        "--points".into(),
        text(&room.at.join("depth.png")),
        "--intrinsics".into(),
        intrinsics(room),
        "--masks".into(),
        text(&room.at.join("instances.png")),
        "--no-lit".into(),
    ]
}

fn scene(run: &Path) -> Scene {
    serde_json::from_slice(&std::fs::read(run.join("scene.json")).unwrap()).unwrap()
}

/// The same run with the truth as players inside this process, answering from the calls' own facts.
async fn inside(room: &Room, out: &Path) -> Scene {
    let photo = harmony_io::load_photo(&room.at.join("photo.jpg")).unwrap();
    let file = parse(SETTINGS).unwrap();
    let (points, masks, k) = (room.at.join("depth.png"), room.at.join("instances.png"), intrinsics(room));
    let casting = cast(&CastRequest {
        profile: CliProfile::Offline,
        players: file.players.resolved(CliProfile::Offline),
        models: harmony_models::Store::new(room.at.join("no_models")),
        photo_size: photo.size(),
        points: Some(&points),
        intrinsics: Some(&k),
        depth_scale: 1000.0,
        masks: Some(&masks),
        questions: PathBuf::from("questions"),
        tasks: None,
        timeout_minutes: 0.0,
        path_tracer: false,
        working_px: file.settings.working_px,
        tell: Arc::new(|_| {}),
    })
    .unwrap();
    let mut players = players::inside(&room.truth_oracle, &casting.offline);
    players.geometry_estimator = Arc::clone(&casting.cast.geometry_estimator);
    players.segmenter = Arc::clone(&casting.cast.segmenter);
    std::fs::create_dir_all(out).unwrap();
    let warnings = Arc::new(Warnings::default());
    let book = Arc::new(CallBook::open(out, BookOptions::default()).unwrap());
    let calls = Calls::new(book, players, casting.offline, CallOptions::default());
    let request = RunRequest {
        photo,
        title: "inside".into(),
        run: out.to_owned(),
        profile: "inside".into(),
        settings: file.settings,
        until: Phase::Lighting,
        path_tracer: false,
        further_inputs: String::new(),
    };
    let silent: harmony_pipeline::ProgressSink = Arc::new(|_| {});
    let outcome = Box::pin(harmony_pipeline::run(&request, &calls, &warnings, &silent)).await.unwrap();
    assert_eq!(outcome.failure, None);
    scene(out)
}

/// Every object of one scene is in the other: same id, same place.
fn same(over_http: &Scene, inside: &Scene) {
    let ids = |scene: &Scene| scene.objects.iter().map(|o| o.id.to_string()).collect::<Vec<_>>();
    assert_eq!(ids(over_http), ids(inside));
    let (a, b) = (over_http.room.extents, inside.room.extents);
    assert!((a.as_vec() - b.as_vec()).length() < 1e-9, "the layout is exact: {a:?} {b:?}");
    let mut worst = (0.0_f64, 0.0_f64, 0.0_f64);
    for (a, b) in over_http.objects.iter().zip(&inside.objects) {
        let off = (a.pose.position - b.pose.position).length();
        let turn = (a.pose.yaw - b.pose.yaw).to_degrees().rem_euclid(360.0);
        let turn = turn.min(360.0 - turn);
        let ratio = (a.size.as_vec() / b.size.as_vec()).to_array().map(|r| (r - 1.0).abs());
        let ratio = ratio.into_iter().fold(0.0, f64::max);
        worst = (worst.0.max(off), worst.1.max(turn), worst.2.max(ratio));
        assert!(off <= POSITION_M, "{}: {off} m", a.id);
        assert!(turn <= YAW_DEG, "{}: {turn} degrees", a.id);
        assert!(ratio <= SIZE, "{}: {ratio}", a.id);
        assert_eq!(a.support, b.support, "{}", a.id);
    }
    eprintln!(
        "{} objects; worst {:.4} m, {:.3} degrees, {:.4} of a size",
        ids(inside).len(),
        worst.0,
        worst.1,
        worst.2
    );
}

async fn as_inside(profile: Profile, level: NoiseLevel) {
    let work = tempfile::tempdir().unwrap();
    let (room, again) = (room(level), room(level));
    let wanted = inside(&again, &work.path().join("inside")).await;
    assert!(wanted.objects.len() >= 4, "{} objects are no proof", wanted.objects.len());

    let studio = Studio::start(Arc::clone(&room.truth_oracle), StudioOptions::default(), 0).await.unwrap();
    let file = work.path().join("harmony.toml");
    std::fs::write(&file, config(&studio, profile) + SETTINGS).unwrap();
    let run = work.path().join("run");
    let output = harmony(reconstruct(&room, &file, &run), true).await;
    let said = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    let entries = studio.ledger.entries();
    let refused: Vec<_> = entries.iter().filter(|e| e.status != 200).collect();
    assert!(refused.is_empty(), "{refused:?}\n{said}");
    assert_eq!(studio.ledger.paid_twice(), []);
    let parts: std::collections::BTreeSet<_> = entries.iter().map(|e| e.part).collect();
    let wanted_parts = if profile == Profile::Paper { 4 } else { 3 };
    assert_eq!(parts.len(), wanted_parts, "every service was asked: {parts:?}");
    let found = scene(&run);
    let stood_in: Vec<_> =
        found.warnings.iter().filter(|w| w.kind == harmony_scene::WarningKind::PlayerReplaced).collect();
    assert!(stood_in.is_empty(), "{stood_in:?}");
    same(&found, &wanted);
    // The room was emptied in the layout phase, and its faces were completed beside the levels.
    let drawn = |name: &str| run.join("calls/image_editor/1_layout").join(name).join("answer.png").is_file();
    assert!(drawn("empty_room") && drawn("surface_floor"), "{said}");
    assert!(!run.join("calls/image_editor/5_decoration/empty_room").exists());
    // Tokens on the bill are those that the services counted.
    let bill: serde_json::Value = serde_json::from_slice(&std::fs::read(run.join("bill.json")).unwrap()).unwrap();
    let paid = studio.ledger.paid_tokens();
    let billed = &bill["total"]["usage"];
    let billed = (billed["input_tokens"].as_u64().unwrap(), billed["output_tokens"].as_u64().unwrap());
    assert!(paid.0 > 0 && paid.1 > 0);
    assert_eq!(billed, paid);
    // Boxes cost tokens in both profiles: of a detector that is a language model, and of a language model itself.
    let boxes = &bill["by_role"]["detector"]["usage"];
    assert!(boxes["input_tokens"].as_u64().unwrap() > 0, "{boxes}");
    drop(studio);
    replayed(&room, &work, &run).await;
    assert!(!said.contains(KEY), "the key is told: {said}");
    assert!(without_key(work.path()) > 50, "run, recording and replay are there");
}

/// No file below a folder holds the key; how many there are.
fn without_key(folder: &Path) -> usize {
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            count += without_key(&path);
            continue;
        }
        count += 1;
        let bytes = std::fs::read(&path).unwrap();
        assert!(!bytes.windows(KEY.len()).any(|part| part == KEY.as_bytes()), "{} holds the key", path.display());
    }
    count
}

/// The recording of a run gives the same bytes, with the services gone and no keys.
async fn replayed(room: &Room, work: &tempfile::TempDir, run: &Path) {
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let recording = work.path().join("recording");
    let record = ["record", &text(run), "--out", &text(&recording), "--label", "studio", "--made-by", "a studio"];
    let mut record: Vec<String> = record.map(str::to_owned).to_vec();
    record.push("--everything".into());
    let output = harmony(record, false).await;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let offline = work.path().join("offline.toml");
    std::fs::write(&offline, format!("profile = \"offline\"\n{SETTINGS}")).unwrap();
    let again = work.path().join("replayed");
    let mut args = reconstruct(room, &offline, &again);
    args.extend(["--replay".to_owned(), text(&recording)]);
    let output = harmony(args, false).await;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for file in ["scene.json", "scene_full.glb", "render_flat.png", "segmentation.png", "objects.json"] {
        let read = |run: &Path| {
            let bytes = std::fs::read(run.join(file)).unwrap();
            if file == "scene.json" { without_cast_warnings(&bytes) } else { bytes }
        };
        let (first, second) = (read(run), read(&again));
        if first != second
            && let Ok(folder) = std::env::var("HARMONY_STUDIO_KEEP")
        {
            std::fs::write(Path::new(&folder).join(format!("first_{file}")), &first).unwrap();
            std::fs::write(Path::new(&folder).join(format!("second_{file}")), &second).unwrap();
        }
        assert!(first == second, "{file} differs");
    }
}

/// A scene without what was said of who plays, which is another profile's business in a replay.
fn without_cast_warnings(bytes: &[u8]) -> Vec<u8> {
    let mut scene: serde_json::Value = serde_json::from_slice(bytes).unwrap();
    let warnings = scene["warnings"].as_array_mut().unwrap();
    warnings.retain(|w| w["phase"] != "input" || w["kind"] != "not_available");
    serde_json::to_vec(&scene).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_papers_profile_ends_in_the_scene_of_the_truth() {
    as_inside(Profile::Paper, NoiseLevel::Clean).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_hosted_profile_ends_in_the_scene_of_the_truth() {
    as_inside(Profile::Hosted, NoiseLevel::Clean).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_local_profile_ends_in_the_scene_of_the_truth() {
    as_inside(Profile::Local, NoiseLevel::Clean).await;
}
