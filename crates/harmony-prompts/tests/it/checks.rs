//! What the checks accept, and what they complain about.

use harmony_prompts::{
    Ask, CompletedAnswer, CompletedObject, CountedKind, CountsAnswer, CountsQuestion, GroupSwap, GroupsAnswer,
    GroupsQuestion, HostedObject, HostsAnswer, HostsObject, HostsQuestion, InspectAnswer, InspectedObject,
    InspectedSize, LayoutAnswer, ListAnswer, ListQuestion, ListedItem, MatchedSet, Question, ReviewActionAnswer,
    ReviewActionKind, ReviewAnswer,
};
use serde_json::{Value, json};

use crate::samples::questions;

fn ids(ids: &[&str]) -> Vec<String> {
    ids.iter().map(|id| (*id).to_owned()).collect()
}

fn complaint(result: Result<(), String>) -> String {
    result.expect_err("a complaint is due")
}

/// What nobody looked at is accepted by the question's own check.
#[test]
fn answers_without_looking_pass() {
    let mut answered = 0;
    for (name, question) in questions() {
        let Some(answer) = question.without_looking() else {
            let needs_eyes = matches!(
                question,
                Question::Layout(_) | Question::List(_) | Question::Inspect(_) | Question::Lights(_)
            );
            assert!(needs_eyes, "{name}");
            continue;
        };
        assert_eq!(question.check(&answer), Ok(()), "{name}");
        answered += 1;
    }
    assert!(answered >= 8);
}

/// What the layout told of the ceiling is named to whoever lists its objects.
#[test]
fn trays_are_no_objects() {
    let asked = |trays: Vec<String>| {
        let (room_type, level) = ("bedroom".to_owned(), harmony_scene::Level::Ceiling);
        let list = ListQuestion { level, room_type, with_boxes: false, placed: vec![], trays, view: None };
        Question::from(list).prompt()
    };
    let (without, with) = (asked(vec![]), asked(vec!["coffer".to_owned(), "tray ceiling".to_owned()]));
    assert!(!without.contains("no objects"));
    assert!(with.contains("Part of the room already, no objects: coffer, tray ceiling."));
    assert_eq!(with.lines().count(), without.lines().count() + 1);
}

/// Examples are of another picture: those that name objects are refused for their ids, the others accepted.
#[test]
fn an_example_sent_back_is_not_taken_for_an_answer() {
    for (name, question) in questions() {
        let example = question.example();
        let names_objects = !matches!(
            question,
            Question::Layout(_) | Question::List(_) | Question::Lights(_) | Question::LightingReview(_)
        );
        let outcome = question.check(&example);
        // The examples of these happen to speak of ids that the samples have, or of none.
        let known = matches!(question, Question::Programs(_) | Question::Orient(_) | Question::Missing(_));
        assert_eq!(outcome.is_err(), names_objects && !known, "{name}: {outcome:?}");
    }
}

#[test]
fn nonsense_of_any_form_is_a_complaint_and_never_a_panic() {
    let nonsense =
        [Value::Null, json!([]), json!({}), json!("text"), json!({"objects": [{"id": ""}]}), json!({"items": [1]})];
    for (name, question) in questions() {
        for value in &nonsense {
            if let Err(complaint) = question.check(value) {
                assert!(!complaint.is_empty(), "{name}");
            }
        }
        assert!(question.check(&json!(7)).is_err(), "{name}");
    }
}

#[test]
fn masses_and_frictions_are_those_of_the_labels_and_within_reason() {
    let question = questions().into_iter().find(|(name, _)| name == "physical").unwrap().1;
    let answer = |label: &str, mass: f64, slip: f64| {
        let item = |l: &str, m: f64| json!({"label": l, "mass_kg": m, "friction": slip});
        question.check(&json!({"items": [item("desk", 30.0), item(label, mass)]}))
    };
    assert_eq!(answer("vase", 1.5, 0.4), Ok(()));
    assert_eq!(question.check(&json!({"items": []})), Ok(()), "the catalogue's are taken");
    assert!(complaint(answer("sofa", 40.0, 0.4)).contains("sofa"));
    assert!(complaint(answer("desk", 30.0, 0.4)).contains("twice"));
    assert!(complaint(answer("vase", 0.0, 0.4)).contains("mass"));
    assert!(complaint(answer("vase", 1.5, 4.0)).contains("friction"));
}

