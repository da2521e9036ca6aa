//! The page and its answers over HTTP.
//!
//! | request | what |
//! |---|---|
//! | `GET /`, `GET /pictures/...` | the site; only files that the page lists are served |
//! | `GET /api/study` | name and version, whether people without an invitation may take part |
//! | `POST /api/enrol` | a new code and its key, where the study is open |
//! | `POST /api/begin` | for an invitation: tokens for all trials, and what is stored already |
//! | `POST /api/answer` | an answer with its token; acknowledged when it is on the disk |
//! | `POST /api/finish` | hands in |
//!
//! Neither addresses nor user agents nor times are stored or logged. There is no TLS: on another address than loopback
//! it belongs behind a proxy that has it.

use std::collections::{BTreeMap, BTreeSet};
use std::future::Future;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path as UrlPath, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::Response;
use axum::routing::{get, post};
use axum::{Router, middleware};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rand::Rng as _;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

use crate::log::{Entry, Log, NotStored, Stored, Via};
use crate::page::data_of;
use crate::private::{PrivateStudy, hex};
use crate::record::{Answer, MAX_ANSWER_BYTES, Refusal, is_participant};
use crate::{StudyError, build};

/// Connections at one time.
const CONNECTIONS: usize = 2048;
/// Longest time for the head of a request.
const HEAD_TIMEOUT: Duration = Duration::from_secs(15);
/// Longest time for a request's body and its answer.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(30);

/// A site that is served.
#[derive(Debug, Clone)]
pub struct Site {
    index: Bytes,
    pictures: BTreeMap<String, PathBuf>,
}

impl Site {
    /// Reads a site and checks that it belongs to the study.
    ///
    /// # Errors
    /// No site, or another study's.
    pub fn open(folder: &Path, study: &PrivateStudy) -> Result<Self, StudyError> {
        let path = folder.join("index.html");
        let index = harmony_io::read_bounded(&path, 4 << 30)?;
        let other = |found: String| StudyError::OtherStudy {
            path: path.clone(),
            found,
            wanted: format!("{} (version {})", study.study, study.version),
        };
        let data = data_of(&String::from_utf8_lossy(&index)).ok_or_else(|| other("no study".to_owned()))?;
        if data.study != study.study || data.version != study.version {
            return Err(other(format!("{} (version {})", data.study, data.version)));
        }
        let listed = data.trials.into_iter().flat_map(|t| {
            t.panels.into_iter().flat_map(|p| p.views).chain(std::iter::once(t.photo)).collect::<Vec<_>>()
        });
        let pictures = listed
            .filter_map(|path| {
                let name = path.strip_prefix("pictures/")?.to_owned();
                let plain = name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'.');
                plain.then(|| (name.clone(), folder.join("pictures").join(name)))
            })
            .collect();
        Ok(Self { index: index.into(), pictures })
    }
}

/// How a study is served.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ServeOptions {
    /// So many people without an invitation may take part.
    pub open: usize,
}

struct App {
    site: Site,
    study: PrivateStudy,
    trials: BTreeSet<String>,
    log: Log,
    open: usize,
    enrolled: AtomicUsize,
}

/// Serves a study until `until` is over; requests in flight are answered first.
pub async fn serve(
    listener: TcpListener,
    site: Site,
    study: PrivateStudy,
    log: Log,
    options: ServeOptions,
    until: impl Future<Output = ()>,
) {
    let enrolled = log.counts().await.map_or(0, |(participants, _)| participants);
    let trials = study.trials.iter().map(|t| t.id.clone()).collect();
    let app = Arc::new(App { site, study, trials, log, open: options.open, enrolled: AtomicUsize::new(enrolled) });
    let router = Router::new()
        .route("/", get(index))
        .route("/index.html", get(index))
        .route("/pictures/{name}", get(picture))
        .route("/api/study", get(about))
        .route("/api/enrol", post(enrol))
        .route("/api/begin", post(begin))
        .route("/api/answer", post(answer))
        .route("/api/finish", post(finish))
        .layer(DefaultBodyLimit::max(MAX_ANSWER_BYTES))
        .layer(middleware::map_response(guarded))
        .with_state(app);
    let places = Arc::new(Semaphore::new(CONNECTIONS));
    let (closing, closed) = tokio::sync::watch::channel(());
    tokio::pin!(until);
    loop {
        let Ok(place) = Arc::clone(&places).acquire_owned().await else { break };
        let stream = tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => stream,
                Err(error) => {
                    // Out of file handles, for one: others will be given back.
                    tracing::warn!(%error, "a connection could not be accepted");
                    tokio::time::sleep(Duration::from_millis(50)).await;
                    continue;
                }
            },
            () = &mut until => break,
        };
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(router.clone());
        let mut closed = closed.clone();
        tokio::spawn(async move {
            let _place = place;
            let connection = hyper::server::conn::http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEAD_TIMEOUT)
                .serve_connection(TokioIo::new(stream), service);
            tokio::pin!(connection);
            let over = tokio::select! {
                ended = connection.as_mut() => Some(ended),
                _ = closed.changed() => None,
            };
            if over.is_none() {
                connection.as_mut().graceful_shutdown();
                let _ = tokio::time::timeout(REQUEST_TIMEOUT, connection).await;
            }
        });
    }
    drop(closing);
    // Every connection gives its place back.
    let _ = tokio::time::timeout(REQUEST_TIMEOUT, places.acquire_many(CONNECTIONS as u32)).await;
}

