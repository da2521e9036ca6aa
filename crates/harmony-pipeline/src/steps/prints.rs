//! Pieces of the photo on what programs model: pictures, screens, labels, prints.
//!
//! A piece brings the photo's light with it. A picture or a screen may: it ends at its frame. A print ends on its own
//! ground, as a monogram on a cushion does, and a square of another red shows round it; such a piece takes its ground's
//! colour, and from then on the light that its ground gets.

use std::sync::Arc;

use glam::DVec2;
use harmony_imaging::color::{lab_distance, lab_from_rgb8, linear_from_rgb8, median_color, rgb8_from_linear};
use harmony_imaging::rectify::rectify_quad;
use harmony_mesh::{Tile, parse_color};
use harmony_scene::{ImageSize, Mask};
use harmony_shape::build::BuiltShape;
use harmony_shape::tree::NodeId;
use harmony_shape::{Kind, ShapeTree};
use image::{DynamicImage, RgbImage, Rgba, RgbaImage};

/// Smallest and largest side of a rectified piece, pixels.
const PIECE_PX: [f64; 2] = [16.0, 1024.0];
/// Width of the rim by which a piece's ground is known, share of its shorter side.
const RIM: f64 = 0.08;
/// Share of a rim that must be near its middle colour, and how near, Lab units.
const ALIKE: (f64, f64) = (0.75, 18.0);
/// Difference in hue and saturation (Lab a and b) up to which the rim is the ground that was said.
const SAME_HUE: f32 = 22.0;
/// Largest factor on a rim's light, and its inverse.
const MAX_LIGHT: f32 = 4.0;
/// Largest fall of light across a piece that is taken out, logarithm.
const MAX_FALL: f64 = 1.5;

/// Lays rectified pieces of the photo on the materials that ask for them. The materials whose pieces took their ground's
/// colour, by name.
///
/// `scale` is what the shape's lengths were multiplied by.
pub fn lay(shape: &mut BuiltShape, tree: &ShapeTree, photo: &RgbImage, scale: f64) -> Vec<String> {
    let (w, h) = (f64::from(photo.width()), f64::from(photo.height()));
    let mut printed = Vec::new();
    for (index, spec) in tree.materials.iter().enumerate() {
        let Some(map) = &spec.photo else { continue };
        let quad = map.quad.map(|[x, y]| DVec2::new(x / 1000.0 * w, y / 1000.0 * h));
        let [least, most] = PIECE_PX;
        let across = quad[0].distance(quad[1]).max(quad[3].distance(quad[2])).clamp(least, most);
        let down = quad[0].distance(quad[3]).max(quad[1].distance(quad[2])).clamp(least, most);
        let mut piece = rectify_quad(photo, quad, ImageSize::new(across.ceil() as u32, down.ceil() as u32));
        if map.delit {
            level_light(&mut piece);
        }
        if let Some(print) = ground(tree, index as u32).and_then(|ground| on_ground(&piece, ground)) {
            piece = print;
            printed.push(spec.name.clone());
        }
        let tile = Arc::new(Tile {
            size: map.size.map(|v| (v * scale) as f32),
            color: Arc::new(piece),
            turn: 0.0,
            normal: None,
            surface: None,
        });
        for material in shape.mesh.materials.iter_mut().filter(|m| m.name == spec.name) {
            material.tile = Some(Arc::clone(&tile));
            material.base_color = [1.0, 1.0, 1.0, material.base_color[3]];
        }
    }
    printed
}

