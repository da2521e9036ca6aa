//! The photo.

use std::path::Path;

use harmony_scene::{ImageSize, Warning};
use image::RgbImage;

use crate::atomic::FileError;

/// Longest side of the working image, pixels; larger photos are scaled down.
pub const MAX_WORKING_SIDE: u32 = 4096;
/// Shortest side that is accepted at all, pixels.
pub const MIN_SIDE: u32 = 16;

/// A photo, upright and ready to work on.
#[derive(Debug, Clone)]
pub struct Photo {
    /// sRGB, 8 bit, upright, longest side at most [`MAX_WORKING_SIDE`].
    pub image: RgbImage,
    /// The file, untouched.
    pub bytes: Vec<u8>,
    /// Extension for the copy in the run folder (by content, not by name): `jpg`, `png`, ...
    pub extension: &'static str,
    /// Size in the file, after turning upright and before any scaling.
    pub original_size: ImageSize,
    /// EXIF orientation that was applied, 1 = none.
    pub orientation: u8,
    /// Focal length in pixels of `image`, when EXIF tells.
    pub focal_px: Option<f64>,
    /// How `focal_px` was derived, in words.
    pub focal_source: Option<String>,
    /// What was unusual (phase `input`).
    pub warnings: Vec<Warning>,
}

impl Photo {
    /// Size of the working image.
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.image.width(), self.image.height())
    }
}

/// The photo cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PhotoError {
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file has no content.
    #[error("the photo is empty (0 bytes)")]
    Empty,
    /// The content is not of a known image format.
    #[error("not an image that can be read: the file starts with {start}")]
    UnknownFormat {
        /// The first bytes, printable.
        start: String,
    },
    /// The format is known and is not read.
    #[error("{format} images are not read")]
    UnsupportedFormat {
        /// Which.
        format: &'static str,
    },
    /// The image is broken or cut off.
    #[error("the {format} image is damaged: {source}")]
    Damaged {
        /// Format by content.
        format: &'static str,
        /// What the decoder says.
        source: image::ImageError,
    },
    /// The image has too few pixels to see a room in.
    #[error("{width} x {height} pixels are too few, at least {min} on each side are needed")]
    TooSmall {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Shortest side accepted.
        min: u32,
    },
    /// The image has too many pixels to decode.
    #[error("{width} x {height} pixels are more than the {limit} that are decoded at most")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Most pixels.
        limit: u64,
    },
}

/// Reads a photo.
///
/// # Errors
/// [`PhotoError`], each with a [`PhotoError::hint`].
pub fn load_photo(path: &Path) -> Result<Photo, PhotoError> {
    let bytes = crate::atomic::read_bounded(path, crate::picture::MAX_IMAGE_BYTES)?;
    photo_from_bytes(bytes)
}

/// Decodes a photo.
///
/// # Errors
/// [`PhotoError`].
pub fn photo_from_bytes(bytes: Vec<u8>) -> Result<Photo, PhotoError> {
    let image =
        image::load_from_memory(&bytes).map_err(|source| PhotoError::Damaged { format: "photo", source })?.to_rgb8();
    let original_size = ImageSize::new(image.width(), image.height());
    Ok(Photo {
        image,
        bytes,
        extension: "jpg",
        original_size,
        orientation: 1,
        focal_px: None,
        focal_source: None,
        warnings: Vec::new(),
    })
}

impl PhotoError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            _ => None,
        }
    }
}
