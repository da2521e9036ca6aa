//! Patterned slots go on by mirror images, where these are known to agree.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::base::Base;
use super::texels::Texel;
use super::view::View;

/// Reflections that are tried in turn for a point that is not seen itself.
const MIRRORS: [[f32; 3]; 3] = [[-1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]];
/// Standard deviation about its material from which a slot has a pattern, sRGB steps.
const PATTERN: f32 = 9.0;
/// Texels seen on both sides of a plane from which their agreement can be told.
const FEWEST: usize = 60;
/// Largest root mean square difference of such, as a share of what unrelated texels differ by.
const AGREE: f32 = 0.45;
/// One texel in so many is asked.
const STRIDE: usize = 5;
/// Most that a mirrored colour counts.
const SHARE: f32 = 0.9;
/// A texel with less than this share of its own is completed.
const OWN: f32 = 0.3;
/// Difference of a mirrored colour from what the surroundings let expect at which it counts no more, in standard deviations.
const UNEXPECTED: f32 = 3.0;

/// Completes texels that are hardly seen; those of the `done` charts are left alone.
pub(super) fn complete(texels: &mut [Texel], made_up: &[[f32; 3]], bases: &[Base], done: &BTreeSet<u32>, view: &View) {
    let trusted: Vec<(f32, Vec<[f32; 3]>)> = (0..bases.len())
        .map(|slot| {
            let spread = spread(texels, slot, &bases[slot]);
            let agree = |m: &[f32; 3]| agrees(texels, slot, *m, spread, view);
            let mirrors = if spread < PATTERN { Vec::new() } else { MIRRORS.into_iter().filter(agree).collect() };
            (spread, mirrors)
        })
        .collect();
    texels.par_iter_mut().zip(made_up).for_each(|(texel, expected)| {
        let (spread, mirrors) = &trusted[texel.slot];
        if texel.share >= OWN || done.contains(&texel.chart) {
            return;
        }
        let sight = mirrors.iter().find_map(|m| view.color(texel, *m));
        let Some(sight) = sight else { return };
        let off = (0..3).map(|k| (sight.color[k] - expected[k]).powi(2)).sum::<f32>() / 3.0;
        let share = SHARE * sight.share * (1.0 - (off.sqrt() / (UNEXPECTED * spread.max(PATTERN))).powi(2)).max(0.0);
        if share > texel.share {
            (texel.color, texel.share, texel.direct) = (Some(sight.color), share, false);
        }
    });
}

/// Standard deviation of what is seen of a slot about its material.
fn spread(texels: &[Texel], slot: usize, base: &Base) -> f32 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for texel in texels.iter().filter(|t| t.slot == slot && t.direct).step_by(STRIDE) {
        let (Some(color), own) = (texel.color, base.at(texel)) else { continue };
        sum += texel.share * (0..3).map(|k| (color[k] - own[k]).powi(2)).sum::<f32>() / 3.0;
        weight += texel.share;
    }
    if weight > 0.0 { (sum / weight).sqrt() } else { 0.0 }
}

/// Whether what is seen on both sides of a mirror is alike.
fn agrees(texels: &[Texel], slot: usize, mirror: [f32; 3], spread: f32, view: &View) -> bool {
    let (mut sum, mut count) = (0.0, 0_usize);
    for texel in texels.iter().filter(|t| t.slot == slot && t.direct && t.share > 0.5).step_by(STRIDE) {
        // Points near the plane are their own mirror images.
        let moved = (0..3).map(|k| ((1.0 - mirror[k]) * texel.point[k]).abs()).fold(0.0, f32::max);
        if moved < 4.0 * texel.steps[0].length().max(texel.steps[1].length()) {
            continue;
        }
        let (Some(color), Some(sight)) = (texel.color, view.color(texel, mirror)) else { continue };
        if sight.share > 0.3 {
            sum += (0..3).map(|k| (color[k] - sight.color[k]).powi(2)).sum::<f32>() / 3.0;
            count += 1;
        }
    }
    // Unrelated ones differ by the root of two standard deviations.
    count >= FEWEST && (sum / count as f32).sqrt() < AGREE * std::f32::consts::SQRT_2 * spread
}
