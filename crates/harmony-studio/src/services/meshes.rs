//! Mesh generators.
//!
//! Quirks, mesh sheet:
//! - section 1, Hunyuan3D-2: every failure is a 404 with `{"text", "error_code": 1}`; `image` is plain base64; a job that
//!   failed is `processing` for ever, so is one that nobody knows; a finished file is visible while it is being written,
//!   so that the first look at it gets half; while `/generate` runs, the server answers nothing else;
//! - section 2, 2.1: values out of range are 422, `/health` exists, a job passes through `texturing` and only ends when it
//!   is textured;
//! - section 4: NVIDIA's container answers `/v1/infer` with `artifacts`, LocalAI `/3d/generations` with `data`.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::{Call, Made, Service, looked_at};
use crate::faults::{Fault, Part};
use crate::glb;
use crate::http::Reply;

/// Looks at a job that find it at work.
const WORKING_LOOKS: usize = 2;

/// Jobs of the two Hunyuan servers.
#[derive(Default)]
pub(crate) struct Jobs {
    jobs: Mutex<HashMap<String, Job>>,
    /// Held while `/generate` runs.
    busy: tokio::sync::Mutex<()>,
}

struct Job {
    looks: usize,
    /// The file; `None` = it failed, and nobody says so.
    file: Option<Arc<Vec<u8>>>,
}

/// The old server's only error.
pub fn hunyuan_error(message: &str) -> Reply {
    Reply::json(404, &json!({"text": format!("NETWORK ERROR DUE TO HIGH TRAFFIC. {message}"), "error_code": 1}))
}

/// The file that is made of a request's picture in base64, with the fault that befalls it.
async fn file(call: &Call<'_>, image: &str) -> Result<Arc<Vec<u8>>, String> {
    let bytes = STANDARD.decode(image).map_err(|_| "cannot identify image file".to_owned())?;
    file_of(call, &bytes, |p| p).await
}

/// The file that is made of a picture, in the frame that `turned` makes of ours.
pub(super) async fn file_of(
    call: &Call<'_>,
    bytes: &[u8],
    turned: fn(glam::Vec3) -> glam::Vec3,
) -> Result<Arc<Vec<u8>>, String> {
    let picture = looked_at(bytes)?.to_rgba8();
    if call.is(Fault::HugeMesh) {
        return tokio::task::spawn_blocking(glb::huge).await.map_err(|error| error.to_string());
    }
    let (truth_oracle, fault) = (Arc::clone(&call.studio.truth_oracle), call.fault);
    let work = move || {
        let mut mesh = truth_oracle.mesh(&picture)?;
        mesh.map(turned, turned);
        Ok(Arc::new(match fault {
            Some(Fault::HalfGlb) => {
                let whole = glb::of(&mesh);
                whole[..whole.len() / 2].to_vec()
            }
            Some(Fault::NanMesh) => glb::with_nan(&mesh),
            Some(Fault::EmptyMesh) => glb::empty(),
            _ => glb::of(&mesh),
        }))
    };
    tokio::task::spawn_blocking(work).await.map_err(|error| error.to_string())?
}

/// What version 2.1 does not let pass, in pydantic's form.
fn out_of_range(body: &Value) -> Option<Value> {
    if body["image"].as_str().is_none() {
        return Some(json!({"detail": [{"type": "missing", "loc": ["body", "image"], "msg": "Field required"}]}));
    }
    let ranges = [
        ("octree_resolution", 64.0, 512.0),
        ("num_inference_steps", 1.0, 20.0),
        ("guidance_scale", 0.1, 20.0),
        ("num_chunks", 1000.0, 20_000.0),
        ("face_count", 1000.0, 100_000.0),
        ("seed", 0.0, 4_294_967_295.0),
    ];
    let (name, low, high) = ranges
        .into_iter()
        .find(|(name, low, high)| body[*name].as_f64().is_some_and(|value| !(*low..=*high).contains(&value)))?;
    let msg = format!("Input should be between {low} and {high}");
    Some(json!({"detail": [{"type": "less_than_equal", "loc": ["body", name], "msg": msg}]}))
}

