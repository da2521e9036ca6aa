//! What happens on the way to a player: places, retries, deadlines, budgets, a clean stop. Tokio's clock is stopped
//! (`start_paused`), so that waits take no time and can be read off to the second.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::common::{Desk, Everyone, Say, Scripted, cast, sane, width_question};
use async_trait::async_trait;
use harmony_calls::{
    Bill, BookOptions, Budget, CallEvent, CallEventKind, CallOptions, Cast, Limits, PlayerLimits, Price, Prices,
    RetryPolicy, Source, StopReason, WhenReached,
};
use harmony_roles::{PlayerCard, Role, RoleError, Usage, VisionLanguage, VlmAnswer, VlmRequest};
use harmony_scene::WarningKind;
use serde_json::json;
use tokio::time::Instant;

/// Answers after a while, and remembers how many were at it together.
struct Slow {
    takes: Duration,
    places: usize,
    running: AtomicUsize,
    most: AtomicUsize,
    /// What it says of its rate with every answer.
    closed_for: Option<Duration>,
    asked: Mutex<Vec<(String, Instant)>>,
}

impl Slow {
    fn new(seconds: u64, places: usize) -> Arc<Self> {
        Arc::new(Self {
            takes: Duration::from_secs(seconds),
            places,
            running: AtomicUsize::new(0),
            most: AtomicUsize::new(0),
            closed_for: None,
            asked: Mutex::default(),
        })
    }

    fn cast(self: &Arc<Self>) -> Cast {
        let nobody = Scripted::saying("nobody", false, &[]);
        Cast { vision_language: self.clone(), ..cast(&nobody, &Everyone::new("others", true, false)) }
    }
}

#[async_trait]
impl VisionLanguage for Slow {
    fn card(&self) -> PlayerCard {
        PlayerCard { player: "slow".into(), model: "m 1".into(), offline: false, concurrency: self.places }
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        self.asked.lock().unwrap().push((request.name.clone(), Instant::now()));
        let now = self.running.fetch_add(1, Ordering::SeqCst) + 1;
        self.most.fetch_max(now, Ordering::SeqCst);
        tokio::time::sleep(self.takes).await;
        self.running.fetch_sub(1, Ordering::SeqCst);
        let value = json!({"width_m": 4});
        let usage = Usage { input_tokens: 500, output_tokens: 500, closed_for: self.closed_for, ..Usage::default() };
        Ok(VlmAnswer { raw: value.to_string(), value, usage })
    }
}

fn offline_cast() -> Cast {
    let offline = Scripted::saying("offline", true, &vec![json!({"width_m": 3.5}); 50]);
    cast(&offline, &Everyone::new("others", true, false))
}

fn desk(run: &std::path::Path, cast: Cast, how: CallOptions) -> Desk {
    Desk::limited(run, BookOptions::default(), cast, offline_cast(), how)
}

fn overloaded() -> RoleError {
    RoleError::Unavailable { player: "model".into(), reason: "overloaded".into(), status: Some(503), retry_after: None }
}

fn too_many() -> RoleError {
    let retry_after = Some(Duration::from_secs(20));
    RoleError::Unavailable {
        player: "model".into(),
        reason: "too many requests".into(),
        status: Some(429),
        retry_after,
    }
}

/// Better to wait than to be refused: nobody is asked before the time that came with an answer is over.
#[tokio::test(start_paused = true)]
async fn a_player_that_says_with_its_answer_that_its_rate_is_used_up_is_left_alone_until_the_reset() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(1, 1);
    let slow = Arc::new(Slow { closed_for: Some(Duration::from_secs(30)), ..Arc::into_inner(slow).unwrap() });
    let desk = desk(run.path(), slow.cast(), CallOptions::default());
    for i in 0..3 {
        desk.calls.ask(&width_question(&format!("1_layout/q_{i}")), sane).await.unwrap();
    }
    let times: Vec<Instant> = slow.asked.lock().unwrap().iter().map(|(_, at)| *at).collect();
    let gaps: Vec<u64> = times.windows(2).map(|w| w[1].duration_since(w[0]).as_secs()).collect();
    assert_eq!(gaps, [31, 31], "one second of work and the pause");
}

