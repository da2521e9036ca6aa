//! Standard cameras: the canonical elevated view, an orbit around the room, and the four views of a mesh.

use std::f64::consts::{FRAC_PI_2, TAU};

use harmony_mesh::Bounds;
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Room, Surface, Vec3};

/// A camera that looks into the room from outside, and the faces that would hide the room from it.
#[derive(Debug, Clone)]
pub struct RoomView {
    /// The camera.
    pub camera: Camera,
    /// Faces not to draw: those whose room side the camera does not see (always the ceiling, too).
    pub omit: Vec<Surface>,
}

/// Horizontal field of view of the standard cameras, radians (about 40 degrees: little perspective).
const FOV: f64 = 0.7;

/// Elevation of the canonical and the orbit views above the horizon, radians.
const ELEVATION: f64 = 0.75;

/// Share of the image that stays free around what is shown.
const MARGIN: f64 = 0.05;

/// The elevated view of the whole room, ceiling and near walls removed, from the photo camera's side.
///
/// Paper: "Canonical Views" in the appendix. The azimuth is that of the photo's camera, held to within
/// 50 degrees of straight onto the back wall, so that the near walls are always those that the photo does not show.
pub fn canonical_camera(room: &Room, size: ImageSize, photo_camera: &Camera) -> RoomView {
    let forward = photo_camera.forward();
    let azimuth = (-forward.x).atan2(-forward.z);
    let azimuth = if azimuth.is_finite() { azimuth.clamp(-0.87, 0.87) } else { 0.0 };
    room_view(room, size, azimuth)
}

/// `n` elevated views around the room, the first from the front wall's side, counter-clockwise seen from above.
pub fn orbit_cameras(room: &Room, size: ImageSize, n: usize) -> Vec<RoomView> {
    (0..n).map(|i| room_view(room, size, TAU * i as f64 / n as f64)).collect()
}

/// View `yaw_index` (0 to 3 = A to D) of the four that show a canonical mesh turned by 0, 90, 180 and 270 degrees.
///
/// The mesh turns about +Y and the camera looks along -Z from slightly above; here the camera is moved
/// instead, so panel 0 shows the +Z side, panel 1 the -X side (which a turn by 90 degrees brings to +Z), and so on.
pub fn mesh_view_camera(bounds: &Bounds, yaw_index: usize, size: ImageSize) -> Camera {
    let azimuth = -FRAC_PI_2 * (yaw_index % 4) as f64;
    // All four panels use the distance that the widest one needs, so that sizes can be compared.
    let corners = corners(bounds.min, bounds.max);
    let distance = (0..4)
        .map(|i| distance_to_fit(&corners, bounds.centre(), size, -FRAC_PI_2 * f64::from(i), 0.26))
        .fold(0.0, f64::max);
    camera_at(bounds.centre(), size, azimuth, 0.26, distance)
}

fn room_view(room: &Room, size: ImageSize, azimuth: f64) -> RoomView {
    let e: &Extents = &room.extents;
    let centre = e.as_vec() / 2.0;
    let corners = corners(Vec3::ZERO, e.as_vec());
    let distance = distance_to_fit(&corners, centre, size, azimuth, ELEVATION);
    let camera = camera_at(centre, size, azimuth, ELEVATION, distance);
    let eye = camera.centre();
    let omit = Surface::ALL
        .into_iter()
        .filter(|s| *s == Surface::Ceiling || (eye - s.point(e, s.size(e) / 2.0)).dot(s.normal()) <= 0.0)
        .collect();
    RoomView { camera, omit }
}

fn corners(min: Vec3, max: Vec3) -> [Vec3; 8] {
    std::array::from_fn(|i| {
        Vec3::new(
            if i & 1 == 0 { min.x } else { max.x },
            if i & 2 == 0 { min.y } else { max.y },
            if i & 4 == 0 { min.z } else { max.z },
        )
    })
}

/// Direction from the target to a camera at an azimuth (0 = on +Z, towards +X) and an elevation.
fn outward(azimuth: f64, elevation: f64) -> Vec3 {
    Vec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos())
}

fn camera_at(target: Vec3, size: ImageSize, azimuth: f64, elevation: f64, distance: f64) -> Camera {
    let out = outward(azimuth, elevation);
    let lens = Intrinsics::from_horizontal_fov(size, FOV);
    Camera::looking(size, lens, target + out * distance, -out)
}

/// The smallest distance from which every corner lies in the image with a margin.
fn distance_to_fit(corners: &[Vec3; 8], target: Vec3, size: ImageSize, azimuth: f64, elevation: f64) -> f64 {
    let probe = camera_at(target, size, azimuth, elevation, 0.0);
    let k = &probe.intrinsics;
    let half = 0.5 - MARGIN;
    let (tx, ty) = (half * f64::from(size.width) / k.fx, half * f64::from(size.height) / k.fy);
    let fit = corners
        .iter()
        .map(|c| {
            let p = probe.to_camera(*c);
            // At distance k the corner is at z + k: |x| <= tx (z + k).
            (p.x.abs() / tx - p.z).max(p.y.abs() / ty - p.z)
        })
        .fold(0.0, f64::max);
    if fit.is_finite() && fit > 0.0 { fit } else { 1.0 }
}
