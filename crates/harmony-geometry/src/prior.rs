//! What is believed about a room before it is measured.
//!
//! A language model's answer, a default, or a person's pins, in one form: size of the room, hints of the camera, points
//! on room edges. Pixels are those of the photo at `photo` size, lengths metres of the room frame, angles degrees where
//! the name says so. Every part may be missing or wrong; who uses it gives it a sigma.

use harmony_scene::{Extents, ImageSize, Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// On which side of the deepest corner the back wall lies, in the photo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WallSide {
    /// The corner is the back wall's right end.
    Left,
    /// The corner is the back wall's left end.
    Right,
    /// The camera faces the back wall squarely.
    Both,
}

/// What a model says about the camera; every part may be missing, and none is trusted.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CameraHints {
    /// Above the floor, metres.
    pub height_m: Option<f64>,
    /// Downward tilt of the optical axis, degrees.
    pub tilt_deg: Option<f64>,
    /// Turn to the left (positive) from facing the back wall squarely, degrees.
    pub yaw_deg: Option<f64>,
    /// Along the floor, camera to back wall, metres.
    pub dist_to_back_m: Option<f64>,
    /// Deepest visible floor corner, photo pixels.
    pub corner_px: Option<[f64; 2]>,
    /// Side of that corner on which the back wall lies.
    pub back_wall_side: Option<WallSide>,
    /// Row of the junction of floor and back wall, fraction of the image height, 0 = top.
    pub floor_junction_y_frac: Option<f64>,
}

/// An edge of the room box that a photo can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoomEdge {
    /// Floor meets back wall: y = 0, z = 0.
    FloorBack,
    /// Floor meets left wall: x = 0, y = 0.
    FloorLeft,
    /// Floor meets right wall: x = W, y = 0.
    FloorRight,
    /// Ceiling meets back wall: y = H, z = 0.
    CeilingBack,
    /// Ceiling meets left wall: x = 0, y = H.
    CeilingLeft,
    /// Ceiling meets right wall: x = W, y = H.
    CeilingRight,
    /// Vertical edge of back and left wall: x = 0, z = 0.
    BackLeft,
    /// Vertical edge of back and right wall: x = W, z = 0.
    BackRight,
}

impl RoomEdge {
    /// All eight.
    pub const ALL: [Self; 8] = [
        Self::FloorBack,
        Self::FloorLeft,
        Self::FloorRight,
        Self::CeilingBack,
        Self::CeilingLeft,
        Self::CeilingRight,
        Self::BackLeft,
        Self::BackRight,
    ];

    /// A point of the edge and its unit direction, room frame.
    pub fn line(self, e: &Extents) -> (Vec3, Vec3) {
        let (w, h) = (e.width, e.height);
        match self {
            Self::FloorBack => (Vec3::ZERO, Vec3::X),
            Self::FloorLeft => (Vec3::ZERO, Vec3::Z),
            Self::FloorRight => (Vec3::new(w, 0.0, 0.0), Vec3::Z),
            Self::CeilingBack => (Vec3::new(0.0, h, 0.0), Vec3::X),
            Self::CeilingLeft => (Vec3::new(0.0, h, 0.0), Vec3::Z),
            Self::CeilingRight => (Vec3::new(w, h, 0.0), Vec3::Z),
            Self::BackLeft => (Vec3::ZERO, Vec3::Y),
            Self::BackRight => (Vec3::new(w, 0.0, 0.0), Vec3::Y),
        }
    }
}

/// Points seen on one edge, photo pixels. One point already helps; two far apart fix the line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PinnedEdge {
    /// Which edge.
    pub edge: RoomEdge,
    /// Points on it, photo pixels.
    pub points: Vec<Vec2>,
}

/// Where room edges are in the photo.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct LayoutPins {
    /// Edges.
    pub edges: Vec<PinnedEdge>,
}

impl LayoutPins {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.edges.iter().all(|e| e.points.is_empty())
    }
}

/// The layout as a model (or a default) believes it to be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LayoutPrior {
    /// Size of the photo that all pixels of the prior speak about.
    pub photo: ImageSize,
    /// Room size, metres. The height carries the metric scale.
    pub extents: Extents,
    /// Whether the photo shows the ceiling; where it does not, its height is a guess, and too low if the photo would show it.
    pub ceiling_seen: bool,
    /// Camera.
    pub camera: CameraHints,
    /// Room edges in the photo.
    pub pins: LayoutPins,
    /// Outlines of what the photo shows of other rooms, through openings without a leaf: no evidence for this one.
    pub passages: Vec<Vec<Vec2>>,
}

impl LayoutPrior {
    /// A prior that knows nothing: a 4 x 2.5 x 5 m room.
    pub fn unknown(photo: ImageSize) -> Self {
        Self {
            photo,
            extents: Extents { width: 4.0, height: 2.5, depth: 5.0 },
            ceiling_seen: true,
            camera: CameraHints::default(),
            pins: LayoutPins::default(),
            passages: Vec::new(),
        }
    }
}
