//! What a pose costs: the one score of placement, in nats.
//!
//! `E = sum rho(r / sigma) - ln p(hypothesis)`: each term is a residual in sigmas ([`crate::noise::Noise`]) under a robust
//! [`Kernel`]; half the square of a residual is the negative logarithm of a Gaussian, so that terms add up and a hypothesis of
//! probability `p` adds `-ln p`. The local solve minimises it for one object, the joint solve for all of them with camera, room
//! and scale, and a change of any sort is kept when it falls (`accept`).
//!
//! The joint solve leaves out what needs a drawing (the area between silhouette and mask, the map pixel by pixel): it takes
//! the silhouette's reach in sixteen directions, and the front's depth as one number.

mod kernel;
mod size;

use harmony_scene::{Level, ObjectId, PlacementType, PointMapKind, Pose, Support, Vec3};

use crate::noise::{Noise, surprise};
use crate::observe::{DIRECTIONS, Match, Window};
use crate::propose::answered_yaw;
use crate::scene::attachment::{Attachment, PoseConstraint, YawRule, angle_between, facing, reach};
use crate::scene::support::gap_to_back;
use crate::scene::{Energy, Evidence};
use crate::{Item, PartialScene, Placed, PlacementSettings, Shape};

pub(crate) use kernel::Kernel;
pub(crate) use size::{NamedSize, first_size, size_log_ratio};

/// A named value: quadratic near it, linear far from it, so that a wrong one does not outvote the mask.
pub(crate) const NAMED: Kernel = Kernel::Huber(2.0);

/// The area between mask and silhouette is a sum of what errs, and pulls from any distance.
const AREA: Kernel = Kernel::Huber(1.0);

/// A window, how the object is held, and the noise of what is known of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Objective<'a> {
    pub(crate) window: &'a Window,
    pub(crate) constraint: PoseConstraint<'a>,
    noise: &'a Noise,
    sizes: NamedSize,
    depth: DepthNoise,
    /// `-ln p` of the hypothesis.
    pub(crate) prior: f64,
}

/// How far a map's depths of one object are off.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DepthNoise {
    /// One sigma at a pixel, relative.
    pub(crate) pixel: f64,
    /// One sigma of the mean over the object, relative.
    pub(crate) mean: f64,
    /// Independent patches on it.
    pub(crate) patches: f64,
    /// The same for its inner form.
    form: f64,
}

/// A sensor's errors are the same over patches this many times smaller than an estimated map's.
const SENSOR_PATCHES: f64 = 9.0;

impl DepthNoise {
    pub(crate) fn new(scene: &PartialScene, window: &Window, noise: &Noise) -> Self {
        let [pixel, patch] = noise.depth_patch;
        let b = &window.mask_box;
        let patches = 1.0 + b.width() * b.height() / (patch * f64::from(scene.camera.size.width)).powi(2);
        if scene.points.as_ref().is_some_and(|p| p.kind == PointMapKind::Metric) {
            // The form of a mesh is no better than that of a map.
            let pixel = noise.depth_floor.hypot(noise.depth_floor);
            return Self { pixel, mean: noise.depth_floor, patches, form: SENSOR_PATCHES * patches };
        }
        Self { pixel, mean: (pixel / patches.sqrt()).hypot(noise.depth_floor), patches, form: patches }
    }
}

/// Losses of an outline's reach: each of [`DIRECTIONS`] residuals.
pub(crate) fn outline_residuals(raw: [f64; DIRECTIONS], noise: &Noise) -> [f64; DIRECTIONS] {
    let kernel = Kernel::GemanMcClure(noise.outline_limit);
    raw.map(|r| kernel.residual(r) * (noise.outline_pieces / DIRECTIONS as f64).sqrt())
}

/// The residual of a gap between a back and its wall, metres, in sigmas.
pub(crate) fn wall_residual(gap: f64, noise: &Noise) -> f64 {
    let [usual, sigma] = noise.wall_gap;
    Kernel::GemanMcClure(noise.outline_limit).residual((gap - usual) / sigma)
}

impl<'a> Objective<'a> {
    pub(crate) fn new(window: &'a Window, constraint: PoseConstraint<'a>, settings: &'a PlacementSettings) -> Self {
        let (scene, item, noise) = (constraint.scene, constraint.item, &settings.noise);
        Self {
            window,
            constraint,
            noise,
            sizes: NamedSize::new(scene, item, settings),
            depth: DepthNoise::new(scene, window, noise),
            prior: 0.0,
        }
    }

