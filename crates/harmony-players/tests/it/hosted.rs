//! Hosted mesh generators against a server on loopback: what the studio's doubles do not do.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::loopback::{Loopback, Play, Seen, bytes, http, json};
use harmony_mesh::{TemplateParams, template};
use harmony_players::check::Check;
use harmony_players::http::{ApiKey, Auth};
use harmony_players::mesh::finish::{AxisName, SourceFrame};
use harmony_players::mesh::hosted::tasks::Tasks;
use harmony_players::mesh::hosted::{Host, HostedOptions, HostedPlayer};
use harmony_roles::{MeshGenerator, MeshRequest, MeshSettings, RoleError};
use harmony_scene::{Level, Size};
use image::{Rgba, RgbaImage};
use serde_json::{Value, json as value};

const KEY: &str = "key-of-a-test-5d1f0c77aa";

fn options(server: &Loopback, host: Host) -> HostedOptions {
    let key = ApiKey::new("HOSTED_KEY", KEY).unwrap();
    let auth = if host == Host::Fal { Auth::Scheme("Key", key) } else { Auth::Bearer(key) };
    let mut service = server.service_with("", auth);
    service.limits.total = Duration::from_secs(5);
    HostedOptions {
        service,
        host,
        model: if host == Host::Fal { "fal-ai/trellis" } else { "meshy-6" }.into(),
        texture: true,
        seed: 3,
        extra: serde_json::Map::new(),
        frame: None,
        usd_per_credit: None,
        poll: Duration::from_millis(5),
        patience: Duration::from_secs(5),
        tasks: Arc::new(Tasks::default()),
        concurrency: 1,
    }
}

fn meshy(server: &Loopback) -> HostedPlayer {
    HostedPlayer::new(&http(), options(server, Host::Meshy)).unwrap()
}

fn glb() -> Vec<u8> {
    let size = Size { width: 2.0, height: 0.8, depth: 0.9 };
    let mesh = template("sofa", &TemplateParams::default(), size).build(size).unwrap().mesh;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    harmony_io::write_mesh_glb(&path, "m", Arc::new(mesh), Value::Null).unwrap();
    std::fs::read(path).unwrap()
}

fn request() -> MeshRequest {
    MeshRequest {
        name: "3_furniture/sofa_01/mesh".into(),
        crop: Arc::new(RgbaImage::from_fn(80, 60, |x, _| Rgba([200, 90, 40, if x > 20 { 255 } else { 0 }]))),
        label: "sofa".into(),
        description: "a sofa".into(),
        level: Level::Furniture,
        size: Size { width: 2.0, height: 0.8, depth: 0.9 },
        template: None,
        params: TemplateParams::default(),
        part_model: None,
        settings: MeshSettings { faces: 900, ..MeshSettings::default() },
    }
}

/// A Meshy whose tasks are done at once and whose file is behind `link`; `{own}` in it is the server's address.
async fn with_link(link: &'static str) -> Loopback {
    let file = glb();
    Loopback::start(move |seen| {
        let own = format!("http://{}", seen.header("host").unwrap_or_default());
        match (seen.method.as_str(), seen.path.as_str()) {
            ("POST", _) => json(202, &value!({"result": "task-1"})),
            (_, path) if path.starts_with("/file") => bytes(file.clone()),
            _ => json(
                200,
                &value!({"status": "SUCCEEDED", "model_urls": {"glb": link.replace("{own}", &own)}, "consumed_credits": 5}),
            ),
        }
    })
    .await
}

fn posts(server: &Loopback) -> usize {
    server.seen().iter().filter(|seen| seen.method == "POST").count()
}

