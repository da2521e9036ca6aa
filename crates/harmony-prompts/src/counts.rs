//! `5_decoration/counts`: kinds counted in photo and scene after the last level; what is missing is added, what is too much
//! is questioned. Beyond the paper's wording, which counts a set when it is inspected.

use std::collections::BTreeSet;

use harmony_scene::Level;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::missing::check_box;
use crate::question::{Ask, fill, lines};
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
        let ids: BTreeSet<&str> = self.placed.iter().map(|p| p.id.as_str()).collect();
        if answer.kinds.len() > 40 {
            return Err(format!("{} kinds; at most 40", answer.kinds.len()));
        }
        for kind in &answer.kinds {
            let named = kind.missing.iter().flat_map(|m| m.like.iter().chain(&m.host)).chain(&kind.surplus);
            for id in named {
                if !ids.contains(id.as_str()) {
                    return Err(format!("there is no object {id:?}"));
                }
            }
            for missing in &kind.missing {
                check_box(&kind.kind, missing.bounds)?;
            }
            if kind.missing.len() > 20 {
                return Err(format!("{} of {} are missing; at most 20", kind.missing.len(), kind.kind));
            }
        }
        Ok(())
    }

    fn without_looking(&self) -> Option<CountsAnswer> {
        Some(CountsAnswer::default())
    }
}
