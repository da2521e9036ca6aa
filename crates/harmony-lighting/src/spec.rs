//! The model's first answer about light (key `light.spec`): which sources emit, in which colour, how strongly.
//!
//! Paper: App. C "Lighting estimation": "the VLM decides which sources are emitting and their color and intensity,
//! returning a compact lighting specification consumed by the renderer". The paper shows no schema for it; this one
//! mirrors the names of its refinement answer ([`crate::LightingDelta`]).

use harmony_scene::{Light, LightKind, Lighting};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::delta::bounds;

/// Ambient light of the room.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct AmbientSpec {
    /// Linear RGB, each 0 to 1; null = as listed.
    pub color: Option<[f64; 3]>,
    /// Multiplier on the listed intensity; 1 = typical of such a room; null = 1.
    pub intensity: Option<f64>,
}

/// Sun or other light from far away.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct DirectionalSpec {
    /// Number of the directional light in the list given, from 0.
    pub index: usize,
    /// Whether it shines.
    pub on: Option<bool>,
    /// Linear RGB, each 0 to 1; null = as listed.
    pub color: Option<[f64; 3]>,
    /// Multiplier on the listed intensity; null = 1.
    pub intensity: Option<f64>,
}

/// One lamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct PointLightSpec {
    /// Id of the lamp in the list given.
    pub id: String,
    /// Whether it shines in the photo.
    pub on: Option<bool>,
    /// Linear RGB, each 0 to 1; null = as listed.
    pub color: Option<[f64; 3]>,
    /// Multiplier on the listed intensity; 1 = typical of such a lamp; null = 1.
    pub intensity: Option<f64>,
}

/// One window or screen.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct WindowSpec {
    /// Id of the window or screen in the list given.
    pub id: String,
    /// Whether daylight comes in; of a screen, whether it is on.
    pub daylight_on: Option<bool>,
    /// Linear RGB, each 0 to 1; null = as listed.
    pub color: Option<[f64; 3]>,
    /// Multiplier on the listed intensity; 1 = bright overcast day; null = 1.
    pub intensity: Option<f64>,
}

/// Direct sunlight in the room (beyond the paper).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct SunSpec {
    /// Outlines in the photo of patches of direct sun on floor, walls or furniture that come through openings which the photo
    /// does not show: corners in order, 0..1000; each pane's patch by itself.
    pub patches: Vec<Vec<[f64; 2]>>,
    /// Points on the edge of something in the sun, each with the place where that point's shadow falls, 0..1000.
    pub shadows: Vec<[[f64; 2]; 2]>,
}

/// The compact lighting specification.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LightingSpec {
    /// Ambient light; null = as listed.
    pub ambient: Option<AmbientSpec>,
    /// Sun and the like.
    pub directional: Vec<DirectionalSpec>,
    /// Lamps and ceiling fixtures.
    pub point_lights: Vec<PointLightSpec>,
    /// Windows and screens.
    pub windows: Vec<WindowSpec>,
    /// Whether the sun falls directly on anything in the room, through whatever window; null when that is not clear.
    pub direct_sun: Option<bool>,
    /// Whether daylight comes in through windows that the photo does not show, beside or behind the camera; null when that is
    /// not clear.
    pub unseen_daylight: Option<bool>,
    /// Direct sun through openings that the photo does not show; null when there is none.
    pub sun: Option<SunSpec>,
    /// One sentence: time of day, what lights the room.
    pub summary: String,
}

/// Which list of an answer a light belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LightList {
    Point,
    Window,
    Directional,
}

pub(crate) fn list_of(light: &Light) -> LightList {
    match light.kind {
        LightKind::Point { .. } => LightList::Point,
        LightKind::Area { .. } => LightList::Window,
        LightKind::Sun { .. } => LightList::Directional,
    }
}

/// Position of the named light of a list.
pub(crate) fn find(lighting: &Lighting, list: LightList, id: &str) -> Option<usize> {
    lighting.lights.iter().position(|l| l.id == id && list_of(l) == list)
}

/// Position of the `index`-th directional light.
pub(crate) fn find_directional(lighting: &Lighting, index: usize) -> Option<usize> {
    let mut suns = lighting.lights.iter().enumerate().filter(|(_, l)| list_of(l) == LightList::Directional);
    suns.nth(index).map(|(i, _)| i)
}

/// One light's part of an answer, whichever list it was in.
struct Change<'a> {
    on: Option<bool>,
    color: Option<[f64; 3]>,
    intensity: Option<f64>,
    name: &'a str,
}

