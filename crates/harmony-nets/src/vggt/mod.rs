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

use aggregator::Aggregator;
use camera_head::{CameraHead, POSE};
use dense_head::DenseHead;

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
}

impl<B: Backend> Vggt<B> {
    /// Loads the network; sizes are read from the file.
    pub fn load(backend: &B, weights: &Weights<'_>) -> Result<Self, NetError> {
        let config = VggtConfig::of(weights)?;
        let points =
            config.points.then(|| DenseHead::load(backend, &weights.at("point_head"), &config, 4)).transpose()?;
        Ok(Self {
            aggregator: Aggregator::load(backend, weights, &config)?,
            camera: CameraHead::load(backend, weights, &config)?,
            depth: DenseHead::load(backend, &weights.at("depth_head"), &config, 2)?,
            points,
            config,
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
        let first = frames.first().ok_or_else(|| wrong("no photo".into()))?;
        let (width, height, patch) = (first.width, first.height, self.config.patch);
        if frames.iter().any(|f| (f.width, f.height) != (width, height)) {
            return Err(wrong("photos of different shapes".into()));
        }
        if width == 0 || height == 0 || !width.is_multiple_of(patch) || !height.is_multiple_of(patch) {
            return Err(wrong(format!("{width}x{height} pixels, wanted multiples of {patch}")));
        }
        let mut pixels = Vec::with_capacity(frames.len() * width * height * 3);
        for frame in frames {
            pixels.extend(frame.rgb.iter().enumerate().map(|(i, v)| (v - MEAN[i % 3]) / DEVIATION[i % 3]));
        }
        let images = backend.load(&HostTensor::from_f32(&[frames.len(), height, width, 3], pixels), DType::F32)?;
        let grid = (height / patch, width / patch);
        let aggregated = self.aggregator.run(backend, &images)?;
        let last = aggregated.levels.last().ok_or_else(|| wrong("a network without levels".into()))?;
        let poses = backend.read(&self.camera.run(backend, last)?)?;
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
        if heads.depth {
            let maps = self.depth.run(backend, &aggregated.levels, aggregated.special, grid)?;
            for (frame, map) in out.iter_mut().zip(maps) {
                let map = backend.read(&map)?;
                let cells = map.as_chunks::<2>().0;
                frame.depth = cells.iter().map(|[v, _]| v.exp()).collect();
                frame.depth_confidence = cells.iter().map(|[_, c]| 1.0 + c.exp()).collect();
            }
        }
        if let (true, Some(head)) = (heads.points, &self.points) {
            let maps = head.run(backend, &aggregated.levels, aggregated.special, grid)?;
            for (frame, map) in out.iter_mut().zip(maps) {
                let map = backend.read(&map)?;
                let cells = map.as_chunks::<4>().0;
                let unlog = |v: f32| v.signum() * v.abs().exp_m1();
                frame.points = cells.iter().map(|[x, y, z, _]| [unlog(*x), unlog(*y), unlog(*z)]).collect();
                frame.point_confidence = cells.iter().map(|[_, _, _, c]| 1.0 + c.exp()).collect();
            }
        }
        Ok(out)
    }
}