#[test]
fn a_layout_has_plausible_numbers() {
    type Spoil = fn(&mut LayoutAnswer);
    let spoils: [(Spoil, &str); 8] = [
        (|a| a.walls[0].openings[1].face.truncate(2), "outline of a passage"),
        (|a| a.room.floor_width_m = 0.1, "floor_width_m"),
        (|a| a.room.floor_depth_m = f64::NAN, "floor_depth_m"),
        (|a| a.room.ceiling_height_m = 30.0, "ceiling_height_m"),
        (|a| a.camera.tilt_deg = 88.0, "tilt_deg"),
        (|a| a.camera.dist_to_back_m = f64::INFINITY, "dist_to_back_m"),
        (|a| a.pins[0].points.truncate(1), "two or more"),
        (|a| a.camera.corner_px = Some([500.0, 9000.0]), "corner_px"),
    ];
    assert_eq!(LayoutAnswer::example().check(), Ok(()));
    for (spoil, what) in spoils {
        let mut answer = LayoutAnswer::example();
        spoil(&mut answer);
        assert!(complaint(answer.check()).contains(what), "{what}");
    }
}

#[test]
fn a_list_is_bounded_and_its_boxes_are_boxes() {
    let (_, question) = questions().into_iter().find(|(name, _)| name == "list with boxes").unwrap();
    let good: ListAnswer = serde_json::from_value(question.example()).unwrap();
    assert_eq!(good.check(), Ok(()));
    let spoilt = |spoil: &dyn Fn(&mut ListedItem)| {
        let mut answer = good.clone();
        spoil(&mut answer.items[0]);
        complaint(answer.check())
    };
    assert!(spoilt(&|item| item.kind = " ".into()).contains("1 to 80"));
    assert!(spoilt(&|item| item.kind = "x".repeat(81)).contains("1 to 80"));
    assert!(spoilt(&|item| item.count = 201).contains("at most 80 kinds"));
    assert!(spoilt(&|item| item.instances[0].bounds = [10.0, 10.0, 10.0, 90.0]).contains("is empty"));
    assert!(spoilt(&|item| item.instances[0].bounds[2] = 4000.0).contains("right of a vase's box"));
    assert!(spoilt(&|item| item.instances[0].outline.truncate(2)).contains("outline has 2 points"));
    let piece = [[10.0, 10.0], [20.0, 10.0], [2000.0, 20.0]];
    assert!(spoilt(&|item| item.instances[0].pieces = vec![piece.to_vec()]).contains("an outline's x"));
    assert!(spoilt(&|item| item.instances[0].pieces = vec![piece[..2].to_vec()]).contains("outline has 2 points"));
    assert!(spoilt(&|item| item.instances[0].pieces = vec![piece.to_vec(); 9]).contains("9 pieces"));
}

#[test]
fn every_candidate_is_answered_once_with_a_size() {
    let size = InspectedSize { width: 0.5, height: 0.9, depth: 0.5 };
    let answer = |names: &[&str]| InspectAnswer {
        objects: names.iter().map(|id| InspectedObject::plain(id, "chair", size)).collect(),
        ..InspectAnswer::default()
    };
    let asked = ids(&["chair_01", "chair_02"]);
    assert_eq!(answer(&["chair_02", "chair_01"]).check(&asked, &[]), Ok(()));
    assert!(complaint(answer(&["chair_01"]).check(&asked, &[])).contains("no entry for chair_02"));
    assert!(complaint(answer(&["chair_01", "chair_01"]).check(&asked, &[])).contains("twice"));
    assert!(complaint(answer(&["chair_01", "sofa_01"]).check(&asked, &[])).contains("no candidate"));
    let whole_level = answer(&["chair_01", "chair_03"]);
    assert_eq!(whole_level.check(&asked, &ids(&["chair_03"])), Ok(()), "recorded when more was asked at once");
    let mut flat = answer(&["chair_01", "chair_02"]);
    flat.objects[1].size_m.depth = 0.0;
    assert!(complaint(flat.check(&asked, &[])).contains("size_m.depth of chair_02"));
    flat.objects[1].size_m.depth = 0.5;
    flat.objects[1].front_deg = Some(720.0);
    assert!(complaint(flat.check(&asked, &[])).contains("front_deg of chair_02"));
}

#[test]
fn exactly_the_shown_objects_are_judged() {
    let answer = |names: &[&str]| CompletedAnswer {
        objects: names
            .iter()
            .map(|id| CompletedObject { id: (*id).into(), matches: true, hint: String::new() })
            .collect(),
    };
    let asked = ids(&["chair_01", "sofa_01"]);
    assert_eq!(answer(&["sofa_01", "chair_01"]).check(&asked), Ok(()));
    assert!(complaint(answer(&["sofa_01"]).check(&asked)).contains("no entry for chair_01"));
    assert!(complaint(answer(&["sofa_01", "chair_01", "desk_01"]).check(&asked)).contains("not asked for"));
}

