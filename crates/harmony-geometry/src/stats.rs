//! Medians, percentiles and a mean that outliers don't move.
//!
//! For measurements with strays: values that are no numbers are left out, order statistics interpolate, and the robust
//! mean rejects by the median absolute deviation until nothing changes. In the unit of the values. It holds up to about
//! a third of strays; two equal heaps have no middle, and which of them wins is chance.

/// Consistency factor that makes the MAD of a normal distribution its standard deviation.
pub const MAD_TO_SIGMA: f64 = 1.4826;

/// Values farther than this many robust sigmas from the median are left out of the robust mean.
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
    let kept = keep_near_median(values.iter().copied().filter(|v| v.is_finite()).collect());
    (!kept.is_empty()).then(|| kept.iter().sum::<f64>() / kept.len() as f64)
}

fn keep_near_median(mut kept: Vec<f64>) -> Vec<f64> {
    for _ in 0..ROUNDS {
        let Some((centre, mad)) = median_absolute_deviation(&kept) else { break };
        let limit = REJECT_SIGMAS * MAD_TO_SIGMA * mad;
        let before = kept.len();
        kept.retain(|v| (v - centre).abs() <= limit);
        if kept.len() == before {
            break;
        }
    }
    kept
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
        fn a_robust_mean_ignores_a_third_of_outliers(
            inside in prop::collection::vec(-0.02f64..0.02, 60..90),
            far in prop::collection::vec(0.5f64..6.0, 1..30),
            centre in -3.0f64..3.0,
        ) {
            let mut values: Vec<f64> = inside.iter().map(|v| v + centre).collect();
            let clean = values.iter().sum::<f64>() / values.len() as f64;
            values.extend(far.iter().map(|v| v + centre));
            prop_assert!((robust_mean_scalar(&values).unwrap() - clean).abs() <= 0.02);
        }
    }

    #[test]
    fn nothing_has_no_mean() {
        assert!(robust_mean_scalar(&[f64::NAN]).is_none());
        assert_eq!(robust_mean_scalar(&[1.0; 4]), Some(1.0));
    }
}
