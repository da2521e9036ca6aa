//! The grain of a surface: what is left of it without light and pattern, as a tile.

use image::RgbaImage;

use super::base::{Base, Color, Smoothing};
use super::fineness::Fineness;
use super::{opaque, quilt, scatter};
use crate::distance::distance_to;
use crate::noise::Random;

/// Sides of the tile that are tried, texels: little that was seen makes a small one.
const TILE_PX: [usize; 4] = [320, 208, 128, 80];
/// Ratios this many robust standard deviations from 1 are lines and edges of something else.
const FINE_OUTLIER: f32 = 3.5;
const COARSE_OUTLIER: f32 = 9.0;
/// Ratios are quilted as if they were 8-bit levels.
const QUILT_SCALE: f32 = 128.0;
/// Standard deviation of the grain where none was seen, as a ratio.
const USUAL_GRAIN: f32 = 0.006;
/// The same, at most, of paint and plaster.
const PAINT_ROUGHNESS: f32 = 0.03;

/// What the grain of a material is like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grain {
    /// Paint, plaster, paper: fine; a line on it is something else.
    Fine,
    /// Boards, tiles, carpet, panels: lines belong to it.
    Coarse,
}

/// Ratios around 1 that are laid over a surface of any size.
#[derive(Debug, Clone)]
pub(super) struct Tile {
    side: usize,
    ratios: Vec<Color>,
    /// Whether it can be laid without a repeat.
    is_noise: bool,
}

impl Tile {
    pub(super) fn of(side: usize, ratios: Vec<Color>) -> Self {
        Self { side, is_noise: scatter::is_noise(&ratios, side), ratios }
    }

    pub(super) fn at(&self, x: u32, y: u32) -> Color {
        if self.is_noise {
            return scatter::at(&self.ratios, self.side, x, y);
        }
        self.ratios[y as usize % self.side * self.side + x as usize % self.side]
    }

    pub(super) fn grain(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let side = 128;
        let ratios = (0..side * side).map(|_| [1.0 + (random.unit() + random.unit() - 1.0) * 2.4 * USUAL_GRAIN; 3]);
        Self::of(side, ratios.collect())
    }

    /// Standard deviation of its brightness.
    fn roughness(&self) -> f32 {
        let off = |c: &Color| (0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2] - 1.0).powi(2);
        (self.ratios.iter().map(off).sum::<f32>() / self.ratios.len().max(1) as f32).sqrt()
    }

    /// As rough as this tile, without what it shows.
    fn smooth_as(&self, seed: u64) -> Self {
        let plain = Self::grain(seed);
        let times = self.roughness() / plain.roughness().max(1e-6);
        Self::of(plain.side, plain.ratios.iter().map(|c| c.map(|v| 1.0 + (v - 1.0) * times)).collect())
    }

    /// Quilted from the ratios that are left, of sharp places when there are enough. Faint lines in a fine grain are cracks,
    /// seams and the edges of other things: laid again and again they would be panels.
    pub(super) fn quilted(rest: &[Option<Color>], fineness: &Fineness, width: usize, grain: Grain, seed: u64) -> Self {
        let height = rest.len() / width.max(1);
        let colors: Vec<Color> = rest.iter().map(|c| c.unwrap_or([1.0; 3]).map(|v| v * QUILT_SCALE)).collect();
        let known = without_outliers(rest, width, grain);
        let best: Vec<bool> =
            known.iter().enumerate().map(|(i, k)| *k && fineness.is_sharp(i % width, i / width)).collect();
        for side in TILE_PX {
            for observed in [&best, &known] {
                let sample = quilt::Sample { width, height, colors: &colors, observed };
                if let Some(tile) = quilt::quilt(&sample, side, seed) {
                    let tile = Self::of(side, evened(&tile, side, grain));
                    let is_paint = grain == Grain::Fine && tile.roughness() < PAINT_ROUGHNESS;
                    return if is_paint && !tile.is_noise { tile.smooth_as(seed) } else { tile };
                }
            }
        }
        Self::grain(seed)
    }
}

/// Which ratios are grain: not far from what is usual, nor beside one that is.
fn without_outliers(rest: &[Option<Color>], width: usize, grain: Grain) -> Vec<bool> {
    let luma = |c: &Color| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
    let mut away: Vec<f32> = rest.iter().flatten().map(|c| (luma(c) - 1.0).abs()).collect();
    if away.is_empty() {
        return vec![false; rest.len()];
    }
    let middle = away.len() / 2;
    // 1.48 times the median deviation is the standard deviation of a normal distribution.
    let sigma = (1.48 * *away.select_nth_unstable_by(middle, f32::total_cmp).1).max(0.004);
    let (most, margin) = match grain {
        Grain::Fine => (FINE_OUTLIER * sigma, 2_usize),
        Grain::Coarse => (COARSE_OUTLIER * sigma, 0),
    };
    let far: Vec<bool> = rest.iter().map(|c| c.is_some_and(|c| (luma(&c) - 1.0).abs() > most)).collect();
    let near = distance_to(&far, width, rest.len() / width.max(1));
    rest.iter().zip(near).map(|(c, d)| c.is_some() && d > margin as f32).collect()
}

/// A quilted tile as ratios with mean 1, without differences over large distances: they would show as a repetition.
pub(super) fn evened(tile: &[Color], side: usize, grain: Grain) -> Vec<Color> {
    let cells = if grain == Grain::Fine { 20 } else { 8 };
    let cell = side.div_ceil(cells);
    // The smooth part is that of the tile among its repetitions: of the tile alone it would break off at the edges, and
    // every repetition would show a line there. Whole cells around it, and more than the blur reaches.
    let around = (4 * cell).min(side);
    let at = |x: u32, y: u32| [x, y].map(|v| (v as usize + side - around) % side);
    let wide = (side + 2 * around) as u32;
    let image = RgbaImage::from_fn(wide, wide, |x, y| {
        let [x, y] = at(x, y);
        opaque(tile[y * side + x])
    });
    let field = Base::smooth(&image, &Smoothing { cell, blur: 1.0, settling: 4.0 });
    let mut ratios: Vec<Color> = tile
        .iter()
        .enumerate()
        .map(|(i, c)| {
            let [x, y] = [i % side, i / side].map(|v| (v + around) as u32);
            let light = field.as_ref().map_or([QUILT_SCALE; 3], |f| f.at(x, y));
            std::array::from_fn(|k| c[k] / light[k].max(1.0))
        })
        .collect();
    for k in 0..3 {
        let mean = ratios.iter().map(|r| r[k]).sum::<f32>() / ratios.len().max(1) as f32;
        for ratio in &mut ratios {
            ratio[k] /= mean.max(0.01);
        }
    }
    ratios
}
