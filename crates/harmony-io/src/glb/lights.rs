//! The camera and the lights as glTF nodes.
//!
//! # Units
//! Our lights carry radiant power in watts as Cycles understands it. KHR_lights_punctual asks for candela and lux, but the
//! viewers that show a GLB as it is (three.js and all that build on it) have no camera exposure that would make 5000 cd
//! a lamp: they take the numbers as they are. So they are written, exposure included: a white surface has in three.js the
//! value that it has in the path-traced render from the same light.
//!
//! | ours | glTF | value, times 2^exposure |
//! |---|---|---|
//! | point, Φ W | point | Φ / 4π: the same in all directions |
//! | area, Φ W | spot | Φ / π: a flat diffuse emitter's intensity along its normal; half-space cone |
//! | sun, E W/m2 | directional | E |
//!
//! Blender's importer has "Lighting Mode: Unitless" for such files, which gives back the watts; in its standard mode
//! lights are 683 times weaker, and the room is seen by the [`AMBIENT_GLOW`] of its surfaces.
//!
//! glTF has no area light and no ambient light: the rectangle stands in the node's extras, the ambient light in the
//! scene's, and the glow plays its part. Lights that are off are written with intensity 0 and their own value in
//! the extras.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec3};
use harmony_scene::{Camera, Light, LightKind, Lighting, SceneCamera};
use serde_json::{Value, json};

use super::document::Node;

/// Share of its base colour that every surface of a whole scene emits, in place of the light that bounces.
///
/// Without it a room is black where no lamp reaches (three.js), or altogether (a viewer that knows no lights); where a
/// viewer adds light of its own, as model-viewer does, a surface gets 1.4 times its colour at most.
pub const AMBIENT_GLOW: f64 = 0.4;
/// Nearest drawn distance of the written camera, metres.
const NEAR_M: f64 = 0.05;

/// Intensity as written, see the module's table; `exposure` in stops.
pub fn punctual_intensity(light: &Light, exposure: f64) -> f64 {
    let per_watt = match light.kind {
        LightKind::Point { .. } => 1.0 / (4.0 * PI),
        LightKind::Area { .. } => 1.0 / PI,
        LightKind::Sun { .. } => 1.0,
    };
    let intensity = light.intensity * per_watt * exposure.exp2();
    if light.on && intensity.is_finite() { intensity.max(0.0) } else { 0.0 }
}

/// The camera entry and its node. glTF's camera looks along its local -Z with +Y up; OpenCV's along +Z with +Y down.
pub(super) fn camera(camera: &Camera) -> (Value, Node) {
    let k = &camera.intrinsics;
    let (w, h) = (f64::from(camera.size.width), f64::from(camera.size.height));
    let entry = json!({
        "name": "camera",
        "type": "perspective",
        "perspective": {
            "yfov": 2.0 * (h / 2.0 / k.fy).atan(),
            "aspectRatio": (w / k.fx) / (h / k.fy),
            "znear": NEAR_M,
        },
    });
    let axes = DMat3::from_cols(camera.right(), -camera.down(), -camera.forward());
    let node = Node {
        name: "camera".to_owned(),
        camera: Some(0),
        translation: Some(camera.centre().to_array()),
        rotation: Some(quaternion(axes)),
        // The principal point has no place in glTF, so the whole camera stands here too.
        extras: json!({ "camera": SceneCamera::from(camera) }),
        ..Node::default()
    };
    (entry, node)
}

fn quaternion(rotation: DMat3) -> [f64; 4] {
    let q = DQuat::from_mat3(&rotation).normalize();
    // One of the two equal quaternions, so that the bytes do not depend on a sign.
    if q.w < 0.0 { (-q).to_array() } else { q.to_array() }
}

