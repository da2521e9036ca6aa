//! Gaussian mixtures of colour.

use crate::color::{farthest_points, nearest};

/// Gaussian components (GrabCut uses 5).
const COMPONENTS: usize = 5;
/// Least variance along each axis, Lab units squared: keeps flat colours from becoming certain.
const MIN_VARIANCE: f32 = 4.0;
/// Most samples used for a fit.
const MAX_SAMPLES: usize = 6000;

#[derive(Debug, Clone)]
struct Gaussian {
    mean: [f32; 3],
    /// Inverse covariance: xx, yy, zz, xy, xz, yz.
    precision: [f32; 6],
    /// log(weight) - log sqrt((2 pi)^3 |covariance|).
    log_scale: f32,
}

/// A mixture of Gaussians over Lab.
#[derive(Debug, Clone)]
pub(super) struct Mixture {
    components: Vec<Gaussian>,
}

impl Mixture {
    /// Fits a mixture to colours by k-means, or `None` when there are none.
    pub(super) fn fit(colors: &[[f32; 3]]) -> Option<Self> {
        let step = colors.len().div_ceil(MAX_SAMPLES).max(1);
        let samples: Vec<[f32; 3]> = colors.iter().copied().step_by(step).collect();
        let mut centres = farthest_points(&samples, COMPONENTS);
        if centres.is_empty() {
            return None;
        }
        let mut belongs = vec![0_usize; samples.len()];
        for _ in 0..8 {
            let mut sums = vec![([0.0_f64; 3], 0.0_f64); centres.len()];
            for (sample, k) in samples.iter().zip(&mut belongs) {
                *k = nearest(&centres, *sample);
                for (s, c) in sums[*k].0.iter_mut().zip(sample) {
                    *s += f64::from(*c);
                }
                sums[*k].1 += 1.0;
            }
            for (centre, (sum, n)) in centres.iter_mut().zip(&sums) {
                if *n > 0.0 {
                    *centre = sum.map(|s| (s / n) as f32);
                }
            }
        }
        let mut components = Vec::new();
        for (k, centre) in centres.iter().enumerate() {
            let members: Vec<&[f32; 3]> =
                samples.iter().zip(&belongs).filter(|(_, b)| **b == k).map(|(s, _)| s).collect();
            if members.len() * 200 < samples.len() && components.len() + 1 < centres.len() && k > 0 {
                continue; // a few outliers are no component
            }
            if let Some(gaussian) = gaussian(*centre, &members, samples.len()) {
                components.push(gaussian);
            }
        }
        (!components.is_empty()).then_some(Self { components })
    }

    /// Log density of a colour.
    pub(super) fn log_density(&self, color: [f32; 3]) -> f32 {
        let mut terms = [f32::NEG_INFINITY; COMPONENTS];
        let mut most = f32::NEG_INFINITY;
        for (term, g) in terms.iter_mut().zip(&self.components) {
            let [x, y, z] = [color[0] - g.mean[0], color[1] - g.mean[1], color[2] - g.mean[2]];
            let [xx, yy, zz, xy, xz, yz] = g.precision;
            let q = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z);
            *term = g.log_scale - 0.5 * q;
            most = most.max(*term);
        }
        // The largest term is within log(5) of the sum; the few decimals do not matter here.
        let mut sum = 0.0;
        for term in terms {
            if term > most - 8.0 {
                sum += (term - most).exp();
            }
        }
        most + sum.ln()
    }
}

fn gaussian(mean: [f32; 3], members: &[&[f32; 3]], total: usize) -> Option<Gaussian> {
    if members.is_empty() {
        return None;
    }
    let mut c = [0.0_f64; 6];
    for m in members {
        let [x, y, z] = [m[0] - mean[0], m[1] - mean[1], m[2] - mean[2]].map(f64::from);
        for (sum, v) in c.iter_mut().zip([x * x, y * y, z * z, x * y, x * z, y * z]) {
            *sum += v;
        }
    }
    let n = members.len() as f64;
    let [xx, yy, zz, xy, xz, yz] = c.map(|v| v / n);
    let (xx, yy, zz) = (xx + f64::from(MIN_VARIANCE), yy + f64::from(MIN_VARIANCE), zz + f64::from(MIN_VARIANCE));
    let determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    if determinant <= 0.0 {
        return None;
    }
    let precision = [
        yy * zz - yz * yz,
        xx * zz - xz * xz,
        xx * yy - xy * xy,
        xz * yz - xy * zz,
        xy * yz - xz * yy,
        xy * xz - xx * yz,
    ]
    .map(|v| (v / determinant) as f32);
    let log_scale = (n / total as f64).ln() - 0.5 * (determinant.ln() + 3.0 * std::f64::consts::TAU.ln());
    Some(Gaussian { mean, precision, log_scale: log_scale as f32 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn density_of_a_single_gaussian_is_the_formula() {
        // Points at +-a on each axis about a mean: variance a*a/3 on each axis, plus the floor.
        let mut colors = Vec::new();
        for axis in 0..3 {
            for sign in [-3.0_f32, 3.0] {
                let mut c = [50.0, 10.0, -5.0];
                c[axis] += sign;
                colors.push(c);
            }
        }
        let all: Vec<&[f32; 3]> = colors.iter().collect();
        let g = gaussian([50.0, 10.0, -5.0], &all, all.len()).unwrap();
        let mixture = Mixture { components: vec![g] };
        let variance = 9.0 / 3.0 + MIN_VARIANCE;
        let at_mean = -1.5 * (std::f32::consts::TAU * variance).ln();
        assert!((mixture.log_density([50.0, 10.0, -5.0]) - at_mean).abs() < 1e-4);
        assert!((mixture.log_density([52.0, 10.0, -5.0]) - (at_mean - 4.0 / (2.0 * variance))).abs() < 1e-4);
    }

    #[test]
    fn two_colours_are_told_from_a_third() {
        let colors: Vec<[f32; 3]> = (0..400)
            .map(|i| if i % 2 == 0 { [30.0 + (i % 7) as f32 * 0.3, 20.0, 0.0] } else { [80.0, -10.0, (i % 5) as f32] })
            .collect();
        let m = Mixture::fit(&colors).unwrap();
        assert!(m.log_density([31.0, 20.0, 0.0]) > m.log_density([55.0, 5.0, 1.0]) + 5.0);
        assert!(m.log_density([80.0, -10.0, 2.0]) > m.log_density([55.0, 5.0, 1.0]) + 5.0);
        assert!(Mixture::fit(&[]).is_none());
        assert!(Mixture::fit(&[[50.0, 0.0, 0.0]; 9]).is_some());
    }
}
