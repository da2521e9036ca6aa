//! `6_lighting/lights` and `6_lighting/review_<n>` (paper App. C, "Material and Lighting Estimation").

use harmony_lighting::{LightingDelta, LightingSpec, PointLightSpec, SunSpec, WindowSpec};
use harmony_scene::{LightKind, Lighting, ObjectId};
use serde::Serialize;

use crate::question::{Ask, fill, in_range, lines};

/// Difference in warmth (log2 of red over blue) that nobody sees.
const LITTLE_WARMTH: f64 = 0.07;
/// Most patches of sun, and most shadows, of one answer.
const MAX_PATCHES: usize = 12;

/// Asks which sources emit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightsQuestion {
    /// The sources.
    pub lighting: Lighting,
    /// Ids of the sources that are screens, or strips and fields of light: rectangles of light as windows are, answered
    /// among them.
    #[serde(skip)]
    pub screens: Vec<String>,
    /// Mean linear luminance of the photo.
    pub photo_luminance: f64,
    /// How bright objects are in the photo.
    pub seen: Vec<SeenObject>,
}

/// How bright an object is in the photo.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeenObject {
    /// Id.
    pub id: ObjectId,
    /// Linear luminance of its median colour.
    pub luminance: f64,
}

/// Asks for corrections of the light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightingReviewQuestion {
    /// The current setup.
    #[serde(skip)]
    pub lighting: Lighting,
    /// How much brighter the preview is than the photo, stops.
    #[serde(skip)]
    pub stops: f64,
    /// How much warmer it is, log2 of red over blue.
    #[serde(skip)]
    pub warmth: f64,
    /// The correction that measurement proposes.
    pub proposed: LightingDelta,
}

impl Ask for LightsQuestion {
    type Answer = LightingSpec;

    fn prompt(&self) -> String {
        let sources: Vec<String> = self
            .lighting
            .lights
            .iter()
            .map(|light| {
                let kind = match light.kind {
                    LightKind::Point { .. } => "lamp",
                    LightKind::Area { .. } if self.screens.contains(&light.id) => "screen, strip or field",
                    LightKind::Area { .. } => "window",
                    LightKind::Sun { .. } => "sun",
                };
                let [x, y, z] = light.position;
                format!("- {}: {kind} at ({x:.2}, {y:.2}, {z:.2}), {:.0} W", light.id, light.intensity)
            })
            .collect();
        fill(include_str!("../templates/lights.md"), &[("sources", lines(&sources))])
    }

    fn example(&self) -> LightingSpec {
        LightingSpec {
            ambient: None,
            directional: Vec::new(),
            point_lights: vec![PointLightSpec {
                id: "floor_lamp_01".into(),
                on: Some(true),
                color: Some([1.0, 0.8, 0.55]),
                intensity: Some(1.2),
            }],
            windows: vec![WindowSpec {
                id: "window_01".into(),
                daylight_on: Some(false),
                color: None,
                intensity: None,
            }],
            direct_sun: Some(true),
            unseen_daylight: None,
            sun: Some(SunSpec {
                patches: vec![vec![[610.0, 830.0], [702.0, 812.0], [788.0, 868.0], [690.0, 890.0]]],
                shadows: vec![[[540.0, 720.0], [498.0, 806.0]]],
            }),
            summary: "Evening; a floor lamp lights the corner.".into(),
        }
    }

    /// What does not fit the sources is repaired where the answer is applied; the sun's places have to be places.
    fn check(&self, answer: &LightingSpec) -> Result<(), String> {
        let Some(sun) = &answer.sun else { return Ok(()) };
        if sun.patches.len() > MAX_PATCHES || sun.shadows.len() > MAX_PATCHES {
            return Err(format!("at most {MAX_PATCHES} patches of sun, and as many shadows"));
        }
        if let Some(few) = sun.patches.iter().find(|patch| patch.len() < 3) {
            return Err(format!("a patch of sun has {} corner(s); three or more are needed", few.len()));
        }
        for p in sun.patches.iter().flatten().chain(sun.shadows.iter().flatten()) {
            in_range("a place of the sun's, x", p[0], -20.0, 1020.0)?;
            in_range("a place of the sun's, y", p[1], -20.0, 1020.0)?;
        }
        Ok(())
    }
}

impl Ask for LightingReviewQuestion {
    type Answer = LightingDelta;

    fn prompt(&self) -> String {
        let setup = serde_json::to_string_pretty(&self.lighting).expect("a setup is plain data");
        let tone = match self.warmth {
            w if w > LITTLE_WARMTH => "warmer than",
            w if w < -LITTLE_WARMTH => "colder than",
            _ => "about as warm as",
        };
        let measured = format!(
            "the preview is {:.2} times as bright as the photo, and {tone} it (its red against its blue is {:.2} times the photo's)",
            self.stops.exp2(),
            self.warmth.exp2()
        );
        fill(include_str!("../templates/lighting_review.md"), &[("setup", setup), ("measured", measured)])
    }

    fn example(&self) -> LightingDelta {
        LightingDelta::default()
    }

    /// What does not fit the sources is repaired where the answer is applied.
    fn check(&self, _: &LightingDelta) -> Result<(), String> {
        Ok(())
    }

    /// What was measured is taken as it is.
    fn without_looking(&self) -> Option<LightingDelta> {
        Some(self.proposed.clone())
    }
}
