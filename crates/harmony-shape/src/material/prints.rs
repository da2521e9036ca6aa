//! Prints and shapes: checks, stripes, dots, motifs, ramps, corrugation, quilting.

use super::Pattern;
use super::noise::{Cells, Noise, gauss, hash, lerp, smooth, unit};
use super::plan::{Palette, amount, dot_diameter, length, pair, stripe_widths, tone_sigma, width};
use super::space::{Paint, Sample, Space, mix, times};

/// Squares of two colours; `gingham`: woven of two-coloured threads, so that a third colour lies between.
pub(super) fn checks(space: &Space, p: &Pattern) -> Paint {
    let (nu, nv) = (space.across(2.0 * width(p)).0 * 2, space.down(2.0 * width(p), 1).0 * 2);
    let (a, b) = (space.w / nu as f64, space.h / nv as f64);
    let colors = pair(p, space, 0.55);
    let gingham = p.variant == "gingham" || p.variant == "buffalo";
    let sigma = tone_sigma(p, 0.02);
    let seed = space.seed;
    let space = *space;
    // Share of a texel in odd bands: 0 or 1 with a filtered edge.
    let band = move |x: f64, side: f64| {
        let k = (x / side).floor();
        let odd = (k as i64).rem_euclid(2) == 1;
        let x = x - k * side;
        let near = x.min(side - x);
        let own = space.inside(-near);
        if odd { own } else { 1.0 - own }
    };
    Box::new(move |u, v| {
        let (i, j) = ((u / a).floor() as i64, (v / b).floor() as i64);
        let (s, t) = (band(u, a), band(v, b));
        let id = hash(seed, i.rem_euclid(nu), j.rem_euclid(nv));
        let share = if gingham { 0.5 * (s + t) } else { s + t - 2.0 * s * t };
        let color = mix(colors[0], colors[1], share);
        Sample { color: times(color, libm::exp(sigma * gauss(id, 1))), id, cover: 1.0, ..Sample::flat(color) }
    })
}

/// Stripes along v, one beside the other along u: the first `width` wide, the second `joint`.
pub(super) fn stripes(space: &Space, p: &Pattern) -> Paint {
    let widths = stripe_widths(p);
    let all: f64 = widths.iter().sum();
    let (n, period) = space.across(all);
    let ends: Vec<f64> = widths
        .iter()
        .scan(0.0, |at, w| {
            *at += w / all * period;
            Some(*at)
        })
        .collect();
    let colors = pair(p, space, 0.5);
    let space = *space;
    let count = ends.len();
    Box::new(move |u, _| {
        let repeat = (u / period).floor();
        let x = u - repeat * period;
        let k = ends.partition_point(|e| *e <= x).min(count - 1);
        let start = if k == 0 { 0.0 } else { ends[k - 1] };
        let (before, after) = (x - start, ends[k] - x);
        let color = colors[k % colors.len()];
        let next = if before < after {
            colors[(k + count - 1) % count % colors.len()]
        } else {
            colors[(k + 1) % count % colors.len()]
        };
        let own = space.inside(-before.min(after));
        let id = hash(7, (repeat as i64).rem_euclid(n), k as i64);
        Sample { id, ..Sample::flat(mix(next, color, own)) }
    })
}

/// Dots on a ground: staggered unless `grid`; `random`: strewn.
pub(super) fn dots(space: &Space, p: &Pattern) -> Paint {
    let colors = pair(p, space, 0.6);
    let w = width(p);
    let r = dot_diameter(p) / 2.0;
    let (nu, a) = space.across(w);
    let (nv, b) = space.down(w, 1);
    let staggered = p.variant != "grid";
    let strewn = (p.variant == "random").then(|| Cells::new(space, [w * 0.71, w * 0.71], 0.55, 61));
    let seed = space.seed;
    let space = *space;
    Box::new(move |u, v| {
        let (d, id) = if let Some(cells) = &strewn {
            let mut best = (f64::INFINITY, 0);
            cells.around(u, v, |to, id| {
                let d = f64::hypot(to[0], to[1]);
                if d < best.0 {
                    best = (d, id);
                }
            });
            best
        } else {
            let at = |off: f64| {
                let (i, j) = ((u / a - off).floor(), (v / b - off).floor());
                let d = f64::hypot(u - (i + off + 0.5) * a, v - (j + off + 0.5) * b);
                (d, hash(seed ^ off.to_bits(), (i as i64).rem_euclid(nu), (j as i64).rem_euclid(nv)))
            };
            let (one, two) = (at(0.0), at(0.5));
            if staggered && two.0 < one.0 { two } else { one }
        };
        let share = space.inside(d - r);
        let k = 1 + ((unit(id, 3) * (colors.len() - 1) as f64) as usize).min(colors.len() - 2);
        Sample { cover: share, id, ..Sample::flat(mix(colors[0], colors[k], share)) }
    })
}

