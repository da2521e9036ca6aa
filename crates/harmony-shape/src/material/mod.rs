//! Slot materials: a colour, a pattern at metric scale, and how light meets it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A named look that nodes share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialSpec {
    /// Slot name: `velvet`, `frame`, `bulb`, ...
    pub name: String,
    /// sRGB colour, `#rrggbb`; the mean colour of a pattern that has no colours of its own.
    pub color: String,
    /// Perceptual roughness, 0 to 1.
    #[serde(default = "default_rough")]
    pub rough: f64,
    /// 0 dielectric to 1 metal.
    #[serde(default)]
    pub metal: f64,
    /// Cloth sheen, 0 to 1.
    #[serde(default)]
    pub sheen: f64,
    /// Coverage, 0 to 1.
    #[serde(default = "unit")]
    pub alpha: f64,
    /// 0 opaque to 1 clear.
    #[serde(default)]
    pub transmission: f64,
    /// Index of refraction, 1 to 2.5.
    #[serde(default = "default_ior")]
    pub ior: f64,
    /// Emitted luminance, cd/m2 (0: none).
    #[serde(default)]
    pub emit: f64,
    /// Colour temperature of what is emitted, kelvin; the slot's colour when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kelvin: Option<f64>,
    /// How strongly the pattern's relief shows, 0 to 3.
    #[serde(default = "unit")]
    pub bump: f64,
    /// What is drawn on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<Pattern>,
    /// A piece of the photo instead of a pattern.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo: Option<PhotoMap>,
    /// Whether the object's own pixels in the photo are painted over it (patterned cloth that no pattern describes).
    #[serde(default)]
    pub paint: bool,
}

fn default_rough() -> f64 {
    0.6
}

fn default_ior() -> f64 {
    1.45
}

fn unit() -> f64 {
    1.0
}

/// A piece of the photo, rectified.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotoMap {
    /// Corners in the photo in thousandths of its width and height: top left, top right, bottom right, bottom left.
    pub quad: [[f64; 2]; 4],
    /// Width and height of the piece, metres: what the corners become on the surface.
    pub size: [f64; 2],
    /// Whether the photo's light is taken out.
    #[serde(default = "yes")]
    pub delit: bool,
}

fn yes() -> bool {
    true
}

/// A pattern at metric scale: a function of surface position that gives colour, height and roughness.
///
/// Lengths are metres, shares 0 to 1. `colors` are sRGB `#rrggbb`; left empty they come from the slot's colour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pattern {
    /// Which one.
    pub kind: PatternKind,
    /// Main width: plank, tile, brick, cell, pitch, yarn.
    #[serde(default)]
    pub width: f64,
    /// Main length: plank, tile, brick; 0: as the width.
    #[serde(default)]
    pub length: f64,
    /// Width of joints, grooves, stripes' second band.
    #[serde(default)]
    pub joint: f64,
    /// Turn in the surface, degrees.
    #[serde(default)]
    pub turn_deg: f64,
    /// How much pieces differ in tone, 0 to 1.
    #[serde(default)]
    pub tone: f64,
    /// Amount of what the pattern is about (grime, veins, grain), 0 to 1.
    #[serde(default)]
    pub amount: f64,
    /// Variant: `running`, `stack`, `herringbone`, `diagonal`, `box`, `diamond`, `channel`, ...
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub variant: String,
    /// Colours, the main one first; joints last where there are joints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub colors: Vec<String>,
    /// Another arrangement of the same kind.
    #[serde(default)]
    pub seed: u32,
    /// Patterns below, for `over` (first on top of second) and `tint`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<Pattern>,
    /// Outline of a motif, metres.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outline: Vec<[f64; 2]>,
}

/// The patterns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum PatternKind {
    Planks,
    Parquet,
    Tiles,
    Brick,
    Checks,
    Stripes,
    Dots,
    Motif,
    Weave,
    Knit,
    Terry,
    Boucle,
    Pile,
    Leather,
    Wood,
    Marble,
    Terrazzo,
    Concrete,
    Plaster,
    Rattan,
    Corrugated,
    Quilting,
    Grime,
    Ramp,
    Over,
    Tint,
}