/// Takes out light that falls off evenly across a piece: the plane through the logarithm of its luminance.
fn level_light(piece: &mut RgbaImage) {
    let (w, h) = (f64::from(piece.width()), f64::from(piece.height()));
    let place = |x: u32, y: u32| DVec2::new((f64::from(x) + 0.5) / w - 0.5, (f64::from(y) + 0.5) / h - 0.5);
    let level = |p: &Rgba<u8>| {
        let [r, g, b] = linear_from_rgb8([p.0[0], p.0[1], p.0[2]]).map(f64::from);
        (0.2126 * r + 0.7152 * g + 0.0722 * b + 1e-3).ln()
    };
    // Places are symmetric about the middle, so that the slopes are independent; transparent ones hardly ever are.
    let (mut slope, mut squares) = (DVec2::ZERO, DVec2::splat(1e-9));
    for (x, y, p) in piece.enumerate_pixels().filter(|(_, _, p)| p.0[3] == 255) {
        slope += place(x, y) * level(p);
        squares += place(x, y) * place(x, y);
    }
    slope = (slope / squares).clamp(DVec2::splat(-MAX_FALL), DVec2::splat(MAX_FALL));
    for (x, y, p) in piece.enumerate_pixels_mut() {
        let factor = (-slope.dot(place(x, y))).exp() as f32;
        let [r, g, b] = linear_from_rgb8([p.0[0], p.0[1], p.0[2]]);
        let [r, g, b] = rgb8_from_linear([r, g, b].map(|v| (v * factor).min(1.0)));
        p.0 = [r, g, b, p.0[3]];
    }
}

/// The colour said of what a material lies on as a decal. `None` where it lies on several, or the photo paints them.
fn ground(tree: &ShapeTree, material: u32) -> Option<[u8; 3]> {
    let mut under = tree.nodes.iter().filter_map(|node| match &node.kind {
        Kind::Decal { child, with, .. } if *with == material => Some(*child),
        _ => None,
    });
    let index = material_of(tree, under.next()?)?;
    if under.any(|other| material_of(tree, other) != Some(index)) {
        return None;
    }
    let spec = tree.materials.get(index as usize)?;
    (spec.photo.is_none() && !spec.paint && spec.emit <= 0.0).then(|| parse_color(&spec.color)).flatten()
}

/// The material of a part, or of the first part below it that has one.
fn material_of(tree: &ShapeTree, id: NodeId) -> Option<u32> {
    let node = tree.nodes.get(id.0 as usize)?;
    // Nodes stand below those that refer to them, so that this ends.
    let below = || node.kind.references().into_iter().filter(|r| r.0 < id.0).find_map(|r| material_of(tree, r));
    node.material.or_else(below)
}

