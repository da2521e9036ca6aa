//! The point map: one 3D point a pixel.

use glam::{DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::{ImageSize, Intrinsics};

/// What the points of a map mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PointMapKind {
    /// Every pixel's own surface, up to one unknown scale (VGGT and its like).
    Relative,
    /// Every pixel's own surface in metres (a depth sensor).
    Metric,
    /// Only the empty room behind the objects (the offline estimator): no depth of any object.
    RoomBox,
}

/// A grid of points in the estimator's own frame, and the camera they were seen by.
///
/// The estimator's frame is right-handed; `camera_from_points` is OpenCV (x right, y down, z forward).
#[derive(Debug, Clone, PartialEq)]
pub struct PointMap {
    /// What the points mean.
    pub kind: PointMapKind,
    /// Grid size; row-major like an image.
    pub size: ImageSize,
    /// Points in the `points` frame; NaN where there is none.
    pub xyz: Vec<Vec3>,
    /// Confidence, larger is better, 0 = none; the same length as `xyz`.
    pub confidence: Vec<f32>,
    /// Pinhole parameters in pixels of `size`.
    pub intrinsics: Intrinsics,
    /// `camera_from_points` rotation, the paper's `R_0`.
    pub rotation: DMat3,
    /// `camera_from_points` translation, the paper's `t_0`, in the map's unit.
    pub translation: DVec3,
}

impl PointMap {
    /// A map from planar depth in the camera's own frame (`R_0 = I`, `t_0 = 0`); 0 or NaN = no reading.
    ///
    /// # Panics
    /// When `depth` has not one value a pixel.
    pub fn from_depth(kind: PointMapKind, size: ImageSize, intrinsics: Intrinsics, depth: &[f32]) -> Self {
        assert_eq!(depth.len(), size.pixels(), "one depth a pixel");
        let mut xyz = Vec::with_capacity(depth.len());
        let mut confidence = Vec::with_capacity(depth.len());
        for (i, z) in depth.iter().enumerate() {
            let pixel =
                glam::DVec2::new(f64::from(i as u32 % size.width) + 0.5, f64::from(i as u32 / size.width) + 0.5);
            if z.is_finite() && *z > 0.0 {
                xyz.push((intrinsics.direction(pixel) * f64::from(*z)).as_vec3());
                confidence.push(1.0);
            } else {
                xyz.push(Vec3::NAN);
                confidence.push(0.0);
            }
        }
        Self { kind, size, xyz, confidence, intrinsics, rotation: DMat3::IDENTITY, translation: DVec3::ZERO }
    }

    /// The same depths on the rays of another focal length (pixels of this map); frame and scale stay.
    #[must_use]
    pub fn with_focal(&self, focal_px: f64) -> Self {
        let ratio = focal_px / self.intrinsics.fx;
        let intrinsics =
            Intrinsics { fx: self.intrinsics.fx * ratio, fy: self.intrinsics.fy * ratio, ..self.intrinsics };
        let points_from_camera = self.rotation.transpose();
        let moved = |p: &Vec3| {
            let mut c = self.rotation * p.as_dvec3() + self.translation;
            c.x /= ratio;
            c.y /= ratio;
            (points_from_camera * (c - self.translation)).as_vec3()
        };
        let xyz = self.xyz.iter().map(moved).collect();
        Self { xyz, confidence: self.confidence.clone(), intrinsics, ..*self }
    }

    /// The point at (column, row), if there is one.
    pub fn at(&self, x: u32, y: u32) -> Option<DVec3> {
        let i = y as usize * self.size.width as usize + x as usize;
        let p = *self.xyz.get(i)?;
        (p.is_finite() && self.confidence[i] > 0.0).then(|| p.as_dvec3())
    }

    /// Camera centre in the `points` frame, the paper's `c_0`.
    pub fn camera_centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }
}
