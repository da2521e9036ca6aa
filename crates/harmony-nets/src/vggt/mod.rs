//! VGGT (Wang et al., CVPR 2025): photos to cameras, depth, points and confidences in one forward pass.
//!
//! Everything here is in the network's own conventions: pixel indices are integers (the centre of the top-left pixel
//! is (0, 0)), the principal point is `(W/2, H/2)`. `VggtEstimator` (feature `players`) carries the results over into ours.

#![allow(clippy::missing_errors_doc, reason = "loading: weights that do not fit; running: what the backend says")]

mod aggregator;
mod block;
mod camera_head;
mod config;
mod dense_head;
#[cfg(feature = "players")]
mod estimator;
mod preprocess;

pub use config::VggtConfig;
#[cfg(feature = "players")]
pub use estimator::{Device, VggtEstimator};
pub use preprocess::{Frame, Photo, WIDTH, preprocess};

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use aggregator::{Aggregator, TrunkTables};
use camera_head::{CameraHead, POSE};
use dense_head::{DenseHead, HeadTables};

use rayon::prelude::*;

use crate::{Backend, DType, HostTensor, NetError, Weights};

/// Mean of the pixels that the network was trained on, RGB in 0..1.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Their standard deviation.
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// Which heads to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heads {
    /// Depth and its confidence.
    pub depth: bool,
    /// World points and their confidence, where the file has the head.
    pub points: bool,
}

/// What the network says of one frame. Maps are row-major, one value a pixel of the preprocessed image.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameGeometry {
    /// Translation, quaternion (x, y, z, w; not normalised), vertical and horizontal field of view in radians;
    /// camera from world, OpenCV axes.
    pub pose: [f32; POSE],
    /// Planar depth in the network's own unit, positive; empty when not asked for.
    pub depth: Vec<f32>,
    /// Confidence of the depth, from 1.
    pub depth_confidence: Vec<f32>,
    /// Points in the world (the first camera's frame, about); empty when not asked for or not there.
    pub points: Vec<[f32; 3]>,
    /// Confidence of the points, from 1.
    pub point_confidence: Vec<f32>,
}

/// The network on a backend.
pub struct Vggt<B: Backend> {
    config: VggtConfig,
    aggregator: Aggregator<B>,
    camera: CameraHead<B>,
    depth: DenseHead<B>,
    points: Option<DenseHead<B>>,
    /// Tells recordings of several networks on one device apart.
    id: u64,
    /// Tables of the size that was run last.
    tables: Mutex<Option<Arc<Tables<B>>>>,
}

/// Tables of one size of photos: number, rows and columns of patches.
struct Tables<B: Backend> {
    size: (usize, usize, usize),
    trunk: TrunkTables<B>,
    head: HeadTables<B>,
}

static NEXT: AtomicU64 = AtomicU64::new(0);

impl<B: Backend> Vggt<B> {
    /// Loads the network; sizes are read from the file. The trunk computes in the backend's preferred type, the heads
    /// in f32 as in the reference.
    pub fn load(backend: &B, weights: &Weights<'_>) -> Result<Self, NetError> {
        Self::load_with(backend, weights, DType::F32)
    }

    /// The same with heads that compute in another type (their last layers stay f32): bf16 is several times as quick on
    /// GPUs.
    pub fn load_with(backend: &B, weights: &Weights<'_>, heads: DType) -> Result<Self, NetError> {
        let config = VggtConfig::of(weights)?;
        let points = config
            .points
            .then(|| DenseHead::load(backend, &weights.at("point_head"), &config, 4, heads))
            .transpose()?;
        Ok(Self {
            aggregator: Aggregator::load(backend, weights, &config)?,
            camera: CameraHead::load(backend, weights, &config, heads)?,
            depth: DenseHead::load(backend, &weights.at("depth_head"), &config, 2, heads)?,
            points,
            config,
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            tables: Mutex::default(),
        })
    }

    /// Its sizes.
    pub fn config(&self) -> &VggtConfig {
        &self.config
    }

    /// Runs it on preprocessed frames of one size.
    ///
    /// # Errors
    /// [`NetError::Input`] for no frames, frames of different sizes, or sides that are no multiple of the patch.
    pub fn run(&self, backend: &B, frames: &[Frame], heads: Heads) -> Result<Vec<FrameGeometry>, NetError> {
        let wrong = |reason: String| NetError::Input { network: "VGGT", reason };
        let (images, grid) = self.pixels(backend, frames)?;
        let tables = self.tables(backend, frames.len(), grid)?;
        let key = self.key(frames.len(), grid, heads);
        let results =
            backend.replayable(&key, &[&images], &mut |inputs| self.network(backend, inputs, &tables, grid, heads))?;
        let (pose, maps) = results.split_first().ok_or_else(|| wrong("a network without results".into()))?;
        let (depth, points) = maps.split_at(if heads.depth { frames.len() } else { 0 });
        let poses = backend.read(pose)?;
        let mut out: Vec<FrameGeometry> = poses
            .as_chunks::<POSE>()
            .0
            .iter()
            .map(|raw| {
                let mut pose = *raw;
                pose[7..].iter_mut().for_each(|fov| *fov = fov.max(0.0));
                let (depth, depth_confidence) = (Vec::new(), Vec::new());
                FrameGeometry { pose, depth, depth_confidence, points: Vec::new(), point_confidence: Vec::new() }
            })
            .collect();
        let read = |maps: &[B::Tensor]| maps.iter().map(|map| backend.read(map)).collect::<Result<Vec<_>, _>>();
        let (depth, points) = (read(depth)?, read(points)?);
        out.par_iter_mut().zip(&depth).for_each(|(frame, map)| {
            let cells = map.as_chunks::<2>().0;
            frame.depth = cells.par_iter().map(|[v, _]| v.exp()).collect();
            frame.depth_confidence = cells.par_iter().map(|[_, c]| 1.0 + c.exp()).collect();
        });
        out.par_iter_mut().zip(&points).for_each(|(frame, map)| {
            let cells = map.as_chunks::<4>().0;
            let unlog = |v: f32| v.signum() * v.abs().exp_m1();
            frame.points = cells.par_iter().map(|[x, y, z, _]| [unlog(*x), unlog(*y), unlog(*z)]).collect();
            frame.point_confidence = cells.par_iter().map(|[_, _, _, c]| 1.0 + c.exp()).collect();
        });
        Ok(out)
    }

