//! Every offline player on a small synthetic photo, through the checks that any player's answers go through.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::{Arc, Mutex};

use harmony_calls::{BookOptions, CallBook, CallOptions, Calls};
use harmony_io::LoadedMask;
use harmony_lighting::{LightingDelta, LightingSpec};
use harmony_mesh::{PartModel, TemplateParams};
use harmony_players::{MaskFiles, casting_report, offline_cast};
use harmony_prompts::{
    CompletedAnswer, CompletedVars, FrontPanel, FrontsAnswer, FrontsVars, InspectAnswer, InspectVars, LayoutAnswer,
    LayoutVars, LightingReviewVars, LightsVars, ListAnswer, ListVars, Question, ReviewAnswer, ReviewVars, completed,
    fronts, inspect, layout, lighting_review, lights, list, review,
};
use harmony_roles::{
    DetectRequest, EditKind, EditRequest, GeometryAnswer, GeometryRequest, MeshFrame, MeshRequest, MeshSettings,
    PhraseRequest, Picture, Role, RoleError, SegmentPrompt, SegmentRequest, Segmenter, VlmRequest,
};
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Level, Mask, PixelBox, SceneCamera, Size, Vec3, Warning};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json};

const SIZE: ImageSize = ImageSize { width: 160, height: 120 };

/// The red thing in the photo.
const THING: PixelBox = PixelBox { x0: 60.0, y0: 50.0, x1: 110.0, y1: 95.0 };

/// A wall, a floor, and a red thing on it.
fn photo() -> Arc<RgbImage> {
    Arc::new(RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
        let noise = ((x * 7 + y * 13) % 5) as u8;
        let inside = inside(&THING, x, y);
        if inside {
            Rgb([180 + noise, 30, 40])
        } else if y < 70 {
            Rgb([225, 222 + noise, 215])
        } else {
            Rgb([120 + noise, 95, 70])
        }
    }))
}

fn inside(b: &PixelBox, x: u32, y: u32) -> bool {
    let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
    b.x0 <= x && x < b.x1 && b.y0 <= y && y < b.y1
}

struct Desk {
    calls: Calls,
    warnings: Arc<Mutex<Vec<Warning>>>,
    _run: tempfile::TempDir,
}

/// The offline cast at work; an answer that is not acceptable is an error here, for nobody else can stand in.
fn desk() -> Desk {
    let run = tempfile::tempdir().unwrap();
    let warnings: Arc<Mutex<Vec<Warning>>> = Arc::default();
    let sink = warnings.clone();
    let options = CallOptions { on_warning: Arc::new(move |w| sink.lock().unwrap().push(w)), ..CallOptions::default() };
    let book = Arc::new(CallBook::open(run.path(), BookOptions::default()).unwrap());
    Desk { calls: Calls::new(book, offline_cast(), offline_cast(), options), warnings, _run: run }
}

#[expect(clippy::needless_pass_by_value, reason = "so that facts can be written in the call")]
fn asked(name: &str, question: Question, facts: Value) -> VlmRequest {
    VlmRequest {
        name: name.into(),
        prompt: question.prompt,
        pictures: vec![Picture { caption: "IMAGE 1: the photo".into(), image: photo() }],
        schema: question.schema,
        example: question.example,
        facts: json!({"question": question.kind, "facts": facts}),
    }
}

#[tokio::test]
async fn the_layout_is_what_was_measured_and_fits_its_schema_even_without_facts() {
    let desk = desk();
    let question = || layout(&LayoutVars { width: 160, height: 120, measured: String::new() });
    let facts = json!({
        "extents": {"width": 3.3, "height": 2.4, "depth": 5.5}, "camera_height_m": 1.4, "tilt_deg": 5.0,
        "yaw_deg": -12.0, "dist_to_back_m": 4.4, "confidence": 0.7
    });
    let answer: LayoutAnswer =
        desk.calls.ask_as(&asked("1_layout/layout", question(), facts), LayoutAnswer::check).await.unwrap();
    assert_eq!((answer.room.floor_width_m, answer.room.ceiling_height_m), (3.3, 2.4));
    assert_eq!((answer.camera.yaw_deg, answer.camera.dist_to_back_m), (-12.0, 4.4));
    assert!(answer.pins.is_empty() && answer.camera.corner_px.is_none(), "nothing is pretended");
    assert!(answer.camera.floor_junction_y_frac > 0.5);

    let hostile = json!({"extents": {"width": 1e9, "height": "x"}, "tilt_deg": null, "camera_height_m": -5});
    for (name, facts) in [("1_layout/none", Value::Null), ("1_layout/hostile", hostile)] {
        let answer: LayoutAnswer =
            desk.calls.ask_as(&asked(name, question(), facts), LayoutAnswer::check).await.unwrap();
        assert!(answer.room.floor_width_m <= 40.0);
    }
}

