//! Instance masks: those of others, our own one-bit masks, and the scene's segmentation image (key `data.segmentation`).
//!
//! | source | read as |
//! |---|---|
//! | image with flat colours on black (PNG, or JPEG with smeared edges) | one mask a colour |
//! | 8- or 16-bit grey image with several values | one mask a value, 0 = background |
//! | grey image of black and white, or RGBA cut-out | one mask |
//! | folder of such images | one mask a file |
//!
//! Labels come from `<image>.json` or `labels.json` beside the image or in the folder (`{"chair_01": "chair"}`,
//! `{"#ff0000": "chair"}`, `{"12": null}` to leave one out, or our own `segmentation.json`), else from file names.

mod coded;
mod labels;
mod segmentation;

use std::path::{Path, PathBuf};

use harmony_scene::{ImageSize, Mask};
use image::{DynamicImage, GrayImage, RgbaImage};

use crate::atomic::{FileError, read_bounded, write_atomic};
use crate::picture::{self, MAX_IMAGE_BYTES, PictureError};
pub use segmentation::{Segment, SegmentEntry, SegmentationFile, index_color, save_segmentation};

use labels::Labels;

/// Most files of a folder, and most masks of one image.
pub const MAX_MASKS: usize = 1000;
/// Masks with fewer pixels are left out (of a megapixel image; scaled with the image's area).
const MIN_PIXELS_PER_MEGAPIXEL: f64 = 16.0;
/// Sizes whose shape differs by less belong to the same photo.
const SAME_ASPECT: f64 = 0.01;

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
    /// In a stable order: by file name (numbers by value), or by first pixel in reading order.
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
    #[error("{source}: {path}")]
    Picture {
        /// What is wrong.
        source: PictureError,
        /// Which file.
        path: PathBuf,
    },
    /// A one-bit PNG cannot be encoded.
    #[error("cannot encode the mask: {0}")]
    Encode(#[from] png::EncodingError),
    /// The mask image's shape is not the photo's.
    #[error("the mask image has {width} x {height} pixels, the photo {photo_width} x {photo_height}: {path}")]
    Size {
        /// Mask columns.
        width: u32,
        /// Mask rows.
        height: u32,
        /// Photo columns.
        photo_width: u32,
        /// Photo rows.
        photo_height: u32,
        /// Which file.
        path: PathBuf,
    },
    /// The image is a photo or a drawing, not flat colours.
    #[error("{share:.0} % of the image is not of flat colours, so it is no segmentation: {path}")]
    NotFlat {
        /// Share of pixels that belong to no flat colour, percent.
        share: f64,
        /// Which file.
        path: PathBuf,
    },
    /// Nothing is marked.
    #[error("no mask was found: {path}")]
    None {
        /// Image or folder.
        path: PathBuf,
    },
    /// Too many files or values.
    #[error("{count} masks are more than the {limit} that are read: {path}")]
    TooMany {
        /// Found.
        count: usize,
        /// Limit.
        limit: usize,
        /// Image or folder.
        path: PathBuf,
    },
}

impl MaskError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Picture { source, .. } => source.hint(),
            Self::Encode(_) => None,
            Self::Size { .. } => Some("masks must show the whole photo, upright; their resolution may differ"),
            Self::NotFlat { .. } | Self::None { .. } => {
                Some("give one flat colour per object on black, or a folder with one white-on-black image per object")
            }
            Self::TooMany { .. } => Some("is this the right file or folder?"),
        }
    }
}

/// Reads instance masks from an image or a folder; all come in the photo's size.
///
/// # Errors
/// [`MaskError`], each with a [`MaskError::hint`]. Single files of a folder that are no masks are left out with a note.
pub fn load_masks(path: &Path, photo_size: ImageSize) -> Result<LoadedMasks, MaskError> {
    let mut out = if path.is_dir() { load_folder(path, photo_size)? } else { load_image(path, photo_size)? };
    let smallest = min_pixels(photo_size);
    let notes = &mut out.notes;
    out.masks.retain(|m| {
        let n = m.mask.count();
        let good = n >= smallest && n < photo_size.pixels();
        if !good {
            let why = if n == 0 {
                "is empty"
            } else if n < smallest {
                "is too small"
            } else {
                "covers everything"
            };
            notes.push(format!("mask {} {why} ({n} pixels) and was left out", m.name));
        }
        good
    });
    if out.masks.is_empty() {
        return Err(MaskError::None { path: path.to_owned() });
    }
    Ok(out)
}

