//! Smoothing within the pieces of an image: what a surface has slowly varying, without its neighbours' share.

use harmony_scene::ImageSize;

/// A Gaussian's weights out to 2.5 standard deviations, in pixels.
fn kernel(sigma: f64) -> Vec<f32> {
    let reach = (2.5 * sigma).ceil().max(1.0) as i64;
    (-reach..=reach).map(|k| (-(k as f64).powi(2) / (2.0 * sigma * sigma)).exp() as f32).collect()
}

/// One axis of a blur over `window` of a row-major image; beyond the window is nothing.
fn blur_axis(values: &[f32], count: usize, lines: usize, step: usize, line_step: usize, kernel: &[f32]) -> Vec<f32> {
    let reach = kernel.len() / 2;
    let mut out = vec![0.0; values.len()];
    for line in 0..lines {
        // Nodes are small: most lines of most are empty.
        let Some(first) = (0..count).find(|i| values[line * line_step + i * step] != 0.0) else { continue };
        let last = (first..count).rfind(|i| values[line * line_step + i * step] != 0.0).unwrap_or(first);
        for i in first.saturating_sub(reach)..(last + reach + 1).min(count) {
            let (from, to) = (i.saturating_sub(reach), (i + reach + 1).min(count));
            let mut sum = 0.0;
            for j in from..to {
                sum += values[line * line_step + j * step] * kernel[j + reach - i];
            }
            out[line * line_step + i * step] = sum;
        }
    }
    out
}

fn blur(values: &[f32], size: ImageSize, kernel: &[f32]) -> Vec<f32> {
    let (w, h) = (size.width as usize, size.height as usize);
    let across = blur_axis(values, w, h, 1, w, kernel);
    blur_axis(&across, h, w, w, 1, kernel)
}

/// The weighted mean of `values` around each pixel of the image, Gaussian of `sigma` pixels.
///
/// Where there is little weight about, the value goes to 0: give residuals from a mean.
pub(crate) fn smoothed(values: &[[f32; 3]], weights: &[f32], size: ImageSize, sigma: f64) -> Vec<[f32; 3]> {
    let kernel = kernel(sigma);
    // As much doubt as a twentieth of a full neighbourhood.
    let full: f32 = kernel.iter().sum::<f32>().powi(2);
    let mass = blur(weights, size, &kernel);
    let mut out = vec![[0.0; 3]; values.len()];
    for c in 0..3 {
        let channel: Vec<f32> =
            values.iter().zip(weights).map(|(v, w)| if *w > 0.0 { v[c] * w } else { 0.0 }).collect();
        for ((o, v), m) in out.iter_mut().zip(blur(&channel, size, &kernel)).zip(&mass) {
            o[c] = v / (m + 0.05 * full).max(1e-12);
        }
    }
    out
}

/// Pixels whose 3 x 3 neighbours all have the same id.
pub(crate) fn interior(ids: &[u32], size: ImageSize) -> Vec<bool> {
    let (w, h) = (size.width as usize, size.height as usize);
    (0..ids.len())
        .map(|i| {
            let (x, y) = (i % w.max(1), i / w.max(1));
            (y.saturating_sub(1)..(y + 2).min(h))
                .all(|v| (x.saturating_sub(1)..(x + 2).min(w)).all(|u| ids[v * w + u] == ids[i]))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_neighbours_values_do_not_leak_and_a_constant_stays() {
        let size = ImageSize::new(30, 10);
        let left = |i: usize| i % 30 < 15;
        let values: Vec<[f32; 3]> = (0..300).map(|i| if left(i) { [1.0; 3] } else { [9.0; 3] }).collect();
        let weights: Vec<f32> = (0..300).map(|i| f32::from(u8::from(left(i)))).collect();
        let smooth = smoothed(&values, &weights, size, 3.0);
        assert!((smooth[5 * 30 + 7][0] - 1.0).abs() <= 0.08, "{:?}", smooth[5 * 30 + 7]);
        assert!(smooth[5 * 30 + 29][0].abs() <= 0.05, "far from any weight it is 0");
    }

    #[test]
    fn borders_between_ids_are_no_interior() {
        let ids: Vec<u32> = (0..36).map(|i| u32::from(i % 6 >= 3)).collect();
        let inside = interior(&ids, ImageSize::new(6, 6));
        assert!(inside[0] && inside[7] && !inside[8] && !inside[9] && inside[10]);
    }
}
