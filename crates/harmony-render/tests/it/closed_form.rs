//! The rasteriser against formulas: planes, boxes, texture coordinates, clipping, silhouettes, coverage.

use std::sync::Arc;

use crate::common::{self, Numbers, camera, mesh_of, quad};
use glam::{DMat3, DVec2, DVec3, Vec2};
use harmony_mesh::{Material, Mesh, ShellOptions, room_shell_with};
use harmony_render::{Instance, RenderOptions, render, render_depth_ids};
use harmony_scene::{Camera, Extents, ImageSize, Intrinsics, Room, Surface};
use image::{Rgba, RgbaImage};

fn unlit() -> RenderOptions {
    RenderOptions::default()
}

fn centre(x: u32, y: u32) -> DVec2 {
    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

fn room(width: f64, height: f64, depth: f64) -> Room {
    Room {
        room_type: "room".into(),
        extents: Extents { width, height, depth },
        shape: harmony_scene::RoomShape::default(),
        seen: vec![],
        openings: vec![],
        floor_texture: None,
        wall_texture: None,
    }
}

#[test]
fn every_pixel_of_an_empty_room_has_the_depth_and_face_of_its_ray() {
    let room = room(4.2, 2.6, 5.3);
    let faces: Vec<Mesh> = Surface::ALL
        .iter()
        .map(|keep| {
            let omit = Surface::ALL.into_iter().filter(|s| s != keep).collect();
            room_shell_with(&room, &|_| None, &ShellOptions { omit, ..ShellOptions::default() })
        })
        .collect();
    let instances: Vec<Instance> = faces.iter().enumerate().map(|(i, m)| Instance::in_room(m, i as u32 + 1)).collect();
    let size = ImageSize::new(331, 247);
    for forward in [DVec3::new(0.3, -0.4, -1.0), DVec3::new(-1.0, 0.2, 0.4), DVec3::new(0.1, -1.0, 0.05)] {
        let lens = Intrinsics::from_horizontal_fov(size, 1.9);
        let camera = Camera::looking(size, lens, DVec3::new(1.1, 1.5, 4.0), forward);
        let frame = render_depth_ids(&camera, &instances, &unlit());
        let mut other_face = 0;
        for y in 0..size.height {
            for x in 0..size.width {
                let i = (y * size.width + x) as usize;
                let (face, at) = room.extents.exit(&camera.ray(centre(x, y))).unwrap();
                let want = camera.depth(at);
                let got = f64::from(frame.depth[i]);
                // At an edge of the room the neighbour face may have been drawn: its depth is continuous there.
                let id = Surface::ALL.iter().position(|s| *s == face).unwrap() as u32 + 1;
                if frame.ids[i] == id {
                    assert!((got - want).abs() <= 2e-6 * want, "({x}, {y}) {face:?}: {got} for {want}");
                } else {
                    other_face += 1;
                    assert!((got - want).abs() <= 0.01 * want, "({x}, {y}) {face:?}: {got} for {want}");
                }
            }
        }
        assert!(other_face <= 4, "{other_face} pixels show the neighbour face");
    }
}

#[test]
fn a_posed_box_has_the_depth_of_a_slab_intersection() {
    let cube = common::cube(DVec3::splat(-0.5), DVec3::splat(0.5));
    let linear = DMat3::from_rotation_y(0.6) * DMat3::from_diagonal(DVec3::new(1.2, 0.7, 0.5));
    let position = DVec3::new(0.2, 0.4, -0.3);
    let instance = Instance { mesh: &cube, linear, translation: position, id: 9 };
    let camera = camera(200, 160, 1.0, DVec3::new(1.5, 1.6, 2.2), position);
    let frame = render(&camera, &[instance], &unlit());
    let inverse = linear.inverse();
    let (mut seen, mut edge, mut off) = (0, 0, 0);
    for y in 0..160 {
        for x in 0..200 {
            let ray = camera.ray(centre(x, y));
            let (o, d) = (inverse * (ray.origin - position), inverse * ray.direction);
            let (t0, t1) = ((DVec3::splat(-0.5) - o) / d, (DVec3::splat(0.5) - o) / d);
            let (near, far) = (t0.min(t1).max_element(), t0.max(t1).min_element());
            let i = (y * 200 + x) as usize;
            if (near <= far) != (frame.ids[i] == 9) {
                edge += 1;
            } else if near <= far {
                seen += 1;
                let want = camera.depth(ray.at(near));
                let error = (f64::from(frame.depth[i]) - want).abs();
                // Right on an edge of the box the other face may own the pixel, and its plane goes on a little.
                assert!(error <= 1e-3, "({x}, {y}): {} {want}", frame.depth[i]);
                off += usize::from(error > 3e-6);
            } else {
                assert_eq!(frame.depth[i], 0.0);
            }
        }
    }
    assert!(seen > 3000 && edge <= 3, "{seen} pixels, {edge} differ at the silhouette");
    assert!(off <= 5, "{off} pixels are off their face");
}

/// A floor quad with a ramp texture (red = u, green = v) at a grazing angle.
#[test]
fn texture_coordinates_are_perspective_correct_at_a_grazing_angle() {
    let ramp = RgbaImage::from_fn(256, 256, |x, y| Rgba([x as u8, y as u8, 77, 255]));
    let mut floor = quad([
        DVec3::new(-3.0, 0.0, 0.0),
        DVec3::new(3.0, 0.0, 0.0),
        DVec3::new(3.0, 0.0, -20.0),
        DVec3::new(-3.0, 0.0, -20.0),
    ]);
    floor.uvs = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)].map(Vec2::from).to_vec();
    floor.materials[0].texture = Some(Arc::new(ramp));
    let size = ImageSize::new(320, 240);
    let lens = Intrinsics::from_horizontal_fov(size, 1.1);
    let camera = Camera::looking(size, lens, DVec3::new(0.4, 0.5, 1.0), DVec3::new(0.05, -0.15, -1.0));
    let frame = render(&camera, &[Instance::in_room(&floor, 1)], &unlit());
    let (mut seen, mut worst) = (0, 0.0_f64);
    for y in 0..size.height {
        for x in 0..size.width {
            if frame.ids[(y * size.width + x) as usize] == 0 {
                continue;
            }
            let ray = camera.ray(centre(x, y));
            let p = ray.at(-ray.origin.y / ray.direction.y);
            let (u, v) = (p.x / 6.0 + 0.5, 1.0 + p.z / 20.0);
            // Farther away a pixel spans many texels, and their mean in linear light is not the middle of a ramp.
            if !(0.1..0.9).contains(&u) || !(0.65..0.98).contains(&v) {
                continue;
            }
            seen += 1;
            let c = frame.color.get_pixel(x, y);
            let error = (f64::from(c[0]) - (u * 256.0 - 0.5)).abs().max((f64::from(c[1]) - (v * 256.0 - 0.5)).abs());
            worst = worst.max(error);
            assert_eq!(c[2], 77);
        }
    }
    assert!(seen > 5000, "{seen}");
    assert!(worst <= 2.5, "off by {worst} of 256 levels");
}

