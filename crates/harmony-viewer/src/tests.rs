//! The page with friendly and with hostile content.

use harmony_scene::{
    Camera, Confidence, Extents, ImageSize, Intrinsics, Level, Lighting, MaterialCategory, ObjectId, Opening,
    OpeningKind, Physical, PixelBox, Pose, Relations, Room, SCENE_VERSION, SceneCamera, SceneObject, Size, Support,
    Surface, SurfaceMaterial, SurfaceTexture, Vec3, Wall, Warning, WarningKind,
};

use super::*;

/// A scene whose every text is `text`.
fn scene(text: &str) -> Scene {
    let size = ImageSize::new(640, 480);
    let camera = Camera::looking(
        size,
        Intrinsics::from_horizontal_fov(size, 1.1),
        Vec3::new(2.0, 1.5, 4.0),
        Vec3::new(0.1, -0.1, -1.0),
    );
    let texture =
        || Some(SurfaceTexture { material: text.into(), color: text.into(), pattern: text.into(), tile_size_m: 1.0 });
    Scene {
        version: SCENE_VERSION,
        generator: text.into(),
        room: Room {
            room_type: text.into(),
            extents: Extents { width: 4.0, height: 2.5, depth: 5.0 },
            shape: harmony_scene::RoomShape::default(),
            seen: vec![Surface::Floor, Surface::Back],
            openings: vec![Opening {
                kind: OpeningKind::Window,
                wall: Wall::Left,
                u: [1.0, 2.0],
                y: [0.9, 2.1],
                inset: 0.0,
                rise: 0.0,
                object: None,
            }],
            floor_texture: texture(),
            wall_texture: texture(),
        },
        camera: SceneCamera::from(&camera),
        objects: vec![SceneObject {
            id: ObjectId::new("chair_01").unwrap(),
            index: 10,
            level: Level::Furniture,
            label: text.into(),
            description: text.into(),
            source_phrase: text.into(),
            pose: Pose::new(Vec3::new(1.0, 0.0, 1.0), 0.5, 1.0),
            size: Size { width: 0.5, height: 0.9, depth: 0.5 },
            support: Support::Floor,
            relations: Relations { group: Some(text.into()), matched_set: Some(text.into()), ..Relations::default() },
            material: SurfaceMaterial {
                category: MaterialCategory::Wood,
                pbr: MaterialCategory::Wood.defaults(),
                physical: Physical { weight_kg: 6.0, thickness_m: 0.02, elasticity: 0.1, rigid: None },
            },
            mesh: text.into(),
            mask: Some(text.into()),
            seen_box: Some(PixelBox { x0: 0.0, y0: 0.0, x1: 9.0, y1: 9.0 }),
            mesh_source: text.into(),
            confidence: Confidence {
                overall: 0.66,
                detection: Some(0.8),
                silhouette_iou: None,
                depth_residual_m: None,
            },
        }],
        lighting: Lighting {
            lights: Vec::new(),
            ambient_color: [1.0; 3],
            ambient_intensity: 0.2,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::Agx,
        },
        summary: text.into(),
        warnings: [("input", None), ("3_furniture", Some("chair_01")), ("9_unknown", None)]
            .map(|(phase, object)| Warning {
                phase: phase.into(),
                object: object.map(|o| ObjectId::new(o).unwrap()),
                kind: WarningKind::Input,
                message: text.into(),
            })
            .to_vec(),
    }
}

fn report(text: &str) -> ReportData {
    let fact = || Fact { name: text.into(), value: text.into(), note: text.into() };
    let evidence =
        || Evidence { method: text.into(), confidence: Some(0.5), because: text.into(), facts: vec![fact()] };
    ReportData {
        title: text.into(),
        finished: text.into(),
        profile: text.into(),
        facts: vec![fact()],
        phases: vec![
            PhaseReport {
                name: "3_furniture".into(),
                status: PhaseStatus::Done,
                seconds: 12.0,
                own_seconds: Some(3.0),
                waited_seconds: Some(700.0),
                outcome: text.into(),
            },
            PhaseReport {
                name: text.into(),
                status: PhaseStatus::Failed,
                seconds: 1.0,
                outcome: text.into(),
                ..PhaseReport::default()
            },
        ],
        calls: vec![CallRow {
            name: text.into(),
            role: text.into(),
            player: text.into(),
            problem: text.into(),
            seconds: 1.5,
            tokens_in: 1200,
            cost_usd: Some(0.02),
            ..CallRow::default()
        }],
        pictures: vec![ReportPicture { title: text.into(), path: "render_extra.png".into(), comparable: true }],
        objects: [(
            ObjectId::new("chair_01").unwrap(),
            ObjectReport {
                crop: Some("../outside.png".into()),
                confidence_because: text.into(),
                facts: vec![fact()],
                ..ObjectReport::default()
            },
        )]
        .into(),
        dropped: vec![DroppedObject { label: text.into(), phase: text.into(), reason: text.into() }],
        room: evidence(),
        camera: evidence(),
    }
}