/// The light entries (for the document's extension) and their nodes.
pub(super) fn lights(lighting: &Lighting) -> (Vec<Value>, Vec<Node>) {
    let mut entries = Vec::new();
    let mut nodes = Vec::new();
    for light in &lighting.lights {
        let mut entry = json!({
            "name": light.id,
            "type": match light.kind {
                LightKind::Point { .. } => "point",
                LightKind::Area { .. } => "spot",
                LightKind::Sun { .. } => "directional",
            },
            "color": light.color.map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 1.0 }),
            "intensity": punctual_intensity(light, lighting.exposure),
        });
        let direction = match light.kind {
            LightKind::Point { .. } => None,
            LightKind::Area { direction, .. } => {
                entry["spot"] = json!({ "innerConeAngle": 0.0, "outerConeAngle": PI / 2.0 });
                Some(direction)
            }
            LightKind::Sun { direction } => Some(direction),
        };
        let position = DVec3::from_array(light.position);
        nodes.push(Node {
            name: light.id.clone(),
            translation: Some(if position.is_finite() { light.position } else { [0.0; 3] }),
            rotation: direction.map(|d| {
                let d = DVec3::from_array(d).try_normalize().unwrap_or(DVec3::NEG_Y);
                quaternion(DMat3::from_quat(DQuat::from_rotation_arc(DVec3::NEG_Z, d)))
            }),
            extensions: [("KHR_lights_punctual".to_owned(), json!({ "light": entries.len() }))].into_iter().collect(),
            extras: json!({ "light": light }),
            ..Node::default()
        });
        entries.push(entry);
    }
    (entries, nodes)
}

#[cfg(test)]
mod tests {
    use harmony_scene::{ImageSize, Intrinsics};

    use super::*;

    #[test]
    fn the_gltf_camera_sees_what_our_camera_sees() {
        let size = ImageSize::new(960, 720);
        let k = Intrinsics { fx: 633.0, fy: 640.0, cx: 480.0, cy: 360.0 };
        let ours = Camera::looking(size, k, DVec3::new(2.0, 1.5, 4.0), DVec3::new(-0.2, -0.15, -1.0));
        let (entry, node) = camera(&ours);
        let q = DQuat::from_array(node.rotation.unwrap());
        let centre = DVec3::from_array(node.translation.unwrap());
        let tan_y = (entry["perspective"]["yfov"].as_f64().unwrap() / 2.0).tan();
        let aspect = entry["perspective"]["aspectRatio"].as_f64().unwrap();
        for point in [DVec3::new(1.0, 0.5, 0.3), DVec3::new(3.0, 2.0, 1.0)] {
            // OpenGL: local -Z forward, normalised device coordinates by the half angles.
            let p = q.inverse() * (point - centre);
            let ndc = (p.x / -p.z / (tan_y * aspect), p.y / -p.z / tan_y);
            let pixel = ours.project(point).unwrap();
            assert!((f64::midpoint(ndc.0, 1.0) * 960.0 - pixel.x).abs() <= 1e-9);
            assert!(((1.0 - ndc.1) / 2.0 * 720.0 - pixel.y).abs() <= 1e-9);
        }
    }

    #[test]
    fn a_bulb_lights_a_wall_in_three_js_as_in_cycles() {
        let light = |kind, on| Light {
            id: "l".to_owned(),
            kind,
            position: [0.0; 3],
            color: [1.0; 3],
            intensity: 100.0,
            on,
            object: None,
            shade: None,
        };
        // Cycles: 100 W in all directions, irradiance 100 / (4 pi d^2); three.js: intensity / d^2. Equal at any d.
        let bulb = punctual_intensity(&light(LightKind::Point { radius_m: 0.03 }, true), 0.0);
        assert!((bulb - 7.957_747).abs() <= 1e-5, "{bulb}");
        let sun = punctual_intensity(&light(LightKind::Sun { direction: [0.0, -1.0, 0.0] }, true), 1.0);
        assert!((sun - 200.0).abs() <= 1e-9, "one stop doubles");
        assert_eq!(punctual_intensity(&light(LightKind::Point { radius_m: 0.03 }, false), 0.0), 0.0);
    }
}
