//! The room's own surfaces: openings, textures of floor, ceiling and walls, the empty-room picture
//! (key `layout.empty_room`).

mod beyond;
mod evidence;
mod openings;
mod paint;
mod pattern;
mod trim;
mod trim_light;

use std::sync::Arc;

use harmony_imaging::color::linear_from_srgb;
use harmony_mesh::Trims;
use harmony_prompts::LayoutAnswer;
use harmony_roles::{EditKind, EditRequest};
use harmony_scene::{Camera, Extents, Level, Mask, Room, Surface};
use image::{DynamicImage, RgbImage};
use rayon::prelude::*;
use serde_json::json;

pub use beyond::{Beyond, beyond, panes};
use evidence::{Bare, Face};
pub use evidence::{standing, unnamed};
pub use openings::{keep_walls_open, open_walls};
use paint::Painted;
pub use trim_light::in_photo as trims_in_photo;

use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// Longest side of a face's texture, texels.
const LONGEST_PX: f64 = 1536.0;
/// Photo pixels this far from a board may show it, metres.
const BOARD_MARGIN: f64 = 0.025;

/// The boards that the layout answer names, as reviews show them until the photo's light is known.
pub fn named_trims(answer: &LayoutAnswer, extents: &Extents) -> Trims {
    trim::trims(&answer.trims, &[], extents)
}

/// The paper's empty room: the image editor takes everything out of the photo. `None` when no editor draws here.
///
/// `objects` are the pixels of everything that was found.
///
/// # Errors
/// Fatal role errors.
pub async fn bare_room(
    ctx: &PhaseCtx<'_>,
    state: &SceneState,
    objects: &Mask,
) -> Result<Option<Arc<RgbImage>>, PhaseError> {
    if !ctx.can().draws {
        return Ok(None);
    }
    let request = EditRequest {
        name: "1_layout/empty_room".to_owned(),
        kind: EditKind::EmptyRoom,
        image: state.photo.clone(),
        mask: Some(Arc::new(with_margin(state, objects))),
        object: None,
        instruction: "Remove all furniture, wall objects, lamps and decorations. Keep the room itself exactly as it \
                      is: floor, walls, ceiling, corners, light, camera."
            .to_owned(),
    };
    let edited = ctx.calls.edit(&request).await?;
    Ok(Some(Arc::new(DynamicImage::ImageRgba8(edited.image).to_rgb8())))
}

/// Pixels that are not bare room: objects with a margin, and the photo's empty frame.
fn with_margin(state: &SceneState, objects: &Mask) -> Mask {
    objects.dilated((state.photo.width() / 200).max(2) as i32).or(&state.photo_frame)
}

/// Makes the textures of all faces, the boards along the walls and the empty-room picture.
///
/// With an image editor that draws, its empty room (`bare`) is projected onto the faces, as in the paper; otherwise the
/// photo's bare pixels are. Either way each face becomes a material that goes on where nothing was seen.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn all(ctx: &PhaseCtx<'_>, state: &mut SceneState, bare: Option<Arc<RgbImage>>) -> Result<(), PhaseError> {
    let seen = state.clone();
    let (finest, is_seen, is_lit) = (ctx.settings.surface_px_per_m, ctx.is_seen(), ctx.path_tracer);
    let (painted, trims, faces, sides) =
        tokio::task::spawn_blocking(move || painted(&seen, bare.as_deref(), finest, is_seen, is_lit))
            .await
            .map_err(|e| PhaseError::internal(ctx.phase, &e))?;
    state.trims = trims;
    for (niche, color) in state.partial.room.shape.niches.iter_mut().zip(sides) {
        niche.sides = color;
    }
    for face in &faces {
        let name = format!("textures/seen/{}.png", face.surface.name());
        ctx.write_picture_rgba_in(Phase::Layout, &name, &face.texture)?;
    }
    for (surface, image) in painted.textures {
        let opaque = DynamicImage::ImageRgba8(image.clone()).to_rgb8();
        ctx.write_picture_in(Phase::Layout, &format!("textures/{}.png", surface.name()), &opaque)?;
        state.surfaces.insert(surface, Arc::new(image));
    }
    state.roughness = state
        .layout
        .answer
        .surfaces
        .iter()
        .filter_map(|s| Some((s.surface.surface(), s.shine()?.roughness())))
        .collect();
    state.even_surfaces = painted.even.into_iter().map(|(surface, image)| (surface, Arc::new(image))).collect();
    let board = |t: harmony_mesh::Trim| json!({ "height_m": t.height, "depth_m": t.depth, "linear_color": t.color });
    ctx.write_json_in(
        Phase::Layout,
        "surfaces.json",
        &json!({
            "surfaces": painted.notes,
            "roughness": state.roughness, "skirting": trims.skirting.map(board), "cornice": trims.cornice.map(board), "casing": trims.casing.map(board),
        }),
    )?;
    let empty = views::empty_room(state);
    ctx.write_picture_in(Phase::Layout, "empty_room.png", &empty)?;
    debug_assert!(state.partial.placed.iter().all(|p| p.item.level <= Level::Decoration));
    Ok(())
}

