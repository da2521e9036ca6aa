//! Completion of texels that the photo does not show.

use std::collections::HashMap;

use glam::Vec3;
use harmony_mesh::Mesh;
use rayon::prelude::*;

use super::base::Base;
use super::texels::Texel;

/// Smallest cell of the means, as a share of the object's diagonal.
const FINEST: f32 = 1.0 / 28.0;
/// Levels of means; each has cells twice as large as the one before.
const LEVELS: u8 = 5;
/// Weight of observation at which a mean counts fully.
const ENOUGH: f32 = 2.0;
/// Finest level that is used for slots with a pattern of their own.
const FINEST_OF_TILES: u8 = 2;
/// Share of the other faces' deviation that a face without observations takes.
const AROUND: f32 = 0.4;
/// Largest deviation from the slot's material that light makes, sRGB steps.
const FARTHEST_OFF: f32 = 90.0;
/// Sides of patches of fine texture that are looked for, texels.
const PATCHES: [usize; 5] = [64, 48, 32, 24, 16];
/// Patches of one size that are looked at.
const TRIES: usize = 6;
/// Share from which a texel's fine texture is to be trusted.
const WELL_SEEN: f32 = 0.6;
/// Half width of the window that separates fine texture from shading, texels.
const FINE: usize = 4;
/// Share of the fine texture that is added where colours are made up.
const STRENGTH: f32 = 0.8;
/// Largest deviation that counts as fine texture, sRGB steps.
const LARGEST: f32 = 24.0;
/// A patch with larger root mean square deviations shows things, not a texture; sRGB steps.
const ROUGHEST: f32 = 14.0;
/// A texture's quarters are about equally rough: largest ratio of their deviations.
const UNEVEN: f32 = 1.8;

/// A made-up colour for every texel that is not wholly the photo's: its slot's material, with the light that was observed
/// nearby and the fine texture of what was seen well.
///
/// `has_texture` tells for each slot whether that is to be had: a sliver of a pane's frame or of a picture is none.
pub(super) fn made_up(
    texels: &[Texel],
    mesh: &Mesh,
    bases: &[Base],
    side: usize,
    has_texture: impl Fn(usize) -> bool,
) -> Vec<[f32; 3]> {
    let diagonal = mesh.bounds().map_or(1.0, |b| b.size().length().max(1e-6)) as f32;
    let means = Means::new(texels, bases, diagonal);
    let patches: Vec<Option<Patch>> = bases
        .iter()
        .enumerate()
        .map(|(slot, base)| if base.is_tiled() || !has_texture(slot) { None } else { Patch::find(texels, slot, side) })
        .collect();
    let color = |texel: &Texel| {
        let base = bases[texel.slot].at(texel);
        let off = means.at(texel, bases[texel.slot].is_tiled());
        let detail = patches[texel.slot].as_ref().map_or([0.0; 3], |p| p.at(texel.at % side, texel.at / side));
        [0, 1, 2].map(|k| (base[k] + off[k] + STRENGTH * detail[k]).clamp(0.0, 255.0))
    };
    texels.par_iter().map(color).collect()
}

/// Mixes the photo's colours with the made-up ones by their share.
pub(super) fn blend(texels: &mut [Texel], made_up: &[[f32; 3]]) {
    for (texel, made_up) in texels.iter_mut().zip(made_up) {
        let mixed = match texel.color {
            Some(seen) => [0, 1, 2].map(|k| made_up[k] + (seen[k] - made_up[k]) * texel.share),
            None => *made_up,
        };
        texel.color = Some(mixed);
    }
}

/// Side of the box that a normal points to, 0 to 5.
fn facing(normal: Vec3) -> u8 {
    let a = normal.abs();
    let axis = if a.x >= a.y && a.x >= a.z { 0 } else { u8::from(a.y < a.z) + 1 };
    axis * 2 + u8::from(normal[axis as usize] < 0.0)
}

