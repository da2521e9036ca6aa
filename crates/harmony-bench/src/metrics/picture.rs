//! Pictures: the pixel loss.
//!
//! Resizing follows Pillow's bicubic filter to the bit, as the published evaluation resizes with it: separable,
//! antialiased when shrinking, a = -0.5, coefficients in 22-bit fixed point, 8 bits between the two passes
//! (Pillow, `src/libImaging/Resample.c`). `bench/metrics_vs_scipy.sh` compares the two.

use harmony_scene::ImageSize;
use image::RgbImage;

/// Bits behind the binary point of filter coefficients; two of 32 stay free for overshoot (Pillow).
const PRECISION_BITS: u32 = 32 - 8 - 2;
/// Half width of the bicubic kernel, pixels of the coarser grid.
const SUPPORT: f64 = 2.0;

/// Pixel loss PL: the mean over pixels and channels of the squared difference of sRGB values in [0, 1].
///
/// Follows VIGA's evaluation: the target is resized to the render's size (bicubic), nothing is masked. `None` when a
/// picture is empty.
pub fn pixel_loss(render: &RgbImage, target: &RgbImage) -> Option<f64> {
    let size = ImageSize::new(render.width(), render.height());
    let target = resize_bicubic(target, size)?;
    let values = render.as_raw();
    let squares: u64 = values.iter().zip(target.as_raw()).map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum();
    (!values.is_empty()).then(|| squares as f64 / (255.0 * 255.0) / values.len() as f64)
}

/// The picture at another size, as Pillow's `resize` does it with its bicubic filter. `None` when a size is 0.
pub fn resize_bicubic(picture: &RgbImage, to: ImageSize) -> Option<RgbImage> {
    let (width, height) = picture.dimensions();
    if width == 0 || height == 0 || to.width == 0 || to.height == 0 {
        return None;
    }
    let mut values = picture.as_raw().clone();
    if to.width != width {
        let taps = taps(width as usize, to.width as usize);
        let mut narrowed = Vec::with_capacity(to.width as usize * height as usize * 3);
        for row in values.chunks_exact(width as usize * 3) {
            for tap in &taps {
                narrowed.extend([0, 1, 2].map(|channel| tap.apply(row[channel..].iter().step_by(3))));
            }
        }
        values = narrowed;
    }
    if to.height != height {
        let stride = to.width as usize * 3;
        let mut shortened = Vec::with_capacity(stride * to.height as usize);
        for tap in taps(height as usize, to.height as usize) {
            shortened.extend((0..stride).map(|column| tap.apply(values[column..].iter().step_by(stride))));
        }
        values = shortened;
    }
    RgbImage::from_raw(to.width, to.height, values)
}

/// The source pixels that make one target pixel of an axis.
struct Tap {
    first: usize,
    weights: Vec<i32>,
}

impl Tap {
    fn apply<'a>(&self, values: impl Iterator<Item = &'a u8>) -> u8 {
        let sum = values.skip(self.first).zip(&self.weights).map(|(value, weight)| i32::from(*value) * weight);
        ((sum.sum::<i32>() + (1 << (PRECISION_BITS - 1))) >> PRECISION_BITS).clamp(0, 255) as u8
    }
}

fn taps(from: usize, to: usize) -> Vec<Tap> {
    let step = from as f64 / to as f64;
    let widening = step.max(1.0);
    let reach = SUPPORT * widening;
    (0..to)
        .map(|i| {
            let centre = (i as f64 + 0.5) * step;
            let first = (centre - reach + 0.5).max(0.0) as usize;
            let end = ((centre + reach + 0.5) as usize).min(from);
            let weights: Vec<f64> =
                (first..end).map(|x| bicubic((x as f64 - centre + 0.5) * (1.0 / widening))).collect();
            let sum: f64 = weights.iter().sum();
            let fixed = |w: &f64| (w / sum * f64::from(1 << PRECISION_BITS)).round() as i32;
            Tap { first, weights: weights.iter().map(fixed).collect() }
        })
        .collect()
}

/// Keys' cubic convolution kernel with a = -0.5.
fn bicubic(x: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        (((x - 5.0) * x + 8.0) * x - 4.0) * -0.5
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn the_loss_of_known_pictures_is_known() {
        let black = RgbImage::new(6, 4);
        let white = RgbImage::from_pixel(6, 4, Rgb([255; 3]));
        let red = RgbImage::from_pixel(12, 9, Rgb([255, 0, 0]));
        let close = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() <= 1e-15;
        assert!(close(pixel_loss(&black, &black), 0.0));
        assert!(close(pixel_loss(&black, &white), 1.0));
        assert!(close(pixel_loss(&black, &red), 1.0 / 3.0), "the target is resized");
        assert_eq!(pixel_loss(&RgbImage::new(0, 0), &black), None);
        assert_eq!(pixel_loss(&black, &RgbImage::new(0, 3)), None);
    }

    #[test]
    fn resizing_gives_pillows_values() {
        // Pillow 13.0: Image.fromarray(a).resize((w, h), BICUBIC) of a[y, x, c] = (x * 37 + y * 91 + c * 53) % 256.
        let picture = RgbImage::from_fn(7, 5, |x, y| Rgb([0, 53, 106].map(|c| ((x * 37 + y * 91 + c) % 256) as u8)));
        let smaller = resize_bicubic(&picture, ImageSize::new(3, 2)).unwrap();
        assert_eq!(smaller.as_raw(), &SMALLER);
        let larger = resize_bicubic(&picture, ImageSize::new(9, 5)).unwrap();
        assert_eq!(larger.as_raw()[..27], LARGER_FIRST_ROW);
    }

    const SMALLER: [u8; 18] = [95, 124, 133, 130, 157, 134, 133, 127, 139, 110, 136, 149, 116, 129, 121, 126, 140, 130];
    const LARGER_FIRST_ROW: [u8; 27] = [
        0, 51, 104, 22, 75, 128, 53, 106, 159, 82, 135, 188, 111, 164, 217, 140, 193, 255, 169, 239, 129, 200, 170, 31,
        224, 9, 74,
    ];
}
