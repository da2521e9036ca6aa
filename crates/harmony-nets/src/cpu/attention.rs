//! Attention in blocks of queries: the scores of a block stay in the second cache and are never written out.
//!
//! Keys are taken in blocks with a running maximum and sum (Milakov and Gimelshein, 2018; Dao et al., 2022), so that
//! memory does not grow with the number of tokens.

use rayon::prelude::*;

use super::Tensor;
use super::kernel::Kernel;
use super::pack::{Columns, Matrix, interleave};
use super::product::Shared;
use super::simd::{exp, for_each_level};
use crate::backend::{AttentionSpec, Rope2d};
use crate::host::{AttentionPlan, Strided};

/// Queries a block, rounded up to the kernel's rows.
const QUERIES: usize = 48;
/// Keys a block.
const KEYS: usize = 1536;

/// Computes attention into `out` `[B, Nq, heads * Dv]`.
pub fn attention(plan: &AttentionPlan<'_, Tensor>, spec: &AttentionSpec<'_, Tensor>, out: &mut [f32]) {
    let kernel = Kernel::best();
    let shared = Shared::new(out);
    let block = QUERIES.next_multiple_of(kernel.mr);
    let pairs = plan.batch * plan.heads;
    // Few heads and many queries (or the other way round): enough pieces for every thread.
    let pieces =
        (rayon::current_num_threads() * 4).div_ceil(pairs.max(1)).clamp(1, plan.queries.div_ceil(block).max(1));
    let step = plan.queries.div_ceil(pieces).next_multiple_of(block);
    (0..pairs * pieces).into_par_iter().for_each(|task| {
        let (pair, piece) = (task / pieces, task % pieces);
        let queries = piece * step..((piece + 1) * step).min(plan.queries);
        if !queries.is_empty() {
            OneHead { plan, spec, kernel, batch: pair / plan.heads, head: pair % plan.heads }
                .run(queries, block, shared);
        }
    });
}

struct OneHead<'a> {
    plan: &'a AttentionPlan<'a, Tensor>,
    spec: &'a AttentionSpec<'a, Tensor>,
    kernel: Kernel,
    batch: usize,
    head: usize,
}

