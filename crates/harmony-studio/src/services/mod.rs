//! The services. Each module holds one maker's wire formats, limits and quirks, each quirk with the reference sheet
//! that it is from.

mod anthropic;
mod detectors;
mod edits;
mod form;
mod google;
mod hosted;
mod meshes;
mod openai;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use harmony_bench::wall_clock::Pace;
use harmony_calls::schema_complaints;
use image::{DynamicImage, RgbImage};
use serde_json::{Value, json};

use crate::faults::{Fault, Part};
use crate::http::{Delivery, Play, Reply, Request};
use crate::ledger::{Entry, Ledger};
use crate::limits::Buckets;
use crate::strict::{self, Rules};
use crate::truth_oracle::TruthOracle;
use crate::{StudioOptions, reading};

/// The body that is announced as 200 MB.
const HUGE: u64 = 200_000_000;

/// A service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "names of makers and programs")]
pub enum Service {
    OpenAi,
    Gemini,
    Anthropic,
    Vllm,
    LlamaCpp,
    SdServer,
    Hunyuan2,
    Hunyuan21,
    TrellisNim,
    TrellisLocalAi,
    LocateAnything,
    GroundingDino,
    Fal,
    Replicate,
    Tripo,
    Meshy,
}

impl Service {
    /// All.
    pub const ALL: [Self; 16] = [
        Self::OpenAi,
        Self::Gemini,
        Self::Anthropic,
        Self::Vllm,
        Self::LlamaCpp,
        Self::SdServer,
        Self::Hunyuan2,
        Self::Hunyuan21,
        Self::TrellisNim,
        Self::TrellisLocalAi,
        Self::LocateAnything,
        Self::GroundingDino,
        Self::Fal,
        Self::Replicate,
        Self::Tripo,
        Self::Meshy,
    ];

    /// First part of its paths here: all services share one port.
    pub fn prefix(self) -> &'static str {
        match self {
            Self::OpenAi => "openai",
            Self::Gemini => "gemini",
            Self::Anthropic => "anthropic",
            Self::Vllm => "vllm",
            Self::LlamaCpp => "llama",
            Self::SdServer => "sd",
            Self::Hunyuan2 => "hunyuan2",
            Self::Hunyuan21 => "hunyuan21",
            Self::TrellisNim => "nim",
            Self::TrellisLocalAi => "localai",
            Self::LocateAnything => "locate",
            Self::GroundingDino => "dino",
            Self::Fal => "fal",
            Self::Replicate => "replicate",
            Self::Tripo => "tripo",
            Self::Meshy => "meshy",
        }
    }

    /// What follows in the base address that a user configures.
    pub fn base(self) -> &'static str {
        match self {
            Self::OpenAi
            | Self::Anthropic
            | Self::Vllm
            | Self::LlamaCpp
            | Self::SdServer
            | Self::LocateAnything
            | Self::Replicate => "/v1",
            Self::Tripo => "/v2/openapi",
            Self::Gemini => "/v1beta",
            Self::GroundingDino => "/",
            Self::Hunyuan2 | Self::Hunyuan21 | Self::TrellisNim | Self::TrellisLocalAi | Self::Fal | Self::Meshy => "",
        }
    }
}

/// An answer on its way out.
pub(crate) struct Made {
    reply: Reply,
    part: Part,
    tokens: (u64, u64),
    /// Paid work was done, and nothing is wrong with the answer itself.
    usable: bool,
}

impl Made {
    /// An answer that costs nothing: lists of models, states of jobs, errors.
    fn free(part: Part, reply: Reply) -> Self {
        Self { reply, part, tokens: (0, 0), usable: false }
    }

    /// Paid work.
    fn paid(part: Part, reply: Reply, tokens: (u64, u64)) -> Self {
        Self { reply, part, tokens, usable: true }
    }
}

/// All services of one studio.
pub(crate) struct Services {
    pub truth_oracle: Arc<TruthOracle>,
    pub options: StudioOptions,
    pub ledger: Arc<Ledger>,
    pub buckets: Buckets,
    /// Address of this studio, for links to files.
    pub own: String,
    /// Address of another host, for redirects.
    pub elsewhere: String,
    jobs: meshes::Jobs,
    tasks: hosted::Tasks,
}

