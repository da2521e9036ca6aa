//! Standard cameras: the canonical elevated view, an orbit around the room, and the four views of a mesh.

use std::f64::consts::{FRAC_PI_2, TAU};

use harmony_mesh::Bounds;
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Pose, Room, Size, Surface, Vec2, Vec3};

/// A camera that looks into the room from outside, and the faces that would hide the room from it.
#[derive(Debug, Clone)]
pub struct RoomView {
    /// The camera.
    pub camera: Camera,
    /// Faces not to draw: those whose room side the camera does not see (always the ceiling, too).
    pub omit: Vec<Surface>,
}

/// Colour of what is outside the room in views of it, sRGB and alpha: grey enough that white walls stand out and a lit room is not
/// dull beside it.
pub const OUTSIDE: [u8; 4] = [204, 206, 210, 255];

/// Horizontal field of view of the standard cameras, radians (about 40 degrees: little perspective).
const FOV: f64 = 0.7;

/// Elevation of the canonical and the orbit views above the horizon, radians: steep enough that furniture in front hides
/// little, level enough that walls and fronts are seen.
const ELEVATION: f64 = 0.62;

/// Share of the image that stays free around what is shown.
const MARGIN: f64 = 0.05;

/// Largest azimuth of the canonical view from straight onto the back wall, radians (50 degrees).
const MAX_AZIMUTH: f64 = 0.87;

/// Step in which larger azimuths are tried, radians, and by what share more of the picture the room must cover for one
/// radian.
const AZIMUTH_STEP: f64 = 0.05;
const AZIMUTH_COST: f64 = 0.15;

/// Rays on each axis of the photo that say what part of the room it shows.
const SEEN_RAYS: u32 = 12;

/// What the frame has beside that part, metres: things stand across the photo's edge.
const BESIDE_SEEN_M: f64 = 0.3;

/// What the frame has beside the things, metres, and its least width and depth: an empty half of a room only makes them
/// small.
const BESIDE_THINGS_M: f64 = 0.6;
const MIN_M: f64 = 2.5;

/// The elevated view of the part of the room that the photo shows and where things are, ceiling and near walls removed,
/// from the photo camera's side.
///
/// Paper: "Canonical Views" in the appendix. The azimuth is that of the photo's camera, held to within
/// 50 degrees of straight onto the back wall, so that the near walls are always those that the photo does not show; it
/// turns further aside, within these bounds, where a long room fills the picture better so. What lies behind the photo's
/// camera may run out of the picture: nothing is known of it.
pub fn canonical_camera(room: &Room, size: ImageSize, photo_camera: &Camera, things: &[(Pose, Size)]) -> RoomView {
    let forward = photo_camera.forward();
    let azimuth = (-forward.x).atan2(-forward.z);
    let azimuth = if azimuth.is_finite() { azimuth.clamp(-MAX_AZIMUTH, MAX_AZIMUTH) } else { 0.0 };
    let (low, high) = around(things, seen_part(&room.extents, photo_camera), room.extents.as_vec());
    let first = room_view(room, size, azimuth, low, high);
    let worth =
        |view: &RoomView, by: f64| covered(&view.camera, &standing(low, high, &view.omit)) / (1.0 + AZIMUTH_COST * by);
    let mut best = (worth(&first, 0.0), first.clone());
    let steps = ((MAX_AZIMUTH - azimuth.abs()) / AZIMUTH_STEP) as u32;
    for by in (1..=steps).map(|k| AZIMUTH_STEP * f64::from(k)) {
        let view = room_view(room, size, azimuth + by.copysign(azimuth), low, high);
        // No further wall is given up for it.
        if view.omit == first.omit && worth(&view, by) > best.0 {
            best = (worth(&view, by), view);
        }
    }
    best.1
}

