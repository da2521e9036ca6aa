//! Mask files as a segmenter, and as a detector where they carry labels.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_io::LoadedMask;
use harmony_roles::{
    DetectRequest, Detection, Detections, Detector, PlayerCard, RoleError, SegmentPrompt, SegmentRequest,
    SegmentedMask, Segmenter,
};
use harmony_scene::{ImageSize, Mask, PixelBox};

/// Smallest overlap of box and mask at which a mask answers a prompt (intersection over union of the boxes).
const MIN_IOU: f64 = 0.3;

/// How much a label that agrees counts when masks compete for a prompt, in units of IoU.
const LABEL_BONUS: f64 = 0.25;

/// Masks that were loaded for the photo.
///
/// As a [`Segmenter`] a prompt gets the mask whose box agrees best with it, each mask is given once, and a prompt that
/// no mask agrees with is left empty. As a [`Detector`] the masks with labels answer the phrases that mean them.
#[derive(Clone)]
pub struct MaskFiles {
    masks: Vec<(LoadedMask, PixelBox)>,
    digest: String,
    rest: Option<Arc<dyn Segmenter>>,
}

impl std::fmt::Debug for MaskFiles {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MaskFiles").field("masks", &self.masks.len()).finish_non_exhaustive()
    }
}

impl MaskFiles {
    /// Takes loaded masks; empty ones are left out.
    pub fn new(masks: Vec<LoadedMask>) -> Self {
        let mut hasher = harmony_calls::KeyHasher::new(harmony_roles::Role::Segmenter);
        for one in &masks {
            hasher.text("name", &one.name);
            hasher.text("label", one.label.as_deref().unwrap_or_default());
            hasher.mask("mask", Some(&one.mask));
        }
        let digest = hasher.finish().0.chars().take(16).collect();
        let masks = masks.into_iter().filter_map(|one| one.mask.bounds().map(|b| (one, b))).collect();
        Self { masks, digest, rest: None }
    }

    /// Has prompts that no mask agrees with cut out by another segmenter.
    #[must_use]
    pub fn with_rest(self, rest: Arc<dyn Segmenter>) -> Self {
        Self { rest: Some(rest), ..self }
    }

    /// Whether any mask says what it shows, so that they can be cast as a detector.
    pub fn have_labels(&self) -> bool {
        self.masks.iter().any(|(one, _)| one.label.is_some())
    }

    /// How many masks there are.
    pub fn count(&self) -> usize {
        self.masks.len()
    }

    fn card(&self) -> PlayerCard {
        // The content is part of the name: other masks are another player, whose answers are not mixed up.
        let rest = self.rest.as_ref().map_or_else(String::new, |rest| format!(", the rest by {}", rest.card().model));
        let model = format!("{} masks {}{rest}", self.masks.len(), self.digest);
        PlayerCard { player: "mask files".to_owned(), model, offline: true, concurrency: 0 }
    }

    /// How well a mask answers a prompt.
    fn agreement(prompt: &SegmentPrompt, mask: &LoadedMask, bounds: &PixelBox) -> f64 {
        let iou = prompt.bounds.iou(bounds);
        let named = mask.label.as_deref().is_some_and(|label| means(&prompt.label, label));
        if iou < MIN_IOU { 0.0 } else { iou + if named { LABEL_BONUS } else { 0.0 } }
    }
}

/// Whether a phrase (alternatives joined by ` . `) and a label share their main word, or one holds the other.
fn means(phrase: &str, label: &str) -> bool {
    let words = |text: &str| -> Vec<String> {
        let parts = text.to_lowercase();
        parts.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty()).map(singular).collect()
    };
    let label = words(label);
    let Some(head) = label.last() else { return false };
    phrase.split(" . ").any(|alternative| {
        let alternative = words(alternative);
        alternative.last() == Some(head) || (label.len() > 1 && alternative.windows(label.len()).any(|w| w == label))
    })
}

