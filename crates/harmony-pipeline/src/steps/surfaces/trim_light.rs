//! Boards in the photo's light.
//!
//! A board's colour is said, as of paint in even light; walls and floors have the light of the photo in them. In a dim
//! photo said white boards would glow. What the photo shows where a board is seen tells its colour there. The room's walls
//! tell how the light there is against that along the rest of it: a patch seen between a table's legs is darker than the
//! board. Boards that the photo does not show get as much light as those that it does.

use harmony_imaging::color::{lab_from_rgb8, linear_from_rgb8, median_color, rgb8_from_linear};
use harmony_lighting::linear::luminance;
use harmony_mesh::{TRIMS, Trim, Trims};
use harmony_render::{Instance, Lighting, RenderOptions, render, render_depth_ids};
use harmony_scene::Mask;
use image::{DynamicImage, RgbImage};

use crate::state::SceneState;
use crate::views;

/// Pixels of a board that tell its colour.
const FEWEST: usize = 40;
/// Light on a board as a share of that in which its colour was said.
const LIGHT: [f32; 2] = [0.05, 1.4];
/// Less light than this share of what the walls have is the shadow of something, not the board's light.
const SHADED: f32 = 0.5;
/// Difference in hue, Lab units, up to which the photo's colour is the board's in coloured light.
const TINT: f32 = 14.0;
/// How far from a board the wall beside it is looked at, as a share of the photo's longer side.
const BESIDE: f64 = 0.03;
/// Light along the whole of a board as a share of that where it is seen.
const ALONG: [f32; 2] = [0.5, 2.0];

/// The room's boards as the photo shows them.
pub fn in_photo(state: &SceneState) -> Trims {
    let Trims { skirting, cornice, casing } = state.trims;
    let said = [skirting, cornice, casing];
    if said.iter().all(Option::is_none) {
        return state.trims;
    }
    let boards = boards(state);
    let walls = light_on_walls(state);
    let seen: [Option<[f32; 3]>; 3] = std::array::from_fn(|k| {
        let board = boards[k].as_ref()?;
        let there = linear_from_rgb8(median_color(&state.photo, &board.seen)?);
        let there = there.map(|c| (c * board.along).min(1.0));
        let said = said[k]?.color;
        seen_as(said, there).filter(|_| walls.is_none_or(|walls| light(there, said) > SHADED * walls))
    });
    let lights: Vec<f32> = said.iter().zip(&seen).filter_map(|(t, s)| Some(light((*s)?, (*t)?.color))).collect();
    let usual = if lights.is_empty() {
        walls.unwrap_or(1.0).min(1.0)
    } else {
        lights.iter().sum::<f32>() / lights.len() as f32
    };
    let [skirting, cornice, casing] = std::array::from_fn(|k| {
        said[k].map(|trim| Trim { color: seen[k].unwrap_or(trim.color.map(|c| c * usual)), ..trim })
    });
    Trims { skirting, cornice, casing }
}

/// How much light the photo shows on walls whose paint was said, as a share of even white light; the middle one of them.
fn light_on_walls(state: &SceneState) -> Option<f32> {
    let said = state.layout.answer.surfaces.iter().filter(|s| s.surface.surface().wall().is_some());
    let mut lights: Vec<f32> = said
        .filter_map(|s| {
            let texture = state.surfaces.get(&s.surface.surface())?;
            let whole = Mask::from_fn(harmony_scene::ImageSize::new(texture.width(), texture.height()), |_, _| true);
            let shown = median_color(&DynamicImage::ImageRgba8((**texture).clone()).to_rgb8(), &whole)?;
            Some(light(linear_from_rgb8(shown), linear_from_rgb8(s.rgb()?)))
        })
        .collect();
    lights.sort_by(f32::total_cmp);
    lights.get(lights.len() / 2).copied()
}

/// A kind of board in the photo.
struct Board {
    /// Where it is the nearest thing, its edges and what was found left out.
    seen: Mask,
    /// Light on the walls along the whole of it, as a share of that beside where it is seen.
    along: f32,
}

