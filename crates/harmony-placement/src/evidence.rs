//! What speaks for a pose.

use harmony_scene::Confidence;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::anchoring::{Anchoring, Frame, YawRule};
use crate::cost::size_log_ratio;
use crate::level::{anchoring_of, neighbours};
use crate::solid::Solid;
use crate::view::View;
use crate::{PartialScene, PlacementSettings, collision};

/// Depth residual at which the confidence in the depth falls to 1/e, metres.
const DEPTH_SCALE: f64 = 0.15;

/// The same for gaps to the support and for penetration, metres.
const CONTACT_SCALE: f64 = 0.05;

/// Deviation `|ln(size / prior)|` at which the confidence in the size falls to `exp(-1/2)`.
const SIZE_SCALE: f64 = 0.5;

/// Confidence of an object that has no mask to be compared with (a copied one).
const WITHOUT_MASK: f64 = 0.4;

/// Measured agreement of a placed object with the photo and with its neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Evidence {
    /// IoU of mask and rendered silhouette in the partial scene, where both could be visible.
    pub silhouette_iou: Option<f64>,
    /// Median absolute depth difference to the point map over mask and silhouette, metres.
    pub depth_residual_m: Option<f64>,
    /// Gap to the support (floor, host, wall, ceiling), metres; negative when it sinks in.
    pub contact_gap_m: f64,
    /// Deepest penetration with another object beyond what is tolerated, metres.
    pub penetration_m: f64,
    /// `ln(size / prior size)` in the mean over the sides that were free.
    pub size_log_ratio: f64,
}

impl Evidence {
    /// The confidence that follows: the weighted geometric mean
    ///
    /// `iou^0.5 * exp(-depth/0.15)^0.2 * exp(-|gap|/0.05)^0.1 * exp(-penetration/0.05)^0.1 * exp(-(ln ratio/0.5)^2/2)^0.1`
    ///
    /// over what was measured (without depth, the other weights grow to fill its place). It says how well the
    /// object agrees with photo, point map, neighbours and prior size, not how probable it is in any stricter sense.
    pub fn confidence(&self, detection: Option<f64>) -> Confidence {
        let scale = |v: f64, s: f64| (-(v / s)).exp();
        let terms = [
            (Some(self.silhouette_iou.unwrap_or(WITHOUT_MASK)), 0.5),
            (self.depth_residual_m.map(|d| scale(d, DEPTH_SCALE)), 0.2),
            (Some(scale(self.contact_gap_m.abs(), CONTACT_SCALE)), 0.1),
            (Some(scale(self.penetration_m, CONTACT_SCALE)), 0.1),
            (Some((-0.5 * (self.size_log_ratio / SIZE_SCALE).powi(2)).exp()), 0.1),
        ];
        let (mut log, mut weight) = (0.0, 0.0);
        for (value, w) in terms {
            if let Some(v) = value {
                log += w * v.clamp(1e-6, 1.0).ln();
                weight += w;
            }
        }
        Confidence {
            overall: (log / weight).exp(),
            detection,
            silhouette_iou: self.silhouette_iou,
            depth_residual_m: self.depth_residual_m,
        }
    }
}

