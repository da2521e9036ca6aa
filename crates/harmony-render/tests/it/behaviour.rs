//! What callers rely on: order, windows, threads, culling, cut-outs, samples, compositing, bad input.

use std::sync::Arc;

use crate::common::{Numbers, camera, cube, mesh_of, quad, sphere};
use glam::{DMat3, DVec3, Vec2, Vec3};
use harmony_mesh::{Material, Mesh};
use harmony_render::{Frame, Instance, Lighting, RenderOptions, Renderer, projected_window, render, render_depth_ids};
use harmony_scene::{Camera, ImageSize, Intrinsics, PixelBox};
use image::{Rgba, RgbaImage};

fn unlit() -> RenderOptions {
    RenderOptions::default()
}

fn noise_texture(seed: u64, size: u32) -> Arc<RgbaImage> {
    let mut r = Numbers(seed);
    Arc::new(RgbaImage::from_fn(size, size, |_, _| {
        let c = r.point() * 127.0 + 128.0;
        Rgba([c.x as u8, c.y as u8, c.z as u8, 255])
    }))
}

/// Spheres and boxes in front of a wall, one of them around the camera's near plane.
fn meshes() -> Vec<(Mesh, DVec3, f64)> {
    let mut r = Numbers(21);
    (0..14)
        .map(|i| {
            let mut mesh = if i % 3 == 0 {
                cube(DVec3::splat(-0.5), DVec3::splat(0.5))
            } else {
                sphere(60, 30, Material::plain("m", [0.4, 0.6, 0.2]))
            };
            for m in &mut mesh.materials {
                m.texture = (i % 2 == 0).then(|| noise_texture(i, 64));
            }
            let at = if i == 13 { DVec3::new(0.3, 0.9, 3.9) } else { r.point() * DVec3::new(2.0, 1.0, 2.0) };
            (mesh, at, 0.3 + 0.2 * r.next().abs())
        })
        .collect()
}

fn instances(meshes: &[(Mesh, DVec3, f64)]) -> Vec<Instance<'_>> {
    meshes
        .iter()
        .enumerate()
        .map(|(i, (mesh, at, s))| Instance {
            mesh,
            linear: DMat3::from_rotation_y(i as f64) * *s,
            translation: *at,
            id: i as u32 + 1,
        })
        .collect()
}

fn view() -> Camera {
    camera(233, 171, 1.1, DVec3::new(0.3, 0.9, 4.0), DVec3::ZERO)
}

fn assert_same(a: &Frame, b: &Frame) {
    assert!(a.color == b.color && a.depth == b.depth && a.ids == b.ids);
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let meshes = meshes();
    for multisample in [false, true] {
        let options = RenderOptions { multisample, lighting: Lighting::HeadLight, ..unlit() };
        let draw = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| render(&view(), &instances(&meshes), &options))
        };
        let one = draw(1);
        assert!(one.ids.iter().filter(|i| **i > 0).count() > 5000);
        assert_same(&one, &draw(2));
        assert_same(&one, &draw(7));
    }
}

#[test]
fn a_window_equals_that_part_of_the_image() {
    let meshes = meshes();
    let renderer = Renderer::new();
    for multisample in [false, true] {
        let options = RenderOptions { multisample, background: [9, 80, 7, 255], ..unlit() };
        let whole = renderer.render(&view(), &instances(&meshes), &options);
        let part = PixelBox { x0: 61.3, y0: 40.0, x1: 150.2, y1: 133.9 };
        let piece = renderer.render_window(&view(), &instances(&meshes), &options, part);
        assert_eq!((piece.window.x0, piece.window.y0), (61, 40));
        assert_eq!(piece.frame.size, ImageSize::new(90, 94));
        for (y, x, i) in piece.window.indices() {
            let j = (y * 233 + x) as usize;
            assert_eq!(piece.frame.depth[i].to_bits(), whole.depth[j].to_bits());
            assert_eq!(piece.frame.ids[i], whole.ids[j]);
            assert_eq!(piece.frame.color.get_pixel(x - 61, y - 40), whole.color.get_pixel(x, y));
        }
        let fast = renderer.render_depth_ids(&view(), &instances(&meshes), &options);
        assert!(fast.depth == whole.depth && fast.ids == whole.ids, "the fast path draws the same");
    }
    let off = PixelBox { x0: -20.0, y0: 0.0, x1: -3.0, y1: 50.0 };
    assert!(renderer.render_window(&view(), &instances(&meshes), &unlit(), off).frame.ids.is_empty());
}

