//! Boxes and one-bit masks in the image.

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ImageSize;

/// An axis-aligned box in pixels; `x1`, `y1` are exclusive edges, so width = `x1 - x0`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PixelBox {
    /// Left edge.
    pub x0: f64,
    /// Top edge.
    pub y0: f64,
    /// Right edge.
    pub x1: f64,
    /// Bottom edge.
    pub y1: f64,
}

impl PixelBox {
    /// Width, never negative.
    pub fn width(&self) -> f64 {
        (self.x1 - self.x0).max(0.0)
    }

    /// Height, never negative.
    pub fn height(&self) -> f64 {
        (self.y1 - self.y0).max(0.0)
    }

    /// Area in square pixels.
    pub fn area(&self) -> f64 {
        self.width() * self.height()
    }

    /// Centre.
    pub fn centre(&self) -> DVec2 {
        DVec2::new(f64::midpoint(self.x0, self.x1), f64::midpoint(self.y0, self.y1))
    }

    /// Overlap of two boxes (of zero area when they do not meet).
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            x0: self.x0.max(other.x0),
            y0: self.y0.max(other.y0),
            x1: self.x1.min(other.x1),
            y1: self.y1.min(other.y1),
        }
    }

    /// Intersection over union.
    pub fn iou(&self, other: &Self) -> f64 {
        let i = self.intersection(other).area();
        let u = self.area() + other.area() - i;
        if u > 0.0 { i / u } else { 0.0 }
    }

    /// Share of this box that `other` covers.
    pub fn covered_by(&self, other: &Self) -> f64 {
        if self.area() > 0.0 { self.intersection(other).area() / self.area() } else { 0.0 }
    }

    /// Grown by a fraction of its size on each side and cut to the image.
    #[must_use]
    pub fn padded(&self, fraction: f64, size: ImageSize) -> Self {
        let (dx, dy) = (self.width() * fraction, self.height() * fraction);
        Self { x0: self.x0 - dx, y0: self.y0 - dy, x1: self.x1 + dx, y1: self.y1 + dy }.clamped(size)
    }

    /// Cut to the image.
    #[must_use]
    pub fn clamped(&self, size: ImageSize) -> Self {
        let (w, h) = (f64::from(size.width), f64::from(size.height));
        Self {
            x0: self.x0.clamp(0.0, w),
            y0: self.y0.clamp(0.0, h),
            x1: self.x1.clamp(0.0, w),
            y1: self.y1.clamp(0.0, h),
        }
    }
}

/// A full-frame one-bit mask.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    size: ImageSize,
    bits: Vec<bool>,
}

impl Mask {
    /// All off.
    pub fn empty(size: ImageSize) -> Self {
        Self { size, bits: vec![false; size.pixels()] }
    }

    /// From a predicate on (column, row).
    pub fn from_fn(size: ImageSize, mut f: impl FnMut(u32, u32) -> bool) -> Self {
        let mut bits = Vec::with_capacity(size.pixels());
        for y in 0..size.height {
            for x in 0..size.width {
                bits.push(f(x, y));
            }
        }
        Self { size, bits }
    }

    /// Image size.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// Row-major bits.
    pub fn bits(&self) -> &[bool] {
        &self.bits
    }

    /// Row-major bits, to write.
    pub fn bits_mut(&mut self) -> &mut [bool] {
        &mut self.bits
    }

    /// The bit at (column, row); off outside the image.
    pub fn get(&self, x: i64, y: i64) -> bool {
        x >= 0
            && y >= 0
            && x < i64::from(self.size.width)
            && y < i64::from(self.size.height)
            && self.bits[y as usize * self.size.width as usize + x as usize]
    }

    /// Sets one bit.
    ///
    /// # Panics
    /// When the pixel is outside the image.
    pub fn set(&mut self, x: u32, y: u32, on: bool) {
        let i = y as usize * self.size.width as usize + x as usize;
        self.bits[i] = on;
    }

    /// Number of set pixels.
    pub fn count(&self) -> usize {
        self.bits.iter().filter(|b| **b).count()
    }

    /// Tight box of the set pixels, or `None` when empty.
    pub fn bounds(&self) -> Option<PixelBox> {
        let (mut x0, mut y0, mut x1, mut y1) = (u32::MAX, u32::MAX, 0, 0);
        for (i, on) in self.bits.iter().enumerate() {
            if *on {
                let (x, y) = (i as u32 % self.size.width, i as u32 / self.size.width);
                x0 = x0.min(x);
                y0 = y0.min(y);
                x1 = x1.max(x + 1);
                y1 = y1.max(y + 1);
            }
        }
        (x1 > 0).then(|| PixelBox { x0: x0.into(), y0: y0.into(), x1: x1.into(), y1: y1.into() })
    }

