//! Convolutions as products over windows gathered while packing, and resizing.

use rayon::prelude::*;

use super::pack::{Rows, interleave};
use super::simd::for_each_level;
use crate::backend::{Resize, Window};
use crate::host::Dims4;
use crate::math;

/// The windows of an image as rows of a product; the summed axis is `(ky, kx, channel)`.
#[derive(Debug, Clone, Copy)]
pub struct Windows<'a> {
    /// The image, NHWC.
    pub data: &'a [f32],
    /// Its axes.
    pub dims: Dims4,
    /// Stride and padding.
    pub window: Window,
    /// Columns of a window.
    pub kw: usize,
    /// Rows of the result.
    pub oh: usize,
    /// Columns of the result.
    pub ow: usize,
    /// As many zeros as there are channels.
    pub zeros: &'a [f32],
}

impl Rows for Windows<'_> {
    fn pack(&self, first: usize, count: usize, k: usize, depth: usize, mr: usize, to: &mut [f32]) {
        let d = self.dims;
        // Without padding a whole row of a window lies in one piece.
        let run = if self.window.padding == 0 { self.kw * d.c } else { d.c };
        let mut at = 0;
        while at < depth {
            let (piece, offset) = ((k + at) / run, (k + at) % run);
            let len = (run - offset).min(depth - at);
            let (ky, kx) = if self.window.padding == 0 { (piece, 0) } else { (piece / self.kw, piece % self.kw) };
            let empty: &[f32] = &[];
            let mut rows = [empty; super::kernel::MAX_MR];
            for (i, row) in rows.iter_mut().enumerate().take(count) {
                let pixel = first + i;
                let (n, oy, ox) = (pixel / (self.oh * self.ow), pixel / self.ow % self.oh, pixel % self.ow);
                let (y, x) = (oy * self.window.stride + ky, ox * self.window.stride + kx);
                *row = match d.padded(n, y, x, self.window.padding) {
                    Some(start) => &self.data[start + offset..][..len],
                    None => &self.zeros[..len],
                };
            }
            interleave(&rows[..count], len, mr, &mut to[at * mr..]);
            at += len;
        }
    }
}

/// Resizes an image into `out` `[N, height, width, C]`.
pub fn resize(data: &[f32], d: Dims4, height: usize, width: usize, how: Resize, out: &mut [f32]) {
    let (ys, xs) = (math::taps(d.h, height, how), math::taps(d.w, width, how));
    out.par_chunks_exact_mut(width * d.c).enumerate().for_each_init(
        || vec![0f32; d.w * d.c],
        |blended, (i, out)| {
            let (n, y) = (i / height, i % height);
            for (k, (iy, weight)) in ys[y].iter().enumerate() {
                let row = &data[(n * d.h + iy) * d.w * d.c..][..d.w * d.c];
                weigh(blended, row, *weight, k > 0);
            }
            for (out, taps) in out.chunks_exact_mut(d.c).zip(&xs) {
                for (k, (ix, weight)) in taps.iter().enumerate() {
                    weigh(out, &blended[ix * d.c..][..d.c], *weight, k > 0);
                }
            }
        },
    );
}

for_each_level! {
    /// `to (+)= weight * from`.
    pub fn weigh(to: &mut [f32], from: &[f32], weight: f32, add: bool) {
        if add {
            for (t, f) in to.iter_mut().zip(from) {
                *t += weight * f;
            }
        } else {
            for (t, f) in to.iter_mut().zip(from) {
                *t = weight * f;
            }
        }
    }
}
