//! Schemas as strict modes take them, and values brought into such a schema.

use serde_json::{Map, Value, json};

/// Which service's rules hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rules {
    /// OpenAI's strict mode: the root is an object and no choice, every property is required and no other allowed, and
    /// only a few keywords are (vlm sheet, section 3; the service names the place in its 400).
    OpenAi,
    /// Anthropic's `output_config.format`: close to OpenAI's, ranges refused (vlm sheet, section 6).
    Anthropic,
    /// Gemini's `responseJsonSchema`: real JSON Schema, unknown keywords are ignored (vlm sheet, section 5).
    Gemini,
    /// Grammars of local servers: `pattern` and `format` are errors in some compilers (vlm sheet, section 7).
    Grammar,
}

/// Deepest nesting of objects (vlm sheet, section 3: 10 levels).
const DEEPEST: usize = 10;
/// Most properties in all.
const MAX_PROPERTIES: usize = 5000;
/// Most values of all enumerations together.
const MAX_VALUES: usize = 1000;
/// Most characters of names and values.
const MAX_CHARACTERS: usize = 120_000;

/// Keywords that every strict mode takes.
const KEYWORDS: [&str; 12] = [
    "type",
    "properties",
    "required",
    "additionalProperties",
    "items",
    "enum",
    "const",
    "anyOf",
    "$ref",
    "$defs",
    "definitions",
    "description",
];

#[derive(Default)]
struct Counted {
    properties: usize,
    values: usize,
    characters: usize,
}

/// What a service has against a schema.
///
/// # Errors
/// In the service's words, more or less.
pub fn check(schema: &Value, rules: Rules) -> Result<(), String> {
    let mut counted = Counted::default();
    if rules == Rules::Gemini {
        return Ok(());
    }
    if rules != Rules::Grammar {
        if schema.get("type") != Some(&json!("object")) {
            return Err("schema must be a JSON Schema of 'type: \"object\"'".to_owned());
        }
        if schema.get("anyOf").is_some() {
            return Err("'anyOf' is not permitted at the root".to_owned());
        }
    }
    node(schema, schema, rules, "()", 0, &mut counted)?;
    if counted.properties > MAX_PROPERTIES {
        return Err(format!("{} properties; at most {MAX_PROPERTIES}", counted.properties));
    }
    if counted.values > MAX_VALUES {
        return Err(format!("{} enum values; at most {MAX_VALUES}", counted.values));
    }
    if counted.characters > MAX_CHARACTERS {
        return Err(format!("{} characters of names and values; at most {MAX_CHARACTERS}", counted.characters));
    }
    Ok(())
}

