//! Grey images for the line detector.

use harmony_scene::ImageSize;

/// An image cannot be made from what was given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The buffer has another length than the size says.
    #[error("{width} x {height} pixels need {wanted} values, got {got}")]
    WrongLength {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Values needed.
        wanted: usize,
        /// Values given.
        got: usize,
    },
}

/// A grey image, sRGB-encoded luma in 0..=1, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct GrayImage {
    size: ImageSize,
    luma: Vec<f32>,
}

impl GrayImage {
    /// From 8-bit luma (sRGB encoded), one byte a pixel.
    ///
    /// # Errors
    /// [`ImageError::WrongLength`].
    pub fn from_luma8(size: ImageSize, luma: &[u8]) -> Result<Self, ImageError> {
        check(size, luma.len(), size.pixels())?;
        Ok(Self { size, luma: luma.iter().map(|v| f32::from(*v) / 255.0).collect() })
    }

    /// From 8-bit RGB (sRGB encoded), three bytes a pixel; Rec. 601 luma.
    ///
    /// # Errors
    /// [`ImageError::WrongLength`].
    pub fn from_rgb8(size: ImageSize, rgb: &[u8]) -> Result<Self, ImageError> {
        check(size, rgb.len(), size.pixels() * 3)?;
        let luma = rgb
            .chunks_exact(3)
            .map(|c| (0.299 * f32::from(c[0]) + 0.587 * f32::from(c[1]) + 0.114 * f32::from(c[2])) / 255.0)
            .collect();
        Ok(Self { size, luma })
    }

    /// Columns and rows.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// Values, row-major.
    pub fn luma(&self) -> &[f32] {
        &self.luma
    }

    /// The image averaged down (area filter) so that its longer side is at most `longest` pixels.
    #[must_use]
    pub fn fit_within(&self, longest: u32) -> Self {
        let to = self.size.fit_within(longest.max(1));
        if to == self.size || self.size.pixels() == 0 {
            return self.clone();
        }
        // Separable box filter with fractional ends: exact area averages, so that edges stay where they are.
        let columns = spans(self.size.width, to.width);
        let rows = spans(self.size.height, to.height);
        let from_width = self.size.width as usize;
        let mut narrow = vec![0.0f32; columns.len() * self.size.height as usize];
        for (row_in, row_out) in self.luma.chunks_exact(from_width).zip(narrow.chunks_exact_mut(columns.len())) {
            for (value, span) in row_out.iter_mut().zip(&columns) {
                *value = span.iter().map(|(i, w)| row_in[*i] * w).sum();
            }
        }
        let mut luma = vec![0.0f32; to.pixels()];
        for (row_out, span) in luma.chunks_exact_mut(columns.len()).zip(&rows) {
            for (i, w) in span {
                let row_in = &narrow[i * columns.len()..(i + 1) * columns.len()];
                for (out, v) in row_out.iter_mut().zip(row_in) {
                    *out += v * w;
                }
            }
        }
        Self { size: to, luma }
    }
}

/// For each of `to` cells, the source indices it covers with weights that sum to 1.
fn spans(from: u32, to: u32) -> Vec<Vec<(usize, f32)>> {
    let k = f64::from(from) / f64::from(to);
    (0..to)
        .map(|cell| {
            let (start, end) = (f64::from(cell) * k, f64::from(cell + 1) * k);
            let last = (end.ceil() as usize).min(from as usize);
            (start as usize..last)
                .map(|i| {
                    let covered = (end.min(i as f64 + 1.0) - start.max(i as f64)).max(0.0);
                    (i, (covered / k) as f32)
                })
                .collect()
        })
        .collect()
}

fn check(size: ImageSize, got: usize, wanted: usize) -> Result<(), ImageError> {
    if got == wanted {
        Ok(())
    } else {
        Err(ImageError::WrongLength { width: size.width, height: size.height, wanted, got })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_stays_where_it_is_when_the_image_shrinks() {
        let size = ImageSize::new(300, 10);
        let bytes: Vec<u8> = (0..size.pixels()).map(|i| if i % 300 < 150 { 0 } else { 255 }).collect();
        let small = GrayImage::from_luma8(size, &bytes).unwrap().fit_within(77);
        let row = &small.luma()[..77];
        // The dark half is 38.5 of 77 cells: what is missing to white sums to it.
        let dark: f32 = row.iter().map(|v| 1.0 - v).sum();
        assert!((dark - 38.5).abs() <= 1e-3, "dark {dark}");
    }

    #[test]
    fn a_wrong_buffer_is_refused() {
        assert!(GrayImage::from_luma8(ImageSize::new(3, 3), &[0; 8]).is_err());
    }
}
