//! A photo as the network takes it: 518 pixels wide, sides multiples of 14, PIL's bicubic filter.

use crate::math;

/// Width in pixels that the published network was trained on.
pub const WIDTH: usize = 518;
/// Bits after the point of PIL's filter weights.
const PRECISION: u32 = 22;

/// An 8-bit RGB photo, row-major.
#[derive(Debug, Clone, Copy)]
pub struct Photo<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `3 width height` values.
    pub rgb: &'a [u8],
}

/// A preprocessed photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// RGB in 0..1, row-major.
    pub rgb: Vec<f32>,
    /// The part that holds the photo: first column and row, columns, rows. The rest is white padding.
    pub photo: [usize; 4],
}

/// Brings a photo into the network's shape.
///
/// Landscape photos and square ones become `width` wide, the height rounded (half to even) to a multiple of `patch`:
/// the reference's mode `crop`, which cuts nothing then. Taller photos would lose their top and bottom there, so they
/// are done as the reference's mode `pad`: `width` high, and white at both sides.
///
/// # Panics
/// When the photo has no pixels, or not three values each.
pub fn preprocess(photo: Photo<'_>, width: usize, patch: usize) -> Frame {
    assert_eq!(photo.rgb.len(), photo.width * photo.height * 3, "three values a pixel");
    assert!(!photo.rgb.is_empty(), "a photo has pixels");
    let (w, h) = (photo.width as f64, photo.height as f64);
    let rounded = |n: f64| ((n / patch as f64).round_ties_even() as usize).max(1) * patch;
    let by_width = rounded(h * (width as f64 / w));
    let (inner_w, inner_h) =
        if by_width <= width { (width, by_width) } else { (rounded(w * (width as f64 / h)), width) };
    let small = resize_bicubic(photo.rgb, [photo.width, photo.height], [inner_w, inner_h]);
    let (left, full_w) = if by_width <= width { (0, width) } else { ((width - inner_w) / 2, width) };
    let mut rgb = vec![1.0; full_w * inner_h * 3];
    for (row, small) in rgb.chunks_exact_mut(full_w * 3).zip(small.chunks_exact(inner_w * 3)) {
        for (to, v) in row[left * 3..].iter_mut().zip(small) {
            *to = f32::from(*v) / 255.0;
        }
    }
    Frame { width: full_w, height: inner_h, rgb, photo: [left, 0, inner_w, inner_h] }
}

/// PIL's `resize(.., BICUBIC)` of 8-bit RGB to the last bit: fixed-point weights, along x first, rounded in between.
/// That is Pillow up to 12; 13 goes along y first in some cases, which changes single values a little.
fn resize_bicubic(from: &[u8], [w, h]: [usize; 2], [to_w, to_h]: [usize; 2]) -> Vec<u8> {
    let xs = fixed_taps(w, to_w);
    let mut wide = Vec::with_capacity(to_w * h * 3);
    for row in from.chunks_exact(w * 3) {
        for (first, weights) in &xs {
            for c in 0..3 {
                wide.push(weigh(weights.iter().enumerate().map(|(k, weight)| (row[(first + k) * 3 + c], *weight))));
            }
        }
    }
    let mut out = Vec::with_capacity(to_w * to_h * 3);
    for (first, weights) in &fixed_taps(h, to_h) {
        for i in 0..to_w * 3 {
            out.push(weigh(weights.iter().enumerate().map(|(k, weight)| (wide[(first + k) * to_w * 3 + i], *weight))));
        }
    }
    out
}

fn fixed_taps(from: usize, to: usize) -> Vec<(usize, Vec<i64>)> {
    let fixed = |w: f64| (w * f64::from(1u32 << PRECISION)).round() as i64;
    let taps = math::cubic_antialias_taps(from, to);
    taps.into_iter().map(|(first, weights)| (first, weights.into_iter().map(fixed).collect())).collect()
}

fn weigh(pixels: impl Iterator<Item = (u8, i64)>) -> u8 {
    let sum: i64 = pixels.map(|(v, w)| i64::from(v) * w).sum::<i64>() + (1 << (PRECISION - 1));
    (sum >> PRECISION).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_those_of_the_reference_and_keep_the_whole_photo() {
        let sizes = |w, h| {
            let frame = preprocess(Photo { width: w, height: h, rgb: &vec![0; w * h * 3] }, WIDTH, 14);
            (frame.width, frame.height, frame.photo)
        };
        // 3024 * 518 / 4032 / 14 = 27.75 -> 28 rows of patches.
        assert_eq!(sizes(4032, 3024), (518, 392, [0, 0, 518, 392]));
        assert_eq!(sizes(640, 640), (518, 518, [0, 0, 518, 518]));
        // Portrait: 388.5 / 14 = 27.75 -> 392 columns in the middle of 518.
        assert_eq!(sizes(3024, 4032), (518, 518, [63, 0, 392, 518]));
        // 14.5 patches round to the even 14.
        assert_eq!(sizes(518, 203), (518, 196, [0, 0, 518, 196]));
    }

    #[test]
    fn a_plain_photo_stays_plain_and_padding_is_white() {
        let rgb = [10, 20, 30].repeat(30 * 60);
        let frame = preprocess(Photo { width: 30, height: 60, rgb: &rgb }, 56, 14);
        assert_eq!((frame.width, frame.height, frame.photo), (56, 56, [14, 0, 28, 56]));
        for (i, v) in frame.rgb.iter().enumerate() {
            let column = i / 3 % 56;
            let wanted = if (14..42).contains(&column) { [10.0, 20.0, 30.0][i % 3] / 255.0 } else { 1.0 };
            assert!((v - wanted).abs() <= 1e-6, "{i}");
        }
    }
}
