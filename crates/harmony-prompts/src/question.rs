//! What all questions share.

use schemars::{JsonSchema, SchemaGenerator, generate::SchemaSettings};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

use crate::{
    CompletedQuestion, CountsQuestion, FrontsQuestion, GroupsQuestion, HostsQuestion, InspectQuestion,
    LastLookQuestion, LayoutQuestion, LightingReviewQuestion, LightsQuestion, ListQuestion, MissingQuestion,
    OrientQuestion, PhysicalQuestion, ProgramsQuestion, ReorderQuestion, ReviewQuestion, SecondLookQuestion,
    SizesQuestion, TurnsQuestion,
};

/// One kind of question: its fields are all that is asked about, and everything else follows from them.
///
/// Players that look get text, schema and example; players that compute read the fields. What is serialised goes into
/// the content key of a call and its record, beside the text: fields that the text says in full are skipped.
pub trait Ask: Serialize + Into<Question> + Clone + Send + Sync {
    /// What is answered.
    type Answer: JsonSchema + Serialize + DeserializeOwned + Send + Sync;

    /// The text, Markdown.
    fn prompt(&self) -> String;

    /// A well-formed answer about some other picture.
    fn example(&self) -> Self::Answer;

    /// Whether an answer that fits the schema makes sense.
    ///
    /// # Errors
    /// A complaint in words, which can be sent back to whoever answered.
    fn check(&self, answer: &Self::Answer) -> Result<(), String>;

    /// The answer of a player that does not look: nothing is objected to, nothing is changed. `None` for questions
    /// that cannot be answered so.
    fn without_looking(&self) -> Option<Self::Answer> {
        None
    }
}

macro_rules! questions {
    ($($name:ident($question:ident)),+ $(,)?) => {
        /// Every question of the program, for players that compute rather than look.
        #[derive(Debug, Clone, PartialEq, Serialize)]
        #[serde(tag = "question", content = "facts", rename_all = "snake_case")]
        #[expect(missing_docs, reason = "one variant a question")]
        pub enum Question {
            $($name($question)),+
        }

        $(impl From<$question> for Question {
            fn from(question: $question) -> Self {
                Self::$name(question)
            }
        })+

        impl Question {
            /// The text, Markdown.
            pub fn prompt(&self) -> String {
                match self { $(Self::$name(question) => question.prompt()),+ }
            }

            /// JSON Schema of the answer.
            pub fn schema(&self) -> Value {
                match self { $(Self::$name(_) => schema_of::<<$question as Ask>::Answer>()),+ }
            }

            /// A well-formed answer about some other picture.
            pub fn example(&self) -> Value {
                match self { $(Self::$name(question) => value_of(&question.example())),+ }
            }

            /// See [`Ask::check`]; an answer that does not fit the schema is complained about too.
            ///
            /// # Errors
            /// A complaint in words.
            pub fn check(&self, answer: &Value) -> Result<(), String> {
                match self { $(Self::$name(question) => question.check(&parse(answer)?)),+ }
            }

            /// See [`Ask::without_looking`].
            pub fn without_looking(&self) -> Option<Value> {
                match self { $(Self::$name(question) => question.without_looking().map(|a| value_of(&a))),+ }
            }
        }
    };
}

questions! {
    Layout(LayoutQuestion),
    List(ListQuestion),
    Inspect(InspectQuestion),
    Sizes(SizesQuestion),
    Completed(CompletedQuestion),
    Fronts(FrontsQuestion),
    Orient(OrientQuestion),
    Turns(TurnsQuestion),
    Hosts(HostsQuestion),
    Groups(GroupsQuestion),
    Missing(MissingQuestion),
    Counts(CountsQuestion),
    Programs(ProgramsQuestion),
    SecondLook(SecondLookQuestion),
    Reorder(ReorderQuestion),
    Review(ReviewQuestion),
    Physical(PhysicalQuestion),
    Lights(LightsQuestion),
    LightingReview(LightingReviewQuestion),
    LastLook(LastLookQuestion),
}

fn schema_of<T: JsonSchema>() -> Value {
    SchemaGenerator::new(SchemaSettings::draft2020_12()).into_root_schema_for::<T>().to_value()
}

fn value_of<T: Serialize>(answer: &T) -> Value {
    serde_json::to_value(answer).expect("answer types are plain data")
}

/// Fills `{name}` places of a template; a place that is not filled stays visible, which the snapshot tests would show.
/// What is filled in is not looked at again: a label or a program may hold braces.
pub(crate) fn fill(template: &str, places: &[(&str, String)]) -> String {
    let mut text = String::with_capacity(template.len());
    let mut rest = template;
    while let Some(open) = rest.find('{') {
        text.push_str(&rest[..open]);
        let place = rest[open + 1..].split_once('}');
        let known = place.and_then(|(name, after)| Some((&places.iter().find(|(n, _)| *n == name)?.1, after)));
        if let Some((value, after)) = known {
            text.push_str(value);
            rest = after;
        } else {
            text.push('{');
            rest = &rest[open + 1..];
        }
    }
    text.push_str(rest);
    text
}

/// One line an item, or `(none)`.
pub(crate) fn lines<T: ToString>(items: &[T]) -> String {
    if items.is_empty() { "(none)".to_owned() } else { bare_lines(items) }
}

/// One line an item; nothing for none.
pub(crate) fn bare_lines<T: ToString>(items: &[T]) -> String {
    items.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// What was tried before and what came of it, as a paragraph of its own; nothing when there was none.
pub(crate) fn tried(lines: &[String]) -> String {
    if lines.is_empty() {
        return String::new();
    }
    format!(
        "\nTried before, with what came of it (what was refused is refused again unless something else changes with it):\n{}\n",
        bare_lines(lines)
    )
}

/// Reads an answer into its type.
fn parse<T: DeserializeOwned>(value: &Value) -> Result<T, String> {
    T::deserialize(value).map_err(|error| format!("the answer does not fit: {error}"))
}

/// Refuses an answer of which more than half of the entries cannot be meant: it is of another scene. A single wrong name
/// costs its own entry, which whoever asked leaves out.
pub(crate) fn mostly_sound(complaints: &[String], entries: usize) -> Result<(), String> {
    if 2 * complaints.len() > entries { Err(complaints.join("; ")) } else { Ok(()) }
}

/// Complains about a number outside its range.
pub(crate) fn in_range(what: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if value.is_finite() && value >= low && value <= high {
        Ok(())
    } else {
        Err(format!("{what} is {value}; expected a number from {low} to {high}"))
    }
}
