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
