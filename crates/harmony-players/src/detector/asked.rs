//! Boxes asked from a language model.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_roles::{
    DetectRequest, Detection, Detections, Detector, PhraseRequest, Picture, PlayerCard, RoleError, VisionLanguage,
    VlmRequest,
};
use harmony_scene::ImageSize;
use image::RgbImage;
use image::imageops::{FilterType, resize};
use serde_json::{Value, json};

use super::boxes::{BoxStyle, ordered, phrase_of};
use crate::check::{Check, Checked};
use crate::work::computed;

/// Qwen2.5-VL brings both sides of a picture to multiples of this; one that has such sides stays as it is.
const PIXEL_BLOCK: u32 = 28;

/// Overlap from which two boxes of one label are one.
const SAME: f64 = 0.8;

/// A language model as a detector. It gives no scores.
///
/// Its card is the language model's: prices, rates and places are those of the model that is asked, whatever it is asked
/// for.
pub struct VlmBoxes {
    language: Arc<dyn VisionLanguage>,
    style: BoxStyle,
}

impl VlmBoxes {
    /// Asks `language`, whose boxes are written in a style.
    pub fn new(language: Arc<dyn VisionLanguage>, style: BoxStyle) -> Self {
        Self { language, style }
    }
}

/// The picture as the model will see it.
fn picture(image: &Arc<RgbImage>, style: BoxStyle) -> Arc<RgbImage> {
    let round = |side: u32| ((f64::from(side) / f64::from(PIXEL_BLOCK)).round() as u32).max(1) * PIXEL_BLOCK;
    let (w, h) = (round(image.width()), round(image.height()));
    if style != BoxStyle::Pixels || (w, h) == image.dimensions() {
        return Arc::clone(image);
    }
    Arc::new(resize(&**image, w, h, FilterType::CatmullRom))
}

/// The question.
pub fn question(request: &DetectRequest, seen: &Arc<RgbImage>, style: BoxStyle) -> VlmRequest {
    let key = match style {
        BoxStyle::Thousandths => "box",
        // The names under which these models learned to write boxes.
        BoxStyle::ThousandthsTopFirst => "box_2d",
        BoxStyle::Pixels => "bbox_2d",
    };
    let unit = match style {
        BoxStyle::Thousandths | BoxStyle::ThousandthsTopFirst => {
            "thousandths of the picture's width and height (0 to 1000)".to_owned()
        }
        BoxStyle::Pixels => format!("pixels of the picture, which is {} x {}", seen.width(), seen.height()),
    };
    let line = |p: &PhraseRequest| {
        let count = if p.count > 0 { format!(", about {} in the picture", p.count) } else { String::new() };
        format!("- {}: {}{count}", p.label, p.phrase)
    };
    let lines: Vec<String> = request.phrases.iter().map(line).collect();
    let labels: Vec<&str> = request.phrases.iter().map(|p| p.label.as_str()).collect();
    let prompt = format!(
        "IMAGE 1 is a photo of a room. Find every instance of these things:\n\n{}\n\nGive one entry an instance: its \
         `label` as above, and `{key}` = {}, {unit}, tight around the visible part. Leave out what is not there; if \
         nothing is, the list is empty.\n",
        lines.join("\n"),
        style.order(),
    );
    let mut properties = json!({"label": {"type": "string", "enum": labels}});
    properties[key] = json!({"type": "array", "items": {"type": "number"}, "minItems": 4, "maxItems": 4});
    let example = match style {
        BoxStyle::ThousandthsTopFirst => [420, 100, 800, 360],
        BoxStyle::Thousandths | BoxStyle::Pixels => [100, 420, 360, 800],
    };
    let mut entry = json!({"label": labels.first().copied().unwrap_or_default()});
    entry[key] = json!(example);
    VlmRequest {
        name: request.name.clone(),
        prompt,
        pictures: vec![Picture { caption: "IMAGE 1: the photo".to_owned(), image: Arc::clone(seen) }],
        schema: json!({
            "type": "object",
            "properties": {"boxes": {"type": "array", "items": {
                "type": "object", "properties": properties, "required": ["label", key], "additionalProperties": false,
            }}},
            "required": ["boxes"],
            "additionalProperties": false,
        }),
        example: json!({"boxes": [entry]}),
        question: None,
    }
}