/// The kinds of boards; `None` where too little is seen of one.
fn boards(state: &SceneState) -> [Option<Board>; 3] {
    let mut shell = views::shell(state, Vec::new());
    let names: Vec<String> = shell.materials.iter().map(|m| m.name.clone()).collect();
    let meshes = TRIMS.map(|name| {
        let mut board = shell.clone();
        board.groups.retain(|g| names[g.material] == name);
        board
    });
    let mut walls = shell.clone();
    walls.groups.retain(|g| names[g.material].starts_with("wall_"));
    shell.groups.retain(|g| !TRIMS.contains(&names[g.material].as_str()) && !names[g.material].starts_with("wall_"));
    // The rest of the room is 1; its walls and boards are ids that nothing else has.
    let wall = u32::MAX - 1;
    let id_of = |k: usize| wall - 1 - k as u32;
    let things: Vec<Instance<'_>> = (state.partial.placed.iter())
        .filter_map(|placed| Some(Instance::posed(state.mesh_of(&placed.item.id)?, &placed.pose, placed.item.index)))
        .collect();
    let room: Vec<Instance<'_>> = [Instance::in_room(&shell, 1), Instance::in_room(&walls, wall)]
        .into_iter()
        .chain(
            meshes
                .iter()
                .enumerate()
                .filter(|(_, b)| !b.groups.is_empty())
                .map(|(k, b)| Instance::in_room(b, id_of(k))),
        )
        .collect();
    let camera = &state.partial.camera;
    let options = RenderOptions { lighting: Lighting::Unlit, ..RenderOptions::default() };
    let empty = render(camera, &room, &options);
    let on_walls = Mask::from_fn(camera.size, |x, y| empty.ids[(y * camera.size.width + x) as usize] == wall);
    let of_room = DynamicImage::ImageRgba8(empty.color).to_rgb8();
    let all: Vec<Instance<'_>> = room.into_iter().chain(things).collect();
    let frame = render_depth_ids(camera, &all, &RenderOptions::default());
    let covered = state.all_objects().or(&state.photo_frame);
    std::array::from_fn(|k| {
        let board = frame.mask(id_of(k));
        let seen = Mask::from_fn(camera.size, |x, y| {
            let (x, y) = (i64::from(x), i64::from(y));
            let around = [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)];
            !covered.get(x, y) && around.into_iter().all(|(i, j)| board.get(x + i, y + j))
        });
        if seen.count() < FEWEST {
            return None;
        }
        let whole = Mask::from_fn(camera.size, |x, y| empty.ids[(y * camera.size.width + x) as usize] == id_of(k));
        let along = beside(&of_room, &on_walls, &whole).zip(beside(&of_room, &on_walls, &seen));
        Some(Board { seen, along: along.map_or(1.0, |(all, here)| (all / here).clamp(ALONG[0], ALONG[1])) })
    })
}

/// Luminance of the walls near a mask, as they are textured.
fn beside(room: &RgbImage, walls: &Mask, of: &Mask) -> Option<f32> {
    let radius = (BESIDE * f64::from(of.size().width.max(of.size().height))).round() as i32;
    let near = of.dilated(radius).and(walls);
    if near.count() < FEWEST {
        return None;
    }
    Some(luminance(linear_from_rgb8(median_color(room, &near)?)).max(1e-3))
}

