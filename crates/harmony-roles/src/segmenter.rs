//! `Segmenter`: a mask for a box.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_scene::{Mask, PixelBox};
use image::RgbImage;

use crate::{PlayerCard, RoleError};

/// One object to cut out.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentPrompt {
    /// Key of the object in the request, such as its provisional id.
    pub key: String,
    /// Label in words.
    pub label: String,
    /// Box in pixels.
    pub bounds: PixelBox,
    /// Rough outline in pixels, if somebody drew one.
    pub outline: Option<Vec<[f64; 2]>>,
}

/// All objects of one photo: the image is encoded once.
#[derive(Debug, Clone)]
pub struct SegmentRequest {
    /// Stable call name.
    pub name: String,
    /// The photo.
    pub image: Arc<RgbImage>,
    /// Objects.
    pub prompts: Vec<SegmentPrompt>,
}

/// One mask.
#[derive(Debug, Clone)]
pub struct SegmentedMask {
    /// Full-frame mask.
    pub mask: Mask,
    /// The segmenter's own quality estimate, 0 to 1; `None` when it gives none.
    pub score: Option<f64>,
}

/// Cuts objects out of a photo.
///
/// Cast in the paper: SAM2. The answer has one entry a prompt, in order; an object that could not be cut out has an
/// empty mask.
#[async_trait]
pub trait Segmenter: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Segments every prompt.
    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError>;
}
