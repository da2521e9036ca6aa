//! Boards: planks, parquet, wood.

use super::noise::{Noise, gauss, hash, lerp, smooth, unit};
use super::pieces::{self, Layout};
use super::plan::{Palette, amount, joint, length, tone_sigma, width};
use super::space::{Paint, Rgb, Sample, Space, mix, times, tinted};
use super::{Pattern, PatternKind};

/// Late wood against early wood, linear.
const LATE: Rgb = [0.60, 0.50, 0.40];
/// Grooves between boards against the boards.
const GROOVE: Rgb = [0.22, 0.19, 0.17];

/// Wood within a piece: x along the grain.
pub(super) struct Grain {
    warp: Noise,
    bend: Noise,
    fibre: Noise,
    pore: Noise,
    mottle: Noise,
    px: f64,
    fibre_shows: f64,
}

/// What the grain is at a place.
pub(super) struct Fibre {
    /// Colour factor.
    pub color: Rgb,
    /// Millimetres.
    pub height: f64,
    /// Roughness added.
    pub rough: f64,
}

impl Grain {
    pub(super) fn new(space: &Space) -> Self {
        // Fibres are drawn as fine as texels allow.
        let thin = (0.0012_f64).max(1.6 * space.px);
        Self {
            warp: Noise::free(space, [0.9, 0.5], 21),
            bend: Noise::free(space, [0.22, 0.025], 22),
            fibre: Noise::free(space, [0.05, thin], 23),
            pore: Noise::free(space, [0.014, thin * 0.9], 24),
            mottle: Noise::free(space, [0.45, 0.05], 25),
            px: space.px,
            fibre_shows: space.shows(0.0035).max(0.55),
        }
    }

    /// The cut of a log by the board's face: rings about a pith below it, so that the lines close to arches.
    pub(super) fn at(&self, id: u64, x: f64, y: f64, strength: f64) -> Fibre {
        let (ox, oy) = (unit(id, 1) * 400.0, unit(id, 2) * 400.0);
        let (gx, gy) = (x + ox, y + oy);
        let pith = (unit(id, 3) - 0.5) * 0.16;
        let depth = 0.012 + 0.10 * unit(id, 4) * unit(id, 4) + 0.035 * self.warp.at(gx, oy);
        let ring = 0.0050 + 0.0050 * unit(id, 5);
        let r = f64::hypot(y - pith + 0.012 * self.warp.at(gx, oy + 9.3), depth) + 0.0022 * self.bend.fbm(gx, gy, 2);
        let phase = (r / ring).fract();
        // Growth: slowly darker, suddenly light again.
        let late = phase * phase * phase * smooth(1.0, 0.86, phase) * 1.6;
        let shown = smooth(1.5, 3.5, ring / self.px);
        let year = 0.5 + 0.5 * gauss(hash(id, (r / ring).floor() as i64, 3), 1).clamp(-1.0, 1.0);
        let late = lerp(0.35, late * year * 1.25, shown);
        let fibre = self.fibre.fbm(gx, gy, 2) * self.fibre_shows;
        let pore = smooth(0.45, 0.75, self.pore.at(gx, gy)) * self.fibre_shows;
        let mottle = self.mottle.fbm(gx, gy, 2);
        let light = libm::exp(strength * (0.13 * mottle + 0.16 * fibre - 0.30 * pore));
        let dark = mix([1.0; 3], LATE, (late * strength * 1.1).min(1.0));
        Fibre {
            color: times(dark, light),
            height: -0.05 * strength * pore + 0.02 * fibre - 0.03 * late * strength,
            rough: 0.06 * late + 0.05 * pore + 0.03 * mottle,
        }
    }
}

fn boards(space: &Space, p: &Pattern, layout: Layout, default_groove: f64, bevel: f64) -> Paint {
    let palette = Palette::of(p, space, p.joint > 0.0, |c| tinted(c, GROOVE));
    let grain = Grain::new(space);
    // Several named colours say how much boards differ.
    let sigma = tone_sigma(p, if palette.main.len() > 1 { 0.06 } else { 0.30 });
    let strength = amount(p, 0.55);
    let groove = joint(p, default_groove);
    let bevel = bevel.max(space.px);
    let px = space.px;
    Box::new(move |u, v| {
        let piece = layout(u, v);
        let id = piece.id;
        let fibre = grain.at(id, piece.x, piece.y, strength);
        let own = palette.pick(id);
        let face = tinted(tinted(own, fibre.color), in_tone(own, sigma * gauss(id, 6)));
        // The piece's edge is the groove's middle.
        let cover = ((groove / 2.0 + px / 2.0 - piece.edge) / px).clamp(0.0, (groove / px).min(1.0));
        let rim = smooth(0.0, bevel, piece.edge - groove / 2.0);
        let shade = lerp(0.86, 1.0, smooth(0.0, 1.5 * bevel, piece.edge));
        let tilt = (gauss(id, 8) * piece.y / piece.half[1] + 0.3 * gauss(id, 9)) * 0.05;
        Sample {
            height: fibre.height + tilt - 0.45 * (1.0 - rim) - 0.5 * cover,
            color: mix(times(face, shade), palette.joint, cover * 0.85),
            rough: fibre.rough + 0.03 * gauss(id, 10) + 0.25 * cover,
            cover: 1.0,
            id,
        }
    })
}

