//! Checks, stripes and waves fitted to pixels.

use super::super::color::{linear_hex, luminance};
use super::super::space::Rgb;
use super::super::{Pattern, plan};
use super::comb::find;
use super::view::{Signal, View};
use super::{MIN_EXPLAINED, PatternFit, axes, dot, edges, far, text, weighted};

/// Squares of two colours.
pub(super) fn checks(fit: &mut PatternFit, view: &View) {
    let p = fit.pattern.clone();
    let w = plan::width(&p);
    let (u, v) = axes(&p, 0.0);
    let all = |_: [f64; 2]| Some(0);
    let (a, b) = (edges(view, u, w, &[0.0], &all), edges(view, v, w, &[0.0], &all));
    (fit.along_u, fit.along_v) = (a.map(|r| r.explained), b.map(|r| r.explained));
    let (Some(a), Some(b)) = (a, b) else { return };
    let width = weighted(a, b);
    fit.pattern.width = width;
    let margin = (1.5 / view.px_per_m).min(0.25 * width);
    // Colours by the parity of column and row.
    let class = |i: i64, j: i64| {
        view.mean_color(|q| {
            let (s, t) = ((dot(q, u) - a.phase) / a.period, (dot(q, v) - b.phase) / b.period);
            let (fs, ft) = (s - s.floor(), t - t.floor());
            let m = margin / width;
            (s.floor() as i64).rem_euclid(2) == i
                && (t.floor() as i64).rem_euclid(2) == j
                && fs.min(1.0 - fs) > m
                && ft.min(1.0 - ft) > m
        })
    };
    let found: Vec<Option<(Rgb, usize)>> = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| class(i, j)).into();
    let Some(found) = found.into_iter().collect::<Option<Vec<_>>>() else { return };
    let gingham = matches!(p.variant.as_str(), "gingham" | "buffalo");
    let joined = |a: (Rgb, usize), b: (Rgb, usize)| -> Rgb {
        let n = (a.1 + b.1) as f64;
        std::array::from_fn(|k| (a.0[k] * a.1 as f64 + b.0[k] * b.1 as f64) / n)
    };
    // Each way to lay the origin: its shift in cells, first and second colour.
    let ways: Vec<([f64; 2], Rgb, Rgb)> = if gingham {
        vec![
            ([0.0, 0.0], found[0].0, found[3].0),
            ([1.0, 0.0], found[1].0, found[2].0),
            ([0.0, 1.0], found[2].0, found[1].0),
            ([1.0, 1.0], found[3].0, found[0].0),
        ]
    } else {
        let (even, odd) = (joined(found[0], found[3]), joined(found[1], found[2]));
        vec![([0.0, 0.0], even, odd), ([1.0, 0.0], odd, even)]
    };
    let cost = |way: &([f64; 2], Rgb, Rgb)| {
        if p.colors.len() >= 2 {
            far(way.1, linear_hex(&p.colors[0])) + far(way.2, linear_hex(&p.colors[1]))
        } else {
            // Left to the slot, the lighter one comes first.
            luminance(way.2) - luminance(way.1)
        }
    };
    let Some(best) = ways.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b))) else { return };
    fit.pattern.offset = [a.phase + best.0[0] * width, b.phase + best.0[1] * width];
    fit.pattern.colors = vec![text(best.1), text(best.2)];
    fit.colors = true;
}