    /// The same for a hypothesis that costs `prior` nats.
    #[must_use]
    pub(crate) fn at_price(self, prior: f64) -> Self {
        Self { prior, ..self }
    }

    /// The energy of a pose, and the comparison it comes from.
    pub(crate) fn energy(&self, pose: &Pose) -> (Energy, Match) {
        let m = self.window.compare(&self.constraint.item.shape, pose, self.depth.pixel);
        let mut energy = self.undrawn(pose);
        energy.silhouette += self.area(m.missed_px + self.noise.order_trust * m.hidden_px, m.beside_px);
        // An object is seen where its mask is: to be out of sight explains nothing.
        energy.silhouette += self.short_of(self.noise.covered, m.covered);
        energy.depth = m.depth.map_or(0.0, |r| {
            self.depth.patches.min(MAX_PATCHES) * Kernel::GemanMcClure(self.noise.outline_limit).loss(r)
        });
        energy.support = self.support(pose);
        (energy, m)
    }

    /// Loss of two areas over the length of the mask's edge, image pixels: what of the mask is missed, and what of the
    /// silhouette is beside it. Of a mask that is small, or a strip, an outline's error is not as wide as all that is seen; but beside
    /// one that is cut there may be more that hides it than is known.
    fn area(&self, missed_px: f64, beside_px: f64) -> f64 {
        let sigma = self.window.outline.sigma;
        let of_mask = sigma.min(self.noise.area_share * self.window.whole_px());
        let beside = if self.window.free == [true; 4] { of_mask } else { sigma };
        self.noise.area_pieces * AREA.loss(missed_px / of_mask + beside_px / beside)
    }

    /// What a shape explains at a pose by its form alone: the area and the reach of its silhouette, and the map pixel by pixel,
    /// each patch for itself; `None` where the map says nothing about it.
    pub(crate) fn form(&self, shape: &Shape, pose: &Pose) -> Option<f64> {
        let m = self.window.compare(shape, pose, self.depth.pixel);
        let outline = self.window.outline.residuals(&self.constraint.scene.camera, shape, pose);
        let reach: f64 = outline_residuals(outline, self.noise).iter().map(|r| 0.5 * r * r).sum();
        let depth = Kernel::GemanMcClure(self.noise.outline_limit).loss(m.depth?);
        Some(
            reach
                + self.area(m.missed_px + self.noise.order_trust * m.hidden_px, m.beside_px)
                + self.depth.form * depth,
        )
    }

    /// The part of the energy that needs no drawing: the outline's reach, sizes, turn and place.
    pub(crate) fn undrawn(&self, pose: &Pose) -> Energy {
        let item = self.constraint.item;
        let outline = self.window.outline.residuals(&self.constraint.scene.camera, &item.shape, pose);
        Energy {
            silhouette: outline_residuals(outline, self.noise).iter().map(|r| 0.5 * r * r).sum(),
            size: self.sizes.loss(item, pose),
            yaw: self.yaw(pose),
            place: self.place(pose),
            prior: self.prior,
            ..Energy::default()
        }
    }

    /// The turn that the relations let expect at a pose.
    fn yaw(&self, pose: &Pose) -> f64 {
        let expected = match self.constraint.yaw {
            YawRule::About { yaw, sigma } => Some((yaw, sigma)),
            YawRule::Facing { target, sigma, .. } => {
                let target = self.constraint.scene.placed.get(target);
                target.and_then(|t| facing(pose.position, t)).map(|yaw| (yaw, sigma))
            }
            YawRule::Fixed(_) | YawRule::Free(_) => None,
        };
        expected.map_or(0.0, |(yaw, sigma)| NAMED.loss(angle_between(pose.yaw, yaw) / sigma))
    }

