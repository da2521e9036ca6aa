//! Scalar mathematics that all backends agree on.

use crate::backend::{Binary, Reduce, Resize};

/// The error function, to about 1e-15: the series with positive terms only (Abramowitz and Stegun 7.1.6).
pub fn erf(x: f64) -> f64 {
    if x.abs() > 6.0 {
        return x.signum();
    }
    let (mut term, mut sum) = (x, x);
    let mut n = 1.0;
    while term.abs() > 1e-18 * sum.abs() {
        term *= 2.0 * x * x / (2.0 * n + 1.0);
        sum += term;
        n += 1.0;
    }
    2.0 / std::f64::consts::PI.sqrt() * (-x * x).exp() * sum
}

/// A pointwise function of two numbers.
pub fn binary(op: Binary, a: f32, b: f32) -> f32 {
    match op {
        Binary::Add => a + b,
        Binary::Sub => a - b,
        Binary::Mul => a * b,
        Binary::Div => a / b,
    }
}

/// A reduction of one row, summed in f64.
pub fn reduce(how: Reduce, row: &[f32]) -> f32 {
    let sum = || row.iter().map(|v| f64::from(*v)).sum::<f64>();
    match how {
        Reduce::Sum => sum() as f32,
        Reduce::Mean => (sum() / row.len() as f64) as f32,
        Reduce::Max => row.iter().copied().fold(f32::NEG_INFINITY, f32::max),
    }
}

/// For every output position of one axis, the input positions and weights it is made of.
pub fn taps(input: usize, output: usize, how: Resize) -> Vec<Vec<(usize, f32)>> {
    let last = input.saturating_sub(1);
    let scale = input as f32 / output as f32;
    let clamp = |i: i64| i.clamp(0, last as i64) as usize;
    (0..output)
        .map(|o| match how {
            Resize::Nearest => vec![(((o as f32 * scale) as usize).min(last), 1.0)],
            Resize::Bilinear | Resize::BilinearCorners => {
                let at = if how == Resize::Bilinear {
                    ((o as f32 + 0.5) * scale - 0.5).max(0.0)
                } else if output > 1 {
                    // As PyTorch computes it: one f32 ratio, then a product.
                    o as f32 * (last as f32 / (output - 1) as f32)
                } else {
                    0.0
                };
                let low = (at as usize).min(last);
                let part = at - low as f32;
                vec![(low, 1.0 - part), ((low + 1).min(last), part)]
            }
            Resize::Bicubic => {
                let at = (o as f32 + 0.5) * scale - 0.5;
                let low = at.floor();
                let part = at - low;
                (-1..3).map(|k| (clamp(low as i64 + k), cubic(k as f32 - part, -0.75))).collect()
            }
        })
        .collect()
}

/// Keys' cubic kernel with parameter `a` at distance `x`.
pub fn cubic(x: f32, a: f32) -> f32 {
    let x = x.abs();
    if x <= 1.0 {
        ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0
    } else if x < 2.0 {
        ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a
    } else {
        0.0
    }
}

/// Antialiased cubic resizing with `a = -0.5`, `align_corners = false`: the kernel widens when shrinking, weights are
/// cut at the border and sum to one. The filter of PIL, and of PyTorch's `antialias = True`.
pub fn cubic_antialias_taps(input: usize, output: usize) -> Vec<(usize, Vec<f64>)> {
    let scale = input as f64 / output as f64;
    let widen = scale.max(1.0);
    let support = 2.0 * widen;
    let kernel = |x: f64| {
        let (x, a) = (x.abs(), -0.5);
        if x < 1.0 {
            ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0
        } else if x < 2.0 {
            (((x - 5.0) * x + 8.0) * x - 4.0) * a
        } else {
            0.0
        }
    };
    (0..output)
        .map(|o| {
            let centre = (o as f64 + 0.5) * scale;
            let first = ((centre - support + 0.5) as i64).max(0) as usize;
            let end = ((centre + support + 0.5) as usize).min(input);
            let raw: Vec<f64> = (first..end).map(|i| kernel((i as f64 + 0.5 - centre) / widen)).collect();
            let total: f64 = raw.iter().sum();
            (first, raw.iter().map(|w| w / total).collect())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_has_the_values_of_the_tables() {
        // Abramowitz and Stegun, table 7.1.
        for (x, wanted) in [(0.0, 0.0), (0.5, 0.520_499_877_8), (1.0, 0.842_700_792_9), (2.0, 0.995_322_265_0)] {
            assert!((erf(x) - wanted).abs() <= 1e-10, "{x}");
            assert!((erf(-x) + wanted).abs() <= 1e-10, "{x}");
        }
        assert!((erf(4.0) - 0.999_999_984_6).abs() <= 1e-10);
    }

    #[test]
    fn taps_sum_to_one_and_keep_straight_lines() {
        for how in [Resize::Bilinear, Resize::BilinearCorners, Resize::Bicubic] {
            for (input, output) in [(5, 9), (9, 5), (7, 7), (1, 4), (4, 1)] {
                for taps in taps(input, output, how) {
                    let total: f32 = taps.iter().map(|t| t.1).sum();
                    assert!((total - 1.0).abs() <= 1e-5, "{how:?} {input} {output}");
                }
            }
        }
        let corners = taps(5, 9, Resize::BilinearCorners);
        for (o, t) in corners.iter().enumerate() {
            let at: f32 = t.iter().map(|(i, w)| *i as f32 * w).sum();
            assert!((at - o as f32 * 0.5).abs() <= 1e-6);
        }
    }
}
