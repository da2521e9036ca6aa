//! Text, schema, example and key of every question, as they are: a change of wording or form shows here, and recordings
//! that answer the old one show a warning.

use harmony_prompts::{Ask, FrontsQuestion, NamedObject, Question};
use serde_json::{Value, json};

use crate::samples::questions;

/// Name of a snapshot's file.
fn file(name: &str) -> String {
    name.replace(' ', "_")
}

#[test]
fn every_prompt_reads_as_it_should() {
    for (name, question) in questions() {
        insta::assert_snapshot!(format!("prompt_{}", file(&name)), question.prompt());
    }
}

/// The first question of each kind: schemas do not depend on the fields.
fn one_of_each_kind() -> Vec<(String, Question)> {
    let mut kinds = std::collections::BTreeSet::new();
    let kind = |name: &str| name.split(' ').next().unwrap().to_owned();
    questions().into_iter().map(|(name, q)| (kind(&name), q)).filter(|(kind, _)| kinds.insert(kind.clone())).collect()
}

#[test]
fn every_schema_is_as_it_should_be() {
    for (kind, question) in one_of_each_kind() {
        insta::assert_json_snapshot!(format!("schema_{kind}"), question.schema());
    }
}

#[test]
fn every_example_is_as_it_should_be() {
    for (kind, question) in one_of_each_kind() {
        insta::assert_json_snapshot!(format!("example_{kind}"), question.example());
    }
}

/// What goes into content keys and records beside the text.
#[test]
fn every_key_holds_the_same_facts_as_ever() {
    for (kind, question) in one_of_each_kind() {
        insta::assert_json_snapshot!(format!("facts_{kind}"), question);
    }
}

#[test]
fn all_kinds_are_among_the_samples() {
    let tag = |question: &Question| serde_json::to_value(question).unwrap()["question"].as_str().unwrap().to_owned();
    let mut kinds: Vec<String> = questions().iter().map(|(_, question)| tag(question)).collect();
    kinds.sort();
    kinds.dedup();
    let wanted = [
        "completed",
        "counts",
        "fronts",
        "groups",
        "hosts",
        "inspect",
        "last_look",
        "layout",
        "lighting_review",
        "lights",
        "list",
        "missing",
        "orient",
        "physical",
        "programs",
        "reorder",
        "review",
        "second_look",
        "sizes",
        "turns",
    ];
    assert_eq!(kinds, wanted, "a new question needs a sample and its snapshots");
}

#[test]
fn no_place_of_a_template_is_left_open() {
    for (name, question) in questions() {
        let prompt = question.prompt();
        let open = prompt.match_indices('{').find_map(|(at, _)| {
            let (inside, _) = prompt[at + 1..].split_once('}')?;
            let is_place = !inside.is_empty() && inside.chars().all(|c| c.is_ascii_lowercase() || c == '_');
            is_place.then(|| inside.to_owned())
        });
        assert_eq!(open, None, "{name}");
    }
}

#[test]
fn no_part_model_is_asked_of_whom_a_program_is_asked_for_next() {
    let (_, question) = questions()
        .into_iter()
        .find(|(_, question)| matches!(question, Question::Inspect(inspect) if inspect.with_models))
        .unwrap();
    let Question::Inspect(mut inspect) = question else { panic!("candidates are inspected") };
    assert!(inspect.prompt().contains(harmony_mesh::PART_MODEL_GUIDE), "one of the two has no program");
    inspect.candidates.iter_mut().for_each(|candidate| candidate.program_follows = true);
    let prompt = inspect.prompt();
    assert!(!prompt.contains(harmony_mesh::PART_MODEL_GUIDE) && prompt.contains("leave `part_model` null"), "{prompt}");
}

/// Text of the user's photo, such as a label that a detector read, is not taken for a place of the template.
#[test]
fn braces_in_a_description_do_no_harm() {
    let (_, question) = questions().into_iter().find(|(name, _)| name == "programs").unwrap();
    let Question::Programs(mut programs) = question else { panic!("programs are asked for") };
    programs.objects[0].description = "{objects} {guide} {".into();
    assert!(programs.prompt().contains("; {objects} {guide} {\n"));
}

#[test]
fn an_answer_keeps_what_its_question_asked_for() {
    let question =
        Question::from(FrontsQuestion { objects: vec![NamedObject { id: "chair_01".into(), about: "chair".into() }] });
    let answer: Value = json!({"objects": [{"id": "chair_01", "front_panel": "C"}]});
    assert_eq!(question.check(&answer), Ok(()));
    let misfit = question.check(&json!({"objects": [{"id": "chair_01", "front_panel": "E"}]}));
    assert!(misfit.unwrap_err().contains("does not fit"));
}
