//! When the points carry no frame: the prior's camera, refined by its pins.
//!
//! The room box of the pins (or of the photo's lines, or of the prior alone) gives camera and room in metres, and the
//! map is scaled so that most of its points lie within the box. Axes on which the map's surfaces agree, if there are
//! some, win over the prior's angles. The result is as good as prior and pins; no face counts as measured.

use harmony_scene::{Camera, Mat3, PointMap, PointMapKind, Similarity, Surface, Vec2, Vec3};

use super::reprojection;
use super::types::{AnchorKind, Calibration, CalibrationEvidence, CalibrationMethod, PlaneEvidence};
use crate::room_box::prior_box;
use crate::stats::percentile_in_place;
use crate::{LayoutPrior, RoomBox, ViewEstimate, solve_from_pins};

/// Confidence of a view whose axes are those of the map's surfaces.
const OF_SURFACES: f64 = 0.5;
/// Percentile of box depth over point depth that is the scale: most points lie in front of the box's faces, so the
/// ratio is too large for them; the lowest ratios are strays.
const TOUCHING_PERCENT: f64 = 20.0;
/// Points looked at for that.
const SAMPLED_POINTS: usize = 5000;

/// What the prior says of the view. Axes that the map's surfaces agree on win over its angles.
pub(super) fn view_of(points: &PointMap, prior: &LayoutPrior, camera_from_room: Option<Mat3>) -> ViewEstimate {
    let view = ViewEstimate::from_hints(points.size, points.intrinsics, &prior.camera);
    match camera_from_room {
        Some(rotation) => ViewEstimate { rotation, confidence: OF_SURFACES, ..view },
        None => view,
    }
}

/// The calibration of last resort; `reason` says why it is needed.
pub(super) fn calibrate_by_prior(
    points: &PointMap,
    prior: &LayoutPrior,
    reason: &str,
    view: &ViewEstimate,
) -> Calibration {
    let (room, method) = match solve_from_pins(view, prior) {
        Ok(room) => (room, CalibrationMethod::Pins),
        Err(_) => (prior_box(view, prior), CalibrationMethod::PriorCamera),
    };
    // The lens is the map's, with its principal point.
    let camera = Camera { intrinsics: points.intrinsics, ..room.camera.resized(points.size) };
    let scale = match points.kind {
        PointMapKind::Metric => 1.0,
        PointMapKind::Relative | PointMapKind::RoomBox => scale_to_box(points, &room),
    };
    // Both cameras see the same pixels: x_cam = R_0 X + t_0 in the map's unit, s times that in metres.
    let room_from_camera = camera.rotation.transpose();
    let rotation = room_from_camera * points.rotation;
    let translation = room_from_camera * (points.translation * scale - camera.translation);
    let room_from_points = Similarity { scale, rotation, translation };

    let mut fallbacks = vec![reason.to_owned()];
    fallbacks.push(match method {
        CalibrationMethod::Pins => "camera from pinned room edges".to_owned(),
        _ => "camera from the prior's numbers".to_owned(),
    });
    fallbacks.extend(room.evidence.fallbacks.iter().cloned());
    let r = rotation.transpose();
    let planes = Surface::ALL
        .into_iter()
        .map(|surface| {
            let (axis, _) = crate::planes::axis_of(surface);
            let at = if matches!(surface, Surface::Right | Surface::Ceiling | Surface::Front) {
                room.extents.as_vec()[axis]
            } else {
                0.0
            };
            let distance_m = (camera.centre()[axis] - at).abs();
            PlaneEvidence { surface, measured: false, distance_m, rms_m: 0.0, inliers: 0, share: 0.0 }
        })
        .collect();
    let evidence = CalibrationEvidence {
        method,
        manhattan: [r * Vec3::X, r * Vec3::Y, r * Vec3::Z].map(|a| a.to_array()),
        planes,
        anchor_kind: AnchorKind::Prior,
        anchor: room.anchor,
        anchor_px: camera.project(room.anchor).map(|p| p.to_array()),
        corner_reprojection_px: reprojection(&camera, room.anchor, prior),
        axis_agreement_deg: 0.0,
        axis_support: 0.0,
        iterations: room.evidence.iterations,
        joint: None,
        scale_source: if points.kind == PointMapKind::Metric {
            "the map is metric"
        } else {
            "points fitted into the box"
        }
        .to_owned(),
        height_ratio: None,
        fallbacks,
    };
    Calibration {
        camera,
        room_from_points,
        extents: room.extents,
        seen: vec![],
        anchor: room.anchor,
        evidence,
        posterior: None,
    }
}

fn scale_to_box(points: &PointMap, room: &RoomBox) -> f64 {
    let camera = room.camera.resized(points.size);
    let step = (points.size.pixels() / SAMPLED_POINTS).max(1);
    let mut ratios: Vec<f64> = (0..points.size.pixels())
        .step_by(step)
        .filter_map(|i| {
            let (x, y) = (i as u32 % points.size.width, i as u32 / points.size.width);
            let point = points.at(x, y)?;
            let depth = (points.rotation * point + points.translation).z;
            let ray = camera.ray(Vec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let (_, hit) = room.extents.exit(&ray)?;
            Some(camera.depth(hit) / depth).filter(|r| r.is_finite() && *r > 0.0)
        })
        .collect();
    percentile_in_place(&mut ratios, TOUCHING_PERCENT).unwrap_or(1.0)
}
