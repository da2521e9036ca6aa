//! Histograms.

use std::fmt::Write;

use crate::summary::number;

const WIDTH: f64 = 300.0;
const HEIGHT: f64 = 110.0;
/// Room for the axis below and the margins beside.
const FOOT: f64 = 22.0;
const SIDE: f64 = 8.0;
const BINS: usize = 24;

/// A histogram as inline SVG; the last bin holds what lies beyond the axis, the dashed line is the target.
///
/// The axis starts at 0 for lengths and the like. It ends at the 97th percentile, rounded up, so that one far value
/// doesn't flatten the rest. Empty without values.
pub fn histogram(values: &[f64], unit: &str, target: Option<f64>, more_is_better: bool) -> String {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let (Some(least), Some(most)) = (sorted.first(), sorted.last()) else { return String::new() };
    let far = sorted[((0.97 * sorted.len() as f64) as usize).min(sorted.len() - 1)];
    // Shares of a hundred that are all high need no axis down to 0.
    let (low, high) = if more_is_better {
        ((least.min(target.unwrap_or(*least)) / 5.0).floor() * 5.0, round_up(*most).min(most.max(100.0)))
    } else {
        (least.min(0.0), round_up(far.max(target.unwrap_or(0.0) * 1.2)))
    };
    let span = (high - low).max(1e-12);
    let mut counts = [0_usize; BINS];
    for v in &sorted {
        counts[((((v - low) / span) * BINS as f64).max(0.0) as usize).min(BINS - 1)] += 1;
    }
    let highest = counts.iter().copied().max().unwrap_or(1).max(1) as f64;
    let (plot, base) = (WIDTH - 2.0 * SIDE, HEIGHT - FOOT);
    let step = plot / BINS as f64;
    let mut out = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"histogram of {} values\">",
        sorted.len()
    );
    for (i, count) in counts.iter().enumerate().filter(|(_, c)| **c > 0) {
        let height = (base - 14.0) * *count as f64 / highest;
        let (from, to) = (low + span * i as f64 / BINS as f64, low + span * (i + 1) as f64 / BINS as f64);
        let (x, width) = (SIDE + step * i as f64, step - 1.0);
        let _ = write!(
            out,
            "<rect class=\"bar\" x=\"{x:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"><title>{} to {} \
             {unit}: {count}</title></rect>",
            base - height,
            number(from),
            number(to),
        );
    }
    let _ = write!(out, "<path class=\"axis\" d=\"M{SIDE} {base}H{}\"/>", WIDTH - SIDE);
    let mut mark = |value: f64, class: &str| {
        if value >= low && value <= high {
            let x = SIDE + plot * (value - low) / span;
            let _ = write!(out, "<path class=\"{class}\" d=\"M{x:.1} 8V{base}\"/>");
        }
    };
    mark(sorted[sorted.len() / 2], "middle");
    if let Some(target) = target {
        mark(target, "target");
    }
    let beyond = if *most > high { " +" } else { "" };
    let (y, right) = (HEIGHT - 7.0, WIDTH - SIDE);
    let _ = write!(
        out,
        "<text x=\"{SIDE}\" y=\"{y}\">{}</text><text x=\"{right}\" y=\"{y}\" text-anchor=\"end\">{}{beyond} {unit}\
         </text><text x=\"{right}\" y=\"12\" text-anchor=\"end\">most in a bar: {highest}</text></svg>",
        plain(low),
        plain(high),
    );
    out
}

fn plain(value: f64) -> String {
    format!("{}", (value * 1e6).round() / 1e6)
}

/// The next of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten.
fn round_up(value: f64) -> f64 {
    if value <= 0.0 {
        return 1.0;
    }
    let power = 10_f64.powf(value.log10().floor());
    let steps = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
    steps.iter().map(|s| s * power).find(|s| *s >= value * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_counts_every_value_once() {
        let svg = histogram(&[0.01, 0.011, 0.04, 0.2, f64::NAN], "m", Some(0.05), false);
        let counted: usize = svg
            .split("<title>")
            .skip(1)
            .filter_map(|t| t.split("</title>").next()?.rsplit(' ').next()?.parse::<usize>().ok())
            .sum();
        assert_eq!(counted, 4);
        assert!(svg.contains("class=\"target\"") && svg.contains("0.2 m"), "{svg}");
        assert_eq!(histogram(&[f64::NAN], "m", None, false), "");
        assert!(histogram(&[99.0, 97.0], "%", Some(96.0), true).contains(">95<"), "shares start near the least");
    }

    #[test]
    fn axes_end_at_round_numbers() {
        for (value, end) in [(0.17, 0.2), (0.2, 0.2), (7.0, 8.0), (0.0, 1.0), (97.0, 100.0)] {
            assert!((round_up(value) - end).abs() <= 1e-9, "{value}: {}", round_up(value));
        }
    }
}
