//! What speaks for a pose.

use harmony_scene::Confidence;
use serde::{Deserialize, Serialize};

/// Measured agreement of a placed object with the photo and with its neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Evidence {
    /// IoU of mask and rendered silhouette, where both could be visible.
    pub silhouette_iou: Option<f64>,
    /// Median absolute depth difference to the point map over mask and silhouette, metres.
    pub depth_residual_m: Option<f64>,
    /// Gap to the support (floor, host, wall, ceiling), metres; negative when it sinks in.
    pub contact_gap_m: f64,
    /// Deepest penetration with another object or a wall, metres.
    pub penetration_m: f64,
    /// `ln(size / prior size)` of the uniform scale.
    pub size_log_ratio: f64,
}

impl Evidence {
    /// The confidence that follows.
    pub fn confidence(&self, detection: Option<f64>) -> Confidence {
        Confidence {
            overall: self.silhouette_iou.unwrap_or(0.3),
            detection,
            silhouette_iou: self.silhouette_iou,
            depth_residual_m: self.depth_residual_m,
        }
    }
}

/// Evidence of a freshly solved object; contact and penetration come from the collision check.
pub(crate) fn of_solution(solution: &crate::solve::Solution) -> Evidence {
    Evidence {
        silhouette_iou: Some(solution.seen.strict_iou),
        depth_residual_m: solution.seen.depth_residual,
        contact_gap_m: 0.0,
        penetration_m: 0.0,
        size_log_ratio: crate::cost::size_log_ratio(solution.frame.item, &solution.pose),
    }
}
