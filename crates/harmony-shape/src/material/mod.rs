//! Slot materials: a colour, a pattern at metric scale, and how light meets it.
//!
//! A [`Pattern`] is a function of surface position: place (u, v) in metres and a seed give height in millimetres, linear
//! colour, roughness and the piece's id. [`bake_tile`] draws it into a tile of whole repeats on a torus (layouts in
//! `pieces`, noise with the tile's period in `noise`), [`material`] makes a mesh's material of a slot, and
//! [`fit_evidence`] fits a described pattern to pixels. Evenness is what looks fake: pieces differ in tone, hue, tilt, size
//! and wear, by hashes of their ids.
//!
//! Frame of a pattern: u to the right and v down the baked image, as metric texture coordinates are; relief is towards
//! the viewer.

mod bake;
mod boards;
mod cloth;
mod color;
mod fit;
mod kept;
mod look;
mod masonry;
mod mineral;
mod noise;
mod pieces;
mod plan;
mod prints;
mod space;
#[cfg(test)]
mod tests;

pub use bake::bake_tile;
pub use color::{hex, kelvin_to_rgb, parse_hex};
pub use fit::{PatternFit, fit_evidence};
pub use look::{WHITE_CD_M2, material, mean_color, recolored};

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
    /// Whether light that falls off across the piece is taken out: for what is evenly coloured as a whole, such as cloth.
    #[serde(default)]
    pub delit: bool,
}

/// A pattern at metric scale: a function of surface position that gives colour, height and roughness.
///
/// Lengths are metres, shares 0 to 1. `colors` are sRGB `#rrggbb`; left empty they come from the slot's colour. A number
/// left 0 takes what is usual for the kind (planks 14 cm wide, bricks 22.5 by 7.5 cm with their joint, ...).
///
/// | kind | along u | variants | `colors` |
/// |---|---|---|---|
/// | planks | the planks | `half`, `third`, `stack`, `even`; else random stagger | of planks in turn; last the groove's if `joint` is given |
/// | parquet | points along v | `herringbone`, `chevron`, `basket` | as planks |
/// | tiles | `width` | `stack`, `running`, `third`, `diagonal`, `checkerboard`, `hex` | of tiles; last the joint's (checkerboard: from three on) |
/// | brick | courses | `running`, `stack`, `third`, `english`, `flemish`; with `painted` | of bricks; last the joint's |
/// | checks | | `gingham` | two |
/// | stripes | one stripe beside the other | | any number |
/// | dots, motif | | `grid`, `random`; `heart`, `star`, `leaf`, `moon` without outline | ground, figures |
/// | weave | weft | `twill`, `basket`, `satin`, `herringbone` | warp, weft |
/// | knit, pile, rattan | courses | `rib`; `loop`, `shag`; `cane` | of rows, tufts |
/// | wood, corrugated (waves), quilting | grain | `box`; `diamond`, `box`, `channel` | ground, late wood |
/// | marble, terrazzo, concrete, plaster | | `board`; `rough`, `stucco`, `smooth` | ground, veins or chips |
/// | over, tint | | | `over`: none; `tint`: the wanted mean |
///
/// Widths and lengths of tiles and bricks are those of the repeat, joint included.
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
    /// Turn in the surface, degrees, u towards v.
    #[serde(default)]
    pub turn_deg: f64,
    /// Shift along its own u and v (before the turn), metres.
    #[serde(default, skip_serializing_if = "is_unset")]
    pub offset: [f64; 2],
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
    /// Patterns below, for `over` (first on top of second, a third being the mask: the first where it is white, the second
    /// where it is black) and `tint`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<Pattern>,
    /// Outline of a motif, metres.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outline: Vec<[f64; 2]>,
}

fn is_unset(offset: &[f64; 2]) -> bool {
    *offset == [0.0; 2]
}

impl Pattern {
    /// What lies below in a pattern of patterns.
    fn below(&self) -> Option<&Self> {
        self.layers.get(1).or(self.layers.first())
    }

    /// A pattern with everything as is usual for its kind.
    pub fn new(kind: PatternKind) -> Self {
        Self {
            kind,
            width: 0.0,
            length: 0.0,
            joint: 0.0,
            turn_deg: 0.0,
            offset: [0.0; 2],
            tone: 0.0,
            amount: 0.0,
            variant: String::new(),
            colors: Vec::new(),
            seed: 0,
            layers: Vec::new(),
            outline: Vec::new(),
        }
    }
}

impl MaterialSpec {
    /// A rough dielectric of one sRGB colour.
    pub fn plain(name: &str, color: &str) -> Self {
        Self {
            name: name.to_owned(),
            color: color.to_owned(),
            rough: default_rough(),
            metal: 0.0,
            sheen: 0.0,
            alpha: 1.0,
            transmission: 0.0,
            ior: default_ior(),
            emit: 0.0,
            kelvin: None,
            bump: 1.0,
            map: None,
            photo: None,
            paint: false,
        }
    }
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
