//! Standard cameras: the canonical elevated view, an orbit around the room, and the four views of a mesh.

use std::f64::consts::{FRAC_PI_2, TAU};

use harmony_mesh::Bounds;
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Room, Surface, Vec2, Vec3};

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
    let corners = corners(Vec3::ZERO, e.as_vec());
    let camera = centred_camera(&corners, e.as_vec() / 2.0, size, azimuth, ELEVATION);
    let eye = camera.centre();
    let omit = Surface::ALL
        .into_iter()
        .filter(|s| *s == Surface::Ceiling || (eye - s.point(e, s.size(e) / 2.0)).dot(s.normal()) <= 0.0)
        .collect();
    RoomView { camera, omit }
}

/// The nearest camera that shows every corner, moved sideways so that their box is in the middle of the image.
fn centred_camera(corners: &[Vec3; 8], centre: Vec3, size: ImageSize, azimuth: f64, elevation: f64) -> Camera {
    let mut target = centre;
    for _ in 0..6 {
        let distance = distance_to_fit(corners, target, size, azimuth, elevation);
        let camera = camera_at(target, size, azimuth, elevation, distance);
        let k = &camera.intrinsics;
        let (low, high) = corners
            .iter()
            .filter_map(|c| camera.project(*c))
            .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let off = (low + high) / 2.0 - Vec2::new(k.cx, k.cy);
        if !off.is_finite() {
            break;
        }
        target += camera.right() * (off.x * distance / k.fx) + camera.down() * (off.y * distance / k.fy);
    }
    let distance = distance_to_fit(corners, target, size, azimuth, elevation);
    camera_at(target, size, azimuth, elevation, distance)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instance, RenderOptions, render_depth_ids};
    use glam::DMat3;
    use harmony_mesh::{Group, Material, Mesh};

    fn room() -> Room {
        Room {
            room_type: "study".into(),
            extents: Extents { width: 4.0, height: 2.6, depth: 5.5 },
            shape: harmony_scene::RoomShape::default(),
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        }
    }

    fn photo(forward: Vec3) -> Camera {
        let size = ImageSize::new(640, 480);
        Camera::looking(size, Intrinsics::from_horizontal_fov(size, 1.1), Vec3::new(2.0, 1.5, 5.0), forward)
    }

    #[test]
    fn room_views_show_every_corner_and_fill_the_image() {
        let room = room();
        for size in [ImageSize::new(800, 600), ImageSize::new(300, 900), ImageSize::new(512, 512)] {
            let mut views = orbit_cameras(&room, size, 7);
            views.push(canonical_camera(&room, size, &photo(Vec3::new(0.4, -0.2, -1.0))));
            for view in views {
                let (w, h) = (f64::from(size.width), f64::from(size.height));
                let all = corners(Vec3::ZERO, room.extents.as_vec());
                let pixels: Vec<Vec2> = all.iter().map(|c| view.camera.project(*c).unwrap()).collect();
                let spread = |f: fn(&Vec2) -> f64| {
                    let v = pixels.iter().map(f);
                    (v.clone().fold(f64::MAX, f64::min), v.fold(f64::MIN, f64::max))
                };
                let ((x0, x1), (y0, y1)) = (spread(|p| p.x), spread(|p| p.y));
                assert!(x0 >= 0.0 && y0 >= 0.0 && x1 <= w && y1 <= h, "{x0} {x1} {y0} {y1}");
                let fill = ((x1 - x0) / w).max((y1 - y0) / h);
                assert!((0.85..=0.92).contains(&fill), "fills {fill}");
                assert!((x0 + x1 - w).abs() <= 0.04 * w && (y0 + y1 - h).abs() <= 0.04 * h);
            }
        }
    }

    #[test]
    fn faces_between_the_camera_and_the_room_are_left_out() {
        let room = room();
        let size = ImageSize::new(640, 480);
        let straight = canonical_camera(&room, size, &photo(Vec3::new(0.0, -0.1, -1.0)));
        assert_eq!(straight.omit, [Surface::Ceiling, Surface::Front]);
        let from_the_right = canonical_camera(&room, size, &photo(Vec3::new(-1.0, -0.1, -1.0)));
        assert_eq!(from_the_right.omit, [Surface::Ceiling, Surface::Right, Surface::Front]);
        assert!(from_the_right.camera.centre().x > 4.0, "it stands on the photo camera's side");
        let backwards = canonical_camera(&room, size, &photo(Vec3::new(0.0, 0.0, 1.0)));
        assert!(!backwards.omit.contains(&Surface::Back), "the back wall is always shown");
        for view in orbit_cameras(&room, size, 8) {
            let shown = Surface::ALL.into_iter().filter(|s| !view.omit.contains(s));
            for s in shown {
                let inside = (view.camera.centre() - s.point(&room.extents, Vec2::ZERO)).dot(s.normal()) > 0.0;
                assert!(inside, "{s:?} would be seen from behind");
            }
        }
    }

    #[test]
    fn panel_k_shows_what_turning_the_mesh_by_k_quarters_brings_to_the_front() {
        // A lopsided tetrahedron, centred in x and z.
        let positions = [[-0.5, 0.0, 0.4], [0.5, 0.0, 0.1], [0.1, 0.0, -0.4], [-0.3, 1.3, 0.2]];
        let mut mesh = Mesh {
            positions: positions.map(glam::Vec3::from).to_vec(),
            uvs: vec![glam::Vec2::ZERO; 4],
            groups: vec![Group { material: 0, triangles: vec![[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]] }],
            materials: vec![Material::plain("m", [1.0; 3])],
            ..Mesh::default()
        };
        mesh.recompute_normals();
        let bounds = mesh.bounds().unwrap();
        let size = ImageSize::new(90, 90);
        let options = RenderOptions::default();
        let front = mesh_view_camera(&bounds, 0, size);
        assert!(front.centre().z > 1.0 && front.centre().x.abs() < 1e-9);
        let mut pictures = Vec::new();
        for k in 0..4 {
            let turned = Instance {
                mesh: &mesh,
                linear: DMat3::from_rotation_y(FRAC_PI_2 * k as f64),
                translation: bounds.centre() - DMat3::from_rotation_y(FRAC_PI_2 * k as f64) * bounds.centre(),
                id: 1,
            };
            let want = render_depth_ids(&front, &[turned], &options);
            let got = render_depth_ids(&mesh_view_camera(&bounds, k, size), &[Instance::in_room(&mesh, 1)], &options);
            let differs = want.depth.iter().zip(&got.depth).filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
            assert!(differs <= 4, "panel {k}: {differs} pixels differ");
            assert!(got.silhouette().count() > 700);
            assert_eq!(got.silhouette().touches_border(0), [false; 4]);
            pictures.push(got.depth);
        }
        assert!(pictures[0] != pictures[1] && pictures[0] != pictures[2] && pictures[1] != pictures[3]);
    }
}
