//! OWLv2 as the pipeline's detector.

use std::path::Path;
use std::sync::Arc;

use async_trait::async_trait;
use harmony_roles::{DetectRequest, Detection, Detections, Detector, PhraseRequest, PlayerCard, RoleError};
use harmony_scene::{ImageSize, PixelBox};
use image::RgbImage;

use super::{Calibration, ChoiceSettings, Owlv2, Owlv2Config, Owlv2Image, Owlv2Size, choose};
use crate::backend::Backend;
use crate::clip::{Tokenizer, TokenizerError};
use crate::player::{self, Last};
use crate::{NetError, WeightFile};

/// Name on the player's card.
const PLAYER: &str = "owlv2";

/// Parts phrases of one request.
const BETWEEN: char = '.';

/// How phrases are asked and boxes chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorSettings {
    /// Sentences that a phrase is put into, at `{}`; the mean of their features stands for the phrase.
    pub templates: Vec<String>,
    /// From logits to probabilities.
    pub calibration: Calibration,
    /// The choice of boxes.
    pub choice: ChoiceSettings,
    /// Sentences that go through the text tower at once.
    pub at_once: usize,
}

impl Default for DetectorSettings {
    fn default() -> Self {
        let templates = ["a photo of a {}.", "{}"].map(str::to_owned).to_vec();
        Self { templates, calibration: Calibration::default(), choice: ChoiceSettings::default(), at_once: 64 }
    }
}

/// Boxes for phrases by OWLv2. A photo is encoded once for all requests that come after one another.
pub struct Owlv2Detector<B: Backend> {
    seen: Arc<Seen<B>>,
    model: String,
}

struct Seen<B: Backend> {
    network: Owlv2<B>,
    tokenizer: Tokenizer,
    settings: DetectorSettings,
    last: Last<Owlv2Image<B>>,
}

/// Why a detector could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DetectorError {
    /// The weights or the device.
    #[error(transparent)]
    Net(#[from] NetError),
    /// The vocabulary.
    #[error(transparent)]
    Tokenizer(#[from] TokenizerError),
}

impl<B: Backend> Owlv2Detector<B> {
    /// Reads a model's folder: `model.safetensors` and the vocabulary.
    ///
    /// # Errors
    /// [`DetectorError`] for files that are missing, broken or of another size, and what the device says.
    pub fn load(
        folder: &Path,
        size: Owlv2Size,
        backend: Arc<B>,
        settings: DetectorSettings,
    ) -> Result<Self, DetectorError> {
        let tokenizer = Tokenizer::open(folder)?;
        let file = WeightFile::open(&folder.join("model.safetensors")).map_err(NetError::from)?;
        let model = format!("owlv2 {}, {}", size.name(), backend.device());
        Ok(Self::new(Owlv2::load(backend, &file, Owlv2Config::of(size))?, tokenizer, settings, model))
    }

    /// A detector that says of itself that it is `model`.
    pub fn new(network: Owlv2<B>, tokenizer: Tokenizer, settings: DetectorSettings, model: impl Into<String>) -> Self {
        let seen = Seen { network, tokenizer, settings, last: Last::default() };
        Self { seen: Arc::new(seen), model: model.into() }
    }
}

#[async_trait]
impl<B: Backend + 'static> Detector for Owlv2Detector<B> {
    fn card(&self) -> PlayerCard {
        player::card(PLAYER, &self.model)
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        let (seen, image, phrases) = (self.seen.clone(), request.image.clone(), request.phrases.clone());
        let detections = player::computed(PLAYER, move || seen.detect(&image, &phrases)).await?;
        Ok(Detections { detections, ..Detections::default() })
    }
}