fn node(
    root: &Value,
    at: &Value,
    rules: Rules,
    place: &str,
    depth: usize,
    counted: &mut Counted,
) -> Result<(), String> {
    let Some(map) = at.as_object() else { return Err(format!("in context={place}: a schema must be an object")) };
    let wrong = |what: &str| Err(format!("Invalid schema: in context={place}, {what}"));
    if rules == Rules::Grammar {
        if let Some(keyword) = ["pattern", "format"].into_iter().find(|k| map.contains_key(*k)) {
            return wrong(&format!("{keyword:?} is not supported"));
        }
    } else {
        if let Some(keyword) = map.keys().find(|k| !KEYWORDS.contains(&k.as_str())) {
            return wrong(&format!("{keyword:?} is not permitted"));
        }
        if map.contains_key("$ref") && map.len() > 1 {
            return wrong("$ref cannot have keywords beside it");
        }
        if !["type", "enum", "const", "anyOf", "$ref"].iter().any(|k| map.contains_key(*k)) {
            return wrong("schema must have a 'type' key");
        }
    }
    if let Some(reference) = map.get("$ref").and_then(Value::as_str)
        && reference.strip_prefix('#').and_then(|pointer| root.pointer(pointer)).is_none()
    {
        return wrong(&format!("reference {reference:?} leads nowhere"));
    }
    let is_object = match map.get("type") {
        Some(Value::Array(types)) => types.iter().any(|t| t == "object"),
        Some(kind) => kind == "object",
        None => false,
    };
    if is_object && rules != Rules::Grammar {
        if map.get("additionalProperties") != Some(&Value::Bool(false)) {
            return wrong("'additionalProperties' is required to be supplied and to be false");
        }
        let none = Map::new();
        let properties = map.get("properties").and_then(Value::as_object).unwrap_or(&none);
        let required: Vec<&str> =
            map.get("required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).collect();
        if let Some(missing) = properties.keys().find(|name| !required.contains(&name.as_str())) {
            return wrong(&format!("'required' must include every key in properties. Missing {missing:?}"));
        }
        if let Some(extra) = required.iter().find(|name| !properties.contains_key(**name)) {
            return wrong(&format!("'required' names {extra:?}, which is no property"));
        }
    }
    if is_object && depth >= DEEPEST {
        return wrong("more than 10 levels of nesting");
    }
    let deeper = depth + usize::from(is_object);
    for (name, property) in map.get("properties").and_then(Value::as_object).into_iter().flatten() {
        counted.properties += 1;
        counted.characters += name.len();
        node(root, property, rules, &format!("{place}.{name}"), deeper, counted)?;
    }
    if let Some(values) = map.get("enum").and_then(Value::as_array) {
        counted.values += values.len();
        counted.characters += values.iter().filter_map(Value::as_str).map(str::len).sum::<usize>();
    }
    if let Some(items) = map.get("items") {
        node(root, items, rules, &format!("{place}.items"), deeper, counted)?;
    }
    for option in map.get("anyOf").and_then(Value::as_array).into_iter().flatten() {
        node(root, option, rules, &format!("{place}.anyOf"), depth, counted)?;
    }
    for defs in ["$defs", "definitions"] {
        for (name, def) in map.get(defs).and_then(Value::as_object).into_iter().flatten() {
            counted.characters += name.len();
            node(root, def, rules, &format!("{place}.{name}"), 0, counted)?;
        }
    }
    Ok(())
}

/// A value of the program's own form in the form of the schema that was sent: what is absent is `null`, a list or
/// scalar at the root is wrapped, free keys become entries, anything goes as text.
pub fn fitted(schema: &Value, value: &Value) -> Value {
    let root = followed(schema, schema);
    let properties = root.get("properties").and_then(Value::as_object);
    let value = match properties.map(|p| p.keys().map(String::as_str).collect::<Vec<_>>()).as_deref() {
        Some([only @ ("items" | "answer")]) if value.get(only).is_none() => &json!({*only: value}),
        _ => value,
    };
    fit(schema, schema, value, 0)
}

fn followed<'a>(root: &'a Value, mut at: &'a Value) -> &'a Value {
    for _ in 0..16 {
        let Some(reference) = at.get("$ref").and_then(Value::as_str) else { break };
        match reference.strip_prefix('#').and_then(|pointer| root.pointer(pointer)) {
            Some(target) => at = target,
            None => break,
        }
    }
    at
}

fn allows(at: &Value, kind: &str) -> bool {
    match at.get("type") {
        Some(Value::String(own)) => own == kind || (kind == "integer" && own == "number"),
        Some(Value::Array(own)) => own.iter().any(|t| t == kind || (kind == "integer" && t == "number")),
        _ => at.get("enum").and_then(Value::as_array).is_some_and(|all| all.iter().any(|v| kind_of(v) == kind)),
    }
}

fn kind_of(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(n) if n.is_i64() || n.is_u64() => "integer",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    }
}

fn fit(root: &Value, at: &Value, value: &Value, depth: usize) -> Value {
    let at = followed(root, at);
    if depth > 40 {
        return value.clone();
    }
    if let Some(options) = at.get("anyOf").and_then(Value::as_array) {
        // An option of the value's own kind, else one into which it can be brought.
        let own =
            |option: &&Value| allows(followed(root, option), kind_of(value)) && fits_shallowly(root, option, value);
        let brought = |option: &&Value| {
            allows(followed(root, option), kind_of(&fit(root, option, value, depth + 1)))
                && fits_shallowly(root, option, value)
        };
        let fitting = options.iter().find(own).or_else(|| options.iter().find(brought));
        return fitting.map_or_else(|| value.clone(), |option| fit(root, option, value, depth + 1));
    }
    match value {
        Value::Object(map) if at.get("properties").is_some() => {
            let properties = at["properties"].as_object();
            let out = properties.into_iter().flatten().map(|(name, property)| {
                (name.clone(), fit(root, property, map.get(name).unwrap_or(&Value::Null), depth + 1))
            });
            Value::Object(out.collect())
        }
        Value::Object(map) if allows(at, "array") => {
            let entries = map.iter().map(|(key, value)| json!({"key": key, "value": value}));
            Value::Array(entries.map(|entry| fit(root, &at["items"], &entry, depth + 1)).collect())
        }
        Value::Array(items) if at.get("items").is_some() => {
            Value::Array(items.iter().map(|item| fit(root, &at["items"], item, depth + 1)).collect())
        }
        other if allows(at, "string") && !allows(at, kind_of(other)) => Value::String(other.to_string()),
        other => other.clone(),
    }
}

