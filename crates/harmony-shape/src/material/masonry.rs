//! Tiles and bricks.

use super::Pattern;
use super::noise::{Cells, Noise, gauss, lerp, smooth, unit};
use super::pieces::{self, Layout};
use super::plan::{Palette, amount, has_joint_color, length, masonry_joint, tone_sigma, width};
use super::space::{Paint, Sample, Space, mix, times, tinted};

fn layout(space: &Space, p: &Pattern) -> Layout {
    let (w, l) = (width(p), length(p));
    match p.variant.as_str() {
        "running" | "metro" => pieces::rows(space, w, l, 0.5),
        "third" => pieces::rows(space, w, l, 1.0 / 3.0),
        "diagonal" => pieces::diagonal(space, w),
        "hex" => pieces::hexagons(space, w),
        _ => pieces::rows(space, w, l, 0.0),
    }
}

/// Ceramic or stone tiles; `amount`: mottling of stone.
pub(super) fn tiles(space: &Space, p: &Pattern) -> Paint {
    let layout = layout(space, p);
    let palette = Palette::of(p, space, has_joint_color(p), |c| {
        // Grout: towards a middle grey, darker than a light tile and lighter than a dark one.
        mix(times(c, 0.72), [0.20, 0.19, 0.18], 0.45)
    });
    let checker = p.variant == "checkerboard";
    let (joint, sigma, stone) = (masonry_joint(p), tone_sigma(p, 0.10), amount(p, 0.12));
    let (mottle, fine) = (Noise::free(space, [0.16, 0.11], 41), Noise::free(space, [0.012, 0.012], 42));
    let wave = Noise::free(space, [0.06, 0.06], 43);
    let grout = Noise::periodic(space, [0.006, 0.006], 44);
    let dirt = Noise::periodic(space, [0.25, 0.25], 45);
    let px = space.px;
    let space = *space;
    let edge_round = (0.05 * width(p).min(length(p))).clamp(0.0012, 0.004).max(px);
    Box::new(move |u, v| {
        let piece = layout(u, v);
        let id = piece.id;
        let base = if checker {
            palette.main[(piece.parity.rem_euclid(2) as usize).min(palette.main.len() - 1)]
        } else {
            palette.pick(id)
        };
        let base = if checker && palette.main.len() == 1 && piece.parity.rem_euclid(2) == 1 {
            times(base, 0.25)
        } else {
            base
        };
        let (gx, gy) = (piece.x + 300.0 * unit(id, 1), piece.y + 300.0 * unit(id, 2));
        let cloud = mottle.fbm(gx, gy, 4);
        let speck = fine.at(gx, gy);
        let tone = libm::exp(sigma * gauss(id, 6) + stone * (0.45 * cloud + 0.12 * speck) + 0.012 * speck);
        let d = piece.edge - joint / 2.0;
        let body = space.inside(-d);
        // Edges of a glazed tile are a little worn and lighter or darker than its face.
        let rim = 1.0 - 0.06 * (1.0 - smooth(0.0, edge_round, d));
        let g = grout.fbm(u, v, 2);
        let soiled = 1.0 - 0.18 * smooth(0.0, 0.8, dirt.fbm(u, v, 2)) - 0.10 * g;
        let tilt = gauss(id, 7) * piece.x + gauss(id, 8) * piece.y;
        let face =
            -0.35 * (1.0 - smooth(0.0, edge_round, d)) + 0.035 * wave.at(gx, gy) + 1.2 * tilt + 0.02 * stone * cloud;
        let bed = -1.0 + 0.08 * g;
        let face_rough = 0.03 * gauss(id, 9) + 0.10 * stone * cloud;
        Sample {
            height: lerp(bed, face, smooth(-px.max(0.001), px.max(0.001), d)),
            color: mix(times(palette.joint, soiled), times(base, tone * rim), body),
            rough: lerp(0.35, face_rough, body),
            cover: 1.0,
            id,
        }
    })
}

