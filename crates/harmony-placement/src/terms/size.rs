//! What is expected of an object's size: the named one, a standard, and that of its set. Key `group.refine`.
//!
//! Sizes are log-normal: residuals are differences of logarithms over relative sigmas. Sides that are free are compared
//! each, else one factor for all. Standard heights (decision 0018) are for the joint solve, which can change the
//! scene's scale; what all named sizes of a scene have in common is its unknown. The member of a set that the photo
//! shows best is the reference of the others, on trust: a reference of wrong size makes them wrong.

use harmony_catalogue::standard_height;
use harmony_scene::{Level, Pose, Vec3};

use super::NAMED;
use crate::noise::Noise;
use crate::scene::TRUSTED_IOU;
use crate::scene::attachment::prior_scale;
use crate::{Item, PartialScene, PlacementSettings};

/// Weight of a side beside the others: half of what a model errs in one it errs in all, so that three are worth 1.5.
const SHARED: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Expected logarithms of an object's sides, metres, and how sure each is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NamedSize {
    /// Mean of `ln(side / canonical side)` and one sigma, for each side.
    sides: [(f64, f64); 3],
    /// The same of the factor on all sides.
    whole: (f64, f64),
    /// Logarithm of the height by a standard and one sigma.
    standard: Option<(f64, f64)>,
    /// Mean of the sides' logarithms in the set, and one sigma.
    set: Option<(f64, f64)>,
}

/// The sides that can be free: one factor for all, or each by itself.
fn free_sides(item: &Item) -> Option<&'static [usize]> {
    let each = item.traits.may_stretch || item.traits.planar;
    // How thick a rug is says nothing about its size.
    each.then_some(if item.traits.flat { &[0, 2] } else { &[0, 1, 2] })
}

/// Logarithms of the factors on a shape's sides.
fn logs(pose: &Pose) -> [f64; 3] {
    std::array::from_fn(|i| (pose.scale * pose.stretch[i]).max(1e-9).ln())
}

/// `ln(size / prior size)` in the mean over the sides that were free.
pub(crate) fn size_log_ratio(item: &Item, pose: &Pose) -> f64 {
    let (scale, stretch) = prior_scale(item, item.size);
    let off: [f64; 3] = std::array::from_fn(|i| logs(pose)[i] - (scale * stretch[i]).ln());
    match free_sides(item) {
        Some(sides) => sides.iter().map(|i| off[*i]).sum::<f64>() / sides.len() as f64,
        None => (pose.scale / scale).ln(),
    }
}

impl NamedSize {
    /// What is expected in a scene of the scale it has: a standard, surer than any scale, is for the joint solve, which can
    /// change it.
    pub(crate) fn new(scene: &PartialScene, item: &Item, settings: &PlacementSettings) -> Self {
        let set = reference_instance(scene, item, settings);
        Self { standard: None, set, ..Self::of_item(item, &settings.noise) }
    }

    /// The same in a scene of which the scale is an unknown of its own.
    pub(crate) fn of_item(item: &Item, noise: &Noise) -> Self {
        let (scale, stretch) = prior_scale(item, item.size);
        let doubt = if item.traits.size_doubted { noise.size_doubted } else { 1.0 };
        let side = |i: usize| {
            let cord = item.level == Level::Ceiling && i == 1;
            ((scale * stretch[i]).ln(), if cord { noise.size_cord } else { noise.size } * doubt)
        };
        let standard = standard_height(&item.label, item.size.height)
            .map(|(height, sigma)| ((height / item.shape.bounds().size().y.max(1e-6)).ln(), sigma));
        Self { sides: std::array::from_fn(side), whole: (scale.ln(), noise.size * doubt), standard, set: None }
    }

    /// Residuals in sigmas of a pose whose scale is multiplied by `exp(ln_scale)`, named sizes by `exp(ln_common)`.
    pub(crate) fn residuals(&self, item: &Item, pose: &Pose, ln_scale: f64, ln_common: f64) -> [f64; 5] {
        let logs = logs(pose).map(|l| l + ln_scale);
        let off = |i: usize| (logs[i] - self.sides[i].0 - ln_common) / self.sides[i].1;
        let mut out = [0.0; 5];
        match free_sides(item) {
            Some(sides) => sides.iter().for_each(|i| out[*i] = off(*i) * SHARED),
            // One factor for all: what hangs is measured by its shade.
            None if item.level == Level::Ceiling => out[0] = f64::midpoint(off(0), off(2)),
            // Sides that are thin in the mesh or in the answer say little.
            None => out[0] = (pose.scale.ln() + ln_scale - self.whole.0 - ln_common) / self.whole.1,
        }
        if let Some((log, sigma)) = self.standard {
            out[3] = (logs[1] - log) / sigma;
        }
        if let Some((log, sigma)) = self.set {
            out[4] = (mean(logs) - log) / sigma;
        }
        out
    }

    pub(crate) fn loss(&self, item: &Item, pose: &Pose) -> f64 {
        self.residuals(item, pose, 0.0, 0.0).iter().map(|r| NAMED.loss(*r)).sum()
    }

    /// The same, named sizes `factor` times less sure.
    #[must_use]
    pub(crate) fn inflated(mut self, factor: f64) -> Self {
        self.sides.iter_mut().for_each(|(_, sigma)| *sigma *= factor);
        self.whole.1 *= factor;
        self
    }

    /// A standard that so many things of one kind share: how far they are from it, they are together.
    #[must_use]
    pub(crate) fn shared_by(mut self, count: usize) -> Self {
        if let Some((_, sigma)) = &mut self.standard {
            *sigma *= (count as f64).sqrt();
        }
        self
    }
}

fn mean(v: [f64; 3]) -> f64 {
    (v[0] + v[1] + v[2]) / 3.0
}

/// The member of an item's set that the photo shows best, where one is placed already.
pub(crate) fn reference_of<'a>(
    scene: &'a PartialScene,
    item: &Item,
    settings: &PlacementSettings,
) -> Option<&'a crate::Placed> {
    let set = item.relations.matched_set.as_ref().filter(|_| settings.groups)?;
    let iou = |p: &crate::Placed| p.evidence.silhouette_iou.unwrap_or(0.0);
    let members = scene.placed.iter().filter(|p| {
        p.item.relations.matched_set.as_ref() == Some(set) && p.item.level == item.level && p.item.id != item.id
    });
    members.filter(|p| iou(p) >= TRUSTED_IOU).max_by(|a, b| iou(a).total_cmp(&iou(b)))
}

/// Mean logarithm of the factors that give an item the size of its set's reference, and one sigma.
fn reference_instance(scene: &PartialScene, item: &Item, settings: &PlacementSettings) -> Option<(f64, f64)> {
    let reference = reference_of(scene, item, settings)?;
    let size = reference.size().as_vec() / item.shape.extent();
    let log = mean(std::array::from_fn(|i| size[i].max(1e-9).ln()));
    // What one mask tells of a size is worth an outline's error on each side.
    let sigma = settings.noise.size_set.hypot(2.0 * settings.noise.outline_relative);
    log.is_finite().then_some((log, sigma))
}

/// The size of the set's reference, or the named one.
pub(crate) fn first_size(scene: &PartialScene, item: &Item, settings: &PlacementSettings) -> (f64, Vec3) {
    prior_scale(item, reference_of(scene, item, settings).map_or(item.size, crate::Placed::size))
}
