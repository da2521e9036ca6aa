//! How a call goes: re-entry, replay, the player's gate, checks, asking again, trying again, the offline player as a
//! stand-in, and the record of it all.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use harmony_roles::{PlayerCard, RoleError, Usage};
use harmony_scene::{Warning, WarningKind};
use tokio::time::Instant;

use crate::board::{Doing, Line, until};
use crate::budget::{Reservation, WhenReached};
use crate::calls::{CallEvent, CallEventKind, Calls};
use crate::check::shortened;
use crate::codec::Recordable;
use crate::gate::Gate;
use crate::key::KeyHasher;
use crate::limits::{Limits, Pace};
use crate::record::{CallRecord, CallTiming, RECORD_VERSION, Source, Try, Unanswered, add_usage};
use crate::shared::{SharedAsk, SharedOver, SharedTurn};
use crate::stop::StopReason;
use crate::{CallName, ContentKey, key_for};

/// Longest complaint sent back to a player, characters.
const MAX_COMPLAINT: usize = 3000;

/// Longest account of a failure, characters.
const MAX_REASON: usize = 600;

/// An accepted answer and how it came about.
struct Accepted<A> {
    answer: A,
    by: PlayerCard,
    source: Source,
    warnings: Vec<Warning>,
}

/// The keys of one call, as its record has them.
struct Keys {
    question: ContentKey,
    key: ContentKey,
    work: Option<ContentKey>,
}

/// The course of one call until now.
#[derive(Default)]
struct Course {
    tries: Vec<Try>,
    usage: Usage,
    /// Time that players took.
    time: Duration,
}

/// Whether an answer is taken; the complaint if not.
type Accept<'a, A> = &'a (dyn Fn(&A) -> Result<(), String> + Send + Sync);

/// When a player's answer can be expected.
fn pace<R: Recordable>(player: &R::Player) -> Pace {
    if R::in_own_time(player) { Pace::OwnTime } else { Pace::AtOnce }
}

