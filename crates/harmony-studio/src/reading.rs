//! What a request asks, read from its text alone, as a model would have to.
//!
//! Real services see neither the name of a call nor its fields, and the studio does not either: the prompt's wording tells
//! the kind of the question, its lists tell the objects. Numbers have the precision of the text (centimetres, degrees,
//! thousandths of the picture); what only shapes the text, and what no answer from the truth depends on, is left out.

use harmony_prompts::{
    CompletedQuestion, CountsQuestion, FoundObject, FrontsQuestion, InspectCandidate, InspectQuestion, KnownDepth,
    KnownObject, LastLookQuestion, LayoutQuestion, LightingReviewQuestion, LightsQuestion, ListQuestion, NamedObject,
    OrientQuestion, PlacedObject, ProgramsQuestion, Question, ReviewQuestion, RoomSummary, SecondLookQuestion,
};
use harmony_scene::{
    Extents, ImageSize, Level, Lighting, ObjectId, PixelBox, RoomShape, Size, Support, ViewTransform, Wall,
};

/// What is asked.
#[derive(Debug, Clone, PartialEq)]
pub enum Asked {
    /// A question of `harmony-prompts`, as far as its text tells it.
    Question(Box<Question>),
    /// Boxes for these phrases (label, phrase).
    Boxes {
        /// Property that holds the numbers.
        key: &'static str,
        /// Labels and phrases.
        phrases: Vec<(String, String)>,
        /// Picture size that pixels refer to; `None` = thousandths.
        pixels: Option<ImageSize>,
    },
    /// The colour of a picture: the program's own check.
    Colour,
}

/// Makes a question from its text.
type Read = fn(&str) -> Option<Question>;

/// Words by which a question is known, and how it is read. One that is reworded is not understood, and a test says so.
const KINDS: [(&str, Read); 13] = [
    ("You look a last time at a 3D scene", |prompt| {
        let (objects, lights, findings) = (Vec::new(), Vec::new(), Vec::new());
        let (tried, guide) = (Vec::new(), String::new());
        Some(LastLookQuestion { room: room(prompt)?, objects, lights, ambient: 0.0, findings, tried, guide }.into())
    }),
    ("You model objects of a photographed room", |prompt| {
        Some(
            ProgramsQuestion { room: room(prompt)?, objects: Vec::new(), features: false, guide: String::new() }.into(),
        )
    }),
    ("You look a second time at objects", |_| {
        Some(SecondLookQuestion { objects: Vec::new(), tried: Vec::new(), guide: String::new() }.into())
    }),
    ("STEP 5 -- PINS", |prompt| {
        let [width, height] = numbers(prompt, "IMAGE 1 is the photograph (", " pixels)")[..] else { return None };
        let photo = ImageSize::new(width as u32, height as u32);
        Some(LayoutQuestion { photo, depth: KnownDepth::None, unaided: None }.into())
    }),
    ("For EVERY candidate decide", |prompt| {
        let level = level(prompt)?;
        let placed = section(prompt, "Objects placed already:").filter_map(|line| known(line, level)).collect();
        Some(
            InspectQuestion {
                level,
                room_type: String::new(),
                room: room(prompt)?,
                candidates: section(prompt, "Candidates:").filter_map(candidate).collect(),
                others: Vec::new(),
                placed,
                templates: Vec::new(),
                with_models: false,
            }
            .into(),
        )
    }),
    ("judge whether the completed picture matches", |prompt| {
        Some(CompletedQuestion { objects: objects(prompt) }.into())
    }),
    ("one de-tilted mesh", |prompt| Some(FrontsQuestion { objects: objects(prompt) }.into())),
    ("pick the one panel whose orientation", |prompt| Some(OrientQuestion { objects: objects(prompt) }.into())),
    ("IMAGE 2 is the current reconstruction", |prompt| {
        let after = |level: &Level| prompt.contains(&format!("after placing {} objects", level.stage()));
        Some(
            ReviewQuestion {
                level: Level::ALL.into_iter().find(after)?,
                room: room(prompt)?,
                placed: section(prompt, "Objects in the scene").filter_map(placed).collect(),
                unplaced: Vec::new(),
                findings: Vec::new(),
                tried: Vec::new(),
            }
            .into(),
        )
    }),
    ("Count, kind by kind, what the photo shows", |prompt| {
        let placed = section(prompt, "Objects in the scene").filter_map(placed).collect();
        Some(CountsQuestion { room: room(prompt)?, placed, unplaced: Vec::new() }.into())
    }),
    ("Light sources in the scene", |_| {
        let dark = Lighting {
            lights: Vec::new(),
            ambient_color: [1.0; 3],
            ambient_intensity: 0.0,
            exposure: 0.0,
            view: ViewTransform::default(),
        };
        Some(LightsQuestion { lighting: dark, screens: Vec::new(), photo_luminance: 0.0, seen: Vec::new() }.into())
    }),
    ("CURRENT LIGHTING SETUP", |prompt| {
        let (_, rest) = prompt.split_once("CURRENT LIGHTING SETUP:\n")?;
        let lighting = serde_json::from_str(rest.split_once("\n\nMeasured:")?.0).ok()?;
        let proposed = harmony_lighting::LightingDelta::default();
        Some(LightingReviewQuestion { lighting, stops: 0.0, warmth: 0.0, proposed }.into())
    }),
    ("OUTPUT -- JSON to the schema: {\"items\"", |prompt| {
        Some(
            ListQuestion {
                level: level(prompt)?,
                room_type: String::new(),
                with_boxes: false,
                placed: Vec::new(),
                trays: vec![],
                view: None,
            }
            .into(),
        )
    }),
];

