//! A planted key must not appear in any error, `Debug` output, record or log of the players over HTTP, whatever a
//! service does with it. One test in a program of its own: the log is the whole program's.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::io::Write;
use std::sync::{Arc, Mutex};

use crate::loopback::{Loopback, Play, Seen, http, json};
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Limits, RetryPolicy};
use harmony_players::check::Check;
use harmony_players::detector::grounding::{GroundingOptions, GroundingPlayer};
use harmony_players::detector::locate::{LocateOptions, LocatePlayer};
use harmony_players::editor::wire::EditSettings;
use harmony_players::editor::{EditorFormat, EditorOptions, EditorPlayer};
use harmony_players::http::{ApiKey, Auth, ServiceOptions};
use harmony_players::mesh::hosted::tasks::Tasks;
use harmony_players::mesh::hosted::{Host as Hosted, HostedOptions, HostedPlayer};
use harmony_players::mesh::hunyuan::{HunyuanOptions, HunyuanPlayer, Route, Version};
use harmony_players::mesh::trellis::{Host, TrellisOptions, TrellisPlayer};
use harmony_players::offline_cast;
use harmony_players::vlm::wire::ModelSettings;
use harmony_players::vlm::wire::chat::Server;
use harmony_players::vlm::{Format, VlmOptions, VlmPlayer};
use harmony_roles::{
    DetectRequest, Detector, EditKind, EditRequest, ImageEditor, MeshGenerator, MeshRequest, MeshSettings,
    PhraseRequest, Picture, VisionLanguage, VlmRequest,
};
use harmony_scene::{Level, Size};
use image::{RgbImage, RgbaImage};
use serde_json::{Value, json as value};

const CANARY: &str = "AIzaCanary-9f3b1e77c0a24d58";

/// Collects the log.
#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<u8>>>);

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// No part of the key of ten characters or more.
fn assert_clean(what: &str, text: &str) {
    for start in 0..CANARY.len() - 9 {
        let part = &CANARY[start..start + 10];
        assert!(!text.contains(part), "{what} holds {part}");
    }
}

fn key() -> ApiKey {
    ApiKey::new("CANARY_KEY", CANARY).unwrap()
}

/// What a service that repeats the key does, in all the ways that it can.
fn plays(seen: &Seen) -> Vec<Play> {
    let said = format!("you sent {:?} and {}", seen.headers, &CANARY[..17]);
    // A model's text that is JSON, so that it is accepted and recorded.
    let text = value!(said).to_string();
    let inside = value!({"status": "completed",
        "output": [{"type": "message", "content": [{"type": "output_text", "text": text}]}],
        "choices": [{"message": {"content": text}, "finish_reason": "stop"}],
        "candidates": [{"content": {"parts": [{"text": text}]}, "finishReason": "STOP"}],
        "content": [{"type": "text", "text": text}], "stop_reason": "end_turn",
        "data": [{"b64_json": said, "id": said}], "artifacts": [{"base64": said}]});
    vec![
        json(401, &value!({"error": {"message": said, "code": said}})),
        json(500, &value!({"error": said})),
        json(404, &value!({"text": said, "error_code": 1})),
        Play::Answer(429, vec![("retry-after".into(), said.clone())], said.clone().into_bytes()),
        Play::Answer(302, vec![("location".into(), format!("https://x.example/{CANARY}?{CANARY}"))], vec![]),
        Play::Answer(200, vec![], said.clone().into_bytes()),
        json(200, &inside),
        Play::CutOff(100_000, said.into_bytes()),
    ]
}

struct Everybody {
    language: Vec<Arc<VlmPlayer>>,
    editors: Vec<Arc<EditorPlayer>>,
    hunyuan: Arc<HunyuanPlayer>,
    trellis: Arc<TrellisPlayer>,
    hosted: Vec<Arc<HostedPlayer>>,
    locate: Arc<LocatePlayer>,
    grounding: Arc<GroundingPlayer>,
}

