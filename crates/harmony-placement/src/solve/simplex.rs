//! Minimisation without derivatives, for a handful of numbers and a bounded number of renders.
//!
//! A drawn silhouette changes by whole pixels, so that its energy has no useful derivative. Nelder and Mead (1965) with
//! the adaptive coefficients of Gao and Han (2012); first steps are the caller's, in the units of each number. Local:
//! it ends in the valley in which it starts, and in more than about ten dimensions it hardly moves.

/// The minimum found.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Minimum {
    /// Where.
    pub(crate) at: Vec<f64>,
    /// How low.
    pub(crate) value: f64,
    /// Evaluations spent.
    pub(crate) evaluations: usize,
}

/// Nelder and Mead (1965) downhill simplex with the adaptive coefficients of Gao and Han (2012).
///
/// Starts at `start` with the given first steps and stops after `budget` evaluations, or when the simplex is
/// smaller than `precision` of the first steps. NaN counts as infinitely high.
pub(crate) fn nelder_mead(
    start: &[f64],
    steps: &[f64],
    budget: usize,
    precision: f64,
    mut cost: impl FnMut(&[f64]) -> f64,
) -> Minimum {
    let n = start.len();
    let mut evaluations = 0;
    let mut evaluate = |x: &[f64]| {
        evaluations += 1;
        let c = cost(x);
        if c.is_nan() { f64::INFINITY } else { c }
    };
    let mut simplex: Vec<(f64, Vec<f64>)> = Vec::with_capacity(n + 1);
    simplex.push((evaluate(start), start.to_vec()));
    for i in 0..n {
        let mut x = start.to_vec();
        x[i] += steps[i];
        let there = evaluate(&x);
        simplex.push((there, x));
    }
    let d = n as f64;
    let (expand, contract, shrink) = (1.0 + 2.0 / d, 0.75 - 0.5 / d, 1.0 - 1.0 / d);
    let (contract, shrink) = (contract.max(0.3), shrink.max(0.4));
    let mut used = n + 1;
    while n > 0 && used < budget {
        simplex.sort_by(|a, b| a.0.total_cmp(&b.0));
        let small = (0..n).all(|i| {
            let (low, high) = simplex.iter().fold((f64::MAX, f64::MIN), |(l, h), (_, x)| (l.min(x[i]), h.max(x[i])));
            high - low <= precision * steps[i].abs()
        });
        if small {
            break;
        }
        let mut centre = vec![0.0; n];
        for (_, x) in &simplex[..n] {
            for i in 0..n {
                centre[i] += x[i] / d;
            }
        }
        let worst = simplex[n].clone();
        let along = |k: f64| -> Vec<f64> { (0..n).map(|i| centre[i] + k * (centre[i] - worst.1[i])).collect() };
        let reflected = along(1.0);
        let r = evaluate(&reflected);
        used += 1;
        if r < simplex[0].0 {
            let far = along(expand);
            let e = evaluate(&far);
            used += 1;
            simplex[n] = if e < r { (e, far) } else { (r, reflected) };
        } else if r < simplex[n - 1].0 {
            simplex[n] = (r, reflected);
        } else {
            let near = if r < worst.0 { along(contract) } else { along(-contract) };
            let c = evaluate(&near);
            used += 1;
            if c < r.min(worst.0) {
                simplex[n] = (c, near);
            } else {
                let best = simplex[0].1.clone();
                for (value, x) in &mut simplex[1..] {
                    for i in 0..n {
                        x[i] = best[i] + shrink * (x[i] - best[i]);
                    }
                    *value = evaluate(x);
                    used += 1;
                }
            }
        }
    }
    simplex.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (value, at) = simplex.swap_remove(0);
    Minimum { at, value, evaluations }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_valley_is_followed_to_its_floor() {
        let rosenbrock = |x: &[f64]| (1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2);
        let m = nelder_mead(&[-1.2, 1.0], &[0.3, 0.3], 400, 1e-6, rosenbrock);
        assert!((m.at[0] - 1.0).abs() <= 1e-3 && (m.at[1] - 1.0).abs() <= 1e-3, "{m:?}");
        assert!(m.evaluations <= 410);
    }

    #[test]
    fn a_cost_that_is_nowhere_finite_ends_where_it_began() {
        let m = nelder_mead(&[0.5, 0.5], &[0.1, 0.1], 50, 1e-3, |_| f64::NAN);
        assert!(m.at.iter().all(|v| v.is_finite()));
    }
}
