//! What a surface is made of, from the part of it that was seen: a lit colour field, a repeating pattern when there is
//! one, and a tile of what is left.
//!
//! A texel is field x pattern x tile. The field is the smooth part: paint under the light of the photo. It is kept, for
//! a flat render is compared with photos at the same exposure: a floor is darker under a bed and a wall behind a
//! cupboard. Away from what was seen it settles at the typical colour, neither darker nor lighter because the photo ends
//! there. The tile has an even brightness, so that it can be laid anywhere, on other surfaces as well.

use glam::{DMat2, DVec2};
use image::{Rgba, RgbaImage};

use super::base::{self, Base, Color, Smoothing};
use super::even;
use super::fineness::Fineness;
use super::grain::{Grain, Tile};
use super::lattice::{Lattice, Ratios};
use super::{MIN_OBSERVED, opaque, without_odd_islands};
use crate::distance::distance_to;

/// Side of a cell of the field, metres.
const CELL: f64 = 0.07;
/// Most cells along a side.
const MAX_CELLS: usize = 72;
/// Blur of the field, metres; at least the pattern's period.
const BLUR: f64 = 0.16;
/// Distance in which the field settles, metres: light changes over a room, not at the edge of what was seen of it.
const SETTLING: f64 = 1.5;
/// How far the light of a surface of which little was seen is believed, metres.
const LITTLE_REACH: f64 = 0.5;
/// Soft border between photo and material, metres.
const FEATHER: f64 = 0.03;
/// Side of the squares in which photo and material are compared at their border, metres, how far the difference is carried
/// on, metres, and its most, as a logarithm.
const SEAM_CELL: f64 = 0.03;
const SEAM_REACH: f64 = 0.3;
const MAX_SEAM: f32 = 0.5;
/// Alpha from which a texel is kept; less than that, and 128 or more, tells the light only.
const KEPT: u8 = 224;
/// Ratios outside this range are no grain; dark joints and knots belong to a coarse one.
const FINE_RANGE: [f32; 2] = [0.6, 1.5];
const COARSE_RANGE: [f32; 2] = [0.3, 2.2];
/// Colour below which a ratio says nothing, 8-bit levels.
const DARKEST: f32 = 6.0;
/// An island in another colour than predicted by this much is not the surface, 8-bit levels.
const ODD: f32 = 28.0;

/// Side of the squares whose mean tones are compared, metres: finer differences are grain.
const PIECE: f64 = 0.05;
/// Fewest squares whose spread says something.
const MIN_SQUARES: usize = 30;
/// Brightness (8-bit levels) from which a texel can be in the sun, how many times the typical one that is at least, how wide such
/// a patch is, metres, how far its soft edge reaches, and its most share of what was seen: more is a light surface.
const SUN: f32 = 190.0;
const SUN_TIMES: f32 = 1.8;
const SUN_WIDTH: f64 = 0.06;
const SUN_EDGE: f64 = 0.05;
const MAX_SUN: f64 = 0.15;

/// Spread of such squares that boards or tiles of one floor have at most, as a logarithm, and what any surface may have.
const MAX_PIECES: f32 = 0.12;
const USUAL_PIECES: f32 = 0.03;

/// A material that was seen somewhere: what other surfaces can be painted with.
#[derive(Debug, Clone)]
pub struct Look {
    /// Typical colour under the photo's light, sRGB levels 0 to 255.
    pub color: [f32; 3],
    pattern: Option<Lattice>,
    tile: Tile,
}

/// A partly seen surface taken apart.
#[derive(Debug, Clone)]
pub struct Survey {
    /// Its material.
    pub look: Look,
    /// Texels that were seen, metres squared of them with the pixels a metre given.
    pub seen_area: f64,
    texture: RgbaImage,
    field: Base,
    fineness: Fineness,
    /// Factor on the light away from what was seen.
    elsewhere: Color,
    px_per_m: f64,
}

/// How uneven a material is under even light: robust standard deviations of the logarithm of brightness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unevenness {
    /// Between squares of 5 cm: boards, tiles, stains.
    pub pieces: f32,
    /// Within them.
    pub grain: f32,
}

impl Look {
    /// A plain colour with the grain of paint.
    pub fn plain(color: [f32; 3], seed: u64) -> Self {
        Self { color, pattern: None, tile: Tile::grain(seed) }
    }