#[tokio::test(start_paused = true)]
async fn what_is_passing_is_tried_again_with_growing_waits_and_answered_once() {
    let run = tempfile::tempdir().unwrap();
    let lines =
        vec![Say::Fail(overloaded), Say::Fail(overloaded), Say::Fail(overloaded), Say::Value(json!({"width_m": 4}))];
    let vlm = Scripted::new("model", false, lines);
    let waits: Arc<Mutex<Vec<u64>>> = Arc::default();
    let heard = waits.clone();
    let how = CallOptions {
        on_event: Arc::new(move |event: CallEvent| {
            if let CallEventKind::Retried { wait, .. } = event.kind {
                heard.lock().unwrap().push(wait.as_secs());
            }
        }),
        ..CallOptions::default()
    };
    let desk = desk(run.path(), cast(&vlm, &Everyone::new("others", true, false)), how);
    let begun = Instant::now();
    let answer = desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    assert_eq!(answer.value["width_m"], 4);
    assert_eq!(*waits.lock().unwrap(), [1, 2, 4]);
    assert_eq!(begun.elapsed().as_secs(), 7);
    assert_eq!(vlm.asked(), 4);
    assert!(desk.warnings().is_empty());
    let log = desk.calls.book().log().unwrap();
    assert_eq!((log[0].tries, &log[0].source), (4, &Source::Player));
    assert_eq!(log[0].usage.cost_usd, Some(0.5), "three tries that were not answered cost nothing");
    desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    assert_eq!(vlm.asked(), 4, "an answered call is never made again");
}

#[tokio::test(start_paused = true)]
async fn retry_after_is_kept_for_all_calls_of_the_player() {
    let run = tempfile::tempdir().unwrap();
    let lines = vec![Say::Fail(too_many), Say::Value(json!({"width_m": 4})), Say::Value(json!({"width_m": 5}))];
    let vlm = Scripted::new("model", false, lines);
    let desk = desk(run.path(), cast(&vlm, &Everyone::new("others", true, false)), CallOptions::default());
    let begun = Instant::now();
    let (one, two) = (width_question("1_layout/one"), width_question("1_layout/two"));
    let first = desk.calls.ask(&one, sane);
    let second = async {
        tokio::time::sleep(Duration::from_secs(3)).await;
        desk.calls.ask(&two, sane).await
    };
    let (first, second) = tokio::join!(first, second);
    first.unwrap();
    second.unwrap();
    assert_eq!(begun.elapsed().as_secs(), 21, "20 s as asked for and up to 1 s of jitter");
    assert_eq!(vlm.asked(), 3, "the second call did not run into the closed door");
}

#[tokio::test(start_paused = true)]
async fn a_player_that_stays_away_is_given_up_and_replaced_with_a_warning() {
    let run = tempfile::tempdir().unwrap();
    let vlm = Scripted::new("model", false, (0..10).map(|_| Say::Fail(overloaded)).collect());
    let limits = Limits { retry: RetryPolicy { retries: 2, ..RetryPolicy::default() }, ..Limits::default() };
    let how = CallOptions { limits, ..CallOptions::default() };
    let desk = desk(run.path(), cast(&vlm, &Everyone::new("others", true, false)), how);
    let answer = desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    assert_eq!(answer.value["width_m"], 3.5);
    assert_eq!(vlm.asked(), 3);
    assert_eq!(desk.warnings()[0].kind, WarningKind::PlayerReplaced);
}

