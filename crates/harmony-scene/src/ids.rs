//! Object names that are safe as file and node names.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An object's id: `[a-z0-9_]`, 1 to 64 characters, starting with a letter, such as `chair_02`.
///
/// It is used as a file name and as a glTF node name, so it is checked when it is made and
/// can never hold what a model or a user wrote unchecked.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub struct ObjectId(String);

/// The text is not an object id.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("object ids have 1 to 64 characters of a-z, 0-9 and _ and start with a letter; got {text:?}")]
pub struct IdError {
    /// What was given, shortened.
    pub text: String,
}

impl ObjectId {
    /// Checks a text.
    ///
    /// # Errors
    /// [`IdError`] when a character or the length is not allowed.
    pub fn new(text: &str) -> Result<Self, IdError> {
        let ok = (1..=64).contains(&text.len())
            && text.starts_with(|c: char| c.is_ascii_lowercase())
            && text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
        if ok { Ok(Self(text.to_owned())) } else { Err(IdError { text: text.chars().take(80).collect() }) }
    }

    /// The id of the `number`-th (from 1) object of a category, whatever characters the category holds.
    pub fn numbered(category: &str, number: usize) -> Self {
        let mut stem: String = category
            .to_lowercase()
            .chars()
            .map(|c| if c.is_ascii_lowercase() || c.is_ascii_digit() { c } else { '_' })
            .collect::<String>()
            .split('_')
            .filter(|part| !part.is_empty())
            .collect::<Vec<_>>()
            .join("_");
        stem.truncate(48);
        if !stem.starts_with(|c: char| c.is_ascii_lowercase()) {
            stem = format!("object_{stem}");
        }
        let stem = stem.trim_end_matches('_');
        Self(format!("{stem}_{number:02}"))
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for ObjectId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for ObjectId {
    type Error = IdError;

    fn try_from(text: String) -> Result<Self, IdError> {
        Self::new(&text)
    }
}

impl From<ObjectId> for String {
    fn from(id: ObjectId) -> String {
        id.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_names_become_harmless_ids() {
        assert_eq!(ObjectId::numbered("../../etc/passwd", 1).as_str(), "etc_passwd_01");
        assert_eq!(ObjectId::numbered("Coffee Table", 2).as_str(), "coffee_table_02");
        assert_eq!(ObjectId::numbered("", 3).as_str(), "object_03");
        assert_eq!(ObjectId::numbered("42 stühle", 1).as_str(), "object_42_st_hle_01");
        assert!(ObjectId::new("../x").is_err());
        for text in ["椅子", "a".repeat(500).as_str(), "\u{0}"] {
            assert!(ObjectId::new(ObjectId::numbered(text, 7).as_str()).is_ok());
        }
    }
}