    /// Mean position of the set pixels (pixel centres), or `None` when empty.
    pub fn centroid(&self) -> Option<DVec2> {
        let mut sum = DVec2::ZERO;
        let mut n = 0.0;
        for (i, on) in self.bits.iter().enumerate() {
            if *on {
                let (x, y) = (i as u32 % self.size.width, i as u32 / self.size.width);
                sum += DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                n += 1.0;
            }
        }
        (n > 0.0).then(|| sum / n)
    }

    /// Pixels set in both.
    ///
    /// # Panics
    /// When the sizes differ.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        self.zip(other, |a, b| a && b)
    }

    /// Pixels set in either.
    ///
    /// # Panics
    /// When the sizes differ.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        self.zip(other, |a, b| a || b)
    }

    /// Pixels set here and not in `other`.
    ///
    /// # Panics
    /// When the sizes differ.
    #[must_use]
    pub fn minus(&self, other: &Self) -> Self {
        self.zip(other, |a, b| a && !b)
    }

    fn zip(&self, other: &Self, f: impl Fn(bool, bool) -> bool) -> Self {
        assert_eq!(self.size, other.size, "masks of one image have one size");
        let bits = self.bits.iter().zip(&other.bits).map(|(a, b)| f(*a, *b)).collect();
        Self { size: self.size, bits }
    }

    /// Intersection over union; 0 when both are empty.
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn iou(&self, other: &Self) -> f64 {
        let i = self.and(other).count();
        let u = self.count() + other.count() - i;
        if u > 0 { i as f64 / u as f64 } else { 0.0 }
    }

    /// Nearest-neighbour resize (pixel centres).
    #[must_use]
    pub fn resized(&self, to: ImageSize) -> Self {
        if to == self.size {
            return self.clone();
        }
        Self::from_fn(to, |x, y| {
            let sx = (f64::from(x) + 0.5) * f64::from(self.size.width) / f64::from(to.width);
            let sy = (f64::from(y) + 0.5) * f64::from(self.size.height) / f64::from(to.height);
            self.get(sx as i64, sy as i64)
        })
    }

    /// Grown (`radius > 0`) or shrunk (`radius < 0`) by a square of that half width, in pixels.
    #[must_use]
    pub fn dilated(&self, radius: i32) -> Self {
        let (w, h) = (self.size.width as usize, self.size.height as usize);
        let grow = radius >= 0;
        let r = radius.unsigned_abs() as usize;
        let pass = |src: &[bool], len: usize, stride: usize, lines: usize, line_stride: usize| {
            let mut out = vec![false; src.len()];
            for line in 0..lines {
                let base = line * line_stride;
                let mut prefix = Vec::with_capacity(len + 1);
                prefix.push(0_u32);
                for k in 0..len {
                    prefix.push(prefix[k] + u32::from(src[base + k * stride]));
                }
                for k in 0..len {
                    let (a, b) = (k.saturating_sub(r), (k + r + 1).min(len));
                    let on = prefix[b] - prefix[a];
                    out[base + k * stride] = if grow { on > 0 } else { on as usize == b - a };
                }
            }
            out
        };
        let rows = pass(&self.bits, w, 1, h, w);
        let bits = pass(&rows, h, w, w, 1);
        Self { size: self.size, bits }
    }

    /// Which image borders the mask touches: left, top, right, bottom.
    pub fn touches_border(&self, margin: u32) -> [bool; 4] {
        let Some(b) = self.bounds() else { return [false; 4] };
        let m = f64::from(margin);
        [b.x0 <= m, b.y0 <= m, b.x1 >= f64::from(self.size.width) - m, b.y1 >= f64::from(self.size.height) - m]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dilation_and_erosion_change_a_square_by_the_radius() {
        let size = ImageSize::new(40, 30);
        let square = Mask::from_fn(size, |x, y| (10..20).contains(&x) && (8..15).contains(&y));
        assert_eq!(square.count(), 70);
        assert_eq!(square.dilated(2).count(), 14 * 11);
        assert_eq!(square.dilated(-2).count(), 6 * 3);
        assert_eq!(square.bounds().unwrap(), PixelBox { x0: 10.0, y0: 8.0, x1: 20.0, y1: 15.0 });
        assert_eq!(square.centroid().unwrap(), DVec2::new(15.0, 11.5));
    }
}
