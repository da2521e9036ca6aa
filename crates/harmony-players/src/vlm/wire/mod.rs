//! The wire formats of language models: a question to JSON, JSON to a reply. Pure; nothing here opens a connection.

pub mod anthropic;
pub mod chat;
pub mod gemini;
pub mod responses;

use serde_json::{Map, Value};

use crate::http::Tokens;

/// A picture, encoded for sending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SentPicture {
    /// How the prompt speaks of it.
    pub caption: String,
    /// `image/png` or `image/jpeg`.
    pub media_type: &'static str,
    /// The file in base64.
    pub base64: String,
}

impl SentPicture {
    /// As a `data:` URL.
    pub fn data_url(&self) -> String {
        format!("data:{};base64,{}", self.media_type, self.base64)
    }
}

/// A question, ready for any of the formats.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked {
    /// Who the model is and what it answers with.
    pub system: String,
    /// The prompt, with the form of the answer.
    pub prompt: String,
    /// Pictures in the order the prompt names them.
    pub pictures: Vec<SentPicture>,
    /// Name of the schema: letters, digits, `_`, `-`, at most 64.
    pub schema_name: String,
    /// Schema in the form of the format's strict mode.
    pub schema: Value,
}

/// What is set for a model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModelSettings {
    /// Model name.
    pub model: String,
    /// How much the model thinks, in the service's words; `None` = its default.
    pub reasoning_effort: Option<String>,
    /// Most tokens of an answer, thinking included; `None` = the service's default.
    pub max_output_tokens: Option<u32>,
    /// Seed, where the service has one.
    pub seed: Option<u64>,
    /// Sampling temperature; `None` = the service's default (reasoning models take no other).
    pub temperature: Option<f64>,
    /// `low`, `high`, `auto` or `original`, for services that ask how finely pictures are looked at.
    pub detail: String,
    /// Further properties of the request, for whatever a server wants beside.
    pub extra: Map<String, Value>,
}

/// A whole answer.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reply {
    /// The model's text.
    pub text: String,
    /// Tokens.
    pub tokens: Tokens,
}

/// Why an answer with a good status is not one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Trouble {
    /// The model or a filter declined.
    Refused(String),
    /// The answer ends early, or thinking left no room for it.
    CutOff(String),
    /// The service failed after it had begun to answer: worth another try.
    Failed(String),
    /// The body is not of the format.
    NotUnderstood(String),
}

/// Adds the further properties of the settings; what is given there wins.
fn with_extra(mut body: Value, settings: &ModelSettings) -> Value {
    if let Some(map) = body.as_object_mut() {
        for (key, value) in &settings.extra {
            map.insert(key.clone(), value.clone());
        }
    }
    body
}

/// A number of a usage block.
fn count(body: &Value, pointer: &str) -> u64 {
    body.pointer(pointer).and_then(Value::as_u64).unwrap_or(0)
}

/// What a cut-off answer is told.
fn cut_off(reason: &str, text: &str, tokens: Tokens) -> Trouble {
    let room = if text.trim().is_empty() {
        "nothing was left for the answer after thinking"
    } else {
        "the answer ends in the middle"
    };
    Trouble::CutOff(format!("{room} ({reason} after {} tokens)", tokens.output))
}

#[cfg(test)]
pub(crate) mod samples {
    use serde_json::json;

    use super::*;

    /// A small question with one picture.
    pub fn asked() -> Asked {
        Asked {
            system: "You look at pictures.".into(),
            prompt: "How wide is it?".into(),
            pictures: vec![SentPicture {
                caption: "IMAGE 1: the photo".into(),
                media_type: "image/png",
                base64: "iVBORw0=".into(),
            }],
            schema_name: "layout".into(),
            schema: json!({
                "type": "object",
                "properties": {"width_m": {"type": "number"}},
                "required": ["width_m"],
                "additionalProperties": false,
            }),
        }
    }

    /// Settings with everything set.
    pub fn settings(model: &str) -> ModelSettings {
        ModelSettings {
            model: model.into(),
            reasoning_effort: Some("low".into()),
            max_output_tokens: Some(9000),
            seed: Some(7),
            temperature: None,
            detail: "high".into(),
            extra: Map::new(),
        }
    }
}
