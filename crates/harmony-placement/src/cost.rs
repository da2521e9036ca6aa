//! What a pose costs: disagreement with mask, point map, prior size and relations, in one number.

use harmony_mesh::catalogue;
use harmony_scene::{Level, PixelBox, PlacementType, Pose, Vec3};

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

/// The same of what touches nothing that is seen: size and distance are traded for each other along the view without any
/// change in the image, so that the prior alone tells them apart; it must outweigh what an inexact outline gains.
const SIZE_WHEN_UNTOUCHED: f64 = 0.06;

/// Relative uncertainty of the height of what hangs from a ceiling: cords are as long as rooms are high.
const CORD_SIGMA: f64 = 0.5;

/// Cost of one sigma of distance from where lamps hang: from the room's middle, or from the middle of a table.
const OFF_MIDDLE: f64 = 0.015;

/// That sigma, as a share of the room's shorter side.
const MIDDLE_SIGMA: f64 = 0.25;

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

/// Deviations of a size from what is expected of it, in sigmas: log-normal around the named size and the usual one of
/// the category, each as sure as it can be. For what touches nothing that is seen.
pub(crate) fn size_surprises(item: &Item, pose: &Pose, size_sigma: f64) -> Vec<f64> {
    let (usual, (low, high)) = (catalogue::default_size(&item.label), catalogue::size_range(&item.label));
    let known = catalogue::category(&item.label).is_some();
    let (usual, low, high) = (usual.as_vec(), low.as_vec(), high.as_vec());
    let (scale, stretch) = prior_scale(item, item.size);
    let hangs = item.level == Level::Ceiling;
    let surprise = |i: usize| {
        let cord = hangs && i == 1;
        let named_sigma = if cord { CORD_SIGMA } else { size_sigma.max(1e-3) };
        let (mut mean, mut weight) = (0.0, named_sigma.powi(-2));
        // The range of a category holds nearly all of it: two sigma each way.
        let spread = (high[i] / low[i]).ln() / 4.0;
        let prior = item.shape.extent()[i] * scale * stretch[i];
        if known && spread > 0.0 && prior > 0.0 {
            let w = spread.max(if cord { CORD_SIGMA } else { 0.0 }).powi(-2);
            mean = (usual[i] / prior).ln() * w / (w + weight);
            weight += w;
        }
        ((pose.scale * pose.stretch[i] / (scale * stretch[i])).ln() - mean) * weight.sqrt()
    };
    if item.traits.may_stretch || item.traits.planar {
        let sides: &[usize] = if item.traits.flat { &[0, 2] } else { &[0, 1, 2] };
        return sides.iter().map(|i| surprise(*i)).collect();
    }
    // One factor for all: what hangs is measured by its shade.
    vec![if hangs { f64::midpoint(surprise(0), surprise(2)) } else { (surprise(0) + surprise(1) + surprise(2)) / 3.0 }]
}

/// Quadratic near the prior, linear far from it: a wrong prior must not outvote the mask.
fn priced(sigmas: f64) -> f64 {
    let d = sigmas.abs();
    if d < 2.0 { d * d } else { 4.0 * d - 4.0 }
}

