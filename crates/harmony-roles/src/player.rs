//! Who plays a role, and what an answer cost.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The roles: what a model can be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "one variant a trait")]
pub enum Role {
    VisionLanguage,
    ImageEditor,
    MeshGenerator,
    GeometryEstimator,
    Detector,
    Segmenter,
    LitRenderer,
}

impl Role {
    /// All roles.
    pub const ALL: [Self; 7] = [
        Self::VisionLanguage,
        Self::ImageEditor,
        Self::MeshGenerator,
        Self::GeometryEstimator,
        Self::Detector,
        Self::Segmenter,
        Self::LitRenderer,
    ];

    /// Folder name under `calls/` and key in the configuration.
    pub fn folder(self) -> &'static str {
        match self {
            Self::VisionLanguage => "vision_language",
            Self::ImageEditor => "image_editor",
            Self::MeshGenerator => "mesh_generator",
            Self::GeometryEstimator => "geometry_estimator",
            Self::Detector => "detector",
            Self::Segmenter => "segmenter",
            Self::LitRenderer => "lit_renderer",
        }
    }
}

/// Who is playing; part of every call's content key and record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlayerCard {
    /// Player, such as `files`, `replay`, `offline`, `openai`.
    pub player: String,
    /// Model or method and its version, such as `gpt-5.5-2026-04-23` or `part-models 1`.
    pub model: String,
    /// True for players that are this program alone: free, deterministic, always there.
    pub offline: bool,
    /// How many calls may run at once; 0 = no limit.
    pub concurrency: usize,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// What one call used.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Usage {
    /// Input tokens, where the player counts them.
    pub input_tokens: u64,
    /// Of the input tokens, those that the player had in its cache.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub cached_tokens: u64,
    /// Output tokens, where the player counts them.
    pub output_tokens: u64,
    /// Cost in US dollars by the price table; `None` = not known.
    pub cost_usd: Option<f64>,
    /// The player takes nothing more for so long, as it said with its answer. Of now, so not recorded.
    #[serde(skip)]
    pub closed_for: Option<Duration>,
}
