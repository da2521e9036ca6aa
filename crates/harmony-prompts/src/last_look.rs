//! `6_lighting/last_look_<n>`: a last look at the lit scene from all sides, with typed actions.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Formatter};

use harmony_scene::{Level, Light};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};

use crate::missing::check_box;
use crate::question::{Ask, fill, in_range, lines, tried};
use crate::subjects::{PlacedObject, RoomSummary};

/// Asks for a last look.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LastLookQuestion {
    /// Room and camera.
    #[serde(skip)]
    pub room: RoomSummary,
    /// Objects in the scene.
    pub objects: Vec<PaintedObject>,
    /// Light sources.
    pub lights: Vec<ListedLight>,
    /// Radiance of the light that comes from everywhere.
    #[serde(skip)]
    pub ambient: f64,
    /// What geometry and light measured, one line each.
    #[serde(skip)]
    pub findings: Vec<String>,
    /// What was asked for in the round before and what came of it, one line each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<String>,
    /// What the modelling language offers.
    #[serde(skip)]
    pub guide: String,
}

/// An object in the scene and its material slots.
#[derive(Debug, Clone, PartialEq)]
pub struct PaintedObject {
    /// The object.
    pub object: PlacedObject,
    /// Names of its slots.
    pub slots: Vec<String>,
}

impl Serialize for PaintedObject {
    /// Its id; the rest is in the text.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.object.id.serialize(serializer)
    }
}

/// Slots of an object that are told: the shelf of books that a program makes has a slot a book.
const SLOTS_TOLD: usize = 16;

impl Display for PaintedObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; slots: {}", self.object, told(&self.slots))
    }
}

/// The first slots, and how many more there are.
fn told(slots: &[String]) -> String {
    let (first, more) = slots.split_at(slots.len().min(SLOTS_TOLD));
    let first = first.join(", ");
    if more.is_empty() { first } else { format!("{first} and {} more", more.len()) }
}

/// A light source.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedLight(pub Light);

impl Serialize for ListedLight {
    /// Its id; the rest is in the text.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.id.serialize(serializer)
    }
}

impl Display for ListedLight {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let Light { id, position: [x, y, z], intensity, on, .. } = &self.0;
        let state = if *on { "on" } else { "off" };
        write!(f, "- {id}: at ({x:.2}, {y:.2}, {z:.2}), {intensity:.1} W, {state}")
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LastLookAnswer {
    /// What differs.
    #[serde(default)]
    pub differences: Vec<Difference>,
    /// What to change, the most visible first.
    #[serde(default)]
    pub actions: Vec<LastAction>,
    /// True when nothing matters any more.
    #[serde(default)]
    pub converged: bool,
}

/// How something differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum DifferenceKind {
    Wrong,
    Ugly,
    Missing,
    Invented,
}

/// One difference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Difference {
    /// How.
    pub kind: DifferenceKind,
    /// What and where, in words.
    pub what: String,
}

/// What an action does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LastActionKind {
    Move,
    Rotate,
    Rescale,
    Remove,
    Reshape,
    Recolor,
    Surface,
    Light,
    Exposure,
    /// Something that the photo shows and the scene lacks.
    Add,
}

/// A text; none where null stands.
fn text_or_null<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    Ok(Option::<String>::deserialize(deserializer)?.unwrap_or_default())
}

/// One action; fields that do not belong to its kind are left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LastAction {
    /// Which.
    pub action: LastActionKind,
    /// Id of the object, room surface or light source.
    #[serde(default, deserialize_with = "text_or_null")]
    #[schemars(with = "Option<String>")]
    pub id: String,
    /// How far from where it is now, metres along room x, y, z.
    #[serde(default)]
    pub delta_m: Option<[f64; 3]>,
    /// Degrees from its present yaw, about its own vertical axis, counter-clockwise seen from above.
    #[serde(default)]
    pub angle_deg: Option<f64>,
    /// Factor on the present size, brightness or exposure.
    #[serde(default)]
    pub factor: Option<f64>,
    /// Slot of the object; none: its main one.
    #[serde(default)]
    pub slot: Option<String>,
    /// sRGB `#rrggbb`.
    #[serde(default)]
    pub color_hex: Option<String>,
    /// Colour temperature.
    #[serde(default)]
    pub kelvin: Option<f64>,
    /// A whole program.
    #[serde(default)]
    pub program: Option<String>,
    /// Values for further parameters of its `build`.
    #[serde(default)]
    pub params: BTreeMap<String, f64>,
    /// What is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub add: Option<AddedObject>,
    /// Why.
    #[serde(default)]
    pub why: String,
}

