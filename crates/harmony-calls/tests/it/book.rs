//! Records on disk: every role's answer comes back, half-written ones are ignored, recordings are replayed.

use std::sync::Arc;

use crate::common::{Desk, Everyone, Scripted, cast, photo, sane, small_mesh, tree, width_question};
use harmony_calls::{BookOptions, CallBook, RecordingAbout, Source, export_recording};
use harmony_mesh::TemplateParams;
use harmony_roles::{
    DetectRequest, EditKind, EditRequest, GeometryAnswer, GeometryRequest, LitRequest, MeshFrame, MeshRequest,
    MeshSettings, PhraseRequest, Role, SegmentPrompt, SegmentRequest,
};
use harmony_scene::{Camera, ImageSize, Intrinsics, Level, Lighting, Mask, PixelBox, Size, Vec3, WarningKind};
use image::{Rgba, RgbaImage};
use serde_json::json;

/// One call of every role but the language model's; the answers as text that can be compared.
async fn every_role(desk: &Desk) -> Vec<String> {
    let calls = &desk.calls;
    let image = photo();
    let size = ImageSize::new(16, 10);
    let phrase = PhraseRequest { label: "chair".into(), phrase: "a chair".into(), count: 1 };
    let name = |what: &str| format!("3_furniture/{what}");
    let detect =
        DetectRequest { name: name("boxes"), image: image.clone(), level: Level::Furniture, phrases: vec![phrase] };
    let prompt = |key: &str| SegmentPrompt {
        key: key.into(),
        label: "chair".into(),
        bounds: PixelBox { x0: 1.0, y0: 1.0, x1: 5.0, y1: 6.0 },
        outline: None,
    };
    let segment = SegmentRequest {
        name: name("masks"),
        image: image.clone(),
        prompts: vec![prompt("chair_01"), prompt("../../../etc/passwd")],
    };
    let edit = EditRequest {
        name: "3_furniture/chair_01/completed".into(),
        kind: EditKind::Amodal,
        image: image.clone(),
        mask: Some(Arc::new(Mask::from_fn(size, |x, _| x > 4))),
        object: None,
        instruction: "complete the chair".into(),
    };
    let mesh = MeshRequest {
        name: "3_furniture/chair_01/mesh".into(),
        crop: Arc::new(RgbaImage::from_pixel(6, 6, Rgba([1, 2, 3, 255]))),
        label: "chair".into(),
        description: "a chair".into(),
        level: Level::Furniture,
        size: Size { width: 0.5, height: 0.9, depth: 0.5 },
        template: None,
        params: TemplateParams::default(),
        part_model: None,
        settings: MeshSettings::default(),
    };
    let geometry = GeometryRequest { name: "1_layout/points".into(), image, exif_focal_px: Some(1.0 / 3.0) };
    let lit = LitRequest {
        name: "6_lighting/lit".into(),
        glb: "somewhere/scene.glb".into(),
        glb_hash: "abc".into(),
        camera: Camera::looking(size, Intrinsics::centred(size, 20.0), Vec3::ONE, Vec3::NEG_Z),
        lighting: Lighting {
            lights: vec![],
            ambient_color: [1.0; 3],
            ambient_intensity: 1.0,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::Agx,
        },
        room: None,
        samples: 16,
        denoise: true,
        albedo: None,
        hidden_nodes: Vec::new(),
        background: None,
        kind: harmony_roles::LitKind::Picture,
    };
    let mut told = vec![format!("{:?}", calls.detect(&detect).await.unwrap())];
    told.push(format!("{:?}", calls.segment(&segment).await.unwrap()));
    told.push(format!("{:?}", calls.edit(&edit).await.unwrap()));
    let made = calls.generate_mesh(&mesh).await.unwrap();
    assert_eq!(made.frame, MeshFrame::Raw);
    assert_eq!(made.source, "test chair");
    assert_eq!(made.notes, ["a note"]);
    told.push(format!("{made:?}"));
    told.push(format!("{:?}", calls.estimate(&geometry).await.unwrap()));
    told.push(format!("{:?}", calls.render_lit(&lit).await.unwrap()));
    told
}

fn open(run: &std::path::Path, others: &Arc<Everyone>, offline: &Arc<Everyone>) -> Desk {
    let vlm = Scripted::saying("offline", true, &[]);
    Desk::with(run, BookOptions::default(), cast(&vlm, others), cast(&vlm, offline))
}

