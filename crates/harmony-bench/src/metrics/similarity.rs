//! How alike two pictures look to networks: N-CLIP and LPIPS.
//!
//! The networks themselves are not here: whoever has their weights hands a [`Similarity`] in.

use std::fmt::Debug;
use std::sync::Arc;

use image::RgbImage;

use super::picture::resize_bicubic;
use harmony_scene::ImageSize;

/// Figures of a pair of pictures; `None` for what cannot be measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Alike {
    /// N-CLIP: one minus the cosine of the pictures' CLIP ViT-B/32 features.
    pub n_clip: Option<f64>,
    /// LPIPS 0.1 with AlexNet.
    pub lpips: Option<f64>,
}

/// Networks that look at pictures.
pub trait Similarity: Send + Sync + Debug {
    /// Compares two pictures of one size.
    fn compare(&self, render: &RgbImage, target: &RgbImage) -> Alike;
}

/// Who measures, and what is not measured and why.
#[derive(Debug, Clone, Default)]
pub struct Looking {
    /// The networks, where there are any.
    pub similarity: Option<Arc<dyn Similarity>>,
    /// A sentence for each figure that is missing.
    pub absent: Vec<String>,
}

impl Looking {
    /// Compares a render with its photo as VIGA's evaluation does it: the photo is resized to the render's size
    /// (Pillow's bicubic filter). LPIPS has no protocol there; it gets the same two pictures.
    pub fn compare(&self, render: &RgbImage, photo: &RgbImage) -> Alike {
        let size = ImageSize::new(render.width(), render.height());
        match (&self.similarity, resize_bicubic(photo, size)) {
            (Some(similarity), Some(target)) => similarity.compare(render, &target),
            _ => Alike::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tells the sizes it was given.
    #[derive(Debug)]
    struct Sizes;

    impl Similarity for Sizes {
        fn compare(&self, render: &RgbImage, target: &RgbImage) -> Alike {
            assert_eq!(render.dimensions(), target.dimensions());
            Alike { n_clip: Some(f64::from(render.width())), lpips: None }
        }
    }

    #[test]
    fn the_photo_is_brought_to_the_renders_size() {
        let looking = Looking { similarity: Some(Arc::new(Sizes)), absent: Vec::new() };
        let found = looking.compare(&RgbImage::new(8, 6), &RgbImage::new(16, 12));
        assert_eq!(found, Alike { n_clip: Some(8.0), lpips: None });
        assert_eq!(looking.compare(&RgbImage::new(0, 0), &RgbImage::new(16, 12)), Alike::default());
        assert_eq!(Looking::default().compare(&RgbImage::new(8, 6), &RgbImage::new(8, 6)), Alike::default());
    }
}
