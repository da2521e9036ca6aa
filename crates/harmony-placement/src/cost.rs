//! What a pose costs: disagreement with mask, point map, prior size and relations, in one number.

use harmony_scene::Pose;

use crate::Item;
use crate::anchoring::{Anchoring, Frame, USUAL_GAP, YawRule, prior_scale, size_of};
use crate::view::{Match, View};

/// Weight of the free edges' mean relative error beside `1 - IoU`.
const EDGES: f64 = 0.4;

/// Cost of a metre of (soft) depth difference.
const DEPTH_PER_METRE: f64 = 2.0;

/// Cost of one sigma of deviation from the prior size.
const SIZE: f64 = 0.015;

/// The same where the mask says little about the size.
const SIZE_WHEN_HIDDEN: f64 = 0.1;

/// Cost of one sigma of deviation from an expected yaw.
const YAW: f64 = 0.02;

/// Cost of [`GAP_SIGMA`] more or less than the usual gap to a wall.
const GAP: f64 = 0.004;

/// Metres.
const GAP_SIGMA: f64 = 0.03;

/// Cost of a footprint that hangs wholly beside its host.
const UNSUPPORTED: f64 = 0.8;

/// Share of a footprint that must be supported to be free of cost.
const SUPPORTED_SHARE: f64 = 0.8;

/// A window, a frame, and the weights that hold for them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judge<'a> {
    pub(crate) view: &'a View,
    pub(crate) frame: Frame<'a>,
    pub(crate) size_sigma: f64,
    /// Whether the point map's depths count.
    pub(crate) use_depth: bool,
}

/// Smallest difference of two angles, radians.
pub(crate) fn angle_between(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(std::f64::consts::TAU);
    if d > std::f64::consts::PI { d - std::f64::consts::TAU } else { d }
}

/// `ln(size / prior)` of the sides that can be free: one for a uniform scale, else three.
pub(crate) fn size_deviations(item: &Item, pose: &Pose) -> Vec<f64> {
    let (scale, stretch) = prior_scale(item, item.size);
    if item.traits.may_stretch || item.traits.planar {
        (0..3).map(|i| (pose.scale * pose.stretch[i] / (scale * stretch[i])).ln()).collect()
    } else {
        vec![(pose.scale / scale).ln()]
    }
}

/// `ln(scale / prior scale)`, over the sides in the mean.
pub(crate) fn size_log_ratio(item: &Item, pose: &Pose) -> f64 {
    let d = size_deviations(item, pose);
    d.iter().sum::<f64>() / d.len() as f64
}

impl Judge<'_> {
    /// The cost of a pose, and the comparison it comes from.
    pub(crate) fn cost(&self, pose: &Pose) -> (f64, Match) {
        let item = self.frame.item;
        let m = self.view.compare(item.shape.proxy(), pose);
        let mut cost = 1.0 - m.iou;
        cost += EDGES * self.edge_error(&m);
        if self.use_depth {
            if let Some(d) = m.soft_depth {
                cost += DEPTH_PER_METRE * d * (m.depth_share * 3.0).min(1.0);
            }
        }
        let weight = if item.traits.heavily_occluded { SIZE_WHEN_HIDDEN } else { SIZE };
        for d in size_deviations(item, pose) {
            let d = d / self.size_sigma.max(1e-3);
            // Quadratic near the prior, linear far from it: a wrong prior must not outvote the mask.
            cost += weight * if d.abs() < 2.0 { d * d } else { 4.0 * d.abs() - 4.0 };
        }
        if let YawRule::About { yaw, sigma } = self.frame.yaw {
            let d = angle_between(pose.yaw, yaw).abs() / sigma.max(1e-3);
            cost += YAW * if d < 2.0 { d * d } else { 4.0 * d - 4.0 };
        }
        if let Some(gap) = self.frame.gap(pose) {
            cost += GAP * ((gap - USUAL_GAP) / GAP_SIGMA).powi(2);
        }
        if matches!(self.frame.anchoring, Anchoring::OnHost { .. }) {
            let lacking = (SUPPORTED_SHARE - self.frame.supported_share(pose)).max(0.0) / SUPPORTED_SHARE;
            cost += UNSUPPORTED * lacking;
        }
        if size_of(item, pose).y > 1.5 * self.frame.scene.room.extents.height {
            cost += 1.0;
        }
        (cost, m)
    }

    /// Mean distance of the outline's free edges to the mask's, relative to the mask's size, at most 1.
    fn edge_error(&self, m: &Match) -> f64 {
        let Some(outline) = m.outline else { return 1.0 };
        let b = &self.view.mask_box;
        let (w, h) = (b.width().max(4.0), b.height().max(4.0));
        let errors = [
            (outline.x0 - b.x0).abs() / w,
            (outline.y0 - b.y0).abs() / h,
            (outline.x1 - b.x1).abs() / w,
            (outline.y1 - b.y1).abs() / h,
        ];
        let (mut sum, mut n) = (0.0, 0.0);
        for (e, free) in errors.iter().zip(self.view.free) {
            if free {
                sum += e.min(1.0);
                n += 1.0;
            }
        }
        // The mean over four, so that an object with one free edge is not judged by it alone.
        if n > 0.0 { sum / 4.0 } else { 0.0 }
    }
}
