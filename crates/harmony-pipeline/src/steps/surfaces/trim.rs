//! Skirting boards: from the layout answer, or from the strip above the floor that all seen walls have.

use harmony_imaging::color::{lab_from_rgb8, linear_from_srgb, rgb8_from_linear};
use harmony_mesh::{Trim, Trims};
use harmony_prompts::{LayoutPart, LayoutPartKind, LayoutSurface, LayoutTrim, LayoutTrims, SurfaceName};
use harmony_scene::{Extents, Surface};
use image::RgbaImage;

use super::evidence::Face;
use super::paint::goes_round;

/// Heights among which a skirting board ends, metres.
const HEIGHTS: [f64; 2] = [0.035, 0.2];
/// Stretch of wall above it that it is compared with, metres beyond the highest.
const ABOVE: f64 = 0.16;
/// Length of wall that must be seen down to the floor, metres.
const LENGTH: f64 = 0.25;
/// Step in colour that makes the edge of a board, Lab units; and difference from the floor, so that a line of floor is
/// none.
const DIFFERENT: f32 = 4.0;
const NOT_FLOOR: f32 = 7.0;
/// Colours that differ by less can be one board under uneven light.
const ONE_BOARD: f32 = 12.0;
/// Difference from the named colour from which a strip is not the named board, Lab units.
const ANOTHER: f32 = 20.0;
/// A cornice that is wider is a frieze: a plain board would hide what the photo shows of it, metres.
const WIDEST_CORNICE: f64 = 0.2;
/// Depth of a board that is only seen, metres.
const DEPTH: f64 = 0.014;

/// The boards of the room: those that the answer names, and a skirting board that is seen.
pub fn trims(answer: &LayoutTrims, faces: &[Face], extents: &Extents) -> Trims {
    let seen = seen_skirting(faces, extents);
    let skirting = match (&answer.skirting, seen) {
        // Its colour under the room's light is what the photo shows.
        (Some(named), Some(seen)) if alike(board(named).color, seen.color) => {
            Some(Trim { height: named.height_m, depth: named.depth_m, color: seen.color })
        }
        // What is seen in quite another colour is a shadow along the wall, or the line of the floor.
        (Some(named), _) => Some(board(named)),
        (None, seen) => seen,
    };
    let cornice = answer.cornice.as_ref().filter(|c| c.height_m <= WIDEST_CORNICE);
    Trims { skirting, cornice: cornice.map(board), casing: answer.casing.as_ref().map(board) }
}

/// The walls' answers with what was called a cornice and is a frieze: a stretch of every wall, with its photo.
pub fn with_frieze(answer: &[LayoutSurface], trims: &LayoutTrims, extents: &Extents) -> Vec<LayoutSurface> {
    let mut surfaces = answer.to_vec();
    let Some(frieze) = trims.cornice.as_ref().filter(|c| c.height_m > WIDEST_CORNICE) else { return surfaces };
    let part = LayoutPart {
        kind: LayoutPartKind::Panelling,
        from_m: extents.height - frieze.height_m,
        to_m: extents.height,
        color_hex: Some(frieze.color_hex.clone()),
        pattern: None,
    };
    for surface in [SurfaceName::WallBack, SurfaceName::WallLeft, SurfaceName::WallRight, SurfaceName::WallFront] {
        if !surfaces.iter().any(|s| s.surface == surface) {
            let parts = goes_round(answer).cloned().into_iter().collect();
            surfaces.push(LayoutSurface { surface, color_hex: None, finish: None, pattern: None, parts });
        }
    }
    for wall in surfaces.iter_mut().filter(|s| s.surface.surface().wall().is_some()) {
        wall.parts.push(part.clone());
    }
    surfaces
}

fn board(named: &LayoutTrim) -> Trim {
    // A flat render shows things as lit: white in a room is no full white.
    Trim { height: named.height_m, depth: named.depth_m, color: linear(named.rgb().map(|c| f32::from(c) * 0.85)) }
}

/// Whether two linear colours can be one board in more or less light.
fn alike(a: [f32; 3], b: [f32; 3]) -> bool {
    let (a, b) = (lab_from_rgb8(rgb8_from_linear(a)), lab_from_rgb8(rgb8_from_linear(b)));
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt() < ANOTHER
}

fn linear(color: [f32; 3]) -> [f32; 3] {
    color.map(|c| linear_from_srgb(c / 255.0))
}

/// The skirting board of the wall that shows most of it.
fn seen_skirting(faces: &[Face], extents: &Extents) -> Option<Trim> {
    let floor = faces.iter().find(|f| f.surface == Surface::Floor).and_then(|f| middle_color(&f.texture));
    let found = faces
        .iter()
        .filter(|f| f.surface.wall().is_some())
        .filter_map(|face| on_wall(face, extents, floor))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(found.0)
}

