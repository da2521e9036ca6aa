//! Asking: re-entry, replay, checks, asking again, the offline player as a stand-in, and the record of it all.

use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use harmony_roles::{
    DetectRequest, Detections, EditRequest, EditedImage, GeneratedMesh, GeometryAnswer, GeometryRequest, LitImage,
    LitRequest, MeshRequest, PlayerCard, Role, RoleError, SegmentRequest, SegmentedMask, Usage, VlmAnswer, VlmRequest,
};
use harmony_scene::{Warning, WarningKind};
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::sync::{Semaphore, SemaphorePermit};

use crate::check::shortened;
use crate::codec::Recordable;
use crate::key::KeyHasher;
use crate::record::{CallRecord, CallTiming, RECORD_VERSION, Source, Try, add_usage};
use crate::{CallBook, CallName, Cast, ContentKey, key_for};

/// Longest complaint sent back to a player, characters.
const MAX_COMPLAINT: usize = 3000;

/// What happens to a call, for progress display.
#[derive(Debug, Clone, PartialEq)]
pub struct CallEvent {
    /// Role.
    pub role: Role,
    /// Call name.
    pub name: String,
    /// What happened.
    pub kind: CallEventKind,
}

/// See [`CallEvent`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum CallEventKind {
    /// A player is asked.
    Asked {
        /// Who.
        player: String,
    },
    /// Its answer was not accepted and it is asked again.
    AskedAgain {
        /// Who.
        player: String,
        /// What was wrong.
        complaint: String,
    },
    /// It answered.
    Answered {
        /// Who.
        player: String,
        /// After this time.
        latency: Duration,
    },
    /// The record of an earlier run answered: no call.
    Reused,
    /// The recording answered: no call.
    Replayed,
    /// The offline player stands in.
    Replaced {
        /// Why.
        reason: String,
    },
}

/// How often what happened since the program was started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CallCounts {
    /// Times that a player was asked, offline ones and second tries included.
    pub asked: usize,
    /// Of these, players other than this program alone.
    pub asked_outside: usize,
    /// Calls answered by their record.
    pub reused: usize,
    /// Calls answered by the recording.
    pub replayed: usize,
    /// Calls answered by the offline player in place of another.
    pub replaced: usize,
}

/// How calls are made.
pub struct CallOptions {
    /// How often an answer that is not accepted is asked for again.
    pub reasks: usize,
    /// Told of everything that went another way; the same again when a record is used again.
    pub on_warning: Arc<dyn Fn(Warning) + Send + Sync>,
    /// Told of progress.
    pub on_event: Arc<dyn Fn(CallEvent) + Send + Sync>,
}

impl Default for CallOptions {
    fn default() -> Self {
        Self { reasks: 2, on_warning: Arc::new(|_| {}), on_event: Arc::new(|_| {}) }
    }
}

/// A cast whose every call is checked and recorded.
pub struct Calls {
    book: Arc<CallBook>,
    cast: Cast,
    offline: Cast,
    options: CallOptions,
    /// Free places by player and model.
    places: Mutex<HashMap<String, Arc<Semaphore>>>,
    /// One call under a name at a time.
    names: Mutex<HashMap<(Role, CallName), Turn>>,
    asked: AtomicUsize,
    asked_outside: AtomicUsize,
    reused: AtomicUsize,
    replayed: AtomicUsize,
    replaced: AtomicUsize,
}

/// Whose turn it is to make the call of a name.
type Turn = Arc<tokio::sync::Mutex<()>>;

/// An accepted answer and how it came about.
struct Accepted<A> {
    answer: A,
    by: PlayerCard,
    source: Source,
    warnings: Vec<Warning>,
}

/// The course of one call until now.
#[derive(Default)]
struct Course {
    tries: Vec<Try>,
    usage: Usage,
}

impl Calls {
    /// Makes calls of `cast` into `book`; `offline` stands in for players that fail.
    pub fn new(book: Arc<CallBook>, cast: Cast, offline: Cast, options: CallOptions) -> Self {
        Self {
            book,
            cast,
            offline,
            options,
            places: Mutex::default(),
            names: Mutex::default(),
            asked: AtomicUsize::new(0),
            asked_outside: AtomicUsize::new(0),
            reused: AtomicUsize::new(0),
            replayed: AtomicUsize::new(0),
            replaced: AtomicUsize::new(0),
        }
    }