/// All faces in their materials, and the boards along the walls. Where nobody looked at the photo (`is_seen`), its things
/// are paint on the faces: no board is read from them, and no edge is cleaned that runs through them.
fn painted(
    state: &SceneState,
    bare: Option<&RgbImage>,
    finest: f64,
    is_seen: bool,
    is_lit: bool,
) -> (Painted, Trims, Vec<Face>, Vec<Option<[f32; 3]>>) {
    let (camera, extents) = (state.partial.camera, state.partial.room.extents);
    let room_faces = state.partial.room.faces();
    let mut visible = match bare {
        Some(_) => {
            let all = Mask::from_fn(camera.size, |_, _| true).minus(&state.photo_frame);
            Bare { open: all.clone(), bare: all }
        }
        None => evidence::bare_pixels(state, is_seen),
    };
    // What is seen through a passage is no wall.
    let through = beyond::pixels(&camera, &state.partial.room);
    (visible.open, visible.bare) = (visible.open.minus(&through), visible.bare.minus(&through));
    let source = bare.unwrap_or(&state.photo);
    // One texel size for all faces: they lend each other their materials.
    let longest = extents.as_vec().max_element().max(0.1);
    let px_per_m = finest.min(LONGEST_PX / longest);
    let mut faces: Vec<Face> = Surface::ALL
        .par_iter()
        .map(|surface| Face::seen(source, &camera, &room_faces, *surface, px_per_m, &visible))
        .collect();
    let answer = &state.layout.answer;
    let found = if is_seen { &faces[..] } else { &[] };
    let trims = trim::trims(&answer.trims, found, &extents);
    faces.par_iter_mut().for_each(|face| {
        if is_seen {
            face.without_seams(&camera, &room_faces);
        }
        if face.surface.wall().is_some() {
            // What the boards cover, and their shadow.
            if let Some(board) = trims.skirting {
                face.without_heights(&extents, -1.0, board.height + BOARD_MARGIN);
            }
            if let Some(board) = trims.cornice {
                face.without_heights(&extents, extents.height - board.height - BOARD_MARGIN, f64::INFINITY);
            }
        }
    });
    let sides = niche_sides(source, &camera, &state.partial.room, &visible.bare);
    let surfaces = trim::with_frieze(&answer.surfaces, &answer.trims, &extents);
    (paint::paint(&faces, &surfaces, &state.partial.room, is_seen, is_lit), trims, faces, sides)
}

/// Linear colour of each niche's sides, sill and lintel: the middle of the bare pixels that show them.
fn niche_sides(photo: &RgbImage, camera: &Camera, room: &Room, bare: &Mask) -> Vec<Option<[f32; 3]>> {
    let mut seen: Vec<Vec<[u8; 3]>> = vec![Vec::new(); room.shape.niches.len()];
    if !seen.is_empty() {
        let faces = room.faces();
        for (x, y, pixel) in photo.enumerate_pixels().filter(|(x, y, _)| bare.get(i64::from(*x), i64::from(*y))) {
            let ray = camera.ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            if let Some(k) = faces.exit(&ray).and_then(|e| e.side_of) {
                seen[k].push(pixel.0);
            }
        }
    }
    let middle = |mut pixels: Vec<[u8; 3]>| {
        (pixels.len() >= MIN_SIDE_PX).then(|| {
            pixels.sort_by_key(|p| p.iter().map(|c| u32::from(*c)).sum::<u32>());
            pixels[pixels.len() / 2].map(|c| linear_from_srgb(f32::from(c) / 255.0))
        })
    };
    seen.into_iter().map(middle).collect()
}

/// Pixels that tell the colour of a niche's sides, at least.
const MIN_SIDE_PX: usize = 40;