#[tokio::test]
async fn every_role_comes_back_from_its_record_without_a_call() {
    let run = tempfile::tempdir().unwrap();
    let others = Everyone::new("others", false, false);
    let first = every_role(&open(run.path(), &others, &others)).await;
    assert_eq!(*others.asked.lock().unwrap(), 6);
    let before = tree(run.path());
    let again = open(run.path(), &others, &others);
    let second = every_role(&again).await;
    assert_eq!(*others.asked.lock().unwrap(), 6, "nobody is asked twice");
    assert_eq!(again.calls.counts().reused, 6);
    assert_eq!(first, second);
    assert_eq!(before, tree(run.path()));
    assert_eq!(again.calls.book().log().unwrap().len(), 6);
}

#[tokio::test]
async fn a_mesh_and_a_point_map_lose_nothing_in_their_record() {
    let run = tempfile::tempdir().unwrap();
    let others = Everyone::new("others", false, false);
    let desk = open(run.path(), &others, &others);
    every_role(&desk).await;
    let glb = run.path().join("calls/mesh_generator/3_furniture/chair_01/mesh/answer.glb");
    let mesh = harmony_io::load_mesh_glb(&glb, &harmony_io::ReadLimits::default()).unwrap();
    let want = small_mesh(0.0);
    assert_eq!(mesh.triangle_count(), want.triangle_count());
    let corners = |mesh: &harmony_mesh::Mesh| -> Vec<_> {
        let mut all: Vec<_> = mesh
            .groups
            .iter()
            .flat_map(|g| g.triangles.iter().flatten().map(|i| (mesh.materials[g.material].name.clone(), *i)))
            .map(|(name, i)| (name, mesh.positions[i as usize].to_array().map(f32::to_bits)))
            .collect();
        all.sort();
        all
    };
    assert_eq!(corners(&mesh), corners(&want));
    let legs = mesh.materials.iter().find(|m| m.name == "legs").unwrap();
    assert_eq!(legs.base_color, want.materials[1].base_color);
    assert_eq!(legs.texture.as_ref().unwrap().as_raw(), want.materials[1].texture.as_ref().unwrap().as_raw());
    assert_eq!((legs.transmission, legs.ior), (0.25, 1.45));

    let request = GeometryRequest { name: "1_layout/points".into(), image: photo(), exif_focal_px: Some(1.0 / 3.0) };
    let GeometryAnswer::Points(map) = desk.calls.estimate(&request).await.unwrap() else { panic!("points") };
    let GeometryAnswer::Points(fresh) = harmony_roles::GeometryEstimator::estimate(&*others, &request).await.unwrap()
    else {
        panic!("points")
    };
    assert_eq!(map.size, fresh.size);
    assert_eq!(map.intrinsics, fresh.intrinsics);
    assert_eq!(map.kind, fresh.kind);
    assert_eq!(map.confidence, fresh.confidence);
    let bits = |p: &glam::Vec3| p.is_finite().then(|| p.to_array().map(f32::to_bits));
    assert!(map.xyz.iter().map(bits).eq(fresh.xyz.iter().map(bits)));
}

#[tokio::test]
async fn unusable_answers_of_every_role_are_replaced() {
    let run = tempfile::tempdir().unwrap();
    let hostile = Everyone::new("hostile", false, true);
    let offline = Everyone::new("offline", true, false);
    let desk = open(run.path(), &hostile, &offline);
    let told = every_role(&desk).await;
    let clean = tempfile::tempdir().unwrap();
    assert_eq!(told, every_role(&open(clean.path(), &offline, &offline)).await);
    // All but the renderer, which has nothing hostile to say.
    assert_eq!(desk.warnings().len(), 5);
    assert_eq!(desk.calls.counts().replaced, 5);
}

#[tokio::test]
async fn a_half_written_record_is_no_record() {
    let run = tempfile::tempdir().unwrap();
    let calls = run.path().join("calls");
    // What a killed program can leave: a temporary folder, and (after a power cut) a record that is cut off.
    std::fs::create_dir_all(calls.join(".tmp/0")).unwrap();
    std::fs::write(calls.join(".tmp/0/record.json"), "{\"ver").unwrap();
    let folder = calls.join("vision_language/1_layout/layout");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("record.json"), "{\"version\": 1, \"na").unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &Scripted::saying("offline", true, &[]));
    assert!(!calls.join(".tmp/0").exists(), "opening removes what was half-written");
    assert!(desk.calls.book().log().unwrap().is_empty());
    desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    assert_eq!(desk.calls.book().log().unwrap().len(), 1);
    assert_eq!(vlm.asked(), 1);
}

#[tokio::test]
async fn two_names_that_would_share_a_folder_are_refused() {
    let run = tempfile::tempdir().unwrap();
    let good = json!({"width_m": 4});
    let vlm = Scripted::saying("model", false, &[good.clone(), good.clone(), good]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &Scripted::saying("offline", true, &[]));
    desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    for name in ["1_layout", "1_layout/layout/images"] {
        let error = desk.calls.ask(&width_question(name), sane).await.unwrap_err();
        assert!(error.is_fatal(), "{name}");
    }
    assert!(run.path().join("calls/vision_language/1_layout/layout/answer.json").is_file());
}

