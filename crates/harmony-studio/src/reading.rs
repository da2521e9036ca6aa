//! What a request asks, read from its text alone, as a model would have to.
//!
//! Real services see neither the name of a call nor its machine-readable facts, and the studio does not either: the
//! prompt's wording tells the kind of the question, its lists tell the objects. Numbers have the precision of the text
//! (centimetres, degrees, thousandths of the picture).

use harmony_prompts::QuestionKind;
use harmony_scene::{ImageSize, Level, ObjectId, PixelBox, Support, Wall};
use serde_json::{Value, json};

/// What is asked.
#[derive(Debug, Clone, PartialEq)]
pub enum Asked {
    /// A question of `harmony-prompts`, with the facts that its text holds.
    Question(QuestionKind, Value),
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

/// Words by which a question is known. One that is reworded is not understood, and a test says so.
const KINDS: [(&str, QuestionKind); 12] = [
    ("You look a last time at a 3D scene", QuestionKind::LastLook),
    ("You model objects of a photographed room", QuestionKind::Programs),
    ("You look a second time at objects", QuestionKind::SecondLook),
    ("STEP 5 -- PINS", QuestionKind::Layout),
    ("For EVERY candidate decide", QuestionKind::Inspect),
    ("judge whether the completed picture matches", QuestionKind::Completed),
    ("one de-tilted mesh", QuestionKind::Fronts),
    ("pick the one panel whose orientation", QuestionKind::Orient),
    ("IMAGE 2 is the current reconstruction", QuestionKind::Review),
    ("Light sources in the scene", QuestionKind::Lights),
    ("CURRENT LIGHTING SETUP", QuestionKind::LightingReview),
    ("OUTPUT -- JSON to the schema: {\"items\"", QuestionKind::List),
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
    let (_, kind) = KINDS.iter().find(|(words, _)| prompt.contains(words))?;
    let level = LEVELS.iter().find(|(words, _)| prompt.contains(words)).map(|(_, level)| *level);
    let facts = match kind {
        QuestionKind::Layout
        | QuestionKind::Lights
        | QuestionKind::LightingReview
        | QuestionKind::LastLook
        | QuestionKind::Programs
        | QuestionKind::SecondLook => json!({}),
        QuestionKind::List => json!({"level": level?}),
        QuestionKind::Inspect => json!({
            "level": level?,
            "candidates": section(prompt, "Candidates:").filter_map(candidate).collect::<Vec<_>>(),
            "placed": section(prompt, "Objects placed already:")
                .filter_map(|line| Some(json!({"id": named(line)?.0}))).collect::<Vec<_>>(),
        }),
        QuestionKind::Completed | QuestionKind::Fronts | QuestionKind::Orient => {
            let ids: Vec<&str> = section(prompt, "Objects:").filter_map(|line| Some(named(line)?.0)).collect();
            json!({"objects": ids})
        }
        QuestionKind::Review => {
            let stage =
                Level::ALL.into_iter().find(|l| prompt.contains(&format!("after placing {} objects", l.stage())));
            json!({
                "level": stage?,
                "placed": section(prompt, "Objects in the scene").filter_map(placed).collect::<Vec<_>>(),
            })
        }
    };
    Some(Asked::Question(*kind, facts))
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

fn candidate(line: &str) -> Option<Value> {
    let (id, rest) = named(line)?;
    let (label, _) = rest.split_once(" (\"")?;
    let [x0, y0, x1, y1] = numbers(rest, "box [", "]")[..] else { return None };
    // Thousandths are pixels of a picture of 1000 x 1000.
    Some(json!({"id": id, "label": label, "box": PixelBox { x0, y0, x1, y1 }, "image": ImageSize::new(1000, 1000)}))
}

fn placed(line: &str) -> Option<Value> {
    let (id, rest) = named(line)?;
    let [x, y, z] = numbers(rest, ", at (", ")")[..] else { return None };
    let [yaw] = numbers(rest, ", yaw ", " deg")[..] else { return None };
    let [width, height, depth] = numbers(rest, ", size ", " m,")[..] else { return None };
    let (_, on) = rest.split_once(" m, ")?;
    let on = on.split(", outline agreement").next().unwrap_or(on);
    let support = match on {
        "on the floor" => Support::Floor,
        "under the ceiling" => Support::Ceiling,
        "on the back wall" => Support::Wall { wall: Wall::Back },
        "on the left wall" => Support::Wall { wall: Wall::Left },
        "on the right wall" => Support::Wall { wall: Wall::Right },
        "on the front wall" => Support::Wall { wall: Wall::Front },
        other => Support::Object { id: ObjectId::new(other.strip_prefix("on ")?).ok()? },
    };
    Some(json!({
        "id": id, "position": [x, y, z], "yaw_deg": yaw, "support": support,
        "size": {"width": width, "height": height, "depth": depth},
    }))
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
    use harmony_prompts as p;

    use super::*;

    fn kind(question: &p::Question) -> Option<QuestionKind> {
        match read(&question.prompt)? {
            Asked::Question(kind, _) => Some(kind),
            _ => None,
        }
    }

    #[test]
    fn every_question_of_the_program_is_understood() {
        let objects = vec!["- chair_01: a chair".to_owned()];
        for level in Level::ALL {
            let list = p::list(&p::ListVars { level, room_type: "study".into(), with_boxes: false, placed: vec![] });
            assert_eq!(read(&list.prompt), Some(Asked::Question(QuestionKind::List, json!({"level": level}))));
            for with_models in [false, true] {
                let inspect = p::inspect(&p::InspectVars {
                    level,
                    room_type: "study".into(),
                    room: "Room W x D x H = 4.00 x 5.00 x 2.60 m (study). Camera at x 2.00, y 1.50, z 4.00.".into(),
                    candidates: vec!["- chair_02: chair (\"office chair\"), box [100, 220, 300, 401]".into()],
                    placed: vec![
                        "- desk_01: desk, at (1.00, 0.00, 0.40), yaw 0 deg, size 1.20 x 0.74 x 0.60 m, on the floor"
                            .into(),
                    ],
                    templates: vec!["chair".into()],
                    with_models,
                });
                let Some(Asked::Question(QuestionKind::Inspect, facts)) = read(&inspect.prompt) else {
                    panic!("{level:?} {with_models}");
                };
                assert_eq!(facts["level"], json!(level));
                assert_eq!(facts["candidates"][0]["id"], "chair_02");
                assert_eq!(facts["candidates"][0]["label"], "chair");
                assert_eq!(facts["candidates"][0]["box"]["x1"], 300.0);
                assert_eq!(facts["placed"], json!([{"id": "desk_01"}]));
            }
            let rows = vec![
                "- lamp_01: lamp, at (1.25, 0.74, -0.40), yaw -90 deg, size 0.20 x 0.45 x 0.20 m, on desk_01, outline agreement 0.91".to_owned(),
                "- window_01: window, at (0.00, 0.90, 2.00), yaw 90 deg, size 1.20 x 1.40 x 0.05 m, on the left wall".to_owned(),
            ];
            let review = p::review(&p::ReviewVars {
                level,
                room: "Room.".into(),
                objects: rows,
                unplaced: vec![],
                findings: vec![],
            });
            let Some(Asked::Question(QuestionKind::Review, facts)) = read(&review.prompt) else { panic!("{level:?}") };
            assert_eq!(facts["level"], json!(level));
            let lamp = &facts["placed"][0];
            assert_eq!(lamp["position"], json!([1.25, 0.74, -0.40]));
            assert_eq!((lamp["yaw_deg"].as_f64(), lamp["size"]["height"].as_f64()), (Some(-90.0), Some(0.45)));
            assert_eq!(lamp["support"], json!({"on": "object", "id": "desk_01"}));
            assert_eq!(facts["placed"][1]["support"], json!({"on": "wall", "wall": "left"}));
        }
        let layout = p::layout(&p::LayoutVars { width: 4, height: 3, measured: "Nothing.".into() });
        assert_eq!(kind(&layout), Some(QuestionKind::Layout));
        for (question, wanted) in [
            (p::completed(&p::CompletedVars { objects: objects.clone() }), QuestionKind::Completed),
            (p::fronts(&p::FrontsVars { objects: objects.clone() }), QuestionKind::Fronts),
            (p::orient(&p::FrontsVars { objects: objects.clone() }), QuestionKind::Orient),
        ] {
            assert_eq!(read(&question.prompt), Some(Asked::Question(wanted, json!({"objects": ["chair_01"]}))));
        }
        assert_eq!(kind(&p::lights(&p::LightsVars { sources: vec![] })), Some(QuestionKind::Lights));
        let again = p::LightingReviewVars { setup: "{}".into(), measured: "so".into() };
        assert_eq!(kind(&p::lighting_review(&again)), Some(QuestionKind::LightingReview));
        let models = p::ProgramsVars { room: String::new(), objects: objects.clone(), guide: String::new() };
        assert_eq!(kind(&p::programs(&models)), Some(QuestionKind::Programs));
        assert_eq!(kind(&p::second_look(&models)), Some(QuestionKind::SecondLook));
        assert_eq!(read("What is the weather like?"), None);
    }
}