impl Calls {
    /// One call of any role.
    pub(crate) async fn call<R: Recordable>(
        &self,
        request: &R,
        cast: &Arc<R::Player>,
        offline: &Arc<R::Player>,
        sense: Accept<'_, R::Answer>,
    ) -> Result<R::Answer, RoleError> {
        let name = CallName::new(request.name()).map_err(crate::BookError::from)?;
        let turn = self.turn(R::ROLE, &name);
        let _only_one = turn.lock().await;
        self.stop.check()?;
        let accept = |answer: &R::Answer| request.check(answer).and_then(|()| sense(answer));
        let event = |kind| self.tell::<R>(&name, kind);
        let card = R::card(cast);

        let arrived = self.arrivals.lock().await;
        let question = blocking({
            let request = request.clone();
            move || {
                let mut hasher = KeyHasher::new(R::ROLE);
                request.hash(&mut hasher);
                hasher.finish()
            }
        })
        .await?;
        drop(arrived);
        let recorded = self.book.recorded(R::ROLE, &name, &question)?;
        let key = recorded.as_ref().map_or_else(|| key_for(&question, &card), |recorded| recorded.key.clone());

        let mut warnings = Vec::new();
        if let Some(record) = self.book.record(R::ROLE, &name).filter(|record| self.reusable(record, &key)) {
            let answer = self.read_back(request, &name).await?;
            match answer.and_then(|answer| accept(&answer).map(|()| answer)) {
                Ok(answer) => {
                    self.reused.fetch_add(1, Ordering::Relaxed);
                    event(CallEventKind::Reused);
                    for warning in record.warnings {
                        (self.options.on_warning)(warning);
                    }
                    return Ok(answer);
                }
                Err(reason) => {
                    let reason = format!("the kept answer to {name} cannot be used any more: {reason}");
                    warnings.push(warning(&name, WarningKind::AnswerRepaired, &reason));
                }
            }
        }

        let mut course = Course::default();
        let started = SystemTime::now();
        let mut accepted = None;
        if let Some(recorded) = recorded {
            let folder = recorded.folder.clone();
            let request = request.clone();
            let clock = Instant::now();
            let read = blocking(move || request.read_answer(&folder)).await?;
            course.time = clock.elapsed();
            match read.and_then(|a| accept(&a).map(|()| a)) {
                Ok(answer) => {
                    self.replayed.fetch_add(1, Ordering::Relaxed);
                    tracing::debug!(role = R::ROLE.folder(), call = %name, player = "replay", "asked");
                    event(CallEventKind::Replayed);
                    let label = recorded.card.model.clone();
                    if recorded.question_differs {
                        let text = format!("the recording {label:?} answered {name}, but to a different question");
                        warnings.push(warning(&name, WarningKind::AnswerRepaired, &text));
                    }
                    let source = Source::Recording { label, question_differs: recorded.question_differs };
                    accepted = Some((answer, recorded.card, source));
                }
                Err(reason) => {
                    let text = format!("the recorded answer to {name} cannot be used: {reason}");
                    warnings.push(warning(&name, WarningKind::PlayerReplaced, &text));
                }
            }
        } else if self.book.recording().is_some_and(|recording| recording.covers(R::ROLE)) {
            let missing = RoleError::NotRecorded { name: name.to_string() };
            let text = format!("{missing}; {} was asked", card.player);
            warnings.push(warning(&name, WarningKind::PlayerReplaced, &text));
        }
        // What reaches the player may be less than the question. The lock is held until the record is there, so that of
        // two calls about the same work the second finds it.
        let work = accepted.is_none().then(|| request.work(cast)).flatten().map(|work| key_for(&work, &card));
        let work_turn = work.as_ref().map(|work| self.work_turn(work));
        let _only_one_at_work = match &work_turn {
            Some(turn) => Some(tokio::select! {
                biased;
                stopped = self.no_new() => return Err(stopped),
                turn = turn.lock() => turn,
            }),
            None => None,
        };
        if let Some(work) = &work
            && let Some((answer, by, with)) = self.shared(request, work, &accept).await?
        {
            self.reused.fetch_add(1, Ordering::Relaxed);
            event(CallEventKind::Reused);
            accepted = Some((answer, by, Source::Shared { with }));
        }
        let (answer, by, source) = if let Some(accepted) = accepted {
            accepted
        } else {
            // What an earlier start paid for without an answer belongs to this call's account.
            if let Some(before) = self.book.unanswered(R::ROLE, &name) {
                course.usage = before.usage;
                course.tries = before.tries;
                course.time = Duration::from_millis(before.latency_ms);
            }
            let played = self.play(request, cast, offline, &accept, &name, &mut course, &mut warnings).await;
            if played.is_err() {
                self.keep_unanswered::<R>(&name, &course, started)?;
            }
            played?
        };
        let accepted = Accepted { answer, by, source, warnings };
        let timing = CallTiming { started_unix_ms: unix_millis(started), latency_ms: millis(course.time) };
        self.keep(request, &name, accepted, Keys { question, key, work }, card, course, timing).await
    }

    /// The answer that the same work got under another name, who gave it, and that name; `None` when there is none that
    /// this call accepts.
    async fn shared<R: Recordable>(
        &self,
        request: &R,
        work: &ContentKey,
        accept: Accept<'_, R::Answer>,
    ) -> Result<Option<(R::Answer, PlayerCard, String)>, RoleError> {
        let (book, wanted) = (Arc::clone(&self.book), work.clone());
        let Some(record) = blocking(move || book.with_work(R::ROLE, &wanted)).await?? else { return Ok(None) };
        let with = CallName::new(&record.name).map_err(crate::BookError::from)?;
        let answer = self.read_back(request, &with).await?;
        let taken = answer.and_then(|answer| accept(&answer).map(|()| answer));
        Ok(taken.ok().map(|answer| (answer, record.answered_by, record.name)))
    }

