//! The reflective loop's answer about light (paper App. C, "Lighting estimation"; key `light.loop`) and how it is applied.

use glam::DVec3;
use harmony_scene::{Extents, Lighting};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::assess::{Brightness, Tone};
use crate::spec::{LightList, find, find_directional};

/// Limits of everything that an answer can change.
pub mod bounds {
    use harmony_scene::LightKind;

    /// `global_intensity_mult` of one round (paper App. C).
    pub const GLOBAL_MULT: [f64; 2] = [0.5, 1.3];
    /// Multiplier on a single light in one round.
    pub const LIGHT_MULT: [f64; 2] = [0.25, 4.0];
    /// Multiplier on a default intensity in a specification.
    pub const SPEC_INTENSITY: [f64; 2] = [0.02, 8.0];
    /// Change of a colour channel in one round, either way.
    pub const COLOR_STEP: f64 = 0.3;
    /// Smallest channel of a light's colour when the brightest is 1: a candle has about 0.1 of blue.
    pub const COLOR_MIN: f64 = 0.1;
    /// Shift of a lamp in one round, metres along each axis.
    pub const OFFSET_M: f64 = 0.3;
    /// Radiant power of a lamp, watts (a 60 W bulb of old gives about 5 W of light in Cycles' sense; photo lamps more).
    pub const POINT_WATTS: [f64; 2] = [0.05, 300.0];
    /// Radiant power of a window, watts.
    pub const AREA_WATTS: [f64; 2] = [0.05, 2000.0];
    /// Sun, W/m2.
    pub const SUN_WM2: [f64; 2] = [0.01, 30.0];
    /// Ambient radiance.
    pub const AMBIENT: [f64; 2] = [0.0, 5.0];

    /// The power range of a kind of light.
    pub fn range(kind: &LightKind) -> [f64; 2] {
        match kind {
            LightKind::Point { .. } => POINT_WATTS,
            LightKind::Area { .. } => AREA_WATTS,
            LightKind::Sun { .. } => SUN_WM2,
        }
    }

    /// An intensity within the range of its kind; not a number becomes the lower end.
    pub fn intensity(kind: &LightKind, value: f64) -> f64 {
        let [low, high] = range(kind);
        if value.is_nan() { low } else { value.clamp(low, high) }
    }

    /// An ambient radiance within range.
    pub fn ambient(value: f64) -> f64 {
        if value.is_nan() { 0.0 } else { value.clamp(AMBIENT[0], AMBIENT[1]) }
    }

    /// A multiplier within a range, 1 where none is given; a note where it had to be changed.
    pub(crate) fn multiplier(given: Option<f64>, range: [f64; 2], name: &str, notes: &mut Vec<String>) -> f64 {
        let Some(value) = given else { return 1.0 };
        if !value.is_finite() {
            notes.push(format!("{name}: intensity is not a number, left as it is"));
            return 1.0;
        }
        let kept = value.clamp(range[0], range[1]);
        if kept != value {
            notes.push(format!("{name}: intensity multiplier {value} brought to {kept}"));
        }
        kept
    }

    /// A colour with its brightest channel 1 and no channel below [`COLOR_MIN`]; `fallback` when it is none.
    pub(crate) fn color(given: [f64; 3], fallback: [f64; 3], name: &str, notes: &mut Vec<String>) -> [f64; 3] {
        let top = given.iter().copied().fold(0.0, f64::max);
        if given.iter().any(|c| !c.is_finite() || *c < 0.0) || top <= 0.0 {
            notes.push(format!("{name}: {given:?} is no colour, left as it is"));
            return fallback;
        }
        given.map(|c| (c / top).clamp(COLOR_MIN, 1.0))
    }

    /// A text from outside, cut for a note.
    pub(crate) fn shortened(text: &str) -> String {
        text.chars().filter(|c| !c.is_control()).take(64).collect()
    }
}

/// Whether another round is needed, in the model's view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LightingVerdict {
    /// It matches.
    Converged,
    /// Apply the deltas and look again.
    #[default]
    Adjust,
}

/// Change of the ambient light.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct AmbientDelta {
    /// Added to the linear RGB colour; null = none.
    pub color_delta: Option<[f64; 3]>,
    /// Multiplies the intensity; null = 1.
    pub intensity_mult: Option<f64>,
}

