//! Blocked products `out = residual + scale .* act(A B + bias)`, the work of linear layers and convolutions.
//!
//! The blocking is Goto's (Goto and van de Geijn, 2008): a slice of packed rows stays in the second cache, a packed
//! panel of columns in the first, a tile in registers. Weights are packed as they are needed, for a panel serves
//! hundreds of rows, and so they can stay in the mapped file.

use rayon::prelude::*;

use super::kernel::{Kernel, MAX_TILE};
use super::pack::{Columns, Rows};
use super::simd::{erf, exp, for_each_level};
use crate::backend::Act;

/// Depth of a block: a panel of 32 columns is 32 KiB.
const DEPTH: usize = 256;
/// Rows of a block: its packed slice is 1.2 MB.
const ROWS: usize = 1152;
/// Up to so many rows a product is bound by reading the weights, and is done as dot products.
const FEW_ROWS: usize = 8;

/// What is done with each sum.
#[derive(Debug, Clone, Copy, Default)]
pub struct Finish<'a> {
    /// Added first, one a column.
    pub bias: Option<&'a [f32]>,
    /// Then applied.
    pub act: Act,
    /// Then multiplied, one a column.
    pub scale: Option<&'a [f32]>,
    /// Then added, of the shape of the result.
    pub residual: Option<&'a [f32]>,
}

/// Memory that several threads write disjoint parts of.
#[derive(Clone, Copy)]
pub struct Shared(*mut f32);
// SAFETY: only a pointer; each use says why its parts are disjoint.
unsafe impl Send for Shared {}
// SAFETY: as above.
unsafe impl Sync for Shared {}

impl Shared {
    /// A slice to be written in parts.
    pub fn new(slice: &mut [f32]) -> Self {
        Self(slice.as_mut_ptr())
    }

    /// A part of it.
    ///
    /// # Safety
    /// The part lies inside the slice, and nobody else uses it meanwhile.
    pub unsafe fn part<'a>(self, start: usize, len: usize) -> &'a mut [f32] {
        // SAFETY: the contract.
        unsafe { std::slice::from_raw_parts_mut(self.0.add(start), len) }
    }
}

/// Sizes of a product.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Rows.
    pub m: usize,
    /// Columns.
    pub n: usize,
    /// Summed axis.
    pub k: usize,
}

/// Computes a product into `out`, row-major `[m, n]`.
pub fn product(size: Size, rows: &impl Rows, columns: Columns<'_>, finish: Finish<'_>, out: &mut [f32]) {
    let Size { m, n, k } = size;
    let out = &mut out[..m * n];
    if k == 0 {
        out.fill(0.0);
        out.chunks_exact_mut(n.max(1)).enumerate().for_each(|(i, row)| finish_row(row, &finish, i * n, 0));
        return;
    }
    if let (true, Columns::Transposed(weights)) = (m <= FEW_ROWS, columns) {
        few_rows(size, rows, weights, finish, out);
        return;
    }
    let kernel = Kernel::best();
    let threads = rayon::current_num_threads();
    let shared = Shared::new(out);
    // The longer side is cut, for every task packs all of the other; few columns are left together.
    let parts = threads * 2;
    let tasks: Vec<[usize; 4]> = if n >= parts * 128 && n >= m {
        split(n, parts, kernel.nr).map(|(a, b)| [0, m, a, b]).collect()
    } else {
        split(m, parts.max(m.div_ceil(4 * ROWS)), kernel.mr).map(|(a, b)| [a, b, 0, n]).collect()
    };
    tasks.into_par_iter().for_each(|[m0, m1, n0, n1]| {
        let mut packed_rows = vec![0f32; (m1 - m0).min(ROWS).next_multiple_of(kernel.mr) * DEPTH.min(k)];
        let mut panel = vec![0f32; DEPTH.min(k) * kernel.nr];
        for row in (m0..m1).step_by(ROWS) {
            let count = ROWS.min(m1 - row);
            for depth in (0..k).step_by(DEPTH) {
                let block = Block { row, count, depth, len: DEPTH.min(k - depth), last: depth + DEPTH >= k };
                block.pack(rows, &kernel, &mut packed_rows);
                for column in (n0..n1).step_by(kernel.nr) {
                    let width = kernel.nr.min(n1 - column);
                    columns.pack(column, width, depth, block.len, kernel.nr, &mut panel);
                    block.tiles(&kernel, &packed_rows, &panel, (column, width), n, shared, &finish);
                }
            }
        }
    });
}

/// A slice of rows and depth.
struct Block {
    row: usize,
    count: usize,
    depth: usize,
    len: usize,
    last: bool,
}

impl Block {
    fn pack(&self, rows: &impl Rows, kernel: &Kernel, to: &mut [f32]) {
        let tile = kernel.mr * self.len;
        for (i, to) in to.chunks_exact_mut(tile).take(self.count.div_ceil(kernel.mr)).enumerate() {
            let first = i * kernel.mr;
            rows.pack(self.row + first, kernel.mr.min(self.count - first), self.depth, self.len, kernel.mr, to);
        }
    }

