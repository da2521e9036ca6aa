//! Labels beside masks.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::LoadedMask;
use crate::atomic::read_json;

/// Longest label, characters.
const MAX_LABEL: usize = 80;

/// Label by name, by file name, by id or by `#rrggbb`; `None` = not an object.
#[derive(Debug, Default)]
pub(super) struct Labels(BTreeMap<String, Option<String>>);

impl Labels {
    /// From `<stem>.json` or `labels.json` beside an image.
    pub(super) fn beside_image(image: &Path, notes: &mut Vec<String>) -> Self {
        let own = image.with_extension("json");
        if own.is_file() { Self::read(&own, notes) } else { Self::read(&image.with_file_name("labels.json"), notes) }
    }

    /// From `labels.json` in a folder.
    pub(super) fn in_folder(folder: &Path, notes: &mut Vec<String>) -> Self {
        Self::read(&folder.join("labels.json"), notes)
    }

    fn read(path: &Path, notes: &mut Vec<String>) -> Self {
        if !path.is_file() {
            return Self::default();
        }
        match read_json::<Value>(path) {
            Ok(value) => Self::parse(&value),
            Err(error) => {
                notes.push(format!("the labels were not read: {error}"));
                Self::default()
            }
        }
    }

    /// A map, a list of `{"name" | "file" | "id" | "color": ..., "label" | "type": ...}`, or `segmentation.json`.
    fn parse(value: &Value) -> Self {
        let mut out = BTreeMap::new();
        if let Some(list) = value.get("objects").unwrap_or(value).as_array() {
            for item in list {
                let label = ["label", "type", "category"].iter().find_map(|k| item.get(k)).and_then(text);
                for key in ["name", "file", "mask", "id", "index", "color"] {
                    if let Some(key) = item.get(key).and_then(key_text) {
                        out.insert(key, label.clone());
                    }
                }
            }
        } else if let Some(map) = value.as_object() {
            for (key, value) in map {
                out.insert(key.trim().to_lowercase(), text(value));
            }
        }
        Self(out)
    }

    /// Sets the labels of masks and takes out those that are said to be no objects.
    pub(super) fn apply(&self, masks: &mut Vec<LoadedMask>, notes: &mut Vec<String>) {
        if self.0.is_empty() {
            return;
        }
        masks.retain_mut(|m| {
            let name = m.name.to_lowercase();
            let mut keys = vec![name.clone()];
            keys.extend(["png", "jpg", "jpeg"].map(|end| format!("{name}.{end}")));
            keys.extend(name.strip_prefix("id_").map(str::to_owned));
            if let Some([r, g, b]) = m.color {
                keys.extend([format!("#{r:02x}{g:02x}{b:02x}"), format!("{r},{g},{b}")]);
            }
            match keys.iter().find_map(|k| self.0.get(k)) {
                Some(Some(label)) => {
                    m.label = Some(label.clone());
                    true
                }
                Some(None) => {
                    notes.push(format!("mask {} was left out: its label says that it is no object", m.name));
                    false
                }
                None => true,
            }
        });
    }
}

fn text(value: &Value) -> Option<String> {
    let clean: String = value.as_str()?.chars().filter(|c| !c.is_control()).take(MAX_LABEL).collect();
    let clean = clean.trim().to_lowercase();
    (!clean.is_empty()).then_some(clean)
}

fn key_text(value: &Value) -> Option<String> {
    match value {
        Value::String(s) => Some(s.rsplit(['/', '\\']).next().unwrap_or(s).trim().to_lowercase()),
        Value::Number(n) => Some(n.to_string()),
        Value::Array(c) if c.len() == 3 => {
            Some(c.iter().map(|v| v.as_u64().unwrap_or(0).to_string()).collect::<Vec<_>>().join(","))
        }
        _ => None,
    }
}

/// The category in a file name: `coffee_table_02` is a coffee table, `12` and `mask_3` say nothing.
pub(super) fn from_stem(stem: &str) -> Option<String> {
    let words: Vec<String> = stem
        .split(|c: char| !c.is_alphanumeric())
        .map(|w| w.trim_end_matches(|c: char| c.is_ascii_digit()).to_lowercase())
        .filter(|w| !w.is_empty() && !["mask", "masks", "object", "obj", "instance", "seg", "id"].contains(&w.as_str()))
        .collect();
    let label: String = words.join(" ").chars().take(MAX_LABEL).collect();
    label.chars().any(char::is_alphabetic).then_some(label)
}