    /// Where things of this kind stand and hang.
    fn place(&self, pose: &Pose) -> f64 {
        let (scene, item) = (self.constraint.scene, self.constraint.item);
        let mut loss = self.constraint.gap(pose).map_or(0.0, |gap| 0.5 * wall_residual(gap, self.noise).powi(2));
        if let Attachment::OnHost { host, .. } = self.constraint.attachment
            && item.placement.placement_type == PlacementType::AgainstBack
            && let Some(gap) = scene.placed.get(host).and_then(|h| gap_to_back(h, item, pose))
        {
            loss += Kernel::GemanMcClure(self.noise.outline_limit).loss(gap.max(0.0) / self.noise.back_gap);
        }
        if self.constraint.attachment == Attachment::Ceiling && item.relations.matched_set.is_none() {
            loss += NAMED.loss(self.off_middle(pose));
        }
        if item.traits.has_front && self.constraint.attachment == Attachment::Floor {
            let [needed, sigma] = self.noise.front_room;
            loss += NAMED.loss((needed - room_before(scene, item, pose)).max(0.0) / sigma);
        }
        loss += self.order(pose);
        let over = item.shape.extent().y * pose.scale * pose.stretch.y / scene.room.extents.height - 1.0;
        loss + NAMED.loss(over.max(0.0) / self.noise.size)
    }

    /// What it is said to stand before or behind, as the camera sees them.
    fn order(&self, pose: &Pose) -> f64 {
        let (scene, relations) = (self.constraint.scene, &self.constraint.item.relations);
        // A wrong answer costs as much as it is improbable, and no more.
        let kernel = Kernel::GemanMcClure((2.0 * surprise(self.noise.wrong_before)).sqrt());
        let loss = |anchor: &Option<ObjectId>, side: f64| {
            let anchor = anchor.as_ref().and_then(|id| scene.find(id));
            let beyond = anchor.map_or(0.0, |anchor| side * beyond(scene, anchor, pose.position));
            kernel.loss(beyond.max(0.0) / self.noise.before)
        };
        loss(&relations.in_front_of, 1.0) + loss(&relations.behind, -1.0)
    }

    /// How far a lamp that hangs alone is from where lamps hang, in sigmas.
    fn off_middle(&self, pose: &Pose) -> f64 {
        let scene = self.constraint.scene;
        let e = scene.room.extents;
        let tables = scene.placed.iter().filter(|p| p.item.traits.lit_from_above).map(|p| p.pose.position);
        let middle = Vec3::new(e.width / 2.0, 0.0, e.depth / 2.0);
        let away = |at: Vec3| (at.x - pose.position.x).hypot(at.z - pose.position.z);
        tables.map(away).fold(away(middle), f64::min) / (self.noise.lamp_middle * e.width.min(e.depth)).max(0.1)
    }

    /// What of a footprint hangs beside its host.
    fn support(&self, pose: &Pose) -> f64 {
        match self.constraint.attachment {
            Attachment::OnHost { .. } | Attachment::OnLedge(_) => {
                self.short_of(self.noise.support[0], self.constraint.supported_share(pose))
            }
            _ => 0.0,
        }
    }

    /// Loss of a share that is less than it should be.
    fn short_of(&self, enough: f64, share: f64) -> f64 {
        NAMED.loss((enough - share).max(0.0) / self.noise.support[1])
    }

    /// Observed energy of an object that agrees within the sigmas: half a nat for each piece.
    fn expected(&self, m: &Match) -> f64 {
        let depth = m.depth.map_or(0.0, |_| self.depth.patches.min(MAX_PATCHES));
        0.5 * (self.noise.outline_pieces + self.noise.area_pieces + depth)
    }

    /// Observed energy if nothing were there: the mask is not explained.
    pub(crate) fn absent(&self) -> f64 {
        self.area(self.window.whole_px(), 0.0)
            + 0.5 * self.noise.outline_pieces * self.noise.outline_limit.powi(2)
            + self.short_of(self.noise.covered, 0.0)
    }

    /// Observed energy of a pose over the expected one.
    pub(crate) fn misfit(&self, energy: &Energy, m: &Match) -> f64 {
        energy.observed() / self.expected(m)
    }
}

/// Patches of a map that are worth something of their own on one object, at most: beyond, the object's form is wrong.
const MAX_PATCHES: f64 = 6.0;

/// Room between an object's front and the wall it looks at, metres.
fn room_before(scene: &PartialScene, item: &Item, pose: &Pose) -> f64 {
    let front = Vec3::new(pose.yaw.sin(), 0.0, pose.yaw.cos());
    let (low, high) = reach(item, pose);
    let wall =
        harmony_scene::Wall::ALL.into_iter().min_by(|a, b| a.normal().dot(front).total_cmp(&b.normal().dot(front)));
    let Some(wall) = wall.filter(|w| !scene.is_loose(*w)) else { return f64::INFINITY };
    wall.distance(&scene.room.extents, pose.position) - (high - low).dot(wall.normal().abs()) / 2.0
}

