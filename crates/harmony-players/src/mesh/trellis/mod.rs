//! TRELLIS behind the two servers that speak plain HTTP: NVIDIA's container (TRELLIS) and LocalAI (TRELLIS.2).
//!
//! Both were read from programs that use them, not from a reference of their makers: `docs/players.md` says so.

pub mod wire;

use std::sync::Arc;

use async_trait::async_trait;
use harmony_roles::{GeneratedMesh, MeshFrame, MeshGenerator, MeshRequest, PlayerCard, RoleError, Usage};
use serde_json::Value;

use super::finish::{Finish, SourceFrame, finished};
use super::picture::{check_request, encoded};
use crate::check::{Check, Checked};
use crate::http::{Http, HttpRequest, Service, ServiceOptions};
use crate::vlm::wire::Trouble;
use crate::work::computed;

/// Which server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Host {
    /// NVIDIA's container.
    Nim,
    /// LocalAI.
    LocalAi,
}

/// How a generator is set up.
#[derive(Debug, Clone)]
pub struct TrellisOptions {
    /// Where and how.
    pub service: ServiceOptions,
    /// Which server.
    pub host: Host,
    /// Model name, as LocalAI knows it.
    pub model: String,
    /// Seed.
    pub seed: u32,
    /// How many calls may run at once.
    pub concurrency: usize,
}

/// A TRELLIS server as a mesh generator.
#[derive(Debug)]
pub struct TrellisPlayer {
    service: Service,
    options: TrellisOptions,
}

impl TrellisPlayer {
    /// Sets it up; nothing is sent yet.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn new(http: &Http, options: TrellisOptions) -> Result<Self, RoleError> {
        let service = Service::new(http, options.service.clone())?;
        if options.host == Host::LocalAi && options.model.trim().is_empty() {
            return Err(service.not_set_up("no model is named", "set `model` to the name under which LocalAI has it"));
        }
        Ok(Self { service, options })
    }

    /// The service, for whoever needs its key hidden.
    pub fn service(&self) -> &Service {
        &self.service
    }
}

#[async_trait]
impl MeshGenerator for TrellisPlayer {
    fn card(&self) -> PlayerCard {
        let model = if self.options.model.is_empty() { "trellis" } else { &self.options.model };
        PlayerCard {
            player: self.service.player().to_owned(),
            model: format!("{model}, seed {}", self.options.seed),
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
        let host = self.options.host;
        let body = wire::body(&image, &settings, self.options.seed, &self.options.model, host);
        let answer: Value = self.service.call_json(&HttpRequest::post_json(wire::path(host), &body)).await?.value;
        let bytes = wire::read(&answer, host).map_err(|trouble| match trouble {
            Trouble::Refused(reason) => self.service.refused(&reason),
            Trouble::Failed(reason) => self.service.unavailable(reason),
            Trouble::CutOff(reason) | Trouble::NotUnderstood(reason) => self.service.unusable(reason, ""),
        })?;
        // Y up and front +Z, one unit large. The first TRELLIS leaves metalness out, which glTF reads as metal.
        let finish =
            Finish { faces: settings.faces as usize, frame: SourceFrame::default(), not_metal: host == Host::Nim };
        let done = computed(self.service.player(), move || finished(&bytes, &finish)).await?;
        let (mesh, notes) = done.map_err(|complaint| self.service.unusable(complaint, ""))?;
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Raw,
            part_model: None,
            source: self.card().model,
            notes,
            usage: Usage::default(),
        })
    }
}

#[async_trait]
impl Check for TrellisPlayer {
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        let path = match self.options.host {
            Host::Nim => "/v1/health/ready",
            Host::LocalAi => "/readyz",
        };
        self.service.call(&HttpRequest::get(path)).await?;
        if !paid {
            return Ok(Checked { detail: "the server is ready".to_owned(), usage: None });
        }
        let made = self.generate(&check_request()).await?;
        Ok(Checked { detail: format!("a ball of {} triangles", made.mesh.triangle_count()), usage: Some(made.usage) })
    }
}