#[test]
fn objects_drawn_one_by_one_and_laid_over_each_other_give_the_whole_scene() {
    let meshes = meshes();
    let all = instances(&meshes);
    let renderer = Renderer::new();
    let whole = renderer.render(&view(), &all, &unlit());
    let mut frame = renderer.render(&view(), &all[..5], &unlit());
    let mut depths = renderer.render_depth_ids(&view(), &all[..5], &unlit());
    for instance in &all[5..] {
        let Some(window) = projected_window(&view(), instance, unlit().near) else { continue };
        let piece = renderer.render_window(&view(), &[*instance], &unlit(), window);
        let alone = renderer.render_depth_ids_window(&view(), &[*instance], &unlit(), window);
        let visible = alone.visible_against(&depths.depth);
        assert!(visible.minus(&alone.silhouette()).count() == 0);
        frame.overlay(&piece);
        depths.overlay(&alone);
        assert_eq!(depths.mask(instance.id), visible);
    }
    assert_same(&frame, &whole);
    assert!(depths.depth == whole.depth && depths.ids == whole.ids);
    assert_eq!(whole.mask(3), depths.mask(3));
}

#[test]
fn the_projected_window_holds_the_silhouette_and_little_more() {
    let ball = sphere(60, 30, Material::plain("m", [1.0; 3]));
    let camera = view();
    let place = |at: DVec3| Instance { mesh: &ball, linear: DMat3::IDENTITY * 0.3, translation: at, id: 1 };
    let instance = place(DVec3::new(0.5, 0.2, -1.0));
    let window = projected_window(&camera, &instance, 0.05).unwrap();
    let seen = render_depth_ids(&camera, &[instance], &unlit()).silhouette().bounds().unwrap();
    assert!(window.x0 <= seen.x0 + 0.5 && window.x1 >= seen.x1 - 0.5 && (window.width() - seen.width()).abs() <= 2.0);
    assert!(window.y0 <= seen.y0 + 0.5 && window.y1 >= seen.y1 - 0.5 && (window.height() - seen.height()).abs() <= 2.0);
    assert!(projected_window(&camera, &place(DVec3::new(0.3, 0.9, 9.0)), 0.05).is_none(), "behind the camera");
    assert!(projected_window(&camera, &place(DVec3::new(60.0, 0.9, 0.0)), 0.05).is_none(), "beside the image");
    let around = projected_window(&camera, &place(camera.centre()), 0.05).unwrap();
    assert_eq!(around.area(), 233.0 * 171.0, "around the camera it can be anywhere");
}

#[test]
fn of_equal_depths_the_first_instance_stays() {
    let a = cube(DVec3::splat(-0.5), DVec3::splat(0.5));
    let camera = view();
    let (one, two) = (Instance::in_room(&a, 1), Instance::in_room(&a, 2));
    for (order, first) in [([one, two], 1), ([two, one], 2)] {
        let frame = render(&camera, &order, &unlit());
        assert!(frame.mask(first).count() > 500);
        assert_eq!(frame.mask(3 - first).count(), 0);
    }
}

