//! The folder as a language model, with a thread as the one who answers.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast};
use harmony_players::{FilesEvent, FilesOptions, FilesPlayer, offline_cast};
use harmony_prompts::{ListAnswer, ListQuestion};
use harmony_roles::{Picture, RoleError, VisionLanguage, VlmRequest};
use harmony_scene::Level;
use image::{Rgb, RgbImage};
use serde_json::{Value, json};

fn options(folder: &Path) -> FilesOptions {
    FilesOptions {
        poll: Duration::from_millis(10),
        settle: Duration::from_millis(100),
        patience: Some(Duration::from_secs(20)),
        answered_by: "a thread".into(),
        ..FilesOptions::new(folder)
    }
}

/// The real list question, about a small picture.
fn question(name: &str) -> VlmRequest {
    let question = ListQuestion {
        level: Level::Furniture,
        room_type: "bedroom".into(),
        with_boxes: true,
        placed: vec![],
        trays: vec![],
        view: None,
    };
    let image = Arc::new(RgbImage::from_pixel(32, 20, Rgb([200, 180, 160])));
    VlmRequest::new(name.into(), question.into(), vec![Picture { caption: "IMAGE 1: the photo".into(), image }])
}

fn good() -> Value {
    json!({"items": [{"type": "bed", "gdino": "bed", "count": 1, "instances": [
        {"box": [100, 300, 700, 900], "outline": [], "host": null}
    ]}]})
}

