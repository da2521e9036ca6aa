//! Anthropic's Messages: `POST /v1/messages`.

use serde_json::{Value, json};

use super::{Asked, ModelSettings, Reply, Trouble, count, cut_off, with_extra};
use crate::http::Tokens;

/// Path below the base address.
pub const PATH: &str = "/messages";

/// Header that names the version of the format.
pub const VERSION: (&str, &str) = ("anthropic-version", "2023-06-01");

/// The service wants a limit on every answer.
const MAX_TOKENS: u32 = 32_000;

/// The request's body.
pub fn body(asked: &Asked, settings: &ModelSettings) -> Value {
    let mut content = Vec::new();
    for picture in &asked.pictures {
        content.push(json!({"type": "text", "text": picture.caption}));
        content.push(json!({"type": "image", "source": {
            "type": "base64", "media_type": picture.media_type, "data": picture.base64,
        }}));
    }
    content.push(json!({"type": "text", "text": asked.prompt}));
    let mut output = json!({"format": {"type": "json_schema", "schema": asked.schema}});
    if let Some(effort) = &settings.reasoning_effort {
        output["effort"] = json!(effort);
    }
    let mut body = json!({
        "model": settings.model,
        "max_tokens": settings.max_output_tokens.unwrap_or(MAX_TOKENS),
        "system": asked.system,
        "messages": [{"role": "user", "content": content}],
        "output_config": output,
    });
    if let Some(temperature) = settings.temperature {
        body["temperature"] = json!(temperature);
    }
    with_extra(body, settings)
}

/// Tokens of an answer, whole or not. The service counts cached input beside the rest.
pub fn tokens(body: &Value) -> Tokens {
    let cached = count(body, "/usage/cache_read_input_tokens");
    let written = count(body, "/usage/cache_creation_input_tokens");
    Tokens {
        input: count(body, "/usage/input_tokens") + cached + written,
        cached,
        output: count(body, "/usage/output_tokens"),
    }
}

/// Reads an answer.
///
/// # Errors
/// [`Trouble`].
pub fn read(body: &Value) -> Result<Reply, Trouble> {
    let Some(content) = body.get("content").and_then(Value::as_array) else {
        return Err(Trouble::NotUnderstood("there is no `content`".to_owned()));
    };
    let tokens = tokens(body);
    let texts = content.iter().filter(|block| block.get("type").and_then(Value::as_str) == Some("text"));
    let text: String = texts.filter_map(|block| block.get("text")?.as_str()).collect();
    match body.get("stop_reason").and_then(Value::as_str) {
        Some("refusal") => {
            let words = if text.trim().is_empty() { "no reason given" } else { text.trim() };
            Err(Trouble::Refused(words.to_owned()))
        }
        Some(reason @ ("max_tokens" | "model_context_window_exceeded")) => Err(cut_off(reason, &text, tokens)),
        _ if text.trim().is_empty() => Err(Trouble::NotUnderstood("there is no text in the answer".to_owned())),
        _ => Ok(Reply { text, tokens }),
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    #[test]
    fn the_request_is_as_the_service_wants_it() {
        insta::assert_json_snapshot!(body(&samples::asked(), &samples::settings("some-claude")));
        let mut settings = samples::settings("some-claude");
        settings.max_output_tokens = None;
        assert_eq!(body(&samples::asked(), &settings)["max_tokens"], json!(MAX_TOKENS), "it may not be left out");
    }

    fn answer(stop: &str, text: &str) -> Value {
        json!({"type": "message", "content": [{"type": "thinking", "thinking": "hm"}, {"type": "text", "text": text}],
               "stop_reason": stop,
               "usage": {"input_tokens": 20, "cache_read_input_tokens": 1000, "cache_creation_input_tokens": 30, "output_tokens": 8}})
    }

    #[test]
    fn text_is_read_and_cached_input_counts_as_input() {
        let reply = read(&answer("end_turn", "{}")).unwrap();
        assert_eq!(reply, Reply { text: "{}".into(), tokens: Tokens { input: 1050, cached: 1000, output: 8 } });
    }

    #[test]
    fn refusals_and_cuts_are_told_apart() {
        assert_eq!(read(&answer("refusal", "I won't")), Err(Trouble::Refused("I won't".into())));
        assert!(matches!(read(&answer("max_tokens", "{\"a\"")), Err(Trouble::CutOff(_))));
        for odd in [json!({}), json!({"content": []}), answer("end_turn", " "), json!({"content": "text"})] {
            assert!(matches!(read(&odd), Err(Trouble::NotUnderstood(_))), "{odd}");
        }
    }
}
