//! Light sources and the lighting of a scene (paper Sec. 3.4, App. C "Lighting estimation").

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ObjectId, SceneCamera};

/// How scene-linear light becomes a picture's values: Blender's view transforms with their looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ViewTransform {
    /// Plain sRGB, clipped at 1: colours stay what the textures say.
    Standard,
    /// Blender's Filmic.
    Filmic,
    /// Filmic with its look "High Contrast".
    FilmicHighContrast,
    /// Blender's AgX: soft highlights, pale colours.
    #[default]
    Agx,
    /// AgX with its look "Medium High Contrast".
    AgxHighContrast,
    /// AgX with its look "Punchy".
    AgxPunchy,
}

impl ViewTransform {
    /// All of them, the plainest first.
    pub const ALL: [Self; 6] =
        [Self::Standard, Self::Filmic, Self::FilmicHighContrast, Self::Agx, Self::AgxHighContrast, Self::AgxPunchy];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Standard => "standard",
            Self::Filmic => "filmic",
            Self::FilmicHighContrast => "filmic_high_contrast",
            Self::Agx => "agx",
            Self::AgxHighContrast => "agx_high_contrast",
            Self::AgxPunchy => "agx_punchy",
        }
    }
}

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
    /// What the photo shows of the cloth or glass round a lamp's bulb: mean colour, display-linear; `None` where it shows
    /// none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shade: Option<[f64; 3]>,
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
    /// Light to picture.
    #[serde(default)]
    pub view: ViewTransform,
}

/// Factors that make reflectances of a scene's base colours, which hold the photo's own light.
///
/// One coarse image a node, in the frame of the photo's camera: lit there, the node looks as in the photo. A surface
/// point takes the factor of the place where that camera would see it; away from the frame the node's mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AlbedoField {
    /// The photo's camera; its size is only the frame, not the grid.
    pub camera: SceneCamera,
    /// Cells across the frame.
    pub columns: u32,
    /// Cells down the frame.
    pub rows: u32,
    /// By node of the scene's GLB, `node/material` for one material of a node.
    pub nodes: BTreeMap<String, AlbedoCells>,
    /// Linear RGB factor of nodes that are not named.
    pub other: [f32; 3],
}

fn whole() -> f32 {
    1.0
}

/// One node's part of an [`AlbedoField`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AlbedoCells {
    /// Linear RGB factor where the photo's frame says nothing.
    pub mean: [f32; 3],
    /// Linear RGB factors, row-major from the frame's top left; empty = the mean everywhere.
    pub factors: Vec<[f32; 3]>,
    /// Factor on specular reflection and sheen, 0 to 1: no base colour is dark enough where these alone are more than
    /// the photo shows.
    #[serde(default = "whole")]
    pub gloss: f32,
}
