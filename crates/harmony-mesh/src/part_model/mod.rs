//! Part models: meshes that are described instead of scanned (beyond the paper, which has a mesh generator only).
//!
//! A [`PartModel`] is a small bounded JSON document: colour slots and parts, each part a shape that fills a box given
//! in fractions of the object (0 to 1 from left, bottom and back; z = 1 is the front). It holds no metres, so one model
//! builds at any size. A vision-language model writes it from a crop, [`crate::template`] writes it from a category.

mod atlas;
mod build;
mod check;
mod guide;
mod shapes;
mod solid;

use harmony_scene::{MaterialCategory, Size};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use atlas::{ChartPlace, pack_charts};
pub use build::BuiltModel;
pub use check::PartModelError;
pub use guide::PART_MODEL_GUIDE;

/// Most parts a model may have once repeats and mirrors are expanded.
pub const MAX_PARTS: usize = 200;
/// Deepest nesting of groups.
pub const MAX_DEPTH: usize = 4;
/// Most slots.
pub const MAX_SLOTS: usize = 16;
/// Most points of a polygon, profile or polyline.
pub const MAX_POINTS: usize = 64;

/// An object as coloured slots and simple parts.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartModel {
    /// What the parts are coloured with.
    #[serde(default)]
    pub slots: Vec<Slot>,
    /// The parts, in any order; they may overlap.
    pub parts: Vec<Part>,
}

/// One look that parts share: `body`, `legs`, `cushions`, `shade`, ...
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Slot {
    /// Name that parts refer to.
    pub name: String,
    /// sRGB colour, `#rrggbb`.
    #[serde(alias = "colour")]
    pub color: String,
    /// What it is made of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<MaterialCategory>,
    /// Whether the photo's pixels are put on it.
    #[serde(default)]
    pub texture: TextureMode,
}

/// Where a slot's look comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TextureMode {
    /// The object's own pixels in the photo.
    #[default]
    Photo,
    /// Always the slot's colour (glass, mirrors, screens).
    Plain,
}

/// The shapes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Box, edges rounded by `round`.
    #[default]
    #[serde(alias = "rounded_box", alias = "cube", alias = "cuboid")]
    Box,
    /// Cylinder or frustum along `axis`: `top`, `sides`, `hollow`, `oval`.
    #[serde(alias = "frustum", alias = "cone", alias = "prism", alias = "disc", alias = "disk", alias = "ring")]
    Cylinder,
    /// Ball or ellipsoid that fills its box.
    #[serde(alias = "ellipsoid", alias = "ball")]
    Sphere,
    /// Thin board with rounded outline: `corner`, `round`.
    #[serde(alias = "board", alias = "plate", alias = "panel")]
    Slab,
    /// Upholstery: `puff` 0 is a firm seat cushion, 1 a throw pillow.
    #[serde(alias = "pillow")]
    Cushion,
    /// A board bent about `axis`, hollow side to the front: `bend_deg`, `thickness`.
    #[serde(alias = "curved_back", alias = "bent_slab", alias = "arc")]
    Back,
    /// A polygon (`points`) pulled along `axis`.
    #[serde(alias = "extrusion", alias = "polygon")]
    Extrude,
    /// A profile (`points`: radius, height) turned about `axis`: `hollow`, `smooth`.
    #[serde(alias = "revolve", alias = "turned")]
    Lathe,
    /// A round bar along `path`: `thickness`, `smooth`, `closed`.
    #[serde(alias = "pipe", alias = "wire")]
    Tube,
    /// Leaves: `habit`, `count`, `leaf_size`, `seed`.
    #[serde(alias = "foliage", alias = "plant")]
    Leaves,
    /// A hanging sheet with folds: `folds`.
    #[serde(alias = "curtain", alias = "drape")]
    Cloth,
    /// Nested `parts` in fractions of this box.
    Group,
}

/// An axis of the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Side to side.
    #[serde(alias = "X", alias = "width")]
    X,
    /// Upwards.
    #[serde(alias = "Y", alias = "height", alias = "up", alias = "vertical")]
    Y,
    /// Back to front.
    #[serde(alias = "Z", alias = "depth")]
    Z,
}

/// Planes through the middle of the parent box in which a part is reflected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Mirror {
    /// Left and right.
    X,
    /// Bottom and top.
    Y,
    /// Back and front.
    Z,
    /// All four corners, such as legs.
    Xz,
}

/// How leaves are arranged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LeafHabit {
    /// Round leaves all over a rounded volume.
    #[default]
    Bushy,
    /// Long arching fronds from the bottom centre.
    Palm,
    /// Upright sword leaves from the bottom centre.
    Upright,
    /// Leaves hanging over the edge.
    Trailing,
    /// Flowers on stems.
    Flowers,
}

/// Copies of a part in a row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Repeat {
    /// Along which axis.
    pub axis: Axis,
    /// How many in all, 1 to 100.
    pub count: u32,
    /// Distance between copies in fractions of the parent; left out, the row ends as far from the far side as it
    /// starts from the near side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
}

/// One or many copies of a part: a JSON object or a list of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Repeats {
    /// A row.
    Row(Repeat),
    /// A grid.
    Grid(Vec<Repeat>),
}

