//! Textures for part models from the object's own pixels (DESIGN section 7).
//!
//! Every texel of the unwrap knows its surface point. A point that the camera sees, inside the object's mask, takes the
//! photo's colour. The others are completed: first from the photo again, where the camera sees the point's mirror image
//! in the object's plane of symmetry (x = 0, then z = 0, then both); else from what was observed of the same slot
//! nearby, on faces that point the same way if possible, with the fine texture of the best observed patch; last from
//! the slot's own colour. The gaps of large patterned faces (rugs, table tops) are filled from the face itself by
//! patches.

mod exemplar;
mod fill;
mod lattice;
mod pyramid;
mod texels;
mod view;

use std::sync::Arc;

use harmony_mesh::Mesh;
use harmony_scene::{Camera, Mask, Pose};
use image::{RgbImage, RgbaImage};
use rayon::prelude::*;

use texels::Texel;
use view::View;

/// How to bake.
#[derive(Debug, Clone, PartialEq)]
pub struct BakeOptions {
    /// Slots (material names) that keep their colour.
    pub plain_slots: Vec<String>,
    /// Pixels by which the mask is shrunk before colours are taken from it.
    pub erode_px: i32,
    /// Smallest cosine between surface normal and view at which a texel is taken from the photo.
    pub min_cosine: f64,
    /// Texture side in pixels; 0 chooses 256 to 1024 from the object's size in the photo.
    pub texture_size: u32,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self { plain_slots: Vec::new(), erode_px: 2, min_cosine: 0.12, texture_size: 0 }
    }
}

/// A mesh with its texture, and how much of it was seen.
#[derive(Debug, Clone)]
pub struct BakedMesh {
    /// The mesh; its photo slots share one texture.
    pub mesh: Mesh,
    /// Share of the photo slots' texels that were taken from the photo, 0 to 1.
    pub observed: f64,
    /// sRGB colour of each slot (by name): median of its observed pixels, else its own colour.
    pub colors: Vec<SlotColour>,
}

/// Median colour of a slot in the photo.
#[derive(Debug, Clone, PartialEq)]
pub struct SlotColour {
    /// Slot name.
    pub slot: String,
    /// sRGB.
    pub rgb: [u8; 3],
    /// Photo pixels it was taken from (0: nothing was seen, the colour is the mesh's own).
    pub pixels: usize,
}

/// Reflections that are tried in turn for a point that is not seen itself.
const MIRRORS: [[f32; 3]; 3] = [[-1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]];

/// Weight of a mirrored colour in the means, relative to one seen at its place.
const MIRROR_WEIGHT: f32 = 0.25;

/// Puts the photo's pixels on the mesh and completes what was not seen.
///
/// `mesh` is in its canonical frame with a unique unwrap, `pose` carries it into the room, `visible` holds the photo
/// pixels that belong to this object. When sizes of photo, mask and camera differ nothing counts as seen.
pub fn bake_texture(
    mesh: &Mesh,
    pose: &Pose,
    camera: &Camera,
    photo: &RgbImage,
    visible: &Mask,
    options: &BakeOptions,
) -> BakedMesh {
    let side = texture_side(visible, options);
    let mut texels = texels::surface(mesh, side, &options.plain_slots);
    let view = View::new(mesh, pose, camera, photo, visible, options);
    let colors = medians(mesh, view.as_ref());
    let mut seen = 0;
    if let Some(view) = &view {
        texels.par_iter_mut().for_each(|t| look(t, view));
        seen = texels.iter().filter(|t| t.direct).count();
    }
    let mut made_up = fill::made_up(&texels, mesh, &colors, side as usize);
    exemplar::improve(&mut made_up, &texels, side as usize);
    fill::blend(&mut texels, &made_up);
    let texture = Arc::new(paint(&texels, side));
    let mut mesh = mesh.clone();
    for material in &mut mesh.materials {
        if !options.plain_slots.contains(&material.name) {
            material.texture = Some(Arc::clone(&texture));
            material.base_color = [1.0, 1.0, 1.0, material.base_color[3]];
        }
    }
    BakedMesh { mesh, observed: seen as f64 / texels.len().max(1) as f64, colors }
}

/// Median photo colour of each slot as visible in the pose, to recolour a part model without baking.
pub fn slot_colors(
    mesh: &Mesh,
    pose: &Pose,
    camera: &Camera,
    photo: &RgbImage,
    visible: &Mask,
    options: &BakeOptions,
) -> Vec<SlotColour> {
    medians(mesh, View::new(mesh, pose, camera, photo, visible, options).as_ref())
}

/// Takes the photo's colour of a texel, or of its mirror image.
fn look(texel: &mut Texel, view: &View) {
    if let Some(sight) = view.color(texel, [1.0; 3]) {
        texel.color = Some(sight.color);
        texel.weight = (sight.cosine * sight.cosine) as f32;
        texel.share = sight.share;
        texel.direct = true;
        return;
    }
    for mirror in MIRRORS {
        if let Some(sight) = view.color(texel, mirror) {
            texel.color = Some(sight.color);
            texel.weight = MIRROR_WEIGHT * (sight.cosine * sight.cosine) as f32;
            texel.share = sight.share;
            return;
        }
    }
}

fn texture_side(visible: &Mask, options: &BakeOptions) -> u32 {
    if options.texture_size > 0 {
        return options.texture_size.clamp(16, 4096);
    }
    // the unwrap fills about 0.7 of the square, and the photo shows about a third of the surface
    let wanted = (visible.count() as f64).sqrt() * 2.2;
    [256, 384, 512, 768, 1024].into_iter().find(|s| f64::from(*s) >= wanted).unwrap_or(1024)
}

fn medians(mesh: &Mesh, view: Option<&View>) -> Vec<SlotColour> {
    let mut channels: Vec<[Vec<u8>; 3]> = vec![Default::default(); mesh.materials.len()];
    if let Some(view) = view {
        view.collect(&mut channels);
    }
    mesh.materials
        .iter()
        .zip(channels)
        .map(|(material, channels)| {
            let pixels = channels[0].len();
            let own = [0, 1, 2].map(|k| crate::srgb::tables().encode(material.base_color[k]));
            let median = |mut values: Vec<u8>| {
                let middle = values.len() / 2;
                *values.select_nth_unstable(middle).1
            };
            let rgb = if pixels == 0 { own } else { channels.map(median) };
            SlotColour { slot: material.name.clone(), rgb, pixels }
        })
        .collect()
}

/// Writes the texels; everything between the charts continues their colours, so that no filter draws in a seam.
fn paint(texels: &[Texel], side: u32) -> RgbaImage {
    let mut colors = vec![None; (side * side) as usize];
    for texel in texels {
        colors[texel.at] = texel.color;
    }
    pyramid::fill(&colors, side as usize)
}

#[cfg(test)]
mod tests;
