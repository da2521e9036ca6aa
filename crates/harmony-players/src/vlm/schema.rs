//! Schemas as strict modes demand them, and answers back in the form that was asked for.
//!
//! Strict modes want an object at the root, every property required and no others, no free keys and few keywords.
//! [`strict`] reshapes a schema so, [`to_wire`] brings a value (an example) into the reshaped form, and [`from_wire`]
//! brings an answer back, so that it fits the schema of the request:
//!
//! | in the request's schema | on the wire |
//! |---|---|
//! | a list, a scalar or a choice at the root | an object with the one property `items` or `answer` |
//! | a property that may be left out | required, `null` = left out |
//! | an object with free keys | a list of `{key, value}` |
//! | anything at all | a text that holds JSON |
//! | keywords the mode refuses (`default`, ranges, patterns, ...) | words in the description |
//!
//! What a mode cannot express is not lost: answers are checked against the request's own schema afterwards.

use harmony_calls::schema_complaints;
use serde_json::{Map, Value, json};

/// Deepest nesting that is followed: beyond, a schema refers to itself without a value in between.
const MAX_DEPTH: usize = 64;

/// Keywords that only narrow a value. A mode that refuses them gets them as words.
const NARROWING: [&str; 14] = [
    "minimum",
    "maximum",
    "exclusiveMinimum",
    "exclusiveMaximum",
    "multipleOf",
    "minLength",
    "maxLength",
    "pattern",
    "format",
    "minItems",
    "maxItems",
    "uniqueItems",
    "minProperties",
    "maxProperties",
];

/// Formats that tell about the type in memory rather than about the answer.
const TYPE_FORMATS: [&str; 10] =
    ["double", "float", "uint", "int", "uint8", "uint16", "uint32", "uint64", "int32", "int64"];

/// What a kind of strict mode understands beyond the common ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dialect {
    /// Narrowing keywords that it enforces.
    pub keeps: &'static [&'static str],
}

impl Dialect {
    /// OpenAI's and Anthropic's strict modes: no narrowing keyword.
    pub const STRICT: Self = Self { keeps: &[] };
    /// Gemini's `responseJsonSchema`.
    pub const GEMINI: Self = Self { keeps: &["minimum", "maximum", "minItems", "maxItems"] };
    /// Grammars of local servers.
    pub const GRAMMAR: Self = Self { keeps: &["minItems", "maxItems"] };
}

/// What a schema asks for at one place.
enum Shape<'a> {
    /// Anything.
    Any,
    /// What another place says.
    Reference(&'a str),
    /// One of several.
    Choice(&'a [Value]),
    /// An object with free keys; the schema of the values, if there is one.
    FreeKeys(Option<&'a Value>),
    /// An object with these properties.
    Object(&'a Map<String, Value>),
    /// A list.
    List,
    /// A scalar.
    Scalar,
}

fn shape(node: &Value) -> Shape<'_> {
    let Some(map) = node.as_object() else { return Shape::Any };
    if let Some(reference) = map.get("$ref").and_then(Value::as_str) {
        return Shape::Reference(reference);
    }
    for keyword in ["anyOf", "oneOf", "allOf"] {
        if let Some(options) = map.get(keyword).and_then(Value::as_array)
            && !options.is_empty()
        {
            return Shape::Choice(options);
        }
    }
    let is = |name: &str| match map.get("type") {
        Some(Value::String(own)) => own == name,
        Some(Value::Array(own)) => own.iter().any(|t| t == name),
        _ => false,
    };
    if let Some(properties) = map.get("properties").and_then(Value::as_object).filter(|p| !p.is_empty()) {
        return Shape::Object(properties);
    }
    if is("object") {
        return match map.get("additionalProperties") {
            Some(Value::Bool(false)) => Shape::Scalar,
            Some(values) if values.is_object() => Shape::FreeKeys(Some(values)),
            _ => Shape::FreeKeys(None),
        };
    }
    if is("array") || map.contains_key("items") || map.contains_key("prefixItems") {
        return Shape::List;
    }
    if map.contains_key("type") || map.contains_key("enum") || map.contains_key("const") {
        return Shape::Scalar;
    }
    Shape::Any
}

/// The place that a reference such as `#/$defs/Part` names.
fn resolve<'a>(root: &'a Value, reference: &str) -> Option<&'a Value> {
    root.pointer(reference.strip_prefix('#')?)
}

