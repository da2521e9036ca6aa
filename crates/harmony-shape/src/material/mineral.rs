//! Stone, plaster and dirt: marble, terrazzo, concrete, plaster, grime.

use super::Pattern;
use super::color::{linear_hex, luminance};
use super::noise::{Cells, Noise, gauss, lerp, smooth, unit};
use super::plan::{Palette, amount, chip_share, tone_sigma, width};
use super::space::{Paint, Rgb, Sample, Space, mix, times};

/// Veins through clouds; colours: ground, veins; `amount`: how many.
pub(super) fn marble(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, p.colors.len() >= 2, |c| {
        if luminance(c) > 0.12 { mix(times(c, 0.30), [0.12, 0.12, 0.13], 0.4) } else { [0.55, 0.53, 0.50] }
    });
    let w = width(p);
    let warp_u = Noise::periodic(space, [w * 0.8; 2], 141);
    let warp_v = Noise::periodic(space, [w * 0.8; 2], 142);
    let cloud = Noise::periodic(space, [w * 0.6, w * 0.35], 143);
    let large = Noise::periodic(space, [w * 0.75, w * 0.5], 144);
    let small = Noise::periodic(space, [w * 0.28, w * 0.2], 145);
    let presence = Noise::periodic(space, [w * 0.5; 2], 146);
    let much = amount(p, 0.5);
    Box::new(move |u, v| {
        let (a, b) = (0.30 * w * warp_u.fbm(u, v, 4), 0.30 * w * warp_v.fbm(u, v, 4));
        let (x, y) = (u + a, v + b);
        let c = cloud.fbm(x, y, 4);
        let there = smooth(-0.5, 0.6, presence.fbm(u, v, 2));
        // Distance from where the noise is zero, in its own measure: lines of uneven width.
        let thick = smooth(0.13, 0.0, large.at(x, y).abs()) * there;
        let thin =
            smooth(0.055, 0.0, small.fbm(x + 0.2 * a, y, 2).abs()) * 0.55 * smooth(-0.2, 0.8, presence.fbm(v, u, 2));
        let halo = smooth(0.45, 0.0, large.at(x, y).abs()) * 0.20 * there;
        let vein = ((thick * thick * 0.75).max(thin) + halo).min(1.0) * (0.35 + 1.1 * much);
        let ground = times(palette.main[0], libm::exp(0.09 * c));
        Sample { rough: 0.05 * vein, ..Sample::flat(mix(ground, palette.joint, vein.min(0.92))) }
    })
}

/// Chips of stone in a matrix; colours: matrix, chips; `amount`: how many chips.
pub(super) fn terrazzo(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let matrix = palette.main[0];
    let chips: Vec<Rgb> = if palette.main.len() > 1 {
        palette.main[1..].to_vec()
    } else {
        vec![
            times(matrix, 0.45),
            mix(times(matrix, 0.65), [0.30, 0.17, 0.10], 0.45),
            mix(matrix, [0.9; 3], 0.65),
            times(matrix, 0.16),
        ]
    };
    let w = width(p);
    let share = chip_share(p);
    let warp = Noise::periodic(space, [w * 0.5; 2], 151);
    let grains = [
        (Cells::new(space, [w; 2], 1.0, 152), 0.55 * share, 0.10),
        (Cells::new(space, [w * 0.5; 2], 1.0, 153), 0.60 * share, 0.12),
        (Cells::new(space, [w * 0.22; 2], 1.0, 154), 0.55 * share, 0.16),
    ];
    let within = Noise::periodic(space, [w * 0.25; 2], 155);
    let dust = Noise::periodic(space, [(0.0012_f64).max(1.7 * space.px); 2], 156);
    let sigma = tone_sigma(p, 0.35);
    let px = space.px;
    Box::new(move |u, v| {
        let (x, y) = (u + 0.10 * w * warp.at(u, v), v + 0.10 * w * warp.at(v + w, u));
        let mut color = times(matrix, 1.0 + 0.05 * dust.fbm(u, v, 2));
        let (mut id, mut on) = (0, 0.0);
        for (k, (cells, part, gap)) in grains.iter().enumerate() {
            let n = cells.at(x, y);
            if unit(n.id, 1) >= *part {
                continue;
            }
            let size = w * [1.0, 0.5, 0.22][k];
            // Cut faces of a Voronoi cell, shrunk by a gap that differs from chip to chip.
            let d = (gap * (0.5 + 2.0 * unit(n.id, 2)) - (n.d2 - n.d1) * 0.5) * size;
            let share = (0.5 - d / px).clamp(0.0, 1.0);
            if share > 0.0 {
                let chip = chips[((unit(n.id, 3) * chips.len() as f64) as usize).min(chips.len() - 1)];
                let tone = libm::exp(sigma * 0.7 * gauss(n.id, 4) + 0.08 * within.fbm(u, v, 2));
                color = mix(color, times(chip, tone), share);
                (id, on) = (n.id, share);
                break;
            }
        }
        Sample { rough: lerp(0.06, -0.03, on), id, ..Sample::flat(color) }
    })
}