#[tokio::test]
async fn nothing_is_listed_where_no_surface_is_known() {
    let desk = desk();
    for level in Level::ALL {
        let vars = ListVars { level, room_type: "room".into(), with_boxes: true, placed: vec![] };
        let request = asked(&format!("{}/list", level.folder()), list(&vars), json!({"level": level}));
        let answer: ListAnswer = desk.calls.ask_as(&request, ListAnswer::check).await.unwrap();
        assert!(answer.items.is_empty());
    }
}

#[tokio::test]
async fn a_list_with_a_known_room_fits_its_schema() {
    let desk = desk();
    let camera = Camera::looking(SIZE, Intrinsics::centred(SIZE, 140.0), Vec3::new(2.0, 1.4, 4.5), Vec3::NEG_Z);
    for level in Level::ALL {
        let vars = ListVars { level, room_type: "room".into(), with_boxes: true, placed: vec![] };
        let facts = json!({
            "level": level, "with_boxes": true, "camera": SceneCamera::from(&camera),
            "extents": Extents { width: 4.0, height: 2.6, depth: 5.0 }
        });
        let request = asked(&format!("{}/list", level.folder()), list(&vars), facts);
        let answer: ListAnswer = desk.calls.ask_as(&request, ListAnswer::check).await.unwrap();
        for item in &answer.items {
            assert_eq!(item.count as usize, item.instances.len());
        }
        assert!(level != Level::Decoration || answer.items.is_empty());
    }
}

#[tokio::test]
async fn inspection_keeps_every_candidate_with_a_plausible_size_in_the_order_from_far_to_near() {
    let desk = desk();
    let vars = InspectVars {
        level: Level::Decoration,
        room_type: "room".into(),
        room: String::new(),
        candidates: vec![],
        placed: vec![],
        templates: vec![],
        with_models: true,
    };
    let near = json!({"id": "vase_01", "label": "vase", "box": PixelBox { x0: 70.0, y0: 60.0, x1: 80.0, y1: 90.0 },
        "estimated_size_m": {"width": 90.0, "height": 900.0, "depth": 0.0}, "host": null});
    let far = json!({"id": "blob_01", "label": "unheard-of", "box": PixelBox { x0: 10.0, y0: 5.0, x1: 20.0, y1: 30.0 },
        "estimated_size_m": null, "host": "table_02"});
    let table = |id: &str, y1: f64| {
        let bounds = PixelBox { x0: 50.0, y0: 40.0, x1: 120.0, y1 };
        json!({"id": id, "label": "table", "level": "furniture", "box": bounds})
    };
    let facts = json!({
        "level": "decoration", "candidates": [near, far, {"no": "id"}],
        "placed": [table("table_01", 95.0), table("table_02", 110.0), table("table_03", 80.0)]
    });
    let ids = ["vase_01".to_owned(), "blob_01".to_owned()];
    let request = asked("5_decoration/inspect", inspect(&vars), facts);
    let answer: InspectAnswer = desk.calls.ask_as(&request, |a: &InspectAnswer| a.check(&ids)).await.unwrap();
    assert_eq!(answer.placement_order, ["blob_01", "vase_01"]);
    let vase = &answer.objects[0];
    assert!(vase.keep && vase.size_m.height < 4.1, "a vase is not 900 m high: {:?}", vase.size_m);
    assert_eq!(vase.on_top_of.as_deref(), Some("table_02"), "the nearest under its foot");
    assert_eq!(answer.objects[1].on_top_of.as_deref(), Some("table_02"), "as listed");
    assert!(answer.objects[1].template.is_none());
}

