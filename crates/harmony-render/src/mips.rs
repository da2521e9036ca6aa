//! Texture pyramids: each level averages the one below over areas, in linear light and weighted by alpha.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use image::RgbaImage;

use crate::srgb::{self, Tables};

/// A texture with its smaller copies.
#[derive(Debug)]
pub(crate) struct Pyramid {
    base: Arc<RgbaImage>,
    /// Smallest alpha of the base image.
    pub(crate) min_alpha: u8,
    /// Levels 1, 2, ...; made when first sampled.
    levels: OnceLock<Vec<RgbaImage>>,
}

impl Pyramid {
    pub(crate) fn new(base: Arc<RgbaImage>) -> Self {
        let min_alpha = base.as_raw().chunks_exact(4).fold(255, |low: u8, t| low.min(t[3]));
        Self { base, min_alpha, levels: OnceLock::new() }
    }

    fn levels(&self) -> &[RgbaImage] {
        self.levels.get_or_init(|| {
            let mut levels: Vec<RgbaImage> = Vec::new();
            loop {
                let last = levels.last().unwrap_or(&self.base);
                if last.width().max(last.height()) <= 1 {
                    return levels;
                }
                levels.push(if self.min_alpha == 255 { halved_opaque(last) } else { halved(last) });
            }
        })
    }

    /// Makes the levels now.
    pub(crate) fn build(&self) {
        self.levels();
    }

    /// Linear colour and alpha at (u, v), wrapped around; `footprint` is the squared length of a pixel's longer
    /// side in (u, v) multiplied by the texture's size, so in squared texels.
    #[inline]
    pub(crate) fn sample(&self, u: f32, v: f32, footprint: f32) -> [f32; 4] {
        let tables = srgb::tables();
        if footprint.is_nan() || footprint <= 1.0 {
            return self.bilinear(tables, &self.base, u, v);
        }
        let levels = self.levels();
        // log2 through the exponent and a linear mantissa: at most 0.09 too small, which no picture shows.
        let log2 = footprint.to_bits() as f32 * (1.0 / 8_388_608.0) - 127.0;
        let lod = (0.5 * log2).clamp(0.0, levels.len() as f32);
        let fine = lod as usize;
        let mix = lod - fine as f32;
        let mut near = self.bilinear(tables, if fine == 0 { &self.base } else { &levels[fine - 1] }, u, v);
        if mix < 0.01 || fine >= levels.len() {
            return near;
        }
        let far = self.bilinear(tables, &levels[fine], u, v);
        for (n, f) in near.iter_mut().zip(far) {
            *n += (f - *n) * mix;
        }
        near
    }

    /// Size of the full texture.
    #[inline]
    pub(crate) fn size(&self) -> (f32, f32) {
        (self.base.width() as f32, self.base.height() as f32)
    }

    #[inline]
    fn bilinear(&self, tables: &Tables, image: &RgbaImage, u: f32, v: f32) -> [f32; 4] {
        let (w, h) = (image.width() as usize, image.height() as usize);
        if w == 0 || h == 0 {
            return [1.0; 4];
        }
        let (x0, x1, fx) = neighbours(u, w);
        let (y0, y1, fy) = neighbours(v, h);
        let raw = image.as_raw().as_slice();
        let corners = [
            (texel(raw, y0 * w + x0), (1.0 - fx) * (1.0 - fy)),
            (texel(raw, y0 * w + x1), fx * (1.0 - fy)),
            (texel(raw, y1 * w + x0), (1.0 - fx) * fy),
            (texel(raw, y1 * w + x1), fx * fy),
        ];
        let mut sum = [0.0; 4];
        if self.min_alpha == 255 {
            for (t, k) in corners {
                for (s, c) in sum.iter_mut().zip(&t[..3]) {
                    *s += tables.decode[*c as usize] * k;
                }
            }
            sum[3] = 1.0;
            return sum;
        }
        for (t, k) in corners {
            let a = f32::from(t[3]) * k;
            for (s, c) in sum.iter_mut().zip(&t[..3]) {
                *s += tables.decode[*c as usize] * a;
            }
            sum[3] += a;
        }
        let a = sum[3];
        if a <= 0.0 { [0.0; 4] } else { [sum[0] / a, sum[1] / a, sum[2] / a, a / 255.0] }
    }
}

/// The two texels around a wrapped coordinate, and the share of the second.
#[inline]
fn neighbours(u: f32, n: usize) -> (usize, usize, f32) {
    // Whole numbers by casts (they saturate, NaN becomes 0): `floor` is a call on the basic x86-64 target.
    let mut t = u - (u as i32) as f32;
    if t < 0.0 {
        t += 1.0;
    }
    let t = if (0.0..=1.0).contains(&t) { t } else { 0.0 };
    let s = t * n as f32 + 0.5;
    let next = (s as usize).min(n);
    (if next == 0 { n } else { next } - 1, if next == n { 0 } else { next }, s - next as f32)
}

#[inline]
fn texel(raw: &[u8], i: usize) -> [u8; 4] {
    let p = &raw[i * 4..i * 4 + 4];
    [p[0], p[1], p[2], p[3]]
}

/// [`halved`] for opaque images, which takes four texels to one where both sides are even.
fn halved_opaque(image: &RgbaImage) -> RgbaImage {
    let (w, h) = (image.width(), image.height());
    if w % 2 != 0 || h % 2 != 0 {
        return halved(image);
    }
    let tables = srgb::tables();
    let row = w as usize * 4;
    let mut out = Vec::with_capacity(image.as_raw().len() / 4);
    for pair in image.as_raw().chunks_exact(2 * row) {
        let (top, bottom) = pair.split_at(row);
        for (a, b) in top.chunks_exact(8).zip(bottom.chunks_exact(8)) {
            let mean = |i: usize| {
                let d = |byte: u8| tables.decode[byte as usize];
                tables.encode((d(a[i]) + d(a[i + 4]) + d(b[i]) + d(b[i + 4])) * 0.25)
            };
            out.extend([mean(0), mean(1), mean(2), 255]);
        }
    }
    RgbaImage::from_raw(w / 2, h / 2, out).unwrap_or_default()
}

