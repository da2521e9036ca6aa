//! One object, from its hypotheses to a pose: the paper's two coupled steps, then a bounded local search.
//!
//! Every step and every trial is on its support already (`scene::attachment`), and is kept when the energy falls.

use harmony_scene::{Level, Pose};
use rayon::prelude::*;

use super::simplex::nelder_mead;
use super::steps;
use crate::observe::{Match, Window};
use crate::propose::{Hypothesis, Proposer};
use crate::scene::attachment::{Attachment, Parameters, PoseConstraint, angle_between};
use crate::scene::{Energy, Evidence};
use crate::terms::{Objective, evidence_of};
use crate::{Item, PartialScene, PlacementSettings, RoomPoints};

/// Hypotheses that get the full rounds.
const FINALISTS: usize = 4;

/// Rounds end when a pose changes less than this, metres and relative.
const SMALL: f64 = 1e-3;

/// Nats that a move of one first step costs where the outline alone is fitted: what no side of it decides stays.
const TETHER: f64 = 0.05;

/// Evaluations of a fit of the outline; each projects a few hundred points.
const OUTLINE_EVALUATIONS: usize = 140;

/// The pose of one object and what led to it.
#[derive(Debug, Clone)]
pub(crate) struct Solution<'a> {
    pub(crate) objective: Objective<'a>,
    pub(crate) pose: Pose,
    pub(crate) energy: Energy,
    pub(crate) seen: Match,
    pub(crate) first_iou: f64,
    pub(crate) rounds: usize,
    pub(crate) renders: usize,
    /// Probability of its turn and support among those that were tried.
    pub(crate) hypothesis: f64,
}

impl<'a> Solution<'a> {
    fn at(objective: Objective<'a>, pose: Pose) -> Self {
        let (energy, seen) = objective.energy(&pose);
        Self { objective, pose, energy, seen, first_iou: seen.iou, rounds: 0, renders: 1, hypothesis: 1.0 }
    }

    pub(crate) fn total(&self) -> f64 {
        self.energy.total()
    }

    pub(crate) fn evidence(&self) -> Evidence {
        Evidence { hypothesis: self.hypothesis, ..evidence_of(&self.objective, &self.pose) }
    }

    /// Takes a pose if the energy falls.
    fn offer(&mut self, pose: Pose) -> bool {
        let (energy, seen) = self.objective.energy(&pose);
        self.renders += 1;
        let better = energy.total() < self.total();
        if better {
            (self.pose, self.energy, self.seen) = (pose, energy, seen);
        }
        better
    }
}

/// Places one object into the partial scene; it is not among the placed ones of its window.
///
/// Nothing stands yet that a change would have to earn (`accept`): hypotheses, another host among them, are alternatives
/// whose prices are in their energies, and the least one is taken, tempered ([`Energy::tempered`]) by the misfit of the best
/// of them, so that of poses that all disagree with the photo the answered one wins.
pub(crate) fn solve<'a>(
    scene: &'a PartialScene,
    item: &'a Item,
    window: &'a Window,
    settings: &'a PlacementSettings,
) -> Solution<'a> {
    let proposer = Proposer { scene, item, window, settings };
    let best = best_of(&proposer.all(), window, settings);
    let expected = 0.5 * crate::noise::surprise(settings.noise.wrong_host);
    // On another host it would have to cost less than this at least.
    let elsewhere = item.level == Level::Decoration || item.relations.on_top_of.is_some();
    let others = if elsewhere && best.total() > expected { proposer.on_other_hosts() } else { Vec::new() };
    if others.is_empty() {
        return best;
    }
    let mut other = best_of(&others, window, settings);
    other.renders += best.renders;
    let misfit = [&best, &other].map(|s| s.objective.misfit(&s.energy, &s.seen));
    let misfit = misfit[0].min(misfit[1]);
    if other.energy.tempered(misfit) < best.energy.tempered(misfit) {
        other
    } else {
        Solution { renders: other.renders, ..best }
    }
}

fn objective<'a>(h: &Hypothesis<'a>, window: &'a Window, settings: &'a PlacementSettings) -> Objective<'a> {
    Objective::new(window, h.constraint, settings).at_price(h.price)
}