#[tokio::test]
async fn where_nobody_looks_nothing_is_objected_to() {
    let desk = desk();
    let ids = vec!["chair_01".to_owned(), "sofa_01".to_owned()];
    let facts = json!({"objects": ids});
    let question = completed(&CompletedVars { objects: vec![] });
    let request = asked("3_furniture/completed", question, facts.clone());
    let answer: CompletedAnswer = desk.calls.ask_as(&request, |a: &CompletedAnswer| a.check(&ids)).await.unwrap();
    assert!(answer.objects.iter().all(|o| o.matches));
    let request = asked("3_furniture/fronts", fronts(&FrontsVars { objects: vec![] }), facts);
    let answer: FrontsAnswer = desk.calls.ask_as(&request, |a: &FrontsAnswer| a.check(&ids)).await.unwrap();
    assert!(answer.objects.iter().all(|o| o.front_panel == FrontPanel::A));
    let vars = ReviewVars {
        level: Level::Furniture,
        room: String::new(),
        objects: vec![],
        unplaced: vec![],
        findings: vec!["- chair_01: outline agreement 0.10".into()],
    };
    let request = asked("3_furniture/review_1", review(&vars), Value::Null);
    let answer: ReviewAnswer = desk.calls.ask_as(&request, |a: &ReviewAnswer| a.check(&ids)).await.unwrap();
    assert!(answer.converged && answer.actions.is_empty());
}

#[tokio::test]
async fn lamps_shine_when_they_are_bright_and_the_measured_correction_is_taken() {
    let desk = desk();
    let lamp = |id: &str| {
        json!({"id": id, "kind": "point", "radius_m": 0.05, "position": [1.0, 1.5, 1.0],
            "color": [1.0, 0.9, 0.8], "intensity": 8.0, "on": true, "object": id})
    };
    let window = json!({"id": "window_01", "kind": "area", "direction": [0.0, 0.0, 1.0], "size_m": [1.0, 1.2],
        "position": [2.0, 1.5, 0.0], "color": [1.0, 1.0, 1.0], "intensity": 80.0, "on": true, "object": "window_01"});
    let facts = json!({
        "lighting": {"lights": [lamp("lamp_01"), lamp("lamp_02"), lamp("lamp_03"), window],
            "ambient_color": [1.0, 1.0, 1.0], "ambient_intensity": 0.5, "exposure": 0.0},
        "photo_luminance": 0.2,
        "seen": [{"id": "lamp_01", "luminance": 0.9}, {"id": "lamp_02", "luminance": 0.1},
            {"id": "window_01", "luminance": 0.1}]
    });
    let question = lights(&LightsVars { sources: vec![] });
    let spec: LightingSpec =
        desk.calls.ask_as(&asked("6_lighting/lights", question, facts), |_: &LightingSpec| Ok(())).await.unwrap();
    let told: Vec<_> = spec.point_lights.iter().map(|l| (l.id.as_str(), l.on)).collect();
    assert_eq!(told, [("lamp_01", Some(true)), ("lamp_02", Some(false))], "of an unseen lamp nothing is said");
    assert_eq!(spec.windows[0].daylight_on, Some(false));

    let question = || lighting_review(&LightingReviewVars { setup: String::new(), measured: String::new() });
    let mut proposed = question().example;
    proposed["global_intensity_mult"] = json!(0.7);
    let request = asked("6_lighting/review_1", question(), json!({"proposed": proposed.clone()}));
    let delta: LightingDelta = desk.calls.ask_as(&request, |_: &LightingDelta| Ok(())).await.unwrap();
    assert_eq!(delta, serde_json::from_value(proposed).unwrap());
    assert!(!delta.is_converged());
    let request = asked("6_lighting/review_2", question(), Value::Null);
    let delta: LightingDelta = desk.calls.ask_as(&request, |_: &LightingDelta| Ok(())).await.unwrap();
    assert!(delta.is_converged());
}

#[tokio::test]
async fn a_question_without_a_rule_is_declined() {
    let desk = desk();
    let mut request =
        asked("1_layout/poem", layout(&LayoutVars { width: 1, height: 1, measured: String::new() }), Value::Null);
    request.facts = Value::Null;
    let error = desk.calls.ask(&request, |_| Ok(())).await.unwrap_err();
    assert!(matches!(error, RoleError::NotCapable { .. }), "{error}");
}

#[tokio::test]
async fn the_segmenter_cuts_the_thing_out() {
    let prompt = |bounds| SegmentPrompt { key: "x".into(), label: "thing".into(), bounds, outline: None };
    let outside = PixelBox { x0: 500.0, y0: 500.0, x1: 600.0, y1: 600.0 };
    let request = SegmentRequest {
        name: "3_furniture/masks".into(),
        image: photo(),
        prompts: vec![prompt(PixelBox { x0: 57.0, y0: 48.0, x1: 112.0, y1: 97.0 }), prompt(outside)],
    };
    let masks = desk().calls.segment(&request).await.unwrap();
    let truth = Mask::from_fn(SIZE, |x, y| inside(&THING, x, y));
    assert!(masks[0].mask.iou(&truth) >= 0.9, "{}", masks[0].mask.iou(&truth));
    assert_eq!(masks[1].mask.count(), 0, "what is outside the photo is empty");
}

