//! Patterns as images.

use std::sync::Arc;

use harmony_mesh::Tile;
use image::{Rgb as Pixel, RgbImage, Rgba, RgbaImage};
use rayon::prelude::*;

use super::color::{bytes_of, linear_hex, linear_of, luminance};
use super::noise::{hash, lerp};
use super::plan::{self, Plan, amount};
use super::space::{Paint, Rgb, Sample, Space, mix, tinted};
use super::{MaterialSpec, Pattern, PatternKind as K};

/// Rounds of the correction of the mean: rounding to bytes and clipping leave less than half a step after them.
const MEAN_ROUNDS: usize = 4;
/// Least and largest roughness of a texel.
const ROUGHNESS: (f64, f64) = (0.03, 1.0);
/// What the roughness of a texel may exceed the slot's by: the material's factor is that much larger.
const ROUGHNESS_ROOM: f64 = 0.2;
/// Samples a side of the grid by which patterns made of patterns know their mean.
const MEAN_GRID: usize = 96;

/// Roughness factor of a slot with a tile; the tile's green channel is relative to it.
pub(super) fn roughness_factor(spec: &MaterialSpec) -> f64 {
    (spec.rough.clamp(0.0, 1.0) + ROUGHNESS_ROOM).min(1.0)
}

/// Quarter turns of a pattern, if it is turned by whole ones.
fn quarters(turn_deg: f64) -> Option<i32> {
    let q = turn_deg / 90.0;
    ((q - q.round()).abs() < 1e-3).then(|| (q.round() as i32).rem_euclid(4))
}

/// A pattern by its kind, in its own frame.
fn painted(space: &Space, p: &Pattern) -> Paint {
    use super::{boards, cloth, masonry, mineral, prints};
    match p.kind {
        K::Planks => boards::planks(space, p),
        K::Parquet => boards::parquet(space, p),
        K::Wood => boards::wood(space, p),
        K::Tiles => masonry::tiles(space, p),
        K::Brick => masonry::brick(space, p),
        K::Checks => prints::checks(space, p),
        K::Stripes => prints::stripes(space, p),
        K::Dots => prints::dots(space, p),
        K::Motif => prints::motif(space, p),
        K::Ramp => prints::ramp(space, p),
        K::Corrugated => prints::corrugated(space, p),
        K::Quilting => prints::quilting(space, p),
        K::Weave => cloth::weave(space, p),
        K::Knit => cloth::knit(space, p),
        K::Terry => cloth::terry(space, p),
        K::Boucle => cloth::boucle(space, p),
        K::Pile => cloth::pile(space, p),
        K::Leather => cloth::leather(space, p),
        K::Rattan => cloth::rattan(space, p),
        K::Marble => mineral::marble(space, p),
        K::Terrazzo => mineral::terrazzo(space, p),
        K::Concrete => mineral::concrete(space, p),
        K::Plaster => mineral::plaster(space, p),
        K::Grime => mineral::grime(space, p),
        K::Over => over(space, p),
        K::Tint => tint(space, p),
    }
}

/// A pattern turned by quarters and shifted, in the frame of `space`.
fn placed(space: &Space, p: &Pattern, quarter: i32) -> Paint {
    let own = if quarter % 2 == 0 { *space } else { Space { w: space.h, h: space.w, ..*space } };
    let own = Space { seed: hash(own.seed, i64::from(p.seed), 1), ..own };
    let paint = painted(&own, p);
    let [ou, ov] = p.offset.map(|o| if o.is_finite() { o } else { 0.0 });
    if quarter == 0 && ou == 0.0 && ov == 0.0 {
        return paint;
    }
    Box::new(move |u, v| {
        let (a, b) = match quarter {
            1 => (v, -u),
            2 => (-u, -v),
            3 => (-v, u),
            _ => (u, v),
        };
        paint((a - ou).rem_euclid(own.w), (b - ov).rem_euclid(own.h))
    })
}

/// A layer, turned to its nearest quarter.
fn layer(space: &Space, p: &Pattern) -> Paint {
    placed(space, p, (p.turn_deg / 90.0).round().rem_euclid(4.0) as i32)
}

/// The first layer over the second, by its cover and `amount`; where there is a third, as far as that one is white.
fn over(space: &Space, p: &Pattern) -> Paint {
    let Some(below) = p.below().map(|q| layer(space, q)) else {
        let flat = space.slot;
        return Box::new(move |_, _| Sample::flat(flat));
    };
    if p.layers.len() < 2 {
        return below;
    }
    let above = layer(space, &p.layers[0]);
    let white = Space { slot: [1.0; 3], ..*space };
    let mask = p.layers.get(2).map(|q| layer(&white, q));
    let opacity = amount(p, 1.0);
    Box::new(move |u, v| {
        let (a, b) = (above(u, v), below(u, v));
        let shown = mask.as_ref().map_or(1.0, |mask| {
            let m = mask(u, v);
            m.cover * luminance(m.color)
        });
        let t = (a.cover * opacity * shown).clamp(0.0, 1.0);
        Sample {
            height: b.height + a.height * t,
            color: mix(b.color, a.color, t),
            rough: lerp(b.rough, a.rough, t),
            cover: b.cover.max(t),
            id: if t > 0.5 { a.id } else { b.id },
        }
    })
}