/// Half the size (rounded down, at least 1) by area averages in linear light.
fn halved(image: &RgbaImage) -> RgbaImage {
    let tables = srgb::tables();
    let (w, h) = (image.width(), image.height());
    let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
    let columns: Vec<Vec<(usize, f32)>> = (0..nw).map(|x| taps(x, nw, w)).collect();
    let raw = image.as_raw().as_slice();
    let mut out = Vec::with_capacity(nw as usize * nh as usize * 4);
    for y in 0..nh {
        let rows = taps(y, nh, h);
        for column in &columns {
            let (mut color, mut alpha, mut weight) = ([0.0_f32; 3], 0.0, 0.0);
            for (sy, ky) in &rows {
                for (sx, kx) in column {
                    let t = texel(raw, sy * w as usize + sx);
                    let k = kx * ky;
                    let a = f32::from(t[3]) * k;
                    for (s, c) in color.iter_mut().zip(&t[..3]) {
                        *s += tables.decode[*c as usize] * a;
                    }
                    alpha += a;
                    weight += k;
                }
            }
            let inverse = if alpha > 0.0 { 1.0 / alpha } else { 0.0 };
            out.extend(color.map(|c| tables.encode(c * inverse)));
            out.push((alpha / weight + 0.5) as u8);
        }
    }
    RgbaImage::from_raw(nw, nh, out).unwrap_or_default()
}

/// Source positions and weights of one output position of an area average from `from` down to `to` samples.
fn taps(i: u32, to: u32, from: u32) -> Vec<(usize, f32)> {
    let k = f64::from(from) / f64::from(to);
    let (start, end) = (f64::from(i) * k, f64::from(i + 1) * k);
    (start.floor() as u32..(end.ceil() as u32).min(from))
        .map(|s| (s as usize, (end.min(f64::from(s) + 1.0) - start.max(f64::from(s))) as f32))
        .filter(|(_, w)| *w > 1e-6)
        .collect()
}

/// Pyramids by texture, kept while somebody else still holds the texture.
#[derive(Debug, Default)]
pub(crate) struct MipCache {
    // The key is the address of an image that the value keeps alive, so it cannot be taken by another one.
    known: Mutex<BTreeMap<usize, Arc<Pyramid>>>,
}

impl MipCache {
    /// The pyramid of a texture.
    pub(crate) fn get(&self, texture: &Arc<RgbaImage>) -> Arc<Pyramid> {
        let key = Arc::as_ptr(texture) as usize;
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(known.entry(key).or_insert_with(|| Arc::new(Pyramid::new(Arc::clone(texture)))))
    }

    /// Forgets textures that nobody else holds.
    pub(crate) fn sweep(&self) {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|_, p| Arc::strong_count(p) > 1 || Arc::strong_count(&p.base) > 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    #[test]
    fn the_smallest_level_is_the_mean_in_linear_light() {
        for (w, h) in [(64, 64), (65, 33), (7, 1), (3, 5)] {
            // Columns 0, 2, 4, ... are white.
            let image = RgbaImage::from_fn(w, h, |x, _| Rgba(if x % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] }));
            let white = f64::from(w.div_ceil(2)) / f64::from(w);
            let p = Pyramid::new(Arc::new(image));
            let got = p.sample(0.3, 0.7, 1e9)[1];
            assert!((f64::from(got) - white).abs() < 0.03, "{w}x{h}: {got} for {white}");
            assert_eq!(p.levels().last().unwrap().dimensions(), (1, 1));
        }
    }

    #[test]
    fn the_quick_way_to_halve_agrees_with_the_general_one() {
        let image = RgbaImage::from_fn(12, 6, |x, y| Rgba([(x * 21) as u8, (y * 50) as u8, (x * y * 4) as u8, 255]));
        let (quick, general) = (halved_opaque(&image), halved(&image));
        assert_eq!(quick.dimensions(), (6, 3));
        assert!(quick.as_raw().iter().zip(general.as_raw()).all(|(a, b)| a.abs_diff(*b) <= 1));
    }

    #[test]
    fn transparent_texels_do_not_tint_their_neighbours() {
        let image = RgbaImage::from_fn(8, 8, |x, _| Rgba(if x < 4 { [200, 10, 10, 255] } else { [0, 255, 0, 0] }));
        let p = Pyramid::new(Arc::new(image));
        let c = p.sample(0.5, 0.5, 30.0);
        assert!(c[1] < 0.01, "{c:?}");
        assert!(c[3] > 0.2 && c[3] < 0.8, "{c:?}");
    }

    #[test]
    fn texel_centres_give_the_texel_and_coordinates_wrap() {
        let image = RgbaImage::from_fn(4, 2, |x, y| Rgba([(x * 60) as u8, (y * 200) as u8, 9, 255]));
        let p = Pyramid::new(Arc::new(image));
        for turn in [-3.0, 0.0, 2.0] {
            let c = p.sample(turn + 2.5 / 4.0, 1.5 / 2.0 - turn, 0.0);
            let back = [0, 1, 2].map(|i| srgb::tables().encode(c[i]));
            assert_eq!(back, [120, 200, 9]);
        }
        for bad in [f32::NAN, f32::INFINITY, -1e30, 1e30] {
            let _ = p.sample(bad, 0.5, bad);
        }
    }
}
