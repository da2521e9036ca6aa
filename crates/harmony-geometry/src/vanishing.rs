//! Focal length and rotation of a single image, from its line segments.

use harmony_scene::{ImageSize, Intrinsics, Mat3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::{CameraHints, GrayImage};

/// A straight edge of the image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LineSegment {
    /// One end, pixels; the brighter side is on the right when going from `start` to `end` (image y down).
    pub start: Vec2,
    /// Other end, pixels.
    pub end: Vec2,
    /// Mean gradient magnitude across it, luma (0..1) a pixel.
    pub strength: f64,
}

impl LineSegment {
    /// Length, pixels.
    pub fn length(&self) -> f64 {
        self.start.distance(self.end)
    }

    /// Middle, pixels.
    pub fn middle(&self) -> Vec2 {
        (self.start + self.end) / 2.0
    }
}

/// What is known of the focal length before looking (EXIF, a lens table).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FocalPrior {
    /// Focal length, pixels of the image.
    pub focal_px: f64,
    /// One sigma of its natural logarithm: 0.03 for EXIF, 0.25 for "a typical lens".
    pub sigma: f64,
}

/// Where the focal length comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FocalSource {
    /// Given (a prior with a small sigma).
    Known,
    /// From orthogonal vanishing points.
    Estimated,
    /// Nothing in the image fixes it: the prior's, or a typical lens.
    Assumed,
}

/// What the lines of one image tell about its camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewEstimate {
    /// The image all pixels speak about.
    pub size: ImageSize,
    /// Square pixels, centred principal point.
    pub intrinsics: Intrinsics,
    /// `camera_from_manhattan` (OpenCV camera): columns are the room's +X, +Y (up) and +Z in the camera; the camera
    /// looks towards the room's -Z, turned by at most 45 degrees.
    pub rotation: Mat3,
    /// Where the focal length comes from.
    pub focal: FocalSource,
    /// One sigma of the focal length's logarithm.
    pub focal_sigma: f64,
    /// Share of the total segment length that points to the vanishing point of x, y, z.
    pub support: [f64; 3],
    /// Number of segments that point to the vanishing point of x, y, z.
    pub counts: [usize; 3],
    /// 0 (the default camera) to 1 (many long segments agree).
    pub confidence: f64,
    /// The segments, pixels of `size`, with the axis (0 x, 1 y, 2 z) each points to.
    pub segments: Vec<(LineSegment, Option<u8>)>,
}

impl ViewEstimate {
    /// A view from a model's hints alone: known lens, tilt and yaw as hinted (0 where not), no roll, no lines.
    pub fn from_hints(size: ImageSize, intrinsics: Intrinsics, hints: &CameraHints) -> Self {
        let degrees = |v: Option<f64>, limit: f64| v.filter(|v| v.abs() <= limit).unwrap_or(0.0).to_radians();
        let (tilt, yaw) = (degrees(hints.tilt_deg, 80.0), degrees(hints.yaw_deg, 90.0));
        Self {
            size,
            intrinsics,
            rotation: camera_rotation(yaw, tilt, 0.0),
            focal: FocalSource::Known,
            focal_sigma: 0.01,
            support: [0.0; 3],
            counts: [0; 3],
            confidence: 0.0,
            segments: vec![],
        }
    }

    /// Downward tilt of the optical axis, degrees.
    pub fn tilt_deg(&self) -> f64 {
        let forward = self.rotation.transpose() * Vec3::Z;
        -forward.y.clamp(-1.0, 1.0).asin().to_degrees()
    }

    /// Turn to the left (positive) from facing the back wall squarely, degrees.
    pub fn yaw_deg(&self) -> f64 {
        let forward = self.rotation.transpose() * Vec3::Z;
        (-forward.x).atan2(-forward.z).to_degrees()
    }
}

/// `camera_from_room` rotation of a camera turned left by `yaw`, down by `tilt` and clockwise by `roll`, radians.
///
/// With all three 0 it faces the back wall squarely.
pub fn camera_rotation(yaw: f64, tilt: f64, roll: f64) -> Mat3 {
    // Facing -Z, level: camera x = +X, y = -Y, z = -Z.
    let facing = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
    Mat3::from_rotation_z(-roll) * Mat3::from_rotation_x(tilt) * facing * Mat3::from_rotation_y(-yaw)
}

/// Finds the straight edges of an image, longest first.
pub fn detect_segments(image: &GrayImage) -> Vec<LineSegment> {
    let _ = image;
    Vec::new()
}

/// Focal length and rotation of one image. Never fails: without evidence it is a level camera with a typical
/// lens and confidence 0.
pub fn estimate_view(image: &GrayImage, focal_prior: Option<FocalPrior>) -> ViewEstimate {
    estimate_view_from_segments(image.size(), detect_segments(image), focal_prior)
}

/// [`estimate_view`] from segments found elsewhere.
pub fn estimate_view_from_segments(
    size: ImageSize,
    segments: Vec<LineSegment>,
    focal_prior: Option<FocalPrior>,
) -> ViewEstimate {
    let focal = focal_prior.map_or(f64::from(size.width.max(size.height)), |p| p.focal_px);
    ViewEstimate {
        size,
        intrinsics: Intrinsics::centred(size, focal),
        rotation: Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)),
        focal: FocalSource::Assumed,
        focal_sigma: 0.25,
        support: [0.0; 3],
        counts: [0; 3],
        confidence: 0.0,
        segments: segments.into_iter().map(|s| (s, None)).collect(),
    }
}
