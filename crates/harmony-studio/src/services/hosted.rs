//! Hosted mesh generators: fal.ai, Replicate, Tripo, Meshy.
//!
//! Quirks, as the players' modules give their sources (`harmony-players/src/mesh/hosted`):
//! - fal: the key is sent as `Key`; a task is asked for at owner and app only; states before the end come with 202; what
//!   the model said comes with the result; a used-up account is a 403;
//! - Replicate: large `data:` URLs are refused, files can be uploaded; a used-up account is a 402;
//! - Tripo: pictures are uploaded first; everything stands in `data`, every error has a number; each look gives a fresh link;
//!   the front is +X;
//! - Meshy: a new task is answered with 202; each look gives a fresh link;
//! - links are signed: a request to one that carries a key is refused, as object stores do.

use std::collections::HashMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use tokio::time::Instant;

use super::form::{boundary, parts};
use super::{Call, Made, Service, looked_at, meshes};
use crate::faults::{Fault, Part};
use crate::http::{Delivery, Reply};

/// Looks at a task that find it waiting, then at work.
const WAITING_LOOKS: usize = 1;
const WORKING_LOOKS: usize = 3;

/// Looks that fail, and fetches that are cut off, where that is the fault.
const BROKEN: usize = 2;

/// Largest `data:` URL that Replicate takes, characters.
const INLINE: usize = 360_000;

/// Tasks and uploads of all four.
#[derive(Default)]
pub(crate) struct Tasks {
    tasks: Mutex<HashMap<String, Task>>,
    uploads: Mutex<HashMap<String, Vec<u8>>>,
}

struct Task {
    service: Service,
    /// Owner and app, for fal.
    app: String,
    /// The file, or why there is none.
    file: Result<Arc<Vec<u8>>, String>,
    fault: Option<Fault>,
    /// Not done before.
    due: Instant,
    looks: usize,
    fetches: usize,
}

