//! Distances from a prediction to the truth and back, and the numbers made of them.

use glam::DVec3;
use serde::Serialize;

use super::nearest::{NearestError, NearestIndex};

/// Kept out of a division by zero when precision and recall are both 0, percent (Gen3DSR's evaluation script).
pub const F1_EPSILON_PERCENT: f64 = 1e-6;
/// The same for shares in 0..1 (MIDI-3D's evaluation).
pub const F1_EPSILON_SHARE: f64 = 1e-8;

/// Nearest-neighbour distances between two point sets, in the points' unit.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoWay {
    /// From each predicted point to the nearest true one.
    pub from_prediction: Vec<f64>,
    /// From each true point to the nearest predicted one.
    pub from_truth: Vec<f64>,
}

/// Precision, recall and their harmonic mean at one threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ThresholdScore {
    /// Distances strictly below it count, in the points' unit.
    pub threshold: f64,
    /// Share of the predicted points that are near the truth.
    pub precision: f64,
    /// Share of the true points that are near the prediction.
    pub recall: f64,
    /// 2 P R / (P + R + a small number).
    pub f1: f64,
}

/// Measures both ways.
///
/// # Errors
/// [`NearestError`] when a set is empty or has points that are not finite.
pub fn two_way(prediction: &[DVec3], truth: &[DVec3]) -> Result<TwoWay, NearestError> {
    let to_truth = NearestIndex::build(truth)?;
    let to_prediction = NearestIndex::build(prediction)?;
    Ok(TwoWay { from_prediction: to_truth.distances(prediction)?, from_truth: to_prediction.distances(truth)? })
}

impl TwoWay {
    /// Half the sum of both mean distances; not squared, in the points' unit.
    pub fn chamfer(&self) -> f64 {
        f64::midpoint(mean(&self.from_prediction), mean(&self.from_truth))
    }

    /// The sum of both mean squared distances, in the square of the points' unit.
    pub fn chamfer_squared(&self) -> f64 {
        let squared = |values: &[f64]| values.iter().map(|d| d * d).sum::<f64>() / values.len() as f64;
        squared(&self.from_prediction) + squared(&self.from_truth)
    }

    /// Precision, recall and F1 in percent ([`F1_EPSILON_PERCENT`]).
    pub fn percent_at(&self, threshold: f64) -> ThresholdScore {
        self.score(threshold, 100.0, F1_EPSILON_PERCENT)
    }

    /// Precision, recall and F1 as shares, 0..1 ([`F1_EPSILON_SHARE`]).
    pub fn share_at(&self, threshold: f64) -> ThresholdScore {
        self.score(threshold, 1.0, F1_EPSILON_SHARE)
    }

    fn score(&self, threshold: f64, whole: f64, epsilon: f64) -> ThresholdScore {
        let share =
            |values: &[f64]| whole * (values.iter().filter(|d| **d < threshold).count() as f64 / values.len() as f64);
        let (precision, recall) = (share(&self.from_prediction), share(&self.from_truth));
        ThresholdScore { threshold, precision, recall, f1: 2.0 * precision * recall / (precision + recall + epsilon) }
    }
}

/// Arithmetic mean; NaN of nothing.
pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(offset: DVec3) -> Vec<DVec3> {
        (0..10_000).map(|i| DVec3::new((i % 100) as f64, (i / 100) as f64, 0.0) * 0.01 + offset).collect()
    }

    #[test]
    fn parallel_grids_are_as_far_apart_as_they_are() {
        let apart = two_way(&grid(DVec3::Z * 0.03), &grid(DVec3::ZERO)).unwrap();
        assert!((apart.chamfer() - 0.03).abs() <= 1e-12);
        assert!((apart.chamfer_squared() - 2.0 * 0.03 * 0.03).abs() <= 1e-12);
        let near = apart.percent_at(0.0301);
        assert_eq!((near.precision, near.recall), (100.0, 100.0));
        assert!((near.f1 - 20_000.0 / (200.0 + 1e-6)).abs() <= 1e-12);
        let far = apart.percent_at(0.0299);
        assert_eq!((far.precision, far.recall, far.f1), (0.0, 0.0, 0.0));
    }

    #[test]
    fn a_grid_shifted_within_its_plane_has_known_distances() {
        // By 2 mm along x: 99 of 100 columns are 2 mm from their own, the last one too, for it has none beyond.
        let shifted = two_way(&grid(DVec3::X * 0.002), &grid(DVec3::ZERO)).unwrap();
        assert!((shifted.chamfer() - 0.002).abs() <= 1e-12);
        // By 1.004 m: the nearest column is the last; distances run from 14 mm in steps of 10 mm.
        let beyond = two_way(&grid(DVec3::X * 1.004), &grid(DVec3::ZERO)).unwrap();
        let expected = (0..100).map(|i| 0.014 + 0.01 * f64::from(i)).sum::<f64>() / 100.0;
        assert!((beyond.chamfer() - expected).abs() <= 1e-12);
        let at = beyond.share_at(0.035);
        assert!((at.precision - 0.03).abs() <= 1e-15 && (at.recall - 0.03).abs() <= 1e-15);
    }

    #[test]
    fn concentric_spheres_are_apart_by_their_radii() {
        // The same directions on both (a Fibonacci sphere), so that the nearest point is straight outwards.
        let sphere = |radius: f64| -> Vec<DVec3> {
            (0..20_000)
                .map(|i| {
                    let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 20_000.0;
                    let (turn, ring) = (f64::from(i) * 2.399_963_229_728_653, (1.0 - z * z).sqrt());
                    DVec3::new(ring * turn.cos(), ring * turn.sin(), z) * radius
                })
                .collect()
        };
        let apart = two_way(&sphere(1.25), &sphere(1.0)).unwrap();
        assert!((apart.chamfer() - 0.25).abs() <= 1e-12, "{}", apart.chamfer());
        assert!((apart.chamfer_squared() - 0.125).abs() <= 1e-12);
    }

    #[test]
    fn one_sided_sets_tell_precision_from_recall() {
        let truth = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::X * 3.0];
        let scores = two_way(&truth[..1], &truth).unwrap().percent_at(0.5);
        assert_eq!((scores.precision, scores.recall), (100.0, 25.0));
        assert!((scores.f1 - 5000.0 / 125.000_001).abs() <= 1e-12);
        assert_eq!(two_way(&[], &truth).unwrap_err(), NearestError::Empty);
        assert_eq!(two_way(&truth, &[]).unwrap_err(), NearestError::Empty);
    }
}
