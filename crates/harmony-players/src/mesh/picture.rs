//! The picture that a generator gets: the object alone, on transparent ground, with a margin.

use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture::rgba_png;
use harmony_roles::{MeshRequest, MeshSettings};
use harmony_scene::{Level, Size};
use image::imageops::{FilterType, crop_imm, overlay, resize};
use image::{Rgba, RgbaImage};

/// Alpha from which a pixel belongs to the object.
const OBJECT_ALPHA: u8 = 128;

/// Margin around the object, as a fraction of its longer side.
const MARGIN: f64 = 0.08;

/// Longest side that is sent, pixels; generators work at 512 to 1024.
const LONGEST: u32 = 1024;

/// PNG in base64.
///
/// # Errors
/// In words, when nothing of the object is seen.
pub(super) fn encoded(crop: &RgbaImage) -> Result<String, String> {
    let file = rgba_png(&alone(crop)?).map_err(|error| error.to_string())?;
    Ok(STANDARD.encode(file))
}

/// Shortest longer side that hosted services do well with, pixels; the strictest refuses less than 128.
const SHORTEST: u32 = 512;

/// A PNG file for a hosted service: small pictures are enlarged, for services refuse what is too small.
///
/// # Errors
/// In words, when nothing of the object is seen.
pub(super) fn hosted(crop: &RgbaImage) -> Result<Vec<u8>, String> {
    let mut picture = alone(crop)?;
    let longest = picture.width().max(picture.height());
    if longest < SHORTEST {
        let scaled = |side: u32| ((u64::from(side) * u64::from(SHORTEST)) / u64::from(longest)).max(1) as u32;
        let (width, height) = (scaled(picture.width()), scaled(picture.height()));
        picture = resize(&picture, width, height, FilterType::CatmullRom);
    }
    rgba_png(&picture).map_err(|error| error.to_string())
}

/// The object in a picture of its own size and a margin.
fn alone(crop: &RgbaImage) -> Result<RgbaImage, String> {
    let object = crop.enumerate_pixels().filter(|(_, _, p)| p.0[3] >= OBJECT_ALPHA);
    let (mut x0, mut y0, mut x1, mut y1) = (u32::MAX, u32::MAX, 0, 0);
    for (x, y, _) in object {
        (x0, y0, x1, y1) = (x0.min(x), y0.min(y), x1.max(x + 1), y1.max(y + 1));
    }
    if x0 >= x1 || y0 >= y1 {
        return Err("nothing of the object is in the picture".to_owned());
    }
    let (width, height) = (x1 - x0, y1 - y0);
    let margin = (f64::from(width.max(height)) * MARGIN).ceil() as u32;
    let mut out = RgbaImage::from_pixel(width + 2 * margin, height + 2 * margin, Rgba([255, 255, 255, 0]));
    let mut object = crop_imm(crop, x0, y0, width, height).to_image();
    for pixel in object.pixels_mut().filter(|p| p.0[3] < OBJECT_ALPHA) {
        *pixel = Rgba([255, 255, 255, 0]);
    }
    overlay(&mut out, &object, i64::from(margin), i64::from(margin));
    let longest = out.width().max(out.height());
    if longest > LONGEST {
        let scaled = |side: u32| ((u64::from(side) * u64::from(LONGEST)) / u64::from(longest)).max(1) as u32;
        out = resize(&out, scaled(out.width()), scaled(out.height()), FilterType::CatmullRom);
    }
    Ok(out)
}

/// A tiny piece of work: a ball, coarse.
pub(super) fn check_request() -> MeshRequest {
    let ball = RgbaImage::from_fn(256, 256, |x, y| {
        let (dx, dy) = (f64::from(x) - 128.0, f64::from(y) - 128.0);
        let r = (dx * dx + dy * dy).sqrt() / 100.0;
        let light = (220.0 - 120.0 * (r + (dx + dy) / 400.0)).clamp(0.0, 255.0) as u8;
        Rgba([light, light / 2, light / 3, if r < 1.0 { 255 } else { 0 }])
    });
    MeshRequest {
        name: "doctor/check".to_owned(),
        crop: Arc::new(ball),
        label: "ball".to_owned(),
        description: "a ball".to_owned(),
        level: Level::Decoration,
        size: Size { width: 0.2, height: 0.2, depth: 0.2 },
        template: None,
        params: harmony_mesh::TemplateParams::default(),
        part_model: None,
        settings: MeshSettings { octree_resolution: 128, steps: 5, faces: 10_000 },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_object_fills_its_picture() {
        let crop = RgbaImage::from_fn(1600, 1200, |x, y| {
            let inside = (700..1000).contains(&x) && (500..600).contains(&y);
            Rgba([9, 9, 9, if inside { 255 } else { 20 }])
        });
        let picture = alone(&crop).unwrap();
        assert_eq!(picture.dimensions(), (348, 148));
        assert_eq!((picture.get_pixel(174, 74).0[3], picture.get_pixel(3, 3).0[3]), (255, 0));
        assert!(alone(&RgbaImage::new(8, 8)).is_err());
        let small = RgbaImage::from_pixel(40, 30, Rgba([9, 9, 9, 255]));
        let file = harmony_io::picture::decode(&hosted(&small).unwrap()).unwrap();
        assert_eq!(file.width().max(file.height()), SHORTEST);
        let large = alone(&RgbaImage::from_pixel(1200, 600, Rgba([1, 2, 3, 255]))).unwrap();
        assert_eq!(large.width(), LONGEST);
    }
}
