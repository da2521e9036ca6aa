//! How surely camera and room are known after calibration.
//!
//! The joint refinement, and the pins where there is no map, leave the information matrix of their least squares (Gauss and
//! Newton's, at the solution). Placement takes it as the prior of its own joint solve (decision 0012), and the report tells from
//! it how likely the camera is right. It knows what the residuals know: a wrong hypothesis (a line of another thing taken
//! for an edge) is not in it.

use nalgebra::{DMatrix, DVector, Matrix3, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::joint::{LN_HEIGHT, TOLD_HEIGHT_SIGMA};
use crate::room_box::pins::{FLOOR_LOGIT, LN_BACK, LN_LEFT, ROLL, TILT, YAW};

/// What is called right of a camera, degrees: to these bounds calibration is held in tests on rooms with known truth.
pub const RIGHT_ROTATION_DEG: f64 = 1.0;
/// Metres.
pub const RIGHT_POSITION_M: f64 = 0.1;

/// How surely camera, room and the map's scale are known: the information matrix of the joint refinement over
/// `ln focal, yaw, tilt, roll, ln left, ln right, logit(floor / height), ln back, ln height, ln scale` (radians;
/// distances of the camera to the faces, metres), row by row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoomPosterior {
    /// 10 x 10 values.
    pub information: Vec<f64>,
    /// The unknowns at which it holds; the scale is that of the points as they are delivered, so that its logarithm
    /// is 0 until somebody scales them.
    pub mean: [f64; 10],
    /// The part of it that a model's guesses of lengths have (camera height, distance to the back wall, width, and of pins
    /// alone how far left the camera stands): each
    /// one's derivatives and how far it is off at `mean`, in units of its sigma.
    pub hints: Vec<([f64; 10], f64)>,
}

impl RoomPosterior {
    /// The same where the height that gave the map its metres is known to `sigma` (logarithm) and not exactly.
    #[must_use]
    pub fn with_height_known_to(mut self, sigma: f64) -> Self {
        let k = LN_HEIGHT * self.mean.len() + LN_HEIGHT;
        let told = TOLD_HEIGHT_SIGMA.powi(-2);
        // Where it was not told, a metric map or a sensor knows better.
        if self.information[k] >= told {
            self.information[k] += sigma.powi(-2) - told;
        }
        self
    }

    /// The same with the hints `factor` times less sure; unchanged where nothing would be left to hold the room.
    #[must_use]
    pub fn with_hints_inflated(&self, factor: f64) -> Self {
        const N: usize = 10;
        let less = 1.0 - factor.powi(-2);
        let mut information = DMatrix::from_column_slice(N, N, &self.information);
        let mut pull = DVector::zeros(N);
        for (slopes, off) in &self.hints {
            let g = DVector::from_column_slice(slopes);
            information -= &g * g.transpose() * less;
            pull += g * (*off * less);
        }
        let mut mean = self.mean;
        let Some(moved) = information.clone().cholesky().map(|c| c.solve(&pull)) else { return self.clone() };
        for (m, by) in mean.iter_mut().zip(moved.iter()) {
            *m += by;
        }
        Self { information: information.iter().copied().collect(), mean, hints: self.hints.clone() }
    }

    /// The probability that the camera is right: its rotation within [`RIGHT_ROTATION_DEG`] and its position in the room within
    /// [`RIGHT_POSITION_M`], if the posterior is what it says and the height of the room is as it was told (its own error
    /// scales the whole room; see [`Self::with_height_known_to`]).
    ///
    /// Angles count as small. Of rotation and position the product is taken: for errors that are Gaussian about the mean both
    /// together are at least as likely as that (T. Royen, "A simple proof of the Gaussian correlation conjecture", 2014).
    /// 0 where the information is singular: something of the room is not known at all.
    pub fn camera_confidence(&self) -> f64 {
        const N: usize = 10;
        let Some(covariance) = DMatrix::from_column_slice(N, N, &self.information).cholesky().map(|c| c.inverse())
        else {
            return 0.0;
        };
        let of =
            |slopes: DMatrix<f64>| Matrix3::from_iterator((&slopes * &covariance * slopes.transpose()).iter().copied());
        let mut angles = DMatrix::zeros(3, N);
        for (row, unknown) in [YAW, TILT, ROLL].into_iter().enumerate() {
            angles[(row, unknown)] = 1.0;
        }
        let (height, share) = (self.mean[LN_HEIGHT].exp(), 1.0 / (1.0 + (-self.mean[FLOOR_LOGIT]).exp()));
        let mut place = DMatrix::zeros(3, N);
        place[(0, LN_LEFT)] = self.mean[LN_LEFT].exp();
        place[(1, LN_HEIGHT)] = height * share;
        place[(1, FLOOR_LOGIT)] = height * share * (1.0 - share);
        place[(2, LN_BACK)] = self.mean[LN_BACK].exp();
        within(&of(angles), RIGHT_ROTATION_DEG.to_radians()) * within(&of(place), RIGHT_POSITION_M)
    }
}

/// Steps of the sum over each of two axes: of the probability the third digit is right.
const STEPS: u32 = 48;