/// Waits until a file is there and returns its text.
fn read_when_there(path: &Path) -> String {
    for _ in 0..12_000 {
        if let Ok(text) = std::fs::read_to_string(path) {
            return text;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("{} did not appear", path.display());
}

fn write(folder: &Path, answer: &str) {
    std::fs::write(folder.join("answer.json"), answer).unwrap();
}

#[tokio::test]
async fn a_wrong_answer_gets_a_complaint_and_the_right_one_is_taken() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("001_3_furniture__list");
    let events: Arc<Mutex<Vec<FilesEvent>>> = Arc::default();
    let sink = events.clone();
    let player = FilesPlayer::new(FilesOptions {
        on_event: Arc::new(move |e| sink.lock().unwrap().push(e)),
        ..options(root.path())
    });
    let answering = std::thread::spawn({
        let folder = folder.clone();
        move || {
            let prompt = read_when_there(&folder.join("prompt.md"));
            assert!(prompt.contains("![image_1_the_photo.png](image_1_the_photo.png)"), "{prompt}");
            assert!(prompt.contains("answer.json") && prompt.contains("`gdino`"), "{prompt}");
            for file in ["image_1_the_photo.png", "schema.json", "example.json"] {
                assert!(folder.join(file).is_file(), "{file}");
            }
            let example: Value = serde_json::from_str(&read_when_there(&folder.join("example.json"))).unwrap();
            assert!(serde_json::from_value::<ListAnswer>(example).is_ok());
            write(&folder, r#"{"items": [{"type": "bed", "gdino": "bed", "count": "one", "instances": []}]}"#);
            let complaint = read_when_there(&folder.join("complaint.md"));
            assert!(complaint.contains("/items/0/count") && complaint.contains("one"), "{complaint}");
            // In a fence and with a comma too many, as chat windows give it.
            let text = format!("Here:\n```json\n{}\n```\n", good().to_string().replace("}]}", "},]}"));
            write(&folder, &text);
        }
    });
    let answer = player.ask(&question("3_furniture/list")).await.unwrap();
    answering.join().unwrap();
    assert_eq!(answer.value, good());
    assert!(answer.raw.starts_with("Here:"));
    assert!(folder.join("accepted").is_file());
    assert!(!folder.join("complaint.md").exists());
    let events = events.lock().unwrap();
    let name = || "3_furniture/list".to_owned();
    assert_eq!(events[0], FilesEvent::Waiting { name: name(), folder, open: 1, answered: 0 });
    assert!(matches!(&events[1], FilesEvent::Complained { complaint, .. } if complaint.contains("count")));
    assert_eq!(events.last(), Some(&FilesEvent::Accepted { name: name(), open: 0, answered: 1 }));
}

#[tokio::test]
async fn a_half_written_answer_is_given_time() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("001_3_furniture__list");
    let complaints: Arc<Mutex<usize>> = Arc::default();
    let sink = complaints.clone();
    let on_event = move |e| *sink.lock().unwrap() += usize::from(matches!(e, FilesEvent::Complained { .. }));
    let settle = Duration::from_secs(5);
    let player = FilesPlayer::new(FilesOptions { settle, on_event: Arc::new(on_event), ..options(root.path()) });
    let answering = std::thread::spawn(move || {
        read_when_there(&folder.join("prompt.md"));
        let text = good().to_string();
        for cut in [0, 1, text.len() / 3, text.len() / 2, text.len() - 1, text.len()] {
            write(&folder, &text[..cut]);
            std::thread::sleep(Duration::from_millis(40));
        }
    });
    assert_eq!(player.ask(&question("3_furniture/list")).await.unwrap().value, good());
    answering.join().unwrap();
    assert_eq!(*complaints.lock().unwrap(), 0);
}

#[tokio::test]
async fn a_question_that_was_answered_before_is_not_asked_again() {
    let root = tempfile::tempdir().unwrap();
    let asked = question("3_furniture/list");
    let answering = std::thread::spawn({
        let folder = root.path().join("001_3_furniture__list");
        move || {
            read_when_there(&folder.join("prompt.md"));
            write(&folder, &good().to_string());
        }
    });
    FilesPlayer::new(options(root.path())).ask(&asked).await.unwrap();
    answering.join().unwrap();
    // Another program, later: the answer is there. Nobody is left to write one.
    let again = FilesPlayer::new(options(root.path())).ask(&asked).await.unwrap();
    assert_eq!(again.value, good());
    // Another content is another question, with a number of its own.
    let mut other = asked.clone();
    other.prompt.push_str("!\n");
    let impatient = FilesOptions { patience: Some(Duration::from_millis(50)), ..options(root.path()) };
    let error = FilesPlayer::new(impatient).ask(&other).await.unwrap_err();
    assert!(error.is_retryable(), "{error}");
    let folders = folders(root.path());
    assert_eq!(folders, ["001_3_furniture__list", "002_3_furniture__list"]);
}

fn folders(root: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(root)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name != "README.md" && !name.starts_with('.'))
        .collect();
    names.sort();
    names
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn several_questions_are_open_at_once_and_may_be_answered_in_any_order() {
    let root = tempfile::tempdir().unwrap();
    let player = Arc::new(FilesPlayer::new(options(root.path())));
    let names = ["2_wall/list", "3_furniture/list", "4_ceiling/list"];
    let tasks: Vec<_> = names
        .map(|name| {
            let player = player.clone();
            tokio::spawn(async move { player.ask(&question(name)).await.unwrap().value })
        })
        .into();
    let root = root.path().to_owned();
    let answering = std::thread::spawn(move || {
        while folders(&root).iter().filter(|f| root.join(f).join("prompt.md").is_file()).count() < 3 {
            std::thread::sleep(Duration::from_millis(10));
        }
        for folder in folders(&root).iter().rev() {
            let count = json!({"items": [{"type": folder, "gdino": "x", "count": 1, "instances": []}]});
            write(&root.join(folder), &count.to_string());
        }
    });
    for (task, name) in tasks.into_iter().zip(names) {
        let value = task.await.unwrap();
        let kind = value["items"][0]["type"].as_str().unwrap();
        assert!(kind.ends_with(&name.replace('/', "__")), "{kind} for {name}");
    }
    answering.join().unwrap();
    assert_eq!(player.tally(), (0, 3));
}

#[tokio::test]
async fn passing_lets_another_player_answer() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("001_3_furniture__list");
    let answering = std::thread::spawn(move || {
        read_when_there(&folder.join("prompt.md"));
        std::fs::write(folder.join("pass"), "the picture is too dark\n").unwrap();
    });
    let error = FilesPlayer::new(options(root.path())).ask(&question("3_furniture/list")).await.unwrap_err();
    answering.join().unwrap();
    assert!(matches!(&error, RoleError::Refused { reason, .. } if reason == "the picture is too dark"), "{error}");
}

/// What fits the schema but makes no sense comes back through the wrapper, into the same folder.
#[tokio::test]
async fn an_answer_without_sense_is_complained_about_in_the_same_folder() {
    let run = tempfile::tempdir().unwrap();
    let root: PathBuf = run.path().join("questions");
    let player = Arc::new(FilesPlayer::new(options(&root)));
    let offline = offline_cast();
    let cast = Cast { vision_language: player, ..offline.clone() };
    let book = Arc::new(CallBook::open(run.path(), BookOptions::default()).unwrap());
    let calls = Calls::new(book, cast, offline, CallOptions::default());
    let folder = root.join("001_3_furniture__list");
    let answering = std::thread::spawn(move || {
        read_when_there(&folder.join("prompt.md"));
        write(&folder, &good().to_string().replace("100", "700"));
        let complaint = read_when_there(&folder.join("complaint.md"));
        assert!(complaint.contains("is empty"), "{complaint}");
        write(&folder, &good().to_string());
    });
    let sense = |answer: &ListAnswer| answer.check();
    let answer: ListAnswer = calls.ask_as(&question("3_furniture/list"), sense).await.unwrap();
    answering.join().unwrap();
    assert_eq!(answer.items[0].kind, "bed");
    assert_eq!(folders(&root).len(), 1);
    assert_eq!(calls.counts().asked, 2);
}
