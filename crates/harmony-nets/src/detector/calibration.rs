//! From logits to probabilities.

/// Platt's scaling: `p = sigmoid(slope * logit + offset)`.
///
/// The identity (slope 1, offset 0) is the network's own score. [`Calibration::fit`] finds a better one from logits
/// of boxes that are known to be right or wrong; there is none for real weights yet (`docs/decisions/0014-detector.md`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Factor on the logit, positive.
    pub slope: f64,
    /// Added after that.
    pub offset: f64,
}

impl Default for Calibration {
    fn default() -> Self {
        Self { slope: 1.0, offset: 0.0 }
    }
}

impl Calibration {
    /// Probability that a box with this logit is right.
    pub fn probability(&self, logit: f64) -> f64 {
        sigmoid(self.slope * logit + self.offset)
    }

    /// Most likely scaling for logits of right (`true`) and wrong boxes, by Newton's method with the targets of
    /// Platt (1999), which keep it finite when the two are apart. `None` without both kinds, or when larger logits do
    /// not speak for right boxes.
    pub fn fit(samples: &[(f64, bool)]) -> Option<Self> {
        let right = samples.iter().filter(|s| s.1).count() as f64;
        let wrong = samples.len() as f64 - right;
        if right == 0.0 || wrong == 0.0 || samples.iter().any(|s| !s.0.is_finite()) {
            return None;
        }
        let target = |hit: bool| if hit { (right + 1.0) / (right + 2.0) } else { 1.0 / (wrong + 2.0) };
        let loss = |c: Self| -> f64 {
            // Cross-entropy, in a form that does not overflow.
            let one = |(x, hit): &(f64, bool)| {
                let z = c.slope * x + c.offset;
                z.max(0.0) - z * target(*hit) + (-z.abs()).exp().ln_1p()
            };
            samples.iter().map(one).sum()
        };
        let mut at = Self { slope: 0.0, offset: ((right + 1.0) / (wrong + 1.0)).ln() };
        for _ in 0..100 {
            let (mut g0, mut g1, mut h00, mut h01, mut h11) = (0.0, 0.0, 1e-12, 0.0, 1e-12);
            for (x, hit) in samples {
                let p = at.probability(*x);
                let (error, weight) = (p - target(*hit), p * (1.0 - p));
                g0 += error * x;
                g1 += error;
                h00 += weight * x * x;
                h01 += weight * x;
                h11 += weight;
            }
            let determinant = h00 * h11 - h01 * h01;
            let step = [(h11 * g0 - h01 * g1) / determinant, (h00 * g1 - h01 * g0) / determinant];
            // Half steps until it gets better.
            let tried = (0..30)
                .map(|k| 0.5f64.powi(k))
                .map(|k| Self { slope: at.slope - k * step[0], offset: at.offset - k * step[1] });
            let before = loss(at);
            let Some(better) = tried.into_iter().find(|c| loss(*c) < before) else { break };
            at = better;
            if before - loss(at) < 1e-12 * before.abs() {
                break;
            }
        }
        (at.slope > 0.0 && at.offset.is_finite()).then_some(at)
    }
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_finds_the_scaling_that_made_the_samples() {
        // Logits on a grid, right exactly as often as the scaling says: 1000 samples each.
        let made = Calibration { slope: 0.7, offset: 1.3 };
        let mut samples = Vec::new();
        for i in -20..=20 {
            let logit = f64::from(i) * 0.25;
            let hits = (made.probability(logit) * 1000.0).round() as usize;
            samples.extend((0..1000).map(|k| (logit, k < hits)));
        }
        let found = Calibration::fit(&samples).expect("both kinds");
        assert!((found.slope - made.slope).abs() <= 5e-3, "{found:?}");
        assert!((found.offset - made.offset).abs() <= 5e-3, "{found:?}");
    }

    #[test]
    fn a_fit_needs_both_kinds_and_the_right_direction() {
        assert_eq!(Calibration::fit(&[(1.0, true), (2.0, true)]), None);
        assert_eq!(Calibration::fit(&[(1.0, true), (2.0, false), (0.5, true), (3.0, false)]), None);
        assert_eq!(Calibration::fit(&[(f64::NAN, true), (0.0, false)]), None);
        // Fully apart: finite, and on the right sides.
        let apart = Calibration::fit(&[(-2.0, false), (-1.0, false), (1.0, true), (2.0, true)]).expect("a fit");
        assert!(apart.slope.is_finite() && apart.probability(-1.0) < 0.5 && apart.probability(1.0) > 0.5);
    }
}
