//! Fills holes with what is around them: exemplar-based, coarse to fine.

pub(crate) mod canvas;
mod patches;

use harmony_scene::{ImageSize, Mask};
use image::{Rgb, RgbImage};

use crate::resample::{Window, resize_window};
use canvas::{Canvas, Texel};
use patches::{Matcher, Matches, NONE, Vote};

/// Where the fill may copy from.
#[derive(Debug, Clone, Copy)]
pub enum Sources<'a> {
    /// From everything that is not hole.
    Anywhere,
    /// From the set pixels that are not hole.
    Masked(&'a Mask),
    /// From pixels that carry the same label as the pixel to fill, such as a surface label map; row-major. A map of
    /// another length than the photo is ignored.
    SameLabel(&'a [u8]),
    /// Both: set pixels with the same label.
    MaskedSameLabel(&'a Mask, &'a [u8]),
}

/// Parameters of the fill.
#[derive(Debug, Clone, PartialEq)]
pub struct FillSettings {
    /// Longest side at which patches are matched, pixels; larger photos reuse the matches at full resolution.
    pub working_px: u32,
    /// Seed of the random search.
    pub seed: u64,
}

impl Default for FillSettings {
    fn default() -> Self {
        Self { working_px: 1024, seed: 0x5eed }
    }
}

/// Most that is added to a copied patch, 8-bit levels.
const MAX_OFFSET: f32 = 20.0;
/// Shorter side of the coarsest picture, pixels: some patches wide.
const COARSEST_PX: usize = 40;

/// The photo with the hole filled; pixels outside the hole are unchanged.
///
/// Without anything to copy from, the hole is filled smoothly from what is known around it (and left as it is when the
/// hole is the whole photo).
pub fn fill(photo: &RgbImage, hole: &Mask, sources: Sources<'_>, settings: &FillSettings) -> RgbImage {
    let hole = crate::fitted(hole, photo);
    let size = crate::size_of(photo);
    if size.pixels() == 0 || hole.count() == 0 || hole.count() == size.pixels() {
        return photo.clone();
    }
    let (mask, labels) = match sources {
        Sources::Anywhere => (None, None),
        Sources::Masked(mask) => (Some(mask), None),
        Sources::SameLabel(labels) => (None, Some(labels)),
        Sources::MaskedSameLabel(mask, labels) => (Some(mask), Some(labels)),
    };
    let mask = mask.map(|m| crate::fitted(m, photo));
    let labels = labels.filter(|l| l.len() == size.pixels());
    let work = size.fit_within(settings.working_px.clamp(32, 8192));
    let small = resize_window(photo, Window::whole((size.width, size.height)), work);
    let mut canvas = canvas(&small, size, &hole, mask.as_deref(), labels);
    let matches = complete(&mut canvas, MAX_OFFSET, settings.seed);
    let mut filled = photo.clone();
    if work == size {
        for (pixel, (texel, hole)) in filled.pixels_mut().zip(canvas.pixels.iter().zip(hole.bits())) {
            if *hole {
                *pixel = rgb(*texel);
            }
        }
    } else {
        copy_at_full_size(photo, &hole, mask.as_deref(), &canvas, &matches, &mut filled);
    }
    filled
}

/// The working picture. A working pixel is hole (or no source) when any photo pixel in it is.
fn canvas(small: &RgbImage, size: ImageSize, hole: &Mask, source: Option<&Mask>, labels: Option<&[u8]>) -> Canvas {
    let (width, height) = (small.width() as usize, small.height() as usize);
    let mut canvas = Canvas {
        width,
        height,
        pixels: small.pixels().map(|p| texel(p.0)).collect(),
        hole: vec![false; width * height],
        source: vec![true; width * height],
        label: vec![0; width * height],
    };
    // Shrinking mixes the hole's colours into its surroundings: one pixel more is hole then.
    let grown =
        if small.width() == size.width { None } else { Some(hole.dilated((size.width / small.width()) as i32)) };
    let hole = grown.as_ref().unwrap_or(hole);
    for y in 0..size.height as usize {
        for x in 0..size.width as usize {
            let i = y * size.width as usize + x;
            let j = y * height / size.height as usize * width + x * width / size.width as usize;
            canvas.hole[j] |= hole.bits()[i];
            if let Some(source) = source {
                canvas.source[j] &= source.bits()[i];
            }
            if let Some(labels) = labels {
                canvas.label[j] = labels[i];
            }
        }
    }
    canvas
}

/// Completes the hole of a canvas, coarse to fine; the matches of the finest level.
pub(crate) fn complete(canvas: &mut Canvas, max_offset: f32, seed: u64) -> Matches {
    let mut levels = vec![canvas.clone()];
    while let Some(last) = levels.last()
        && last.width.min(last.height) >= 2 * COARSEST_PX
    {
        let half = last.halved();
        levels.push(half);
    }
    let mut coarser: Option<(Canvas, Matches)> = None;
    let count = levels.len();
    for (depth, mut level) in levels.into_iter().enumerate().rev() {
        match &coarser {
            None => level.fill_smoothly(),
            Some((half, _)) => level.guess_from_half(half),
        }
        let seed = seed ^ (depth as u64) << 48;
        let mut matches =
            Matcher::new(&level, max_offset, seed).start(coarser.as_ref().map(|(half, matches)| (matches, half.width)));
        // Many turns where they are cheap and decide the structure, few at full size.
        let (turns, passes) = match depth {
            0 if count > 2 => (1, 2),
            1 => (2, 2),
            2 => (4, 2),
            _ => (8, 3),
        };
        for turn in 0..turns {
            let matcher = Matcher::new(&level, max_offset, seed);
            matcher.evaluate(&mut matches);
            if turn == 0 {
                // First let the matches speak at this resolution, then search. At the coarsest level they are random
                // ones: the search goes better from a wrong texture than from none, which only smooth patches match.
                let pixels =
                    if coarser.is_some() { matcher.vote(&matches, Vote::Wide) } else { matcher.scatter(&matches) };
                level.pixels = pixels;
            }
            let matcher = Matcher::new(&level, max_offset, seed);
            matcher.evaluate(&mut matches);
            for pass in 0..passes {
                matcher.improve(&mut matches, (turn * passes + pass) as u64);
            }
            let last = depth == 0 && turn + 1 == turns;
            let pixels = matcher.vote(&matches, if last { Vote::Sharp } else { Vote::Wide });
            level.pixels = pixels;
        }
        coarser = Some((level, matches));
    }
    let (finished, matches) = coarser.expect("there is at least the finest level");
    *canvas = finished;
    matches
}

/// Fills the photo's hole by the working matches: each pixel copies from where its working pixel's patch came from.
fn copy_at_full_size(
    photo: &RgbImage,
    hole: &Mask,
    source: Option<&Mask>,
    canvas: &Canvas,
    matches: &Matches,
    filled: &mut RgbImage,
) {
    let size = crate::size_of(photo);
    let (kx, ky) = (f64::from(size.width) / canvas.width as f64, f64::from(size.height) / canvas.height as f64);
    let copyable = |x: i64, y: i64| {
        x >= 0
            && y >= 0
            && x < i64::from(size.width)
            && y < i64::from(size.height)
            && !hole.get(x, y)
            && source.is_none_or(|s| s.get(x, y))
    };
    for y in 0..size.height {
        for x in 0..size.width {
            if !hole.get(i64::from(x), i64::from(y)) {
                continue;
            }
            // The four working pixels around, by their bilinear weights: blends where matches change.
            let (wx, wy) = ((f64::from(x) + 0.5) / kx - 0.5, (f64::from(y) + 0.5) / ky - 0.5);
            let mut sum = [0.0_f32; 4];
            let mut total = 0.0_f32;
            for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let (qx, qy) = (wx.floor() + dx, wy.floor() + dy);
                if qx < 0.0 || qy < 0.0 || qx >= canvas.width as f64 || qy >= canvas.height as f64 {
                    continue;
                }
                let weight = ((1.0 - (wx - qx).abs()) * (1.0 - (wy - qy).abs())) as f32;
                let q = qy as usize * canvas.width + qx as usize;
                let s = matches.source[q];
                if s == NONE || weight <= 0.0 {
                    continue;
                }
                let (sx, sy) = (s as usize % canvas.width, s as usize / canvas.width);
                let px = i64::from(x) + ((sx as f64 - qx) * kx).round() as i64;
                let py = i64::from(y) + ((sy as f64 - qy) * ky).round() as i64;
                if copyable(px, py) {
                    let color = texel(photo.get_pixel(px as u32, py as u32).0);
                    for c in 0..3 {
                        sum[c] += weight * (color[c] + matches.offset[q][c]);
                    }
                    total += weight;
                }
            }
            let color = if total > 0.0 { sum.map(|s| s / total) } else { canvas.sample(wx as f32, wy as f32) };
            filled.put_pixel(x, y, rgb(color));
        }
    }
}

/// Colour as floats.
pub(crate) fn texel([r, g, b]: [u8; 3]) -> Texel {
    [f32::from(r), f32::from(g), f32::from(b), 0.0]
}

/// Colour as bytes.
pub(crate) fn rgb(texel: Texel) -> Rgb<u8> {
    Rgb([0, 1, 2].map(|c| texel[c].round().clamp(0.0, 255.0) as u8))
}

#[cfg(test)]
mod tests;