/// Tag names of the page outside scripts and styles, and the number of script elements: a crude HTML reader.
fn tags(page: &str) -> (Vec<String>, usize) {
    let (mut rest, mut names, mut scripts) = (page, Vec::new(), 0);
    while let Some(at) = rest.find('<') {
        rest = &rest[at + 1..];
        let end = rest.find(|c: char| !(c.is_alphanumeric() || "/!-".contains(c))).unwrap_or(rest.len());
        let name = rest[..end].to_lowercase();
        if name == "script" || name == "style" {
            scripts += usize::from(name == "script");
            let close = format!("</{name}");
            rest = &rest[rest.find(&close).expect("scripts are closed")..];
        }
        names.push(name);
    }
    (names, scripts)
}

#[test]
fn hostile_texts_stay_texts() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene_full.glb"), b"glTF</script><script>alert(1)</script>").unwrap();
    image::RgbImage::new(64, 48).save(folder.path().join("render_extra.png")).unwrap();
    image::RgbImage::new(64, 48).save(folder.path().join("input.png")).unwrap();
    let plain = report_html(folder.path(), &scene("chair"), &report("chair")).unwrap();
    let evil =
        "</script></style></title><script>alert(1)</script><img src=x onerror=alert(1)>\" onload=\"x' --><!-- &lt;";
    let hostile = report_html(folder.path(), &scene(evil), &report(evil)).unwrap();
    assert_eq!(tags(&plain), tags(&hostile), "the same elements, whatever the texts are");
    assert!(!hostile.contains("<img src=x"));
    assert!(!hostile.contains("\" onload=\""));
    // The machine-readable copy still says what the scene says.
    let start = hostile.find("id=\"scene\">").unwrap() + 11;
    let json = &hostile[start..start + hostile[start..].find("</script>").unwrap()];
    let back: Scene = serde_json::from_str(json).unwrap();
    assert_eq!(back, scene(evil));
}

#[test]
fn the_page_refers_to_nothing_outside_itself() {
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::new(64, 48).save(folder.path().join("input.png")).unwrap();
    std::fs::write(folder.path().join("scene_full.glb"), b"glTF").unwrap();
    write_report(folder.path(), &scene("chair"), &report("chair")).unwrap();
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    let body = page.replace(include_str!("../assets/viewer.js"), "");
    for outside in ["http:", "https:", "//cdn", "@import", "url(", "<link", "<iframe", "srcset"] {
        assert!(!body.contains(outside), "{outside}");
    }
    for (at, _) in body.match_indices("src=\"") {
        assert!(body[at + 5..].starts_with("data:"), "{}", &body[at..at + 40]);
    }
}

#[test]
fn an_empty_run_gives_a_page_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut empty = scene("room");
    empty.objects.clear();
    empty.warnings.clear();
    write_report(folder.path(), &empty, &ReportData::default()).unwrap();
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    for words in ["No object was placed", "no scene_full.glb", "No model was asked", "Not made in this run: input"] {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn numbers_of_the_run_are_added_up() {
    let folder = tempfile::tempdir().unwrap();
    let mut data = report("x");
    let call = |role: &str, cost: Option<f64>, record| CallRow {
        name: "3_furniture/chair_01/front".into(),
        role: role.into(),
        player: "p".into(),
        seconds: 2.0,
        tokens_in: 1000,
        tokens_out: 10,
        cost_usd: cost,
        from_record: record,
        ..CallRow::default()
    };
    data.calls = vec![
        call("vision_language", Some(0.25), false),
        call("vision_language", Some(0.5), true),
        call("mesh_generator", None, false),
    ];
    let page = report_html(folder.path(), &scene("x"), &data).unwrap();
    assert!(page.contains("$0.75"));
    assert!(page.contains("own work <span>3.0 s</span><br>waiting for players <span>11 min 40 s</span>"));
    assert!(page.contains("calls, 3.0 a placed object"));
    assert!(page.contains("3\u{202f}000 / 30"), "tokens of all calls");
    assert!(page.contains("66 %"), "the object's confidence");
    assert!(page.contains("the photo") || page.contains("About the photo"));
    for call in &mut data.calls {
        call.cost_usd = None;
    }
    let page = report_html(folder.path(), &scene("x"), &data).unwrap();
    assert!(page.contains("no price of a model call is known") && !page.contains("$0.00"));
}
