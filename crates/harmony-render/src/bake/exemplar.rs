//! Gaps of large patterned faces are filled from the face itself.

use std::collections::{BTreeMap, BTreeSet};

use harmony_imaging::tile::{Detail, TextureSettings, complete_surface};
use harmony_scene::ImageSize;
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

use super::base::Base;
use super::lattice::Picture;
use super::texels::Texel;

/// Shortest side of a face, texels.
const SHORTEST: usize = 40;
/// Share of the face's rectangle that it must fill.
const RECTANGULAR: f64 = 0.9;
/// Share of the face that must have been seen, and that must be missing.
const SEEN: f64 = 0.3;
const MISSING: f64 = 0.02;
/// The same of a face that somebody said to have a pattern all over: a piece of it shows the whole.
const SEEN_OF_TILES: f64 = 0.05;
/// A slot's own tile is given up where what was seen varies within a block of so many texels by so many times as much as
/// it does (standard deviations), and by so many sRGB steps: a long pile of which only the fibres were described.
const BLOCK: usize = 8;
const COARSER: f64 = 1.8;
const COARSE: f64 = 5.0;
/// Standard deviation of the seen colours from which the face has a pattern, sRGB steps.
const PATTERN: f64 = 9.0;
/// Most faces of an object that are filled so, largest first.
const FACES: usize = 4;
/// Longest side at which patches are matched, texels.
const WORKING_PX: u32 = 256;
/// Seed of the choice of patches.
const SEED: u64 = 0x9115;
/// A colour seen with less than this share counts as missing.
const SURE: f32 = 0.5;

/// One chart's texels, as indices into the list.
struct Face {
    members: Vec<usize>,
    low: [usize; 2],
    size: ImageSize,
}

/// Replaces the made-up colours of large faces with a pattern; returns their charts.
pub(super) fn improve(made_up: &mut [[f32; 3]], texels: &[Texel], bases: &[Base], side: usize) -> BTreeSet<u32> {
    let mut charts: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (i, texel) in texels.iter().enumerate() {
        charts.entry(texel.chart).or_default().push(i);
    }
    let faces = charts.into_iter().filter_map(|(chart, m)| Some((chart, Face::new(m, texels, bases, side)?)));
    let mut faces: Vec<(u32, Face)> = faces.collect();
    faces.sort_by_key(|(_, f)| std::cmp::Reverse(f.members.len()));
    faces.truncate(FACES);
    let so_far: &[[f32; 3]] = made_up;
    let filled: Vec<Option<RgbaImage>> = faces.par_iter().map(|(_, f)| f.filled(so_far, texels, bases, side)).collect();
    let mut done = BTreeSet::new();
    for ((chart, face), image) in faces.iter().zip(&filled) {
        let Some(image) = image else { continue };
        done.insert(*chart);
        for i in &face.members {
            let (x, y) = face.place(texels[*i].at, side);
            let [r, g, b, _] = image.get_pixel(x, y).0.map(f32::from);
            made_up[*i] = [r, g, b];
        }
    }
    done
}

fn known(texel: &Texel) -> bool {
    texel.color.is_some() && texel.direct && texel.share >= SURE
}