/// The probability that a Gaussian vector of this covariance is shorter than `radius`.
///
/// In its principal axes: a sum over the two with the largest sigmas, in closed form along the third.
fn within(covariance: &Matrix3<f64>, radius: f64) -> f64 {
    let mut sigmas: Vec<f64> =
        SymmetricEigen::new(*covariance).eigenvalues.iter().map(|v| v.max(0.0).sqrt().max(1e-6 * radius)).collect();
    sigmas.sort_by(f64::total_cmp);
    let [thin, middle, wide] = [sigmas[0], sigmas[1], sigmas[2]];
    // Beyond six sigmas there is nothing to sum.
    let cells = |sigma: f64, reach: f64| {
        let reach = reach.min(6.0 * sigma);
        let step = 2.0 * reach / f64::from(STEPS);
        (0..STEPS).map(move |k| {
            let at = (f64::from(k) + 0.5) * step - reach;
            let density = (-0.5 * (at / sigma).powi(2)).exp() / (sigma * std::f64::consts::TAU.sqrt());
            (at, density * step)
        })
    };
    let line = |half: f64| libm::erf(half / (thin * std::f64::consts::SQRT_2));
    let sum: f64 = cells(wide, radius)
        .map(|(x, p)| {
            let disc = (radius * radius - x * x).max(0.0);
            p * cells(middle, disc.sqrt()).map(|(y, q)| q * line((disc - y * y).max(0.0).sqrt())).sum::<f64>()
        })
        .sum();
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ln back: a map says 0 with a sigma of 0.1, a hint 0.3 with the same; everything else is known by itself.
    #[test]
    fn a_hint_whose_sigma_is_inflated_pulls_less() {
        let mut information = vec![0.0; 100];
        for i in 0..10 {
            information[i * 10 + i] = 100.0;
        }
        information[LN_BACK * 10 + LN_BACK] = 200.0;
        let (mut mean, mut slopes) = ([0.0; 10], [0.0; 10]);
        mean[LN_BACK] = 0.15;
        slopes[LN_BACK] = 10.0;
        let posterior = RoomPosterior { information, mean, hints: vec![(slopes, (0.15 - 0.3) / 0.1)] };
        assert_eq!(posterior.with_hints_inflated(1.0), posterior);
        // With a sigma of 0.2 the hint weighs a quarter of the map.
        let inflated = posterior.with_hints_inflated(2.0);
        assert!((inflated.mean[LN_BACK] - 0.06).abs() < 1e-12, "{:?}", inflated.mean);
        assert!((inflated.information[LN_BACK * 10 + LN_BACK] - 125.0).abs() < 1e-9);
        assert_eq!(inflated.mean[..LN_BACK], posterior.mean[..LN_BACK]);
        assert!(posterior.with_hints_inflated(3.0).mean[LN_BACK] < inflated.mean[LN_BACK]);
    }

    #[test]
    fn a_ball_holds_what_is_known_of_it_in_closed_form() {
        let of = |sigmas: [f64; 3], radius: f64| {
            within(&Matrix3::from_diagonal(&nalgebra::Vector3::from_column_slice(&sigmas.map(|s| s * s))), radius)
        };
        // Maxwell's distribution; a disc; a line.
        let k = 1.5_f64;
        let ball =
            libm::erf(k / std::f64::consts::SQRT_2) - (2.0 / std::f64::consts::PI).sqrt() * k * (-0.5 * k * k).exp();
        assert!((of([0.2; 3], 0.2 * k) - ball).abs() < 3e-3, "{} {ball}", of([0.2; 3], 0.2 * k));
        let disc = 1.0 - (-0.5 * k * k).exp();
        assert!((of([1.0, 0.0, 1.0], k) - disc).abs() < 3e-3, "{} {disc}", of([1.0, 0.0, 1.0], k));
        let line = libm::erf(k / std::f64::consts::SQRT_2);
        assert!((of([0.0, 1.0, 0.0], k) - line).abs() < 3e-3, "{} {line}", of([0.0, 1.0, 0.0], k));
        assert!(of([0.01; 3], 1.0) > 0.999 && of([100.0; 3], 1.0) < 1e-4);
    }

    #[test]
    fn a_camera_is_as_sure_as_the_least_sure_of_its_angles_and_distances() {
        let with = |unknown: Option<usize>, sigma: f64| {
            let mut information = vec![0.0; 100];
            for i in 0..10 {
                let own = if Some(i) == unknown { sigma } else { 0.002 };
                information[i * 10 + i] = 1.0 / (own * own);
            }
            let mean = [0.0, 0.0, 0.0, 0.0, 0.7, 0.7, 0.2, 1.0, 1.0, 0.0];
            RoomPosterior { information, mean, hints: Vec::new() }.camera_confidence()
        };
        assert!(with(None, 0.0) > 0.99);
        // Two degrees of turn, a fifth of the distance to the left or to the back.
        for (unknown, sigma) in [(YAW, 0.035), (LN_LEFT, 0.2), (LN_BACK, 0.2)] {
            let sure = with(Some(unknown), sigma);
            assert!((0.05..0.5).contains(&sure), "{unknown}: {sure}");
        }
        let singular = RoomPosterior { information: vec![0.0; 100], mean: [0.0; 10], hints: Vec::new() };
        assert_eq!(singular.camera_confidence(), 0.0);
    }
}
