//! LocateAnything: a vision-language model that writes boxes as tokens.
//!
//! It has no server of its own. Servers of others (a fork of llama.cpp, vLLM) speak chat completions and must print
//! special tokens. It gives no score, so there is none here.

use async_trait::async_trait;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture::rgb_png;
use harmony_roles::{DetectRequest, Detection, Detections, Detector, PhraseRequest, PlayerCard, RoleError};
use harmony_scene::ImageSize;
use serde_json::{Value, json};

use super::boxes::{BoxStyle, alternatives, ordered, phrase_of};
use crate::check::{Check, Checked};
use crate::http::{Http, HttpRequest, Received, Service, ServiceOptions};
use crate::vlm::wire::chat;
use crate::work::computed;

/// A box is six tokens; too few tokens would drop boxes without a word.
const MAX_TOKENS: u32 = 4096;

/// Overlap from which two boxes of one label are one: alternatives of a phrase find the same thing twice.
const SAME: f64 = 0.8;

/// How the detector is set up.
#[derive(Debug, Clone)]
pub struct LocateOptions {
    /// Where and how.
    pub service: ServiceOptions,
    /// Model name, as served.
    pub model: String,
    /// How many calls may run at once.
    pub concurrency: usize,
}

/// LocateAnything as a detector.
#[derive(Debug)]
pub struct LocatePlayer {
    service: Service,
    options: LocateOptions,
}

impl LocatePlayer {
    /// Sets it up; nothing is sent yet.
    ///
    /// # Errors
    /// [`RoleError::NotSetUp`].
    pub fn new(http: &Http, options: LocateOptions) -> Result<Self, RoleError> {
        Ok(Self { service: Service::new(http, options.service.clone())?, options })
    }

    /// The service, for whoever needs its key hidden.
    pub fn service(&self) -> &Service {
        &self.service
    }
}

/// The request's body. `image` is a PNG in base64.
pub fn body(image: &str, phrases: &[PhraseRequest], model: &str) -> Value {
    let all: Vec<String> = phrases.iter().flat_map(alternatives).collect();
    // The wording (grammar included) is the one that the model was trained with.
    let prompt = match all.as_slice() {
        [one] => format!("Locate all the instances that match the following description: {one}."),
        all => format!("Locate all the instances that matches the following description: {}.", all.join("</c>")),
    };
    json!({
        "model": model,
        "messages": [{"role": "user", "content": [
            {"type": "image_url", "image_url": {"url": format!("data:image/png;base64,{image}")}},
            {"type": "text", "text": prompt},
        ]}],
        "temperature": 0.0,
        "max_tokens": MAX_TOKENS,
        // Boxes are special tokens; vLLM hides those unless told otherwise.
        "skip_special_tokens": false,
    })
}

/// One box as the model writes it: its label and four numbers of 0 to 1000.
pub type WrittenBox = (String, [f64; 4]);

/// Reads `<ref>label</ref><box><x1><y1><x2><y2></box>...`; several boxes may follow one label, `<box>none</box>` is
/// none. Points and broken boxes are left out.
pub fn written_boxes(text: &str) -> Vec<WrittenBox> {
    let mut boxes = Vec::new();
    let mut label = String::new();
    let mut rest = text;
    loop {
        let (next_ref, next_box) = (rest.find("<ref>"), rest.find("<box>"));
        match (next_ref, next_box) {
            (Some(r), b) if b.is_none_or(|b| r < b) => {
                let after = &rest[r + "<ref>".len()..];
                let end = after.find("</ref>").unwrap_or(0);
                after[..end].trim().clone_into(&mut label);
                rest = &after[end..];
            }
            (_, Some(b)) => {
                let after = &rest[b + "<box>".len()..];
                let Some(end) = after.find("</box>") else { break };
                let numbers: Vec<f64> = after[..end]
                    .split(['<', '>'])
                    .filter(|part| !part.trim().is_empty())
                    .filter_map(|part| part.trim().parse().ok())
                    .collect();
                if let [x0, y0, x1, y1] = numbers[..] {
                    boxes.push((label.clone(), [x0, y0, x1, y1]));
                }
                rest = &after[end..];
            }
            _ => break,
        }
    }
    boxes
}

