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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn percentiles_interpolate_and_skip_nan() {
        let values = [3.0, f64::NAN, 1.0, 2.0, 4.0, f64::INFINITY];
        assert_eq!(percentile(&values, 0.0), Some(1.0));
        assert_eq!(percentile(&values, 50.0), Some(2.5));
        assert_eq!(percentile(&values, 100.0), Some(4.0));
        assert_eq!(percentile(&[], 50.0), None);
        assert_eq!(median_absolute_deviation(&[1.0, 2.0, 3.0, 4.0, 100.0]), Some((3.0, 1.0)));
    }

    proptest! {
        #[test]
        fn a_percentile_has_its_share_below(mut values in prop::collection::vec(-1e3f64..1e3, 1..200), p in 0.0f64..100.0) {
            let at = percentile(&values, p).unwrap();
            values.sort_by(f64::total_cmp);
            let below = values.iter().filter(|v| **v < at).count() as f64;
            let above = values.iter().filter(|v| **v > at).count() as f64;
            let gaps = (values.len() - 1) as f64;
            prop_assert!(below <= p / 100.0 * gaps + 1.0 + 1e-6);
            prop_assert!(above <= (1.0 - p / 100.0) * gaps + 1.0 + 1e-6);
        }

        #[test]
        fn robust_means_ignore_a_third_of_outliers(
            inside in prop::collection::vec(-0.02f64..0.02, 60..90),
            far in prop::collection::vec(0.5f64..6.0, 1..30),
            centre in -3.0f64..3.0,
        ) {
            let mut values: Vec<f64> = inside.iter().map(|v| v + centre).collect();
            let clean = values.iter().sum::<f64>() / values.len() as f64;
            values.extend(far.iter().map(|v| v + centre));
            prop_assert!((robust_mean_scalar(&values).unwrap() - clean).abs() <= 0.02);

            // A surface facing along a slanted direction, with background showing through.
            let forward = Vec3::new(0.3, -0.2, 0.9).normalize();
            let side = forward.any_orthonormal_vector();
            let mut points: Vec<Vec3> = inside
                .iter()
                .enumerate()
                .map(|(i, v)| forward * (3.0 + v) + side * (i as f64 * 0.005))
                .collect();
            let front = points.iter().copied().sum::<Vec3>() / points.len() as f64;
            points.extend(far.iter().map(|v| forward * (3.0 + v) + side * (v * 0.1)));
            let found = front_surface_mean(&points, forward).unwrap();
            prop_assert!((found - front).dot(forward).abs() <= 0.02);
            prop_assert!(robust_mean(&points).unwrap().distance(front) <= 0.1);
        }
    }

    #[test]
    fn nothing_has_no_mean() {
        assert!(robust_mean(&[]).is_none());
        assert!(front_surface_mean(&[Vec3::NAN], Vec3::Z).is_none());
        assert_eq!(robust_mean(&[Vec3::ONE; 4]), Some(Vec3::ONE));
    }
}
