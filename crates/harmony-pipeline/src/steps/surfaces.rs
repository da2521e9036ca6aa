//! The room's own surfaces: openings, textures of floor, ceiling and walls, the empty-room picture.

use std::sync::Arc;

use harmony_imaging::rectify::{SurfaceRect, surface_texture};
use harmony_imaging::tile::{TextureSettings, complete_surface};
use harmony_mesh::template_name;
use harmony_roles::{EditKind, EditRequest, Role};
use harmony_scene::{Level, Mask, Opening, OpeningKind, Support, Surface};
use image::{DynamicImage, RgbImage, RgbaImage};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::SceneState;
use crate::views;

/// Holes that the placed windows and doors cut into the walls.
pub fn openings(state: &SceneState) -> Vec<Opening> {
    let e = state.partial.room.extents;
    state
        .partial
        .placed
        .iter()
        .filter_map(|p| {
            let kind = match template_name(&p.item.label) {
                Some("window") => OpeningKind::Window,
                Some("door") => OpeningKind::Door,
                _ => return None,
            };
            let Support::Wall { wall } = p.support else { return None };
            let size = p.size();
            let at = wall.coordinates(p.pose.position);
            // The frame covers the wall's edge all around.
            let inset = 0.03_f64.min(size.width * 0.1);
            let u = [
                (at.x - size.width / 2.0 + inset).max(0.02),
                (at.x + size.width / 2.0 - inset).min(wall.length(&e) - 0.02),
            ];
            let y0 = if kind == OpeningKind::Door { 0.0 } else { (at.y + inset).max(0.02) };
            let y = [y0, (at.y + size.height - inset).min(e.height - 0.02)];
            (u[1] - u[0] > 0.1 && y[1] - y[0] > 0.1).then(|| Opening {
                kind,
                wall,
                u,
                y,
                object: Some(p.item.id.clone()),
            })
        })
        .collect()
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
    if !ctx.played_outside(Role::ImageEditor) {
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

/// Makes the textures of all faces and the empty-room picture.
///
/// With an image editor that draws, the paper's way: its empty room (`bare`) is projected onto the faces. Otherwise
/// the photo's bare pixels are, and each face is completed in its own plane, where the texture has no perspective.
///
/// # Errors
/// Fatal role errors and unwritable files.
pub async fn all(ctx: &PhaseCtx<'_>, state: &mut SceneState, bare: Option<Arc<RgbImage>>) -> Result<(), PhaseError> {
    let size = state.partial.camera.size;
    let (source, visible) = if let Some(bare) = bare {
        (bare, Mask::from_fn(size, |_, _| true))
    } else {
        let objects = with_margin(state, &state.all_objects());
        (state.photo.clone(), Mask::from_fn(size, |_, _| true).minus(&objects))
    };
    let camera = state.partial.camera;
    let extents = state.partial.room.extents;
    let px_per_m = ctx.settings.surface_px_per_m;
    let textures = tokio::task::spawn_blocking(move || {
        use rayon::prelude::*;
        let complete = |surface: &Surface| {
            let surface = *surface;
            let longest = surface.size(&extents).max_element();
            let px_per_m = px_per_m.min(1536.0 / longest.max(0.1));
            let rect = SurfaceRect::whole(surface, &extents);
            let seen = surface_texture(&source, &camera, &extents, &rect, px_per_m, &visible);
            let observed = seen.pixels().filter(|p| p.0[3] > 127).count();
            (surface, observed, complete_surface(&seen, &TextureSettings::default()))
        };
        Surface::ALL.par_iter().map(complete).collect::<Vec<_>>()
    })
    .await
    .map_err(|e| PhaseError::internal(ctx.phase, &e))?;
    // A wall that is not seen at all takes the look of a seen one; a ceiling without pixels is plain.
    let donor = textures
        .iter()
        .filter(|(s, _, _)| s.wall().is_some())
        .max_by_key(|(_, observed, _)| *observed)
        .map(|(_, _, image)| mean_color(image));
    for (surface, observed, image) in textures {
        let image = match (observed, surface.wall(), donor) {
            (0..64, Some(_), Some(color)) => plain(color),
            (0..64, None, Some(color)) if surface == Surface::Ceiling => {
                plain(color.map(|c| c.saturating_add((255 - c) / 2)))
            }
            _ => image,
        };
        let folder = format!("textures/{}.png", surface.name());
        let opaque = DynamicImage::ImageRgba8(image.clone()).to_rgb8();
        ctx.write_picture_in("1_layout", &folder, &opaque)?;
        state.surfaces.insert(surface, Arc::new(image));
    }
    let empty = views::empty_room(state);
    ctx.write_picture_in("1_layout", "empty_room.png", &empty)?;
    debug_assert!(state.partial.placed.iter().all(|p| p.item.level <= Level::Decoration));
    Ok(())
}

fn plain(color: [u8; 3]) -> RgbaImage {
    RgbaImage::from_pixel(16, 16, image::Rgba([color[0], color[1], color[2], 255]))
}

fn mean_color(image: &RgbaImage) -> [u8; 3] {
    let n = f64::from(image.width()) * f64::from(image.height());
    let mut sum = [0.0; 3];
    for p in image.pixels() {
        for (s, v) in sum.iter_mut().zip(p.0) {
            *s += f64::from(v);
        }
    }
    sum.map(|s| (s / n.max(1.0)).round() as u8)
}