#[tokio::test(start_paused = true)]
async fn a_try_that_hangs_ends_at_its_deadline() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(100_000, 0);
    let mut limits = Limits { retry: RetryPolicy { retries: 1, ..RetryPolicy::default() }, ..Limits::default() };
    limits.try_seconds.insert(Role::VisionLanguage, 30.0);
    let desk = desk(run.path(), slow.cast(), CallOptions { limits, ..CallOptions::default() });
    let begun = Instant::now();
    let answer = desk.calls.ask(&width_question("1_layout/layout"), sane).await.unwrap();
    assert_eq!(answer.value["width_m"], 3.5);
    assert_eq!(begun.elapsed().as_secs(), 61, "two tries of 30 s and a wait of 1 s");
    assert!(desk.warnings()[0].message.contains("no answer within 30 s"), "{:?}", desk.warnings());
}

#[tokio::test(start_paused = true)]
async fn so_many_calls_at_a_time_and_requests_a_minute() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(10, 3);
    let desk = desk(run.path(), slow.cast(), CallOptions::default());
    let begun = Instant::now();
    let questions: Vec<_> = (0..10).map(|i| width_question(&format!("1_layout/q_{i}"))).collect();
    let mut tasks = Vec::new();
    for question in questions.clone() {
        let calls = desk.calls.clone();
        tasks.push(tokio::spawn(async move { calls.ask(&question, sane).await.unwrap() }));
    }
    for task in tasks {
        task.await.unwrap();
    }
    assert_eq!(slow.most.load(Ordering::SeqCst), 3);
    assert_eq!(begun.elapsed().as_secs(), 40, "ten calls of 10 s, three at a time");

    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(1, 0);
    let player = PlayerLimits { requests_per_minute: Some(4.0), ..PlayerLimits::default() };
    let limits = Limits { players: [("slow".to_owned(), player)].into(), ..Limits::default() };
    let desk = Desk::limited(
        run.path(),
        BookOptions::default(),
        slow.cast(),
        offline_cast(),
        CallOptions { limits, ..CallOptions::default() },
    );
    let begun = Instant::now();
    let mut tasks = Vec::new();
    for question in questions {
        let calls = desk.calls.clone();
        tasks.push(tokio::spawn(async move { calls.ask(&question, sane).await.unwrap() }));
    }
    for task in tasks {
        task.await.unwrap();
    }
    assert_eq!(begun.elapsed().as_secs(), 121, "four, four and two");
}

fn priced(usd_a_call: f64) -> Prices {
    let price = Price { call: usd_a_call, ..Price::default() };
    Prices { date: "2026-11-01".into(), models: [("m 1".to_owned(), price)].into() }
}

#[tokio::test(start_paused = true)]
async fn a_budget_stops_the_run_and_the_next_start_goes_on_where_it_is_raised() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(5, 0);
    let how = |usd| CallOptions {
        budget: Budget { usd: Some(usd), ..Budget::default() },
        prices: priced(1.0),
        ..CallOptions::default()
    };
    let first = desk(run.path(), slow.cast(), how(2.5));
    let ask = |desk: &Desk, i: usize| {
        let (calls, question) = (desk.calls.clone(), width_question(&format!("1_layout/q_{i}")));
        async move { calls.ask(&question, sane).await }
    };
    let (a, b, c) = tokio::join!(ask(&first, 0), ask(&first, 1), ask(&first, 2));
    // Which of the three come first is not said.
    let answers = [a, b, c];
    let missing = answers.iter().position(Result::is_err).expect("three are beyond the budget");
    assert_eq!(answers.iter().filter(|a| a.is_ok()).count(), 2, "two are in it, and what is in flight is awaited");
    let error = answers[missing].as_ref().unwrap_err();
    assert!(matches!(error, RoleError::Budget { reason } if reason.contains("2.50 US$")), "{error}");
    assert!(ask(&first, 3).await.is_err(), "nobody new is asked");
    assert_eq!(slow.asked.lock().unwrap().len(), 2);
    let bill = Bill::of(&first.calls.book().log().unwrap());
    assert_eq!(bill.total.usage.cost_usd, Some(2.0));

    let same = desk(run.path(), slow.cast(), how(2.5));
    assert!(ask(&same, (missing + 1) % 3).await.is_ok(), "what is recorded costs nothing");
    assert!(ask(&same, missing).await.is_err(), "what was spent before counts");
    let raised = desk(run.path(), slow.cast(), how(10.0));
    let (a, b, c) = tokio::join!(ask(&raised, 0), ask(&raised, 1), ask(&raised, 2));
    assert!(a.is_ok() && b.is_ok() && c.is_ok());
    assert_eq!(slow.asked.lock().unwrap().len(), 3, "only the missing one is asked");
}

