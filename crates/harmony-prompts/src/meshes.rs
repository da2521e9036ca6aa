//! Checks on completed images and meshes: `<level>/completed`, `<level>/fronts`, `<level>/orient`.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, bare_lines, fill};
use crate::subjects::NamedObject;

/// Asks whether completed objects are right.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CompletedQuestion {
    /// Objects and their descriptions.
    pub objects: Vec<NamedObject>,
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

/// Asks for the front of de-tilted meshes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrontsQuestion {
    /// Objects and their kinds.
    pub objects: Vec<NamedObject>,
}

/// Asks which of four yaws in the scene matches the photo.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OrientQuestion {
    /// Objects and their kinds.
    pub objects: Vec<NamedObject>,
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

impl Ask for CompletedQuestion {
    type Answer = CompletedAnswer;

    fn prompt(&self) -> String {
        fill(include_str!("../templates/completed.md"), &[("objects", bare_lines(&self.objects))])
    }

    fn example(&self) -> CompletedAnswer {
        CompletedAnswer {
            objects: vec![
                CompletedObject { id: "table_01".into(), matches: true, hint: String::new() },
                CompletedObject {
                    id: "chair_01".into(),
                    matches: false,
                    hint: "four tapered legs of light beech, the seat is dark green velvet".into(),
                },
            ],
        }
    }

    fn check(&self, answer: &CompletedAnswer) -> Result<(), String> {
        answer.check(&ids(&self.objects))
    }

    fn without_looking(&self) -> Option<CompletedAnswer> {
        let passes = |id| CompletedObject { id, matches: true, hint: String::new() };
        Some(CompletedAnswer { objects: ids(&self.objects).into_iter().map(passes).collect() })
    }
}

impl Ask for FrontsQuestion {
    type Answer = FrontsAnswer;

    fn prompt(&self) -> String {
        fill(include_str!("../templates/fronts.md"), &[("objects", bare_lines(&self.objects))])
    }

    fn example(&self) -> FrontsAnswer {
        FrontsAnswer::example()
    }

    fn check(&self, answer: &FrontsAnswer) -> Result<(), String> {
        answer.check(&ids(&self.objects))
    }

    fn without_looking(&self) -> Option<FrontsAnswer> {
        Some(FrontsAnswer::as_they_are(&self.objects))
    }
}

impl Ask for OrientQuestion {
    type Answer = FrontsAnswer;

    fn prompt(&self) -> String {
        fill(include_str!("../templates/orient.md"), &[("objects", bare_lines(&self.objects))])
    }

    fn example(&self) -> FrontsAnswer {
        FrontsAnswer::example()
    }

    /// What is left out stays as it is.
    fn check(&self, answer: &FrontsAnswer) -> Result<(), String> {
        let known = |o: &FrontsObject| self.objects.iter().any(|asked| asked.id == o.id);
        if answer.objects.is_empty() || answer.objects.iter().any(known) {
            return Ok(());
        }
        Err(format!("none of the ids was asked for; they are {}", ids(&self.objects).join(", ")))
    }

    fn without_looking(&self) -> Option<FrontsAnswer> {
        Some(FrontsAnswer::as_they_are(&self.objects))
    }
}

fn ids(objects: &[NamedObject]) -> Vec<String> {
    objects.iter().map(|o| o.id.clone()).collect()
}

impl FrontsAnswer {
    fn example() -> Self {
        Self { objects: vec![FrontsObject { id: "chair_01".into(), front_panel: FrontPanel::B }] }
    }

    /// Nothing is turned.
    fn as_they_are(objects: &[NamedObject]) -> Self {
        let as_it_is = |id| FrontsObject { id, front_panel: FrontPanel::A };
        Self { objects: ids(objects).into_iter().map(as_it_is).collect() }
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
