//! Chat completions, OpenAI's and of all servers that speak like it: `POST /v1/chat/completions`.
//!
//! Servers differ where the format is silent; [`Server`] names them, [`Server::from_models`] tells them apart.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Asked, ModelSettings, Reply, Trouble, count, cut_off, with_extra};
use crate::http::Tokens;

/// Path below the base address.
pub const PATH: &str = "/chat/completions";

/// Who speaks chat completions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Server {
    /// OpenAI itself.
    #[serde(rename = "openai")]
    OpenAi,
    /// vLLM.
    Vllm,
    /// `llama-server` of llama.cpp.
    LlamaCpp,
    /// Ollama.
    Ollama,
    /// mistral.rs.
    MistralRs,
    /// Somebody else; only what all understand is sent.
    Other,
}

impl Server {
    /// Tells who answers from the list of models (`GET /v1/models`) and the `server` header.
    pub fn from_models(models: &Value, header: Option<&str>) -> Self {
        let owner = models.pointer("/data/0/owned_by").and_then(Value::as_str).unwrap_or_default();
        let header = header.unwrap_or_default().to_ascii_lowercase();
        match owner.to_ascii_lowercase().as_str() {
            "vllm" => Self::Vllm,
            "llamacpp" => Self::LlamaCpp,
            "library" => Self::Ollama,
            "local" => Self::MistralRs,
            _ if header.contains("llama.cpp") => Self::LlamaCpp,
            _ => Self::Other,
        }
    }
}

/// The request's body.
pub fn body(asked: &Asked, settings: &ModelSettings, server: Server) -> Value {
    let mut content = Vec::new();
    for picture in &asked.pictures {
        content.push(json!({"type": "text", "text": picture.caption}));
        let mut url = json!({"url": picture.data_url()});
        if server == Server::OpenAi {
            url["detail"] = json!(settings.detail);
        }
        content.push(json!({"type": "image_url", "image_url": url}));
    }
    content.push(json!({"type": "text", "text": asked.prompt}));
    let mut body = json!({
        "model": settings.model,
        "messages": [{"role": "system", "content": asked.system}, {"role": "user", "content": content}],
        // The nested form: llama.cpp lets a flat one pass without constraining anything.
        "response_format": {"type": "json_schema", "json_schema": {
            "name": asked.schema_name, "schema": asked.schema, "strict": true,
        }},
    });
    if let Some(most) = settings.max_output_tokens {
        // OpenAI's reasoning models refuse `max_tokens`, local servers may not know the other.
        let name = if server == Server::OpenAi { "max_completion_tokens" } else { "max_tokens" };
        body[name] = json!(most);
    }
    if let (Some(seed), true) = (settings.seed, server != Server::MistralRs) {
        body["seed"] = json!(seed);
    }
    if let Some(temperature) = settings.temperature {
        body["temperature"] = json!(temperature);
    }
    match (&settings.reasoning_effort, server) {
        // Thinking before constrained JSON goes wrong on many servers: it is off unless asked for.
        (None, Server::Vllm | Server::LlamaCpp) => body["chat_template_kwargs"] = json!({"enable_thinking": false}),
        (None, Server::MistralRs) => body["enable_thinking"] = json!(false),
        (None, Server::Ollama) => body["reasoning_effort"] = json!("none"),
        (None, Server::OpenAi | Server::Other) => {}
        (Some(effort), _) => body["reasoning_effort"] = json!(effort),
    }
    with_extra(body, settings)
}

/// Tokens of an answer, whole or not.
pub fn tokens(body: &Value) -> Tokens {
    Tokens {
        input: count(body, "/usage/prompt_tokens"),
        cached: count(body, "/usage/prompt_tokens_details/cached_tokens"),
        output: count(body, "/usage/completion_tokens"),
    }
}

/// Reads an answer.
///
/// # Errors
/// [`Trouble`].
pub fn read(body: &Value) -> Result<Reply, Trouble> {
    let Some(choice) = body.pointer("/choices/0") else {
        return Err(Trouble::NotUnderstood("there is no `choices`".to_owned()));
    };
    if let Some(refusal) = choice.pointer("/message/refusal").and_then(Value::as_str).filter(|r| !r.is_empty()) {
        return Err(Trouble::Refused(refusal.to_owned()));
    }
    let tokens = tokens(body);
    let text = match choice.pointer("/message/content") {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Array(parts)) => parts.iter().filter_map(|part| part.get("text")?.as_str()).collect(),
        _ => String::new(),
    };
    let text = without_thoughts(&text).to_owned();
    match choice.get("finish_reason").and_then(Value::as_str) {
        Some("content_filter") => Err(Trouble::Refused("a content filter stopped the answer".to_owned())),
        Some("length") => Err(cut_off("length", &text, tokens)),
        _ if text.trim().is_empty() => Err(Trouble::NotUnderstood("there is no text in the answer".to_owned())),
        _ => Ok(Reply { text, tokens }),
    }
}

/// The text after a model's thoughts, where a server leaves them in.
fn without_thoughts(text: &str) -> &str {
    let begins = text.trim_start().starts_with("<think>") || !text.contains("<think>");
    match text.find("</think>") {
        Some(end) if begins => &text[end + "</think>".len()..],
        _ => text,
    }
}

