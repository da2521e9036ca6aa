//! `segmentation.png` and `segmentation.json`: the paper's data set annotation "one image, masks of every stage
//! merged, each object one solid colour", and per object its colour, stage, type, source phrase and mask file.

use std::path::Path;

use harmony_scene::{ImageSize, Mask, ObjectId, SceneObject};
use image::{Rgb, RgbImage};
use serde::{Deserialize, Serialize};

use super::MaskError;
use crate::atomic::write_json;
use crate::picture::write_rgb_png;

/// An object and its mask, for the annotation files.
#[derive(Debug, Clone, Copy)]
pub struct Segment<'a> {
    /// The object.
    pub object: &'a SceneObject,
    /// Its visible pixels in the photo.
    pub mask: &'a Mask,
}

/// `segmentation.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SegmentationFile {
    /// Version of this file.
    pub version: u32,
    /// Columns and rows of `segmentation.png`.
    pub size: ImageSize,
    /// Colour of what belongs to no object.
    pub background: [u8; 3],
    /// Objects in the order given.
    pub objects: Vec<SegmentEntry>,
}

/// One object of `segmentation.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SegmentEntry {
    /// Colour in `segmentation.png`, sRGB.
    pub color: [u8; 3],
    /// Object.
    pub id: ObjectId,
    /// Object's index (the value in id images).
    pub index: u32,
    /// `furniture`, `wall-mounted`, `ceiling` or `decoration`.
    pub stage: String,
    /// Category.
    #[serde(rename = "type")]
    pub kind: String,
    /// Phrase it was detected by.
    pub source_phrase: String,
    /// Mask file, relative to the run folder.
    pub mask: Option<String>,
    /// Pixels of its colour in the image (later objects lie over earlier ones).
    pub pixels: usize,
}

/// The colour of an object index in `segmentation.png`.
///
/// Always the same, never black or grey, different for all indices below 9,216: 384 hues by the golden ratio, so that
/// neighbouring indices differ most, then the next of 24 levels of brightness and saturation.
pub fn index_color(index: u32) -> [u8; 3] {
    const HUES: u32 = 384;
    // 239 is near 384 / 1.618 and prime to 384: all hues come before the first returns.
    let hue = f64::from((index % HUES) * 239 % HUES) / f64::from(HUES) * 6.0;
    let level = (index / HUES) % 24;
    let value = 255.0 - f64::from(level % 6) * 24.0;
    let saturation = 0.92 - f64::from(level / 6) * 0.11;
    let channel = |offset: f64| {
        let k = (offset + hue) % 6.0;
        let share = (k.min(4.0 - k)).clamp(0.0, 1.0);
        (value * (1.0 - saturation * share)).round() as u8
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

/// Writes `segmentation.png` and `segmentation.json` into a folder; later segments lie over earlier ones.
///
/// # Errors
/// [`MaskError`].
///
/// # Panics
/// When a mask has another size than the image.
pub fn save_segmentation(folder: &Path, size: ImageSize, segments: &[Segment<'_>]) -> Result<(), MaskError> {
    let mut owner = vec![usize::MAX; size.pixels()];
    for (k, segment) in segments.iter().enumerate() {
        assert_eq!(segment.mask.size(), size, "masks have the photo's size");
        for (o, _) in owner.iter_mut().zip(segment.mask.bits()).filter(|(_, on)| **on) {
            *o = k;
        }
    }
    let mut pixels = vec![0; segments.len()];
    let image = RgbImage::from_fn(size.width, size.height, |x, y| {
        let k = owner[y as usize * size.width as usize + x as usize];
        match segments.get(k) {
            Some(segment) => {
                pixels[k] += 1;
                Rgb(index_color(segment.object.index))
            }
            None => Rgb([0; 3]),
        }
    });
    let objects = segments
        .iter()
        .zip(pixels)
        .map(|(s, pixels)| SegmentEntry {
            color: index_color(s.object.index),
            id: s.object.id.clone(),
            index: s.object.index,
            stage: s.object.level.stage().to_owned(),
            kind: s.object.label.clone(),
            source_phrase: s.object.source_phrase.clone(),
            mask: s.object.mask.clone(),
            pixels,
        })
        .collect();
    let path = folder.join("segmentation.png");
    write_rgb_png(&path, &image).map_err(|source| MaskError::Picture { source, path })?;
    let file = SegmentationFile { version: 1, size, background: [0; 3], objects };
    Ok(write_json(&folder.join("segmentation.json"), &file)?)
}
