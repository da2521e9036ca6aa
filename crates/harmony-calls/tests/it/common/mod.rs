//! Scripted players and small requests.
#![allow(dead_code, clippy::unwrap_used, reason = "every test file uses its own part of these helpers")]

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use async_trait::async_trait;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast};
use harmony_mesh::{ConvexPart, Group, Material, Mesh};
use harmony_roles::{
    DetectRequest, Detection, Detections, Detector, EditRequest, EditedImage, GeneratedMesh, GeometryAnswer,
    GeometryEstimator, GeometryRequest, ImageEditor, LitImage, LitRenderer, LitRequest, MeshFrame, MeshGenerator,
    MeshRequest, Picture, PlayerCard, RoleError, SegmentRequest, SegmentedMask, Segmenter, Usage, VisionLanguage,
    VlmAnswer, VlmRequest,
};
use harmony_scene::{ImageSize, Intrinsics, Mask, PointMap, PointMapKind, Warning};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json};

/// What a scripted language model says next.
pub enum Say {
    Value(Value),
    Fail(fn() -> RoleError),
}

/// Says what it is told to, in order, and remembers what it was asked.
pub struct Scripted {
    pub card: PlayerCard,
    pub lines: Mutex<VecDeque<Say>>,
    pub heard: Mutex<Vec<VlmRequest>>,
}

impl Scripted {
    pub fn new(player: &str, offline: bool, lines: Vec<Say>) -> Arc<Self> {
        Arc::new(Self { card: card(player, offline), lines: Mutex::new(lines.into()), heard: Mutex::default() })
    }

    pub fn saying(player: &str, offline: bool, values: &[Value]) -> Arc<Self> {
        Self::new(player, offline, values.iter().cloned().map(Say::Value).collect())
    }

    pub fn asked(&self) -> usize {
        self.heard.lock().unwrap().len()
    }
}

pub fn card(player: &str, offline: bool) -> PlayerCard {
    PlayerCard { player: player.into(), model: "test 1".into(), offline, concurrency: 0 }
}

#[async_trait]
impl VisionLanguage for Scripted {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        self.heard.lock().unwrap().push(request.clone());
        tokio::task::yield_now().await;
        match self.lines.lock().unwrap().pop_front() {
            Some(Say::Value(value)) => Ok(VlmAnswer {
                raw: value.to_string(),
                value,
                usage: Usage { input_tokens: 100, output_tokens: 10, cost_usd: Some(0.5), ..Usage::default() },
            }),
            Some(Say::Fail(error)) => Err(error()),
            None => Err(RoleError::Refused { player: self.card.player.clone(), reason: "nothing more to say".into() }),
        }
    }
}

/// Plays every role but the first in a fixed way; `hostile` answers are unusable.
pub struct Everyone {
    pub card: PlayerCard,
    pub hostile: bool,
    pub asked: Mutex<usize>,
}

impl Everyone {
    pub fn new(player: &str, offline: bool, hostile: bool) -> Arc<Self> {
        Arc::new(Self { card: card(player, offline), hostile, asked: Mutex::new(0) })
    }

    fn count(&self) {
        *self.asked.lock().unwrap() += 1;
    }
}

#[async_trait]
impl Detector for Everyone {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        self.count();
        let x1 = if self.hostile { f64::NAN } else { f64::from(request.image.width()) / 3.0 };
        let bounds = harmony_scene::PixelBox { x0: 1.0, y0: 2.0, x1, y1: 9.5 };
        let one = Detection { label: "chair".into(), phrase: "chair".into(), bounds, score: Some(0.1), outline: None };
        Ok(Detections { detections: vec![one], ..Detections::default() })
    }
}

#[async_trait]
impl Segmenter for Everyone {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        self.count();
        let size = ImageSize::new(request.image.width(), request.image.height());
        let size = if self.hostile { ImageSize::new(3, 3) } else { size };
        let mask = |i: usize| Mask::from_fn(size, |x, y| ((x + y) as usize).is_multiple_of(i + 2));
        Ok((0..request.prompts.len()).map(|i| SegmentedMask { mask: mask(i), score: None }).collect())
    }
}

#[async_trait]
impl ImageEditor for Everyone {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError> {
        self.count();
        let (w, h) = if self.hostile { (1, 1) } else { request.image.dimensions() };
        let image = RgbaImage::from_fn(w, h, |x, y| Rgba([x as u8, y as u8, 7, (x * y) as u8]));
        Ok(EditedImage { image, usage: Usage::default() })
    }
}

/// A textured triangle pair with values that a lossy store would change.
pub fn small_mesh(bad: f32) -> Mesh {
    let texture = RgbaImage::from_fn(5, 3, |x, y| Rgba([(x * 50) as u8, (y * 80) as u8, 3, 255]));
    let mut material = Material::plain("legs", [0.1, 0.2, 1.0 / 3.0]);
    material.texture = Some(Arc::new(texture));
    material.transmission = 0.25;
    material.ior = 1.45;
    let p = |x: f32, y: f32, z: f32| glam::Vec3::new(x, y, z);
    Mesh {
        metric_uvs: Vec::new(),
        colors: Vec::new(),
        positions: vec![p(0.0, bad, 0.0), p(1.0 / 3.0, 0.0, 0.0), p(0.0, 0.7, 0.0), p(0.3, 0.7, 0.1)],
        normals: vec![glam::Vec3::Z; 4],
        uvs: vec![glam::Vec2::new(0.1, 0.9); 4],
        groups: vec![
            Group { material: 1, triangles: vec![[0, 1, 2]] },
            Group { material: 0, triangles: vec![[1, 3, 2]] },
        ],
        materials: vec![Material::plain("body", [0.5, 0.5, 0.5]), material],
    }
}

