//! Tests on ranks, and the few distributions that they need.

use std::f64::consts::{PI, SQRT_2};

use serde::Serialize;

/// Friedman's test and Kendall's coefficient of concordance, corrected for ties.
///
/// M. Friedman, "The use of ranks to avoid the assumption of normality", 1937; M. G. Kendall and B. Babington Smith,
/// "The problem of m rankings", 1939. The p-value is the chi-square approximation: rough below ten blocks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Friedman {
    /// Blocks (people, or scenes).
    pub blocks: usize,
    /// Mean rank of each column.
    pub mean_ranks: Vec<f64>,
    /// Chi-square, `columns - 1` degrees of freedom.
    pub chi2: f64,
    /// Probability of such a value or a larger one when nothing differs.
    pub p: f64,
    /// Kendall's W, 0 = no agreement of the blocks, 1 = full.
    pub w: f64,
}

/// Friedman's test on values of which smaller is better; rows are blocks. `None` with fewer than two rows or columns,
/// or when every block has nothing but ties.
pub fn friedman(rows: &[Vec<f64>]) -> Option<Friedman> {
    let (n, k) = (rows.len(), rows.first()?.len());
    if n < 2 || k < 2 || rows.iter().any(|r| r.len() != k) {
        return None;
    }
    let mut sums = vec![0.0; k];
    let mut squares = 0.0;
    for row in rows {
        for (sum, rank) in sums.iter_mut().zip(average_ranks(row)) {
            *sum += rank;
            squares += rank * rank;
        }
    }
    let (nf, kf) = (n as f64, k as f64);
    let expected = nf * (kf + 1.0) / 2.0;
    let between: f64 = sums.iter().map(|s| (s - expected).powi(2)).sum();
    let within = squares - nf * kf * (kf + 1.0).powi(2) / 4.0;
    if within <= 1e-12 {
        return None;
    }
    let chi2 = (kf - 1.0) * between / within;
    Some(Friedman {
        blocks: n,
        mean_ranks: sums.iter().map(|s| s / nf).collect(),
        chi2,
        p: chi2_above(chi2, kf - 1.0),
        w: chi2 / (nf * (kf - 1.0)),
    })
}

/// Ranks from 1; equal values share the mean of their ranks.
pub fn average_ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut i = 0;
    while i < order.len() {
        let mut j = i;
        while j + 1 < order.len() && values[order[j + 1]] == values[order[i]] {
            j += 1;
        }
        let mean = (i + j) as f64 / 2.0 + 1.0;
        order[i..=j].iter().for_each(|o| ranks[*o] = mean);
        i = j + 1;
    }
    ranks
}

/// Difference of mean ranks from which two columns differ at this level.
///
/// P. Nemenyi, "Distribution-free multiple comparisons", 1963, as in J. Demsar, "Statistical comparisons of classifiers
/// over multiple data sets", 2006.
pub fn nemenyi_critical(columns: usize, blocks: usize, level: f64) -> f64 {
    let k = columns as f64;
    range_quantile(1.0 - level, columns) / SQRT_2 * (k * (k + 1.0) / (6.0 * blocks as f64)).sqrt()
}

/// Nemenyi's p-value for a difference of mean ranks.
pub fn nemenyi_p(difference: f64, columns: usize, blocks: usize) -> f64 {
    let k = columns as f64;
    let q = difference.abs() / (k * (k + 1.0) / (12.0 * blocks as f64)).sqrt();
    (1.0 - range_below(q, columns)).clamp(0.0, 1.0)
}

/// Two-sided exact sign test.
pub fn sign_test(wins: usize, losses: usize) -> f64 {
    let n = wins + losses;
    if n == 0 {
        return 1.0;
    }
    let log_choose =
        |i: usize| libm::lgamma(n as f64 + 1.0) - libm::lgamma(i as f64 + 1.0) - libm::lgamma((n - i) as f64 + 1.0);
    let tail: f64 = (0..=wins.min(losses)).map(|i| (log_choose(i) - n as f64 * 2.0_f64.ln()).exp()).sum();
    (2.0 * tail).min(1.0)
}

/// Kendall's tau of two orders without ties.
pub fn kendall_tau(a: &[u8], b: &[u8]) -> f64 {
    let (mut same, mut pairs) = (0_i64, 0_i64);
    for i in 0..a.len().min(b.len()) {
        for j in 0..i {
            let product = (i64::from(a[i]) - i64::from(a[j])).signum() * (i64::from(b[i]) - i64::from(b[j])).signum();
            same += product;
            pairs += 1;
        }
    }
    if pairs == 0 { 1.0 } else { same as f64 / pairs as f64 }
}

/// Probability that a chi-square variable is above `x`.
pub fn chi2_above(x: f64, degrees: f64) -> f64 {
    if x <= 0.0 || degrees <= 0.0 {
        return 1.0;
    }
    upper_gamma(degrees / 2.0, x / 2.0)
}

