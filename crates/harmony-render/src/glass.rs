//! See-through surfaces: all that lie before the opaque ones are blended over them, farthest first, so that the order in
//! which they are given does not matter.

use harmony_mesh::Material;

use crate::RenderOptions;
use crate::assemble::{Piece, STEPS};
use crate::prepare::Draw;
use crate::raster::Band;
use crate::shade::{Facet, glowing};
use crate::srgb::tables;

/// Materials with at least this [`opacity`] are drawn as opaque.
pub const SOLID: f32 = 0.98;

/// Linear grey that glass mirrors in flat light: what is around it, about.
const SURROUNDINGS: f32 = 0.55;

/// Share of the surroundings that glass mirrors when seen straight, at least: enough to be noticed. Physics says 0.04 for
/// window glass.
const MIN_MIRRORED: f32 = 0.07;

/// The same at grazing view, at most: a flat render must not turn rims into white lines.
const MAX_MIRRORED: f32 = 0.6;

/// Light lost by rough glass, which scatters it.
const FROST: f32 = 0.5;

/// Share of the light that a material seen straight keeps back, 0 to 1: 1 is opaque.
pub fn opacity(material: &Material) -> f32 {
    let unit = |v: f32| if v.is_nan() { 1.0 } else { v.clamp(0.0, 1.0) };
    let passes = if material.transmission.is_nan() { 0.0 } else { material.transmission.clamp(0.0, 1.0) };
    let metal = if material.metallic.is_nan() { 0.0 } else { material.metallic.clamp(0.0, 1.0) };
    unit(material.base_color[3]) * (1.0 - passes * (1.0 - metal))
}

/// How light passes through a see-through surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pane {
    /// Share of the surface's colour that is glass and not paint.
    passes: f32,
    /// Reflection seen straight.
    straight: f32,
    /// Share of what passes that arrives as haze of the surface's own colour.
    haze: f32,
}

/// What a layer does to the light behind it: `out = behind * passes + own`.
#[derive(Debug, Clone, Copy)]
struct Layer {
    passes: [f32; 3],
    own: [f32; 3],
}

impl Pane {
    pub(crate) fn new(material: &Material) -> Self {
        let unit = |v: f32, otherwise: f32| if v.is_finite() { v.clamp(0.0, 1.0) } else { otherwise };
        let ior = if material.ior.is_finite() { material.ior.max(1.0) } else { 1.5 };
        let f0 = ((ior - 1.0) / (ior + 1.0)).powi(2);
        Self {
            passes: unit(material.transmission, 0.0) * (1.0 - unit(material.metallic, 0.0)),
            straight: f0.max(MIN_MIRRORED),
            haze: FROST * unit(material.roughness, 0.6).powi(2),
        }
    }

