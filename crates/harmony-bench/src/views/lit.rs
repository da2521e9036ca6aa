//! The lit picture of a finished scene against what is there.

use std::sync::Arc;

use harmony_imaging::color::{linear_from_srgb, srgb_from_linear};
use harmony_roles::{LitKind, LitRenderer, LitRequest, RoleError};
use harmony_scene::{Camera, ImageSize, Mask, Scene};
use image::{Rgb, RgbImage};
use serde::{Deserialize, Serialize};

use super::{JudgedView, PictureScore, measure, picture_score};
use crate::metrics::similarity::Looking;
use crate::score::Prediction;
use crate::truth::TruthRoom;

/// Longest side of a lit picture unless told otherwise, pixels: a preview.
pub const LIT_WIDTH: u32 = 480;
/// Its samples a pixel; it is denoised.
pub const LIT_SAMPLES: u32 = 32;

/// How lit pictures are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LitOptions {
    /// Longest side, pixels.
    pub longest: u32,
    /// Samples a pixel.
    pub samples: u32,
}

impl Default for LitOptions {
    fn default() -> Self {
        Self { longest: LIT_WIDTH, samples: LIT_SAMPLES }
    }
}

/// A lit picture's figures, at its own size: the photo and the flat picture are shrunk to it in linear light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LitScore {
    /// Size of the picture, pixels.
    pub size: [u32; 2],
    /// The lit picture.
    pub lit: PictureScore,
    /// Pixel loss of the flat picture at this size.
    pub flat_pl: f64,
    /// Median absolute error of the linear luminance, stops.
    pub stops: f64,
    /// Median signed error, stops; positive = too bright.
    pub stops_bias: f64,
}

/// Renders a run lit, from its own camera and from each judged view, and judges the pictures; the score of the photo's
/// view is returned, those of the views are put into them.
///
/// # Errors
/// What the renderer says.
pub async fn lit_scores(
    renderer: &dyn LitRenderer,
    truth: &TruthRoom,
    run: &Prediction,
    views: &mut [JudgedView],
    options: LitOptions,
    looking: &Looking,
) -> Result<(Option<LitScore>, Option<RgbImage>), RoleError> {
    let unusable =
        |complaint: String| RoleError::UnusableAnswer { player: "bench".to_owned(), complaint, raw: String::new() };
    let glb = harmony_io::scene_for_light(&run.folder);
    let scene: Scene = harmony_io::read_json(&run.folder.join("scene.json")).map_err(|e| unusable(e.to_string()))?;
    let bytes = harmony_io::read_bounded(&glb, 1 << 31).map_err(|e| unusable(e.to_string()))?;
    let albedo = harmony_io::albedo_field(&run.folder).map(Arc::new);
    let request = |name: &str, camera: &Camera| LitRequest {
        name: format!("bench/{name}"),
        glb: glb.clone(),
        glb_hash: blake3::hash(&bytes).to_hex().to_string(),
        camera: camera.resized(camera.size.fit_within(options.longest)),
        lighting: scene.lighting.clone(),
        room: Some(scene.room.extents),
        samples: options.samples,
        denoise: true,
        albedo: albedo.clone(),
        hidden_nodes: Vec::new(),
        background: None,
        kind: LitKind::default(),
    };
    for view in views.iter_mut() {
        let image = renderer.render(&request(&view.score.view, &view.camera)).await?.image;
        view.score.lit = lit_score(&image, &view.flat, &view.photo, Some(&view.seen), looking);
        view.lit = Some(image);
    }
    let Some((flat, photo)) = crate::score::pictures(truth, run) else { return Ok((None, None)) };
    let image = renderer.render(&request("photo", &run.camera)).await?.image;
    let score = lit_score(&image, &flat, &photo, None, looking);
    Ok((score, Some(image)))
}

