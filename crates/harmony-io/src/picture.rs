//! PNG and JPEG, encoded deterministically and decoded within limits.

use std::io::Cursor;
use std::path::Path;

use harmony_scene::ImageSize;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageReader, Limits, RgbImage, RgbaImage};

use crate::atomic::{FileError, read_bounded, write_atomic};

/// Largest image file that is read, bytes.
pub const MAX_IMAGE_BYTES: u64 = 512 << 20;
/// Most pixels of an image that is decoded (a 100 megapixel camera passes).
pub const MAX_PIXELS: u64 = 160_000_000;
/// Most memory that decoding one image may take, bytes.
pub const MAX_DECODE_BYTES: u64 = 2 << 30;

/// A picture could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The image is larger than what is decoded.
    #[error("{width} x {height} pixels are more than the {limit} that are decoded at most")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Most pixels.
        limit: u64,
    },
    /// The bytes are not an image, or a broken one.
    #[error("not a readable image: {0}")]
    Decode(#[source] image::ImageError),
    /// The image could not be encoded.
    #[error("cannot encode the image: {0}")]
    Encode(#[source] image::ImageError),
}

impl PictureError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::TooLarge { .. } => Some("scale the image down first"),
            Self::Decode(_) => Some("check that the file is a whole PNG, JPEG, WebP, BMP, TIFF or PNM image"),
            Self::Encode(_) => None,
        }
    }
}

/// Decodes an image of any supported format, whatever its name says, within limits.
///
/// # Errors
/// [`PictureError::TooLarge`] or [`PictureError::Decode`].
pub fn decode(bytes: &[u8]) -> Result<DynamicImage, PictureError> {
    let io = |e: std::io::Error| PictureError::Decode(image::ImageError::IoError(e));
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(io)?;
    let (width, height) = reader.into_dimensions().map_err(PictureError::Decode)?;
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(PictureError::TooLarge { width, height, limit: MAX_PIXELS });
    }
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(io)?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits);
    reader.decode().map_err(PictureError::Decode)
}

/// Reads and decodes an image file.
///
/// # Errors
/// [`PictureError`].
pub fn read(path: &Path) -> Result<DynamicImage, PictureError> {
    decode(&read_bounded(path, MAX_IMAGE_BYTES)?)
}

fn png(width: u32, height: u32, data: &[u8], color: ExtendedColorType) -> Result<Vec<u8>, PictureError> {
    let mut out = Vec::new();
    // `Fast` with adaptive filters: a third of the time of the best setting for a tenth more bytes.
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(data, width, height, color)
        .map_err(PictureError::Encode)?;
    Ok(out)
}

/// An RGB image as PNG.
///
/// # Errors
/// [`PictureError::Encode`] (an image without pixels).
pub fn rgb_png(image: &RgbImage) -> Result<Vec<u8>, PictureError> {
    png(image.width(), image.height(), image.as_raw(), ExtendedColorType::Rgb8)
}

/// An RGBA image as PNG.
///
/// # Errors
/// [`PictureError::Encode`].
pub fn rgba_png(image: &RgbaImage) -> Result<Vec<u8>, PictureError> {
    png(image.width(), image.height(), image.as_raw(), ExtendedColorType::Rgba8)
}

/// An RGB image as baseline JPEG; `quality` is 1 to 100.
///
/// # Errors
/// [`PictureError::Encode`].
pub fn rgb_jpeg(image: &RgbImage, quality: u8) -> Result<Vec<u8>, PictureError> {
    let mut out = Vec::new();
    JpegEncoder::new_with_quality(&mut out, quality.clamp(1, 100))
        .write_image(image.as_raw(), image.width(), image.height(), ExtendedColorType::Rgb8)
        .map_err(PictureError::Encode)?;
    Ok(out)
}

/// Writes an RGB image as PNG, atomically.
///
/// # Errors
/// [`PictureError`].
pub fn write_rgb_png(path: &Path, image: &RgbImage) -> Result<(), PictureError> {
    Ok(write_atomic(path, &rgb_png(image)?)?)
}

/// Writes an RGBA image as PNG, atomically.
///
/// # Errors
/// [`PictureError`].
pub fn write_rgba_png(path: &Path, image: &RgbaImage) -> Result<(), PictureError> {
    Ok(write_atomic(path, &rgba_png(image)?)?)
}

/// Writes planar depth in metres as 16-bit PNG in millimetres, 0 = nothing (also beyond 65.5 m).
///
/// # Errors
/// [`PictureError`].
pub fn write_depth_png(path: &Path, size: ImageSize, depth: &[f32]) -> Result<(), PictureError> {
    let millimetres = |z: &f32| {
        let mm = (f64::from(*z) * 1000.0).round();
        if mm.is_finite() && (1.0..=65_534.0).contains(&mm) { mm as u16 } else { 0 }
    };
    write_grey16(path, size, depth.iter().map(millimetres))
}

/// Writes one number a pixel as 16-bit grey PNG, 0 for numbers that do not fit.
///
/// # Errors
/// [`PictureError`].
pub fn write_ids_png(path: &Path, size: ImageSize, ids: &[u32]) -> Result<(), PictureError> {
    write_grey16(path, size, ids.iter().map(|id| u16::try_from(*id).unwrap_or(0)))
}

fn write_grey16(path: &Path, size: ImageSize, values: impl Iterator<Item = u16>) -> Result<(), PictureError> {
    let bytes: Vec<u8> = values.flat_map(u16::to_ne_bytes).collect();
    if bytes.len() != size.pixels() * 2 || bytes.is_empty() {
        let kind = image::error::ParameterErrorKind::DimensionMismatch;
        return Err(PictureError::Encode(image::ImageError::Parameter(image::error::ParameterError::from_kind(kind))));
    }
    Ok(write_atomic(path, &png(size.width, size.height, &bytes, ExtendedColorType::L16)?)?)
}
