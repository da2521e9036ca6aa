//! From a photo to OWLv2's input.

use image::RgbImage;

use crate::clip::{MEAN, STD};
use crate::resample::Pixels;

/// As transformers' `Owlv2ImageProcessor`: 0..1, filled up with zeros to a square at the bottom or right, blurred when
/// it gets smaller, resized linearly, normalised. Boxes are fractions of that square.
pub fn preprocess(photo: &RgbImage, side: usize) -> Pixels {
    let square = Pixels::from_photo(photo).padded_to_square();
    let factor = square.width as f64 / side as f64;
    let sigma = ((factor - 1.0) / 2.0).max(0.0);
    let smooth = if sigma > 0.0 { square.blur(sigma, (3.0 * sigma).ceil() as usize) } else { square };
    smooth.resize_bilinear(side, side).normalized(MEAN, STD)
}
