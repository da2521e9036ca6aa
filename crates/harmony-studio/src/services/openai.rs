//! OpenAI's Responses and chat completions, and the local servers that speak chat completions.
//!
//! Quirks, all from the vlm sheet:
//! - section 2: pictures of Responses are plain strings and `detail` is required; the schema lies flat in `text.format`;
//! - section 1: `max_tokens`, `temperature` and the like are refused by reasoning models with 400; a schema's name has
//!   at most 64 letters, digits, `_`, `-`;
//! - section 3: strict schemas are checked, and refused with 400 and the place;
//! - section 4: rate limits stand in `x-ratelimit-*` of every answer; 429 has two kinds;
//! - section 7: vLLM and llama.cpp say nothing of rates; llama.cpp lets a *flat* `json_schema` pass unconstrained, so the
//!   studio answers such a request with prose; errors of local servers have a number as code.

use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::{Call, Made, NoThought, Service, think, tokens};
use crate::faults::{Fault, Part};
use crate::http::Reply;
use crate::limits::{Level, spelled};
use crate::strict::Rules;

/// An error in OpenAI's form.
pub fn error(status: u16, code: &str, message: &str, wait: Option<Duration>) -> Reply {
    let kind = match status {
        429 => "requests",
        500.. => "server_error",
        _ => "invalid_request_error",
    };
    let body = json!({"error": {"message": message, "type": kind, "param": null, "code": code}});
    let reply = Reply::json(status, &body).header("x-request-id", "req_studio");
    match wait {
        // Seconds are whole; milliseconds are sent beside them at times.
        Some(wait) if wait < Duration::from_secs(1) => {
            reply.header("retry-after-ms", wait.as_millis()).header("retry-after", 1)
        }
        Some(wait) => reply.header("retry-after", wait.as_secs()),
        None => reply,
    }
}

/// The headers that every answer has.
pub fn with_rates(reply: Reply, level: Level) -> Reply {
    reply
        .header("x-request-id", "req_studio")
        .header("openai-processing-ms", 12)
        .header("x-ratelimit-limit-requests", level.limit)
        .header("x-ratelimit-remaining-requests", level.remaining)
        .header("x-ratelimit-reset-requests", spelled(level.reset))
}

pub(crate) async fn serve(call: &Call<'_>) -> Made {
    let free = |reply| Made::free(Part::Language, reply);
    if call.service == Service::OpenAi && call.bearer() != Some(call.studio.options.key.as_str()) {
        return free(error(401, "invalid_api_key", "Incorrect API key provided.", None));
    }
    if call.request.method == "GET" {
        return free(models(call));
    }
    let read = match call.path {
        "/v1/responses" if call.service == Service::OpenAi => responses(&call.json),
        "/v1/chat/completions" => chat(&call.json, call.service),
        _ => {
            return free(Reply::json(
                404,
                &json!({"error": {"message": "Not found", "type": "invalid_request_error", "code": null}}),
            ));
        }
    };
    let level = (call.service == Service::OpenAi).then(|| call.studio.buckets.take(Service::OpenAi));
    if let Some(level) = level.filter(|level| level.over) {
        let refused = error(429, "rate_limit_exceeded", "Rate limit reached for requests.", Some(level.reset));
        return free(with_rates(refused, level));
    }
    let asked = match read {
        Ok(asked) => asked,
        Err((code, message)) => return free(error(400, code, &message, None)),
    };
    let text = match &asked.schema {
        Some(schema) => {
            let rules = if call.service == Service::OpenAi { Rules::OpenAi } else { Rules::Grammar };
            think(call, &asked.prompt, &asked.pictures, schema, rules).await
        }
        None => Ok("There is a room in the picture.".to_owned()),
    };
    let text = match text {
        Ok(text) => text,
        Err(NoThought::Bad(message)) => return free(error(400, "invalid_json_schema", &message, None)),
        Err(NoThought::Own(message)) => return free(error(400, "studio", &message, None)),
    };
    let count = tokens(&asked.prompt, asked.pictures.len(), &text);
    let body = if call.path == "/v1/responses" { response(call, &text, count) } else { completion(call, &text, count) };
    let reply = Reply::json(200, &body);
    let reply = match level {
        Some(level) => with_rates(reply, level),
        None => reply,
    };
    let mut made = Made::paid(Part::Language, reply, count);
    made.usable = asked.schema.is_some();
    made
}