#[tokio::test]
async fn a_file_is_fetched_without_the_key_and_only_from_where_it_may() {
    let server = with_link("{own}/file.glb?signature=1").await;
    let made = meshy(&server).generate(&request()).await.unwrap();
    assert!(made.mesh.triangle_count() <= 900 && made.mesh.check().is_ok());
    let is_file = |seen: &&Seen| seen.path.starts_with("/file");
    let file = server.seen().iter().find(is_file).cloned().unwrap();
    assert_eq!((file.path.as_str(), file.header("authorization")), ("/file.glb?signature=1", None));
    assert!(server.seen().iter().filter(|seen| !is_file(seen)).all(|seen| seen.header("authorization").is_some()));

    for link in [
        "http://127.0.0.1:1/secret-path?signature=secret",
        "https://10.0.0.7/secret-path?signature=secret",
        "https://localhost/secret-path",
        "http://files.example.com/secret-path",
        "file:///etc/passwd?secret-path",
        "gopher://files.example.com/secret-path",
    ] {
        let server = with_link(link).await;
        let error = meshy(&server).generate(&request()).await.unwrap_err();
        let said = format!("{error} {error:?}");
        assert!(said.contains("not followed") && !said.contains("secret"), "{link}: {said}");
    }
}

#[tokio::test]
async fn a_redirect_of_a_file_is_not_followed() {
    let other = Loopback::always(bytes(glb())).await;
    let to = format!("{}/elsewhere.glb", other.address());
    let server = Loopback::start(move |seen| match (seen.method.as_str(), seen.path.as_str()) {
        ("POST", _) => json(202, &value!({"result": "task-1"})),
        (_, "/file.glb") => Play::Answer(302, vec![("location".into(), to.clone())], vec![]),
        _ => {
            let link = format!("http://{}/file.glb", seen.header("host").unwrap_or_default());
            json(200, &value!({"status": "SUCCEEDED", "model_urls": {"glb": link}}))
        }
    })
    .await;
    assert!(meshy(&server).generate(&request()).await.is_err());
    assert!(other.seen().is_empty());
}

#[tokio::test]
async fn a_task_that_the_service_has_forgotten_is_made_anew_and_that_is_said() {
    let file = glb();
    let server = Loopback::start(move |seen| match (seen.method.as_str(), seen.path.as_str()) {
        ("POST", _) => json(202, &value!({"result": "task-new"})),
        (_, path) if path.ends_with("task-old") => json(404, &value!({"message": "Task not found"})),
        (_, "/file.glb") => bytes(file.clone()),
        _ => {
            let link = format!("http://{}/file.glb", seen.header("host").unwrap_or_default());
            json(200, &value!({"status": "SUCCEEDED", "model_urls": {"glb": link}}))
        }
    })
    .await;
    // A note of long ago about this very work: made by this program, then aged.
    let folder = tempfile::tempdir().unwrap();
    let with_notes = || {
        let tasks = Arc::new(Tasks::in_folder(folder.path().to_owned()));
        HostedPlayer::new(&http(), HostedOptions { tasks, ..options(&server, Host::Meshy) }).unwrap()
    };
    with_notes().generate(&request()).await.unwrap();
    let note = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let mut text: Value = serde_json::from_slice(&std::fs::read(&note).unwrap()).unwrap();
    text["task"] = value!("task-old");
    text["made_unix_ms"] = value!(1_700_000_000_000_u64);
    std::fs::write(&note, text.to_string()).unwrap();
    let made = with_notes().generate(&request()).await.unwrap();
    assert!(made.notes.iter().any(|note| note.contains("task-old")), "{:?}", made.notes);
    assert_eq!(posts(&server), 2);
    let kept = std::fs::read_to_string(&note).unwrap();
    assert!(kept.contains("task-new"), "{kept}");
}

#[tokio::test]
async fn answers_that_are_not_understood_end_in_words_and_no_loop() {
    for (submitted, state) in [
        (value!({"result": "../../account"}), Value::Null),
        (value!({"nothing": 1}), Value::Null),
        (value!({"result": "task-1"}), value!({"status": "DANCING"})),
        (value!({"result": "task-1"}), value!({"status": "SUCCEEDED"})),
        (value!({"result": "task-1"}), value!(["odd"])),
    ] {
        let told = format!("{submitted} {state}");
        let server = Loopback::start(move |seen| match seen.method.as_str() {
            "POST" => json(202, &submitted),
            _ => json(200, &state),
        })
        .await;
        let error = meshy(&server).generate(&request()).await.unwrap_err();
        assert!(matches!(error, RoleError::UnusableAnswer { .. } | RoleError::NotCapable { .. }), "{told}: {error}");
        assert_eq!(posts(&server), 1, "{told}");
    }
}

