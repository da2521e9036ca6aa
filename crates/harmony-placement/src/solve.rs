//! One object, from its hypotheses to a pose: the paper's two coupled steps, then a bounded local search.

use harmony_scene::{Pose, Support};
use rayon::prelude::*;

use crate::anchoring::{Frame, Parameters};
use crate::cost::{Judge, angle_between};
use crate::first_pose::{Hypothesis, Starter};
use crate::optimise::nelder_mead;
use crate::view::{Match, View};
use crate::{Item, PartialScene, PlacementSettings, RoomPoints, outline, steps};

/// Hypotheses that get the full rounds.
const FINALISTS: usize = 4;

/// Rounds end when a pose changes less than this, metres.
const SMALL_MOVE: f64 = 1e-3;

/// And its scale less than this, relative.
const SMALL_SCALE: f64 = 1e-3;

/// A step may lower the IoU by no more than this: one row of window pixels.
const IOU_SLACK: f64 = 0.003;

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
    let mut hypotheses = starter.all();
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