fn everybody(server: &Loopback) -> Everybody {
    let http = http();
    let bearer = || server.service_with("/v1", Auth::Bearer(key()));
    let header = |name| server.service_with("/v1", Auth::Header(name, key()));
    let vlm = |service: ServiceOptions, format| {
        let settings = ModelSettings { model: "m".into(), ..ModelSettings::default() };
        Arc::new(VlmPlayer::new(&http, VlmOptions { service, format, settings, concurrency: 0 }).unwrap())
    };
    let editor = |service: ServiceOptions, format| {
        let settings = EditSettings { model: "m".into(), ..EditSettings::default() };
        let options = EditorOptions { service, format, settings, concurrency: 0 };
        Arc::new(EditorPlayer::new(&http, options).unwrap())
    };
    let hunyuan = HunyuanOptions {
        service: bearer(),
        version: Version::V2,
        model: "m".into(),
        route: Route::Generate,
        texture: true,
        seed: 1,
        poll: std::time::Duration::from_millis(20),
        concurrency: 1,
    };
    let trellis = TrellisOptions { service: bearer(), host: Host::Nim, model: "m".into(), seed: 1, concurrency: 1 };
    let hosted = |host, service| {
        let second = std::time::Duration::from_secs(1);
        let options = HostedOptions {
            service,
            host,
            model: "m/n".into(),
            texture: true,
            seed: 1,
            extra: serde_json::Map::new(),
            frame: None,
            usd_per_credit: None,
            poll: std::time::Duration::from_millis(5),
            patience: second,
            tasks: Arc::new(Tasks::default()),
            concurrency: 1,
        };
        Arc::new(HostedPlayer::new(&http, options).unwrap())
    };
    let locate = LocateOptions { service: bearer(), model: "m".into(), concurrency: 1 };
    let grounding = GroundingOptions { service: bearer(), model: "m".into(), threshold: 0.3, concurrency: 1 };
    Everybody {
        language: vec![
            vlm(bearer(), Format::Responses),
            vlm(bearer(), Format::Chat(Some(Server::OpenAi))),
            vlm(bearer(), Format::Chat(None)),
            vlm(header("x-goog-api-key"), Format::Gemini),
            vlm(header("x-api-key"), Format::Anthropic),
        ],
        editors: vec![
            editor(header("x-goog-api-key"), EditorFormat::Gemini),
            editor(bearer(), EditorFormat::OpenAi),
            editor(bearer(), EditorFormat::Local),
        ],
        hunyuan: Arc::new(HunyuanPlayer::new(&http, hunyuan).unwrap()),
        trellis: Arc::new(TrellisPlayer::new(&http, trellis).unwrap()),
        hosted: vec![
            hosted(Hosted::Fal, server.service_with("/v1", Auth::Scheme("Key", key()))),
            hosted(Hosted::Replicate, bearer()),
            hosted(Hosted::Tripo, bearer()),
            hosted(Hosted::Meshy, bearer()),
        ],
        locate: Arc::new(LocatePlayer::new(&http, locate).unwrap()),
        grounding: Arc::new(GroundingPlayer::new(&http, grounding).unwrap()),
    }
}

fn question(name: &str) -> VlmRequest {
    VlmRequest {
        name: name.into(),
        prompt: "What is there?".into(),
        pictures: vec![Picture { caption: "IMAGE 1".into(), image: Arc::new(RgbImage::new(8, 8)) }],
        // Anything fits, so that what the service repeats is accepted and recorded.
        schema: value!({"type": "string"}),
        example: Value::Null,
        question: None,
    }
}

fn edit() -> EditRequest {
    EditRequest {
        name: "1_layout/empty_room".into(),
        kind: EditKind::EmptyRoom,
        image: Arc::new(RgbImage::new(64, 48)),
        mask: None,
        object: None,
        instruction: "Empty it.".into(),
    }
}

fn mesh() -> MeshRequest {
    MeshRequest {
        name: "3_furniture/sofa_01/mesh".into(),
        crop: Arc::new(RgbaImage::from_pixel(32, 32, image::Rgba([9, 9, 9, 255]))),
        label: "sofa".into(),
        description: String::new(),
        level: Level::Furniture,
        size: Size { width: 2.0, height: 0.8, depth: 0.9 },
        template: None,
        params: harmony_mesh::TemplateParams::default(),
        part_model: None,
        settings: MeshSettings::default(),
    }
}

fn detect() -> DetectRequest {
    DetectRequest {
        name: "3_furniture/detect".into(),
        image: Arc::new(RgbImage::new(64, 48)),
        level: Level::Furniture,
        phrases: vec![PhraseRequest { label: "sofa".into(), phrase: "sofa".into(), count: 1 }],
    }
}

