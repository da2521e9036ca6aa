//! `<level>/missing/<id>`: what rests on a piece of furniture in the photo and is not in the reconstruction (paper App. C,
//! "Missing-decoration detection").

use std::fmt::{Display, Formatter};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, fill, in_range, lines};
use crate::subjects::NamedObject;

/// Asks what is missing on one piece of furniture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MissingQuestion {
    /// Room type.
    #[serde(skip)]
    pub room_type: String,
    /// The piece.
    pub furniture: NamedObject,
    /// What was found on it already.
    pub present: Vec<PresentDecoration>,
}

/// A decoration that is found already.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PresentDecoration {
    /// Its label.
    pub label: String,
    /// `[left, top, right, bottom]` in the photo, 0..1000.
    pub bounds: [f64; 4],
}

impl Display for PresentDecoration {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let [left, top, right, bottom] = self.bounds;
        write!(f, "- {}, box [{left:.0}, {top:.0}, {right:.0}, {bottom:.0}]", self.label)
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MissingAnswer {
    /// What the piece is.
    #[serde(default)]
    pub label: String,
    /// What rests on it and is absent.
    pub missing_decorations: Vec<MissingDecoration>,
}

/// One missing thing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MissingDecoration {
    /// Category, such as `table lamp`.
    pub name: String,
    /// Quantity, colour, material and position.
    #[serde(default)]
    pub description: String,
    /// `[left, top, right, bottom]` in the photo, 0..1000, read off the border of IMAGE 1, tight around the visible part.
    #[serde(rename = "box")]
    pub bounds: [f64; 4],
}

/// Most things that can be missing on one piece.
const MAX_MISSING: usize = 20;

impl Ask for MissingQuestion {
    type Answer = MissingAnswer;

    fn prompt(&self) -> String {
        fill(
            include_str!("../templates/missing.md"),
            &[
                ("room_type", self.room_type.clone()),
                ("furniture", self.furniture.to_string()),
                ("present", lines(&self.present)),
            ],
        )
    }

    fn example(&self) -> MissingAnswer {
        MissingAnswer {
            label: "coffee table".into(),
            missing_decorations: vec![MissingDecoration {
                name: "vase".into(),
                description: "one white ceramic vase, left of the middle".into(),
                bounds: [412.0, 180.0, 488.0, 455.0],
            }],
        }
    }

    fn check(&self, answer: &MissingAnswer) -> Result<(), String> {
        if answer.missing_decorations.len() > MAX_MISSING {
            return Err(format!("{} things are missing; at most {MAX_MISSING}", answer.missing_decorations.len()));
        }
        answer.missing_decorations.iter().try_for_each(|m| check_box(&m.name, m.bounds))
    }

    fn without_looking(&self) -> Option<MissingAnswer> {
        Some(MissingAnswer::default())
    }
}

/// Complains about a box that is none.
pub(crate) fn check_box(name: &str, [left, top, right, bottom]: [f64; 4]) -> Result<(), String> {
    for v in [left, top, right, bottom] {
        in_range(&format!("a side of the box of {name:?}"), v, -20.0, 1020.0)?;
    }
    if right > left && bottom > top { Ok(()) } else { Err(format!("the box of {name:?} is empty")) }
}
