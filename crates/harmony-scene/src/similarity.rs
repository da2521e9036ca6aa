//! Similarity transforms between named frames.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// `x -> scale * rotation * x + translation`; a value is named `target_from_source`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    /// Uniform scale.
    pub scale: f64,
    /// Proper rotation.
    pub rotation: DMat3,
    /// Translation, in the target's unit.
    pub translation: DVec3,
}

impl Similarity {
    /// The identity.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// Maps a point.
    pub fn point(&self, x: DVec3) -> DVec3 {
        self.rotation * x * self.scale + self.translation
    }

    /// Maps a direction (rotation only).
    pub fn direction(&self, x: DVec3) -> DVec3 {
        self.rotation * x
    }

    /// The inverse map.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        let scale = 1.0 / self.scale;
        Self { scale, rotation, translation: -(rotation * self.translation) * scale }
    }
}

impl std::ops::Mul for Similarity {
    type Output = Self;

    /// `a_from_b * b_from_c = a_from_c`.
    fn mul(self, rhs: Self) -> Self {
        Self {
            scale: self.scale * rhs.scale,
            rotation: self.rotation * rhs.rotation,
            translation: self.point(rhs.translation),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use proptest::prelude::*;

    use super::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        [-10.0..10.0, -10.0..10.0, -10.0..10.0].prop_map(DVec3::from_array)
    }

    fn similarity() -> impl Strategy<Value = Similarity> {
        let rotation = (vector(), 0.0..6.0).prop_filter_map("an axis", |(axis, angle)| {
            Some(DMat3::from_quat(DQuat::from_axis_angle(axis.try_normalize()?, angle)))
        });
        (0.05..20.0, rotation, vector()).prop_map(|(scale, rotation, translation)| Similarity {
            scale,
            rotation,
            translation,
        })
    }

    proptest! {
        #[test]
        fn the_inverse_leads_back(s in similarity(), x in vector()) {
            prop_assert!(s.inverse().point(s.point(x)).abs_diff_eq(x, 1e-9));
            prop_assert!(s.point(s.inverse().point(x)).abs_diff_eq(x, 1e-9));
            prop_assert!((s.inverse() * s).point(x).abs_diff_eq(x, 1e-9));
        }

        #[test]
        fn a_product_is_one_map_after_the_other(a in similarity(), b in similarity(), x in vector()) {
            let apart = a.point(b.point(x));
            prop_assert!((a * b).point(x).abs_diff_eq(apart, 1e-9 * (1.0 + apart.length())));
            prop_assert!((a * b).direction(x).abs_diff_eq(a.direction(b.direction(x)), 1e-9));
        }

        #[test]
        fn distances_are_scaled_and_directions_keep_their_length(s in similarity(), x in vector(), y in vector()) {
            let distance = s.point(x).distance(s.point(y));
            prop_assert!((distance - s.scale * x.distance(y)).abs() < 1e-9 * (1.0 + distance));
            prop_assert!((s.direction(x).length() - x.length()).abs() < 1e-9);
        }
    }

    #[test]
    fn a_point_is_turned_scaled_and_moved_in_this_order() {
        let s = Similarity {
            scale: 2.0,
            rotation: DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2),
            translation: DVec3::new(1.0, 0.0, 0.0),
        };
        assert!(s.point(DVec3::Z).abs_diff_eq(DVec3::new(3.0, 0.0, 0.0), 1e-12));
        assert!(s.direction(DVec3::Z).abs_diff_eq(DVec3::X, 1e-12));
        assert_eq!(Similarity::IDENTITY.point(DVec3::X), DVec3::X);
    }
}