/// A node with its references followed.
fn followed<'a>(root: &'a Value, mut node: &'a Value) -> &'a Value {
    for _ in 0..MAX_DEPTH {
        let Shape::Reference(reference) = shape(node) else { break };
        let Some(target) = resolve(root, reference) else { break };
        node = target;
    }
    node
}

/// Name of the property in which an answer that is no object is wrapped.
fn wrapper(root: &Value) -> Option<&'static str> {
    match shape(followed(root, root)) {
        Shape::Object(_) => None,
        Shape::List => Some("items"),
        _ => Some("answer"),
    }
}

/// The schema as a strict mode demands it.
pub fn strict(schema: &Value, dialect: Dialect) -> Value {
    let root = followed(schema, schema);
    let mut out = match wrapper(schema) {
        None => reshaped(schema, root, dialect, 0),
        Some(name) => json!({
            "type": "object",
            "properties": {name: reshaped(schema, root, dialect, 0)},
            "required": [name],
            "additionalProperties": false,
        }),
    };
    for key in ["$defs", "definitions"] {
        if let Some(defs) = schema.get(key).and_then(Value::as_object) {
            let defs: Map<String, Value> =
                defs.iter().map(|(name, node)| (name.clone(), reshaped(schema, node, dialect, 0))).collect();
            out[key] = Value::Object(defs);
        }
    }
    out
}

fn reshaped(root: &Value, node: &Value, dialect: Dialect, depth: usize) -> Value {
    if depth > MAX_DEPTH {
        return text_of_json(node);
    }
    let below = |node: &Value| reshaped(root, node, dialect, depth + 1);
    match shape(node) {
        Shape::Any => text_of_json(node),
        // Words beside a reference are refused by strict modes.
        Shape::Reference(reference) => json!({"$ref": reference}),
        Shape::Choice(options) => choice(node, options, &below),
        Shape::FreeKeys(values) => {
            let value = values.map_or_else(|| text_of_json(&Value::Null), below);
            let entry = json!({
                "type": "object",
                "properties": {"key": {"type": "string"}, "value": value},
                "required": ["key", "value"],
                "additionalProperties": false,
            });
            let kind = renamed_type(node, "object", "array");
            with_words(json!({"type": kind, "items": entry}), node, dialect)
        }
        Shape::Object(properties) => {
            let required = required(node);
            let mut out = Map::new();
            for (name, property) in properties {
                let strict = below(property);
                let optional = !required.contains(&name.as_str());
                out.insert(name.clone(), if optional { nullable(root, property, strict) } else { strict });
            }
            let names: Vec<&String> = properties.keys().collect();
            let kind = node.get("type").cloned().unwrap_or_else(|| json!("object"));
            let object = json!({"type": kind, "properties": out, "required": names, "additionalProperties": false});
            with_words(object, node, dialect)
        }
        Shape::List => {
            let items = match (node.get("prefixItems").and_then(Value::as_array), node.get("items")) {
                (Some(places), _) if !places.is_empty() => {
                    let mut kinds: Vec<Value> = Vec::new();
                    for kind in places.iter().map(below) {
                        if !kinds.contains(&kind) {
                            kinds.push(kind);
                        }
                    }
                    if kinds.len() == 1 { kinds.remove(0) } else { json!({"anyOf": kinds}) }
                }
                (_, Some(items)) => below(items),
                _ => text_of_json(&Value::Null),
            };
            let kind = node.get("type").cloned().unwrap_or_else(|| json!("array"));
            with_words(json!({"type": kind, "items": items}), node, dialect)
        }
        Shape::Scalar => scalar(node, dialect),
    }
}

