//! Settings by their keys: changed from the command line, and switched off one after the other.

use harmony_pipeline::{Questions, Settings};
use serde_json::Value;

/// A change that cannot be made.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OverrideError {
    /// Not `key=value`.
    #[error("{text:?} is not of the form key=value")]
    Form {
        /// What was typed.
        text: String,
    },
    /// There is no such setting.
    #[error("there is no setting {key:?}")]
    Unknown {
        /// The key.
        key: String,
        /// The most similar one.
        similar: Option<String>,
    },
    /// The value does not fit.
    #[error("{key} cannot be {value}: {reason}")]
    Value {
        /// The key.
        key: String,
        /// What it should have become.
        value: String,
        /// Why not.
        reason: String,
    },
}

impl OverrideError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Form { .. } => Some("for instance --set placement.refinement=false".to_owned()),
            Self::Unknown { similar: Some(key), .. } => Some(format!("did you mean {key}?")),
            Self::Unknown { similar: None, .. } => Some("`harmony schema config` prints what can be set".to_owned()),
            Self::Value { .. } => None,
        }
    }
}

/// All keys of the settings with their values, `placement.refinement` and so on.
pub fn keys(settings: &Settings) -> Vec<(String, Value)> {
    let mut out = Vec::new();
    collect("", &value_of(settings), &mut out);
    out
}

fn value_of(settings: &Settings) -> Value {
    serde_json::to_value(settings).expect("settings are plain data")
}

fn collect(prefix: &str, value: &Value, out: &mut Vec<(String, Value)>) {
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
                collect(&key, value, out);
            }
        }
        other => out.push((prefix.to_owned(), other.clone())),
    }
}

/// The settings with one of them changed: `placement.refinement=false`, `review_rounds=0`.
///
/// The value is read as JSON, and as plain text where it is none.
///
/// # Errors
/// [`OverrideError`].
pub fn with_change(settings: &Settings, change: &str) -> Result<Settings, OverrideError> {
    let (key, typed) = change.split_once('=').ok_or_else(|| OverrideError::Form { text: change.to_owned() })?;
    let (key, typed) = (key.trim(), typed.trim());
    let mut all = value_of(settings);
    let Some(place) = all.pointer_mut(&format!("/{}", key.replace('.', "/"))).filter(|v| !v.is_object()) else {
        return Err(OverrideError::Unknown { key: key.to_owned(), similar: similar(settings, key) });
    };
    *place = serde_json::from_str(typed).unwrap_or_else(|_| Value::String(typed.to_owned()));
    let wrong = |reason: String| OverrideError::Value { key: key.to_owned(), value: typed.to_owned(), reason };
    let changed: Settings = serde_json::from_value(all).map_err(|e| wrong(e.to_string()))?;
    changed.check().map_err(wrong)?;
    Ok(changed)
}

/// The settings with several changes, in their order.
///
/// # Errors
/// [`OverrideError`] of the first that cannot be made.
pub fn with_changes(settings: &Settings, changes: &[String]) -> Result<Settings, OverrideError> {
    changes.iter().try_fold(settings.clone(), |settings, change| with_change(&settings, change))
}

/// The key that shares most with what was typed: at most a third of the last word's letters differ, or of all.
fn similar(settings: &Settings, typed: &str) -> Option<String> {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let near = |distance: usize, of: &str| (distance * 3 <= of.len()).then_some(distance);
    let distance = |key: &str| {
        let word = near(edits(&last(key), &last(typed)), &last(typed));
        [word, near(edits(key, typed), typed)].into_iter().flatten().min()
    };
    let nearest = keys(settings).into_iter().filter_map(|(key, _)| Some((distance(&key)?, key))).min()?;
    Some(nearest.1)
}

/// Letters to insert, drop or replace (Levenshtein).
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, c) in a.chars().enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (j, d) in b.iter().enumerate() {
            let replaced = corner + usize::from(c != *d);
            corner = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(corner + 1);
        }
    }
    row[b.len()]
}

/// Changes that take one part of the method away each: every switch that is on (top level, placement, looks that are
/// asked for), and the review.
pub fn switches_off(settings: &Settings) -> Vec<String> {
    let of_section = |key: &str, section: &str| {
        key.strip_prefix(section).and_then(|k| k.strip_prefix('.')).is_some_and(|k| !k.contains('.'))
    };
    let asks = settings.questions == Questions::Paper;
    let switch = |key: &str| !key.contains('.') || of_section(key, "placement") || (asks && of_section(key, "looks"));
    let mut off: Vec<String> = keys(settings)
        .into_iter()
        .filter(|(key, value)| switch(key) && *value == Value::Bool(true))
        .map(|(key, _)| format!("{key}=false"))
        .collect();
    if settings.review_rounds > 0 {
        off.push("review_rounds=0".to_owned());
    }
    off
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_reaches_its_setting_and_no_other() {
        let settings = Settings::default();
        let changes = ["placement.refinement=false".to_owned(), " review_rounds = 0 ".to_owned()];
        let changed = with_changes(&settings, &changes).unwrap();
        assert!(!changed.placement.refinement && changed.review_rounds == 0);
        let mut back = changed;
        back.placement.refinement = true;
        back.review_rounds = settings.review_rounds;
        assert_eq!(back, settings);
    }

    #[test]
    fn a_misspelt_key_is_named_and_the_right_one_suggested() {
        let wrong = |text: &str| with_change(&Settings::default(), text).unwrap_err();
        for (typed, meant) in [
            ("placement.refinment=false", "placement.refinement"),
            ("refinement=false", "placement.refinement"),
            ("review_round=0", "review_rounds"),
        ] {
            let error = wrong(typed);
            assert!(error.hint().is_some_and(|h| h.contains(meant)), "{typed}: {error} {:?}", error.hint());
        }
        assert!(matches!(wrong("nothing.of.the.kind=1"), OverrideError::Unknown { similar: None, .. }));
        assert!(matches!(wrong("placement=1"), OverrideError::Unknown { .. }), "a table is no setting");
        assert!(matches!(wrong("review_rounds"), OverrideError::Form { .. }));
    }

    #[test]
    fn a_value_that_does_not_fit_is_refused() {
        for text in ["placement.refinement=3", "review_rounds=many", "working_px=9", "review_rounds=-1"] {
            assert!(matches!(with_change(&Settings::default(), text), Err(OverrideError::Value { .. })), "{text}");
        }
    }

    #[test]
    fn all_parts_that_are_on_can_be_taken_away() {
        let mut settings = Settings::default();
        let off = switches_off(&settings);
        for expected in
            ["camera_calibration=false", "placement.depth_first=false", "placement.groups=false", "review_rounds=0"]
        {
            assert!(off.iter().any(|o| o == expected), "{expected} of {off:?}");
        }
        for change in &off {
            assert_ne!(with_change(&settings, change).unwrap(), settings, "{change}");
        }
        settings.placement.groups = false;
        assert_eq!(switches_off(&settings).len(), off.len() - 1);
        assert!(!off.iter().any(|o| o.starts_with("looks.")), "nothing is asked there that could be left out");
        settings.questions = Questions::Paper;
        let off = switches_off(&settings);
        let looks: Vec<&String> = off.iter().filter(|o| o.starts_with("looks.")).collect();
        assert_eq!(looks.len(), 8, "{looks:?}");
        for change in looks {
            let without = with_change(&settings, change).unwrap();
            assert_ne!(without.asked_looks(), settings.asked_looks(), "{change}");
        }
    }
}