impl Tasks {
    fn tasks(&self) -> MutexGuard<'_, HashMap<String, Task>> {
        self.tasks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn uploads(&self) -> MutexGuard<'_, HashMap<String, Vec<u8>>> {
        self.uploads.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn free(reply: Reply) -> Made {
    Made::free(Part::HostedMesh, reply)
}

/// A service's way to say no.
fn no(service: Service, status: u16, code: u64, message: &str) -> Reply {
    let body = match service {
        Service::Tripo => json!({"code": code, "message": message, "suggestion": "look at the documentation"}),
        Service::Meshy => json!({"message": message}),
        Service::Replicate => json!({"title": message, "detail": message, "status": status}),
        _ => json!({"detail": message}),
    };
    Reply::json(status, &body)
}

/// Refusals that need no look at the request.
pub(super) fn refusal(service: Service, fault: Fault) -> Option<Reply> {
    let limited = |wait: Option<Duration>| {
        let reply = no(service, 429, 2000, "Too many requests");
        wait.map_or(reply.clone(), |wait| reply.header("retry-after", wait.as_secs_f64()))
    };
    Some(match fault {
        Fault::RateLimited => limited(None),
        Fault::RateLimitedWait => limited(Some(Duration::from_millis(40))),
        Fault::RateLimitedLong => limited(Some(Duration::from_hours(1))),
        Fault::AccountSpent => match service {
            Service::Fal => no(
                service,
                403,
                0,
                "User is locked. Reason: Exhausted balance. Top up your balance at fal.ai/dashboard/billing.",
            ),
            Service::Tripo => no(service, 403, 2010, "You need more credits to start a new task."),
            _ => no(service, 402, 0, "Insufficient credit"),
        },
        Fault::ServerError => no(service, 500, 1000, "Internal server error"),
        Fault::Overloaded => no(service, 503, 1001, "Service unavailable"),
        _ => return None,
    })
}

/// Whether the key is there, in the service's way.
fn is_known(call: &Call<'_>) -> bool {
    let scheme = if call.service == Service::Fal { "Key " } else { "Bearer " };
    let key = call.request.header("authorization").and_then(|value| value.strip_prefix(scheme));
    key == Some(call.studio.options.key.as_str())
}

pub(crate) async fn serve(call: &Call<'_>, tasks: &Tasks) -> Made {
    if let Some(file) = call.path.strip_prefix("/files/").filter(|_| call.request.method == "GET") {
        return free(fetched(call, tasks, file));
    }
    if !is_known(call) {
        return free(match call.service {
            Service::Fal => no(call.service, 401, 0, "Cannot access application. Authentication is required."),
            Service::Replicate => no(call.service, 401, 0, "You did not pass a valid authentication token"),
            Service::Tripo => no(call.service, 401, 1002, "Authentication failed"),
            _ => no(call.service, 401, 0, "Invalid API key"),
        });
    }
    let post = call.request.method == "POST";
    let path = call.path;
    match call.service {
        Service::Fal => fal(call, tasks).await,
        Service::Replicate => match path {
            "/v1/account" => free(Reply::json(200, &json!({"type": "organization", "username": "studio"}))),
            "/v1/files" if post => free(upload(call, tasks, "content")),
            "/v1/predictions" if post => replicate(call, tasks).await,
            _ => match path.strip_prefix("/v1/predictions/") {
                Some(id) if post => match id.strip_suffix("/cancel") {
                    Some(id) => free(cancel(call, tasks, id)),
                    None => free(no(call.service, 404, 0, "Not found")),
                },
                Some(id) => free(look(call, tasks, id)),
                None => free(no(call.service, 404, 0, "Not found")),
            },
        },
        Service::Tripo => match path {
            "/v2/openapi/user/balance" => {
                free(Reply::json(200, &json!({"code": 0, "data": {"balance": 480, "frozen": 0}})))
            }
            "/v2/openapi/upload/sts" if post => free(upload(call, tasks, "file")),
            "/v2/openapi/task" if post => tripo(call, tasks).await,
            _ => match path.strip_prefix("/v2/openapi/task/") {
                Some(id) if !post => free(look(call, tasks, id)),
                _ => free(no(call.service, 404, 1004, "Not found")),
            },
        },
        _ => match path {
            "/openapi/v1/balance" => free(Reply::json(200, &json!({"balance": 1000}))),
            "/openapi/v1/image-to-3d" if post => meshy(call, tasks).await,
            _ => match path.strip_prefix("/openapi/v1/image-to-3d/") {
                Some(id) if !post => free(look(call, tasks, id)),
                _ => free(no(call.service, 404, 0, "Not found")),
            },
        },
    }
}

/// The picture of a `data:` URL or of an upload.
fn picture(tasks: &Tasks, given: &Value) -> Option<Vec<u8>> {
    let given = given.as_str()?;
    if let Some(data) = given.strip_prefix("data:image/png;base64,") {
        return STANDARD.decode(data).ok();
    }
    let id = given.rsplit('/').next()?;
    tasks.uploads().get(id).cloned()
}

/// Takes a file of a form.
fn upload(call: &Call<'_>, tasks: &Tasks, field: &str) -> Reply {
    let kind = call.request.header("content-type").unwrap_or_default();
    let file = boundary(kind)
        .and_then(|boundary| parts(&call.request.body, boundary).into_iter().find(|part| part.name == field))
        .map(|part| part.content.to_vec());
    let Some(file) = file.filter(|file| looked_at(file).is_ok()) else {
        return no(call.service, 400, 2003, "The input file is empty.");
    };
    // The same file gives the same token, so that the same work has the same fingerprint.
    let id = blake3::hash(&file).to_hex()[..24].to_owned();
    tasks.uploads().insert(id.clone(), file);
    if call.service == Service::Tripo {
        return Reply::json(200, &json!({"code": 0, "data": {"image_token": id}}));
    }
    let url = format!("{}/replicate/v1/files/{id}", call.studio.own);
    Reply::json(201, &json!({"id": id, "urls": {"get": url}}))
}

/// Makes a task of a picture; its id, and whether something usable comes of it: what a task that fails by itself may have
/// cost (Replicate charges time) bought nothing, and asking again is not paying for the same twice. The file is made at
/// once and given out later.
async fn make(call: &Call<'_>, tasks: &Tasks, app: &str, picture: &[u8]) -> (String, bool) {
    let front_is_x = call.service == Service::Tripo;
    // Our +Z is its +X.
    let turned: fn(glam::Vec3) -> glam::Vec3 = if front_is_x { |p| glam::Vec3::new(p.z, p.y, -p.x) } else { |p| p };
    let file = meshes::file_of(call, picture, turned).await;
    let usable = file.is_ok();
    let mut all = tasks.tasks();
    let id = format!("{}-{}", &blake3::hash(&call.request.body).to_hex()[..20], all.len());
    let due = Instant::now() + call.studio.options.pace.map_or(Duration::ZERO, |pace| pace.mesh);
    let task = Task { service: call.service, app: app.to_owned(), file, fault: call.fault, due, looks: 0, fetches: 0 };
    all.insert(id.clone(), task);
    call.studio.ledger.tasks.fetch_add(1, Ordering::Relaxed);
    (id, usable)
}

/// The answer to a new task.
fn made(usable: bool, status: u16, body: &Value) -> Made {
    let reply = Reply::json(status, body);
    if usable { Made::paid(Part::HostedMesh, reply, (0, 0)) } else { free(reply) }
}

/// The first of these numbers that is outside of its range.
fn outside<'a>(body: &Value, ranges: &[(&'a str, f64, f64)]) -> Option<&'a str> {
    let out = |name: &str, low: f64, high: f64| body[name].as_f64().is_some_and(|v| !(low..=high).contains(&v));
    ranges.iter().find(|(name, low, high)| out(name, *low, *high)).map(|(name, ..)| *name)
}

