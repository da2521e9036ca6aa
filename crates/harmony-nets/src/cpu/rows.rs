//! Norms and sums over the last axis.

use super::simd::for_each_level;

for_each_level! {
    /// Sum of a row, in 32 partial sums.
    pub fn sum(row: &[f32]) -> f32 {
        let (chunks, rest) = row.as_chunks::<32>();
        let mut sums = [0f32; 32];
        for chunk in chunks {
            for i in 0..32 {
                sums[i] += chunk[i];
            }
        }
        sums.iter().sum::<f32>() + rest.iter().sum::<f32>()
    }
}

for_each_level! {
    /// Sum of squared distances from `mean`.
    pub fn sum_of_squares(row: &[f32], mean: f32) -> f32 {
        let (chunks, rest) = row.as_chunks::<32>();
        let mut sums = [0f32; 32];
        for chunk in chunks {
            for i in 0..32 {
                let d = chunk[i] - mean;
                sums[i] += d * d;
            }
        }
        sums.iter().sum::<f32>() + rest.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>()
    }
}

for_each_level! {
    /// Layer norm of one row in place.
    pub fn layer_norm_row(row: &mut [f32], weight: Option<&[f32]>, bias: Option<&[f32]>, eps: f32) {
        let n = row.len() as f32;
        let mean = sum(row) / n;
        let inv = 1.0 / (sum_of_squares(row, mean) / n + eps).sqrt();
        for v in row.iter_mut() {
            *v = (*v - mean) * inv;
        }
        if let Some(weight) = weight {
            for (v, w) in row.iter_mut().zip(weight) {
                *v *= w;
            }
        }
        if let Some(bias) = bias {
            for (v, b) in row.iter_mut().zip(bias) {
                *v += b;
            }
        }
    }
}