/// Outline of a motif: its own, else one by name (`heart`, `star`, `leaf`, `moon`), a heart where there is none.
pub(super) fn outline(p: &Pattern) -> Vec<[f64; 2]> {
    if p.outline.len() >= 3 {
        return p.outline.clone();
    }
    let s = 0.45 * width(p);
    let n = 48;
    let turn = |k: usize| k as f64 / n as f64 * std::f64::consts::TAU;
    match p.variant.as_str() {
        "star" => (0..10)
            .map(|k| {
                let a = k as f64 / 10.0 * std::f64::consts::TAU;
                let r = if k % 2 == 0 { 0.5 * s } else { 0.2 * s };
                [r * libm::sin(a), r * libm::cos(a)]
            })
            .collect(),
        "leaf" => (0..n)
            .map(|k| {
                let a = turn(k);
                let t = libm::cos(a);
                [0.24 * s * libm::sin(a) * (1.0 - 0.35 * t), 0.5 * s * t]
            })
            .collect(),
        "moon" => (0..n)
            .map(|k| {
                let a = turn(k);
                let x = if k < n / 2 { libm::sin(a) } else { 0.45 * libm::sin(a).abs() };
                [0.5 * s * (x - 0.4), 0.5 * s * libm::cos(a)]
            })
            .collect(),
        _ => (0..n)
            .map(|k| {
                // The usual heart curve, 16 wide to each side.
                let a = turn(k);
                let x = 16.0 * libm::pow(libm::sin(a).abs(), 3.0) * libm::sin(a).signum();
                let y = 13.0 * libm::cos(a) - 5.0 * libm::cos(2.0 * a) - 2.0 * libm::cos(3.0 * a) - libm::cos(4.0 * a);
                [x * s / 32.0, (y + 2.0) * s / 32.0]
            })
            .collect(),
    }
}

/// Area of a polygon, square metres.
pub(super) fn area(points: &[[f64; 2]]) -> f64 {
    let n = points.len();
    (0..n).map(|k| points[k][0] * points[(k + 1) % n][1] - points[(k + 1) % n][0] * points[k][1]).sum::<f64>().abs()
        / 2.0
}