#[tokio::test]
async fn a_recording_holds_answers_only_and_is_replayed_by_name() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4.25})]);
    let offline = Scripted::saying("offline", true, &[json!({"width_m": 1.5}), json!({"width_m": 2.5})]);
    let question = width_question("1_layout/layout");
    Desk::open(run.path(), BookOptions::default(), &vlm, &offline).calls.ask(&question, sane).await.unwrap();
    let out = tempfile::tempdir().unwrap();
    let about = RecordingAbout::texts("test room", "a person", "CC0-1.0");
    assert_eq!(export_recording(run.path(), out.path(), &about).unwrap(), 1);
    let files: Vec<_> = tree(out.path()).into_iter().map(|(path, _)| path.display().to_string()).collect();
    assert_eq!(files, ["recording.json", "vision_language/1_layout/layout/answer.json"]);

    let fresh = tempfile::tempdir().unwrap();
    let replay = || BookOptions { replay: Some(out.path().to_owned()), ..BookOptions::default() };
    let desk = Desk::open(fresh.path(), replay(), &offline, &offline);
    assert_eq!(desk.calls.ask(&question, sane).await.unwrap().value["width_m"], 4.25);
    assert_eq!(offline.asked(), 0);
    assert_eq!(desk.calls.counts().replayed, 1);
    assert!(desk.warnings().is_empty(), "{:?}", desk.warnings());
    let log = desk.calls.book().log().unwrap();
    let source = Source::Recording { label: "test room".into(), question_differs: false };
    assert_eq!((log[0].source.clone(), log[0].player.as_str()), (source, "replay"));

    // Opened again: the record answers. With another recorded answer: the recording does.
    let again = Desk::open(fresh.path(), replay(), &offline, &offline);
    again.calls.ask(&question, sane).await.unwrap();
    assert_eq!(again.calls.counts().reused, 1);
    std::fs::write(out.path().join("vision_language/1_layout/layout/answer.json"), "{\"width_m\": 9}").unwrap();
    assert_eq!(again.calls.ask(&question, sane).await.unwrap().value["width_m"], 9);
    assert_eq!(again.calls.counts().replayed, 1);

    // Something that was not recorded goes to the cast player, and this is said.
    assert_eq!(again.calls.ask(&width_question("1_layout/other"), sane).await.unwrap().value["width_m"], 1.5);
    assert_eq!(again.warnings().last().unwrap().kind, WarningKind::PlayerReplaced);

    // A hostile recorded answer is refused like any other.
    std::fs::write(out.path().join("vision_language/1_layout/layout/answer.json"), "{\"width_m\": 1e300}").unwrap();
    assert_eq!(again.calls.ask(&question, sane).await.unwrap().value["width_m"], 2.5);
}

#[tokio::test]
async fn a_replayed_answer_to_another_question_is_taken_and_said() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4.25})]);
    let offline = Scripted::saying("offline", true, &[]);
    let mut question = width_question("1_layout/layout");
    Desk::open(run.path(), BookOptions::default(), &vlm, &offline).calls.ask(&question, sane).await.unwrap();
    question.prompt.push_str(" (new wording)");
    // The folder of a run can be replayed too.
    let fresh = tempfile::tempdir().unwrap();
    let options = || BookOptions { replay: Some(run.path().to_owned()), ..BookOptions::default() };
    let desk = Desk::open(fresh.path(), options(), &offline, &offline);
    assert_eq!(desk.calls.ask(&question, sane).await.unwrap().value["width_m"], 4.25);
    let warnings = desk.warnings();
    assert!(warnings.len() == 1 && warnings[0].message.contains("different question"), "{warnings:?}");
    let again = Desk::open(fresh.path(), options(), &offline, &offline);
    again.calls.ask(&question, sane).await.unwrap();
    assert_eq!((again.calls.counts().reused, again.warnings()), (1, warnings));
}

#[test]
fn a_folder_that_is_no_recording_is_refused_with_a_reason() {
    let run = tempfile::tempdir().unwrap();
    let none = tempfile::tempdir().unwrap();
    let open = || CallBook::open(run.path(), BookOptions { replay: Some(none.path().into()), ..Default::default() });
    assert!(open().unwrap_err().to_string().contains("recording.json"));
    std::fs::write(none.path().join("recording.json"), "{\"version\": 99}").unwrap();
    assert!(open().is_err());
    assert!(CallBook::open(run.path(), BookOptions::default()).unwrap().recording().is_none());
    assert_eq!(Role::ALL.len(), 7);
}
