//! What the page shows beside the scene itself.

use std::collections::BTreeMap;

use harmony_scene::ObjectId;
use serde::{Deserialize, Serialize};

/// What the pipeline tells about a run. Every text may come from a model: it is escaped when the page is made.
///
/// All paths are relative to the run folder; a picture that does not exist is left out of the page. Warnings come from
/// [`harmony_scene::Scene::warnings`] and are sorted to their phases and objects by the page.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ReportData {
    /// Page title, such as the photo's file name.
    pub title: String,
    /// When the run ended, as text; left out when empty.
    pub finished: String,
    /// Profile name.
    pub profile: String,
    /// Facts about the run (version, seed, settings that were changed), in order.
    pub facts: Vec<Fact>,
    /// Phases in order.
    pub phases: Vec<PhaseReport>,
    /// Model calls in order of their names.
    pub calls: Vec<CallRow>,
    /// More pictures than those found by their names (see [`crate::write_report`]).
    pub pictures: Vec<ReportPicture>,
    /// What is to be said about single objects.
    pub objects: BTreeMap<ObjectId, ObjectReport>,
    /// Objects that were looked for and are not in the scene.
    pub dropped: Vec<DroppedObject>,
    /// The room and how it was found.
    pub room: Evidence,
    /// The camera and how it was found.
    pub camera: Evidence,
}

/// A name and a value in words.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Fact {
    /// What.
    pub name: String,
    /// The value with its unit.
    pub value: String,
    /// A remark in small print; may be empty.
    pub note: String,
}

impl Fact {
    /// A fact without a remark.
    pub fn new(name: impl Into<String>, value: impl Into<String>) -> Self {
        Self { name: name.into(), value: value.into(), note: String::new() }
    }
}

/// How a phase ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhaseStatus {
    /// Done in this run.
    Done,
    /// Done by an earlier run and still valid.
    Kept,
    /// Not started.
    #[default]
    Pending,
    /// Left out on request.
    Skipped,
    /// Stopped by an error.
    Failed,
}

/// A phase.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct PhaseReport {
    /// Folder name, such as `3_furniture`; warnings are matched by it.
    pub name: String,
    /// How it ended.
    pub status: PhaseStatus,
    /// What the players' answers took, one after the other, seconds; computing is not in it.
    pub seconds: f64,
    /// Time of the phase in which the program alone was at work, seconds; `None` where it is not known.
    pub own_seconds: Option<f64>,
    /// Time of the phase in which a player had been asked and had not answered, seconds; the program may have computed
    /// meanwhile.
    pub waited_seconds: Option<f64>,
    /// One line about the outcome, such as `7 placed, 1 dropped`.
    pub outcome: String,
}

/// One model call.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CallRow {
    /// Stable call name.
    pub name: String,
    /// Role.
    pub role: String,
    /// Who played it (and the model).
    pub player: String,
    /// Time, seconds; 0 when it came from the record.
    pub seconds: f64,
    /// Tokens sent.
    pub tokens_in: u64,
    /// Tokens received.
    pub tokens_out: u64,
    /// US dollars, when the player says or a price is known.
    pub cost_usd: Option<f64>,
    /// How often it was tried.
    pub tries: u32,
    /// Whether the answer came from the record of an earlier run.
    pub from_record: bool,
    /// Empty when it went well, else what happened (`replaced by offline: ...`).
    pub problem: String,
}

/// A picture.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ReportPicture {
    /// Caption.
    pub title: String,
    /// File, relative to the run folder.
    pub path: String,
    /// Whether it is taken by the photo's camera, so that it can be laid over the photo.
    pub comparable: bool,
}

/// What is to be said about an object beside its entry in the scene.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ObjectReport {
    /// Crop from the photo, file relative to the run folder.
    pub crop: Option<String>,
    /// Completed (amodal) picture.
    pub completed: Option<String>,
    /// Picture of the mesh.
    pub mesh_view: Option<String>,
    /// Why the confidence is what it is, in words.
    pub confidence_because: String,
    /// Further facts.
    pub facts: Vec<Fact>,
}

/// Something that is not in the scene.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct DroppedObject {
    /// Label or phrase.
    pub label: String,
    /// Phase folder name.
    pub phase: String,
    /// Why.
    pub reason: String,
}

/// A result with its evidence.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Evidence {
    /// The method that gave it, in words; fallbacks named.
    pub method: String,
    /// 0 to 1, when known.
    pub confidence: Option<f64>,
    /// Why the confidence is what it is.
    pub because: String,
    /// Residuals and other numbers.
    pub facts: Vec<Fact>,
}

/// A line of the table of a scene's plausibility, as a simulation found it.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct PlausibilityRow {
    /// What is counted.
    pub what: String,
    /// The count or share in words.
    pub value: String,
    /// Whether it is as it should be.
    pub good: bool,
}
