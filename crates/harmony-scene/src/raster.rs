//! Boxes and one-bit masks in the image.

use std::sync::OnceLock;

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
#[derive(Debug, Clone)]
pub struct Mask {
    size: ImageSize,
    bits: Vec<bool>,
    /// What [`Mask::bounds`] found; gone once a bit may have changed.
    bounds: OnceLock<Option<PixelBox>>,
}

impl PartialEq for Mask {
    fn eq(&self, other: &Self) -> bool {
        self.size == other.size && self.bits == other.bits
    }
}

impl Eq for Mask {}

impl Mask {
    /// All off.
    pub fn empty(size: ImageSize) -> Self {
        Self::of(size, vec![false; size.pixels()])
    }

    /// From a predicate on (column, row).
    pub fn from_fn(size: ImageSize, mut f: impl FnMut(u32, u32) -> bool) -> Self {
        let mut bits = Vec::with_capacity(size.pixels());
        for y in 0..size.height {
            for x in 0..size.width {
                bits.push(f(x, y));
            }
        }
        Self::of(size, bits)
    }

    fn of(size: ImageSize, bits: Vec<bool>) -> Self {
        Self { size, bits, bounds: OnceLock::new() }
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
        self.bounds.take();
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
        self.bounds.take();
    }

    /// Number of set pixels.
    pub fn count(&self) -> usize {
        self.bits.iter().filter(|b| **b).count()
    }

    /// Tight box of the set pixels, or `None` when empty. Looked for once.
    pub fn bounds(&self) -> Option<PixelBox> {
        *self.bounds.get_or_init(|| self.find_bounds())
    }

    fn find_bounds(&self) -> Option<PixelBox> {
        let width = self.size.width as usize;
        let (mut x0, mut x1) = (width, 0);
        let (mut y0, mut y1) = (usize::MAX, 0);
        for (y, row) in self.bits.chunks_exact(width.max(1)).enumerate().filter(|(_, row)| row.contains(&true)) {
            y0 = y0.min(y);
            y1 = y + 1;
            // Only what is outside of the box so far can widen it.
            x0 = row[..x0].iter().position(|on| *on).unwrap_or(x0);
            x1 = row[x1..].iter().rposition(|on| *on).map_or(x1, |x| x1 + x + 1);
        }
        (y1 > 0).then_some(PixelBox { x0: x0 as f64, y0: y0 as f64, x1: x1 as f64, y1: y1 as f64 })
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
        Self::of(self.size, bits)
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
        let decide = |on: u32, of: usize| if grow { on > 0 } else { on as usize == of };
        let reach = |k: usize, len: usize| (k.saturating_sub(r), (k + r + 1).min(len));
        // A square is a row of columns; both passes go along the rows, where memory is.
        let mut rows = vec![false; self.bits.len()];
        let mut sums = vec![0_u32; w + 1];
        for (from, to) in self.bits.chunks_exact(w.max(1)).zip(rows.chunks_exact_mut(w.max(1))) {
            for (k, on) in from.iter().enumerate() {
                sums[k + 1] = sums[k] + u32::from(*on);
            }
            for (k, out) in to.iter_mut().enumerate() {
                let (a, b) = reach(k, w);
                *out = decide(sums[b] - sums[a], b - a);
            }
        }
        let mut bits = vec![false; self.bits.len()];
        let mut counts = vec![0_u32; w];
        let (mut first, mut end) = (0, 0);
        for y in 0..h {
            let (a, b) = reach(y, h);
            for row in end..b {
                counts.iter_mut().zip(&rows[row * w..]).for_each(|(count, on)| *count += u32::from(*on));
            }
            for row in first..a {
                counts.iter_mut().zip(&rows[row * w..]).for_each(|(count, on)| *count -= u32::from(*on));
            }
            (first, end) = (a, b);
            bits[y * w..(y + 1) * w].iter_mut().zip(&counts).for_each(|(out, count)| *out = decide(*count, b - a));
        }
        Self::of(self.size, bits)
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
    fn boxes_and_squares_are_those_of_the_definition() {
        let size = ImageSize::new(23, 17);
        for seed in 0..60_u32 {
            // Some dozen pixels, fewer in every second mask; the last masks are empty.
            let keep = if seed < 56 { 3 + seed % 2 * 20 } else { 0 };
            let hash = |x: u32, y: u32| (x * 7919 + y * 104_729 + seed * 1_299_709).wrapping_mul(2_654_435_761) >> 20;
            let mask = Mask::from_fn(size, |x, y| keep > 0 && hash(x, y) % keep == 0);
            let all = || (0..17_i64).flat_map(|y| (0..23_i64).map(move |x| (x, y)));
            let set: Vec<(i64, i64)> = all().filter(|(x, y)| mask.get(*x, *y)).collect();
            let bounds = (!set.is_empty()).then(|| PixelBox {
                x0: set.iter().map(|p| p.0).min().unwrap() as f64,
                y0: set.iter().map(|p| p.1).min().unwrap() as f64,
                x1: set.iter().map(|p| p.0).max().unwrap() as f64 + 1.0,
                y1: set.iter().map(|p| p.1).max().unwrap() as f64 + 1.0,
            });
            assert_eq!(mask.bounds(), bounds);
            let mut fuller = mask.clone();
            fuller.set(22, 16, true);
            assert_eq!(fuller.bounds().map(|b| (b.x1, b.y1)), Some((23.0, 17.0)));
            fuller.bits_mut().fill(false);
            assert_eq!(fuller.bounds(), None);
            for radius in [0, 1, 3, 30] {
                let (grown, shrunk) = (mask.dilated(radius), mask.dilated(-radius));
                for (x, y) in all() {
                    let r = i64::from(radius);
                    let mut around = all().filter(|(u, v)| (u - x).abs() <= r && (v - y).abs() <= r);
                    assert_eq!(grown.get(x, y), around.clone().any(|(u, v)| mask.get(u, v)), "{x} {y} {radius}");
                    assert_eq!(shrunk.get(x, y), around.all(|(u, v)| mask.get(u, v)), "{x} {y} -{radius}");
                }
            }
        }
    }

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
