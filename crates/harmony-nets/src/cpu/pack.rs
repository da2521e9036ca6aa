//! Putting rows and columns into the order in which the kernel reads them, a block at a time.

/// Where the rows of a product come from.
pub trait Rows: Sync {
    /// Packs `count` rows from `first`, `depth` values each from `k`, as `[k][mr]`; missing rows are zeros.
    fn pack(&self, first: usize, count: usize, k: usize, depth: usize, mr: usize, to: &mut [f32]);
}

/// Rows that lie in memory, `stride` apart.
#[derive(Debug, Clone, Copy)]
pub struct Matrix<'a> {
    /// The values.
    pub data: &'a [f32],
    /// From one row to the next.
    pub stride: usize,
}

impl Matrix<'_> {
    /// `depth` values of row `i` from column `k`.
    pub fn part(&self, i: usize, k: usize, depth: usize) -> &[f32] {
        &self.data[i * self.stride + k..][..depth]
    }
}

impl Rows for Matrix<'_> {
    fn pack(&self, first: usize, count: usize, k: usize, depth: usize, mr: usize, to: &mut [f32]) {
        let empty: &[f32] = &[];
        let mut rows = [empty; super::kernel::MAX_MR];
        for (i, row) in rows.iter_mut().enumerate().take(count) {
            *row = self.part(first + i, k, depth);
        }
        interleave(&rows[..count], depth, mr, to);
    }
}

/// Writes rows as columns: `to[k * width + i] = rows[i][k]`, zeros for missing rows.
pub fn interleave(rows: &[&[f32]], depth: usize, width: usize, to: &mut [f32]) {
    let to = &mut to[..depth * width];
    if rows.len() < width {
        to.fill(0.0);
    }
    // Eight rows at a time keep the lines that are written in the nearest cache.
    for (block, rows) in rows.chunks(8).enumerate() {
        if let Ok(rows) = <&[&[f32]; 8]>::try_from(rows) {
            let rows = rows.map(|row| &row[..depth]);
            for (k, cell) in to.chunks_exact_mut(width).enumerate() {
                let cell = &mut cell[block * 8..block * 8 + 8];
                for i in 0..8 {
                    cell[i] = rows[i][k];
                }
            }
        } else {
            for (i, row) in rows.iter().enumerate() {
                for (k, value) in row[..depth].iter().enumerate() {
                    to[k * width + block * 8 + i] = *value;
                }
            }
        }
    }
}

/// Where the columns of a product come from.
#[derive(Debug, Clone, Copy)]
pub enum Columns<'a> {
    /// `[N, K]`: every column is a row in memory (weights of linear layers, keys).
    Transposed(Matrix<'a>),
    /// `[K, N]`.
    Plain(Matrix<'a>),
}

impl Columns<'_> {
    /// Packs `count` columns from `first`, `depth` values each from `k`, as `[k][nr]`; missing columns are zeros.
    pub fn pack(&self, first: usize, count: usize, k: usize, depth: usize, nr: usize, to: &mut [f32]) {
        match self {
            Self::Transposed(m) => {
                let empty: &[f32] = &[];
                let mut rows = [empty; 32];
                for (i, row) in rows.iter_mut().enumerate().take(count) {
                    *row = m.part(first + i, k, depth);
                }
                transpose(&rows[..count], depth, nr, to);
            }
            Self::Plain(m) => {
                for (d, cell) in to[..depth * nr].chunks_exact_mut(nr).enumerate() {
                    cell[..count].copy_from_slice(m.part(k + d, first, count));
                    cell[count..].fill(0.0);
                }
            }
        }
    }
}

/// [`interleave`] for wide panels: blocks of 16 by 16 in registers where the machine can.
fn transpose(rows: &[&[f32]], depth: usize, width: usize, to: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    if rows.len() == 32 && width == 32 && super::simd::Level::best() == super::simd::Level::Avx512 {
        let whole = depth / 16 * 16;
        for (half, rows) in rows.as_chunks::<16>().0.iter().enumerate() {
            for k in (0..whole).step_by(16) {
                assert!(rows.iter().all(|row| row.len() >= k + 16) && to.len() >= (k + 15) * 32 + half * 16 + 16);
                // SAFETY: the machine has AVX-512, and the lengths were just checked.
                unsafe {
                    transpose16(&rows.map(|row| row.as_ptr().add(k)), to.as_mut_ptr().add(k * 32 + half * 16));
                }
            }
        }
        for k in whole..depth {
            for (i, row) in rows.iter().enumerate() {
                to[k * 32 + i] = row[k];
            }
        }
        return;
    }
    interleave(rows, depth, width, to);
}

/// 16 rows of 16 values to 16 columns, written 32 apart.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn transpose16(rows: &[*const f32; 16], to: *mut f32) {
    use std::arch::x86_64::*;
    // SAFETY: the caller checked the lengths.
    unsafe {
        let r: [__m512; 16] = std::array::from_fn(|i| _mm512_loadu_ps(rows[i]));
        // Pairs of rows, then fours, then the four 128-bit lanes.
        let pair = |a: __m512, b: __m512| (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
        let mut s = [_mm512_setzero_ps(); 16];
        for g in 0..4 {
            let (a0, a1) = pair(r[4 * g], r[4 * g + 1]);
            let (b0, b1) = pair(r[4 * g + 2], r[4 * g + 3]);
            s[4 * g] = _mm512_shuffle_ps::<0b01_00_01_00>(a0, b0);
            s[4 * g + 1] = _mm512_shuffle_ps::<0b11_10_11_10>(a0, b0);
            s[4 * g + 2] = _mm512_shuffle_ps::<0b01_00_01_00>(a1, b1);
            s[4 * g + 3] = _mm512_shuffle_ps::<0b11_10_11_10>(a1, b1);
        }
        // s[4 g + c] holds, in lane l, column 4 l + c of rows 4 g .. 4 g + 4.
        for c in 0..4 {
            let lo = _mm512_shuffle_f32x4::<0b10_00_10_00>(s[c], s[4 + c]);
            let hi = _mm512_shuffle_f32x4::<0b11_01_11_01>(s[c], s[4 + c]);
            let lo2 = _mm512_shuffle_f32x4::<0b10_00_10_00>(s[8 + c], s[12 + c]);
            let hi2 = _mm512_shuffle_f32x4::<0b11_01_11_01>(s[8 + c], s[12 + c]);
            _mm512_storeu_ps(to.add(c * 32), _mm512_shuffle_f32x4::<0b10_00_10_00>(lo, lo2));
            _mm512_storeu_ps(to.add((4 + c) * 32), _mm512_shuffle_f32x4::<0b10_00_10_00>(hi, hi2));
            _mm512_storeu_ps(to.add((8 + c) * 32), _mm512_shuffle_f32x4::<0b11_01_11_01>(lo, lo2));
            _mm512_storeu_ps(to.add((12 + c) * 32), _mm512_shuffle_f32x4::<0b11_01_11_01>(hi, hi2));
        }
    }
}