/// How much farther from the camera a place is than the place of an object's footprint that is nearest to it, level, metres; 0
/// within the footprint.
fn beyond(scene: &PartialScene, object: &Placed, at: Vec3) -> f64 {
    let (low, high) = reach(&object.item, &object.pose);
    let nearest = at.clamp(object.pose.position + low, object.pose.position + high);
    let eye = scene.camera.centre();
    let away = |p: Vec3| (p.x - eye.x).hypot(p.z - eye.z);
    away(at) - away(nearest)
}

/// Energy of everything that is placed, each object among all others: what `accept` compares. Objects without a mask count
/// by what they hide of others.
pub(crate) fn scene_energy(scene: &PartialScene, settings: &PlacementSettings) -> Vec<Energy> {
    use rayon::prelude::*;
    (0..scene.placed.len()).into_par_iter().map(|i| placed_energy(scene, i, settings).unwrap_or_default()).collect()
}

/// Energy of a placed object where it is; `None` where it has no mask.
pub(crate) fn placed_energy(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<Energy> {
    let placed = &scene.placed[object];
    let window = Window::new(scene, &placed.item, Some(object), &[], settings)?;
    Some(told_objective(scene, object, &window, settings).energy(&placed.pose).0)
}

/// Observed energy of the mask of a placed object if it were gone; `None` where it has no mask.
pub(crate) fn absent_energy(scene: &PartialScene, object: usize, settings: &PlacementSettings) -> Option<f64> {
    let window = Window::new(scene, &scene.placed[object].item, Some(object), &[], settings)?;
    Some(told_objective(scene, object, &window, settings).absent())
}

/// The objective of a placed object by what was said of it, whatever the solve assumed.
pub(crate) fn told_objective<'a>(
    scene: &'a PartialScene,
    object: usize,
    window: &'a Window,
    settings: &'a PlacementSettings,
) -> Objective<'a> {
    let (placed, noise) = (&scene.placed[object], &settings.noise);
    let held = PoseConstraint::as_placed(scene, object, noise);
    let constraint = PoseConstraint { yaw: told_yaw(scene, placed, noise), ..held };
    Objective { prior: told_prior(placed, noise), ..Objective::new(window, constraint, settings) }
}

/// What relations and answers say of the turn of a placed object.
fn told_yaw(scene: &PartialScene, placed: &Placed, noise: &Noise) -> YawRule {
    let item = &placed.item;
    let facing = item.relations.facing_toward.as_ref().and_then(|id| scene.position(id));
    match (item.yaw, facing, &placed.support) {
        (_, _, Support::Wall { .. }) => YawRule::Fixed(placed.pose.yaw),
        (crate::YawHint::About(yaw), ..) if item.traits.flat => {
            YawRule::About { yaw, sigma: answered_yaw(item, yaw, noise) }
        }
        (crate::YawHint::About(yaw), ..) => YawRule::About { yaw, sigma: noise.yaw_panel },
        (_, Some(target), _) => YawRule::Facing { target, start: placed.pose.yaw, sigma: noise.yaw_facing },
        _ => YawRule::Free(placed.pose.yaw),
    }
}

/// `-ln p` of a placed object that is held by another thing than was said.
fn told_prior(placed: &Placed, noise: &Noise) -> f64 {
    let relations = &placed.item.relations;
    match &placed.support {
        Support::Object { id } if relations.on_top_of.as_ref().is_some_and(|said| said != id) => {
            surprise(noise.wrong_host)
        }
        Support::Wall { wall } if relations.wall_affinity.wall().is_some_and(|said| said != *wall) => {
            surprise(noise.wrong_hung)
        }
        Support::Floor if placed.item.level == Level::Decoration && relations.on_top_of.is_some() => {
            surprise(noise.wrong_host)
        }
        support => match (support.ledge(), &relations.on_top_of) {
            (Some(ledge), Some(said)) if *said != ledge.id() => surprise(noise.wrong_host),
            _ => 0.0,
        },
    }
}

