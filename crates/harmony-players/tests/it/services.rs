//! Each player against a server on loopback that speaks its format, and misbehaves as such servers do.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::loopback::{Loopback, Play, Seen, bytes, http, json};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture::{decode, rgb_png};
use harmony_mesh::{TemplateParams, template};
use harmony_players::check::Check;
use harmony_players::detector::asked::VlmBoxes;
use harmony_players::detector::boxes::BoxStyle;
use harmony_players::detector::grounding::{GroundingOptions, GroundingPlayer};
use harmony_players::detector::locate::{LocateOptions, LocatePlayer};
use harmony_players::editor::wire::EditSettings;
use harmony_players::editor::{EditorFormat, EditorOptions, EditorPlayer};
use harmony_players::mesh::hunyuan::{HunyuanOptions, HunyuanPlayer, Route, Version};
use harmony_players::mesh::trellis::{Host, TrellisOptions, TrellisPlayer};
use harmony_players::vlm::wire::ModelSettings;
use harmony_players::vlm::{Format, VlmOptions, VlmPlayer};
use harmony_roles::{
    DetectRequest, Detector, EditKind, EditRequest, ImageEditor, MeshGenerator, MeshRequest, MeshSettings,
    PhraseRequest, Picture, RoleError, VisionLanguage, VlmRequest,
};
use harmony_scene::{ImageSize, Level, Mask, Size};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json as value};

// ---- language models ----

fn question() -> VlmRequest {
    VlmRequest {
        name: "3_furniture/list".into(),
        prompt: "What is there?".into(),
        pictures: vec![Picture { caption: "IMAGE 1: the photo".into(), image: Arc::new(RgbImage::new(40, 30)) }],
        // A bare list with an optional property: both have to be reshaped.
        schema: value!({"type": "array", "items": {"type": "object", "properties": {
            "kind": {"type": "string"}, "count": {"type": "integer", "minimum": 1}, "host": {"type": "string"}},
            "required": ["kind", "count"], "additionalProperties": false}}),
        example: value!([{"kind": "lamp", "count": 2}]),
        question: None,
    }
}

const WIRE_ANSWER: &str = r#"{"items":[{"kind":"sofa","count":1,"host":null}]}"#;