/// A layer in another colour: the first of the pattern's own, else the slot's.
fn tint(space: &Space, p: &Pattern) -> Paint {
    let wanted = p.colors.first().map_or(space.slot, |c| linear_hex(c));
    let Some(q) = p.layers.first() else { return Box::new(move |_, _| Sample::flat(wanted)) };
    let paint = layer(space, q);
    let mean = plan::mean(q, space.slot).unwrap_or_else(|| sampled_mean(space, &paint));
    let factor: Rgb = std::array::from_fn(|k| wanted[k] / mean[k].max(1e-3));
    Box::new(move |u, v| {
        let s = paint(u, v);
        Sample { color: tinted(s.color, factor), ..s }
    })
}

fn sampled_mean(space: &Space, paint: &Paint) -> Rgb {
    let n = MEAN_GRID;
    let mut sum = [0.0; 3];
    for j in 0..n {
        for i in 0..n {
            let s = paint((i as f64 + 0.5) / n as f64 * space.w, (j as f64 + 0.5) / n as f64 * space.h);
            for (t, c) in sum.iter_mut().zip(s.color) {
                *t += c.clamp(0.0, 1.0) / (n * n) as f64;
            }
        }
    }
    sum
}

fn space_of(plan: &Plan, p: &Pattern, slot: Rgb) -> Space {
    let px = (plan.size[0] / f64::from(plan.px[0])).max(plan.size[1] / f64::from(plan.px[1]));
    Space { w: plan.size[0], h: plan.size[1], px, seed: hash(0x4841_524d, p.kind as i64, 0), slot }
}

/// The colour that a pattern has in the mean, linear.
pub(super) fn mean_linear(p: &Pattern, slot: Rgb) -> Rgb {
    plan::mean(p, slot).unwrap_or_else(|| {
        let plan = plan::plan(p, None);
        let space = space_of(&plan, p, slot);
        sampled_mean(&space, &placed(&space, p, 0))
    })
}

/// A pattern over its tile before it becomes images; rows from v = 0.
pub(super) struct Field {
    /// Width and height, pixels.
    pub px: [u32; 2],
    /// Width and height, metres.
    pub size: [f64; 2],
    /// Turn that the tile leaves to its coordinates, degrees.
    pub turn_deg: f64,
    /// Samples.
    pub samples: Vec<Sample>,
}

/// Samples of a pattern over its tile.
pub(super) fn field(p: &Pattern, slot: Rgb, texel: Option<f64>) -> Field {
    let plan = plan::plan(p, texel);
    let space = space_of(&plan, p, slot);
    // Quarter turns are drawn; any other turn is one of the coordinates. A pattern over another one turns with it.
    let turn = p.turn_deg + if matches!(p.kind, K::Over | K::Tint) { base_turn(p) } else { 0.0 };
    let turn = if turn.is_finite() { turn.rem_euclid(360.0) } else { 0.0 };
    let quarter = quarters(turn);
    let q = quarter.unwrap_or(0);
    let flip = q % 2 == 1;
    let swap = |a: [f64; 2]| if flip { [a[1], a[0]] } else { a };
    let size = swap(plan.size);
    let px = if flip { [plan.px[1], plan.px[0]] } else { plan.px };
    let paint = placed(&Space { w: size[0], h: size[1], ..space }, p, q);
    let (w, h) = (px[0] as usize, px[1] as usize);
    let mut samples = vec![Sample::flat([0.0; 3]); w * h];
    samples.par_chunks_mut(w).enumerate().for_each(|(j, row)| {
        let v = (j as f64 + 0.5) / h as f64 * size[1];
        for (i, s) in row.iter_mut().enumerate() {
            *s = paint((i as f64 + 0.5) / w as f64 * size[0], v);
        }
    });
    Field { px, size, turn_deg: if quarter.is_some() { 0.0 } else { turn }, samples }
}

/// The odd turn of the pattern at the bottom of a pattern of patterns, degrees: it becomes the whole tile's.
fn base_turn(p: &Pattern) -> f64 {
    let Some(below) = p.below() else { return 0.0 };
    let own = if below.turn_deg.is_finite() { below.turn_deg } else { 0.0 };
    if quarters(own).is_some() { 0.0 } else { own - (own / 90.0).round() * 90.0 }
}