    /// Asks the cast player, again with the complaint where that helps, and then the offline one.
    #[expect(clippy::too_many_arguments, reason = "one call's state, split for reading only")]
    async fn play<R: Recordable>(
        &self,
        request: &R,
        cast: &Arc<R::Player>,
        offline: &Arc<R::Player>,
        accept: Accept<'_, R::Answer>,
        name: &CallName,
        course: &mut Course,
        warnings: &mut Vec<Warning>,
    ) -> Result<(R::Answer, PlayerCard, Source), RoleError> {
        let card = R::card(cast);
        let failure = match self.try_player(request, cast, accept, name, course).await {
            Ok(answer) => return Ok((answer, card, Source::Player)),
            Err(error) => error,
        };
        let stand_in = R::card(offline);
        let same = stand_in.player == card.player && stand_in.model == card.model;
        let goes_on = matches!(failure, RoleError::Budget { .. })
            && self.purse.budget().when_reached == WhenReached::Offline
            && self.stop.reason().is_none();
        if (failure.is_fatal() && !goes_on) || same {
            return Err(failure);
        }
        let todo = failure.hint().filter(|hint| !hint.is_empty()).map_or_else(String::new, |hint| format!(" ({hint})"));
        let reason = shortened(&self.book.redacted(&format!("{failure}{todo}")), MAX_REASON);
        tracing::warn!(call = %name, role = R::ROLE.folder(), "{} stands in: {reason}", stand_in.player);
        self.tell::<R>(name, CallEventKind::Replaced { reason: reason.clone() });
        let answer = self.try_player(request, offline, accept, name, course).await?;
        self.replaced.fetch_add(1, Ordering::Relaxed);
        let text = format!("{reason}; {} ({}) stood in", stand_in.player, stand_in.model);
        warnings.push(warning(name, WarningKind::PlayerReplaced, &text));
        Ok((answer, stand_in, Source::Replaced { reason }))
    }

    /// Asks one player until its answer is accepted or it makes no sense to ask again: what is passing is waited for
    /// and tried again, an answer that is not accepted is asked for again with the complaint.
    async fn try_player<R: Recordable>(
        &self,
        request: &R,
        player: &Arc<R::Player>,
        accept: Accept<'_, R::Answer>,
        name: &CallName,
        course: &mut Course,
    ) -> Result<R::Answer, RoleError> {
        let card = R::card(player);
        // The same question would get the same answer from a player that only computes.
        let reasks = if card.offline { 0 } else { self.options.reasks };
        let gate = self.gate(&card);
        let line = self.board.line(R::ROLE, name.as_str(), &card);
        let mut asked = request.clone();
        let (mut refused, mut unanswered) = (0, 0);
        loop {
            let error = match self.one_try(&asked, player, &card, &gate, &line, accept, name, course).await {
                Ok(answer) => return Ok(answer),
                Err(error) => error,
            };
            // The one place that decides what a failure leads to.
            match &error {
                RoleError::UnusableAnswer { complaint, raw, .. } if refused < reasks => {
                    refused += 1;
                    let (player, complaint_told) = (card.player.clone(), complaint.clone());
                    self.tell::<R>(name, CallEventKind::AskedAgain { player, complaint: complaint_told });
                    asked = request.again(complaint, raw);
                }
                _ if error.is_retryable() && Limits::is_tried_again(R::ROLE, &card, pace::<R>(player)) => {
                    unanswered += 1;
                    let asked_for = error.retry_after();
                    let random = (self.options.random)().clamp(0.0, 1.0);
                    let wait = self.options.limits.retry.wait(unanswered, asked_for, random);
                    let Some(wait) = wait else { return Err(error) };
                    if error.status() == Some(429) || asked_for.is_some() {
                        gate.refused(Instant::now(), wait);
                        if let Some(shared) = &self.options.shared {
                            shared.refused(&card.player, &card.model, wait).await;
                        }
                    }
                    let reason = shortened(&self.book.redacted(&error.to_string()), MAX_REASON);
                    let at = Instant::now() + wait;
                    line.doing(Doing::Backoff(at));
                    self.tell::<R>(name, CallEventKind::Retried { player: card.player.clone(), reason, wait });
                    tokio::select! {
                        biased;
                        stopped = self.no_new() => return Err(stopped),
                        () = tokio::time::sleep_until(at) => {}
                    }
                }
                _ => return Err(error),
            }
        }
    }

