//! What all questions share.

use schemars::{JsonSchema, SchemaGenerator, generate::SchemaSettings};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

/// Which question it is; players that compute rather than look choose their rule by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "one variant a module")]
pub enum QuestionKind {
    Layout,
    List,
    Inspect,
    Completed,
    Fronts,
    Orient,
    Programs,
    SecondLook,
    Review,
    Lights,
    LightingReview,
    LastLook,
}

/// A question ready to be asked, but for its name and pictures.
#[derive(Debug, Clone)]
pub struct Question {
    /// Which.
    pub kind: QuestionKind,
    /// Prompt text, Markdown.
    pub prompt: String,
    /// JSON Schema of the answer.
    pub schema: Value,
    /// A well-formed answer about some other picture.
    pub example: Value,
}

impl Question {
    /// Builds a question whose answer is a `T`.
    pub(crate) fn new<T: JsonSchema + Serialize>(kind: QuestionKind, prompt: String, example: &T) -> Self {
        let generator = SchemaGenerator::new(SchemaSettings::draft2020_12());
        let schema = generator.into_root_schema_for::<T>();
        Self {
            kind,
            prompt,
            schema: schema.to_value(),
            example: serde_json::to_value(example).expect("answer types are plain data"),
        }
    }
}

/// Fills `{name}` places of a template; a place that is not filled stays visible, which the snapshot tests would show.
pub(crate) fn fill(template: &str, places: &[(&str, String)]) -> String {
    let mut text = template.to_owned();
    for (name, value) in places {
        text = text.replace(&format!("{{{name}}}"), value);
    }
    text
}

/// Reads an answer into its type.
///
/// # Errors
/// A complaint in words, with the path of the first misfit, that can be sent back to whoever answered.
pub fn parse<T: DeserializeOwned>(value: &Value) -> Result<T, String> {
    serde_json::from_value(value.clone()).map_err(|error| format!("the answer does not fit: {error}"))
}

/// Complains about a number outside its range.
pub(crate) fn in_range(what: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if value.is_finite() && value >= low && value <= high {
        Ok(())
    } else {
        Err(format!("{what} is {value}; expected a number from {low} to {high}"))
    }
}
