//! Rules as a language model: for each question what its facts and pictures allow, and nothing that they don't.

use async_trait::async_trait;
use harmony_prompts::QuestionKind;
use harmony_roles::{PlayerCard, RoleError, Usage, VisionLanguage, VlmAnswer, VlmRequest};
use serde_json::Value;

use super::answers;

/// Answers the program's own questions by rules.
///
/// `request.facts` is `{"question": <kind>, "facts": {...}}`; what each rule reads of the facts is documented with it.
/// Facts that are missing are done without.
#[derive(Debug, Clone, Copy)]
pub struct Rules;

#[async_trait]
impl VisionLanguage for Rules {
    fn card(&self) -> PlayerCard {
        super::card("rules 1")
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let Some(kind) = kind_of(request) else {
            return Err(super::not_capable(format!("there is no rule for the question {}", request.name)));
        };
        let request = request.clone();
        let value = super::computed(move || answer(kind, &request)).await??;
        Ok(VlmAnswer { raw: String::new(), value, usage: Usage::default() })
    }
}

/// The kind of a question: as its facts say, else by the last part of its name.
fn kind_of(request: &VlmRequest) -> Option<QuestionKind> {
    if let Ok(kind) = serde_json::from_value(request.facts["question"].clone()) {
        return Some(kind);
    }
    let last = request.name.rsplit('/').next()?;
    let stem = last.trim_end_matches(|c: char| c.is_ascii_digit() || c == '_');
    match stem {
        "review" if request.name.starts_with("6_lighting") => Some(QuestionKind::LightingReview),
        stem => serde_json::from_value(Value::String(stem.to_owned())).ok(),
    }
}

fn answer(kind: QuestionKind, request: &VlmRequest) -> Result<Value, RoleError> {
    let facts = &request.facts["facts"];
    let answer = match kind {
        QuestionKind::Layout => serde_json::to_value(answers::layout(facts, request)),
        QuestionKind::List => serde_json::to_value(answers::list(facts, request)),
        QuestionKind::Inspect => serde_json::to_value(answers::inspect(facts)),
        QuestionKind::Completed => serde_json::to_value(answers::completed(facts)),
        QuestionKind::Fronts | QuestionKind::Orient => serde_json::to_value(answers::fronts(facts)),
        // It writes no programs, and has nothing against those that there are.
        QuestionKind::Programs => serde_json::to_value(harmony_prompts::ProgramsAnswer::default()),
        QuestionKind::SecondLook => serde_json::to_value(harmony_prompts::SecondLookAnswer::default()),
        QuestionKind::Review => serde_json::to_value(answers::review()),
        QuestionKind::Lights => serde_json::to_value(answers::lights(facts)),
        QuestionKind::LastLook => serde_json::to_value(harmony_prompts::LastLookAnswer {
            converged: true,
            ..harmony_prompts::LastLookAnswer::default()
        }),
        QuestionKind::LightingReview => serde_json::to_value(answers::lighting_review(facts)),
    };
    answer.map_err(|error| super::not_capable(format!("the answer can't be written: {error}")))
}