impl LightingSpec {
    /// The schema to send with the question.
    pub fn schema() -> serde_json::Value {
        crate::strict_schema::<Self>()
    }

    /// Sets colours, intensities and switches; everything is brought into [`crate::delta::bounds`].
    ///
    /// Returns what was not as asked: unknown ids, values out of range.
    pub fn apply(&self, lighting: &mut Lighting) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some(ambient) = &self.ambient {
            if let Some(color) = ambient.color {
                lighting.ambient_color = bounds::color(color, lighting.ambient_color, "ambient", &mut notes);
            }
            let k = bounds::multiplier(ambient.intensity, bounds::SPEC_INTENSITY, "ambient", &mut notes);
            lighting.ambient_intensity = bounds::ambient(lighting.ambient_intensity * k);
        }
        for (list, id, change) in self.changes() {
            let at = match list {
                LightList::Directional => id.parse().ok().and_then(|i| find_directional(lighting, i)),
                _ => find(lighting, list, &id),
            };
            let Some(light) = at.and_then(|i| lighting.lights.get_mut(i)) else {
                notes.push(format!("there is no {} {}", change.name, bounds::shortened(&id)));
                continue;
            };
            if let Some(on) = change.on {
                light.on = on;
            }
            let name = light.id.clone();
            if let Some(color) = change.color {
                light.color = bounds::color(color, light.color, &name, &mut notes);
            }
            let k = bounds::multiplier(change.intensity, bounds::SPEC_INTENSITY, &name, &mut notes);
            light.intensity = bounds::intensity(&light.kind, light.intensity * k);
        }
        notes
    }

    fn changes(&self) -> Vec<(LightList, String, Change<'_>)> {
        let mut all = Vec::new();
        for s in &self.directional {
            let change = Change { on: s.on, color: s.color, intensity: s.intensity, name: "directional light" };
            all.push((LightList::Directional, s.index.to_string(), change));
        }
        for s in &self.point_lights {
            let change = Change { on: s.on, color: s.color, intensity: s.intensity, name: "lamp" };
            all.push((LightList::Point, s.id.clone(), change));
        }
        for s in &self.windows {
            let change = Change { on: s.daylight_on, color: s.color, intensity: s.intensity, name: "window" };
            all.push((LightList::Window, s.id.clone(), change));
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delta::tests::evening;

    #[test]
    fn a_specification_sets_what_it_names_and_reports_the_rest() {
        let mut lighting = evening();
        let before = lighting.clone();
        let spec: LightingSpec = serde_json::from_str(
            r#"{"ambient": {"color": null, "intensity": 0.5}, "directional": [{"index": 0, "on": false}],
                "point_lights": [{"id": "lamp_01", "on": true, "color": [2, 1, 0.5], "intensity": 1e9},
                                 {"id": "window_01", "on": false}],
                "windows": [{"id": "window_01", "daylight_on": false}], "summary": "evening"}"#,
        )
        .unwrap();
        let notes = spec.apply(&mut lighting);
        assert_eq!(lighting.ambient_intensity, before.ambient_intensity * 0.5);
        assert_eq!(lighting.ambient_color, before.ambient_color);
        let lamp = lighting.lights.iter().find(|l| l.id == "lamp_01").unwrap();
        assert!(lamp.on);
        assert_eq!(lamp.color, [1.0, 0.5, 0.25]);
        assert!(lamp.intensity <= bounds::POINT_WATTS[1]);
        assert!(!lighting.lights.iter().find(|l| l.id == "window_01").unwrap().on);
        assert!(!lighting.lights.iter().find(|l| l.id == "sun_01").unwrap().on);
        assert!(notes.iter().any(|n| n.contains("no lamp window_01")), "{notes:?}");
        assert!(notes.iter().any(|n| n.contains("lamp_01") && n.contains("intensity")), "{notes:?}");
    }

    #[test]
    fn the_schema_requires_every_field_and_allows_null() {
        let schema = LightingSpec::schema();
        assert_eq!(schema["required"].as_array().unwrap().len(), 8);
        assert_eq!(schema["additionalProperties"], false);
        let lamp = &schema["properties"]["point_lights"]["items"];
        assert_eq!(lamp["required"].as_array().unwrap().len(), 4, "{lamp}");
        let text = serde_json::to_string(&lamp["properties"]["on"]).unwrap();
        assert!(text.contains("null"), "{text}");
    }
}