#[test]
fn a_checkerboard_floor_shows_each_cell_where_its_rays_meet_it() {
    let board = RgbaImage::from_fn(512, 512, |x, y| {
        Rgba(if (x / 64 + y / 64) % 2 == 0 { [230, 20, 20, 255] } else { [20, 20, 230, 255] })
    });
    let mut floor = quad([
        DVec3::new(0.0, 0.0, 0.0),
        DVec3::new(0.0, 0.0, 8.0),
        DVec3::new(8.0, 0.0, 8.0),
        DVec3::new(8.0, 0.0, 0.0),
    ]);
    floor.uvs = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)].map(Vec2::from).to_vec();
    floor.materials[0].texture = Some(Arc::new(board));
    let camera = camera(400, 300, 1.2, DVec3::new(3.3, 1.2, 10.0), DVec3::new(4.0, 0.0, 4.0));
    let frame = render(&camera, &[Instance::in_room(&floor, 1)], &unlit());
    let mut seen = 0;
    for y in 0..300 {
        for x in 0..400 {
            let at = |dx: f64, dy: f64| {
                let ray = camera.ray(centre(x, y) + DVec2::new(dx, dy));
                ray.at(-ray.origin.y / ray.direction.y)
            };
            let p = at(0.0, 0.0);
            let cell = |p: DVec3| (p.x.floor() as i64, p.z.floor() as i64);
            let inside = (0.0..8.0).contains(&p.x) && (0.0..8.0).contains(&p.z);
            // The cell must be the same some pixels around, for trilinear filtering is isotropic.
            let calm = [-4.0, 4.0].iter().all(|k| cell(at(*k, 0.0)) == cell(p) && cell(at(0.0, *k)) == cell(p));
            if inside && calm {
                seen += 1;
                let red = (cell(p).0 + cell(p).1) % 2 == 0;
                let c = frame.color.get_pixel(x, y);
                assert_eq!(c[0] > 200, red, "({x}, {y}): {c:?}");
                assert_eq!(c[2] > 200, !red, "({x}, {y}): {c:?}");
            }
        }
    }
    assert!(seen > 5000, "{seen}");
}

