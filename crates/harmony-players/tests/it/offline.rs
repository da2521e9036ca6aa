//! Every offline player on a small synthetic photo, through the checks that any player's answers go through.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::{Arc, Mutex};

use harmony_calls::{BookOptions, CallBook, CallOptions, Calls};
use harmony_io::LoadedMask;
use harmony_lighting::{LightingDelta, LightingSpec, LightingVerdict};
use harmony_mesh::{PartModel, TemplateParams};
use harmony_players::{MaskFiles, casting_report, offline_cast};
use harmony_prompts::{
    Ask, CompletedQuestion, FrontPanel, FrontsQuestion, InspectCandidate, InspectQuestion, KnownDepth, KnownObject,
    LayoutQuestion, LightingReviewQuestion, LightsQuestion, ListQuestion, NamedObject, PlacedObject, ReviewQuestion,
    RoomSummary, RoomView, SeenObject, UnaidedRoom,
};
use harmony_roles::{
    DetectRequest, EditKind, EditRequest, GeometryAnswer, GeometryRequest, MeshFrame, MeshRequest, MeshSettings,
    PhraseRequest, Picture, Role, RoleError, SegmentPrompt, SegmentRequest, Segmenter, VlmRequest,
};
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Level, Light, LightKind, Lighting, Mask, ObjectId, PixelBox, SceneCamera,
    Size, Support, Vec3, ViewTransform, Warning,
};
use image::{Rgb, RgbImage, Rgba, RgbaImage};

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

impl Desk {
    /// The answer to a question about the photo, through its own check.
    async fn ask<Q: Ask>(&self, name: &str, question: Q) -> Q::Answer {
        let picture = Picture { caption: "IMAGE 1: the photo".into(), image: photo() };
        let request = VlmRequest::new(name.into(), question.clone().into(), vec![picture]);
        self.calls.ask_as(&request, |answer| question.check(answer)).await.unwrap()
    }
}

fn id(text: &str) -> ObjectId {
    ObjectId::new(text).unwrap()
}

fn room() -> RoomSummary {
    let extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };
    RoomSummary {
        extents,
        room_type: "room".into(),
        camera: [2.0, 1.4, 4.5],
        shape: harmony_scene::RoomShape::default(),
    }
}

fn table(name: &str, y1: f64) -> PlacedObject {
    PlacedObject {
        id: id(name),
        label: "table".into(),
        level: Level::Furniture,
        seen: Some(PixelBox { x0: 50.0, y0: 40.0, x1: 120.0, y1 }),
        position: [1.0, 0.0, 1.0],
        yaw_deg: 0.0,
        size: Size { width: 1.2, height: 0.74, depth: 0.6 },
        support: Support::Floor,
        outline_agreement: Some(0.1),
    }
}

#[tokio::test]
async fn the_layout_is_what_was_measured_and_fits_its_schema_even_when_nothing_was() {
    let desk = desk();
    let measured = UnaidedRoom {
        extents: Extents { width: 3.3, height: 2.4, depth: 5.5 },
        camera_height_m: 1.4,
        tilt_deg: 5.0,
        yaw_deg: -12.0,
        dist_to_back_m: 4.4,
        confidence: 0.7,
    };
    let question = |unaided| LayoutQuestion { photo: SIZE, depth: KnownDepth::None, unaided };
    let answer = desk.ask("1_layout/layout", question(Some(measured))).await;
    assert_eq!((answer.room.floor_width_m, answer.room.ceiling_height_m), (3.3, 2.4));
    assert_eq!((answer.camera.yaw_deg, answer.camera.dist_to_back_m), (-12.0, 4.4));
    assert!(answer.pins.is_empty() && answer.camera.corner_px.is_none(), "nothing is pretended");
    assert!(answer.camera.floor_junction_y_frac > 0.5);

    let hostile = UnaidedRoom {
        extents: Extents { width: 1e9, height: f64::NAN, depth: f64::INFINITY },
        camera_height_m: -5.0,
        tilt_deg: f64::NAN,
        yaw_deg: 1e300,
        dist_to_back_m: 0.0,
        confidence: f64::NAN,
    };
    for (name, unaided) in [("1_layout/none", None), ("1_layout/hostile", Some(hostile))] {
        let answer = desk.ask(name, question(unaided)).await;
        assert!(answer.room.floor_width_m <= 40.0);
    }
}

fn list(level: Level, view: Option<RoomView>) -> ListQuestion {
    ListQuestion { level, room_type: "room".into(), with_boxes: true, placed: vec![], trays: vec![], view }
}

#[tokio::test]
async fn nothing_is_listed_where_no_surface_is_known() {
    let desk = desk();
    for level in Level::ALL {
        assert!(desk.ask(&format!("{}/list", level.folder()), list(level, None)).await.items.is_empty());
    }
}

