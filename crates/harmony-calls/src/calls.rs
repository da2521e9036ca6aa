//! The calls of a run: who plays, what is limited, and one method a role. How a call goes is in `asking.rs`.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use harmony_roles::{
    DetectRequest, Detections, EditRequest, EditedImage, GeneratedMesh, GeometryAnswer, GeometryRequest, LitImage,
    LitRequest, MeshRequest, PlayerCard, Role, RoleError, SegmentRequest, SegmentedMask, VlmAnswer, VlmRequest,
};
use harmony_scene::Warning;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::time::Instant;

use crate::board::{Board, CallsNow};
use crate::budget::{Budget, Purse, Spent};
use crate::check::shortened;
use crate::gate::Gate;
use crate::limits::Limits;
use crate::prices::Prices;
use crate::record::{CallSummary, Source};
use crate::shared::SharedLimits;
use crate::stop::Stop;
use crate::{CallBook, CallName, Capabilities, Cast, ContentKey};

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
    /// It takes no more calls at once; this one waits in line.
    Queued {
        /// Who.
        player: String,
    },
    /// It takes no more requests or tokens this minute.
    RateLimited {
        /// Who.
        player: String,
        /// For so long.
        wait: Duration,
    },
    /// It did not answer and is asked again.
    Retried {
        /// Who.
        player: String,
        /// What happened.
        reason: String,
        /// After this time.
        wait: Duration,
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
        /// For so many US dollars, where known.
        cost_usd: Option<f64>,
    },
    /// A record answered, of an earlier run or of another call about the same work: no call.
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
    /// Calls answered by a record: their own, or that of another call about the same work.
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
    /// What players can take, and when they are tried again.
    pub limits: Limits,
    /// What may be spent.
    pub budget: Budget,
    /// What calls cost, where players don't say.
    pub prices: Prices,
    /// Who counts for several programs at once, where this run is one of many.
    pub shared: Option<Arc<dyn SharedLimits>>,
    /// Numbers from 0 to 1 for the jitter of waits.
    pub random: Arc<dyn Fn() -> f64 + Send + Sync>,
}

impl Default for CallOptions {
    fn default() -> Self {
        Self {
            reasks: 2,
            on_warning: Arc::new(|_| {}),
            on_event: Arc::new(|_| {}),
            limits: Limits::default(),
            budget: Budget::default(),
            prices: Prices::default(),
            shared: None,
            random: Arc::new(rand::random::<f64>),
        }
    }
}

/// A cast whose every call is checked and recorded.
pub struct Calls {
    pub(crate) book: Arc<CallBook>,
    cast: Cast,
    offline: Cast,
    pub(crate) options: CallOptions,
    /// The way to each player and model.
    gates: Mutex<HashMap<String, Arc<Gate>>>,
    /// One call under a name at a time.
    names: Mutex<HashMap<(Role, CallName), Turn>>,
    /// Calls come to their players in the order in which they were begun, however long it takes to read a question.
    pub(crate) arrivals: tokio::sync::Mutex<()>,
    /// One call about the same work at a time.
    works: Mutex<HashMap<ContentKey, Turn>>,
    pub(crate) stop: Arc<Stop>,
    pub(crate) purse: Arc<Purse>,
    pub(crate) board: Board,
    /// When the run's time is over.
    pub(crate) deadline: Option<Instant>,
    pub(crate) asked: AtomicUsize,
    pub(crate) asked_outside: AtomicUsize,
    pub(crate) reused: AtomicUsize,
    pub(crate) replayed: AtomicUsize,
    pub(crate) replaced: AtomicUsize,
}

/// Whose turn it is to make the call of a name.
type Turn = Arc<tokio::sync::Mutex<()>>;

