//! The closed-form similarity from the point map into the room.
//!
//! Rotation by the oriented Manhattan axes, scale by one vertical edge whose length in metres is known, translation by
//! its lower end (paper Sec. 3.1, Alg. 1). From the `points` frame (any unit, any pose) to the `room` frame (metres, +X
//! width, +Y up, +Z off the back wall). Exact and without weighing: an error of the edge is an error of the whole room,
//! which the joint refinement may take back.

use harmony_scene::{Camera, ImageSize, Intrinsics, Mat3, Similarity, Vec3};

use crate::CalibrationError;
use crate::manhattan::ManhattanAxes;

/// Shortest anchor edge, as a share of its distance from the camera, that carries a scale.
const SHORTEST_EDGE: f64 = 0.02;

/// A vertical edge by its two ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerticalEdge {
    /// Lower end, the paper's `X_f`.
    pub floor: Vec3,
    /// Upper end, the paper's `X_c`.
    pub ceiling: Vec3,
}

impl VerticalEdge {
    /// Its length.
    pub fn length(&self) -> f64 {
        self.ceiling.distance(self.floor)
    }
}

/// Solves the similarity that carries the point map into the room, from one vertical room edge.
///
/// Paper: Sec. 3.1 "Camera Calibration"; Alg. 1; keys `cam.rotation`, `cam.scale`, `cam.translation`.
///
/// | argument         | frame    | unit    | meaning                                              |
/// |------------------|----------|---------|------------------------------------------------------|
/// | `axes`           | `points` | –       | oriented Manhattan axes ([`ManhattanAxes::oriented`]) |
/// | `camera_centre`  | `points` | free    | the paper's `c_0`, the length to judge the edge by   |
/// | `anchor`         | `points` | free    | floor and ceiling end of the deepest corner          |
/// | `anchor_in_room` | `room`   | metres  | the same edge in the room; its length is `H_room`    |
///
/// # Errors
/// [`CalibrationError::ShortAnchor`] when the anchor edge carries no scale.
pub fn room_from_points(
    axes: &ManhattanAxes,
    camera_centre: Vec3,
    anchor: &VerticalEdge,
    anchor_in_room: &VerticalEdge,
) -> Result<Similarity, CalibrationError> {
    let length = anchor.length();
    let min = SHORTEST_EDGE * anchor.floor.distance(camera_centre);
    // NaN is refused as well.
    if !(length > min && length.is_finite()) {
        return Err(CalibrationError::ShortAnchor { length, min });
    }
    let rotation = axes.r_align();
    let scale = anchor_in_room.length() / length;
    let translation = anchor_in_room.floor - rotation * anchor.floor * scale;
    Ok(Similarity { scale, rotation, translation })
}

/// The point map's camera in the room (key `cam.pose`): `R = R_0 R_align^T`, `c = s R_align c_0 + t`.
pub fn camera_in_room(
    size: ImageSize,
    intrinsics: Intrinsics,
    camera_from_points: Mat3,
    camera_centre: Vec3,
    room_from_points: &Similarity,
) -> Camera {
    let rotation = camera_from_points * room_from_points.rotation.transpose();
    let centre = room_from_points.point(camera_centre);
    Camera { size, intrinsics, rotation, translation: -(rotation * centre) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn axes(yaw: f64, tilt: f64) -> ManhattanAxes {
        let r = Mat3::from_rotation_x(tilt) * Mat3::from_rotation_y(yaw);
        ManhattanAxes { width: r.x_axis, vertical: r.y_axis, depth: r.z_axis }.oriented(Vec3::NEG_Y, Vec3::Z)
    }

    proptest! {
        #[test]
        fn pixels_stay_and_the_anchor_lands(
            yaw in -0.7f64..0.7, tilt in -0.5f64..0.5, length in 0.2f64..9.0, height in 1.9f64..4.0,
            x in -3.0f64..3.0, y in -2.0f64..2.0, z in 0.5f64..9.0, width in 2.0f64..8.0,
        ) {
            let axes = axes(yaw, tilt);
            let floor = Vec3::new(0.4, 0.8, 4.0);
            let anchor = VerticalEdge { floor, ceiling: floor + axes.vertical * length };
            let target = Vec3::new(width, 0.0, 0.0);
            let in_room = VerticalEdge { floor: target, ceiling: target + Vec3::Y * height };
            let r0 = Mat3::from_rotation_z(0.03) * Mat3::from_rotation_y(0.1);
            let t0 = Vec3::new(0.1, -0.05, 0.02);
            let c0 = -(r0.transpose() * t0);
            let map = room_from_points(&axes, c0, &anchor, &in_room).unwrap();
            prop_assert!((map.point(anchor.floor) - in_room.floor).length() <= 1e-9);
            prop_assert!((map.point(anchor.ceiling) - in_room.ceiling).length() <= 1e-9);

            let size = ImageSize::new(518, 392);
            let k = Intrinsics::from_horizontal_fov(size, 1.1);
            let camera = camera_in_room(size, k, r0, c0, &map);
            prop_assert!((camera.rotation * camera.rotation.transpose() - Mat3::IDENTITY)
                .to_cols_array().iter().all(|v| v.abs() <= 1e-12));
            // The point map's own camera, and the calibrated one on the mapped point, agree on the pixel.
            let p = Vec3::new(x, y, z);
            let own = Camera { size, intrinsics: k, rotation: r0, translation: t0 };
            if let (Some(a), Some(b)) = (own.project(p), camera.project(map.point(p))) {
                prop_assert!((a - b).length() <= 1e-6 * (1.0 + a.length()));
            }
        }
    }

    #[test]
    fn an_edge_without_length_is_refused() {
        let edge = VerticalEdge { floor: Vec3::Z, ceiling: Vec3::Z };
        assert!(matches!(
            room_from_points(&axes(0.0, 0.0), Vec3::ZERO, &edge, &edge),
            Err(CalibrationError::ShortAnchor { .. })
        ));
    }
}
