//! SAM 2 as the pipeline's segmenter.

use std::path::Path;
use std::sync::Arc;

use async_trait::async_trait;
use harmony_roles::{PlayerCard, RoleError, SegmentPrompt, SegmentRequest, SegmentedMask, Segmenter};
use harmony_scene::{ImageSize, Mask};
use image::RgbImage;
use rayon::prelude::*;

use super::{Encoded, Masks, Prompt, Sam2, Sam2Config, Sam2Size, mask_at};
use crate::backend::Backend;
use crate::player::{self, Last};
use crate::{NetError, WeightError, WeightFile};

/// Name on the player's card.
const PLAYER: &str = "sam2";

/// Boxes to masks by SAM 2; a photo is encoded once for all its objects, and for the requests that follow about it.
pub struct Sam2Segmenter<B: Backend> {
    seen: Arc<Seen<B>>,
    model: String,
}

struct Seen<B: Backend> {
    network: Sam2<B>,
    last: Last<Encoded<B>>,
}

impl<B: Backend> Sam2Segmenter<B> {
    /// Reads a checkpoint in its original layout: `sam2.1_hiera_*.pt`, or the same keys as safetensors.
    ///
    /// # Errors
    /// [`NetError::Weights`] for a file that is missing, broken, of another size or of another layout, and what the device
    /// says.
    pub fn load(path: &Path, size: Sam2Size, backend: Arc<B>) -> Result<Self, NetError> {
        let file = WeightFile::open(path)?;
        if file.keys().any(|key| key.starts_with("vision_encoder.")) {
            let reason =
                "this is SAM 2 in transformers' layout; the original one (image_encoder.trunk...) is read".to_owned();
            return Err(WeightError::Malformed { path: path.to_owned(), reason }.into());
        }
        // Published files keep everything below one key.
        let below = if file.keys().any(|key| key.starts_with("model.")) { "model" } else { "" };
        let model = format!("sam2 hiera {}, {}", size.name(), backend.device());
        let network = Sam2::load(backend, &file.at(below), Sam2Config::of(size))?;
        Ok(Self::new(network, model))
    }

    /// A segmenter that says of itself that it is `model`.
    pub fn new(network: Sam2<B>, model: impl Into<String>) -> Self {
        Self { seen: Arc::new(Seen { network, last: Last::default() }), model: model.into() }
    }
}

#[async_trait]
impl<B: Backend + 'static> Segmenter for Sam2Segmenter<B> {
    fn card(&self) -> PlayerCard {
        player::card(PLAYER, &self.model)
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        let (seen, image, prompts) = (self.seen.clone(), request.image.clone(), request.prompts.clone());
        player::computed(PLAYER, move || segment(&seen, &image, &prompts)).await
    }
}

/// One mask a prompt, in order; empty for boxes that hold no pixel.
fn segment<B: Backend>(
    seen: &Seen<B>,
    image: &Arc<RgbImage>,
    prompts: &[SegmentPrompt],
) -> Result<Vec<SegmentedMask>, NetError> {
    let size = ImageSize::new(image.width(), image.height());
    let mut answers = vec![SegmentedMask { mask: Mask::empty(size), score: None }; prompts.len()];
    let usable = |p: &SegmentPrompt| {
        let b = p.bounds.clamped(size);
        // NaN fails.
        (b.area() > 0.0).then(|| Prompt::from_box([b.x0, b.y0, b.x1, b.y1]))
    };
    let (places, boxes): (Vec<usize>, Vec<Prompt>) =
        prompts.iter().enumerate().filter_map(|(i, p)| Some((i, usable(p)?))).unzip();
    if boxes.is_empty() {
        return Ok(answers);
    }
    let encoded = seen.last.of(image, |image| seen.network.encode(image))?;
    let predicted = seen.network.predict(&encoded, &boxes, Masks::Best)?;
    let whole = predicted.par_iter().map(|masks| {
        let best = masks.first()?;
        let score = Some(f64::from(best.iou).clamp(0.0, 1.0)).filter(|s| s.is_finite());
        Some(SegmentedMask { mask: mask_at(&best.logits, size), score })
    });
    for (place, answer) in places.into_iter().zip(whole.collect::<Vec<_>>()) {
        if let Some(answer) = answer {
            answers[place] = answer;
        }
    }
    Ok(answers)
}
