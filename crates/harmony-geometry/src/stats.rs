//! Medians, percentiles and means that outliers don't move.

use harmony_scene::Vec3;

/// Consistency factor that makes the MAD of a normal distribution its standard deviation.
pub const MAD_TO_SIGMA: f64 = 1.4826;

/// Values farther than this many robust sigmas from the median are left out of robust means.
const REJECT_SIGMAS: f64 = 2.5;

/// Rounds of rejection at most; it settles after two or three.
const ROUNDS: usize = 10;

/// The `p`-th percentile (0..=100) with linear interpolation between order statistics; NaNs are left out.
///
/// `None` when no finite value is there.
pub fn percentile(values: &[f64], p: f64) -> Option<f64> {
    let mut kept: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    percentile_in_place(&mut kept, p)
}

/// [`percentile`] on a scratch buffer of finite values, reordered by the call.
pub(crate) fn percentile_in_place(values: &mut [f64], p: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let position = (p / 100.0).clamp(0.0, 1.0) * last as f64;
    let low = position.floor() as usize;
    let (_, lower, above) = values.select_nth_unstable_by(low, f64::total_cmp);
    let lower = *lower;
    let fraction = position - low as f64;
    if fraction <= 0.0 || above.is_empty() {
        return Some(lower);
    }
    let upper = above.iter().copied().fold(f64::INFINITY, f64::min);
    Some(lower + (upper - lower) * fraction)
}

/// The median; `None` when no finite value is there.
pub fn median(values: &[f64]) -> Option<f64> {
    percentile(values, 50.0)
}

/// Median and median absolute deviation.
pub fn median_absolute_deviation(values: &[f64]) -> Option<(f64, f64)> {
    let centre = median(values)?;
    let deviations: Vec<f64> = values.iter().filter(|v| v.is_finite()).map(|v| (v - centre).abs()).collect();
    Some((centre, median(&deviations)?))
}

/// Iterative median with MAD rejection, then the mean of what is left.
pub fn robust_mean_scalar(values: &[f64]) -> Option<f64> {
    let kept = keep_near_median(values.iter().copied().filter(|v| v.is_finite()).collect(), |v| *v);
    (!kept.is_empty()).then(|| kept.iter().sum::<f64>() / kept.len() as f64)
}

/// Robust mean of points: rejection by distance from the component-wise median, then the mean.
pub fn robust_mean(points: &[Vec3]) -> Option<Vec3> {
    let mut kept: Vec<Vec3> = points.iter().copied().filter(|p| p.is_finite()).collect();
    for _ in 0..ROUNDS {
        let centre = component_median(&kept)?;
        let distances: Vec<f64> = kept.iter().map(|p| p.distance(centre)).collect();
        // Distances are one-sided: their median is itself the scale.
        let limit = REJECT_SIGMAS * MAD_TO_SIGMA * median(&distances)?;
        let before = kept.len();
        kept.retain(|p| p.distance(centre) <= limit.max(f64::EPSILON));
        if kept.len() == before || kept.is_empty() {
            break;
        }
    }
    mean(&kept)
}

/// Robust mean of the surface an object turns to the camera (paper Sec. 3.3, "robust front-surface means by
/// iterative median with MAD outlier rejection").
///
/// Rejection is along the viewing direction `forward` (unit, the frame of `points`): background seen through
/// the object's gaps or leaking in at its outline differs in depth first of all. The rest is averaged in 3D.
/// `None` when no finite point is there.
pub fn front_surface_mean(points: &[Vec3], forward: Vec3) -> Option<Vec3> {
    let finite: Vec<Vec3> = points.iter().copied().filter(|p| p.is_finite()).collect();
    let kept = keep_near_median(finite, |p| p.dot(forward));
    mean(&kept)
}

fn keep_near_median<T>(mut kept: Vec<T>, value: impl Fn(&T) -> f64) -> Vec<T> {
    for _ in 0..ROUNDS {
        let values: Vec<f64> = kept.iter().map(&value).collect();
        let Some((centre, mad)) = median_absolute_deviation(&values) else { break };
        let limit = REJECT_SIGMAS * MAD_TO_SIGMA * mad;
        let before = kept.len();
        kept.retain(|v| (value(v) - centre).abs() <= limit);
        if kept.len() == before {
            break;
        }
    }
    kept
}

fn component_median(points: &[Vec3]) -> Option<Vec3> {
    let column = |axis: usize| median(&points.iter().map(|p| p[axis]).collect::<Vec<_>>());
    Some(Vec3::new(column(0)?, column(1)?, column(2)?))
}

fn mean(points: &[Vec3]) -> Option<Vec3> {
    (!points.is_empty()).then(|| points.iter().copied().sum::<Vec3>() / points.len() as f64)
}
