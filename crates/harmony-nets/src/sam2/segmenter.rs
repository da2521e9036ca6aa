//! SAM 2 as the pipeline's segmenter.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_roles::{PlayerCard, RoleError, SegmentPrompt, SegmentRequest, SegmentedMask, Segmenter};
use harmony_scene::{ImageSize, Mask};
use image::RgbImage;

use super::{Masks, Prompt, Sam2, mask_at};
use crate::NetError;
use crate::backend::Backend;

/// Name on the player's card.
const PLAYER: &str = "native";

/// Boxes to masks by SAM 2; a photo is encoded once for all its objects.
pub struct Sam2Segmenter<B: Backend> {
    network: Arc<Sam2<B>>,
    model: String,
}

impl<B: Backend> Sam2Segmenter<B> {
    /// A segmenter that says of itself that it is `model`, such as `sam2.1 large (cpu)`.
    pub fn new(network: Arc<Sam2<B>>, model: impl Into<String>) -> Self {
        Self { network, model: model.into() }
    }
}

#[async_trait]
impl<B: Backend + 'static> Segmenter for Sam2Segmenter<B> {
    fn card(&self) -> PlayerCard {
        // One at a time: each call uses the whole device.
        PlayerCard { player: PLAYER.to_owned(), model: self.model.clone(), offline: false, concurrency: 1 }
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        let (network, image, prompts) = (self.network.clone(), request.image.clone(), request.prompts.clone());
        let work = tokio::task::spawn_blocking(move || segment(&network, &image, &prompts));
        let capable = |reason: String| RoleError::NotCapable { player: PLAYER.to_owned(), reason };
        match work.await {
            Ok(Ok(masks)) => Ok(masks),
            Ok(Err(error)) => Err(capable(error.to_string())),
            Err(error) => Err(capable(format!("the computation broke off: {error}"))),
        }
    }
}

/// One mask a prompt, in order; empty for boxes that hold no pixel.
fn segment<B: Backend>(
    network: &Sam2<B>,
    image: &RgbImage,
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
    let encoded = network.encode(image)?;
    for (place, masks) in places.into_iter().zip(network.predict(&encoded, &boxes, Masks::Best)?) {
        let Some(best) = masks.into_iter().next() else { continue };
        let score = Some(f64::from(best.iou).clamp(0.0, 1.0)).filter(|s| s.is_finite());
        answers[place] = SegmentedMask { mask: mask_at(&best.logits, size), score };
    }
    Ok(answers)
}