/// Stands for faces that point anywhere.
const ANY: u8 = 6;

/// Slot, facing, level, cell.
type Key = (usize, u8, u8, [i32; 3]);

/// Weighted means, in cells of several sizes, of what observed colours differ by from the slot's material.
struct Means {
    cells: HashMap<Key, ([f32; 3], f32)>,
    finest: f32,
}

impl Means {
    fn new(texels: &[Texel], bases: &[Base], diagonal: f32) -> Self {
        let mut cells: HashMap<Key, ([f32; 3], f32)> = HashMap::new();
        let finest = diagonal * FINEST;
        for texel in texels {
            let Some(color) = texel.color.filter(|_| texel.direct) else { continue };
            let base = bases[texel.slot].at(texel);
            let weight = texel.weight * texel.share;
            for level in 0..LEVELS {
                let size = finest * f32::from(1_u16 << level);
                let cell = (texel.point / size).floor().to_array().map(|v| v as i32);
                for side in [facing(texel.normal), ANY] {
                    let (sum, total) = cells.entry((texel.slot, side, level, cell)).or_default();
                    for k in 0..3 {
                        sum[k] += (color[k] - base[k]) * weight;
                    }
                    *total += weight;
                }
            }
        }
        Self { cells, finest }
    }

    /// From coarse to fine, each level as far as there are observations near the point: a little of what all faces show,
    /// then what those that point the same way do. Of a pattern only the light between its parts is wanted.
    fn at(&self, texel: &Texel, tiled: bool) -> [f32; 3] {
        let mut off = [0.0_f32; 3];
        let finest = if tiled { FINEST_OF_TILES } else { 0 };
        for side in [ANY, facing(texel.normal)] {
            let levels = if side == ANY { LEVELS - 1..LEVELS } else { finest..LEVELS };
            let most = if side == ANY { AROUND } else { 1.0 };
            for level in levels.rev() {
                let (sum, weight) = self.gather(texel.slot, side, level, texel.point);
                if weight > 0.0 {
                    let share = most * (weight / ENOUGH).min(1.0);
                    for (c, s) in off.iter_mut().zip(sum) {
                        *c += (s / weight - *c) * share;
                    }
                }
            }
        }
        off.map(|c| c.clamp(-FARTHEST_OFF, FARTHEST_OFF))
    }

    /// Trilinear mixture of the eight cells around a point.
    fn gather(&self, slot: usize, side: u8, level: u8, point: Vec3) -> ([f32; 3], f32) {
        let p = point / (self.finest * f32::from(1_u16 << level)) - 0.5;
        let (low, f) = (p.floor(), p - p.floor());
        let (mut sum, mut weight) = ([0.0; 3], 0.0);
        for corner in 0..8_u8 {
            let bit = |k: u8| f32::from((corner >> k) & 1);
            let offset = Vec3::new(bit(0), bit(1), bit(2));
            let share = (1.0 - (offset - f).abs()).to_array().iter().product::<f32>();
            let cell = (low + offset).to_array().map(|v| v as i32);
            if let Some((s, w)) = self.cells.get(&(slot, side, level, cell)) {
                for (a, b) in sum.iter_mut().zip(s) {
                    *a += b * share;
                }
                weight += w * share;
            }
        }
        (sum, weight)
    }
}

/// Deviations from the local mean over a square that was seen well.
struct Patch {
    side: usize,
    detail: Vec<[f32; 3]>,
}

