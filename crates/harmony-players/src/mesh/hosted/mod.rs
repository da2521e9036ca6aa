//! Hosted services that make meshes of pictures for money: fal.ai, Replicate, Tripo, Meshy.
//!
//! All work alike: a task is made, looked at until it is done, and leaves a link to a file. What differs is in one module
//! each ([`wire::Wire`]), with what was read of the service and what is not certain.
//!
//! No mesh is paid twice: a task is noted when it is made ([`tasks`]), so that a try that ends too early, a broken line, a
//! file that came cut off or a program that was killed leads back to the same task. A task that fails is made anew once; one
//! that stays at work for longer than [`HostedOptions::patience`] is cancelled where the service allows it.
//! What cannot be known is whether a request whose answer was lost made a task: it is asked again.

pub mod fal;
pub mod meshy;
pub mod replicate;
pub mod tasks;
pub mod tripo;
pub mod wire;

use std::sync::Arc;
use std::time::{Duration, Instant};

use async_trait::async_trait;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_roles::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, PlayerCard, RoleError, Usage};
use serde_json::{Map, Value};

use super::finish::{Finish, SourceFrame, finished, whole};
use super::picture::{check_request, hosted};
use crate::check::{Check, Checked};
use crate::editor::wire::decoded;
use crate::http::{Http, HttpAnswer, HttpRequest, Service, ServiceOptions};
use crate::work::computed;
use tasks::Tasks;
use wire::{Ended, Meaning, Product, TaskState, Wire, Work};

/// How long one look at a task, and each other small request, may take.
const LOOK: Duration = Duration::from_secs(30);

/// How long making a task may take, its picture on the way included.
const SUBMIT: Duration = Duration::from_mins(2);

/// Each wait between two looks is so many times the one before, until it is [`SLOWEST`] times the first. A mesh is found
/// that much too late, and so is every one that waits for its place.
const SLOWER: f64 = 1.5;
const SLOWEST: u32 = 2;

/// A task that was just made may not be known everywhere yet.
const YOUNG: Duration = Duration::from_secs(20);

/// Times that a file is fetched that comes cut off or not at all.
const FETCHES: usize = 3;

/// Tasks for one piece of work that may end without a result.
const MAX_FAILED: u32 = 2;

/// Times that one task's file may turn out to be of no use; then another start may make another task.
const MAX_UNUSABLE: u32 = 3;

/// What helps when a mesh cannot be fetched any more.
const AGAIN: &str = "`harmony reconstruct` with `--from` this phase makes another task, which is paid anew";

/// Which service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Host {
    /// fal.ai.
    Fal,
    /// Replicate.
    Replicate,
    /// Tripo.
    Tripo,
    /// Meshy.
    Meshy,
}

impl Host {
    /// Its API.
    pub fn wire(self) -> Box<dyn Wire> {
        match self {
            Self::Fal => Box::new(fal::Fal),
            Self::Replicate => Box::new(replicate::Replicate),
            Self::Tripo => Box::new(tripo::Tripo),
            Self::Meshy => Box::new(meshy::Meshy),
        }
    }
}

/// How a service is set up as a mesh generator.
#[derive(Debug, Clone)]
pub struct HostedOptions {
    /// Where and how; `limits.total` is how long one call waits for its task.
    pub service: ServiceOptions,
    /// Which service.
    pub host: Host,
    /// Model, as the service names it.
    pub model: String,
    /// Whether meshes are textured.
    pub texture: bool,
    /// Seed, where the service has one.
    pub seed: u32,
    /// Further properties of the request.
    pub extra: Map<String, Value>,
    /// The frame of its meshes; `None` = the service's usual one.
    pub frame: Option<SourceFrame>,
    /// US dollars for one of the service's credits, where it tells how many a task took.
    pub usd_per_credit: Option<f64>,
    /// First wait between two looks at a task.
    pub poll: Duration,
    /// How long a task may be at work before it is given up.
    pub patience: Duration,
    /// Tasks that were made.
    pub tasks: Arc<Tasks>,
    /// How many calls may run at once.
    pub concurrency: usize,
}