    /// The same material in another colour.
    #[must_use]
    pub fn tinted(&self, color: [f32; 3]) -> Self {
        Self { color, ..self.clone() }
    }

    /// The same material without its pattern.
    #[must_use]
    pub fn unpatterned(&self) -> Self {
        Self { pattern: None, ..self.clone() }
    }

    /// The same colour with a picture of one period instead of what was seen: `cell_from_texel` gives the place in the
    /// picture (0 to 1 across and down) of a texel. A picture without area changes nothing.
    #[must_use]
    pub fn printed(&self, picture: &RgbaImage, cell_from_texel: DMat2, seed: u64) -> Self {
        match Lattice::printed(picture, cell_from_texel) {
            Some(pattern) => Self { color: self.color, pattern: Some(pattern), tile: Tile::grain(seed) },
            None => self.clone(),
        }
    }

    /// The same material, the differences within its pattern that many times as strong (as logarithms).
    #[must_use]
    pub fn with_contrast(&self, times: f32) -> Self {
        Self { pattern: self.pattern.as_ref().map(|p| p.with_contrast(times)), ..self.clone() }
    }

    /// The same material with the grain of another that was seen at the same texel size.
    #[must_use]
    pub fn with_grain_of(&self, other: &Self) -> Self {
        Self { tile: other.tile.clone(), ..self.clone() }
    }

    /// The periods of its pattern, texels, when it has one.
    pub fn periods(&self) -> Option<[DVec2; 2]> {
        self.pattern.as_ref().map(Lattice::periods)
    }

    /// A surface of that material under even light; `width` x `height` texels of the size that it was seen at.
    pub fn paint(&self, width: u32, height: u32) -> RgbaImage {
        RgbaImage::from_fn(width, height, |x, y| opaque(self.times(x, y, self.color)))
    }

    /// Its colour at a texel, with its pattern and without its grain.
    fn piece(&self, x: u32, y: u32) -> Color {
        let pattern = self.pattern_at(x, y);
        std::array::from_fn(|c| self.color[c] * pattern[c])
    }

    fn pattern_at(&self, x: u32, y: u32) -> Color {
        self.pattern.as_ref().map_or([1.0; 3], |p| p.at(f64::from(x) + 0.5, f64::from(y) + 0.5))
    }

    fn times(&self, x: u32, y: u32, light: Color) -> Color {
        let (grain, pattern) = (self.tile.at(x, y), self.pattern_at(x, y));
        std::array::from_fn(|c| light[c] * grain[c] * pattern[c])
    }
}

/// Texels of patches of sun: wide, far brighter than the rest and a small part of it. They are the photo's light, and would be
/// laid all over the surface. `None` without any.
fn sunlit(texture: &RgbaImage, px_per_m: f64) -> Option<Vec<bool>> {
    let luma = |p: &Rgba<u8>| 0.2126 * f32::from(p.0[0]) + 0.7152 * f32::from(p.0[1]) + 0.0722 * f32::from(p.0[2]);
    let mut all: Vec<f32> = texture.pixels().filter(|p| p.0[3] >= 128).map(luma).collect();
    if all.is_empty() {
        return None;
    }
    let middle = all.len() / 2;
    let typical = *all.select_nth_unstable_by(middle, f32::total_cmp).1;
    let least = SUN.max(SUN_TIMES * typical);
    let (width, height) = (texture.width() as usize, texture.height() as usize);
    let bright: Vec<bool> = texture.pixels().map(|p| p.0[3] >= 128 && luma(p) >= least).collect();
    let count = bright.iter().filter(|b| **b).count();
    if count == 0 || count as f64 > MAX_SUN * all.len() as f64 {
        return None;
    }
    // What is no wider than a joint is none.
    let other: Vec<bool> = bright.iter().map(|b| !b).collect();
    let half = (SUN_WIDTH / 2.0 * px_per_m) as f32;
    let core: Vec<bool> = distance_to(&other, width, height).into_iter().map(|d| d.is_finite() && d > half).collect();
    let reach = half + (SUN_EDGE * px_per_m) as f32;
    core.contains(&true).then(|| distance_to(&core, width, height).into_iter().map(|d| d <= reach).collect())
}

