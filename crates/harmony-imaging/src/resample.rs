//! Crops and resizes.

use harmony_resample::Filter;
pub(crate) use harmony_resample::Window;
use harmony_scene::ImageSize;
use image::{RgbImage, RgbaImage};

/// The window of the photo at another size; triangle filter, averaging when smaller.
pub(crate) fn resize_window(photo: &RgbImage, window: Window, to: ImageSize) -> RgbImage {
    let (width, height) = (to.width.max(1), to.height.max(1));
    let crop = |to: Window| image::imageops::crop_imm(photo, to.x, to.y, to.width, to.height).to_image();
    if window.width == width && window.height == height {
        return crop(window);
    }
    harmony_resample::resize_rgb(photo, window, (width, height), Filter::Triangle)
        .unwrap_or_else(|| RgbImage::new(width, height))
}

/// An RGBA image at another size, alpha-weighted.
pub(crate) fn resize_rgba(source: &RgbaImage, to: ImageSize) -> RgbaImage {
    let (width, height) = (to.width.max(1), to.height.max(1));
    if source.dimensions() == (width, height) {
        return source.clone();
    }
    harmony_resample::resize_rgba(source, Window::whole(source.dimensions()), (width, height), Filter::Triangle)
        .unwrap_or_else(|| RgbaImage::new(width, height))
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
