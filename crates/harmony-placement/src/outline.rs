//! A start from the free edges alone: no pixel is drawn, so that many starts can be tried.

use harmony_scene::Pose;

use crate::anchoring::{Frame, Parameters};
use crate::cost::size_deviations;
use crate::optimise::nelder_mead;
use crate::view::{View, outline_of};

/// Evaluations of one fit; each projects a few hundred hull points.
const EVALUATIONS: usize = 140;

/// Cost of one sigma of size against one squared relative edge error.
const SIZE: f64 = 0.01;

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
    let b = &view.mask_box;
    let (w, h) = (b.width().max(4.0), b.height().max(4.0));
    let cost = |x: &[f64]| {
        let pose = pose_of(x);
        let points = frame.item.shape.hulls().iter().flatten().copied();
        let Some(o) = outline_of(&frame.scene.camera, points, &pose) else { return 10.0 };
        let errors = [(o.x0 - b.x0) / w, (o.y0 - b.y0) / h, (o.x1 - b.x1) / w, (o.y1 - b.y1) / h];
        let edges: f64 = errors.iter().zip(view.free).filter(|(_, f)| *f).map(|(e, _)| e * e).sum();
        let sizes: f64 = size_deviations(frame.item, &pose).iter().map(|d| (d / size_sigma.max(1e-3)).powi(2)).sum();
        edges + SIZE * sizes
    };
    let start: Vec<f64> = free.iter().map(|(i, _)| origin[*i]).collect();
    let steps: Vec<f64> = free.iter().map(|(i, s)| if *i < 2 { 4.0 * s } else { 2.0 * s }).collect();
    Some(pose_of(&nelder_mead(&start, &steps, EVALUATIONS, 0.01, cost).at))
}
