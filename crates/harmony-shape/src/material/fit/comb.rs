//! Finds a repeat in profiles: harmonics of one period against all that changes.

use super::view::Profile;

/// A repeat that was found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Repeat {
    /// Metres.
    pub period: f64,
    /// Where the signal is strongest, metres, 0 to the period.
    pub phase: f64,
    /// Share of the profile's change that the repeat explains, 0 to 1.
    pub explained: f64,
}

/// Range of periods that is searched, relative to the expected one.
const RANGE: (f64, f64) = (0.74, 1.36);
/// Most harmonics.
const HARMONICS: usize = 7;
/// Steps of the search over the range.
const STEPS: usize = 420;
/// Fewest repeats that must be in view.
const MIN_REPEATS: f64 = 2.0;

/// Complex sums of harmonic 1, 2, ... of a period over profiles; profile `c` is shifted by `shifts[c]` periods.
fn harmonics(profiles: &[Profile], shifts: &[f64], period: f64, count: usize) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0); count];
    for (profile, shift) in profiles.iter().zip(shifts) {
        for (k, (v, w)) in profile.value.iter().zip(&profile.weight).enumerate() {
            if *w == 0.0 {
                continue;
            }
            let s = profile.start + k as f64 * profile.step;
            let turn = std::f64::consts::TAU * (s / period - shift);
            let (sin, cos) = (libm::sin(turn), libm::cos(turn));
            // Higher harmonics by the addition theorem.
            let (mut re, mut im) = (cos, sin);
            for sum in &mut sums {
                sum.0 += w * v * re;
                sum.1 -= w * v * im;
                (re, im) = (re * cos - im * sin, re * sin + im * cos);
            }
        }
    }
    sums
}

/// The repeat near an expected period, if the profiles speak of one; `signed`: the phase is that of the largest value,
/// else of the largest deviation.
pub(super) fn find(profiles: &[Profile], shifts: &[f64], expected: f64, least: f64, signed: bool) -> Option<Repeat> {
    let (mut weight, mut power, mut length) = (0.0, 0.0, 0.0_f64);
    for p in profiles {
        let mut seen = 0.0;
        for (v, w) in p.value.iter().zip(&p.weight) {
            weight += w;
            power += w * v * v;
            seen += f64::from(*w > 0.0) * p.step;
        }
        length = length.max(seen);
    }
    if weight <= 0.0 || power <= 1e-12 || length < MIN_REPEATS * expected {
        return None;
    }
    // No finer than three pixels (bins are half pixels).
    let finest = profiles[0].step * 6.0;
    let count = |period: f64| ((period / finest) as usize).clamp(1, HARMONICS);
    let score = |period: f64| {
        let sums = harmonics(profiles, shifts, period, count(period));
        sums.iter().map(|(a, b)| a * a + b * b).sum::<f64>() * 2.0 / (weight * power)
    };
    let mut best = (0.0, expected);
    let ratio = (RANGE.1 / RANGE.0).powf(1.0 / STEPS as f64);
    let mut period = expected * RANGE.0;
    for _ in 0..=STEPS {
        let s = score(period);
        if s > best.0 {
            best = (s, period);
        }
        period *= ratio;
    }
    // Golden section about the best step.
    let (mut a, mut b) = (best.1 / ratio, best.1 * ratio);
    for _ in 0..24 {
        let (c, d) = (b - 0.618 * (b - a), a + 0.618 * (b - a));
        if score(c) > score(d) { b = d } else { a = c }
    }
    let period = f64::midpoint(a, b);
    let explained = score(period).min(1.0);
    // At the border of the range it is something else's repeat.
    let inside = period > expected * RANGE.0 * 1.01 && period < expected * RANGE.1 * 0.99;
    if explained < least || !inside {
        return None;
    }
    let sums = harmonics(profiles, shifts, period, count(period));
    let value = |t: f64| {
        let turn = std::f64::consts::TAU * t;
        sums.iter()
            .enumerate()
            .map(|(k, (re, im))| {
                let a = turn * (k + 1) as f64;
                re * libm::cos(a) - im * libm::sin(a)
            })
            .sum::<f64>()
    };
    let mut peak = (f64::NEG_INFINITY, 0.0);
    for k in 0..720 {
        let t = f64::from(k) / 720.0;
        let v = if signed { value(t) } else { value(t).abs() };
        if v > peak.0 {
            peak = (v, t);
        }
    }
    Some(Repeat { period, phase: peak.1 * period, explained })
}