async fn fal(call: &Call<'_>, tasks: &Tasks) -> Made {
    let mut names = call.path.trim_matches('/').splitn(3, '/');
    let app = format!("{}/{}", names.next().unwrap_or_default(), names.next().unwrap_or_default());
    let rest = names.next().unwrap_or_default();
    if call.request.method != "POST" {
        return free(match rest.strip_prefix("requests/").map(|rest| rest.split_once('/').unwrap_or((rest, ""))) {
            Some((id, what)) => fal_task(call, tasks, &app, id, what),
            None => no(call.service, 404, 0, "Not found"),
        });
    }
    let field = if app == "fal-ai/hunyuan3d" { "input_image_url" } else { "image_url" };
    let wrong = |name: &str, kind: &str, message: &str| {
        let detail = json!({"detail": [{"loc": ["body", name], "msg": message, "type": kind}]});
        free(Reply::json(422, &detail))
    };
    let ranges = [
        ("ss_sampling_steps", 1.0, 50.0),
        ("slat_sampling_steps", 1.0, 50.0),
        ("num_inference_steps", 1.0, 50.0),
        ("octree_resolution", 1.0, 1024.0),
    ];
    if let Some(name) = outside(&call.json, &ranges) {
        return wrong(name, "less_than_equal", "Input should be in range");
    }
    let Some(picture) = picture(tasks, &call.json[field]).filter(|file| looked_at(file).is_ok()) else {
        return wrong(field, "file_download_error", "Failed to download the file.");
    };
    let (id, usable) = make(call, tasks, &app, &picture).await;
    let at = format!("{}/fal/{app}/requests/{id}", call.studio.own);
    let body = json!({
        "status": "IN_QUEUE", "request_id": id, "response_url": at, "queue_position": 0,
        "status_url": format!("{at}/status"), "cancel_url": format!("{at}/cancel"),
    });
    made(usable, 200, &body)
}

/// State, result and cancellation of a task at fal.
fn fal_task(call: &Call<'_>, tasks: &Tasks, app: &str, id: &str, what: &str) -> Reply {
    if call.request.method == "PUT" && what == "cancel" {
        return cancel(call, tasks, id);
    }
    let mut all = tasks.tasks();
    let Some(task) = all.get_mut(id).filter(|task| task.service == Service::Fal && task.app == app) else {
        return no(call.service, 404, 0, "Request not found");
    };
    if what == "status" {
        task.looks += 1;
        if let Some(broken) = broken_look(call.service, task) {
            return broken;
        }
        return match state(task) {
            State::Waiting => Reply::json(202, &json!({"status": "IN_QUEUE", "request_id": id, "queue_position": 1})),
            State::Working => Reply::json(202, &json!({"status": "IN_PROGRESS", "request_id": id})),
            State::Failed(error) => {
                let body =
                    json!({"status": "COMPLETED", "request_id": id, "error": error, "error_type": "internal_error"});
                Reply::json(200, &body)
            }
            State::Refused | State::Done => Reply::json(200, &json!({"status": "COMPLETED", "request_id": id})),
        };
    }
    match state(task) {
        State::Done => {
            let file =
                json!({"url": link(call, id, task), "content_type": "model/gltf-binary", "file_name": "model.glb"});
            Reply::json(200, &json!({"model_mesh": file, "seed": 1}))
        }
        State::Refused => {
            let one = json!({"loc": ["body", "image_url"], "msg": "The content could not be processed.",
                             "type": "content_policy_violation"});
            Reply::json(422, &json!({"detail": [one]}))
        }
        State::Failed(error) => no(call.service, 500, 0, &error),
        State::Waiting | State::Working => no(call.service, 400, 0, "Request is still in progress"),
    }
}

