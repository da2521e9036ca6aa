//! What speaks for a pose, and how sure it is.
//!
//! The energy of a pose by term (nats), what was measured of it, and a confidence: the probability that place, turn and
//! size are right by the benchmark's definition. It is the Gaussian posterior of the joint solve, its sigmas widened by
//! the root of the misfit (Birge's ratio) where the object agrees less than the sigmas allow, times the probability of
//! the hypothesis. The three errors count as independent; a hypothesis that was never tried is not in it.

use harmony_scene::Confidence;
use serde::{Deserialize, Serialize};

/// Agreement with its mask (IoU) from which an object says something about others: about their set's size, about camera and room.
pub(crate) const TRUSTED_IOU: f64 = 0.6;

/// What is called right, by definition and as in the benchmark: metres, radians, and the logarithm of 12 %.
const RIGHT: (f64, f64, f64) = (0.15, 0.174_533, 0.113);

/// The energy of a pose by term, nats: `sum rho(r / sigma) - ln p(hypothesis)`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Energy {
    /// Where the outline ends, and the area between it and the mask's.
    pub silhouette: f64,
    /// The point map's depths.
    pub depth: f64,
    /// Named, usual and standard sizes, and those of the set.
    pub size: f64,
    /// The turn that relations and answers let expect.
    pub yaw: f64,
    /// Distance to a wall, to a host's back, to where lamps hang; room before a front.
    pub place: f64,
    /// Support by the host.
    pub support: f64,
    /// `-ln p` of what contradicts an answer.
    pub prior: f64,
}

impl Energy {
    /// All together.
    pub fn total(&self) -> f64 {
        self.observed() + self.size + self.yaw + self.place + self.support + self.prior
    }

    /// The total where the photo's sigmas are `misfit` times (in variance) what they were taken to be: beside an answer it says
    /// less by that factor. A misfit below 1 is luck.
    pub(crate) fn tempered(&self, misfit: f64) -> f64 {
        self.total() - self.observed() + self.observed() / misfit.max(1.0)
    }

    /// What the photo and its map say.
    pub fn observed(&self) -> f64 {
        self.silhouette + self.depth
    }
}

/// How uncertain a pose is, one sigma of each: from the posterior of camera, room, scale and all objects together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Position in the room, metres (root of the summed variances).
    pub position_m: f64,
    /// Turn, radians.
    pub yaw: f64,
    /// Size, relative.
    pub size: f64,
}

/// Measured agreement of a placed object with the photo and with its neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Evidence {
    /// IoU of mask and rendered silhouette in the partial scene, where both could be visible.
    pub silhouette_iou: Option<f64>,
    /// Median absolute depth difference to the point map over mask and silhouette, metres.
    pub depth_residual_m: Option<f64>,
    /// Gap to the support (floor, host, wall, ceiling), metres; negative when it sinks in.
    pub contact_gap_m: f64,
    /// Deepest penetration with another object beyond what is tolerated, metres.
    pub penetration_m: f64,
    /// `ln(size / prior size)` in the mean over the sides that were free.
    pub size_log_ratio: f64,
    /// Its score by term.
    pub energy: Energy,
    /// Observed energy over that of an object that agrees within the sigmas; 1: as expected.
    pub misfit: f64,
    /// Probability of the hypothesis of its turn and support among those that were tried.
    pub hypothesis: f64,
    /// How uncertain the pose is; `None` where there was no mask to measure by.
    pub spread: Option<Spread>,
}

impl Evidence {
    /// The probability that the pose is right (within 0.15 m, 10 degrees and 12 %), if the posterior is what it says:
    /// its sigmas grow with the root of the misfit (Birge's ratio), and a wrong hypothesis is wrong.
    pub fn confidence(&self, detection: Option<f64>) -> Confidence {
        let within = |limit: f64, sigma: f64| libm::erf(limit / (std::f64::consts::SQRT_2 * sigma.max(1e-6)));
        let birge = self.misfit.max(1.0).sqrt();
        let overall = self.spread.map_or(0.0, |s| {
            let (metres, angle, size) = RIGHT;
            self.hypothesis
                * within(metres, birge * s.position_m)
                * within(angle, birge * s.yaw)
                * within(size, birge * s.size)
        });
        Confidence { overall, detection, silhouette_iou: self.silhouette_iou, depth_residual_m: self.depth_residual_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidence_is_the_probability_of_being_right() {
        let spread = |position_m, yaw, size| Some(Spread { position_m, yaw, size });
        let sure = Evidence { spread: spread(0.02, 0.02, 0.01), misfit: 0.8, hypothesis: 1.0, ..Evidence::default() };
        let of = |e: Evidence| e.confidence(None).overall;
        assert!(of(sure) > 0.99);
        // One sigma on the limit: two in three.
        let position = of(Evidence { spread: spread(0.15, 0.0, 0.0), ..sure });
        assert!((position - 0.6827).abs() < 1e-3, "{position}");
        // A coin's toss between two turns halves it; twice the misfit widens the sigmas.
        assert!((of(Evidence { hypothesis: 0.5, ..sure }) - 0.5 * of(sure)).abs() < 1e-9);
        assert!(of(Evidence { spread: spread(0.15, 0.0, 0.0), misfit: 4.0, ..sure }) < 0.4);
        assert_eq!(of(Evidence { spread: None, ..sure }), 0.0, "nothing is known of what has no mask");
    }
}
