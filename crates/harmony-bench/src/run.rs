//! Runs the pipeline on rooms with known truth, played by the oracle, and judges what comes out.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast};
use harmony_pipeline::{RunRequest, Settings, Warnings};
use serde::{Deserialize, Serialize};

use crate::oracle::{Noise, NoiseLevel, Oracle};
use crate::score::{Prediction, RoomScore, ScoreOptions, score};
use crate::truth::{TruthError, TruthRoom};

/// Index of the last phase that the benchmark needs: decorations. Lighting asks questions that the truth can't answer.
const LAST_PHASE: usize = 4;

/// What to run.
#[derive(Debug, Clone)]
pub struct BenchRequest {
    /// Truth folders.
    pub rooms: Vec<PathBuf>,
    /// Folder for the runs.
    pub out: PathBuf,
    /// Level of noise.
    pub level: NoiseLevel,
    /// Its errors.
    pub noise: Noise,
    /// Seeds: every room is run once with each.
    pub seeds: Vec<u64>,
    /// The room's height is told exactly.
    pub exact_height: bool,
    /// Settings of the pipeline.
    pub settings: Settings,
}

/// Scores of a benchmark, as measured and after scale alignment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchResult {
    /// What was run, in words.
    pub title: String,
    /// Level of noise.
    pub level: NoiseLevel,
    /// Whether the room's height was exact.
    pub exact_height: bool,
    /// One a room and seed, metres as delivered.
    pub raw: Vec<RoomScore>,
    /// The same after scaling each run by its median depth ratio.
    pub aligned: Vec<RoomScore>,
}

/// A benchmark cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A truth folder.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// A photo.
    #[error("photo of {room}: {reason}")]
    Photo {
        /// Room.
        room: String,
        /// Why.
        reason: String,
    },
    /// A run folder.
    #[error("run of {room}: {reason}")]
    Run {
        /// Room.
        room: String,
        /// Why.
        reason: String,
    },
}

/// Runs all rooms with all seeds. `tell` hears a line after each.
///
/// # Errors
/// Folders that cannot be used. A run that fails is no error: its score says so and counts as nothing found.
pub async fn run(
    request: &BenchRequest,
    offline: &Cast,
    tell: &(dyn Fn(String) + Sync),
) -> Result<BenchResult, BenchError> {
    let (mut raw, mut aligned) = (Vec::new(), Vec::new());
    for folder in &request.rooms {
        let truth = TruthRoom::load(folder)?;
        for seed in &request.seeds {
            let out = request.out.join(format!("{}_{seed}", truth.name));
            let begun = Instant::now();
            let failure = Box::pin(one(request, &truth, *seed, &out, offline)).await?;
            let seconds = begun.elapsed().as_secs_f64();
            let [a, b] = judged(&truth, &out, seconds, failure.as_deref());
            tell(line(&a));
            raw.push(a);
            aligned.push(b);
        }
    }
    let title = format!("{} rooms, {} seeds, noise {}", request.rooms.len(), request.seeds.len(), request.level.name());
    Ok(BenchResult { title, level: request.level, exact_height: request.exact_height, raw, aligned })
}

/// Judges a run folder raw and scale-aligned.
pub fn judged(truth: &TruthRoom, folder: &Path, seconds: f64, failure: Option<&str>) -> [RoomScore; 2] {
    let of = |align_scale: bool| match Prediction::load(folder) {
        Ok(run) => {
            let mut s = score(truth, &run, ScoreOptions { align_scale });
            s.seconds = seconds;
            s.failure = failure.map(str::to_owned);
            s
        }
        Err(error) => RoomScore::failed(truth, seconds, failure.map_or_else(|| error.to_string(), str::to_owned)),
    };
    [of(false), of(true)]
}

fn line(s: &RoomScore) -> String {
    let mut far: Vec<f64> = s.objects.iter().filter(|o| o.truth.is_some()).map(|o| o.position_m).collect();
    far.sort_by(f64::total_cmp);
    let median = far.get(far.len() / 2).copied().unwrap_or(f64::NAN);
    format!(
        "{:<20} camera {:>5.2} deg {:.3} m  {:>2} objects ({} missed)  position {median:.3} m  {:.1} s{}",
        s.room,
        s.camera.rotation_deg,
        s.camera.centre_m,
        s.objects.len(),
        s.missed.len(),
        s.seconds,
        s.failure.as_ref().map_or_else(String::new, |f| format!("  FAILED: {f}")),
    )
}

/// One run; returns the reason when a phase failed.
async fn one(
    request: &BenchRequest,
    truth: &TruthRoom,
    seed: u64,
    out: &Path,
    offline: &Cast,
) -> Result<Option<String>, BenchError> {
    let failed = |reason: String| BenchError::Run { room: truth.name.clone(), reason };
    let photo = harmony_io::load_photo(&truth.photo())
        .map_err(|e| BenchError::Photo { room: truth.name.clone(), reason: e.to_string() })?;
    if out.exists() {
        std::fs::remove_dir_all(out).map_err(|e| failed(e.to_string()))?;
    }
    std::fs::create_dir_all(out).map_err(|e| failed(e.to_string()))?;
    let oracle = Arc::new(Oracle::new(truth.clone(), request.noise, seed, request.exact_height));
    let warnings = Arc::new(Warnings::default());
    let collected = Arc::clone(&warnings);
    let options =
        CallOptions { on_warning: Arc::new(move |warning| collected.push(warning)), ..CallOptions::default() };
    let book = CallBook::open(out, BookOptions::default()).map_err(|e| failed(e.to_string()))?;
    let calls = Calls::new(Arc::new(book), oracle.cast(offline), offline.clone(), options);
    let run = RunRequest {
        photo,
        title: truth.name.clone(),
        run: out.to_owned(),
        profile: format!("oracle, noise {}", request.level.name()),
        settings: request.settings.clone(),
        until: LAST_PHASE,
        boxes_from_vlm: false,
        path_tracer: false,
        further_inputs: format!("{} {seed}", request.level.name()),
    };
    let silent: harmony_pipeline::ProgressSink = Arc::new(|_| {});
    let outcome = Box::pin(harmony_pipeline::run(&run, &calls, &warnings, &silent)).await;
    let outcome = outcome.map_err(|e| failed(e.to_string()))?;
    Ok(outcome.failure.map(|(phase, reason, _)| format!("{phase}: {reason}")))
}
