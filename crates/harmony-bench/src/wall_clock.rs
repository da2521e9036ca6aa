//! The wall clock: a made-up room whose players answer from a script after latencies like real ones, to see how near
//! a run comes to what its calls allow.
//!
//! The run is the real pipeline with the real call book; only the players are scripted. Under Tokio's stopped clock
//! (`start_paused`) waiting takes no time and computing counts as none, so that the measured time is the schedule's
//! alone, to the millisecond; under the real clock it is what a person waits.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast};
use harmony_mesh::Mesh;
use harmony_pipeline::{Phase, RunRequest, Settings, Warnings};
use harmony_prompts::{
    CompletedAnswer, CompletedObject, CompletedQuestion, InspectAnswer, InspectQuestion, InspectedObject,
    InspectedSize, ListAnswer, ListQuestion, ListedItem, NamedObject, Occlusion, Question,
};
use harmony_roles::{
    DetectRequest, Detection, Detections, Detector, EditRequest, EditedImage, GeneratedMesh, ImageEditor, MeshFrame,
    MeshGenerator, MeshRequest, PlayerCard, Role, RoleError, SegmentRequest, SegmentedMask, Segmenter, Usage,
    VisionLanguage, VlmAnswer, VlmRequest,
};
use harmony_scene::{ImageSize, Level, Mask, PixelBox, Wall, WallAffinity};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::json;
use tokio::sync::Semaphore;
use tokio::time::Instant;

use crate::run::BenchError;

/// Size of the photo, pixels: small, for what is computed is not what is measured.
const PHOTO: ImageSize = ImageSize { width: 256, height: 192 };

/// One in so many completed pictures does not match and is drawn again.
const DRAWN_AGAIN: usize = 4;

/// How long players take, and how many calls at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// An answer of the language model.
    pub question: Duration,
    /// An edited image.
    pub edit: Duration,
    /// A mesh.
    pub mesh: Duration,
    /// Questions at a time.
    pub questions_at_once: usize,
    /// Edits at a time.
    pub edits_at_once: usize,
    /// Meshes at a time.
    pub meshes_at_once: usize,
    /// Nobody is asked while somebody else is: one call after another.
    pub in_a_row: bool,
}

impl Pace {
    /// Latencies like the real ones, divided by `faster`: 8 s a question, 12 s an edit, 45 s a mesh.
    pub fn like_real(faster: f64, meshes_at_once: usize) -> Self {
        let seconds = |s: f64| Duration::from_secs_f64(s / faster);
        Self {
            question: seconds(8.0),
            edit: seconds(12.0),
            mesh: seconds(45.0),
            questions_at_once: 8,
            edits_at_once: 8,
            meshes_at_once,
            in_a_row: false,
        }
    }
}

/// What a simulated run was.
#[derive(Debug, Clone, PartialEq)]
pub struct Played {
    /// From its begin to its end.
    pub elapsed: Duration,
    /// Calls to the scripted players with latencies, and the time they took added up.
    pub work: BTreeMap<Role, (usize, Duration)>,
    /// Objects in the scene.
    pub objects: usize,
    /// Why it failed, if it did.
    pub failure: Option<String>,
}

impl Played {
    /// Time of the busiest player: its work divided by its places.
    pub fn busiest(&self, pace: &Pace) -> Duration {
        let places = |role: Role| match role {
            Role::VisionLanguage => pace.questions_at_once,
            Role::ImageEditor => pace.edits_at_once,
            Role::MeshGenerator => pace.meshes_at_once,
            _ => 1,
        };
        let each = self.work.iter().map(|(role, (_, time))| time.div_f64(places(*role).max(1) as f64));
        each.max().unwrap_or_default()
    }

    /// All calls, one after another.
    pub fn in_a_row(&self) -> Duration {
        self.work.values().map(|(_, time)| *time).sum()
    }
}

/// The scripted players of a room with so many objects on each level.
struct Studio {
    counts: [usize; 4],
    pace: Pace,
    /// The one place of all players when calls go one after another.
    row: Semaphore,
    work: Mutex<BTreeMap<Role, (usize, Duration)>>,
    offline: Cast,
}

