//! The room's own surfaces: openings, textures of floor, ceiling and walls, the empty-room picture
//! (key `layout.empty_room`).

mod beyond;
mod edited;
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
use harmony_scene::{Camera, Extents, Level, Mask, Room, Surface};
use image::{DynamicImage, RgbImage};
use rayon::prelude::*;
use serde_json::json;

pub use beyond::{Beyond, beyond, panes};
pub use edited::{EditedRoom, Faces, emptied};
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

/// The room's faces as an image editor completes what its empty room shows of them; none where there is no such room.
///
/// # Errors
/// Fatal role errors.
pub async fn completed(ctx: &PhaseCtx<'_>, state: &Arc<SceneState>) -> Result<Faces, PhaseError> {
    if state.edited.emptied.is_none() {
        return Ok(Faces::new());
    }
    let (seen, finest, is_seen) = (Arc::clone(state), ctx.settings.surface_px_per_m, ctx.is_seen());
    let shown = ctx.computed(move || Shown::of(&seen, finest, is_seen)).await?;
    edited::completed(ctx, &shown.faces, &state.partial.room.extents).await
}

/// Makes the textures of all faces, the boards along the walls and the empty-room picture.
///
/// The photo's bare pixels are projected onto the faces and, where an image editor draws, those of its empty room
/// elsewhere, as in the paper. Each face becomes a material that goes on where nothing was seen, the editor's where it
/// completed the face.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn all(ctx: &PhaseCtx<'_>, state: &mut SceneState) -> Result<(), PhaseError> {
    let seen = state.clone();
    let (finest, is_seen, is_lit) = (ctx.settings.surface_px_per_m, ctx.is_seen(), ctx.path_tracer);
    let (painted, trims, faces, sides) = ctx.computed(move || painted(&seen, finest, is_seen, is_lit)).await?;
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

/// What is seen of the faces, and the boards along the walls.
struct Shown {
    faces: Vec<Face>,
    trims: Trims,
    /// What shows the bare room, and which of its pixels do.
    source: Arc<RgbImage>,
    visible: Bare,
}

impl Shown {
    /// Where nobody looked at the photo (`is_seen`), its things are paint on the faces: no board is read from them, and no edge
    /// is cleaned that runs through them. Before anything is found, an editor's empty room is all that shows the room.
    fn of(state: &SceneState, finest: f64, is_seen: bool) -> Self {
        let (camera, extents) = (state.partial.camera, state.partial.room.extents);
        let room_faces = state.partial.room.faces();
        let (source, mut visible) = match &state.edited.emptied {
            Some(emptied) => {
                let all = Mask::from_fn(camera.size, |_, _| true).minus(&state.photo_frame);
                let source = if state.objects.is_empty() {
                    Arc::clone(emptied)
                } else {
                    let bare = evidence::bare_pixels(state, is_seen).bare;
                    Arc::new(edited::put_together(&state.photo, emptied, &bare))
                };
                (source, Bare { open: all.clone(), bare: all })
            }
            None => (Arc::clone(&state.photo), evidence::bare_pixels(state, is_seen)),
        };
        // What is seen through a passage is no wall.
        let through = beyond::pixels(&camera, &state.partial.room);
        (visible.open, visible.bare) = (visible.open.minus(&through), visible.bare.minus(&through));
        // One texel size for all faces: they lend each other their materials.
        let longest = extents.as_vec().max_element().max(0.1);
        let px_per_m = finest.min(LONGEST_PX / longest);
        let mut faces: Vec<Face> = Surface::ALL
            .par_iter()
            .map(|surface| Face::seen(&source, &camera, &room_faces, *surface, px_per_m, &visible))
            .collect();
        let found = if is_seen { &faces[..] } else { &[] };
        let trims = trim::trims(&state.layout.answer.trims, found, &extents);
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
        Self { faces, trims, source, visible }
    }
}

/// All faces in their materials, the boards along the walls and the colours of niches' sides. `is_lit`: the path tracer will
/// light them.
fn painted(
    state: &SceneState,
    finest: f64,
    is_seen: bool,
    is_lit: bool,
) -> (Painted, Trims, Vec<Face>, Vec<Option<[f32; 3]>>) {
    let room = &state.partial.room;
    let Shown { faces, trims, source, visible } = Shown::of(state, finest, is_seen);
    let sides = niche_sides(&source, &state.partial.camera, room, &visible.bare);
    let answer = &state.layout.answer;
    let surfaces = trim::with_frieze(&answer.surfaces, &answer.trims, &room.extents);
    let mut painted = paint::paint(&faces, &surfaces, room, is_seen, is_lit);
    for face in &faces {
        let Some(edited) = state.edited.faces.get(&face.surface) else { continue };
        for textures in [&mut painted.textures, &mut painted.even] {
            if let Some(own) = textures.get_mut(&face.surface) {
                edited::over_unseen(own, &face.texture, edited, face.px_per_m);
            }
        }
    }
    (painted, trims, faces, sides)
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
