//! Answers of models are untrusted: is this JSON, does it fit the schema, and if not, what is wrong in words.

use serde_json::Value;

/// Most complaints listed at once.
const MAX_COMPLAINTS: usize = 12;

/// Longest complaint, characters.
const MAX_COMPLAINT: usize = 240;

/// Largest text that is read as an answer, bytes.
pub const MAX_ANSWER_BYTES: usize = 8 << 20;

/// What does not fit a JSON Schema, one line a misfit with the place in the answer; empty = it fits.
///
/// A schema that is itself broken is reported like a misfit: an answer can't be accepted without one.
pub fn schema_complaints(schema: &Value, answer: &Value) -> Vec<String> {
    let validator = match jsonschema::validator_for(schema) {
        Ok(validator) => validator,
        Err(error) => return vec![shortened(&format!("the schema itself is broken: {error}"), MAX_COMPLAINT)],
    };
    let mut complaints: Vec<String> = Vec::new();
    let mut more = 0_usize;
    for error in validator.iter_errors(answer) {
        if complaints.len() == MAX_COMPLAINTS {
            more += 1;
            continue;
        }
        let path = error.instance_path().to_string();
        let place = if path.is_empty() { "the answer as a whole".to_owned() } else { format!("at {path}") };
        complaints.push(shortened(&format!("{place}: {error}"), MAX_COMPLAINT));
    }
    if more > 0 {
        complaints.push(format!("and {more} more"));
    }
    complaints
}

/// Reads a text as JSON, forgiving what is plainly meant: a byte-order mark, a fenced code block, words before and
/// after one JSON object, and commas before a closing bracket.
///
/// # Errors
/// A complaint in words with line and column.
pub fn parse_answer(text: &str) -> Result<Value, String> {
    if text.len() > MAX_ANSWER_BYTES {
        return Err(format!("the answer has {} bytes; at most {MAX_ANSWER_BYTES} are read", text.len()));
    }
    let text = text.trim_start_matches('\u{feff}').trim();
    if text.is_empty() {
        return Err("the answer is empty; it must be one JSON object".to_owned());
    }
    let first = match serde_json::from_str::<Value>(text) {
        Ok(value) => return Ok(value),
        Err(error) => error,
    };
    let mut candidates = Vec::new();
    candidates.extend(fenced(text));
    candidates.extend(outermost_object(text));
    candidates.push(text);
    for candidate in candidates {
        if let Ok(value) = serde_json::from_str(candidate) {
            return Ok(value);
        }
        if let Ok(value) = serde_json::from_str(&without_trailing_commas(candidate)) {
            return Ok(value);
        }
    }
    Err(format!("the answer is not JSON: {first}"))
}

/// The content of the first fenced code block.
fn fenced(text: &str) -> Option<&str> {
    let open = text.find("```")?;
    let rest = &text[open + 3..];
    let body = &rest[rest.find('\n')? + 1..];
    Some(body[..body.find("```")?].trim())
}

/// From the first opening brace to the last closing one.
fn outermost_object(text: &str) -> Option<&str> {
    let (open, close) = (text.find('{')?, text.rfind('}')?);
    (open < close).then(|| &text[open..=close])
}

/// Drops commas that stand before a closing bracket, outside of strings.
fn without_trailing_commas(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut in_string = false;
    let mut escaped = false;
    for (i, c) in text.char_indices() {
        if in_string {
            in_string = escaped || c != '"';
            escaped = !escaped && c == '\\';
        } else if c == '"' {
            in_string = true;
        } else if c == ',' && text[i + 1..].trim_start().starts_with(['}', ']']) {
            continue;
        }
        out.push(c);
    }
    out
}

/// At most `limit` characters, with a mark where something was cut.
pub fn shortened(text: &str, limit: usize) -> String {
    if text.chars().count() <= limit {
        return text.to_owned();
    }
    let mut short: String = text.chars().take(limit.saturating_sub(4)).collect();
    short.push_str(" ...");
    short
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn plainly_meant_json_is_read() {
        let want = json!({"a": [1, 2], "b": "x, ]"});
        for text in [
            r#"{"a": [1, 2], "b": "x, ]"}"#,
            "\u{feff} {\"a\": [1, 2], \"b\": \"x, ]\"}\n",
            "Here it is:\n```json\n{\"a\": [1, 2,], \"b\": \"x, ]\",}\n```\nDone.",
            "Sure! {\"a\": [1, 2], \"b\": \"x, ]\"} Anything else?",
            "{\"a\": [1, 2 , ], \"b\": \"x, ]\" ,\n }",
        ] {
            assert_eq!(parse_answer(text).as_ref(), Ok(&want), "{text}");
        }
    }

    #[test]
    fn what_is_not_json_gets_a_complaint_with_a_place() {
        for text in ["", "no", "{\"a\": NaN}", "{\"a\": 1", "{\"a\": 1e999}", &"[".repeat(10_000), "```", "}{"] {
            assert!(parse_answer(text).is_err(), "{}", shortened(text, 20));
        }
        assert!(parse_answer("{\"a\":\n  oops}").unwrap_err().contains("line 2"));
    }

    #[test]
    fn misfits_are_listed_with_their_place_and_bounded() {
        let schema = json!({
            "type": "object",
            "properties": {"items": {"type": "array", "items": {"type": "number"}}},
            "required": ["items"],
            "additionalProperties": false
        });
        assert!(schema_complaints(&schema, &json!({"items": [1, 2]})).is_empty());
        let wrong = schema_complaints(&schema, &json!({"items": [1, "two"]}));
        assert_eq!(wrong.len(), 1);
        assert!(wrong[0].contains("/items/1") && wrong[0].contains("number"), "{wrong:?}");
        let hostile = json!({"items": vec!["x".repeat(1000); 10_000]});
        let many = schema_complaints(&schema, &hostile);
        assert_eq!(many.len(), MAX_COMPLAINTS + 1);
        assert!(many.iter().all(|c| c.chars().count() <= MAX_COMPLAINT));
        assert!(!schema_complaints(&schema, &json!([1])).is_empty());
        assert!(!schema_complaints(&json!({"type": 7}), &json!(1)).is_empty());
    }
}