/// Box of the part of the room that a camera in it shows, from the floor to the ceiling; the whole room if it shows none.
fn seen_part(e: &Extents, camera: &Camera) -> (Vec3, Vec3) {
    let (whole, eye, k) = (e.as_vec(), camera.centre(), &camera.intrinsics);
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (i, j) in (0..SEEN_RAYS).flat_map(|i| (0..SEEN_RAYS).map(move |j| (i, j))) {
        let at = |n: u32, pixels: u32| f64::from(n) / f64::from(SEEN_RAYS - 1) * f64::from(pixels);
        let (x, y) = (at(i, camera.size.width), at(j, camera.size.height));
        let ray = camera.forward() + camera.right() * ((x - k.cx) / k.fx) + camera.down() * ((y - k.cy) / k.fy);
        // Where the ray leaves the room.
        let leaves = (0..3).filter(|a| ray[*a].abs() > 1e-9).map(|a| {
            let face = if ray[a] > 0.0 { whole[a] } else { 0.0 };
            (face - eye[a]) / ray[a]
        });
        let point = eye + ray * leaves.fold(f64::INFINITY, f64::min);
        if point.is_finite() && point.cmpge(Vec3::splat(-1e-6)).all() && point.cmple(whole + 1e-6).all() {
            (low, high) = (low.min(point), high.max(point));
        }
    }
    if !(low.cmplt(high).all()) {
        return (Vec3::ZERO, whole);
    }
    let (low, high) = ((low - BESIDE_SEEN_M).max(Vec3::ZERO), (high + BESIDE_SEEN_M).min(whole));
    (low.with_y(0.0), high.with_y(whole.y))
}

/// The part of a box that has things in it, with some room around them, those that cross its border whole; its whole height.
fn around(things: &[(Pose, Size)], (low, high): (Vec3, Vec3), whole: Vec3) -> (Vec3, Vec3) {
    let (mut from, mut to) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (mut least, mut most) = (low, high);
    for (pose, size) in things {
        let half = size.as_vec() / 2.0;
        let metric = Pose { scale: 1.0, stretch: Vec3::ONE, ..*pose };
        let (mut start, mut end) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for corner in corners(-half, half).map(|c| metric.point(c)) {
            (start, end) = (start.min(corner), end.max(corner));
        }
        (from, to) = (from.min(start), to.max(end));
        if start.x < high.x && end.x > low.x && start.z < high.z && end.z > low.z {
            (least, most) = (least.min(start).max(Vec3::ZERO), most.max(end).min(whole));
        }
    }
    if !(from.is_finite() && to.is_finite()) {
        return (low, high);
    }
    let (from, to) = (from - BESIDE_THINGS_M, to + BESIDE_THINGS_M);
    let short = (Vec3::splat(MIN_M) - (to - from)).max(Vec3::ZERO) / 2.0;
    let (from, to) = ((from - short).max(least), (to + short).min(most));
    if !(from.x < to.x && from.z < to.z) {
        return (low, high);
    }
    (from.with_y(low.y), to.with_y(high.y))
}

/// `n` elevated views around the room, the first from the front wall's side, counter-clockwise seen from above.
pub fn orbit_cameras(room: &Room, size: ImageSize, n: usize) -> Vec<RoomView> {
    let whole = room.extents.as_vec();
    (0..n).map(|i| room_view(room, size, TAU * i as f64 / n as f64, Vec3::ZERO, whole)).collect()
}

/// Elevation from which a mesh is shown, radians.
const FROM_BESIDE: f64 = 0.26;
/// ... and one that lies flat.
const FROM_ABOVE: f64 = 1.0;
/// What is lower than this share of its shorter side lies flat.
const FLAT_SHARE: f64 = 0.12;

/// View `yaw_index` (0 to 3 = A to D) of the four that show a canonical mesh turned by 0, 90, 180 and 270 degrees.
///
/// The mesh turns about +Y and the camera looks along -Z from slightly above; here the camera is moved
/// instead, so panel 0 shows the +Z side, panel 1 the -X side (which a turn by 90 degrees brings to +Z), and so on.
/// What lies flat (a rug, a tray) is looked down upon: of its pattern nothing would be seen.
pub fn mesh_view_camera(bounds: &Bounds, yaw_index: usize, size: ImageSize) -> Camera {
    let azimuth = -FRAC_PI_2 * (yaw_index % 4) as f64;
    let extent = bounds.max - bounds.min;
    let elevation = if extent.y < FLAT_SHARE * extent.x.min(extent.z) { FROM_ABOVE } else { FROM_BESIDE };
    // All four panels use the distance that the widest one needs, so that sizes can be compared.
    let corners = corners(bounds.min, bounds.max);
    let distance = (0..4)
        .map(|i| distance_to_fit(&corners, bounds.centre(), size, -FRAC_PI_2 * f64::from(i), elevation))
        .fold(0.0, f64::max);
    camera_at(bounds.centre(), size, azimuth, elevation, distance)
}

