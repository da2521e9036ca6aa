//! `VisionLanguage`: an answer that fits a JSON Schema, from text and pictures.

use std::sync::Arc;

use async_trait::async_trait;
use image::RgbImage;
use serde_json::Value;

use crate::{PlayerCard, RoleError, Usage};

/// A picture shown with a question.
#[derive(Debug, Clone)]
pub struct Picture {
    /// How the prompt speaks of it, such as `IMAGE 1: the photo`.
    pub caption: String,
    /// Pixels.
    pub image: Arc<RgbImage>,
}

/// One question.
#[derive(Debug, Clone)]
pub struct VlmRequest {
    /// Stable call name, such as `3_furniture/list`.
    pub name: String,
    /// The prompt, Markdown.
    pub prompt: String,
    /// Pictures in the order the prompt names them.
    pub pictures: Vec<Picture>,
    /// JSON Schema of the answer (strict: every property required, no others).
    pub schema: Value,
    /// An example of a well-formed answer about some other picture.
    pub example: Value,
    /// Facts in machine-readable form (ids, sizes, positions) for players that compute rather than look.
    pub facts: Value,
}

/// One answer that fits the schema.
#[derive(Debug, Clone)]
pub struct VlmAnswer {
    /// The answer.
    pub value: Value,
    /// The raw text it came in.
    pub raw: String,
    /// Tokens and cost.
    pub usage: Usage,
}

/// Answers questions about pictures.
///
/// Cast in the paper: gpt-5.5. An answer that does not fit the schema is [`RoleError::UnusableAnswer`] with a
/// complaint; the caller asks again with it.
#[async_trait]
pub trait VisionLanguage: Send + Sync {
    /// Who is playing.
    fn card(&self) -> PlayerCard;

    /// Answers one question.
    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError>;
}
