//! What the model says about light, from the truth.

use glam::DVec3;
use harmony_scene::{Light, LightKind, Lighting};
use serde_json::{Value, json};

use super::Oracle;
use crate::truth::{TruthLight, TruthLightKind};

/// A window of the run is the true one whose light is nearer than this, metres.
const SAME_WINDOW_M: f64 = 0.8;
/// Multipliers that an answer may give.
const MULTIPLIER: [f64; 2] = [0.02, 8.0];

impl Oracle {
    /// The compact lighting specification: which of the listed sources shine, how strongly and in which colour.
    ///
    /// Powers are as far off as three hints: nobody reads watts from a photo.
    pub(super) fn lights(&self, listed: &Lighting) -> Value {
        let (mut lamps, mut windows, mut suns) = (Vec::new(), Vec::new(), Vec::new());
        for light in &listed.lights {
            let truth = self.true_light(light);
            let color = truth.map(|t| brightest_one(t.color));
            let intensity = truth.map(|t| {
                let off = self.factor(&format!("light {}", light.id), 3.0 * self.noise.hints).max(0.3);
                (t.power / light.intensity.max(1e-6) * off).clamp(MULTIPLIER[0], MULTIPLIER[1])
            });
            let on = truth.is_some();
            match light.kind {
                LightKind::Area { .. } => windows.push(json!({
                    "id": light.id, "daylight_on": on, "color": color, "intensity": intensity,
                })),
                LightKind::Point { .. } => {
                    lamps.push(json!({ "id": light.id, "on": on, "color": color, "intensity": intensity }));
                }
                LightKind::Sun { .. } => suns.push(json!({
                    "index": suns.len(), "on": on, "color": color, "intensity": intensity,
                })),
            }
        }
        json!({
            "ambient": null, "directional": suns, "point_lights": lamps, "windows": windows,
            "summary": "as in the truth",
        })
    }

    /// The true light that a light of the run is.
    fn true_light(&self, light: &Light) -> Option<&TruthLight> {
        let owner = light.object.as_ref().map_or(light.id.as_str(), |id| id.as_str());
        let owner = self.known(owner).map(|o| o.id.as_str());
        let fits = |t: &&TruthLight| {
            matches!(
                (&light.kind, t.kind),
                (LightKind::Area { .. }, TruthLightKind::Area)
                    | (LightKind::Point { .. }, TruthLightKind::Point)
                    | (LightKind::Sun { .. }, TruthLightKind::Sun)
            )
        };
        let of_owner = self.lights.iter().filter(fits).find(|t| t.owner.is_some() && t.owner.as_deref() == owner);
        let at = DVec3::from_array(light.position);
        let near = || {
            let windows =
                self.lights.iter().filter(fits).filter(|t| t.kind == TruthLightKind::Area && t.owner.is_some());
            windows
                .map(|t| (t.position.distance(at), t))
                .filter(|(d, _)| *d < SAME_WINDOW_M)
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, t)| t)
        };
        of_owner.or_else(near)
    }
}

/// A colour with its brightest channel 1.
fn brightest_one(color: DVec3) -> [f64; 3] {
    (color / color.max_element().max(1e-6)).to_array()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use harmony_scene::{Camera, Extents, ImageSize, Intrinsics};

    use super::*;
    use crate::oracle::NoiseLevel;
    use crate::truth::TruthRoom;

    fn oracle(lights: Vec<TruthLight>) -> Oracle {
        let size = ImageSize::new(8, 6);
        let room = TruthRoom {
            name: "lit".to_owned(),
            folder: std::path::PathBuf::from("/nowhere"),
            camera: Camera::looking(size, Intrinsics::centred(size, 6.0), DVec3::new(2.0, 1.5, 4.0), DVec3::NEG_Z),
            extents: Extents { width: 4.0, height: 2.6, depth: 4.5 },
            shape: harmony_scene::RoomShape::default(),
            origin: DVec3::ZERO,
            walls: Vec::new(),
            openings: Vec::new(),
            objects: Vec::new(),
            ids: vec![0; size.pixels()],
            depth: vec![0.0; size.pixels()],
        };
        let mut oracle = Oracle::new(room, NoiseLevel::Clean.noise(), 1, true);
        oracle.lights = lights;
        oracle
    }

    fn window(position: [f64; 3], intensity: f64) -> Light {
        Light {
            id: format!("window at {}", position[0]),
            kind: LightKind::Area { direction: [0.0, 0.0, 1.0], size_m: [1.0, 1.0] },
            position,
            color: [1.0; 3],
            intensity,
            on: true,
            object: None,
            shade: None,
        }
    }

    #[test]
    fn a_window_gets_its_true_power_and_one_that_is_none_is_switched_off() {
        let truth = TruthLight {
            kind: TruthLightKind::Area,
            position: DVec3::new(1.0, 1.5, 0.02),
            power: 40.0,
            color: DVec3::new(0.43, 0.465, 0.5),
            owner: Some("window_01".to_owned()),
        };
        // The fill behind the camera belongs to nobody and is no window.
        let fill = TruthLight { position: DVec3::new(3.0, 1.5, 0.02), power: 9.0, owner: None, ..truth.clone() };
        let oracle = Arc::new(oracle(vec![truth, fill]));
        let lighting = Lighting {
            lights: vec![window([1.2, 1.5, 0.05], 20.0), window([3.0, 1.5, 0.05], 20.0)],
            ambient_color: [1.0; 3],
            ambient_intensity: 0.1,
            exposure: 0.0,
            view: harmony_scene::ViewTransform::Agx,
        };
        let said = oracle.lights(&lighting);
        let spec: Vec<&Value> = said["windows"].as_array().unwrap().iter().collect();
        assert_eq!(spec[0]["daylight_on"], true);
        assert!((spec[0]["intensity"].as_f64().unwrap() - 2.0).abs() < 1e-9);
        assert!((spec[0]["color"][0].as_f64().unwrap() - 0.86).abs() < 1e-9);
        assert_eq!((&spec[1]["daylight_on"], &spec[1]["intensity"]), (&json!(false), &Value::Null));
    }
}