/// Factors that make wood lighter (`tone` above 0, a logarithm) or darker: a channel that it absorbs more changes more, so
/// that a darker board of brown wood is warmer, and one of grey wood is grey.
fn in_tone(color: Rgb, tone: f64) -> Rgb {
    let absorbed = color.map(|c| -libm::log(c.clamp(0.02, 0.95)));
    let mean = (absorbed[0] + absorbed[1] + absorbed[2]) / 3.0;
    absorbed.map(|a| libm::exp(tone * (a / mean).clamp(0.5, 1.6)))
}

/// Planks along u.
pub(super) fn planks(space: &Space, p: &Pattern) -> Paint {
    let spread = match p.variant.as_str() {
        "even" => 0.0,
        _ => 0.7,
    };
    let layout = match p.variant.as_str() {
        "half" | "brick" | "running" => pieces::rows(space, length(p), width(p), 0.5),
        "third" => pieces::rows(space, length(p), width(p), 1.0 / 3.0),
        "stack" => pieces::rows(space, length(p), width(p), 0.0),
        _ => pieces::planks(space, width(p), length(p), spread),
    };
    boards(space, p, layout, 0.0014, 0.0025)
}

/// How many squares long a block of parquet is.
pub(super) fn block_count(p: &Pattern) -> i64 {
    ((length(p) / width(p)).round() as i64).clamp(2, 12)
}

/// Parquet: herringbone unless told otherwise.
pub(super) fn parquet(space: &Space, p: &Pattern) -> Paint {
    let layout = match p.variant.as_str() {
        "chevron" => pieces::chevron(space, width(p), length(p)),
        "basket" | "mosaic" | "squares" => pieces::basket(space, width(p), block_count(p)),
        _ => pieces::herringbone(space, width(p), block_count(p)),
    };
    boards(space, p, layout, 0.0008, 0.0016)
}

/// Solid or veneered wood, grain along u: leaves of veneer without joints.
pub(super) fn wood(space: &Space, p: &Pattern) -> Paint {
    debug_assert!(p.kind == PatternKind::Wood);
    let palette = Palette::of(p, space, false, |c| c);
    let (rows, leaf) = space.down(width(p), 1);
    let grain = Grain::new(space);
    let strength = amount(p, 0.6);
    let sigma = tone_sigma(p, 0.06);
    let edge = Noise::periodic(space, [0.30, 0.06], 31);
    let along = Noise::periodic(space, [space.w, leaf], 32);
    let (seed, w) = (space.seed, space.w);
    let second = palette.main.get(1).copied();
    Box::new(move |u, v| {
        let vv = v + 0.012 * edge.at(u, v);
        let j = (vv / leaf).floor();
        let row = (j as i64).rem_euclid(rows);
        let id = hash(seed, row, 5);
        // The grain is not periodic along u: two draws are blended where they would meet.
        let t = u.rem_euclid(w);
        let y = vv - (j + 0.5) * leaf;
        let a = grain.at(id, t, y, strength);
        let near = smooth(w * 0.82, w, t);
        let color = if near > 0.0 { mix(a.color, grain.at(id, t - w, y, strength).color, near) } else { a.color };
        let base = second.map_or(palette.main[0], |s| {
            let dark = 1.0 - color[0].clamp(0.0, 1.0);
            mix(palette.main[0], s, (dark * 1.6).clamp(0.0, 1.0))
        });
        let tone = libm::exp(sigma * gauss(id, 6) + 0.04 * along.at(u, v));
        Sample { height: a.height, color: times(tinted(base, color), tone), rough: a.rough, cover: 1.0, id }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_of_grey_wood_differ_in_tone_alone_and_darker_brown_ones_are_warmer() {
        let warmth = |c: Rgb, tone: f64| {
            let [r, _, b] = tinted(c, in_tone(c, tone));
            r / b
        };
        let (grey, brown) = ([0.5; 3], [0.4, 0.22, 0.1]);
        assert!((warmth(grey, -0.4) - warmth(grey, 0.4)).abs() < 1e-9);
        assert!(warmth(brown, -0.4) > 1.3 * warmth(brown, 0.4));
        let [r, ..] = tinted(grey, in_tone(grey, -0.4));
        assert!((r / 0.5 - libm::exp(-0.4)).abs() < 1e-9);
    }
}
