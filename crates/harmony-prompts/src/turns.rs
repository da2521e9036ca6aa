//! `<level>/turn_<n>`: small corrections of a yaw that is about right (paper App. C, "Orientation correction": up to three
//! further single-step passes).

use std::collections::BTreeSet;
use std::fmt::{Display, Formatter};

use harmony_scene::ObjectId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, bare_lines, fill};

/// Asks which of three turns matches the photo best.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TurnsQuestion {
    /// The objects.
    pub objects: Vec<TurnedObject>,
    /// Step between the panels, degrees.
    pub step_deg: f64,
}

/// An object at its present turn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TurnedObject {
    /// Id.
    pub id: ObjectId,
    /// Its kind.
    #[serde(skip)]
    pub about: String,
    /// Counter-clockwise from above, 0 = front to the viewer, degrees.
    pub yaw_deg: f64,
}

impl Display for TurnedObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "- {}: {}", self.id, self.about)
    }
}

/// Panels of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum TurnPanel {
    /// As it is.
    A,
    /// A step counter-clockwise, seen from above.
    B,
    /// A step clockwise.
    C,
}

impl TurnPanel {
    /// All, in the order of a row.
    pub const ALL: [Self; 3] = [Self::A, Self::B, Self::C];

    /// How many steps counter-clockwise.
    pub fn steps(self) -> f64 {
        match self {
            Self::A => 0.0,
            Self::B => 1.0,
            Self::C => -1.0,
        }
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurnsAnswer {
    /// One entry an object that another panel than A matches; the others may be left out.
    pub objects: Vec<TurnsObject>,
}

/// The panel of one object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurnsObject {
    /// Id.
    pub id: String,
    /// The panel that matches the photo best.
    pub panel: TurnPanel,
}

impl Ask for TurnsQuestion {
    type Answer = TurnsAnswer;

    fn prompt(&self) -> String {
        let places = [("objects", bare_lines(&self.objects)), ("step", format!("{:.0}", self.step_deg))];
        fill(include_str!("../templates/turns.md"), &places)
    }

    fn example(&self) -> TurnsAnswer {
        TurnsAnswer { objects: vec![TurnsObject { id: "chair_01".into(), panel: TurnPanel::B }] }
    }

    fn check(&self, answer: &TurnsAnswer) -> Result<(), String> {
        let asked: BTreeSet<&str> = self.objects.iter().map(|o| o.id.as_str()).collect();
        match answer.objects.iter().find(|o| !asked.contains(o.id.as_str())) {
            Some(other) => Err(format!("{:?} was not asked for", other.id)),
            None => Ok(()),
        }
    }

    fn without_looking(&self) -> Option<TurnsAnswer> {
        Some(TurnsAnswer::default())
    }
}