/// Signed distance to a polygon, negative inside (even-odd).
fn distance(points: &[[f64; 2]], x: f64, y: f64) -> f64 {
    let mut best = f64::INFINITY;
    let mut inside = false;
    let n = points.len();
    for k in 0..n {
        let (a, b) = (points[k], points[(k + 1) % n]);
        let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
        let (wx, wy) = (x - a[0], y - a[1]);
        let t = ((wx * ex + wy * ey) / (ex * ex + ey * ey).max(1e-18)).clamp(0.0, 1.0);
        let (dx, dy) = (wx - ex * t, wy - ey * t);
        best = best.min(dx * dx + dy * dy);
        if (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * ex {
            inside = !inside;
        }
    }
    if inside { -best.sqrt() } else { best.sqrt() }
}

/// A motif stamped over a ground on a staggered lattice; `amount`: how far places, turns and sizes stray. The motif's +y
/// is the tile's -v (images have v downwards).
pub(super) fn motif(space: &Space, p: &Pattern) -> Paint {
    let colors = pair(p, space, 0.6);
    let points = outline(p);
    let radius = points.iter().map(|q| f64::hypot(q[0], q[1])).fold(0.0, f64::max);
    let w = width(p);
    let (nu, a) = space.across(w);
    let (nv, b) = space.down(w, 2);
    let stray = amount(p, 0.25);
    // Stamps stay apart: no farther from their places than the gap allows.
    let room = ((w - 2.0 * radius) / 2.0).max(0.0) * stray;
    let seed = space.seed;
    let space = *space;
    Box::new(move |u, v| {
        let mut best = (f64::INFINITY, 0);
        let j0 = (v / b).floor() as i64;
        for j in j0 - 1..=j0 + 1 {
            let off = if j.rem_euclid(2) == 0 { 0.0 } else { 0.5 };
            let i0 = (u / a - off).floor() as i64;
            for i in i0 - 1..=i0 + 1 {
                let id = hash(seed, i.rem_euclid(nu), j.rem_euclid(nv));
                let cx = (i as f64 + 0.5 + off) * a + room * (2.0 * unit(id, 1) - 1.0);
                let cy = (j as f64 + 0.5) * b + room * (2.0 * unit(id, 2) - 1.0);
                let (dx, dy) = (u - cx, cy - v);
                let scale = 1.0 + 0.25 * stray * gauss(id, 3).clamp(-1.5, 1.5);
                if f64::hypot(dx, dy) > radius * scale + 2.0 * space.px {
                    continue;
                }
                let turn = 0.5 * stray * gauss(id, 4);
                let (s, c) = (libm::sin(turn), libm::cos(turn));
                let d = distance(&points, (c * dx + s * dy) / scale, (c * dy - s * dx) / scale) * scale;
                if d < best.0 {
                    best = (d, id);
                }
            }
        }
        let share = if best.0.is_finite() { space.inside(best.0) } else { 0.0 };
        let k = 1 + ((unit(best.1, 5) * (colors.len() - 1) as f64) as usize).min(colors.len() - 2);
        Sample { cover: share, id: best.1, ..Sample::flat(mix(colors[0], colors[k], share)) }
    })
}

/// From the first colour to the last along v over `length`, and back, so that it repeats.
pub(super) fn ramp(space: &Space, p: &Pattern) -> Paint {
    let colors = pair(p, space, 0.5);
    let (_, period) = space.down(2.0 * length(p), 1);
    Box::new(move |_, v| {
        let t = (v / period).rem_euclid(1.0);
        let t = if t < 0.5 { 2.0 * t } else { 2.0 - 2.0 * t };
        let x = t * (colors.len() - 1) as f64;
        let k = (x as usize).min(colors.len() - 2);
        Sample::flat(mix(colors[k], colors[k + 1], x - k as f64))
    })
}

/// Sheet bent to waves along u, ridges along v; `amount`: depth against the pitch; variant `box`: flat tops.
pub(super) fn corrugated(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let (n, pitch) = space.across(width(p));
    let depth = 1000.0 * pitch * 0.35 * amount(p, 0.5);
    let boxed = p.variant == "box" || p.variant == "trapezoid";
    let stain = Noise::periodic(space, [0.06, 0.35], 71);
    let scratch = Noise::periodic(space, [0.003, 0.06], 72);
    Box::new(move |u, v| {
        let x = u / pitch;
        let wave = libm::cos(x * std::f64::consts::TAU);
        let shape = if boxed { smooth(-0.35, 0.35, wave) } else { 0.5 + 0.5 * wave };
        let s = stain.fbm(u, v, 3);
        let color = times(palette.main[0], libm::exp(0.06 * s - 0.10 * (1.0 - shape)));
        let id = (x.floor() as i64).rem_euclid(n) as u64;
        Sample { height: depth * shape + 0.02 * scratch.at(u, v), rough: 0.05 * s, id, ..Sample::flat(color) }
    })
}

/// Padded cloth stitched through: `box`, `diamond` or `channel` (rows along u); `amount`: how full it is.
pub(super) fn quilting(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let w = width(p);
    let (nu, a) = space.across(w);
    let (nv, b) = space.down(if p.variant == "diamond" { w * 3.0_f64.sqrt() } else { w }, 1);
    let (diamond, channel) = (p.variant == "diamond", p.variant == "channel");
    let full = 1000.0 * 0.16 * w * amount(p, 0.5);
    let pucker = Noise::periodic(space, [0.010, 0.010], 73);
    let cloth = Noise::periodic(space, [0.0015_f64.max(2.0 * space.px); 2], 74);
    let sag = Noise::periodic(space, [0.07, 0.07], 75);
    let px = space.px;
    Box::new(move |u, v| {
        let (x, y) = (u / a, v / b);
        // Distances to the two nearest seams, metres, and where along them.
        let (d1, d2, along) = if diamond {
            let (s, t) = (x + y, y - x);
            let f = |q: f64| (q - q.round()).abs();
            let k = a * b / f64::hypot(a, b);
            (f(s) * k, f(t) * k, if f(s) < f(t) { y * b / 0.866 } else { y * b / 0.866 })
        } else {
            let f = |q: f64, side: f64| (q - q.round()).abs() * side;
            let dv = f(y, b);
            if channel { (dv, f64::INFINITY, u) } else { (f(x, a), dv, if f(x, a) < dv { v } else { u }) }
        };
        let d = d1.min(d2);
        let reach = if channel { b / 2.0 } else { a.min(b) / 2.0 };
        let dome = |d: f64| {
            let t = (d / reach).min(1.0);
            (1.0 - (1.0 - t) * (1.0 - t)).max(0.0).sqrt()
        };
        let puff = dome(d1) * if d2.is_finite() { dome(d2) } else { 1.0 };
        let creases = pucker.fbm(u, v, 2) * smooth(reach * 0.7, 0.0, d) * full * 0.05;
        let stitch =
            smooth(0.0012_f64.max(px), 0.0, d) * smooth(-0.2, 0.3, libm::cos(along / 0.004 * std::f64::consts::TAU));
        let id = hash(space_id(nu, nv), x.floor() as i64 % nu, y.floor() as i64 % nv);
        let shade = lerp(0.88, 1.0, smooth(0.0, reach * 0.35, d));
        let weave = 0.03 * cloth.at(u, v);
        Sample {
            height: full * (puff + 0.05 * sag.at(u, v)) + creases + 0.04 * cloth.at(u, v) - 0.25 * stitch,
            color: times(palette.main[0], shade * (1.0 + weave) * (1.0 - 0.12 * stitch)),
            rough: 0.0,
            cover: 1.0,
            id,
        }
    })
}

const fn space_id(nu: i64, nv: i64) -> u64 {
    (nu as u64) << 32 | nv as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signed_distance_of_a_square() {
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        for (x, y, d) in [(0.0, 0.0, -1.0), (0.5, 0.2, -0.5), (2.0, 0.0, 1.0), (4.0, 5.0, 5.0)] {
            assert!((distance(&square, x, y) - d).abs() <= 1e-12, "{x} {y}");
        }
        assert!((area(&square) - 4.0).abs() <= 1e-12);
    }
}