    fn key(&self, frames: usize, (rows, columns): (usize, usize), heads: Heads) -> String {
        format!("vggt {} {frames}x{rows}x{columns} {heads:?}", self.id)
    }

    /// Normalised photos `[S, H, W, 3]` on the device, and the rows and columns of patches of each.
    fn pixels(&self, backend: &B, frames: &[Frame]) -> Result<(B::Tensor, (usize, usize)), NetError> {
        let wrong = |reason: String| NetError::Input { network: "VGGT", reason };
        let first = frames.first().ok_or_else(|| wrong("no photo".into()))?;
        let (width, height, patch) = (first.width, first.height, self.config.patch);
        if frames.iter().any(|f| (f.width, f.height) != (width, height)) {
            return Err(wrong("photos of different shapes".into()));
        }
        if width == 0 || height == 0 || !width.is_multiple_of(patch) || !height.is_multiple_of(patch) {
            return Err(wrong(format!("{width}x{height} pixels, wanted multiples of {patch}")));
        }
        let of_frame =
            |f: &Frame| f.rgb.par_iter().enumerate().map(|(i, v)| (v - MEAN[i % 3]) / DEVIATION[i % 3]).collect();
        let pixels = frames.par_iter().map(of_frame).collect::<Vec<Vec<f32>>>().concat();
        let images = backend.load(&HostTensor::from_f32(&[frames.len(), height, width, 3], pixels), DType::F32)?;
        Ok((images, (height / patch, width / patch)))
    }

    /// Milliseconds of the network alone, with the pixels on the device and the outputs left there; for benchmarks.
    /// `recorded`: as [`Self::run`] does it, which the backend may replay; else operation by operation.
    pub fn timed(&self, backend: &B, frames: &[Frame], heads: Heads, recorded: bool) -> Result<f64, NetError> {
        let (images, grid) = self.pixels(backend, frames)?;
        let tables = self.tables(backend, frames.len(), grid)?;
        let key = self.key(frames.len(), grid, heads);
        backend.read(&backend.slice(&images, 0, 0, 1)?)?;
        let start = std::time::Instant::now();
        let body = &mut |inputs: &[B::Tensor]| self.network(backend, inputs, &tables, grid, heads);
        let results = if recorded { backend.replayable(&key, &[&images], body)? } else { body(&[images])? };
        if let Some(pose) = results.first() {
            // The few numbers of the pose; work before and after them is on one queue, so the last map is waited for too.
            backend.read(pose)?;
        }
        if let Some(last) = results.last() {
            backend.read(&backend.slice(last, 1, 0, 1)?)?;
        }
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Everything between the pixels and the raw outputs: the pose, then the depth maps, then the point maps.
    fn network(
        &self,
        backend: &B,
        inputs: &[B::Tensor],
        tables: &Tables<B>,
        grid: (usize, usize),
        heads: Heads,
    ) -> Result<Vec<B::Tensor>, NetError> {
        let wrong = |reason: &str| NetError::Input { network: "VGGT", reason: reason.into() };
        let images = inputs.first().ok_or_else(|| wrong("no photo"))?;
        let aggregated = self.aggregator.run(backend, images, &tables.trunk)?;
        let last = aggregated.levels.last().ok_or_else(|| wrong("a network without levels"))?;
        let mut results = vec![self.camera.run(backend, last)?];
        let depth = heads.depth.then_some(&self.depth);
        for head in [depth, self.points.as_ref().filter(|_| heads.points)].into_iter().flatten() {
            results.extend(head.run(backend, &aggregated.levels, aggregated.special, grid, &tables.head)?);
        }
        Ok(results)
    }

    fn tables(&self, backend: &B, frames: usize, grid: (usize, usize)) -> Result<Arc<Tables<B>>, NetError> {
        let mut last = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        let size = (frames, grid.0, grid.1);
        if let Some(tables) = last.as_ref().filter(|t| t.size == size) {
            return Ok(Arc::clone(tables));
        }
        *last = None;
        let trunk = self.aggregator.tables(backend, frames, grid)?;
        let tables = Arc::new(Tables { size, trunk, head: self.depth.tables(backend, grid)? });
        *last = Some(Arc::clone(&tables));
        Ok(tables)
    }
}
