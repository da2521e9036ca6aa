//! `6_lighting/lights` and `6_lighting/review_<n>` (paper App. C, "Material and Lighting Estimation").

use harmony_lighting::{LightingDelta, LightingSpec, PointLightSpec, WindowSpec};

use crate::question::{Question, QuestionKind, fill};

/// What `lights` is filled with.
#[derive(Debug, Clone)]
pub struct LightsVars {
    /// Sources: id, kind, position, one line each.
    pub sources: Vec<String>,
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
    let example = LightingSpec {
        ambient: None,
        directional: Vec::new(),
        point_lights: vec![PointLightSpec {
            id: "floor_lamp_01".into(),
            on: Some(true),
            color: Some([1.0, 0.8, 0.55]),
            intensity: Some(1.2),
        }],
        windows: vec![WindowSpec { id: "window_01".into(), daylight_on: Some(false), color: None, intensity: None }],
        summary: "Evening; a floor lamp lights the corner.".into(),
    };
    Question::new(QuestionKind::Lights, prompt, &example)
}

/// Asks for corrections of the light.
pub fn lighting_review(vars: &LightingReviewVars) -> Question {
    let prompt = fill(
        include_str!("../templates/lighting_review.md"),
        &[("setup", vars.setup.clone()), ("measured", vars.measured.clone())],
    );
    Question::new(QuestionKind::LightingReview, prompt, &LightingDelta::default())
}