fn min_pixels(size: ImageSize) -> usize {
    ((size.pixels() as f64 * MIN_PIXELS_PER_MEGAPIXEL / 1e6).ceil() as usize).max(1)
}

fn decode(path: &Path) -> Result<DynamicImage, MaskError> {
    let bytes = read_bounded(path, MAX_IMAGE_BYTES)?;
    picture::decode(&bytes).map_err(|source| MaskError::Picture { source, path: path.to_owned() })
}

fn check_shape(path: &Path, size: ImageSize, photo: ImageSize) -> Result<(), MaskError> {
    let aspect = |s: ImageSize| f64::from(s.width) / f64::from(s.height);
    if (aspect(size) / aspect(photo)).ln().abs() > SAME_ASPECT {
        return Err(MaskError::Size {
            width: size.width,
            height: size.height,
            photo_width: photo.width,
            photo_height: photo.height,
            path: path.to_owned(),
        });
    }
    Ok(())
}

fn load_image(path: &Path, photo: ImageSize) -> Result<LoadedMasks, MaskError> {
    let picture = decode(path)?;
    let size = ImageSize::new(picture.width(), picture.height());
    check_shape(path, size, photo)?;
    let mut notes = Vec::new();
    let labels = Labels::beside_image(path, &mut notes);
    if size != photo {
        notes.push(format!(
            "the mask image has {} x {} pixels and was resized to the photo's {} x {}",
            size.width, size.height, photo.width, photo.height
        ));
    }
    let mut masks = match meaning(picture) {
        Meaning::One(mask) => {
            let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
            vec![LoadedMask { label: labels::from_stem(&name), name, mask, color: None }]
        }
        Meaning::Ids(ids) => by_id(path, size, &ids)?,
        Meaning::Colors(rgba) => {
            let found = coded::split(&rgba, min_pixels(size))
                .map_err(|share| MaskError::NotFlat { share: share * 100.0, path: path.to_owned() })?;
            notes.extend(found.notes);
            found.masks
        }
    };
    if masks.len() > MAX_MASKS {
        return Err(MaskError::TooMany { count: masks.len(), limit: MAX_MASKS, path: path.to_owned() });
    }
    labels.apply(&mut masks, &mut notes);
    for m in &mut masks {
        m.mask = m.mask.resized(photo);
    }
    Ok(LoadedMasks { masks, notes })
}

/// What an image of masks means.
enum Meaning {
    One(Mask),
    Ids(Vec<u32>),
    Colors(RgbaImage),
}

fn meaning(picture: DynamicImage) -> Meaning {
    let size = ImageSize::new(picture.width(), picture.height());
    match picture {
        DynamicImage::ImageLuma8(grey) => {
            if is_black_and_white(&grey) {
                Meaning::One(mask_of(size, grey.as_raw(), |v| *v > 127))
            } else {
                Meaning::Ids(grey.as_raw().iter().map(|v| u32::from(*v)).collect())
            }
        }
        DynamicImage::ImageLuma16(grey) => {
            let ids: Vec<u32> = grey.as_raw().iter().map(|v| u32::from(*v)).collect();
            if ids.iter().all(|v| matches!(v, 0 | 65_535)) {
                return Meaning::One(mask_of(size, &ids, |v| *v > 0));
            }
            Meaning::Ids(ids)
        }
        other => {
            let rgba = other.into_rgba8();
            let grey = rgba.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
            let opaque = rgba.pixels().all(|p| p.0[3] == 255);
            if !opaque && !coded::is_flat(&rgba) {
                return Meaning::One(mask_of(size, rgba.as_raw().as_chunks::<4>().0, |p| p[3] > 127));
            }
            if grey && opaque {
                let grey = DynamicImage::ImageRgba8(rgba).into_luma8();
                return meaning(DynamicImage::ImageLuma8(grey));
            }
            Meaning::Colors(rgba)
        }
    }
}

fn mask_of<T>(size: ImageSize, values: &[T], on: impl Fn(&T) -> bool) -> Mask {
    let mut mask = Mask::empty(size);
    for (bit, value) in mask.bits_mut().iter_mut().zip(values) {
        *bit = on(value);
    }
    mask
}