/// The regularised upper incomplete gamma function: its series below a + 1, its continued fraction (Lentz) above.
fn upper_gamma(a: f64, x: f64) -> f64 {
    let front = (a * x.ln() - x - libm::lgamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        for _ in 0..10_000 {
            n += 1.0;
            term *= x / n;
            sum += term;
            if term < sum * 1e-16 {
                break;
            }
        }
        return (1.0 - front * sum).clamp(0.0, 1.0);
    }
    let tiny = 1e-300;
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / tiny;
    let mut d = 1.0 / b;
    let mut h = d;
    for i in 1..10_000 {
        let an = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = an * d + b;
        d = 1.0 / if d.abs() < tiny { tiny } else { d };
        c = b + an / c;
        c = if c.abs() < tiny { tiny } else { c };
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    (front * h).clamp(0.0, 1.0)
}

/// Probability that the range of `k` standard normal variables is below `q` (the studentised range with an infinite
/// number of degrees of freedom), by Simpson's rule.
fn range_below(q: f64, k: usize) -> f64 {
    if q <= 0.0 {
        return 0.0;
    }
    let density = |z: f64| (-z * z / 2.0).exp() / (2.0 * PI).sqrt();
    let below = |z: f64| libm::erfc(-z / SQRT_2) / 2.0;
    let f = |z: f64| density(z) * (below(z) - below(z - q)).powi(k as i32 - 1);
    let (low, high, steps) = (-8.5_f64, 8.5 + q.min(40.0), 2000);
    let h = (high - low) / f64::from(steps);
    let inner: f64 = (1..steps).map(|i| f(low + h * f64::from(i)) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
    (k as f64 * (f(low) + inner + f(high)) * h / 3.0).clamp(0.0, 1.0)
}

/// The value below which that range is with probability `p`.
fn range_quantile(p: f64, k: usize) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if range_below(middle, k) < p { low = middle } else { high = middle }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(rows: &[&[f64]]) -> Vec<Vec<f64>> {
        rows.iter().map(|r| r.to_vec()).collect()
    }

    fn near(a: f64, b: f64, by: f64) {
        assert!((a - b).abs() <= by, "{a} is not {b}");
    }

    #[test]
    fn friedman_by_hand() {
        // Rank sums 5, 8, 11: 12 / (4 * 3 * 4) * (25 + 64 + 121) - 3 * 4 * 4 = 4.5; with two degrees of freedom
        // p = exp(-2.25); W = 4.5 / (4 * 2).
        let f = friedman(&rows(&[&[1., 2., 3.], &[1., 3., 2.], &[1., 2., 3.], &[2., 1., 3.]])).unwrap();
        near(f.chi2, 4.5, 1e-12);
        near(f.p, (-2.25_f64).exp(), 1e-12);
        near(f.w, 0.5625, 1e-12);
        assert_eq!(f.mean_ranks, [1.25, 2.0, 2.75]);
    }

    #[test]
    fn kendalls_w_of_a_textbook() {
        // S. Siegel, "Nonparametric statistics", 1956: three executives rank six applicants; s = 25.5,
        // W = 12 * 25.5 / (9 * (216 - 6)) = 0.1619.
        let f = friedman(&rows(&[&[1., 6., 3., 2., 5., 4.], &[1., 5., 6., 4., 2., 3.], &[6., 3., 2., 5., 4., 1.]]))
            .unwrap();
        near(f.w, 12.0 * 25.5 / (9.0 * 210.0), 1e-12);
        near(f.w, 0.16, 0.005);
    }

    #[test]
    fn ties_share_ranks_and_are_corrected_for() {
        assert_eq!(average_ranks(&[3.0, 1.0, 3.0, 2.0]), [3.5, 1.0, 3.5, 2.0]);
        // By hand: ranks (1.5, 1.5, 3), (1, 2, 3): sums 2.5, 3.5, 6; between = 2.25 + 0.25 + 4 = 6.5;
        // within = 2.25 + 2.25 + 9 + 14 - 24 = 3.5; chi2 = 2 * 6.5 / 3.5.
        let f = friedman(&rows(&[&[5., 5., 9.], &[1., 2., 3.]])).unwrap();
        near(f.chi2, 13.0 / 3.5, 1e-12);
        assert!(friedman(&rows(&[&[1., 1.], &[2., 2.]])).is_none());
        assert!(friedman(&rows(&[&[1., 2.]])).is_none());
    }

    #[test]
    fn nemenyi_as_printed() {
        // J. Demsar 2006, table 5(a), two-tailed Nemenyi: q / sqrt(2) for 2 to 10 columns.
        let five = [1.960, 2.343, 2.569, 2.728, 2.850, 2.949, 3.031, 3.102, 3.164];
        let ten = [1.645, 2.052, 2.291, 2.459, 2.589, 2.693, 2.780, 2.855, 2.920];
        for (i, (a, b)) in five.iter().zip(ten).enumerate() {
            near(range_quantile(0.95, i + 2) / SQRT_2, *a, 0.0011);
            near(range_quantile(0.90, i + 2) / SQRT_2, b, 0.0011);
        }
        // The same paper's example: four classifiers, fourteen data sets, CD = 1.25 and 1.12.
        near(nemenyi_critical(4, 14, 0.05), 1.25, 0.005);
        near(nemenyi_critical(4, 14, 0.10), 1.12, 0.005);
        near(nemenyi_p(nemenyi_critical(6, 16, 0.05), 6, 16), 0.05, 1e-6);
    }

    #[test]
    fn distributions_as_printed() {
        for (x, degrees, p) in [(3.841, 1.0, 0.05), (11.070, 5.0, 0.05), (15.086, 5.0, 0.01), (43.773, 30.0, 0.05)] {
            near(chi2_above(x, degrees), p, 2e-5);
        }
        // Two heads of ten: 2 * (1 + 10 + 45) / 1024.
        near(sign_test(2, 8), 112.0 / 1024.0, 1e-9);
        near(sign_test(5, 5), 1.0, 1e-12);
        near(kendall_tau(&[1, 2, 3, 4], &[1, 3, 2, 4]), 4.0 / 6.0, 1e-12);
        near(kendall_tau(&[1, 2, 3], &[3, 2, 1]), -1.0, 1e-12);
    }
}
