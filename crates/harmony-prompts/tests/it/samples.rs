//! One question of every kind, with every field set, about one small room.

use harmony_lighting::{LightingDelta, LightingVerdict};
use harmony_prompts::{
    CompletedQuestion, CountsQuestion, DoubtedSize, FoundObject, FrontsQuestion, GroupsQuestion, HostedObject,
    HostsQuestion, InspectCandidate, InspectQuestion, KnownDepth, KnownObject, LastLookQuestion, LayoutQuestion,
    LightingReviewQuestion, LightsQuestion, ListQuestion, ListedLight, MatchedSet, MissingQuestion, ModelledObject,
    NamedObject, OrientQuestion, PaintedObject, PhysicalLabel, PhysicalQuestion, PlacedObject, PresentDecoration,
    ProgramsQuestion, Question, ReorderQuestion, ReviewQuestion, RoomSummary, RoomView, SecondLookQuestion, SeenObject,
    ShownProgram, SizesQuestion, ToModel, TurnedObject, TurnsQuestion, UnaidedRoom, WithoutProgram,
};
use harmony_scene::{
    Camera, Extents, ImageSize, Intrinsics, Level, Light, LightKind, Lighting, ObjectId, PixelBox, RoomShape,
    SceneCamera, Size, Support, Vec3, ViewTransform, Wall,
};

const PHOTO: ImageSize = ImageSize { width: 640, height: 480 };

fn id(text: &str) -> ObjectId {
    ObjectId::new(text).unwrap()
}

fn room() -> RoomSummary {
    let extents = Extents { width: 4.2, height: 2.6, depth: 5.0 };
    RoomSummary { extents, room_type: "study".into(), camera: [2.1, 1.5, 4.5], shape: RoomShape::default() }
}

fn size(width: f64, height: f64, depth: f64) -> Size {
    Size { width, height, depth }
}

fn placed(name: &str, label: &str, level: Level, support: Support) -> PlacedObject {
    PlacedObject {
        id: id(name),
        label: label.into(),
        level,
        seen: Some(PixelBox { x0: 64.0, y0: 240.0, x1: 320.0, y1: 432.0 }),
        position: [1.25, 0.0, 0.375],
        yaw_deg: -90.0,
        size: size(1.2, 0.74, 0.6),
        support,
        outline_agreement: (level == Level::Furniture).then_some(0.912),
    }
}

fn scene() -> Vec<PlacedObject> {
    vec![
        placed("window_01", "window", Level::Wall, Support::Wall { wall: Wall::Left }),
        placed("desk_01", "desk", Level::Furniture, Support::Floor),
        placed("pendant_lamp_01", "pendant lamp", Level::Ceiling, Support::Ceiling),
        placed("vase_01", "vase", Level::Decoration, Support::Object { id: id("desk_01") }),
    ]
}

fn light(name: &str, kind: LightKind, on: bool) -> Light {
    Light {
        id: name.into(),
        kind,
        position: [1.0, 1.5, 0.25],
        color: [1.0, 0.9, 0.8],
        intensity: 12.5,
        on,
        object: Some(id(name)),
        shade: None,
    }
}

fn lighting() -> Lighting {
    let area = LightKind::Area { direction: [0.0, 0.0, 1.0], size_m: [1.0, 1.2] };
    Lighting {
        lights: vec![
            light("floor_lamp_01", LightKind::Point { radius_m: 0.05 }, true),
            light("window_01", area.clone(), true),
            light("monitor_01", area, false),
        ],
        ambient_color: [1.0; 3],
        ambient_intensity: 0.5,
        exposure: 0.25,
        view: ViewTransform::Agx,
    }
}

fn named() -> Vec<NamedObject> {
    let object = |id: &str, about: &str| NamedObject { id: id.into(), about: about.into() };
    vec![object("chair_01", "office chair, black mesh back"), object("sofa_01", "two-seat sofa, grey")]
}

fn list(level: Level, with_boxes: bool) -> Question {
    let camera = Camera::looking(PHOTO, Intrinsics::centred(PHOTO, 500.0), Vec3::new(2.1, 1.5, 4.5), Vec3::NEG_Z);
    let view = RoomView { camera: SceneCamera::from(&camera), extents: room().extents };
    let placed = if level == Level::Decoration { scene() } else { Vec::new() };
    ListQuestion { level, room_type: "study".into(), with_boxes, placed, trays: vec![], view: Some(view) }.into()
}

