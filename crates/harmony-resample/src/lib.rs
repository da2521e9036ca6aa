//! Images at another size, by convolution (`fast_image_resize`).
//!
//! A crate of its own because the convolutions are generic: each crate that calls them compiles them for each kind of
//! pixel, once more for its tests, which was a minute of building for each of two crates.

use fast_image_resize::images::{TypedImage, TypedImageRef};
use fast_image_resize::pixels::{U8x3, U8x4};
use fast_image_resize::{FilterType, PixelTrait, ResizeAlg, ResizeOptions, Resizer};
use image::{RgbImage, RgbaImage};

/// A whole-pixel rectangle inside an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Window {
    /// A whole image of `(columns, rows)`.
    pub fn whole((width, height): (u32, u32)) -> Self {
        Self { x: 0, y: 0, width, height }
    }
}

/// How texels are weighted; both average when the image gets smaller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// Linear: no overshoot.
    Triangle,
    /// Sharper, as photo programs do it.
    Lanczos3,
}

/// A window of an image at another size `(columns, rows)`; `None` where either is empty or the window lies outside.
pub fn resize_rgb(image: &RgbImage, window: Window, to: (u32, u32), filter: Filter) -> Option<RgbImage> {
    let bytes = resize::<U8x3>(image.as_raw(), image.dimensions(), window, to, filter)?;
    RgbImage::from_raw(to.0, to.1, bytes)
}

/// [`resize_rgb`] weighted by alpha.
pub fn resize_rgba(image: &RgbaImage, window: Window, to: (u32, u32), filter: Filter) -> Option<RgbaImage> {
    let bytes = resize::<U8x4>(image.as_raw(), image.dimensions(), window, to, filter)?;
    RgbaImage::from_raw(to.0, to.1, bytes)
}

/// Typed, for the untyped call compiles the filters of all kinds of pixels.
fn resize<P: PixelTrait>(
    bytes: &[u8],
    (source_width, source_height): (u32, u32),
    window: Window,
    (width, height): (u32, u32),
    filter: Filter,
) -> Option<Vec<u8>> {
    if [source_width, source_height, window.width, window.height, width, height].contains(&0) {
        return None;
    }
    let source = TypedImageRef::<P>::from_buffer(source_width, source_height, bytes).ok()?;
    let mut resized = vec![0; width as usize * height as usize * P::size()];
    let mut target = TypedImage::<P>::from_buffer(width, height, &mut resized).ok()?;
    let filter = match filter {
        Filter::Triangle => FilterType::Bilinear,
        Filter::Lanczos3 => FilterType::Lanczos3,
    };
    let options = ResizeOptions::new().resize_alg(ResizeAlg::Convolution(filter)).crop(
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
    fn a_plain_image_stays_plain_and_what_does_not_exist_is_not_resized() {
        let photo = RgbImage::from_pixel(64, 48, image::Rgb([10, 200, 30]));
        for filter in [Filter::Triangle, Filter::Lanczos3] {
            let small = resize_rgb(&photo, Window::whole((64, 48)), (20, 10), filter).unwrap();
            assert_eq!(small.dimensions(), (20, 10));
            assert!(small.pixels().all(|p| p.0 == [10, 200, 30]));
            let outside = Window { x: 60, y: 0, width: 20, height: 48 };
            assert!(resize_rgb(&photo, outside, (20, 10), filter).is_none());
            assert!(resize_rgb(&RgbImage::new(0, 0), Window::whole((0, 0)), (3, 2), filter).is_none());
        }
    }

    #[test]
    fn transparent_texels_do_not_tint_their_neighbours() {
        let image =
            RgbaImage::from_fn(
                16,
                16,
                |x, _| {
                    if x < 8 { image::Rgba([250, 0, 0, 0]) } else { image::Rgba([0, 0, 240, 255]) }
                },
            );
        let small = resize_rgba(&image, Window::whole((16, 16)), (4, 4), Filter::Triangle).unwrap();
        assert!(small.pixels().filter(|p| p.0[3] > 20).all(|p| p.0[0] < 6 && p.0[2] > 230));
    }
}