/// Change of a light from far away.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct DirectionalDelta {
    /// Number of the directional light, from 0.
    pub index: usize,
    /// Added to the linear RGB colour; null = none.
    pub color_delta: Option<[f64; 3]>,
    /// Multiplies the intensity; null = 1.
    pub intensity_mult: Option<f64>,
}

/// Change of a lamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct PointLightDelta {
    /// Id of the lamp.
    pub id: String,
    /// Switches it; null = leave.
    pub set_on: Option<bool>,
    /// Added to the linear RGB colour; null = none.
    pub color_delta: Option<[f64; 3]>,
    /// Multiplies the intensity; null = 1.
    pub intensity_mult: Option<f64>,
    /// Moves it, metres in the room frame; null = not.
    pub offset_delta_m: Option<[f64; 3]>,
}

/// Change of a window.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct WindowDelta {
    /// Id of the window.
    pub id: String,
    /// Switches its daylight; null = leave.
    pub set_daylight_on: Option<bool>,
    /// Added to the linear RGB colour; null = none.
    pub color_delta: Option<[f64; 3]>,
    /// Multiplies the intensity; null = 1.
    pub intensity_mult: Option<f64>,
}

/// The paper's refinement answer, field by field.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LightingDelta {
    /// The preview's brightness against the photo.
    pub brightness_assessment: Brightness,
    /// The preview's tone against the photo.
    pub tone_assessment: Tone,
    /// Multiplies every active light and the ambient light, within [0.5, 1.3]; null = 1.
    pub global_intensity_mult: Option<f64>,
    /// Ambient light; null = unchanged.
    pub ambient_delta: Option<AmbientDelta>,
    /// Sun and the like.
    pub directional_delta: Vec<DirectionalDelta>,
    /// Lamps.
    pub point_light_deltas: Vec<PointLightDelta>,
    /// Windows.
    pub window_deltas: Vec<WindowDelta>,
    /// Whether it matches now.
    pub verdict: LightingVerdict,
}

fn shifted(color: [f64; 3], delta: Option<[f64; 3]>, name: &str, notes: &mut Vec<String>) -> [f64; 3] {
    let Some(delta) = delta else { return color };
    if delta.iter().any(|d| !d.is_finite()) {
        notes.push(format!("{name}: colour change is not a number, left as it is"));
        return color;
    }
    let mut target = color;
    for (c, d) in target.iter_mut().zip(delta) {
        let step = d.clamp(-bounds::COLOR_STEP, bounds::COLOR_STEP);
        if step != d {
            notes.push(format!("{name}: colour change {d} brought to {step}"));
        }
        *c = (*c + step).max(0.0);
    }
    bounds::color(target, color, name, notes)
}

impl LightingDelta {
    /// The schema to send with the question.
    pub fn schema() -> serde_json::Value {
        crate::strict_schema::<Self>()
    }

    /// Whether nothing would change: the verdict says so, or every delta is empty.
    pub fn is_converged(&self) -> bool {
        let still = |mult: Option<f64>, color: Option<[f64; 3]>| {
            mult.is_none_or(|k| (k - 1.0).abs() < 1e-3) && color.is_none_or(|c| c.iter().all(|d| d.abs() < 1e-3))
        };
        self.verdict == LightingVerdict::Converged
            || (still(self.global_intensity_mult, None)
                && self.ambient_delta.as_ref().is_none_or(|d| still(d.intensity_mult, d.color_delta))
                && self.directional_delta.iter().all(|d| still(d.intensity_mult, d.color_delta))
                && self
                    .window_deltas
                    .iter()
                    .all(|d| d.set_daylight_on.is_none() && still(d.intensity_mult, d.color_delta))
                && self.point_light_deltas.iter().all(|d| {
                    d.set_on.is_none() && still(d.intensity_mult, d.color_delta) && still(None, d.offset_delta_m)
                }))
    }

