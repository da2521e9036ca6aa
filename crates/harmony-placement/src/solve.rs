//! One object, from its hypotheses to a pose: the paper's two coupled steps, then a bounded local search.

use harmony_scene::{Pose, Support};
use rayon::prelude::*;

use crate::anchoring::{Anchoring, Frame, Parameters};
use crate::cost::{Judge, angle_between};
use crate::first_pose::{Hypothesis, Starter};
use crate::optimise::nelder_mead;
use crate::view::{Match, View};
use crate::{Item, PartialScene, PlacementSettings, RoomPoints, first_on_host, outline, steps};

/// Hypotheses that get the full rounds.
const FINALISTS: usize = 4;

/// Rounds end when a pose changes less than this, metres.
const SMALL_MOVE: f64 = 1e-3;

/// And its scale less than this, relative.
const SMALL_SCALE: f64 = 1e-3;

/// A step may lower the IoU by no more than this: one row of window pixels.
const IOU_SLACK: f64 = 0.003;

/// What agrees less with its mask on the given host, or of whose footprint less is on it, is tried on others too.
const POOR_IOU: f64 = 0.5;
const POOR_SUPPORT: f64 = 0.5;

/// The pose of one object and what led to it.
#[derive(Debug, Clone)]
pub(crate) struct Solution<'a> {
    pub(crate) frame: Frame<'a>,
    pub(crate) pose: Pose,
    pub(crate) cost: f64,
    pub(crate) seen: Match,
    pub(crate) first_iou: f64,
    pub(crate) rounds: usize,
    pub(crate) renders: usize,
}

impl Solution<'_> {
    pub(crate) fn support(&self) -> Support {
        self.frame.support()
    }
}

fn judge<'a>(view: &'a View, frame: Frame<'a>, settings: &PlacementSettings) -> Judge<'a> {
    let dense = frame.scene.points.as_ref().is_some_and(RoomPoints::is_dense);
    Judge { view, frame, size_sigma: settings.size_sigma, use_depth: settings.point_map && dense }
}

/// Places one object into the partial scene; it is not among the placed ones there.
pub(crate) fn solve<'a>(
    scene: &'a PartialScene,
    item: &'a Item,
    view: &'a View,
    settings: &'a PlacementSettings,
) -> Solution<'a> {
    let starter = Starter { scene, item, view, settings };
    let best = best_of(starter.all(), view, settings);
    let on_host = matches!(best.frame.anchoring, Anchoring::OnHost { .. });
    let poor = best.seen.strict_iou < POOR_IOU || best.frame.supported_share(&best.pose) < POOR_SUPPORT;
    let others = if on_host && poor { first_on_host::on_other_hosts(&starter) } else { Vec::new() };
    if others.is_empty() {
        return best;
    }
    let mut other = best_of(others, view, settings);
    other.renders += best.renders;
    if other.cost < best.cost { other } else { Solution { renders: other.renders, ..best } }
}

/// The best pose to which any of the hypotheses (at least one) leads.
fn best_of<'a>(mut hypotheses: Vec<Hypothesis<'a>>, view: &'a View, settings: &'a PlacementSettings) -> Solution<'a> {
    if settings.refinement {
        let fitted: Vec<Hypothesis<'a>> = hypotheses
            .par_iter()
            .filter_map(|h| {
                Some(Hypothesis { pose: outline::fit(&h.frame, view, &h.pose, settings.size_sigma)?, ..h.clone() })
            })
            .collect();
        hypotheses.extend(fitted);
        hypotheses = distinct(hypotheses);
    }
    let mut tries: Vec<Solution<'a>> = hypotheses
        .into_par_iter()
        .map(|Hypothesis { frame, pose, price }| {
            let (cost, seen) = judge(view, frame, settings).cost(&pose);
            let (cost, first_iou) = (cost + price, seen.iou);
            let first = Solution { frame, pose, cost, seen, first_iou, rounds: 0, renders: 1 };
            if settings.refinement { rounds(first, price, view, settings, 1) } else { first }
        })
        .collect();
    tries.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    if !settings.refinement || tries.len() == 1 && tries[0].rounds == 0 {
        return tries.swap_remove(0);
    }
    let spent: usize = tries.iter().map(|t| t.renders).sum();
    let mut kept: Vec<Solution<'a>> = Vec::new();
    for t in tries {
        if kept.len() < FINALISTS && !kept.iter().any(|k| alike(&k.frame, &k.pose, &t.frame, &t.pose)) {
            kept.push(t);
        }
    }
    let tries = kept;
    let count = tries.len();
    let mut finals: Vec<Solution<'a>> = tries
        .into_par_iter()
        .map(|t| {
            let price = t.cost - judge(view, t.frame, settings).cost(&t.pose).0;
            let t = rounds(t, price, view, settings, settings.max_rounds);
            if settings.optimiser { search(t, price, view, settings, settings.renders_per_object / 2) } else { t }
        })
        .collect();
    finals.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut best = finals.swap_remove(0);
    if settings.optimiser && count > 1 {
        let price = best.cost - judge(view, best.frame, settings).cost(&best.pose).0;
        best = search(best, price, view, settings, settings.renders_per_object / 2);
    }
    best.renders += spent;
    best
}

