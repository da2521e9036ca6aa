//! Strengths from rankings: Plackett and Luce.
//!
//! P(order) = product over places of w of the one chosen / sum of w over those that remain (R. D. Luce 1959,
//! R. L. Plackett 1975). Fitted by minorisation-maximisation (D. R. Hunter, "MM algorithms for generalized
//! Bradley-Terry models", 2004). A method that always or never wins would have an infinite strength: every method also
//! wins and loses [`PRIOR`] comparisons against one of mean strength, which pulls towards the middle.

/// Virtual comparisons won, and lost, by each method.
pub const PRIOR: f64 = 0.25;
/// Most rounds of the fit.
const ROUNDS: usize = 2000;
/// A fit ends when no log strength moves by more.
const SETTLED: f64 = 1e-8;

/// A ranking as an order of methods, best first, and how often it counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Methods, best first; methods may be missing.
    pub best_first: Vec<usize>,
    /// Weight.
    pub weight: f64,
}

/// Log strengths with mean 0.
pub fn fit(orders: &[Order], methods: usize, start: Option<&[f64]>) -> Vec<f64> {
    let mut log: Vec<f64> = start.map_or_else(|| vec![0.0; methods], <[f64]>::to_vec);
    // How often a method was chosen from at least two.
    let mut chosen = vec![PRIOR; methods];
    for order in orders {
        let places = order.best_first.len().saturating_sub(1);
        order.best_first.iter().take(places).for_each(|m| chosen[*m] += order.weight);
    }
    for _ in 0..ROUNDS {
        let w: Vec<f64> = log.iter().map(|l| l.exp()).collect();
        let mut offered: Vec<f64> = w.iter().map(|w| 2.0 * PRIOR / (w + 1.0)).collect();
        for order in orders {
            // Sums of what remains, from the last place on; each method is offered at its own place and all before.
            let mut remaining: f64 = order.best_first.iter().map(|m| w[*m]).sum();
            let mut share = 0.0;
            let last = order.best_first.len().saturating_sub(1);
            for (place, m) in order.best_first.iter().enumerate() {
                if place < last {
                    share += order.weight / remaining;
                }
                offered[*m] += share;
                remaining -= w[*m];
            }
        }
        // Only ratios are known from rankings: without this their common factor would drift, ever more slowly.
        let mut new: Vec<f64> = chosen.iter().zip(&offered).map(|(c, o)| (c / o).ln()).collect();
        let mean = new.iter().sum::<f64>() / methods.max(1) as f64;
        for l in &mut new {
            *l -= mean;
        }
        let moved = new.iter().zip(&log).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        log = new;
        if moved < SETTLED {
            break;
        }
    }
    log
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strengths_of_known_people_come_back() {
        use rand::{Rng as _, SeedableRng as _};
        let truth = [1.5, 0.4, 0.0, -0.6, -1.3];
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let orders: Vec<Order> = (0..4000)
            .map(|_| {
                // Gumbel noise on log strengths gives Plackett-Luce orders.
                let mut scores: Vec<(f64, usize)> = truth
                    .iter()
                    .enumerate()
                    .map(|(i, t)| (t - (-rng.random_range(1e-12..1.0_f64).ln()).ln(), i))
                    .collect();
                scores.sort_by(|a, b| b.0.total_cmp(&a.0));
                Order { best_first: scores.into_iter().map(|(_, i)| i).collect(), weight: 1.0 }
            })
            .collect();
        for (fitted, truth) in fit(&orders, 5, None).iter().zip(truth) {
            // About 3 standard errors of 4000 orders.
            assert!((fitted - truth).abs() <= 0.08, "{fitted} {truth}");
        }
    }

    #[test]
    fn two_methods_are_a_coin() {
        // 30 of 40: with the prior the strength is (30 + ...) and without it ln 3; the prior is a small pull.
        let order = |a: usize, b: usize, weight| Order { best_first: vec![a, b], weight };
        let fitted = fit(&[order(0, 1, 30.0), order(1, 0, 10.0)], 2, None);
        let log_odds = fitted[0] - fitted[1];
        assert!((log_odds - 3.0_f64.ln()).abs() <= 0.02 && log_odds < 3.0_f64.ln(), "{log_odds}");
    }

    #[test]
    fn one_that_always_wins_has_a_finite_strength() {
        let orders = vec![Order { best_first: vec![0, 1, 2], weight: 1.0 }; 50];
        let fitted = fit(&orders, 3, None);
        assert!(fitted.iter().all(|f| f.is_finite()) && fitted[0] > fitted[1] && fitted[1] > fitted[2]);
    }
}
