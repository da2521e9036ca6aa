//! How far off what is joined can be: every sigma and every probability, in one place.

/// Sigmas and probabilities of joining. Lengths in metres, angles in radians, relative ones as shares. Those of places,
/// walls, heights and scales are measured on 57 runs of 16 generated rooms (noise `real`), places half as wide again: what
/// two runs have wrong alike is not told apart here.
#[derive(Debug, Clone, PartialEq)]
pub struct JoinNoise {
    /// A place along the line of sight: share of the distance, and metres.
    pub along: [f64; 2],
    /// ... across it.
    pub across: [f64; 2],
    /// Factor on both where the image's edge cuts an object, and where half of it is hidden.
    pub cut: f64,
    /// See `cut`.
    pub hidden: f64,
    /// Factor on all of them, on walls and on scales where it is asked whether two runs show one room and which things are
    /// one: real photos' answers are rougher than those that the sigmas were measured on, and a thing that is refused is lost.
    pub pairing: f64,
    /// Sigmas from which a place counts as somebody else's (Geman and McClure's scale).
    pub limit: f64,
    /// Scale of a run, relative; whether its photo shows floor and ceiling makes no difference.
    pub scale: f64,
    /// What a run's walls are askew.
    pub askew: f64,
    /// Distance of a camera to a wall that its photo shows: share of it, and metres.
    pub wall: [f64; 2],
    /// ... to a wall that it does not show: metres.
    pub wall_unseen: f64,
    /// Height of a room, relative, beside the scale: where the ceiling is seen, and where it is not.
    pub height: [f64; 2],
    /// What is between a thing and the wall behind it, metres.
    pub wall_gap: f64,
    /// Turn of an object as one run has it.
    pub yaw: f64,
    /// Size of an object as one run has it, relative, beside the scale.
    pub size: f64,
    /// Spread of sizes within a kind, relative.
    pub size_kind: f64,
    /// Colour of one thing in two photos, Lab.
    pub color: f64,
    /// Colours of two things, Lab.
    pub color_kind: f64,
    /// Probability that two things of a room bear one kind's name by chance.
    pub same_kind: f64,
    /// Probability that a run misses what its photo shows.
    pub missed: f64,
    /// Probability that a run has something else at the place of what it shows.
    pub named_otherwise: f64,
    /// Spread of the heights of rooms, relative.
    pub rooms_height: f64,
    /// Odds against chance that one room must have before it is joined, nats.
    pub least_odds: f64,
    /// Odds that the best way to lay two runs together must have against the second best, nats.
    pub least_lead: f64,
}

impl Default for JoinNoise {
    fn default() -> Self {
        Self {
            along: [0.012, 0.018],
            across: [0.002, 0.009],
            cut: 3.0,
            hidden: 2.0,
            pairing: 1.8,
            limit: 5.0,
            scale: 0.022,
            askew: 0.005,
            wall: [0.005, 0.02],
            wall_unseen: 0.5,
            height: [0.006, 0.04],
            wall_gap: 0.05,
            yaw: 0.1,
            size: 0.06,
            size_kind: 0.25,
            color: 12.0,
            color_kind: 30.0,
            same_kind: 0.1,
            missed: 0.1,
            named_otherwise: 0.3,
            rooms_height: 0.12,
            least_odds: 15.0,
            least_lead: 3.0,
        }
    }
}

/// `ln` of the normal density of `r` sigmas over that of `spread` (the same difference by chance): what a difference
/// says for one thing and against two, nats. `sigma` and `spread` in one unit.
pub fn for_one(difference: f64, sigma: f64, spread: f64) -> f64 {
    let wide = spread.hypot(sigma);
    (wide / sigma).ln() - 0.5 * (difference / sigma).powi(2) + 0.5 * (difference / wide).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agreement_speaks_for_one_and_distance_against() {
        assert!(for_one(0.0, 0.1, 1.0) > 2.0);
        assert!(for_one(0.5, 0.1, 1.0) < -9.0);
        // Where the two hypotheses say the same nothing is learned.
        assert!(for_one(0.3, 10.0, 0.001).abs() < 1e-3);
    }
}
