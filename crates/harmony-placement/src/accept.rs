//! Whether a change is kept: one rule for review actions, turns, hosts, windows and the joint solve.
//!
//! A change is kept when the energy of all that it touches falls by more than so many nats; who asks for it (a reviewer
//! who is right with some probability) is evidence like any other, worth the logarithm of its odds.

use crate::scene::Energy;

/// Nats that a change must gain beyond its odds: less is the noise of a drawing.
const MIN_GAIN: f64 = 0.1;

/// `ln((1 - p) / p)`, nats: what an answer that is wrong with probability `p` is worth.
pub(crate) fn odds(p_wrong: f64) -> f64 {
    let p = p_wrong.clamp(1e-6, 1.0 - 1e-6);
    ((1.0 - p) / p).ln()
}

/// Whether a change from one energy to another is kept; `odds` speak for it.
pub(crate) fn accepts(before: f64, after: f64, odds: f64) -> bool {
    after < before + odds - MIN_GAIN
}

/// Sum of energies.
pub(crate) fn total(all: &[Energy]) -> f64 {
    all.iter().map(Energy::total).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_that_is_mostly_right_may_cost_its_odds_and_no_more() {
        let word = odds(0.12);
        assert!((word - (0.88_f64 / 0.12).ln()).abs() < 1e-12);
        assert!(accepts(10.0, 11.0, word) && !accepts(10.0, 12.5, word));
        assert!(!accepts(10.0, 10.0, 0.0) && accepts(10.0, 9.5, 0.0));
        assert!(odds(0.5).abs() < 1e-12 && odds(0.9) < 0.0);
    }
}