/// Reads an answer that fits the question's schema.
pub fn read(answer: &Value, request: &DetectRequest, seen: ImageSize, style: BoxStyle) -> Vec<Detection> {
    let size = ImageSize::new(request.image.width(), request.image.height());
    let entries = answer.get("boxes").and_then(Value::as_array).into_iter().flatten();
    let found = entries.filter_map(|entry| {
        let numbers = ["box", "box_2d", "bbox_2d"].iter().find_map(|key| entry.get(key)?.as_array())?;
        let numbers: Vec<f64> = numbers.iter().filter_map(Value::as_f64).collect();
        let bounds = style.to_pixels(numbers.try_into().ok()?, seen, size)?;
        let phrase = phrase_of(entry.get("label")?.as_str()?, &request.phrases)?;
        let (label, phrase) = (phrase.label.clone(), phrase.phrase.clone());
        Some(Detection { label, phrase, bounds, score: None, outline: None })
    });
    ordered(found.collect(), &request.phrases, SAME)
}

#[async_trait]
impl Detector for VlmBoxes {
    fn card(&self) -> PlayerCard {
        self.language.card()
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        if request.phrases.is_empty() {
            return Ok(Detections::default());
        }
        let (image, style) = (Arc::clone(&request.image), self.style);
        let seen = computed("vlm_boxes", move || picture(&image, style)).await?;
        let answer = self.language.ask(&question(request, &seen, style)).await?;
        let size = ImageSize::new(seen.width(), seen.height());
        Ok(Detections { detections: read(&answer.value, request, size, style), usage: answer.usage })
    }
}

#[async_trait]
impl Check for VlmBoxes {
    /// Whether the language model is there is its own check's business.
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        if !paid {
            return Ok(Checked { detail: "the language model is asked for boxes".to_owned(), usage: None });
        }
        let found = self.detect(&super::grounding::check_request()).await?;
        Ok(Checked { detail: format!("{} boxes for a red ball", found.detections.len()), usage: Some(found.usage) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::boxes::tests::phrase;
    use super::super::grounding::check_request;
    use super::*;
    use harmony_calls::schema_complaints;

    fn request() -> DetectRequest {
        let image = Arc::new(RgbImage::new(800, 600));
        let phrases = vec![phrase("sofa", "leather sofa"), PhraseRequest { count: 0, ..phrase("lamp", "floor lamp") }];
        DetectRequest { image, phrases, ..check_request() }
    }

    #[test]
    fn each_style_has_its_question_and_its_example_fits() {
        for style in [BoxStyle::Thousandths, BoxStyle::ThousandthsTopFirst, BoxStyle::Pixels] {
            let request = request();
            let seen = picture(&request.image, style);
            let question = question(&request, &seen, style);
            insta::assert_snapshot!(format!("{style:?}"), question.prompt);
            assert!(schema_complaints(&question.schema, &question.example).is_empty());
        }
    }

    #[test]
    fn pixels_are_those_of_the_picture_that_was_sent() {
        let request = request();
        let seen = picture(&request.image, BoxStyle::Pixels);
        assert_eq!(seen.dimensions(), (812, 588));
        let size = ImageSize::new(812, 588);
        let answer = json!({"boxes": [{"label": "sofa", "bbox_2d": [0, 0, 812, 294]}]});
        let found = read(&answer, &request, size, BoxStyle::Pixels);
        assert_eq!((found[0].bounds.x1, found[0].bounds.y1, found[0].score), (800.0, 300.0, None));
    }

    #[test]
    fn gemini_writes_the_top_first() {
        let answer =
            json!({"boxes": [{"label": "lamp", "box_2d": [100, 200, 300, 400]}, {"label": "lamp", "box_2d": [1, 2]}]});
        let found = read(&answer, &request(), ImageSize::new(800, 600), BoxStyle::ThousandthsTopFirst);
        assert_eq!(found.len(), 1);
        assert!((found[0].bounds.x0 - 160.0).abs() < 1e-9 && (found[0].bounds.y0 - 60.0).abs() < 1e-9);
    }
}