/// Something to add.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AddedObject {
    /// What it is: `floor lamp`.
    pub label: String,
    /// Where it belongs: what stands on the floor is furniture, what rests on other things decoration.
    pub level: Level,
    /// `[left, top, right, bottom]` in the photo, 0..1000, tight around the visible part.
    #[serde(rename = "box")]
    pub bounds: [f64; 4],
    /// The object in the scene that looks just like it; null when none does.
    #[serde(default)]
    pub like: Option<String>,
    /// Decorations: id of what it rests on.
    #[serde(default)]
    pub host: Option<String>,
}

/// The name by which the light that comes from everywhere is listed among the lights.
pub const AMBIENT: &str = "ambient";

/// Most actions of one answer.
pub const MAX_LAST_ACTIONS: usize = 20;

impl Ask for LastLookQuestion {
    type Answer = LastLookAnswer;

    fn prompt(&self) -> String {
        fill(
            include_str!("../templates/last_look.md"),
            &[
                ("room", self.room.to_string()),
                ("objects", lines(&self.objects)),
                ("lights", format!("{}\n- {AMBIENT}: from everywhere, {:.2}", lines(&self.lights), self.ambient)),
                ("findings", lines(&self.findings)),
                ("tried", tried(&self.tried)),
                ("guide", self.guide.clone()),
            ],
        )
    }

    fn example(&self) -> LastLookAnswer {
        LastLookAnswer::example()
    }

    fn check(&self, answer: &LastLookAnswer) -> Result<(), String> {
        let objects: Vec<String> = self.objects.iter().map(|o| o.object.id.to_string()).collect();
        let lights: Vec<String> = self.lights.iter().map(|l| l.0.id.clone()).collect();
        answer.check(&objects, &lights)
    }

    fn without_looking(&self) -> Option<LastLookAnswer> {
        Some(LastLookAnswer { converged: true, ..LastLookAnswer::default() })
    }
}

impl LastAction {
    /// An action about something, without numbers.
    pub fn about(action: LastActionKind, id: &str) -> Self {
        Self {
            action,
            id: id.to_owned(),
            delta_m: None,
            angle_deg: None,
            factor: None,
            slot: None,
            color_hex: None,
            kelvin: None,
            program: None,
            params: BTreeMap::new(),
            add: None,
            why: String::new(),
        }
    }

    /// Whether it brings what its kind needs.
    fn check(&self) -> Result<(), String> {
        let needs = |there: bool, what: &str| {
            if there { Ok(()) } else { Err(format!("{:?} of {:?} needs {what}", self.action, self.id)) }
        };
        match self.action {
            LastActionKind::Move => needs(self.delta_m.is_some(), "delta_m"),
            LastActionKind::Rotate => needs(self.angle_deg.is_some(), "angle_deg"),
            LastActionKind::Rescale | LastActionKind::Exposure => {
                in_range("factor", self.factor.unwrap_or(f64::NAN), 0.1, 10.0)
            }
            LastActionKind::Remove => Ok(()),
            LastActionKind::Add => match &self.add {
                None => needs(false, "add: label, level and box"),
                Some(add) if add.label.trim().is_empty() => needs(false, "a label"),
                Some(add) => check_box(&add.label, add.bounds),
            },
            LastActionKind::Reshape => needs(self.program.is_some(), "a program"),
            LastActionKind::Recolor | LastActionKind::Surface => {
                let hex = self.color_hex.as_deref().and_then(harmony_mesh::parse_color);
                needs(hex.is_some(), "color_hex such as #a0b0c0")
            }
            LastActionKind::Light => {
                needs(self.factor.is_some() || self.kelvin.is_some(), "a factor or kelvin")?;
                in_range("factor", self.factor.unwrap_or(1.0), 0.0, 20.0)?;
                in_range("kelvin", self.kelvin.unwrap_or(3000.0), 1500.0, 15_000.0)
            }
        }
    }
}