/// Whether a server has cut the prompt without saying so: it counts far fewer tokens than the text alone has. Some
/// servers (Ollama) do, when the prompt is larger than the context they were started with.
pub fn prompt_was_cut(asked: &Asked, tokens: Tokens) -> Option<String> {
    // No tokeniser makes fewer than one token of eight characters of such prompts.
    let least = (asked.prompt.chars().count() / 8) as u64;
    (tokens.input > 0 && tokens.input < least).then(|| {
        format!("the server read {} tokens of a prompt of more than {least}: it cuts long prompts", tokens.input)
    })
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    const SERVERS: [(&str, Server); 6] = [
        ("openai", Server::OpenAi),
        ("vllm", Server::Vllm),
        ("llama_cpp", Server::LlamaCpp),
        ("ollama", Server::Ollama),
        ("mistral_rs", Server::MistralRs),
        ("other", Server::Other),
    ];

    #[test]
    fn each_server_gets_its_request() {
        for (name, server) in SERVERS {
            let mut settings = samples::settings("some-model");
            if server != Server::OpenAi {
                settings.reasoning_effort = None;
            }
            insta::assert_json_snapshot!(name, body(&samples::asked(), &settings, server));
            assert_eq!(serde_json::to_value(server).unwrap(), json!(name));
        }
    }

    #[test]
    fn further_properties_win() {
        let mut settings = samples::settings("m");
        settings.extra.insert("top_k".into(), json!(20));
        settings.extra.insert("seed".into(), json!(1));
        let body = body(&samples::asked(), &settings, Server::Vllm);
        assert_eq!((&body["top_k"], &body["seed"]), (&json!(20), &json!(1)));
    }

    #[test]
    fn servers_are_told_apart_by_their_models() {
        let models = |owner: &str| json!({"object": "list", "data": [{"id": "m", "owned_by": owner}]});
        assert_eq!(Server::from_models(&models("vllm"), None), Server::Vllm);
        assert_eq!(Server::from_models(&models("llamacpp"), None), Server::LlamaCpp);
        assert_eq!(Server::from_models(&models("library"), None), Server::Ollama);
        assert_eq!(Server::from_models(&models("local"), None), Server::MistralRs);
        assert_eq!(Server::from_models(&models("me"), Some("llama.cpp")), Server::LlamaCpp);
        assert_eq!(Server::from_models(&models("me"), None), Server::Other);
        assert_eq!(Server::from_models(&json!("?"), None), Server::Other);
    }

    fn answer(message: &Value, finish: &str) -> Value {
        json!({"choices": [{"message": message, "finish_reason": finish}],
               "usage": {"prompt_tokens": 70, "completion_tokens": 9, "prompt_tokens_details": {"cached_tokens": 64}}})
    }

    #[test]
    fn text_is_read_with_and_without_thoughts() {
        let read_text = |content: Value| read(&answer(&json!({"content": content}), "stop")).unwrap();
        let reply = read_text(json!("{\"a\": 1}"));
        assert_eq!((reply.text.as_str(), reply.tokens), ("{\"a\": 1}", Tokens { input: 70, cached: 64, output: 9 }));
        assert_eq!(read_text(json!("<think>hm {</think>\n{\"a\": 1}")).text, "\n{\"a\": 1}");
        assert_eq!(read_text(json!("hm</think>{}")).text, "{}", "the opening tag is often in the template");
        assert_eq!(read_text(json!("{\"a\": \"<think></think>\"}")).text, "{\"a\": \"<think></think>\"}");
        assert_eq!(read_text(json!([{"type": "text", "text": "{}"}])).text, "{}");
    }

    #[test]
    fn refusals_and_cuts_are_told_apart() {
        let refused = answer(&json!({"content": null, "refusal": "no"}), "stop");
        assert_eq!(read(&refused), Err(Trouble::Refused("no".into())));
        assert!(matches!(read(&answer(&json!({"content": "{"}), "content_filter")), Err(Trouble::Refused(_))));
        let cut = read(&answer(&json!({"content": "{\"a\""}), "length"));
        assert!(matches!(cut, Err(Trouble::CutOff(text)) if text.contains("in the middle")));
        let thought = read(&answer(&json!({"content": "", "reasoning_content": "long"}), "length"));
        assert!(matches!(thought, Err(Trouble::CutOff(text)) if text.contains("nothing was left")));
        for odd in [json!({}), json!({"choices": []}), answer(&json!({"content": null}), "stop"), json!(3)] {
            assert!(matches!(read(&odd), Err(Trouble::NotUnderstood(_))), "{odd}");
        }
    }

    #[test]
    fn a_cut_prompt_is_noticed() {
        let mut asked = samples::asked();
        asked.prompt = "word ".repeat(4000);
        assert!(prompt_was_cut(&asked, Tokens { input: 2048, ..Tokens::default() }).is_some());
        assert!(prompt_was_cut(&asked, Tokens { input: 4100, ..Tokens::default() }).is_none());
        assert!(prompt_was_cut(&asked, Tokens::default()).is_none(), "a server that counts nothing");
    }
}