/// Judges a lit picture beside the flat one; `None` when the shapes differ.
pub fn lit_score(
    lit: &RgbImage,
    flat: &RgbImage,
    photo: &RgbImage,
    seen: Option<&Mask>,
    looking: &Looking,
) -> Option<LitScore> {
    let size = ImageSize::new(lit.width(), lit.height());
    let (photo, flat) = (shrunk(photo, size), shrunk(flat, size));
    let seen = seen.map(|s| s.resized(size));
    let score = picture_score(lit, &photo, seen.as_ref(), looking)?;
    let everywhere = Mask::from_fn(size, |_, _| true);
    let stops = measure::stops(lit, &photo)?;
    Some(LitScore {
        size: [size.width, size.height],
        lit: score,
        flat_pl: measure::loss(&flat, &photo, &everywhere)?,
        stops: stops.error,
        stops_bias: stops.bias,
    })
}

/// A picture at a smaller size: the mean of linear light over each pixel's area.
fn shrunk(picture: &RgbImage, to: ImageSize) -> RgbImage {
    let (w, h) = picture.dimensions();
    if (w, h) == (to.width, to.height) {
        return picture.clone();
    }
    let lut: Vec<f32> = (0..=255_u8).map(|v| linear_from_srgb(f32::from(v) / 255.0)).collect();
    let columns = spans(w, to.width);
    let rows = spans(h, to.height);
    RgbImage::from_fn(to.width, to.height, |x, y| {
        let mut sum = [0.0_f32; 3];
        let mut weight = 0.0;
        for (sy, wy) in &rows[y as usize] {
            for (sx, wx) in &columns[x as usize] {
                let p = picture.get_pixel(*sx, *sy).0;
                for (s, v) in sum.iter_mut().zip(p) {
                    *s += lut[usize::from(v)] * wx * wy;
                }
                weight += wx * wy;
            }
        }
        Rgb(sum.map(|s| (srgb_from_linear(s / weight) * 255.0).round().clamp(0.0, 255.0) as u8))
    })
}

/// Source pixels of each target pixel along one axis, with the lengths that they cover.
fn spans(from: u32, to: u32) -> Vec<Vec<(u32, f32)>> {
    let step = f64::from(from) / f64::from(to.max(1));
    (0..to)
        .map(|i| {
            let (a, b) = (f64::from(i) * step, f64::from(i + 1) * step);
            let last = (b.ceil() as u32).min(from);
            (a.floor() as u32..last)
                .filter_map(|p| {
                    let cover = b.min(f64::from(p + 1)) - a.max(f64::from(p));
                    (cover > 1e-9).then_some((p, cover as f32))
                })
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_keeps_the_mean_of_light() {
        // Half the area black, half white: 0.5 linear is sRGB 188.
        let picture = RgbImage::from_fn(4, 2, |x, _| Rgb([if x % 2 == 0 { 0 } else { 255 }; 3]));
        let small = shrunk(&picture, ImageSize::new(2, 1));
        assert!(small.pixels().all(|p| p.0 == [188; 3]), "{:?}", small.as_raw());
        // 3 columns to 2: each target takes one and a half of them, 2/3 white and 1/3 black on the left.
        let thirds = RgbImage::from_fn(3, 1, |x, _| Rgb([if x == 0 { 255 } else { 0 }; 3]));
        let small = shrunk(&thirds, ImageSize::new(2, 1));
        let expected = (srgb_from_linear(2.0 / 3.0) * 255.0).round() as u8;
        assert_eq!([small.get_pixel(0, 0).0[0], small.get_pixel(1, 0).0[0]], [expected, 0]);
    }

    #[test]
    fn a_picture_one_stop_too_dark_is_one_stop_off() {
        let photo = RgbImage::from_pixel(16, 16, Rgb([188; 3]));
        // 0.25 linear.
        let dark = RgbImage::from_pixel(8, 8, Rgb([137; 3]));
        let score = lit_score(&dark, &photo, &photo, None, &Looking::default()).unwrap();
        assert!((score.stops - 1.0).abs() < 0.02 && (score.stops_bias + 1.0).abs() < 0.02, "{score:?}");
        assert_eq!((score.flat_pl, score.size), (0.0, [8, 8]));
        assert!((score.lit.all.pl - (51.0_f64 / 255.0).powi(2)).abs() < 1e-9);
    }
}