impl Calls {
    /// Makes calls of `cast` into `book`; `offline` stands in for players that fail. The run's minutes begin now.
    pub fn new(book: Arc<CallBook>, cast: Cast, offline: Cast, options: CallOptions) -> Self {
        // A book that can't be listed says so when it is used.
        let before =
            if options.budget.is_unlimited() { BTreeMap::new() } else { spent_in(&book.log().unwrap_or_default()) };
        let minutes = options.budget.minutes.map(|m| Duration::from_secs_f64((m * 60.0).clamp(0.0, 3.2e9)));
        Self {
            book,
            cast,
            offline,
            gates: Mutex::default(),
            names: Mutex::default(),
            arrivals: tokio::sync::Mutex::default(),
            works: Mutex::default(),
            stop: Arc::default(),
            purse: Purse::new(options.budget.clone(), before),
            board: Board::default(),
            deadline: minutes.map(|m| Instant::now() + m),
            options,
            asked: AtomicUsize::new(0),
            asked_outside: AtomicUsize::new(0),
            reused: AtomicUsize::new(0),
            replayed: AtomicUsize::new(0),
            replaced: AtomicUsize::new(0),
        }
    }

    /// The switch that stops the run.
    pub fn stop(&self) -> &Arc<Stop> {
        &self.stop
    }

    /// What is under way now, and what was spent.
    pub fn now(&self) -> CallsNow {
        CallsNow { underway: self.board.underway(), spent: self.purse.spent() }
    }

    /// The book.
    pub fn book(&self) -> &CallBook {
        &self.book
    }

    /// Who plays.
    pub fn cast(&self) -> &Cast {
        &self.cast
    }

    /// What the players can do, or could when the recording that is replayed was made.
    pub fn can(&self) -> Capabilities {
        let can = self.cast.can();
        let Some(recording) = self.book.recording() else { return can };
        Capabilities {
            draws: can.draws || recording.played_outside(Role::ImageEditor),
            makes_shapes: can.makes_shapes || recording.played_outside(Role::MeshGenerator),
            // A recording without a detector's answers has boxes with its lists.
            gives_boxes: recording.played_outside(Role::Detector),
            recognises: can.recognises || recording.played_outside(Role::Detector),
            ..can
        }
    }

    /// Whether a question is answered by somebody who looks: the language model, or the recording that is replayed.
    pub fn is_looked_at(&self, question: &str) -> bool {
        let recorded = || self.book.recording().and_then(|r| r.names(Role::VisionLanguage).ok()).unwrap_or_default();
        self.cast.can().sees || recorded().iter().any(|name| name.as_str() == question)
    }

    /// Time since the start in which a player from outside was asked and had not answered.
    pub fn waited(&self) -> Duration {
        self.board.waited()
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

    /// The lock of a name: two calls under one name run one after the other, the second takes the first's record.
    pub(crate) fn turn(&self, role: Role, name: &CallName) -> Turn {
        let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(names.entry((role, name.clone())).or_default())
    }

    /// The lock of a piece of work: of two calls about it one waits, and takes the other's answer.
    pub(crate) fn work_turn(&self, work: &ContentKey) -> Turn {
        let mut works = self.works.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(works.entry(work.clone()).or_default())
    }

    /// The way to a player.
    pub(crate) fn gate(&self, card: &PlayerCard) -> Arc<Gate> {
        let mut gates = self.gates.lock().unwrap_or_else(PoisonError::into_inner);
        let gate = gates.entry(format!("{}\n{}", card.player, card.model)).or_insert_with(|| {
            let limits = self.options.limits.of(card);
            Gate::new(card.concurrency, limits, self.options.limits.minute)
        });
        Arc::clone(gate)
    }
}

/// What the records of earlier starts say was spent, by role.
fn spent_in(log: &[CallSummary]) -> BTreeMap<Role, Spent> {
    let mut spent: BTreeMap<Role, Spent> = BTreeMap::new();
    for call in log {
        // The stand-in's try is this program's own.
        let own = usize::from(call.offline || matches!(call.source, Source::Replaced { .. }));
        let outside = call.tries.saturating_sub(own);
        if outside > 0 {
            let time = Duration::from_millis(call.timing.latency_ms);
            spent.entry(call.role).or_default().add(call.usage.cost_usd, outside, time);
        }
    }
    spent
}
