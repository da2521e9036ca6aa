//! The innermost loop of every product: a tile of `MR` rows by `NR` columns in registers.

use super::simd::Level;

/// A tile kernel: `c[i][j] (+)= sum_k a[k][i] b[k][j]` for a full tile.
///
/// Arguments: depth, packed rows `[k][MR]`, packed columns `[k][NR]`, the tile, its row stride, whether to add to it.
pub type Run = unsafe fn(usize, *const f32, *const f32, *mut f32, usize, bool);

/// A kernel and the size of its tile.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Rows.
    pub mr: usize,
    /// Columns.
    pub nr: usize,
    run: Run,
}

/// Largest tile of any kernel, for scratch space.
pub const MAX_TILE: usize = 12 * 32;
/// Most rows of any kernel.
pub const MAX_MR: usize = 12;

impl Kernel {
    /// The best kernel of this machine.
    pub fn best() -> Self {
        match Level::best() {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => Self { mr: 12, nr: 32, run: avx512 },
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => Self { mr: 6, nr: 16, run: avx2 },
            _ => Self { mr: 4, nr: 8, run: portable },
        }
    }

    /// Runs the kernel on a full tile at the front of `c`.
    ///
    /// # Panics
    /// When a slice is too short.
    pub fn run(&self, depth: usize, a: &[f32], b: &[f32], c: &mut [f32], stride: usize, add: bool) {
        assert!(a.len() >= depth * self.mr && b.len() >= depth * self.nr);
        assert!(stride >= self.nr && c.len() >= (self.mr - 1) * stride + self.nr);
        // SAFETY: the lengths were just checked, and `best` chose a kernel that the machine can run.
        unsafe { (self.run)(depth, a.as_ptr(), b.as_ptr(), c.as_mut_ptr(), stride, add) }
    }

    /// As [`Kernel::run`], for a tile inside memory that other threads write other parts of.
    ///
    /// # Safety
    /// `c` must be valid for `mr` rows of `nr` values, `stride` apart, and nobody else may touch these meanwhile.
    pub unsafe fn run_raw(&self, depth: usize, a: &[f32], b: &[f32], c: *mut f32, stride: usize, add: bool) {
        assert!(a.len() >= depth * self.mr && b.len() >= depth * self.nr);
        // SAFETY: the caller's promise, and the lengths were just checked.
        unsafe { (self.run)(depth, a.as_ptr(), b.as_ptr(), c, stride, add) }
    }
}

#[cfg(target_arch = "x86_64")]
macro_rules! tile_kernel {
    ($name:ident, $features:literal, $mr:literal, $nv:literal, $lanes:literal, $zero:ident, $load:ident, $store:ident, $splat:ident, $fma:ident, $plus:ident) => {
        #[target_feature(enable = $features)]
        unsafe fn $name(depth: usize, a: *const f32, b: *const f32, c: *mut f32, stride: usize, add: bool) {
            use std::arch::x86_64::*;
            // SAFETY: the caller of `Kernel::run` gave as many values as are read and written here.
            unsafe {
                let mut sums = [[$zero(); $nv]; $mr];
                let (mut a, mut b) = (a, b);
                for _ in 0..depth {
                    let mut columns = [$zero(); $nv];
                    for (j, column) in columns.iter_mut().enumerate() {
                        *column = $load(b.add(j * $lanes));
                    }
                    for (i, row) in sums.iter_mut().enumerate() {
                        let value = $splat(*a.add(i));
                        for (sum, column) in row.iter_mut().zip(&columns) {
                            *sum = $fma(value, *column, *sum);
                        }
                    }
                    a = a.add($mr);
                    b = b.add($nv * $lanes);
                }
                for (i, row) in sums.iter().enumerate() {
                    for (j, sum) in row.iter().enumerate() {
                        let to = c.add(i * stride + j * $lanes);
                        $store(to, if add { $plus($load(to), *sum) } else { *sum });
                    }
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
tile_kernel!(
    avx512,
    "avx512f",
    12,
    2,
    16,
    _mm512_setzero_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_set1_ps,
    _mm512_fmadd_ps,
    _mm512_add_ps
);
#[cfg(target_arch = "x86_64")]
tile_kernel!(
    avx2,
    "avx2,fma",
    6,
    2,
    8,
    _mm256_setzero_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_set1_ps,
    _mm256_fmadd_ps,
    _mm256_add_ps
);

unsafe fn portable(depth: usize, a: *const f32, b: *const f32, c: *mut f32, stride: usize, add: bool) {
    // SAFETY: the caller of `Kernel::run` gave as many values as are read and written here.
    unsafe {
        let mut sums = [[0f32; 8]; 4];
        for k in 0..depth {
            for (i, row) in sums.iter_mut().enumerate() {
                let value = *a.add(k * 4 + i);
                for (j, sum) in row.iter_mut().enumerate() {
                    *sum += value * *b.add(k * 8 + j);
                }
            }
        }
        for (i, row) in sums.iter().enumerate() {
            for (j, sum) in row.iter().enumerate() {
                let to = c.add(i * stride + j);
                *to = if add { *to + sum } else { *sum };
            }
        }
    }
}
