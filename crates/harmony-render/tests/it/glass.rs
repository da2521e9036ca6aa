//! See-through surfaces, tiles and glowing ones.

use std::sync::Arc;

use crate::common::{cube, quad};
use glam::{DVec3, Vec2};
use harmony_mesh::{Material, Mesh, Tile};
use harmony_render::{Frame, Glass, Instance, Lighting, RenderOptions, Renderer, render, render_depth_ids};
use harmony_scene::{Camera, ImageSize, Intrinsics};
use image::{Rgba, RgbaImage};

fn facing() -> Camera {
    let size = ImageSize::new(100, 100);
    // A sheet of half width 1 at z = 0 fills the image exactly.
    Camera::looking(size, Intrinsics::centred(size, 200.0), DVec3::new(0.0, 0.0, 4.0), DVec3::NEG_Z)
}

fn sheet(z: f64, half: f64, material: Material) -> Mesh {
    let corner = |x: f64, y: f64| DVec3::new(x * half, y * half, z);
    let mut mesh = quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    mesh.uvs = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)].map(Vec2::from).to_vec();
    mesh.materials[0] = material;
    mesh
}

fn veil(rgb: [f32; 3], alpha: f32) -> Material {
    let mut m = Material::plain("veil", rgb);
    m.base_color[3] = alpha;
    m
}

fn clear(rgb: [f32; 3]) -> Material {
    Material { transmission: 1.0, roughness: 0.0, ..Material::plain("glass", rgb) }
}

