//! Hanging cloth: curtains.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::Cloth;
use super::grid::tube;
use super::noise::{Dice, noise1, noise2, smoothstep};
use super::sheet::Middle;
use crate::Piece;
use crate::tree::HangTop;

/// Thickness of the cloth, metres.
const THICK: f64 = 0.003;

/// Arguments of [`hang`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HangSpec {
    /// Width and height as it hangs.
    pub size: [f64; 2],
    /// Number of folds; 0: one every 12 cm.
    pub folds: u32,
    /// Cloth width relative to the width it hangs in.
    pub gather: f64,
    /// How it is held.
    pub top: HangTop,
    /// Height of a tie-back as a fraction of the height, 0: none. Tied to the left (-x) side.
    pub tie: f64,
    /// Seed.
    pub seed: u32,
}

/// Angles of the cloth along a row of it.
struct Folds {
    spec: HangSpec,
    /// Length of the cloth along a row.
    cloth: f64,
    count: f64,
    /// Where folds begin, fractions of the cloth: of unequal widths, the same all the way down.
    starts: Vec<f64>,
    /// Depth of each fold at the hem relative to the top.
    depth: Vec<f64>,
}

impl Folds {
    fn new(spec: &HangSpec) -> Self {
        let [w, _] = spec.size;
        let count = if spec.folds > 0 { f64::from(spec.folds) } else { (w / 0.12).round() }.clamp(1.0, 80.0);
        let mut dice = Dice::new(spec.seed, 41);
        let widths: Vec<f64> = (0..count as usize).map(|_| 1.0 + 0.42 * dice.bell()).collect();
        let whole: f64 = widths.iter().sum();
        let mut sum = 0.0;
        let mut starts = vec![0.0];
        for v in &widths {
            sum += v / whole;
            starts.push(sum);
        }
        // Some folds give way to their neighbours on the way down.
        let depth = (0..count as usize).map(|_| 1.0 + 0.65 * dice.bell()).collect();
        Self { spec: *spec, cloth: w * spec.gather.clamp(1.0, 4.0), count, starts, depth }
    }

    /// Angle of the cloth against its row, before the row is fitted to its width; `down` 0 at the top, 1 at the hem.
    fn angle(&self, s: f64, down: f64) -> f64 {
        let seed = self.spec.seed;
        // Phase of the unequal folds, drifting sideways a little on the way down.
        let drift =
            0.45 / self.count * smoothstep(0.05, 1.0, down) * noise2(s * self.count * 0.35, down * 1.3, seed ^ 5);
        let at = (s + drift).clamp(0.0, 1.0);
        let k = (self.starts.partition_point(|v| *v <= at).max(1) - 1).min(self.depth.len() - 1);
        let t = (at - self.starts[k]) / (self.starts[k + 1] - self.starts[k]).max(1e-9);
        let next = self.depth[(k + 1).min(self.depth.len() - 1)];
        let before = self.depth[k.saturating_sub(1)];
        let own = if t < 0.5 {
            before + (self.depth[k] - before) * (t + 0.5)
        } else {
            self.depth[k] + (next - self.depth[k]) * (t - 0.5)
        };
        let lower = smoothstep(0.0, 0.9, down);
        let amount = 1.0 + (own - 1.0) * lower;
        let regular = libm::cos(TAU * t);
        match self.spec.top {
            HangTop::Rings => amount * regular,
            // Pinched pleats: three narrow folds in the middle of each, flat between; they open into one fold.
            HangTop::Pleats => {
                let pinched = smoothstep(0.30, 0.36, t) * (1.0 - smoothstep(0.64, 0.70, t));
                let pleat = pinched * libm::cos(TAU * (t - 0.5) * 8.8) * 1.5 + 0.12 * regular;
                let open = smoothstep(0.02, 0.22, down);
                pleat + (amount * regular - pleat) * open
            }
            // Ruffles on a rod: many small uneven gathers that merge on the way down.
            HangTop::Rod => {
                let small = libm::cos(TAU * (s * self.count * 2.3 + 0.7 * noise1(s * self.count * 1.1, seed)))
                    * (0.8 + 0.4 * noise1(s * self.count * 1.7 + 3.1, seed));
                let open = smoothstep(0.015, 0.35, down);
                small + (amount * regular - small) * open
            }
        }
    }

    /// A row as (x from its left end, z), `n` points, spanning `width`: the angles are scaled until it does.
    fn row(&self, n: usize, width: f64, down: f64) -> Vec<DVec2> {
        let ds = self.cloth / (n - 1) as f64;
        let angles: Vec<f64> = (0..n - 1).map(|i| self.angle((i as f64 + 0.5) / (n - 1) as f64, down)).collect();
        let span = |scale: f64| angles.iter().map(|a| libm::cos(a * scale) * ds).sum::<f64>();
        let (mut lo, mut hi) = (0.0, 2.2);
        for _ in 0..26 {
            let mid = f64::midpoint(lo, hi);
            if span(mid) > width {
                lo = mid;
            } else {
                hi = mid;
            }
        }
        let mut at = DVec2::ZERO;
        let mut out = vec![at];
        for a in &angles {
            let (s, c) = libm::sincos(a * lo);
            at += DVec2::new(c, s) * ds;
            out.push(at);
        }
        // Exactly its width, and on average in its plane all along.
        let fit = width / at.x.max(1e-9);
        let slope = at.y / (n - 1) as f64;
        let mean = out.iter().enumerate().map(|(i, p)| p.y - slope * i as f64).sum::<f64>() / n as f64;
        for (i, p) in out.iter_mut().enumerate() {
            *p = DVec2::new(p.x * fit, p.y - slope * i as f64 - mean);
        }
        out
    }
}

