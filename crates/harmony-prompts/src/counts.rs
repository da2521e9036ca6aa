//! `5_decoration/counts`: kinds counted in photo and scene after the last level; what is missing is added, what is too much
//! is questioned. Beyond the paper's wording, which counts a set when it is inspected.

use harmony_scene::Level;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::missing::check_box;
use crate::question::{Ask, fill, lines, mostly_sound};
use crate::subjects::{PlacedObject, RoomSummary};

/// Asks for counts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CountsQuestion {
    /// Room and camera.
    #[serde(skip)]
    pub room: RoomSummary,
    /// Objects in the scene.
    pub placed: Vec<PlacedObject>,
    /// What was looked for and is not in the scene, one line each.
    #[serde(skip)]
    pub unplaced: Vec<String>,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CountsAnswer {
    /// Kinds of which the photo shows another number than the scene has.
    pub kinds: Vec<CountedKind>,
}

/// One kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CountedKind {
    /// Category.
    #[serde(rename = "type")]
    pub kind: String,
    /// Level that it belongs to.
    pub level: Level,
    /// How many the photo shows.
    pub photo: u32,
    /// How many the scene has.
    pub scene: u32,
    /// Where those are that the scene lacks.
    #[serde(default)]
    pub missing: Vec<MissingInstance>,
    /// Ids of those that the photo does not show.
    #[serde(default)]
    pub surplus: Vec<String>,
}

/// One that the scene lacks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MissingInstance {
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

impl CountsQuestion {
    /// What is wrong with an id: the scene has no such object.
    pub fn complaint(&self, id: &str) -> Option<String> {
        self.placed.iter().all(|p| p.id.as_str() != id).then(|| format!("there is no object {id:?}"))
    }

    /// What is wrong with one that is missing: the scene lacks what it is like or what it rests on.
    pub fn missing_complaint(&self, missing: &MissingInstance) -> Option<String> {
        missing.like.iter().chain(&missing.host).find_map(|id| self.complaint(id))
    }
}

impl Ask for CountsQuestion {
    type Answer = CountsAnswer;

    fn prompt(&self) -> String {
        fill(
            include_str!("../templates/counts.md"),
            &[("room", self.room.to_string()), ("objects", lines(&self.placed)), ("unplaced", lines(&self.unplaced))],
        )
    }

    fn example(&self) -> CountsAnswer {
        let bounds = [712.0, 480.0, 788.0, 655.0];
        let like = Some("dining_chair_02".to_owned());
        CountsAnswer {
            kinds: vec![CountedKind {
                kind: "dining chair".into(),
                level: Level::Furniture,
                photo: 4,
                scene: 3,
                missing: vec![MissingInstance { bounds, like, host: None }],
                surplus: vec![],
            }],
        }
    }

    fn check(&self, answer: &CountsAnswer) -> Result<(), String> {
        if answer.kinds.len() > 40 {
            return Err(format!("{} kinds; at most 40", answer.kinds.len()));
        }
        for kind in &answer.kinds {
            for missing in &kind.missing {
                check_box(&kind.kind, missing.bounds)?;
            }
            if kind.missing.len() > 20 {
                return Err(format!("{} of {} are missing; at most 20", kind.missing.len(), kind.kind));
            }
        }
        let missing = answer.kinds.iter().flat_map(|kind| &kind.missing);
        let surplus = answer.kinds.iter().flat_map(|kind| &kind.surplus);
        let entries = missing.clone().count() + surplus.clone().count();
        let complaints: Vec<String> = missing
            .filter_map(|missing| self.missing_complaint(missing))
            .chain(surplus.filter_map(|id| self.complaint(id)))
            .collect();
        mostly_sound(&complaints, entries)
    }

    fn without_looking(&self) -> Option<CountsAnswer> {
        Some(CountsAnswer::default())
    }
}