#[test]
fn a_floor_that_reaches_behind_the_camera_is_cut_at_the_near_plane() {
    // One triangle around the camera's foot, edges far behind and beside the camera; also a giant one, so that the
    // guard band cuts it, and a camera turned so that the plane's horizon is oblique.
    for reach in [30.0, 3e5] {
        let floor = mesh_of(
            &[DVec3::new(-reach, 0.0, reach), DVec3::new(reach, 0.0, reach), DVec3::new(0.0, 0.0, -reach * 3.0)],
            &[[0, 1, 2]],
        );
        let size = ImageSize::new(160, 120);
        let lens = Intrinsics::from_horizontal_fov(size, 1.4);
        let mut camera = Camera::looking(size, lens, DVec3::new(0.0, 1.5, 0.0), DVec3::new(0.0, -0.3, -1.0));
        let roll = DMat3::from_rotation_z(0.3);
        camera = Camera { rotation: roll * camera.rotation, translation: roll * camera.translation, ..camera };
        let frame = render_depth_ids(&camera, &[Instance::in_room(&floor, 3)], &unlit());
        for y in 0..size.height {
            for x in 0..size.width {
                let ray = camera.ray(centre(x, y));
                let k = -ray.origin.y / ray.direction.y;
                let p = ray.at(k);
                let on_floor = k > 0.0 && p.z > -reach * 3.0 + 3.0 * p.x.abs() + 1.0 && p.z < reach;
                let clear = k > 0.0 && k < reach / 2.0;
                let i = (y * size.width + x) as usize;
                if on_floor && clear {
                    let want = camera.depth(p);
                    let got = f64::from(frame.depth[i]);
                    assert!((got - want).abs() <= 1e-5 * want, "({x}, {y}) reach {reach}: {got} for {want}");
                } else if k <= 0.0 {
                    assert_eq!(frame.ids[i], 0, "above the horizon");
                }
            }
        }
        // Nothing nearer than the near plane is drawn.
        let far = RenderOptions { near: 3.0, ..unlit() };
        let cut = render_depth_ids(&camera, &[Instance::in_room(&floor, 3)], &far);
        assert!(cut.depth.iter().all(|z| *z == 0.0 || *z >= 3.0 - 1e-5));
        assert!(cut.depth.iter().any(|z| *z > 0.0));
        let kept = frame.depth.iter().zip(&cut.depth).filter(|(a, _)| **a > 3.001);
        assert!(kept.clone().count() > 1000);
        assert!(kept.into_iter().all(|(a, b)| (a - b).abs() <= 1e-5 * a), "what is beyond stays as it was");
    }
}

#[test]
fn silhouettes_agree_with_a_point_in_polygon_test() {
    let mut r = Numbers(5);
    let camera = camera(120, 90, 1.0, DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO);
    let mut compared = 0;
    for _ in 0..300 {
        let corners: [DVec3; 3] = std::array::from_fn(|_| r.point() * DVec3::new(1.8, 1.4, 1.0));
        let mut mesh = mesh_of(&corners, &[[0, 1, 2]]);
        mesh.materials[0].double_sided = true;
        let frame = render_depth_ids(&camera, &[Instance::in_room(&mesh, 1)], &unlit());
        // As the mesh holds them, in single precision.
        let px: Vec<DVec2> = mesh.positions.iter().map(|p| camera.project(p.as_dvec3()).unwrap()).collect();
        for y in 0..90 {
            for x in 0..120 {
                let c = centre(x, y);
                let signed: [f64; 3] = std::array::from_fn(|i| {
                    let (a, b) = (px[i], px[(i + 1) % 3]);
                    (b - a).perp_dot(c - a) / (b - a).length()
                });
                // Closer than the snapping to an edge, either answer is right.
                if signed.iter().any(|d| d.abs() <= 1.0 / 256.0) {
                    continue;
                }
                compared += 1;
                let inside = signed.iter().all(|d| *d > 0.0) || signed.iter().all(|d| *d < 0.0);
                assert_eq!(frame.ids[(y * 120 + x) as usize] == 1, inside, "({x}, {y}) of {corners:?}");
            }
        }
    }
    assert!(compared > 3_000_000);
}