    /// Waits for the player's gate and asks once.
    #[expect(clippy::too_many_arguments, reason = "one try's state, split for reading only")]
    async fn one_try<R: Recordable>(
        &self,
        asked: &R,
        player: &Arc<R::Player>,
        card: &PlayerCard,
        gate: &Arc<Gate>,
        line: &Line<'_>,
        accept: Accept<'_, R::Answer>,
        name: &CallName,
        course: &mut Course,
    ) -> Result<R::Answer, RoleError> {
        let event = |kind| self.tell::<R>(name, kind);
        line.doing(Doing::Queued);
        if gate.is_full() {
            event(CallEventKind::Queued { player: card.player.clone() });
        }
        let _place = tokio::select! {
            biased;
            stopped = self.no_new() => return Err(stopped),
            place = gate.place(name.phase()) => place,
        };
        let number = if card.offline { 0 } else { self.admitted::<R>(gate, card, line, name).await? };
        let expected = self.options.prices.expected(R::ROLE, card);
        let shared = if card.offline { None } else { self.shared_turn::<R>(card, expected, line, name).await? };
        let reservation = match self.reserve::<R>(card, expected) {
            Ok(reservation) => reservation,
            Err(error) => {
                self.shared_over(shared, SharedOver { cost_usd: Some(0.0), ..SharedOver::default() }).await;
                return Err(error);
            }
        };
        self.asked.fetch_add(1, Ordering::Relaxed);
        self.asked_outside.fetch_add(usize::from(!card.offline), Ordering::Relaxed);
        tracing::debug!(role = R::ROLE.folder(), call = %name, player = %card.player, "asked");
        event(CallEventKind::Asked { player: card.player.clone() });
        line.doing(Doing::Running);

        let deadline = self.options.limits.try_deadline(R::ROLE, card, pace::<R>(player));
        let clock = Instant::now();
        let (outcome, dropped) = tokio::select! {
            biased;
            outcome = asked.play(player) => (outcome, false),
            error = overdue(card, deadline) => (Err(error), false),
            stopped = self.let_go() => (Err(stopped), true),
        };
        let time = clock.elapsed();
        course.time += time;
        let (usage, outcome) = match outcome {
            Ok(answer) => {
                let mut usage = R::usage(&answer);
                if let Some(closed) = usage.closed_for {
                    // Better to wait now than to be refused next.
                    gate.pause(Instant::now() + closed);
                }
                usage.cost_usd = self.options.prices.cost(R::ROLE, card, usage);
                let taken = accept(&answer).map_err(|complaint| RoleError::UnusableAnswer {
                    player: card.player.clone(),
                    complaint: shortened(&complaint, MAX_COMPLAINT),
                    raw: shortened(&R::raw(&answer), 2000),
                });
                (Some(usage), taken.map(|()| answer))
            }
            Err(error) => (None, Err(error)),
        };
        course.usage = add_usage(course.usage, usage.unwrap_or_default());
        if !card.offline {
            gate.used(number, usage.map_or(0, |u| u.input_tokens.saturating_add(u.output_tokens)));
        }
        let cost = match (&usage, &outcome) {
            (Some(usage), _) => usage.cost_usd,
            // Nothing came, so nothing is paid; after everything else nobody knows, and it counts as paid.
            (None, Err(RoleError::Unavailable { status: Some(_), .. })) => None,
            (None, Err(RoleError::NotSetUp { .. } | RoleError::NotCapable { .. })) => None,
            (None, _) => expected,
        };
        if let Some(reservation) = reservation {
            reservation.settle(cost, time);
        }
        let over = SharedOver {
            tokens: usage.map(|u| u.input_tokens.saturating_add(u.output_tokens)),
            cost_usd: Some(cost.unwrap_or(0.0)),
            closed_for: usage.and_then(|u| u.closed_for),
        };
        self.shared_over(shared, over).await;
        match outcome {
            Ok(answer) => {
                let usage = usage.unwrap_or_default();
                course.tries.push(Try { player: card.player.clone(), complaint: None, usage });
                let cost_usd = usage.cost_usd;
                event(CallEventKind::Answered { player: card.player.clone(), latency: time, cost_usd });
                Ok(answer)
            }
            Err(error) => {
                let text = if dropped {
                    "let go of in flight; it may have been paid".to_owned()
                } else {
                    self.book.redacted(&shortened(&error.to_string(), MAX_COMPLAINT))
                };
                let usage = Usage::default();
                course.tries.push(Try { player: card.player.clone(), complaint: Some(text), usage });
                Err(error)
            }
        }
    }