/// A shape in a box. Fields that do not belong to the shape are ignored.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Which shape.
    #[serde(alias = "type")]
    pub shape: Shape,
    /// Slot name; a group's children inherit it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slot: Option<String>,
    /// Left, bottom, back corner in fractions of the parent.
    #[serde(default = "zero", alias = "min")]
    pub from: [f64; 3],
    /// Right, top, front corner in fractions of the parent.
    #[serde(default = "one", alias = "max")]
    pub to: [f64; 3],
    /// Turn about x, then y, then z through the middle of the box, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_deg: Option<[f64; 3]>,
    /// Reflected copies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mirror: Option<Mirror>,
    /// Rows of copies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeat: Option<Repeats>,
    /// Makes the box's cross section square (legs, posts) with its smaller side, across this axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub square: Option<Axis>,
    /// Edge radius as a fraction of the part's smallest side, 0 to 0.5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub round: Option<f64>,
    /// Outline radius of a slab as a fraction of its second smallest side, 0 to 0.5 (0.5: a disc or stadium).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corner: Option<f64>,
    /// Axis of cylinder, lathe, extrusion and bent board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// Radius at the far end relative to the near end of a cylinder (0: a cone; > 1: widens); height of a bent
    /// board's ends relative to its middle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top: Option<f64>,
    /// Number of flat sides of a cylinder (3 to 64); left out it is round.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sides: Option<u32>,
    /// Wall thickness as a fraction of the radius, 0 to 0.9: an open shade (cylinder) or vessel (lathe).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hollow: Option<f64>,
    /// Lets a cylinder or lathe fill its box as an oval; else its cross section is a circle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub oval: Option<bool>,
    /// 0 firm to 1 pillow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub puff: Option<f64>,
    /// Angle of a bent board, degrees, 5 to 330.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bend_deg: Option<f64>,
    /// Bar or board thickness as a fraction of the object's smallest side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness: Option<f64>,
    /// Polygon or profile, fractions of the box. Extrusion along z: (x, y); along x: (z, y); along y: (x, z).
    /// Lathe: (radius, height), both 0 to 1, from bottom to top.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<Vec<[f64; 2]>>,
    /// Centre line of a tube, fractions of the box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<Vec<[f64; 3]>>,
    /// Rounds off a profile or path.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smooth: Option<bool>,
    /// Joins a path's end to its start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closed: Option<bool>,
    /// Arrangement of leaves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub habit: Option<LeafHabit>,
    /// Number of leaves, 1 to 300.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// Leaf length as a fraction of the part's smallest side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leaf_size: Option<f64>,
    /// Another arrangement of the same kind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u32>,
    /// Number of folds of cloth, 1 to 40.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folds: Option<u32>,
    /// Children of a group.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parts: Option<Vec<Part>>,
}

fn zero() -> [f64; 3] {
    [0.0; 3]
}

fn one() -> [f64; 3] {
    [1.0; 3]
}

impl PartModel {
    /// Reads a model that somebody else wrote, and checks it.
    ///
    /// # Errors
    /// [`PartModelError`] with the path of the first thing that is wrong and what would be allowed.
    pub fn from_json(text: &str) -> Result<Self, PartModelError> {
        check::from_json(text)
    }

    /// As [`PartModel::from_json`], from a parsed value.
    ///
    /// # Errors
    /// As there.
    pub fn from_value(value: &serde_json::Value) -> Result<Self, PartModelError> {
        check::from_value(value)
    }

    /// Checks limits, slot names, colours and numbers.
    ///
    /// # Errors
    /// [`PartModelError`] with the path of the first thing that is wrong and what would be allowed.
    pub fn check(&self) -> Result<(), PartModelError> {
        check::check(self)
    }

    /// Builds the canonical mesh in metres for a size: +Y up, front +Z, bottom at y = 0, centred in x and z; its
    /// bounds are the size.
    ///
    /// # Errors
    /// [`PartModelError`] when the model or the size cannot be used.
    pub fn build(&self, size: Size) -> Result<BuiltModel, PartModelError> {
        build::build(self, size)
    }

    /// A simple chair, for prompts and tests.
    pub fn example() -> Self {
        guide::example()
    }

    /// The slot of a name.
    pub fn slot(&self, name: &str) -> Option<&Slot> {
        self.slots.iter().find(|s| s.name == name)
    }

    /// Gives a slot another sRGB colour; nothing happens when there is no such slot.
    pub fn set_color(&mut self, name: &str, rgb: [u8; 3]) {
        if let Some(slot) = self.slots.iter_mut().find(|s| s.name == name) {
            slot.color = hex_color(rgb);
        }
    }
}

/// `#rrggbb` of an sRGB colour.
pub fn hex_color(rgb: [u8; 3]) -> String {
    format!("#{:02x}{:02x}{:02x}", rgb[0], rgb[1], rgb[2])
}

/// sRGB colour of `#rrggbb`, `rrggbb`, `#rgb` or a common colour word.
pub fn parse_color(text: &str) -> Option<[u8; 3]> {
    check::parse_color(text)
}

/// Linear light of an sRGB colour.
pub fn linear_rgb(rgb: [u8; 3]) -> [f32; 3] {
    rgb.map(|c| {
        let c = f32::from(c) / 255.0;
        if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    })
}

/// The closed solids of a model, for tests of other modules.
#[cfg(test)]
pub(crate) fn solids_for_tests(model: &PartModel, size: glam::DVec3) -> Vec<(String, solid::Solid)> {
    build::solids(model, size).unwrap_or_default()
}
