//! Scale of a prediction from depth maps.

use harmony_geometry::median;
use harmony_scene::Mask;
use serde::Serialize;

/// A factor that carries predicted lengths to true ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DepthScale {
    /// Median of true over predicted depth.
    pub factor: f64,
    /// Pixels it was taken from.
    pub pixels: usize,
}

/// The median ratio of true to predicted depth over the pixels of the mask where both are finite and positive.
///
/// Depths are planar (along the optical axis), row by row at the mask's size; the true ones in metres, the predicted
/// ones in any unit. For an even number of pixels the median is the mean of the middle two. `None` when no pixel is
/// left or a map is not of the mask's size.
pub fn median_depth_scale(predicted: &[f32], truth: &[f32], mask: &Mask) -> Option<DepthScale> {
    let bits = mask.bits();
    if predicted.len() != bits.len() || truth.len() != bits.len() {
        return None;
    }
    let usable = |depth: f32| depth.is_finite() && depth > 0.0;
    let ratios: Vec<f64> = predicted
        .iter()
        .zip(truth)
        .zip(bits)
        .filter(|((p, t), on)| **on && usable(**p) && usable(**t))
        .map(|((p, t), _)| f64::from(*t) / f64::from(*p))
        .collect();
    Some(DepthScale { factor: median(&ratios)?, pixels: ratios.len() })
}

#[cfg(test)]
mod tests {
    use harmony_scene::ImageSize;

    use super::*;

    #[test]
    fn the_scale_ignores_a_minority_and_what_is_not_measured() {
        let mask = Mask::from_fn(ImageSize::new(4, 2), |x, y| (x, y) != (3, 1));
        let predicted = [1.0, 2.0, 3.0, 1.0, 2.0, 4.0, f32::NAN, 1.0];
        let truth = [1.5, 3.0, 4.5, 9.0, 3.0, 0.0, 2.0, 50.0];
        // Ratios 1.5, 1.5, 1.5, 9, 1.5.
        assert_eq!(median_depth_scale(&predicted, &truth, &mask), Some(DepthScale { factor: 1.5, pixels: 5 }));
        assert_eq!(median_depth_scale(&[0.0; 8], &truth, &mask), None);
        assert_eq!(median_depth_scale(&predicted[..7], &truth, &mask), None);
    }
}
