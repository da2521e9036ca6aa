//! The room box of a photo without depth.
//!
//! Three ways, the surest first: least squares on pinned room edges ([`solve_from_pins`]), box edges fitted to the
//! image's lines, the prior's own numbers on the measured view. Photo pixels in, a camera and a box in metres out, room
//! frame. The metres come from told lengths, the height first of all; a photo alone has none. It never fails: the
//! method and every fallback are in the evidence.

mod appearance;
mod edges;
pub(crate) mod pins;
pub(crate) mod solved;

use harmony_scene::{Camera, Extents, ImageSize, PointMap, PointMapKind, Surface, Vec2, Vec3};
use serde::{Deserialize, Serialize};

pub use pins::solve_from_pins;
use solved::CameraBox;

use crate::{GrayImage, LayoutPrior, RoomPosterior, ViewEstimate};

/// Camera height when nobody knows: a phone held by a standing person, metres.
pub(crate) const USUAL_CAMERA_HEIGHT: f64 = 1.5;
/// Pinned points from which the pins alone place the box.
const ENOUGH_PINS: usize = 3;
/// Confidence of a view below which hinted angles are better.
const WEAK_VIEW: f64 = 0.15;

/// How a room box was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoomBoxMethod {
    /// Least squares on pinned edges.
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
    /// How surely it is known, where pins tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posterior: Option<RoomPosterior>,
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
///
/// `image` and `view` may be of any size; the result speaks of `prior.photo`.
pub fn estimate_room_box(image: &GrayImage, view: &ViewEstimate, prior: &LayoutPrior) -> RoomBox {
    let prior = &sane(prior);
    let mut notes = Vec::new();
    if pins::pinned_points(prior) >= ENOUGH_PINS {
        match pins::solve_with_image(Some(image), view, prior) {
            Ok(room) => return room,
            Err(e) => notes.push(format!("the pinned edges were not used: {e}")),
        }
    }
    let from_lines = if view.confidence >= WEAK_VIEW { edges::box_from_lines(image, view, prior) } else { None };
    let mut room = from_lines.unwrap_or_else(|| prior_box(view, prior));
    room.evidence.fallbacks.extend(notes);
    room
}

/// A prior with a usable room size.
fn sane(prior: &LayoutPrior) -> LayoutPrior {
    let usual = LayoutPrior::unknown(prior.photo).extents;
    let pick = |v: f64, low: f64, high: f64, otherwise: f64| if (low..=high).contains(&v) { v } else { otherwise };
    let extents = Extents {
        width: pick(prior.extents.width, 0.5, 100.0, usual.width),
        height: pick(prior.extents.height, 1.5, 30.0, usual.height),
        depth: pick(prior.extents.depth, 0.5, 100.0, usual.depth),
    };
    LayoutPrior { extents, ..prior.clone() }
}

/// The prior's numbers on the measured view (on the hinted angles where nothing was measured).
pub(crate) fn prior_box(view: &ViewEstimate, prior: &LayoutPrior) -> RoomBox {
    let prior = &sane(prior);
    let hints = &prior.camera;
    let Extents { width, height, depth } = prior.extents;
    let mut fallbacks = vec!["the room's size is the prior's".to_owned()];
    let degrees = |v: Option<f64>, limit: f64| v.filter(|v| v.abs() <= limit).map(f64::to_radians);
    let (mut yaw, mut tilt, mut roll) = (view.yaw_deg().to_radians(), view.tilt_deg().to_radians(), view.roll());
    if view.confidence < WEAK_VIEW {
        fallbacks.push("the image shows too few straight lines: tilt and yaw are the prior's".to_owned());
        yaw = degrees(hints.yaw_deg, 80.0).unwrap_or(yaw);
        tilt = degrees(hints.tilt_deg, 70.0).unwrap_or(tilt);
        roll = 0.0;
    }
    let floor = hints.height_m.filter(|h| (0.1..0.97 * height).contains(h));
    let floor = floor.unwrap_or(USUAL_CAMERA_HEIGHT.min(0.7 * height));
    let back = hints.dist_to_back_m.filter(|d| (0.2..=100.0).contains(d)).unwrap_or(0.75 * depth);
    // Looking to the left from the right half of the room shows most of it, and the other way round.
    let left = width * (0.5 + 0.3 * yaw.sin());
    let k = f64::from(prior.photo.width.max(1)) / f64::from(view.size.width.max(1));
    let solved = CameraBox {
        focal: view.intrinsics.fx * k,
        yaw,
        tilt,
        roll,
        left,
        right: width - left,
        floor,
        ceiling: height - floor,
        back,
        shift: 0.0,
    };
    let evidence = RoomBoxEvidence {
        method: RoomBoxMethod::Prior,
        pin_rms_px: 0.0,
        pins_used: 0,
        pins_given: 0,
        pins_rejected: vec![],
        edge_support: 0.0,
        view_confidence: view.confidence,
        iterations: 0,
        fallbacks,
    };
    finish(&solved, prior, 0.05 + 0.15 * view.confidence, evidence)
}

fn finish(solved: &CameraBox, prior: &LayoutPrior, confidence: f64, evidence: RoomBoxEvidence) -> RoomBox {
    let camera = solved.camera(prior.photo);
    let extents = solved.extents(prior.extents.depth);
    let (anchor, anchor_px) = solved::anchor(&camera, &extents);
    let seen = solved::faces_shown(&camera, &extents);
    RoomBox { camera, extents, seen, anchor, anchor_px, confidence, evidence, posterior: None }
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
