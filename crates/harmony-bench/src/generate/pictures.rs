//! Larger procedural pictures: floors, walls, rugs, paintings and the view from a window.

use image::RgbaImage;

use super::dice::{Dice, hash_unit};
use super::paint::{Palette, Rgb, draw, noise, scaled, shade};

/// A floor of `w` by `d` metres.
pub(super) fn floor(dice: &mut Dice, palette: &Palette, w: f32, d: f32, wet: bool) -> RgbaImage {
    let seed = dice.number();
    let size = |m: f32| ((m * 130.0) as u32).clamp(64, 1024);
    let kind = if wet { dice.int(5, 6) } else { dice.int(0, 7) };
    let color = match kind {
        0..=4 => scaled(palette.wood(dice), dice.f(0.85, 1.1)),
        5 | 6 => palette.glaze(dice).map(|c| 120 + c / 2),
        _ => palette.fabric(dice),
    };
    let (across, along) = (dice.f(0.09, 0.2), dice.f(0.7, 1.8));
    let tile = dice.f(0.22, 0.6);
    let turned = dice.chance(0.5);
    let checker = dice.chance(0.35);
    draw(size(w), size(d), |u, v| {
        let (x, z) = (u * w, v * d);
        match kind {
            0..=4 => {
                let (p, q) = if turned { (z, x) } else { (x, z) };
                let row = (p / across) as u32;
                let shifted = q + along * hash_unit(row, 7, seed);
                let plank = hash_unit(row, (shifted / along) as u32, seed);
                let joint = (p / across).fract() < 0.025 || (shifted / along).fract() < 0.004;
                let grain = noise(q * 0.5 + plank, p * 2.0, 6, 48, seed);
                shade(color, if joint { 0.6 } else { 0.78 + 0.22 * plank + 0.16 * grain })
            }
            5 | 6 => {
                let (i, j) = ((x / tile) as u32, (z / tile) as u32);
                let joint = (x / tile).fract() < 0.02 || (z / tile).fract() < 0.02;
                let dark = checker && (i + j) % 2 == 0;
                let k = if joint { 0.72 } else { 0.95 + 0.05 * hash_unit(i, j, seed) };
                shade(color, if dark && !joint { k * 0.6 } else { k } + 0.06 * noise(u, v, 40, 40, seed) - 0.03)
            }
            _ => {
                let fine = hash_unit((u * 4000.0) as u32, (v * 4000.0) as u32, seed);
                shade(color, 0.8 + 0.18 * fine + 0.1 * noise(u, v, 30, 30, seed))
            }
        }
    })
}

/// A wall of `w` by `h` metres: paint, sometimes stripes, a dado or tiles.
pub(super) fn wall(seed: u32, color: Rgb, style: usize, w: f32, h: f32) -> RgbaImage {
    let size = |m: f32| ((m * 140.0) as u32).clamp(64, 960);
    draw(size(w), size(h), |u, v| {
        let (x, y) = (u * w, (1.0 - v) * h);
        let rough =
            0.97 + 0.03 * hash_unit((u * 900.0) as u32, (v * 900.0) as u32, seed) + 0.02 * noise(u, v, 9, 6, seed);
        let k = match style {
            1 if ((x / 0.18) as u32).is_multiple_of(2) => 0.93,
            2 if y < 0.95 => {
                if y > 0.9 || (x / 0.6).fract() < 0.03 {
                    1.12
                } else {
                    0.82
                }
            }
            3 if y < 1.6 && (x.rem_euclid(0.2) < 0.012 || y.rem_euclid(0.2) < 0.012) => 0.84,
            4 => 0.97 + 0.03 * noise(x * 0.5, y * 0.5, 23, 23, seed ^ 3) + 0.03 * noise(x, y, 90, 90, seed ^ 5),
            _ => 1.0,
        };
        shade(color, rough * k)
    })
}

/// A rug's pattern.
pub(super) fn rug(dice: &mut Dice, palette: &Palette) -> RgbaImage {
    let seed = dice.number();
    let [a, b, c] = [palette.fabric(dice), palette.fabric(dice), palette.fabric(dice)];
    let (kind, n) = (dice.int(0, 4), dice.f(4.0, 10.0));
    draw(256, 256, |u, v| {
        let (x, y) = (u - 0.5, v - 0.5);
        let edge = x.abs().max(y.abs());
        let base = match kind {
            _ if edge > 0.47 => b,
            0 => [a, b, c][(u * n) as usize % 3],
            1 => [a, b][((u * n) as usize + (v * n) as usize) % 2],
            2 if (x.abs() + y.abs()) * n % 1.0 < 0.4 => c,
            3 if edge > 0.38 && edge < 0.42 => c,
            4 if ((u * n).fract() - 0.5).hypot((v * n).fract() - 0.5) < 0.3 => c,
            _ => a,
        };
        shade(base, 0.85 + 0.2 * hash_unit((u * 512.0) as u32, (v * 512.0) as u32, seed))
    })
}

/// What hangs in a frame: hills, blocks of colour, a sun, waves.
pub(super) fn painting(dice: &mut Dice, palette: &Palette) -> RgbaImage {
    let seed = dice.number();
    let colors = [palette.glaze(dice), palette.fabric(dice), palette.glaze(dice), palette.fabric(dice)];
    let kind = dice.int(0, 3);
    let margin = if dice.chance(0.5) { 0.1 } else { 0.0 };
    draw(160, 160, |u, v| {
        if u.min(v).min(1.0 - u).min(1.0 - v) < margin {
            return [240, 238, 230];
        }
        let base = match kind {
            0 => {
                let ridge = |k: u32| 0.25 + 0.2 * k as f32 + 0.25 * (noise(u * 0.7, 0.3, 5, 2, seed ^ k) - 0.5);
                (1..4).rev().find(|k| v > ridge(*k)).map_or([186, 206, 222], |k| colors[k as usize])
            }
            1 => colors[hash_unit((u * 3.0) as u32, (v * 4.0) as u32, seed).mul_add(3.99, 0.0) as usize],
            2 if (u - 0.45).hypot(v - 0.42) < 0.22 => colors[1],
            2 => colors[usize::from(v > 0.66) * 2],
            _ => colors[((v + 0.12 * (u * 9.0).sin()) * 6.0) as usize % 4],
        };
        shade(base, 0.9 + 0.15 * noise(u, v, 20, 20, seed))
    })
}

/// Sky, trees and a lawn, as bright as the day.
pub(super) fn view(dice: &mut Dice) -> RgbaImage {
    let seed = dice.number();
    let (horizon, tint) = (dice.f(0.45, 0.8), dice.f(0.0, 1.0));
    let houses = dice.chance(0.4);
    draw(200, 200, |u, v| {
        let tree = horizon - 0.32 * noise(u, 0.1, 6, 2, seed) + 0.05 * noise(u, 0.6, 30, 3, seed);
        if v < tree && houses && v > horizon - 0.12 - 0.25 * hash_unit((u * 5.0) as u32, 1, seed) {
            let window = (u * 40.0).fract() < 0.4 && (v * 30.0).fract() < 0.5;
            return if window { [126, 138, 150] } else { [206, 196, 186] };
        }
        if v < tree {
            let k = 1.0 - 0.12 * (1.0 - v) - 0.1 * noise(u, v, 5, 8, seed ^ 5);
            return shade([222, 236, 250], k + 0.06 * tint);
        }
        if v < horizon {
            return shade([128, 152, 112], 0.75 + 0.4 * noise(u, v, 26, 26, seed));
        }
        shade([164, 182, 132], 0.9 + 0.2 * noise(u, v, 12, 12, seed))
    })
}