impl Survey {
    /// Takes apart what was seen (alpha 128 or more); `None` when that is hardly anything.
    ///
    /// Texels with alpha 224 or more are kept as they are. The others that were seen, next to objects and in nooks
    /// between them, tell the light and the colour, but their shapes would be left as ghosts.
    /// Grain is taken where the photo shows the texels sharply (`fineness`).
    pub fn of(texture: &RgbaImage, fineness: &Fineness, px_per_m: f64, grain: Grain, seed: u64) -> Option<Self> {
        let width = texture.width() as usize;
        if !(px_per_m.is_finite() && px_per_m > 0.0) {
            return None;
        }
        let mut known = without_odd_islands(texture);
        if let Some(sun) = sunlit(&known, px_per_m) {
            known.pixels_mut().zip(sun).filter(|(_, lit)| *lit).for_each(|(p, _)| p.0[3] = 0);
        }
        let count = known.pixels().filter(|p| p.0[3] >= 128).count();
        if count < MIN_OBSERVED {
            return None;
        }
        // Against a light that is far smoother than any pattern.
        let trend = Trend::of(&known)?;
        let pattern = Lattice::find(&Ratios {
            width,
            height: texture.height() as usize,
            values: &kept(&known, ratios(&known, |x, y| trend.at(x, y))),
        });
        let mut smoothing = smoothing(texture, px_per_m);
        let mut pattern = pattern;
        if let Some(lattice) = &pattern {
            let period = lattice.periods().into_iter().map(DVec2::length).fold(0.0, f64::max);
            smoothing.blur = smoothing.blur.max((0.7 * period / smoothing.cell as f64) as f32);
        }
        let mut field = Base::smooth(&without_pattern(&known, pattern.as_ref()), &smoothing)?;
        if let Some(lattice) = pattern.take() {
            let values = kept(&known, ratios(&known, |x, y| field.at(x, y)));
            let again = lattice.averaged_again(&Ratios { width, height: texture.height() as usize, values: &values });
            pattern = Some(again.unwrap_or(lattice));
            field = Base::smooth(&without_pattern(&known, pattern.as_ref()), &smoothing)?;
        }
        let look = Look { color: field.median, pattern, tile: Tile::of(1, vec![[1.0; 3]]) };
        let [lowest, highest] = if grain == Grain::Fine { FINE_RANGE } else { COARSE_RANGE };
        let rest: Vec<Option<Color>> = kept(&known, ratios(&known, |x, y| look.times(x, y, field.at(x, y))))
            .into_iter()
            .map(|c| c.filter(|c| c.iter().all(|v| (lowest..=highest).contains(v))))
            .collect();
        let tile = Tile::quilted(&rest, fineness, width, grain, seed);
        let texture = believed(texture, &look, &field);
        let seen_area = texture.pixels().filter(|p| p.0[3] >= 128).count() as f64 / (px_per_m * px_per_m);
        Some(Self {
            look: Look { tile, ..look },
            seen_area,
            texture,
            field,
            fineness: fineness.clone(),
            elsewhere: [1.0; 3],
            px_per_m,
        })
    }

    /// The same surface, away from what was seen of it in another typical colour: what little shows lies in a corner, or
    /// beside a lamp.
    #[must_use]
    pub fn settling_at(mut self, color: [f32; 3]) -> Self {
        self.elsewhere = std::array::from_fn(|c| color[c] / self.look.color[c].max(1.0));
        self.look.color = color;
        self
    }

    /// The light at a texel so far from what was seen.
    fn light(&self, x: u32, y: u32, away: f32) -> Color {
        let far = smoothstep(away / (LITTLE_REACH * self.px_per_m) as f32);
        let field = self.field.at(x, y);
        std::array::from_fn(|c| field[c] * (1.0 + far * (self.elsewhere[c] - 1.0)))
    }

    /// The whole surface: the photo where it was seen, and, with a soft border, the material elsewhere; opaque.
    pub fn complete(&self) -> RgbaImage {
        self.completed(&self.look, |x, y, away| self.look.times(x, y, self.light(x, y, away)))
    }

    /// [`Survey::complete`] with another pattern under the light that was seen.
    pub fn complete_as(&self, look: &Look) -> RgbaImage {
        self.completed(look, |x, y, away| look.times(x, y, self.light(x, y, away)))
    }

