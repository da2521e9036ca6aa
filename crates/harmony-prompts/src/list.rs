//! `<level>/list`: which objects of a level are there (paper App. C, detection prompts of the four levels).

use harmony_scene::{Extents, Level, SceneCamera};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, fill, in_range, lines};
use crate::subjects::PlacedObject;

/// Asks which objects of a level are there.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ListQuestion {
    /// Level asked for.
    pub level: Level,
    /// Room type.
    #[serde(skip)]
    pub room_type: String,
    /// Whether the answer must hold a box and an outline of each instance (no other detector is cast).
    pub with_boxes: bool,
    /// Furniture placed already, for decorations.
    #[serde(skip)]
    pub placed: Vec<PlacedObject>,
    /// Recesses of the ceiling that are in the room's shape, in words; for the ceiling.
    #[serde(skip)]
    pub trays: Vec<String>,
    /// The photo's camera and the room box, where they are known.
    #[serde(flatten)]
    pub view: Option<RoomView>,
}

/// The photo's camera in the room box.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RoomView {
    /// Its size is the photo's.
    pub camera: SceneCamera,
    /// Metres.
    pub extents: Extents,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ListAnswer {
    /// Kinds of objects.
    pub items: Vec<ListedItem>,
}

/// One kind of object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ListedItem {
    /// Category, such as `dining chair`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Short grounding phrase for open-vocabulary detection, alternatives joined by ` . `.
    pub gdino: String,
    /// How many are visible.
    pub count: u32,
    /// Where each one is, when boxes are asked for.
    #[serde(default)]
    pub instances: Vec<ListedInstance>,
}

/// Most pieces that something is seen in, beside the largest.
const MAX_PIECES: usize = 8;

/// Where one object is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ListedInstance {
    /// `[left, top, right, bottom]`, 0..1000, tight around the visible part.
    #[serde(rename = "box")]
    pub bounds: [f64; 4],
    /// Outline of the visible part, `[x, y]` 0..1000, 4 to 40 points in order; empty = none.
    #[serde(default)]
    pub outline: Vec<[f64; 2]>,
    /// Where what hides it cuts the visible part into pieces: the outlines of the others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pieces: Vec<Vec<[f64; 2]>>,
    /// Decorations: id of the furniture it rests on; null otherwise.
    #[serde(default)]
    pub host: Option<String>,
}

impl Ask for ListQuestion {
    type Answer = ListAnswer;

    fn prompt(&self) -> String {
        let template = match self.level {
            Level::Wall => include_str!("../templates/list_wall.md"),
            Level::Furniture => include_str!("../templates/list_furniture.md"),
            Level::Ceiling => include_str!("../templates/list_ceiling.md"),
            Level::Decoration => include_str!("../templates/list_decoration.md"),
        };
        let boxes = if self.with_boxes {
            include_str!("../templates/list_boxes.md")
        } else {
            "Leave `instances` empty: a detector looks for the boxes.\n"
        };
        let told = if self.trays.is_empty() {
            String::new()
        } else {
            fill(include_str!("../templates/list_trays.md"), &[("trays", self.trays.join(", "))])
        };
        fill(
            template,
            &[
                ("boxes", boxes.to_owned()),
                ("room_type", self.room_type.clone()),
                ("placed", lines(&self.placed)),
                ("trays", told),
            ],
        )
    }

    fn example(&self) -> ListAnswer {
        ListAnswer::example(self)
    }

    fn check(&self, answer: &ListAnswer) -> Result<(), String> {
        answer.check()
    }
}

impl ListAnswer {
    /// A well-formed answer about some other picture.
    pub fn example(question: &ListQuestion) -> Self {
        let (kind, phrase, host) = match question.level {
            Level::Wall => ("window", "white framed window . window", None),
            Level::Furniture => ("sofa", "leather sofa . leather couch", None),
            Level::Ceiling => ("pendant lamp", "pendant lamp . hanging lamp", None),
            Level::Decoration => ("vase", "white ceramic vase", Some("coffee_table_01".to_owned())),
        };
        let instance = ListedInstance {
            bounds: [412.0, 180.0, 588.0, 455.0],
            outline: vec![[414.0, 183.0], [586.0, 181.0], [588.0, 452.0], [413.0, 455.0]],
            pieces: Vec::new(),
            host,
        };
        Self {
            items: vec![ListedItem {
                kind: kind.into(),
                gdino: phrase.into(),
                count: 1,
                instances: if question.with_boxes { vec![instance] } else { vec![] },
            }],
        }
    }

    /// Whether the numbers make sense.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self) -> Result<(), String> {
        let total: usize = self.items.iter().map(|i| i.instances.len().max(i.count as usize)).sum();
        if self.items.len() > 80 || total > 200 {
            return Err(format!(
                "{} kinds and {total} objects; at most 80 kinds and 200 objects are accepted",
                self.items.len()
            ));
        }
        for item in &self.items {
            if item.kind.trim().is_empty() || item.kind.len() > 80 {
                return Err(format!("type {:?} must have 1 to 80 characters", item.kind));
            }
            for instance in &item.instances {
                let [x0, y0, x1, y1] = instance.bounds;
                for (name, v) in [("left", x0), ("top", y0), ("right", x1), ("bottom", y1)] {
                    in_range(&format!("{} of a {}'s box", name, item.kind), v, -50.0, 1050.0)?;
                }
                if x1 - x0 < 1.0 || y1 - y0 < 1.0 {
                    return Err(format!(
                        "a {}'s box {:?} is empty: it is [left, top, right, bottom] in thousandths",
                        item.kind, instance.bounds
                    ));
                }
                if instance.pieces.len() > MAX_PIECES {
                    return Err(format!("a {} has {} pieces; at most {MAX_PIECES}", item.kind, instance.pieces.len()));
                }
                for outline in instance.pieces.iter().chain([&instance.outline]) {
                    if outline.len() > 200 || (1..3).contains(&outline.len()) {
                        return Err(format!("a {}'s outline has {} points; 3 to 200", item.kind, outline.len()));
                    }
                }
                for p in instance.pieces.iter().flatten().chain(&instance.outline) {
                    in_range("an outline's x", p[0], -50.0, 1050.0)?;
                    in_range("an outline's y", p[1], -50.0, 1050.0)?;
                }
            }
        }
        Ok(())
    }
}
