//! Gemini: `POST /v1beta/models/{model}:generateContent`.

use serde_json::{Value, json};

use super::{Asked, ModelSettings, Reply, Trouble, count, cut_off, with_extra};
use crate::http::Tokens;

/// Path below the base address.
pub fn path(model: &str) -> String {
    format!("/models/{model}:generateContent")
}

/// The request's body.
pub fn body(asked: &Asked, settings: &ModelSettings) -> Value {
    let mut parts = Vec::new();
    for picture in &asked.pictures {
        parts.push(json!({"text": picture.caption}));
        parts.push(json!({"inlineData": {"mimeType": picture.media_type, "data": picture.base64}}));
    }
    parts.push(json!({"text": asked.prompt}));
    let mut generation = json!({
        "responseMimeType": "application/json",
        "responseJsonSchema": asked.schema,
    });
    if let Some(most) = settings.max_output_tokens {
        generation["maxOutputTokens"] = json!(most);
    }
    if let Some(seed) = settings.seed {
        generation["seed"] = json!(seed);
    }
    if let Some(temperature) = settings.temperature {
        generation["temperature"] = json!(temperature);
    }
    if let Some(effort) = &settings.reasoning_effort {
        // Models of 2.5 count thoughts in tokens, later ones have levels.
        generation["thinkingConfig"] = match effort.parse::<i64>() {
            Ok(budget) => json!({"thinkingBudget": budget}),
            Err(_) => json!({"thinkingLevel": effort}),
        };
    }
    let body = json!({
        "systemInstruction": {"parts": [{"text": asked.system}]},
        "contents": [{"role": "user", "parts": parts}],
        "generationConfig": generation,
    });
    with_extra(body, settings)
}

/// Tokens of an answer, whole or not. Thoughts are counted beside the answer, and paid like it.
pub fn tokens(body: &Value) -> Tokens {
    Tokens {
        input: count(body, "/usageMetadata/promptTokenCount"),
        cached: count(body, "/usageMetadata/cachedContentTokenCount"),
        output: count(body, "/usageMetadata/candidatesTokenCount") + count(body, "/usageMetadata/thoughtsTokenCount"),
    }
}

/// Why there is no answer, when it was declined: the block reason of the prompt or the finish reason of the candidate.
pub fn declined(body: &Value) -> Option<String> {
    if let Some(reason) = body.pointer("/promptFeedback/blockReason").and_then(Value::as_str) {
        return Some(format!("the prompt was blocked: {reason}"));
    }
    let finish = body.pointer("/candidates/0/finishReason").and_then(Value::as_str)?;
    let declines = [
        "SAFETY",
        "RECITATION",
        "BLOCKLIST",
        "PROHIBITED_CONTENT",
        "SPII",
        "IMAGE_SAFETY",
        "IMAGE_PROHIBITED_CONTENT",
        "IMAGE_RECITATION",
        "LANGUAGE",
    ];
    declines.contains(&finish).then(|| {
        let words = body.pointer("/candidates/0/finishMessage").and_then(Value::as_str).unwrap_or_default();
        format!("{finish} {words}").trim().to_owned()
    })
}

/// Reads an answer.
///
/// # Errors
/// [`Trouble`].
pub fn read(body: &Value) -> Result<Reply, Trouble> {
    if let Some(reason) = declined(body) {
        return Err(Trouble::Refused(reason));
    }
    let tokens = tokens(body);
    let Some(candidate) = body.pointer("/candidates/0") else {
        return Err(Trouble::NotUnderstood("there is no `candidates`".to_owned()));
    };
    let parts = candidate.pointer("/content/parts").and_then(Value::as_array).into_iter().flatten();
    let spoken = parts.filter(|part| part.get("thought").and_then(Value::as_bool) != Some(true));
    let text: String = spoken.filter_map(|part| part.get("text")?.as_str()).collect();
    match candidate.get("finishReason").and_then(Value::as_str) {
        Some("MAX_TOKENS") => Err(cut_off("MAX_TOKENS", &text, tokens)),
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
        insta::assert_json_snapshot!(body(&samples::asked(), &samples::settings("gemini-3.6-flash")));
        assert_eq!(path("gemini-3.6-flash"), "/models/gemini-3.6-flash:generateContent");
        let mut settings = samples::settings("gemini-2.5-pro");
        settings.reasoning_effort = Some("512".into());
        let config = &body(&samples::asked(), &settings)["generationConfig"]["thinkingConfig"];
        assert_eq!(*config, json!({"thinkingBudget": 512}));
    }

    #[test]
    fn text_is_read_without_thoughts_and_thoughts_are_paid() {
        let answer = json!({
            "candidates": [{"content": {"parts": [{"text": "hm", "thought": true}, {"text": "{\"a\""}, {"text": ":1}"}]},
                            "finishReason": "STOP"}],
            "usageMetadata": {"promptTokenCount": 300, "candidatesTokenCount": 12, "thoughtsTokenCount": 80,
                              "cachedContentTokenCount": 256, "totalTokenCount": 392},
        });
        let reply = read(&answer).unwrap();
        assert_eq!(reply, Reply { text: "{\"a\":1}".into(), tokens: Tokens { input: 300, cached: 256, output: 92 } });
    }

    #[test]
    fn blocks_and_cuts_are_told_apart() {
        let blocked = json!({"promptFeedback": {"blockReason": "PROHIBITED_CONTENT"}});
        assert!(matches!(read(&blocked), Err(Trouble::Refused(text)) if text.contains("PROHIBITED_CONTENT")));
        let finish =
            |reason: &str| json!({"candidates": [{"content": {"parts": [{"text": "{"}]}, "finishReason": reason}]});
        assert!(matches!(read(&finish("SAFETY")), Err(Trouble::Refused(_))));
        assert!(matches!(read(&finish("RECITATION")), Err(Trouble::Refused(_))));
        assert!(matches!(read(&finish("MAX_TOKENS")), Err(Trouble::CutOff(_))));
        for odd in [json!({}), json!({"candidates": []}), json!({"candidates": [{}]})] {
            assert!(matches!(read(&odd), Err(Trouble::NotUnderstood(_))), "{odd}");
        }
    }
}