fn models(call: &Call<'_>) -> Reply {
    let model = |id: &str, owner: &str| json!({"id": id, "object": "model", "owned_by": owner});
    match (call.service, call.path.strip_prefix("/v1/models")) {
        (Service::OpenAi, Some(id)) if id.len() > 1 => Reply::json(200, &model(&id[1..], "system")),
        (Service::OpenAi, Some(_)) => {
            Reply::json(200, &json!({"object": "list", "data": [model("gpt-5.5", "system")]}))
        }
        (Service::LlamaCpp, Some(_)) => {
            let list = json!({"object": "list", "data": [model("qwen3-vl-8b-q4_k_m.gguf", "llamacpp")]});
            Reply::json(200, &list).header("server", "llama.cpp")
        }
        (_, Some(_)) => {
            Reply::json(200, &json!({"object": "list", "data": [model("Qwen/Qwen3-VL-8B-Instruct", "vllm")]}))
        }
        _ => Reply::json(404, &json!({"error": {"message": "Not found"}})),
    }
}

/// What a request asks.
struct AskedOf {
    prompt: String,
    pictures: Vec<Vec<u8>>,
    schema: Option<Value>,
}

type Refused = (&'static str, String);

fn responses(body: &Value) -> Result<AskedOf, Refused> {
    refuse_sampling(body, "max_tokens")?;
    let content = body.pointer("/input/0/content").and_then(Value::as_array);
    let content = content.ok_or(("missing_required_parameter", "Missing required parameter: 'input'.".to_owned()))?;
    let (mut prompt, mut pictures) = (String::new(), Vec::new());
    for part in content {
        match part["type"].as_str() {
            Some("input_text") => prompt = part["text"].as_str().unwrap_or_default().to_owned(),
            Some("input_image") => {
                let url = part["image_url"].as_str();
                let url = url.ok_or(("invalid_type", "image_url: expected a string, got an object.".to_owned()))?;
                if !matches!(part["detail"].as_str(), Some("low" | "high" | "auto" | "original")) {
                    return Err(("missing_required_parameter", "Missing required parameter: 'detail'.".to_owned()));
                }
                pictures.push(data_url(url)?);
            }
            other => return Err(("invalid_value", format!("Invalid value: {other:?} for 'type'."))),
        }
    }
    let format = &body["text"]["format"];
    if format.get("json_schema").is_some() {
        return Err(("unknown_parameter", "Unknown parameter: 'text.format.json_schema'.".to_owned()));
    }
    Ok(AskedOf { prompt, pictures, schema: Some(named_schema(format)?) })
}

fn chat(body: &Value, service: Service) -> Result<AskedOf, Refused> {
    if service == Service::OpenAi {
        refuse_sampling(body, "max_tokens")?;
    }
    let messages = body["messages"].as_array();
    let messages =
        messages.ok_or(("missing_required_parameter", "Missing required parameter: 'messages'.".to_owned()))?;
    let content = messages.iter().rev().find(|m| m["role"] == "user").and_then(|m| m["content"].as_array());
    let (mut prompt, mut pictures) = (String::new(), Vec::new());
    for part in content.into_iter().flatten() {
        match part["type"].as_str() {
            Some("text") => prompt = part["text"].as_str().unwrap_or_default().to_owned(),
            Some("image_url") => {
                let url = part["image_url"]["url"].as_str();
                pictures.push(data_url(url.ok_or(("invalid_type", "image_url must be an object".to_owned()))?)?);
            }
            other => return Err(("invalid_value", format!("Invalid value: {other:?} for 'type'."))),
        }
    }
    let format = &body["response_format"];
    let schema = match (service, format.get("json_schema"), format.get("schema")) {
        (Service::OpenAi, Some(nested), _) => Some(named_schema(&json!({
            "type": "json_schema", "name": nested["name"], "schema": nested["schema"], "strict": nested["strict"],
        }))?),
        (_, Some(nested), _) => Some(nested["schema"].clone()),
        // Silently unconstrained: llama.cpp reads the nested form only.
        _ => None,
    };
    Ok(AskedOf { prompt, pictures, schema })
}

fn refuse_sampling(body: &Value, renamed: &str) -> Result<(), Refused> {
    if body.get(renamed).is_some() {
        return Err((
            "unsupported_parameter",
            format!("Unsupported parameter: '{renamed}' is not supported with this model."),
        ));
    }
    if body.get("temperature").is_some_and(|t| t.as_f64() != Some(1.0)) {
        return Err(("unsupported_value", "Unsupported value: 'temperature' does not support this value.".to_owned()));
    }
    if body["model"].as_str().is_none_or(str::is_empty) {
        return Err(("missing_required_parameter", "you must provide a model parameter".to_owned()));
    }
    Ok(())
}

fn named_schema(format: &Value) -> Result<Value, Refused> {
    let name = format["name"].as_str().unwrap_or_default();
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if format["type"] != "json_schema" || name.is_empty() || name.len() > 64 || !name.chars().all(plain) {
        return Err(("invalid_value", format!("Invalid 'text.format': name {name:?}")));
    }
    if format["strict"] != json!(true) {
        return Err(("invalid_value", "the studio wants strict schemas".to_owned()));
    }
    Ok(format["schema"].clone())
}

/// The bytes of a data URL.
fn data_url(url: &str) -> Result<Vec<u8>, Refused> {
    let bad = || ("invalid_image_url", "Invalid image URL: expected a base64-encoded data URL.".to_owned());
    let rest = url.strip_prefix("data:image/").ok_or_else(bad)?;
    let (kind, data) = rest.split_once(";base64,").ok_or_else(bad)?;
    if !matches!(kind, "png" | "jpeg" | "webp" | "gif") {
        return Err(bad());
    }
    STANDARD.decode(data).map_err(|_| bad())
}

/// `status`, `output` and `usage` of Responses, a reasoning item first.
fn response(call: &Call<'_>, text: &str, (input, output): (u64, u64)) -> Value {
    let declined = call.is(Fault::Refusal);
    let content = if declined {
        json!({"type": "refusal", "refusal": "I'm sorry, I can't help with that."})
    } else {
        json!({"type": "output_text", "text": text, "annotations": []})
    };
    let (status, reason) = match call.fault {
        Some(Fault::SafetyBlock) => ("incomplete", json!({"reason": "content_filter"})),
        Some(Fault::CutAnswer) => ("incomplete", json!({"reason": "max_output_tokens"})),
        _ => ("completed", Value::Null),
    };
    json!({
        "id": "resp_studio", "object": "response", "status": status, "incomplete_details": reason, "error": null,
        "model": call.json["model"],
        "output": [
            {"id": "rs_studio", "type": "reasoning", "summary": []},
            {"id": "msg_studio", "type": "message", "role": "assistant", "status": status, "content": [content]},
        ],
        "usage": {
            "input_tokens": input, "input_tokens_details": {"cached_tokens": 0},
            "output_tokens": output, "output_tokens_details": {"reasoning_tokens": 0},
            "total_tokens": input + output,
        },
    })
}

/// `choices` and `usage` of chat completions. vLLM puts thoughts into `reasoning_content` beside the answer.
fn completion(call: &Call<'_>, text: &str, (input, output): (u64, u64)) -> Value {
    let finish = match call.fault {
        Some(Fault::SafetyBlock) => "content_filter",
        Some(Fault::CutAnswer) => "length",
        _ => "stop",
    };
    let message = if call.is(Fault::Refusal) {
        json!({"role": "assistant", "content": null, "refusal": "I'm sorry, I can't help with that."})
    } else if call.service == Service::Vllm {
        json!({"role": "assistant", "content": text, "reasoning_content": null, "refusal": null})
    } else {
        json!({"role": "assistant", "content": text, "refusal": null})
    };
    json!({
        "id": "chatcmpl-studio", "object": "chat.completion", "model": call.json["model"],
        "choices": [{"index": 0, "message": message, "finish_reason": finish}],
        "usage": {"prompt_tokens": input, "completion_tokens": output, "total_tokens": input + output},
    })
}
