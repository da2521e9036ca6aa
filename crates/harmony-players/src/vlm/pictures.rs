//! Pictures for sending: small enough for the service, lossless where that is small too.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture::{rgb_jpeg, rgb_png};
use harmony_roles::Picture;
use harmony_scene::ImageSize;
use image::RgbImage;
use image::imageops::{FilterType, resize};

use super::wire::SentPicture;

/// Largest file that is sent lossless, bytes.
const LOSSLESS_BYTES: usize = 1_500_000;

/// Largest file that is sent, bytes: 5 MiB of base64, what the strictest service takes.
const MAX_BYTES: usize = 3_700_000;

/// Encodes a picture with at most `longest` pixels on its longer side. Places in answers are fractions of the picture,
/// so that its size does not matter to them.
///
/// # Errors
/// In words, for a picture without pixels.
pub fn encoded(picture: &Picture, longest: u32) -> Result<SentPicture, String> {
    let (media_type, bytes) = file(&picture.image, longest)?;
    Ok(SentPicture { caption: picture.caption.clone(), media_type, base64: STANDARD.encode(bytes) })
}

/// The media type and the bytes of a picture's file.
fn file(image: &RgbImage, longest: u32) -> Result<(&'static str, Vec<u8>), String> {
    let small;
    let size = ImageSize::new(image.width(), image.height());
    let fit = size.fit_within(longest);
    let image = if fit == size {
        image
    } else {
        small = resize(image, fit.width, fit.height, FilterType::CatmullRom);
        &small
    };
    let png = rgb_png(image).map_err(|error| error.to_string())?;
    if png.len() <= LOSSLESS_BYTES {
        return Ok(("image/png", png));
    }
    for quality in [92, 80, 60] {
        let jpeg = rgb_jpeg(image, quality).map_err(|error| error.to_string())?;
        if jpeg.len() <= MAX_BYTES {
            return Ok(("image/jpeg", jpeg));
        }
    }
    Err(format!("a picture of {} x {} cannot be made small enough", image.width(), image.height()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn plain_pictures_are_lossless_and_noisy_ones_small() {
        let plain = RgbImage::from_pixel(300, 200, Rgb([9, 8, 7]));
        let (kind, bytes) = file(&plain, 2000).unwrap();
        assert_eq!(kind, "image/png");
        assert_eq!(harmony_io::picture::decode(&bytes).unwrap().to_rgb8(), plain);
        let mut seed = 1_u32;
        let noisy = RgbImage::from_fn(1800, 1200, |_, _| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Rgb([(seed >> 24) as u8, (seed >> 16) as u8, (seed >> 8) as u8])
        });
        let (kind, bytes) = file(&noisy, 1200).unwrap();
        let decoded = harmony_io::picture::decode(&bytes).unwrap();
        assert_eq!(kind, "image/jpeg");
        assert!(bytes.len() <= MAX_BYTES);
        assert_eq!((decoded.width(), decoded.height()), (1200, 800));
        assert!(file(&RgbImage::new(0, 0), 100).is_err());
    }
}
