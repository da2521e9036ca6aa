//! Robust losses: what a residual of `r` sigmas costs, nats.
//!
//! Near 0 both are half the square, the negative logarithm of a Gaussian, so that terms of different kinds add up.
//! Huber's goes on linearly (a wrong value still pulls), Geman and McClure's saturates (what is another thing pulls no
//! more). For least squares each gives the residual of which half the square is the loss. They weigh single residuals:
//! outliers that agree with one another are not outliers to them.

/// A loss that grows more slowly than the square far from 0, so that one wrong answer does not outvote the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kernel {
    /// Quadratic up to so many sigmas, linear from there on (Huber, 1964): a wrong value still pulls.
    Huber(f64),
    /// Saturates at half the square of so many sigmas (Geman and McClure, 1985): what is another thing pulls no more.
    GemanMcClure(f64),
}

impl Kernel {
    /// The loss.
    pub(crate) fn loss(self, r: f64) -> f64 {
        match self {
            Self::Huber(k) if r.abs() <= k => 0.5 * r * r,
            Self::Huber(k) => k * (r.abs() - 0.5 * k),
            Self::GemanMcClure(c) => 0.5 * r * r / (1.0 + (r / c).powi(2)),
        }
    }

    /// The residual of which half the square is the loss, for least squares.
    pub(crate) fn residual(self, r: f64) -> f64 {
        (2.0 * self.loss(r)).sqrt().copysign(r)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn near_zero_all_are_the_square_and_none_falls_outwards(r in -50.0_f64..50.0, by in 0.0_f64..5.0, limit in 0.5_f64..6.0) {
            for kernel in [Kernel::Huber(limit), Kernel::GemanMcClure(limit)] {
                let small = r / 5000.0;
                prop_assert!((kernel.loss(small) - 0.5 * small * small).abs() <= 1e-3 * small * small);
                prop_assert!(kernel.loss(r.abs() + by) >= kernel.loss(r.abs()) - 1e-12);
                prop_assert!((0.5 * kernel.residual(r).powi(2) - kernel.loss(r)).abs() <= 1e-9 * (1.0 + kernel.loss(r)));
                prop_assert!(kernel.residual(r) * r >= 0.0);
            }
            prop_assert!(Kernel::GemanMcClure(limit).loss(r) <= 0.5 * limit * limit);
        }

        #[test]
        fn the_slope_is_bounded_by_the_kernels_scale(r in -50.0_f64..50.0, limit in 0.5_f64..6.0) {
            for kernel in [Kernel::Huber(limit), Kernel::GemanMcClure(limit)] {
                let slope = (kernel.loss(r + 1e-5) - kernel.loss(r - 1e-5)) / 2e-5;
                prop_assert!(slope.abs() <= limit + 1e-6, "{kernel:?} {slope}");
            }
        }
    }
}
