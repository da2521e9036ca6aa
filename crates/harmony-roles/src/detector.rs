//! `Detector`: boxes for phrases.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_scene::{Level, PixelBox};
use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::{PlayerCard, RoleError, Usage};

/// One kind of thing to look for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhraseRequest {
    /// Label the results will carry.
    pub label: String,
    /// Grounding phrase, alternatives joined by ` . `.
    pub phrase: String,
    /// How many the VLM counted; 0 = not counted.
    pub count: usize,
}

/// What to look for in a photo.
#[derive(Debug, Clone)]
pub struct DetectRequest {
    /// Stable call name.
    pub name: String,
    /// The photo.
    pub image: Arc<RgbImage>,
    /// Which level the phrases belong to.
    pub level: Level,
    /// Phrases.
    pub phrases: Vec<PhraseRequest>,
}

/// One box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Detection {
    /// Label of the phrase that found it.
    pub label: String,
    /// The phrase.
    pub phrase: String,
    /// Pixels of the request's image.
    #[serde(rename = "box")]
    pub bounds: PixelBox,
    /// Score of the detector, 0 to 1; `None` when it gives none. Never invented.
    pub score: Option<f64>,
    /// A rough outline in pixels, for players that can draw one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outline: Option<Vec<[f64; 2]>>,
}

/// All boxes, best first within a label.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Detections {
    /// The boxes.
    pub detections: Vec<Detection>,
    /// What it used; belongs to the call's bill, not to the answer, and is not kept with it.
    #[serde(skip)]
    pub usage: Usage,
}

/// Finds boxes for phrases in a photo.
///
/// Cast in the paper: LocateAnything (App. B.1). Having looked and found nothing is an empty list, not an error.
#[async_trait]
pub trait Detector: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Whether it gives boxes. Where it does not, they are asked for with the language model's lists.
    fn gives_boxes(&self) -> bool {
        true
    }

    /// Whether it knows what it boxes. Where it does not, and nobody else looks, a box is only believed where what is put
    /// there fits well.
    fn recognises(&self) -> bool {
        true
    }

    /// Looks for every phrase of the request.
    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError>;
}
