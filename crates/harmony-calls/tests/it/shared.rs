//! Somebody counts for several programs: asked before each try, told after it.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use harmony_calls::{
    BookOptions, Budget, CallOptions, Price, Prices, SharedAsk, SharedLimits, SharedOver, SharedTurn, StopReason,
};
use harmony_roles::RoleError;
use serde_json::json;
use tokio::time::Instant;

use crate::common::{Desk, Everyone, Say, Scripted, cast, sane, width_question};

/// Answers in order, then always yes.
#[derive(Default)]
struct Counter {
    turns: Mutex<VecDeque<SharedTurn>>,
    asked: Mutex<Vec<SharedAsk>>,
    settled: Mutex<Vec<(i64, SharedOver)>>,
    refused: Mutex<Vec<(String, String, Duration)>>,
}

#[async_trait]
impl SharedLimits for Counter {
    async fn take(&self, ask: &SharedAsk) -> SharedTurn {
        self.asked.lock().unwrap().push(ask.clone());
        self.turns.lock().unwrap().pop_front().unwrap_or(SharedTurn::Go(7))
    }

    async fn settle(&self, number: i64, over: SharedOver) {
        self.settled.lock().unwrap().push((number, over));
    }

    async fn refused(&self, player: &str, model: &str, wait: Duration) {
        self.refused.lock().unwrap().push((player.to_owned(), model.to_owned(), wait));
    }
}

fn desk(run: &std::path::Path, lines: Vec<Say>, counter: &Arc<Counter>, budget: Budget) -> (Desk, Arc<Scripted>) {
    let vlm = Scripted::new("language", false, lines);
    let others = Everyone::new("others", true, false);
    let offline = Scripted::saying("offline", true, &[json!({"width_m": 3.0})]);
    let price = Price { call: 0.25, ..Price::default() };
    let how = CallOptions {
        shared: Some(counter.clone()),
        prices: Prices { models: [("test 1".to_owned(), price)].into(), ..Prices::default() },
        budget,
        ..CallOptions::default()
    };
    (Desk::limited(run, BookOptions::default(), cast(&vlm, &others), cast(&offline, &others), how), vlm)
}

fn said() -> Say {
    Say::Value(json!({"width_m": 4.0}))
}

#[tokio::test(start_paused = true)]
async fn a_try_waits_for_its_turn_and_is_told_when_it_is_over() {
    let run = tempfile::tempdir().unwrap();
    let counter = Arc::new(Counter::default());
    counter.turns.lock().unwrap().extend([
        SharedTurn::Wait(Duration::from_secs(20)),
        SharedTurn::Wait(Duration::from_secs(3)),
        SharedTurn::Go(41),
    ]);
    let busy = || RoleError::Unavailable {
        player: "language".into(),
        reason: "too many".into(),
        status: Some(429),
        retry_after: Some(Duration::from_secs(5)),
    };
    let (desk, vlm) = desk(run.path(), vec![Say::Fail(busy), said()], &counter, Budget::default());
    let begun = Instant::now();
    desk.calls.ask(&width_question("1_layout/q"), sane).await.unwrap();
    assert!(begun.elapsed() >= Duration::from_secs(28), "23 s for the turn, 5 s as the player asked");
    assert_eq!(vlm.asked(), 2);
    let asked = counter.asked.lock().unwrap().clone();
    assert_eq!(asked.len(), 4, "thrice for the first try, once for the second");
    assert_eq!(
        (asked[0].player.as_str(), asked[0].model.as_str(), asked[0].expected_usd),
        ("language", "test 1", Some(0.25))
    );
    let settled = counter.settled.lock().unwrap().clone();
    assert_eq!(settled.iter().map(|(n, _)| *n).collect::<Vec<_>>(), [41, 7]);
    assert_eq!(settled[0].1, SharedOver { cost_usd: Some(0.0), ..SharedOver::default() }, "a 429 costs nothing");
    // What the player says its answer cost counts more than the table.
    assert_eq!((settled[1].1.tokens, settled[1].1.cost_usd), (Some(110), Some(0.5)));
    assert_eq!(counter.refused.lock().unwrap().len(), 1);
    // A record needs no turn.
    desk.calls.ask(&width_question("1_layout/q"), sane).await.unwrap();
    assert_eq!(counter.asked.lock().unwrap().len(), 4);
}

#[tokio::test(start_paused = true)]
async fn a_shared_budget_or_the_loss_of_the_job_stops_the_run_before_anybody_is_asked() {
    for (turn, budget) in
        [(SharedTurn::Budget("all is spent".into()), true), (SharedTurn::Stop("taken over".into()), false)]
    {
        let run = tempfile::tempdir().unwrap();
        let counter = Arc::new(Counter::default());
        counter.turns.lock().unwrap().push_back(turn);
        let (desk, vlm) = desk(run.path(), vec![said()], &counter, Budget::default());
        let error = desk.calls.ask(&width_question("1_layout/q"), sane).await.unwrap_err();
        assert_eq!(matches!(error, RoleError::Budget { .. }), budget, "{error}");
        assert_eq!(matches!(desk.calls.stop().reason(), Some(StopReason::Budget(_))), budget);
        assert!(desk.calls.stop().reason().is_some());
        assert_eq!((vlm.asked(), counter.settled.lock().unwrap().len()), (0, 0));
    }
}

#[tokio::test(start_paused = true)]
async fn a_turn_that_the_runs_own_budget_refuses_is_given_back() {
    let run = tempfile::tempdir().unwrap();
    let counter = Arc::new(Counter::default());
    let (desk, vlm) = desk(run.path(), vec![said()], &counter, Budget { calls: Some(0), ..Budget::default() });
    desk.calls.ask(&width_question("1_layout/q"), sane).await.unwrap_err();
    assert_eq!(vlm.asked(), 0);
    let free = SharedOver { cost_usd: Some(0.0), ..SharedOver::default() };
    assert_eq!(*counter.settled.lock().unwrap(), [(7, free)]);
}