#[tokio::test]
async fn failing_tasks_are_not_made_without_end() {
    let server = Loopback::start(|seen| match seen.method.as_str() {
        "POST" => json(202, &value!({"result": "task-1"})),
        _ => json(200, &value!({"status": "FAILED", "task_error": {"message": "out of memory"}})),
    })
    .await;
    let player = meshy(&server);
    let first = player.generate(&request()).await.unwrap_err();
    assert!(first.is_retryable() && first.to_string().contains("out of memory"), "{first}");
    for _ in 0..3 {
        let error = player.generate(&request()).await.unwrap_err();
        assert!(matches!(error, RoleError::NotCapable { .. }), "{error}");
    }
    assert_eq!(posts(&server), 2, "once, and once more");
}

#[tokio::test]
async fn looks_slow_down_and_wait_as_they_are_asked() {
    let looks = Arc::new(AtomicUsize::new(0));
    let server = {
        let (looks, file) = (Arc::clone(&looks), glb());
        Loopback::start(move |seen| {
            let link = format!("http://{}/file.glb", seen.header("host").unwrap_or_default());
            match (seen.method.as_str(), seen.path.as_str()) {
                ("POST", _) => json(202, &value!({"result": "task-1"})),
                (_, "/file.glb") => bytes(file.clone()),
                _ => match looks.fetch_add(1, Ordering::Relaxed) {
                    0 => Play::Answer(429, vec![("retry-after".into(), "0.2".into())], b"{}".to_vec()),
                    1 => Play::Close,
                    2 => json(200, &value!({"status": "IN_PROGRESS"})),
                    _ => json(200, &value!({"status": "SUCCEEDED", "model_urls": {"glb": link}})),
                },
            }
        })
        .await
    };
    let clock = std::time::Instant::now();
    meshy(&server).generate(&request()).await.unwrap();
    assert!(clock.elapsed() >= Duration::from_millis(200), "{:?}", clock.elapsed());
    assert_eq!((looks.load(Ordering::Relaxed), posts(&server)), (4, 1));
}

#[tokio::test]
async fn the_frame_can_be_set_and_nonsense_is_refused_before_anything_is_sent() {
    let server = with_link("{own}/file.glb").await;
    // The front of what comes looks along +X; ours is +Z, so width and depth change places.
    let frame = Some(SourceFrame { up: AxisName::PlusY, front: AxisName::PlusX });
    let player = HostedPlayer::new(&http(), HostedOptions { frame, ..options(&server, Host::Meshy) }).unwrap();
    let size = player.generate(&request()).await.unwrap().mesh.bounds().unwrap().size();
    assert!((size.x - 0.9).abs() < 0.02 && (size.z - 2.0).abs() < 0.02, "{size}");

    let flat = Some(SourceFrame { up: AxisName::PlusY, front: AxisName::MinusY });
    let error = HostedPlayer::new(&http(), HostedOptions { frame: flat, ..options(&server, Host::Meshy) }).unwrap_err();
    assert!(error.hint().is_some_and(|hint| hint.contains("front")), "{error}");
    for model in ["", "../account", "a b", "m?x=1"] {
        let options = HostedOptions { model: model.into(), ..options(&server, Host::Fal) };
        assert!(HostedPlayer::new(&http(), options).is_err(), "{model:?}");
    }
}

#[tokio::test]
async fn checks_tell_what_is_left_and_what_is_missing() {
    let rich = Loopback::always(json(200, &value!({"balance": 120}))).await;
    assert!(meshy(&rich).check(false).await.unwrap().detail.contains("120"));
    let poor = Loopback::always(json(200, &value!({"balance": 0}))).await;
    let error = meshy(&poor).check(false).await.unwrap_err();
    assert!(error.hint().is_some_and(|hint| hint.contains("top up")), "{error}");
    let wrong = Loopback::always(json(401, &value!({"message": "Invalid API key"}))).await;
    assert!(meshy(&wrong).check(false).await.unwrap_err().to_string().contains("did not accept the key"));
    let region = Loopback::always(json(403, &value!({"message": "Not available in your country"}))).await;
    assert!(meshy(&region).check(false).await.unwrap_err().to_string().contains("where you are"));
    let other = Loopback::always(json(200, &value!({"hello": "world"}))).await;
    assert!(meshy(&other).check(false).await.unwrap_err().to_string().contains("does not look like"));
}
