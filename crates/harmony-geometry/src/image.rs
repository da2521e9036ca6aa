//! Grey images for the line detector.
//!
//! sRGB-encoded luma in 0 to 1, row-major, averaged down by areas so that edges stay where they are to a fraction of a
//! pixel; the centre of the first pixel is (0.5, 0.5). A thumbnail keeps the colours of the same view. Files are not
//! read here: whoever has a decoded picture hands over its bytes.

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

/// Longer side of the colour thumbnail, pixels.
const THUMBNAIL_PX: u32 = 64;

/// A grey image, sRGB-encoded luma in 0..=1, row-major; with a small colour thumbnail of the same view.
#[derive(Debug, Clone, PartialEq)]
pub struct GrayImage {
    size: ImageSize,
    luma: Vec<f32>,
    thumbnail_size: ImageSize,
    thumbnail: Vec<[f32; 3]>,
}

impl GrayImage {
    /// From 8-bit luma (sRGB encoded), one byte a pixel.
    ///
    /// # Errors
    /// [`ImageError::WrongLength`].
    pub fn from_luma8(size: ImageSize, luma: &[u8]) -> Result<Self, ImageError> {
        check(size, luma.len(), size.pixels())?;
        let luma: Vec<f32> = luma.iter().map(|v| f32::from(*v) / 255.0).collect();
        let (thumbnail_size, small) = shrink(size, &luma, size.fit_within(THUMBNAIL_PX));
        Ok(Self { size, luma, thumbnail_size, thumbnail: small.into_iter().map(|v| [v; 3]).collect() })
    }

    /// From 8-bit RGB (sRGB encoded), three bytes a pixel; Rec. 601 luma.
    ///
    /// # Errors
    /// [`ImageError::WrongLength`].
    pub fn from_rgb8(size: ImageSize, rgb: &[u8]) -> Result<Self, ImageError> {
        check(size, rgb.len(), size.pixels() * 3)?;
        let channel = |k: usize| rgb.chunks_exact(3).map(|c| f32::from(c[k]) / 255.0).collect::<Vec<f32>>();
        let [r, g, b] = [0, 1, 2].map(channel);
        let luma = r.iter().zip(&g).zip(&b).map(|((r, g), b)| 0.299 * r + 0.587 * g + 0.114 * b).collect();
        let thumbnail_size = size.fit_within(THUMBNAIL_PX);
        let [r, g, b] = [r, g, b].map(|c| shrink(size, &c, thumbnail_size).1);
        let thumbnail = r.into_iter().zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect();
        Ok(Self { size, luma, thumbnail_size, thumbnail })
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
        let (size, luma) = shrink(self.size, &self.luma, self.size.fit_within(longest.max(1)));
        Self { size, luma, thumbnail_size: self.thumbnail_size, thumbnail: self.thumbnail.clone() }
    }

    /// A thumbnail of at most 64 pixels, sRGB-encoded colours in 0..=1 (grey where the image was made from luma).
    pub(crate) fn thumbnail(&self) -> (ImageSize, &[[f32; 3]]) {
        (self.thumbnail_size, &self.thumbnail)
    }
}

/// Area averages: separable box filter with fractional ends, so that edges stay where they are.
fn shrink(from: ImageSize, values: &[f32], to: ImageSize) -> (ImageSize, Vec<f32>) {
    if to == from || from.pixels() == 0 {
        return (from, values.to_vec());
    }
    let columns = spans(from.width, to.width);
    let rows = spans(from.height, to.height);
    let mut narrow = vec![0.0f32; columns.len() * from.height as usize];
    for (row_in, row_out) in values.chunks_exact(from.width as usize).zip(narrow.chunks_exact_mut(columns.len())) {
        for (value, span) in row_out.iter_mut().zip(&columns) {
            *value = span.iter().map(|(i, w)| row_in[*i] * w).sum();
        }
    }
    let mut out = vec![0.0f32; to.pixels()];
    for (row_out, span) in out.chunks_exact_mut(columns.len()).zip(&rows) {
        for (i, w) in span {
            let row_in = &narrow[i * columns.len()..(i + 1) * columns.len()];
            for (o, v) in row_out.iter_mut().zip(row_in) {
                *o += v * w;
            }
        }
    }
    (to, out)
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
