//! Blender Cycles, where there is a Blender.

use std::sync::{Arc, Mutex, PoisonError};

use async_trait::async_trait;
use harmony_lighting::{CyclesJob, CyclesOutput, CyclesRenderer, LitError, RenderMode, relight};
use harmony_roles::{LightMeasurement, LitImage, LitKind, LitRenderer, LitRequest, PlayerCard, RoleError};

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

/// What was found.
enum Found {
    NobodyLooked,
    Nothing,
    Here(CyclesLit),
}

static FOUND: Mutex<Found> = Mutex::new(Found::NobodyLooked);

/// Cycles if it is here. Looking starts a program or two, so it is done once a process.
pub fn path_tracer() -> Option<CyclesLit> {
    let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    if matches!(*found, Found::NobodyLooked) {
        *found = CyclesLit::find().map_or(Found::Nothing, Found::Here);
    }
    match &*found {
        Found::Here(cycles) => Some(cycles.clone()),
        Found::Nothing | Found::NobodyLooked => None,
    }
}

/// Looks again the next time: a Blender was installed.
pub fn forget_path_tracer() {
    *FOUND.lock().unwrap_or_else(PoisonError::into_inner) = Found::NobodyLooked;
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
        let job = job_of(request);
        let rendered = super::computed(move || renderer.render(&job)).await?;
        let output = rendered.map_err(|error| role_error(&error))?;
        for note in &output.notes {
            tracing::info!(call = %request.name, "Cycles: {note}");
        }
        match request.kind {
            LitKind::Picture => {
                let image = output.image.ok_or_else(|| unusable("Blender gave no image".to_owned()))?;
                Ok(LitImage { image, measured: None })
            }
            LitKind::Measurement { .. } => {
                let gain = [request.lighting.exposure.exp2(); 3];
                let image = output.response.to_picture(&relight(&output.lights, &vec![gain; output.lights.len()]));
                Ok(LitImage { image, measured: Some(Arc::new(measurement(output, request)?)) })
            }
        }
    }
}

fn job_of(request: &LitRequest) -> CyclesJob {
    let mut job = CyclesJob::lit(&request.glb, request.camera, request.lighting.clone());
    job.room = request.room;
    job.samples = request.samples;
    job.denoise = request.denoise;
    job.albedo.clone_from(&request.albedo);
    job.hidden_nodes.clone_from(&request.hidden_nodes);
    job.background = request.background;
    if let LitKind::Measurement { nodes, views } = &request.kind {
        job.mode = RenderMode::PerLight;
        job.denoise = false;
        job.node_ids = nodes.iter().zip(1..).map(|(name, id)| (name.clone(), id)).collect();
        job.views.clone_from(views);
    }
    job
}

fn measurement(output: CyclesOutput, request: &LitRequest) -> Result<LightMeasurement, RoleError> {
    let missing = |what: &str| unusable(format!("Blender gave no {what}"));
    Ok(LightMeasurement {
        size: request.camera.size,
        lights: output.lights.into_iter().map(|pass| (pass.light, pass.image.rgb)).collect(),
        albedo: output.albedo.ok_or_else(|| missing("reflectances"))?.rgb,
        nodes: output.ids.ok_or_else(|| missing("node image"))?,
        views: output.views.into_iter().map(|table| (table.view, table.display)).collect(),
    })
}

#[async_trait]
impl LitRenderer for NoLit {
    fn card(&self) -> PlayerCard {
        super::card("no path tracer")
    }

    fn traces(&self) -> bool {
        false
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