/// The view at an azimuth that shows the box from `low` to `high`.
fn room_view(room: &Room, size: ImageSize, azimuth: f64, low: Vec3, high: Vec3) -> RoomView {
    let e: &Extents = &room.extents;
    let corners = corners(low, high);
    let camera = centred_camera(&corners, (low + high) / 2.0, size, azimuth, ELEVATION);
    let eye = camera.centre();
    let omit: Vec<Surface> = Surface::ALL
        .into_iter()
        .filter(|s| *s == Surface::Ceiling || (eye - s.point(e, s.size(e) / 2.0)).dot(s.normal()) <= 0.0)
        .collect();
    let nearer = centred_camera(&standing(low, high, &omit), (low + high) / 2.0, size, azimuth, ELEVATION);
    // Near enough it could look over a wall that the farther one did not.
    let sees = |s: &Surface| (nearer.centre() - s.point(e, s.size(e) / 2.0)).dot(s.normal()) > 0.0;
    let same = Surface::ALL.iter().all(|s| *s == Surface::Ceiling || sees(s) != omit.contains(s));
    RoomView { camera: if same { nearer } else { camera }, omit }
}

/// Corners of a box; where no wall is left nothing stands up to the ceiling.
fn standing(low: Vec3, high: Vec3, omit: &[Surface]) -> Vec<Vec3> {
    let stands = |c: &Vec3| {
        let walls = [
            if c.x > low.x { Surface::Right } else { Surface::Left },
            if c.z > low.z { Surface::Front } else { Surface::Back },
        ];
        c.y <= low.y || walls.iter().any(|wall| !omit.contains(wall))
    };
    corners(low, high).into_iter().filter(stands).collect()
}

/// Area of the picture inside the outline of points, pixels.
fn covered(camera: &Camera, points: &[Vec3]) -> f64 {
    let mut left: Vec<Vec2> = points.iter().filter_map(|p| camera.project(*p)).collect();
    left.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    // Andrew's monotone chain, there and back.
    let chain = |points: &mut dyn Iterator<Item = &Vec2>| {
        points.fold(Vec::<Vec2>::new(), |mut hull, p| {
            while let [.., a, b] = hull[..]
                && (b - a).perp_dot(*p - b) <= 0.0
            {
                hull.pop();
            }
            hull.push(*p);
            hull
        })
    };
    let hull = [chain(&mut left.iter()), chain(&mut left.iter().rev())].concat();
    let next = hull.iter().cycle().skip(1);
    hull.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs() / 2.0
}