#[tokio::test]
async fn a_list_with_a_known_room_fits_its_schema() {
    let desk = desk();
    let camera = Camera::looking(SIZE, Intrinsics::centred(SIZE, 140.0), Vec3::new(2.0, 1.4, 4.5), Vec3::NEG_Z);
    for level in Level::ALL {
        let view = RoomView { camera: SceneCamera::from(&camera), extents: room().extents };
        let answer = desk.ask(&format!("{}/list", level.folder()), list(level, Some(view))).await;
        for item in &answer.items {
            assert_eq!(item.count as usize, item.instances.len());
        }
        assert!(level != Level::Decoration || answer.items.is_empty());
    }
}

#[tokio::test]
async fn inspection_keeps_every_candidate_with_a_plausible_size_in_the_order_from_far_to_near() {
    let desk = desk();
    let candidate = |name: &str, label: &str, bounds, estimated_size_m, host| InspectCandidate {
        id: id(name),
        label: label.into(),
        phrase: label.into(),
        bounds,
        image: SIZE,
        estimated_size_m,
        host,
        program_follows: false,
    };
    let huge = Size { width: 90.0, height: 900.0, depth: 0.0 };
    let near = PixelBox { x0: 70.0, y0: 60.0, x1: 80.0, y1: 90.0 };
    let far = PixelBox { x0: 10.0, y0: 5.0, x1: 20.0, y1: 30.0 };
    let tables = [table("table_01", 95.0), table("table_02", 110.0), table("table_03", 80.0)];
    let question = InspectQuestion {
        level: Level::Decoration,
        room_type: "room".into(),
        room: room(),
        candidates: vec![
            candidate("vase_01", "vase", near, Some(huge), None),
            candidate("blob_01", "unheard-of", far, None, Some(id("table_02"))),
        ],
        others: vec![],
        placed: tables.map(KnownObject::Placed).to_vec(),
        templates: vec![],
        with_models: true,
    };
    let answer = desk.ask("5_decoration/inspect", question).await;
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
    let objects: Vec<NamedObject> =
        ["chair_01", "sofa_01"].map(|id| NamedObject { id: id.into(), about: "a seat".into() }).to_vec();
    let answer = desk.ask("3_furniture/completed", CompletedQuestion { objects: objects.clone() }).await;
    assert!(answer.objects.iter().all(|o| o.matches));
    let answer = desk.ask("3_furniture/fronts", FrontsQuestion { objects }).await;
    assert!(answer.objects.iter().all(|o| o.front_panel == FrontPanel::A));
    let question = ReviewQuestion {
        level: Level::Furniture,
        room: room(),
        placed: vec![table("table_01", 95.0)],
        unplaced: vec![],
        findings: vec!["- table_01: outline agreement 0.10".into()],
        tried: vec![],
    };
    let answer = desk.ask("3_furniture/review_1", question).await;
    assert!(answer.converged && answer.actions.is_empty());
}

#[tokio::test]
async fn lamps_shine_when_they_are_bright_and_the_measured_correction_is_taken() {
    let desk = desk();
    let light = |name: &str, kind| Light {
        id: name.into(),
        kind,
        position: [1.0, 1.5, 1.0],
        color: [1.0, 0.9, 0.8],
        intensity: 8.0,
        on: true,
        object: Some(id(name)),
        shade: None,
    };
    let mut lights: Vec<Light> =
        ["lamp_01", "lamp_02", "lamp_03"].map(|name| light(name, LightKind::Point { radius_m: 0.05 })).to_vec();
    lights.push(light("window_01", LightKind::Area { direction: [0.0, 0.0, 1.0], size_m: [1.0, 1.2] }));
    let lighting = Lighting {
        lights,
        ambient_color: [1.0; 3],
        ambient_intensity: 0.5,
        exposure: 0.0,
        view: ViewTransform::default(),
    };
    let seen = [("lamp_01", 0.9), ("lamp_02", 0.1), ("window_01", 0.1)];
    let question = LightsQuestion {
        lighting: lighting.clone(),
        screens: vec![],
        photo_luminance: 0.2,
        seen: seen.map(|(name, luminance)| SeenObject { id: id(name), luminance }).to_vec(),
    };
    let spec: LightingSpec = desk.ask("6_lighting/lights", question).await;
    let told: Vec<_> = spec.point_lights.iter().map(|l| (l.id.as_str(), l.on)).collect();
    assert_eq!(told, [("lamp_01", Some(true)), ("lamp_02", Some(false))], "of an unseen lamp nothing is said");
    assert_eq!(spec.windows[0].daylight_on, Some(false));

    let proposed = LightingDelta {
        global_intensity_mult: Some(0.7),
        verdict: LightingVerdict::Adjust,
        ..LightingDelta::default()
    };
    let question = LightingReviewQuestion { lighting, stops: 0.5, warmth: 0.0, proposed: proposed.clone() };
    assert_eq!(desk.ask("6_lighting/review_1", question).await, proposed);
}

#[tokio::test]
async fn a_question_in_words_only_is_declined() {
    let desk = desk();
    let question = LayoutQuestion { photo: SIZE, depth: KnownDepth::None, unaided: None };
    let mut request = VlmRequest::new("1_layout/layout".into(), question.into(), vec![]);
    request.question = None;
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
