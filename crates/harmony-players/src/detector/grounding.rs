//! Zero-shot detection over HTTP in the form of Hugging Face's task of that name: Grounding DINO, OWLv2 and others are
//! served so.
//!
//! `POST {"inputs": <base64>, "parameters": {"candidate_labels": [...], "threshold"}}` gives
//! `[{"score", "label", "box": {"xmin", "ymin", "xmax", "ymax"}}]`, boxes in pixels of the image that was sent.

use std::sync::Arc;

use async_trait::async_trait;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture::rgb_png;
use harmony_roles::{DetectRequest, Detection, Detections, Detector, PhraseRequest, PlayerCard, RoleError};
use harmony_scene::{ImageSize, Level};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};

use super::boxes::{BoxStyle, alternatives, ordered, phrase_of};
use crate::check::{Check, Checked};
use crate::http::{Http, HttpRequest, Service, ServiceOptions};
use crate::work::computed;

/// Overlap from which two boxes of one label are one: 900 queries repeat themselves.
const SAME: f64 = 0.7;

/// How the detector is set up.
#[derive(Debug, Clone)]
pub struct GroundingOptions {
    /// Where and how; the address is that of the route itself.
    pub service: ServiceOptions,
    /// Model name, for records.
    pub model: String,
    /// Least score; the original's is 0.35.
    pub threshold: f64,
    /// How many calls may run at once.
    pub concurrency: usize,
}

/// A zero-shot detector.
#[derive(Debug)]
pub struct GroundingPlayer {
    service: Service,
    options: GroundingOptions,
}

impl GroundingPlayer {
    /// Sets it up; nothing is sent yet.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn new(http: &Http, options: GroundingOptions) -> Result<Self, RoleError> {
        Ok(Self { service: Service::new(http, options.service.clone())?, options })
    }

    /// The service, for whoever needs its key hidden.
    pub fn service(&self) -> &Service {
        &self.service
    }
}

/// The request's body. `image` is a PNG in base64.
pub fn body(image: &str, phrases: &[PhraseRequest], threshold: f64) -> Value {
    let labels: Vec<String> = phrases.iter().flat_map(alternatives).collect();
    json!({"inputs": image, "parameters": {"candidate_labels": labels, "threshold": threshold}})
}

/// Reads the boxes; `None` = the answer has another form.
pub fn read(body: &Value, request: &DetectRequest, threshold: f64) -> Option<Vec<Detection>> {
    let size = ImageSize::new(request.image.width(), request.image.height());
    let mut found = Vec::new();
    for entry in body.as_array()? {
        let number = |key: &str| entry.get("box")?.get(key)?.as_f64();
        let numbers = [number("xmin")?, number("ymin")?, number("xmax")?, number("ymax")?];
        let label = entry.get("label")?.as_str()?;
        let score = entry.get("score").and_then(Value::as_f64).filter(|score| (0.0..=1.0).contains(score));
        let Some(phrase) = phrase_of(label, &request.phrases) else { continue };
        let Some(bounds) = BoxStyle::Pixels.to_pixels(numbers, size, size) else { continue };
        // Servers that do not know the threshold give everything.
        if score.is_none_or(|score| score >= threshold) {
            let (label, phrase) = (phrase.label.clone(), phrase.phrase.clone());
            found.push(Detection { label, phrase, bounds, score, outline: None });
        }
    }
    Some(ordered(found, &request.phrases, SAME))
}

#[async_trait]
impl Detector for GroundingPlayer {
    fn card(&self) -> PlayerCard {
        PlayerCard {
            player: self.service.player().to_owned(),
            model: format!("{}, threshold {}", self.options.model, self.options.threshold),
            offline: false,
            concurrency: self.options.concurrency,
        }
    }

    async fn detect(&self, request: &DetectRequest) -> Result<Detections, RoleError> {
        if request.phrases.is_empty() {
            return Ok(Detections::default());
        }
        let player = self.service.player();
        let image = request.image.clone();
        let file = computed(player, move || rgb_png(&image).map(|file| STANDARD.encode(file))).await?;
        let file =
            file.map_err(|error| RoleError::NotCapable { player: player.to_owned(), reason: error.to_string() })?;
        let body = body(&file, &request.phrases, self.options.threshold);
        let answer: Value = self.service.call_json(&HttpRequest::post_json("", &body)).await?.value;
        let found = read(&answer, request, self.options.threshold);
        let detections = found.ok_or_else(|| {
            self.service.unusable("the answer is no list of scores, labels and boxes", &answer.to_string())
        })?;
        Ok(Detections { detections, ..Detections::default() })
    }
}

/// A red ball to look for.
pub(super) fn check_request() -> DetectRequest {
    let image = RgbImage::from_fn(128, 96, |x, y| {
        let (dx, dy) = (f64::from(x) - 64.0, f64::from(y) - 48.0);
        if dx * dx + dy * dy < 900.0 { Rgb([210, 30, 30]) } else { Rgb([230; 3]) }
    });
    DetectRequest {
        name: "doctor/check".to_owned(),
        image: Arc::new(image),
        level: Level::Decoration,
        phrases: vec![PhraseRequest { label: "ball".to_owned(), phrase: "red ball".to_owned(), count: 1 }],
    }
}

#[async_trait]
impl Check for GroundingPlayer {
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        if self.service.secret().is_some() && !paid {
            return Ok(Checked { detail: "not asked: a call may cost something".to_owned(), usage: None });
        }
        let found = self.detect(&check_request()).await?;
        Ok(Checked { detail: format!("{} boxes for a red ball", found.detections.len()), usage: None })
    }
}

#[cfg(test)]
mod tests {
    use super::super::boxes::tests::phrase;
    use super::*;

    fn request() -> DetectRequest {
        let phrases = vec![phrase("sofa", "leather sofa . leather couch"), phrase("lamp", "floor lamp")];
        DetectRequest { phrases, ..check_request() }
    }

    #[test]
    fn the_request_is_as_the_task_wants_it() {
        insta::assert_json_snapshot!(body("iVBO", &request().phrases, 0.35));
    }

    #[test]
    fn boxes_and_scores_are_read() {
        let entry = |label: &str, score: Value, x: f64| json!({"score": score, "label": label, "box": {"xmin": x, "ymin": 5, "xmax": x + 30.0, "ymax": 60}});
        let answer = json!([
            entry("floor lamp", json!(0.5), 1.0),
            entry("leather couch", json!(0.6), 41.0),
            entry("leather sofa", json!(0.9), 40.0),
            entry("leather sofa", json!(0.1), 90.0),
            entry("dog", json!(0.99), 10.0),
        ]);
        let found = read(&answer, &request(), 0.35).unwrap();
        let short: Vec<_> = found.iter().map(|d| (d.label.as_str(), d.score, d.bounds.x0)).collect();
        assert_eq!(short, [("sofa", Some(0.9), 40.0), ("lamp", Some(0.5), 1.0)]);
        let without = read(&json!([entry("floor lamp", json!(null), 1.0)]), &request(), 0.35).unwrap();
        assert_eq!(without[0].score, None, "no score is made up");
        assert_eq!(read(&json!([]), &request(), 0.35), Some(vec![]));
        for odd in [json!({"error": "loading"}), json!([{"label": "x"}]), json!(null)] {
            assert_eq!(read(&odd, &request(), 0.35), None, "{odd}");
        }
    }
}
