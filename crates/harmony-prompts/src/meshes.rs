//! Checks on completed images and meshes: `<level>/completed`, `<level>/fronts`, `<level>/orient`.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Question, QuestionKind, fill};

/// What `completed` is filled with.
#[derive(Debug, Clone)]
pub struct CompletedVars {
    /// Objects: id and description, one line each.
    pub objects: Vec<String>,
}

/// Whether inpainted objects are what they should be (paper Sec. 3.2).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CompletedAnswer {
    /// One entry an object.
    pub objects: Vec<CompletedObject>,
}

/// About one completed object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CompletedObject {
    /// Id.
    pub id: String,
    /// Same type, complete, same shape as in the photo.
    pub matches: bool,
    /// Material and colour hints for one more try, when it does not match.
    #[serde(default)]
    pub hint: String,
}

/// What `fronts` and `orient` are filled with.
#[derive(Debug, Clone)]
pub struct FrontsVars {
    /// Objects: id and label, one line each.
    pub objects: Vec<String>,
}

/// The paper's panel letters: yaw 0, 90, 180, 270 degrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[expect(missing_docs, reason = "letters")]
pub enum FrontPanel {
    A,
    B,
    C,
    D,
}

impl FrontPanel {
    /// Yaw of the panel, radians.
    pub fn yaw(self) -> f64 {
        std::f64::consts::FRAC_PI_2 * f64::from(self as u8)
    }

    /// Letters in order.
    pub const ALL: [Self; 4] = [Self::A, Self::B, Self::C, Self::D];
}

/// Which panel shows the front (or the right orientation) of each object.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrontsAnswer {
    /// One entry an object.
    pub objects: Vec<FrontsObject>,
}

/// About one object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrontsObject {
    /// Id.
    pub id: String,
    /// Panel.
    pub front_panel: FrontPanel,
}

/// Asks whether completed objects are right.
pub fn completed(vars: &CompletedVars) -> Question {
    let prompt = fill(include_str!("../templates/completed.md"), &[("objects", vars.objects.join("\n"))]);
    let example = CompletedAnswer {
        objects: vec![
            CompletedObject { id: "table_01".into(), matches: true, hint: String::new() },
            CompletedObject {
                id: "chair_01".into(),
                matches: false,
                hint: "four tapered legs of light beech, the seat is dark green velvet".into(),
            },
        ],
    };
    Question::new(QuestionKind::Completed, prompt, &example)
}

/// Asks for the front of de-tilted meshes.
pub fn fronts(vars: &FrontsVars) -> Question {
    let prompt = fill(include_str!("../templates/fronts.md"), &[("objects", vars.objects.join("\n"))]);
    Question::new(QuestionKind::Fronts, prompt, &FrontsAnswer::example())
}

/// Asks which of four yaws in the scene matches the photo.
pub fn orient(vars: &FrontsVars) -> Question {
    let prompt = fill(include_str!("../templates/orient.md"), &[("objects", vars.objects.join("\n"))]);
    Question::new(QuestionKind::Orient, prompt, &FrontsAnswer::example())
}

impl FrontsAnswer {
    fn example() -> Self {
        Self { objects: vec![FrontsObject { id: "chair_01".into(), front_panel: FrontPanel::B }] }
    }

    /// Whether exactly the asked objects are answered.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, asked: &[String]) -> Result<(), String> {
        same_ids(self.objects.iter().map(|o| o.id.as_str()), asked)
    }
}

impl CompletedAnswer {
    /// Whether exactly the asked objects are answered.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, asked: &[String]) -> Result<(), String> {
        same_ids(self.objects.iter().map(|o| o.id.as_str()), asked)
    }
}

fn same_ids<'a>(answered: impl Iterator<Item = &'a str>, asked: &[String]) -> Result<(), String> {
    let answered: BTreeSet<&str> = answered.collect();
    let asked: BTreeSet<&str> = asked.iter().map(String::as_str).collect();
    if let Some(extra) = answered.difference(&asked).next() {
        return Err(format!("{extra:?} was not asked for"));
    }
    let missing: Vec<_> = asked.difference(&answered).copied().collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("no entry for {}", missing.join(", "))) }
}