    /// The book.
    pub fn book(&self) -> &CallBook {
        &self.book
    }

    /// Who plays.
    pub fn cast(&self) -> &Cast {
        &self.cast
    }

    /// What happened since the start.
    pub fn counts(&self) -> CallCounts {
        let get = |n: &AtomicUsize| n.load(Ordering::Relaxed);
        CallCounts {
            asked: get(&self.asked),
            asked_outside: get(&self.asked_outside),
            reused: get(&self.reused),
            replayed: get(&self.replayed),
            replaced: get(&self.replaced),
        }
    }

    /// Asks the language model. The answer fits the request's schema and passed `sense`.
    ///
    /// # Errors
    /// [`RoleError`] when not even the offline player has an acceptable answer, or when the run must stop.
    pub async fn ask(
        &self,
        request: &VlmRequest,
        sense: impl Fn(&Value) -> Result<(), String> + Send + Sync,
    ) -> Result<VlmAnswer, RoleError> {
        let check = |answer: &VlmAnswer| sense(&answer.value);
        self.call(request, &self.cast.vision_language, &self.offline.vision_language, &check).await
    }

    /// As [`Calls::ask`], read into a type before `sense` looks at it.
    ///
    /// # Errors
    /// As [`Calls::ask`].
    pub async fn ask_as<T: DeserializeOwned>(
        &self,
        request: &VlmRequest,
        sense: impl Fn(&T) -> Result<(), String> + Send + Sync,
    ) -> Result<T, RoleError> {
        let parse = |value: &Value| T::deserialize(value).map_err(|error| format!("the answer does not fit: {error}"));
        let answer = self.ask(request, |value| sense(&parse(value)?)).await?;
        parse(&answer.value).map_err(|complaint| RoleError::UnusableAnswer {
            player: self.cast.vision_language.card().player,
            complaint,
            raw: shortened(&answer.raw, 2000),
        })
    }

