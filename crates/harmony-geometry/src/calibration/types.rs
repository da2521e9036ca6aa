//! Settings, result, evidence and errors of the calibration.

use harmony_scene::{Camera, Extents, Similarity, Surface, Vec3};
use serde::{Deserialize, Serialize};

/// Constants of the calibration; the defaults are the paper's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationSettings {
    /// Floor/ceiling band, fraction of image rows (paper's rho, App. B.2).
    pub row_band: f64,
    /// Least `|normal . axis|` for a point to count toward a plane (paper's tau, App. B.2).
    pub normal_threshold: f64,
    /// Percentile to which floor and ceiling are extended (paper's p_fc, App. B.2).
    pub floor_ceiling_percentile: f64,
    /// Percentile to which walls are extended (paper's p_wall, App. B.2).
    pub wall_percentile: f64,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self { row_band: 0.2, normal_threshold: 0.7, floor_ceiling_percentile: 98.0, wall_percentile: 97.0 }
    }
}

/// How the calibration was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationMethod {
    /// Algorithm 1 of the paper.
    Manhattan,
    /// Pinned edges of the prior; the scale of the points from the box.
    Pins,
    /// The prior's camera; the scale of the points from the box.
    PriorCamera,
}

/// What the anchor is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AnchorKind {
    /// The deepest floor corner that projects into the image.
    FloorCorner,
    /// No floor corner is in the image: the farthest end of a measured wall.
    WallEnd,
    /// No two walls meet at it: a corner of the prior's box.
    Prior,
}

/// How well one face of the box was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlaneEvidence {
    /// Which face.
    pub surface: Surface,
    /// Whether it was measured.
    pub measured: bool,
    /// Distance of the face from the camera, metres.
    pub distance_m: f64,
    /// RMS distance of its inliers, metres.
    pub rms_m: f64,
    /// Points on it.
    pub inliers: usize,
    /// Share of all valid pixels that lie on it.
    pub share: f64,
}

/// What speaks for a calibration; written to `camera.json` and `manhattan.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationEvidence {
    /// How it was found.
    pub method: CalibrationMethod,
    /// Manhattan axes w, v, d in the `points` frame (unit; +X, +Y and +Z of the room).
    pub manhattan: [[f64; 3]; 3],
    /// The six faces.
    pub planes: Vec<PlaneEvidence>,
    /// What the anchor is.
    pub anchor_kind: AnchorKind,
    /// The anchor, room frame.
    pub anchor: Vec3,
    /// Where it projects, pixels of the point map; `None` behind the camera.
    pub anchor_px: Option<[f64; 2]>,
    /// Distance to the prior's corner, photo pixels.
    pub corner_reprojection_px: Option<f64>,
    /// RMS angle between counted normals and their axis, degrees.
    pub axis_agreement_deg: f64,
    /// Share of the normals that agree with the frame within 15 degrees.
    pub axis_support: f64,
    /// Rounds of the frame search.
    pub iterations: usize,
    /// What the joint refinement with the photo changed, if it ran.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<super::JointEvidence>,
    /// Where the metric scale comes from, in words.
    pub scale_source: String,
    /// Measured height over the prior's height, where both planes are seen (metric maps: the prior's error).
    pub height_ratio: Option<f64>,
    /// Every fallback that was used, in words.
    pub fallbacks: Vec<String>,
}

/// The camera in the room, and the way from the point map into it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The camera, with the point map's size and intrinsics; `camera.resized(photo)` for the photo.
    pub camera: Camera,
    /// The similarity of paper Sec. 3.1.
    pub room_from_points: Similarity,
    /// The room box.
    pub extents: Extents,
    /// Measured faces.
    pub seen: Vec<Surface>,
    /// Anchor corner (floor), room frame.
    pub anchor: Vec3,
    /// What speaks for it.
    pub evidence: CalibrationEvidence,
    /// How surely camera, room and scale are known, when the joint refinement ran.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posterior: Option<super::RoomPosterior>,
}

impl Calibration {
    /// The probability that the camera is right ([`super::RoomPosterior::camera_confidence`]); `None` where nothing refined
    /// it, so that nobody knows how far it is off.
    pub fn confidence(&self) -> Option<f64> {
        self.posterior.as_ref().map(super::RoomPosterior::camera_confidence)
    }
}

/// Calibration is impossible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// The map is (almost) empty.
    #[error("the point map has {got} usable points, at least {min} are needed")]
    TooFewPoints {
        /// Usable points.
        got: usize,
        /// Needed.
        min: usize,
    },
    /// The map's buffers don't have one entry a pixel.
    #[error("a point map of {width} x {height} pixels has {points} points and {confidences} confidences")]
    BadMap {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Points.
        points: usize,
        /// Confidences.
        confidences: usize,
    },
    /// The prior's room size is not a size.
    #[error("room prior of {width:.3} x {height:.3} x {depth:.3} m is not a room")]
    BadPrior {
        /// Metres.
        width: f64,
        /// Metres.
        height: f64,
        /// Metres.
        depth: f64,
    },
    /// The anchor edge is too short to carry the scale.
    #[error("anchor edge is {length:.4} long in the point map, at least {min:.4} is needed")]
    ShortAnchor {
        /// Edge length, in the point map's own unit.
        length: f64,
        /// Shortest edge accepted, same unit.
        min: f64,
    },
}