#[async_trait]
impl MeshGenerator for Everyone {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn generate(&self, request: &MeshRequest) -> Result<GeneratedMesh, RoleError> {
        self.count();
        let bad = if self.hostile { f32::INFINITY } else { 0.0 };
        let part = ConvexPart { points: vec![glam::Vec3::new(0.1, 0.2, 1.0 / 3.0), glam::Vec3::ONE] };
        Ok(GeneratedMesh {
            mesh: Arc::new(small_mesh(bad)),
            convex: Some(vec![part]),
            frame: MeshFrame::Raw,
            part_model: None,
            source: format!("test {}", request.label),
            notes: vec!["a note".into()],
            usage: Usage::default(),
        })
    }
}

#[async_trait]
impl GeometryEstimator for Everyone {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn estimate(&self, _request: &GeometryRequest) -> Result<GeometryAnswer, RoleError> {
        self.count();
        // The grid has another shape than the photo, as estimators' grids have.
        let size = ImageSize::new(8, 6);
        let intrinsics = Intrinsics { fx: 7.3, fy: 7.1, cx: 4.1, cy: 2.9 };
        let depth: Vec<f32> =
            (0..48).map(|i| if i == 5 || self.hostile { 0.0 } else { 1.0 + i as f32 / 7.0 }).collect();
        let map = PointMap::from_depth(PointMapKind::Relative, size, intrinsics, &depth);
        Ok(GeometryAnswer::Points(Arc::new(map)))
    }
}

#[async_trait]
impl LitRenderer for Everyone {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn render(&self, request: &LitRequest) -> Result<LitImage, RoleError> {
        self.count();
        let size = request.camera.size;
        Ok(LitImage { image: RgbImage::from_pixel(size.width, size.height, Rgb([9, 8, 7])), measured: None })
    }
}

/// A cast with a scripted language model.
pub fn cast(vlm: &Arc<Scripted>, others: &Arc<Everyone>) -> Cast {
    Cast {
        vision_language: vlm.clone(),
        image_editor: others.clone(),
        mesh_generator: others.clone(),
        geometry_estimator: others.clone(),
        detector: others.clone(),
        segmenter: others.clone(),
        lit_renderer: others.clone(),
    }
}

/// Calls into a run folder, and the warnings they make.
pub struct Desk {
    pub calls: Arc<Calls>,
    pub warnings: Arc<Mutex<Vec<Warning>>>,
}

impl Desk {
    pub fn open(run: &Path, options: BookOptions, vlm: &Arc<Scripted>, offline: &Arc<Scripted>) -> Self {
        let others = Everyone::new("others", true, false);
        Self::with(run, options, cast(vlm, &others), cast(offline, &others))
    }

    pub fn with(run: &Path, options: BookOptions, cast: Cast, offline: Cast) -> Self {
        Self::limited(run, options, cast, offline, CallOptions::default())
    }

    /// With budgets, limits and prices; waits are drawn at their upper bound.
    pub fn limited(run: &Path, options: BookOptions, cast: Cast, offline: Cast, how: CallOptions) -> Self {
        let warnings: Arc<Mutex<Vec<Warning>>> = Arc::default();
        let sink = warnings.clone();
        let options_of_calls = CallOptions {
            on_warning: Arc::new(move |w| sink.lock().unwrap().push(w)),
            random: Arc::new(|| 1.0),
            ..how
        };
        let book = Arc::new(CallBook::open(run, options).unwrap());
        Self { calls: Arc::new(Calls::new(book, cast, offline, options_of_calls)), warnings }
    }

    pub fn warnings(&self) -> Vec<Warning> {
        self.warnings.lock().unwrap().clone()
    }
}

/// A question for a width, with one small picture.
pub fn width_question(name: &str) -> VlmRequest {
    VlmRequest {
        name: name.into(),
        prompt: "How wide is the room?".into(),
        pictures: vec![Picture { caption: "IMAGE 1: the photo".into(), image: photo() }],
        schema: json!({
            "type": "object",
            "properties": {"width_m": {"type": "number"}},
            "required": ["width_m"],
            "additionalProperties": false
        }),
        example: json!({"width_m": 3.0}),
        question: None,
    }
}

pub fn photo() -> Arc<RgbImage> {
    Arc::new(RgbImage::from_fn(16, 10, |x, y| Rgb([(x * 16) as u8, (y * 25) as u8, 99])))
}

/// A width that makes sense.
pub fn sane(value: &Value) -> Result<(), String> {
    let width = value["width_m"].as_f64().ok_or("width_m is not a number")?;
    if (1.0..20.0).contains(&width) { Ok(()) } else { Err(format!("width_m is {width}; expected 1 to 20")) }
}

/// Every file below a folder with its bytes, but for `timing.json`, sorted.
pub fn tree(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    fn walk(root: &Path, folder: &Path, files: &mut Vec<(PathBuf, Vec<u8>)>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(root, &path, files);
            } else if path.file_name().unwrap() != "timing.json" {
                files.push((path.strip_prefix(root).unwrap().to_owned(), std::fs::read(&path).unwrap()));
            }
        }
    }
    let mut files = Vec::new();
    walk(folder, folder, &mut files);
    files.sort();
    files
}