#[tokio::test(start_paused = true)]
async fn with_offline_when_reached_this_program_goes_on_alone_and_says_so() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(5, 0);
    let budget = Budget { calls: Some(1), when_reached: WhenReached::Offline, ..Budget::default() };
    let desk = desk(run.path(), slow.cast(), CallOptions { budget, ..CallOptions::default() });
    assert_eq!(desk.calls.ask(&width_question("1_layout/a"), sane).await.unwrap().value["width_m"], 4);
    assert_eq!(desk.calls.ask(&width_question("1_layout/b"), sane).await.unwrap().value["width_m"], 3.5);
    assert!(desk.warnings()[0].message.contains("all 1 calls"), "{:?}", desk.warnings());
    assert_eq!(desk.calls.stop().reason(), None);
}

#[tokio::test(start_paused = true)]
async fn at_the_runs_deadline_nobody_new_is_asked_and_what_is_in_flight_is_recorded() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(50, 1);
    let budget = Budget { minutes: Some(1.0), ..Budget::default() };
    let desk = desk(run.path(), slow.cast(), CallOptions { budget, ..CallOptions::default() });
    let begun = Instant::now();
    let questions: Vec<_> = (0..3).map(|i| width_question(&format!("1_layout/q_{i}"))).collect();
    let [a, b, c] = &questions[..] else { panic!() };
    let (a, b, c) = tokio::join!(desk.calls.ask(a, sane), desk.calls.ask(b, sane), desk.calls.ask(c, sane));
    let answers = [a, b, c];
    assert_eq!(answers.iter().filter(|a| a.is_ok()).count(), 2, "the second was begun before the deadline");
    assert!(matches!(answers.iter().find_map(|a| a.as_ref().err()), Some(RoleError::Budget { .. })));
    assert_eq!(begun.elapsed().as_secs(), 100);
    assert_eq!(desk.calls.book().log().unwrap().len(), 2);
}

#[tokio::test(start_paused = true)]
async fn an_interrupt_awaits_what_is_in_flight_and_a_second_one_lets_go_of_it_on_the_account() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(50, 2);
    let how = || CallOptions { prices: priced(1.0), ..CallOptions::default() };
    let first = desk(run.path(), slow.cast(), how());
    let stop = first.calls.stop().clone();
    let question = |i: usize| width_question(&format!("1_layout/q_{i}"));
    let (one, three) = (question(1), question(3));
    let interrupt = async {
        tokio::time::sleep(Duration::from_secs(10)).await;
        stop.close(StopReason::Interrupted("interrupted".into()));
    };
    let late = async {
        tokio::time::sleep(Duration::from_secs(11)).await;
        first.calls.ask(&three, sane).await
    };
    let (answered, (), late) = tokio::join!(first.calls.ask(&one, sane), interrupt, late);
    assert!(answered.is_ok(), "in flight, so awaited");
    assert!(matches!(late.unwrap_err(), RoleError::Interrupted { .. }));

    let second = desk(run.path(), slow.cast(), how());
    let stop = second.calls.stop().clone();
    let two = question(2);
    let insist = async {
        tokio::time::sleep(Duration::from_secs(10)).await;
        stop.now(StopReason::Interrupted("interrupted".into()));
    };
    let begun = Instant::now();
    let (dropped, ()) = tokio::join!(second.calls.ask(&two, sane), insist);
    assert!(matches!(dropped.unwrap_err(), RoleError::Interrupted { .. }));
    assert_eq!(begun.elapsed().as_secs(), 10);
    let log = second.calls.book().log().unwrap();
    let account: Vec<_> = log.iter().map(|c| (c.name.as_str(), c.tries, c.source == Source::Unanswered)).collect();
    assert_eq!(account, [("1_layout/q_1", 1, false), ("1_layout/q_2", 1, true)]);

    let third = desk(run.path(), slow.cast(), how());
    third.calls.ask(&two, sane).await.unwrap();
    let log = third.calls.book().log().unwrap();
    assert_eq!((log.len(), log[1].tries), (2, 2), "the try that was let go of stays on the call's account");
    assert!(!run.path().join("calls/.unanswered/vision_language/1_layout.q_2.json").exists());
}