#[tokio::test]
async fn the_editor_fills_what_is_marked_and_completes_what_is_symmetric() {
    let desk = desk();
    let mask = Mask::from_fn(SIZE, |x, y| inside(&THING, x, y)).dilated(2);
    let edit = |name: &str, kind, mask: Option<Mask>, object: Option<Mask>| EditRequest {
        name: name.into(),
        kind,
        image: photo(),
        mask: mask.map(Arc::new),
        object: object.map(Arc::new),
        instruction: String::new(),
    };
    let empty = edit("1_layout/empty_room", EditKind::EmptyRoom, Some(mask.clone()), None);
    let room = desk.calls.edit(&empty).await.unwrap().image;
    let red = room.pixels().filter(|p| p.0[0] > 150 && p.0[1] < 60).count();
    assert_eq!(red, 0, "the red thing is gone");
    assert!(room.pixels().all(|p| p.0[3] == 255));
    let nothing = edit("1_layout/empty_room_2", EditKind::EmptyRoom, None, None);
    assert!(matches!(desk.calls.edit(&nothing).await, Err(RoleError::NotCapable { .. })));

    // The right third of the thing is behind something that may change.
    let truth = Mask::from_fn(SIZE, |x, y| inside(&THING, x, y));
    let hider = Mask::from_fn(SIZE, |x, _| x >= 94);
    let amodal =
        edit("3_furniture/thing_01/complete", EditKind::Amodal, Some(hider.clone()), Some(truth.minus(&hider)));
    let image = desk.calls.edit(&amodal).await.unwrap().image;
    let alpha = Mask::from_fn(SIZE, |x, y| image.get_pixel(x, y).0[3] == 255);
    assert!(truth.minus(&hider).minus(&alpha).count() == 0, "what is seen stays");
    let unmarked = edit("3_furniture/thing_01/complete_2", EditKind::Amodal, None, None);
    assert!(matches!(desk.calls.edit(&unmarked).await, Err(RoleError::NotCapable { .. })));
}

fn mesh_request(name: &str, label: &str) -> MeshRequest {
    MeshRequest {
        name: name.into(),
        crop: Arc::new(RgbaImage::from_pixel(8, 8, Rgba([180, 30, 40, 255]))),
        label: label.into(),
        description: String::new(),
        level: Level::Furniture,
        size: Size { width: 2.0, height: 0.8, depth: 0.9 },
        template: None,
        params: TemplateParams::default(),
        part_model: None,
        settings: MeshSettings::default(),
    }
}

#[tokio::test]
async fn meshes_have_the_size_asked_for_and_say_what_they_were_made_from() {
    let desk = desk();
    let sofa = desk.calls.generate_mesh(&mesh_request("3_furniture/sofa_01/mesh", "leather sofa")).await.unwrap();
    let size = sofa.mesh.bounds().unwrap().size();
    assert!((size - glam::DVec3::new(2.0, 0.8, 0.9)).abs().max_element() <= 1e-3, "{size}");
    assert_eq!(sofa.frame, MeshFrame::Canonical);
    assert!(sofa.convex.is_some() && sofa.part_model.is_some());

    let mut given = mesh_request("3_furniture/chair_01/mesh", "chair");
    given.part_model = Some(PartModel::example());
    let chair = desk.calls.generate_mesh(&given).await.unwrap();
    assert_eq!(chair.source, "part model");

    let mut broken = mesh_request("3_furniture/chair_02/mesh", "chair");
    broken.part_model = Some(PartModel::default());
    let chair = desk.calls.generate_mesh(&broken).await.unwrap();
    assert!(chair.source != "part model" && chair.notes[0].contains("part model can't be built"), "{:?}", chair.notes);

    let blob = desk.calls.generate_mesh(&mesh_request("3_furniture/blob_01/mesh", "zzyzx")).await.unwrap();
    assert!(blob.source == "plain body" && blob.notes[0].contains("zzyzx"));
    let mut absurd = mesh_request("3_furniture/sofa_02/mesh", "sofa");
    absurd.size = Size { width: f64::NAN, height: -1.0, depth: 1e9 };
    let sofa = desk.calls.generate_mesh(&absurd).await.unwrap();
    assert!(sofa.notes.iter().any(|n| n.contains("usual")), "{:?}", sofa.notes);
}

