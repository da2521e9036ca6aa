//! A start from the free edges alone: no pixel is drawn, so that many starts can be tried.

use harmony_scene::Pose;

use crate::anchoring::{Frame, Parameters};
use crate::cost::{edge_errors, size_deviations};
use crate::optimise::nelder_mead;
use crate::view::View;

/// Evaluations of one fit; each projects a few hundred hull points.
const EVALUATIONS: usize = 140;

/// Cost of one sigma of size against one squared relative edge error.
const SIZE: f64 = 0.01;

/// Cost of one first step away from the start.
const TETHER: f64 = 1e-3;

/// Moves and scales an object until its outline meets the mask's free edges, its size staying near the prior.
///
/// `None` when there are not two free edges to meet.
pub(crate) fn fit(frame: &Frame, view: &View, pose: &Pose, size_sigma: f64) -> Option<Pose> {
    if view.free.iter().filter(|f| **f).count() < 2 {
        return None;
    }
    let origin: Parameters = frame.parameters(pose);
    // Yaw is left to the silhouette: edges alone would trade it for size.
    let free: Vec<(usize, f64)> = frame.free_numbers(pose).into_iter().filter(|(i, _)| *i != 2).collect();
    let pose_of = |x: &[f64]| {
        let mut numbers = origin;
        for ((i, _), v) in free.iter().zip(x) {
            numbers[*i] = *v;
        }
        frame.pose(&numbers)
    };
    let start: Vec<f64> = free.iter().map(|(i, _)| origin[*i]).collect();
    let steps: Vec<f64> = free.iter().map(|(i, s)| if *i < 2 { 4.0 * s } else { 2.0 * s }).collect();
    let cost = |x: &[f64]| {
        let pose = pose_of(x);
        let Some(o) = view.outline_of_shape(&frame.item.shape, &pose) else { return 10.0 };
        let edges: f64 = edge_errors(view, &o).iter().map(|e| e * e).sum();
        // What no edge decides stays where the start was.
        let moved: f64 = (0..x.len().min(2)).map(|i| ((x[i] - start[i]) / steps[i]).powi(2)).sum();
        let sizes: f64 = size_deviations(frame.item, &pose).iter().map(|d| (d / size_sigma.max(1e-3)).powi(2)).sum();
        edges + SIZE * sizes + TETHER * moved
    };
    Some(pose_of(&nelder_mead(&start, &steps, EVALUATIONS, 0.01, cost).at))
}