/// The board on a wall, and the length of wall that shows it.
fn on_wall(face: &Face, extents: &Extents, floor: Option<[f32; 3]>) -> Option<(Trim, f64)> {
    let (width, height) = face.texture.dimensions();
    let per_m = f64::from(height) / extents.height.max(0.1);
    let rows = (((HEIGHTS[1] + ABOVE) * per_m) as u32).min(height);
    if rows < 12 {
        return None;
    }
    let seen = |x: u32, k: u32| face.texture.get_pixel(x, height - 1 - k).0[3] >= 128;
    let columns: Vec<u32> =
        (0..width).filter(|x| (0..rows).filter(|k| seen(*x, *k)).count() * 10 >= rows as usize * 9).collect();
    let length = columns.len() as f64 / face.px_per_m;
    if length < LENGTH {
        return None;
    }
    let row = |k: u32| {
        let texels = columns.iter().map(|x| face.texture.get_pixel(*x, height - 1 - k).0).filter(|p| p[3] >= 128);
        median_color(texels.map(|p| [p[0], p[1], p[2]]))
    };
    let profile: Vec<[f32; 3]> = (0..rows).map(row).collect::<Option<_>>()?;
    let lab = |c: [f32; 3]| lab_from_rgb8(c.map(|v| v.round().clamp(0.0, 255.0) as u8));
    let apart = |a: [f32; 3], b: [f32; 3]| {
        let (a, b) = (lab(a), lab(b));
        (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt()
    };
    let at = |metres: f64| ((metres * per_m) as usize).min(profile.len() - 1);
    // The board's upper edge is the sharpest step, for walls darken smoothly towards the floor.
    let step = |k: usize| apart(mean(&profile[k - 3..k - 1]), mean(&profile[k + 1..k + 3]));
    let (low, high) = (at(HEIGHTS[0]).max(3), at(HEIGHTS[1]).min(profile.len() - 3));
    let like_floor = |c: [f32; 3]| floor.is_some_and(|f| apart(c, f) < NOT_FLOOR);
    // A line of floor at the foot of the wall ends in a step of its own.
    let ends = |k: &usize| !profile[k - 3..k - 1].iter().any(|c| like_floor(*c));
    let top = (low..high).filter(ends).max_by(|a, b| step(*a).total_cmp(&step(*b)))?;
    let sharpest = step(top);
    let others = (top + 4..profile.len() - 3).map(step).fold(0.0, f32::max);
    if sharpest < DIFFERENT || others > sharpest / 2.0 {
        return None;
    }
    // Down to the floor: the line between both may be a little off.
    let upper = mean(&profile[top - 3..top - 1]);
    let foot = (0..top - 1).rev().find(|k| like_floor(profile[*k]) || apart(profile[*k], upper) > ONE_BOARD);
    let foot = foot.map_or(0, |k| k + 1);
    let tall = (top - foot) as f64 / per_m;
    if like_floor(upper) || tall < HEIGHTS[0] * 0.7 || foot as f64 / per_m > 0.08 {
        return None;
    }
    let span = top - foot;
    let color = mean(&profile[foot + span / 4..=top - 1 - span / 5]);
    Some((Trim { height: tall, depth: DEPTH, color: linear(color) }, length))
}

fn mean(colors: &[[f32; 3]]) -> [f32; 3] {
    let sum = colors.iter().fold([0.0_f32; 3], |s, c| [s[0] + c[0], s[1] + c[1], s[2] + c[2]]);
    sum.map(|s| s / colors.len().max(1) as f32)
}

fn middle_color(texture: &RgbaImage) -> Option<[f32; 3]> {
    median_color(texture.pixels().step_by(7).filter(|p| p.0[3] >= 128).map(|p| [p.0[0], p.0[1], p.0[2]]))
}

fn median_color(colors: impl Iterator<Item = [u8; 3]>) -> Option<[f32; 3]> {
    let mut channels: [Vec<u8>; 3] = Default::default();
    for color in colors {
        for (channel, v) in channels.iter_mut().zip(color) {
            channel.push(v);
        }
    }
    let middle = channels[0].len() / 2;
    (!channels[0].is_empty()).then(|| channels.map(|mut c| f32::from(*c.select_nth_unstable(middle).1)))
}

#[cfg(test)]
mod tests {
    use harmony_imaging::tile::Fineness;
    use image::Rgba;

    use super::*;

    fn wall(row: impl Fn(f64) -> [u8; 3]) -> Face {
        let texture = RgbaImage::from_fn(300, 250, |x, y| {
            let v = (f64::from(249 - y) + 0.5) / 100.0;
            // Something stands before the left half.
            let [r, g, b] = row(v);
            if x < 150 { Rgba([0; 4]) } else { Rgba([r, g, b, 255]) }
        });
        Face { surface: Surface::Back, fineness: Fineness::full(300, 250), texture, px_per_m: 100.0 }
    }

    fn floor() -> Face {
        let texture = RgbaImage::from_pixel(50, 50, Rgba([80, 70, 60, 255]));
        Face { surface: Surface::Floor, fineness: Fineness::full(50, 50), texture, px_per_m: 100.0 }
    }

    const ROOM: Extents = Extents { width: 3.0, height: 2.5, depth: 4.0 };

    #[test]
    fn a_board_above_the_floor_is_found_with_its_height_and_colour() {
        // Two centimetres of floor at its foot: the line between floor and wall is a little off.
        let face = wall(|v| {
            if v < 0.02 {
                [80, 70, 60]
            } else if v < 0.1 {
                [235, 235, 230]
            } else {
                [150, 170, 160]
            }
        });
        let trims = trims(&LayoutTrims::default(), &[floor(), face], &ROOM);
        let board = trims.skirting.unwrap();
        assert!((board.height - 0.08).abs() < 0.011, "{}", board.height);
        assert!((board.color[0] - linear_from_srgb(235.0 / 255.0)).abs() < 0.02);
    }

    #[test]
    fn a_shadow_at_the_foot_of_a_wall_does_not_colour_the_named_board() {
        let face = wall(|v| if v < 0.08 { [100, 90, 78] } else { [196, 188, 172] });
        let named = LayoutTrim { height_m: 0.08, depth_m: 0.015, color_hex: "#c4c2bf".into() };
        let answer = LayoutTrims { skirting: Some(named), ..LayoutTrims::default() };
        let color = trims(&answer, &[floor(), face], &ROOM).skirting.unwrap().color;
        assert!((color[0] - linear_from_srgb(196.0 * 0.85 / 255.0)).abs() < 0.01, "{color:?}");
    }

    #[test]
    fn a_cornice_that_is_a_frieze_is_a_stretch_of_every_wall_and_no_board() {
        let named = |height_m: f64| LayoutTrims {
            cornice: Some(LayoutTrim { height_m, depth_m: 0.05, color_hex: "#b5a591".into() }),
            ..LayoutTrims::default()
        };
        let part = |kind, from_m, to_m| LayoutPart { kind, from_m, to_m, color_hex: None, pattern: None };
        let of = |surface, parts| LayoutSurface { surface, color_hex: None, finish: None, pattern: None, parts };
        let answer = [
            of(SurfaceName::WallBack, vec![part(LayoutPartKind::Wainscot, 0.0, 1.0)]),
            of(SurfaceName::WallLeft, Vec::new()),
            of(SurfaceName::Floor, Vec::new()),
        ];
        assert!(trims(&named(0.1), &[], &ROOM).cornice.is_some() && trims(&named(0.36), &[], &ROOM).cornice.is_none());
        assert_eq!(with_frieze(&answer, &named(0.1), &ROOM), answer);
        let surfaces = with_frieze(&answer, &named(0.36), &ROOM);
        let parts = |surface| &surfaces.iter().find(|s| s.surface == surface).unwrap().parts;
        for (wall, count) in [(SurfaceName::WallBack, 2), (SurfaceName::WallLeft, 1), (SurfaceName::WallFront, 2)] {
            let last = parts(wall).last().unwrap();
            assert_eq!(parts(wall).len(), count, "{wall:?}");
            assert!((last.from_m - 2.14).abs() < 1e-9 && (last.to_m - 2.5).abs() < 1e-9, "{last:?}");
        }
        assert!(parts(SurfaceName::Floor).is_empty());
    }

    #[test]
    fn a_line_of_floor_and_a_plain_wall_are_no_board_but_a_named_one_is() {
        let leaked = wall(|v| if v < 0.05 { [80, 70, 60] } else { [150, 170, 160] });
        let plain = wall(|_| [150, 170, 160]);
        for face in [leaked, plain] {
            assert!(trims(&LayoutTrims::default(), &[floor(), face], &ROOM).skirting.is_none());
        }
        let named = LayoutTrim { height_m: 0.12, depth_m: 0.02, color_hex: "#ffffff".into() };
        let answer = LayoutTrims { skirting: Some(named), ..LayoutTrims::default() };
        let board = trims(&answer, &[floor()], &ROOM).skirting.unwrap();
        assert!((board.height - 0.12).abs() < 1e-12 && (board.depth - 0.02).abs() < 1e-12);
    }
}