#[tokio::test]
async fn the_estimator_says_that_it_has_no_depth_and_what_it_saw() {
    let request = GeometryRequest { name: "1_layout/points".into(), image: photo(), exif_focal_px: Some(150.0) };
    let GeometryAnswer::NoDepth { evidence } = desk().calls.estimate(&request).await.unwrap() else {
        panic!("there is no depth in a photo alone")
    };
    let focal = evidence["focal_px"].as_f64().unwrap();
    assert!((focal / 150.0).ln().abs() <= 0.1, "EXIF is believed: {focal}");
    assert!(evidence["confidence"].as_f64().is_some());
}

#[tokio::test]
async fn the_detector_gives_boxes_in_the_photo_and_never_a_score() {
    let phrase = |label: &str| PhraseRequest { label: label.into(), phrase: label.into(), count: 100_000 };
    let request = DetectRequest {
        name: "3_furniture/boxes".into(),
        image: photo(),
        level: Level::Furniture,
        phrases: vec![phrase("sofa"), phrase("thing")],
    };
    let found = desk().calls.detect(&request).await.unwrap().detections;
    assert!(found.len() <= 50);
    assert!(found.iter().all(|d| d.score.is_none()));
}

#[tokio::test]
async fn given_masks_answer_by_overlap_and_label() {
    let one = |name: &str, label: Option<&str>, b: PixelBox| LoadedMask {
        name: name.into(),
        label: label.map(str::to_owned),
        mask: Mask::from_fn(SIZE, |x, y| inside(&b, x, y)),
        color: None,
    };
    let lamp = PixelBox { x0: 10.0, y0: 10.0, x1: 20.0, y1: 60.0 };
    let masks = MaskFiles::new(vec![one("a", Some("chair"), THING), one("b", Some("floor lamp"), lamp)]);
    let prompt = |label: &str, bounds| SegmentPrompt { key: label.into(), label: label.into(), bounds, outline: None };
    let nowhere = PixelBox { x0: 130.0, y0: 90.0, x1: 150.0, y1: 110.0 };
    let request = SegmentRequest {
        name: "3_furniture/masks".into(),
        image: photo(),
        prompts: vec![prompt("lamp", lamp), prompt("red chair", THING), prompt("chair", THING), prompt("x", nowhere)],
    };
    let cut = masks.segment(&request).await.unwrap();
    assert_eq!(cut[0].mask.bounds(), Some(lamp));
    assert_eq!(cut[1].mask.bounds(), Some(THING));
    assert_eq!((cut[2].mask.count(), cut[3].mask.count()), (0, 0), "each mask is given once");

    let phrases =
        ["lamp", "table", "wooden chair"].map(|p| PhraseRequest { label: p.into(), phrase: p.into(), count: 1 });
    let request = DetectRequest {
        name: "3_furniture/boxes".into(),
        image: photo(),
        level: Level::Furniture,
        phrases: phrases.into(),
    };
    let found = harmony_roles::Detector::detect(&masks, &request).await.unwrap().detections;
    assert_eq!(
        found.iter().map(|d| (d.label.as_str(), d.bounds)).collect::<Vec<_>>(),
        [("lamp", lamp), ("wooden chair", THING)]
    );

    // Half the size, and the rest by graph cut.
    let small = LoadedMask { mask: one("b", None, lamp).mask.resized(ImageSize::new(80, 60)), ..one("b", None, lamp) };
    let masks = MaskFiles::new(vec![small]).with_rest(offline_cast().segmenter);
    let request = SegmentRequest {
        name: "3_furniture/masks".into(),
        image: photo(),
        prompts: vec![prompt("lamp", lamp), prompt("chair", THING)],
    };
    let cut = masks.segment(&request).await.unwrap();
    assert_eq!(cut[0].mask.bounds(), Some(lamp));
    assert!(cut[1].mask.count() > 0);
}

#[test]
fn the_report_speaks_of_every_role_and_says_how_to_do_better() {
    let report = casting_report(&offline_cast());
    assert_eq!(report.iter().map(|r| r.role).collect::<Vec<_>>(), Role::ALL);
    assert!(report.iter().all(|r| !r.detail.is_empty() && r.player.offline));
    for status in report.iter().filter(|r| !r.available) {
        assert!(status.hint.is_some(), "{status:?}");
    }
}

#[tokio::test]
async fn nothing_that_the_offline_cast_does_needs_a_warning() {
    let desk = desk();
    let request = GeometryRequest { name: "1_layout/points".into(), image: photo(), exif_focal_px: None };
    desk.calls.estimate(&request).await.unwrap();
    assert!(desk.warnings.lock().unwrap().is_empty());
}