/// Headers of every response.
async fn guarded(mut response: Response) -> Response {
    let headers = response.headers_mut();
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "no-referrer"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

fn reply(status: StatusCode, kind: &'static str, body: impl Into<Body>) -> Response {
    let mut response = Response::new(body.into());
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    response
}

fn say(status: StatusCode, value: &Value) -> Response {
    reply(status, "application/json", value.to_string())
}

fn refuse(status: StatusCode, why: &(impl ToString + ?Sized)) -> Response {
    say(status, &json!({ "error": why.to_string() }))
}

async fn index(State(app): State<Arc<App>>) -> Response {
    reply(StatusCode::OK, "text/html; charset=utf-8", app.site.index.clone())
}

async fn picture(State(app): State<Arc<App>>, UrlPath(name): UrlPath<String>) -> Response {
    let Some(path) = app.site.pictures.get(&name) else {
        return refuse(StatusCode::NOT_FOUND, "the page shows no such picture");
    };
    match tokio::fs::read(path).await {
        Ok(bytes) => {
            let mut response = reply(StatusCode::OK, "image/jpeg", bytes);
            let forever = HeaderValue::from_static("private, max-age=86400, immutable");
            response.headers_mut().insert(header::CACHE_CONTROL, forever);
            response
        }
        Err(_) => refuse(StatusCode::NOT_FOUND, "the picture is not there"),
    }
}

async fn about(State(app): State<Arc<App>>) -> Response {
    let value = json!({ "study": app.study.study, "version": app.study.version, "open": app.open > 0 });
    say(StatusCode::OK, &value)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Who {
    study: String,
    participant: String,
    key: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Posted {
    token: String,
    answer: Answer,
}

async fn enrol(State(app): State<Arc<App>>) -> Response {
    let taken = app.enrolled.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| (n < app.open).then_some(n + 1));
    if taken.is_err() {
        return refuse(StatusCode::FORBIDDEN, "this study takes people with an invitation only");
    }
    let mut bytes = [0_u8; 32];
    rand::rng().fill(&mut bytes);
    let participant = build::code(&hex(&bytes), 0);
    let key = app.study.invitation(&participant);
    say(StatusCode::OK, &json!({ "participant": participant, "key": key }))
}

/// Who asks, if the invitation is genuine.
#[expect(clippy::result_large_err, reason = "the answer to send is axum's")]
fn invited(app: &App, body: &[u8]) -> Result<Who, Response> {
    let who: Who = serde_json::from_slice(body)
        .map_err(|e| refuse(StatusCode::BAD_REQUEST, &Refusal::Malformed(e.to_string())))?;
    if who.study != app.study.study {
        return Err(refuse(StatusCode::CONFLICT, &Refusal::OtherStudy));
    }
    if !is_participant(&who.participant) {
        return Err(refuse(StatusCode::BAD_REQUEST, &Refusal::Participant));
    }
    if !app.study.invited(&who.participant, &who.key) {
        return Err(refuse(StatusCode::FORBIDDEN, "this is no invitation to this study"));
    }
    Ok(who)
}

async fn begin(State(app): State<Arc<App>>, body: Bytes) -> Response {
    let who = match invited(&app, &body) {
        Ok(who) => who,
        Err(response) => return response,
    };
    let Some(seen) = app.log.seen(&who.participant).await else {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, &NotStored::Closed);
    };
    let tokens: BTreeMap<&String, String> =
        app.trials.iter().map(|t| (t, app.study.token(&who.participant, t))).collect();
    say(StatusCode::OK, &json!({ "tokens": tokens, "answers": seen.answers, "finished": seen.finished }))
}

async fn answer(State(app): State<Arc<App>>, body: Bytes) -> Response {
    let posted: Posted = match serde_json::from_slice(&body) {
        Ok(posted) => posted,
        Err(e) => return refuse(StatusCode::BAD_REQUEST, &Refusal::Malformed(e.to_string())),
    };
    // The signature first: to others the study tells nothing about its trials.
    if !app.study.signed(&posted.answer.participant, &posted.answer.trial, &posted.token) {
        return refuse(StatusCode::FORBIDDEN, &Refusal::Forged);
    }
    if let Err(refusal) = posted.answer.check(&app.study) {
        return refuse(status_of(&refusal), &refusal);
    }
    let revision = posted.answer.revision;
    stored(app.log.append(Entry::Answer { answer: posted.answer, via: Via::Server }).await, revision)
}

async fn finish(State(app): State<Arc<App>>, body: Bytes) -> Response {
    match invited(&app, &body) {
        Ok(who) => stored(app.log.append(Entry::Finish { participant: who.participant }).await, 0),
        Err(response) => response,
    }
}

fn stored(outcome: Result<Stored, NotStored>, revision: u32) -> Response {
    match outcome {
        Ok(stored) => {
            say(StatusCode::OK, &json!({ "stored": true, "new": stored == Stored::New, "revision": revision }))
        }
        Err(NotStored::Refused(refusal)) => refuse(status_of(&refusal), &refusal),
        Err(error @ NotStored::Full) => refuse(StatusCode::INSUFFICIENT_STORAGE, &error),
        Err(error) => refuse(StatusCode::SERVICE_UNAVAILABLE, &error),
    }
}

fn status_of(refusal: &Refusal) -> StatusCode {
    match refusal {
        Refusal::Forged => StatusCode::FORBIDDEN,
        Refusal::Trial => StatusCode::NOT_FOUND,
        Refusal::OtherStudy | Refusal::Doubled | Refusal::Closed => StatusCode::CONFLICT,
        Refusal::Full => StatusCode::INSUFFICIENT_STORAGE,
        _ => StatusCode::BAD_REQUEST,
    }
}
