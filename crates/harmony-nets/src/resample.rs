//! Resizing of photos for networks, exactly as the references do it.
//!
//! | function | as | used by |
//! |---|---|---|
//! | [`resize_8bit`] | Pillow's `Image.resize` (up to 12): 8-bit between the passes, fixed-point weights | CLIP |
//! | [`Pixels::resize_antialiased`] | PyTorch's `antialias = True` on floats | SAM 2 |
//! | [`Pixels::blur`], [`Pixels::resize_bilinear`] | torchvision's Gaussian blur, `antialias = False` | OWLv2 |
//!
//! Pixels are RGB, row-major; the centre of the top-left pixel is (0.5, 0.5) throughout.

use image::RgbImage;

use crate::backend::Resize;
use crate::math;

/// Kernel of an antialiased resize; it widens by the shrinking factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// Linear ("bilinear").
    Triangle,
    /// Keys' cubic with `a = -0.5` ("bicubic" of Pillow, and of PyTorch with antialiasing).
    Cubic,
}

impl Filter {
    fn support(self) -> f64 {
        match self {
            Self::Triangle => 1.0,
            Self::Cubic => 2.0,
        }
    }

    fn at(self, x: f64) -> f64 {
        let (x, a) = (x.abs(), -0.5);
        match self {
            Self::Triangle => (1.0 - x).max(0.0),
            Self::Cubic if x < 1.0 => ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0,
            Self::Cubic if x < 2.0 => (((x - 5.0) * x + 8.0) * x - 4.0) * a,
            Self::Cubic => 0.0,
        }
    }

    /// For every output position the first input position and the weights from there on; they sum to one.
    fn taps(self, input: usize, output: usize) -> Vec<(usize, Vec<f64>)> {
        let scale = input as f64 / output as f64;
        let widen = scale.max(1.0);
        let support = self.support() * widen;
        let taps = |o: usize| {
            let centre = (o as f64 + 0.5) * scale;
            let first = ((centre - support + 0.5) as i64).max(0) as usize;
            let end = ((centre + support + 0.5) as usize).min(input);
            let raw: Vec<f64> = (first..end).map(|i| self.at((i as f64 - centre + 0.5) / widen)).collect();
            let total: f64 = raw.iter().sum();
            (first, raw.iter().map(|w| w / total).collect())
        };
        (0..output).map(taps).collect()
    }
}

/// Binary digits of the fixed-point weights: Pillow's `32 - 8 - 2`.
const DIGITS: u32 = 22;

/// Resizes as Pillow does up to 12, to the last bit. Sides of zero become one.
pub fn resize_8bit(image: &RgbImage, width: u32, height: u32, filter: Filter) -> RgbImage {
    let (width, height) = (width.max(1), height.max(1));
    let (w0, h0) = image.dimensions();
    if w0 == 0 || h0 == 0 {
        return RgbImage::new(width, height);
    }
    let fixed = |input: u32, output: u32| -> Vec<(usize, Vec<i32>)> {
        let round = |w: f64| (w * f64::from(1 << DIGITS)).round() as i32;
        let taps = filter.taps(input as usize, output as usize);
        taps.into_iter().map(|(first, weights)| (first, weights.into_iter().map(round).collect())).collect()
    };
    // Across, then down: the order matters, for values are cut to 8 bits in between. Pillow does so up to 12 (seen with
    // 12.0.0 on 391 sizes at which the two orders differ); 13 goes down first in some cases.
    let mut rows = image.as_raw().clone();
    if width != w0 {
        rows = across(&rows, w0, &fixed(w0, width));
    }
    if height != h0 {
        rows = down(&rows, width, &fixed(h0, height));
    }
    RgbImage::from_raw(width, height, rows).unwrap_or_else(|| RgbImage::new(width, height))
}

type FixedTaps = [(usize, Vec<i32>)];
/// One half, so that cutting the digits off rounds.
const HALF: i32 = 1 << (DIGITS - 1);

/// The pass along rows of `width` pixels.
fn across(rows: &[u8], width: u32, taps: &FixedTaps) -> Vec<u8> {
    let mut out = Vec::with_capacity(rows.len() / width as usize * taps.len());
    for row in rows.chunks_exact(width as usize * 3) {
        for (first, weights) in taps {
            let mut sums = [HALF; 3];
            for (pixel, w) in row[first * 3..].as_chunks::<3>().0.iter().zip(weights) {
                for (sum, v) in sums.iter_mut().zip(pixel) {
                    *sum += i32::from(*v) * w;
                }
            }
            out.extend(sums.map(clip));
        }
    }
    out
}

/// The pass along columns.
fn down(rows: &[u8], width: u32, taps: &FixedTaps) -> Vec<u8> {
    let stride = width as usize * 3;
    let mut sums = vec![0i32; stride];
    let mut out = Vec::with_capacity(stride * taps.len());
    for (first, weights) in taps {
        sums.fill(HALF);
        for (row, w) in rows[first * stride..].chunks_exact(stride).zip(weights) {
            for (sum, v) in sums.iter_mut().zip(row) {
                *sum += i32::from(*v) * w;
            }
        }
        out.extend(sums.iter().copied().map(clip));
    }
    out
}