fn inspect(level: Level, with_models: bool) -> Question {
    let candidate = |name: &str, host: Option<ObjectId>| InspectCandidate {
        id: id(name),
        label: "chair".into(),
        phrase: "office chair . desk chair".into(),
        bounds: PixelBox { x0: 64.0, y0: 105.6, x1: 192.0, y1: 192.48 },
        image: PHOTO,
        estimated_size_m: host.is_none().then(|| size(0.6, 0.9, 0.0)),
        host,
        program_follows: with_models && name == "chair_01",
    };
    let found = FoundObject {
        id: id("rug_01"),
        label: "rug".into(),
        level: Level::Furniture,
        seen: None,
        bounds: PixelBox { x0: 0.0, y0: 300.0, x1: 320.0, y1: 432.0 },
        image: PHOTO,
        size: size(2.0, 0.01, 1.4),
    };
    InspectQuestion {
        level,
        room_type: "home office".into(),
        room: room(),
        candidates: vec![candidate("chair_01", None), candidate("chair_02", Some(id("desk_01")))],
        others: if level == Level::Furniture { vec![candidate("chair_03", None)] } else { Vec::new() },
        placed: scene().into_iter().map(KnownObject::Placed).chain([KnownObject::Found(found)]).collect(),
        templates: vec!["chair".into(), "desk".into()],
        with_models,
    }
    .into()
}

fn to_model(name: &str, otherwise: WithoutProgram, matched_set: Option<&str>) -> ToModel {
    ToModel {
        id: id(name),
        kind: "stool".into(),
        size: size(0.4, 0.45, 0.4),
        bounds: PixelBox { x0: 64.0, y0: 105.6, x1: 192.0, y1: 192.48 },
        image: PHOTO,
        otherwise,
        matched_set: matched_set.map(str::to_owned),
        description: "a round stool of oak".into(),
    }
}