/// Bands beside each other along u.
pub(super) fn stripes(fit: &mut PatternFit, view: &View) {
    let p = fit.pattern.clone();
    let widths = plan::stripe_widths(&p);
    let all: f64 = widths.iter().sum();
    let (u, _) = axes(&p, 0.0);
    let profiles = view.profiles(u, Signal::Along(view.main_axis()), all, 1, |_| Some(0));
    let Some(repeat) = find(&profiles, &[0.0], all, MIN_EXPLAINED, true) else { return };
    fit.along_u = Some(repeat.explained);
    let period = repeat.period;
    // The mean colour at each place of the repeat.
    let bins = ((period * view.px_per_m) as usize).clamp(8, 256);
    let mut fold = vec![([0.0; 3], 0.0); bins];
    for k in view.pixels() {
        let t = (dot(view.place(k), u) / period).rem_euclid(1.0);
        let f = &mut fold[((t * bins as f64) as usize).min(bins - 1)];
        for (s, c) in f.0.iter_mut().zip(view.color[k]) {
            *s += c;
        }
        f.1 += 1.0;
    }
    if fold.iter().any(|f| f.1 == 0.0) {
        return;
    }
    let color: Vec<Rgb> = fold.iter().map(|f| f.0.map(|s| s / f.1)).collect();
    let named: Vec<Rgb> = plan_colors(&p);
    let count = widths.len();
    // Two bands may have any widths; more keep the described ones.
    let shares: Vec<Vec<f64>> = if count == 2 {
        (4..=60).map(|k| vec![f64::from(k) / 64.0, 1.0 - f64::from(k) / 64.0]).collect()
    } else {
        vec![widths.iter().map(|w| w / all).collect()]
    };
    let mut best = (f64::INFINITY, 0, 0, Vec::new());
    for (s, share) in shares.iter().enumerate() {
        for shift in 0..bins {
            let mut sums: Vec<(Rgb, f64, f64)> = vec![([0.0; 3], 0.0, 0.0); count];
            for k in 0..bins {
                let t = (k as f64 + 0.5) / bins as f64;
                let mut end = 0.0;
                let band = share.iter().position(|w| {
                    end += w;
                    t < end
                });
                let c = color[(k + shift) % bins];
                let b = &mut sums[band.unwrap_or(count - 1)];
                for (sum, c) in b.0.iter_mut().zip(c) {
                    *sum += c;
                    b.1 += c * c;
                }
                b.2 += 1.0;
            }
            // Variance within bands, and a little for bands that are not as they were named.
            let within: f64 =
                sums.iter().map(|b| b.1 - b.0.iter().map(|c| c * c).sum::<f64>() / b.2.max(1.0)).sum::<f64>()
                    / bins as f64;
            let means: Vec<Rgb> = sums.iter().map(|b| b.0.map(|c| c / b.2.max(1.0))).collect();
            let off: f64 = means
                .iter()
                .enumerate()
                .map(|(k, m)| named.get(k % named.len().max(1)).map_or(0.0, |n| far(*m, *n)))
                .sum::<f64>()
                / count as f64;
            let cost = within + 1e-3 * off;
            if cost < best.0 {
                best = (cost, s, shift, means);
            }
        }
    }
    let (_, s, shift, means) = best;
    fit.pattern.offset[0] = shift as f64 / bins as f64 * period;
    if count == 2 {
        fit.pattern.width = shares[s][0] * period;
        fit.pattern.joint = shares[s][1] * period;
    } else {
        fit.pattern.width *= period / all;
        fit.pattern.joint *= period / all;
        if fit.pattern.width == 0.0 {
            fit.pattern.width = plan::width(&p) * period / all;
        }
    }
    fit.pattern.colors = means.into_iter().map(text).collect();
    fit.colors = true;
}

/// Colours as described; none where they are left to the slot.
fn plan_colors(p: &Pattern) -> Vec<Rgb> {
    p.colors.iter().map(|c| linear_hex(c)).collect()
}

/// Corrugation: light and shade across the waves.
pub(super) fn waves(fit: &mut PatternFit, view: &View) {
    let p = fit.pattern.clone();
    let w = plan::width(&p);
    let (u, _) = axes(&p, 0.0);
    let profiles = view.profiles(u, Signal::Along([0.58; 3]), w, 1, |_| Some(0));
    if let Some(repeat) = find(&profiles, &[0.0], w, MIN_EXPLAINED, true) {
        fit.along_u = Some(repeat.explained);
        fit.pattern.width = repeat.period;
        fit.pattern.offset[0] = repeat.phase;
    }
}
