//! Blender Cycles, where there is a Blender.

use std::sync::OnceLock;

use async_trait::async_trait;
use harmony_lighting::{CyclesJob, CyclesRenderer, LitError};
use harmony_roles::{LitImage, LitRenderer, LitRequest, PlayerCard, RoleError};

/// Path-traces with Blender Cycles, in a process of its own.
#[derive(Debug, Clone)]
pub struct CyclesLit {
    renderer: CyclesRenderer,
}

impl CyclesLit {
    /// Looks for a Blender.
    fn find() -> Option<Self> {
        CyclesRenderer::find().map(|renderer| Self { renderer })
    }
}

/// No path tracer: says so, with what to do about it. The flat render stands in.
#[derive(Debug, Clone, Copy)]
pub struct NoLit;

/// Cycles if it is here. Looking starts a program or two, so it is done once a process.
pub fn path_tracer() -> Option<CyclesLit> {
    static FOUND: OnceLock<Option<CyclesLit>> = OnceLock::new();
    FOUND.get_or_init(CyclesLit::find).clone()
}

#[async_trait]
impl LitRenderer for CyclesLit {
    fn card(&self) -> PlayerCard {
        PlayerCard {
            player: "cycles".to_owned(),
            model: format!("Blender {}", self.renderer.version()),
            // It computes, and would say the same again.
            offline: true,
            // One render takes all cores.
            concurrency: 1,
        }
    }

    async fn render(&self, request: &LitRequest) -> Result<LitImage, RoleError> {
        let renderer = self.renderer.clone();
        let mut job = CyclesJob::lit(&request.glb, request.camera, request.lighting.clone());
        job.room = request.room;
        job.samples = request.samples;
        job.denoise = request.denoise;
        let rendered = super::computed(move || renderer.render(&job)).await?;
        let output = rendered.map_err(|error| role_error(&error))?;
        for note in &output.notes {
            tracing::info!(call = %request.name, "Cycles: {note}");
        }
        let image = output.image.ok_or_else(|| unusable("Blender gave no image".to_owned()))?;
        Ok(LitImage { image })
    }
}

#[async_trait]
impl LitRenderer for NoLit {
    fn card(&self) -> PlayerCard {
        super::card("no path tracer")
    }

    async fn render(&self, _request: &LitRequest) -> Result<LitImage, RoleError> {
        Err(role_error(&LitError::NotFound))
    }
}

fn unusable(complaint: String) -> RoleError {
    RoleError::UnusableAnswer { player: "cycles".to_owned(), complaint, raw: String::new() }
}

fn role_error(error: &LitError) -> RoleError {
    let player = "cycles".to_owned();
    match error {
        LitError::NotFound => {
            RoleError::NotSetUp { player, reason: error.to_string(), hint: error.hint().unwrap_or_default() }
        }
        LitError::Timeout { .. } => {
            RoleError::Unavailable { player, reason: error.to_string(), status: None, retry_after: None }
        }
        other => unusable(other.to_string()),
    }
}