/// Words by which the level of a list or an inspection is known.
const LEVELS: [(&str, Level); 8] = [
    ("List every wall-mounted", Level::Wall),
    ("List only floor-standing furniture", Level::Furniture),
    ("List every ceiling-mounted", Level::Ceiling),
    ("list every object resting on its surface", Level::Decoration),
    ("the wall it is fixed to", Level::Wall),
    ("the object's BACK touches that wall", Level::Furniture),
    ("the whole drop from the ceiling", Level::Ceiling),
    ("id of the furniture that carries it", Level::Decoration),
];

/// Reads a prompt; `None` when it is no question of this program.
pub fn read(prompt: &str) -> Option<Asked> {
    if prompt.starts_with("Which colour has the picture?") {
        return Some(Asked::Colour);
    }
    if prompt.contains("Find every instance of these things") {
        return boxes(prompt);
    }
    let (_, question) = KINDS.iter().find(|(words, _)| prompt.contains(words))?;
    Some(Asked::Question(Box::new(question(prompt)?)))
}

fn level(prompt: &str) -> Option<Level> {
    LEVELS.iter().find(|(words, _)| prompt.contains(words)).map(|(_, level)| *level)
}

fn room(prompt: &str) -> Option<RoomSummary> {
    let [width, depth, height] = numbers(prompt, "Room W x D x H = ", " m (")[..] else { return None };
    let (_, rest) = prompt.split_once("Room W x D x H = ")?;
    let (_, rest) = rest.split_once(" m (")?;
    let (room_type, rest) = rest.split_once("). Camera at x ")?;
    let mut camera = rest.split_once(".\n").map_or(rest, |(line, _)| line).split(", ");
    let mut next = |axis: &str| camera.next()?.trim_start_matches(axis).trim().parse().ok();
    let camera = [next("x")?, next("y")?, next("z")?];
    let (room_type, shape) = (room_type.to_owned(), RoomShape::default());
    Some(RoomSummary { extents: Extents { width, height, depth }, room_type, camera, shape })
}