/// A jittered grid whose corners often fall exactly on pixel centres: no gaps, nothing twice.
#[test]
fn triangles_that_share_edges_cover_each_pixel_exactly_once() {
    let size = ImageSize::new(96, 80);
    // At depth 1 and f = 64 the image point of (x, y, 1) is (64 x + cx, 64 y + cy).
    let camera = Camera {
        size,
        intrinsics: Intrinsics { fx: 64.0, fy: 64.0, cx: 48.0, cy: 40.0 },
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let mut r = Numbers(77);
    for round in 0..6 {
        let n = 9;
        let mut corners = Vec::new();
        for j in 0..=n {
            for i in 0..=n {
                let border = i == 0 || j == 0 || i == n || j == n;
                let jitter = if border { DVec2::ZERO } else { DVec2::new(r.next(), r.next()) * 1.4 };
                let p = DVec2::new(f64::from(i) * 8.0 + 8.5, f64::from(j) * 7.0 + 6.5) + jitter;
                // Whole pixel centres in the even rounds.
                let p = if round % 2 == 0 { p.floor() + 0.5 } else { p };
                corners.push(DVec3::new((p.x - 48.0) / 64.0, (p.y - 40.0) / 64.0, 1.0));
            }
        }
        let mut triangles = Vec::new();
        for j in 0..n as u32 {
            for i in 0..n as u32 {
                let a = j * (n as u32 + 1) + i;
                let (b, c, d) = (a + 1, a + n as u32 + 1, a + n as u32 + 2);
                triangles.extend(if (i + j) % 2 == 0 { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] });
            }
        }
        let mut count = vec![0; size.pixels()];
        for t in &triangles {
            let mut alone = mesh_of(&corners, &[*t]);
            alone.materials[0].double_sided = true;
            let frame = render_depth_ids(&camera, &[Instance::in_room(&alone, 1)], &unlit());
            for (n, id) in count.iter_mut().zip(&frame.ids) {
                *n += id;
            }
        }
        for (i, n) in count.iter().enumerate() {
            let (x, y) = (i as u32 % size.width, i as u32 / size.width);
            // The grid covers 8.5..80.5 by 6.5..69.5; its left and top edges own their pixel centres.
            let inside = (8..80).contains(&x) && (6..69).contains(&y);
            assert_eq!(*n, u32::from(inside), "pixel ({x}, {y}) in round {round}");
        }
    }
}

/// The same across the near plane and the guard band, where triangles are clipped.
#[test]
fn clipped_neighbours_leave_no_gap_and_no_overlap() {
    let size = ImageSize::new(140, 100);
    let camera = Camera::looking(
        size,
        Intrinsics::from_horizontal_fov(size, 1.5),
        DVec3::new(0.01, 0.4, 0.02),
        DVec3::new(0.2, -1.0, -0.9),
    );
    let mut r = Numbers(4);
    let n = 6_u32;
    let mut corners = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let jitter = DVec2::new(r.next(), r.next()) * 0.3;
            corners.push(DVec3::new(f64::from(i) - 3.0 + jitter.x, 0.0, f64::from(j) - 3.0 + jitter.y) * 40.0);
        }
    }
    let mut count = vec![0; size.pixels()];
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            for t in [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]] {
                let alone = mesh_of(&corners, &[t]);
                let frame = render_depth_ids(&camera, &[Instance::in_room(&alone, 1)], &unlit());
                for (n, id) in count.iter_mut().zip(&frame.ids) {
                    *n += id;
                }
            }
        }
    }
    for (i, n) in count.iter().enumerate() {
        let ray = camera.ray(centre(i as u32 % size.width, i as u32 / size.width));
        let k = -ray.origin.y / ray.direction.y;
        if k > 0.0 && k < 60.0 {
            assert_eq!(*n, 1, "pixel {i}");
        } else {
            assert!(*n <= 1, "pixel {i}");
        }
    }
}

#[test]
fn a_whole_sphere_has_the_depth_of_the_sphere() {
    let sphere = common::sphere(200, 100, Material::plain("m", [0.5; 3]));
    let camera = camera(150, 150, 0.8, DVec3::new(0.0, 1.0, 4.0), DVec3::ZERO);
    let frame = render_depth_ids(&camera, &[Instance::in_room(&sphere, 2)], &unlit());
    let mut seen = 0;
    for y in 0..150 {
        for x in 0..150 {
            let ray = camera.ray(centre(x, y));
            let b = ray.origin.dot(ray.direction);
            let disc = b * b - (ray.origin.length_squared() - 1.0);
            // Inside the silhouette by a little more than the facets' sagitta.
            if disc > 0.02 {
                seen += 1;
                let want = camera.depth(ray.at(-b - disc.sqrt()));
                let got = f64::from(frame.depth[(y * 150 + x) as usize]);
                assert!((got - want).abs() <= 6e-3, "({x}, {y}): {got} {want}");
            } else if disc < 0.0 {
                assert_eq!(frame.ids[(y * 150 + x) as usize], 0);
            }
        }
    }
    assert!(seen > 5000, "{seen}");
}