    /// Applies the answer; every value is brought into [`bounds`] first.
    ///
    /// A converged verdict changes nothing, whatever else is in the answer. A lamp stays inside the room box.
    /// Returns what was not as asked.
    pub fn apply(&self, lighting: &mut Lighting, room: &Extents) -> Vec<String> {
        let mut notes = Vec::new();
        if self.verdict == LightingVerdict::Converged {
            return notes;
        }
        // Switches come first, so that a lamp just switched on takes part in the global multiplier.
        for d in &self.point_light_deltas {
            let Some(i) = find(lighting, LightList::Point, &d.id) else {
                notes.push(format!("there is no lamp {}", bounds::shortened(&d.id)));
                continue;
            };
            let light = &mut lighting.lights[i];
            light.on = d.set_on.unwrap_or(light.on);
            light.color = shifted(light.color, d.color_delta, &light.id, &mut notes);
            light.intensity *= bounds::multiplier(d.intensity_mult, bounds::LIGHT_MULT, &light.id, &mut notes);
            if let Some(offset) = d.offset_delta_m {
                let offset = DVec3::from_array(offset);
                if offset.is_finite() {
                    let kept = offset.clamp(DVec3::splat(-bounds::OFFSET_M), DVec3::splat(bounds::OFFSET_M));
                    if kept != offset {
                        notes.push(format!("{}: move {offset} m cut to {kept}", light.id));
                    }
                    let moved = DVec3::from_array(light.position) + kept;
                    light.position = moved.clamp(DVec3::ZERO, room.as_vec().max(DVec3::ZERO)).to_array();
                } else {
                    notes.push(format!("{}: move is not a number, left as it is", light.id));
                }
            }
        }
        for d in &self.window_deltas {
            let Some(i) = find(lighting, LightList::Window, &d.id) else {
                notes.push(format!("there is no window {}", bounds::shortened(&d.id)));
                continue;
            };
            let light = &mut lighting.lights[i];
            light.on = d.set_daylight_on.unwrap_or(light.on);
            light.color = shifted(light.color, d.color_delta, &light.id, &mut notes);
            light.intensity *= bounds::multiplier(d.intensity_mult, bounds::LIGHT_MULT, &light.id, &mut notes);
        }
        for d in &self.directional_delta {
            let Some(i) = find_directional(lighting, d.index) else {
                notes.push(format!("there is no directional light {}", d.index));
                continue;
            };
            let light = &mut lighting.lights[i];
            light.color = shifted(light.color, d.color_delta, &light.id, &mut notes);
            light.intensity *= bounds::multiplier(d.intensity_mult, bounds::LIGHT_MULT, &light.id, &mut notes);
        }
        if let Some(d) = &self.ambient_delta {
            lighting.ambient_color = shifted(lighting.ambient_color, d.color_delta, "ambient", &mut notes);
            lighting.ambient_intensity *=
                bounds::multiplier(d.intensity_mult, bounds::LIGHT_MULT, "ambient", &mut notes);
        }
        let k = bounds::multiplier(self.global_intensity_mult, bounds::GLOBAL_MULT, "global", &mut notes);
        for light in lighting.lights.iter_mut().filter(|l| l.on) {
            light.intensity *= k;
        }
        for light in &mut lighting.lights {
            light.intensity = bounds::intensity(&light.kind, light.intensity);
        }
        lighting.ambient_intensity = bounds::ambient(lighting.ambient_intensity * k);
        notes
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use harmony_scene::{Light, LightKind};
    use proptest::prelude::*;

    use super::*;

    pub(crate) const ROOM: Extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };

    pub(crate) fn evening() -> Lighting {
        let light = |id: &str, kind, intensity, on| Light {
            id: id.to_owned(),
            kind,
            position: [1.0, 1.2, 0.5],
            color: [1.0, 0.8, 0.6],
            intensity,
            on,
            object: None,
            shade: None,
        };
        Lighting {
            lights: vec![
                light("lamp_01", LightKind::Point { radius_m: 0.05 }, 20.0, false),
                light("window_01", LightKind::Area { direction: [0.0, 0.0, 1.0], size_m: [1.0, 1.2] }, 40.0, true),
                light("sun_01", LightKind::Sun { direction: [0.0, -1.0, 0.2] }, 3.0, true),
            ],
            ambient_color: [1.0; 3],
            ambient_intensity: 0.2,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::Standard,
        }
    }

