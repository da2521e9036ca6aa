//! Colour-coded instance images: one flat colour an object.
//!
//! Clean files hold exactly their colours. Files that went through JPEG or soft edges hold thousands: there a colour
//! counts when it fills an area (its pixels have like neighbours on all sides), and the smeared pixels between areas
//! go to the area beside them.

use std::collections::BTreeMap;

use harmony_scene::ImageSize;
use image::RgbaImage;

use super::LoadedMask;

/// Largest channel difference within one smeared colour.
const TOLERANCE: u8 = 40;
/// Channels up to this are background black in a smeared file.
const BLACK: u8 = 24;
/// Share of pixels outside clean colours from which a file counts as smeared.
const SMEARED: f64 = 0.0005;
/// Share of pixels without an area from which an image is no segmentation at all.
const NOT_FLAT: f64 = 0.2;
/// Largest channel difference to its area's colour that JPEG leaves in a flat area; photos vary more.
const FLAT: u8 = 16;
/// How far smeared edges reach, pixels.
const EDGE_ROUNDS: usize = 8;

pub(super) struct Split {
    pub masks: Vec<LoadedMask>,
    pub notes: Vec<String>,
}

fn is_background(c: [u8; 3], limit: u8) -> bool {
    c.iter().all(|v| *v <= limit)
}

fn distance(a: [u8; 3], b: [u8; 3]) -> u8 {
    a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
}

/// Colours (transparent = black) and how many pixels have each.
fn histogram(image: &RgbaImage) -> (Vec<[u8; 3]>, BTreeMap<[u8; 3], usize>) {
    let pixels: Vec<[u8; 3]> =
        image.pixels().map(|p| if p.0[3] < 128 { [0; 3] } else { [p.0[0], p.0[1], p.0[2]] }).collect();
    let mut counts = BTreeMap::new();
    for c in &pixels {
        *counts.entry(*c).or_insert(0) += 1;
    }
    (pixels, counts)
}

/// Whether what an image with transparency shows is few flat colours (so that it is colour-coded, not a cut-out).
pub(super) fn is_flat(image: &RgbaImage) -> bool {
    let mut counts: BTreeMap<[u8; 3], usize> = BTreeMap::new();
    for p in image.pixels().filter(|p| p.0[3] >= 128) {
        *counts.entry([p.0[0], p.0[1], p.0[2]]).or_insert(0) += 1;
    }
    let mut sizes: Vec<usize> = counts.into_values().collect();
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    let first: usize = sizes.iter().take(64).sum();
    let all: usize = sizes.iter().sum();
    // One single colour is a cut-out too: an alpha mask painted white.
    sizes.len() > 1 && first as f64 >= 0.98 * all as f64
}

/// One mask a colour, in the order of their first pixels; `Err` is the share that belongs to no flat colour.
pub(super) fn split(image: &RgbaImage, min_pixels: usize) -> Result<Split, f64> {
    let size = ImageSize::new(image.width(), image.height());
    let (pixels, counts) = histogram(image);
    let n = pixels.len().max(1) as f64;
    let mut notes = Vec::new();
    let small: usize = counts.values().filter(|c| **c < min_pixels).sum();
    let clean = small as f64 / n <= SMEARED && counts.len() <= 4096;
    let (labels, colors) = if clean {
        let colors: Vec<[u8; 3]> = counts.keys().copied().collect();
        let index: BTreeMap<[u8; 3], u32> = colors.iter().enumerate().map(|(i, c)| (*c, i as u32)).collect();
        (pixels.iter().map(|c| Some(index[c])).collect(), colors)
    } else {
        let (labels, colors, loose) = smeared(size, &pixels, min_pixels);
        let share = loose as f64 / n;
        if share > NOT_FLAT {
            return Err(share);
        }
        notes.push(format!(
            "the mask image has smeared colours (JPEG or soft edges): {:.1} % of its pixels went to the object beside them",
            share * 100.0
        ));
        (labels, colors)
    };
    let background = background(size, &labels, &colors, if clean { 8 } else { BLACK }, &mut notes);
    let mut order: Vec<u32> = Vec::new();
    let mut seen = vec![false; colors.len()];
    for l in labels.iter().flatten() {
        if !std::mem::replace(&mut seen[*l as usize], true) && !background[*l as usize] {
            order.push(*l);
        }
    }
    let masks = order
        .into_iter()
        .take(super::MAX_MASKS + 1)
        .map(|l| {
            let [r, g, b] = colors[l as usize];
            LoadedMask {
                name: format!("color_{r:02x}{g:02x}{b:02x}"),
                label: None,
                mask: super::mask_of(size, &labels, |v| *v == Some(l)),
                color: Some([r, g, b]),
            }
        })
        .filter(|m| m.mask.count() >= min_pixels)
        .collect();
    Ok(Split { masks, notes })
}

