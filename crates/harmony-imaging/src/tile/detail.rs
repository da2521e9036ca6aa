//! The detail of a coarse texture (a long pile, gravel, foliage), to be laid under any light.

use image::{Rgba, RgbaImage};

use super::base::{Base, Color, Smoothing};
use super::{MIN_OBSERVED, quilt};

/// Sides of the tile that are tried, texels: little that was seen makes a small one.
const SIDES: [usize; 4] = [192, 128, 96, 64];
/// Cell of the smooth part, texels, and its blur in cells: detail is what is finer.
const CELL: usize = 12;
const BLUR: f32 = 1.5;
/// Ratios to the smooth part are held within this range: glints and holes.
const RANGE: [f32; 2] = [0.3, 2.5];
/// Ratios are quilted as if they were 8-bit levels.
const SCALE: f32 = 100.0;
/// Colour below which a ratio says nothing, 8-bit levels.
const DARKEST: f32 = 6.0;

/// A tile of ratios to the local mean colour.
#[derive(Debug, Clone)]
pub struct Detail {
    side: usize,
    ratios: Vec<Color>,
}

impl Detail {
    /// From what was seen of a surface (sRGB levels, row-major, `None` where it was not); `None` when no square of a
    /// useful size was seen as a whole.
    pub fn of(colors: &[Option<Color>], width: usize, seed: u64) -> Option<Self> {
        let height = colors.len() / width.max(1);
        if colors.iter().flatten().count() < MIN_OBSERVED {
            return None;
        }
        let image = RgbaImage::from_fn(width as u32, height as u32, |x, y| {
            colors[y as usize * width + x as usize].map_or(Rgba([0; 4]), |c| {
                let [r, g, b] = c.map(|v| v.round().clamp(0.0, 255.0) as u8);
                Rgba([r, g, b, 255])
            })
        });
        let field = Base::smooth(&image, &Smoothing { cell: CELL, blur: BLUR, settling: 4.0 })?;
        let ratio = |i: usize, c: Color| -> Color {
            let mean = field.at((i % width) as u32, (i / width) as u32);
            std::array::from_fn(|k| (c[k].max(DARKEST) / mean[k].max(DARKEST)).clamp(RANGE[0], RANGE[1]) * SCALE)
        };
        let ratios: Vec<Color> =
            colors.iter().enumerate().map(|(i, c)| c.map_or([SCALE; 3], |c| ratio(i, c))).collect();
        let observed: Vec<bool> = colors.iter().map(Option::is_some).collect();
        let sample = quilt::Sample { width, height, colors: &ratios, observed: &observed };
        let (side, tile) = SIDES.into_iter().find_map(|side| Some((side, quilt::quilt(&sample, side, seed)?)))?;
        let mean: Color = std::array::from_fn(|k| tile.iter().map(|c| c[k]).sum::<f32>() / tile.len().max(1) as f32);
        let ratios = tile.into_iter().map(|c| std::array::from_fn(|k| c[k] / mean[k].max(1.0))).collect();
        Some(Self { side, ratios })
    }

    /// The ratio at a texel of a surface of the same texel size; its mean is 1.
    pub fn at(&self, x: u32, y: u32) -> Color {
        self.ratios[y as usize % self.side * self.side + x as usize % self.side]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tufts of 4 texels by a hash, under light that falls off to the right.
    fn lit_tufts(x: usize, y: usize) -> Color {
        let h = ((x / 4).wrapping_mul(0x9E37_79B1) ^ (y / 4).wrapping_mul(0x85EB_CA77)).wrapping_mul(0xC2B2_AE3D);
        let tuft = if h >> 7 & 1 == 0 { 0.7 } else { 1.3 };
        [120.0, 100.0, 80.0].map(|c| c * tuft * (1.2 - x as f32 / 400.0))
    }

    #[test]
    fn detail_keeps_the_contrast_and_loses_the_light() {
        let (w, h) = (220, 180);
        let colors: Vec<Option<Color>> = (0..w * h).map(|i| Some(lit_tufts(i % w, i / w))).collect();
        let detail = Detail::of(&colors, w, 1).unwrap();
        let all: Vec<f32> = (0..128 * 128).map(|i| detail.at(i % 128, i / 128)[0]).collect();
        let mean = all.iter().sum::<f32>() / all.len() as f32;
        let deviation = (all.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / all.len() as f32).sqrt();
        assert!((mean - 1.0).abs() < 0.05, "{mean}");
        assert!((0.2..0.4).contains(&deviation), "tufts differ by 0.3 from their mean: {deviation}");
        let column = |x: u32| (0..128).map(|y| detail.at(x, y)[0]).sum::<f32>() / 128.0;
        let side = |from: u32| (from..from + 32).map(column).sum::<f32>() / 32.0;
        assert!((side(0) - side(90)).abs() < 0.1, "no light is left: {} {}", side(0), side(90));
    }

    #[test]
    fn a_little_scattered_evidence_is_no_texture() {
        let colors: Vec<Option<Color>> =
            (0..200 * 200).map(|i| (i % 3 == 0).then(|| lit_tufts(i % 200, i / 200))).collect();
        assert!(Detail::of(&colors, 200, 1).is_none());
        assert!(Detail::of(&[], 0, 1).is_none());
    }
}
