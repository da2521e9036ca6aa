//! Means and how sure they are, over scenes.
//!
//! Intervals are percentile bootstraps (B. Efron, "Bootstrap Methods: Another Look at the Jackknife", 1979) at 95 %:
//! scenes are drawn with replacement, as often as there are scenes, [`RESAMPLES`] times, from a stated seed. They say
//! how far the mean would move with other scenes *of the same kind*, nothing about bias. With fewer than about ten
//! scenes they are too narrow; with one there is none.
//!
//! The sign test (W. J. Dixon, A. M. Mood, 1946) asks whether one side wins more scenes than a coin would let it; ties
//! are left out. It is exact and two-sided.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Bootstrap samples of an interval.
pub const RESAMPLES: usize = 4000;
/// Share of the bootstrap samples that lies in an interval.
pub const COVERAGE: f64 = 0.95;

/// An interval, both ends in it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// A mean over scenes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// Scenes.
    pub n: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation of a sample (n - 1); `None` for one scene.
    pub sd: Option<f64>,
    /// Bootstrap interval of the mean; `None` for one scene.
    pub interval: Option<Interval>,
}

impl Mean {
    /// Of some values; `None` without any. Values are finite.
    pub fn of(values: &[f64], seed: u64) -> Option<Self> {
        let mean = mean(values)?;
        Some(Self { n: values.len(), mean, sd: deviation(values), interval: bootstrap(values, seed) })
    }
}

/// The arithmetic mean; `None` of nothing.
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Standard deviation of a sample; `None` for fewer than two values.
pub fn deviation(values: &[f64]) -> Option<f64> {
    let about = mean(values).filter(|_| values.len() > 1)?;
    Some((values.iter().map(|v| (v - about).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt())
}

/// The middle value, or the middle of the two; `None` of nothing.
pub fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let half = sorted.len() / 2;
    match sorted.len() {
        0 => None,
        n if n % 2 == 1 => Some(sorted[half]),
        _ => Some(f64::midpoint(sorted[half - 1], sorted[half])),
    }
}

/// Bootstrap interval of the mean; `None` for fewer than two values.
pub fn bootstrap(values: &[f64], seed: u64) -> Option<Interval> {
    bootstrap_of(values.len(), seed, |drawn| drawn.iter().map(|i| values[*i]).sum::<f64>() / drawn.len() as f64)
}

/// Bootstrap interval of any figure of `n` scenes, which is given the scenes drawn; `None` for fewer than two scenes.
pub fn bootstrap_of(n: usize, seed: u64, figure: impl FnMut(&[usize]) -> f64) -> Option<Interval> {
    bootstrap_times(n, RESAMPLES, seed, figure)
}

/// The same with a number of samples of its own, for figures that take long.
pub fn bootstrap_times(
    n: usize,
    resamples: usize,
    seed: u64,
    mut figure: impl FnMut(&[usize]) -> f64,
) -> Option<Interval> {
    if n < 2 || resamples == 0 {
        return None;
    }
    let mut numbers = ChaCha8Rng::seed_from_u64(seed);
    let mut drawn = vec![0; n];
    let mut figures: Vec<f64> = (0..resamples)
        .map(|_| {
            drawn.fill_with(|| numbers.random_range(0..n));
            figure(&drawn)
        })
        .collect();
    figures.sort_by(f64::total_cmp);
    Some(Interval {
        low: quantile(&figures, (1.0 - COVERAGE) / 2.0),
        high: quantile(&figures, f64::midpoint(1.0, COVERAGE)),
    })
}

/// A quantile of sorted values, between the two nearest.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let place = q * (sorted.len() - 1) as f64;
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    sorted[low] + (sorted[high] - sorted[low]) * (place - low as f64)
}

/// Two-sided p value of the sign test: how often a fair coin falls at least as unevenly. 1 without any trial.
pub fn sign_test(wins: usize, losses: usize) -> f64 {
    let n = wins + losses;
    let fewer = wins.min(losses);
    // Terms of the binomial distribution by their logarithms: 2^-n is nothing for a thousand scenes.
    let mut log_term = -(n as f64) * std::f64::consts::LN_2;
    let mut tail = 0.0;
    for k in 0..=fewer {
        if k > 0 {
            log_term += ((n - k + 1) as f64).ln() - (k as f64).ln();
        }
        tail += log_term.exp();
    }
    (2.0 * tail).min(1.0)
}