/// Runs a room with so many objects on each level (wall, furniture, ceiling, decoration) in an empty folder.
///
/// # Errors
/// A folder that cannot be used. A run that fails is told in [`Played::failure`].
pub async fn play(counts: [usize; 4], pace: Pace, offline: &Cast, out: &Path) -> Result<Played, BenchError> {
    let failed = |reason: String| BenchError::Run { room: "the simulated room".into(), reason };
    let file = out.join("photo.png");
    harmony_io::picture::write_rgb_png(&file, &photo()).map_err(|e| failed(e.to_string()))?;
    let photo = harmony_io::load_photo(&file).map_err(|e| failed(e.to_string()))?;
    let run = out.join("run");
    std::fs::create_dir_all(&run).map_err(|e| failed(e.to_string()))?;
    let studio =
        Arc::new(Studio { counts, pace, row: Semaphore::new(1), work: Mutex::default(), offline: offline.clone() });
    let cast = Cast {
        vision_language: studio.clone(),
        image_editor: studio.clone(),
        mesh_generator: studio.clone(),
        detector: studio.clone(),
        segmenter: studio.clone(),
        ..offline.clone()
    };
    let book = CallBook::open(&run, BookOptions { without_images: true, ..BookOptions::default() });
    let book = Arc::new(book.map_err(|e| failed(e.to_string()))?);
    let warnings = Arc::new(Warnings::default());
    let calls = Calls::new(book, cast, offline.clone(), CallOptions::default());
    let mut settings = Settings { working_px: PHOTO.width, surface_px_per_m: 10.0, ..Settings::default() };
    settings.mesh.faces = 1000;
    // What is computed is not what is measured: first poses are enough.
    let placement = &mut settings.placement;
    (placement.refinement, placement.optimiser) = (false, false);
    (placement.global_refinement, placement.collision) = (false, false);
    (placement.max_rounds, placement.renders_per_object, placement.window_px) = (1, 2, 32);
    let request = RunRequest {
        photo,
        title: "a simulated room".into(),
        run,
        profile: "simulated".into(),
        settings,
        until: Phase::Lighting,
        path_tracer: false,
        further_inputs: String::new(),
    };
    let silent: harmony_pipeline::ProgressSink = Arc::new(|_| {});
    let begun = Instant::now();
    let outcome = Box::pin(harmony_pipeline::run(&request, &calls, &warnings, &silent)).await;
    let elapsed = begun.elapsed();
    let outcome = outcome.map_err(|e| failed(e.to_string()))?;
    let work = studio.work.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let objects = outcome.scene.map_or(0, |scene| scene.objects.len());
    Ok(Played { elapsed, work, objects, failure: outcome.failure.map(|failure| failure.to_string()) })
}

/// Walls, floor and a shade of each, so that there are pixels to look at.
fn photo() -> RgbImage {
    RgbImage::from_fn(PHOTO.width, PHOTO.height, |x, y| {
        let floor = y > PHOTO.height * 2 / 3;
        let shade = ((x * 7 + y * 13) % 23) as u8;
        if floor { Rgb([120 + shade, 90 + shade, 60]) } else { Rgb([200, 195 + shade / 2, 180 + shade]) }
    })
}

/// Label of the objects of a level.
fn label(level: Level) -> &'static str {
    match level {
        Level::Wall => "painting",
        Level::Furniture => "cabinet",
        Level::Ceiling => "pendant lamp",
        Level::Decoration => "vase",
    }
}

/// Part of the photo's height that the objects of a level stand in.
fn band(level: Level) -> (f64, f64) {
    match level {
        Level::Ceiling => (0.02, 0.15),
        Level::Wall => (0.2, 0.4),
        Level::Decoration => (0.42, 0.56),
        Level::Furniture => (0.57, 0.95),
    }
}

/// Places of the objects of a level: rows that fill its band.
fn places(level: Level, count: usize) -> Vec<PixelBox> {
    let (top, bottom) = band(level);
    let (w, h) = (f64::from(PHOTO.width), f64::from(PHOTO.height));
    let columns = count.clamp(1, 8);
    let rows = count.div_ceil(columns).max(1);
    (0..count)
        .map(|i| {
            let (column, row) = ((i % columns) as f64, (i / columns) as f64);
            let (width, height) = (w / columns as f64, (bottom - top) * h / rows as f64);
            let (x0, y0) = (column * width, top * h + row * height);
            PixelBox { x0: x0 + 0.1 * width, y0: y0 + 0.1 * height, x1: x0 + 0.9 * width, y1: y0 + 0.9 * height }
        })
        .collect()
}

