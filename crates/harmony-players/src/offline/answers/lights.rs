//! `lights` and `lighting_review`: by measured brightness.

use harmony_lighting::{LightingDelta, LightingSpec, LightingVerdict, PointLightSpec, WindowSpec};
use harmony_scene::{LightKind, Lighting};
use serde_json::Value;

/// Luminance relative to the photo's mean from which a lamp is taken to shine.
const LAMP_RATIO: f64 = 2.0;

/// Linear luminance from which a lamp is taken to shine in any photo.
const LAMP_LUMINANCE: f64 = 0.6;

/// Luminance relative to the photo's mean from which daylight comes through a window.
const WINDOW_RATIO: f64 = 1.2;

/// Facts: `lighting` (the sources), `photo_luminance` (linear mean), `seen` (`id`, `luminance` of objects).
///
/// A lamp shines when it is much brighter than the photo, a window when it is somewhat brighter. Of what was not seen
/// nothing is said, so it stays as it is listed. Colours are left to the fit.
pub fn lights(facts: &Value) -> LightingSpec {
    let Ok(lighting) = serde_json::from_value::<Lighting>(facts["lighting"].clone()) else {
        return LightingSpec::default();
    };
    let mean = facts["photo_luminance"].as_f64().filter(|v| v.is_finite() && *v > 0.0).unwrap_or(0.2);
    let luminance = |id: &str| -> Option<f64> {
        let seen = facts["seen"].as_array()?.iter().find(|entry| entry["id"] == id)?;
        seen["luminance"].as_f64().filter(|v| v.is_finite())
    };
    let mut spec = LightingSpec {
        summary: "By rule: what is brighter than the photo shines.".to_owned(),
        ..LightingSpec::default()
    };
    for light in &lighting.lights {
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

/// Facts: `proposed`, the correction that was measured between photo and preview; it is taken as it is. Without one
/// nothing is changed.
pub fn lighting_review(facts: &Value) -> LightingDelta {
    serde_json::from_value(facts["proposed"].clone())
        .unwrap_or_else(|_| LightingDelta { verdict: LightingVerdict::Converged, ..LightingDelta::default() })
}