/// The best pose to which any of the hypotheses (at least one) leads.
fn best_of<'a>(hypotheses: &[Hypothesis<'a>], window: &'a Window, settings: &'a PlacementSettings) -> Solution<'a> {
    let starts: Vec<(Objective<'a>, Pose)> = hypotheses
        .par_iter()
        .flat_map_iter(|h| {
            let objective = objective(h, window, settings);
            let fitted = settings.refinement.then(|| fit_outline(&objective, &h.pose)).flatten();
            std::iter::once((objective, h.pose)).chain(fitted.map(|pose| (objective, pose)))
        })
        .collect();
    let tries: Vec<Solution<'a>> = distinct(starts)
        .into_par_iter()
        .map(|(objective, pose)| {
            let mut first = Solution::at(objective, pose);
            if settings.refinement {
                rounds(&mut first, settings, 1);
            }
            first
        })
        .collect();
    let tries = by_energy(tries);
    if !settings.refinement {
        return with_probability(tries);
    }
    let spent: usize = tries.iter().map(|t| t.renders).sum();
    let mut kept: Vec<Solution<'a>> = Vec::new();
    let mut rest: Vec<Solution<'a>> = Vec::new();
    for t in tries {
        let known = kept.iter().any(|k| alike(&k.objective, &k.pose, &t.objective, &t.pose));
        if kept.len() < FINALISTS && !known { kept.push(t) } else { rest.push(t) }
    }
    let count = kept.len();
    let finals: Vec<Solution<'a>> = kept
        .into_par_iter()
        .map(|mut t| {
            rounds(&mut t, settings, settings.max_rounds);
            if settings.optimiser {
                search(&mut t, settings.renders_per_object / 2);
            }
            t
        })
        .collect();
    let mut finals = by_energy(finals);
    if settings.optimiser && count > 1 {
        search(&mut finals[0], settings.renders_per_object / 2);
    }
    finals.extend(rest);
    let mut best = with_probability(finals);
    best.renders += spent;
    best
}

/// The best first. Where none agrees within the sigmas, they are too small here, and what the photo says is worth less
/// beside what was answered.
fn by_energy(mut all: Vec<Solution>) -> Vec<Solution> {
    let misfit = least_misfit(&all);
    all.sort_by(|a, b| a.energy.tempered(misfit).total_cmp(&b.energy.tempered(misfit)));
    all
}

fn least_misfit(all: &[Solution]) -> f64 {
    all.iter().map(|s| s.objective.misfit(&s.energy, &s.seen)).fold(f64::INFINITY, f64::min)
}

/// The first of all, with the probability of its turn and support beside the others that were tried.
fn with_probability(mut all: Vec<Solution>) -> Solution {
    let misfit = least_misfit(&all);
    let mut best = all.swap_remove(0);
    let differs = |s: &Solution| {
        // What has no front looks the same after a quarter turn.
        let has_front = best.objective.constraint.item.traits.has_front;
        let turned = has_front && angle_between(s.pose.yaw, best.pose.yaw).abs() > std::f64::consts::FRAC_PI_4;
        let held = |s: &Solution| s.objective.constraint.attachment;
        let elsewhere = match (held(s), held(&best)) {
            (Attachment::OnHost { host: a, .. }, Attachment::OnHost { host: b, .. }) => a != b,
            (Attachment::OnWall(a), Attachment::OnWall(b)) => a != b,
            _ => false,
        };
        turned || elsewhere
    };
    let tempered = |s: &Solution| s.energy.tempered(misfit);
    let other = all.iter().filter(|s| differs(s)).map(tempered).fold(f64::INFINITY, f64::min);
    best.hypothesis = 1.0 / (1.0 + (tempered(&best) - other).min(0.0).exp());
    best
}

/// Whether two poses are the same start for what follows.
fn alike(one: &Objective, a: &Pose, other: &Objective, b: &Pose) -> bool {
    let kind = |o: &Objective| std::mem::discriminant(&o.constraint.attachment);
    kind(one) == kind(other)
        && (a.position - b.position).length() < 0.02
        && angle_between(a.yaw, b.yaw).abs() < 0.06
        && (a.scale / b.scale).ln().abs() < 0.02
        && (a.stretch / b.stretch - 1.0).abs().max_element() < 0.03
}