    #[expect(clippy::too_many_arguments, reason = "the inside of one loop")]
    fn tiles(
        &self,
        kernel: &Kernel,
        rows: &[f32],
        panel: &[f32],
        (column, width): (usize, usize),
        stride: usize,
        out: Shared,
        finish: &Finish<'_>,
    ) {
        let add = self.depth > 0;
        for first in (0..self.count).step_by(kernel.mr) {
            let height = kernel.mr.min(self.count - first);
            let a = &rows[first * self.len..][..kernel.mr * self.len];
            let start = (self.row + first) * stride + column;
            if height == kernel.mr && width == kernel.nr {
                // SAFETY: the whole tile lies in this task's rectangle of the result.
                unsafe { kernel.run_raw(self.len, a, panel, out.0.add(start), stride, add) };
            } else {
                let mut tile = [0f32; MAX_TILE];
                kernel.run(self.len, a, panel, &mut tile, kernel.nr, false);
                for (i, tile) in tile.chunks_exact(kernel.nr).enumerate().take(height) {
                    // SAFETY: these `width` values lie in this task's rectangle of the result.
                    let row = unsafe { out.part(start + i * stride, width) };
                    for (to, value) in row.iter_mut().zip(tile) {
                        *to = if add { *to + value } else { *value };
                    }
                }
            }
            if self.last {
                for i in 0..height {
                    let at = start + i * stride;
                    // SAFETY: as above.
                    finish_row(unsafe { out.part(at, width) }, finish, at, column);
                }
            }
        }
    }
}

/// `0..n` in about `parts` pieces whose lengths are multiples of `unit`.
fn split(n: usize, parts: usize, unit: usize) -> impl Iterator<Item = (usize, usize)> {
    let step = n.div_ceil(parts.max(1)).next_multiple_of(unit).max(unit);
    (0..n).step_by(step).map(move |a| (a, (a + step).min(n)))
}

/// A product of few rows: each weight is read once, in place.
fn few_rows(size: Size, rows: &impl Rows, weights: super::pack::Matrix<'_>, finish: Finish<'_>, out: &mut [f32]) {
    let Size { m, n, k } = size;
    let mut x = vec![0f32; m * k];
    for i in 0..m {
        rows.pack(i, 1, 0, k, 1, &mut x[i * k..(i + 1) * k]);
    }
    let shared = Shared::new(out);
    (0..n).into_par_iter().with_min_len(64).for_each(|j| {
        let weight = weights.part(j, 0, k);
        for i in 0..m {
            // SAFETY: this value belongs to column `j` only.
            let cell = unsafe { shared.part(i * n + j, 1) };
            cell[0] = dot(&x[i * k..(i + 1) * k], weight);
            finish_row(cell, &finish, i * n + j, j);
        }
    });
}

for_each_level! {
    /// Sum of products, in 64 partial sums.
    pub fn dot(a: &[f32], b: &[f32]) -> f32 {
        let (a64, a_rest) = a.as_chunks::<64>();
        let (b64, b_rest) = b.as_chunks::<64>();
        let mut sums = [0f32; 64];
        for (a, b) in a64.iter().zip(b64) {
            for i in 0..64 {
                sums[i] += a[i] * b[i];
            }
        }
        let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        sums.iter().sum::<f32>() + rest
    }
}

for_each_level! {
    /// A pointwise function of every value.
    pub fn activate(row: &mut [f32], act: Act) {
        #[inline(always)]
        fn each(row: &mut [f32], f: impl Fn(f32) -> f32) {
            for v in row {
                *v = f(*v);
            }
        }
        match act {
            Act::None => {}
            Act::Relu => each(row, |x| if x < 0.0 { 0.0 } else { x }),
            Act::Gelu => each(row, |x| 0.5 * x * (1.0 + erf(x * std::f32::consts::FRAC_1_SQRT_2))),
            Act::GeluTanh => each(row, |x| {
                let t = 0.797_884_6 * (x + 0.044_715 * x * x * x);
                x / (1.0 + exp(-2.0 * t))
            }),
            Act::QuickGelu => each(row, |x| x / (1.0 + exp(-1.702 * x))),
            Act::Silu => each(row, |x| x / (1.0 + exp(-x))),
            Act::Sigmoid => each(row, |x| 1.0 / (1.0 + exp(-x))),
            Act::Exp => each(row, exp),
        }
    }
}

for_each_level! {
    /// Finishes part of a row of the result: `at` is its place in the result, `column` its first column.
    pub fn finish_row(row: &mut [f32], finish: &Finish<'_>, at: usize, column: usize) {
        let n = row.len();
        if let Some(bias) = finish.bias {
            for (v, b) in row.iter_mut().zip(&bias[column..column + n]) {
                *v += b;
            }
        }
        if finish.act != Act::None {
            activate(row, finish.act);
        }
        if let Some(scale) = finish.scale {
            for (v, s) in row.iter_mut().zip(&scale[column..column + n]) {
                *v *= s;
            }
        }
        if let Some(residual) = finish.residual {
            for (v, r) in row.iter_mut().zip(&residual[at..at + n]) {
                *v += r;
            }
        }
    }
}
