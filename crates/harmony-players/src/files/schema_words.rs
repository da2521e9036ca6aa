//! A JSON Schema as an indented list that a person can read.

use std::fmt::Write as _;

use serde_json::Value;

/// Deepest level that is described; below, `schema.json` must do.
const MAX_DEPTH: usize = 7;

/// Longest text.
const MAX_CHARS: usize = 20_000;

/// The schema in words.
pub(super) fn in_words(schema: &Value) -> String {
    let mut words = Words { root: schema, text: String::new(), open: Vec::new() };
    words.text.push_str("The answer is ");
    words.describe(schema, 0);
    if words.text.len() > MAX_CHARS {
        let cut = (0..=MAX_CHARS).rev().find(|i| words.text.is_char_boundary(*i)).unwrap_or(0);
        words.text.truncate(cut);
        words.text.push_str("\n...\n(the rest is in schema.json)\n");
    }
    words.text
}

struct Words<'a> {
    root: &'a Value,
    text: String,
    /// References being described: a schema that refers to itself is not followed.
    open: Vec<String>,
}

impl<'a> Words<'a> {
    /// Says what a value is, and lists its properties below.
    fn describe(&mut self, schema: &'a Value, depth: usize) {
        if let Some(reference) = schema.get("$ref").and_then(Value::as_str) {
            let name = reference.rsplit('/').next().unwrap_or(reference);
            let target = reference.strip_prefix('#').and_then(|pointer| self.root.pointer(pointer));
            match target {
                Some(target) if !self.open.iter().any(|r| r == reference) && depth < MAX_DEPTH => {
                    self.open.push(reference.to_owned());
                    self.describe(target, depth);
                    self.open.pop();
                }
                _ => {
                    let _ = writeln!(self.text, "a {name} (see schema.json)");
                }
            }
            return;
        }
        if let Some((inner, null)) = alternatives(schema) {
            match inner.as_slice() {
                [one] => self.describe_nullable(one, null, depth),
                many if many.iter().all(|one| one.get("const").is_some() || one.get("enum").is_some()) => {
                    let words: Vec<String> = many.iter().flat_map(|one| choices(one)).collect();
                    let _ = writeln!(self.text, "one of {}{}", words.join(", "), or_null(null));
                }
                many => {
                    let _ = writeln!(self.text, "one of these{}:", or_null(null));
                    for one in many {
                        self.indent(depth);
                        self.describe(one, depth + 1);
                    }
                }
            }
            return;
        }
        self.describe_plain(schema, false, depth);
    }

    fn describe_nullable(&mut self, schema: &'a Value, null: bool, depth: usize) {
        if schema.get("$ref").is_some() && null {
            self.text.push_str("null or ");
            self.describe(schema, depth);
        } else {
            self.describe_plain(schema, null, depth);
        }
    }

    fn describe_plain(&mut self, schema: &'a Value, null: bool, depth: usize) {
        let (kinds, null_too) = kinds(schema);
        let null = or_null(null || null_too);
        let options = choices(schema);
        if !options.is_empty() {
            let _ = writeln!(self.text, "one of {}{null}", options.join(", "));
            return;
        }
        match kinds.first().map(String::as_str) {
            Some("object") => {
                let _ = writeln!(self.text, "an object{null} with");
                self.properties(schema, depth);
            }
            Some("array") => self.array(schema, null, depth),
            Some(_) => {
                let _ = writeln!(self.text, "{}{}{null}", kinds.join(" or "), range(schema));
            }
            None if schema.get("properties").is_some() => {
                let _ = writeln!(self.text, "an object{null} with");
                self.properties(schema, depth);
            }
            None => {
                let _ = writeln!(self.text, "any value");
            }
        }
    }

    fn array(&mut self, schema: &'a Value, null: &str, depth: usize) {
        let bound = |key: &str| schema.get(key).and_then(Value::as_u64);
        let count = match (bound("minItems"), bound("maxItems")) {
            (Some(a), Some(b)) if a == b => format!("exactly {a} values"),
            (Some(a), Some(b)) => format!("{a} to {b} values"),
            (Some(a), None) if a > 0 => format!("at least {a} values"),
            (_, Some(b)) => format!("up to {b} values"),
            _ => "any number of values".to_owned(),
        };
        let _ = write!(self.text, "a list{null} of {count}, each ");
        match schema.get("items") {
            Some(items) if depth < MAX_DEPTH => self.describe(items, depth),
            _ => self.text.push_str("as in schema.json\n"),
        }
    }