fn clip(sum: i32) -> u8 {
    (sum >> DIGITS).clamp(0, 255) as u8
}

/// A colour image of f32, `[height, width, 3]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Pixels {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values, row-major, RGB next to each other.
    pub data: Vec<f32>,
}

impl Pixels {
    /// From 0..255 to 0..1.
    pub fn from_photo(photo: &RgbImage) -> Self {
        let data = photo.as_raw().iter().map(|v| f32::from(*v) / 255.0).collect();
        Self { width: photo.width() as usize, height: photo.height() as usize, data }
    }

    /// `(x - mean) / std` for each channel.
    #[must_use]
    pub fn normalized(mut self, mean: [f32; 3], std: [f32; 3]) -> Self {
        for pixel in self.data.as_chunks_mut::<3>().0 {
            for c in 0..3 {
                pixel[c] = (pixel[c] - mean[c]) / std[c];
            }
        }
        self
    }

    /// A square, filled with zeros at the bottom or right.
    #[must_use]
    pub fn padded_to_square(&self) -> Self {
        let side = self.width.max(self.height);
        let mut data = vec![0.0; side * side * 3];
        for (to, from) in data.chunks_exact_mut(side * 3).zip(self.data.chunks_exact(self.width * 3)) {
            to[..from.len()].copy_from_slice(from);
        }
        Self { width: side, height: side, data }
    }

    /// Antialiased resize; sides of zero are not allowed.
    #[must_use]
    pub fn resize_antialiased(&self, width: usize, height: usize, filter: Filter) -> Self {
        let taps = |input, output| -> Vec<Taps> {
            let to = |(first, weights): (usize, Vec<f64>)| {
                weights.iter().enumerate().map(|(i, w)| (first + i, *w as f32)).collect()
            };
            filter.taps(input, output).into_iter().map(to).collect()
        };
        self.combined(&taps(self.width, width), &taps(self.height, height))
    }

    /// Linear resize without antialiasing, `align_corners = false`.
    #[must_use]
    pub fn resize_bilinear(&self, width: usize, height: usize) -> Self {
        let taps = |input, output| math::taps(input, output, Resize::Bilinear);
        self.combined(&taps(self.width, width), &taps(self.height, height))
    }

    /// Gaussian blur by a kernel of `2 radius + 1`, mirrored at the borders without repeating the border pixel;
    /// `sigma` in pixels.
    #[must_use]
    pub fn blur(&self, sigma: f64, radius: usize) -> Self {
        let r = radius as i64;
        let raw: Vec<f64> = (-r..=r).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
        let total: f64 = raw.iter().sum();
        let taps = |n: usize| -> Vec<Taps> {
            let last = n as i64 - 1;
            let mirror = |i: i64| if last == 0 { 0 } else { (last - ((i.rem_euclid(2 * last)) - last).abs()) as usize };
            let at = |o: i64| (-r..=r).zip(&raw).map(|(k, w)| (mirror(o + k), (w / total) as f32)).collect();
            (0..n as i64).map(at).collect()
        };
        self.combined(&taps(self.width), &taps(self.height))
    }

    /// Weighted sums along rows, then along columns.
    fn combined(&self, across: &[Taps], down: &[Taps]) -> Self {
        let (width, height) = (across.len(), down.len());
        let mut narrow = Vec::with_capacity(self.height * width * 3);
        for row in self.data.chunks_exact(self.width * 3) {
            let (pixels, _) = row.as_chunks::<3>();
            narrow.extend(across.iter().flat_map(|taps| {
                let mut sums = [0f32; 3];
                for (i, w) in taps {
                    for (sum, v) in sums.iter_mut().zip(&pixels[*i]) {
                        *sum += v * w;
                    }
                }
                sums
            }));
        }
        let mut data = vec![0f32; width * height * 3];
        for (out, taps) in data.chunks_exact_mut(width * 3).zip(down) {
            for (i, w) in taps {
                for (sum, v) in out.iter_mut().zip(&narrow[i * width * 3..(i + 1) * width * 3]) {
                    *sum += v * w;
                }
            }
        }
        Self { width, height, data }
    }
}

type Taps = Vec<(usize, f32)>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blur_keeps_flat_images_and_mirrors_at_borders() {
        let flat = Pixels { width: 7, height: 5, data: vec![0.25; 105] };
        for v in flat.blur(1.3, 4).data {
            assert!((v - 0.25).abs() <= 1e-6);
        }
        // A single column: nothing to mirror.
        let thin = Pixels { width: 1, height: 3, data: vec![0.5; 9] };
        assert!(thin.blur(1.0, 3).data.iter().all(|v| (v - 0.5).abs() <= 1e-6));
        // A kernel as narrow as this takes the neighbour inside for the one outside: (b, a, b) about a.
        let step = Pixels { width: 3, height: 1, data: [0f32, 1.0, 0.0].iter().flat_map(|v| [*v; 3]).collect() };
        let w = (-0.5f32).exp();
        assert!((step.blur(1.0, 1).data[0] - 2.0 * w / (1.0 + 2.0 * w)).abs() <= 1e-6);
    }
}