/// A board's colour in the light that the photo shows on it; `None` where the photo shows something else.
fn seen_as(said: [f32; 3], seen: [f32; 3]) -> Option<[f32; 3]> {
    let light = light(seen, said);
    if !(LIGHT[0]..=LIGHT[1]).contains(&light) {
        return None;
    }
    let dimmed = said.map(|c| c * light);
    let (a, b) = (lab_from_rgb8(rgb8_from_linear(seen)), lab_from_rgb8(rgb8_from_linear(dimmed)));
    let tint = ((a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt();
    Some(if tint <= TINT { seen } else { dimmed })
}

/// How much light falls on a colour that is seen, as a share of that in which it was said.
fn light(seen: [f32; 3], said: [f32; 3]) -> f32 {
    luminance(seen).max(1e-4) / luminance(said).max(1e-4)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::Surface;
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::testing::empty_room;

    fn board(color: [u8; 3]) -> Trim {
        Trim { height: 0.2, depth: 0.02, color: linear_from_rgb8(color) }
    }

    fn room(photo: [u8; 3]) -> SceneState {
        let mut state = empty_room();
        let size = state.photo.dimensions();
        state.photo = Arc::new(RgbImage::from_pixel(size.0, size.1, Rgb(photo)));
        state
    }

    #[test]
    fn white_boards_of_a_dim_photo_are_as_dim_as_it_shows_them() {
        let mut state = room([92, 96, 100]);
        state.trims.skirting = Some(board([240, 240, 235]));
        // There is no door, so that no casing is seen.
        state.trims.casing = Some(board([240, 240, 235]));
        let trims = in_photo(&state);
        assert_eq!(rgb8_from_linear(trims.skirting.unwrap().color), [92, 96, 100]);
        let casing = rgb8_from_linear(trims.casing.unwrap().color);
        assert!(casing.iter().all(|c| (88..104).contains(c)), "in the light of the others: {casing:?}");
    }

    #[test]
    fn a_red_board_stays_red_in_what_light_the_photo_has() {
        let mut state = room([60, 60, 60]);
        state.trims.skirting = Some(board([200, 60, 40]));
        let color = in_photo(&state).skirting.unwrap().color;
        let said = linear_from_rgb8([200, 60, 40]);
        assert!((color[0] / color[2] - said[0] / said[2]).abs() < 1e-3, "{color:?}");
        assert!((luminance(color) / luminance(linear_from_rgb8([60; 3])) - 1.0).abs() < 1e-3, "{color:?}");
    }

    #[test]
    fn a_patch_seen_in_the_dark_is_not_the_whole_board() {
        let mut state = empty_room();
        let (width, height) = state.photo.dimensions();
        // The photo shows the right third, in a shadow that the wall has there too.
        let shadow = |x: u32| x > 2 * width / 3;
        state.photo_frame = Arc::new(Mask::from_fn(state.photo_frame.size(), |x, _| !shadow(x)));
        state.photo =
            Arc::new(RgbImage::from_fn(width, height, |x, _| Rgb(if shadow(x) { [80; 3] } else { [170; 3] })));
        state.trims.skirting = Some(board([240, 240, 235]));
        let alone = rgb8_from_linear(in_photo(&state).skirting.unwrap().color);
        assert!(alone.iter().all(|c| (78..83).contains(c)), "of an even wall: {alone:?}");
        let texture = |dark_from: u32| {
            let picture = image::RgbaImage::from_fn(90, 45, |x, _| {
                image::Rgba(if x >= dark_from { [100, 100, 100, 255] } else { [200, 200, 200, 255] })
            });
            Arc::new(picture)
        };
        state.surfaces = [(Surface::Back, 60), (Surface::Left, 90), (Surface::Right, 0)]
            .map(|(wall, dark_from)| (wall, texture(dark_from)))
            .into();
        let color = rgb8_from_linear(in_photo(&state).skirting.unwrap().color);
        assert!(color.iter().all(|c| *c > 100), "{color:?}");
    }

    #[test]
    fn a_board_that_is_seen_in_a_shadow_alone_has_the_light_of_the_walls() {
        let mut state = room([60, 60, 60]);
        state.trims.skirting = Some(board([240, 240, 235]));
        let dark = rgb8_from_linear(in_photo(&state).skirting.unwrap().color);
        assert!(dark.iter().all(|c| *c < 65), "nothing says better: {dark:?}");
        let wall = harmony_prompts::LayoutSurface {
            surface: harmony_prompts::SurfaceName::WallBack,
            color_hex: Some("#d8d8d8".into()),
            finish: None,
            pattern: None,
            parts: vec![],
        };
        state.layout.answer.surfaces = vec![wall];
        let paper = image::RgbaImage::from_pixel(90, 45, image::Rgba([190, 190, 190, 255]));
        state.surfaces = [(Surface::Back, Arc::new(paper))].into();
        let color = rgb8_from_linear(in_photo(&state).skirting.unwrap().color);
        assert!(color.iter().all(|c| (195..225).contains(c)), "{color:?}");
    }

    #[test]
    fn what_is_too_dark_to_be_the_board_says_nothing() {
        let mut state = room([4, 4, 4]);
        state.trims.skirting = Some(board([240, 240, 235]));
        assert_eq!(in_photo(&state), state.trims);
    }
}