/// One request to a service.
pub(crate) struct Call<'a> {
    studio: &'a Services,
    service: Service,
    request: &'a Request,
    /// Path below the prefix.
    path: &'a str,
    json: Value,
    fault: Option<Fault>,
}

impl Call<'_> {
    fn is(&self, fault: Fault) -> bool {
        self.fault == Some(fault)
    }

    /// How long the answer to a question or an edit takes. Hosted meshes are tasks, which answer at once and take their
    /// time then.
    fn takes(&self, pace: Pace) -> Duration {
        match self.service {
            Service::OpenAi if self.path == "/v1/images/edits" => pace.edit,
            Service::Gemini if google::wants_images(&self.json) => pace.edit,
            Service::SdServer => pace.edit,
            Service::OpenAi | Service::Gemini | Service::Anthropic | Service::Vllm | Service::LlamaCpp => pace.question,
            _ => Duration::ZERO,
        }
    }

    /// The key of `Authorization: Bearer`.
    fn bearer(&self) -> Option<&str> {
        self.request.header("authorization")?.strip_prefix("Bearer ")
    }
}

impl Services {
    pub fn new(truth_oracle: Arc<TruthOracle>, options: StudioOptions, own: SocketAddr, elsewhere: SocketAddr) -> Self {
        let buckets = Buckets::new(options.requests, options.window);
        Self {
            truth_oracle,
            options,
            ledger: Arc::default(),
            buckets,
            own: format!("http://{own}"),
            elsewhere: format!("http://{elsewhere}"),
            jobs: meshes::Jobs::default(),
            tasks: hosted::Tasks::default(),
        }
    }

    async fn answer(&self, request: &Request) -> (Reply, u64) {
        let path = request.path.trim_start_matches('/');
        let (prefix, rest) = path.split_once('/').unwrap_or((path, ""));
        let Some(service) = Service::ALL.into_iter().find(|s| s.prefix() == prefix) else {
            return (Reply::json(404, &json!({"detail": "Not Found"})), 0);
        };
        let rest = format!("/{rest}");
        let json = serde_json::from_slice(&request.body).unwrap_or(Value::Null);
        let mut call = Call { studio: self, service, request, path: &rest, json, fault: None };
        let fingerprint = fingerprint(request);
        // Work is what can go wrong: asking whether a service is there works always.
        if request.method == "POST" {
            let before = self.ledger.seen(&fingerprint);
            let part = part_of(&call);
            call.fault = self.options.faults.fault(part, fingerprint.as_bytes(), before);
        }
        let mut made = match early(&call) {
            Some(made) => made,
            None => self.serve(&call).await,
        };
        let fault = call.fault;
        if let Some(fault) = fault {
            deliver(&mut made, fault);
        }
        if request.method != "POST" {
            return (made.reply, 0);
        }
        let entry = Entry {
            service: service.prefix(),
            part: made.part,
            fingerprint,
            status: made.reply.status,
            fault,
            tokens: made.tokens,
            usable: made.usable && fault.is_none_or(Fault::is_harmless),
            whole: None,
        };
        (made.reply, self.ledger.add(entry))
    }

    async fn serve(&self, call: &Call<'_>) -> Made {
        if let Some(pace) = self.options.pace.filter(|_| call.request.method == "POST") {
            tokio::time::sleep(call.takes(pace)).await;
        }
        match call.service {
            Service::OpenAi if call.path == "/v1/images/edits" => edits::openai(call).await,
            Service::OpenAi | Service::Vllm | Service::LlamaCpp => openai::serve(call).await,
            Service::Gemini => google::serve(call).await,
            Service::Anthropic => anthropic::serve(call).await,
            Service::SdServer => edits::sd_server(call).await,
            Service::Hunyuan2 | Service::Hunyuan21 => meshes::hunyuan(call, &self.jobs).await,
            Service::TrellisNim | Service::TrellisLocalAi => meshes::trellis(call).await,
            Service::Fal | Service::Replicate | Service::Tripo | Service::Meshy => {
                hosted::serve(call, &self.tasks).await
            }
            Service::LocateAnything => detectors::locate(call).await,
            Service::GroundingDino => detectors::grounding(call).await,
        }
    }
}