/// A hosted service as a mesh generator.
#[derive(Debug)]
pub struct HostedPlayer {
    service: Service,
    wire: Box<dyn Wire>,
    frame: SourceFrame,
    options: HostedOptions,
}

/// What a try works on.
struct Asked<'a> {
    /// Hash of the work.
    key: String,
    /// Name of the call.
    call: &'a str,
    png: Vec<u8>,
    work: Work,
}

/// The file of a task, and what the task took.
struct Fetched {
    bytes: Vec<u8>,
    credits: Option<f64>,
}

impl HostedPlayer {
    /// Sets it up; nothing is sent yet.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn new(http: &Http, options: HostedOptions) -> Result<Self, RoleError> {
        let service = Service::new(http, options.service.clone())?;
        let model = options.model.trim();
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:".contains(c);
        if model.is_empty() || model.contains("..") || !model.chars().all(plain) {
            let hint = "set `model` in [players.mesh_generator] to a model as the service names it";
            return Err(service.not_set_up("no model is named, or one that cannot be part of an address", hint));
        }
        let wire = options.host.wire();
        let frame = options.frame.unwrap_or_else(|| wire.frame(model));
        frame
            .canonical_from_source()
            .map_err(|reason| service.not_set_up(reason, "set `up` and `front` in [players.mesh_generator] apart"))?;
        Ok(Self { service, wire, frame, options })
    }

    /// The service, for whoever needs its key hidden.
    pub fn service(&self) -> &Service {
        &self.service
    }

    /// Sets how long a task may be at work before it is given up.
    pub fn be_patient_for(&mut self, patience: Duration) {
        self.options.patience = patience;
    }

    /// Hash of all that decides what comes back.
    fn key(&self, png: &[u8], work: &Work) -> String {
        let mut hasher = blake3::Hasher::new();
        let (request, _) = self.wire.submit("the picture", work);
        let body = request.body.map(|(_, body)| body).unwrap_or_default();
        for part in [self.service.player().as_bytes(), self.service.address().as_bytes(), &body, png] {
            hasher.update(&(part.len() as u64).to_le_bytes());
            hasher.update(part);
        }
        hasher.finalize().to_hex()[..32].to_owned()
    }

    fn note_failed(&self, error: std::io::Error) -> RoleError {
        RoleError::Io { player: self.service.player().to_owned(), source: error }
    }

    fn not_capable(&self, reason: &str) -> RoleError {
        RoleError::NotCapable { player: self.service.player().to_owned(), reason: self.service.scrubbed(reason) }
    }

    /// The error of an answer that is not a success.
    fn failure(&self, answer: &HttpAnswer) -> RoleError {
        match self.wire.meaning(answer) {
            Some(Meaning::Refused(reason)) => self.service.refused(&reason),
            Some(Meaning::Spent(reason)) => {
                self.service.not_set_up(format!("the account is used up: {reason}"), "top up the account")
            }
            None => self.service.failure(answer),
        }
    }

    /// Sends a small request.
    async fn send(&self, request: &HttpRequest) -> Result<HttpAnswer, RoleError> {
        self.send_within(LOOK, request).await
    }

    async fn send_within(&self, patience: Duration, request: &HttpRequest) -> Result<HttpAnswer, RoleError> {
        match tokio::time::timeout(patience, self.service.send(request)).await {
            Ok(answer) => answer,
            Err(_) => Err(self.service.unavailable(format!("no answer within {patience:?}"))),
        }
    }

    /// The task is at work: nothing is paid by looking at it again.
    fn not_yet(&self, waited: Duration) -> RoleError {
        RoleError::Unavailable {
            player: self.service.player().to_owned(),
            reason: format!("the task is not done after {waited:?}; it is looked at again, and not paid again"),
            status: Some(202),
            retry_after: None,
        }
    }

    /// Sends a request whose answer is JSON.
    async fn ask(&self, request: &HttpRequest) -> Result<Value, RoleError> {
        let answer = self.send_within(SUBMIT, request).await?;
        if !answer.is_success() {
            return Err(self.failure(&answer));
        }
        self.json(&answer)
    }

    fn json(&self, answer: &HttpAnswer) -> Result<Value, RoleError> {
        serde_json::from_slice(&answer.body)
            .map_err(|error| self.service.unusable(format!("its answer is not JSON: {error}"), &answer.text()))
    }

    /// Makes a task and notes it; its id.
    async fn submit(&self, asked: &Asked<'_>) -> Result<String, RoleError> {
        let picture = match self.wire.upload(&asked.png) {
            Some(request) => {
                let answer = self.ask(&request).await?;
                self.wire.uploaded(&answer).map_err(|reason| self.service.unusable(reason, &answer.to_string()))?
            }
            None => format!("data:image/png;base64,{}", STANDARD.encode(&asked.png)),
        };
        let (request, _) = self.wire.submit(&picture, &asked.work);
        let answer = self.ask(&request).await?;
        let id = self.wire.submitted(&answer);
        let id = id.map_err(|reason| self.service.unusable(reason, &answer.to_string()))?;
        let made = self.options.tasks.made(&asked.key, asked.call, self.service.player(), &id);
        made.map_err(|error| self.note_failed(error))?;
        tracing::debug!(player = self.service.player(), task = %id, "made a task");
        Ok(id)
    }

    /// Waits until a task is done; `None` = the service does not know it any more.
    async fn product(&self, asked: &Asked<'_>, id: &str) -> Result<Option<Product>, RoleError> {
        let (model, since) = (asked.work.model.as_str(), Instant::now());
        let total = self.service.limits().total;
        let look = self.wire.look(model, id);
        let mut wait = self.options.poll;
        let mut at_once = true;
        loop {
            if since.elapsed() >= total {
                return Err(self.not_yet(total));
            }
            // A task of an earlier try may be done.
            if !std::mem::take(&mut at_once) {
                tokio::time::sleep(wait.min(total.saturating_sub(since.elapsed()))).await;
                wait = wait.mul_f64(SLOWER).min(self.options.poll * SLOWEST);
            }
            let answer = match self.send(&look).await {
                Ok(answer) => answer,
                // The line broke: the task is there all the same.
                Err(RoleError::Unavailable { .. }) => continue,
                Err(error) => return Err(error),
            };
            let age = self.options.tasks.of(&asked.key).age();
            if matches!(answer.status, 404 | 410) {
                if age < YOUNG {
                    continue;
                }
                return Ok(None);
            }
            if !answer.is_success() {
                let error = self.failure(&answer);
                if !error.is_retryable() {
                    return Err(error);
                }
                wait = wait.max(error.retry_after().unwrap_or_default());
                continue;
            }
            let Ok(body) = serde_json::from_slice::<Value>(&answer.body) else { continue };
            let mut state = self.wire.state(&body);
            if state == TaskState::Ready {
                state = self.result(asked, id).await?;
            }
            match state {
                TaskState::Working | TaskState::Ready if age >= self.options.patience => {
                    return Err(self.given_up(asked, id, age).await?);
                }
                TaskState::Working | TaskState::Ready => {}
                TaskState::Done(product) => return Ok(Some(product)),
                TaskState::Ended(ended) => return Err(self.ended(asked, ended)?),
            }
        }
    }

    /// Asks for the result of a task whose result is asked for separately.
    async fn result(&self, asked: &Asked<'_>, id: &str) -> Result<TaskState, RoleError> {
        let request = self.wire.result(&asked.work.model, id);
        let answer = match self.send(&request).await {
            Ok(answer) => answer,
            Err(RoleError::Unavailable { .. }) => return Ok(TaskState::Working),
            Err(error) => return Err(error),
        };
        if answer.is_success() {
            let body = serde_json::from_slice::<Value>(&answer.body);
            return Ok(body.map_or(TaskState::Working, |body| self.wire.product(&body)));
        }
        let error = self.failure(&answer);
        // The model's own error comes with a status of its own; what is said of the line or the key is another thing.
        match (&error, answer.status) {
            (RoleError::Refused { reason, .. }, _) => Ok(TaskState::Ended(Ended::Refused(reason.clone()))),
            (_, 401..=403) => Err(error),
            (_, 408 | 429 | 502..=504) => Ok(TaskState::Working),
            _ => Ok(TaskState::Ended(Ended::Failed(error.to_string()))),
        }
    }

    /// The error of a task that ended without a result. The same work may be tried by another task once.
    fn ended(&self, asked: &Asked<'_>, ended: Ended) -> Result<RoleError, RoleError> {
        let failed = self.options.tasks.failed(&asked.key).map_err(|error| self.note_failed(error))?;
        Ok(match ended {
            Ended::Refused(reason) => self.service.refused(&reason),
            Ended::NotUnderstood(reason) => {
                self.not_capable(&format!("its answer about the task is not understood: {reason}"))
            }
            Ended::Failed(reason) if failed < MAX_FAILED => {
                self.service.unavailable(format!("the task failed: {reason}"))
            }
            Ended::Failed(reason) => self.not_capable(&format!("{failed} tasks failed, the last one: {reason}")),
        })
    }

    /// Cancels a task that is at work for too long; the error that tells so.
    async fn given_up(&self, asked: &Asked<'_>, id: &str, age: Duration) -> Result<RoleError, RoleError> {
        let cancelled = match self.wire.cancel(&asked.work.model, id) {
            Some(request) => match self.send(&request).await {
                Ok(answer) if answer.is_success() => "it was cancelled",
                _ => "it could not be cancelled",
            },
            None => "the service has no way to cancel it",
        };
        self.options.tasks.failed(&asked.key).map_err(|error| self.note_failed(error))?;
        Ok(self.not_capable(&format!("the task is not done after {} minutes; {cancelled}", age.as_secs() / 60)))
    }

    /// The file behind a link; `None` = the link has ended.
    async fn file(&self, link: &str) -> Result<Option<Vec<u8>>, RoleError> {
        if link.starts_with("data:") {
            let bytes = decoded(link).map_err(|_| self.service.unusable("the file is not base64", ""))?;
            return Ok(Some(bytes));
        }
        let link = self.service.file_link(link)?;
        let mut last = None;
        for fetch in 0..FETCHES {
            if fetch > 0 {
                tokio::time::sleep(self.options.poll).await;
            }
            match self.service.fetch(&link).await {
                Ok(answer) if answer.is_success() => match whole(&answer.body) {
                    Ok(()) => return Ok(Some(answer.body)),
                    Err(reason) => last = Some(self.service.unusable(reason, "")),
                },
                // Signed links that have ended are refused, not only missing.
                Ok(answer) if matches!(answer.status, 401 | 403 | 404 | 410) => return Ok(None),
                Ok(answer) => {
                    let status = answer.status;
                    last = Some(RoleError::Unavailable {
                        player: self.service.player().to_owned(),
                        reason: format!("the file of the task cannot be fetched (status {status})"),
                        status: Some(status),
                        retry_after: None,
                    });
                }
                Err(error @ RoleError::Unavailable { .. }) => last = Some(error),
                Err(error) => return Err(error),
            }
        }
        Err(last.unwrap_or_else(|| self.service.unavailable("the file of the task cannot be fetched")))
    }

    /// The file for a piece of work: of the task that was made for it, else of a new one.
    async fn made(&self, asked: &Asked<'_>, notes: &mut Vec<String>) -> Result<Fetched, RoleError> {
        let tasks = &self.options.tasks;
        for _ in 0..2 {
            let before = tasks.of(&asked.key);
            let (id, earlier) = match before.task {
                Some(id) => (id, true),
                None if before.failed >= MAX_FAILED => {
                    return Err(self.not_capable(&format!("{} tasks for this picture gave nothing", before.failed)));
                }
                None => (self.submit(asked).await?, false),
            };
            // A second look gives a fresh link where links end soon.
            for _ in 0..2 {
                let Some(product) = self.product(asked, &id).await? else { break };
                if let Some(bytes) = self.file(&product.link).await? {
                    return Ok(Fetched { bytes, credits: product.credits });
                }
            }
            tasks.failed(&asked.key).map_err(|error| self.note_failed(error))?;
            if !earlier {
                return Err(
                    self.not_capable(&format!("the link to its file has ended, and there is no other; {AGAIN}"))
                );
            }
            notes.push(format!("task {id} of an earlier try is gone at the service, with its file; another was made"));
        }
        Err(self.not_capable(&format!("the links to its files have ended; {AGAIN}")))
    }
}