impl OneHead<'_> {
    fn values<'t>(&self, part: Strided<'t, Tensor>, token: usize, dim: usize) -> &'t [f32] {
        &part.tensor.values()[part.at(self.batch, token) + self.head * dim..][..dim]
    }

    /// One head of queries or keys as the product takes it: normed, turned, scaled.
    fn prepared(&self, part: Strided<'_, Tensor>, tokens: std::ops::Range<usize>, query: bool) -> Vec<f32> {
        let dim = self.plan.dim;
        let mut out = Vec::with_capacity(tokens.len() * dim);
        for token in tokens {
            let start = out.len();
            out.extend_from_slice(self.values(part, token, dim));
            let row = &mut out[start..];
            if let Some(norm) = &self.spec.qk_norm {
                let (w, b) = if query { (norm.q_weight, norm.q_bias) } else { (norm.k_weight, norm.k_bias) };
                super::rows::layer_norm_row(row, Some(w.values()), Some(b.values()), norm.eps);
            }
            if let Some(rope) = &self.spec.rope {
                turn(row, rope, token);
            }
            if query {
                for v in row {
                    *v *= self.plan.scale;
                }
            }
        }
        out
    }

    fn run(&self, queries: std::ops::Range<usize>, block: usize, out: Shared) {
        let (plan, kernel) = (self.plan, self.kernel);
        let (dim, value_dim) = (plan.dim, plan.value_dim);
        let value_panels = value_dim.div_ceil(kernel.nr);
        let key_count = if self.spec.causal { queries.end.min(plan.keys) } else { plan.keys };
        // Keys and values of this head, packed once for all its queries.
        let (mut keys, mut values) = (Vec::new(), Vec::new());
        for first in (0..key_count).step_by(KEYS) {
            let count = KEYS.min(key_count - first);
            keys.push(self.packed_keys(first, count));
            values.push(self.packed_values(first, count, value_panels));
        }
        let width = KEYS.min(key_count).next_multiple_of(kernel.nr);
        let mut scores = vec![0f32; block * width];
        let mut packed = vec![0f32; kernel.mr * KEYS.max(dim)];
        let mut tile = vec![0f32; kernel.mr * value_panels * kernel.nr];
        for first in queries.clone().step_by(block) {
            let count = block.min(queries.end - first);
            let q = self.prepared(plan.q, first..first + count, true);
            let mut running = Running::new(block, value_dim);
            for (b, (keys, values)) in keys.iter().zip(&values).enumerate() {
                let (start, n) = (b * KEYS, KEYS.min(key_count - b * KEYS));
                self.scores(&q, keys, count, &mut packed, &mut scores, width);
                for i in 0..count {
                    let row = &mut scores[i * width..i * width + n];
                    self.mask(row, first + i, start);
                    running.soften(i, row);
                }
                for top in (0..count).step_by(kernel.mr) {
                    let height = kernel.mr.min(count - top);
                    let empty: &[f32] = &[];
                    let mut rows = [empty; super::kernel::MAX_MR];
                    for (i, row) in rows.iter_mut().enumerate().take(height) {
                        *row = &scores[(top + i) * width..][..n];
                    }
                    interleave(&rows[..height], n, kernel.mr, &mut packed);
                    for p in 0..value_panels {
                        let panel = &values[p * n * kernel.nr..][..n * kernel.nr];
                        kernel.run(n, &packed, panel, &mut tile[p * kernel.nr..], value_panels * kernel.nr, false);
                    }
                    for i in 0..height {
                        running.add(top + i, &tile[i * value_panels * kernel.nr..][..value_dim]);
                    }
                }
            }
            for i in 0..count {
                let row = (self.batch * plan.queries + first + i) * plan.heads + self.head;
                // SAFETY: this row of this head is written by this task only.
                running.write(i, unsafe { out.part(row * value_dim, value_dim) });
            }
        }
    }

    fn packed_keys(&self, first: usize, count: usize) -> Vec<f32> {
        let (dim, nr) = (self.plan.dim, self.kernel.nr);
        let k = self.prepared(self.plan.k, first..first + count, false);
        let columns = Columns::Transposed(Matrix { data: &k, stride: dim });
        let mut out = vec![0f32; count.next_multiple_of(nr) * dim];
        for (i, panel) in out.chunks_exact_mut(nr * dim).enumerate() {
            columns.pack(i * nr, nr.min(count - i * nr), 0, dim, nr, panel);
        }
        out
    }

    fn packed_values(&self, first: usize, count: usize, panels: usize) -> Vec<f32> {
        let (dim, nr) = (self.plan.value_dim, self.kernel.nr);
        let mut out = vec![0f32; panels * count * nr];
        for token in 0..count {
            let row = self.values(self.plan.v, first + token, dim);
            for (p, part) in row.chunks(nr).enumerate() {
                out[(p * count + token) * nr..][..part.len()].copy_from_slice(part);
            }
        }
        out
    }

    fn scores(&self, q: &[f32], keys: &[f32], count: usize, packed: &mut [f32], scores: &mut [f32], width: usize) {
        let (dim, Kernel { mr, nr, .. }) = (self.plan.dim, self.kernel);
        for top in (0..count).step_by(mr) {
            let height = mr.min(count - top);
            let empty: &[f32] = &[];
            let mut rows = [empty; super::kernel::MAX_MR];
            for (i, row) in rows.iter_mut().enumerate().take(height) {
                *row = &q[(top + i) * dim..][..dim];
            }
            interleave(&rows[..height], dim, mr, packed);
            for (p, panel) in keys.chunks_exact(dim * nr).enumerate() {
                self.kernel.run(dim, packed, panel, &mut scores[top * width + p * nr..], width, false);
            }
        }
    }

    fn mask(&self, row: &mut [f32], query: usize, first_key: usize) {
        if let Some(bias) = self.spec.bias {
            let at = self.plan.bias_at(self.batch, query) + first_key;
            row.iter_mut().zip(&bias.values()[at..]).for_each(|(s, b)| *s += b);
        }
        if self.spec.causal {
            let seen = (query + 1).saturating_sub(first_key).min(row.len());
            row[seen..].fill(f32::NEG_INFINITY);
        }
    }
}