/// Whether two poses are the same start for what follows.
fn alike(frame_a: &Frame, a: &Pose, frame_b: &Frame, b: &Pose) -> bool {
    std::mem::discriminant(&frame_a.anchoring) == std::mem::discriminant(&frame_b.anchoring)
        && (a.position - b.position).length() < 0.02
        && angle_between(a.yaw, b.yaw).abs() < 0.06
        && (a.scale / b.scale).ln().abs() < 0.02
        && (a.stretch / b.stretch - 1.0).abs().max_element() < 0.03
}

fn distinct(all: Vec<Hypothesis>) -> Vec<Hypothesis> {
    let mut out: Vec<Hypothesis> = Vec::new();
    for h in all {
        if !out.iter().any(|o| o.price <= h.price && alike(&o.frame, &o.pose, &h.frame, &h.pose)) {
            out.push(h);
        }
    }
    out
}

/// Refines a placed object where it stands, all others as they are now.
pub(crate) fn polish<'a>(
    frame: Frame<'a>,
    pose: &Pose,
    view: &'a View,
    settings: &PlacementSettings,
    budget: usize,
) -> Solution<'a> {
    let pose = frame.settle(pose);
    let (cost, seen) = judge(view, frame, settings).cost(&pose);
    let start = Solution { frame, pose, cost, seen, first_iou: seen.iou, rounds: 0, renders: 1 };
    search(start, 0.0, view, settings, budget)
}

/// Silhouette and depth step in turn, until nothing moves. A step is kept when it neither lowers the IoU nor
/// raises the cost.
fn rounds<'a>(
    mut at: Solution<'a>,
    price: f64,
    view: &View,
    settings: &PlacementSettings,
    limit: usize,
) -> Solution<'a> {
    let judge = Judge { view, ..judge(view, at.frame, settings) };
    for _ in 0..limit {
        let before = at.pose;
        at.rounds += 1;
        for kind in 0..3 {
            let next = match kind {
                0 => Some(steps::silhouette_step(&at.frame, view, &at.pose)),
                1 if judge.use_depth => steps::depth_step(&at.frame, view, &at.pose),
                1 => None,
                _ if judge.use_depth => None,
                _ => steps::contact_step(&at.frame, view, &at.pose),
            };
            let Some(next) = next else { continue };
            // Depth changes disturb the silhouette a little; the step is judged once that is set right again.
            let next = if kind == 0 { next } else { steps::silhouette_step(&at.frame, view, &next) };
            let (cost, seen) = judge.cost(&next);
            at.renders += 4;
            let no_worse = seen.iou >= at.seen.iou - IOU_SLACK && cost + price <= at.cost + IOU_SLACK;
            if no_worse || cost + price < at.cost - 0.02 {
                at = Solution { pose: next, cost: cost + price, seen, ..at };
            }
        }
        let moved = (at.pose.position - before.position).length();
        let scaled = ((at.pose.scale * at.pose.stretch) / (before.scale * before.stretch) - 1.0).abs().max_element();
        if moved < SMALL_MOVE && scaled < SMALL_SCALE {
            break;
        }
    }
    at
}

