//! A run that asks as often as the paper asks, from the photo to the scene.

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_bench::generate::{GeneratorSettings, RoomKind, generate, write};
use harmony_bench::metrics::similarity::Looking;
use harmony_bench::oracle::{Noise, NoiseLevel, Oracle};
use harmony_bench::run::{Play, judged};
use harmony_bench::truth::TruthRoom;
use harmony_calls::{BookOptions, CallBook};
use harmony_pipeline::{LookKind, LookSettings, Phase, ProgressSink, Questions, Settings};
use harmony_roles::Role;
use harmony_scene::{ImageSize, Level};

/// A dining room: its chairs are a matched set, its table carries decorations.
fn dining_room(folder: &std::path::Path) -> TruthRoom {
    let settings = GeneratorSettings {
        kinds: vec![RoomKind::DiningRoom],
        image: Some(ImageSize::new(400, 300)),
        min_objects: 8,
        max_objects: 9,
        points: 2000,
        shell_points: 500,
        ..GeneratorSettings::default()
    };
    write(&generate(7, &settings), folder).unwrap();
    TruthRoom::load(folder).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_asks_as_often_as_the_paper_and_ends_with_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let truth = dining_room(&folder.path().join("room"));
    let out = folder.path().join("run");
    let play = Play {
        truth: &truth,
        oracle: Arc::new(Oracle::new(truth.clone(), NoiseLevel::Real.noise(), 1, true)),
        settings: Settings { questions: Questions::Paper, working_px: 400, ..Settings::default() },
        until: Phase::Objects(Level::Decoration),
        path_tracer: false,
        profile: "oracle".to_owned(),
        further_inputs: String::new(),
    };
    let silent: ProgressSink = Arc::new(|_| {});
    let outcome = Box::pin(play.run(&out, &harmony_players::flat_cast(), &silent)).await.unwrap();
    assert!(outcome.failure.is_none(), "{:?}", outcome.failure.map(|failure| failure.to_string()));
    let scene = outcome.scene.unwrap();
    assert!(scene.objects.len() >= 5, "{} objects", scene.objects.len());

    let time = outcome.file.phases["3_furniture"].time.unwrap();
    assert!(time.own_s > 0.0 && time.waited_s > 0.0, "{time:?}");

    let book = CallBook::open(&out, BookOptions::default()).unwrap();
    let asked: Vec<String> =
        book.log().unwrap().into_iter().filter(|c| c.role == Role::VisionLanguage).map(|c| c.name).collect();
    let table = scene.objects.iter().find(|o| o.label.contains("table")).unwrap();
    let missing = format!("5_decoration/missing/{}", table.id);
    for name in [missing.as_str(), "3_furniture/turn_1", "3_furniture/groups", "5_decoration/counts"] {
        assert!(asked.iter().any(|asked| asked == name), "{name} is not among {asked:#?}");
    }
    let rounds = |level: Level| {
        let review = format!("{}/review_", level.folder());
        asked.iter().filter(|name| name.starts_with(&review)).count()
    };
    assert!(Level::ALL.map(rounds).iter().all(|count| *count <= 3), "{asked:#?}");
    let per_object = asked.len() as f64 / scene.objects.len() as f64;
    assert!((outcome.file.questions_per_object - per_object).abs() < 1e-9);
    let [score, _] = judged(&truth, &out, 0, 1.0, None, &Looking::default());
    assert_eq!(score.questions_per_object, Some(outcome.file.questions_per_object));

    // Each look is told with its questions, and what it changed is held against the truth.
    let looks = &outcome.file.looks;
    for (look, begins) in [(LookKind::Missing, "missing/"), (LookKind::Turns, "turn_"), (LookKind::Counts, "counts")] {
        let told: usize = looks.iter().filter(|came| came.look == look).map(|came| came.questions).sum();
        let logged = asked.iter().filter(|name| name.split_once('/').is_some_and(|(_, step)| step.starts_with(begins)));
        assert_eq!(told, logged.count(), "{look:?}");
    }
    let moved: usize = looks.iter().map(|came| came.moved.len()).sum();
    let judged: usize = score.looks.iter().map(|look| look.moved).sum();
    assert!(
        judged <= moved && score.looks.iter().all(|look| look.mended + look.made <= look.moved),
        "{:?}",
        score.looks
    );
    let questions: usize = looks.iter().map(|came| came.questions).sum();
    assert_eq!(score.looks.iter().map(|look| look.questions).sum::<usize>(), questions);

    // Masks are there of what an inspection kept, and of nothing else.
    for level in Level::ALL {
        let phase = out.join(level.folder());
        let Ok(rows) = harmony_io::read_json::<serde_json::Value>(&phase.join("detections.json")) else { continue };
        let has_mask: BTreeMap<String, bool> = rows["kept"]
            .as_array()
            .unwrap()
            .iter()
            .map(|row| (row["id"].as_str().unwrap().to_owned(), row["mask"].is_string()))
            .collect();
        for (id, wanted) in has_mask {
            assert_eq!(phase.join(format!("masks/{id}.png")).is_file(), wanted, "{id}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_lists_overlooked_is_counted_and_added_though_they_found_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let truth = dining_room(&folder.path().join("room"));
    let silent: ProgressSink = Arc::new(|_| {});
    let mut placed = Vec::new();
    for counts in [false, true] {
        let mut settings = Settings { working_px: 400, ..Settings::default() };
        settings.looks.counts = counts;
        let noise = Noise { overlooked: 1.0, ..NoiseLevel::Real.noise() };
        let play = Play {
            truth: &truth,
            oracle: Arc::new(Oracle::new(truth.clone(), noise, 1, true)),
            settings,
            until: Phase::Objects(Level::Decoration),
            path_tracer: false,
            profile: "oracle".to_owned(),
            further_inputs: String::new(),
        };
        let out = folder.path().join(format!("run_{counts}"));
        let outcome = Box::pin(play.run(&out, &harmony_players::flat_cast(), &silent)).await.unwrap();
        assert!(outcome.failure.is_none(), "{:?}", outcome.failure.map(|failure| failure.to_string()));
        let added: usize = outcome.file.looks.iter().map(|came| came.added.len()).sum();
        assert_eq!(added > 0, counts);
        placed.push(outcome.scene.unwrap().objects);
    }
    let furniture = |scene: &[harmony_scene::SceneObject]| scene.iter().filter(|o| o.level == Level::Furniture).count();
    assert_eq!(furniture(&placed[0]), 0);
    assert!(furniture(&placed[1]) >= 3, "{}", furniture(&placed[1]));
}

#[tokio::test(flavor = "multi_thread")]
async fn members_that_were_taken_for_each_other_are_named_and_what_was_exchanged_is_shown_once_more() {
    let folder = tempfile::tempdir().unwrap();
    let truth = dining_room(&folder.path().join("room"));
    let noise = Noise { swapped: 1.0, noticed: 1.0, ..NoiseLevel::Clean.noise() };
    let looks = LookSettings {
        missing: false,
        hosts: false,
        turns: false,
        groups: true,
        counts: false,
        reorder: false,
        physical: false,
        rounds: false,
    };
    let questions = Questions::Paper;
    let settings = Settings { questions, looks, working_px: 400, review_rounds: 0, ..Settings::default() };
    let oracle = Arc::new(Oracle::new(truth.clone(), noise, 1, true));
    let play = Play {
        truth: &truth,
        oracle: Arc::clone(&oracle),
        settings,
        until: Phase::Objects(Level::Furniture),
        path_tracer: false,
        profile: "oracle".to_owned(),
        further_inputs: String::new(),
    };
    let silent: ProgressSink = Arc::new(|_| {});
    let out = folder.path().join("run");
    let outcome = Box::pin(play.run(&out, &harmony_players::flat_cast(), &silent)).await.unwrap();
    assert!(outcome.failure.is_none(), "{:?}", outcome.failure.map(|failure| failure.to_string()));
    oracle.faults().write(&out).unwrap();
    let rounds: serde_json::Value = harmony_io::read_json(&out.join("3_furniture/groups.json")).unwrap();
    let rounds = rounds.as_array().unwrap();
    // A second round is asked where the first has changed something, and only there.
    let swaps = |round: &serde_json::Value| round["swaps"].as_array().unwrap().clone();
    assert!(!swaps(&rounds[0]).is_empty(), "{rounds:#?}");
    for (k, round) in rounds.iter().enumerate() {
        let changed = swaps(round).iter().any(|swap| swap["kept"] == true);
        assert_eq!(rounds.len() > k + 1, changed && k < 2, "{rounds:#?}");
    }

    let [score, _] = judged(&truth, &out, 0, 1.0, None, &Looking::default());
    let groups = score.looks.iter().find(|look| look.look == LookKind::Groups).unwrap();
    assert_eq!([groups.there, groups.found], oracle.faults().of(LookKind::Groups));
    assert!(groups.found > 0 && groups.made == 0, "{groups:?}");
}