/// A word without the ending of the plural.
fn singular(word: &str) -> String {
    let short = word.strip_suffix('s').filter(|short| short.len() > 2 && !short.ends_with('s'));
    short.unwrap_or(word).to_owned()
}

#[async_trait]
impl Segmenter for MaskFiles {
    fn card(&self) -> PlayerCard {
        Self::card(self)
    }

    async fn segment(&self, request: &SegmentRequest) -> Result<Vec<SegmentedMask>, RoleError> {
        let size = ImageSize::new(request.image.width(), request.image.height());
        let scaled: Vec<(&LoadedMask, Mask, PixelBox)> = self
            .masks
            .iter()
            .filter_map(|(one, _)| {
                let mask = one.mask.resized(size);
                mask.bounds().map(|bounds| (one, mask, bounds))
            })
            .collect();
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (p, prompt) in request.prompts.iter().enumerate() {
            for (m, (one, _, bounds)) in scaled.iter().enumerate() {
                let agreement = Self::agreement(prompt, one, bounds);
                if agreement > 0.0 {
                    pairs.push((agreement, p, m));
                }
            }
        }
        // Best agreement first; ties by order, so that the answer does not depend on the sort.
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        let mut answer: Vec<SegmentedMask> =
            request.prompts.iter().map(|_| SegmentedMask { mask: Mask::empty(size), score: None }).collect();
        let mut used = vec![false; scaled.len()];
        let mut served = vec![false; request.prompts.len()];
        for (_, p, m) in pairs {
            if !served[p] && !used[m] {
                served[p] = true;
                used[m] = true;
                answer[p].mask = scaled[m].1.clone();
            }
        }
        let missing: Vec<usize> = (0..served.len()).filter(|p| !served[*p]).collect();
        if let Some(rest) = self.rest.as_ref().filter(|_| !missing.is_empty()) {
            let prompts = missing.iter().map(|p| request.prompts[*p].clone()).collect();
            let cut = rest.segment(&SegmentRequest { prompts, ..request.clone() }).await?;
            for (p, mut one) in missing.into_iter().zip(cut) {
                // What the given masks cover is settled.
                for (m, (_, mask, _)) in scaled.iter().enumerate() {
                    if used[m] && one.mask.size() == size {
                        one.mask = one.mask.minus(mask);
                    }
                }
                answer[p] = one;
            }
        }
        Ok(answer)
    }
}

#[async_trait]
impl Detector for MaskFiles {
    fn card(&self) -> PlayerCard {
        Self::card(self)
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        if !self.have_labels() {
            return Err(RoleError::NotCapable {
                player: Self::card(self).player,
                reason: "the masks don't say what they show".to_owned(),
            });
        }
        let size = ImageSize::new(request.image.width(), request.image.height());
        let mut used = vec![false; self.masks.len()];
        let mut detections = Vec::new();
        for phrase in &request.phrases {
            for (m, (one, _)) in self.masks.iter().enumerate() {
                let Some(label) = &one.label else { continue };
                if used[m] || !(means(&phrase.phrase, label) || means(&phrase.label, label)) {
                    continue;
                }
                let Some(bounds) = one.mask.resized(size).bounds() else { continue };
                used[m] = true;
                detections.push(Detection {
                    label: phrase.label.clone(),
                    phrase: phrase.phrase.clone(),
                    bounds,
                    score: None,
                    outline: None,
                });
            }
        }
        Ok(Detections { detections, ..Detections::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phrases_and_labels_meet_in_their_main_word() {
        assert!(means("dining chair . wooden chair", "chair"));
        assert!(means("chairs", "dining chair"));
        assert!(means("glass", "glass"));
        assert!(!means("chair leg", "chair"));
        assert!(!means("table", "table lamp"));
        assert!(means("brass table lamp on it", "table lamp"));
        assert!(!means("lamp", ""));
    }
}