#[test]
fn back_faces_are_drawn_only_when_the_material_says_so() {
    let mut r#box = cube(DVec3::splat(-0.5), DVec3::splat(0.5));
    let inside = camera(60, 50, 1.2, DVec3::ZERO, DVec3::new(0.1, 0.1, -1.0));
    assert_eq!(render_depth_ids(&inside, &[Instance::in_room(&r#box, 1)], &unlit()).silhouette().count(), 0);
    // Mirroring turns the winding, not the surface.
    let mirrored = Instance {
        mesh: &r#box,
        linear: DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
        translation: DVec3::ZERO,
        id: 1,
    };
    assert_eq!(render_depth_ids(&inside, &[mirrored], &unlit()).silhouette().count(), 0);
    let outside = view();
    let plain = render_depth_ids(&outside, &[Instance::in_room(&r#box, 1)], &unlit());
    let flipped = render_depth_ids(&outside, &[mirrored], &unlit());
    assert!(plain.silhouette().count() > 500);
    assert!(plain.silhouette().iou(&flipped.silhouette()) > 0.99, "the box is symmetric");
    let same = plain.depth.iter().zip(&flipped.depth).filter(|(a, b)| (*a - *b).abs() < 1e-4).count();
    assert!(same > 233 * 171 - 20, "front faces in front: {same}");
    for m in &mut r#box.materials {
        m.double_sided = true;
    }
    assert_eq!(render_depth_ids(&inside, &[Instance::in_room(&r#box, 1)], &unlit()).silhouette().count(), 3000);
}

/// A sheet of 2 by 2 in front of the camera, facing it, uv upright.
fn sheet(z: f64) -> Mesh {
    let mut mesh =
        quad([DVec3::new(-1.0, -1.0, z), DVec3::new(1.0, -1.0, z), DVec3::new(1.0, 1.0, z), DVec3::new(-1.0, 1.0, z)]);
    mesh.uvs = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)].map(Vec2::from).to_vec();
    mesh
}

fn facing() -> Camera {
    let size = ImageSize::new(100, 100);
    // The sheet at z = 0 fills the image exactly.
    Camera::looking(size, Intrinsics::centred(size, 200.0), DVec3::new(0.0, 0.0, 4.0), DVec3::NEG_Z)
}

#[test]
fn textures_lie_the_right_way_round_and_keep_their_bytes() {
    let mut mesh = sheet(0.0);
    // glTF: (0, 0) is the top left.
    let image = RgbaImage::from_fn(100, 100, |x, y| Rgba([x as u8, y as u8, 200, 255]));
    mesh.materials[0].texture = Some(Arc::new(image.clone()));
    mesh.materials[0].base_color = [1.0; 4];
    let frame = render(&facing(), &[Instance::in_room(&mesh, 1)], &unlit());
    let worst = frame.color.pixels().zip(image.pixels()).flat_map(|(a, b)| (0..4).map(|i| a[i].abs_diff(b[i]))).max();
    assert!(worst.unwrap() <= 1, "{worst:?}");
}

#[test]
fn transparent_parts_are_cut_out_of_colour_depth_and_ids() {
    let (mut front, behind) = (sheet(0.0), sheet(-0.5));
    let ring = RgbaImage::from_fn(64, 64, |x, y| {
        let d = Vec2::new(x as f32 - 31.5, y as f32 - 31.5).length();
        Rgba([255, 255, 255, if d < 20.0 { 0 } else { 255 }])
    });
    front.materials[0].texture = Some(Arc::new(ring));
    let pair = [Instance::in_room(&front, 1), Instance::in_room(&behind, 2)];
    for frame in [render_depth_ids(&facing(), &pair, &unlit()), render(&facing(), &pair, &unlit()).depth_ids()] {
        let hole = frame.mask(2).count() as f64;
        let want = std::f64::consts::PI * (20.0_f64 * 100.0 / 64.0).powi(2);
        assert!((hole - want).abs() <= 0.03 * want, "{hole} pixels for {want}");
        assert!((frame.depth[50 * 100 + 50] - 4.5).abs() < 1e-5);
        assert!((frame.depth[5 * 100 + 5] - 4.0).abs() < 1e-5);
    }
    let mut nothing = sheet(0.0);
    nothing.materials[0].base_color[3] = 0.0;
    assert_eq!(render_depth_ids(&facing(), &[Instance::in_room(&nothing, 1)], &unlit()).silhouette().count(), 0);
}

#[test]
fn the_head_light_follows_the_angle_to_the_camera() {
    let ball = sphere(120, 60, Material::plain("m", [0.5; 3]));
    let camera = camera(101, 101, 0.6, DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO);
    let options = RenderOptions { lighting: Lighting::HeadLight, ..unlit() };
    let frame = render(&camera, &[Instance::in_room(&ball, 1)], &options);
    let row: Vec<u8> = (50..101).map(|x| frame.color.get_pixel(x, 50)[1]).take_while(|g| *g > 0).collect();
    assert!((i32::from(row[0]) - 188).abs() <= 1, "linear 0.5 head-on is sRGB 188: {}", row[0]);
    assert!(row.windows(2).all(|w| w[1] <= w[0] + 1), "it falls towards the rim: {row:?}");
    assert!(*row.last().unwrap() < 110);
    let stretched = Instance {
        mesh: &ball,
        linear: DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.01)),
        translation: DVec3::ZERO,
        id: 1,
    };
    let flat = render(&camera, &[stretched], &options);
    assert!(flat.color.get_pixel(60, 50)[1] >= 186, "a flattened ball faces the camera nearly everywhere");
}

#[test]
fn four_samples_measure_partial_coverage_and_leave_depth_and_ids_alone() {
    // A half plane with a slanted edge.
    let mut half = mesh_of(
        &[
            DVec3::new(-3.0, -3.0, 0.0),
            DVec3::new(0.3, -3.0, 0.0),
            DVec3::new(-0.2, 9.0, 0.0),
            DVec3::new(-3.0, 9.0, 0.0),
        ],
        &[[0, 1, 2], [0, 2, 3]],
    );
    half.materials[0].base_color = [1.0; 4];
    let scene = [Instance::in_room(&half, 1)];
    let black = RenderOptions { background: [0, 0, 0, 255], ..unlit() };
    let one = render(&facing(), &scene, &black);
    let four = render(&facing(), &scene, &RenderOptions { multisample: true, ..black });
    assert!(one.depth == four.depth && one.ids == four.ids);
    // Linear light on the background is the covered area; the edge crosses x = 0.3 - (y + 3) / 24.
    let linear = |f: &Frame| -> f64 {
        f.color
            .pixels()
            .map(|p| f64::from(p[0]) / 255.0)
            .map(|c| if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) })
            .sum()
    };
    let want = (0.3 - 3.0 / 24.0 + 1.0) * 5_000.0;
    assert!((linear(&four) - want).abs() <= 12.0, "{} for {want}", linear(&four));
    let levels: std::collections::BTreeSet<u8> = four.color.pixels().map(|p| p[0]).collect();
    assert_eq!(levels.len(), 5, "0 to 4 of 4 samples: {levels:?}");
    let clear = render(&facing(), &scene, &RenderOptions { multisample: true, ..unlit() });
    assert!(clear.color.pixels().all(|p| p[3] == 0 || p[0] == 255), "a transparent background tints no edge");
    assert!(clear.color.pixels().any(|p| (60..200).contains(&p[3])));
}

#[test]
fn an_empty_scene_is_background() {
    let frame = render(&facing(), &[], &RenderOptions { background: [1, 2, 3, 4], ..unlit() });
    assert!(frame.color.pixels().all(|p| p.0 == [1, 2, 3, 4]));
    assert!(frame.depth.iter().all(|z| *z == 0.0) && frame.ids.iter().all(|i| *i == 0));
}

#[test]
fn unusable_meshes_transforms_and_cameras_do_not_panic() {
    let mut bad = sheet(0.0);
    bad.positions.push(Vec3::new(f32::NAN, f32::INFINITY, 3.0));
    bad.groups[0].triangles.extend([[0, 1, 4], [0, 1, 77], [2, 2, 2], [u32::MAX; 3]]);
    bad.groups.push(harmony_mesh::Group { material: 40, triangles: vec![[0, 1, 2]] });
    bad.normals.truncate(1);
    bad.uvs.clear();
    bad.materials[0].texture = Some(Arc::new(RgbaImage::new(0, 0)));
    bad.materials[0].base_color = [f32::NAN; 4];
    let good = sheet(0.2);
    let odd = [
        Instance::in_room(&bad, 1),
        Instance { mesh: &good, linear: DMat3::ZERO, translation: DVec3::ZERO, id: 2 },
        Instance { mesh: &good, linear: DMat3::IDENTITY * f64::NAN, translation: DVec3::ZERO, id: 3 },
        Instance { mesh: &good, linear: DMat3::IDENTITY * 1e30, translation: DVec3::ZERO, id: 4 },
        Instance { mesh: &good, linear: DMat3::IDENTITY * 1e-30, translation: DVec3::INFINITY, id: 5 },
        Instance { mesh: &good, linear: DMat3::IDENTITY * 1e-3, translation: DVec3::ZERO, id: 6 },
    ];
    for lighting in [Lighting::Unlit, Lighting::HeadLight] {
        for multisample in [false, true] {
            for near in [0.05, 0.0, -1.0, f64::NAN, f64::INFINITY] {
                let options = RenderOptions { lighting, multisample, near, ..unlit() };
                let frame = render(&facing(), &odd, &options);
                assert!(frame.depth.iter().all(|z| z.is_finite() && *z >= 0.0));
            }
        }
    }
    let mut camera = facing();
    camera.intrinsics.fx = f64::NAN;
    assert!(render(&camera, &odd, &unlit()).ids.iter().all(|i| *i == 0));
    camera = facing();
    camera.intrinsics.fx = 1e12;
    let _ = render(&camera, &odd, &unlit());
    camera.size = ImageSize::new(0, 7);
    assert!(render(&camera, &odd, &unlit()).ids.is_empty());
}
