//! From the frame of a crop to a frame that an editor draws in, and back.
//!
//! Editors draw at sizes of their own. The crop is laid in the middle of a canvas that has such a size, and what comes
//! back is brought to the canvas's size, cut to the crop's place and brought to the crop's size. An answer whose shape
//! is not the canvas's has been framed anew: nothing in it is where it was, so it is refused.

use harmony_scene::{ImageSize, Mask};
use image::imageops::{FilterType, crop_imm, resize};
use image::{Rgb, RgbImage, RgbaImage};

/// Largest relative difference between the shapes of canvas and answer. Services round their sizes to multiples of
/// their blocks (1184 x 864 for 4:3 is 2.8 % off).
const MAX_SHAPE_ERROR: f64 = 0.05;

/// Shortest and longest sides of what is sent where the service takes any size, pixels.
const SENT_PX: (u32, u32) = (768, 1536);

/// Which sizes an editor draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sizes {
    /// Any size of one of these shapes (width to height).
    Shapes(&'static [(u32, u32)]),
    /// One of these sizes.
    Fixed(&'static [(u32, u32)]),
    /// Sides that are multiples of a block, within a number of pixels, no side longer than three times the other.
    Blocks {
        /// Sides are multiples of this.
        block: u32,
        /// Fewest pixels.
        least: u32,
        /// Most pixels.
        most: u32,
    },
}

/// Shapes that Gemini's image models draw.
pub const GEMINI: Sizes =
    Sizes::Shapes(&[(1, 1), (2, 3), (3, 2), (3, 4), (4, 3), (4, 5), (5, 4), (9, 16), (16, 9), (21, 9)]);

/// Sizes of gpt-image-1 and 1.5.
pub const GPT_IMAGE_1: Sizes = Sizes::Fixed(&[(1024, 1024), (1536, 1024), (1024, 1536)]);

/// Sizes of gpt-image-2; it takes more pixels, at a higher price.
pub const GPT_IMAGE_2: Sizes = Sizes::Blocks { block: 16, least: 1_000_000, most: 1_600_000 };

/// Sizes that diffusion models on local servers draw well.
pub const LOCAL: Sizes = Sizes::Blocks { block: 16, least: 500_000, most: 1_050_000 };

/// A crop's place in a canvas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Canvas {
    /// Size of the crop.
    pub source: ImageSize,
    /// Size of the canvas.
    pub size: ImageSize,
    /// Where the crop lies in it: left, top, width, height.
    pub place: (u32, u32, u32, u32),
    /// The shape to ask for, for services that take shapes.
    pub shape: Option<(u32, u32)>,
}

/// What lies around the crop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Around {
    /// One colour.
    Plain([u8; 3]),
    /// The crop's border pixels, drawn out.
    Border,
}

impl Canvas {
    /// The canvas for a crop.
    pub fn new(source: ImageSize, sizes: Sizes) -> Self {
        let (w, h) = (f64::from(source.width.max(1)), f64::from(source.height.max(1)));
        let waste = |(a, b): &(u32, u32)| ((f64::from(*a) / f64::from(*b)) / (w / h)).ln().abs();
        let nearest = |all: &[(u32, u32)]| all.iter().copied().min_by(|a, b| waste(a).total_cmp(&waste(b)));
        let (size, shape) = match sizes {
            Sizes::Fixed(all) => (nearest(all).unwrap_or((1024, 1024)), None),
            Sizes::Shapes(all) => {
                let (a, b) = nearest(all).unwrap_or((1, 1));
                let ratio = f64::from(a) / f64::from(b);
                let long = w.max(h).clamp(f64::from(SENT_PX.0), f64::from(SENT_PX.1));
                let scale = long / w.max(h);
                // The smallest canvas of the shape that holds the scaled crop.
                let width = (w * scale).max(h * scale * ratio);
                ((width.round() as u32, (width / ratio).round() as u32), Some((a, b)))
            }
            Sizes::Blocks { block, least, most } => {
                let ratio = (w / h).clamp(1.0 / 3.0, 3.0);
                let pixels = (w * h).clamp(f64::from(least), f64::from(most));
                let rounded = |side: f64| ((side / f64::from(block)).round() as u32).max(1) * block;
                ((rounded((pixels * ratio).sqrt()), rounded((pixels / ratio).sqrt())), None)
            }
        };
        let scale = (f64::from(size.0) / w).min(f64::from(size.1) / h);
        let fit = |side: f64, most: u32| ((side * scale).round() as u32).clamp(1, most);
        let (width, height) = (fit(w, size.0), fit(h, size.1));
        let place = ((size.0 - width) / 2, (size.1 - height) / 2, width, height);
        Self { source, size: ImageSize::new(size.0, size.1), place, shape }
    }

