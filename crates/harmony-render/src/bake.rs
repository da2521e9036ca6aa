//! Textures for part models from the object's own pixels.

use harmony_mesh::Mesh;
use harmony_scene::{Camera, Mask, Pose};
use image::RgbImage;

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
        Self { plain_slots: Vec::new(), erode_px: 2, min_cosine: 0.2, texture_size: 0 }
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

/// Puts the photo's pixels on the mesh and completes what was not seen.
///
/// `mesh` is in its canonical frame with a unique unwrap, `pose` carries it into the room, `visible` holds the photo
/// pixels that belong to this object.
pub fn bake_texture(
    mesh: &Mesh,
    pose: &Pose,
    camera: &Camera,
    photo: &RgbImage,
    visible: &Mask,
    options: &BakeOptions,
) -> BakedMesh {
    let colors = slot_colors(mesh, pose, camera, photo, visible, options);
    BakedMesh { mesh: mesh.clone(), observed: 0.0, colors }
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
    let _ = (mesh, pose, camera, photo, visible, options);
    Vec::new()
}
