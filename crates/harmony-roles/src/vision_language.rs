//! `VisionLanguage`: an answer that fits a JSON Schema, from text and pictures.

use std::sync::Arc;

use async_trait::async_trait;
use harmony_prompts::Question;
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
    /// The question itself, for players that compute rather than look; `None` = it is asked in words only.
    pub question: Option<Arc<Question>>,
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

    /// Whether it looks at the pictures. One that only computes is not asked what only looking can tell.
    fn sees(&self) -> bool {
        true
    }

    /// Whether it answers in its own time, as a person does: it has no deadline, and who did not come is not asked again.
    fn in_own_time(&self) -> bool {
        false
    }

    /// Answers one question.
    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError>;
}

/// Heading under which a complaint about an earlier answer is added to a prompt.
const COMPLAINT_HEADING: &str = "\n\n## Your previous answer was not accepted\n\n";

impl VlmRequest {
    /// A question of the program under a call name.
    pub fn new(name: String, question: Question, pictures: Vec<Picture>) -> Self {
        Self {
            name,
            prompt: question.prompt(),
            pictures,
            schema: question.schema(),
            example: question.example(),
            question: Some(Arc::new(question)),
        }
    }

    /// The question as it goes into content keys and records; null for one in words only.
    pub fn facts(&self) -> Value {
        serde_json::to_value(self.question.as_deref()).expect("questions are plain data")
    }

    /// The same question with a complaint about the previous answer at the end of the prompt; it replaces an earlier
    /// complaint.
    #[must_use]
    pub fn with_complaint(&self, complaint: &str, previous: &str) -> Self {
        let (question, _) = self.split_complaint();
        let mut prompt = format!("{question}{COMPLAINT_HEADING}{complaint}\n");
        if !previous.trim().is_empty() {
            prompt.push_str("\nIt began:\n\n");
            for line in previous.trim().chars().take(1500).collect::<String>().lines() {
                prompt.push_str("    ");
                prompt.push_str(line);
                prompt.push('\n');
            }
        }
        prompt.push_str("\nAnswer again, in full.\n");
        Self { prompt, ..self.clone() }
    }

    /// The prompt as it was first asked, and the complaint about the previous answer if there is one.
    pub fn split_complaint(&self) -> (&str, Option<&str>) {
        match self.prompt.split_once(COMPLAINT_HEADING) {
            Some((question, complaint)) => (question, Some(complaint)),
            None => (&self.prompt, None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_complaint_can_be_taken_off_again_and_does_not_pile_up() {
        let request = VlmRequest {
            name: "1_layout/layout".into(),
            prompt: "How large is the room?".into(),
            pictures: vec![],
            schema: Value::Null,
            example: Value::Null,
            question: None,
        };
        assert_eq!(request.split_complaint(), ("How large is the room?", None));
        let again = request.with_complaint("width is -3", "{\"width\": -3}").with_complaint("width is 900", "");
        let (question, complaint) = again.split_complaint();
        assert_eq!(question, request.prompt);
        let complaint = complaint.unwrap();
        assert!(complaint.contains("width is 900") && !complaint.contains("-3"), "{complaint}");
    }
}