/// A cloth that hangs in folds, from `y = height` down to `y = 0`, centred in x, its middle plane at z = 0.
///
/// Every row of the cloth keeps its length (its angles are those of an elastic strip, a cosine of the length), every
/// column nearly so. Folds are of unequal width, drift, open and deepen downwards.
pub fn hang(spec: &HangSpec) -> Cloth {
    let spec = &HangSpec {
        size: spec.size.map(|v| v.clamp(0.05, 20.0)),
        gather: if spec.gather.is_finite() { spec.gather.clamp(1.02, 4.0) } else { 1.8 },
        tie: spec.tie.clamp(0.0, 0.9),
        ..*spec
    };
    let [_, h] = spec.size;
    let folds = Folds::new(spec);
    let fine = if spec.top == HangTop::Rings { 14.0 } else { 22.0 };
    let nu = ((folds.count * fine) as usize).clamp(24, 420) + 1;
    let nv = ((h / 0.07) as usize).clamp(16, 44) + 1;
    // Shapes of the cloth at heights, then every column measured off along them: cloth that is drawn aside comes up.
    let levels = 2 * nv;
    let mut rows = Vec::with_capacity(levels + 1);
    for level in 0..=levels {
        let down = level as f64 / levels as f64;
        let y = h * (1.0 - down * 1.02);
        rows.push((y, shape(spec, &folds, nu, down)));
    }
    let mut points = vec![DVec3::ZERO; nu * nv];
    let mut flat = vec![DVec2::ZERO; nu * nv];
    for i in 0..nu {
        let column: Vec<DVec3> = rows.iter().map(|(y, row)| DVec3::new(row[i].x, *y, row[i].y)).collect();
        let lengths = super::grid::lengths(&column);
        for j in 0..nv {
            let s = h * j as f64 / (nv - 1) as f64;
            let (mut p, _) = super::grid::along(&column, &lengths, s);
            if spec.tie == 0.0 {
                // Free cloth: the hem is level but for a few millimetres.
                p.y = h - s + 0.004 * noise1(i as f64 / nu as f64 * folds.count, spec.seed ^ 0x21) * s / h;
            }
            points[j * nu + i] = p;
            flat[j * nu + i] = DVec2::new(folds.cloth * i as f64 / (nu - 1) as f64, s);
        }
    }
    let middle = Middle { points, flat, nu, nv };
    // The grid is fine along the rows already: more rows only.
    let tall = middle.divided();
    let hem = h - 0.07_f64.min(h * 0.1);
    let head = 0.05_f64.min(h * 0.05);
    let flat = tall.flat.clone();
    let mut piece = tall.thickened(|i, j| {
        let f = flat[j * tall.nu + i];
        // Turned-over cloth at the hem, the heading and the sides is thicker, with a line where it ends.
        let doubled = smoothstep(hem - 0.006, hem + 0.004, f.y)
            .max(1.0 - smoothstep(head - 0.004, head + 0.006, f.y))
            .max(1.0 - smoothstep(0.015, 0.025, f.x.min(folds.cloth - f.x)));
        THICK / 2.0 * (1.0 + 0.9 * doubled)
    });
    let fittings = if spec.top == HangTop::Rings { rings(&folds, &tall) } else { Piece::default() };
    if spec.tie > 0.0 {
        band(spec, &tall, &mut piece);
    }
    Cloth { piece, hems: tall.hems(), fittings }
}

/// Width of the cloth and its shape at a level: points (x, z).
fn shape(spec: &HangSpec, folds: &Folds, nu: usize, down: f64) -> Vec<DVec2> {
    let [w, h] = spec.size;
    let sway = DVec2::new(
        0.012 * noise1(down * 1.4, spec.seed ^ 0x31),
        0.020 * smoothstep(0.1, 1.0, down) * noise1(down * 1.7 + 9.0, spec.seed ^ 0x33),
    );
    if spec.tie == 0.0 {
        // Free folds spread a little towards the hem.
        let width = w * (1.0 - 0.03 * smoothstep(0.0, 0.25, down) + 0.04 * smoothstep(0.3, 1.0, down));
        let width = width.min(folds.cloth * 0.995);
        let row = folds.row(nu, width, down);
        return row.iter().map(|p| DVec2::new(p.x - width / 2.0, p.y) + sway * down.min(0.5)).collect();
    }
    let tied = 1.0 - spec.tie;
    let bundle = (0.26 * w).clamp(0.08, 0.22);
    let below = (0.5 * w).max(bundle);
    // From the full width in a sweep to the bundle, then wider again.
    let width = if down < tied {
        let t = down / tied;
        bundle + (w - bundle) * (1.0 - t * t * (1.6 - 0.6 * t))
    } else {
        bundle + (below - bundle) * smoothstep(0.0, 1.0, (down - tied) / (1.0 - tied).max(0.05)).sqrt() * 0.85
    };
    let row = folds.row(nu, width.min(folds.cloth * 0.995), down);
    // Deep folds are pressed together in the band.
    let near = libm::exp(-((down - tied) * h / 0.16).powi(2));
    let deepest = row.iter().map(|p| p.y.abs()).fold(1e-9, f64::max);
    let flatten = 1.0 + ((0.07 / deepest).min(1.0) - 1.0) * near;
    row.iter().map(|p| DVec2::new(p.x - w / 2.0, p.y * flatten) + sway * down.min(0.5)).collect()
}