impl LastLookAnswer {
    /// A well-formed answer about some other picture.
    pub fn example() -> Self {
        Self {
            differences: vec![Difference {
                kind: DifferenceKind::Wrong,
                what: "the lampshade is grey, in the photo it glows warm white".into(),
            }],
            actions: vec![
                LastAction {
                    factor: Some(1.6),
                    kelvin: Some(2800.0),
                    why: "the lamp is on in the photo".into(),
                    ..LastAction::about(LastActionKind::Light, "lamp_01")
                },
                LastAction {
                    slot: Some("shade".into()),
                    color_hex: Some("#f3e6cf".into()),
                    ..LastAction::about(LastActionKind::Recolor, "lamp_01")
                },
            ],
            converged: false,
        }
    }

    /// Whether actions bring what they need, and not more than half of them are about things that are not there: such ones
    /// are refused one by one.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, objects: &[String], lights: &[String]) -> Result<(), String> {
        if self.actions.len() > MAX_LAST_ACTIONS {
            return Err(format!("{} actions; at most {MAX_LAST_ACTIONS} are tried", self.actions.len()));
        }
        let objects: BTreeSet<&str> = objects.iter().map(String::as_str).collect();
        let lights: BTreeSet<&str> = lights.iter().map(String::as_str).collect();
        let mut unknown = Vec::new();
        for action in &self.actions {
            action.check()?;
            let known = match action.action {
                LastActionKind::Exposure | LastActionKind::Surface | LastActionKind::Add => true,
                LastActionKind::Light => action.id == AMBIENT || lights.contains(action.id.as_str()),
                _ => objects.contains(action.id.as_str()),
            };
            if !known {
                unknown.push(format!("{:?}: there is no {:?}", action.action, action.id));
            }
        }
        if 2 * unknown.len() > self.actions.len() { Err(unknown.join("; ")) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_bring_what_they_need_and_are_about_known_things() {
        let answer = LastLookAnswer::example();
        let ids = ["lamp_01".to_owned()];
        assert_eq!(answer.check(&ids, &ids), Ok(()));
        assert_eq!(answer.check(&ids, &[]), Ok(()), "one of two is refused where it is tried");
        assert!(answer.check(&[], &[]).unwrap_err().contains("lamp_01"));
        let one = |action: LastAction| LastLookAnswer { actions: vec![action], ..LastLookAnswer::default() };
        let bare = |kind| one(LastAction::about(kind, "lamp_01")).check(&ids, &ids);
        for kind in [
            LastActionKind::Move,
            LastActionKind::Reshape,
            LastActionKind::Recolor,
            LastActionKind::Light,
            LastActionKind::Add,
        ] {
            assert!(bare(kind).is_err(), "{kind:?}");
        }
        assert_eq!(bare(LastActionKind::Remove), Ok(()));
        let bounds = [100.0, 200.0, 150.0, 400.0];
        let added = AddedObject { label: "vase".into(), level: Level::Decoration, bounds, like: None, host: None };
        let add = |add| one(LastAction { add: Some(add), ..LastAction::about(LastActionKind::Add, "") });
        assert_eq!(add(added.clone()).check(&ids, &ids), Ok(()));
        assert!(add(AddedObject { bounds: [5.0; 4], ..added }).check(&ids, &ids).is_err());
        let dimmed = LastAction { factor: Some(0.7), ..LastAction::about(LastActionKind::Light, AMBIENT) };
        assert_eq!(one(dimmed).check(&ids, &[]), Ok(()));
        let mut many = answer.clone();
        many.actions = vec![many.actions[0].clone(); MAX_LAST_ACTIONS + 1];
        assert!(many.check(&ids, &ids).is_err());
    }

    #[test]
    fn a_shelf_with_a_slot_a_book_is_told_in_a_line() {
        let slots: Vec<String> = (0..60).map(|k| format!("book {k}")).collect();
        assert!(told(&slots).ends_with("book 15 and 44 more"), "{}", told(&slots));
        assert_eq!(told(&slots[..2]), "book 0, book 1");
    }
}
