//! Options of templates.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

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
    /// These options with what a label says (`round table`, `two-seater`, `snake plant`) where nothing is given.
    #[must_use]
    pub fn with_label(&self, label: &str) -> Self {
        super::names::with_hints(label, self)
    }

    /// Reads options; what is not understood is left out and told in the notes.
    pub fn from_value(value: &Value) -> (Self, Vec<String>) {
        let mut out = Self::default();
        let mut notes = Vec::new();
        let Some(map) = value.as_object() else {
            if !value.is_null() {
                notes.push("template options are not an object and were ignored".to_owned());
            }
            return (out, notes);
        };
        for (key, value) in map {
            if value.is_null() {
                continue;
            }
            let key = key.as_str();
            let understood = match key {
                "seats" => set(&mut out.seats, count(value)),
                "doors" => set(&mut out.doors, count(value)),
                "drawers" => set(&mut out.drawers, count(value)),
                "shelves" => set(&mut out.shelves, count(value)),
                "cushions" => set(&mut out.cushions, count(value)),
                "legs" => set(&mut out.legs, word(value).and_then(|w| LegStyle::from_word(&w))),
                "arms" => set(&mut out.arms, word(value).and_then(|w| ArmStyle::from_word(&w))),
                "back" => set(&mut out.back, word(value).and_then(|w| BackStyle::from_word(&w))),
                "shade" => set(&mut out.shade, word(value).and_then(|w| ShadeShape::from_word(&w))),
                "habit" => set(&mut out.habit, word(value).and_then(|w| PlantHabit::from_word(&w))),
                "round" => set(&mut out.round, truth(value)),
                "filled" => set(&mut out.filled, truth(value)),
                "extra" => set(&mut out.extra, truth(value)),
                "panes" => set(&mut out.panes, pair(value)),
                "colors" | "colours" => {
                    out.colors = colors(value);
                    !out.colors.is_empty()
                }
                _ => false,
            };
            if !understood {
                let key: String = key.chars().take(40).collect();
                let value: String = value.to_string().chars().take(60).collect();
                notes.push(format!("template option {key} = {value} was not understood and ignored"));
            }
        }
        (out, notes)
    }
}

/// Stores what was understood.
fn set<T>(field: &mut Option<T>, value: Option<T>) -> bool {
    *field = value;
    field.is_some()
}

fn count(value: &Value) -> Option<u32> {
    match value {
        Value::Number(n) => n.as_f64().filter(|v| v.is_finite()).map(|v| v.round().clamp(0.0, 100.0) as u32),
        Value::String(text) => text.trim().parse::<u32>().ok().map(|n| n.min(100)),
        Value::Bool(yes) => Some(u32::from(*yes)),
        Value::Array(list) => Some(list.len().min(100) as u32),
        _ => None,
    }
}

fn word(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Bool(yes) => Some(if *yes { "yes" } else { "no" }.to_owned()),
        Value::Number(n) if n.as_f64() == Some(0.0) => Some("none".to_owned()),
        Value::Number(n) if n.as_f64() == Some(4.0) => Some("four".to_owned()),
        _ => None,
    }
}

fn truth(value: &Value) -> Option<bool> {
    match value {
        Value::Bool(yes) => Some(*yes),
        Value::Number(n) => n.as_f64().map(|v| v != 0.0),
        Value::String(text) => match text.trim().to_lowercase().as_str() {
            "true" | "yes" | "y" | "1" => Some(true),
            "false" | "no" | "n" | "0" | "none" => Some(false),
            _ => None,
        },
        _ => None,
    }
}

fn pair(value: &Value) -> Option<[u32; 2]> {
    match value {
        Value::Array(list) => match list.as_slice() {
            [a, b] => Some([count(a)?.max(1), count(b)?.max(1)]),
            _ => None,
        },
        Value::String(text) => {
            let (a, b) = text.split_once(['x', 'X', ',', '*'])?;
            Some([a.trim().parse::<u32>().ok()?.clamp(1, 100), b.trim().parse::<u32>().ok()?.clamp(1, 100)])
        }
        _ => count(value).map(|n| [n.max(1), 1]),
    }
}

/// A list of `{slot, hex}`, or a map from slot to colour.
fn colors(value: &Value) -> Vec<SlotColor> {
    let good = |slot: &str, hex: &str| {
        crate::parse_color(hex).map(|rgb| SlotColor { slot: slot.to_owned(), hex: crate::hex_color(rgb) })
    };
    match value {
        Value::Array(list) => list
            .iter()
            .take(16)
            .filter_map(|c| {
                let hex = ["hex", "color", "colour"].iter().find_map(|k| c.get(k)).and_then(Value::as_str)?;
                good(c.get("slot").or(c.get("name")).and_then(Value::as_str)?, hex)
            })
            .collect(),
        Value::Object(map) => map.iter().take(16).filter_map(|(k, v)| good(k, v.as_str()?)).collect(),
        _ => Vec::new(),
    }
}

impl<'de> Deserialize<'de> for TemplateParams {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Value::deserialize(deserializer)?;
        Ok(Self::from_value(&value).0)
    }
}