/// Whether a text is an answer of this model at all: boxes, or the word that there are none.
pub fn is_answer(text: &str) -> bool {
    text.contains("<box>")
}

#[async_trait]
impl Detector for LocatePlayer {
    fn card(&self) -> PlayerCard {
        PlayerCard {
            player: self.service.player().to_owned(),
            model: self.options.model.clone(),
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
        let body = body(&file, &request.phrases, &self.options.model);
        let Received { value: answer, closed_for }: Received<Value> =
            self.service.call_json(&HttpRequest::post_json(chat::PATH, &body)).await?;
        let text = answer.pointer("/choices/0/message/content").and_then(Value::as_str).unwrap_or_default();
        if answer.pointer("/choices/0/finish_reason").and_then(Value::as_str) == Some("length") {
            return Err(self.service.unusable("the answer was cut off, boxes may be missing", text));
        }
        if !is_answer(text) {
            let hint = "start the server so that it prints special tokens (llama.cpp: --special)";
            return Err(self.service.not_set_up("the answer holds no box tokens", hint));
        }
        let size = ImageSize::new(request.image.width(), request.image.height());
        let found = written_boxes(text).into_iter().filter_map(|(label, numbers)| {
            let phrase = phrase_of(&label, &request.phrases)?;
            let bounds = BoxStyle::Thousandths.to_pixels(numbers, size, size)?;
            let (label, phrase) = (phrase.label.clone(), phrase.phrase.clone());
            Some(Detection { label, phrase, bounds, score: None, outline: None })
        });
        let detections = ordered(found.collect(), &request.phrases, SAME);
        Ok(Detections { detections, usage: chat::tokens(&answer).usage(closed_for) })
    }
}

#[async_trait]
impl Check for LocatePlayer {
    async fn check(&self, paid: bool) -> Result<Checked, RoleError> {
        self.service.call(&HttpRequest::get("/models")).await?;
        if !paid {
            return Ok(Checked { detail: "the server answers".to_owned(), usage: None });
        }
        let found = self.detect(&super::grounding::check_request()).await?;
        Ok(Checked { detail: format!("{} boxes for a red ball", found.detections.len()), usage: Some(found.usage) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::boxes::tests::phrase;
    use super::*;

    #[test]
    fn the_request_is_as_the_model_was_trained() {
        let phrases = [phrase("sofa", "leather sofa . leather couch"), phrase("lamp", "floor lamp")];
        insta::assert_json_snapshot!("many", body("iVBO", &phrases, "locateanything"));
        let one = body("iVBO", &phrases[1..], "m");
        let prompt = one.pointer("/messages/0/content/1/text").unwrap();
        assert_eq!(prompt, "Locate all the instances that match the following description: floor lamp.");
    }

    #[test]
    fn boxes_are_read_from_tokens() {
        let text = "<ref>leather sofa</ref><box><12><300><500><900></box><box><600><310><990><880></box>\
                    <ref>floor lamp</ref><box>none</box><ref>rug</ref><box><1><2></box><box><1><2><3>";
        assert_eq!(
            written_boxes(text),
            [
                ("leather sofa".to_owned(), [12.0, 300.0, 500.0, 900.0]),
                ("leather sofa".to_owned(), [600.0, 310.0, 990.0, 880.0]),
            ]
        );
        assert!(is_answer(text) && !is_answer("leather sofa 12 300 500 900"));
        for odd in ["", "<ref>", "<box></box>", "<ref>x<box><1><2><3><4></box>", "</ref><box>"] {
            assert!(written_boxes(odd).len() <= 1, "{odd}");
        }
    }
}
