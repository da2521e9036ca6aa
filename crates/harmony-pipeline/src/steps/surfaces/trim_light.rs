//! Boards in the photo's light.
//!
//! A board's colour is said, as of paint in even light; walls and floors have the light of the photo in them. In a dim
//! photo said white boards would glow. What the photo shows where a board is seen tells its colour there, and boards that
//! it does not show get as much light as those that it does.

use harmony_imaging::color::{lab_from_rgb8, linear_from_rgb8, median_color, rgb8_from_linear};
use harmony_lighting::linear::luminance;
use harmony_mesh::{TRIMS, Trim, Trims};
use harmony_render::{Instance, RenderOptions, render_depth_ids};
use harmony_scene::Mask;

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
    let shown = masks(state);
    let seen: [Option<[f32; 3]>; 3] =
        std::array::from_fn(|k| seen_as(said[k]?.color, median_color(&state.photo, shown[k].as_ref()?)?));
    let lights: Vec<f32> = said.iter().zip(&seen).filter_map(|(t, s)| Some(light((*s)?, (*t)?.color))).collect();
    let usual = if lights.is_empty() { 1.0 } else { lights.iter().sum::<f32>() / lights.len() as f32 };
    let [skirting, cornice, casing] = std::array::from_fn(|k| {
        said[k].map(|trim| Trim { color: seen[k].unwrap_or(trim.color.map(|c| c * usual)), ..trim })
    });
    Trims { skirting, cornice, casing }
}

/// Where each kind of board is the nearest thing, its edges and what was found left out; `None` where that is too little.
fn masks(state: &SceneState) -> [Option<Mask>; 3] {
    let mut shell = views::shell(state, Vec::new());
    let names: Vec<String> = shell.materials.iter().map(|m| m.name.clone()).collect();
    let mut boards = TRIMS.map(|name| {
        let mut board = shell.clone();
        board.groups.retain(|g| names[g.material] == name);
        board
    });
    shell.groups.retain(|g| !TRIMS.contains(&names[g.material].as_str()));
    // The room is 1; its boards are ids that nothing else has.
    let ids_of = |k: usize| u32::MAX - 1 - k as u32;
    let things =
        state.partial.placed.iter().filter_map(|placed| {
            Some(Instance::posed(state.mesh_of(&placed.item.id)?, &placed.pose, placed.item.index))
        });
    let boards = boards.iter_mut().enumerate().filter(|(_, b)| !b.groups.is_empty());
    let all: Vec<Instance<'_>> = std::iter::once(Instance::in_room(&shell, 1))
        .chain(boards.map(|(k, board)| Instance::in_room(board, ids_of(k))))
        .chain(things)
        .collect();
    let size = state.partial.camera.size;
    let seen = render_depth_ids(&state.partial.camera, &all, &RenderOptions::default());
    let covered = state.all_objects().or(&state.photo_frame);
    std::array::from_fn(|k| {
        let board = seen.mask(ids_of(k));
        let inner = Mask::from_fn(size, |x, y| {
            let (x, y) = (i64::from(x), i64::from(y));
            let around = [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)];
            !covered.get(x, y) && around.into_iter().all(|(i, j)| board.get(x + i, y + j))
        });
        (inner.count() >= FEWEST).then_some(inner)
    })
}

/// A board's colour in the light that the photo shows on it; `None` where the photo shows something else.
fn seen_as(said: [f32; 3], shown: [u8; 3]) -> Option<[f32; 3]> {
    let seen = linear_from_rgb8(shown);
    let light = light(seen, said);
    if !(LIGHT[0]..=LIGHT[1]).contains(&light) {
        return None;
    }
    let dimmed = said.map(|c| c * light);
    let (a, b) = (lab_from_rgb8(shown), lab_from_rgb8(rgb8_from_linear(dimmed)));
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
    fn what_is_too_dark_to_be_the_board_says_nothing() {
        let mut state = room([4, 4, 4]);
        state.trims.skirting = Some(board([240, 240, 235]));
        assert_eq!(in_photo(&state), state.trims);
    }
}
