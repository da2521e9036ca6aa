//! Every question of the pipeline survives the strict form: its example and the answers of the bundled recording come
//! back as they were.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use harmony_calls::schema_complaints;
use harmony_players::vlm::schema::{Dialect, from_wire, size_of, strict, to_wire};
use serde_json::{Value, json};

#[path = "../../../harmony-prompts/tests/it/samples.rs"]
mod samples;
use samples::questions;

/// The same JSON with what is null left out: a property that may be left out and may be null means one thing.
fn without_nulls(value: &Value) -> Value {
    match value {
        Value::Object(map) => {
            map.iter().filter(|(_, v)| !v.is_null()).map(|(k, v)| (k.clone(), without_nulls(v))).collect()
        }
        Value::Array(items) => items.iter().map(without_nulls).collect(),
        other => other.clone(),
    }
}

fn assert_round_trip(name: &str, schema: &Value, answer: &Value) {
    let complaints = schema_complaints(schema, answer);
    assert!(complaints.is_empty(), "{name} itself: {complaints:?}");
    for dialect in [Dialect::STRICT, Dialect::GEMINI, Dialect::GRAMMAR] {
        let wire = to_wire(schema, answer);
        let complaints = schema_complaints(&strict(schema, dialect), &wire);
        assert!(complaints.is_empty(), "{name} {dialect:?}: {complaints:?}");
        let back = from_wire(schema, &wire);
        assert!(schema_complaints(schema, &back).is_empty(), "{name} {dialect:?}");
        assert_eq!(without_nulls(&back), without_nulls(answer), "{name} {dialect:?}");
    }
}

#[test]
fn examples_of_all_questions_survive_the_strict_form() {
    for (name, question) in questions() {
        assert_round_trip(&name, &question.schema(), &question.example());
    }
}

#[test]
fn strict_schemas_are_within_the_limits() {
    for (name, question) in questions() {
        let size = size_of(&strict(&question.schema(), Dialect::STRICT));
        assert!(size.properties <= 5000 && size.enum_values <= 1000, "{name}: {size:?}");
        assert!(size.characters <= 120_000 && size.nesting <= 10, "{name}: {size:?}");
    }
}

#[test]
fn a_schema_in_its_strict_form() {
    let question = questions().into_iter().find(|(name, _)| name == "list with boxes").unwrap().1;
    insta::assert_json_snapshot!(strict(&question.schema(), Dialect::STRICT));
}

#[test]
fn recorded_answers_survive_the_strict_form() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let mut folders: Vec<PathBuf> = vec![root];
    let mut seen = 0;
    while let Some(folder) = folders.pop() {
        let answer = folder.join("answer.json");
        if answer.is_file() {
            // `review_1` and `review_2` are one question; the light's is another than that of a level.
            let last = folder.file_name().unwrap().to_string_lossy().into_owned();
            let last = last.trim_end_matches(|c: char| c == '_' || c.is_ascii_digit());
            let lighting = folder.ancestors().any(|phase| phase.ends_with("6_lighting"));
            let last = if lighting && last == "review" { "lighting_review" } else { last };
            let kind = |name: &str| name.split(' ').next().is_some_and(|kind| kind == last);
            let Some((name, question)) = questions().into_iter().find(|(name, _)| kind(name)) else { continue };
            let text = std::fs::read_to_string(&answer).unwrap();
            let value: Value = serde_json::from_str(&text).unwrap();
            assert_round_trip(&name, &question.schema(), &value);
            seen += 1;
        }
        folders.extend(std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir()));
    }
    assert!(seen >= 5, "{seen} answers");
}

#[test]
fn the_papers_physics_prompt_could_be_asked_too() {
    // Sec. D of the paper asks for an object keyed by label.
    let schema = json!({"type": "object", "additionalProperties": {"type": "object",
        "properties": {"mass_kg": {"type": "number"}, "friction": {"type": "number", "maximum": 1}},
        "required": ["mass_kg", "friction"], "additionalProperties": false}});
    assert_round_trip("physics", &schema, &json!({"sofa_01": {"mass_kg": 45.0, "friction": 0.6}}));
}