/// The evidence of a pose, apart from what needs the finished level.
pub(crate) fn evidence_of(objective: &Objective, pose: &Pose) -> Evidence {
    let (energy, m) = objective.energy(pose);
    let item = objective.constraint.item;
    Evidence {
        silhouette_iou: Some(m.strict_iou),
        depth_residual_m: objective.window.depth_residual(&item.shape, pose),
        size_log_ratio: size_log_ratio(item, pose),
        energy,
        misfit: objective.misfit(&energy, &m),
        hypothesis: 1.0,
        ..Evidence::default()
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::Size;

    use super::*;
    use crate::testing::{add, boxed, empty_room, of_boxes, seen};

    /// A pendant whose shade is 0.36 m wide, on a cord of 0.6 m, as an item that is named `named` wide.
    fn pendant(scene: &PartialScene, at: Vec3, named: f64) -> Item {
        let shape = of_boxes(&[(Vec3::new(0.36, 0.2, 0.36), Vec3::ZERO), (Vec3::new(0.02, 0.6, 0.02), Vec3::Y * 0.2)]);
        let mut item = boxed(scene, shape.extent(), at, 0.0);
        item.level = Level::Ceiling;
        item.label = "pendant".to_owned();
        item.traits.may_stretch = true;
        item.traits.as_wide_as_deep = true;
        item.mask = seen(scene, &shape, &Pose::new(at, 0.0, 1.0)).into();
        item.size = Size { width: named, height: 0.6, depth: named };
        item.shape = std::sync::Arc::new(shape);
        item
    }

    #[test]
    fn a_pendant_whose_ceiling_is_not_seen_hangs_where_its_size_says_and_from_the_ceiling() {
        let (scene, settings) = (empty_room(), PlacementSettings::default());
        let at = Vec3::new(1.9, 1.7, 2.6);
        for named in [0.33, 0.36, 0.42] {
            let item = pendant(&scene, at, named);
            assert!(item.mask.touches_border(1)[1], "its cord leaves the image");
            let window = Window::new(&scene, &item, None, &[], &settings).unwrap();
            let pose = crate::solve::local::solve(&scene, &item, &window, &settings).pose;
            let size = item.shape.extent() * pose.scale * pose.stretch;
            assert!((pose.position.y + size.y - scene.room.extents.height).abs() < 1e-9);
            assert!((size.x / named).ln().abs() < 0.12, "named {named}: {size}");
        }
    }

    /// The energy of a box at a pose, by term.
    fn energy(scene: &PartialScene, item: &Item, held: Attachment, yaw: YawRule, pose: &Pose) -> Energy {
        let settings = PlacementSettings::default();
        let window = Window::new(scene, item, None, &[], &settings).unwrap();
        let constraint = PoseConstraint::new(scene, item, held, yaw, &settings.noise);
        Objective::new(&window, constraint, &settings).energy(pose).0
    }

    #[test]
    fn the_true_pose_costs_nearly_nothing_and_every_error_its_own_term() {
        let scene = empty_room();
        let at = Vec3::new(2.0, 0.0, 2.0);
        let item = boxed(&scene, Vec3::new(0.8, 0.9, 0.5), at, 0.3);
        let of = |pose: &Pose| energy(&scene, &item, Attachment::Floor, YawRule::About { yaw: 0.3, sigma: 0.2 }, pose);
        let right = Pose::new(at, 0.3, 1.0);
        assert!(of(&right).total() < 0.5, "{:?}", of(&right));
        let aside = of(&Pose { position: at + Vec3::X * 0.15, ..right });
        assert!(aside.silhouette > 3.0 && aside.size < 1e-9 && aside.yaw < 1e-9, "{aside:?}");
        // Half as large again, where that is seen alike: two sigmas and three quarters of what was named.
        let camera = scene.camera.centre();
        let far = Pose { position: camera + (at - camera) * 1.5, scale: 1.5, ..right };
        assert!((of(&far).size - NAMED.loss(1.5_f64.ln() / 0.15)).abs() < 1e-4, "{:?}", of(&far));
        let turned = of(&Pose { yaw: 0.5, ..right });
        assert!((turned.yaw - 0.5).abs() < 1e-9, "one sigma is half a nat");
    }

    #[test]
    fn a_lamp_costs_less_over_a_table_and_nothing_else_draws_it() {
        let at = Vec3::new(3.2, 1.9, 1.0);
        let place = |lit_from_above: bool| {
            let mut scene = empty_room();
            add(&mut scene, "table_01", Vec3::new(0.8, 0.5, 0.8), at.with_y(0.0), |p| {
                std::sync::Arc::make_mut(&mut p.item).traits.lit_from_above = lit_from_above;
            });
            let mut item = boxed(&scene, Vec3::new(0.3, 0.6, 0.3), at, 0.0);
            item.level = Level::Ceiling;
            energy(&scene, &item, Attachment::Ceiling, YawRule::Free(0.0), &Pose::new(at, 0.0, 1.0)).place
        };
        assert!(place(true) < 0.01 && place(false) > 1.0, "{} {}", place(true), place(false));
    }

    #[test]
    fn what_is_said_to_stand_before_a_thing_costs_behind_it_as_much_as_a_wrong_answer_and_no_more() {
        let mut scene = empty_room();
        add(&mut scene, "sofa_01", Vec3::new(2.0, 0.8, 0.8), Vec3::new(2.0, 0.0, 1.4), |_| {});
        let place = |behind: bool, z: f64| {
            let at = Vec3::new(2.0, 0.0, z);
            let mut item = boxed(&scene, Vec3::new(0.5, 0.4, 0.5), Vec3::new(2.0, 0.0, 2.4), 0.0);
            let sofa = Some(ObjectId::new("sofa_01").unwrap());
            if behind {
                item.relations.behind = sofa;
            } else {
                item.relations.in_front_of = sofa;
            }
            energy(&scene, &item, Attachment::Floor, YawRule::Free(0.0), &Pose::new(at, 0.0, 1.0)).place
        };
        assert!(place(false, 2.4) < 1e-9 && place(true, 0.5) < 1e-9, "the camera is at the front");
        // A quarter of a metre behind the sofa's back, and far off.
        let limit = surprise(Noise::default().wrong_before);
        for (behind, near, far) in [(false, 0.75, 0.1), (true, 2.05, 4.0)] {
            let (near, far) = (place(behind, near), place(behind, far));
            assert!(near > 0.5 && near < far && far < limit, "{near} {far} {limit}");
        }
    }

    #[test]
    fn a_front_at_a_wall_costs_and_one_to_the_room_does_not() {
        let scene = empty_room();
        let place = |yaw: f64, z: f64| {
            let mut item = boxed(&scene, Vec3::new(0.8, 1.2, 0.4), Vec3::new(2.0, 0.0, z), yaw);
            item.traits.has_front = true;
            let pose = Pose::new(Vec3::new(2.0, 0.0, z), yaw, 1.0);
            energy(&scene, &item, Attachment::Floor, YawRule::Free(yaw), &pose).place
        };
        let half = std::f64::consts::PI;
        assert!(place(half, 0.25) > 1.0 && place(0.0, 0.25) == 0.0 && place(half, 1.2) == 0.0);
    }

    #[test]
    fn losses_of_an_outline_fall_towards_the_truth_as_their_differences_say() {
        let (scene, settings) = (empty_room(), PlacementSettings::default());
        let at = Vec3::new(2.0, 0.0, 2.0);
        let item = boxed(&scene, Vec3::new(0.8, 0.9, 0.5), at, 0.3);
        let window = Window::new(&scene, &item, None, &[], &settings).unwrap();
        let loss = |x: f64| {
            let pose = Pose::new(at + Vec3::X * x, 0.3, 1.0);
            let raw = window.outline.residuals(&scene.camera, &item.shape, &pose);
            outline_residuals(raw, &settings.noise).iter().map(|r| 0.5 * r * r).sum::<f64>()
        };
        let steps: Vec<f64> = (0..10).map(|k| loss(0.02 * f64::from(k))).collect();
        assert!(steps.windows(2).all(|w| w[0] <= w[1] + 1e-9), "{steps:?}");
        // Saturated: half the square of the limit for each of the four pieces.
        let (pieces, limit) = (settings.noise.outline_pieces, settings.noise.outline_limit);
        assert!(loss(3.0) <= 0.5 * pieces * limit * limit && loss(3.0) > 0.3 * pieces * limit * limit);
    }

    #[test]
    fn a_mask_that_nothing_explains_costs_more_than_a_wrong_turn_however_small_it_is() {
        let scene = empty_room();
        let at = Vec3::new(2.0, 0.0, 1.0);
        let item = boxed(&scene, Vec3::new(0.1, 0.12, 0.1), at, 0.0);
        let beside = Pose::new(at - Vec3::X * 1.5, 0.0, 1.0);
        let wrong = energy(&scene, &item, Attachment::Floor, YawRule::Free(0.0), &beside);
        let noise = Noise::default();
        assert!(wrong.silhouette > 2.0 * crate::noise::surprise(noise.wrong_turn), "{wrong:?}");
    }
}
