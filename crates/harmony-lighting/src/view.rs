//! View transforms as tables, and their inverse: from a picture back to light.

use harmony_scene::{ImageSize, ViewTransform};
use image::RgbImage;

use crate::LinearImage;
use crate::linear::{linear_to_srgb, luminance, srgb_to_linear};

/// Samples of a table on each axis; as in `blender/views.py`.
pub const GRID: usize = 24;
/// Light of the table's axis: 2^LOW to 2^HIGH, shifted so that it starts at black.
const LOW: f32 = -9.0;
const HIGH: f32 = 5.0;
/// Rounds of the inverse; each takes most of the remaining difference away.
const ROUNDS: usize = 14;

/// Display values (sRGB encoded, 0 to 1) of light under one view transform, sampled from Blender's own.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewTable {
    /// Which.
    pub view: ViewTransform,
    /// `GRID`^3 values, red fastest.
    pub display: Vec<[f32; 3]>,
}

/// Place of light on a table's axis, in samples.
fn place(light: f32) -> f32 {
    let floor = LOW.exp2();
    let s = ((light.max(0.0) + floor).log2() - LOW) / (HIGH - LOW);
    (s * (GRID - 1) as f32).clamp(0.0, (GRID - 1) as f32)
}

impl ViewTable {
    /// A table from its values; `None` when there are not `GRID`^3 of them.
    pub fn new(view: ViewTransform, display: Vec<[f32; 3]>) -> Option<Self> {
        (display.len() == GRID * GRID * GRID).then_some(Self { view, display })
    }

    /// Plain sRGB; needs no samples.
    pub fn standard() -> Self {
        Self { view: ViewTransform::Standard, display: Vec::new() }
    }

    /// Display value of light, exposure included.
    pub fn shown(&self, light: [f32; 3]) -> [f32; 3] {
        if self.view == ViewTransform::Standard || self.display.is_empty() {
            return light.map(|v| linear_to_srgb(v.clamp(0.0, 1.0)));
        }
        let at = light.map(place);
        let low = at.map(|a| (a as usize).min(GRID - 2));
        let mut sum = [0.0f32; 3];
        for corner in 0..8usize {
            let mut weight = 1.0f32;
            let mut index = 0;
            for axis in [2, 1, 0] {
                let high = corner >> axis & 1;
                let k = at[axis] - low[axis] as f32;
                weight *= if high == 1 { k } else { 1.0 - k };
                index = index * GRID + low[axis] + high;
            }
            for (s, v) in sum.iter_mut().zip(self.display[index]) {
                *s += weight * v;
            }
        }
        sum
    }

    /// Light that shows as a display value, by fixed-point iteration; clipped values give the least light that clips.
    ///
    /// Colours that the transform cannot show at all come as near as light goes.
    pub fn light(&self, display: [f32; 3]) -> [f32; 3] {
        let target = display.map(|v| srgb_to_linear(v.clamp(0.0, 1.0)));
        if self.view == ViewTransform::Standard || self.display.is_empty() {
            return target;
        }
        let floor = 1e-3;
        let mut light = target;
        for _ in 0..ROUNDS {
            let shown = self.shown(light).map(srgb_to_linear);
            for c in 0..3 {
                let ratio = (target[c] + floor) / (shown[c] + floor);
                light[c] = ((light[c] + 1e-4) * ratio.clamp(0.25, 4.0) - 1e-4).clamp(0.0, HIGH.exp2());
            }
        }
        light
    }

    /// A picture's light.
    pub fn to_linear(&self, image: &RgbImage) -> LinearImage {
        LinearImage {
            size: ImageSize::new(image.width(), image.height()),
            rgb: image.pixels().map(|p| self.light(p.0.map(|v| f32::from(v) / 255.0))).collect(),
        }
    }

    /// The picture of light.
    pub fn to_picture(&self, image: &LinearImage) -> RgbImage {
        let width = image.size.width as usize;
        RgbImage::from_fn(image.size.width, image.size.height, |x, y| {
            let rgb = image.rgb.get(y as usize * width + x as usize).copied().unwrap_or_default();
            image::Rgb(self.shown(rgb).map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
        })
    }
}

/// How far two pictures of one view are apart.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct PictureError {
    /// Median absolute difference of display-linear luminance, stops.
    pub stops: f64,
    /// Median distance of chromaticities (r, g, b over their sum).
    pub chroma: f64,
}