/// A piece whose rim has the colour of its ground, if the rim shows that ground under whatever light.
fn on_ground(piece: &RgbaImage, ground: [u8; 3]) -> Option<RgbaImage> {
    let (w, h) = piece.dimensions();
    let size = ImageSize::new(w, h);
    let colors = DynamicImage::ImageRgba8(piece.clone()).to_rgb8();
    let wide = ((RIM * f64::from(w.min(h))).ceil() as u32).max(1);
    let on_rim = |x: u32, y: u32| x < wide || y < wide || x + wide >= w || y + wide >= h;
    let rim = Mask::from_fn(size, |x, y| on_rim(x, y) && piece.get_pixel(x, y).0[3] == 255);
    let middle = median_color(&colors, &rim)?;
    let alike = |x: u32, y: u32| lab_distance(colors.get_pixel(x, y).0, middle) < ALIKE.1;
    let near = Mask::from_fn(size, |x, y| rim.get(i64::from(x), i64::from(y)) && alike(x, y));
    let [[_, a, b], [_, ground_a, ground_b]] = [middle, ground].map(lab_from_rgb8);
    if (near.count() as f64) < ALIKE.0 * rim.count() as f64 || (ground_a - a).hypot(ground_b - b) > SAME_HUE {
        return None;
    }
    // Light differs over a piece: its four corners each have their own.
    let wanted = linear_from_rgb8(ground);
    let corner = |right: bool, low: bool| {
        let here = |x: u32, y: u32| (x >= w / 2) == right && (y >= h / 2) == low;
        let own = Mask::from_fn(size, |x, y| here(x, y) && near.get(i64::from(x), i64::from(y)));
        let seen = linear_from_rgb8(median_color(&colors, &own).unwrap_or(middle));
        [0, 1, 2].map(|k| (wanted[k] + 1e-3) / (seen[k] + 1e-3))
    };
    let corners = [[corner(false, false), corner(true, false)], [corner(false, true), corner(true, true)]];
    if corners.iter().flatten().flatten().any(|f| !(1.0 / MAX_LIGHT..=MAX_LIGHT).contains(f)) {
        return None;
    }
    Some(RgbaImage::from_fn(w, h, |x, y| {
        let (u, v) = ((x as f32 + 0.5) / w as f32, (y as f32 + 0.5) / h as f32);
        let lit = linear_from_rgb8(colors.get_pixel(x, y).0);
        let [r, g, b] = rgb8_from_linear([0, 1, 2].map(|k| {
            let row = |r: usize| corners[r][0][k] * (1.0 - u) + corners[r][1][k] * u;
            (lit[k] * (row(0) * (1.0 - v) + row(1) * v)).min(1.0)
        }));
        Rgba([r, g, b, piece.get_pixel(x, y).0[3]])
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rgb(Rgba([r, g, b, _]): Rgba<u8>) -> [u8; 3] {
        [r, g, b]
    }

    fn opaque([r, g, b]: [u8; 3]) -> Rgba<u8> {
        Rgba([r, g, b, 255])
    }

    /// A golden letter on cloth that darkens to the right.
    fn monogram(cloth: [u8; 3]) -> RgbaImage {
        let cloth = linear_from_rgb8(cloth);
        RgbaImage::from_fn(60, 50, |x, y| {
            let light = 0.6 - 0.3 * x as f32 / 60.0;
            let letter = (25..35).contains(&x) && (10..40).contains(&y);
            let color = if letter { [0.6, 0.45, 0.15] } else { cloth };
            opaque(rgb8_from_linear(color.map(|c| c * light)))
        })
    }

    #[test]
    fn a_print_on_its_own_ground_takes_the_grounds_colour_up_to_its_edge() {
        let red = [150, 52, 42];
        let print = on_ground(&monogram(red), red).unwrap();
        for (x, y) in [(1, 1), (58, 1), (1, 48), (58, 48), (30, 1), (58, 25)] {
            let distance = lab_distance(rgb(*print.get_pixel(x, y)), red);
            assert!(distance < 3.0, "{distance} at {x} {y}");
        }
        assert!(lab_distance(rgb(*print.get_pixel(30, 25)), red) > 25.0, "the letter is still to be read");
    }

    #[test]
    fn light_that_falls_off_across_a_piece_is_taken_out_and_its_figure_stays() {
        let cloth = |x: u32, y: u32, light: f32| {
            let figure = if (x / 6 + y / 5).is_multiple_of(2) { 0.4 } else { 0.2 };
            opaque(rgb8_from_linear([figure * light; 3]))
        };
        let fall = |x: u32| (-0.9 * (x as f32 + 0.5) / 60.0).exp();
        let mut piece = RgbaImage::from_fn(60, 50, |x, y| cloth(x, y, fall(x)));
        level_light(&mut piece);
        // Two places of one tone, far apart, and two of different tones.
        let ends = [2, 50].map(|x| f32::from(piece.get_pixel(x, 2).0[0]));
        let figures = [2, 8].map(|x| f32::from(piece.get_pixel(x, 2).0[0]));
        assert!((ends[0] / ends[1] - 1.0).abs() < 0.06, "{ends:?}");
        assert!((figures[0] - figures[1]).abs() > 25.0, "{figures:?}");
    }

    #[test]
    fn a_picture_that_ends_at_its_frame_stays_as_it_is() {
        // A red print on a blue cushion; a landscape whose rim has many colours.
        assert!(on_ground(&monogram([150, 52, 42]), [40, 60, 150]).is_none());
        let landscape =
            RgbaImage::from_fn(60, 50, |x, y| opaque(if y < 20 { [120, 170, 230] } else { [(x * 4) as u8, 120, 40] }));
        assert!(on_ground(&landscape, [120, 170, 230]).is_none());
        // A black television on black plastic that the photo shows white would need more than light.
        assert!(on_ground(&RgbaImage::from_pixel(30, 30, opaque([240; 3])), [12; 3]).is_none());
    }
}
