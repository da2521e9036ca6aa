//! Boards in the photo's light.
//!
//! A board's colour is said, as of paint in even light; walls and floors have the light of the photo in them. In a dim
//! photo said white boards would glow. What the photo shows where a board is seen tells its colour there, and boards that
//! it does not show get as much light as those that it does.

use harmony_imaging::color::{lab_from_rgb8, rgb8_from_linear};
use harmony_mesh::{TRIMS, Trim, Trims};
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use image::Rgb;

use crate::state::SceneState;
use crate::views;

/// Pixels of a board that tell its colour.
const FEWEST: usize = 40;
/// Light on a board as a share of that in which its colour was said.
const LIGHT: [f32; 2] = [0.05, 1.4];
/// Difference in hue, Lab units, up to which the photo's colour is the board's in coloured light.
const TINT: f32 = 14.0;

/// The room's boards as the photo shows them.
pub fn in_photo(state: &SceneState) -> Trims {
    let Trims { skirting, cornice, casing } = state.trims;
    let said = [skirting, cornice, casing];
    if said.iter().all(Option::is_none) {
        return state.trims;
    }
    let seen = said.iter().zip(pixels(state)).map(|(trim, pixels)| Some(seen_as((*trim)?, &pixels)?.color));
    let seen: Vec<Option<[f32; 3]>> = seen.collect();
    let lights: Vec<f32> =
        said.iter().zip(&seen).filter_map(|(t, s)| Some(luminance((*s)?) / luminance((*t)?.color))).collect();
    let usual = if lights.is_empty() { 1.0 } else { lights.iter().sum::<f32>() / lights.len() as f32 };
    let [skirting, cornice, casing] = std::array::from_fn(|k| {
        said[k].map(|trim| Trim { color: seen[k].unwrap_or(trim.color.map(|c| c * usual)), ..trim })
    });
    Trims { skirting, cornice, casing }
}

/// Linear colours of the photo where each kind of board is the nearest thing, their edges left out.
fn pixels(state: &SceneState) -> [Vec<[f32; 3]>; 3] {
    let mut shell = views::shell(state, Vec::new());
    let names: Vec<String> = shell.materials.iter().map(|m| m.name.clone()).collect();
    // The room is 1; its boards are ids that nothing else has.
    let first = u32::MAX - TRIMS.len() as u32;
    let mut boards = Vec::new();
    for (k, name) in TRIMS.iter().enumerate() {
        let mut board = shell.clone();
        board.groups.retain(|g| names[g.material] == *name);
        boards.push((board, first + k as u32));
    }
    shell.groups.retain(|g| !TRIMS.contains(&names[g.material].as_str()));
    let things =
        state.partial.placed.iter().filter_map(|placed| {
            Some(Instance::posed(state.mesh_of(&placed.item.id)?, &placed.pose, placed.item.index))
        });
    let all: Vec<Instance<'_>> = std::iter::once(Instance::in_room(&shell, 1))
        .chain(boards.iter().filter(|(b, _)| !b.groups.is_empty()).map(|(b, id)| Instance::in_room(b, *id)))
        .chain(things)
        .collect();
    let camera = &state.partial.camera;
    let ids = render_depth_ids(camera, &all, &RenderOptions::default()).ids;
    let objects = state.all_objects();
    let (w, h) = (camera.size.width as usize, camera.size.height as usize);
    let mut out: [Vec<[f32; 3]>; 3] = Default::default();
    for y in 1..h.saturating_sub(1) {
        for x in 1..w.saturating_sub(1) {
            let id = ids[y * w + x];
            let around = [y * w + x - 1, y * w + x + 1, (y - 1) * w + x, (y + 1) * w + x];
            let covered = objects.get(x as i64, y as i64) || state.photo_frame.get(x as i64, y as i64);
            if id < first || id == u32::MAX || covered || around.iter().any(|p| ids[*p] != id) {
                continue;
            }
            let Rgb(color) = *state.photo.get_pixel(x as u32, y as u32);
            out[(id - first) as usize].push(harmony_imaging::color::linear_from_rgb8(color));
        }
    }
    out
}

/// A board in the light that the photo shows on it; `None` where the photo shows too little of it, or something else.
fn seen_as(trim: Trim, pixels: &[[f32; 3]]) -> Option<Trim> {
    if pixels.len() < FEWEST {
        return None;
    }
    let middle: [f32; 3] = std::array::from_fn(|k| {
        let mut channel: Vec<f32> = pixels.iter().map(|p| p[k]).collect();
        let half = channel.len() / 2;
        *channel.select_nth_unstable_by(half, f32::total_cmp).1
    });
    let light = luminance(middle) / luminance(trim.color);
    if !(LIGHT[0]..=LIGHT[1]).contains(&light) {
        return None;
    }
    let dimmed = trim.color.map(|c| c * light);
    let (a, b) = (lab_from_rgb8(rgb8_from_linear(middle)), lab_from_rgb8(rgb8_from_linear(dimmed)));
    let tint = ((a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt();
    Some(Trim { color: if tint <= TINT { middle } else { dimmed }, ..trim })
}

fn luminance(c: [f32; 3]) -> f32 {
    (0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]).max(1e-4)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_imaging::color::linear_from_rgb8;
    use image::RgbImage;

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
    fn what_is_too_dark_to_be_the_board_says_nothing() {
        let mut state = room([4, 4, 4]);
        state.trims.skirting = Some(board([240, 240, 235]));
        assert_eq!(in_photo(&state), state.trims);
    }
}