pub(crate) async fn hunyuan(call: &Call<'_>, jobs: &Jobs) -> Made {
    let free = |reply| Made::free(Part::Mesh, reply);
    let newer = call.service == Service::Hunyuan21;
    if call.request.method == "GET" {
        let _turn = jobs.busy.lock().await;
        return free(match call.path {
            "/health" if newer => Reply::json(200, &json!({"status": "healthy", "worker_id": "studio"})),
            path => match path.strip_prefix("/status/") {
                Some(id) => Reply::json(200, &look(jobs, id, newer)),
                None => Reply::json(404, &json!({"detail": "Not Found"})),
            },
        });
    }
    if newer && let Some(detail) = out_of_range(&call.json) {
        return free(Reply::json(422, &detail));
    }
    let image = call.json["image"].as_str().unwrap_or_default();
    match call.path {
        "/generate" => {
            let _turn = jobs.busy.lock().await;
            match file(call, image).await {
                Ok(file) => {
                    let reply = Reply::bytes(200, "application/octet-stream", file.to_vec());
                    Made::paid(Part::Mesh, reply, (0, 0))
                }
                Err(message) if newer => free(Reply::json(500, &json!({"text": message, "error_code": 1}))),
                Err(message) => free(hunyuan_error(&message)),
            }
        }
        "/send" => {
            let file = file(call, image).await.ok();
            let id = blake3::hash(&call.request.body).to_hex().to_string();
            // A job that was sent again begins again.
            let job = Job { looks: 0, file };
            jobs.jobs.lock().unwrap_or_else(PoisonError::into_inner).insert(id.clone(), job);
            Made::paid(Part::Mesh, Reply::json(200, &json!({"uid": id})), (0, 0))
        }
        _ => free(Reply::json(404, &json!({"detail": "Not Found"}))),
    }
}

/// What a look at a job finds.
fn look(jobs: &Jobs, id: &str, newer: bool) -> Value {
    let mut jobs = jobs.jobs.lock().unwrap_or_else(PoisonError::into_inner);
    let working = json!({"status": "processing"});
    let Some(job) = jobs.get_mut(id) else { return working };
    job.looks += 1;
    let Some(file) = job.file.as_ref().filter(|_| job.looks > WORKING_LOOKS) else {
        return if newer && job.file.is_some() && job.looks == WORKING_LOOKS {
            json!({"status": "texturing"})
        } else {
            working
        };
    };
    // The file is being written when it is first seen.
    let part = if job.looks == WORKING_LOOKS + 1 { &file[..file.len() / 2] } else { &file[..] };
    json!({"status": "completed", "model_base64": STANDARD.encode(part)})
}

pub(crate) async fn trellis(call: &Call<'_>) -> Made {
    let free = |reply| Made::free(Part::Mesh, reply);
    let nim = call.service == Service::TrellisNim;
    if call.request.method == "GET" {
        let ready = if nim { "/v1/health/ready" } else { "/readyz" };
        return free(if call.path == ready {
            Reply::json(200, &json!({"status": "ready"}))
        } else {
            Reply::json(404, &json!({}))
        });
    }
    if call.path != if nim { "/v1/infer" } else { "/3d/generations" } {
        return free(Reply::json(404, &json!({"detail": "Not Found"})));
    }
    if !nim && call.json["model"].as_str().is_none_or(str::is_empty) {
        return free(Reply::json(400, &json!({"error": {"message": "model is required", "code": 400}})));
    }
    if nim && call.json["mode"] != "image" {
        return free(Reply::json(422, &json!({"detail": "mode must be image"})));
    }
    let url = call.json["image"].as_str().unwrap_or_default();
    let image = url.split_once(";base64,").map_or(url, |(_, data)| data);
    match file(call, image).await {
        Ok(file) => {
            let data = STANDARD.encode(file.as_slice());
            let body = if nim {
                json!({"artifacts": [{"base64": data, "finishReason": "SUCCESS", "seed": call.json["seed"]}]})
            } else {
                json!({"created": 1_790_000_000, "data": [{"b64_json": data}]})
            };
            Made::paid(Part::Mesh, Reply::json(200, &body), (0, 0))
        }
        Err(message) => free(Reply::json(500, &json!({"error": {"message": message, "code": 500}}))),
    }
}
