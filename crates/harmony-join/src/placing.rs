//! Where a run's room lies in the joined one.

use glam::{DMat3, DVec2, DVec3};
use harmony_scene::{Camera, Extents, Pose, QuarterTurn, Similarity, Wall};
use serde::Serialize;

/// `joined = scale * Ry(quarters + yaw) * run + (x, 0, z)`: floors lie on each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Placing {
    /// Which wall of the run is which of the joined room.
    pub turn: QuarterTurn,
    /// What the run's walls are askew to the joined ones, radians.
    pub yaw: f64,
    /// Logarithm of the factor on the run's lengths.
    pub ln_scale: f64,
    /// Where the run's origin is, metres.
    pub x: f64,
    /// As `x`.
    pub z: f64,
}

impl Placing {
    /// The run whose frame is the joined one's.
    pub const FIRST: Self = Self { turn: QuarterTurn::ALL[0], yaw: 0.0, ln_scale: 0.0, x: 0.0, z: 0.0 };

    /// The similarity.
    pub fn joined_from_run(&self) -> Similarity {
        Similarity {
            scale: self.ln_scale.exp(),
            rotation: DMat3::from_rotation_y(self.turn.angle() + self.yaw),
            translation: DVec3::new(self.x, 0.0, self.z),
        }
    }

    /// A point of the run in the joined room.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.joined_from_run().point(p)
    }

    /// A yaw of the run in the joined room.
    pub fn turned(&self, yaw: f64) -> f64 {
        yaw + self.turn.angle() + self.yaw
    }

    /// A pose of the run in the joined room.
    pub fn pose(&self, pose: &Pose) -> Pose {
        Pose {
            position: self.point(pose.position),
            yaw: self.turned(pose.yaw),
            scale: pose.scale * self.ln_scale.exp(),
            stretch: pose.stretch,
        }
    }

    /// The run's camera in the joined room: its picture stays.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let s = self.joined_from_run();
        let rotation = camera.rotation * s.rotation.transpose();
        let translation = camera.translation * s.scale - rotation * s.translation;
        Camera { rotation, translation, ..*camera }
    }

    /// Where the plane of a wall of the run lies in the joined room: its offset along the axis of the joined wall that it
    /// is (x for left and right, z for back and front), taken where the run's camera stands before it.
    pub fn wall_offset(&self, wall: Wall, extents: &Extents, camera: DVec3) -> f64 {
        let foot = camera - wall.normal() * wall.distance(extents, camera);
        let at = self.point(foot);
        if is_across(self.turn.wall(wall)) { at.x } else { at.z }
    }

    /// `self` after `first`: where the run of `first` lies in the frame of `self`.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        let s = self.joined_from_run() * first.joined_from_run();
        let quarters = usize::from((self.turn.quarters() + first.turn.quarters()) % 4);
        Self {
            turn: QuarterTurn::ALL[quarters],
            yaw: self.yaw + first.yaw,
            ln_scale: self.ln_scale + first.ln_scale,
            x: s.translation.x,
            z: s.translation.z,
        }
    }

    /// The way back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let s = self.joined_from_run().inverse();
        Self {
            turn: self.turn.inverse(),
            yaw: -self.yaw,
            ln_scale: -self.ln_scale,
            x: s.translation.x,
            z: s.translation.z,
        }
    }
}

/// Whether a wall's normal runs along x.
pub fn is_across(wall: Wall) -> bool {
    matches!(wall, Wall::Left | Wall::Right)
}

/// Covariance of a place on the floor as a photo shows it, as its square root: rows `[lateral; along]` of
/// `(x, z) / sigma` in the run's frame.
#[derive(Debug, Clone, Copy)]
pub struct PlaceNoise {
    /// Unit vector from the camera to the place.
    pub along: DVec2,
    /// Sigma across the line of sight, metres.
    pub across_m: f64,
    /// Sigma along it, metres.
    pub along_m: f64,
}

impl PlaceNoise {
    /// A difference on the floor, run frame, in sigmas: across and along the line of sight.
    pub fn sigmas(&self, difference: DVec2) -> DVec2 {
        let across = DVec2::new(-self.along.y, self.along.x);
        DVec2::new(difference.dot(across) / self.across_m, difference.dot(self.along) / self.along_m)
    }
}

#[cfg(test)]
mod tests {
    use harmony_scene::{ImageSize, Intrinsics};

    use super::*;

    fn some(quarters: usize) -> Placing {
        Placing { turn: QuarterTurn::ALL[quarters], yaw: 0.03, ln_scale: 0.07, x: 1.2, z: -0.4 }
    }

    #[test]
    fn products_and_inverses_are_those_of_similarities() {
        let point = DVec3::new(0.7, 0.9, 2.1);
        for k in 0..4 {
            let (a, b) = (some(k), some((k + 2) % 4));
            assert!((a.after(&b).point(point) - a.point(b.point(point))).length() < 1e-12);
            assert!((a.inverse().point(a.point(point)) - point).length() < 1e-12);
        }
    }

    #[test]
    fn a_camera_goes_with_its_room() {
        let size = ImageSize::new(640, 480);
        let lens = Intrinsics::from_horizontal_fov(size, 1.2);
        let camera = Camera::looking(size, lens, DVec3::new(1.0, 1.5, 4.5), DVec3::new(0.2, -0.2, -1.0));
        let point = DVec3::new(0.6, 0.4, 1.1);
        let placing = some(3);
        let pixel = placing.camera(&camera).project(placing.point(point)).unwrap();
        assert!((pixel - camera.project(point).unwrap()).length() < 1e-9);
    }

    #[test]
    fn a_wall_is_where_its_points_are() {
        let extents = Extents { width: 3.0, height: 2.5, depth: 5.0 };
        for turn in QuarterTurn::ALL {
            let origin = turn.origin(&extents);
            let placing = Placing { turn, yaw: 0.0, ln_scale: 0.0, x: origin.x, z: origin.z };
            let turned = turn.extents(&extents);
            for wall in Wall::ALL {
                let offset = placing.wall_offset(wall, &extents, DVec3::new(1.0, 1.5, 2.0));
                let expected = match turn.wall(wall) {
                    Wall::Back | Wall::Left => 0.0,
                    Wall::Right => turned.width,
                    Wall::Front => turned.depth,
                };
                assert!((offset - expected).abs() < 1e-12, "{turn:?} {wall:?}");
            }
        }
    }
}