fn distinct<'a>(all: Vec<(Objective<'a>, Pose)>) -> Vec<(Objective<'a>, Pose)> {
    let mut out: Vec<(Objective<'a>, Pose)> = Vec::new();
    for (objective, pose) in all {
        if !out.iter().any(|(o, p)| o.prior <= objective.prior && alike(o, p, &objective, &pose)) {
            out.push((objective, pose));
        }
    }
    out
}

/// Refines a placed object where it stands, all others as they are now.
pub(crate) fn polish<'a>(
    window: &'a Window,
    constraint: PoseConstraint<'a>,
    pose: &Pose,
    settings: &'a PlacementSettings,
    budget: usize,
) -> Solution<'a> {
    let mut at = Solution::at(Objective::new(window, constraint, settings), constraint.settle(pose));
    search(&mut at, budget);
    at
}

/// Silhouette and depth step in turn, until nothing moves. A step is kept when the energy falls.
fn rounds(at: &mut Solution, settings: &PlacementSettings, limit: usize) {
    let dense = at.objective.constraint.scene.points.as_ref().is_some_and(RoomPoints::is_dense) && settings.point_map;
    let window = at.objective.window;
    for _ in 0..limit {
        let (before, constraint) = (at.pose, at.objective.constraint);
        at.rounds += 1;
        at.offer(steps::silhouette_step(&constraint, window, &before));
        let along = if dense { steps::depth_step } else { steps::contact_step };
        if let Some(next) = along(&constraint, window, &at.pose) {
            // Depth changes disturb the silhouette a little; the step is judged once that is set right again.
            at.offer(steps::silhouette_step(&constraint, window, &next));
        }
        let moved = (at.pose.position - before.position).length();
        let scaled = ((at.pose.scale * at.pose.stretch) / (before.scale * before.stretch) - 1.0).abs().max_element();
        if moved < SMALL && scaled < SMALL {
            break;
        }
    }
}

/// The free numbers of a pose, with their first steps.
struct Free<'a> {
    constraint: PoseConstraint<'a>,
    origin: Parameters,
    numbers: Vec<(usize, f64)>,
}

impl<'a> Free<'a> {
    fn new(constraint: PoseConstraint<'a>, pose: &Pose) -> Self {
        Self { constraint, origin: constraint.parameters(pose), numbers: constraint.free_numbers(pose) }
    }

    fn start(&self) -> Vec<f64> {
        self.numbers.iter().map(|(i, _)| self.origin[*i]).collect()
    }

    fn steps(&self, factor: f64) -> Vec<f64> {
        self.numbers.iter().map(|(_, s)| s * factor).collect()
    }

    fn pose(&self, x: &[f64]) -> Pose {
        let mut numbers = self.origin;
        for ((i, _), v) in self.numbers.iter().zip(x) {
            numbers[*i] = *v;
        }
        self.constraint.pose(&numbers)
    }
}

/// Moves and scales an object until its outline meets the mask's free sides: no pixel is drawn, so that many starts can
/// be tried. `None` when there are not two free sides to meet.
fn fit_outline(objective: &Objective, pose: &Pose) -> Option<Pose> {
    if objective.window.free.iter().filter(|f| **f).count() < 2 {
        return None;
    }
    let mut free = Free::new(objective.constraint, pose);
    // Yaw is left to the silhouette: an outline alone would trade it for size.
    free.numbers.retain(|(i, _)| *i != 2);
    let (start, steps) = (free.start(), free.steps(3.0));
    let cost = |x: &[f64]| {
        let moved: f64 = (0..x.len().min(2)).map(|i| ((x[i] - start[i]) / steps[i]).powi(2)).sum();
        objective.undrawn(&free.pose(x)).total() + TETHER * moved
    };
    Some(free.pose(&nelder_mead(&start, &steps, OUTLINE_EVALUATIONS, 0.01, cost).at))
}

