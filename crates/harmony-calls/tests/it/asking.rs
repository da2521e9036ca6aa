//! The way of one question: checked, asked again, replaced, recorded, used again.

use crate::common::{self, Desk, Say, Scripted, sane, tree, width_question};
use harmony_calls::{Bill, BookOptions, Secret, Source};
use harmony_roles::{Role, RoleError};
use harmony_scene::WarningKind;
use serde_json::json;

#[tokio::test]
async fn a_good_answer_is_recorded_and_never_asked_for_again() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4.1})]);
    let offline = Scripted::saying("offline", true, &[]);
    let question = width_question("1_layout/layout");

    let first = Desk::open(run.path(), BookOptions::default(), &vlm, &offline);
    let answer = first.calls.ask(&question, sane).await.unwrap();
    assert_eq!(answer.value, json!({"width_m": 4.1}));
    let folder = run.path().join("calls/vision_language/1_layout/layout");
    for file in ["record.json", "timing.json", "request.json", "prompt.md", "raw.txt", "answer.json"] {
        assert!(folder.join(file).is_file(), "{file}");
    }
    assert!(folder.join("images/image_1.png").is_file());
    let before = tree(run.path());

    let second = Desk::open(run.path(), BookOptions::default(), &vlm, &offline);
    let again = second.calls.ask(&question, sane).await.unwrap();
    assert_eq!(again.value, answer.value);
    assert_eq!(vlm.asked(), 1, "the second run asks nobody");
    assert_eq!((second.calls.counts().asked, second.calls.counts().reused), (0, 1));
    assert_eq!(tree(run.path()), before, "and changes no byte");
}

#[tokio::test]
async fn another_question_under_the_same_name_is_asked_and_replaces_the_record() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4.0}), json!({"width_m": 5.0})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &Scripted::saying("offline", true, &[]));
    let mut question = width_question("1_layout/layout");
    desk.calls.ask(&question, sane).await.unwrap();
    question.prompt.push_str(" In metres.");
    let answer = desk.calls.ask(&question, sane).await.unwrap();
    assert_eq!(answer.value["width_m"], 5.0);
    assert_eq!(desk.calls.book().log().unwrap().len(), 1);
    let left = std::fs::read_dir(run.path().join("calls/.tmp")).map_or(0, Iterator::count);
    assert_eq!(left, 0, "no litter");
}

#[tokio::test]
async fn an_answer_that_does_not_fit_or_makes_no_sense_is_asked_for_again_with_the_complaint() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width": 4}), json!({"width_m": 900}), json!({"width_m": 4})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &Scripted::saying("offline", true, &[]));
    let answer = desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    assert_eq!(answer.value, json!({"width_m": 4}));
    let heard = vlm.heard.lock().unwrap();
    assert!(heard[1].prompt.contains("width_m") && heard[1].prompt.starts_with(&heard[0].prompt));
    assert!(heard[2].prompt.contains("width_m is 900; expected 1 to 20"), "{}", heard[2].prompt);
    let log = desk.calls.book().log().unwrap();
    assert_eq!(log[0].tries, 3);
    let bill = Bill::of(&log);
    assert_eq!(bill.total.usage.cost_usd, Some(1.5), "unusable answers are paid for too");
    assert_eq!(bill.by_phase["1_layout"].tries, 3);
    assert!(desk.warnings().is_empty());
}

#[tokio::test]
async fn after_three_bad_answers_the_offline_player_stands_in_with_a_warning_that_is_told_again() {
    let run = tempfile::tempdir().unwrap();
    let bad = json!({"width_m": -1});
    let vlm = Scripted::saying("model", false, &[bad.clone(), bad.clone(), bad.clone(), bad]);
    let offline = Scripted::saying("offline", true, &[json!({"width_m": 3.5})]);
    let question = width_question("3_furniture/chair_02/size");
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &offline);
    let answer = desk.calls.ask(&question, sane).await.unwrap();
    assert_eq!(answer.value["width_m"], 3.5);
    assert_eq!((vlm.asked(), offline.asked()), (3, 1));
    let warnings = desk.warnings();
    assert_eq!(warnings.len(), 1);
    assert_eq!(warnings[0].kind, WarningKind::PlayerReplaced);
    assert_eq!(warnings[0].phase, "3_furniture");
    assert_eq!(warnings[0].object.as_ref().unwrap().as_str(), "chair_02");
    assert!(warnings[0].message.contains("width_m is -1"), "{}", warnings[0].message);

    let again = Desk::open(run.path(), BookOptions::default(), &vlm, &offline);
    again.calls.ask(&question, sane).await.unwrap();
    assert_eq!(again.calls.counts().asked, 0);
    assert_eq!(again.warnings(), warnings);

    let options = BookOptions { retry_replaced: true, ..BookOptions::default() };
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4.5})]);
    let retried = Desk::open(run.path(), options, &vlm, &offline);
    assert_eq!(retried.calls.ask(&question, sane).await.unwrap().value["width_m"], 4.5);
    assert!(retried.warnings().is_empty());
}

