//! `lights`: by measured brightness.

use harmony_lighting::{LightingSpec, PointLightSpec, WindowSpec};
use harmony_prompts::LightsQuestion;
use harmony_scene::LightKind;

/// Luminance relative to the photo's mean from which a lamp is taken to shine.
const LAMP_RATIO: f64 = 2.0;

/// Linear luminance from which a lamp is taken to shine in any photo.
const LAMP_LUMINANCE: f64 = 0.6;

/// Luminance relative to the photo's mean from which daylight comes through a window.
const WINDOW_RATIO: f64 = 1.2;

/// A lamp shines when it is much brighter than the photo, a window when it is somewhat brighter. Of what was not seen
/// nothing is said, so it stays as it is listed. Colours are left to the fit.
pub fn lights(question: &LightsQuestion) -> LightingSpec {
    // A black photo has no mean to compare with.
    let mean = Some(question.photo_luminance).filter(|v| v.is_finite() && *v > 0.0).unwrap_or(0.2);
    let luminance = |id: &str| {
        let seen = question.seen.iter().find(|seen| seen.id.as_str() == id)?;
        Some(seen.luminance).filter(|v| v.is_finite())
    };
    let mut spec = LightingSpec {
        summary: "By rule: what is brighter than the photo shines.".to_owned(),
        ..LightingSpec::default()
    };
    for light in &question.lighting.lights {
        let object = light.object.as_ref().map_or(light.id.as_str(), |id| id.as_str());
        let Some(seen) = luminance(object) else { continue };
        match light.kind {
            LightKind::Point { .. } => {
                let on = Some(seen >= (LAMP_RATIO * mean).min(LAMP_LUMINANCE));
                spec.point_lights.push(PointLightSpec { id: light.id.clone(), on, ..PointLightSpec::default() });
            }
            LightKind::Area { .. } => {
                let daylight_on = Some(seen >= WINDOW_RATIO * mean);
                spec.windows.push(WindowSpec { id: light.id.clone(), daylight_on, ..WindowSpec::default() });
            }
            LightKind::Sun { .. } => {}
        }
    }
    spec
}
