//! Partial failure is normal; it is told, typed, and shown in the report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ObjectId;

/// What kind of thing went another way than intended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum WarningKind {
    /// A player failed or gave an unusable answer; another one stood in.
    PlayerReplaced,
    /// An answer was changed to make sense (clamped, reordered, dropped).
    AnswerRepaired,
    /// A geometric method did not hold and a fallback was used.
    Fallback,
    /// The evidence for this result is thin.
    LowConfidence,
    /// An object is missing from the scene.
    ObjectDropped,
    /// Something that was asked for could not be made here.
    NotAvailable,
    /// A review action was proposed and refused by measurement.
    ActionRefused,
    /// The input itself is unusual (tiny, rotated, no floor).
    Input,
}

/// One warning, with the phase and object it speaks about.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub struct Warning {
    /// Phase folder name, such as `3_furniture`, or `input`.
    pub phase: String,
    /// The object, if it is about one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<ObjectId>,
    /// What kind.
    pub kind: WarningKind,
    /// One sentence for a person.
    pub message: String,
}