    #[test]
    fn the_global_multiplier_is_bounded_as_in_the_paper_and_spares_lights_that_are_off() {
        let mut lighting = evening();
        let delta = LightingDelta { global_intensity_mult: Some(9.0), ..LightingDelta::default() };
        let notes = delta.apply(&mut lighting, &ROOM);
        assert_eq!(lighting.lights[0].intensity, 20.0);
        assert!((lighting.lights[1].intensity - 52.0).abs() <= 1e-9);
        assert!((lighting.ambient_intensity - 0.26).abs() <= 1e-9);
        assert_eq!(notes.len(), 1);
        let mut dark = evening();
        LightingDelta { global_intensity_mult: Some(0.0), ..LightingDelta::default() }.apply(&mut dark, &ROOM);
        assert!((dark.lights[1].intensity - 20.0).abs() <= 1e-9);
    }

    #[test]
    fn the_papers_answer_parses_and_works() {
        let delta: LightingDelta = serde_json::from_str(
            r#"{"brightness_assessment": "too_dim", "tone_assessment": "too_cool", "global_intensity_mult": 1.1,
                "ambient_delta": {"color_delta": [0, 0, -0.2], "intensity_mult": 1.5},
                "directional_delta": [{"index": 0, "color_delta": null, "intensity_mult": 0.5}],
                "point_light_deltas": [{"id": "lamp_01", "set_on": true, "color_delta": null, "intensity_mult": 2.0,
                                        "offset_delta_m": [0, 5, 0]}],
                "window_deltas": [{"id": "nope", "set_daylight_on": false, "color_delta": null, "intensity_mult": null}],
                "verdict": "adjust"}"#,
        )
        .unwrap();
        assert_eq!(delta.brightness_assessment, Brightness::TooDim);
        assert!(!delta.is_converged());
        let mut lighting = evening();
        let notes = delta.apply(&mut lighting, &ROOM);
        assert!(lighting.lights[0].on);
        assert!((lighting.lights[0].intensity - 44.0).abs() <= 1e-9);
        assert!((lighting.lights[0].position[1] - 1.5).abs() <= 1e-9, "the move was cut to 0.3 m");
        assert!((lighting.lights[2].intensity - 1.65).abs() <= 1e-9);
        assert_eq!(lighting.ambient_color, [1.0, 1.0, 0.8]);
        assert!(notes.iter().any(|n| n.contains("no window nope")));
    }

    #[test]
    fn converged_means_no_change() {
        let mut lighting = evening();
        let delta = LightingDelta {
            verdict: LightingVerdict::Converged,
            global_intensity_mult: Some(0.5),
            ..LightingDelta::default()
        };
        assert!(delta.is_converged());
        assert!(delta.apply(&mut lighting, &ROOM).is_empty());
        assert_eq!(lighting, evening());
        assert!(LightingDelta::default().is_converged(), "empty deltas are converged too");
        let switch = WindowDelta { set_daylight_on: Some(false), ..WindowDelta::default() };
        assert!(!LightingDelta { window_deltas: vec![switch], ..LightingDelta::default() }.is_converged());
    }

    proptest! {
        #[test]
        fn no_answer_leaves_the_bounds(k in any::<f64>(), m in any::<f64>(), c in any::<[f64; 3]>(), o in any::<[f64; 3]>()) {
            let mut lighting = evening();
            for _ in 0..20 {
                LightingDelta {
                    global_intensity_mult: Some(k),
                    ambient_delta: Some(AmbientDelta { color_delta: Some(c), intensity_mult: Some(m) }),
                    directional_delta: vec![DirectionalDelta { index: 0, color_delta: Some(c), intensity_mult: Some(m) }],
                    point_light_deltas: vec![PointLightDelta {
                        id: "lamp_01".into(), set_on: Some(true), color_delta: Some(c), intensity_mult: Some(m),
                        offset_delta_m: Some(o),
                    }],
                    ..LightingDelta::default()
                }
                .apply(&mut lighting, &ROOM);
            }
            for light in &lighting.lights {
                let [low, high] = bounds::range(&light.kind);
                prop_assert!((low..=high).contains(&light.intensity));
                prop_assert!(light.color.iter().all(|c| (bounds::COLOR_MIN..=1.0).contains(c)));
                prop_assert!(light.position.iter().all(|p| p.is_finite()));
            }
            prop_assert!((bounds::AMBIENT[0]..=bounds::AMBIENT[1]).contains(&lighting.ambient_intensity));
        }
    }
}
