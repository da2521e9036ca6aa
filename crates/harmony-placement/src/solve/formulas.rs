//! The paper's formulas of Sec. 3.3 "Visual Geometry-Grounded Refinement", one function each.
//!
//! Kept apart from the code that uses them so that each can be read beside its equation and tested on its own. Lengths
//! along the camera's axes in metres, image lengths in pixels, focal length in pixels; sizes in metres a canonical
//! unit. They hold for one object in front of a pinhole camera, its depth taken as one number.

/// Lateral translation along the camera's right axis, `Δu Z / f_x` (`align.lateral`), metres.
///
/// `du` is the mask's centre minus the silhouette's, pixels; `depth` the object's `Z` along the window, metres.
pub fn lateral_shift(du: f64, depth: f64, fx: f64) -> f64 {
    du * depth / fx
}

/// Apparent (angular) size `α = ŵ / f_x` (`align.angular_size`) of a mask `width_px` wide.
pub fn angular_size(width_px: f64, fx: f64) -> f64 {
    width_px / fx
}

/// Corrected depth `Z' = Z + (c_ref - c_ren) · f` (`align.depth`), from the front-surface means along the window, metres.
pub fn corrected_depth(depth: f64, front_reference: f64, front_rendered: f64) -> f64 {
    depth + (front_reference - front_rendered)
}

/// Metric scale `s = α Z' / w_obj` (`align.scale`), metres per canonical unit.
pub fn metric_scale(angular_size: f64, depth: f64, canonical_width: f64) -> f64 {
    angular_size * depth / canonical_width
}

/// Mean depth of the front surface by iterated median with MAD outlier rejection (the paper's `c^front` along the
/// window, where its 3D mean is used for nothing else); `None` without finite values.
pub fn front_surface_depth(values: &[f64]) -> Option<f64> {
    harmony_geometry::robust_mean_scalar(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_front_surface_depth_ignores_a_third_of_outliers(
            z in 1.0_f64..6.0,
            spread in 0.001_f64..0.03,
            outlier in 1.0_f64..10.0,
            n in 20_usize..200,
        ) {
            let mut values: Vec<f64> = (0..n).map(|i| z + spread * (2.0 * i as f64 / n as f64 - 1.0)).collect();
            values.extend(std::iter::repeat_n(z + outlier, n / 2));
            let mean = front_surface_depth(&values).unwrap();
            // One surface of half width `spread`: what is left of it has its mean within.
            prop_assert!((mean - z).abs() <= spread, "{mean} for {z}");
        }

        #[test]
        fn scale_and_depth_change_together_at_a_fixed_angular_size(
            px in 10.0_f64..500.0, fx in 300.0_f64..1500.0, w in 0.2_f64..3.0, z in 0.5_f64..8.0, dz in -0.4_f64..3.0,
        ) {
            let alpha = angular_size(px, fx);
            let after = corrected_depth(z, 1.0 + dz, 1.0);
            let projected = fx * metric_scale(alpha, after, w) * w / after;
            prop_assert!((projected - px).abs() <= 1e-9 * px);
        }
    }
}
