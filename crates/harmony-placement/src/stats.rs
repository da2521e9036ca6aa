//! A robust middle.

/// Median (the upper one of an even number); `values` must not be empty.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Median of positive values as ratios go: of an even number the geometric mean of the middle two, so that a set of two sizes
/// meets halfway and not at the larger one; `values` must not be empty.
pub(crate) fn median_of_ratios(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len().is_multiple_of(2) { (values[middle - 1] * values[middle]).sqrt() } else { values[middle] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_number_meets_between_its_middle_two() {
        let of = |values: &[f64]| median_of_ratios(&mut values.to_vec());
        assert!((of(&[2.0, 0.5]) - 1.0).abs() < 1e-12);
        assert!((of(&[9.0, 0.1, 4.0, 1.0]) - 2.0).abs() < 1e-12);
        assert!((of(&[3.0, 1.0, 2.0]) - 2.0).abs() < 1e-12);
        assert!((of(&[3.0]) - 3.0).abs() < 1e-12);
    }
}