impl PictureError {
    /// One number to compare by: a chromaticity step of 0.05 is as bad as a quarter stop.
    pub fn total(&self) -> f64 {
        self.stops + 5.0 * self.chroma
    }
}

/// Linear luminance below which differences of blacks do not count.
const BLACK: f32 = 0.004;

/// Compares display values (linear) of two images of one size; `weights` (empty = all 1) leaves pixels out.
pub fn picture_error(photo: &LinearImage, render: &LinearImage, weights: &[f32]) -> PictureError {
    let mut stops = Vec::new();
    let mut chroma = Vec::new();
    for (i, (p, r)) in photo.rgb.iter().zip(&render.rgb).enumerate() {
        if weights.get(i).is_some_and(|w| *w <= 0.0) {
            continue;
        }
        stops.push(f64::from(((luminance(*r) + BLACK) / (luminance(*p) + BLACK)).log2().abs()));
        let share = |rgb: [f32; 3]| {
            let sum = rgb.iter().sum::<f32>() + 3.0 * BLACK;
            rgb.map(|v| (v + BLACK) / sum)
        };
        let (a, b) = (share(*p), share(*r));
        chroma.push(f64::from((0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>().sqrt()));
    }
    PictureError { stops: median(&mut stops), chroma: median(&mut chroma) }
}

/// Median, 0 for nothing.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// The value that so large a share of the others are below, 0 for nothing.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((values.len() as f64 * share) as usize).copied().unwrap_or(0.0)
}

/// A picture's display-linear values.
pub fn display_linear(image: &RgbImage) -> LinearImage {
    ViewTable::standard().to_linear(image)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A made-up transform with a soft shoulder that takes a third of the saturation away.
    pub(crate) fn soft() -> ViewTable {
        let at = |i: usize| (LOW + i as f32 / (GRID - 1) as f32 * (HIGH - LOW)).exp2() - LOW.exp2();
        let mut display = Vec::new();
        for b in 0..GRID {
            for g in 0..GRID {
                for r in 0..GRID {
                    let rgb = [at(r), at(g), at(b)];
                    let grey = luminance(rgb);
                    display.push(rgb.map(|v| {
                        let v = v + (grey - v) / 3.0;
                        linear_to_srgb(v / (1.0 + v))
                    }));
                }
            }
        }
        ViewTable::new(ViewTransform::Agx, display).unwrap()
    }

    #[test]
    fn light_comes_back_from_a_transform_that_mixes_channels() {
        let view = soft();
        for light in [[0.18, 0.18, 0.18], [0.5, 0.2, 0.05], [0.02, 0.05, 0.1], [1.5, 1.4, 1.2], [0.0, 0.0, 0.0]] {
            let back = view.light(view.shown(light));
            for c in 0..3 {
                assert!((back[c] - light[c]).abs() <= 0.04 * light[c] + 0.003, "{light:?} came back as {back:?}");
            }
        }
    }

    #[test]
    fn the_table_agrees_with_the_formula_between_its_samples() {
        let view = soft();
        for v in [0.01f32, 0.1, 0.37, 1.0, 3.0] {
            let want = linear_to_srgb(v / (1.0 + v));
            assert!(view.shown([v; 3]).iter().all(|s| (s - want).abs() <= 0.01), "{v}: {:?}", view.shown([v; 3]));
        }
        assert!(ViewTable::new(ViewTransform::Agx, vec![[0.0; 3]; 5]).is_none());
    }

    #[test]
    fn one_stop_is_one_stop_and_grey_has_no_colour_error() {
        let size = ImageSize::new(4, 1);
        let image = |v: [f32; 3]| LinearImage { size, rgb: vec![v; 4] };
        let found = picture_error(&image([0.4; 3]), &image([0.2; 3]), &[]);
        assert!((found.stops - 1.0).abs() <= 0.03, "{found:?}");
        assert!(found.chroma <= 1e-6);
        assert!(picture_error(&image([0.4; 3]), &image([0.4, 0.4, 0.1]), &[]).chroma > 0.1);
        assert_eq!(picture_error(&image([0.4; 3]), &image([0.0; 3]), &[0.0; 4]), PictureError::default());
    }
}
