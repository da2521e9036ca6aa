//! Textures for part models from the object's own pixels (beyond the paper).
//!
//! Every texel of the unwrap knows its surface point. What it looks like by its slot's material (colour or metric tile),
//! in the robust mean colour that the photo shows of the slot, is the base. The photo adds to it where the point is seen
//! squarely, sharply, well inside the object's mask and away from the model's own edges, and where the pixel's colour is
//! plausible for the slot ([`plausible`]). Elsewhere the light that was observed nearby is added to the base, on faces that
//! point the same way if possible, and the fine texture of the best observed patch; a slot with a pattern is completed
//! from the photo's mirror image in the object's plane of symmetry, where what is seen on both sides of it agrees. The
//! gaps of large patterned faces (rugs, table tops) are filled from the face itself, by its lattice or by patches.

mod base;
mod exemplar;
mod fill;
mod lattice;
mod plausible;
mod pyramid;
mod symmetry;
mod texels;
mod view;

use std::sync::Arc;

use harmony_mesh::{Material, Mesh};
use harmony_scene::{Camera, Mask, Pose};
use image::{RgbImage, RgbaImage};
use rayon::prelude::*;

use base::Base;
use texels::Texel;
use view::View;

use crate::{SOLID, opacity};

/// How to bake.
#[derive(Debug, Clone, PartialEq)]
pub struct BakeOptions {
    /// Slots (material names) that keep their colour.
    pub plain_slots: Vec<String>,
    /// Pixels by which the mask is shrunk before colours are taken from it.
    pub erode_px: i32,
    /// Smallest cosine between surface normal and view at which a texel is taken from the photo.
    pub min_cosine: f64,
    /// Whether the whole mask is surely the object's and every colour in it plausible: pictures, panes with a view.
    pub trusted: bool,
    /// Texture side in pixels; 0 chooses 256 to 1536 from the object's size in the photo and the room that its unwrap has.
    pub texture_size: u32,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self { plain_slots: Vec::new(), erode_px: 2, min_cosine: 0.12, trusted: false, texture_size: 0 }
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

/// Least difference, in any channel, of a slot's observed colour from the model's that recolours a slot which is not baked;
/// sRGB steps.
const FAR_OFF: f32 = 40.0;
/// Least photo pixels that give a colour to a slot that is baked.
const SEEN_A_LITTLE: usize = 12;
/// Least photo pixels for a slot that is not.
const SEEN_ENOUGH: usize = 60;
/// A slot with a tile of which less than this share is seen keeps it, which is sharper than any bake.
const HARDLY_SEEN: f64 = 0.03;

/// Share of a slot that must be seen for its fine texture to be found elsewhere on it.
const SEEN_TEXTURE: f64 = 0.05;

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
    let mut side = texture_side(visible, options);
    let mut texels = texels::surface(mesh, side, &options.plain_slots);
    let mut bases = base::of(mesh);
    let named: Vec<[f32; 3]> = bases.iter().map(Base::named).collect();
    let view = View::new(mesh, pose, camera, photo, visible, options, &named);
    if options.texture_size == 0
        && let Some(view) = &view
    {
        let finer = side_for(side, view.pixels_a_texel(&texels));
        if finer > side {
            side = finer;
            texels = texels::surface(mesh, side, &options.plain_slots);
        }
    }
    let colors = medians(mesh, &named, view.as_ref());
    if let Some(view) = &view {
        texels.par_iter_mut().for_each(|t| look(t, view));
    }
    let seen = texels.iter().filter(|t| t.direct).count();
    let mut of_slot = vec![(0_usize, 0_usize); bases.len()];
    for texel in &texels {
        of_slot[texel.slot].0 += usize::from(texel.direct);
        of_slot[texel.slot].1 += 1;
    }
    for (slot, base) in bases.iter_mut().enumerate() {
        let own: Vec<&Texel> = texels.iter().filter(|t| t.slot == slot && t.direct).collect();
        let seen = &colors[slot];
        if !base.meet(&own) && seen.pixels >= SEEN_A_LITTLE && base.off(seen.rgb) >= FAR_OFF {
            base.take(seen.rgb);
        }
    }
    // A window, a picture: what they show in one place is not what they show in another.
    let has_texture = |slot: usize| {
        let (direct, all) = of_slot[slot];
        !options.trusted && direct as f64 >= SEEN_TEXTURE * all as f64
    };
    let mut made_up = fill::made_up(&texels, mesh, &bases, side as usize, has_texture);
    let done = exemplar::improve(&mut made_up, &texels, &bases, side as usize);
    if let Some(view) = &view {
        symmetry::complete(&mut texels, &made_up, &bases, &done, view);
    }
    fill::blend(&mut texels, &made_up);
    let texture = Arc::new(paint(&texels, side));
    let mut mesh = mesh.clone();
    for (slot, material) in mesh.materials.iter_mut().enumerate() {
        let (direct, all) = of_slot[slot];
        let keeps = options.plain_slots.contains(&material.name);
        if keeps {
            // It was said how it looks.
        } else if bases[slot].is_tiled() && (direct as f64) < HARDLY_SEEN * all as f64 {
            recolour(material, &bases[slot], &colors[slot]);
        } else {
            material.texture = Some(Arc::clone(&texture));
            material.base_color = [1.0, 1.0, 1.0, material.base_color[3]];
        }
    }
    BakedMesh { mesh, observed: seen as f64 / texels.len().max(1) as f64, colors }
}