    /// Waits until the player's rates allow a request.
    async fn admitted<R: Recordable>(
        &self,
        gate: &Gate,
        card: &PlayerCard,
        line: &Line<'_>,
        name: &CallName,
    ) -> Result<u64, RoleError> {
        loop {
            let at = match gate.admit(Instant::now()) {
                Ok(number) => return Ok(number),
                Err(at) => at,
            };
            line.doing(Doing::RateLimited(at));
            self.tell::<R>(name, CallEventKind::RateLimited { player: card.player.clone(), wait: until(at) });
            tokio::select! {
                biased;
                stopped = self.no_new() => return Err(stopped),
                () = tokio::time::sleep_until(at) => {}
            }
        }
    }

    /// Waits until whoever counts for several programs lets the try be made.
    async fn shared_turn<R: Recordable>(
        &self,
        card: &PlayerCard,
        expected_usd: Option<f64>,
        line: &Line<'_>,
        name: &CallName,
    ) -> Result<Option<i64>, RoleError> {
        let Some(shared) = &self.options.shared else { return Ok(None) };
        let ask = SharedAsk {
            role: R::ROLE,
            player: card.player.clone(),
            model: card.model.clone(),
            places: card.concurrency,
            limits: self.options.limits.of(card),
            expected_usd,
        };
        loop {
            self.stop.check()?;
            // Not torn down while it counts: a try that was counted is made, or given back below.
            let wait = match shared.take(&ask).await {
                SharedTurn::Go(number) => return Ok(Some(number)),
                SharedTurn::Budget(reason) => return Err(self.reached(reason)),
                SharedTurn::Stop(reason) => {
                    let reason = StopReason::Interrupted(reason);
                    let error = reason.error();
                    self.stop.close(reason);
                    return Err(error);
                }
                SharedTurn::Wait(wait) => wait,
            };
            let at = Instant::now() + wait;
            line.doing(Doing::RateLimited(at));
            self.tell::<R>(name, CallEventKind::RateLimited { player: card.player.clone(), wait });
            tokio::select! {
                biased;
                stopped = self.no_new() => return Err(stopped),
                () = tokio::time::sleep_until(at) => {}
            }
        }
    }

    /// Tells whoever counts for several programs that a try is over.
    async fn shared_over(&self, number: Option<i64>, over: SharedOver) {
        if let (Some(shared), Some(number)) = (&self.options.shared, number) {
            shared.settle(number, over).await;
        }
    }