/// Cast concrete: clouds, pores, and with `variant = "board"` the marks of boards along u.
pub(super) fn concrete(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let second = palette.main.get(1).copied();
    let w = width(p);
    let (cloud, patch) = (Noise::periodic(space, [w * 0.55; 2], 161), Noise::periodic(space, [w * 0.14; 2], 162));
    let fine = Noise::periodic(space, [0.012; 2], 163);
    let sand = Noise::periodic(space, [(0.003_f64).max(1.7 * space.px); 2], 164);
    let (pores, small) = (Cells::new(space, [0.05; 2], 1.0, 165), Cells::new(space, [0.018; 2], 1.0, 166));
    let much = amount(p, 0.5);
    let board = (p.variant == "board").then(|| space.down(0.12, 1));
    let grain = Noise::periodic(space, [0.35, 0.006], 167);
    let seed = space.seed;
    Box::new(move |u, v| {
        let c = cloud.fbm(u, v, 5);
        let q = patch.fbm(u, v, 4);
        let (f, s) = (fine.fbm(u, v, 2), sand.fbm(u, v, 2));
        let hole = |cells: &Cells, part: f64, most: f64| {
            let n = cells.at(u, v);
            let r = most * (0.3 + 0.7 * unit(n.id, 2));
            if unit(n.id, 1) < part { smooth(r, r * 0.55, n.d1) } else { 0.0 }
        };
        let pit = hole(&pores, 0.35 * much, 0.09).max(hole(&small, 0.20 * much, 0.12));
        let (mut mark, mut step, mut id) = (0.0, 0.0, 0);
        if let Some((n, side)) = board {
            let j = (v / side).floor();
            id = super::noise::hash(seed, (j as i64).rem_euclid(n), 3);
            let d = (v - j * side).min((j + 1.0) * side - v);
            mark = 0.10 * gauss(id, 1) + 0.10 * grain.fbm(u, v, 2) - 0.25 * smooth(0.004, 0.0, d);
            step = 0.5 * gauss(id, 2) + 0.25 * grain.fbm(u, v, 2) + 0.8 * smooth(0.003, 0.0, d);
        }
        let base = second.map_or(palette.main[0], |b| mix(palette.main[0], b, smooth(-0.6, 0.6, c)));
        let tone = libm::exp(much * (0.17 * c + 0.13 * q) + 0.035 * f + 0.03 * s - 0.55 * pit + 0.7 * mark);
        Sample {
            height: 0.35 * much * q + 0.10 * f + 0.05 * s - 1.3 * pit + step,
            color: times(base, tone),
            rough: 0.07 * q + 0.10 * pit,
            cover: 1.0,
            id,
        }
    })
}

/// Plaster or painted wall: `amount`: depth of the trowel's strokes; `rough` (roughcast), `stucco`, `smooth`.
pub(super) fn plaster(space: &Space, p: &Pattern) -> Paint {
    let palette = Palette::of(p, space, false, |c| c);
    let second = palette.main.get(1).copied();
    let w = width(p);
    let much = amount(p, 0.35);
    let (wu, wv) = (Noise::periodic(space, [w; 2], 171), Noise::periodic(space, [w; 2], 172));
    let stroke = Noise::periodic(space, [w * 0.55, w * 0.11], 173);
    let cross = Noise::periodic(space, [w * 0.12, w * 0.5], 174);
    let which = Noise::periodic(space, [w * 0.8; 2], 175);
    let cloud = Noise::periodic(space, [w * 1.6; 2], 176);
    let fine = Noise::periodic(space, [(0.004_f64).max(1.7 * space.px); 2], 177);
    let lumps = Cells::new(space, [0.010_f64.max(4.0 * space.px); 2], 1.0, 178);
    let coarse = matches!(p.variant.as_str(), "rough" | "stucco");
    let even = p.variant == "smooth";
    Box::new(move |u, v| {
        let (x, y) = (u + 0.25 * w * wu.fbm(u, v, 3), v + 0.25 * w * wv.fbm(u, v, 3));
        // Strokes this way here and that way there.
        let t = smooth(-0.25, 0.25, which.at(u, v));
        let s = lerp(stroke.fbm(x, y, 4), cross.fbm(x, y, 4), t);
        let ridge = 1.0 - stroke.ridged(x, y, 3);
        let (c, f) = (cloud.fbm(u, v, 3), fine.fbm(u, v, 2));
        let lump = if coarse {
            let n = lumps.at(u, v);
            (1.0 - 1.6 * n.d1 * n.d1).max(0.0).sqrt() * unit(n.id, 1)
        } else {
            0.0
        };
        let work = if even { 0.0 } else { much };
        let base = second.map_or(palette.main[0], |b| mix(palette.main[0], b, smooth(-0.6, 0.6, c + 0.5 * s)));
        let tone =
            libm::exp(work * (0.10 * s + 0.05 * c) + 0.012 * c + 0.012 * f - 0.12 * (0.6 - lump) * f64::from(coarse));
        Sample {
            height: work * (1.1 * s + 0.5 * ridge) + 0.035 * f + 2.0 * lump,
            color: times(base, tone),
            rough: 0.05 * work * s + 0.02 * f,
            cover: 1.0,
            id: 0,
        }
    })
}

/// Dirt over whatever lies below: stains and dust where noise is high; `amount`: how much is covered.
pub(super) fn grime(space: &Space, p: &Pattern) -> Paint {
    let color = p.colors.first().map_or([0.055, 0.045, 0.035], |c| linear_hex(c));
    let w = width(p);
    let (large, small) = (Noise::periodic(space, [w * 0.8; 2], 181), Noise::periodic(space, [w * 0.15; 2], 182));
    let streak = Noise::periodic(space, [w * 0.06, w * 0.9], 183);
    let speck = Noise::periodic(space, [(0.006_f64).max(2.0 * space.px); 2], 184);
    let much = amount(p, 0.3);
    Box::new(move |u, v| {
        let n =
            0.55 * large.fbm(u, v, 5) + 0.30 * small.fbm(u, v, 3) + 0.22 * streak.fbm(u, v, 2) + 0.12 * speck.at(u, v);
        let cover = smooth(0.55 - 0.9 * much, 1.25 - 0.7 * much, n) * (0.35 + 0.6 * much);
        Sample { rough: 0.25, cover, ..Sample::flat(times(color, 1.0 + 0.2 * speck.at(u, v))) }
    })
}
