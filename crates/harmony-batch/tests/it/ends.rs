//! How scenes end: done, failed and tried again, set aside, stopped, given back.

use std::time::{Duration, Instant};

use harmony_batch::queue::{Filter, SetState};
use harmony_batch::status::{Status, write_table};
use harmony_batch::{WorkerEvent, WorkerReport, WorkerStop, work};

use crate::common::Desk;

#[tokio::test]
async fn bad_photos_crashes_and_phases_that_fail_are_set_aside_with_their_causes_and_the_rest_is_done() {
    let photos = [
        ("good", "room"),
        ("other", "room 2"),
        ("bad", "no picture"),
        ("dies", "crash"),
        ("stuck", "never works 1"),
        ("stuck2", "never works 2"),
    ];
    let desk = Desk::new(&photos, 2000.0, |_| {}).await;
    let report = work(&desk.queue, desk.options(), &WorkerStop::default()).await.unwrap();
    assert_eq!(report, WorkerReport { done: 2, failed: 8, ..WorkerReport::default() }, "two attempts each");
    let scenes = desk.scenes().await;
    for name in ["good", "other"] {
        assert_eq!((scenes[name].state.as_str(), scenes[name].ends, scenes[name].calls), ("done", 1, 10), "{name}");
        assert!(desk.set.run(name).join("scene.json").is_file());
        // 6 questions, 2 edits, 2 meshes.
        let usd = 6.0 * 0.02 + 2.0 * 0.04 + 2.0 * 0.1;
        assert!((scenes[name].paid_usd - usd).abs() < 1e-9, "{:?}", scenes[name]);
        assert!((scenes[name].bill_usd.unwrap() - usd).abs() < 1e-9, "the bill says the same");
    }
    for (name, stage, said) in [
        ("bad", "input", "is no picture: # bytes"),
        ("dies", "crash", "killed by signal #"),
        ("stuck", "3_furniture", "no answer to inspect of # things"),
    ] {
        let row = &scenes[name];
        assert_eq!((row.state.as_str(), row.stage.as_str(), row.attempts, row.ends), ("failed", stage, 2, 1), "{name}");
        assert!(row.cause.contains(said), "{name}: {}", row.cause);
    }
    let status = Status::of(&desk.queue, desk.set.name()).await.unwrap();
    assert_eq!((status.counts.done, status.counts.failed, status.counts.open()), (2, 4, 0));
    assert_eq!((status.causes[0].failed, status.causes[0].stage.as_str()), (2, "3_furniture"), "most frequent first");
    assert!(status.text(desk.path()).contains("no answer to inspect of # things"));
    status.write(&desk.set).unwrap();
    write_table(&desk.queue, &desk.row, &desk.set).await.unwrap();
    let page = std::fs::read_to_string(desk.set.path().join("status.html")).unwrap();
    assert!(page.contains("2 of 6 scenes") && page.contains("--stage 3_furniture") && page.contains("logs/bad.log"));
    let table = std::fs::read_to_string(desk.set.path().join("scenes.csv")).unwrap();
    assert_eq!(table.lines().count(), 7);
    assert!(table.contains("\nstuck2,failed,3_furniture,no answer to inspect of # things,"), "{table}");

    // Those of one cause are put back, and what was paid for them is not paid again.
    let paid = desk.paid().len();
    let filter =
        Filter { stage: Some("3_furniture".into()), cause: Some("to inspect of #".into()), ..Filter::default() };
    assert_eq!(desk.queue.retry(desk.row.id, &filter).await.unwrap(), 2);
    let other = Filter { cause: Some("%".into()), ..Filter::default() };
    assert_eq!(desk.queue.retry(desk.row.id, &other).await.unwrap(), 0, "a sign of patterns is a sign like others");
    let report = work(&desk.queue, desk.options(), &WorkerStop::default()).await.unwrap();
    assert_eq!(report.failed, 4);
    assert_eq!(desk.paid().len(), paid);
}

#[tokio::test]
async fn a_scene_that_takes_too_long_is_stopped_and_many_failures_in_a_row_pause_the_set() {
    let photos = [("a", "endless 1"), ("b", "never works"), ("c", "never works 3"), ("d", "never works 4")];
    let desk = Desk::new(&photos, 2000.0, |set| {
        set.timeout_ms = 400;
        set.attempts = 1;
        set.streak = 3;
    })
    .await;
    let mut options = desk.options();
    // It does not listen to the end of its input, so it is killed after the grace.
    options.grace = Duration::from_millis(300);
    options.slots = 1;
    work(&desk.queue, options, &WorkerStop::default()).await.unwrap();
    let scenes = desk.scenes().await;
    assert_eq!((scenes["a"].stage.as_str(), scenes["a"].cause.as_str()), ("time", "it took longer than # s"));
    assert_eq!(scenes["d"].state, "queued", "the set was paused before");
    let set = desk.queue.set(desk.set.name()).await.unwrap();
    assert_eq!(set.state, SetState::Paused);
    assert!(set.reason.starts_with("failures:") && set.reason.contains("no answer"), "{}", set.reason);
    // Resumed, it goes on.
    desk.queue.set_state(desk.row.id, SetState::Running, "").await.unwrap();
    work(&desk.queue, desk.options(), &WorkerStop::default()).await.unwrap();
    assert_eq!(desk.scenes().await["d"].state, "failed");
}

