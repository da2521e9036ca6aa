//! Area-aware resampling through any map from texels to the photo.

use glam::DVec2;
use harmony_scene::{ImageSize, Mask};
use image::{RgbImage, Rgba, RgbaImage};
use rayon::prelude::*;

/// Most samples along a texel's side.
const MAX_SAMPLES: usize = 8;

/// An image whose texel (x, y), with (0, 0) the top-left corner of the first texel, shows the photo at `map`.
///
/// Each texel averages as many bilinear samples as photo pixels fall on it (bounded). A texel is opaque when at least
/// half of its samples have a place in the photo that is `visible`; else it is transparent black.
pub(super) fn resample(
    photo: &RgbImage,
    visible: Option<&Mask>,
    size: ImageSize,
    map: impl Fn(DVec2) -> Option<DVec2> + Sync,
) -> RgbaImage {
    let width = size.width as usize;
    let mut out = RgbaImage::new(size.width, size.height);
    if photo.width() == 0 || photo.height() == 0 {
        return out;
    }
    out.par_chunks_mut((width * 4).max(1)).enumerate().for_each(|(y, row)| {
        for (x, texel) in row.chunks_exact_mut(4).enumerate() {
            let at = DVec2::new(x as f64, y as f64);
            let (nx, ny) = samples_needed(&map, at);
            let mut sum = [0.0_f32; 3];
            let mut seen = 0_usize;
            for j in 0..ny {
                for i in 0..nx {
                    let inside = DVec2::new((i as f64 + 0.5) / nx as f64, (j as f64 + 0.5) / ny as f64);
                    let Some(p) = map(at + inside) else { continue };
                    if !in_photo(photo, p) || visible.is_some_and(|m| !m.get(p.x as i64, p.y as i64)) {
                        continue;
                    }
                    let color = bilinear(photo, p);
                    for (s, c) in sum.iter_mut().zip(color) {
                        *s += c;
                    }
                    seen += 1;
                }
            }
            if seen * 2 >= nx * ny && seen > 0 {
                let [r, g, b] = sum.map(|s| (s / seen as f32).round().clamp(0.0, 255.0) as u8);
                texel.copy_from_slice(&Rgba([r, g, b, 255]).0);
            }
        }
    });
    out
}

fn in_photo(photo: &RgbImage, p: DVec2) -> bool {
    p.x >= 0.0 && p.y >= 0.0 && p.x < f64::from(photo.width()) && p.y < f64::from(photo.height())
}

/// Samples along x and y of a texel: the photo pixels its sides span.
fn samples_needed(map: &impl Fn(DVec2) -> Option<DVec2>, corner: DVec2) -> (usize, usize) {
    let centre = corner + 0.5;
    let (Some(left), Some(right)) = (map(centre - DVec2::new(0.5, 0.0)), map(centre + DVec2::new(0.5, 0.0))) else {
        return (1, 1);
    };
    let (Some(top), Some(bottom)) = (map(centre - DVec2::new(0.0, 0.5)), map(centre + DVec2::new(0.0, 0.5))) else {
        return (1, 1);
    };
    let count = |length: f64| (length.ceil().max(1.0) as usize).min(MAX_SAMPLES);
    (count((right - left).length()), count((bottom - top).length()))
}

/// Colour at a position (pixel centres at halves), edge pixels continued.
pub(crate) fn bilinear(photo: &RgbImage, p: DVec2) -> [f32; 3] {
    let (w, h) = (photo.width() as usize, photo.height() as usize);
    let x = (p.x - 0.5).clamp(0.0, (w - 1) as f64);
    let y = (p.y - 0.5).clamp(0.0, (h - 1) as f64);
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
    let (tx, ty) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let data = photo.as_raw();
    std::array::from_fn(|c| {
        let at = |x: usize, y: usize| f32::from(data[(y * w + x) * 3 + c]);
        let top = at(x0, y0) * (1.0 - tx) + at(x1, y0) * tx;
        let bottom = at(x0, y1) * (1.0 - tx) + at(x1, y1) * tx;
        top * (1.0 - ty) + bottom * ty
    })
}