    /// Lays a picture of the crop's size in the canvas.
    pub fn lay(&self, image: &RgbImage, around: Around) -> RgbImage {
        let (left, top, width, height) = self.place;
        let scaled = resize(image, width, height, FilterType::CatmullRom);
        RgbImage::from_fn(self.size.width, self.size.height, |x, y| {
            let inside = x >= left && y >= top && x < left + width && y < top + height;
            match around {
                Around::Plain(color) if !inside => Rgb(color),
                _ => {
                    let at = |v: u32, first: u32, count: u32| v.saturating_sub(first).min(count - 1);
                    *scaled.get_pixel(at(x, left, width), at(y, top, height))
                }
            }
        })
    }

    /// Lays a mask of the crop's size in the canvas; around the crop nothing is set.
    pub fn lay_mask(&self, mask: &Mask) -> Mask {
        let (left, top, width, height) = self.place;
        let scaled = mask.resized(ImageSize::new(width, height));
        Mask::from_fn(self.size, |x, y| scaled.get(i64::from(x) - i64::from(left), i64::from(y) - i64::from(top)))
    }

    /// Brings an answer back to the crop's frame and size.
    ///
    /// # Errors
    /// In words, when the answer has another shape.
    pub fn bring_back(&self, edited: &RgbaImage) -> Result<RgbaImage, String> {
        let (w, h) = edited.dimensions();
        let (cw, ch) = (self.size.width, self.size.height);
        let off = (f64::from(w) / f64::from(h.max(1))) / (f64::from(cw) / f64::from(ch)) - 1.0;
        if w == 0 || h == 0 || off.abs() > MAX_SHAPE_ERROR {
            return Err(format!(
                "the image is {w} x {h} pixels, of another shape than the {cw} x {ch} that were sent: \
                 its content is not where it was"
            ));
        }
        let (left, top, width, height) = self.place;
        let canvas = if (w, h) == (cw, ch) { edited.clone() } else { resize(edited, cw, ch, FilterType::CatmullRom) };
        let crop = crop_imm(&canvas, left, top, width, height).to_image();
        let (sw, sh) = (self.source.width, self.source.height);
        Ok(if (width, height) == (sw, sh) { crop } else { resize(&crop, sw, sh, FilterType::CatmullRom) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    const ALL: [Sizes; 4] = [GEMINI, GPT_IMAGE_1, GPT_IMAGE_2, LOCAL];

    #[test]
    fn what_is_laid_down_comes_back_where_it_was() {
        for (w, h) in [(320, 240), (97, 401), (1000, 300)] {
            // A white square on dark ground, whose centre is looked for afterwards.
            let inside = |x: u32, y: u32| (w / 4..w / 2).contains(&x) && (h / 2..h * 3 / 4).contains(&y);
            let image = RgbImage::from_fn(w, h, |x, y| if inside(x, y) { Rgb([255; 3]) } else { Rgb([10; 3]) });
            for sizes in ALL {
                let canvas = Canvas::new(ImageSize::new(w, h), sizes);
                let laid = canvas.lay(&image, Around::Border);
                assert_eq!(laid.dimensions(), (canvas.size.width, canvas.size.height));
                // An editor that draws at 4/3 of the size, off in shape by a rounding to 32.
                let (ew, eh) = (laid.width() * 4 / 3 / 32 * 32, laid.height() * 4 / 3 / 32 * 32);
                let edited = image::DynamicImage::ImageRgb8(resize(&laid, ew, eh, FilterType::Triangle)).to_rgba8();
                let back = canvas.bring_back(&edited).unwrap();
                assert_eq!(back.dimensions(), (w, h));
                let (mut sum, mut n) = ((0.0, 0.0), 0.0);
                for (x, y, p) in back.enumerate_pixels() {
                    if p.0[0] > 128 {
                        sum = (sum.0 + f64::from(x) + 0.5, sum.1 + f64::from(y) + 0.5);
                        n += 1.0;
                    }
                }
                let centre = (sum.0 / n, sum.1 / n);
                let want = (f64::from(w / 4 + w / 2) / 2.0, f64::from(h / 2 + h * 3 / 4) / 2.0);
                // Half a per cent of the longer side: the scaling of each crop rounds to pixels of the canvas.
                let tolerance = 1.0 + 0.005 * f64::from(w.max(h));
                let error = (centre.0 - want.0).abs().max((centre.1 - want.1).abs());
                assert!(error <= tolerance, "{w}x{h} {sizes:?}: {centre:?} {want:?}");
            }
        }
    }

    #[test]
    fn canvases_have_sizes_that_the_services_take() {
        for (w, h) in [(640, 480), (64, 64), (3000, 200), (200, 3000), (4000, 3000)] {
            let size = |sizes| Canvas::new(ImageSize::new(w, h), sizes).size;
            assert!(
                [(1024, 1024), (1536, 1024), (1024, 1536)]
                    .contains(&(size(GPT_IMAGE_1).width, size(GPT_IMAGE_1).height))
            );
            for (sizes, least, most) in [(GPT_IMAGE_2, 655_360, 8_294_400), (LOCAL, 400_000, 1_200_000)] {
                let s = size(sizes);
                assert!(s.width % 16 == 0 && s.height % 16 == 0, "{s:?}");
                assert!(s.width <= 3 * s.height + 48 && s.height <= 3 * s.width + 48, "{s:?}");
                assert!((least..=most).contains(&s.pixels()), "{s:?}");
            }
            let gemini = Canvas::new(ImageSize::new(w, h), GEMINI);
            let (a, b) = gemini.shape.unwrap();
            let off = f64::from(gemini.size.width) / f64::from(gemini.size.height) * f64::from(b) / f64::from(a) - 1.0;
            assert!(off.abs() < 0.003, "{gemini:?}");
        }
        assert_eq!(Canvas::new(ImageSize::new(1200, 900), GEMINI).shape, Some((4, 3)));
    }

    #[test]
    fn an_answer_that_was_framed_anew_is_refused() {
        let canvas = Canvas::new(ImageSize::new(640, 480), GEMINI);
        let square = RgbaImage::from_pixel(1024, 1024, Rgba([1; 4]));
        let complaint = canvas.bring_back(&square).unwrap_err();
        assert!(complaint.contains("1024 x 1024"), "{complaint}");
        assert!(canvas.bring_back(&RgbaImage::new(0, 0)).is_err());
        assert!(canvas.bring_back(&RgbaImage::from_pixel(1184, 864, Rgba([1; 4]))).is_ok());
    }

    #[test]
    fn masks_are_laid_like_pictures() {
        let size = ImageSize::new(200, 100);
        let canvas = Canvas::new(size, GPT_IMAGE_1);
        let mask = canvas.lay_mask(&Mask::from_fn(size, |x, _| x >= 100));
        let (left, top, width, height) = canvas.place;
        assert!(mask.get(i64::from(left + width - 2), i64::from(top + height / 2)));
        assert!(!mask.get(i64::from(left + 2), i64::from(top + height / 2)));
        assert_eq!(mask.get(5, 5), top == 0, "above the crop nothing is set");
    }
}
