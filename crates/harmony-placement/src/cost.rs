//! What a pose costs: disagreement with mask, point map, prior size and relations, in one number.

use harmony_scene::{PixelBox, PlacementType, Pose};

use crate::Item;
use crate::anchoring::{Anchoring, Frame, USUAL_GAP, YawRule, prior_scale, size_of};
use crate::first_pose::facing;
use crate::support::gap_to_back;
use crate::view::{Match, View};

/// Weight of the free edges' mean relative error beside `1 - IoU`.
const EDGES: f64 = 0.8;

/// Weight of falling short of where the mask is cut, against missing a free edge.
const SHORT_OF_CUT: f64 = 3.0;

/// Share of the IoU that counts only pixels which what is placed leaves visible: it keeps an object from being
/// right in the image but inside its host. Not all of it, for what is placed may itself be a little off.
const STRICT: f64 = 0.4;

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

/// Cost of [`BACK_SIGMA`] of space behind what leans against its host's back, metres.
const AWAY_FROM_BACK: f64 = 0.05;
const BACK_SIGMA: f64 = 0.08;

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
        // How thick a rug is says nothing about its size.
        let sides: &[usize] = if item.traits.flat { &[0, 2] } else { &[0, 1, 2] };
        sides.iter().map(|&i| (pose.scale * pose.stretch[i] / (scale * stretch[i])).ln()).collect()
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
        let mut cost = 1.0 - (1.0 - STRICT) * m.iou - STRICT * m.strict_iou;
        cost += EDGES * self.edge_error(&m);
        if self.use_depth
            && let Some(d) = m.soft_depth
        {
            cost += DEPTH_PER_METRE * d * (m.depth_share * 3.0).min(1.0);
        }
        let weight = if item.traits.heavily_occluded { SIZE_WHEN_HIDDEN } else { SIZE };
        for d in size_deviations(item, pose) {
            let d = d / self.size_sigma.max(1e-3);
            // Quadratic near the prior, linear far from it: a wrong prior must not outvote the mask.
            cost += weight * if d.abs() < 2.0 { d * d } else { 4.0 * d.abs() - 4.0 };
        }
        if let Some((yaw, sigma)) = self.expected_yaw(pose) {
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
        if let Anchoring::OnHost { host, .. } = self.frame.anchoring
            && item.placement.placement_type == PlacementType::AgainstBack
            && let Some(gap) = self.frame.scene.placed.get(host).and_then(|h| gap_to_back(h, item, pose))
        {
            cost += AWAY_FROM_BACK * (gap.max(0.0) / BACK_SIGMA).min(3.0);
        }
        if size_of(item, pose).y > 1.5 * self.frame.scene.room.extents.height {
            cost += 1.0;
        }
        (cost, m)
    }

    /// The yaw that the relations let expect at a pose, with its sigma.
    fn expected_yaw(&self, pose: &Pose) -> Option<(f64, f64)> {
        match self.frame.yaw {
            YawRule::About { yaw, sigma } => Some((yaw, sigma)),
            YawRule::Facing { target, sigma, .. } => {
                let yaw = facing(pose.position, self.frame.scene.placed.get(target)?)?;
                Some((yaw, sigma))
            }
            YawRule::Fixed(_) | YawRule::Free(_) => None,
        }
    }

    /// Mean error of the outline's edges, see [`edge_errors`]; over four, so that an object with one free edge is not
    /// judged by it alone.
    fn edge_error(&self, m: &Match) -> f64 {
        m.outline.map_or(1.0, |o| edge_errors(self.view, &o).iter().map(|e| e.min(1.0)).sum::<f64>() / 4.0)
    }
}

/// Distance of each edge of an outline to the mask's, relative to the mask's size: left, top, right, bottom.
///
/// Where the mask is cut, the outline may go on beyond it, but must reach it: what is seen up to the cut is surely
/// there (a cord that leaves the image at its top).
pub(crate) fn edge_errors(view: &View, outline: &PixelBox) -> [f64; 4] {
    let b = &view.mask_box;
    let (w, h) = (b.width().max(4.0), b.height().max(4.0));
    // Positive where the outline reaches beyond the mask.
    let beyond = [(b.x0 - outline.x0) / w, (b.y0 - outline.y0) / h, (outline.x1 - b.x1) / w, (outline.y1 - b.y1) / h];
    std::array::from_fn(|i| if view.free[i] { beyond[i].abs() } else { SHORT_OF_CUT * (-beyond[i]).max(0.0) })
}