fn size(level: Level) -> InspectedSize {
    let (width, height, depth) = match level {
        Level::Wall => (0.5, 0.4, 0.04),
        Level::Furniture => (0.4, 0.8, 0.4),
        Level::Ceiling => (0.3, 0.4, 0.3),
        Level::Decoration => (0.1, 0.2, 0.1),
    };
    InspectedSize { width, height, depth }
}

/// Number at the end of an id.
fn number(id: &str) -> usize {
    id.rsplit_once('_').and_then(|(_, n)| n.parse().ok()).unwrap_or(0)
}

fn card(model: &str, concurrency: usize) -> PlayerCard {
    PlayerCard { player: "simulated".into(), model: model.into(), offline: false, concurrency }
}

impl Studio {
    /// Takes its time.
    async fn work(&self, role: Role, time: Duration) {
        let row = if self.pace.in_a_row { self.row.acquire().await.ok() } else { None };
        tokio::time::sleep(time).await;
        drop(row);
        let mut work = self.work.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = work.entry(role).or_default();
        *entry = (entry.0 + 1, entry.1 + time);
    }
}

/// Everything is what it was found as, partly hidden, and decorations stand on the furniture.
fn inspect(question: &InspectQuestion) -> InspectAnswer {
    let level = question.level;
    let hosts: Vec<String> = question.placed.iter().map(|known| known.id().to_string()).collect();
    let hosts: Vec<String> = hosts.into_iter().filter(|id| id.starts_with("cabinet")).collect();
    let candidates: Vec<String> = question.candidates.iter().map(|c| c.id.to_string()).collect();
    let objects = candidates
        .iter()
        .enumerate()
        .map(|(i, id)| {
            let mut object = InspectedObject::plain(id, label(level), size(level));
            object.description = format!("a plain {}", label(level));
            object.occlusion = Occlusion::Partly;
            if level == Level::Wall {
                (object.wall, object.wall_affinity) = (Some(Wall::Back), WallAffinity::Back);
            }
            if level == Level::Decoration {
                object.on_top_of = hosts.get(i % hosts.len().max(1)).cloned();
            }
            object
        })
        .collect();
    InspectAnswer { objects, placement_order: candidates, scene_summary: String::new() }
}

#[async_trait]
impl VisionLanguage for Studio {
    fn card(&self) -> PlayerCard {
        card("language", self.pace.questions_at_once)
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        self.work(Role::VisionLanguage, self.pace.question).await;
        let value = match request.question.as_deref() {
            Some(Question::List(ListQuestion { level, .. })) => {
                let count = self.counts[Level::ALL.iter().position(|l| l == level).unwrap_or(0)];
                let item = |kind: &str| ListedItem {
                    kind: kind.into(),
                    gdino: kind.into(),
                    count: count as u32,
                    instances: Vec::new(),
                };
                json!(ListAnswer { items: if count == 0 { Vec::new() } else { vec![item(label(*level))] } })
            }
            Some(Question::Inspect(question)) => json!(inspect(question)),
            Some(Question::Completed(CompletedQuestion { objects })) => {
                let judged = objects.iter().map(|NamedObject { id, .. }| {
                    let matches = !number(id).is_multiple_of(DRAWN_AGAIN);
                    CompletedObject { id: id.clone(), matches, hint: "a plain surface".into() }
                });
                json!(CompletedAnswer { objects: judged.collect() })
            }
            // The rest is answered by rule, after the same time.
            _ => return self.offline.vision_language.ask(request).await,
        };
        Ok(VlmAnswer { raw: value.to_string(), value, usage: Usage::default() })
    }
}

#[async_trait]
impl ImageEditor for Studio {
    fn card(&self) -> PlayerCard {
        card("editor", self.pace.edits_at_once)
    }

    async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError> {
        self.work(Role::ImageEditor, self.pace.edit).await;
        let image = RgbaImage::from_fn(request.image.width(), request.image.height(), |x, y| {
            let own = request.object.as_ref().is_none_or(|mask| mask.get(x.into(), y.into()));
            let Rgb([r, g, b]) = *request.image.get_pixel(x, y);
            Rgba([r, g, b, if own { 255 } else { 0 }])
        });
        Ok(EditedImage { image, usage: Usage::default() })
    }
}

