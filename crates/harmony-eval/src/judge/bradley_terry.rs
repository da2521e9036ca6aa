//! Strengths from pairwise wins (R. A. Bradley, M. E. Terry, "Rank Analysis of Incomplete Block Designs", 1952).
//!
//! The probability that i beats j is `s_i / (s_i + s_j)`; strengths are found by D. Hunter's iteration ("MM algorithms
//! for generalized Bradley-Terry models", 2004). A tie counts as half a win for each. Who never or always wins has no
//! finite strength: every pair that was compared therefore gets [`PRIOR`] of a win each way, as if an undecided
//! comparison had been seen.

/// Wins added each way to every pair that was compared.
pub const PRIOR: f64 = 0.5;
/// Most rounds, and the change of log strengths at which they end.
const ROUNDS: usize = 500;
const SETTLED: f64 = 1e-9;

/// Log strengths, mean 0, from `wins[i][j]`: how often i beat j, ties as halves. Those without any comparison get 0.
pub fn strengths(wins: &[Vec<f64>], prior: f64) -> Vec<f64> {
    let n = wins.len();
    let at = |i: usize, j: usize| wins.get(i).and_then(|row| row.get(j)).copied().unwrap_or(0.0);
    let compared = |i: usize, j: usize| i != j && at(i, j) + at(j, i) > 0.0;
    let padded = |i: usize, j: usize| at(i, j) + if compared(i, j) { prior } else { 0.0 };
    if n == 2 && compared(0, 1) && padded(0, 1) > 0.0 && padded(1, 0) > 0.0 {
        // Two have a solution of closed form.
        let lead = (padded(0, 1) / padded(1, 0)).ln();
        return vec![lead / 2.0, -lead / 2.0];
    }
    let mut log = vec![0.0_f64; n];
    for _ in 0..ROUNDS {
        let strength: Vec<f64> = log.iter().map(|l| l.exp()).collect();
        let mut next = log.clone();
        for i in 0..n {
            let (mut won, mut expected) = (0.0, 0.0);
            for j in (0..n).filter(|j| compared(i, *j)) {
                won += padded(i, j);
                expected += (padded(i, j) + padded(j, i)) / (strength[i] + strength[j]);
            }
            if won > 0.0 && expected > 0.0 {
                next[i] = (won / expected).ln();
            }
        }
        let mean = next.iter().sum::<f64>() / n.max(1) as f64;
        for l in &mut next {
            *l -= mean;
        }
        let moved = next.iter().zip(&log).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        log = next;
        if moved < SETTLED {
            break;
        }
    }
    log
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn two_are_as_strong_as_their_wins() {
        let s = strengths(&[vec![0.0, 30.0], vec![10.0, 0.0]], 0.0);
        assert!((s[0] - s[1] - 3.0_f64.ln()).abs() <= 1e-8, "{s:?}");
        let even = strengths(&[vec![0.0, 4.0], vec![4.0, 0.0]], PRIOR);
        assert!(even.iter().all(|s| s.abs() <= 1e-8));
    }

    #[test]
    fn strengths_that_wins_were_drawn_from_are_found() {
        let truth: [f64; 4] = [0.9, 0.3, -0.2, -1.0];
        let mut numbers = ChaCha8Rng::seed_from_u64(11);
        let mut wins = vec![vec![0.0; 4]; 4];
        for i in 0..4 {
            for j in i + 1..4 {
                for _ in 0..3000 {
                    let first = numbers.random::<f64>() < 1.0 / (1.0 + (truth[j] - truth[i]).exp());
                    let (winner, loser) = if first { (i, j) } else { (j, i) };
                    wins[winner][loser] += 1.0;
                }
            }
        }
        // Each strength rests on 9000 comparisons: its standard error is about 0.02.
        for (found, truth) in strengths(&wins, PRIOR).iter().zip(truth) {
            assert!((found - truth).abs() < 0.09, "{found} {truth}");
        }
    }

    #[test]
    fn who_never_wins_has_a_finite_strength_and_who_was_not_compared_none() {
        let s = strengths(&[vec![0.0, 20.0, 0.0], vec![0.0; 3], vec![0.0; 3]], PRIOR);
        assert!(s[0] > 1.0 && s[1] < -1.0 && s.iter().all(|v| v.is_finite()), "{s:?}");
        assert!((s[0] - s[1] - (20.5_f64 / 0.5).ln()).abs() < 1e-6);
        assert_eq!(strengths(&[], PRIOR), Vec::<f64>::new());
    }
}
