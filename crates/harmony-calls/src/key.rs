//! Content keys: what a call is about, as a hash.

use harmony_roles::{PlayerCard, Role};
use harmony_scene::Mask;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A blake3 hash in lower-case hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ContentKey(pub String);

impl std::fmt::Display for ContentKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Collects what belongs to a key; every entry is tagged and carries its length, so that no two lists of entries
/// run together into the same bytes.
pub struct KeyHasher(blake3::Hasher);

impl KeyHasher {
    /// Starts a key for a role.
    pub fn new(role: Role) -> Self {
        let mut this = Self(blake3::Hasher::new());
        this.bytes("harmony call 1", role.folder().as_bytes());
        this
    }

    /// Adds bytes.
    pub fn bytes(&mut self, tag: &str, bytes: &[u8]) {
        self.0.update(&(tag.len() as u64).to_le_bytes());
        self.0.update(tag.as_bytes());
        self.0.update(&(bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }

    /// Adds text.
    pub fn text(&mut self, tag: &str, text: &str) {
        self.bytes(tag, text.as_bytes());
    }

    /// Adds JSON, whatever the order of its properties, its numbers to six decimals: what was computed comes out the same
    /// only so far when a sum is taken in another order.
    pub fn json(&mut self, tag: &str, value: &Value) {
        self.text(tag, &canonical(value).to_string());
    }

    /// Adds pixels.
    pub fn pixels(&mut self, tag: &str, hash: &str) {
        self.text(tag, hash);
    }

    /// Adds a mask.
    pub fn mask(&mut self, tag: &str, mask: Option<&Mask>) {
        match mask {
            None => self.bytes(tag, b"none"),
            Some(mask) => {
                let bits: Vec<u8> = mask.bits().iter().map(|b| u8::from(*b)).collect();
                self.text(tag, &pixel_hash(mask.size().width, mask.size().height, &bits));
            }
        }
    }

    /// The key.
    pub fn finish(&self) -> ContentKey {
        ContentKey(self.0.finalize().to_hex().to_string())
    }
}

/// Hash of pixels and their arrangement.
pub fn pixel_hash(width: u32, height: u32, bytes: &[u8]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&width.to_le_bytes());
    hasher.update(&height.to_le_bytes());
    hasher.update(bytes);
    hasher.finalize().to_hex().to_string()
}

/// The key of a question put to a player: the question's own key and who is asked. How many calls the player takes at
/// once does not matter.
pub fn key_for(question: &ContentKey, card: &PlayerCard) -> ContentKey {
    let mut hasher = blake3::Hasher::new();
    for part in [&question.0, &card.player, &card.model] {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    ContentKey(hasher.finalize().to_hex().to_string())
}

/// The same JSON with the properties of every object in order of their names, and fractions to six decimals.
fn canonical(value: &Value) -> Value {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by(|a, b| a.0.cmp(b.0));
            Value::Object(entries.into_iter().map(|(k, v)| (k.clone(), canonical(v))).collect())
        }
        Value::Array(items) => Value::Array(items.iter().map(canonical).collect()),
        Value::Number(number) if number.is_f64() => {
            // Adding 0 takes the sign from -0.
            let rounded = number.as_f64().map(|v| (v * 1e6).round() / 1e6 + 0.0);
            rounded.and_then(serde_json::Number::from_f64).map_or_else(|| value.clone(), Value::Number)
        }
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn key(f: impl Fn(&mut KeyHasher)) -> ContentKey {
        let mut hasher = KeyHasher::new(Role::Detector);
        f(&mut hasher);
        hasher.finish()
    }

    #[test]
    fn property_order_does_not_change_a_key_but_content_does() {
        let a = key(|h| h.json("facts", &json!({"a": 1, "b": [{"x": 1, "y": 2}]})));
        let b = key(|h| h.json("facts", &json!({"b": [{"y": 2, "x": 1}], "a": 1})));
        let c = key(|h| h.json("facts", &json!({"b": [{"y": 2, "x": 1}], "a": 2})));
        assert_eq!(a, b);
        assert_ne!(a, c);
    }

    #[test]
    fn what_a_sum_leaves_behind_does_not_change_a_key() {
        let of = |v: f64| key(|h| h.json("facts", &json!({"yaw_deg": v})));
        assert_eq!(of(32.451_915_716_576_18), of(32.451_915_715_571_32));
        assert_eq!(of(3e-17), of(-1e-16));
        assert_ne!(of(32.4519), of(32.4520));
        // What cannot be rounded stays as it is.
        assert_ne!(of(1e303), of(2e303));
    }

    #[test]
    fn entries_do_not_run_together() {
        let a = key(|h| {
            h.text("p", "ab");
            h.text("p", "c");
        });
        let b = key(|h| {
            h.text("p", "a");
            h.text("p", "bc");
        });
        assert_ne!(a, b);
    }

    #[test]
    fn the_key_knows_the_player_but_not_how_many_calls_it_takes_at_once() {
        let question = key(|h| h.text("p", "x"));
        let card = |player: &str, concurrency| PlayerCard {
            player: player.into(),
            model: "m".into(),
            offline: false,
            concurrency,
        };
        assert_eq!(key_for(&question, &card("a", 1)), key_for(&question, &card("a", 8)));
        assert_ne!(key_for(&question, &card("a", 1)), key_for(&question, &card("b", 1)));
    }
}