impl Judge<'_> {
    /// Whether the photo shows no place where the object touches something, and no depth: only its size tells how far it is.
    fn is_untouched(&self) -> bool {
        let contact = match self.frame.anchoring {
            Anchoring::Ceiling => 1,
            Anchoring::Floor => 3,
            Anchoring::AgainstWall(_) | Anchoring::OnWall(_) | Anchoring::OnHost { .. } => return false,
        };
        !self.view.free[contact] && !self.use_depth
    }

    /// How far a lamp that hangs alone is from where lamps hang, in sigmas.
    fn off_middle(&self, pose: &Pose) -> f64 {
        let scene = self.frame.scene;
        let e = scene.room.extents;
        let tables = scene.placed.iter().filter(|p| p.item.label.contains("table")).map(|p| p.pose.position);
        let middle = Vec3::new(e.width / 2.0, 0.0, e.depth / 2.0);
        let away = |at: Vec3| (at.x - pose.position.x).hypot(at.z - pose.position.z);
        let least = tables.map(away).fold(away(middle), f64::min);
        least / (MIDDLE_SIGMA * e.width.min(e.depth)).max(0.1)
    }

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
        if self.is_untouched() {
            let surprises = size_surprises(item, pose, self.size_sigma);
            cost += SIZE_WHEN_UNTOUCHED * surprises.into_iter().map(priced).sum::<f64>();
            if item.level == Level::Ceiling && item.relations.matched_set.is_none() {
                cost += OFF_MIDDLE * priced(self.off_middle(pose));
            }
        } else {
            let weight = if item.traits.heavily_occluded { SIZE_WHEN_HIDDEN } else { SIZE };
            let deviations = size_deviations(item, pose);
            cost += weight * deviations.into_iter().map(|d| priced(d / self.size_sigma.max(1e-3))).sum::<f64>();
        }
        if let Some((yaw, sigma)) = self.expected_yaw(pose) {
            cost += YAW * priced(angle_between(pose.yaw, yaw) / sigma.max(1e-3));
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

#[cfg(test)]
mod tests {
    use harmony_scene::{Mask, Size};

    use super::*;
    use crate::PlacementSettings;
    use crate::anchoring::YawRule;
    use crate::testing::{boxed, empty_room, of_boxes, seen};

    /// A pendant whose shade is 0.36 m wide, on a cord of 0.6 m, as an item that is named `named` wide.
    fn pendant(scene: &crate::PartialScene, at: Vec3, named: f64) -> Item {
        let shape = of_boxes(&[(Vec3::new(0.36, 0.2, 0.36), Vec3::ZERO), (Vec3::new(0.02, 0.6, 0.02), Vec3::Y * 0.2)]);
        let mut item = boxed(scene, shape.extent(), at, 0.0);
        item.level = Level::Ceiling;
        item.label = "pendant".to_owned();
        item.traits.may_stretch = true;
        item.traits.as_wide_as_deep = true;
        item.mask = seen(scene, &shape, &Pose::new(at, 0.0, 1.0));
        item.size = Size { width: named, height: 0.6, depth: named };
        item.shape = std::sync::Arc::new(shape);
        item
    }

    fn solved(scene: &crate::PartialScene, item: &Item) -> Pose {
        let settings = PlacementSettings::default();
        let view = View::new(scene, None, &item.mask, &[], settings.window_px).unwrap();
        crate::solve::solve(scene, item, &view, &settings).pose
    }

    #[test]
    fn a_pendant_whose_ceiling_is_not_seen_hangs_where_its_size_says_and_from_the_ceiling() {
        let scene = empty_room();
        let at = Vec3::new(1.9, 1.7, 2.6);
        for named in [0.33, 0.36, 0.42] {
            let item = pendant(&scene, at, named);
            assert!(item.mask.touches_border(1)[1], "its cord leaves the image");
            let pose = solved(&scene, &item);
            let size = size_of(&item, &pose);
            assert!((pose.position.y + size.y - scene.room.extents.height).abs() < 1e-9);
            assert!((size.x / named).ln().abs() < 0.12, "named {named}: {size}");
            let camera = scene.camera.centre();
            let apart = pose.position.distance(camera) / at.distance(camera);
            assert!((apart / (named / 0.36)).ln().abs() < 0.12, "{apart}");
        }
    }

    #[test]
    fn a_wrong_outline_does_not_buy_a_pendant_of_another_size() {
        let scene = empty_room();
        let item = pendant(&scene, Vec3::new(1.9, 1.7, 2.6), 0.36);
        let view = View::new(&scene, None, &item.mask, &[], 128).unwrap();
        let frame = Frame {
            scene: &scene,
            item: &item,
            anchoring: Anchoring::Ceiling,
            yaw: YawRule::Fixed(0.0),
            wall_gap: 0.0,
            fixed_size: false,
        };
        let judge = Judge { view: &view, frame, size_sigma: 0.2, use_depth: false };
        assert!(judge.is_untouched());
        // Half as large again: worth more than the tenth of the outline that a template's form is off by.
        let large = Pose { scale: 1.5, ..Pose::new(Vec3::ZERO, 0.0, 1.0) };
        let surprises: f64 = size_surprises(&item, &large, 0.2).into_iter().map(priced).sum();
        assert!(SIZE_WHEN_UNTOUCHED * surprises > 0.1, "{surprises}");
        let seen = Judge { use_depth: true, ..judge };
        assert!(!seen.is_untouched());
    }

    #[test]
    fn the_usual_size_pulls_a_named_one_a_little_and_the_length_of_a_cord_says_little() {
        let scene = empty_room();
        let mut item = pendant(&scene, Vec3::new(1.9, 1.7, 2.6), 0.8);
        item.mask = Mask::from_fn(item.mask.size(), |x, y| x < 9 && y < 9);
        let (scale, stretch) = prior_scale(&item, item.size);
        let of = |x: f64, y: f64| {
            let by = Vec3::new(x, y, x);
            size_surprises(&item, &Pose { scale, stretch: stretch * by, ..Pose::new(Vec3::ZERO, 0.0, 1.0) }, 0.2)
        };
        // Pendants are usually 0.4 m wide: a little less than 0.8 is likelier than 0.8, half of it is not.
        assert!(of(0.93, 1.0)[0].abs() < of(1.0, 1.0)[0].abs());
        assert!(of(0.5, 1.0)[0].abs() > 2.0);
        assert!(of(1.0, 1.5)[1].abs() < 1.5 && of(1.5, 1.0)[0].abs() > 2.0);
    }
}
