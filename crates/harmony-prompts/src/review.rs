//! `<level>/review_<n>`: the reflective feedback loop (paper Sec. 3.3), with typed actions only.

use std::collections::BTreeSet;

use harmony_scene::{Level, ObjectId};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};

use crate::question::{Ask, fill, in_range, lines, tried};
use crate::subjects::{PlacedObject, RoomSummary};

/// Asks what to change after a level is placed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReviewQuestion {
    /// Level just placed.
    pub level: Level,
    /// Room and camera.
    #[serde(skip)]
    pub room: RoomSummary,
    /// Objects in the scene.
    #[serde(flatten, serialize_with = "ids_and_rows")]
    pub placed: Vec<PlacedObject>,
    /// Candidates that could not be placed, one line each.
    #[serde(skip)]
    pub unplaced: Vec<String>,
    /// What the geometry itself complains about (collisions, floating, poor overlap), one line each.
    pub findings: Vec<String>,
    /// What was asked for in the round before and what came of it, one line each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<String>,
}

/// The ids beside the rows, as in the content keys of all records there are.
fn ids_and_rows<S: Serializer>(placed: &[PlacedObject], serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Facts<'a> {
        objects: Vec<&'a ObjectId>,
        placed: &'a [PlacedObject],
    }
    Facts { objects: placed.iter().map(|p| &p.id).collect(), placed }.serialize(serializer)
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReviewAnswer {
    /// What differs between photo and render, in words.
    #[serde(default)]
    pub issues: Vec<String>,
    /// What to change.
    pub actions: Vec<ReviewActionAnswer>,
    /// True when nothing needs to change.
    pub converged: bool,
}

/// What an action does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReviewActionKind {
    /// By `delta_m` from where it is.
    Move,
    /// By `angle_deg` from its present yaw.
    Rotate,
    /// Multiply the size by `factor`.
    Rescale,
    /// Exchange the places of `id` and `other`.
    Swap,
    /// Put it onto `other`.
    Rehost,
    /// Place another copy of `id`'s mesh at `position_m`, its yaw `angle_deg`.
    Add,
    /// Take it out of the scene.
    Remove,
    /// Give all of a matched set (`id` names one member) one size.
    EqualizeGroup,
}

/// One action; fields an action does not need are null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReviewActionAnswer {
    /// What.
    pub action: ReviewActionKind,
    /// Which object.
    pub id: String,
    /// The other object.
    #[serde(default)]
    pub other: Option<String>,
    /// Of a move: how far from where it is now, metres along room x (right), y (up), z (towards the viewer).
    #[serde(default)]
    pub delta_m: Option<[f64; 3]>,
    /// Of an added copy: its bottom centre in the room, metres; no move has it.
    #[serde(default)]
    pub position_m: Option<[f64; 3]>,
    /// Of a rotation: degrees from its present yaw, about its own vertical axis, counter-clockwise seen from above. Of an
    /// added copy: its yaw.
    #[serde(default)]
    pub angle_deg: Option<f64>,
    /// Factors on its present width, height, depth.
    #[serde(default)]
    pub factor: Option<[f64; 3]>,
    /// Why.
    #[serde(default)]
    pub reason: String,
}

impl Ask for ReviewQuestion {
    type Answer = ReviewAnswer;

    fn prompt(&self) -> String {
        fill(
            include_str!("../templates/review.md"),
            &[
                ("stage", self.level.stage().to_owned()),
                ("room", self.room.to_string()),
                ("objects", lines(&self.placed)),
                ("unplaced", lines(&self.unplaced)),
                ("findings", lines(&self.findings)),
                ("tried", tried(&self.tried)),
            ],
        )
    }

    fn example(&self) -> ReviewAnswer {
        ReviewAnswer {
            issues: vec!["chair_02 looks away from the table".into()],
            actions: vec![ReviewActionAnswer {
                action: ReviewActionKind::Rotate,
                id: "chair_02".into(),
                other: None,
                delta_m: None,
                position_m: None,
                angle_deg: Some(90.0),
                factor: None,
                reason: "its back is turned to the table".into(),
            }],
            converged: false,
        }
    }

    fn check(&self, answer: &ReviewAnswer) -> Result<(), String> {
        answer.check(&self.placed.iter().map(|p| p.id.to_string()).collect::<Vec<_>>())
    }

    /// What geometry can tell by itself, placement has settled already.
    fn without_looking(&self) -> Option<ReviewAnswer> {
        Some(ReviewAnswer { converged: true, ..ReviewAnswer::default() })
    }
}

impl ReviewAnswer {
    /// Whether the actions speak of known objects and carry what they need.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, ids: &[String]) -> Result<(), String> {
        let known: BTreeSet<&str> = ids.iter().map(String::as_str).collect();
        if self.actions.len() > 60 {
            return Err(format!("{} actions; at most 60", self.actions.len()));
        }
        // One wrong name does not cost the other actions: what names nobody is not tried, and the record says so.
        let nobody =
            |a: &&ReviewActionAnswer| std::iter::once(&a.id).chain(&a.other).any(|id| !known.contains(id.as_str()));
        let lost = self.actions.iter().filter(nobody).count();
        if 2 * lost > self.actions.len() {
            return Err(format!("{lost} actions name what is no object of the scene; the ids are {}", ids.join(", ")));
        }
        for a in &self.actions {
            let need = |present: bool, field: &str| {
                if present { Ok(()) } else { Err(format!("{:?} of {} needs {field}", a.action, a.id)) }
            };
            match a.action {
                ReviewActionKind::Move => need(a.delta_m.is_some(), "delta_m")?,
                ReviewActionKind::Rotate => need(a.angle_deg.is_some(), "angle_deg")?,
                ReviewActionKind::Rescale => need(a.factor.is_some(), "factor")?,
                ReviewActionKind::Swap | ReviewActionKind::Rehost => need(a.other.is_some(), "other")?,
                ReviewActionKind::Add => need(a.position_m.is_some(), "position_m")?,
                ReviewActionKind::Remove | ReviewActionKind::EqualizeGroup => {}
            }
            for v in a.delta_m.iter().chain(&a.position_m).flatten() {
                in_range("a position or delta", *v, -20.0, 40.0)?;
            }
            for v in a.factor.iter().flatten() {
                in_range("a factor", *v, 0.2, 5.0)?;
            }
            if let Some(v) = a.angle_deg {
                in_range("angle_deg", v, -360.0, 360.0)?;
            }
        }
        Ok(())
    }
}