/// All questions, each under a name of its own; those of one kind begin with the last part of its call's name.
pub fn questions() -> Vec<(String, Question)> {
    let unaided = UnaidedRoom {
        extents: room().extents,
        camera_height_m: 1.5,
        tilt_deg: 8.0,
        yaw_deg: -12.5,
        dist_to_back_m: 4.5,
        confidence: 0.6,
    };
    let mut all: Vec<(String, Question)> = Vec::new();
    for (name, depth) in [("metric", KnownDepth::Metric), ("scale", KnownDepth::UpToScale), ("none", KnownDepth::None)]
    {
        let question = LayoutQuestion { photo: PHOTO, depth, unaided: Some(unaided.clone()) };
        all.push((format!("layout {name}"), question.into()));
    }
    for level in Level::ALL {
        let level_name = level.folder();
        all.push((format!("list {level_name}"), list(level, false)));
        all.push((format!("inspect {level_name}"), inspect(level, level == Level::Furniture)));
    }
    all.push(("list with boxes".to_owned(), list(Level::Decoration, true)));
    let modelled = |object: PlacedObject, program: Option<ShownProgram>| ModelledObject {
        object,
        made_as: if program.is_some() { "its program" } else { "template desk" }.into(),
        params: program.iter().map(|_| ("rows".to_owned(), 3.0)).collect(),
        program,
    };
    let painted = scene().into_iter().map(|object| PaintedObject { object, slots: vec!["oak".into(), "steel".into()] });
    let finding = "- desk_01: outline agreement 0.51, penetration 30 mm".to_owned();
    let measured = LightingDelta { verdict: LightingVerdict::Adjust, ..LightingDelta::default() };
    let further: [(&str, Question); 21] = [
        ("completed", CompletedQuestion { objects: named() }.into()),
        ("front", FrontsQuestion { objects: named() }.into()),
        ("orient", OrientQuestion { objects: named() }.into()),
        (
            "turns",
            TurnsQuestion {
                objects: vec![TurnedObject { id: id("desk_01"), about: "desk".into(), yaw_deg: 12.5 }],
                step_deg: 15.0,
            }
            .into(),
        ),
        (
            "sizes",
            SizesQuestion {
                objects: vec![DoubtedSize {
                    id: id("stool_01"),
                    kind: "stool".into(),
                    answered: size(1.5, 0.5, 0.4),
                    usual: [size(0.25, 0.4, 0.25), size(0.6, 0.8, 0.6)],
                    apparent: Some(size(0.5, 0.55, 0.0)),
                }],
            }
            .into(),
        ),
        (
            "physical",
            PhysicalQuestion {
                items: vec![
                    PhysicalLabel { label: "desk".into(), size: size(1.2, 0.74, 0.6) },
                    PhysicalLabel { label: "vase".into(), size: size(0.12, 0.3, 0.12) },
                ],
            }
            .into(),
        ),
        (
            "hosts",
            HostsQuestion {
                objects: vec![HostedObject {
                    id: id("vase_01"),
                    about: "vase".into(),
                    current: Some(id("desk_01")),
                    candidates: vec![id("desk_01"), id("window_01")],
                }],
            }
            .into(),
        ),
        (
            "groups",
            GroupsQuestion {
                sets: vec![MatchedSet { name: "stools".into(), members: vec![id("stool_02"), id("stool_01")] }],
            }
            .into(),
        ),
        (
            "missing",
            MissingQuestion {
                room_type: "study".into(),
                furniture: NamedObject { id: "desk_01".into(), about: "desk".into() },
                present: vec![PresentDecoration { label: "vase".into(), bounds: [100.0, 200.0, 150.0, 320.0] }],
            }
            .into(),
        ),
        (
            "reorder",
            ReorderQuestion {
                level: Level::Furniture,
                room: room(),
                placed: scene(),
                order: vec![id("desk_01")],
                collisions: vec!["- desk_01 and stool_01: 40 mm".into()],
            }
            .into(),
        ),
        (
            "counts",
            CountsQuestion { room: room(), placed: scene(), unplaced: vec!["- chair_02: a fragment".into()] }.into(),
        ),
        (
            "programs",
            ProgramsQuestion {
                room: room(),
                objects: vec![
                    to_model("stool_01", WithoutProgram::PartModel, Some("stools")),
                    to_model("stool_02", WithoutProgram::Template("stool".into()), None),
                    to_model("stool_03", WithoutProgram::Unnamed, None),
                ],
                features: true,
                guide: "(the guide)".into(),
            }
            .into(),
        ),
        (
            "second_look",
            SecondLookQuestion {
                objects: vec![
                    modelled(scene().remove(1), None),
                    modelled(
                        scene().remove(3),
                        Some(ShownProgram::Text("def build(w, h, d, rows=2):\n    return box(w, h, d)\n".into())),
                    ),
                    modelled(scene().remove(2), Some(ShownProgram::SameAs(scene().remove(3).id))),
                ],
                tried: vec![],
                guide: "(the guide)".into(),
            }
            .into(),
        ),
        (
            "second_look after another",
            SecondLookQuestion {
                objects: vec![modelled(scene().remove(1), None)],
                tried: vec!["- another program of desk_01: kept".into()],
                guide: "(the guide)".into(),
            }
            .into(),
        ),
        (
            "review",
            ReviewQuestion {
                level: Level::Furniture,
                room: room(),
                placed: scene(),
                unplaced: vec!["- sofa: nothing of it is seen".into()],
                findings: vec![finding.clone()],
                tried: vec![],
            }
            .into(),
        ),
        (
            "review after another",
            ReviewQuestion {
                level: Level::Furniture,
                room: room(),
                placed: scene(),
                unplaced: vec![],
                findings: vec![],
                tried: vec!["- rotate chair_01 by 90 degrees: kept".into()],
            }
            .into(),
        ),
        (
            "review of nothing",
            ReviewQuestion {
                level: Level::Wall,
                room: room(),
                placed: vec![],
                unplaced: vec![],
                findings: vec![],
                tried: vec![],
            }
            .into(),
        ),
        (
            "lights",
            LightsQuestion {
                lighting: lighting(),
                screens: vec!["monitor_01".into()],
                photo_luminance: 0.25,
                seen: vec![SeenObject { id: id("window_01"), luminance: 0.75 }],
            }
            .into(),
        ),
        (
            "lighting_review",
            LightingReviewQuestion { lighting: lighting(), stops: -0.5, warmth: 0.125, proposed: measured }.into(),
        ),
        (
            "last_look",
            LastLookQuestion {
                room: room(),
                objects: painted.collect(),
                lights: lighting().lights.into_iter().map(ListedLight).collect(),
                ambient: lighting().ambient_intensity,
                findings: vec![finding],
                tried: vec![],
                guide: "(the guide)".into(),
            }
            .into(),
        ),
        (
            "last_look after another",
            LastLookQuestion {
                room: room(),
                objects: vec![],
                lights: vec![],
                ambient: 0.3,
                findings: vec![],
                tried: vec!["- light lamp_01, factor 1.50: refused, it agrees less with the photo".into()],
                guide: "(the guide)".into(),
            }
            .into(),
        ),
    ];
    all.extend(further.map(|(name, question)| (name.to_owned(), question)));
    all
}