    /// The whole surface in a material under even light, for whoever lights it again: what was seen without its light,
    /// and the material elsewhere; opaque. On a floor (`Grain::Coarse`) boards or tiles differ by as much as the look's do,
    /// or [`MAX_PIECES`]; what differs by more is light. Elsewhere what differs as much as all that was seen does may be a
    /// pattern.
    pub fn even(&self, look: &Look, grain: Grain) -> RgbaImage {
        let own = self.unevenness().map_or(USUAL_PIECES, |u| u.pieces);
        let named = self.unevenness_in(look).map_or(0.0, |u| u.pieces);
        let pieces = if grain == Grain::Coarse { own.min(named.max(MAX_PIECES)) } else { own.max(USUAL_PIECES) };
        let seen = even::Seen { texture: &self.texture, kept: KEPT, px_per_m: self.px_per_m, pieces };
        let texture = even::even(&seen, |x, y| look.piece(x, y));
        Self { texture, ..self.clone() }.completed(look, |x, y, _| look.times(x, y, look.color))
    }

    /// How uneven what was seen is; `None` when too little was.
    pub fn unevenness(&self) -> Option<Unevenness> {
        self.uneven(&self.texture)
    }

    /// How uneven the same places would be in another material.
    pub fn unevenness_in(&self, look: &Look) -> Option<Unevenness> {
        let mut painted = look.paint(self.texture.width(), self.texture.height());
        for (p, seen) in painted.pixels_mut().zip(self.texture.pixels()) {
            p.0[3] = seen.0[3];
        }
        self.uneven(&painted)
    }

    fn uneven(&self, texture: &RgbaImage) -> Option<Unevenness> {
        let field = Base::smooth(texture, &smoothing(texture, self.px_per_m))?;
        let luma = |c: Color| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        let side = ((PIECE * self.px_per_m).round() as usize).max(2);
        let columns = (texture.width() as usize).div_ceil(side);
        let mut squares: Vec<Vec<f32>> = vec![Vec::new(); columns * (texture.height() as usize).div_ceil(side)];
        let ratios = kept(texture, ratios(texture, |x, y| field.at(x, y)));
        for ((x, y, _), ratio) in texture.enumerate_pixels().zip(ratios) {
            if let Some(ratio) = ratio {
                squares[y as usize / side * columns + x as usize / side].push(luma(ratio).max(1e-3).ln());
            }
        }
        squares.retain(|s| 2 * s.len() >= side * side);
        let means: Vec<f32> = squares.iter().map(|s| s.iter().sum::<f32>() / s.len() as f32).collect();
        let within = squares.iter().zip(&means).flat_map(|(s, mean)| s.iter().map(move |v| v - mean)).collect();
        Some(Unevenness { pieces: spread(means)?, grain: spread(within)? })
    }

    /// What was seen, its uneven light taken out; alpha 255 where it was kept.
    pub fn delit(&self) -> RgbaImage {
        RgbaImage::from_fn(self.texture.width(), self.texture.height(), |x, y| {
            let p = self.texture.get_pixel(x, y).0;
            let field = self.field.at(x, y);
            let [r, g, b, _] =
                opaque(std::array::from_fn(|c| f32::from(p[c]) / field[c].max(1.0) * self.look.color[c])).0;
            if p[3] < KEPT { Rgba([0; 4]) } else { Rgba([r, g, b, 255]) }
        })
    }

    /// What was seen, in another material: for a surface of which too little was seen to tell its own.
    pub fn complete_in(&self, look: &Look) -> RgbaImage {
        let reach = (LITTLE_REACH * self.px_per_m) as f32;
        self.completed(look, |x, y, away| {
            // Towards the little that was seen the light is the one seen there.
            let near = 1.0 - smoothstep(away / reach);
            let field = self.field.at(x, y);
            look.times(x, y, std::array::from_fn(|c| look.color[c] + near * (field[c] - look.color[c])))
        })
    }