/// The running softmax of a block of queries.
struct Running {
    top: Vec<f32>,
    total: Vec<f32>,
    sums: Vec<f32>,
    dim: usize,
}

impl Running {
    fn new(block: usize, dim: usize) -> Self {
        Self { top: vec![f32::NEG_INFINITY; block], total: vec![0.0; block], sums: vec![0.0; block * dim], dim }
    }

    /// Scores become weights relative to the largest score so far.
    fn soften(&mut self, i: usize, row: &mut [f32]) {
        let top = largest(row).max(self.top[i]);
        if top == f32::NEG_INFINITY {
            row.fill(0.0);
            return;
        }
        let faded = (self.top[i] - top).exp();
        if faded != 1.0 {
            self.total[i] *= faded;
            self.sums[i * self.dim..(i + 1) * self.dim].iter_mut().for_each(|s| *s *= faded);
        }
        self.top[i] = top;
        self.total[i] += exp_sum(row, top);
    }

    fn add(&mut self, i: usize, row: &[f32]) {
        self.sums[i * self.dim..(i + 1) * self.dim].iter_mut().zip(row).for_each(|(s, v)| *s += v);
    }

    fn write(&self, i: usize, out: &mut [f32]) {
        let inv = if self.total[i] == 0.0 { 0.0 } else { 1.0 / self.total[i] };
        out.iter_mut().zip(&self.sums[i * self.dim..(i + 1) * self.dim]).for_each(|(o, s)| *o = s * inv);
    }
}

/// Rotary positions; see [`Rope2d`].
fn turn(row: &mut [f32], rope: &Rope2d<'_, Tensor>, token: usize) {
    let quarter = row.len() / 4;
    let cos = &rope.cos.values()[token * 2 * quarter..][..2 * quarter];
    let sin = &rope.sin.values()[token * 2 * quarter..][..2 * quarter];
    for (h, half) in row.chunks_exact_mut(2 * quarter).enumerate() {
        let (front, back) = half.split_at_mut(quarter);
        for j in 0..quarter {
            let (c, s) = (cos[h * quarter + j], sin[h * quarter + j]);
            (front[j], back[j]) = (front[j] * c - back[j] * s, back[j] * c + front[j] * s);
        }
    }
}

for_each_level! {
    /// Largest value; NaN is passed over.
    pub fn largest(row: &[f32]) -> f32 {
        let (chunks, rest) = row.as_chunks::<32>();
        let mut top = [f32::NEG_INFINITY; 32];
        for chunk in chunks {
            for i in 0..32 {
                top[i] = if chunk[i] > top[i] { chunk[i] } else { top[i] };
            }
        }
        top.iter().chain(rest).fold(f32::NEG_INFINITY, |a, b| if *b > a { *b } else { a })
    }
}

for_each_level! {
    /// `v = exp(v - top)` for every value, and the sum of these.
    pub fn exp_sum(row: &mut [f32], top: f32) -> f32 {
        let (chunks, rest) = row.as_chunks_mut::<32>();
        let mut sums = [0f32; 32];
        for chunk in chunks {
            for i in 0..32 {
                chunk[i] = exp(chunk[i] - top);
                sums[i] += chunk[i];
            }
        }
        let mut total: f32 = sums.iter().sum();
        for v in rest {
            *v = exp(*v - top);
            total += *v;
        }
        total
    }
}