/// Whether the properties of a value are those of an option.
fn fits_shallowly(root: &Value, option: &Value, value: &Value) -> bool {
    let properties = followed(root, option).get("properties").and_then(Value::as_object);
    match (value, properties) {
        (Value::Object(map), Some(properties)) => map.keys().all(|key| properties.contains_key(key)),
        (Value::Object(_), None) => followed(root, option).get("items").is_some(),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(properties: &Value, required: &Value) -> Value {
        json!({"type": "object", "properties": properties, "required": required, "additionalProperties": false})
    }

    #[test]
    fn what_a_strict_mode_refuses_is_refused_with_its_place() {
        let good = object(&json!({"a": {"type": ["number", "null"]}}), &json!(["a"]));
        assert_eq!(check(&good, Rules::OpenAi), Ok(()));
        let mut open = good.clone();
        open["additionalProperties"] = json!(true);
        let mut ranged = good.clone();
        ranged["properties"]["a"]["minimum"] = json!(0);
        let mut lost = good.clone();
        lost["properties"]["a"] = json!({"$ref": "#/$defs/X"});
        for (schema, word) in [
            (json!({"type": "array", "items": {"type": "string"}}), "object"),
            (object(&json!({"a": {"type": "number"}}), &json!([])), "Missing \"a\""),
            (open, "additionalProperties"),
            (ranged.clone(), "context=().a"),
            (lost, "leads nowhere"),
        ] {
            let error = check(&schema, Rules::OpenAi).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
        assert_eq!(check(&ranged, Rules::Gemini), Ok(()));
        let mut deep = json!({"type": "string"});
        for _ in 0..11 {
            deep = object(&json!({"a": deep}), &json!(["a"]));
        }
        assert!(check(&deep, Rules::OpenAi).unwrap_err().contains("nesting"));
    }

    #[test]
    fn null_is_null_beside_a_choice_of_words() {
        let schema =
            object(&json!({"wall": {"anyOf": [{"$ref": "#/$defs/Wall"}, {"type": "null"}]}}), &json!(["wall"]));
        let mut schema = schema;
        schema["$defs"] = json!({"Wall": {"type": "string", "enum": ["back", "left"]}});
        assert_eq!(fitted(&schema, &json!({"wall": null})), json!({"wall": null}));
        assert_eq!(fitted(&schema, &json!({})), json!({"wall": null}));
        assert_eq!(fitted(&schema, &json!({"wall": "left"})), json!({"wall": "left"}));
    }

    #[test]
    fn values_are_brought_into_the_form_that_was_sent() {
        let schema = object(
            &json!({
                "items": {"type": "array", "items": {"$ref": "#/$defs/Item"}},
            }),
            &json!(["items"]),
        );
        let mut schema = schema;
        schema["$defs"] = json!({"Item": object(
            &json!({"name": {"type": "string"}, "size": {"type": ["number", "null"]},
                    "free": {"type": ["array", "null"], "items": object(&json!({"key": {"type": "string"}, "value": {"type": "number"}}), &json!(["key", "value"]))}}),
            &json!(["name", "size", "free"]))});
        let fitted = fitted(&schema, &json!([{"name": "chair", "free": {"w": 2.5}}, {"name": "rug", "size": 2}]));
        assert_eq!(
            fitted,
            json!({"items": [{"name": "chair", "size": null, "free": [{"key": "w", "value": 2.5}]},
                             {"name": "rug", "size": 2, "free": null}]})
        );
        assert!(harmony_calls::schema_complaints(&schema, &fitted).is_empty());
    }
}