/// The band of a tie-back around the bundle.
fn band(spec: &HangSpec, cloth: &Middle, piece: &mut Piece) {
    let [_, h] = spec.size;
    let y = spec.tie * h;
    let near: Vec<DVec3> = cloth.points.iter().filter(|p| (p.y - y).abs() < 0.04).copied().collect();
    let Some(first) = near.first() else { return };
    let (lo, hi) = near.iter().fold((*first, *first), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
    let (mid, half) = ((lo + hi) / 2.0, (hi - lo) / 2.0 + DVec3::splat(0.006));
    for k in 0..3 {
        let ring: Vec<DVec3> = (0..28)
            .map(|i| {
                let (s, c) = libm::sincos(TAU * f64::from(i) / 28.0);
                let rise = 0.25 * (c * half.x).min(0.05) + 0.012 * f64::from(k - 1);
                DVec3::new(mid.x + half.x * c, y + rise, mid.z + half.z * s)
            })
            .collect();
        tube(piece, &ring, &[0.008], 8, true);
    }
}

/// Rings above the front of every fold.
fn rings(folds: &Folds, cloth: &Middle) -> Piece {
    let mut piece = Piece { closed: true, ..Piece::default() };
    let n = cloth.nu;
    for k in 0..folds.count as usize {
        let s = f64::midpoint(folds.starts[k], folds.starts[k + 1]);
        let at = cloth.points[((s * (n - 1) as f64) as usize).min(n - 1)];
        let r = 0.017;
        let ring: Vec<DVec3> = (0..20)
            .map(|i| {
                let (sin, cos) = libm::sincos(TAU * f64::from(i) / 20.0 + PI / 2.0);
                DVec3::new(at.x, at.y + r * (1.0 + sin) - 0.004, r * cos)
            })
            .collect();
        tube(&mut piece, &ring, &[0.0022], 6, true);
    }
    piece
}

#[cfg(test)]
mod tests {
    use super::super::grid::testing::sound;
    use super::*;

    fn spec(top: HangTop) -> HangSpec {
        HangSpec { size: [1.4, 2.4], folds: 10, gather: 1.9, top, tie: 0.0, seed: 3 }
    }

    #[test]
    fn curtains_fill_their_place_and_rows_keep_their_length() {
        for top in [HangTop::Rings, HangTop::Pleats, HangTop::Rod] {
            let cloth = hang(&spec(top));
            sound(&cloth.piece);
            let (lo, hi) = cloth.piece.bounds().unwrap();
            assert!((hi.y - 2.4).abs() < 0.01 && lo.y.abs() < 0.02, "{top:?}: {lo} {hi}");
            assert!((hi.x - lo.x - 1.4).abs() < 0.1, "{top:?}: {lo} {hi}");
            assert!(hi.z - lo.z > 0.05 && hi.z - lo.z < 0.4, "{top:?}: folds {lo} {hi}");
            let whole = |edge: &[DVec3]| edge.windows(2).map(|w| w[0].distance(w[1])).sum::<f64>();
            assert!((whole(&cloth.hems.foot) / (1.4 * 1.9) - 1.0).abs() < 0.06, "{}", whole(&cloth.hems.foot));
            assert!((cloth.hems.left[0].y - 2.4).abs() < 0.01 && cloth.hems.left[0].x < -0.6);
        }
        assert!(hang(&spec(HangTop::Rings)).fittings.triangles.len() > 100);
    }

    #[test]
    fn a_tied_curtain_is_narrow_at_the_band_and_its_free_side_comes_up() {
        let cloth = hang(&HangSpec { tie: 0.4, ..spec(HangTop::Pleats) });
        sound(&cloth.piece);
        let span = |y: f64| {
            let near = cloth.piece.positions.iter().filter(|p| (p.y - y).abs() < 0.05);
            let (lo, hi) = near.fold((f64::MAX, f64::MIN), |(lo, hi), p| (lo.min(p.x), hi.max(p.x)));
            hi - lo
        };
        assert!(span(0.96) < 0.5 && span(2.3) > 1.3, "{} {}", span(0.96), span(2.3));
        let (left, right) = (cloth.hems.left.last().unwrap(), cloth.hems.right.last().unwrap());
        assert!(right.y > left.y + 0.05, "{left} {right}");
    }
}