/// Bricks; `amount`: wear of their edges; variant `painted` (with a bond: `painted flemish`): a film of paint over all.
pub(super) fn brick(space: &Space, p: &Pattern) -> Paint {
    let (w, h) = (width(p), length(p));
    let painted = p.variant.contains("painted");
    let bond = p.variant.replace("painted", "");
    let layout = match bond.trim() {
        "stack" => pieces::rows(space, w, h, 0.0),
        "third" => pieces::rows(space, w, h, 1.0 / 3.0),
        "flemish" => pieces::bonded(space, w, h, true),
        "english" => pieces::bonded(space, w, h, false),
        _ => pieces::rows(space, w, h, 0.5),
    };
    let palette = Palette::of(p, space, has_joint_color(p) && !painted, |c| {
        if painted { times(c, 0.90) } else { mix([0.42, 0.39, 0.34], c, 0.18) }
    });
    let (joint, wear) = (masonry_joint(p), amount(p, 0.5));
    let usual = tone_sigma(&Pattern { tone: 0.0, ..p.clone() }, 0.42);
    let sigma = if painted { 0.25 } else { 1.0 } * tone_sigma(p, 0.42);
    let chip = Noise::free(space, [0.022, 0.022], 51);
    let grain = Noise::free(space, [0.006, 0.006], 52);
    let cloud = Noise::free(space, [0.09, 0.05], 53);
    let mortar = Noise::periodic(space, [0.005, 0.005], 54);
    let soot = Noise::periodic(space, [0.5, 0.4], 55);
    let pits = Cells::new(space, [0.014, 0.014], 1.0, 56);
    let px = space.px;
    let depth = if painted { 1.6 } else { 4.0 };
    Box::new(move |u, v| {
        let piece = layout(u, v);
        let id = piece.id;
        let (gx, gy) = (piece.x + 300.0 * unit(id, 1), piece.y + 300.0 * unit(id, 2));
        // Each brick a little smaller, shifted and turned in its bed; a rounded rectangle, gnawed by noise.
        let shy = [0.0015 * unit(id, 3), 0.0012 * unit(id, 4)];
        let (x, y) = (piece.x + 0.0011 * gauss(id, 5), piece.y + 0.0008 * gauss(id, 6));
        let (x, y) = (x + 0.006 * gauss(id, 7) * y, y - 0.006 * gauss(id, 7) * x);
        let r = 0.004 + 0.003 * unit(id, 8);
        let qx = x.abs() - (piece.half[0] - joint / 2.0 - shy[0]) + r;
        let qy = y.abs() - (piece.half[1] - joint / 2.0 - shy[1]) + r;
        let d = f64::hypot(qx.max(0.0), qy.max(0.0)) + qx.max(qy).min(0.0) - r;
        let bite = chip.fbm(gx, gy, 3);
        let d = d + wear * (0.0022 * bite + 0.004 * smooth(0.55, 1.0, bite));
        let body = smooth(0.5 * px.max(0.0018), -0.5 * px.max(0.0018), d);
        let hole = pits.at(u, v);
        let pit = if unit(hole.id, 3) < 0.22 { smooth(0.20, 0.05, hole.d1) } else { 0.0 };
        let fine = grain.fbm(gx, gy, 2);
        let g = mortar.fbm(u, v, 3);
        let dark = soot.fbm(u, v, 3);
        // Some bricks are burnt darker and bluer; under paint nobody sees it, nor where all are of one tone.
        let burnt = if painted { 0.0 } else { smooth(0.88, 0.97, unit(id, 9)) * 0.45 * (sigma / usual).min(1.0) };
        let tone = libm::exp(sigma * gauss(id, 10) + 0.10 * cloud.fbm(gx, gy, 3) + 0.09 * fine - 0.35 * pit - burnt);
        let hue = sigma * gauss(id, 11);
        let face = tinted(times(palette.pick(id), tone), [1.0 + 0.15 * hue, 1.0, 1.0 - 0.12 * hue + 0.3 * burnt]);
        let bed = times(palette.joint, 1.0 + 0.13 * g);
        let all = libm::exp(-0.10 * dark);
        let soft: f64 = if painted { 0.006 } else { 0.0035 };
        let shoulder = smooth(px.max(0.001), -soft.max(1.5 * px), d);
        let relief = 0.30 * fine - 0.9 * pit + 0.35 * cloud.at(gx, gy) + 0.8 * gauss(id, 12);
        let tilt = 6.0 * (gauss(id, 13) * y + 0.4 * gauss(id, 14) * x);
        let film = if painted { 0.45 } else { 1.0 };
        Sample {
            height: lerp(-depth + 0.5 * g * film, (relief + tilt) * film, shoulder),
            color: times(mix(bed, face, body), all),
            rough: film * (0.05 * fine + lerp(0.10, 0.03 * gauss(id, 15), body)),
            cover: 1.0,
            id,
        }
    })
}