impl Play for Services {
    async fn play(&self, request: Request) -> (Reply, u64) {
        self.answer(&request).await
    }

    fn sent(&self, number: u64, whole: bool) {
        self.ledger.sent(number, whole);
    }
}

fn part_of(call: &Call<'_>) -> Part {
    match call.service {
        Service::OpenAi if call.path.ends_with("/images/edits") => Part::Editor,
        Service::Gemini if google::wants_images(&call.json) => Part::Editor,
        Service::OpenAi | Service::Gemini | Service::Anthropic | Service::Vllm | Service::LlamaCpp => Part::Language,
        Service::SdServer => Part::Editor,
        Service::Hunyuan2 | Service::Hunyuan21 | Service::TrellisNim | Service::TrellisLocalAi => Part::Mesh,
        Service::Fal | Service::Replicate | Service::Tripo | Service::Meshy => Part::HostedMesh,
        Service::LocateAnything | Service::GroundingDino => Part::Detector,
    }
}

/// Hash of what is asked for. The boundary of a form is not part of it.
fn fingerprint(request: &Request) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(request.path.as_bytes());
    let boundary = request.header("content-type").and_then(form::boundary);
    match boundary {
        Some(boundary) => {
            for part in form::parts(&request.body, boundary) {
                hasher.update(part.name.as_bytes());
                hasher.update(part.content);
            }
        }
        None => {
            hasher.update(&request.body);
        }
    }
    hasher.finalize().to_hex().chars().take(16).collect()
}

/// Faults that need no answer.
fn early(call: &Call<'_>) -> Option<Made> {
    let part = part_of(call);
    let made = |reply| Some(Made::free(part, reply));
    if part == Part::HostedMesh
        && let Some(reply) = hosted::refusal(call.service, call.fault?)
    {
        return made(reply);
    }
    match call.fault? {
        Fault::RateLimited => made(refused(call, 429, "rate_limit_exceeded", "Rate limit reached.", None)),
        Fault::RateLimitedWait => {
            made(refused(call, 429, "rate_limit_exceeded", "Rate limit reached.", Some(Duration::from_millis(40))))
        }
        Fault::RateLimitedLong => {
            made(refused(call, 429, "rate_limit_exceeded", "Rate limit reached.", Some(Duration::from_hours(1))))
        }
        Fault::AccountSpent => {
            let status = if call.service == Service::Gemini { 402 } else { 429 };
            made(refused(call, status, "insufficient_quota", "You exceeded your current quota.", None))
        }
        Fault::ServerError => made(refused(call, 500, "server_error", "The server had an error.", None)),
        Fault::Overloaded => {
            let status = if call.service == Service::Anthropic { 529 } else { 503 };
            made(refused(call, status, "server_is_overloaded", "Overloaded.", None))
        }
        Fault::Redirect => made(
            Reply::bytes(307, "text/html", vec![])
                .header("location", format!("{}{}", call.studio.elsewhere, call.path)),
        ),
        Fault::Close | Fault::Silence | Fault::Huge => {
            let mut reply = Reply::bytes(200, "application/json", vec![]);
            reply.delivery = match call.fault {
                Some(Fault::Close) => Delivery::Close,
                Some(Fault::Silence) => Delivery::Silence,
                _ => Delivery::Endless(HUGE),
            };
            made(reply)
        }
        _ => None,
    }
}

/// An error in the form of the service, and how long to wait where it says so.
fn refused(call: &Call<'_>, status: u16, code: &str, message: &str, wait: Option<Duration>) -> Reply {
    match call.service {
        Service::OpenAi => openai::error(status, code, message, wait),
        Service::Gemini => google::error(status, message, wait),
        Service::Anthropic => anthropic::error(status, code, message, wait),
        // Every failure of the old server is a 404 (mesh sheet, section 1).
        Service::Hunyuan2 if status != 429 => meshes::hunyuan_error(message),
        _ => {
            let reply = Reply::json(status, &json!({"error": {"message": message, "code": status}}));
            match wait {
                Some(wait) => reply.header("retry-after", wait.as_secs_f64()),
                None => reply,
            }
        }
    }
}