#[async_trait]
impl MeshGenerator for Studio {
    fn card(&self) -> PlayerCard {
        card("mesh", self.pace.meshes_at_once)
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        self.work(Role::MeshGenerator, self.pace.mesh).await;
        let made = self.offline.mesh_generator.generate(request).await?;
        let mesh: Mesh = (*made.mesh).clone();
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: None,
            frame: MeshFrame::Raw,
            part_model: None,
            source: "simulated".into(),
            notes: Vec::new(),
            usage: Usage::default(),
        })
    }
}

#[async_trait]
impl Detector for Studio {
    fn card(&self) -> PlayerCard {
        card("detector", 0)
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        let count = request.phrases.iter().map(|p| p.count).sum();
        let found = places(request.level, count).into_iter().map(|bounds| Detection {
            label: label(request.level).into(),
            phrase: label(request.level).into(),
            bounds,
            score: Some(0.9),
            outline: None,
        });
        Ok(Detections { detections: found.collect(), ..Detections::default() })
    }
}

#[async_trait]
impl Segmenter for Studio {
    fn card(&self) -> PlayerCard {
        card("segmenter", 0)
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        let size = ImageSize::new(request.image.width(), request.image.height());
        let mask = |b: &PixelBox| {
            Mask::from_fn(size, |x, y| {
                let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                (b.x0..b.x1).contains(&x) && (b.y0..b.y1).contains(&y)
            })
        };
        Ok(request.prompts.iter().map(|p| SegmentedMask { mask: mask(&p.bounds), score: Some(0.9) }).collect())
    }
}

/// What a call costs by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overhead {
    /// From one answer of a busy player to the next question put to it: scheduling alone (median).
    pub handover: Duration,
    /// A call in all, its record written and read back (mean).
    pub whole: Duration,
}

/// A player that answers at once, one call at a time, and remembers when.
struct AtOnce(Mutex<Vec<std::time::Instant>>);

#[async_trait]
impl VisionLanguage for AtOnce {
    fn card(&self) -> PlayerCard {
        PlayerCard { player: "at once".into(), model: "1".into(), offline: false, concurrency: 1 }
    }

    async fn ask(&self, _request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(std::time::Instant::now());
        Ok(VlmAnswer { value: json!({ "items": [] }), raw: String::new(), usage: Usage::default() })
    }
}

/// Makes so many calls, half of them in line at once and half one after another.
///
/// # Errors
/// A folder that cannot be used.
pub async fn overhead(count: usize, offline: &Cast, out: &Path) -> Result<Overhead, BenchError> {
    let failed = |reason: String| BenchError::Run { room: "overhead".into(), reason };
    let player = Arc::new(AtOnce(Mutex::default()));
    let cast = Cast { vision_language: player.clone(), ..offline.clone() };
    let book = Arc::new(CallBook::open(out, BookOptions::default()).map_err(|e| failed(e.to_string()))?);
    let calls = Calls::new(book, cast, offline.clone(), CallOptions::default());
    let question = |i: usize| VlmRequest {
        name: format!("1_layout/q_{i}"),
        prompt: "What is there?".into(),
        pictures: Vec::new(),
        schema: json!({ "type": "object" }),
        example: json!({ "items": [] }),
        question: None,
    };
    let questions: Vec<VlmRequest> = (0..count).map(question).collect();
    let (crowd, row) = questions.split_at(count / 2);
    let waiting = crowd.iter().map(|q| calls.ask(q, |_| Ok(())));
    for answer in futures::future::join_all(waiting).await {
        answer.map_err(|e| failed(e.to_string()))?;
    }
    let times = std::mem::take(&mut *player.0.lock().unwrap_or_else(PoisonError::into_inner));
    let mut gaps: Vec<Duration> = times.windows(2).map(|w| w[1].duration_since(w[0])).collect();
    gaps.sort();
    let clock = std::time::Instant::now();
    for q in row {
        calls.ask(q, |_| Ok(())).await.map_err(|e| failed(e.to_string()))?;
    }
    let whole = clock.elapsed().div_f64(row.len().max(1) as f64);
    Ok(Overhead { handover: gaps.get(gaps.len() / 2).copied().unwrap_or_default(), whole })
}