fn objects(prompt: &str) -> Vec<NamedObject> {
    let named = section(prompt, "Objects:").filter_map(named);
    named.map(|(id, about)| NamedObject { id: id.to_owned(), about: about.to_owned() }).collect()
}

/// The lines that follow a heading, up to the next empty one.
fn section<'a>(prompt: &'a str, heading: &str) -> impl Iterator<Item = &'a str> + use<'a> {
    let after = prompt.find(heading).map_or("", |at| &prompt[at..]);
    after.lines().skip(1).take_while(|line| !line.trim().is_empty())
}

/// `id` and the rest of `- id: rest`.
fn named(line: &str) -> Option<(&str, &str)> {
    line.strip_prefix("- ")?.split_once(": ")
}

/// The numbers between two marks.
fn numbers(text: &str, open: &str, close: &str) -> Vec<f64> {
    let Some((_, rest)) = text.split_once(open) else { return Vec::new() };
    let inside = rest.split_once(close).map_or(rest, |(inside, _)| inside);
    inside.split([',', 'x']).filter_map(|n| n.trim().parse().ok()).collect()
}

/// Thousandths are pixels of a picture of this size.
const THOUSANDTHS: ImageSize = ImageSize { width: 1000, height: 1000 };

fn candidate(line: &str) -> Option<InspectCandidate> {
    let (id, rest) = named(line)?;
    let (label, phrase) = rest.split_once(" (\"")?;
    Some(InspectCandidate {
        id: ObjectId::new(id).ok()?,
        label: label.to_owned(),
        phrase: phrase.split_once("\"), box").map_or(phrase, |(phrase, _)| phrase).to_owned(),
        bounds: bounds(rest)?,
        image: THOUSANDTHS,
        estimated_size_m: None,
        host: rest.split_once(", listed on ").and_then(|(_, host)| ObjectId::new(host).ok()),
        program_follows: false,
    })
}

fn bounds(text: &str) -> Option<PixelBox> {
    let [x0, y0, x1, y1] = numbers(text, "box [", "]")[..] else { return None };
    Some(PixelBox { x0, y0, x1, y1 })
}

/// An object of an earlier level; the text does not say of which, so that one that is not placed is taken to be of the
/// level that is asked for.
fn known(line: &str, asked: Level) -> Option<KnownObject> {
    if let Some(object) = placed(line) {
        return Some(KnownObject::Placed(object));
    }
    let (id, rest) = named(line)?;
    let (label, _) = rest.split_once(", seen at ")?;
    let [width, height, depth] = numbers(rest, ", about ", " m;")[..] else { return None };
    Some(KnownObject::Found(FoundObject {
        id: ObjectId::new(id).ok()?,
        label: label.to_owned(),
        level: asked,
        seen: None,
        bounds: bounds(rest)?,
        image: THOUSANDTHS,
        size: Size { width, height, depth },
    }))
}

fn placed(line: &str) -> Option<PlacedObject> {
    let (id, rest) = named(line)?;
    let (label, _) = rest.split_once(", at (")?;
    let [x, y, z] = numbers(rest, ", at (", ")")[..] else { return None };
    let [yaw_deg] = numbers(rest, ", yaw ", " deg")[..] else { return None };
    let [width, height, depth] = numbers(rest, ", size ", " m,")[..] else { return None };
    let (_, on) = rest.split_once(" m, ")?;
    let (on, agreement) = on.split_once(", outline agreement ").map_or((on, None), |(on, iou)| (on, Some(iou)));
    let (support, level) = match on {
        "on the floor" => (Support::Floor, Level::Furniture),
        "under the ceiling" => (Support::Ceiling, Level::Ceiling),
        "on the back wall" => (Support::Wall { wall: Wall::Back }, Level::Wall),
        "on the left wall" => (Support::Wall { wall: Wall::Left }, Level::Wall),
        "on the right wall" => (Support::Wall { wall: Wall::Right }, Level::Wall),
        "on the front wall" => (Support::Wall { wall: Wall::Front }, Level::Wall),
        other => (Support::Object { id: ObjectId::new(other.strip_prefix("on ")?).ok()? }, Level::Decoration),
    };
    Some(PlacedObject {
        id: ObjectId::new(id).ok()?,
        label: label.to_owned(),
        level,
        seen: None,
        position: [x, y, z],
        yaw_deg,
        size: Size { width, height, depth },
        support,
        outline_agreement: agreement.and_then(|iou| iou.parse().ok()),
    })
}

