//! Hunyuan3D-2 and 2.1.
//!
//! Both servers take a picture by `POST /generate` (the file comes back as the answer) or by `POST /send` (a job, asked
//! for by `GET /status/{uid}`). How they fail decides which is used: `/generate` tells of a failure, with status 404;
//! a job that failed is `processing` for ever, and a finished one may be read while its file is being written.

pub mod wire;

use std::sync::Arc;
use std::time::{Duration, Instant};

use async_trait::async_trait;
use harmony_roles::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, PlayerCard, RoleError, Usage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::finish::{Finish, SourceFrame, finished, whole};
use super::picture::{check_request, encoded};
use crate::check::{Check, Checked};
use crate::http::{Http, HttpRequest, Service, ServiceOptions};
use crate::work::computed;

/// How long one look at a job may take: while the server works it may not answer at all.
const LOOK: Duration = Duration::from_secs(30);

/// Looks at a completed job whose file stays incomplete, before it is given up.
const INCOMPLETE_LOOKS: usize = 10;

/// Which server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// Hunyuan3D-2.
    V2,
    /// Hunyuan3D-2.1 (physically based materials).
    V2_1,
}

/// Which of the two ways is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Route {
    /// One request, answered when the mesh is there.
    #[default]
    Generate,
    /// A job, for lines that are cut when they are silent for long.
    Send,
}

/// How a generator is set up.
#[derive(Debug, Clone)]
pub struct HunyuanOptions {
    /// Where and how.
    pub service: ServiceOptions,
    /// Which server.
    pub version: Version,
    /// Name of the weights it was started with, for records.
    pub model: String,
    /// Which way.
    pub route: Route,
    /// Whether meshes are textured; the server must have been started for it.
    pub texture: bool,
    /// Seed.
    pub seed: u32,
    /// Between two looks at a job.
    pub poll: Duration,
    /// How many calls may run at once; the server takes one after the other.
    pub concurrency: usize,
}

/// A Hunyuan3D server as a mesh generator.
#[derive(Debug)]
pub struct HunyuanPlayer {
    service: Service,
    options: HunyuanOptions,
}

impl HunyuanPlayer {
    /// Sets it up; nothing is sent yet.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn new(http: &Http, options: HunyuanOptions) -> Result<Self, RoleError> {
        let service = Service::new(http, options.service.clone())?;
        if options.version == Version::V2_1 && options.route == Route::Send && !options.texture {
            return Err(service.not_set_up(
                "jobs without texture never end on a 2.1 server",
                "set `route = \"generate\"` or `texture = true`",
            ));
        }
        Ok(Self { service, options })
    }

    /// The service, for whoever needs its key hidden.
    pub fn service(&self) -> &Service {
        &self.service
    }

    async fn generate_now(&self, body: &Value) -> Result<Vec<u8>, RoleError> {
        let answer = self.service.send(&HttpRequest::post_json("/generate", body)).await?;
        if answer.is_success() {
            return Ok(answer.body);
        }
        let said: Value = serde_json::from_slice(&answer.body).unwrap_or(Value::Null);
        match wire::failure_text(answer.status, &said) {
            Some(text) if text.contains("image is empty") => Err(RoleError::NotCapable {
                player: self.service.player().to_owned(),
                reason: "the server's own background removal leaves nothing of the object".to_owned(),
            }),
            Some(text) => {
                let texture =
                    if self.options.texture { "; textures need a server started with --enable_tex" } else { "" };
                Err(RoleError::Unavailable {
                    player: self.service.player().to_owned(),
                    reason: self.service.scrubbed(&format!("the server failed: {text}{texture}")),
                    status: Some(answer.status),
                    retry_after: None,
                })
            }
            None => Err(self.service.failure(&answer)),
        }
    }

    async fn generate_as_job(&self, body: &Value) -> Result<Vec<u8>, RoleError> {
        let total = self.service.limits().total;
        let since = Instant::now();
        let sent: Value = self.service.call_json(&HttpRequest::post_json("/send", body)).await?.value;
        let Some(id) = wire::job_id(&sent) else {
            return Err(self.service.unusable("the server gave no job id", &sent.to_string()));
        };
        let request = HttpRequest::get(&format!("/status/{id}"));
        let mut incomplete = 0;
        loop {
            if since.elapsed() >= total {
                // Sent again it would fail again, after as long a wait, on a GPU that may still be at it.
                return Err(RoleError::NotCapable {
                    player: self.service.player().to_owned(),
                    reason: format!(
                        "the job did not end within {total:?}; this server never says that a job has failed (see its log)"
                    ),
                });
            }
            tokio::time::sleep(self.options.poll.min(total.saturating_sub(since.elapsed()))).await;
            let look = tokio::time::timeout(LOOK, self.service.send(&request)).await;
            let answer = match look {
                Ok(Ok(answer)) if answer.is_success() => answer,
                Ok(Ok(answer)) => {
                    let error = self.service.failure(&answer);
                    if !error.is_retryable() {
                        return Err(error);
                    }
                    continue;
                }
                // The server is at work and does not answer, or the line broke: the job may be there all the same.
                Ok(Err(RoleError::Unavailable { .. })) | Err(_) => continue,
                Ok(Err(error)) => return Err(error),
            };
            let state: Value = serde_json::from_slice(&answer.body).map_err(|error| {
                self.service.unusable(format!("a job's status is not JSON: {error}"), &answer.text())
            })?;
            match wire::job_state(&state) {
                wire::JobState::Working => {}
                wire::JobState::NotUnderstood(reason) => return Err(self.service.unusable(reason, "")),
                wire::JobState::Done(bytes) => match whole(&bytes) {
                    Ok(()) => return Ok(bytes),
                    Err(reason) if incomplete >= INCOMPLETE_LOOKS => return Err(self.service.unusable(reason, "")),
                    Err(_) => incomplete += 1,
                },
            }
        }
    }
}