#[tokio::test]
async fn a_fatal_error_stops_instead_of_being_replaced() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::new("model", false, vec![Say::Fail(|| RoleError::Budget { reason: "10 calls".into() })]);
    let offline = Scripted::saying("offline", true, &[json!({"width_m": 3.5})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &offline);
    let error = desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap_err();
    assert!(matches!(error, RoleError::Budget { .. }));
    assert_eq!(offline.asked(), 0);
    let log = desk.calls.book().log().unwrap();
    assert_eq!(log.len(), 1);
    assert_eq!(log[0].source, Source::Unanswered, "there is no record, but an account of what was tried");
}

#[tokio::test]
async fn hostile_names_are_refused_and_nothing_is_written_outside_the_book() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &Scripted::saying("offline", true, &[]));
    for name in ["../../escape", "/etc/passwd", "a/../../b", "", "1_layout/Sofa's", "a\0b"] {
        assert!(desk.calls.ask(&width_question(name), sane).await.is_err(), "{name:?}");
    }
    assert_eq!(vlm.asked(), 0);
    let entries: Vec<_> = std::fs::read_dir(run.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(entries, ["calls"]);
}

#[tokio::test]
async fn hostile_answers_are_bounded() {
    let run = tempfile::tempdir().unwrap();
    let many = json!({"width_m": vec!["../../x".repeat(20); 10_000]});
    let vlm = Scripted::saying("model", false, &[json!([null]), many, json!("width_m")]);
    let offline = Scripted::saying("offline", true, &[json!({"width_m": 3.5})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &offline);
    desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    for request in vlm.heard.lock().unwrap().iter() {
        assert!(request.prompt.len() < 8_000, "a complaint has {} bytes", request.prompt.len());
    }
    let record = std::fs::metadata(run.path().join("calls/vision_language/1_layout/layout/record.json")).unwrap();
    assert!(record.len() < 20_000, "{}", record.len());
}

#[tokio::test]
async fn secrets_never_enter_a_record() {
    let run = tempfile::tempdir().unwrap();
    let leak = || RoleError::NotSetUp {
        player: "model".into(),
        reason: "401: bad key sk-very-secret-123".into(),
        hint: String::new(),
    };
    let vlm = Scripted::new("model", false, vec![Say::Fail(leak)]);
    let offline = Scripted::saying("offline", true, &[json!({"width_m": 3.5})]);
    let options = BookOptions { secrets: vec![Secret::new("sk-very-secret-123".into())], ..BookOptions::default() };
    assert!(!format!("{options:?}").contains("very-secret"));
    let desk = Desk::open(run.path(), options, &vlm, &offline);
    let mut question = width_question("1_layout/layout");
    question.prompt.push_str(" (sk-very-secret-123)");
    desk.calls.ask(&question, sane).await.unwrap();
    for (path, bytes) in tree(run.path()) {
        assert!(!String::from_utf8_lossy(&bytes).contains("very-secret"), "{}", path.display());
    }
    assert!(!desk.warnings()[0].message.contains("very-secret"));
    assert!(desk.warnings()[0].message.contains("[secret]"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_calls_under_one_name_make_one_call() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4}), json!({"width_m": 5})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &Scripted::saying("offline", true, &[]));
    let ask = || {
        let calls = desk.calls.clone();
        tokio::spawn(async move { calls.ask(&width_question("1_layout/layout"), sane).await.unwrap().value })
    };
    let (a, b) = (ask(), ask());
    assert_eq!(a.await.unwrap(), b.await.unwrap());
    assert_eq!(vlm.asked(), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_player_has_no_more_calls_at_once_than_its_card_says() {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    struct Slow {
        now: AtomicUsize,
        most: AtomicUsize,
    }
    #[async_trait::async_trait]
    impl harmony_roles::VisionLanguage for Slow {
        fn card(&self) -> harmony_roles::PlayerCard {
            harmony_roles::PlayerCard { concurrency: 2, ..common::card("slow", false) }
        }

        async fn ask(&self, _: &harmony_roles::VlmRequest) -> Result<harmony_roles::VlmAnswer, RoleError> {
            let now = self.now.fetch_add(1, Ordering::SeqCst) + 1;
            self.most.fetch_max(now, Ordering::SeqCst);
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
            self.now.fetch_sub(1, Ordering::SeqCst);
            let value = json!({"width_m": 4});
            Ok(harmony_roles::VlmAnswer { raw: value.to_string(), value, usage: harmony_roles::Usage::default() })
        }
    }
    let run = tempfile::tempdir().unwrap();
    let slow = Arc::new(Slow { now: AtomicUsize::new(0), most: AtomicUsize::new(0) });
    let offline = Scripted::saying("offline", true, &[]);
    let others = common::Everyone::new("others", true, false);
    let mut cast = common::cast(&offline, &others);
    cast.vision_language = slow.clone();
    let desk = Desk::with(run.path(), BookOptions::default(), cast, common::cast(&offline, &others));
    let tasks: Vec<_> = (0..7)
        .map(|i| {
            let calls = desk.calls.clone();
            tokio::spawn(async move { calls.ask(&width_question(&format!("1_layout/q{i}")), sane).await.unwrap() })
        })
        .collect();
    for task in tasks {
        task.await.unwrap();
    }
    assert_eq!(slow.most.load(Ordering::SeqCst), 2);
}

#[tokio::test]
async fn a_record_edited_by_a_person_is_taken_if_it_makes_sense_and_changes_the_digest() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4}), json!({"width_m": 6})]);
    let offline = Scripted::saying("offline", true, &[]);
    let question = width_question("1_layout/layout");
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &offline);
    desk.calls.ask(&question, sane).await.unwrap();
    let book = desk.calls.book();
    let digest = book.answers_digest("1_layout/").unwrap();
    assert_eq!(digest, book.answers_digest("1_layout/").unwrap());
    let file = run.path().join("calls/vision_language/1_layout/layout/answer.json");
    std::fs::write(&file, "{\"width_m\": 7}").unwrap();
    assert_ne!(digest, book.answers_digest("1_layout/").unwrap());
    assert_eq!(desk.calls.ask(&question, sane).await.unwrap().value["width_m"], 7);
    assert_eq!(vlm.asked(), 1);

    std::fs::write(&file, "{\"width_m\": 7000}").unwrap();
    assert_eq!(desk.calls.ask(&question, sane).await.unwrap().value["width_m"], 6, "asked again");
    assert_eq!(desk.warnings()[0].kind, WarningKind::AnswerRepaired);
}

#[tokio::test]
async fn ask_as_gives_the_type_and_sends_a_misfit_back_as_a_complaint() {
    #[derive(serde::Deserialize)]
    struct Width {
        width_m: u32,
    }
    let run = tempfile::tempdir().unwrap();
    // Fits the schema (a number), not the type (a whole number).
    let vlm = Scripted::saying("model", false, &[json!({"width_m": 4.5}), json!({"width_m": 5})]);
    let desk = Desk::open(run.path(), BookOptions::default(), &vlm, &Scripted::saying("offline", true, &[]));
    let width: Width = desk.calls.ask_as(&width_question("1_layout/layout"), |_: &Width| Ok(())).await.unwrap();
    assert_eq!(width.width_m, 5);
    assert_eq!(vlm.asked(), 2);
    assert!(vlm.heard.lock().unwrap()[1].split_complaint().1.unwrap().contains("does not fit"));
    let name = harmony_calls::CallName::new("1_layout/layout").unwrap();
    let record = desk.calls.book().record(Role::VisionLanguage, &name).unwrap();
    assert_eq!(record.source, Source::Player);
}
