//! Keys of services: taken from the environment, sent in one header, shown nowhere.

use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_calls::Secret;

/// What stands in a text where a key stood.
const HIDDEN: &str = "[key]";

/// Parts of a key of this length are hidden as well: services repeat the beginning of a key in their errors, and a
/// shortened text may end in the middle of one.
const PART: usize = 10;

/// Shortest key that is taken for one, characters.
const SHORTEST: usize = 8;

/// A key cannot be had. No variant holds what was given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KeyError {
    /// The variable is not set, or empty.
    #[error("the environment variable {variable} is not set")]
    NotSet {
        /// Its name.
        variable: String,
    },
    /// What should be the name of a variable looks like something else, such as the key itself.
    #[error("the name of the key's environment variable must be capitals, digits and `_`, at most 64 of them")]
    NotAName,
    /// The variable holds something that no key is.
    #[error("the environment variable {variable} holds no usable key: {reason}")]
    NotAKey {
        /// Its name.
        variable: String,
        /// What is wrong with it.
        reason: &'static str,
    },
}

/// A key. `Debug` and errors never show it.
#[derive(Clone, PartialEq, Eq)]
pub struct ApiKey {
    text: Arc<str>,
    variable: String,
}

impl ApiKey {
    /// Takes the key from an environment variable.
    ///
    /// # Errors
    /// [`KeyError`]; the value is never part of it.
    pub fn from_env(variable: &str) -> Result<Self, KeyError> {
        check_variable(variable)?;
        match std::env::var(variable) {
            Ok(text) if !text.trim().is_empty() => Self::new(variable, &text),
            Err(std::env::VarError::NotUnicode(_)) => {
                Err(KeyError::NotAKey { variable: variable.to_owned(), reason: "it is not text" })
            }
            _ => Err(KeyError::NotSet { variable: variable.to_owned() }),
        }
    }

    /// Takes a text as the key that the variable would hold.
    ///
    /// # Errors
    /// [`KeyError::NotAKey`] when it can't stand in a header.
    pub fn new(variable: &str, text: &str) -> Result<Self, KeyError> {
        let wrong = |reason| KeyError::NotAKey { variable: variable.to_owned(), reason };
        let text = text.trim();
        if text.len() < SHORTEST {
            return Err(wrong("it is too short"));
        }
        if !text.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(wrong("it holds spaces or characters beyond ASCII"));
        }
        Ok(Self { text: text.into(), variable: variable.to_owned() })
    }

    /// Name of the variable.
    pub fn variable(&self) -> &str {
        &self.variable
    }

    /// The key, for the header of a request.
    pub(super) fn expose(&self) -> &str {
        &self.text
    }

    /// For the call book, which replaces it in everything it writes.
    pub fn secret(&self) -> Secret {
        Secret::new(self.text.to_string())
    }

    /// The text without the key, without longer parts of it and without its base64 form.
    pub fn scrubbed(&self, text: &str) -> String {
        let mut out = text.replace(&*self.text, HIDDEN).replace(&STANDARD.encode(self.text.as_bytes()), HIDDEN);
        // Keys are ASCII, so every byte offset in them is a character boundary.
        let mut start = 0;
        while start + PART <= self.text.len() {
            let rest = &self.text[start..];
            if out.contains(&rest[..PART]) {
                // The longest part that begins here is hidden as a whole.
                let longest = (PART..=rest.len()).rev().find(|n| out.contains(&rest[..*n])).unwrap_or(PART);
                out = out.replace(&rest[..longest], HIDDEN);
                continue;
            }
            start += 1;
        }
        out
    }

    /// Overwrites the key, or a longer beginning of it, wherever it stands in an answer; the length stays, so that
    /// binary formats stay readable.
    pub(super) fn blot_out(&self, bytes: &mut [u8]) {
        let key = self.text.as_bytes();
        let mut at = 0;
        while at < bytes.len() {
            let same = key.iter().zip(&bytes[at..]).take_while(|(a, b)| a == b).count();
            if same >= PART.min(key.len()) {
                bytes[at..at + same].fill(b'x');
                at += same;
            } else {
                at += 1;
            }
        }
    }
}

impl std::fmt::Debug for ApiKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(HIDDEN)
    }
}

/// Whether a text can be the name of a key's variable. Keys themselves hold small letters or `-`, so that a key that
/// was written in place of a name is found out, and not repeated in a message.
///
/// # Errors
/// [`KeyError::NotAName`].
pub fn check_variable(name: &str) -> Result<(), KeyError> {
    let first = name.bytes().next().is_some_and(|b| b.is_ascii_uppercase() || b == b'_');
    let all = name.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_');
    if first && all && name.len() <= 64 { Ok(()) } else { Err(KeyError::NotAName) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CANARY: &str = "sk-canary-3f9a7c21b8e4d605";

    fn key() -> ApiKey {
        ApiKey::new("CANARY_KEY", CANARY).unwrap()
    }

    #[test]
    fn a_key_is_not_shown_whole_or_in_part() {
        assert!(!format!("{:?} {:?}", key(), Some(key())).contains("canary"));
        for text in [
            format!("Incorrect API key provided: {CANARY}."),
            format!("bad key {}... and {}", &CANARY[..14], &CANARY[8..]),
            format!("Basic {}", STANDARD.encode(CANARY)),
            format!("{CANARY}{CANARY}"),
        ] {
            let clean = key().scrubbed(&text);
            for start in 0..CANARY.len() - PART {
                assert!(!clean.contains(&CANARY[start..start + PART]), "{clean}");
            }
            assert!(clean.contains(HIDDEN));
        }
        assert_eq!(key().scrubbed("no key here"), "no key here");
    }

    #[test]
    fn blotting_out_keeps_the_length() {
        let mut bytes = format!("a{CANARY}b{CANARY}").into_bytes();
        let length = bytes.len();
        key().blot_out(&mut bytes);
        assert_eq!(bytes.len(), length);
        assert!(bytes.starts_with(b"axxx") && !String::from_utf8_lossy(&bytes).contains("canary"));
        let mut beginning = format!("ssk-canarsk-canary-3f9..., {}", &CANARY[..6]).into_bytes();
        key().blot_out(&mut beginning);
        assert_eq!(String::from_utf8_lossy(&beginning), "ssk-canarxxxxxxxxxxxxx..., sk-can");
    }

    #[test]
    fn a_key_in_place_of_a_name_is_refused_without_being_repeated() {
        for wrong in [CANARY, "AIzaSyCanary123", "", "1KEY", "KEY NAME"] {
            let error = ApiKey::from_env(wrong).unwrap_err();
            assert_eq!(error, KeyError::NotAName);
            assert!(wrong.is_empty() || !error.to_string().contains(wrong));
        }
        assert!(matches!(ApiKey::from_env("HARMONY_NO_SUCH_KEY"), Err(KeyError::NotSet { .. })));
        assert!(matches!(ApiKey::new("K", "has a space in it"), Err(KeyError::NotAKey { .. })));
        assert!(matches!(ApiKey::new("K", "short"), Err(KeyError::NotAKey { .. })));
    }
}