impl Patch {
    /// The largest square of a slot's directly observed texels; of equally large ones the one seen most frontally.
    fn find(texels: &[Texel], slot: usize, side: usize) -> Option<Self> {
        // sums over the rectangle from the corner: count and trust
        let width = side + 1;
        let mut sums = vec![(0_u32, 0.0_f64); width * width];
        let mut colors: Vec<Option<[f32; 3]>> = vec![None; side * side];
        for texel in texels.iter().filter(|t| t.slot == slot && t.direct && t.share > WELL_SEEN) {
            colors[texel.at] = texel.color;
            sums[(texel.at / side + 1) * width + texel.at % side + 1] = (1, f64::from(texel.weight));
        }
        for y in 1..width {
            for x in 1..width {
                let (a, b, c) = (sums[(y - 1) * width + x], sums[y * width + x - 1], sums[(y - 1) * width + x - 1]);
                let own = &mut sums[y * width + x];
                *own = (own.0 + a.0 + b.0 - c.0, own.1 + a.1 + b.1 - c.1);
            }
        }
        for patch in PATCHES.into_iter().filter(|p| *p <= side) {
            let mut found: Vec<(f64, usize, usize)> = Vec::new();
            for y in (0..=side - patch).step_by(4) {
                for x in (0..=side - patch).step_by(4) {
                    let at = |dx: usize, dy: usize| sums[(y + dy) * width + x + dx];
                    let (a, b, c, d) = (at(0, 0), at(patch, 0), at(0, patch), at(patch, patch));
                    if (d.0 + a.0 - b.0 - c.0) as usize == patch * patch {
                        found.push((d.1 + a.1 - b.1 - c.1, x, y));
                    }
                }
            }
            found.sort_by(|a, b| b.0.total_cmp(&a.0));
            // the best seen ones, some way apart from each other
            let mut tried: Vec<(usize, usize)> = Vec::new();
            for (_, x, y) in found {
                if tried.len() == TRIES {
                    break;
                }
                if tried.iter().any(|(u, v)| u.abs_diff(x) < patch / 2 && v.abs_diff(y) < patch / 2) {
                    continue;
                }
                tried.push((x, y));
                let texel = |i: usize, j: usize| colors[(y + j) * side + x + i].unwrap_or_default();
                let candidate = Self::from_colors(patch, texel);
                if candidate.is_texture() {
                    return Some(candidate);
                }
            }
        }
        None
    }

    /// Whether the deviations are small and spread evenly.
    fn is_texture(&self) -> bool {
        let half = self.side / 2;
        let quarter = |x0: usize, y0: usize| {
            let pixels = (0..half * half).map(|i| self.detail[(y0 + i / half) * self.side + x0 + i % half]);
            let sum: f32 = pixels.map(|d| d.iter().map(|v| v * v).sum::<f32>() / 3.0).sum();
            (sum / (half * half) as f32).sqrt()
        };
        let all = [quarter(0, 0), quarter(half, 0), quarter(0, half), quarter(half, half)];
        let (low, high) = all.iter().fold((f32::MAX, 0.0_f32), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        high < ROUGHEST && high < UNEVEN * low + 0.5
    }

    fn from_colors(side: usize, texel: impl Fn(usize, usize) -> [f32; 3]) -> Self {
        let mut detail = Vec::with_capacity(side * side);
        for j in 0..side {
            for i in 0..side {
                let (mut sum, mut n) = ([0.0; 3], 0.0);
                for v in j.saturating_sub(FINE)..(j + FINE + 1).min(side) {
                    for u in i.saturating_sub(FINE)..(i + FINE + 1).min(side) {
                        for (s, c) in sum.iter_mut().zip(texel(u, v)) {
                            *s += c;
                        }
                        n += 1.0;
                    }
                }
                let here = texel(i, j);
                detail.push([0, 1, 2].map(|k| (here[k] - sum[k] / n).clamp(-LARGEST, LARGEST)));
            }
        }
        Self { side, detail }
    }

    /// The patch repeated by reflection over the texture.
    fn at(&self, x: usize, y: usize) -> [f32; 3] {
        let fold = |v: usize| {
            let v = v % (2 * self.side);
            if v < self.side { v } else { 2 * self.side - 1 - v }
        };
        self.detail[fold(y) * self.side + fold(x)]
    }
}
