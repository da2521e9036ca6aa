//! Completes partly observed surface textures, and makes tileable samples of them.
//!
//! A surface is taken as a smooth field (paint, light, vignetting) plus detail. The field goes on from the observed
//! part and settles at the median far away; the detail is copied by the exemplar fill of [`crate::inpaint`]. Known weak
//! regime: patterns larger than what was observed. The faces of a room are taken apart further ([`Survey`]): there the
//! detail is a repeating pattern and a tile, which other faces can take over ([`Look`]).

mod base;
mod detail;
mod even;
mod fineness;
mod grain;
mod lattice;
mod look;
mod quilt;
mod scatter;

use harmony_scene::ImageSize;
use image::{Rgba, RgbaImage};

use crate::color::{distance_squared, lab_from_rgb8};
use crate::inpaint::canvas::Canvas;
use crate::inpaint::complete;
use crate::noise::Random;
use crate::resample::resize_rgba;
use base::{Base, Color};

pub use detail::Detail;
pub use fineness::Fineness;
pub use grain::Grain;
pub use look::{Look, Survey, Unevenness};

/// Parameters of completion and tiles.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureSettings {
    /// Longest side at which patches are matched, pixels; the unobserved part of a larger texture is that fine only.
    pub working_px: u32,
    /// Seed of the random choices.
    pub seed: u64,
}

impl Default for TextureSettings {
    fn default() -> Self {
        Self { working_px: 512, seed: 0x5eed }
    }
}

/// Most that is added to a copied patch of detail, 8-bit levels.
const MAX_OFFSET: f32 = 5.0;
/// With fewer observed texels there is no detail to speak of.
const MIN_OBSERVED: usize = 400;
/// Islands below this share of the observed texels are dropped when their colour is this far from the median, Lab units.
const ISLAND_SHARE: f64 = 0.05;
const ISLAND_DISTANCE: f32 = 12.0;
/// Grain where nothing is known, 8-bit levels.
const GRAIN: f32 = 2.0;

/// The texture with every unobserved texel (alpha below 128) filled in; opaque.
///
/// The large-scale colour goes on from the observed part and settles at its median far away; the detail is copied from
/// observed texels. With hardly any observed texels the result is the median colour with a little noise; with none,
/// mid grey. Observed texels keep their colour, except small islands in quite another colour (the shadow under a chair,
/// what a mask has missed): those count as unobserved.
pub fn complete_surface(texture: &RgbaImage, settings: &TextureSettings) -> RgbaImage {
    let size = ImageSize::new(texture.width(), texture.height());
    if size.pixels() == 0 {
        return texture.clone();
    }
    let texture = &without_odd_islands(texture);
    let work = size.fit_within(settings.working_px.clamp(16, 4096));
    if work != size {
        let small = complete_surface(&resize_rgba(texture, work), settings);
        let filled = resize_rgba(&small, size);
        return merge(texture, |x, y| *filled.get_pixel(x, y));
    }
    let observed = texture.pixels().filter(|p| p.0[3] >= 128).count();
    let Some(base) = Base::of(texture).filter(|_| observed >= MIN_OBSERVED) else {
        let plain = grain(texture, settings.seed);
        return merge(texture, |x, y| *plain.get_pixel(x, y));
    };
    let mut canvas = Canvas {
        width: size.width as usize,
        height: size.height as usize,
        pixels: texture
            .enumerate_pixels()
            .map(|(x, y, p)| if p.0[3] >= 128 { detail(*p, base.at(x, y)) } else { [0.0; 4] })
            .collect(),
        hole: texture.pixels().map(|p| p.0[3] < 128).collect(),
        source: vec![true; size.pixels()],
        label: vec![0; size.pixels()],
    };
    complete(&mut canvas, MAX_OFFSET, settings.seed);
    merge(texture, |x, y| {
        let detail = canvas.pixels[y as usize * canvas.width + x as usize];
        let field = base.at(x, y);
        opaque(std::array::from_fn(|c| field[c] + detail[c]))
    })
}

/// The texture without small islands of observed texels whose median is far from that of the whole.
fn without_odd_islands(texture: &RgbaImage) -> RgbaImage {
    let (w, h) = (texture.width() as usize, texture.height() as usize);
    let observed: Vec<bool> = texture.pixels().map(|p| p.0[3] >= 128).collect();
    let total = observed.iter().filter(|b| **b).count();
    let Some(median) = base::median(texture) else { return texture.clone() };
    let (labels, counts) = harmony_scene::components(&observed, w, h);
    let mut sums = vec![[0.0_f32; 3]; counts.len()];
    for (label, p) in labels.iter().zip(texture.pixels()).filter(|(l, _)| **l > 0) {
        for (s, c) in sums[*label as usize].iter_mut().zip(p.0) {
            *s += f32::from(c);
        }
    }
    let lab = |color: Color| lab_from_rgb8(color.map(|c| c.round().clamp(0.0, 255.0) as u8));
    let middle = lab(median);
    let odd: Vec<bool> = sums
        .iter()
        .zip(&counts)
        .map(|(sum, n)| {
            let mean = lab(sum.map(|s| s / (*n).max(1) as f32));
            (*n as f64) < ISLAND_SHARE * total as f64 && distance_squared(mean, middle) > ISLAND_DISTANCE.powi(2)
        })
        .collect();
    let mut kept = texture.clone();
    for (p, label) in kept.pixels_mut().zip(&labels) {
        if odd[*label as usize] {
            p.0[3] = 0;
        }
    }
    kept
}

/// What a texel differs from the field by.
fn detail(p: Rgba<u8>, field: Color) -> [f32; 4] {
    [f32::from(p.0[0]) - field[0], f32::from(p.0[1]) - field[1], f32::from(p.0[2]) - field[2], 0.0]
}

fn opaque(color: Color) -> Rgba<u8> {
    let [r, g, b] = color.map(|c| c.round().clamp(0.0, 255.0) as u8);
    Rgba([r, g, b, 255])
}

/// Observed texels of the texture, the others from `fill`; opaque.
fn merge(texture: &RgbaImage, fill: impl Fn(u32, u32) -> Rgba<u8>) -> RgbaImage {
    RgbaImage::from_fn(texture.width(), texture.height(), |x, y| {
        let Rgba([r, g, b, a]) = *texture.get_pixel(x, y);
        if a >= 128 { Rgba([r, g, b, 255]) } else { fill(x, y) }
    })
}

/// The median colour (grey without any) with a little noise.
fn grain(texture: &RgbaImage, seed: u64) -> RgbaImage {
    let median = base::median(texture).unwrap_or([128.0; 3]);
    let mut random = Random::new(seed);
    RgbaImage::from_fn(texture.width(), texture.height(), |_, _| {
        let noise = (random.unit() + random.unit() - 1.0) * GRAIN;
        opaque(median.map(|c| c + noise))
    })
}

#[cfg(test)]
mod tests;