impl Face {
    /// `None` when the chart is small, not rectangular, wholly known, hardly known, or of one colour.
    fn new(members: Vec<usize>, texels: &[Texel], bases: &[Base], side: usize) -> Option<Self> {
        let at = |i: &usize| [texels[*i].at % side, texels[*i].at / side];
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for p in members.iter().map(at) {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k] + 1);
            }
        }
        let (w, h) = (high[0].checked_sub(low[0])?, high[1].checked_sub(low[1])?);
        let n = members.len() as f64;
        if w.min(h) < SHORTEST || n < RECTANGULAR * (w * h) as f64 {
            return None;
        }
        let seen: Vec<&Texel> = members.iter().map(|i| &texels[*i]).filter(|t| known(t)).collect();
        let share = seen.len() as f64 / n;
        let tiled = members.first().is_some_and(|i| bases[texels[*i].slot].is_tiled());
        let least = if tiled { SEEN_OF_TILES } else { SEEN };
        if !(least..=1.0 - MISSING).contains(&share) || spread(&seen) < PATTERN {
            return None;
        }
        Some(Self { members, low, size: ImageSize::new(w as u32, h as u32) })
    }

    fn place(&self, at: usize, side: usize) -> (u32, u32) {
        ((at % side - self.low[0]) as u32, (at / side - self.low[1]) as u32)
    }

    /// The whole face; `None` where the slot's own tile continues it better than patches would.
    fn filled(&self, made_up: &[[f32; 3]], texels: &[Texel], bases: &[Base], side: usize) -> Option<RgbaImage> {
        let (w, h) = (self.size.width as usize, self.size.height as usize);
        let mut picture = Picture { width: w, height: h, pixels: vec![None; w * h] };
        let mut image = RgbaImage::new(self.size.width, self.size.height);
        for i in &self.members {
            let (x, y) = self.place(texels[*i].at, side);
            picture.pixels[y as usize * w + x as usize] = texels[*i].color.filter(|_| known(&texels[*i]));
        }
        let repeats = picture.complete();
        let tiled = self.members.first().is_some_and(|i| bases[texels[*i].slot].is_tiled());
        if tiled && !repeats {
            // Under the light that was made up for each texel.
            let detail = Detail::of(&picture.pixels, w, SEED);
            let detail = detail.filter(|_| self.is_coarser(&picture, texels, bases, side))?;
            for i in &self.members {
                let (x, y) = self.place(texels[*i].at, side);
                let ratio = detail.at(x, y);
                image.put_pixel(x, y, rgba([0, 1, 2].map(|k| made_up[*i][k] * ratio[k])));
            }
            return Some(image);
        }
        for (pixel, color) in image.pixels_mut().zip(&picture.pixels) {
            if let Some(color) = color {
                *pixel = rgba(*color);
            }
        }
        Some(complete_surface(&image, &TextureSettings { working_px: WORKING_PX, ..TextureSettings::default() }))
    }
}

impl Face {
    /// Whether what was seen varies within a few texels by much more than the slot's tile does there.
    fn is_coarser(&self, picture: &Picture, texels: &[Texel], bases: &[Base], side: usize) -> bool {
        let (w, h) = (picture.width, picture.height);
        let mut own: Vec<Option<[f32; 3]>> = vec![None; w * h];
        for i in &self.members {
            let (x, y) = self.place(texels[*i].at, side);
            own[y as usize * w + x as usize] = Some(bases[texels[*i].slot].at(&texels[*i]));
        }
        let (mut seen, mut told, mut n) = (0.0, 0.0, 0.0);
        for y in (0..h.saturating_sub(BLOCK - 1)).step_by(BLOCK) {
            for x in (0..w.saturating_sub(BLOCK - 1)).step_by(BLOCK) {
                let places = || (0..BLOCK * BLOCK).map(move |i| (y + i / BLOCK) * w + x + i % BLOCK);
                let both = [&picture.pixels, &own].map(|all| places().map(|i| all[i]).collect::<Option<Vec<_>>>());
                if let [Some(photo), Some(tile)] = both {
                    (seen, told, n) = (seen + deviation(&photo), told + deviation(&tile), n + 1.0);
                }
            }
        }
        n > 0.0 && seen >= COARSE * n && seen >= COARSER * told
    }
}

fn rgba(color: [f32; 3]) -> Rgba<u8> {
    let [r, g, b] = color.map(|c| c.round().clamp(0.0, 255.0) as u8);
    Rgba([r, g, b, 255])
}

/// Standard deviation of the texels' colours.
fn spread(texels: &[&Texel]) -> f64 {
    deviation(&texels.iter().filter_map(|t| t.color).collect::<Vec<_>>())
}

/// Standard deviation of colours, mean over the channels.
fn deviation(colors: &[[f32; 3]]) -> f64 {
    let n = colors.len().max(1) as f64;
    let channel = |k: usize| {
        let values = || colors.iter().map(|c| f64::from(c[k]));
        let mean = values().sum::<f64>() / n;
        (values().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    (channel(0) + channel(1) + channel(2)) / 3.0
}