/// The nearest camera that shows every corner, moved sideways so that their box is in the middle of the image.
fn centred_camera(corners: &[Vec3], centre: Vec3, size: ImageSize, azimuth: f64, elevation: f64) -> Camera {
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
fn distance_to_fit(corners: &[Vec3], target: Vec3, size: ImageSize, azimuth: f64, elevation: f64) -> f64 {
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

    /// Whether the points lie in the picture, fill it and are in its middle.
    fn fills(view: &RoomView, points: &[Vec3]) {
        let size = view.camera.size;
        let (w, h) = (f64::from(size.width), f64::from(size.height));
        let pixels: Vec<Vec2> = points.iter().map(|c| view.camera.project(*c).unwrap()).collect();
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

    /// Corners of a box, but for those above the floor where no wall is left.
    fn upright(low: Vec3, high: Vec3, omit: &[Surface]) -> Vec<Vec3> {
        let left = |c: &Vec3| if c.x > low.x { Surface::Right } else { Surface::Left };
        let back = |c: &Vec3| if c.z > low.z { Surface::Front } else { Surface::Back };
        let stands = |c: &Vec3| c.y == 0.0 || !omit.contains(&left(c)) || !omit.contains(&back(c));
        corners(low, high).into_iter().filter(stands).collect()
    }

    #[test]
    fn the_area_that_is_covered_is_that_of_the_outline() {
        let camera = photo(Vec3::NEG_Z);
        let at = |x: f64, y: f64| camera.centre() + camera.right() * x + camera.down() * y + camera.forward() * 2.0;
        let square = [at(-0.5, -0.5), at(0.5, 0.5), at(0.1, 0.2), at(-0.5, 0.5), at(0.5, -0.5), at(0.0, 0.0)];
        let side = camera.intrinsics.fx / 2.0;
        assert!((covered(&camera, &square) - side * side).abs() < 1e-6);
        assert_eq!(covered(&camera, &square[..1]), 0.0);
    }

    #[test]
    fn orbit_views_show_the_whole_room_and_fill_the_image() {
        let room = room();
        for size in [ImageSize::new(800, 600), ImageSize::new(300, 900), ImageSize::new(512, 512)] {
            for view in orbit_cameras(&room, size, 7) {
                fills(&view, &upright(Vec3::ZERO, room.extents.as_vec(), &view.omit));
            }
        }
    }

    #[test]
    fn the_canonical_view_shows_what_the_photo_shows_of_a_long_room() {
        let mut room = room();
        room.extents.depth = 11.0;
        let photo = photo(Vec3::new(0.4, -0.2, -1.0));
        let (low, high) = seen_part(&room.extents, &photo);
        assert!(low.z == 0.0 && high.z > 3.0 && high.z < 6.0 && high.y == 2.6, "from {low} to {high}");
        for size in [ImageSize::new(800, 600), ImageSize::new(300, 900)] {
            let view = canonical_camera(&room, size, &photo, &[]);
            fills(&view, &upright(low, high, &view.omit));
        }
        // What looks out of the room shows nothing of it.
        let away = Camera::looking(photo.size, photo.intrinsics, Vec3::new(2.0, 1.5, 20.0), Vec3::Z);
        assert_eq!(seen_part(&room.extents, &away), (Vec3::ZERO, room.extents.as_vec()));
    }

    #[test]
    fn an_empty_half_of_the_room_is_not_framed() {
        let room = room();
        let (low, high) = (Vec3::ZERO, room.extents.as_vec());
        // Turned a quarter, it is 1 m deep and 2 m wide.
        let sofa = (
            Pose::new(Vec3::new(1.0, 0.0, 1.0), std::f64::consts::FRAC_PI_2, 1.0),
            Size::from_vec(Vec3::new(1.0, 0.8, 2.0)),
        );
        let (from, to) = around(&[sofa], (low, high), high);
        assert_eq!(from, Vec3::ZERO);
        assert!((to - Vec3::new(2.6, 2.6, 2.25)).abs().max_element() < 0.01, "to {to}");
        let far = (Pose::new(Vec3::new(3.8, 0.0, 5.4), 0.0, 1.0), Size::from_vec(Vec3::splat(0.4)));
        assert_eq!(around(&[sofa, far], (low, high), high), (low, high));
        assert_eq!(around(&[], (low, high), high), (low, high));
        // The photo cuts it: the view does not. What the photo does not show at all does not count.
        let part = (Vec3::new(1.5, 0.0, 0.0), high.with_z(3.0));
        let (from, to) = around(&[sofa, far], part, high);
        assert!(from.x.abs() < 0.01 && (to - high.with_z(3.0)).abs().max_element() < 0.01, "{from} {to}");
        let size = ImageSize::new(640, 480);
        let photo = photo(Vec3::new(0.0, -0.3, -1.0));
        let sofa_in = |things: &[(Pose, Size)]| {
            let camera = canonical_camera(&room, size, &photo, things).camera;
            camera
                .project(Vec3::new(0.0, 0.0, 0.5))
                .unwrap()
                .distance(camera.project(Vec3::new(2.0, 0.0, 0.5)).unwrap())
        };
        assert!(sofa_in(&[sofa]) > 1.2 * sofa_in(&[]), "larger in the picture");
    }

    #[test]
    fn faces_between_the_camera_and_the_room_are_left_out() {
        let room = room();
        let size = ImageSize::new(640, 480);
        let straight = canonical_camera(&room, size, &photo(Vec3::new(0.0, -0.1, -1.0)), &[]);
        assert_eq!(straight.omit, [Surface::Ceiling, Surface::Front]);
        let from_the_right = canonical_camera(&room, size, &photo(Vec3::new(-1.0, -0.1, -1.0)), &[]);
        assert_eq!(from_the_right.omit, [Surface::Ceiling, Surface::Right, Surface::Front]);
        assert!(from_the_right.camera.centre().x > 4.0, "it stands on the photo camera's side");
        let backwards = canonical_camera(&room, size, &photo(Vec3::new(0.0, 0.0, 1.0)), &[]);
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