/// Faults of the way rather than of the answer.
fn deliver(made: &mut Made, fault: Fault) {
    let reply = &mut made.reply;
    match fault {
        Fault::Slow => reply.delivery = Delivery::Slow(8, Duration::from_millis(15)),
        Fault::Stall => reply.delivery = Delivery::Stall(100),
        Fault::Reset => reply.delivery = Delivery::Reset(100),
        Fault::CutOff => reply.delivery = Delivery::CutOff(160),
        Fault::CutBody => {
            let half = reply.body.len() / 2;
            reply.body = Arc::new(reply.body[..half].to_vec());
        }
        Fault::NotJson => {
            *reply = Reply::bytes(200, "text/html", b"<html><body>502 Bad Gateway \xff\xfe</body></html>".to_vec());
        }
        _ => {}
    }
}

/// Why a service does not think at all.
pub(crate) enum NoThought {
    /// The request is not accepted.
    Bad(String),
    /// A fault of the studio itself.
    Own(String),
}

/// A model's thoughts: the text of an answer to a prompt with pictures, in the form of a schema.
///
/// The schema is checked as the service checks it, every picture must be one.
pub(crate) async fn think(
    call: &Call<'_>,
    prompt: &str,
    pictures: &[Vec<u8>],
    schema: &Value,
    rules: Rules,
) -> Result<String, NoThought> {
    strict::check(schema, rules).map_err(NoThought::Bad)?;
    for picture in pictures {
        looked_at(picture).map_err(NoThought::Bad)?;
    }
    let asked = reading::read(prompt).ok_or_else(|| NoThought::Own("the studio does not know this question".into()))?;
    let value = call.studio.truth_oracle.answer(&asked).await.map_err(NoThought::Own)?;
    let mut value = strict::fitted(schema, &value);
    let complaints = schema_complaints(schema, &value);
    if !complaints.is_empty() {
        return Err(NoThought::Own(format!("the studio's own answer does not fit: {}", complaints.join("; "))));
    }
    match call.fault {
        Some(Fault::SchemaViolation) => violate(&mut value),
        Some(Fault::UnicodeNames) => rename(&mut value, ""),
        _ => {}
    }
    let mut text = value.to_string();
    if call.is(Fault::CutAnswer) {
        let mut half = text.len() / 2;
        while !text.is_char_boundary(half) {
            half -= 1;
        }
        text.truncate(half);
    }
    Ok(text)
}

/// The pixels of a picture that was sent.
pub(crate) fn looked_at(file: &[u8]) -> Result<DynamicImage, String> {
    harmony_io::picture::decode(file).map_err(|error| format!("Invalid image: {error}"))
}

/// Colours only.
pub(crate) fn rgb(file: &[u8]) -> Result<RgbImage, String> {
    Ok(looked_at(file)?.to_rgb8())
}

/// Input and output tokens as a service counts them, roughly: a token is four characters, a picture 1000 tokens.
pub(crate) fn tokens(prompt: &str, pictures: usize, text: &str) -> (u64, u64) {
    ((prompt.len() / 4 + 1000 * pictures) as u64, (text.len() / 4 + 1) as u64)
}

/// Breaks the promise of a schema: the first property is of another type and a foreign one is added.
fn violate(value: &mut Value) {
    if let Some(map) = value.as_object_mut() {
        if let Some(first) = map.keys().next().cloned() {
            map.insert(first, json!({"not": ["what", "was", "asked"]}));
        }
        map.insert("surprise".into(), json!(1e300));
    }
}

/// Puts other scripts into names and descriptions.
fn rename(value: &mut Value, key: &str) {
    match value {
        Value::String(text)
            if matches!(key, "type" | "description" | "room_type" | "scene_summary" | "matched_set") =>
        {
            *text = format!("\u{202e}{text} 🪑 стул 椅子 é\u{301}\u{200d}");
        }
        Value::Array(items) => items.iter_mut().for_each(|item| rename(item, key)),
        Value::Object(map) => map.iter_mut().for_each(|(key, value)| rename(value, key)),
        _ => {}
    }
}
