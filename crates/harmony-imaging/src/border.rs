//! The frame of white or black pixels that undistorted and scanned pictures have around them.

use harmony_scene::{ImageSize, Mask};
use image::RgbImage;

/// Largest share of the shorter side that counts as frame.
const WIDEST: f64 = 0.06;
/// A line of pixels belongs to the frame when this share of it is white, or black.
const UNIFORM: f64 = 0.85;
/// Lines beyond the last uniform one that are mixed with the frame, pixels.
const SOFT: u32 = 2;

/// Widths of a picture's empty frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Border {
    /// Columns at the left.
    pub left: u32,
    /// Rows at the top.
    pub top: u32,
    /// Columns at the right.
    pub right: u32,
    /// Rows at the bottom.
    pub bottom: u32,
}

impl Border {
    /// Finds the frame: lines at the edge that are almost wholly white or almost wholly black.
    ///
    /// A real surface that fills the edge (an overexposed wall, night outside) is seldom uniform over a whole line
    /// and ends nowhere: a frame that reaches [`WIDEST`] is taken for the picture itself.
    pub fn of(photo: &RgbImage) -> Self {
        let (w, h) = photo.dimensions();
        let widest = (f64::from(w.min(h)) * WIDEST) as u32;
        let width = |line: &dyn Fn(u32, u32) -> (u32, u32), length: u32| {
            let uniform = |k: u32| {
                let (mut white, mut black) = (0_u32, 0_u32);
                for i in 0..length {
                    let (x, y) = line(k, i);
                    let p = photo.get_pixel(x, y).0;
                    white += u32::from(p.iter().all(|v| *v >= 245));
                    black += u32::from(p.iter().all(|v| *v <= 8));
                }
                f64::from(white.max(black)) >= UNIFORM * f64::from(length)
            };
            // One mixed line may lie between uniform ones.
            let mut found = 0;
            for k in 0..widest {
                if uniform(k) {
                    found = k + 1;
                } else if k > found {
                    break;
                }
            }
            if found == 0 || found + 1 >= widest { 0 } else { found + SOFT }
        };
        Self {
            left: width(&|k, i| (k, i), h),
            top: width(&|k, i| (i, k), w),
            right: width(&|k, i| (w - 1 - k, i), h),
            bottom: width(&|k, i| (i, h - 1 - k), w),
        }
    }

    /// The pixels of the frame.
    pub fn mask(&self, size: ImageSize) -> Mask {
        let (right, bottom) = (size.width.saturating_sub(self.right), size.height.saturating_sub(self.bottom));
        Mask::from_fn(size, |x, y| x < self.left || y < self.top || x >= right || y >= bottom)
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// Grey noise in a frame of the given widths (left, top, right, bottom).
    fn framed(widths: [u32; 4], color: [u8; 3]) -> RgbImage {
        RgbImage::from_fn(200, 150, |x, y| {
            if x < widths[0] || y < widths[1] || x >= 200 - widths[2] || y >= 150 - widths[3] {
                Rgb(color)
            } else {
                let v = 60 + ((x * 7 + y * 13) % 90) as u8;
                Rgb([v, v, v])
            }
        })
    }

    #[test]
    fn frames_are_measured_side_by_side() {
        for color in [[255; 3], [0; 3]] {
            let b = Border::of(&framed([4, 3, 0, 5], color));
            assert_eq!((b.left, b.top, b.right, b.bottom), (4 + SOFT, 3 + SOFT, 0, 5 + SOFT));
        }
        assert_eq!(Border::of(&framed([0; 4], [0; 3])), Border::default());
    }

    #[test]
    fn a_white_wall_is_no_frame() {
        let wall = RgbImage::from_fn(200, 150, |x, _| if x < 90 { Rgb([255; 3]) } else { Rgb([90, 80, 70]) });
        assert_eq!(Border::of(&wall), Border::default());
        assert_eq!(Border::of(&RgbImage::from_pixel(3, 2, Rgb([255; 3]))), Border::default());
    }

    #[test]
    fn the_mask_holds_the_frame_only() {
        let b = Border { left: 2, top: 1, right: 0, bottom: 0 };
        let mask = b.mask(ImageSize::new(6, 4));
        assert_eq!(mask.count(), 2 * 4 + 4);
    }
}