/// Measures a placed object (an index into [`PartialScene::placed`]) in the scene as it is.
///
/// # Panics
/// When there is no such object.
pub fn measure(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Evidence {
    measure_among(scene, &collision::solids(scene), object, settings)
}

fn view_of(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<View> {
    let item = &scene.placed[object].item;
    let others = neighbours(scene, item, &[], Some(object));
    View::new(scene, Some(object), &item.mask, &others, settings.window_px)
}

/// [`Evidence::silhouette_iou`] alone.
pub(crate) fn silhouette_iou(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<f64> {
    let placed = &scene.placed[object];
    Some(view_of(scene, object, settings)?.compare(placed.item.shape.proxy(), &placed.pose).strict_iou)
}

fn measure_among(scene: &PartialScene, all: &[Solid], object: usize, settings: &PlacementSettings) -> Evidence {
    let placed = &scene.placed[object];
    let item = &placed.item;
    let view = view_of(scene, object, settings);
    let seen = view.as_ref().map(|v| v.compare(item.shape.proxy(), &placed.pose));
    let depth = view.filter(|_| settings.point_map).and_then(|v| v.depth_residual(item.shape.proxy(), &placed.pose));
    let frame = Frame {
        scene,
        item,
        anchoring: anchoring_of(scene, object),
        yaw: YawRule::Fixed(placed.pose.yaw),
        wall_gap: settings.wall_gap,
        fixed_size: true,
    };
    Evidence {
        silhouette_iou: seen.map(|m| m.strict_iou),
        depth_residual_m: depth,
        contact_gap_m: contact_gap(&frame, placed.pose.position.y),
        penetration_m: collision::deepest(scene, all, object, settings),
        size_log_ratio: size_log_ratio(item, &placed.pose),
    }
}

/// Gap between an object and what carries it, metres.
fn contact_gap(frame: &Frame, bottom: f64) -> f64 {
    let scene = frame.scene;
    match frame.anchoring {
        Anchoring::Floor | Anchoring::AgainstWall(_) => bottom,
        Anchoring::OnHost { .. } => {
            let pose = scene.find(&frame.item.id).map(|p| p.pose);
            pose.map_or(0.0, |p| bottom - frame.settle(&p).position.y)
        }
        // The thick part of a window is in the wall: where it should be is not where its back touches.
        Anchoring::OnWall(wall) => scene.find(&frame.item.id).map_or(0.0, |p| {
            let away = |at| wall.distance(&scene.room.extents, at);
            away(p.pose.position) - away(frame.settle(&p.pose).position)
        }),
        Anchoring::Ceiling => {
            let top = scene.find(&frame.item.id).map_or(bottom, |p| bottom + p.size().height);
            scene.room.extents.height - top
        }
    }
}

/// Measures all objects again: those of earlier levels move too, by global refinement and by what came beside them.
pub(crate) fn measure_all(scene: &mut PartialScene, settings: &PlacementSettings) {
    let still: &PartialScene = scene;
    let solids = collision::solids(still);
    let measured: Vec<Evidence> =
        (0..still.placed.len()).into_par_iter().map(|i| measure_among(still, &solids, i, settings)).collect();
    for (placed, evidence) in scene.placed.iter_mut().zip(measured) {
        placed.evidence = evidence;
    }
}

/// Evidence of a freshly solved object; contact and penetration are measured when the level is complete.
pub(crate) fn of_solution(solution: &crate::solve::Solution, view: &View) -> Evidence {
    Evidence {
        silhouette_iou: Some(solution.seen.strict_iou),
        depth_residual_m: view.depth_residual(solution.frame.item.shape.proxy(), &solution.pose),
        contact_gap_m: 0.0,
        penetration_m: 0.0,
        size_log_ratio: size_log_ratio(solution.frame.item, &solution.pose),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn perfect_agreement_is_one_and_each_disagreement_lowers_it() {
        let perfect = Evidence { silhouette_iou: Some(1.0), depth_residual_m: Some(0.0), ..Evidence::default() };
        assert!((perfect.confidence(None).overall - 1.0).abs() <= 1e-12);
        let worse = [
            Evidence { silhouette_iou: Some(0.6), ..perfect },
            Evidence { depth_residual_m: Some(0.2), ..perfect },
            Evidence { contact_gap_m: -0.05, ..perfect },
            Evidence { penetration_m: 0.05, ..perfect },
            Evidence { size_log_ratio: 0.7, ..perfect },
        ];
        for e in worse {
            let c = e.confidence(Some(0.5));
            assert!(c.overall < 0.95 && c.overall > 0.5, "{e:?}: {}", c.overall);
        }
        let nothing = Evidence { silhouette_iou: Some(0.0), ..perfect };
        assert!(nothing.confidence(None).overall < 0.01);
    }
}
