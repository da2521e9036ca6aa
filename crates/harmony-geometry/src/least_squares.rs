//! A small Levenberg-Marquardt solver (D. Marquardt, SIAM J. 1963; damping as in J. Moré, 1978, by the diagonal).
//!
//! For problems with a dozen unknowns and some hundred residuals: dense, numeric derivatives. Robust losses are put
//! into the residuals themselves ([`robust`]).

use nalgebra::{DMatrix, DVector};

/// Where the solver ended.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Where it ended.
    pub parameters: Vec<f64>,
    /// Half the sum of squared residuals.
    pub cost: f64,
    /// Steps taken.
    pub iterations: usize,
    /// One sigma of each parameter, when the residuals are in units of theirs; infinite where nothing holds it.
    pub sigmas: Vec<f64>,
    /// The information matrix (approximate Hessian of the cost) at the end, row by row.
    pub information: Vec<f64>,
}

/// Minimises half the sum of squares of what `residuals` pushes; `steps` are the derivative steps by parameter.
///
/// The number of residuals must not change. Residuals that aren't finite make a trial point unacceptable.
pub fn minimise(
    start: &[f64],
    steps: &[f64],
    max_iterations: usize,
    residuals: impl Fn(&[f64], &mut Vec<f64>),
) -> Solution {
    minimise_with(start, max_iterations, &residuals, |p, rows| differences(p, steps, rows, &residuals))
}

/// [`minimise`] for those who know the derivatives: `jacobian` gets the parameters and the number of residuals, and
/// returns as many rows and a column for each parameter.
pub fn minimise_with(
    start: &[f64],
    max_iterations: usize,
    residuals: impl Fn(&[f64], &mut Vec<f64>),
    jacobian: impl Fn(&[f64], usize) -> DMatrix<f64>,
) -> Solution {
    let n = start.len();
    let evaluate = |p: &[f64]| {
        let mut r = Vec::new();
        residuals(p, &mut r);
        let cost = 0.5 * r.iter().map(|v| v * v).sum::<f64>();
        (DVector::from_vec(r), cost)
    };
    let mut p = start.to_vec();
    let (mut r, mut cost) = evaluate(&p);
    let mut lambda = 1e-3;
    let mut iterations = 0;
    let mut normal = DMatrix::<f64>::zeros(n, n);
    while iterations < max_iterations && cost.is_finite() {
        iterations += 1;
        let jacobian = jacobian(&p, r.len());
        normal = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&r);
        let mut improved = false;
        for _ in 0..12 {
            let mut damped = normal.clone();
            for i in 0..n {
                damped[(i, i)] += lambda * normal[(i, i)].max(1e-9);
            }
            let step = damped.cholesky().map(|c| c.solve(&gradient));
            let trial: Option<Vec<f64>> = step.map(|s| p.iter().zip(s.iter()).map(|(a, b)| a - b).collect());
            if let Some(trial) = trial {
                let (trial_r, trial_cost) = evaluate(&trial);
                if trial_cost < cost {
                    let gain = (cost - trial_cost) / cost.max(f64::MIN_POSITIVE);
                    (p, r, cost) = (trial, trial_r, trial_cost);
                    lambda = (lambda * 0.3).max(1e-12);
                    improved = gain > 1e-9;
                    break;
                }
            }
            lambda *= 4.0;
        }
        if !improved {
            break;
        }
    }
    let inverse = normal.clone().cholesky().map(|c| c.inverse());
    let sigmas = (0..n).map(|i| inverse.as_ref().map_or(f64::INFINITY, |m| m[(i, i)].max(0.0).sqrt())).collect();
    let information = normal.iter().copied().collect();
    Solution { parameters: p, cost, iterations, sigmas, information }
}

/// Derivatives of what `residuals` pushes, by central differences; 0 where those are not finite.
pub fn differences(p: &[f64], steps: &[f64], rows: usize, residuals: impl Fn(&[f64], &mut Vec<f64>)) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(rows, p.len());
    let mut moved = p.to_vec();
    let (mut plus, mut minus) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
    for i in 0..p.len() {
        plus.clear();
        minus.clear();
        moved[i] = p[i] + steps[i];
        residuals(&moved, &mut plus);
        moved[i] = p[i] - steps[i];
        residuals(&moved, &mut minus);
        moved[i] = p[i];
        if plus.len() == rows && minus.len() == rows {
            for (k, (plus, minus)) in plus.iter().zip(&minus).enumerate() {
                let slope = (plus - minus) / (2.0 * steps[i]);
                jacobian[(k, i)] = if slope.is_finite() { slope } else { 0.0 };
            }
        }
    }
    jacobian
}

/// Geman-McClure loss as a residual: `r` for small values, never more than `limit`.
pub fn robust(r: f64, limit: f64) -> f64 {
    let k = r / limit;
    r / (1.0 + k * k).sqrt()
}

/// Derivative of [`robust`] by `r`.
pub fn robust_slope(r: f64, limit: f64) -> f64 {
    let k = r / limit;
    (1.0 + k * k).powf(-1.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_fitted_in_spite_of_outliers() {
        // y = a exp(b x), a quarter of the values wrong.
        let data: Vec<(f64, f64)> = (0..40)
            .map(|i| {
                let x = f64::from(i) * 0.1;
                let y = 2.0 * (-0.7 * x).exp();
                (x, if i % 4 == 0 { y + 1.5 } else { y })
            })
            .collect();
        let solution = minimise(&[1.0, 0.0], &[1e-5, 1e-5], 100, |p, out| {
            out.extend(data.iter().map(|(x, y)| robust((p[0] * (p[1] * x).exp() - y) / 0.05, 2.0)));
        });
        assert!((solution.parameters[0] - 2.0).abs() <= 0.05, "{solution:?}");
        assert!((solution.parameters[1] + 0.7).abs() <= 0.05, "{solution:?}");
    }
}