/// Bakes a slot's pattern, or its plain colour, into a tile; `texel` in metres, chosen by the pattern's scale if `None`.
///
/// Colours are set so that the mean of the image (in linear light) is [`super::mean_color`]; normals are those of
/// the relief in metres times [`MaterialSpec::bump`]; the green channel of `surface` is roughness relative to the
/// factor that [`super::material`] sets. The same spec gives the same bytes.
pub fn bake_tile(spec: &MaterialSpec, texel: Option<f64>) -> Tile {
    let slot = linear_hex(&spec.color);
    let texel = texel.filter(|t| t.is_finite() && *t > 0.0).map(|t| t.clamp(1e-4, 0.05));
    let Some(p) = &spec.map else {
        let [r, g, b] = bytes_of(slot);
        return Tile {
            size: [1.0; 2],
            turn: 0.0,
            color: Arc::new(RgbaImage::from_pixel(4, 4, Rgba([r, g, b, 255]))),
            normal: None,
            surface: None,
        };
    };
    let field = field(p, slot, texel);
    let color = color_image(&field, mean_linear(p, slot));
    let bump = if spec.bump.is_finite() { spec.bump.clamp(0.0, 3.0) } else { 1.0 };
    Tile {
        size: field.size.map(|s| s as f32),
        turn: field.turn_deg.to_radians() as f32,
        color: Arc::new(color),
        normal: normal_image(&field, bump).map(Arc::new),
        surface: Some(Arc::new(surface_image(&field, spec))),
    }
}

fn color_image(field: &Field, mean: Rgb) -> RgbaImage {
    let n = field.samples.len() as f64;
    let mut factor = [1.0; 3];
    let mut image = RgbaImage::new(field.px[0], field.px[1]);
    for _ in 0..MEAN_ROUNDS {
        let mut sum = [0.0; 3];
        for (s, p) in field.samples.iter().zip(image.pixels_mut()) {
            let [r, g, b] = bytes_of(tinted(s.color, factor));
            p.0 = [r, g, b, 255];
            for (t, c) in sum.iter_mut().zip(linear_of([r, g, b])) {
                *t += c / n;
            }
        }
        let error = sum.iter().zip(mean).map(|(s, m)| (s - m).abs()).fold(0.0, f64::max);
        if error < 2e-4 {
            break;
        }
        for k in 0..3 {
            factor[k] = (factor[k] * (mean[k] + 1e-6) / (sum[k] + 1e-6)).clamp(0.1, 10.0);
        }
    }
    image
}

/// Normals of the relief in tangent space: x along the image's columns, y up the image (against v), z out.
fn normal_image(field: &Field, bump: f64) -> Option<RgbImage> {
    let (w, h) = (field.px[0] as usize, field.px[1] as usize);
    let (dx, dy) = (2.0 * field.size[0] / w as f64, 2.0 * field.size[1] / h as f64);
    let z = |i: usize, j: usize| field.samples[(j % h) * w + i % w].height * 1e-3 * bump;
    let mut flat = true;
    let mut image = RgbImage::new(field.px[0], field.px[1]);
    for j in 0..h {
        for i in 0..w {
            let a = (z(i + 1, j) - z(i + w - 1, j)) / dx;
            let b = (z(i, j + 1) - z(i, j + h - 1)) / dy;
            flat &= a.abs() < 2e-3 && b.abs() < 2e-3;
            let n = [-a, b, 1.0];
            let length = (a * a + b * b + 1.0).sqrt();
            let byte = n.map(|c| ((c / length * 0.5 + 0.5) * 255.0).round() as u8);
            image.put_pixel(i as u32, j as u32, Pixel(byte));
        }
    }
    (!flat).then_some(image)
}

/// Occlusion (none), roughness, metalness (the factor's own), at half the size.
fn surface_image(field: &Field, spec: &MaterialSpec) -> RgbImage {
    let factor = roughness_factor(spec);
    let (w, h) = (field.px[0] as usize, field.px[1] as usize);
    let at = |i: usize, j: usize| {
        let r = field.samples[j.min(h - 1) * w + i.min(w - 1)].rough + spec.rough;
        r.clamp(ROUGHNESS.0, ROUGHNESS.1)
    };
    let even = field.samples.iter().all(|s| s.rough.abs() < 5e-3);
    if even {
        let g = (spec.rough.clamp(ROUGHNESS.0, ROUGHNESS.1) / factor * 255.0).round() as u8;
        return RgbImage::from_pixel(4, 4, Pixel([255, g, 255]));
    }
    RgbImage::from_fn((w / 2).max(1) as u32, (h / 2).max(1) as u32, |x, y| {
        let (i, j) = (2 * x as usize, 2 * y as usize);
        let mean = (at(i, j) + at(i + 1, j) + at(i, j + 1) + at(i + 1, j + 1)) / 4.0;
        Pixel([255, (mean / factor * 255.0).round().min(255.0) as u8, 255])
    })
}