/// Gives a slot that is hardly seen the colour that was observed, when the model's is far off. What one sees through,
/// in or what shines has no colour of its own in a photo.
fn recolour(material: &mut Material, base: &Base, seen: &SlotColour) {
    let dull = opacity(material) >= SOLID && material.metallic < 0.5 && material.emissive.iter().all(|e| *e <= 0.0);
    if !dull || seen.pixels < SEEN_ENOUGH || base.off(seen.rgb) < FAR_OFF {
        return;
    }
    let mean = base.linear();
    for ((value, mean), rgb) in material.base_color.iter_mut().zip(mean).zip(seen.rgb) {
        let wanted = base::linear(f32::from(rgb));
        // Through a tile only a factor is to be had.
        let factor = ((wanted + 0.002) / (mean + 0.002)).clamp(0.1, 10.0);
        *value = if base.is_tiled() { (*value * factor).min(1.0) } else { wanted };
    }
}

/// Linear mean colour of each material, by colour and pattern.
pub(crate) fn mean_color(mesh: &Mesh) -> Vec<[f32; 3]> {
    base::of(mesh).iter().map(Base::linear).collect()
}

/// Takes the photo's colour of a texel.
fn look(texel: &mut Texel, view: &View) {
    if let Some(sight) = view.color(texel, [1.0; 3]) {
        texel.color = Some(sight.color);
        texel.weight = (sight.cosine * sight.cosine) as f32;
        texel.share = sight.share;
        texel.direct = true;
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

/// Sides that a texture gets where the photo shows more than the usual one holds.
const FINER_SIDES: [u32; 6] = [384, 512, 768, 1024, 1280, 1536];
/// Photo pixels a texel along a side from which the texture is too coarse.
const TOO_COARSE: f64 = 1.25;

/// The side at which a texel is about a pixel of the photo: unwraps of things of many parts have little room for each.
fn side_for(side: u32, pixels_a_texel: f64) -> u32 {
    if pixels_a_texel <= TOO_COARSE {
        return side;
    }
    let wanted = f64::from(side) * pixels_a_texel;
    let last = FINER_SIDES[FINER_SIDES.len() - 1];
    FINER_SIDES.into_iter().find(|s| f64::from(*s) >= wanted).unwrap_or(last).max(side)
}

fn medians(mesh: &Mesh, named: &[[f32; 3]], view: Option<&View>) -> Vec<SlotColour> {
    let mut channels: Vec<[Vec<u8>; 3]> = vec![Default::default(); mesh.materials.len()];
    if let Some(view) = view {
        view.collect(&mut channels);
    }
    mesh.materials
        .iter()
        .zip(named)
        .zip(channels)
        .map(|((material, own), channels)| {
            let pixels = channels[0].len();
            let own = own.map(|c| c.round().clamp(0.0, 255.0) as u8);
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