    /// The photo over a material that is given texel by texel, with the distance to what was seen. What of the look is
    /// finer than the photo's pixels is added to it: from the photo's place nothing changes, and from nearby the seen part
    /// is no blur beside the rest.
    fn completed(&self, look: &Look, material: impl Fn(u32, u32, f32) -> Color) -> RgbaImage {
        let (width, height) = (self.texture.width() as usize, self.texture.height() as usize);
        let unseen: Vec<bool> = self.texture.pixels().map(|p| p.0[3] < KEPT).collect();
        let seen: Vec<bool> = unseen.iter().map(|b| !b).collect();
        let depth = distance_to(&unseen, width, height);
        let away = distance_to(&seen, width, height);
        let feather = (FEATHER * self.px_per_m).max(2.0) as f32;
        let kept = (0..seen.len()).filter(|i| seen[*i]).map(|i| (i % width, i / width));
        let lost = self.fineness.loses(kept).then(|| {
            (0..width * height)
                .map(|i| look.times((i % width) as u32, (i / width) as u32, [1.0; 3]))
                .collect::<Vec<_>>()
        });
        let seam = Seam::of(&self.texture, self.px_per_m, |x, y| material(x, y, 0.0));
        RgbaImage::from_fn(width as u32, height as u32, |x, y| {
            let i = y as usize * width + x as usize;
            let joined = seam.at(x, y, away[i]);
            let material = material(x, y, away[i]);
            let material: Color = std::array::from_fn(|c| material[c] * joined[c]);
            let photo = self.texture.get_pixel(x, y).0;
            let weight = if unseen[i] { 0.0 } else { smoothstep((depth[i] - 0.5) / feather) };
            let fine = match &lost {
                Some(of) if weight > 0.0 => self.fineness.lost(of, x as usize, y as usize),
                _ => [1.0; 3],
            };
            opaque(std::array::from_fn(|c| material[c] + weight * (f32::from(photo[c]) * fine[c] - material[c])))
        })
    }
}