/// A scalar, or an object without properties.
fn scalar(node: &Value, dialect: Dialect) -> Value {
    let mut out = Map::new();
    if let Some(kind) = node.get("type") {
        out.insert("type".into(), kind.clone());
    }
    if let Some(values) = node.get("enum") {
        out.insert("enum".into(), values.clone());
    }
    if let Some(value) = node.get("const") {
        out.insert("enum".into(), json!([value]));
    }
    if !out.contains_key("type")
        && let Some(values) = out.get("enum").and_then(Value::as_array)
        && values.iter().all(Value::is_string)
    {
        out.insert("type".into(), json!("string"));
    }
    if out.get("type") == Some(&json!("object")) {
        out.insert("properties".into(), json!({}));
        out.insert("required".into(), json!([]));
        out.insert("additionalProperties".into(), json!(false));
    }
    with_words(Value::Object(out), node, dialect)
}

/// One of several; texts to choose from become one list of words, with what each means in the description.
fn choice(node: &Value, options: &[Value], below: &dyn Fn(&Value) -> Value) -> Value {
    let word = |option: &Value| match (option.get("const"), option.get("enum").and_then(Value::as_array)) {
        (Some(Value::String(word)), _) => Some(vec![word.clone()]),
        (None, Some(words)) => words.iter().map(|w| w.as_str().map(str::to_owned)).collect(),
        _ => None,
    };
    let words: Option<Vec<Vec<String>>> = options.iter().map(word).collect();
    let mut out = match words {
        Some(words) => {
            let meanings: Vec<String> = options
                .iter()
                .zip(&words)
                .filter_map(|(option, words)| {
                    Some(format!("{}: {}", words.first()?, option.get("description")?.as_str()?))
                })
                .collect();
            let mut out = json!({"type": "string", "enum": words.concat()});
            if !meanings.is_empty() {
                out["description"] = json!(meanings.join("; "));
            }
            out
        }
        // One option is the option itself (a reference with words beside it is often written so).
        None if options.len() == 1 => below(&options[0]),
        None => json!({"anyOf": options.iter().map(below).collect::<Vec<_>>()}),
    };
    if let (Some(words), None) = (node.get("description"), out.get("$ref")) {
        let own = words.as_str().unwrap_or_default();
        let text =
            out.get("description").and_then(Value::as_str).map_or_else(|| own.to_owned(), |d| format!("{own} {d}"));
        out["description"] = json!(text);
    }
    out
}

/// Anything at all, as a text.
fn text_of_json(node: &Value) -> Value {
    let words = node.get("description").and_then(Value::as_str).unwrap_or_default();
    json!({"type": "string", "description": format!("{words} (a JSON value, written as text)").trim().to_owned()})
}

/// Adds the description and, in words or as they are, the narrowing keywords.
fn with_words(mut out: Value, node: &Value, dialect: Dialect) -> Value {
    let mut words: Vec<String> =
        node.get("description").and_then(Value::as_str).map(|text| text.trim().to_owned()).into_iter().collect();
    let mut limits = Vec::new();
    for keyword in NARROWING {
        let Some(limit) = node.get(keyword) else { continue };
        if dialect.keeps.contains(&keyword) {
            out[keyword] = limit.clone();
        } else if !(keyword == "format" && limit.as_str().is_some_and(|f| TYPE_FORMATS.contains(&f))) {
            limits.push(format!("{keyword} {limit}"));
        }
    }
    if !limits.is_empty() {
        words.push(format!("({})", limits.join(", ")));
    }
    if !words.is_empty() {
        out["description"] = json!(words.join(" "));
    }
    out
}