#[tokio::test]
async fn a_worker_that_is_stopped_gives_its_scenes_back_and_nothing_is_paid_twice() {
    let desk = Desk::new(&[("a", "one"), ("b", "two"), ("c", "three")], 60.0, |_| {}).await;
    let stop = WorkerStop::default();
    let worker = tokio::spawn({
        let (queue, options, stop) = (desk.queue.clone(), desk.options(), stop.clone());
        async move { work(&queue, options, &stop).await }
    });
    desk.until("running", 2).await;
    while desk.paid().len() < 3 {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    stop.soon();
    let report = worker.await.unwrap().unwrap();
    assert_eq!((report.given_back, report.failed), (2, 0), "{report:?}");
    let scenes = desk.scenes().await;
    assert!(scenes.values().all(|row| row.state == "queued" && row.attempts == 0 && row.losses == 0), "{scenes:?}");
    let before = desk.paid().len();
    assert!((3..15).contains(&before));
    work(&desk.queue, desk.options(), &WorkerStop::default()).await.unwrap();
    let mut paid: Vec<String> =
        desk.paid().iter().map(|l| l.split('\t').take(3).collect::<Vec<_>>().join(" ")).collect();
    paid.sort();
    paid.dedup();
    assert_eq!((paid.len(), desk.paid().len()), (30, 30));
}

#[tokio::test]
#[ignore = "a cancelled scene is at times reported as ended on a busy machine; `cargo test -p harmony-batch -- --ignored`"]
async fn paused_scenes_wait_drained_workers_end_and_cancelled_scenes_are_stopped() {
    let desk = Desk::new(&[("a", "one"), ("b", "two"), ("c", "three")], 30.0, |_| {}).await;
    let mut options = desk.options();
    options.slots = 1;
    let worker = tokio::spawn({
        let (queue, options) = (desk.queue.clone(), options.clone());
        async move { work(&queue, options, &WorkerStop::default()).await }
    });
    desk.until("running", 1).await;
    desk.queue.set_state(desk.row.id, SetState::Draining, "").await.unwrap();
    let report = worker.await.unwrap().unwrap();
    assert_eq!(report.done, 1, "what runs goes on");
    assert_eq!(desk.scenes().await["b"].state, "queued");

    desk.queue.set_state(desk.row.id, SetState::Running, "").await.unwrap();
    assert_eq!(desk.queue.set_priority(desk.row.id, "c", 5).await.unwrap(), 1);
    let worker = tokio::spawn({
        let queue = desk.queue.clone();
        async move { work(&queue, options, &WorkerStop::default()).await }
    });
    desk.until("running", 1).await;
    assert_eq!(desk.scenes().await["c"].state, "running", "the higher priority goes first");
    let clock = Instant::now();
    assert_eq!(desk.queue.cancel_set(desk.row.id).await.unwrap(), (1, 1));
    let report = worker.await.unwrap().unwrap();
    assert_eq!(report.cancelled, 1);
    // A question of 8 s is at most 0.4 s here; the whole scene takes 3.
    assert!(clock.elapsed() < Duration::from_millis(2500), "{:?}", clock.elapsed());
    let scenes = desk.scenes().await;
    assert_eq!((scenes["b"].state.as_str(), scenes["c"].state.as_str()), ("cancelled", "cancelled"));
    assert_eq!((scenes["b"].ends, scenes["c"].ends), (1, 1));

    // Cancelled ones can be put back.
    desk.queue.set_state(desk.row.id, SetState::Running, "").await.unwrap();
    let filter = Filter { cancelled: true, scene: Some("b".into()), ..Filter::default() };
    assert_eq!(desk.queue.retry(desk.row.id, &filter).await.unwrap(), 1);
    work(&desk.queue, desk.options(), &WorkerStop::default()).await.unwrap();
    assert_eq!(desk.scenes().await["b"].state, "done");
    assert!(desk.events.lock().unwrap().iter().any(|e| matches!(e, WorkerEvent::Began { scene } if scene == "b")));
}