#[async_trait]
impl MeshGenerator for HostedPlayer {
    fn card(&self) -> PlayerCard {
        let texture = if self.options.texture { "textured" } else { "untextured" };
        let seed = if self.wire.has_seed() { format!(", seed {}", self.options.seed) } else { String::new() };
        PlayerCard {
            player: self.service.player().to_owned(),
            model: format!("{}, {texture}{seed}", self.options.model),
            offline: false,
            concurrency: self.options.concurrency,
        }
    }

    fn sees_picture_only(&self) -> bool {
        true
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let crop = Arc::clone(&request.crop);
        let png = computed(self.service.player(), move || hosted(&crop)).await?;
        let png = png.map_err(|reason| self.not_capable(&reason))?;
        let work = Work {
            model: self.options.model.trim().to_owned(),
            settings: request.settings,
            seed: self.options.seed,
            texture: self.options.texture,
            extra: self.options.extra.clone(),
        };
        let (_, mut notes) = self.wire.submit("", &work);
        let asked = Asked { key: self.key(&png, &work), call: &request.name, png, work };
        let fetched = self.made(&asked, &mut notes).await?;
        let finish = Finish {
            faces: request.settings.faces as usize,
            frame: self.frame,
            not_metal: self.wire.not_metal(&asked.work.model),
        };
        let bytes = fetched.bytes;
        let done = computed(self.service.player(), move || finished(&bytes, &finish)).await?;
        let (mesh, more) = match done {
            Ok(done) => done,
            Err(complaint) => {
                let tasks = &self.options.tasks;
                let unusable = tasks.unusable(&asked.key).map_err(|error| self.note_failed(error))?;
                if unusable >= MAX_UNUSABLE {
                    tasks.failed(&asked.key).map_err(|error| self.note_failed(error))?;
                }
                return Err(self.service.unusable(complaint, ""));
            }
        };
        notes.extend(more);
        let cost_usd = fetched.credits.zip(self.options.usd_per_credit).map(|(credits, usd)| credits * usd);
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Raw,
            part_model: None,
            source: format!("{} {}", self.service.player(), asked.work.model),
            notes,
            usage: Usage { cost_usd, ..Usage::default() },
        })
    }
}

#[async_trait]
impl Check for HostedPlayer {
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        let answer = self.send(&self.wire.check(&self.options.model)).await?;
        let detail = match self.wire.checked(&answer) {
            Some(Ok(detail)) => detail,
            Some(Err(reason)) => return Err(self.service.not_set_up(reason, "top up the account")),
            None if answer.is_success() => {
                return Err(self.service.unusable("this does not look like the service", &answer.text()));
            }
            None => return Err(self.failure(&answer)),
        };
        if !paid {
            return Ok(Checked { detail, usage: None });
        }
        let made = self.generate(&check_request()).await?;
        Ok(Checked { detail: format!("a ball of {} triangles", made.mesh.triangle_count()), usage: Some(made.usage) })
    }
}
