//! One-to-one assignment of the highest gain (Kuhn, Naval Research Logistics 1955; Munkres, SIAM J. 1957; in the form with
//! potentials and shortest augmenting paths).

/// Pairs `(row, column)` of the assignment with the highest sum of gains. Only pairs of positive gain are made; `gains` has
/// one row of equal length for each thing on the left.
pub fn assign(gains: &[Vec<f64>]) -> Vec<(usize, usize)> {
    let rows = gains.len();
    let columns = gains.first().map_or(0, Vec::len);
    // As many further columns as rows: whoever takes one stays alone, at no gain.
    let all = columns + rows;
    let cost = |i: usize, j: usize| if j < columns { -gains[i][j].max(0.0) } else { 0.0 };
    // 1-based; column 0 is where each new row starts.
    let (mut of_row, mut of_column) = (vec![0.0; rows + 1], vec![0.0; all + 1]);
    let mut row_at = vec![0; all + 1];
    for row in 1..=rows {
        row_at[0] = row;
        let mut column = 0;
        let mut least = vec![f64::INFINITY; all + 1];
        let mut before = vec![0; all + 1];
        let mut used = vec![false; all + 1];
        loop {
            used[column] = true;
            let (i, mut delta, mut next) = (row_at[column], f64::INFINITY, 0);
            for j in (1..=all).filter(|j| !used[*j]) {
                let reduced = cost(i - 1, j - 1) - of_row[i] - of_column[j];
                if reduced < least[j] {
                    (least[j], before[j]) = (reduced, column);
                }
                if least[j] < delta {
                    (delta, next) = (least[j], j);
                }
            }
            for j in 0..=all {
                if used[j] {
                    of_row[row_at[j]] += delta;
                    of_column[j] -= delta;
                } else {
                    least[j] -= delta;
                }
            }
            column = next;
            if row_at[column] == 0 {
                break;
            }
        }
        while column != 0 {
            row_at[column] = row_at[before[column]];
            column = before[column];
        }
    }
    let mut pairs: Vec<(usize, usize)> = (1..=columns)
        .filter(|j| row_at[*j] > 0 && gains[row_at[*j] - 1][j - 1] > 0.0)
        .map(|j| (row_at[j] - 1, j - 1))
        .collect();
    pairs.sort_unstable();
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_sum_is_found_where_the_best_pair_misleads() {
        // Taking 10 first leaves 1: 11. The other way round: 9 + 8.
        assert_eq!(assign(&[vec![10.0, 9.0], vec![8.0, 1.0]]), [(0, 1), (1, 0)]);
    }

    #[test]
    fn nobody_is_paired_at_a_loss() {
        assert_eq!(assign(&[vec![-1.0, 2.0, 0.0], vec![-3.0, -2.0, -1.0]]), [(0, 1)]);
        assert!(assign(&[]).is_empty() && assign(&[vec![], vec![]]).is_empty());
    }

    #[test]
    fn it_is_as_good_as_trying_all() {
        let gain = |i: usize, j: usize| ((i * 37 + j * 61 + i * j * 17) % 23) as f64 - 6.0;
        let gains: Vec<Vec<f64>> = (0..4).map(|i| (0..4).map(|j| gain(i, j)).collect()).collect();
        let found: f64 = assign(&gains).iter().map(|(i, j)| gains[*i][*j]).sum();
        let mut best: f64 = 0.0;
        for code in 0..5_usize.pow(4) {
            let choice: Vec<usize> = (0..4).map(|i| code / 5_usize.pow(i) % 5).collect();
            let once = (0..4).all(|i| choice[i] == 4 || !choice[..i].contains(&choice[i]));
            if once {
                best = best.max((0..4).filter(|i| choice[*i] < 4).map(|i| gains[i][choice[i]]).sum());
            }
        }
        assert!((found - best).abs() < 1e-9, "{found} {best}");
    }
}
