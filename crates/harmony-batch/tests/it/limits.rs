//! Limits that hold over all programs of a queue.

use std::sync::Arc;
use std::time::Duration;

use harmony_batch::queue::{SetState, SharedPlayers};
use harmony_batch::{WorkerStop, work};
use harmony_calls::{PlayerLimits, SharedAsk, SharedLimits as _, SharedOver, SharedTurn};
use harmony_roles::Role;

use crate::common::Desk;

fn ask(places: usize, usd: f64) -> SharedAsk {
    SharedAsk {
        role: Role::MeshGenerator,
        player: "hunyuan".into(),
        model: "2".into(),
        places,
        limits: PlayerLimits::default(),
        expected_usd: Some(usd),
    }
}

async fn two(desk: &Desk) -> [SharedPlayers; 2] {
    let one = desk.queue.claim(&desk.row, "one").await.unwrap().unwrap();
    let two = desk.queue.claim(&desk.row, "two").await.unwrap().unwrap();
    [(one, "east"), (two, "west")]
        .map(|(job, host)| SharedPlayers::new(desk.queue.clone(), (desk.row.id, job.id, job.token), host.to_owned()))
}

fn number(turn: SharedTurn) -> i64 {
    match turn {
        SharedTurn::Go(number) => number,
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn places_are_shared_and_come_back_with_the_call_or_with_the_end_of_its_job() {
    let desk = Desk::new(&[("a", "one"), ("b", "two")], 1000.0, |_| {}).await;
    let [east, west] = two(&desk).await;
    let first = number(east.take(&ask(2, 0.1)).await);
    let second = number(west.take(&ask(2, 0.1)).await);
    assert!(matches!(east.take(&ask(2, 0.1)).await, SharedTurn::Wait(_)));
    east.settle(first, SharedOver { cost_usd: Some(0.3), ..SharedOver::default() }).await;
    east.flush(Duration::from_secs(5)).await;
    number(east.take(&ask(2, 0.1)).await);
    // A refusal that one is told holds back the other.
    west.refused("hunyuan", "2", Duration::from_secs(9)).await;
    west.settle(second, SharedOver::default()).await;
    west.flush(Duration::from_secs(5)).await;
    match east.take(&ask(0, 0.1)).await {
        SharedTurn::Wait(wait) => assert!(wait > Duration::from_secs(8), "{wait:?}"),
        other => panic!("{other:?}"),
    }
    let set = desk.queue.set(desk.set.name()).await.unwrap();
    assert!((set.spent_usd - 0.4).abs() < 1e-9 && (set.flying_usd - 0.1).abs() < 1e-9, "{set:?}");
    assert_eq!(set.spent_calls, 3);
}

#[tokio::test]
async fn players_of_each_machine_have_places_of_each_machine() {
    let desk = Desk::new(&[("a", "one"), ("b", "two")], 1000.0, |_| {}).await;
    let [east, west] = two(&desk).await.map(|players| players.with_own([Role::MeshGenerator]));
    number(east.take(&ask(1, 0.0)).await);
    number(west.take(&ask(1, 0.0)).await);
    assert!(matches!(east.take(&ask(1, 0.0)).await, SharedTurn::Wait(_)));
}

#[tokio::test]
async fn whoever_lost_the_job_gets_no_turn() {
    let desk = Desk::new(&[("a", "one"), ("b", "two")], 1000.0, |set| set.lease_ms = 1).await;
    let [east, _] = two(&desk).await;
    number(east.take(&ask(0, 0.25)).await);
    tokio::time::sleep(Duration::from_millis(20)).await;
    let mut back = desk.queue.tend().await.unwrap();
    back.sort();
    assert_eq!(back, ["a", "b"]);
    assert!(matches!(east.take(&ask(0, 0.25)).await, SharedTurn::Stop(_)));
    // What it had in flight may have been paid, and counts so.
    let set = desk.queue.set(desk.set.name()).await.unwrap();
    assert!((set.spent_usd - 0.25).abs() < 1e-9 && set.flying_usd == 0.0, "{set:?}");
    // Lost thrice, a scene is set aside: it may be what takes its workers along.
    for _ in 0..2 {
        desk.queue.claim(&desk.row, "one").await.unwrap().unwrap();
        tokio::time::sleep(Duration::from_millis(10)).await;
        desk.queue.tend().await.unwrap();
    }
    let row = desk.scenes().await.remove("a").unwrap();
    assert_eq!((row.state.as_str(), row.stage.as_str(), row.losses, row.ends), ("failed", "crash", 3, 1));
}

#[tokio::test]
async fn money_is_one_purse_and_a_higher_one_goes_on_without_paying_again() {
    let desk = Desk::new(&[("a", "one"), ("b", "two"), ("c", "three"), ("d", "four")], 600.0, |_| {}).await;
    // A scene is 0.40 US$.
    desk.queue.set_budget(desk.row.id, Some(0.9), None).await.unwrap();
    let mut options = desk.options();
    options.slots = 4;
    work(&desk.queue, options, &WorkerStop::default()).await.unwrap();
    let set = desk.queue.set(desk.set.name()).await.unwrap();
    assert_eq!(set.state, SetState::Paused);
    assert!(set.reason.starts_with("budget:"), "{}", set.reason);
    assert!(set.spent_usd <= 0.9 + 1e-9 && set.spent_usd > 0.7, "{set:?}");
    let scenes = desk.scenes().await;
    assert!(scenes.values().all(|row| row.attempts == 0 && row.state != "failed"), "{scenes:?}");
    desk.queue.set_budget(desk.row.id, Some(50.0), None).await.unwrap();
    work(&desk.queue, desk.options(), &WorkerStop::default()).await.unwrap();
    assert_eq!(desk.queue.counts(desk.row.id).await.unwrap().done, 4);
    assert_eq!(desk.paid().len(), 40);
    let set = desk.queue.set(desk.set.name()).await.unwrap();
    assert!((set.spent_usd - 1.6).abs() < 1e-6, "{set:?}");
}

#[tokio::test]
async fn nobody_is_asked_while_nobody_counts() {
    let desk = Desk::new(&[("a", "one"), ("b", "two")], 1000.0, |_| {}).await;
    let [east, _] = two(&desk).await;
    let east = Arc::new(east);
    desk.queue.close().await;
    assert!(matches!(east.take(&ask(0, 0.0)).await, SharedTurn::Wait(_)));
}