    /// Counts a try of somebody outside; when a budget is reached, the run stops or this program goes on alone.
    fn reserve<R: Recordable>(
        &self,
        card: &PlayerCard,
        expected: Option<f64>,
    ) -> Result<Option<Reservation>, RoleError> {
        self.stop.check()?;
        if card.offline {
            return Ok(None);
        }
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            return Err(self.reached(self.minutes_reason()));
        }
        self.purse.take(R::ROLE, expected).map(Some).map_err(|reason| self.reached(reason))
    }

    /// A budget is reached.
    fn reached(&self, reason: String) -> RoleError {
        if self.purse.budget().when_reached == WhenReached::Stop {
            self.stop.close(StopReason::Budget(reason.clone()));
        }
        RoleError::Budget { reason }
    }

    fn minutes_reason(&self) -> String {
        format!("the run's {} minutes are over", self.purse.budget().minutes.unwrap_or_default())
    }

    /// Resolves when nobody new may be asked.
    async fn no_new(&self) -> RoleError {
        let at_deadline = async {
            match self.deadline {
                Some(deadline) if self.purse.budget().when_reached == WhenReached::Stop => {
                    tokio::time::sleep_until(deadline).await;
                    self.reached(self.minutes_reason())
                }
                _ => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            stopped = self.stop.closed() => stopped,
            reached = at_deadline => reached,
        }
    }

    /// Resolves when even what is in flight is let go of: at once when somebody insists, else after the grace.
    async fn let_go(&self) -> RoleError {
        let after_grace = async {
            let stopped = self.no_new().await;
            tokio::time::sleep(self.purse.budget().grace()).await;
            stopped
        };
        tokio::select! {
            biased;
            dropped = self.stop.dropped() => dropped,
            stopped = after_grace => stopped,
        }
    }

    /// Writes the record and returns the answer as it is read back from it, so that a run that is re-entered sees
    /// exactly what the first one saw.
    #[expect(clippy::too_many_arguments, reason = "one record's parts")]
    async fn keep<R: Recordable>(
        &self,
        request: &R,
        name: &CallName,
        accepted: Accepted<R::Answer>,
        keys: Keys,
        cast: PlayerCard,
        course: Course,
        timing: CallTiming,
    ) -> Result<R::Answer, RoleError> {
        let warnings: Vec<Warning> =
            accepted.warnings.into_iter().map(|w| Warning { message: self.book.redacted(&w.message), ..w }).collect();
        let record = CallRecord {
            version: RECORD_VERSION,
            name: name.to_string(),
            role: R::ROLE,
            key: keys.key,
            question: keys.question,
            work: keys.work,
            cast,
            answered_by: accepted.by,
            source: accepted.source,
            tries: course.tries,
            usage: course.usage,
            warnings: warnings.clone(),
        };
        let book = Arc::clone(&self.book);
        let request = request.clone();
        let answer = accepted.answer;
        let own = name.clone();
        let kept = blocking(move || {
            let offline = record.answered_by.offline;
            let folder = book.store(&record, timing, |out| {
                request.write_request(out, offline)?;
                request.write_answer(&answer, out)
            })?;
            book.forget_unanswered(R::ROLE, &own);
            let path = folder.join("answer.json");
            request.read_answer(&folder).map_err(|reason| crate::BookError::Write { reason, path })
        })
        .await??;
        for warning in warnings {
            (self.options.on_warning)(warning);
        }
        Ok(kept)
    }

    /// Keeps the account of a call that ends without an answer: what was paid for it is not forgotten.
    fn keep_unanswered<R: Recordable>(
        &self,
        name: &CallName,
        course: &Course,
        started: SystemTime,
    ) -> Result<(), RoleError> {
        if course.tries.is_empty() {
            return Ok(());
        }
        let account = Unanswered {
            name: name.to_string(),
            role: R::ROLE,
            tries: course.tries.clone(),
            usage: course.usage,
            started_unix_ms: unix_millis(started),
            latency_ms: millis(course.time),
        };
        Ok(self.book.keep_unanswered(&account)?)
    }

    fn tell<R: Recordable>(&self, name: &CallName, kind: CallEventKind) {
        (self.options.on_event)(CallEvent { role: R::ROLE, name: name.to_string(), kind });
    }

    fn reusable(&self, record: &CallRecord, key: &ContentKey) -> bool {
        let replaced = matches!(record.source, Source::Replaced { .. });
        record.key == *key && !(replaced && self.book.options().retry_replaced)
    }

    async fn read_back<R: Recordable>(
        &self,
        request: &R,
        name: &CallName,
    ) -> Result<Result<R::Answer, String>, RoleError> {
        let folder = self.book.record_folder(R::ROLE, name);
        let request = request.clone();
        blocking(move || request.read_answer(&folder)).await
    }
}

/// Resolves when a try has taken too long; never when it has no deadline.
async fn overdue(card: &PlayerCard, seconds: Option<f64>) -> RoleError {
    let Some(seconds) = seconds else { return std::future::pending().await };
    tokio::time::sleep(Duration::from_secs_f64(seconds)).await;
    RoleError::Unavailable {
        player: card.player.clone(),
        reason: format!("no answer within {seconds} s"),
        status: None,
        retry_after: None,
    }
}

/// Runs what hashes, encodes or waits for the disk beside the asynchronous work.
async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, RoleError> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| RoleError::Io { player: "the call book".to_owned(), source: std::io::Error::other(error) })
}

fn warning(name: &CallName, kind: WarningKind, message: &str) -> Warning {
    let message = shortened(message, 1200);
    Warning { phase: name.phase().to_owned(), object: name.object(), kind, message }
}

fn millis(duration: Duration) -> u64 {
    u64::try_from(duration.as_millis()).unwrap_or(u64::MAX)
}

fn unix_millis(time: SystemTime) -> u64 {
    millis(time.duration_since(UNIX_EPOCH).unwrap_or_default())
}