fn required(node: &Value) -> Vec<&str> {
    node.get("required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).collect()
}

fn renamed_type(node: &Value, from: &str, to: &str) -> Value {
    let rename = |t: &Value| if t == from { json!(to) } else { t.clone() };
    match node.get("type") {
        Some(Value::Array(types)) => Value::Array(types.iter().map(rename).collect()),
        _ => json!(to),
    }
}

/// Whether a schema lets `null` pass.
fn accepts_null(root: &Value, node: &Value) -> bool {
    let node = followed(root, node);
    match shape(node) {
        Shape::Any => true,
        Shape::Choice(options) => options.iter().any(|option| accepts_null(root, option)),
        _ => match (node.get("type"), node.get("enum").and_then(Value::as_array)) {
            (_, Some(values)) => values.contains(&Value::Null),
            (Some(Value::Array(types)), None) => types.iter().any(|t| t == "null"),
            (Some(kind), None) => kind == "null",
            (None, None) => false,
        },
    }
}

/// The reshaped schema of a property that may be left out.
fn nullable(root: &Value, property: &Value, mut strict: Value) -> Value {
    if accepts_null(root, property) && !matches!(shape(property), Shape::Any) {
        return strict;
    }
    if let Some(values) = strict.get_mut("enum").and_then(Value::as_array_mut) {
        values.push(Value::Null);
    }
    if let Some(options) = strict.get_mut("anyOf").and_then(Value::as_array_mut) {
        options.push(json!({"type": "null"}));
        return strict;
    }
    match strict.get("type").cloned() {
        Some(Value::Array(mut types)) => {
            types.push(json!("null"));
            strict["type"] = Value::Array(types);
            strict
        }
        Some(kind) => {
            strict["type"] = json!([kind, "null"]);
            strict
        }
        None => json!({"anyOf": [strict, {"type": "null"}]}),
    }
}

/// An answer in the form of the request's schema, from the form of [`strict`]. What does not look like that form is left
/// as it is: the check against the schema finds it.
pub fn from_wire(schema: &Value, answer: &Value) -> Value {
    let inner = wrapper(schema).and_then(|name| match answer.as_object() {
        Some(map) if map.len() == 1 => map.get(name),
        _ => None,
    });
    back(schema, schema, inner.unwrap_or(answer), 0)
}

fn back(root: &Value, node: &Value, value: &Value, depth: usize) -> Value {
    if depth > MAX_DEPTH {
        return value.clone();
    }
    let node = followed(root, node);
    let below = |node: &Value, value: &Value| back(root, node, value, depth + 1);
    match (shape(node), value) {
        (Shape::Any, Value::String(text)) => serde_json::from_str(text).unwrap_or_else(|_| value.clone()),
        (Shape::Choice(_), Value::Null) => Value::Null,
        (Shape::Choice(options), _) => {
            let candidates = options.iter().filter(|option| followed(root, option).get("type") != Some(&json!("null")));
            let candidates: Vec<&Value> = candidates.collect();
            if let [only] = candidates.as_slice() {
                return below(only, value);
            }
            let found = candidates.iter().map(|option| (option, below(option, value)));
            let mut found = found.filter(|(option, value)| fits(root, option, value));
            found.next().map_or_else(|| value.clone(), |(_, value)| value)
        }
        (Shape::FreeKeys(values), Value::Array(entries)) => {
            let mut out = Map::new();
            for entry in entries {
                let (Some(key), Some(value)) = (entry.get("key").and_then(Value::as_str), entry.get("value")) else {
                    return value.clone();
                };
                let value = match values {
                    Some(schema) => below(schema, value),
                    None => below(&Value::Bool(true), value),
                };
                out.insert(key.to_owned(), value);
            }
            Value::Object(out)
        }
        (Shape::Object(properties), Value::Object(given)) => {
            let required = required(node);
            let mut out = Map::new();
            for (name, value) in given {
                match properties.get(name) {
                    Some(property)
                        if value.is_null()
                            && !required.contains(&name.as_str())
                            && (!accepts_null(root, property) || matches!(shape(property), Shape::Any)) => {}
                    Some(property) => {
                        out.insert(name.clone(), below(property, value));
                    }
                    None => {
                        out.insert(name.clone(), value.clone());
                    }
                }
            }
            Value::Object(out)
        }
        (Shape::List, Value::Array(items)) => {
            let item = |(i, value)| place(node, i).map_or_else(|| Value::clone(value), |schema| below(schema, value));
            Value::Array(items.iter().enumerate().map(item).collect())
        }
        _ => value.clone(),
    }
}

/// A value that fits the request's schema in the form of [`strict`].
pub fn to_wire(schema: &Value, value: &Value) -> Value {
    let inner = forth(schema, schema, value, 0);
    match wrapper(schema) {
        Some(name) => json!({name: inner}),
        None => inner,
    }
}

fn forth(root: &Value, node: &Value, value: &Value, depth: usize) -> Value {
    if depth > MAX_DEPTH {
        return value.clone();
    }
    let node = followed(root, node);
    let below = |node: &Value, value: &Value| forth(root, node, value, depth + 1);
    match (shape(node), value) {
        (Shape::Any, _) => json!(value.to_string()),
        (Shape::Choice(options), _) => {
            let found = options.iter().find(|option| fits(root, option, value));
            found.map_or_else(|| value.clone(), |option| below(option, value))
        }
        (Shape::FreeKeys(values), Value::Object(entries)) => {
            let entry = |(key, value)| {
                let value = match values {
                    Some(schema) => below(schema, value),
                    None => below(&Value::Bool(true), value),
                };
                json!({"key": key, "value": value})
            };
            Value::Array(entries.iter().map(entry).collect())
        }
        (Shape::Object(properties), Value::Object(given)) => {
            let all = properties.iter().map(|(name, property)| {
                let value = given.get(name).map_or(Value::Null, |value| below(property, value));
                (name.clone(), value)
            });
            Value::Object(all.collect())
        }
        (Shape::List, Value::Array(items)) => {
            let item = |(i, value)| place(node, i).map_or_else(|| Value::clone(value), |schema| below(schema, value));
            Value::Array(items.iter().enumerate().map(item).collect())
        }
        _ => value.clone(),
    }
}

/// The schema of an item of a list.
fn place(node: &Value, index: usize) -> Option<&Value> {
    let fixed = node.get("prefixItems").and_then(|places| places.get(index));
    fixed.or_else(|| node.get("items")).filter(|schema| !schema.is_boolean())
}

/// Whether a value fits a part of a schema.
fn fits(root: &Value, node: &Value, value: &Value) -> bool {
    let mut schema = followed(root, node).clone();
    if let Some(map) = schema.as_object_mut() {
        for key in ["$defs", "definitions"] {
            if let Some(defs) = root.get(key) {
                map.insert(key.to_owned(), defs.clone());
            }
        }
    }
    schema_complaints(&schema, value).is_empty()
}

/// How large a schema is, in the measures that OpenAI limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SchemaSize {
    /// Properties of all objects together; at most 5000.
    pub properties: usize,
    /// Enum values of all enums together; at most 1000.
    pub enum_values: usize,
    /// Characters of all names and enum values; at most 120 000.
    pub characters: usize,
    /// Objects in lists in objects, references not followed; at most 10.
    pub nesting: usize,
}

/// Measures a schema.
pub fn size_of(schema: &Value) -> SchemaSize {
    fn walk(node: &Value, depth: usize, size: &mut SchemaSize) {
        match node {
            Value::Object(map) => {
                let own = usize::from(map.get("properties").is_some_and(Value::is_object));
                size.nesting = size.nesting.max(depth + own);
                if let Some(properties) = map.get("properties").and_then(Value::as_object) {
                    size.properties += properties.len();
                    size.characters += properties.keys().map(String::len).sum::<usize>();
                }
                for value in map.get("enum").and_then(Value::as_array).into_iter().flatten() {
                    size.enum_values += 1;
                    size.characters += value.as_str().map_or(0, str::len);
                }
                for (key, value) in map {
                    if key != "enum" {
                        let depth = if key == "$defs" { 0 } else { depth + own };
                        walk(value, depth, size);
                    }
                }
            }
            Value::Array(items) => items.iter().for_each(|item| walk(item, depth, size)),
            _ => {}
        }
    }
    let mut size = SchemaSize::default();
    walk(schema, 0, &mut size);
    size
}

#[cfg(test)]
mod tests;
