//! One rule a question.

mod inspect;
mod layout;
mod lights;
mod list;
mod meshes;

pub(super) use inspect::inspect;
pub(super) use layout::layout;
pub(super) use lights::{lighting_review, lights};
pub(super) use list::list;
pub(super) use meshes::{completed, fronts, review};

use serde_json::Value;

/// A number of the facts within a range, if it is there and finite.
fn number(facts: &Value, key: &str, low: f64, high: f64) -> Option<f64> {
    facts[key].as_f64().filter(|v| v.is_finite()).map(|v| v.clamp(low, high))
}

/// The ids of a list of facts: texts, or objects with an `id`.
fn ids(list: &Value) -> Vec<String> {
    let one = |entry: &Value| entry.as_str().or_else(|| entry["id"].as_str()).map(str::to_owned);
    list.as_array().into_iter().flatten().filter_map(one).collect()
}