/// Downhill simplex over the free numbers, twice with smaller steps.
fn search<'a>(
    mut at: Solution<'a>,
    price: f64,
    view: &View,
    settings: &PlacementSettings,
    budget: usize,
) -> Solution<'a> {
    let judge = Judge { view, ..judge(view, at.frame, settings) };
    for (share, shrink) in [(0.6, 1.0), (0.4, 0.35)] {
        let origin: Parameters = at.frame.parameters(&at.pose);
        let free = at.frame.free_numbers(&at.pose);
        let start: Vec<f64> = free.iter().map(|(i, _)| origin[*i]).collect();
        let steps: Vec<f64> = free.iter().map(|(_, s)| s * shrink).collect();
        let pose_of = |x: &[f64]| {
            let mut numbers = origin;
            for ((i, _), v) in free.iter().zip(x) {
                numbers[*i] = *v;
            }
            at.frame.pose(&numbers)
        };
        let budget = (share * budget as f64) as usize;
        let found = nelder_mead(&start, &steps, budget, 0.02, |x| judge.cost(&pose_of(x)).0 + price);
        at.renders += found.evaluations;
        if found.value < at.cost {
            let pose = pose_of(&found.at);
            let (cost, seen) = judge.cost(&pose);
            at = Solution { pose, cost: cost + price, seen, ..at };
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Level, Mask, ObjectId, Support, Vec3, Wall};

    use super::*;
    use crate::testing::{boxed, empty_room, of_boxes, seen};
    use crate::{Evidence, Placed};

    fn solved(scene: &PartialScene, item: &Item) -> Pose {
        let settings = PlacementSettings::default();
        let view = View::new(scene, None, &item.mask, &[], settings.window_px).unwrap();
        solve(scene, item, &view, &settings).pose
    }

    /// Distance of the nearest first pose to a place, metres.
    fn nearest_start(scene: &PartialScene, item: &Item, at: Vec3) -> f64 {
        let settings = PlacementSettings::default();
        let view = View::new(scene, None, &item.mask, &[], settings.window_px).unwrap();
        let starts = Starter { scene, item, view: &view, settings: &settings }.all();
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
        item.mask = Mask::from_fn(whole.size(), |x, y| x > middle && whole.get(i64::from(x), i64::from(y)));
        item.shape = std::sync::Arc::new(shape);
        let left = Mask::from_fn(whole.size(), |x, y| x <= middle && whole.get(i64::from(x), i64::from(y)));
        item.occluders = Some(left);
        let far = nearest_start(&scene, &item, at);
        assert!(far < 0.1, "{far}");
        let pose = solved(&scene, &item);
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
        item.mask = seen(&scene, &shape, &Pose::new(at, std::f64::consts::PI, 1.0));
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
            let view = View::new(&scene, None, &chair.mask, &[], settings.window_px).unwrap();
            let starts = Starter { scene: &scene, item: chair, view: &view, settings: &settings }.all();
            let backwards = starts.iter().filter(|h| angle_between(h.pose.yaw, std::f64::consts::PI).abs() < 0.5);
            backwards.map(|h| h.price).fold(f64::INFINITY, f64::min)
        };
        assert!(cheapest_backwards(&chair) > 0.1);
        chair.relations.facing_toward = Some(ObjectId::numbered("box", 1));
        assert!(cheapest_backwards(&chair) < 1e-9);
    }

    #[test]
    fn a_lamp_said_to_stand_on_the_chair_before_its_table_is_put_on_the_table() {
        let mut scene = empty_room();
        let place = |scene: &mut PartialScene, name: &str, parts: &[(Vec3, Vec3)], at: Vec3| {
            let pose = Pose::new(at, 0.0, 1.0);
            let shape = of_boxes(parts);
            let mut item = boxed(scene, shape.extent(), at, 0.0);
            item.id = ObjectId::numbered(name, 1);
            item.mask = seen(scene, &shape, &pose);
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
            let view = View::new(&scene, None, &second.mask, &[], settings.window_px).unwrap();
            let starter = Starter { scene: &scene, item: &second, view: &view, settings: &settings };
            assert!((starter.sized(Vec3::ZERO, 0.0).scale - scale).abs() < 1e-6);
        }
    }
}