    /// Schlick's approximation of Fresnel reflection, held so that a flat picture shows it well.
    fn mirrored(&self, cosine: f32) -> f32 {
        let grazing = (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        (self.straight + (1.0 - self.straight) * grazing).min(MAX_MIRRORED)
    }

    /// `color` is the surface's linear colour and alpha.
    fn layer(&self, [r, g, b, a]: [f32; 4], emissive: [f32; 3], cosine: f32) -> Layer {
        let mirrored = self.mirrored(cosine);
        let color = [r, g, b].map(|c| c.clamp(0.0, 1.0));
        let a = if a.is_nan() { 1.0 } else { a.clamp(0.0, 1.0) };
        // Light passes two surfaces of a pane: each takes the root of its colour, as path tracers do.
        let clear = |k: usize| self.passes * (1.0 - mirrored) * (1.0 - self.haze) * color[k].sqrt();
        let paint: [f32; 3] = std::array::from_fn(|k| {
            let hazy = self.passes * (1.0 - mirrored) * self.haze * color[k];
            (1.0 - self.passes) * color[k] + self.passes * mirrored * SURROUNDINGS + hazy
        });
        let own = glowing(paint, emissive);
        Layer { passes: std::array::from_fn(|k| 1.0 - a + a * clear(k)), own: own.map(|c| c * a) }
    }
}

/// A see-through triangle at a sample.
#[derive(Debug, Clone, Copy)]
struct Fragment {
    pixel: u32,
    triangle: u32,
    inverse_depth: f32,
}

/// Blends the see-through surfaces of a band over its colours.
///
/// `samples` are the offsets at which the band was sampled, in sub-pixel steps, with the reciprocal depths of its opaque
/// surfaces there. The mean transmission and the mean own light of a pixel's samples are applied to its resolved colour.
pub(crate) fn blend<'p>(
    draw: &Draw,
    options: &RenderOptions,
    [x0, y0]: [i32; 2],
    width: usize,
    samples: &mut [([i32; 2], Vec<f32>)],
    pieces: &(impl Iterator<Item = &'p [Piece]> + Clone),
    color: &mut [u8],
) {
    let n = color.len() / 4;
    let count = samples.len() as f32;
    let mut sums: Vec<(u32, Layer)> = Vec::new();
    for (offset, depth) in samples {
        let mut none = Vec::new();
        let band = Band {
            x0,
            y0,
            width,
            height: n / width.max(1),
            offset: *offset,
            inverse_depth: depth,
            triangle: &mut none,
        };
        let mut fragments = Vec::new();
        for piece in pieces.clone() {
            band.visit(draw, &piece[opaque_pieces(draw, piece)..], |pixel, inverse_depth, triangle| {
                fragments.push(Fragment { pixel: pixel as u32, triangle, inverse_depth });
            });
        }
        // Farthest first; of equal depths the one given first is in front, as among opaque surfaces.
        fragments.sort_unstable_by(|a, b| {
            let near = a.inverse_depth.total_cmp(&b.inverse_depth);
            a.pixel.cmp(&b.pixel).then(near).then(b.triangle.cmp(&a.triangle))
        });
        let mut run = 0;
        let shift = offset.map(|o| o as f32 / STEPS as f32);
        for stack in fragments.chunk_by(|a, b| a.pixel == b.pixel) {
            let pixel = stack[0].pixel;
            let (x, y) = (x0 + (pixel as usize % width) as i32, y0 + (pixel as usize / width) as i32);
            let mut whole = Layer { passes: [1.0; 3], own: [0.0; 3] };
            for fragment in stack {
                run = draw.run_of(fragment.triangle, run);
                let Some(pane) = draw.runs[run].glass else { continue };
                let facet = Facet::new(draw, &draw.vertices(draw.corners(fragment.triangle, run), run), run);
                let (color, cosine) = facet.film(draw, run, options, x as f32 + shift[0], y as f32 + shift[1]);
                let layer = pane.layer(color, draw.runs[run].emissive, cosine);
                whole = Layer {
                    passes: std::array::from_fn(|k| whole.passes[k] * layer.passes[k]),
                    own: std::array::from_fn(|k| whole.own[k] * layer.passes[k] + layer.own[k]),
                };
            }
            sums.push((pixel, whole));
        }
    }
    sums.sort_by_key(|(pixel, _)| *pixel);
    for same in sums.chunk_by(|a, b| a.0 == b.0) {
        let free = count - same.len() as f32;
        let mean = |f: fn(&Layer) -> [f32; 3], k: usize| same.iter().map(|(_, l)| f(l)[k]).sum::<f32>() / count;
        let layer = Layer {
            passes: std::array::from_fn(|k| mean(|l| l.passes, k) + free / count),
            own: std::array::from_fn(|k| mean(|l| l.own, k)),
        };
        let at = same[0].0 as usize * 4;
        over(&mut color[at..at + 4], &layer);
    }
}

/// Puts a layer over an sRGB pixel with alpha.
fn over(pixel: &mut [u8], layer: &Layer) {
    let tables = tables();
    let alpha = f32::from(pixel[3]) / 255.0;
    let kept = layer.passes.iter().sum::<f32>() / 3.0;
    let out = alpha * kept + (1.0 - kept);
    for (k, value) in pixel.iter_mut().take(3).enumerate() {
        let c = tables.decode[*value as usize] * alpha * layer.passes[k] + layer.own[k];
        *value = tables.encode(if out > 0.0 { c / out } else { 0.0 });
    }
    pixel[3] = (out * 255.0 + 0.5) as u8;
}

/// How many of the pieces, which are in triangle order, are opaque.
pub(crate) fn opaque_pieces(draw: &Draw, pieces: &[Piece]) -> usize {
    if draw.opaque == draw.triangles { pieces.len() } else { pieces.partition_point(|p| p.triangle < draw.opaque) }
}

/// Lets the see-through surfaces of a band claim pixels in its depth and triangle buffers, where the opaque surface behind
/// them is nothing or of the instance `backdrop`.
pub(crate) fn claim(draw: &Draw, band: &mut Band, backdrop: u32, clear: &[&[Piece]]) {
    let mut found: Vec<(usize, f32, u32)> = Vec::new();
    for pieces in clear {
        band.visit(draw, pieces, |pixel, inverse_depth, triangle| found.push((pixel, inverse_depth, triangle)));
    }
    let id_of = |triangle: u32| draw.placed[draw.runs[draw.run_of(triangle, 0)].placed].id;
    found.retain(|(pixel, ..)| {
        let behind = band.triangle[*pixel];
        behind == crate::raster::NOTHING || (backdrop != 0 && id_of(behind) == backdrop)
    });
    // After the test of all: the first glass must not keep the second from being nearer.
    for (pixel, inverse_depth, triangle) in found {
        if inverse_depth > band.inverse_depth[pixel] {
            band.inverse_depth[pixel] = inverse_depth;
            band.triangle[pixel] = triangle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glass(tint: [f32; 3]) -> Material {
        Material { transmission: 1.0, roughness: 0.0, ..Material::plain("glass", tint) }
    }

    #[test]
    fn opacity_is_alpha_times_what_does_not_pass() {
        let mut m = Material::plain("m", [1.0; 3]);
        assert_eq!(opacity(&m), 1.0);
        m.base_color[3] = 0.5;
        assert_eq!(opacity(&m), 0.5);
        m.transmission = 0.8;
        assert!((opacity(&m) - 0.1).abs() < 1e-6);
        // Metals do not let light pass, whatever is said.
        m.metallic = 1.0;
        assert_eq!(opacity(&m), 0.5);
        m.base_color[3] = f32::NAN;
        assert_eq!(opacity(&m), 1.0);
    }

    #[test]
    fn clear_glass_shows_what_is_behind_and_is_noticed_more_at_its_rim() {
        let pane = Pane::new(&glass([1.0; 3]));
        let straight = pane.layer([1.0; 4], [0.0; 3], 1.0);
        assert!((straight.passes[0] - 0.93).abs() < 1e-6, "{straight:?}");
        assert!((straight.own[1] - 0.07 * 0.55).abs() < 1e-6);
        let rim = pane.layer([1.0; 4], [0.0; 3], 0.05);
        assert!(rim.passes[2] < 0.5 && rim.own[2] > straight.own[2]);
    }

    #[test]
    fn two_surfaces_of_coloured_glass_tint_by_its_colour() {
        let pane = Pane::new(&glass([0.25, 1.0, 1.0]));
        let one = pane.layer([0.25, 1.0, 1.0, 1.0], [0.0; 3], 1.0);
        let twice = (one.passes[0] / one.passes[1]).powi(2);
        assert!((twice - 0.25).abs() < 1e-6);
    }

    #[test]
    fn without_transmission_alpha_is_plain_mixing() {
        let mut m = Material::plain("veil", [0.2, 0.4, 0.6]);
        m.base_color[3] = 0.25;
        let layer = Pane::new(&m).layer(m.base_color, [0.0; 3], 1.0);
        assert_eq!(layer.passes, [0.75; 3]);
        assert!((layer.own[2] - 0.15).abs() < 1e-6);
    }
}
