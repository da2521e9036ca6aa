//! What a model is told about the format.

use super::PartModel;

/// One page for prompts: what a part model is, and two short examples.
pub const PART_MODEL_GUIDE: &str = include_str!("guide.md");

pub(super) fn example() -> PartModel {
    serde_json::from_str(include_str!("example_chair.json")).unwrap_or_default()
}
