//! From light to a picture: exposure, a soft shoulder, sensor noise.

use glam::Vec3;
use harmony_render::Frame;
use image::RgbImage;
use rayon::prelude::*;

use super::dice::{Dice, hash_unit};
use super::light::Point;

/// What turns light into a picture's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Exposure {
    /// Factor of linear light.
    gain: f32,
    /// Red up and blue down by this share.
    warmth: f32,
}

fn decode(c: u8) -> f32 {
    let v = f32::from(c) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn encode(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Exposure, a soft shoulder and sensor noise; `like` exposes as another picture was.
pub(super) fn develop(
    dice: &mut Dice,
    frame: &Frame,
    points: &[Point],
    lit: &[Vec3],
    like: Option<Exposure>,
) -> (RgbImage, Exposure) {
    let table: Vec<f32> = (0..=255).map(decode).collect();
    let albedo = |i: usize| {
        let p = &frame.color.as_raw()[i * 4..i * 4 + 3];
        Vec3::new(table[usize::from(p[0])], table[usize::from(p[1])], table[usize::from(p[2])])
    };
    let mut bright: Vec<f32> = (0..points.len())
        .step_by(7)
        .filter(|i| !points[*i].glows)
        .map(|i| (albedo(i) * lit[i]).dot(Vec3::new(0.21, 0.72, 0.07)))
        .collect();
    bright.sort_by(f32::total_cmp);
    let middle = bright.get(bright.len() * 55 / 100).copied().unwrap_or(0.2).max(1e-3);
    let high = bright.get(bright.len() * 97 / 100).copied().unwrap_or(1.0).max(1e-3);
    let own = Exposure { gain: (dice.f(0.2, 0.27) / middle).min(1.6 / high), warmth: dice.f(-0.04, 0.06) };
    let Exposure { gain: exposure, warmth } = like.unwrap_or(own);
    let (noise, seed) = (dice.f(0.004, 0.011), dice.number());
    let width = frame.size.width;
    let mut out = RgbImage::new(width, frame.size.height);
    out.as_mut().par_chunks_mut(3 * width as usize).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let i = y * width as usize + x;
            let glow = if points[i].glows { Vec3::splat(points[i].gleam / exposure.max(0.01)) } else { lit[i] };
            let c = albedo(i) * glow * exposure * Vec3::new(1.0 + warmth, 1.0, 1.0 - warmth);
            for (k, v) in pixel.iter_mut().enumerate() {
                let (x, y) = (x as u32, y as u32);
                let bell = (0..3).map(|n| hash_unit(x, y, seed ^ (k as u32 * 3 + n + 1))).sum::<f32>() - 1.5;
                // A shoulder that leaves dark and middle tones as they are.
                let c = c[k].max(0.0);
                let toned = if c > 0.6 { 0.6 + 0.4 * (1.0 - (-(c - 0.6) / 0.4).exp()) } else { c };
                *v = ((encode(toned) + bell * 2.0 * noise) * 255.0 + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
    });
    (out, Exposure { gain: exposure, warmth })
}