/// Downhill simplex over the free numbers, twice with smaller steps.
fn search(at: &mut Solution, budget: usize) {
    for (share, shrink) in [(0.6, 1.0), (0.4, 0.35)] {
        let free = Free::new(at.objective.constraint, &at.pose);
        let budget = (share * budget as f64) as usize;
        let objective = at.objective;
        let cost = |x: &[f64]| objective.energy(&free.pose(x)).0.total();
        let found = nelder_mead(&free.start(), &free.steps(shrink), budget, 0.02, cost);
        at.renders += found.evaluations;
        if found.value < at.total() {
            at.offer(free.pose(&found.at));
        }
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Mask, ObjectId, Support, Vec3, Wall};

    use super::*;
    use crate::scene::attachment::YawRule;
    use crate::testing::{boxed, empty_room, of_boxes, seen};
    use crate::{Evidence, Placed};

    fn solved(scene: &PartialScene, item: &Item) -> Pose {
        let settings = PlacementSettings::default();
        let window = Window::new(scene, item, None, &[], &settings).unwrap();
        solve(scene, item, &window, &settings).pose
    }

    /// Distance of the nearest first pose to a place, metres.
    fn nearest_start(scene: &PartialScene, item: &Item, at: Vec3) -> f64 {
        let settings = PlacementSettings::default();
        let window = Window::new(scene, item, None, &[], &settings).unwrap();
        let starts = Proposer { scene, item, window: &window, settings: &settings }.all();
        starts.iter().map(|h| h.pose.position.distance(at)).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn a_table_that_the_border_cuts_goes_on_beyond_it() {
        let scene = empty_room();
        // Half of it is right of the image.
        let (size, at) = (Vec3::new(1.8, 0.75, 0.9), Vec3::new(3.0, 0.0, 3.2));
        let item = boxed(&scene, size, at, 0.0);
        let [left, _, right, _] = item.mask.touches_border(1);
        assert!(right && !left);
        let far = nearest_start(&scene, &item, at);
        assert!(far < 0.2, "{far}");
        let pose = solved(&scene, &item);
        assert!(pose.position.distance(at) < 0.08, "{pose:?}");
    }

    #[test]
    fn of_two_curtains_of_which_one_is_seen_both_are_hung() {
        let scene = empty_room();
        let (panel, apart) = (Vec3::new(0.4, 2.0, 0.05), 0.9);
        let shape = of_boxes(&[(panel, Vec3::X * -apart), (panel, Vec3::X * apart)]);
        let at = Vec3::new(2.0, 0.2, 0.03);
        let mut item = boxed(&scene, Vec3::new(2.2, 2.0, 0.05), at, 0.0);
        item.level = Level::Wall;
        item.traits.hangs = true;
        item.relations.wall_affinity = Wall::Back.into();
        let pose = Pose::new(at, 0.0, 1.0);
        let whole = seen(&scene, &shape, &pose);
        // The left one is not seen, and nothing says why.
        let middle = scene.camera.project(at).unwrap().x as u32;
        item.mask = Mask::from_fn(whole.size(), |x, y| x > middle && whole.get(i64::from(x), i64::from(y))).into();
        item.shape = std::sync::Arc::new(shape);
        let left = Mask::from_fn(whole.size(), |x, y| x <= middle && whole.get(i64::from(x), i64::from(y)));
        let mut before = boxed(&scene, Vec3::new(0.4, 2.0, 0.2), Vec3::new(1.1, 0.0, 1.0), 0.0);
        before.id = ObjectId::numbered("box", 2);
        before.mask = left.into();
        let (settings, waiting) = (PlacementSettings::default(), [std::sync::Arc::new(before)]);
        let window = Window::new(&scene, &item, None, &waiting, &settings).unwrap();
        let starts = Proposer { scene: &scene, item: &item, window: &window, settings: &settings }.all();
        let far = starts.iter().map(|h| h.pose.position.distance(at)).fold(f64::INFINITY, f64::min);
        assert!(far < 0.1, "{far}");
        let pose = solve(&scene, &item, &window, &settings).pose;
        assert!(pose.position.distance(at) < 0.15, "{pose:?}");
    }

    #[test]
    fn a_desk_at_a_wall_whose_front_was_named_wrongly_is_turned_about() {
        let scene = empty_room();
        // A desk with its drawers left, as seen from its front; a top, a leg, drawers.
        let drawers = (Vec3::new(0.4, 0.7, 0.6), Vec3::X * -0.5);
        let leg = (Vec3::new(0.06, 0.7, 0.6), Vec3::X * 0.67);
        let top = (Vec3::new(1.4, 0.05, 0.6), Vec3::Y * 0.7);
        let shape = of_boxes(&[drawers, leg, top]);
        let at = Vec3::new(2.2, 0.0, 0.33);
        let mut item = boxed(&scene, Vec3::new(1.4, 0.75, 0.6), at, 0.0);
        item.mask = seen(&scene, &shape, &Pose::new(at, std::f64::consts::PI, 1.0)).into();
        item.shape = std::sync::Arc::new(shape);
        item.traits.has_front = true;
        item.relations.wall_affinity = Wall::Back.into();
        let pose = solved(&scene, &item);
        assert!(angle_between(pose.yaw, std::f64::consts::PI).abs() < 0.1, "{pose:?}");
    }

    #[test]
    fn a_table_whose_mesh_lies_across_is_not_held_by_the_wall_it_was_said_to_be_at() {
        let scene = empty_room();
        let at = Vec3::new(2.0, 0.0, 2.2);
        // Its mesh is deeper than wide: it was turned by a quarter. It has no front that could be wrong.
        let mut item = boxed(&scene, Vec3::new(0.8, 0.75, 1.5), at, std::f64::consts::FRAC_PI_2);
        item.relations.wall_affinity = Wall::Back.into();
        let pose = solved(&scene, &item);
        assert!(pose.position.distance(at) < 0.1, "{pose:?}");
        assert!(pose.yaw.sin().abs() > 0.99, "{pose:?}");
    }

    #[test]
    fn a_chair_turned_to_the_desk_that_it_faces_costs_nothing() {
        let mut scene = empty_room();
        let desk = boxed(&scene, Vec3::new(1.4, 0.75, 0.7), Vec3::new(2.0, 0.0, 1.0), 0.0);
        let (pose, evidence) = (Pose::new(Vec3::new(2.0, 0.0, 1.0), 0.0, 1.0), Evidence::default());
        let desk = std::sync::Arc::new(desk);
        scene.placed.push(Placed { item: desk, pose, support: Support::Floor, evidence });
        let mut chair = boxed(&scene, Vec3::new(0.6, 0.9, 0.6), Vec3::new(2.0, 0.0, 1.8), 0.0);
        chair.id = ObjectId::numbered("chair", 1);
        // Named to look at the viewer, and to face the desk behind it.
        chair.yaw = crate::YawHint::About(0.3);
        let settings = PlacementSettings::default();
        let cheapest_backwards = |chair: &Item| {
            let window = Window::new(&scene, chair, None, &[], &settings).unwrap();
            let starts = Proposer { scene: &scene, item: chair, window: &window, settings: &settings }.all();
            let backwards = starts.iter().filter(|h| angle_between(h.pose.yaw, std::f64::consts::PI).abs() < 0.5);
            backwards.map(|h| h.price).fold(f64::INFINITY, f64::min)
        };
        assert!(cheapest_backwards(&chair) > 0.1);
        chair.relations.facing_toward = Some(ObjectId::numbered("box", 1));
        assert!(cheapest_backwards(&chair) < 1e-9);
        // Tucked in behind the desk, its mask begins where one would have to turn round to face the desk: that turn is
        // asked again wherever the chair comes to stand.
        let mut tucked = boxed(&scene, Vec3::new(0.4, 0.7, 0.4), Vec3::new(2.0, 0.0, 1.2), 0.0);
        tucked.id = ObjectId::numbered("chair", 2);
        tucked.yaw = crate::YawHint::About(0.0);
        tucked.relations.facing_toward = Some(ObjectId::numbered("box", 1));
        let window = Window::new(&scene, &tucked, None, &[], &settings).unwrap();
        let starts = Proposer { scene: &scene, item: &tucked, window: &window, settings: &settings }.all();
        let backwards = |h: &&Hypothesis<'_>| angle_between(h.pose.yaw, std::f64::consts::PI).abs() < 0.1;
        let free: Vec<_> = starts.iter().filter(backwards).filter(|h| h.price < 1e-9).collect();
        assert!(!free.is_empty());
        assert!(free.iter().all(|h| matches!(h.constraint.yaw, YawRule::Facing { .. })));
    }

    #[test]
    fn a_lamp_said_to_stand_on_the_chair_before_its_table_is_put_on_the_table() {
        let mut scene = empty_room();
        let place = |scene: &mut PartialScene, name: &str, parts: &[(Vec3, Vec3)], at: Vec3| {
            let pose = Pose::new(at, 0.0, 1.0);
            let shape = of_boxes(parts);
            let mut item = boxed(scene, shape.extent(), at, 0.0);
            item.id = ObjectId::numbered(name, 1);
            item.mask = seen(scene, &shape, &pose).into();
            item.shape = std::sync::Arc::new(shape);
            let item = std::sync::Arc::new(item);
            scene.placed.push(Placed { item, pose, support: Support::Floor, evidence: Evidence::default() });
        };
        place(&mut scene, "table", &[(Vec3::new(0.8, 0.7, 0.6), Vec3::ZERO)], Vec3::new(2.0, 0.0, 1.2));
        // Its back's post is beside the lamp in the image, its box all around it.
        let seat = (Vec3::new(0.7, 0.4, 0.5), Vec3::ZERO);
        let post = (Vec3::new(0.05, 1.2, 0.05), Vec3::X * 0.32);
        place(&mut scene, "chair", &[seat, post], Vec3::new(2.05, 0.0, 2.6));
        let at = Vec3::new(2.0, 0.7, 1.2);
        let mut lamp = boxed(&scene, Vec3::new(0.2, 0.4, 0.2), at, 0.0);
        lamp.level = Level::Decoration;
        lamp.relations.on_top_of = Some(ObjectId::numbered("chair", 1));
        let pose = solved(&scene, &lamp);
        assert!(pose.position.distance(at) < 0.08, "{pose:?}");
    }

    #[test]
    fn sills_mantels_and_radiators_carry_what_is_said_to_stand_on_them() {
        let pane = (Vec3::new(1.0, 1.1, 0.04), Vec3::Y * 0.04);
        let sill = (Vec3::new(1.1, 0.04, 0.24), Vec3::Z * 0.1);
        let wall_things = [
            ("window", vec![pane, sill], Vec3::new(2.0, 0.9, 0.03), 0.94),
            ("mantel", vec![(Vec3::new(1.4, 0.15, 0.24), Vec3::ZERO)], Vec3::new(2.0, 1.0, 0.122), 1.15),
            ("radiator", vec![(Vec3::new(1.0, 0.6, 0.16), Vec3::ZERO)], Vec3::new(2.0, 0.1, 0.082), 0.7),
        ];
        for (name, parts, at, top) in wall_things {
            let mut scene = empty_room();
            let (shape, pose) = (of_boxes(&parts), Pose::new(at, 0.0, 1.0));
            let mut host = boxed(&scene, shape.extent(), at, 0.0);
            (host.id, host.level) = (ObjectId::numbered(name, 1), Level::Wall);
            host.mask = seen(&scene, &shape, &pose).into();
            host.shape = std::sync::Arc::new(shape);
            let (item, support) = (std::sync::Arc::new(host), Support::Wall { wall: Wall::Back });
            scene.placed.push(Placed { item, pose, support, evidence: Evidence::default() });
            let stands_at = Vec3::new(2.15, top, if name == "window" { 0.18 } else { at.z });
            let mut vase = boxed(&scene, Vec3::new(0.12, 0.25, 0.12), stands_at, 0.0);
            vase.level = Level::Decoration;
            vase.relations.on_top_of = Some(ObjectId::numbered(name, 1));
            let settings = PlacementSettings::default();
            let window = Window::new(&scene, &vase, None, &[], &settings).unwrap();
            let found = solve(&scene, &vase, &window, &settings);
            let on_it = Support::Object { id: ObjectId::numbered(name, 1) };
            assert_eq!(found.objective.constraint.support(), on_it, "{name}");
            assert!(found.pose.position.distance(stands_at) < 0.08, "{name}: {:?}", found.pose);
        }
    }

    #[test]
    fn a_member_of_a_set_starts_as_large_as_the_one_that_is_seen_well() {
        let mut scene = empty_room();
        let size = Vec3::new(0.5, 0.9, 0.5);
        let mut first = boxed(&scene, size, Vec3::new(1.2, 0.0, 2.0), 0.0);
        first.relations.matched_set = Some("chairs".to_owned());
        let mut second = first.clone();
        second.id = ObjectId::numbered("box", 2);
        second.size = harmony_scene::Size::from_vec(size * 1.3);
        let pose = Pose::new(Vec3::new(1.2, 0.0, 2.0), 0.0, 1.0);
        let item = std::sync::Arc::new(first);
        let settings = PlacementSettings::default();
        for (iou, scale) in [(0.9, 1.0), (0.3, 1.3)] {
            let evidence = Evidence { silhouette_iou: Some(iou), ..Evidence::default() };
            scene.placed = vec![Placed { item: std::sync::Arc::clone(&item), pose, support: Support::Floor, evidence }];
            let window = Window::new(&scene, &second, None, &[], &settings).unwrap();
            let proposer = Proposer { scene: &scene, item: &second, window: &window, settings: &settings };
            assert!((proposer.sized(Vec3::ZERO, 0.0).scale - scale).abs() < 1e-6);
        }
    }
}
