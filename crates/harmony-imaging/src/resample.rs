//! Crops and resizes.

use fast_image_resize::images::{TypedImage, TypedImageRef};
use fast_image_resize::pixels::{U8x3, U8x4};
use fast_image_resize::{FilterType, PixelTrait, ResizeAlg, ResizeOptions, Resizer};
use harmony_scene::ImageSize;
use image::{RgbImage, RgbaImage};

/// A whole-pixel rectangle inside an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

impl Window {
    /// The whole image.
    pub(crate) fn whole(size: ImageSize) -> Self {
        Self { x: 0, y: 0, width: size.width, height: size.height }
    }
}

/// The window of the photo at another size; triangle filter, averaging when smaller.
pub(crate) fn resize_window(photo: &RgbImage, window: Window, to: ImageSize) -> RgbImage {
    let (width, height) = (to.width.max(1), to.height.max(1));
    let crop = |to: Window| image::imageops::crop_imm(photo, to.x, to.y, to.width, to.height).to_image();
    if window.width == width && window.height == height {
        return crop(window);
    }
    resize_bytes::<U8x3>(photo.as_raw(), photo.dimensions(), window, (width, height))
        .and_then(|bytes| RgbImage::from_raw(width, height, bytes))
        .unwrap_or_else(|| RgbImage::new(width, height))
}

/// An RGBA image at another size, alpha-weighted.
pub(crate) fn resize_rgba(source: &RgbaImage, to: ImageSize) -> RgbaImage {
    let (width, height) = (to.width.max(1), to.height.max(1));
    if source.dimensions() == (width, height) {
        return source.clone();
    }
    let window = Window { x: 0, y: 0, width: source.width(), height: source.height() };
    resize_bytes::<U8x4>(source.as_raw(), source.dimensions(), window, (width, height))
        .and_then(|bytes| RgbaImage::from_raw(width, height, bytes))
        .unwrap_or_else(|| RgbaImage::new(width, height))
}

/// `None` for empty images and windows outside. Typed, for the untyped call compiles the filters of all pixel kinds.
fn resize_bytes<P: PixelTrait>(
    bytes: &[u8],
    (source_width, source_height): (u32, u32),
    window: Window,
    (width, height): (u32, u32),
) -> Option<Vec<u8>> {
    let source = TypedImageRef::<P>::from_buffer(source_width, source_height, bytes).ok()?;
    let mut resized = vec![0; width as usize * height as usize * P::size()];
    let mut target = TypedImage::<P>::from_buffer(width, height, &mut resized).ok()?;
    let options = ResizeOptions::new().resize_alg(ResizeAlg::Convolution(FilterType::Bilinear)).crop(
        f64::from(window.x),
        f64::from(window.y),
        f64::from(window.width),
        f64::from(window.height),
    );
    Resizer::new().resize_typed(&source, &mut target, &options).ok()?;
    Some(resized)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gradient_keeps_its_values_at_pixel_centres() {
        let photo = RgbImage::from_fn(80, 40, |x, y| image::Rgb([(x * 3) as u8, (y * 4) as u8, 9]));
        let half = resize_window(&photo, Window { x: 20, y: 10, width: 40, height: 20 }, ImageSize::new(20, 10));
        let p = half.get_pixel(5, 4);
        // Centre of texel 5 is photo x = 20 + 11 = pixel 30.5: between columns 30 and 31.
        assert!((f64::from(p[0]) - 3.0 * 30.5).abs() <= 1.0);
        assert!((f64::from(p[1]) - 4.0 * 18.5).abs() <= 1.0);
        assert_eq!(
            resize_window(&RgbImage::new(0, 0), Window { x: 0, y: 0, width: 0, height: 0 }, ImageSize::new(3, 2))
                .dimensions(),
            (3, 2)
        );
    }
}
