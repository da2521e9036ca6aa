//! Rules as a language model: for each question what its fields and pictures allow, and nothing that they don't.

use async_trait::async_trait;
use harmony_prompts::Question;
use harmony_roles::{PlayerCard, RoleError, Usage, VisionLanguage, VlmAnswer, VlmRequest};
use serde_json::Value;

use super::answers;

/// Answers the program's own questions by rules; questions in words only are declined.
#[derive(Debug, Clone, Copy)]
pub struct Rules;

#[async_trait]
impl VisionLanguage for Rules {
    fn card(&self) -> PlayerCard {
        super::card("rules 1")
    }

    fn sees(&self) -> bool {
        false
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let no_rule = || super::not_capable(format!("there is no rule for the question {}", request.name));
        let question = request.question.clone().ok_or_else(no_rule)?;
        let photo = request.pictures.first().map(|picture| picture.image.clone());
        let value = super::computed(move || answer(&question, photo.as_deref())).await?.ok_or_else(no_rule)?;
        Ok(VlmAnswer { raw: String::new(), value, usage: Usage::default() })
    }
}

fn answer(question: &Question, photo: Option<&image::RgbImage>) -> Option<Value> {
    let answer = match question {
        Question::Layout(question) => serde_json::to_value(answers::layout(question, photo)),
        Question::List(question) => serde_json::to_value(answers::list(question, photo)),
        Question::Inspect(question) => serde_json::to_value(answers::inspect(question)),
        Question::Lights(question) => serde_json::to_value(answers::lights(question)),
        question => return question.without_looking(),
    };
    Some(answer.expect("answer types are plain data"))
}