async fn replicate(call: &Call<'_>, tasks: &Tasks) -> Made {
    let input = &call.json["input"];
    let invalid = |message: &str| free(no(call.service, 422, 0, message));
    let Some(version) = call.json["version"].as_str().filter(|version| version.contains(':')) else {
        return invalid("- version is required");
    };
    if outside(input, &[("steps", 20.0, 50.0), ("ss_sampling_steps", 1.0, 50.0)]).is_some() {
        return invalid("- input.steps: Must be between 20 and 50");
    }
    let given = if version.contains("trellis") { &input["images"][0] } else { &input["image"] };
    if given.as_str().is_some_and(|given| given.starts_with("data:") && given.len() > INLINE) {
        return invalid("- input.image: the data URL is too large, upload the file");
    }
    let Some(picture) = picture(tasks, given).filter(|file| looked_at(file).is_ok()) else {
        return invalid("- input.image: Does not match format 'uri'");
    };
    let (id, usable) = make(call, tasks, "", &picture).await;
    made(usable, 201, &json!({"id": id, "status": "starting", "output": null, "error": null}))
}

async fn tripo(call: &Call<'_>, tasks: &Tasks) -> Made {
    let body = &call.json;
    if body["type"] != "image_to_model" {
        return free(no(call.service, 400, 2002, "The task type is unsupported."));
    }
    let versions = ["Turbo-v1.0-20250506", "v3.0-20250812", "v2.5-20250123", "v2.0-20240919"];
    if !body["model_version"].as_str().is_none_or(|version| versions.contains(&version)) {
        return free(no(call.service, 400, 2017, "Invalid model version."));
    }
    let Some(picture) = picture(tasks, &body["file"]["file_token"]) else {
        return free(no(call.service, 404, 2019, "File not found."));
    };
    let (id, usable) = make(call, tasks, "", &picture).await;
    made(usable, 200, &json!({"code": 0, "data": {"task_id": id}}))
}

async fn meshy(call: &Call<'_>, tasks: &Tasks) -> Made {
    let body = &call.json;
    let invalid = |message: &str| free(no(call.service, 400, 0, message));
    if !matches!(body["ai_model"].as_str(), None | Some("meshy-5" | "meshy-6" | "meshy-7" | "latest")) {
        return invalid("Invalid values: AIModel must be one of the models");
    }
    if outside(body, &[("target_polycount", 100.0, 300_000.0)]).is_some() {
        return invalid("Invalid values: TargetPolycount must be 100 to 300000");
    }
    let Some(picture) = picture(tasks, &body["image_url"]).filter(|file| looked_at(file).is_ok()) else {
        return invalid("Image_url is not a valid image");
    };
    let (id, usable) = make(call, tasks, "", &picture).await;
    made(usable, 202, &json!({"result": id}))
}

/// How a task is.
enum State {
    Waiting,
    Working,
    Refused,
    Failed(String),
    Done,
}

fn state(task: &Task) -> State {
    let looks = task.looks - if task.fault == Some(Fault::BrokenLooks) { task.looks.min(BROKEN) } else { 0 };
    if task.fault == Some(Fault::TaskStuck) || (WAITING_LOOKS + 1..WORKING_LOOKS).contains(&looks) {
        return State::Working;
    }
    if looks <= WAITING_LOOKS {
        return State::Waiting;
    }
    if Instant::now() < task.due {
        return State::Working;
    }
    match (task.fault, &task.file) {
        (Some(Fault::TaskRefused), _) => State::Refused,
        (Some(Fault::TaskFailed), _) => State::Failed("CUDA out of memory".to_owned()),
        (_, Err(error)) => State::Failed(error.clone()),
        (_, Ok(_)) => State::Done,
    }
}

/// The answer to a look that fails.
fn broken_look(service: Service, task: &Task) -> Option<Reply> {
    let broken = task.fault == Some(Fault::BrokenLooks) && task.looks <= BROKEN;
    broken.then(|| match task.looks {
        1 => no(service, 503, 1001, "Service unavailable"),
        _ => Reply { delivery: Delivery::Close, ..no(service, 500, 1000, "closed") },
    })
}

