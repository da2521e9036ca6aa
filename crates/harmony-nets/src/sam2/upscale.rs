//! Masks at the photo's resolution.

#[cfg(feature = "players")]
use harmony_scene::{ImageSize, Mask};

use super::MaskLogits;
use crate::backend::Resize;
use crate::math;

/// Rows of logits at another size: linear, pixel centres at +0.5, as upstream's post-processing.
fn rows(logits: &MaskLogits, width: usize, height: usize) -> impl Iterator<Item = Vec<f32>> {
    let across = math::taps(logits.side, width, Resize::Bilinear);
    math::taps(logits.side, height, Resize::Bilinear).into_iter().map(move |down| {
        let mut row = vec![0f32; width];
        // First between the two rows, then along: the row between is small.
        let mut between = vec![0f32; logits.side];
        for (y, w) in down {
            for (sum, v) in between.iter_mut().zip(&logits.values[y * logits.side..(y + 1) * logits.side]) {
                *sum += v * w;
            }
        }
        for (out, taps) in row.iter_mut().zip(&across) {
            *out = taps.iter().map(|(x, w)| between[*x] * w).sum();
        }
        row
    })
}

/// Logits for every pixel, row-major.
pub fn logits_at(logits: &MaskLogits, width: u32, height: u32) -> Vec<f32> {
    rows(logits, width as usize, height as usize).flatten().collect()
}

/// The mask itself: logits above zero.
#[cfg(feature = "players")]
pub fn mask_at(logits: &MaskLogits, size: ImageSize) -> Mask {
    let mut mask = Mask::empty(size);
    let width = size.width as usize;
    for (bits, row) in mask.bits_mut().chunks_exact_mut(width.max(1)).zip(rows(logits, width, size.height as usize)) {
        for (bit, v) in bits.iter_mut().zip(row) {
            *bit = v > 0.0;
        }
    }
    mask
}