/// Which colours are background: black, or else a white that runs along most of the border.
fn background(
    size: ImageSize,
    labels: &[Option<u32>],
    colors: &[[u8; 3]],
    black: u8,
    notes: &mut Vec<String>,
) -> Vec<bool> {
    let mut out: Vec<bool> = colors.iter().map(|c| is_background(*c, black)).collect();
    if out.iter().any(|b| *b) {
        return out;
    }
    let (w, h) = (size.width as usize, size.height as usize);
    let mut border = vec![0_usize; colors.len()];
    for (i, l) in labels.iter().enumerate() {
        let (x, y) = (i % w, i / w);
        if (x == 0 || y == 0 || x + 1 == w || y + 1 == h)
            && let Some(l) = l
        {
            border[*l as usize] += 1;
        }
    }
    let white = |l: usize| colors[l].iter().all(|v| *v >= 255 - black);
    if let Some(l) = (0..colors.len()).filter(|l| white(*l)).max_by_key(|l| border[*l])
        && border[l] * 2 > 2 * (w + h)
    {
        out[l] = true;
        notes.push("the mask image has no black: white was taken for its background".to_owned());
    }
    out
}

/// Labels of a smeared image: areas first, then their edges; also the number of pixels that are in no flat area.
fn smeared(size: ImageSize, pixels: &[[u8; 3]], min_pixels: usize) -> (Vec<Option<u32>>, Vec<[u8; 3]>, usize) {
    let (w, h) = (size.width as usize, size.height as usize);
    // A pixel is inside an area when its eight neighbours have nearly its colour.
    let inside = |i: usize| {
        let (x, y) = (i % w, i / w);
        (y.saturating_sub(1)..(y + 2).min(h)).all(|v| {
            (x.saturating_sub(1)..(x + 2).min(w)).all(|u| distance(pixels[v * w + u], pixels[i]) <= TOLERANCE / 2)
        })
    };
    let interior: Vec<bool> = (0..pixels.len()).map(inside).collect();
    let mut counts: BTreeMap<[u8; 3], usize> = BTreeMap::new();
    for (c, _) in pixels.iter().zip(&interior).filter(|(_, inside)| **inside) {
        *counts.entry(*c).or_insert(0) += 1;
    }
    let mut by_count: Vec<([u8; 3], usize)> = counts.into_iter().collect();
    by_count.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    // The most frequent colour of a cloud stands for it.
    let mut seeds: Vec<([u8; 3], usize)> = Vec::new();
    for (color, count) in by_count.into_iter().take(20_000) {
        match seeds.iter().position(|(s, _)| distance(*s, color) <= TOLERANCE) {
            Some(k) => seeds[k].1 += count,
            None if seeds.len() < super::MAX_MASKS => seeds.push((color, count)),
            None => {}
        }
    }
    seeds.retain(|(_, count)| *count >= min_pixels.max(9));
    let colors: Vec<[u8; 3]> = seeds.iter().map(|(c, _)| *c).collect();
    let nearest = |c: [u8; 3]| {
        let best = colors.iter().enumerate().min_by_key(|(_, s)| distance(**s, c))?;
        (distance(*best.1, c) <= TOLERANCE).then_some(best.0 as u32)
    };
    let mut labels: Vec<Option<u32>> =
        pixels.iter().zip(&interior).map(|(c, inside)| if *inside { nearest(*c) } else { None }).collect();
    let flat = |(l, c): (&Option<u32>, &[u8; 3])| l.is_some_and(|l| distance(colors[l as usize], *c) <= FLAT);
    let loose = pixels.len() - labels.iter().zip(pixels).filter(|p| flat(*p)).count();
    // Edge pixels: their own colour decides where it is near a neighbouring area's, else the majority beside them.
    for round in 0..EDGE_ROUNDS {
        let before = labels.clone();
        let mut changed = false;
        for i in (0..pixels.len()).filter(|i| before[*i].is_none()) {
            let (x, y) = (i % w, i / w);
            let mut votes: Vec<(u32, u32)> = Vec::new();
            for v in y.saturating_sub(1)..(y + 2).min(h) {
                for u in x.saturating_sub(1)..(x + 2).min(w) {
                    if let Some(l) = before[v * w + u] {
                        match votes.iter_mut().find(|(k, _)| *k == l) {
                            Some(vote) => vote.1 += 1,
                            None => votes.push((l, 1)),
                        }
                    }
                }
            }
            let close = |l: u32| u32::from(255 - distance(colors[l as usize], pixels[i]));
            labels[i] = votes
                .iter()
                .max_by_key(|(l, n)| if round < 3 { close(*l) * 16 + n } else { n * 256 + close(*l) })
                .map(|(l, _)| *l);
            changed |= labels[i].is_some();
        }
        if !changed {
            break;
        }
    }
    (labels, colors, loose)
}
