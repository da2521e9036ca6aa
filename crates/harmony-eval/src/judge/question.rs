//! What the judge is asked.
//!
//! It is asked in words only: no player that computes could answer, so that the question has no place among those that
//! the pipeline asks.

use harmony_roles::{Picture, VlmRequest};
use schemars::{JsonSchema, SchemaGenerator, generate::SchemaSettings};
use serde::{Deserialize, Serialize};

/// What is compared, each on its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the template says what each is")]
pub enum Criterion {
    ObjectsPresent,
    Identity,
    Position,
    Orientation,
    Scale,
    Materials,
    Light,
    Overall,
}

impl Criterion {
    /// In the order of the question.
    pub const ALL: [Self; 8] = [
        Self::ObjectsPresent,
        Self::Identity,
        Self::Position,
        Self::Orientation,
        Self::Scale,
        Self::Materials,
        Self::Light,
        Self::Overall,
    ];

    /// For people.
    pub fn title(self) -> &'static str {
        match self {
            Self::ObjectsPresent => "objects present",
            Self::Identity => "identity",
            Self::Position => "position",
            Self::Orientation => "orientation",
            Self::Scale => "scale",
            Self::Materials => "materials",
            Self::Light => "light",
            Self::Overall => "overall",
        }
    }
}

/// Which of the two is nearer to the photo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum Better {
    A,
    B,
    Same,
}

/// The verdict on one criterion.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// Which is nearer to the photo.
    pub better: Better,
    /// What decided it.
    pub why: String,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "one field a criterion")]
pub struct JudgeAnswer {
    /// What was seen, before anything was decided.
    pub observations: String,
    pub objects_present: Verdict,
    pub identity: Verdict,
    pub position: Verdict,
    pub orientation: Verdict,
    pub scale: Verdict,
    pub materials: Verdict,
    pub light: Verdict,
    pub overall: Verdict,
}

impl JudgeAnswer {
    /// The verdict on a criterion.
    pub fn verdict(&self, criterion: Criterion) -> &Verdict {
        match criterion {
            Criterion::ObjectsPresent => &self.objects_present,
            Criterion::Identity => &self.identity,
            Criterion::Position => &self.position,
            Criterion::Orientation => &self.orientation,
            Criterion::Scale => &self.scale,
            Criterion::Materials => &self.materials,
            Criterion::Light => &self.light,
            Criterion::Overall => &self.overall,
        }
    }

    /// A well-formed answer about some other pair.
    pub fn example() -> Self {
        let verdict = |better, why: &str| Verdict { better, why: why.to_owned() };
        Self {
            observations:
                "The photo shows a bed with two nightstands under a window. A lacks the left nightstand; in B \
                           the bed is turned by a quarter and its cover is grey instead of blue."
                    .to_owned(),
            objects_present: verdict(Better::B, "A lacks a nightstand"),
            identity: verdict(Better::Same, "both have a bed and a lamp of the right kind"),
            position: verdict(Better::A, "B's bed stands away from its wall"),
            orientation: verdict(Better::A, "B's bed faces the left wall"),
            scale: verdict(Better::Same, "sizes agree within what can be seen"),
            materials: verdict(Better::A, "B's cover has the wrong colour"),
            light: verdict(Better::Same, "neither shows the sun through the window"),
            overall: verdict(Better::A, "the turned bed weighs more than a nightstand"),
        }
    }

    /// Whether somebody looked: without a word of what was seen an answer is no judgement.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self) -> Result<(), String> {
        if self.observations.trim().is_empty() {
            return Err("`observations` is empty: say what you see before you decide".to_owned());
        }
        if *self == Self::example() {
            return Err("this is the example, not an answer about these pictures".to_owned());
        }
        Ok(())
    }
}

/// One question.
#[derive(Debug, Clone)]
pub struct JudgeQuestion {
    /// The photo, then A's and B's picture of each view.
    pub pictures: Vec<Picture>,
    /// Which time it is asked, from 1.
    pub round: usize,
}

impl JudgeQuestion {
    /// As it goes to the player.
    pub fn request(&self, name: String) -> VlmRequest {
        let captions: Vec<&str> = self.pictures.iter().map(|p| p.caption.as_str()).collect();
        // Another text is another question, so that a later round is asked and not taken from the first one's record.
        let round = if self.round > 1 { format!(" (Look {} of these pictures.)", self.round) } else { String::new() };
        let prompt = include_str!("../../templates/judge.md")
            .replace("{pictures}", &captions.join("\n"))
            .replace("{round}", &round);
        let schema = SchemaGenerator::new(SchemaSettings::draft2020_12()).into_root_schema_for::<JudgeAnswer>();
        VlmRequest {
            name,
            prompt,
            pictures: self.pictures.clone(),
            schema: schema.to_value(),
            example: serde_json::to_value(JudgeAnswer::example()).expect("answers are plain data"),
            question: None,
        }
    }
}
