//! `completed`, `fronts`, `orient` and `review`: where nobody looks, nothing is objected to.

use harmony_prompts::{CompletedAnswer, CompletedObject, FrontPanel, FrontsAnswer, FrontsObject, ReviewAnswer};
use serde_json::Value;

use super::ids;

/// Facts: `objects`. Every completed object passes: a rule can't tell.
pub fn completed(facts: &Value) -> CompletedAnswer {
    let passes = |id| CompletedObject { id, matches: true, hint: String::new() };
    CompletedAnswer { objects: ids(&facts["objects"]).into_iter().map(passes).collect() }
}

/// Facts: `objects`. Every mesh is taken to face as it was made.
pub fn fronts(facts: &Value) -> FrontsAnswer {
    let as_made = |id| FrontsObject { id, front_panel: FrontPanel::A };
    FrontsAnswer { objects: ids(&facts["objects"]).into_iter().map(as_made).collect() }
}

/// Nothing is asked for: what geometry can tell by itself, placement has settled already.
pub fn review() -> ReviewAnswer {
    ReviewAnswer { issues: vec![], actions: vec![], converged: true }
}
