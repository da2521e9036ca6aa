//! From visible triangles to pixels: shading, averaging of samples, and the final depth and ids.

use crate::RenderOptions;
use crate::assemble::{Piece, STEPS};
use crate::glass::opaque_pieces;
use crate::prepare::{Draw, Vertices};
use crate::raster::{Band, NOTHING};
use crate::shade::Facet;
use crate::srgb::{Tables, tables};

/// The four samples of a pixel, in sub-pixel steps from its centre (a square turned by 27 degrees).
const SAMPLES: [[i32; 2]; 4] = [[-32, -96], [96, -32], [-96, 32], [32, 96]];

/// Largest coordinate in [`SAMPLES`].
pub(crate) const SPREAD: i32 = 96;

/// The triangle that was shaded last, for its neighbour pixels.
struct Shader<'d, 'a> {
    draw: &'d Draw<'a>,
    options: &'d RenderOptions,
    last: Option<(u32, usize, Facet)>,
}

impl Shader<'_, '_> {
    fn color(&mut self, triangle: u32, x: f32, y: f32, samples: u32) -> [f32; 3] {
        let (run, facet) = match self.last {
            Some((t, run, facet)) if t == triangle => (run, facet),
            _ => {
                let run = self.draw.run_of(triangle, self.last.map_or(0, |l| l.1));
                let facet = Facet::new(self.draw, &self.draw.vertices(self.draw.corners(triangle, run), run), run);
                self.last = Some((triangle, run, facet));
                (run, facet)
            }
        };
        facet.color(self.draw, run, self.options, x, y, samples)
    }
}

/// Colours a band with one sample a pixel.
///
/// Pixels go through in batches, one step after the other: on a large mesh each visible triangle costs several
/// trips to memory, and in this order the trips of a batch overlap.
pub(crate) fn single(draw: &Draw, options: &RenderOptions, band: &Band, color: &mut [u8]) {
    const BATCH: usize = 64;
    /// A pixel to shade, and what its triangle was found to be.
    #[derive(Clone, Copy, Default)]
    struct Pixel {
        at: usize,
        run: usize,
        corners: [usize; 3],
    }
    let tables = tables();
    let mut pixels = [Pixel::default(); BATCH];
    let mut vertices = [Vertices::default(); BATCH];
    let mut run = 0;
    let mut next = 0;
    while next < band.triangle.len() {
        let mut count = 0;
        while next < band.triangle.len() && count < BATCH {
            let triangle = band.triangle[next];
            if triangle != NOTHING {
                run = draw.run_of(triangle, run);
                pixels[count] = Pixel { at: next, run, corners: draw.corners(triangle, run) };
                count += 1;
            }
            next += 1;
        }
        for (pixel, v) in pixels[..count].iter().zip(&mut vertices) {
            *v = draw.vertices(pixel.corners, pixel.run);
        }
        let mut last: Option<(Pixel, Facet)> = None;
        for (pixel, v) in pixels[..count].iter().zip(&vertices) {
            let facet = match last {
                Some((p, facet)) if p.corners == pixel.corners && p.run == pixel.run => facet,
                _ => Facet::new(draw, v, pixel.run),
            };
            last = Some((*pixel, facet));
            let (x, y) = (band.x0 + (pixel.at % band.width) as i32, band.y0 + (pixel.at / band.width) as i32);
            let c = facet.color(draw, pixel.run, options, x as f32, y as f32, 1);
            let out = &mut color[pixel.at * 4..pixel.at * 4 + 4];
            out.copy_from_slice(&[tables.encode(c[0]), tables.encode(c[1]), tables.encode(c[2]), 255]);
        }
    }
}

/// Draws a band again at four samples a pixel and averages their colours in linear light.
///
/// A triangle is shaded once a pixel, at the middle of the samples it covers. Returns the reciprocal depths of the samples
/// when there are see-through surfaces to blend over them.
pub(crate) fn multisampled<'p>(
    draw: &Draw,
    options: &RenderOptions,
    x0: i32,
    y0: i32,
    width: usize,
    pieces: &(impl Iterator<Item = &'p [Piece]> + Clone),
    color: &mut [u8],
) -> Vec<([i32; 2], Vec<f32>)> {
    let n = color.len() / 4;
    let height = n / width;
    let mut depth = vec![0.0; n];
    let mut depths = Vec::new();
    let layers: Vec<Vec<u32>> = SAMPLES
        .iter()
        .map(|offset| {
            let mut triangle = vec![NOTHING; n];
            let mut band =
                Band { x0, y0, width, height, offset: *offset, inverse_depth: &mut depth, triangle: &mut triangle };
            band.clear();
            pieces.clone().for_each(|p| band.draw(draw, &p[..opaque_pieces(draw, p)]));
            if draw.opaque < draw.triangles {
                depths.push((*offset, depth.clone()));
            }
            triangle
        })
        .collect();
    let tables = tables();
    let mut shader = Shader { draw, options, last: None };
    for (i, out) in color.chunks_exact_mut(4).enumerate() {
        let (x, y) = ((x0 + (i % width) as i32) as f32, (y0 + (i / width) as i32) as f32);
        let seen = [layers[0][i], layers[1][i], layers[2][i], layers[3][i]];
        if seen == [NOTHING; 4] {
            continue;
        }
        let mut sum = Sum::default();
        for (k, triangle) in seen.iter().enumerate() {
            if *triangle == NOTHING {
                sum.background(options.background, tables);
            } else if !seen[..k].contains(triangle) {
                let mine = || SAMPLES.iter().zip(&seen).filter(|(_, t)| *t == triangle).map(|(s, _)| s);
                let samples = mine().count() as u32;
                let count = samples as f32;
                let middle = |axis: usize| mine().map(|s| s[axis] as f32).sum::<f32>() / (count * STEPS as f32);
                let c = shader.color(*triangle, x + middle(0), y + middle(1), samples);
                // Clamped before averaging: an overbright sample must not outshine its neighbours.
                sum.add(c.map(|v| v.clamp(0.0, 1.0)), 1.0, count);
            }
        }
        out.copy_from_slice(&sum.pixel(tables));
    }
    depths
}

/// Weighted colours, premultiplied by their alpha.
#[derive(Default)]
struct Sum {
    color: [f32; 3],
    alpha: f32,
    weight: f32,
}

impl Sum {
    fn add(&mut self, color: [f32; 3], alpha: f32, weight: f32) {
        for (s, c) in self.color.iter_mut().zip(color) {
            *s += c * alpha * weight;
        }
        self.alpha += alpha * weight;
        self.weight += weight;
    }

    fn background(&mut self, [r, g, b, a]: [u8; 4], tables: &Tables) {
        self.add([r, g, b].map(|c| tables.decode[c as usize]), f32::from(a) / 255.0, 1.0);
    }

    fn pixel(&self, tables: &Tables) -> [u8; 4] {
        let [r, g, b] = self.color.map(|c| tables.encode(c / self.alpha));
        [r, g, b, (self.alpha / self.weight * 255.0 + 0.5) as u8]
    }
}

/// Turns reciprocal depths into metres and triangle numbers into instance ids.
pub(crate) fn finish(draw: &Draw, band: &mut Band) {
    let mut run = 0;
    for (depth, id) in band.inverse_depth.iter_mut().zip(band.triangle.iter_mut()) {
        if *id == NOTHING {
            *id = 0;
        } else {
            run = draw.run_of(*id, run);
            *depth = 1.0 / *depth;
            *id = draw.placed[draw.runs[run].placed].id;
        }
    }
}
