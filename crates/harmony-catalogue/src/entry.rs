//! What the catalogue's file holds. Metres, kilograms; sigmas are relative (of the natural logarithm).

use std::collections::BTreeSet;

use harmony_scene::{Level, MaterialCategory, OpeningKind, Size};
use serde::Deserialize;

/// The file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    /// Words that end labels of parts of the room itself.
    pub(crate) room_parts: Vec<String>,
    #[serde(rename = "standard_height")]
    pub(crate) standard_heights: Vec<StandardHeight>,
    #[serde(rename = "material")]
    pub(crate) materials: Vec<Material>,
    #[serde(rename = "kind")]
    pub(crate) kinds: Vec<Kind>,
}

/// A kind of thing.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kind {
    /// Name, in snake case.
    pub name: String,
    /// The geometry template of `harmony-mesh` that draws it; without one it becomes a plain body.
    pub template: Option<String>,
    /// Words and phrases that mean it, in the singular, besides the name.
    #[serde(default)]
    pub synonyms: Vec<String>,
    /// Words that mean it at the end of a label only: "light" is an adjective elsewhere.
    #[serde(default)]
    pub last_words: Vec<String>,
    /// Where it is usually found.
    pub level: Level,
    /// Side to side, seen from its front, metres.
    pub width: Side,
    /// Bottom to top, metres.
    pub height: Side,
    /// Front to back, metres.
    pub depth: Side,
    /// Name of the [`StandardHeight`] that things of this kind may have.
    pub standard_height: Option<String>,
    /// Dominant material.
    pub material: MaterialCategory,
    /// Mass of one of the usual size, kilograms.
    pub mass_kg: f64,
    /// Thickness of its walls, panels or cloth, metres, where it is not the material's.
    pub wall_thickness_m: Option<f64>,
    /// Share of the mass in the lowest fifth of the height, 0 to 1, where it stands by a heavy foot.
    pub heavy_foot: Option<f64>,
    /// What holds of it.
    #[serde(default)]
    pub traits: BTreeSet<Trait>,
    /// What its back has that its front has not.
    pub back: Option<Back>,
    /// The opening of the wall that it fills.
    pub opening: Option<OpeningKind>,
    /// What light it gives.
    pub emits: Option<Emission>,
    /// The template's slot that shines.
    pub light_slot: Option<String>,
    /// Height of the bulb as a share of its own height, where it is not its level's.
    pub bulb_at: Option<f64>,
    /// How its parts move.
    #[serde(default)]
    pub joints: Vec<Joint>,
}

impl Kind {
    /// Whether it has a trait.
    pub fn has(&self, wanted: Trait) -> bool {
        self.traits.contains(&wanted)
    }

    /// The prior of width, height and depth.
    pub fn sides(&self) -> [Side; 3] {
        [self.width, self.height, self.depth]
    }

    /// Usual size, metres.
    pub fn usual_size(&self) -> Size {
        Size { width: self.width.usual, height: self.height.usual, depth: self.depth.usual }
    }

    /// Smallest and largest plausible size, metres.
    pub fn size_range(&self) -> (Size, Size) {
        let of = |side: fn(&Side) -> f64| Size {
            width: side(&self.width),
            height: side(&self.height),
            depth: side(&self.depth),
        };
        (of(|s| s.low), of(|s| s.high))
    }

    /// Mass over the bounding box of one of the usual size, kg/m3.
    pub fn box_density(&self) -> f64 {
        self.mass_kg / (self.width.usual * self.height.usual * self.depth.usual)
    }
}

/// A log-normal prior of a side, metres.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Side {
    /// Smallest plausible.
    pub low: f64,
    /// The one to take where nobody looked.
    pub usual: f64,
    /// Largest plausible.
    pub high: f64,
    /// One sigma of the logarithm, where it is wider than the range says.
    sigma: Option<f64>,
}

impl Side {
    /// One sigma of the logarithm; the range holds nearly all of a kind, two sigma each way.
    pub fn sigma(&self) -> f64 {
        self.sigma.unwrap_or_else(|| (self.high / self.low).ln() / 4.0)
    }
}

/// What holds of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trait {
    /// One side is the front.
    Front,
    /// It is a thin slab that can carry a rectified picture.
    Planar,
    /// Others may stand on it.
    Carries,
    /// It may stand under others, as chairs do under tables.
    FitsUnder,
    /// It lies on the floor under everything.
    Flat,
    /// It gives way where others touch it.
    Soft,
    /// It may be thrown over what carries it, and hang down beside it.
    Drapes,
    /// It leans where it stands against a back.
    Leans,
    /// It hangs, in front of what is behind it or from above.
    Hangs,
    /// Daylight comes in through it.
    Transmits,
    /// Its texture is a picture of what is seen in it or through it.
    Pictured,
    /// It is screwed, plumbed or built in where it stands.
    Fixed,
    /// A lamp hangs over its middle where it has one: tables.
    LitFromAbove,
    /// A seat for one with a back: what somebody draws out, or sits down on.
    Chair,
}

/// What a back has that a front has not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Back {
    /// It is higher: seats, beds.
    High,
    /// It is closed, where the front may be open: storage.
    Closed,
}

/// What light a thing gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// A bulb.
    Lamp,
    /// A small flame.
    Candle,
    /// A picture that shines by itself.
    Screen,
    /// A fire that may burn.
    Fire,
}

/// How a part moves against the thing's body.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// The part.
    pub part: String,
    /// Turning or sliding.
    pub motion: Motion,
    /// Axis of the canonical frame to turn about or slide along.
    pub axis: Axis,
}

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// It turns about its axis.
    Hinge,
    /// It slides along its axis.
    Slide,
}

/// Axes of the canonical frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Side to side.
    X,
    /// Up.
    Y,
    /// To the front.
    Z,
}

/// A height that things have because people sit at them, stand at them and walk through them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StandardHeight {
    /// Name by which kinds refer to it.
    pub name: String,
    /// Metres.
    pub height: f64,
    /// One sigma, relative.
    pub sigma: f64,
    /// A label that ends in one of these has it, whatever height was named within reason ...
    pub certain: Vec<String>,
    /// ... in one of these only with a height near the standard.
    #[serde(default)]
    pub likely: Vec<String>,
    /// A label with one of these words has not.
    pub unless: Vec<String>,
}

/// A material.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Its category.
    pub name: MaterialCategory,
    /// Words of labels that name it.
    pub words: Vec<String>,
    /// Density of the solid material, kg/m3.
    pub density_kg_m3: f64,
    /// Mass of a thing of it over its bounding box, kg/m3, where the kind is unknown.
    pub box_density_kg_m3: f64,
    /// Coefficient of static friction against dry wood.
    pub friction: f64,
    /// Usual thickness of walls, sheets, panes and paddings of it, metres.
    pub wall_thickness_m: f64,
    /// 0 rigid to 1 springy.
    pub elasticity: f64,
}
