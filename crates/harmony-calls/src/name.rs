//! Call names: stable from run to run, and safe as folder names.

use std::path::{Path, PathBuf};

/// The longest name accepted, in folders.
const MAX_PARTS: usize = 8;

/// The longest part accepted, in characters.
const MAX_PART: usize = 64;

/// A checked call name such as `3_furniture/chair_02/mesh`: 1 to 8 parts of `[a-z0-9_]`, 1 to 64 characters each.
///
/// Nothing that a model said becomes a path unchecked: a name with any other character, `..` among them, is refused.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CallName(String);

/// The text is not a call name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("call names are 1 to {MAX_PARTS} parts of a-z, 0-9 and _ (1 to {MAX_PART} each) joined by /; got {text:?}")]
pub struct NameError {
    /// What was given, shortened.
    pub text: String,
}

impl CallName {
    /// Checks a text.
    ///
    /// # Errors
    /// [`NameError`] when a part is empty, too long, or holds another character.
    pub fn new(text: &str) -> Result<Self, NameError> {
        let part_ok = |part: &str| {
            (1..=MAX_PART).contains(&part.len())
                && part.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
        };
        let parts = text.split('/').count();
        if parts <= MAX_PARTS && text.split('/').all(part_ok) {
            Ok(Self(text.to_owned()))
        } else {
            Err(NameError { text: text.chars().take(120).collect() })
        }
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// First part: the phase's folder name.
    pub fn phase(&self) -> &str {
        self.0.split('/').next().unwrap_or(&self.0)
    }

    /// The object a call is about, by its name: the second of three or more parts, when it is a numbered id
    /// (`3_furniture/chair_02/mesh`).
    pub fn object(&self) -> Option<harmony_scene::ObjectId> {
        let mut parts = self.0.split('/').skip(1);
        let part = parts.next()?;
        parts.next()?;
        let (_, number) = part.rsplit_once('_')?;
        let numbered = !number.is_empty() && number.chars().all(|c| c.is_ascii_digit());
        numbered.then(|| harmony_scene::ObjectId::new(part).ok()).flatten()
    }

    /// The folder of this name under `root`.
    pub(crate) fn under(&self, root: &Path) -> PathBuf {
        self.0.split('/').fold(root.to_path_buf(), |path, part| path.join(part))
    }
}

impl std::fmt::Display for CallName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_plain_parts_make_a_name() {
        for good in ["1_layout/layout", "3_furniture/chair_02/mesh", "a"] {
            assert!(CallName::new(good).is_ok(), "{good}");
        }
        let long = "a".repeat(65);
        for bad in ["", "/", "a//b", "../x", "a/..", "/etc", "a\\b", "A", "a b", "a.b", "é", "a\0", &long] {
            assert!(CallName::new(bad).is_err(), "{bad:?}");
        }
        assert!(CallName::new("a/a/a/a/a/a/a/a/a").is_err());
    }

    #[test]
    fn phase_and_object_come_from_the_name() {
        let name = CallName::new("3_furniture/chair_02/mesh").unwrap();
        assert_eq!(name.phase(), "3_furniture");
        assert_eq!(name.object().unwrap().as_str(), "chair_02");
        assert!(CallName::new("3_furniture/list").unwrap().object().is_none());
        assert!(CallName::new("3_furniture/list/again").unwrap().object().is_none());
    }
}