/// A look at a task of the others.
fn look(call: &Call<'_>, tasks: &Tasks, id: &str) -> Reply {
    let mut all = tasks.tasks();
    let Some(task) = all.get_mut(id).filter(|task| task.service == call.service) else {
        return no(call.service, 404, 2001, "Task not found.");
    };
    task.looks += 1;
    if let Some(broken) = broken_look(call.service, task) {
        return broken;
    }
    let task = &*task;
    let link = link(call, id, task);
    let body = match call.service {
        Service::Replicate => match state(task) {
            State::Waiting => json!({"id": id, "status": "starting"}),
            State::Working => json!({"id": id, "status": "processing"}),
            State::Refused => {
                json!({"id": id, "status": "failed", "error": "NSFW content detected. Try another image."})
            }
            State::Failed(error) => json!({"id": id, "status": "failed", "error": error}),
            State::Done => json!({"id": id, "status": "succeeded", "output": {"model_file": link, "mesh": link},
                                     "metrics": {"predict_time": 31.4}}),
        },
        Service::Tripo => {
            let data = match state(task) {
                State::Waiting => json!({"status": "queued", "progress": 0, "output": {}}),
                State::Working => json!({"status": "running", "progress": 60, "output": {}}),
                State::Refused => json!({"status": "banned", "output": {}}),
                State::Failed(error) => {
                    json!({"status": "failed", "error_code": 1000, "error_msg": error, "output": {}})
                }
                State::Done => json!({"status": "success", "progress": 100, "output": {"pbr_model": link},
                                         "consumed_credit": 30}),
            };
            json!({"code": 0, "data": data})
        }
        _ => match state(task) {
            State::Waiting => json!({"id": id, "status": "PENDING", "progress": 0}),
            State::Working => json!({"id": id, "status": "IN_PROGRESS", "progress": 60}),
            State::Refused => json!({"id": id, "status": "FAILED",
                                     "task_error": {"message": "The image was rejected by content moderation."}}),
            State::Failed(error) => json!({"id": id, "status": "FAILED", "task_error": {"message": error}}),
            State::Done => json!({"id": id, "status": "SUCCEEDED", "model_urls": {"glb": link},
                                     "consumed_credits": 30, "task_error": {"message": ""}}),
        },
    };
    Reply::json(200, &body)
}

/// A link to the file of a task: of this look, where links end soon.
fn link(call: &Call<'_>, id: &str, task: &Task) -> String {
    let fresh = matches!(call.service, Service::Tripo | Service::Meshy);
    let look = if fresh { task.looks } else { 0 };
    format!("{}/{}/files/{id}/{look}.glb?signature=studio", call.studio.own, call.service.prefix())
}

/// A fetch of a file.
fn fetched(call: &Call<'_>, tasks: &Tasks, path: &str) -> Reply {
    if call.request.header("authorization").is_some() {
        return Reply::bytes(400, "application/xml", b"<Error>Only one auth mechanism allowed</Error>".to_vec());
    }
    let expired =
        || Reply::bytes(403, "application/xml", b"<Error><Message>Request has expired</Message></Error>".to_vec());
    let mut all = tasks.tasks();
    let Some((id, look)) = path.strip_suffix(".glb").and_then(|path| path.split_once('/')) else { return expired() };
    let Some(task) = all.get_mut(id).filter(|task| task.service == call.service) else { return expired() };
    if task.fault == Some(Fault::ExpiredLink) && look.parse().is_ok_and(|look: usize| look <= WORKING_LOOKS) {
        return expired();
    }
    task.fetches += 1;
    match &task.file {
        Ok(file) => {
            let mut reply = Reply::bytes(200, "model/gltf-binary", file.to_vec());
            if task.fault == Some(Fault::BrokenLooks) && task.fetches < BROKEN {
                reply.delivery = Delivery::CutOff(100);
            }
            reply
        }
        Err(_) => expired(),
    }
}

/// Cancels a task that is not done.
fn cancel(call: &Call<'_>, tasks: &Tasks, id: &str) -> Reply {
    let mut all = tasks.tasks();
    let Some(task) = all.get(id).filter(|task| task.service == call.service) else {
        return no(call.service, 404, 0, "NOT_FOUND");
    };
    if matches!(state(task), State::Done) {
        return Reply::json(400, &json!({"status": "ALREADY_COMPLETED"}));
    }
    all.remove(id);
    call.studio.ledger.cancelled.fetch_add(1, Ordering::Relaxed);
    match call.service {
        Service::Fal => Reply::json(202, &json!({"status": "CANCELLATION_REQUESTED"})),
        _ => Reply::json(200, &json!({"id": id, "status": "canceled"})),
    }
}
