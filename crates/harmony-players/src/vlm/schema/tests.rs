use super::*;

fn object(properties: &Value, required: &Value) -> Value {
    json!({"type": "object", "properties": properties, "required": required, "additionalProperties": false})
}

/// Whether a schema obeys the rules of a strict mode, everywhere.
fn assert_strict(node: &Value) {
    match node {
        Value::Object(map) => {
            if let Some(properties) = map.get("properties").and_then(Value::as_object) {
                let names: Vec<&Value> = map["required"].as_array().unwrap().iter().collect();
                assert_eq!(names.len(), properties.len(), "{node}");
                assert_eq!(map["additionalProperties"], json!(false), "{node}");
            }
            for keyword in NARROWING.iter().chain(&["default", "oneOf", "allOf", "const", "title", "prefixItems"]) {
                assert!(!map.contains_key(*keyword) || map.contains_key("properties"), "{keyword} in {node}");
            }
            if map.contains_key("$ref") {
                assert_eq!(map.len(), 1, "{node}");
            }
            for (key, value) in map {
                if key == "properties" || key == "$defs" {
                    value.as_object().unwrap().values().for_each(assert_strict);
                } else if key != "enum" {
                    assert_strict(value);
                }
            }
        }
        Value::Array(items) => items.iter().for_each(assert_strict),
        _ => {}
    }
}

fn round_trip(schema: &Value, value: &Value) {
    assert!(schema_complaints(schema, value).is_empty(), "the test's own value does not fit");
    let strict = strict(schema, Dialect::STRICT);
    assert_strict(&strict);
    assert_eq!(strict["type"], "object", "the root");
    let wire = to_wire(schema, value);
    let complaints = schema_complaints(&strict, &wire);
    assert!(complaints.is_empty(), "{complaints:?}: {wire}");
    assert_eq!(&from_wire(schema, &wire), value);
}

#[test]
fn a_bare_list_is_wrapped_and_unwrapped() {
    let schema = json!({"type": "array", "items": {"type": "string", "minLength": 1}});
    round_trip(&schema, &json!(["sofa", "lamp"]));
    let strict = strict(&schema, Dialect::STRICT);
    assert_eq!(strict["properties"]["items"]["type"], "array");
    assert_eq!(from_wire(&schema, &json!(["sofa"])), json!(["sofa"]), "one that forgot to wrap it");
    round_trip(&json!({"type": "number"}), &json!(3.5));
    round_trip(&json!({"anyOf": [{"type": "number"}, {"type": "string"}]}), &json!("x"));
}

#[test]
fn free_keys_become_a_list_and_a_map_again() {
    // The paper's physics prompt: an object keyed by label.
    let entry = object(&json!({"mass_kg": {"type": "number"}, "friction": {"type": "number"}}), &json!(["mass_kg"]));
    let schema = json!({"type": "object", "additionalProperties": entry});
    round_trip(&schema, &json!({"sofa": {"mass_kg": 40.0, "friction": 0.6}, "lamp": {"mass_kg": 2.0}}));
    let wire = to_wire(&schema, &json!({"lamp": {"mass_kg": 2.0}}));
    assert_eq!(wire, json!({"answer": [{"key": "lamp", "value": {"mass_kg": 2.0, "friction": null}}]}));
    let nested = object(
        &json!({"by_label": {"type": ["object", "null"], "additionalProperties": {"type": "number"}}}),
        &json!(["by_label"]),
    );
    round_trip(&nested, &json!({"by_label": {"a": 1.0}}));
    round_trip(&nested, &json!({"by_label": null}));
}

#[test]
fn what_may_be_left_out_is_null_on_the_wire_and_left_out_again() {
    let schema = object(
        &json!({
            "id": {"type": "string"},
            "hint": {"type": "string", "default": ""},
            "kind": {"enum": ["a", "b"]},
            "host": {"type": ["string", "null"]},
            "size": {"$ref": "#/$defs/Size"},
            "any": true,
        }),
        &json!(["id"]),
    );
    let mut schema = schema;
    schema["$defs"] = json!({"Size": object(&json!({"w": {"type": "number", "minimum": 0.0}}), &json!(["w"]))});
    round_trip(&schema, &json!({"id": "x", "host": null}));
    round_trip(
        &schema,
        &json!({"id": "x", "hint": "h", "kind": "b", "host": "t", "size": {"w": 2.0}, "any": {"q": [1]}}),
    );
    let strict = strict(&schema, Dialect::STRICT);
    assert_eq!(strict["properties"]["kind"]["enum"], json!(["a", "b", null]));
    assert_eq!(strict["properties"]["size"], json!({"anyOf": [{"$ref": "#/$defs/Size"}, {"type": "null"}]}));
    assert_eq!(strict["$defs"]["Size"]["properties"]["w"], json!({"type": "number", "description": "(minimum 0.0)"}));
    let gemini = super::strict(&schema, Dialect::GEMINI);
    assert_eq!(gemini["$defs"]["Size"]["properties"]["w"], json!({"type": "number", "minimum": 0.0}));
}

#[test]
fn choices_keep_their_words_and_the_right_branch_is_restored() {
    let words = json!({"oneOf": [
        {"type": "string", "const": "keep", "description": "leave it"},
        {"type": "string", "const": "move", "description": "shift it"}]});
    let schema = object(
        &json!({
            "action": words,
            "what": {"anyOf": [
                object(&json!({"m": {"type": "object", "additionalProperties": {"type": "number"}}}), &json!(["m"])),
                object(&json!({"n": {"type": "number"}}), &json!([])),
                {"type": "null"}]},
            "pair": {"type": "array", "prefixItems": [{"type": "number"}, {"type": "string"}], "minItems": 2, "maxItems": 2},
        }),
        &json!(["action", "what", "pair"]),
    );
    for what in [json!({"m": {"a": 1.0}}), json!({"n": 2.0}), json!({}), json!(null)] {
        round_trip(&schema, &json!({"action": "move", "what": what, "pair": [1.0, "x"]}));
    }
    let strict = strict(&schema, Dialect::STRICT);
    assert_eq!(strict["properties"]["action"]["enum"], json!(["keep", "move"]));
    assert!(strict["properties"]["action"]["description"].as_str().unwrap().contains("move: shift it"));
}

#[test]
fn schemas_that_refer_to_themselves_are_followed_by_value_only() {
    let schema = json!({
        "$ref": "#/$defs/Node",
        "$defs": {"Node": object(&json!({"name": {"type": "string"}, "children": {"type": "array", "items": {"$ref": "#/$defs/Node"}}}), &json!(["name"]))},
    });
    round_trip(&schema, &json!({"name": "a", "children": [{"name": "b"}, {"name": "c", "children": []}]}));
    let endless = json!({"$ref": "#/$defs/A", "$defs": {"A": {"$ref": "#/$defs/A"}}});
    assert_eq!(from_wire(&endless, &json!(1)), json!(1));
    let _ = strict(&endless, Dialect::STRICT);
}

#[test]
fn an_answer_of_another_form_is_left_for_the_check() {
    let schema = object(&json!({"m": {"type": "object", "additionalProperties": {"type": "number"}}}), &json!(["m"]));
    for odd in [json!([1]), json!("text"), json!({"m": [{"k": 1}]}), json!({"m": 7, "extra": 1}), json!(null)] {
        assert_eq!(from_wire(&schema, &odd), odd);
    }
    assert_eq!(from_wire(&schema, &json!({"m": {"a": 1.0}})), json!({"m": {"a": 1.0}}), "a map given as a map");
}