fn boxes(prompt: &str) -> Option<Asked> {
    let key = ["`box_2d`", "`bbox_2d`", "`box`"].into_iter().find(|key| prompt.contains(key))?;
    let key = match key {
        "`box_2d`" => "box_2d",
        "`bbox_2d`" => "bbox_2d",
        _ => "box",
    };
    let (_, lines) = prompt.split_once("these things:\n\n")?;
    let phrases = lines
        .lines()
        .map_while(named)
        .map(|(label, phrase)| {
            let phrase = phrase.split(", about ").next().unwrap_or(phrase);
            (label.to_owned(), phrase.to_owned())
        })
        .collect();
    let pixels = numbers(prompt, "pixels of the picture, which is ", ", tight");
    let pixels = <[f64; 2]>::try_from(pixels).ok().map(|[w, h]| ImageSize::new(w as u32, h as u32));
    Some(Asked::Boxes { key, phrases, pixels })
}

#[cfg(test)]
mod tests {
    use harmony_prompts::{Ask, RoomView, WithoutProgram};
    use harmony_scene::{Camera, Intrinsics, SceneCamera, Vec3};

    use super::*;

    fn id(text: &str) -> ObjectId {
        ObjectId::new(text).unwrap()
    }

    fn study() -> RoomSummary {
        let extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };
        RoomSummary { extents, room_type: "study".into(), camera: [2.0, 1.5, 4.0], shape: RoomShape::default() }
    }

    fn object(name: &str, level: Level, support: Support) -> PlacedObject {
        PlacedObject {
            id: id(name),
            label: "table lamp".into(),
            level,
            seen: None,
            position: [1.25, 0.74, -0.4],
            yaw_deg: -90.0,
            size: Size { width: 0.2, height: 0.45, depth: 0.2 },
            support,
            outline_agreement: (level == Level::Decoration).then_some(0.91),
        }
    }

    fn rows() -> Vec<PlacedObject> {
        vec![
            object("lamp_01", Level::Decoration, Support::Object { id: id("desk_01") }),
            object("window_01", Level::Wall, Support::Wall { wall: Wall::Left }),
            object("desk_01", Level::Furniture, Support::Floor),
            object("pendant_01", Level::Ceiling, Support::Ceiling),
        ]
    }

    /// What is read from a question's text.
    fn read_of(question: &Question) -> Question {
        match read(&question.prompt()) {
            Some(Asked::Question(read)) => *read,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn levels_candidates_and_places_are_read_from_the_text() {
        for level in Level::ALL {
            let camera = Camera::looking(
                ImageSize::new(8, 6),
                Intrinsics::centred(ImageSize::new(8, 6), 6.0),
                Vec3::new(2.0, 1.5, 4.0),
                Vec3::NEG_Z,
            );
            let view = RoomView { camera: SceneCamera::from(&camera), extents: study().extents };
            let list = |placed, view| ListQuestion {
                level,
                room_type: String::new(),
                with_boxes: false,
                placed,
                trays: vec![],
                view,
            };
            assert_eq!(read_of(&list(rows(), Some(view)).into()), list(vec![], None).into());

            let candidate = InspectCandidate {
                id: id("chair_02"),
                label: "chair".into(),
                phrase: "office chair".into(),
                bounds: PixelBox { x0: 100.0, y0: 220.0, x1: 300.0, y1: 401.0 },
                image: THOUSANDTHS,
                estimated_size_m: None,
                host: (level == Level::Decoration).then(|| id("desk_01")),
                program_follows: false,
            };
            let found = FoundObject {
                id: id("rug_01"),
                label: "rug".into(),
                level,
                seen: None,
                bounds: PixelBox { x0: 0.0, y0: 620.0, x1: 500.0, y1: 900.0 },
                image: THOUSANDTHS,
                size: Size { width: 2.0, height: 0.01, depth: 1.4 },
            };
            let known: Vec<KnownObject> = rows().into_iter().map(KnownObject::Placed).collect();
            for with_models in [false, true] {
                let inspect = InspectQuestion {
                    level,
                    room_type: String::new(),
                    room: study(),
                    candidates: vec![candidate.clone()],
                    others: vec![],
                    placed: known.iter().cloned().chain([KnownObject::Found(found.clone())]).collect(),
                    templates: vec![],
                    with_models,
                };
                let wanted = InspectQuestion { with_models: false, ..inspect.clone() };
                assert_eq!(read_of(&inspect.into()), wanted.into());
            }
            let review = ReviewQuestion {
                level,
                room: study(),
                placed: rows(),
                unplaced: vec![],
                findings: vec![],
                tried: vec![],
            };
            assert_eq!(read_of(&review.clone().into()), review.into());
        }
    }

    #[test]
    fn every_other_question_is_understood() {
        let objects = vec![NamedObject { id: "chair_01".into(), about: "a chair".into() }];
        let photo = ImageSize::new(640, 480);
        let setup = Lighting {
            lights: vec![],
            ambient_color: [1.0; 3],
            ambient_intensity: 0.0,
            exposure: 0.5,
            view: ViewTransform::default(),
        };
        let dark = Lighting { exposure: 0.0, ..setup.clone() };
        let proposed = harmony_lighting::LightingDelta::default();
        for whole in [
            Question::from(LayoutQuestion { photo, depth: KnownDepth::None, unaided: None }),
            CompletedQuestion { objects: objects.clone() }.into(),
            FrontsQuestion { objects: objects.clone() }.into(),
            CountsQuestion { room: study(), placed: rows(), unplaced: vec![] }.into(),
            OrientQuestion { objects }.into(),
            LightsQuestion { lighting: dark, screens: vec![], photo_luminance: 0.0, seen: vec![] }.into(),
            LightingReviewQuestion { lighting: setup, stops: 0.0, warmth: 0.0, proposed }.into(),
            ProgramsQuestion { room: study(), objects: vec![], features: false, guide: String::new() }.into(),
            SecondLookQuestion { objects: vec![], tried: vec![], guide: String::new() }.into(),
            LastLookQuestion {
                room: study(),
                objects: vec![],
                lights: vec![],
                ambient: 0.0,
                findings: vec![],
                tried: vec![],
                guide: String::new(),
            }
            .into(),
        ] {
            assert_eq!(read_of(&whole), whole);
        }
        // Objects to model are in the text, but no answer from the truth depends on them.
        let stool = harmony_prompts::ToModel {
            id: id("stool_01"),
            kind: "stool".into(),
            size: Size { width: 0.4, height: 0.45, depth: 0.4 },
            bounds: PixelBox { x0: 1.0, y0: 2.0, x1: 3.0, y1: 4.0 },
            image: photo,
            otherwise: WithoutProgram::Unnamed,
            matched_set: None,
            description: "a stool".into(),
        };
        let programs = ProgramsQuestion { room: study(), objects: vec![stool], features: false, guide: String::new() };
        assert!(programs.prompt().contains("- stool_01: stool"));
        assert_eq!(
            read_of(&programs.into()),
            ProgramsQuestion { room: study(), objects: vec![], features: false, guide: String::new() }.into()
        );
        assert_eq!(read("What is the weather like?"), None);
    }
}