    /// Looks for boxes.
    ///
    /// # Errors
    /// As [`Calls::ask`].
    pub async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        self.call(request, &self.cast.detector, &self.offline.detector, &|_| Ok(())).await
    }

    /// Cuts objects out: one mask a prompt, in order.
    ///
    /// # Errors
    /// As [`Calls::ask`].
    pub async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        self.call(request, &self.cast.segmenter, &self.offline.segmenter, &|_| Ok(())).await
    }

    /// Edits an image; the answer has the size of the request's image.
    ///
    /// # Errors
    /// As [`Calls::ask`].
    pub async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError> {
        self.call(request, &self.cast.image_editor, &self.offline.image_editor, &|_| Ok(())).await
    }

    /// Makes a mesh.
    ///
    /// # Errors
    /// As [`Calls::ask`].
    pub async fn generate_mesh(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        self.call(request, &self.cast.mesh_generator, &self.offline.mesh_generator, &|_| Ok(())).await
    }

    /// Estimates geometry.
    ///
    /// # Errors
    /// As [`Calls::ask`].
    pub async fn estimate(&self, request: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
        self.call(request, &self.cast.geometry_estimator, &self.offline.geometry_estimator, &|_| Ok(())).await
    }

    /// Path-traces. Nobody stands in for a renderer that is not there: the caller has its own flat render.
    ///
    /// # Errors
    /// As [`Calls::ask`]; [`RoleError::NotSetUp`] when there is no path tracer.
    pub async fn render_lit(&self, request: &LitRequest) -> Result<LitImage, RoleError> {
        self.call(request, &self.cast.lit_renderer, &self.offline.lit_renderer, &|_| Ok(())).await
    }

    /// One call of any role.
    async fn call<R: Recordable>(
        &self,
        request: &R,
        cast: &Arc<R::Player>,
        offline: &Arc<R::Player>,
        sense: &(dyn Fn(&R::Answer) -> Result<(), String> + Send + Sync),
    ) -> Result<R::Answer, RoleError> {
        let name = CallName::new(request.name()).map_err(crate::BookError::from)?;
        let turn = self.turn(R::ROLE, &name);
        let _only_one = turn.lock().await;
        let accept = |answer: &R::Answer| request.check(answer).and_then(|()| sense(answer));
        let event = |kind| (self.options.on_event)(CallEvent { role: R::ROLE, name: name.to_string(), kind });
        let card = R::card(cast);

        let question = blocking({
            let request = request.clone();
            move || {
                let mut hasher = KeyHasher::new(R::ROLE);
                request.hash(&mut hasher);
                hasher.finish()
            }
        })
        .await?;
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
        let clock = Instant::now();
        let mut accepted = None;
        if let Some(recorded) = recorded {
            let folder = recorded.folder.clone();
            let request = request.clone();
            match blocking(move || request.read_answer(&folder)).await?.and_then(|a| accept(&a).map(|()| a)) {
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
        let (answer, by, source) = match accepted {
            Some(accepted) => accepted,
            None => self.play(request, cast, offline, &accept, &name, &mut course, &mut warnings).await?,
        };
        let accepted = Accepted { answer, by, source, warnings };
        let timing = CallTiming {
            started_unix_ms: millis(started.duration_since(UNIX_EPOCH).unwrap_or_default()),
            latency_ms: millis(clock.elapsed()),
        };
        self.keep(request, &name, accepted, (question, key, card), course, timing).await
    }

    /// Asks the cast player, again with the complaint where that helps, and then the offline one.
    #[expect(clippy::too_many_arguments, reason = "one call's state, split for reading only")]
    async fn play<R: Recordable>(
        &self,
        request: &R,
        cast: &Arc<R::Player>,
        offline: &Arc<R::Player>,
        accept: &(dyn Fn(&R::Answer) -> Result<(), String> + Send + Sync),
        name: &CallName,
        course: &mut Course,
        warnings: &mut Vec<Warning>,
    ) -> Result<(R::Answer, PlayerCard, Source), RoleError> {
        let card = R::card(cast);
        let event = |kind| (self.options.on_event)(CallEvent { role: R::ROLE, name: name.to_string(), kind });
        let failure = match self.try_player(request, cast, accept, name, course).await {
            Ok(answer) => return Ok((answer, card, Source::Player)),
            Err(error) => error,
        };
        let stand_in = R::card(offline);
        let same = stand_in.player == card.player && stand_in.model == card.model;
        if failure.is_fatal() || same {
            return Err(failure);
        }
        let reason = shortened(&self.book.redacted(&failure.to_string()), 600);
        tracing::warn!(call = %name, role = R::ROLE.folder(), "{} stands in: {reason}", stand_in.player);
        event(CallEventKind::Replaced { reason: reason.clone() });
        let answer = self.try_player(request, offline, accept, name, course).await?;
        self.replaced.fetch_add(1, Ordering::Relaxed);
        let text = format!("{reason}; {} ({}) stood in", stand_in.player, stand_in.model);
        warnings.push(warning(name, WarningKind::PlayerReplaced, &text));
        Ok((answer, stand_in, Source::Replaced { reason }))
    }

    /// Asks one player until its answer is accepted or it makes no sense to ask again.
    async fn try_player<R: Recordable>(
        &self,
        request: &R,
        player: &Arc<R::Player>,
        accept: &(dyn Fn(&R::Answer) -> Result<(), String> + Send + Sync),
        name: &CallName,
        course: &mut Course,
    ) -> Result<R::Answer, RoleError> {
        let card = R::card(player);
        let event = |kind| (self.options.on_event)(CallEvent { role: R::ROLE, name: name.to_string(), kind });
        // The same question would get the same answer from a player that only computes.
        let reasks = if card.offline { 0 } else { self.options.reasks };
        let place = self.place(&card);
        let mut asked = request.clone();
        let mut tried = 0;
        loop {
            let _place = free_place(place.as_deref()).await;
            self.asked.fetch_add(1, Ordering::Relaxed);
            self.asked_outside.fetch_add(usize::from(!card.offline), Ordering::Relaxed);
            tracing::debug!(role = R::ROLE.folder(), call = %name, player = %card.player, "asked");
            event(CallEventKind::Asked { player: card.player.clone() });
            let clock = Instant::now();
            let outcome = asked.play(player).await.and_then(|answer| match accept(&answer) {
                Ok(()) => Ok(answer),
                Err(complaint) => {
                    let usage = R::usage(&answer);
                    course.usage = add_usage(course.usage, usage);
                    Err(RoleError::UnusableAnswer {
                        player: card.player.clone(),
                        complaint: shortened(&complaint, MAX_COMPLAINT),
                        raw: shortened(&R::raw(&answer), 2000),
                    })
                }
            });
            let error = match outcome {
                Ok(answer) => {
                    let usage = R::usage(&answer);
                    course.usage = add_usage(course.usage, usage);
                    course.tries.push(Try { player: card.player.clone(), complaint: None, usage });
                    event(CallEventKind::Answered { player: card.player, latency: clock.elapsed() });
                    return Ok(answer);
                }
                Err(error) => error,
            };
            let complaint = self.book.redacted(&shortened(&error.to_string(), MAX_COMPLAINT));
            course.tries.push(Try {
                player: card.player.clone(),
                complaint: Some(complaint.clone()),
                usage: Usage::default(),
            });
            tried += 1;
            // The one place that decides what a failure leads to; waiting and trying again what is passing
            // (`is_retryable`, `retry_after`) belongs here too.
            match &error {
                RoleError::UnusableAnswer { complaint, raw, .. } if tried <= reasks => {
                    event(CallEventKind::AskedAgain { player: card.player.clone(), complaint: complaint.clone() });
                    asked = request.again(complaint, raw);
                }
                _ => return Err(error),
            }
        }
    }

    /// Writes the record and returns the answer as it is read back from it, so that a run that is re-entered sees
    /// exactly what the first one saw.
    async fn keep<R: Recordable>(
        &self,
        request: &R,
        name: &CallName,
        accepted: Accepted<R::Answer>,
        (question, key, cast): (ContentKey, ContentKey, PlayerCard),
        course: Course,
        timing: CallTiming,
    ) -> Result<R::Answer, RoleError> {
        let warnings: Vec<Warning> =
            accepted.warnings.into_iter().map(|w| Warning { message: self.book.redacted(&w.message), ..w }).collect();
        let record = CallRecord {
            version: RECORD_VERSION,
            name: name.to_string(),
            role: R::ROLE,
            key,
            question,
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
        let kept = blocking(move || {
            let offline = record.answered_by.offline;
            let folder = book.store(&record, timing, |out| {
                request.write_request(out, offline)?;
                request.write_answer(&answer, out)
            })?;
            let path = folder.join("answer.json");
            request.read_answer(&folder).map_err(|reason| crate::BookError::Write { reason, path })
        })
        .await??;
        for warning in warnings {
            (self.options.on_warning)(warning);
        }
        Ok(kept)
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

    /// The lock of a name: two calls under one name run one after the other, the second takes the first's record.
    fn turn(&self, role: Role, name: &CallName) -> Turn {
        let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(names.entry((role, name.clone())).or_default())
    }

    /// The free places of a player; `None` = no limit.
    fn place(&self, card: &PlayerCard) -> Option<Arc<Semaphore>> {
        if card.concurrency == 0 {
            return None;
        }
        let mut places = self.places.lock().unwrap_or_else(PoisonError::into_inner);
        let place = places
            .entry(format!("{}\n{}", card.player, card.model))
            .or_insert_with(|| Arc::new(Semaphore::new(card.concurrency.min(Semaphore::MAX_PERMITS))));
        Some(Arc::clone(place))
    }
}

async fn free_place(place: Option<&Semaphore>) -> Option<SemaphorePermit<'_>> {
    match place {
        // The semaphore is never closed, so this waits until there is a place.
        Some(place) => place.acquire().await.ok(),
        None => None,
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
