//! The photo: upright sRGB, EXIF focal length, and what was unusual about it.

mod container;
mod exif;

use std::io::Cursor;
use std::path::Path;

use harmony_resample::{Filter, Window, resize_rgb};
use harmony_scene::{ImageSize, Warning, WarningKind};
use image::{ColorType, DynamicImage, ImageDecoder, ImageReader, Limits, RgbImage};

use crate::atomic::{FileError, read_bounded};
use crate::picture::{MAX_DECODE_BYTES, MAX_IMAGE_BYTES, MAX_PIXELS};

/// Longest side of the working image, pixels; larger photos are scaled down.
pub const MAX_WORKING_SIDE: u32 = 4096;
/// Shortest side that is accepted at all, pixels.
pub const MIN_SIDE: u32 = 16;
/// Longest side below which a photo is called small, pixels.
const SMALL_SIDE: u32 = 512;
/// Side ratio from which a photo is called a panorama (a 16:9 or 2:1 frame is none).
const PANORAMA_RATIO: f64 = 2.2;

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
    /// The image is broken.
    #[error("the {format} image is damaged: {source}")]
    Damaged {
        /// Format by content.
        format: &'static str,
        /// What the decoder says.
        source: image::ImageError,
    },
    /// The image ends before its last pixel.
    #[error("the {format} image is cut off after {bytes} bytes")]
    Truncated {
        /// Format by content.
        format: &'static str,
        /// Bytes that are there.
        bytes: usize,
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

impl PhotoError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Empty | Self::Truncated { .. } => Some("copy or download the photo again, the file is not whole"),
            Self::UnknownFormat { .. } => Some("give a photo as JPEG, PNG, WebP, BMP, TIFF or PNM"),
            Self::UnsupportedFormat { .. } => Some("convert it to JPEG or PNG first"),
            Self::Damaged { .. } => Some("open the photo in an image program and save it again as JPEG or PNG"),
            Self::TooSmall { .. } => Some("give the photo in a larger size"),
            Self::TooLarge { .. } => Some("scale the photo down first; 4096 pixels on the longer side are enough"),
        }
    }
}

/// Reads a photo.
///
/// # Errors
/// [`PhotoError`], each with a [`PhotoError::hint`].
pub fn load_photo(path: &Path) -> Result<Photo, PhotoError> {
    photo_from_bytes(read_bounded(path, MAX_IMAGE_BYTES)?)
}

/// Decodes a photo: whatever the bytes are, the result is a photo or an error, never a panic, and memory is bounded by
/// [`MAX_PIXELS`] and [`MAX_DECODE_BYTES`].
///
/// # Errors
/// [`PhotoError`].
pub fn photo_from_bytes(bytes: Vec<u8>) -> Result<Photo, PhotoError> {
    let format = container::sniff(&bytes)?;
    let damaged = |source| PhotoError::Damaged { format: format.name, source };
    if !container::is_whole(&bytes, format) {
        return Err(PhotoError::Truncated { format: format.name, bytes: bytes.len() });
    }
    let mut reader = ImageReader::with_format(Cursor::new(&bytes), format.kind);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| too_large_or(&bytes, format, e))?;
    let (width, height) = decoder.dimensions();
    check_size(width, height)?;
    let decoded_type = decoder.color_type();
    let stored_type = decoder.original_color_type();
    let mut picture = DynamicImage::from_decoder(decoder).map_err(damaged)?;

    let mut notes = Notes::default();
    notes.about_pixels(&bytes, format, decoded_type, stored_type);
    let facts = exif::read(&bytes);
    if facts.orientation != 1 {
        if let Some(orientation) = image::metadata::Orientation::from_exif(facts.orientation) {
            picture.apply_orientation(orientation);
        }
        notes.add(format!(
            "the camera was held turned (EXIF orientation {}); the photo was turned upright",
            facts.orientation
        ));
    }
    let original_size = ImageSize::new(picture.width(), picture.height());
    let image = notes.flatten(picture);
    let image = shrink(image, &mut notes);
    notes.about_shape(original_size);
    notes.about_content(&image);
    let size = ImageSize::new(image.width(), image.height());
    let focal = facts.focal_px(original_size, &mut |text| notes.add(text));
    let shrunk = f64::from(size.width) / f64::from(original_size.width);
    Ok(Photo {
        image,
        bytes,
        extension: format.extension,
        original_size,
        orientation: facts.orientation,
        focal_px: focal.as_ref().map(|f| f.pixels * shrunk),
        focal_source: focal.map(|f| f.source),
        warnings: notes.0,
    })
}

fn check_size(width: u32, height: u32) -> Result<(), PhotoError> {
    if width < MIN_SIDE || height < MIN_SIDE {
        return Err(PhotoError::TooSmall { width, height, min: MIN_SIDE });
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(PhotoError::TooLarge { width, height, limit: MAX_PIXELS });
    }
    Ok(())
}