/// Both black and white, and little between (soft edges, JPEG noise).
fn is_black_and_white(grey: &GrayImage) -> bool {
    let n = grey.as_raw().len().max(1) as f64;
    let (mut black, mut white) = (0.0, 0.0);
    for v in grey.as_raw() {
        match v {
            0..=31 => black += 1.0,
            224..=255 => white += 1.0,
            _ => {}
        }
    }
    // 1 to 6 as ids are nearly black all the same: without any white it is not black and white.
    (black + white) / n >= 0.97 && (white > 0.0 || black == n && grey.as_raw().iter().all(|v| *v == 0))
}

fn by_id(path: &Path, size: ImageSize, ids: &[u32]) -> Result<Vec<LoadedMask>, MaskError> {
    let mut order: Vec<u32> = Vec::new();
    let mut seen = vec![false; 65_536];
    for id in ids.iter().filter(|id| **id != 0) {
        if !std::mem::replace(&mut seen[*id as usize & 0xffff], true) {
            order.push(*id);
        }
    }
    if order.len() > 255 {
        let (count, limit) = (order.len(), 255);
        return Err(MaskError::TooMany { count, limit, path: path.to_owned() });
    }
    Ok(order
        .into_iter()
        .map(|id| LoadedMask {
            name: format!("id_{id}"),
            label: None,
            mask: mask_of(size, ids, |v| *v == id),
            color: None,
        })
        .collect())
}

fn load_folder(folder: &Path, photo: ImageSize) -> Result<LoadedMasks, MaskError> {
    let fail = |source| FileError::Read { path: folder.to_owned(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if path.is_file() && ["png", "jpg", "jpeg", "webp", "bmp", "tif", "tiff", "pgm"].contains(&extension.as_str()) {
            files.push(path);
        }
    }
    if files.len() > MAX_MASKS {
        return Err(MaskError::TooMany { count: files.len(), limit: MAX_MASKS, path: folder.to_owned() });
    }
    files.sort_by_cached_key(|p| natural(&p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()));
    let mut out = LoadedMasks::default();
    let labels = Labels::in_folder(folder, &mut out.notes);
    for path in files {
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let picture = match decode(&path) {
            Ok(picture) => picture,
            Err(error) => {
                out.notes.push(format!("{name} was left out: {error}"));
                continue;
            }
        };
        let size = ImageSize::new(picture.width(), picture.height());
        if let Err(error) = check_shape(&path, size, photo) {
            out.notes.push(format!("{name} was left out: {error}"));
            continue;
        }
        match meaning(picture) {
            Meaning::One(mask) => {
                let label = labels::from_stem(&name);
                out.masks.push(LoadedMask { name, label, mask: mask.resized(photo), color: None });
            }
            Meaning::Ids(_) | Meaning::Colors(_) => {
                out.notes.push(format!("{name} was left out: it is a picture, not a mask"));
            }
        }
    }
    let LoadedMasks { masks, notes } = &mut out;
    labels.apply(masks, notes);
    Ok(out)
}

/// Sort key in which `mask_2` comes before `mask_10`, and numbers before words.
fn natural(name: &str) -> Vec<(u64, String)> {
    let mut key = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        let (number, tail) = rest.split_at(digits);
        let words = tail.find(|c: char| c.is_ascii_digit()).unwrap_or(tail.len());
        let (word, tail) = tail.split_at(words);
        key.push((number.parse().unwrap_or(u64::MAX), word.to_lowercase()));
        rest = tail;
    }
    key.push((u64::MAX, name.to_owned()));
    key
}

/// Writes a mask as one-bit PNG (1 = in the mask).
///
/// # Errors
/// [`MaskError::Encode`], [`MaskError::File`].
pub fn save_mask(path: &Path, mask: &Mask) -> Result<(), MaskError> {
    let size = mask.size();
    let row = size.width.div_ceil(8) as usize;
    let mut data = vec![0_u8; row * size.height as usize];
    for (i, _) in mask.bits().iter().enumerate().filter(|(_, on)| **on) {
        let (x, y) = (i % size.width as usize, i / size.width as usize);
        data[y * row + x / 8] |= 0x80 >> (x % 8);
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size.width, size.height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&data)?;
    writer.finish()?;
    Ok(write_atomic(path, &bytes)?)
}

/// Reads a mask written by [`save_mask`], or any white-on-black image.
///
/// # Errors
/// [`MaskError`].
pub fn load_mask(path: &Path) -> Result<Mask, MaskError> {
    let grey = decode(path)?.into_luma8();
    Ok(mask_of(ImageSize::new(grey.width(), grey.height()), grey.as_raw(), |v| *v > 127))
}

#[cfg(test)]
mod tests;
