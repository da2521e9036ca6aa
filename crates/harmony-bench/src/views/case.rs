//! Views of one case: judged, put into its score, their pictures written for the report.

use std::path::Path;

use harmony_io::picture::rgb_jpeg;
use harmony_roles::LitRenderer;
use image::imageops::{self, FilterType, resize};
use image::{Rgb, RgbImage};

use super::{JudgedView, LitOptions, judge, lit_scores};
use crate::metrics::similarity::Looking;
use crate::run::{BenchError, PICTURES};
use crate::score::{Prediction, RoomScore};
use crate::truth::TruthRoom;

/// Width of one picture of a pair, pixels.
const WIDTH: u32 = 480;
/// Between pictures, pixels.
const GAP: u32 = 6;
/// Quality of the JPEG.
const QUALITY: u8 = 85;

/// Who renders lit pictures, and how.
#[derive(Clone, Copy)]
pub struct Lit<'a> {
    /// The renderer.
    pub renderer: &'a dyn LitRenderer,
    /// Size and samples.
    pub options: LitOptions,
}

/// Judges a run's views and, with `lit`, its lit pictures, and puts both into its score. With `out`, the pictures go
/// to its folder of cases. A renderer that fails is said in words; the flat figures stay.
///
/// # Errors
/// Views that cannot be read and pictures that cannot be written.
pub async fn judge_case(
    truth: &TruthRoom,
    folder: &Path,
    score: &mut RoomScore,
    looking: &Looking,
    lit: Option<Lit<'_>>,
    out: Option<&Path>,
) -> Result<Option<String>, BenchError> {
    let Ok(run) = Prediction::load(folder) else { return Ok(None) };
    let mut views = judge(truth, &run, &score.objects, score.shift_x, looking)?;
    let mut absent = None;
    if let Some(Lit { renderer, options }) = lit {
        match lit_scores(renderer, truth, &run, &mut views, options, looking).await {
            Ok((photo, image)) => {
                score.lit = photo;
                if let (Some(out), Some(image), Some((flat, photo))) = (out, image, crate::score::pictures(truth, &run))
                {
                    write(out, &picture_name(&score.case(), "lit"), &[&photo, &flat, &image])?;
                }
            }
            Err(error) => absent = Some(format!("lit pictures are not judged: {error}")),
        }
    }
    if let Some(out) = out {
        for view in &views {
            let JudgedView { photo, flat, lit, score: view, .. } = view;
            let pictures: Vec<&RgbImage> = [Some(photo), Some(flat), lit.as_ref()].into_iter().flatten().collect();
            write(out, &picture_name(&score.case(), &view.view), &pictures)?;
        }
    }
    score.views = views.into_iter().map(|v| v.score).collect();
    Ok(absent)
}

/// Name of a view's pictures in the folder of cases.
pub fn picture_name(case: &str, view: &str) -> String {
    format!("{case}_view_{view}.jpg")
}

/// Pictures side by side as a JPEG.
fn write(out: &Path, name: &str, pictures: &[&RgbImage]) -> Result<(), BenchError> {
    let Some(first) = pictures.first() else { return Ok(()) };
    let height = (u64::from(WIDTH) * u64::from(first.height()) / u64::from(first.width().max(1))).max(1) as u32;
    let n = pictures.len() as u32;
    let mut sheet = RgbImage::from_pixel(n * WIDTH + (n - 1) * GAP, height, Rgb([255; 3]));
    for (picture, i) in pictures.iter().zip(0_i64..) {
        let small = resize(*picture, WIDTH, height, FilterType::Triangle);
        imageops::replace(&mut sheet, &small, i * i64::from(WIDTH + GAP), 0);
    }
    let folder = out.join(PICTURES);
    let wrong = |reason: String| BenchError::Run { room: name.to_owned(), reason };
    std::fs::create_dir_all(&folder).map_err(|e| wrong(e.to_string()))?;
    let jpeg = rgb_jpeg(&sheet, QUALITY).map_err(|e| wrong(e.to_string()))?;
    Ok(harmony_io::write_atomic(&folder.join(name), &jpeg)?)
}
