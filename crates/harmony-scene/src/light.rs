//! Light sources and the lighting of a scene (paper Sec. 3.4, App. C "Lighting estimation").

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ObjectId;

/// What a light is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum LightKind {
    /// A small bulb; `watts` is radiant power as Cycles understands it.
    Point {
        /// Bulb radius, metres.
        radius_m: f64,
    },
    /// Daylight through a window or any rectangle of light; shines along `direction`.
    Area {
        /// Unit direction of the light in the room.
        direction: [f64; 3],
        /// Width and height of the rectangle, metres.
        size_m: [f64; 2],
    },
    /// The sun; `intensity` is W/m2.
    Sun {
        /// Unit direction of the light in the room.
        direction: [f64; 3],
    },
}

/// One light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Light {
    /// Stable name, such as `table_lamp_01` or `window_01`.
    pub id: String,
    /// What it is.
    #[serde(flatten)]
    pub kind: LightKind,
    /// Position in the room, metres.
    pub position: [f64; 3],
    /// Linear RGB, the brightest channel 1.
    pub color: [f64; 3],
    /// Radiant power in watts (point, area), or irradiance in W/m2 (sun).
    pub intensity: f64,
    /// Whether it shines.
    pub on: bool,
    /// The object it belongs to.
    pub object: Option<ObjectId>,
}

/// All light of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Lighting {
    /// Sources.
    pub lights: Vec<Light>,
    /// Linear RGB of the ambient light, the brightest channel 1.
    pub ambient_color: [f64; 3],
    /// Radiance of the ambient light (Blender's world strength).
    pub ambient_intensity: f64,
    /// Exposure of the render, stops.
    pub exposure: f64,
}