impl<B: Backend> Seen<B> {
    fn detect(&self, photo: &Arc<RgbImage>, phrases: &[PhraseRequest]) -> Result<Vec<Detection>, NetError> {
        // Each alternative of a phrase is asked on its own.
        let asked: Vec<(usize, &str)> =
            phrases.iter().enumerate().flat_map(|(i, p)| alternatives(p).map(move |a| (i, a))).collect();
        if asked.is_empty() {
            return Ok(Vec::new());
        }
        let texts: Vec<&str> = asked.iter().map(|(_, text)| *text).collect();
        let features = self.phrase_features(&texts)?;
        let image = self.last.of(photo, |photo| self.network.encode(photo))?;
        let logits = self.network.logits(&image, &features)?;

        let probability = |logit: f32| self.settings.calibration.probability(f64::from(logit));
        let by_phrase = |row: &Vec<f32>| {
            // The best alternative speaks for the phrase.
            let mut best = vec![0f64; phrases.len()];
            for ((phrase, _), logit) in asked.iter().zip(row) {
                best[*phrase] = best[*phrase].max(probability(*logit));
            }
            best
        };
        let scores: Vec<Vec<f64>> = logits.iter().map(by_phrase).collect();
        let size = ImageSize::new(photo.width(), photo.height());
        let boxes: Vec<PixelBox> = image.boxes.iter().map(|b| in_pixels(*b, size)).collect();
        let counts: Vec<usize> = phrases.iter().map(|p| p.count).collect();
        let found = choose(&boxes, &scores, &counts, &self.settings.choice);
        let detection = |c: super::Candidate| Detection {
            label: phrases[c.label].label.clone(),
            phrase: phrases[c.label].phrase.clone(),
            bounds: c.bounds,
            score: Some(c.score),
            outline: None,
        };
        Ok(found.into_iter().map(detection).collect())
    }

    /// Mean unit features of each phrase over the templates.
    fn phrase_features(&self, texts: &[&str]) -> Result<Vec<Vec<f32>>, NetError> {
        let most = self.network.config().text.positions;
        let plain = ["{}".to_owned()];
        let templates = if self.settings.templates.is_empty() { &plain[..] } else { &self.settings.templates[..] };
        let sentence = |text: &str, template: &String| self.tokenizer.encode(&template.replace("{}", text), most);
        let ids: Vec<Vec<u32>> =
            texts.iter().flat_map(|text| templates.iter().map(move |t| sentence(text, t))).collect();
        let mut rows = Vec::with_capacity(ids.len());
        for some in ids.chunks(self.settings.at_once.max(1)) {
            rows.extend(self.network.embed_text(some)?);
        }
        let mean = |rows: &[Vec<f32>]| {
            let mut sum = rows[0].clone();
            for row in &rows[1..] {
                sum.iter_mut().zip(row).for_each(|(s, v)| *s += v);
            }
            for s in &mut sum {
                *s /= rows.len() as f32;
            }
            sum
        };
        Ok(rows.chunks_exact(templates.len()).map(mean).collect())
    }
}

/// The phrase's alternatives; the label where the phrase is empty.
fn alternatives(request: &PhraseRequest) -> impl Iterator<Item = &str> {
    let parts = || request.phrase.split(BETWEEN).map(str::trim).filter(|p| !p.is_empty());
    let label = if parts().next().is_none() { Some(request.label.trim()).filter(|l| !l.is_empty()) } else { None };
    parts().chain(label)
}

/// From fractions of the square that the photo was filled up to, to pixels of the photo.
fn in_pixels([cx, cy, w, h]: [f32; 4], size: ImageSize) -> PixelBox {
    let side = f64::from(size.width.max(size.height));
    let edge = |centre: f32, length: f32, sign: f64| (f64::from(centre) + sign * 0.5 * f64::from(length)) * side;
    PixelBox { x0: edge(cx, w, -1.0), y0: edge(cy, h, -1.0), x1: edge(cx, w, 1.0), y1: edge(cy, h, 1.0) }.clamped(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phrases_have_alternatives_and_labels_stand_in_for_empty_ones() {
        let of = |label: &str, phrase: &str| {
            let request = PhraseRequest { label: label.to_owned(), phrase: phrase.to_owned(), count: 0 };
            alternatives(&request).map(str::to_owned).collect::<Vec<_>>()
        };
        assert_eq!(of("sofa", "leather sofa . leather couch ."), ["leather sofa", "leather couch"]);
        assert_eq!(of("sofa", " . "), ["sofa"]);
        assert!(of("", "").is_empty());
    }

    #[test]
    fn boxes_are_fractions_of_the_filled_up_square() {
        let found = in_pixels([0.5, 0.25, 0.5, 0.25], ImageSize::new(400, 300));
        assert_eq!(found, PixelBox { x0: 100.0, y0: 50.0, x1: 300.0, y1: 150.0 });
        // What reaches into the filled-in part is cut.
        assert_eq!(in_pixels([0.5, 0.9, 1.0, 0.4], ImageSize::new(400, 300)).y1, 300.0);
    }
}