#[test]
fn actions_of_a_review_carry_what_they_need() {
    let action = |kind| ReviewActionAnswer {
        action: kind,
        id: "chair_01".into(),
        other: None,
        delta_m: None,
        position_m: None,
        angle_deg: None,
        factor: None,
        reason: String::new(),
    };
    let known = ids(&["chair_01", "desk_01"]);
    let check =
        |action: ReviewActionAnswer| ReviewAnswer { actions: vec![action], ..ReviewAnswer::default() }.check(&known);
    for (kind, what) in [
        (ReviewActionKind::Move, "delta_m"),
        (ReviewActionKind::Rotate, "angle_deg"),
        (ReviewActionKind::Rescale, "factor"),
        (ReviewActionKind::Swap, "other"),
        (ReviewActionKind::Rehost, "other"),
        (ReviewActionKind::Add, "position_m"),
    ] {
        assert!(complaint(check(action(kind))).contains(what), "{kind:?}");
    }
    for kind in [ReviewActionKind::Remove, ReviewActionKind::EqualizeGroup] {
        assert_eq!(check(action(kind)), Ok(()), "{kind:?}");
    }
    let far = ReviewActionAnswer { delta_m: Some([0.0, 0.0, 99.0]), ..action(ReviewActionKind::Move) };
    assert!(complaint(check(far)).contains("position or delta"));
    let giant = ReviewActionAnswer { factor: Some([1.0, 50.0, 1.0]), ..action(ReviewActionKind::Rescale) };
    assert!(complaint(check(giant)).contains("factor"));
    let onto = |other: &str| ReviewActionAnswer { other: Some(other.into()), ..action(ReviewActionKind::Rehost) };
    assert_eq!(check(onto("desk_01")), Ok(()));
    assert!(complaint(check(onto("shelf_09"))).contains("no object"));
    let many = ReviewAnswer { actions: vec![action(ReviewActionKind::Remove); 61], ..ReviewAnswer::default() };
    assert!(complaint(many.check(&known)).contains("at most 60"));
}

#[test]
fn one_unknown_id_costs_its_entry_and_more_than_half_the_answer() {
    let id = |text: &str| harmony_scene::ObjectId::new(text).unwrap();
    let sets = [("chairs", ["chair_01", "chair_02"]), ("stools", ["stool_01", "stool_02"])];
    let sets = sets.map(|(name, members)| MatchedSet { name: name.into(), members: members.map(id).to_vec() });
    let groups = GroupsQuestion { sets: sets.to_vec() };
    let swap = |a: &str, b: &str| GroupSwap { id: a.into(), with: b.into() };
    let swaps = |swaps: Vec<GroupSwap>| groups.check(&GroupsAnswer { swaps, missing: vec![] });
    let right = || swap("chair_01", "chair_02");
    for wrong in [swap("chair_09", "chair_01"), swap("chair_01", "chair_09"), swap("chair_01", "stool_01")] {
        assert!(groups.swap_complaint(&wrong).is_some());
        assert_eq!(swaps(vec![right(), wrong.clone()]), Ok(()));
        assert!(swaps(vec![right(), wrong.clone(), wrong]).is_err());
    }
    assert_eq!(groups.swap_complaint(&right()), None);

    let candidates = ["desk_01", "shelf_01"].map(id).to_vec();
    let hosted = HostedObject { id: id("vase_01"), about: "vase".into(), current: None, candidates };
    let hosts = HostsQuestion { objects: vec![hosted] };
    let onto = |object: &str, host: &str| HostsObject { id: object.into(), host: host.into(), reason: String::new() };
    let (right, wrong) = (onto("vase_01", "desk_01"), [onto("vase_01", "sofa_01"), onto("vase_09", "desk_01")]);
    assert_eq!(hosts.complaint(&right), None);
    for wrong in wrong {
        assert!(hosts.complaint(&wrong).is_some());
        assert_eq!(hosts.check(&HostsAnswer { objects: vec![right.clone(), wrong.clone()] }), Ok(()));
        assert!(hosts.check(&HostsAnswer { objects: vec![wrong] }).is_err());
    }

    let Some(counts) = questions().into_iter().find_map(|(_, question)| match question {
        Question::Counts(counts) => Some(counts),
        _ => None,
    }) else {
        panic!("the samples have no counts")
    };
    let surplus = |surplus: &[&str]| {
        let (kind, level, surplus) = ("stool".to_owned(), harmony_scene::Level::Furniture, ids(surplus));
        let kind = CountedKind { kind, level, photo: 0, scene: 1, missing: vec![], surplus };
        CountsQuestion::check(&counts, &CountsAnswer { kinds: vec![kind] })
    };
    assert_eq!(surplus(&["desk_01", "stool_09"]), Ok(()));
    assert!(complaint(surplus(&["desk_01", "stool_08", "stool_09"])).contains("stool_09"));
}
