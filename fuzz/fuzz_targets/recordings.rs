//! Recordings and run folders that are replayed: the manifest, the records, the answers of each role.
//!
//! The input is a folder: sections parted by `\n--- NAME\n`, each a file.
#![no_main]

use std::path::Path;
use std::sync::{Arc, OnceLock};

use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Recording};
use harmony_fuzz::{nobody, scratch};
use harmony_mesh::TemplateParams;
use harmony_roles::{
    DetectRequest, EditKind, EditRequest, GeometryRequest, MeshRequest, MeshSettings, Role, SegmentPrompt,
    SegmentRequest, VlmRequest,
};
use harmony_scene::{Level, PixelBox, Size};
use image::{RgbImage, RgbaImage};
use libfuzzer_sys::fuzz_target;
use serde_json::json;
use tokio::runtime::{Builder, Runtime};

fn runtime() -> &'static Runtime {
    static RUNTIME: OnceLock<Runtime> = OnceLock::new();
    RUNTIME.get_or_init(|| Builder::new_current_thread().build().expect("a runtime"))
}

/// Makes the folder; names that would leave it are left out.
fn unpack(folder: &Path, data: &[u8]) {
    let mut rest = data;
    for _ in 0..24 {
        let Some(start) = find(rest, b"\n--- ") else { return };
        rest = &rest[start + 5..];
        let Some(end) = find(rest, b"\n") else { return };
        let name = String::from_utf8_lossy(&rest[..end]).into_owned();
        rest = &rest[end + 1..];
        let body = &rest[..find(rest, b"\n--- ").unwrap_or(rest.len())];
        let safe = |part: &str| !part.is_empty() && part.len() < 80 && !part.starts_with('.') && !part.contains('\0');
        if name.split('/').count() <= 10 && name.split('/').all(safe) {
            let path = folder.join(&name);
            if let Some(parent) = path.parent() {
                let _ = std::fs::create_dir_all(parent);
            }
            let _ = std::fs::write(path, body);
        }
    }
}

fn find(text: &[u8], what: &[u8]) -> Option<usize> {
    text.windows(what.len()).position(|w| w == what)
}

async fn ask_everything(calls: &Calls) {
    let image = Arc::new(RgbImage::from_pixel(8, 6, image::Rgb([90, 90, 90])));
    let crop = Arc::new(RgbaImage::from_pixel(8, 6, image::Rgba([90, 90, 90, 255])));
    let schema = json!({"type": "object", "properties": {"a": {"type": "number"}}});
    let name = |step: &str| format!("3_furniture/{step}");
    let question = VlmRequest {
        name: name("list"),
        prompt: "What?".into(),
        pictures: Vec::new(),
        schema,
        example: json!({"a": 1}),
        facts: json!({}),
    };
    let _ = calls.ask(&question, |_| Ok(())).await;
    let detect = DetectRequest {
        name: name("detect"),
        image: image.clone(),
        level: Level::Furniture,
        phrases: Vec::new(),
    };
    let _ = calls.detect(&detect).await;
    let prompt = SegmentPrompt {
        key: "chair_01".into(),
        label: "chair".into(),
        bounds: PixelBox { x0: 1.0, y0: 1.0, x1: 5.0, y1: 5.0 },
        outline: None,
    };
    let segment = SegmentRequest { name: name("segment"), image: image.clone(), prompts: vec![prompt] };
    let _ = calls.segment(&segment).await;
    let edit = EditRequest {
        name: name("edit"),
        kind: EditKind::Amodal,
        image: image.clone(),
        mask: None,
        object: None,
        instruction: String::new(),
    };
    let _ = calls.edit(&edit).await;
    let mesh = MeshRequest {
        name: name("chair_01/mesh"),
        crop,
        label: "chair".into(),
        description: String::new(),
        level: Level::Furniture,
        size: Size { width: 0.5, height: 0.9, depth: 0.5 },
        template: None,
        params: TemplateParams::default(),
        part_model: None,
        settings: MeshSettings::default(),
    };
    let _ = calls.generate_mesh(&mesh).await;
    let geometry = GeometryRequest { name: "1_layout/geometry".into(), image, exif_focal_px: None };
    let _ = calls.estimate(&geometry).await;
}

fuzz_target!(|data: &[u8]| {
    let recording = scratch().join("recording");
    let run = scratch().join("run");
    let _ = std::fs::remove_dir_all(&recording);
    let _ = std::fs::remove_dir_all(&run);
    std::fs::create_dir_all(&recording).expect("a scratch folder");
    unpack(&recording, data);
    if let Ok(opened) = Recording::open(&recording) {
        for role in Role::ALL {
            let _ = opened.names(role);
        }
    }
    let _ = harmony_calls::export_recording(
        &recording,
        &run.join("export"),
        &harmony_calls::RecordingAbout::texts("l", "m", "CC0-1.0"),
    );
    let options = BookOptions { replay: Some(recording.clone()), ..BookOptions::default() };
    let Ok(book) = CallBook::open(&run, options) else { return };
    let calls = Calls::new(Arc::new(book), nobody::cast(), nobody::cast(), CallOptions::default());
    runtime().block_on(ask_everything(&calls));
    let _ = calls.book().log();
    let _ = calls.book().answers_digest("");
});