/// Robust standard deviation: 1.48 times the median distance to the median.
fn spread(mut values: Vec<f32>) -> Option<f32> {
    if values.len() < MIN_SQUARES {
        return None;
    }
    let middle = values.len() / 2;
    let median = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
    for v in &mut values {
        *v = (*v - median).abs();
    }
    Some(1.48 * *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

fn smoothstep(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn smoothing(texture: &RgbaImage, px_per_m: f64) -> Smoothing {
    let longest = texture.width().max(texture.height()) as usize;
    let cell = ((CELL * px_per_m).round() as usize).max(longest.div_ceil(MAX_CELLS)).max(1);
    let in_cells = |metres: f64| (metres * px_per_m / cell as f64) as f32;
    Smoothing { cell, blur: in_cells(BLUR).max(1.2), settling: in_cells(SETTLING).max(2.0) }
}

/// Observed texels over a light; clear of what is too dark to tell.
fn ratios(texture: &RgbaImage, light: impl Fn(u32, u32) -> Color) -> Vec<Option<Color>> {
    texture
        .enumerate_pixels()
        .map(|(x, y, p)| {
            (p.0[3] >= 128).then(|| {
                let light = light(x, y);
                std::array::from_fn(|c| (f32::from(p.0[c]) + DARKEST) / (light[c].max(0.0) + DARKEST))
            })
        })
        .collect()
}

/// The values of texels that are kept: nooks show shapes that are not the material's.
fn kept(texture: &RgbaImage, values: Vec<Option<Color>>) -> Vec<Option<Color>> {
    values.into_iter().zip(texture.pixels()).map(|(v, p)| v.filter(|_| p.0[3] >= KEPT)).collect()
}

/// The texture with its pattern divided out.
fn without_pattern(texture: &RgbaImage, pattern: Option<&Lattice>) -> RgbaImage {
    let Some(pattern) = pattern else { return texture.clone() };
    let mut plain = texture.clone();
    for (x, y, p) in plain.enumerate_pixels_mut() {
        let here = pattern.at(f64::from(x) + 0.5, f64::from(y) + 0.5);
        for (v, h) in p.0.iter_mut().zip(here) {
            *v = (f32::from(*v) / h.max(0.05)).round().clamp(0.0, 255.0) as u8;
        }
    }
    plain
}

/// The texture without islands whose mean is not what the material predicts there.
fn believed(texture: &RgbaImage, look: &Look, field: &Base) -> RgbaImage {
    let (width, height) = (texture.width() as usize, texture.height() as usize);
    let observed: Vec<bool> = texture.pixels().map(|p| p.0[3] >= 128).collect();
    let total = observed.iter().filter(|b| **b).count();
    let (labels, counts) = harmony_scene::components(&observed, width, height);
    let mut sums = vec![[0.0_f32; 3]; counts.len()];
    for ((x, y, p), label) in texture.enumerate_pixels().zip(&labels).filter(|(_, l)| **l > 0) {
        let predicted = look.times(x, y, field.at(x, y));
        for ((s, v), m) in sums[*label as usize].iter_mut().zip(p.0).zip(predicted) {
            *s += f32::from(v) - m;
        }
    }
    let odd: Vec<bool> = sums
        .iter()
        .zip(&counts)
        .map(|(sum, n)| *n * 20 < total && sum.iter().any(|s| (s / (*n).max(1) as f32).abs() > ODD))
        .collect();
    let mut kept = texture.clone();
    for (p, label) in kept.pixels_mut().zip(&labels) {
        if odd[*label as usize] {
            *p = Rgba([0; 4]);
        }
    }
    kept
}

/// How much what was seen differs from the material at the border between the two, carried a little way into what was not
/// seen: a shadow on a wall ends softly behind the chair before it, and not in the chair's outline.
struct Seam {
    cell: usize,
    width: usize,
    height: usize,
    /// Logarithms of photo over material.
    values: Vec<Color>,
    reach: f32,
}

impl Seam {
    fn of(texture: &RgbaImage, px_per_m: f64, material: impl Fn(u32, u32) -> Color) -> Self {
        let cell = ((SEAM_CELL * px_per_m).round() as usize).max(1);
        let (width, height) = ((texture.width() as usize).div_ceil(cell), (texture.height() as usize).div_ceil(cell));
        let mut cells: Vec<(Color, f32)> = vec![([0.0; 3], 0.0); width * height];
        for (x, y, p) in texture.enumerate_pixels().filter(|(_, _, p)| p.0[3] >= KEPT) {
            let (at, here) = (&mut cells[y as usize / cell * width + x as usize / cell], material(x, y));
            for (sum, (seen, said)) in at.0.iter_mut().zip(p.0.iter().zip(here)) {
                let ratio = (f32::from(*seen) + DARKEST) / (said.max(0.0) + DARKEST);
                *sum += ratio.ln().clamp(-MAX_SEAM, MAX_SEAM);
            }
            at.1 += 1.0;
        }
        Self { cell, width, height, values: spread_out(&cells, width, height), reach: (SEAM_REACH * px_per_m) as f32 }
    }

    /// Factors on the material at a texel so far from what was seen.
    fn at(&self, x: u32, y: u32, away: f32) -> Color {
        let share = 1.0 - smoothstep(away / self.reach);
        if share <= 0.0 {
            return [1.0; 3];
        }
        let [x, y] = [x, y].map(|v| (v as f32 + 0.5) / self.cell as f32 - 0.5);
        between(&self.values, self.width, self.height, x, y).map(|v| (share * v).exp())
    }
}

/// Bilinear value at a place in cells, whose middles are whole numbers.
fn between(values: &[Color], width: usize, height: usize, x: f32, y: f32) -> Color {
    let place = |at: f32, n: usize| {
        let at = at.clamp(0.0, (n - 1) as f32);
        let low = (at as usize).min(n.saturating_sub(2));
        (low, (low + 1).min(n - 1), at - low as f32)
    };
    let ((x0, x1, u), (y0, y1, v)) = (place(x, width), place(y, height));
    std::array::from_fn(|c| {
        let row = |y: usize| values[y * width + x0][c] * (1.0 - u) + values[y * width + x1][c] * u;
        row(y0) * (1.0 - v) + row(y1) * v
    })
}

/// Means of cells (sum and weight), and in empty ones those of ever larger surroundings.
fn spread_out(cells: &[(Color, f32)], width: usize, height: usize) -> Vec<Color> {
    if width <= 1 && height <= 1 {
        let (sum, weight) = cells.first().copied().unwrap_or(([0.0; 3], 0.0));
        return vec![sum.map(|v| v / weight.max(1e-6))];
    }
    let (w, h) = (width.div_ceil(2), height.div_ceil(2));
    let mut coarse: Vec<(Color, f32)> = vec![([0.0; 3], 0.0); w * h];
    for (i, (sum, weight)) in cells.iter().enumerate() {
        let at = &mut coarse[i / width / 2 * w + i % width / 2];
        at.0.iter_mut().zip(sum).for_each(|(a, s)| *a += s);
        at.1 += weight;
    }
    let below = spread_out(&coarse, w, h);
    let full = cells.iter().map(|c| c.1).fold(0.0, f32::max).max(1e-6);
    (0..width * height)
        .map(|i| {
            let [x, y] = [i % width, i / width].map(|v| v as f32 * 0.5 - 0.25);
            let around = between(&below, w, h, x, y);
            let (sum, weight) = cells[i];
            let own = (weight / (0.5 * full)).min(1.0);
            std::array::from_fn(|c| around[c] + own * (sum[c] / weight.max(1e-6) - around[c]))
        })
        .collect()
}

/// A quadratic surface through each channel of what was seen.
struct Trend {
    scale: [f64; 2],
    factors: [[f64; 6]; 3],
    range: [[f32; 2]; 3],
}

impl Trend {
    fn of(texture: &RgbaImage) -> Option<Self> {
        let middle = base::median(texture)?;
        let scale = [2.0 / f64::from(texture.width().max(1)), 2.0 / f64::from(texture.height().max(1))];
        let stride = (texture.width() * texture.height() / 40_000).max(1).isqrt() as usize;
        let mut factors = [[0.0; 6]; 3];
        let mut normal = [[0.0; 6]; 6];
        let mut right = [[0.0; 6]; 3];
        for y in (0..texture.height()).step_by(stride) {
            for x in (0..texture.width()).step_by(stride) {
                let p = texture.get_pixel(x, y).0;
                if p[3] < 128 {
                    continue;
                }
                let terms = Self::terms(scale, x, y);
                for i in 0..6 {
                    for j in 0..6 {
                        normal[i][j] += terms[i] * terms[j];
                    }
                    for (r, v) in right.iter_mut().zip(p) {
                        r[i] += terms[i] * f64::from(v);
                    }
                }
            }
        }
        // Held to a plain colour where little was seen.
        let weight = normal[0][0].max(1.0);
        for (i, row) in normal.iter_mut().enumerate().skip(1) {
            row[i] += 1e-3 * weight;
        }
        for (f, r) in factors.iter_mut().zip(right) {
            *f = solved(normal, r)?;
        }
        let range = middle.map(|m| [0.35 * m, 2.5 * m + 10.0]);
        Some(Self { scale, factors, range })
    }

    fn terms(scale: [f64; 2], x: u32, y: u32) -> [f64; 6] {
        let (u, v) = (f64::from(x) * scale[0] - 1.0, f64::from(y) * scale[1] - 1.0);
        [1.0, u, v, u * u, u * v, v * v]
    }

    fn at(&self, x: u32, y: u32) -> Color {
        let terms = Self::terms(self.scale, x, y);
        std::array::from_fn(|c| {
            let value: f64 = terms.iter().zip(self.factors[c]).map(|(t, f)| t * f).sum();
            (value as f32).clamp(self.range[c][0], self.range[c][1])
        })
    }
}

/// Gaussian elimination with pivots; `None` when there is no solution.
fn solved(mut m: [[f64; 6]; 6], mut r: [f64; 6]) -> Option<[f64; 6]> {
    for k in 0..6 {
        let pivot = (k..6).max_by(|a, b| m[*a][k].abs().total_cmp(&m[*b][k].abs()))?;
        if m[pivot][k].abs() < 1e-12 {
            return None;
        }
        m.swap(k, pivot);
        r.swap(k, pivot);
        for i in k + 1..6 {
            let f = m[i][k] / m[k][k];
            let row = m[k];
            for (v, above) in m[i].iter_mut().zip(row).skip(k) {
                *v -= f * above;
            }
            r[i] -= f * r[k];
        }
    }
    for k in (0..6).rev() {
        let rest: f64 = (k + 1..6).map(|j| m[k][j] * r[j]).sum();
        r[k] = (r[k] - rest) / m[k][k];
    }
    Some(r)
}

#[cfg(test)]
#[path = "look_tests.rs"]
mod tests;