#[tokio::test]
async fn a_planted_key_appears_nowhere() {
    let log = Log::default();
    let writer = log.clone();
    tracing_subscriber::fmt()
        .with_max_level(tracing_subscriber::filter::LevelFilter::TRACE)
        .with_ansi(false)
        .with_writer(move || writer.clone())
        .init();
    let count = plays(&Seen { method: String::new(), path: String::new(), headers: vec![], body: vec![] }).len();
    let mut errors = 0;
    // Looks for Blender: once is enough.
    let offline = offline_cast();
    for which in 0..count {
        let server = Loopback::start(move |seen| plays(seen).swap_remove(which)).await;
        let all = everybody(&server);
        let mut said: Vec<String> = Vec::new();
        let mut tell = |result: Result<String, harmony_roles::RoleError>| {
            errors += usize::from(result.is_err());
            said.push(result.unwrap_or_else(|error| format!("{error} {error:?} {:?}", error.hint())));
        };
        for player in &all.language {
            tell(player.ask(&question("3_furniture/list")).await.map(|answer| format!("{answer:?}")));
            tell(player.check(true).await.map(|c| format!("{c:?}")));
            tell(Ok(format!("{player:?} {:?}", player.card())));
        }
        for player in &all.editors {
            tell(player.edit(&edit()).await.map(|answer| format!("{:?}", answer.usage)));
            tell(player.check(false).await.map(|c| format!("{c:?}")));
            tell(Ok(format!("{player:?} {:?}", player.card())));
        }
        tell(all.hunyuan.generate(&mesh()).await.map(|made| made.source));
        tell(all.hunyuan.check(false).await.map(|c| format!("{c:?}")));
        tell(all.trellis.generate(&mesh()).await.map(|made| made.source));
        for player in &all.hosted {
            tell(player.generate(&mesh()).await.map(|made| made.source));
            tell(player.check(true).await.map(|c| format!("{c:?}")));
            tell(Ok(format!("{player:?} {:?}", player.card())));
        }
        tell(all.locate.detect(&detect()).await.map(|found| format!("{found:?}")));
        tell(all.grounding.detect(&detect()).await.map(|found| format!("{found:?}")));
        tell(Ok(format!("{:?} {:?} {:?} {:?}", all.hunyuan, all.trellis, all.locate, all.grounding)));
        for text in said {
            assert_clean(&format!("play {which}"), &text);
        }

        // The same through the call book: records, raw answers and warnings.
        let folder = tempfile::tempdir().unwrap();
        let mut cast = offline.clone();
        cast.vision_language = all.language[which % all.language.len()].clone();
        cast.image_editor = all.editors[which % all.editors.len()].clone();
        cast.mesh_generator = if which % 2 == 0 { all.hunyuan.clone() } else { all.hosted[which / 2 % 4].clone() };
        cast.detector = all.locate.clone();
        let secrets = vec![key().secret()];
        let book = CallBook::open(folder.path(), BookOptions { secrets, ..BookOptions::default() }).unwrap();
        // What is passing is tried again once, and at once: the waits of a run would take minutes here.
        let retry = RetryPolicy { retries: 1, first_seconds: 0.01, most_seconds: 0.01, ..RetryPolicy::default() };
        let limits = Limits { retry, ..Limits::default() };
        let options = CallOptions { reasks: 1, limits, ..CallOptions::default() };
        let calls = Calls::new(Arc::new(book), cast, offline.clone(), options);
        let _ = calls.ask(&question("3_furniture/list"), |_| Ok(())).await;
        let _ = calls.edit(&edit()).await;
        let _ = calls.generate_mesh(&mesh()).await;
        let _ = calls.detect(&detect()).await;
        let mut files = vec![folder.path().to_owned()];
        let mut read = 0;
        while let Some(path) = files.pop() {
            if path.is_dir() {
                files.extend(std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
            } else {
                read += 1;
                let bytes = std::fs::read(&path).unwrap();
                assert_clean(&path.display().to_string(), &String::from_utf8_lossy(&bytes));
            }
        }
        assert!(read > 0, "play {which}: nothing was recorded");
        // The key was really sent, or the test shows nothing.
        assert!(server.seen().iter().all(|seen| format!("{:?}", seen.headers).contains(CANARY)));
    }
    assert!(errors > 50, "{errors}");
    let log = String::from_utf8_lossy(&log.0.lock().unwrap()).into_owned();
    assert!(log.contains("asked"), "the log is there");
    assert_clean("the log", &log);
}