fn formats() -> [(&'static str, Format); 5] {
    [
        ("responses", Format::Responses),
        ("chat", Format::Chat(Some(harmony_players::vlm::wire::chat::Server::OpenAi))),
        ("compatible", Format::Chat(None)),
        ("gemini", Format::Gemini),
        ("anthropic", Format::Anthropic),
    ]
}

/// The service's answer with a text of the model.
fn spoken(path: &str, text: &str) -> Value {
    if path.ends_with("/responses") {
        value!({"status": "completed", "output": [{"type": "message", "content": [{"type": "output_text", "text": text}]}],
                "usage": {"input_tokens": 1000, "output_tokens": 100}})
    } else if path.ends_with("/chat/completions") {
        value!({"choices": [{"message": {"content": text}, "finish_reason": "stop"}],
                "usage": {"prompt_tokens": 1000, "completion_tokens": 100}})
    } else if path.ends_with(":generateContent") {
        value!({"candidates": [{"content": {"parts": [{"text": text}]}, "finishReason": "STOP"}],
                "usageMetadata": {"promptTokenCount": 1000, "candidatesTokenCount": 60, "thoughtsTokenCount": 40}})
    } else if path.ends_with("/messages") {
        value!({"content": [{"type": "text", "text": text}], "stop_reason": "end_turn",
                "usage": {"input_tokens": 1000, "output_tokens": 100}})
    } else if path.ends_with("/models") {
        value!({"object": "list", "data": [{"id": "served-model", "owned_by": "vllm"}]})
    } else {
        value!({"id": "m"})
    }
}

fn vlm(server: &Loopback, format: Format) -> VlmPlayer {
    let model = if format == Format::Chat(None) { "" } else { "a-model" };
    let settings = ModelSettings { model: model.into(), detail: "high".into(), ..ModelSettings::default() };
    let service = server.service("/v1");
    VlmPlayer::new(&http(), VlmOptions { service, format, settings, concurrency: 2 }).unwrap()
}

#[tokio::test]
async fn every_format_brings_an_answer_that_fits_the_question() {
    for (name, format) in formats() {
        let server = Loopback::start(|seen| json(200, &spoken(&seen.path, WIRE_ANSWER))).await;
        let player = vlm(&server, format);
        let answer = player.ask(&question()).await.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(answer.value, value!([{"kind": "sofa", "count": 1}]), "{name}");
        assert_eq!((answer.usage.input_tokens, answer.usage.output_tokens), (1000, 100), "{name}");
        assert_eq!(answer.usage.cost_usd, None, "{name}: no service tells a cost");
        let sent = server.seen().pop().unwrap();
        let text = sent.json().to_string();
        assert!(text.contains("image/png") && text.contains("What is there?") && text.contains("additionalProperties"));
        if format == Format::Chat(None) {
            assert_eq!(sent.json()["model"], "served-model");
            assert_eq!(player.card().model, "served-model");
        }
        assert!(player.check(false).await.is_ok(), "{name}");
    }
}

#[tokio::test]
async fn answers_that_cannot_be_used_are_asked_for_again() {
    for (name, format) in formats() {
        for text in ["{\"items\": [{\"kind\": \"so", "I see a sofa.", "{\"items\": [{\"kind\": 7}]}", "{}"] {
            let server = Loopback::start(move |seen| json(200, &spoken(&seen.path, text))).await;
            let error = vlm(&server, format).ask(&question()).await.unwrap_err();
            let usable = matches!(&error, RoleError::UnusableAnswer { raw, .. } if raw == text);
            assert!(usable, "{name} {text}: {error:?}");
        }
        // The envelope itself is cut off, with a good status.
        let server = Loopback::start(|seen| {
            let whole = spoken(&seen.path, WIRE_ANSWER).to_string().into_bytes();
            let cut = if seen.path.ends_with("/models") { whole.len() } else { whole.len() / 2 };
            bytes(whole[..cut].to_vec())
        })
        .await;
        let error = vlm(&server, format).ask(&question()).await.unwrap_err();
        assert!(matches!(error, RoleError::UnusableAnswer { .. }), "{name}: {error}");
    }
}

#[tokio::test]
async fn refusals_limits_and_lasting_failures_are_told_apart() {
    let refusals = [
        value!({"status": "completed", "output": [{"type": "message", "content": [{"type": "refusal", "refusal": "no"}]}]}),
        value!({"choices": [{"message": {"content": null, "refusal": "no"}, "finish_reason": "stop"}]}),
        value!({"choices": [{"message": {"content": null, "refusal": "no"}, "finish_reason": "stop"}]}),
        value!({"promptFeedback": {"blockReason": "SAFETY"}}),
        value!({"content": [], "stop_reason": "refusal"}),
    ];
    for ((name, format), refusal) in formats().into_iter().zip(refusals) {
        let answer = move |seen: &Seen, play: Play| {
            if seen.path.ends_with("/models") { json(200, &spoken(&seen.path, "")) } else { play }
        };
        let refusing = {
            let refusal = refusal.clone();
            Loopback::start(move |seen| answer(seen, json(200, &refusal))).await
        };
        let error = vlm(&refusing, format).ask(&question()).await.unwrap_err();
        assert!(matches!(error, RoleError::Refused { .. }), "{name}: {error}");

        let busy = Loopback::start(move |seen| {
            answer(seen, Play::Answer(429, vec![("retry-after".into(), "3".into())], b"{}".to_vec()))
        })
        .await;
        let error = vlm(&busy, format).ask(&question()).await.unwrap_err();
        assert_eq!(error.retry_after(), Some(Duration::from_secs(3)), "{name}: {error}");

        let overloaded =
            Loopback::start(move |seen| answer(seen, json(529, &value!({"error": {"message": "busy"}})))).await;
        assert!(vlm(&overloaded, format).ask(&question()).await.unwrap_err().is_retryable(), "{name}");

        let strict = Loopback::start(move |seen| {
            answer(seen, json(400, &value!({"error": {"message": "bad schema", "code": "invalid_json_schema"}})))
        })
        .await;
        let error = vlm(&strict, format).ask(&question()).await.unwrap_err();
        assert!(
            matches!(&error, RoleError::NotSetUp { reason, .. } if reason.contains("bad schema")),
            "{name}: {error}"
        );
    }
}

#[tokio::test]
async fn a_server_that_loads_is_waited_for_and_one_that_cuts_prompts_is_not_trusted() {
    let loading = Loopback::always(json(503, &value!({"error": {"code": 503, "message": "Loading model"}}))).await;
    let error = vlm(&loading, Format::Chat(None)).ask(&question()).await.unwrap_err();
    assert!(error.is_retryable() && error.to_string().contains("Loading model"), "{error}");

    let ollama = Loopback::start(|seen| {
        if seen.path.ends_with("/models") {
            return json(200, &value!({"data": [{"id": "qwen3-vl:8b", "owned_by": "library"}]}));
        }
        json(
            200,
            &value!({"choices": [{"message": {"content": WIRE_ANSWER}, "finish_reason": "stop"}],
                           "usage": {"prompt_tokens": 500, "completion_tokens": 9}}),
        )
    })
    .await;
    let mut long = question();
    long.prompt = "Look closely. ".repeat(2000);
    let error = vlm(&ollama, Format::Chat(None)).ask(&long).await.unwrap_err();
    assert!(error.hint().is_some_and(|hint| hint.contains("OLLAMA_CONTEXT_LENGTH")), "{error}");
    assert!(vlm(&ollama, Format::Chat(None)).ask(&question()).await.is_ok());
}

#[tokio::test]
async fn several_models_without_a_name_are_listed() {
    let models = value!({"data": [{"id": "a", "owned_by": "vllm"}, {"id": "b", "owned_by": "vllm"}]});
    let server = Loopback::always(json(200, &models)).await;
    let error = vlm(&server, Format::Chat(None)).check(false).await.unwrap_err();
    assert!(error.to_string().contains("a, b"), "{error}");
}

// ---- image editors ----

fn edit(kind: EditKind) -> EditRequest {
    let size = ImageSize::new(320, 240);
    let object = Mask::from_fn(size, |x, y| (100..200).contains(&x) && (80..180).contains(&y));
    EditRequest {
        name: "1_layout/empty_room".into(),
        kind,
        image: Arc::new(RgbImage::from_fn(320, 240, |x, y| Rgb([x as u8, y as u8, 90]))),
        mask: (kind == EditKind::EmptyRoom).then(|| Arc::new(object.clone())),
        object: (kind == EditKind::Amodal).then(|| Arc::new(object)),
        instruction: "Do it.".into(),
    }
}

fn editor(server: &Loopback, format: EditorFormat, model: &str) -> EditorPlayer {
    let settings = EditSettings { model: model.into(), ..EditSettings::default() };
    let service = server.service("/v1");
    EditorPlayer::new(&http(), EditorOptions { service, format, settings, concurrency: 1 }).unwrap()
}

const EDITORS: [(EditorFormat, &str); 4] = [
    (EditorFormat::Gemini, "gemini-3.1-flash-image"),
    (EditorFormat::OpenAi, "gpt-image-1.5"),
    (EditorFormat::OpenAi, "gpt-image-2"),
    (EditorFormat::Local, ""),
];

/// An answer with an image file, in the format of the path.
fn drawn(path: &str, file: &[u8]) -> Value {
    let data = STANDARD.encode(file);
    if path.ends_with("/edits") {
        value!({"created": 1, "data": [{"b64_json": data}], "usage": {"input_tokens": 50, "output_tokens": 1000}})
    } else {
        value!({"candidates": [{"content": {"parts": [{"text": "Here."}, {"inlineData": {"mimeType": "image/png", "data": data}}]},
                "finishReason": "STOP"}], "usageMetadata": {"promptTokenCount": 50, "candidatesTokenCount": 1000}})
    }
}

/// The first picture that was sent, whatever the format.
fn first_picture(seen: &Seen) -> RgbImage {
    if seen.method == "GET" {
        return RgbImage::new(1, 1);
    }
    let file = if seen.path.ends_with("/edits") {
        let at = seen.body.windows(4).position(|w| w == b"\x89PNG").unwrap();
        seen.body[at..].to_vec()
    } else {
        let parts = seen.json().pointer("/contents/0/parts").unwrap().as_array().unwrap().clone();
        let data = parts.iter().find_map(|part| part.pointer("/inlineData/data")).unwrap().clone();
        STANDARD.decode(data.as_str().unwrap()).unwrap()
    };
    decode(&file).unwrap().to_rgb8()
}

#[tokio::test]
async fn edits_come_back_in_the_pictures_frame_and_only_where_they_may() {
    for (format, model) in EDITORS {
        // An editor that makes everything lighter, at the size that it was sent.
        let server = Loopback::start(|seen| {
            let mut picture = first_picture(seen);
            picture.pixels_mut().for_each(|p| p.0 = p.0.map(|v| v.saturating_add(60)));
            json(200, &drawn(&seen.path, &rgb_png(&picture).unwrap()))
        })
        .await;
        let request = edit(EditKind::EmptyRoom);
        let edited = editor(&server, format, model).edit(&request).await.unwrap();
        assert_eq!(edited.image.dimensions(), (320, 240));
        assert_eq!(edited.usage.output_tokens, 1000);
        let mask = request.mask.as_ref().unwrap();
        for (x, y, pixel) in edited.image.enumerate_pixels() {
            let before = request.image.get_pixel(x, y).0;
            if mask.get(i64::from(x), i64::from(y)) {
                // Scaled up and down again: within the error of the resampling.
                let lighter = before.map(|v| v.saturating_add(60));
                assert!((0..3).all(|c| pixel.0[c].abs_diff(lighter[c]) <= 8), "{model} {x} {y} {pixel:?} {lighter:?}");
            } else {
                assert_eq!(pixel.0[..3], before, "{model} {x} {y}");
            }
        }
        let sent = String::from_utf8_lossy(&server.seen().last().unwrap().body).into_owned();
        assert_eq!(sent.contains("mask.png"), format == EditorFormat::OpenAi);
    }
}

#[tokio::test]
async fn completed_objects_are_cut_out_in_place() {
    for (format, model) in EDITORS {
        let server =
            Loopback::start(|seen| json(200, &drawn(&seen.path, &rgb_png(&first_picture(seen)).unwrap()))).await;
        let request = edit(EditKind::Amodal);
        let edited = editor(&server, format, model).edit(&request).await.unwrap();
        let size = ImageSize::new(320, 240);
        let found = Mask::from_fn(size, |x, y| edited.image.get_pixel(x, y).0[3] > 0);
        let iou = found.iou(request.object.as_ref().unwrap());
        assert!(iou > 0.93, "{model} {iou}");
    }
}

#[tokio::test]
async fn wrong_sizes_words_and_files_that_are_no_images_are_refused() {
    let narrow = rgb_png(&RgbImage::new(60, 200)).unwrap();
    for (format, model) in EDITORS {
        for file in [narrow.clone(), b"<html>oops</html>".to_vec(), narrow[..narrow.len() / 2].to_vec()] {
            let server = Loopback::start(move |seen| json(200, &drawn(&seen.path, &file))).await;
            let error = editor(&server, format, model).edit(&edit(EditKind::EmptyRoom)).await.unwrap_err();
            assert!(matches!(error, RoleError::UnusableAnswer { .. }), "{model}: {error}");
        }
    }
    let words = value!({"candidates": [{"content": {"parts": [{"text": "A room."}]}, "finishReason": "STOP"}]});
    let server = Loopback::always(json(200, &words)).await;
    let error = editor(&server, EditorFormat::Gemini, "m").edit(&edit(EditKind::EmptyRoom)).await.unwrap_err();
    assert!(matches!(&error, RoleError::UnusableAnswer { complaint, .. } if complaint.contains("A room.")), "{error}");
    let blocked = value!({"candidates": [{"finishReason": "IMAGE_SAFETY"}]});
    let server = Loopback::always(json(200, &blocked)).await;
    let error = editor(&server, EditorFormat::Gemini, "m").edit(&edit(EditKind::EmptyRoom)).await.unwrap_err();
    assert!(matches!(error, RoleError::Refused { .. }), "{error}");
    let moderated = value!({"error": {"message": "blocked", "code": "moderation_blocked"}});
    let server = Loopback::always(json(400, &moderated)).await;
    let error =
        editor(&server, EditorFormat::OpenAi, "gpt-image-2").edit(&edit(EditKind::EmptyRoom)).await.unwrap_err();
    assert!(matches!(error, RoleError::Refused { .. }), "{error}");
}

// ---- mesh generators ----

fn glb() -> Vec<u8> {
    let size = Size { width: 2.0, height: 0.8, depth: 0.9 };
    let mesh = template("sofa", &TemplateParams::default(), size).build(size).unwrap().mesh;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    harmony_io::write_mesh_glb(&path, "m", Arc::new(mesh), Value::Null).unwrap();
    std::fs::read(path).unwrap()
}

fn mesh_request() -> MeshRequest {
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

fn hunyuan(server: &Loopback, version: Version, route: Route, total: Duration) -> HunyuanPlayer {
    let mut service = server.service("");
    service.limits.total = total;
    HunyuanPlayer::new(
        &http(),
        HunyuanOptions {
            service,
            version,
            model: "hunyuan3d-2".into(),
            route,
            texture: true,
            seed: 1,
            poll: Duration::from_millis(20),
            concurrency: 1,
        },
    )
    .unwrap()
}

const PATIENT: Duration = Duration::from_secs(20);

#[tokio::test]
async fn a_mesh_is_made_cleaned_and_kept_to_the_budget() {
    let file = glb();
    let server = Loopback::start(move |seen| match seen.path.as_str() {
        "/generate" => bytes(file.clone()),
        "/health" => json(200, &value!({"status": "healthy", "worker_id": "w"})),
        _ => json(200, &value!({"status": "processing"})),
    })
    .await;
    for version in [Version::V2, Version::V2_1] {
        let player = hunyuan(&server, version, Route::Generate, PATIENT);
        let made = player.generate(&mesh_request()).await.unwrap();
        assert!(made.mesh.triangle_count() <= 900 && made.mesh.check().is_ok());
        assert_eq!(made.notes.iter().any(|note| note.contains("steps 25")), version == Version::V2_1);
        player.check(false).await.unwrap();
    }
    let sent = server.seen()[0].json();
    assert_eq!((&sent["octree_resolution"], &sent["num_inference_steps"]), (&value!(384), &value!(25)));
    let picture = decode(&STANDARD.decode(sent["image"].as_str().unwrap()).unwrap()).unwrap().to_rgba8();
    assert!(picture.pixels().any(|p| p.0[3] == 0) && picture.pixels().any(|p| p.0[3] == 255));
}

#[tokio::test]
async fn hunyuans_404_is_a_failure_of_the_server_unless_it_is_a_wrong_path() {
    let failing = Loopback::always(json(404, &value!({"text": "CUDA out of memory", "error_code": 1}))).await;
    let error = hunyuan(&failing, Version::V2, Route::Generate, PATIENT).generate(&mesh_request()).await.unwrap_err();
    assert!(error.is_retryable() && error.status() == Some(404), "{error}");
    let empty = Loopback::always(json(404, &value!({"text": "input image is empty", "error_code": 1}))).await;
    let error = hunyuan(&empty, Version::V2, Route::Generate, PATIENT).generate(&mesh_request()).await.unwrap_err();
    assert!(matches!(error, RoleError::NotCapable { .. }), "{error}");
    let other = Loopback::always(json(404, &value!({"detail": "Not Found"}))).await;
    let error = hunyuan(&other, Version::V2, Route::Generate, PATIENT).generate(&mesh_request()).await.unwrap_err();
    assert!(matches!(error, RoleError::NotSetUp { .. }), "{error}");
    let strict =
        Loopback::always(json(422, &value!({"detail": [{"loc": ["body", "seed"], "msg": "too large"}]}))).await;
    let error = hunyuan(&strict, Version::V2_1, Route::Generate, PATIENT).generate(&mesh_request()).await.unwrap_err();
    assert!(error.to_string().contains("seed"), "{error}");
}

#[tokio::test]
async fn files_that_are_no_whole_meshes_are_refused() {
    let whole = glb();
    let mut endless = whole.clone();
    endless.truncate(whole.len() / 2);
    for file in [endless, b"not a mesh".to_vec(), Vec::new()] {
        let server = Loopback::always(bytes(file)).await;
        let error =
            hunyuan(&server, Version::V2, Route::Generate, PATIENT).generate(&mesh_request()).await.unwrap_err();
        assert!(matches!(error, RoleError::UnusableAnswer { .. }), "{error}");
    }
}

#[tokio::test]
async fn a_job_is_looked_at_until_its_file_is_whole() {
    let file = glb();
    let looks = Arc::new(AtomicUsize::new(0));
    let server = {
        let looks = Arc::clone(&looks);
        Loopback::start(move |seen| {
            if seen.path == "/send" {
                return json(200, &value!({"uid": "ab-12"}));
            }
            match looks.fetch_add(1, Ordering::Relaxed) {
                0 => json(200, &value!({"status": "processing"})),
                // While it works, the server may not answer.
                1 => Play::Close,
                2 => json(200, &value!({"status": "texturing"})),
                3 => json(
                    200,
                    &value!({"status": "completed", "model_base64": STANDARD.encode(&file[..file.len() / 3])}),
                ),
                _ => json(200, &value!({"status": "completed", "model_base64": STANDARD.encode(&file)})),
            }
        })
        .await
    };
    let made = hunyuan(&server, Version::V2_1, Route::Send, PATIENT).generate(&mesh_request()).await.unwrap();
    assert!(made.mesh.triangle_count() > 0);
    assert_eq!(looks.load(Ordering::Relaxed), 5);
    assert_eq!(server.seen().iter().filter(|seen| seen.path == "/send").count(), 1, "a job is paid once");
}

#[tokio::test]
async fn a_job_that_never_ends_is_given_up_in_time() {
    let server = Loopback::start(|seen| {
        if seen.path == "/send" {
            json(200, &value!({"uid": "a"}))
        } else {
            json(200, &value!({"status": "processing"}))
        }
    })
    .await;
    let clock = Instant::now();
    let player = hunyuan(&server, Version::V2, Route::Send, Duration::from_millis(500));
    let error = player.generate(&mesh_request()).await.unwrap_err();
    assert!(clock.elapsed() < Duration::from_secs(5), "{error}");
    // Sent again it would keep the server busy once more.
    assert!(!error.is_retryable() && error.to_string().contains("did not end"), "{error}");
}

#[tokio::test]
async fn trellis_servers_make_meshes_that_are_not_metal() {
    let file = glb();
    let server = Loopback::start(move |seen| {
        let data = STANDARD.encode(&file);
        match seen.path.as_str() {
            "/v1/infer" => json(200, &value!({"artifacts": [{"base64": data, "finishReason": "SUCCESS"}]})),
            "/3d/generations" => json(200, &value!({"data": [{"b64_json": data}]})),
            _ => json(200, &value!({})),
        }
    })
    .await;
    for host in [Host::Nim, Host::LocalAi] {
        let options =
            TrellisOptions { service: server.service(""), host, model: "trellis2".into(), seed: 1, concurrency: 1 };
        let player = TrellisPlayer::new(&http(), options).unwrap();
        let made = player.generate(&mesh_request()).await.unwrap();
        assert!(made.mesh.materials.iter().all(|m| m.metallic < 0.5));
        player.check(false).await.unwrap();
    }
}

// ---- detectors ----

fn detect() -> DetectRequest {
    let phrase = |label: &str, phrase: &str| PhraseRequest { label: label.into(), phrase: phrase.into(), count: 1 };
    DetectRequest {
        name: "3_furniture/detect".into(),
        image: Arc::new(RgbImage::new(400, 300)),
        level: Level::Furniture,
        phrases: vec![phrase("sofa", "leather sofa . leather couch"), phrase("lamp", "floor lamp")],
    }
}

#[tokio::test]
async fn locate_anything_gives_boxes_and_no_scores() {
    let text = "<ref>leather couch</ref><box><100><200><500><800></box><ref>floor lamp</ref><box>none</box>";
    let server = Loopback::always(json(200, &spoken("/chat/completions", text))).await;
    let options = LocateOptions { service: server.service("/v1"), model: "m".into(), concurrency: 1 };
    let answer = LocatePlayer::new(&http(), options.clone()).unwrap().detect(&detect()).await.unwrap();
    assert_eq!((answer.usage.input_tokens, answer.usage.output_tokens), (1000, 100));
    let found = answer.detections;
    assert_eq!(found.len(), 1);
    let b = found[0].bounds;
    assert_eq!((found[0].label.as_str(), found[0].score), ("sofa", None));
    assert_eq!((b.x0, b.y0, b.x1, b.y1), (40.0, 60.0, 200.0, 240.0));
    // A server that hides the box tokens.
    let mute = Loopback::always(json(200, &spoken("/chat/completions", "leather couch"))).await;
    let options = LocateOptions { service: mute.service("/v1"), ..options };
    let error = LocatePlayer::new(&http(), options).unwrap().detect(&detect()).await.unwrap_err();
    assert!(error.hint().is_some_and(|hint| hint.contains("--special")), "{error}");
}

#[tokio::test]
async fn a_zero_shot_detector_gives_its_scores() {
    let found =
        value!([{"score": 0.71, "label": "leather sofa", "box": {"xmin": 10, "ymin": 20, "xmax": 110, "ymax": 90}}]);
    let server = Loopback::always(json(200, &found)).await;
    let options =
        GroundingOptions { service: server.service("/detect"), model: "m".into(), threshold: 0.35, concurrency: 1 };
    let player = GroundingPlayer::new(&http(), options).unwrap();
    let found = player.detect(&detect()).await.unwrap().detections;
    assert_eq!((found[0].label.as_str(), found[0].score), ("sofa", Some(0.71)));
    let sent = server.seen()[0].clone();
    assert_eq!(sent.path, "/detect");
    assert_eq!(sent.json()["parameters"]["candidate_labels"], value!(["leather sofa", "leather couch", "floor lamp"]));
    player.check(false).await.unwrap();
}

#[tokio::test]
async fn a_language_model_gives_boxes_in_its_own_way() {
    for (style, key, numbers) in [
        (BoxStyle::Thousandths, "box", [100, 200, 500, 800]),
        (BoxStyle::ThousandthsTopFirst, "box_2d", [200, 100, 800, 500]),
    ] {
        let text = value!({"boxes": [{"label": "sofa", key: numbers}]}).to_string();
        let server = Loopback::start(move |seen| json(200, &spoken(&seen.path, &text))).await;
        let language = vlm(&server, Format::Gemini);
        let card = VisionLanguage::card(&language);
        let detector = VlmBoxes::new(Arc::new(language), style);
        // Prices and rates are looked up by the card: they are the language model's.
        assert_eq!(detector.card(), card);
        let answer = detector.detect(&detect()).await.unwrap();
        assert_eq!((answer.usage.input_tokens, answer.usage.output_tokens), (1000, 100), "{style:?}");
        let found = answer.detections;
        let b = found[0].bounds;
        assert_eq!((b.x0, b.y0, b.x1, b.y1, found[0].score), (40.0, 60.0, 200.0, 240.0, None), "{style:?}");
    }
}