/// Two sets over the same scenes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Paired {
    /// Mean of the differences, first minus second, and its bootstrap interval.
    pub difference: Mean,
    /// Middle difference.
    pub median: f64,
    /// Scenes where the first is lower.
    pub lower: usize,
    /// Scenes where it is higher.
    pub higher: usize,
    /// Scenes where both are equal.
    pub equal: usize,
    /// Two-sided p value of the sign test.
    pub p: f64,
}

impl Paired {
    /// Of pairs (first, second); `None` without any.
    pub fn of(pairs: &[(f64, f64)], seed: u64) -> Option<Self> {
        let differences: Vec<f64> = pairs.iter().map(|(a, b)| a - b).collect();
        let count = |test: &dyn Fn(&f64) -> bool| differences.iter().filter(|d| test(d)).count();
        let (lower, higher) = (count(&|d| *d < 0.0), count(&|d| *d > 0.0));
        Some(Self {
            difference: Mean::of(&differences, seed)?,
            median: median(&differences)?,
            lower,
            higher,
            equal: differences.len() - lower - higher,
            p: sign_test(lower, higher),
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::Rng as _;

    use super::*;

    #[test]
    fn the_sign_test_has_the_values_of_the_binomial_distribution() {
        // By hand: 2 * (C(8,0) + C(8,1)) / 2^8, 2 * 1 / 2^5, and everything where both win as often.
        assert!((sign_test(1, 7) - 18.0 / 256.0).abs() <= 1e-12);
        assert!((sign_test(5, 0) - 2.0 / 32.0).abs() <= 1e-12);
        assert_eq!((sign_test(4, 4), sign_test(0, 0)), (1.0, 1.0));
        // 600 of 1000 is 6.3 standard deviations: known to be 2.73e-10 (R: binom.test(600, 1000)$p.value).
        let p = sign_test(600, 400);
        assert!((p / 2.728e-10 - 1.0).abs() < 0.01, "{p}");
        assert!(sign_test(1200, 800) > 0.0, "no underflow to nothing");
    }

    #[test]
    fn means_and_deviations_are_those_of_the_textbook() {
        let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0];
        assert_eq!(mean(&values), Some(5.0));
        assert!((deviation(&values).unwrap() - (32.0_f64 / 7.0).sqrt()).abs() <= 1e-12);
        assert_eq!(median(&values), Some(4.5));
        assert_eq!((mean(&[]), deviation(&[1.0]), median(&[])), (None, None, None));
        let one = Mean::of(&[3.0], 1).unwrap();
        assert_eq!((one.n, one.sd, one.interval), (1, None, None));
    }

    #[test]
    fn an_interval_covers_the_true_mean_as_often_as_it_says() {
        // 400 samples of 40 exponential values of mean 1: skewed, so that the percentile bootstrap covers a bit less
        // than 95 % (about 93 %); 90 % and 98 % are four standard errors and more away.
        let mut numbers = ChaCha8Rng::seed_from_u64(5);
        let mut covered = 0;
        for trial in 0..400 {
            let values: Vec<f64> = (0..40).map(|_| -(1.0 - numbers.random::<f64>()).ln()).collect();
            let i = bootstrap_times(values.len(), 500, trial, |d| {
                d.iter().map(|k| values[*k]).sum::<f64>() / d.len() as f64
            })
            .unwrap();
            covered += usize::from(i.low <= 1.0 && 1.0 <= i.high);
        }
        assert!((352..=392).contains(&covered), "{covered} of 400");
    }

    #[test]
    fn pairs_that_shift_alike_are_sure_whatever_the_scenes_are() {
        let pairs: Vec<(f64, f64)> = (0..12).map(|k| (f64::from(k * k), f64::from(k * k) + 1.0)).collect();
        let p = Paired::of(&pairs, 3).unwrap();
        assert_eq!((p.difference.mean, p.lower, p.higher, p.equal, p.median), (-1.0, 12, 0, 0, -1.0));
        assert_eq!(p.difference.interval, Some(Interval { low: -1.0, high: -1.0 }));
        assert!((p.p - 2.0 / 4096.0).abs() <= 1e-12);
        assert_eq!(Paired::of(&[], 3), None);
        assert_eq!(Paired::of(&[(1.0, 1.0)], 3).map(|p| (p.equal, p.p)), Some((1, 1.0)));
    }

    proptest! {
        #[test]
        fn the_same_seed_gives_the_same_interval_around_the_mean(
            values in prop::collection::vec(-5.0..5.0_f64, 2..40), seed in 0_u64..99,
        ) {
            let a = bootstrap(&values, seed).unwrap();
            prop_assert_eq!(a, bootstrap(&values, seed).unwrap());
            let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
            prop_assert!(low - 1e-12 <= a.low && a.low <= a.high && a.high <= high + 1e-12);
        }
    }
}