    fn properties(&mut self, schema: &'a Value, depth: usize) {
        let properties = schema.get("properties").and_then(Value::as_object);
        let required: Vec<&str> = schema
            .get("required")
            .and_then(Value::as_array)
            .map(|names| names.iter().filter_map(Value::as_str).collect())
            .unwrap_or_default();
        if depth >= MAX_DEPTH {
            self.indent(depth);
            self.text.push_str("(see schema.json)\n");
            return;
        }
        for (name, property) in properties.into_iter().flatten() {
            self.indent(depth);
            let optional = if required.contains(&name.as_str()) { "" } else { " (may be left out)" };
            let _ = write!(self.text, "`{name}`{optional}: ");
            if let Some(about) = property.get("description").and_then(Value::as_str) {
                let about = about.split_whitespace().collect::<Vec<_>>().join(" ");
                let about = about.trim_end_matches('.');
                let _ = write!(self.text, "{about}; ");
            }
            self.describe(property, depth + 1);
        }
    }

    fn indent(&mut self, depth: usize) {
        for _ in 0..depth {
            self.text.push_str("  ");
        }
        self.text.push_str("- ");
    }
}

fn or_null(null: bool) -> &'static str {
    if null { " or null" } else { "" }
}

/// Types of a schema other than null, with an article, and whether null is one too.
fn kinds(schema: &Value) -> (Vec<String>, bool) {
    let names: Vec<&str> = match schema.get("type") {
        Some(Value::String(name)) => vec![name],
        Some(Value::Array(names)) => names.iter().filter_map(Value::as_str).collect(),
        _ => vec![],
    };
    let null = names.contains(&"null");
    let words = names.into_iter().filter(|name| *name != "null").map(|name| match name {
        "integer" => "a whole number".to_owned(),
        "number" => "a number".to_owned(),
        "string" => "a text".to_owned(),
        "boolean" => "true or false".to_owned(),
        other => other.to_owned(),
    });
    (words.collect(), null)
}

/// The branches of `anyOf` or `oneOf` other than null, and whether null is one.
fn alternatives(schema: &Value) -> Option<(Vec<&Value>, bool)> {
    let branches = schema.get("anyOf").or_else(|| schema.get("oneOf"))?.as_array()?;
    let is_null = |branch: &&Value| branch.get("type").and_then(Value::as_str) == Some("null");
    let null = branches.iter().any(|branch| is_null(&branch));
    Some((branches.iter().filter(|branch| !is_null(branch)).collect(), null))
}

/// The values of an `enum` or `const`.
fn choices(schema: &Value) -> Vec<String> {
    let listed = schema.get("enum").and_then(Value::as_array).cloned().unwrap_or_default();
    listed.iter().chain(schema.get("const")).map(ToString::to_string).collect()
}

fn range(schema: &Value) -> String {
    let bound = |key: &str| schema.get(key).and_then(Value::as_f64);
    match (bound("minimum"), bound("maximum")) {
        (Some(a), Some(b)) => format!(" from {a} to {b}"),
        (Some(a), None) => format!(", at least {a}"),
        (None, Some(b)) => format!(", at most {b}"),
        (None, None) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn every_property_is_named_with_its_kind() {
        let schema = json!({
            "type": "object",
            "properties": {
                "items": {"type": "array", "items": {"$ref": "#/$defs/Item"}, "description": "Kinds of\nobjects."},
                "note": {"type": ["string", "null"]}
            },
            "required": ["items"],
            "$defs": {
                "Item": {
                    "type": "object",
                    "properties": {
                        "box": {"type": "array", "items": {"type": "number"}, "minItems": 4, "maxItems": 4},
                        "wall": {"anyOf": [{"$ref": "#/$defs/Wall"}, {"type": "null"}]},
                        "count": {"type": "integer", "minimum": 0},
                        "inside": {"type": "array", "items": {"$ref": "#/$defs/Item"}}
                    },
                    "required": ["box", "wall", "count", "inside"]
                },
                "Wall": {"oneOf": [{"const": "back", "description": "z = 0"}, {"const": "left"}]}
            }
        });
        let words = in_words(&schema);
        for expected in [
            "`items`: Kinds of objects; a list of any number of values, each an object with",
            "  - `box`: a list of exactly 4 values, each a number",
            "`wall`: null or one of \"back\", \"left\"",
            "`count`: a whole number, at least 0",
            "`note` (may be left out): a text or null",
        ] {
            assert!(words.contains(expected), "{expected}\n---\n{words}");
        }
    }

    #[test]
    fn a_schema_that_refers_to_itself_ends() {
        let schema = json!({"$ref": "#/$defs/A", "$defs": {"A": {"type": "array", "items": {"$ref": "#/$defs/A"}}}});
        assert!(in_words(&schema).contains("(see schema.json)"));
        assert!(in_words(&json!({"$ref": "#"})).len() < MAX_CHARS);
        assert!(in_words(&json!(true)).contains("any value"));
    }
}