#[async_trait]
impl MeshGenerator for HunyuanPlayer {
    fn card(&self) -> PlayerCard {
        let texture = if self.options.texture { "textured" } else { "untextured" };
        PlayerCard {
            player: self.service.player().to_owned(),
            model: format!("{}, {texture}, seed {}", self.options.model, self.options.seed),
            offline: false,
            concurrency: self.options.concurrency,
        }
    }

    fn sees_picture_only(&self) -> bool {
        true
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        let settings = request.settings;
        let crop = Arc::clone(&request.crop);
        let image = computed(self.service.player(), move || encoded(&crop)).await?;
        let image =
            image.map_err(|reason| RoleError::NotCapable { player: self.service.player().to_owned(), reason })?;
        let (body, mut notes) =
            wire::body(&image, &settings, self.options.seed, self.options.texture, self.options.version);
        let bytes = match self.options.route {
            Route::Generate => self.generate_now(&body).await?,
            Route::Send => self.generate_as_job(&body).await?,
        };
        // Both servers leave meshes Y up with the front of the picture towards +Z, about 2 units long.
        let finish = Finish { faces: settings.faces as usize, frame: SourceFrame::default(), not_metal: false };
        let done = computed(self.service.player(), move || finished(&bytes, &finish)).await?;
        let (mesh, more) = done.map_err(|complaint| self.service.unusable(complaint, ""))?;
        notes.extend(more);
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Raw,
            part_model: None,
            source: format!("{} {}", self.service.player(), self.options.model),
            notes,
            usage: Usage::default(),
        })
    }
}

#[async_trait]
impl Check for HunyuanPlayer {
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        // Version 2 has no health route; it says `processing` of any job that it does not know.
        let path = match self.options.version {
            Version::V2 => "/status/harmony-check",
            Version::V2_1 => "/health",
        };
        let state: Value = self.service.call_json(&HttpRequest::get(path)).await?.value;
        if state.get("status").and_then(Value::as_str).is_none() {
            return Err(self.service.unusable("this does not look like a Hunyuan3D server", &state.to_string()));
        }
        if !paid {
            return Ok(Checked { detail: "the server answers".to_owned(), usage: None });
        }
        let made = self.generate(&check_request()).await?;
        Ok(Checked { detail: format!("a ball of {} triangles", made.mesh.triangle_count()), usage: Some(made.usage) })
    }
}