fn linear(byte: u8) -> f64 {
    let c = f64::from(byte) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

fn middle(frame: &Frame) -> [f64; 3] {
    let p = frame.color.get_pixel(50, 50).0;
    [0, 1, 2].map(|k| linear(p[k]))
}

fn options() -> [RenderOptions; 2] {
    let single = RenderOptions::default();
    [single, RenderOptions { multisample: true, ..single }]
}

#[test]
fn veils_are_mixed_by_depth_and_not_by_the_order_in_which_they_are_given() {
    let wall = sheet(-2.0, 5.0, Material::plain("wall", [0.8, 0.8, 0.8]));
    let red = sheet(-1.0, 2.0, veil([1.0, 0.0, 0.0], 0.5));
    let blue = sheet(0.0, 2.0, veil([0.0, 0.0, 1.0], 0.25));
    for options in options() {
        let mut seen = Vec::new();
        for order in [[&wall, &red, &blue], [&blue, &red, &wall], [&red, &wall, &blue]] {
            let all = order.map(|m| Instance::in_room(m, 1));
            seen.push(middle(&render(&facing(), &all, &options)));
        }
        // The wall, half covered by red, then a quarter by blue.
        let behind = [0.9, 0.4, 0.4];
        let want = [behind[0] * 0.75, behind[1] * 0.75, behind[2] * 0.75 + 0.25];
        for s in &seen {
            assert_eq!(s, &seen[0]);
            for k in 0..3 {
                assert!((s[k] - want[k]).abs() < 0.01, "{s:?} for {want:?}");
            }
        }
    }
}

#[test]
fn an_opaque_thing_before_glass_hides_it_and_one_behind_is_seen_tinted() {
    let wall = sheet(-2.0, 5.0, Material::plain("wall", [0.6; 3]));
    let near = sheet(1.0, 2.0, Material::plain("near", [0.2; 3]));
    let pane = sheet(0.0, 2.0, clear([0.25, 1.0, 1.0]));
    for options in options() {
        let hidden = render(&facing(), &[&pane, &wall, &near].map(|m| Instance::in_room(m, 1)), &options);
        assert!((middle(&hidden)[0] - 0.2).abs() < 0.01);
        let seen = middle(&render(&facing(), &[&pane, &wall].map(|m| Instance::in_room(m, 1)), &options));
        // Half of red passes one surface (the root of 0.25), all of green and blue, less what is mirrored.
        assert!((0.25..0.4).contains(&seen[0]), "{seen:?}");
        assert!((0.5..0.64).contains(&seen[1]) && seen[1] == seen[2], "{seen:?}");
    }
}

#[test]
fn glass_before_something_as_white_as_itself_is_still_noticed() {
    let wall = sheet(-2.0, 5.0, Material::plain("wall", [0.9; 3]));
    let bowl = cube(DVec3::new(-0.4, -0.4, -0.4), DVec3::new(0.4, 0.4, 0.4));
    let mut bowl = bowl;
    bowl.materials.iter_mut().for_each(|m| *m = clear([1.0; 3]));
    let frame = render(&facing(), &[Instance::in_room(&wall, 1), Instance::in_room(&bowl, 2)], &options()[0]);
    let (inside, outside) = (linear(frame.color.get_pixel(50, 50)[1]), linear(frame.color.get_pixel(3, 3)[1]));
    assert!(outside - inside > 0.015, "{outside} and {inside}");
    assert!(inside > 0.75, "one sees through it: {inside}");
}

#[test]
fn depth_and_ids_take_glass_for_a_surface_or_see_through_it() {
    let wall = sheet(-2.0, 5.0, Material::plain("wall", [0.9; 3]));
    let chair = sheet(-1.0, 0.3, Material::plain("chair", [0.3; 3]));
    let pane = sheet(0.0, 0.6, clear([1.0; 3]));
    let all = [Instance::in_room(&pane, 3), Instance::in_room(&chair, 2), Instance::in_room(&wall, 1)];
    let at = |x: usize| 50 * 100 + x;
    let solid = render_depth_ids(&facing(), &all, &RenderOptions::default());
    assert_eq!([solid.ids[at(50)], solid.ids[at(28)], solid.ids[at(5)]], [3, 3, 1]);
    let through = RenderOptions { glass: Glass::Clear { backdrop: 1 }, ..RenderOptions::default() };
    for frame in [render_depth_ids(&facing(), &all, &through), render(&facing(), &all, &through).depth_ids()] {
        // The chair is seen through the pane; before the room the pane keeps its silhouette.
        assert_eq!([frame.ids[at(50)], frame.ids[at(28)], frame.ids[at(5)]], [2, 3, 1]);
        assert!((frame.depth[at(50)] - 5.0).abs() < 1e-5 && (frame.depth[at(28)] - 4.0).abs() < 1e-5);
    }
    let alone = render_depth_ids(&facing(), &all[..1], &through);
    assert_eq!(alone.silhouette().count(), 60 * 60);
    // Without a backdrop the wall counts as what is seen.
    let nothing = RenderOptions { glass: Glass::Clear { backdrop: 0 }, ..RenderOptions::default() };
    assert_eq!(render_depth_ids(&facing(), &all, &nothing).mask(3).count(), 0);
}

#[test]
fn a_window_of_glass_equals_that_part_of_the_image() {
    let wall = sheet(-2.0, 5.0, Material::plain("wall", [0.7, 0.5, 0.3]));
    let mut bowl = cube(DVec3::new(-0.55, -0.43, -0.4), DVec3::new(0.37, 0.61, 0.4));
    bowl.materials.iter_mut().for_each(|m| *m = clear([0.4, 0.9, 0.6]));
    let all = [Instance::in_room(&bowl, 2), Instance::in_room(&wall, 1)];
    for options in options() {
        let renderer = Renderer::new();
        let whole = renderer.render(&facing(), &all, &options);
        let b = harmony_scene::PixelBox { x0: 17.0, y0: 9.0, x1: 61.0, y1: 77.0 };
        let part = renderer.render_window(&facing(), &all, &options, b);
        for (y, x, i) in part.window.indices() {
            let (px, py) = (x - part.window.x0, y - part.window.y0);
            assert_eq!(part.frame.color.get_pixel(px, py), whole.color.get_pixel(x, y), "{x} {y}");
            assert_eq!(part.frame.ids[i], whole.ids[y as usize * 100 + x as usize]);
        }
    }
}

#[test]
fn over_nothing_glass_has_an_alpha() {
    let pane = sheet(0.0, 2.0, veil([0.5; 3], 0.4));
    for options in options() {
        let frame = render(&facing(), &[Instance::in_room(&pane, 1)], &options);
        let p = frame.color.get_pixel(50, 50).0;
        assert!(p[3].abs_diff(102) <= 1 && p[0].abs_diff(188) <= 1, "{p:?}");
    }
}

/// Columns of black and white texels.
fn tile(size: [f32; 2]) -> Arc<Tile> {
    let color = RgbaImage::from_fn(2, 1, |x, _| Rgba(if x == 0 { [255; 4] } else { [0, 0, 0, 255] }));
    Arc::new(Tile { size, turn: 0.0, color: Arc::new(color), normal: None, surface: None })
}

#[test]
fn tiles_repeat_at_their_metric_size_and_take_the_materials_colour() {
    let mut mesh = sheet(0.0, 1.0, Material::plain("stripes", [1.0, 0.5, 0.0]));
    mesh.materials[0].tile = Some(tile([0.5, 0.5]));
    // Metres from the left and the top, far along the wall.
    mesh.metric_uvs = [(100.0, 2.0), (102.0, 2.0), (102.0, 0.0), (100.0, 0.0)].map(Vec2::from).to_vec();
    let frame = render(&facing(), &[Instance::in_room(&mesh, 1)], &RenderOptions::default());
    // Two metres are a hundred pixels: a tile is 25 wide, its white texel's centre at a quarter.
    for k in 0..4 {
        let white = frame.color.get_pixel(25 * k + 6, 40).0;
        let black = frame.color.get_pixel(25 * k + 18, 40).0;
        assert!(white[0] > 250 && white[1].abs_diff(188) <= 3 && white[2] == 0, "{k}: {white:?}");
        // The pixel's centre is a fiftieth of a texel off the black one's: sRGB 39.
        assert!(black[0] < 45, "{k}: {black:?}");
    }
    // From far away only the mean is left (half of linear white is sRGB 188).
    mesh.materials[0].tile = Some(tile([0.004, 0.004]));
    let frame = render(&facing(), &[Instance::in_room(&mesh, 1)], &RenderOptions::default());
    let p = frame.color.get_pixel(50, 50).0;
    assert!(p[0].abs_diff(188) <= 2, "{p:?}");
    // A texture goes before the tile; without metric coordinates there is no tile to lay.
    mesh.metric_uvs.clear();
    let frame = render(&facing(), &[Instance::in_room(&mesh, 1)], &RenderOptions::default());
    assert_eq!(frame.color.get_pixel(50, 50).0[0], 255);
}

#[test]
fn a_lit_shade_is_bright_and_keeps_some_hue() {
    let lamp = |strength: f32| {
        let mut m = Material::plain("shade", [0.3, 0.2, 0.1]);
        m.emissive = [strength, 0.8 * strength, 0.5 * strength];
        let mesh = sheet(0.0, 1.0, m);
        let lit = RenderOptions { lighting: Lighting::Unlit, ..RenderOptions::default() };
        middle(&render(&facing(), &[Instance::in_room(&mesh, 1)], &lit))
    };
    let (off, dim, bright) = (lamp(0.0), lamp(0.3), lamp(20.0));
    assert!((dim[0] - off[0] - 0.3).abs() < 0.01, "light is added");
    assert!(bright[0] > 0.98 && bright[0] > bright[1] && bright[1] > bright[2] && bright[2] > 0.6, "{bright:?}");
}
