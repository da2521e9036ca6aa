//! OpenAI's Responses: `POST /v1/responses`.
//!
//! Differs from chat completions: pictures are plain strings, the schema lies flat in `text.format`, answers are kept by
//! the service unless `store` is false.

use serde_json::{Value, json};

use super::{Asked, ModelSettings, Reply, Trouble, count, cut_off, with_extra};
use crate::http::Tokens;

/// Path below the base address.
pub const PATH: &str = "/responses";

/// The request's body.
pub fn body(asked: &Asked, settings: &ModelSettings) -> Value {
    let mut content = Vec::new();
    for picture in &asked.pictures {
        content.push(json!({"type": "input_text", "text": picture.caption}));
        content.push(json!({"type": "input_image", "image_url": picture.data_url(), "detail": settings.detail}));
    }
    content.push(json!({"type": "input_text", "text": asked.prompt}));
    let mut body = json!({
        "model": settings.model,
        "instructions": asked.system,
        "input": [{"role": "user", "content": content}],
        "text": {"format": {
            "type": "json_schema", "name": asked.schema_name, "schema": asked.schema, "strict": true,
        }},
        "store": false,
    });
    if let Some(effort) = &settings.reasoning_effort {
        body["reasoning"] = json!({"effort": effort});
    }
    if let Some(most) = settings.max_output_tokens {
        body["max_output_tokens"] = json!(most);
    }
    if let Some(temperature) = settings.temperature {
        body["temperature"] = json!(temperature);
    }
    with_extra(body, settings)
}

/// Tokens of an answer, whole or not.
pub fn tokens(body: &Value) -> Tokens {
    Tokens {
        input: count(body, "/usage/input_tokens"),
        cached: count(body, "/usage/input_tokens_details/cached_tokens"),
        output: count(body, "/usage/output_tokens"),
    }
}

/// Reads an answer.
///
/// # Errors
/// [`Trouble`].
pub fn read(body: &Value) -> Result<Reply, Trouble> {
    let Some(output) = body.get("output").and_then(Value::as_array) else {
        return Err(Trouble::NotUnderstood("there is no `output`".to_owned()));
    };
    let tokens = tokens(body);
    let mut text = String::new();
    let messages = output.iter().filter(|item| item.get("type").and_then(Value::as_str) == Some("message"));
    for part in messages.filter_map(|message| message.get("content")?.as_array()).flatten() {
        match part.get("type").and_then(Value::as_str) {
            Some("refusal") => {
                let reason = part.get("refusal").and_then(Value::as_str).unwrap_or("no reason given");
                return Err(Trouble::Refused(reason.to_owned()));
            }
            Some("output_text") => text.push_str(part.get("text").and_then(Value::as_str).unwrap_or_default()),
            _ => {}
        }
    }
    match body.get("status").and_then(Value::as_str) {
        Some("incomplete") => {
            let reason =
                body.pointer("/incomplete_details/reason").and_then(Value::as_str).unwrap_or("no reason given");
            Err(if reason == "content_filter" {
                Trouble::Refused("a content filter stopped the answer".to_owned())
            } else {
                cut_off(reason, &text, tokens)
            })
        }
        Some("failed" | "cancelled") => {
            let reason = body.pointer("/error/message").and_then(Value::as_str).unwrap_or("no reason given");
            Err(Trouble::Failed(reason.to_owned()))
        }
        _ if text.is_empty() => Err(Trouble::NotUnderstood("there is no text in the answer".to_owned())),
        _ => Ok(Reply { text, tokens }),
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    fn answer(content: &Value) -> Value {
        json!({
            "status": "completed",
            "output": [{"type": "reasoning", "summary": []}, {"type": "message", "content": [content]}],
            "usage": {"input_tokens": 900, "input_tokens_details": {"cached_tokens": 100}, "output_tokens": 50},
        })
    }

    #[test]
    fn the_request_is_as_the_service_wants_it() {
        insta::assert_json_snapshot!(body(&samples::asked(), &samples::settings("gpt-5.5")));
    }

    #[test]
    fn text_and_tokens_are_read() {
        let reply = read(&answer(&json!({"type": "output_text", "text": "{\"width_m\": 4}"}))).unwrap();
        assert_eq!(reply.text, "{\"width_m\": 4}");
        assert_eq!(reply.tokens, Tokens { input: 900, cached: 100, output: 50 });
    }

    #[test]
    fn refusals_cuts_and_failures_are_told_apart() {
        let refusal = answer(&json!({"type": "refusal", "refusal": "I can't"}));
        assert_eq!(read(&refusal), Err(Trouble::Refused("I can't".into())));
        let mut cut = answer(&json!({"type": "output_text", "text": "{\"wid"}));
        cut["status"] = json!("incomplete");
        cut["incomplete_details"] = json!({"reason": "max_output_tokens"});
        assert!(matches!(read(&cut), Err(Trouble::CutOff(text)) if text.contains("max_output_tokens after 50")));
        cut["incomplete_details"]["reason"] = json!("content_filter");
        assert!(matches!(read(&cut), Err(Trouble::Refused(_))));
        let failed = json!({"status": "failed", "output": [], "error": {"message": "oops"}});
        assert_eq!(read(&failed), Err(Trouble::Failed("oops".into())));
        let thought_only = json!({"status": "incomplete", "output": [{"type": "reasoning"}],
            "incomplete_details": {"reason": "max_output_tokens"}});
        assert!(matches!(read(&thought_only), Err(Trouble::CutOff(text)) if text.contains("nothing was left")));
        for odd in [json!({}), json!([]), json!({"output": []}), json!({"output": 7}), answer(&json!(7))] {
            assert!(matches!(read(&odd), Err(Trouble::NotUnderstood(_))), "{odd}");
        }
    }
}