#[tokio::test(start_paused = true)]
async fn one_who_never_comes_back_is_let_go_of_after_the_grace() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(100_000, 0);
    let budget = Budget { grace_seconds: Some(20.0), ..Budget::default() };
    let desk = desk(run.path(), slow.cast(), CallOptions { budget, ..CallOptions::default() });
    let stop = desk.calls.stop().clone();
    let question = width_question("1_layout/q");
    let interrupt = async {
        tokio::time::sleep(Duration::from_secs(10)).await;
        stop.close(StopReason::Interrupted("interrupted".into()));
    };
    let begun = Instant::now();
    let (dropped, ()) = tokio::join!(desk.calls.ask(&question, sane), interrupt);
    assert!(dropped.is_err());
    assert_eq!(begun.elapsed().as_secs(), 30);
}

#[tokio::test(start_paused = true)]
async fn the_bill_knows_phases_roles_players_and_objects() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(2, 0);
    let desk = desk(run.path(), slow.cast(), CallOptions { prices: priced(0.25), ..CallOptions::default() });
    for name in ["1_layout/layout", "3_furniture/chair_02/front", "3_furniture/chair_02/completed", "3_furniture/list"]
    {
        desk.calls.ask(&width_question(name), sane).await.unwrap();
    }
    let bill = Bill::of(&desk.calls.book().log().unwrap());
    assert_eq!(bill.by_object["chair_02"].usage.cost_usd, Some(0.5));
    assert_eq!(bill.by_object["(shared)"].calls, 2);
    assert_eq!(bill.by_phase["3_furniture"].calls, 3);
    assert_eq!(bill.by_player["slow / m 1"].latency_ms, 8000);
    assert_eq!(bill.total.usage.cost_usd, Some(1.0));
    assert!(!bill.without_times().to_string().contains("latency"));
    let now = desk.calls.now();
    assert!(now.underway.is_empty());
    assert_eq!((now.spent.usd, now.spent.calls), (1.0, 4));
}

#[tokio::test]
async fn questions_come_to_a_player_in_the_order_in_which_they_were_begun() {
    let run = tempfile::tempdir().unwrap();
    let slow = Slow::new(0, 0);
    let desk = desk(run.path(), slow.cast(), CallOptions::default());
    // The earlier a question, the more there is of it to read before it can be asked.
    let questions: Vec<VlmRequest> = (0..4_u32)
        .map(|i| {
            let mut question = width_question(&format!("2_wall/inspect_{i}"));
            let side = 1 + 900 * (3 - i);
            question.pictures[0].image = Arc::new(image::RgbImage::new(side, side));
            question
        })
        .collect();
    let ask = |i: usize| desk.calls.ask(&questions[i], sane);
    let (a, b, c, d) = tokio::join!(ask(0), ask(1), ask(2), ask(3));
    assert!([a, b, c, d].iter().all(Result::is_ok));
    let asked: Vec<String> = slow.asked.lock().unwrap().iter().map(|(name, _)| name.clone()).collect();
    assert_eq!(asked, questions.iter().map(|question| question.name.clone()).collect::<Vec<_>>());
}
