//! Fills the holes of an image from its surroundings (push-pull, Gortler et al. 1996).

use image::{Rgba, RgbaImage};

/// A level: colours times weight, and weight.
type Level = Vec<([f32; 3], f32)>;

/// An opaque image of the known colours (sRGB, 0 to 255), the rest continued smoothly from them; grey when nothing is
/// known.
pub(super) fn fill(known: &[Option<[f32; 3]>], side: usize) -> RgbaImage {
    let start: Level = known.iter().map(|c| c.map_or(([0.0; 3], 0.0), |c| (c, 1.0))).collect();
    let mut levels = vec![(side, start)];
    while let Some((size, level)) = levels.last()
        && *size > 1
    {
        let half = size.div_ceil(2);
        let next = (0..half * half).map(|i| pull(level, *size, i % half, i / half)).collect();
        levels.push((half, next));
    }
    let mut coarse: Option<(usize, Vec<[f32; 3]>)> = None;
    for (size, level) in levels.into_iter().rev() {
        let filled = level
            .iter()
            .enumerate()
            .map(|(i, (sum, weight))| {
                if *weight > 0.0 {
                    return sum.map(|s| s / weight);
                }
                match &coarse {
                    Some((half, colors)) => push(colors, *half, i % size, i / size),
                    None => [128.0; 3],
                }
            })
            .collect();
        coarse = Some((size, filled));
    }
    let colors = coarse.map_or_else(Vec::new, |(_, colors)| colors);
    RgbaImage::from_fn(side as u32, side as u32, |x, y| {
        let [r, g, b] = colors[y as usize * side + x as usize].map(|v| v.round().clamp(0.0, 255.0) as u8);
        Rgba([r, g, b, 255])
    })
}

fn pull(level: &Level, size: usize, x: usize, y: usize) -> ([f32; 3], f32) {
    let (mut sum, mut weight) = ([0.0; 3], 0.0);
    for (i, j) in [(2 * x, 2 * y), (2 * x + 1, 2 * y), (2 * x, 2 * y + 1), (2 * x + 1, 2 * y + 1)] {
        if i < size && j < size {
            let (s, w) = level[j * size + i];
            sum = [sum[0] + s[0], sum[1] + s[1], sum[2] + s[2]];
            weight += w;
        }
    }
    // a few known pixels count as much as many
    let scale = if weight > 1.0 { 1.0 / weight } else { 1.0 };
    (sum.map(|s| s * scale), weight * scale)
}

/// Bilinear sample of the next coarser level.
fn push(colors: &[[f32; 3]], half: usize, x: usize, y: usize) -> [f32; 3] {
    let place = |v: usize| {
        let p = f32::midpoint(v as f32, 0.5) - 0.5;
        let low = p.floor();
        (low.max(0.0) as usize, ((low + 1.0).max(0.0) as usize).min(half - 1), p - low)
    };
    let ((x0, x1, fx), (y0, y1, fy)) = (place(x), place(y));
    let (x0, y0) = (x0.min(half - 1), y0.min(half - 1));
    let at = |x: usize, y: usize| colors[y * half + x];
    std::array::from_fn(|k| {
        let top = at(x0, y0)[k] * (1.0 - fx) + at(x1, y0)[k] * fx;
        let bottom = at(x0, y1)[k] * (1.0 - fx) + at(x1, y1)[k] * fx;
        top * (1.0 - fy) + bottom * fy
    })
}
