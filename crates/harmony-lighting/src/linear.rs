//! Scene-linear images and the way to and from 8-bit values.

use harmony_scene::ImageSize;
use image::RgbImage;

/// A linear RGB image, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearImage {
    /// Size.
    pub size: ImageSize,
    /// Linear RGB (Rec. 709 primaries), one a pixel.
    pub rgb: Vec<[f32; 3]>,
}

/// How grey light becomes display values: sampled from the renderer's own view transform.
///
/// Both columns ascend. Between samples it is linear; beyond them it is constant.
#[derive(Debug, Clone, PartialEq)]
pub struct GreyResponse {
    /// Scene-linear light, after exposure.
    pub light: Vec<f32>,
    /// Display value, 0 to 1 (sRGB encoded).
    pub display: Vec<f32>,
}

/// Rec. 709 luminance of linear RGB.
pub fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// sRGB decoding of a value in 0..=1.
pub fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// sRGB encoding of a value in 0..=1.
pub fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

impl GreyResponse {
    /// Plain sRGB, clipped at 1.
    pub fn srgb() -> Self {
        let display: Vec<f32> = (0..=255).map(|i| i as f32 / 255.0).collect();
        Self { light: display.iter().map(|v| srgb_to_linear(*v)).collect(), display }
    }

    /// Display value of light.
    pub fn display(&self, light: f32) -> f32 {
        interpolate(&self.light, &self.display, light)
    }

    /// Light of a display value (the least that shows so).
    pub fn light(&self, display: f32) -> f32 {
        interpolate(&self.display, &self.light, display)
    }

    /// A picture's light, channel by channel (approximate for saturated colours under AgX).
    pub fn to_linear(&self, image: &RgbImage) -> LinearImage {
        let table: Vec<f32> = (0..=255).map(|v| self.light(v as f32 / 255.0)).collect();
        LinearImage {
            size: ImageSize::new(image.width(), image.height()),
            rgb: image.pixels().map(|p| p.0.map(|v| table[usize::from(v)])).collect(),
        }
    }

    /// The picture of light, channel by channel.
    pub fn to_picture(&self, image: &LinearImage) -> RgbImage {
        let width = image.size.width as usize;
        RgbImage::from_fn(image.size.width, image.size.height, |x, y| {
            let i = y as usize * width + x as usize;
            let rgb = image.rgb.get(i).copied().unwrap_or_default();
            image::Rgb(rgb.map(|v| (self.display(v).clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
        })
    }
}

/// Piecewise linear `ys(xs)`, constant beyond the ends; `xs` ascends.
fn interpolate(xs: &[f32], ys: &[f32], x: f32) -> f32 {
    let n = xs.len().min(ys.len());
    if n == 0 {
        return x;
    }
    if x.is_nan() || x <= xs[0] {
        return ys[0];
    }
    if x >= xs[n - 1] {
        return ys[n - 1];
    }
    let hi = xs[..n].partition_point(|v| *v < x).clamp(1, n - 1);
    let (x0, x1) = (xs[hi - 1], xs[hi]);
    let k = if x1 > x0 { (x - x0) / (x1 - x0) } else { 0.0 };
    ys[hi - 1] + k * (ys[hi] - ys[hi - 1])
}

impl LinearImage {
    /// All black.
    pub fn black(size: ImageSize) -> Self {
        Self { size, rgb: vec![[0.0; 3]; size.pixels()] }
    }

    /// Mean over boxes: the image at a smaller size.
    #[must_use]
    pub fn shrunk(&self, to: ImageSize) -> Self {
        let (w, h) = (self.size.width as usize, self.size.height as usize);
        let (tw, th) = (to.width.max(1) as usize, to.height.max(1) as usize);
        let mut rgb = Vec::with_capacity(tw * th);
        for ty in 0..th {
            let (y0, y1) = (ty * h / th, ((ty + 1) * h / th).max(ty * h / th + 1).min(h));
            for tx in 0..tw {
                let (x0, x1) = (tx * w / tw, ((tx + 1) * w / tw).max(tx * w / tw + 1).min(w));
                let mut sum = [0.0f64; 3];
                let mut n = 0.0f64;
                for y in y0..y1 {
                    for x in x0..x1 {
                        let p = self.rgb.get(y * w + x).copied().unwrap_or_default();
                        for c in 0..3 {
                            sum[c] += f64::from(p[c]);
                        }
                        n += 1.0;
                    }
                }
                rgb.push(sum.map(|s| if n > 0.0 { (s / n) as f32 } else { 0.0 }));
            }
        }
        Self { size: ImageSize::new(tw as u32, th as u32), rgb }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_survives_light_and_back() {
        let picture = RgbImage::from_fn(16, 16, |x, y| image::Rgb([(x * 16) as u8, (y * 16) as u8, 200]));
        let response = GreyResponse::srgb();
        assert_eq!(response.to_picture(&response.to_linear(&picture)), picture);
        assert!((response.display(0.18) - 0.4613).abs() <= 0.002, "middle grey is at 46 %");
        assert_eq!(response.display(7.0), 1.0);
        assert_eq!(response.display(f32::NAN), 0.0);
    }

    #[test]
    fn shrinking_keeps_the_mean() {
        let size = ImageSize::new(12, 8);
        let image = LinearImage { size, rgb: (0..96).map(|i| [i as f32, 1.0, 0.0]).collect() };
        let small = image.shrunk(ImageSize::new(3, 2));
        let mean = small.rgb.iter().map(|p| p[0]).sum::<f32>() / 6.0;
        assert!((mean - 47.5).abs() <= 1e-4);
        assert_eq!(image.shrunk(ImageSize::new(24, 16)).rgb.len(), 384);
    }
}
