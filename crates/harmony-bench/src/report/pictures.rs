//! The pictures of a case: photo, render, and the outlines of both.

use harmony_io::picture::{read, rgb_jpeg};
use image::imageops::{FilterType, resize};
use image::{Rgb, RgbImage, imageops};

use crate::score::Prediction;
use crate::truth::TruthRoom;

/// Width of one of the three pictures, pixels.
const WIDTH: u32 = 480;
/// Between them, pixels.
const GAP: u32 = 6;
/// Quality of the JPEG.
const QUALITY: u8 = 82;
/// Outlines of what is there.
pub const TRUE_COLOUR: [u8; 3] = [0, 150, 90];
/// Outlines of what was made of it.
pub const RUN_COLOUR: [u8; 3] = [225, 30, 120];
/// First id of an object in the id image of the truth; smaller ones are the shell.
const FIRST_OBJECT: u32 = 10;

/// Photo, the run's evenly lit render, and the photo in grey with true and found outlines, side by side as a JPEG.
///
/// A missing render leaves its place empty. `None` when the photo cannot be read.
pub fn case_picture(truth: &TruthRoom, run: &Prediction) -> Option<Vec<u8>> {
    let photo = read(&truth.photo()).ok()?.into_rgb8();
    let height = (u64::from(WIDTH) * u64::from(photo.height()) / u64::from(photo.width().max(1))).max(1) as u32;
    let photo = resize(&photo, WIDTH, height, FilterType::Triangle);
    let mut sheet = RgbImage::from_pixel(3 * WIDTH + 2 * GAP, height, Rgb([255; 3]));
    imageops::replace(&mut sheet, &photo, 0, 0);
    if let Ok(render) = read(&run.folder.join("render_flat.png")) {
        let render = resize(&render.into_rgb8(), WIDTH, height, FilterType::Triangle);
        imageops::replace(&mut sheet, &render, i64::from(WIDTH + GAP), 0);
    }
    let overlay = outlines(&photo, truth, run);
    imageops::replace(&mut sheet, &overlay, i64::from(2 * (WIDTH + GAP)), 0);
    rgb_jpeg(&sheet, QUALITY).ok()
}

fn outlines(photo: &RgbImage, truth: &TruthRoom, run: &Prediction) -> RgbImage {
    let mut picture = RgbImage::from_fn(photo.width(), photo.height(), |x, y| {
        let [r, g, b] = photo.get_pixel(x, y).0.map(u32::from);
        Rgb([(140 + (3 * r + 6 * g + b) * 11 / 255) as u8; 3])
    });
    let (found, _) = run.render();
    // Ids of the run count objects from 1, those of the truth from FIRST_OBJECT; both become 0 for the room.
    let sides = [
        (truth.camera.size, TRUE_COLOUR, truth.ids.iter().map(|id| u32::from(*id)).collect::<Vec<_>>(), FIRST_OBJECT),
        (run.camera.size, RUN_COLOUR, found, 1),
    ];
    for (size, colour, ids, first) in sides {
        let (w, h) = (picture.width(), picture.height());
        let at = |x: u32, y: u32| {
            let (x, y) = (x.min(w - 1), y.min(h - 1));
            let (sx, sy) = (x * size.width / w, y * size.height / h);
            ids.get((sy * size.width + sx) as usize).copied().filter(|id| *id >= first).unwrap_or(0)
        };
        for y in 0..h {
            for x in 0..w {
                if at(x, y) != at(x + 1, y) || at(x, y) != at(x, y + 1) {
                    picture.put_pixel(x, y, Rgb(colour));
                }
            }
        }
    }
    picture
}
