//! `6_lighting/lights` and `6_lighting/review_<n>` (paper App. C, "Material and Lighting Estimation").

use harmony_lighting::LightingDelta;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Question, QuestionKind, fill, in_range};

/// What `lights` is filled with.
#[derive(Debug, Clone)]
pub struct LightsVars {
    /// Sources: id, kind, position, one line each.
    pub sources: Vec<String>,
}

/// Which sources emit.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightsAnswer {
    /// One entry a source.
    pub lights: Vec<LightAnswer>,
    /// sRGB hex colour of the ambient light, such as `#fff4e6`.
    #[serde(default)]
    pub ambient_hex: Option<String>,
    /// Ambient level relative to a normally lit room, 0 to 3.
    #[serde(default)]
    pub ambient_level: Option<f64>,
}

/// About one source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightAnswer {
    /// Id.
    pub id: String,
    /// Whether it shines in the photo.
    pub on: bool,
    /// sRGB hex colour of its light.
    #[serde(default)]
    pub color_hex: Option<String>,
    /// Strength relative to a usual source of its kind, 0 to 5.
    #[serde(default)]
    pub level: Option<f64>,
}

/// What `lighting_review` is filled with.
#[derive(Debug, Clone)]
pub struct LightingReviewVars {
    /// The current setup as JSON.
    pub setup: String,
    /// What was measured between photo and preview, in words.
    pub measured: String,
}

/// Asks which sources emit.
pub fn lights(vars: &LightsVars) -> Question {
    let sources = if vars.sources.is_empty() { "(none)".to_owned() } else { vars.sources.join("\n") };
    let prompt = fill(include_str!("../templates/lights.md"), &[("sources", sources)]);
    let example = LightsAnswer {
        lights: vec![LightAnswer {
            id: "floor_lamp_01".into(),
            on: true,
            color_hex: Some("#ffd9a8".into()),
            level: Some(1.0),
        }],
        ambient_hex: Some("#f2f5ff".into()),
        ambient_level: Some(1.0),
    };
    Question::new(QuestionKind::Lights, prompt, &example)
}

/// Asks for corrections of the light.
pub fn lighting_review(vars: &LightingReviewVars) -> Question {
    let prompt = fill(
        include_str!("../templates/lighting_review.md"),
        &[("setup", vars.setup.clone()), ("measured", vars.measured.clone())],
    );
    Question::new(QuestionKind::LightingReview, prompt, &LightingDelta::example())
}

impl LightsAnswer {
    /// Whether the answer speaks of known sources in range.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, ids: &[String]) -> Result<(), String> {
        for light in &self.lights {
            if !ids.contains(&light.id) {
                return Err(format!("there is no light {:?}; the ids are {}", light.id, ids.join(", ")));
            }
            if let Some(level) = light.level {
                in_range(&format!("level of {}", light.id), level, 0.0, 5.0)?;
            }
        }
        if let Some(level) = self.ambient_level {
            in_range("ambient_level", level, 0.0, 3.0)?;
        }
        Ok(())
    }
}