/// A decoder that refuses for size says so in our words.
fn too_large_or(bytes: &[u8], format: container::Format, source: image::ImageError) -> PhotoError {
    if let image::ImageError::Limits(_) = source {
        let size = ImageReader::with_format(Cursor::new(bytes), format.kind).into_dimensions();
        if let Ok((width, height)) = size {
            return PhotoError::TooLarge { width, height, limit: MAX_PIXELS };
        }
    }
    PhotoError::Damaged { format: format.name, source }
}

fn shrink(image: RgbImage, notes: &mut Notes) -> RgbImage {
    let from = ImageSize::new(image.width(), image.height());
    let to = from.fit_within(MAX_WORKING_SIDE);
    if to == from {
        return image;
    }
    notes.add(format!(
        "the photo has {} x {} pixels; it is worked on at {} x {}",
        from.width, from.height, to.width, to.height
    ));
    // Lanczos in sRGB values: as photo programs do it.
    let whole = Window::whole(image.dimensions());
    let small = resize_rgb(&image, whole, (to.width, to.height), Filter::Lanczos3);
    // Cannot fail for an RGB image with pixels; the slower filter is a safe answer all the same.
    small.unwrap_or_else(|| DynamicImage::ImageRgb8(image).thumbnail_exact(to.width, to.height).into_rgb8())
}

/// Collects what was unusual.
#[derive(Debug, Default)]
struct Notes(Vec<Warning>);

impl Notes {
    fn add(&mut self, message: String) {
        self.0.push(Warning { phase: "input".to_owned(), object: None, kind: WarningKind::Input, message });
    }

    fn about_pixels(
        &mut self,
        bytes: &[u8],
        format: container::Format,
        decoded: ColorType,
        stored: image::ExtendedColorType,
    ) {
        let channels = u16::from(decoded.channel_count());
        let bits = decoded.bits_per_pixel() / channels.max(1);
        if bits > 8 {
            self.add(format!("the photo has {bits} bits a channel; it is worked on with 8"));
        }
        if container::jpeg_components(bytes, format) == Some(4) || stored == image::ExtendedColorType::Cmyk8 {
            self.add(
                "the photo is CMYK (made for print); it was converted to RGB without its colour profile".to_owned(),
            );
        }
        if !decoded.has_color() {
            self.add("the photo is greyscale: colours of materials cannot be seen".to_owned());
        }
    }

    /// RGB over white.
    fn flatten(&mut self, picture: DynamicImage) -> RgbImage {
        if !picture.color().has_alpha() {
            return picture.into_rgb8();
        }
        let rgba = picture.into_rgba8();
        let clear = rgba.pixels().filter(|p| p.0[3] < 255).count();
        if clear > 0 {
            let share = clear as f64 / rgba.len().max(4) as f64 * 4.0 * 100.0;
            self.add(format!("{share:.1} % of the photo is transparent; it was laid over white"));
        }
        let mut rgb = RgbImage::new(rgba.width(), rgba.height());
        for (to, from) in rgb.pixels_mut().zip(rgba.pixels()) {
            let [r, g, b, a] = from.0.map(u32::from);
            let over = |c: u32| ((c * a + 255 * (255 - a) + 127) / 255) as u8;
            to.0 = [over(r), over(g), over(b)];
        }
        rgb
    }

    fn about_shape(&mut self, size: ImageSize) {
        let (long, short) = (size.width.max(size.height), size.width.min(size.height));
        if long < SMALL_SIDE {
            self.add(format!(
                "the photo is small ({} x {} pixels): small objects and exact places cannot be expected",
                size.width, size.height
            ));
        }
        let ratio = f64::from(long) / f64::from(short.max(1));
        if ratio >= PANORAMA_RATIO {
            self.add(format!(
                "the photo's sides are {ratio:.1} to 1, like a panorama's; a pinhole camera is assumed all the same"
            ));
        }
    }

    fn about_content(&mut self, image: &RgbImage) {
        let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
        let step = (image.as_raw().len() / 3 / 200_000).max(1);
        for p in image.pixels().step_by(step) {
            let y = p.0.iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0;
            n += 1.0;
            sum += y;
            squares += y * y;
        }
        let mean: f64 = sum / f64::max(n, 1.0);
        let deviation = (squares / f64::max(n, 1.0) - mean * mean).max(0.0).sqrt();
        if deviation < 3.0 {
            self.add("the photo is almost one even colour: nothing can be recognised in it".to_owned());
        } else if mean < 20.0 {
            self.add(format!("the photo is very dark (mean {mean:.0} of 255): much of the room cannot be seen"));
        }
    }
}

#[cfg(test)]
mod tests;
