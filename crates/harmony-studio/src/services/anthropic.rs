//! Anthropic's Messages. Quirks: vlm sheet, section 6 (`anthropic-version` and `max_tokens` are mandatory; a picture has
//! at most 5 242 880 bytes of base64 and 8000 pixels a side, 2000 when there are more than 20; 529 = overloaded; limits
//! with RFC 3339 times in `anthropic-ratelimit-*`; cached input is counted beside `input_tokens`).

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::{Call, Made, NoThought, Service, looked_at, think, tokens};
use crate::faults::{Fault, Part};
use crate::http::Reply;
use crate::limits::Level;
use crate::strict::Rules;

/// An error in Anthropic's form.
pub fn error(status: u16, code: &str, message: &str, wait: Option<Duration>) -> Reply {
    let kind = match status {
        401 => "authentication_error",
        404 => "not_found_error",
        429 => "rate_limit_error",
        529 => "overloaded_error",
        500.. => "api_error",
        _ => "invalid_request_error",
    };
    let message = if code == "insufficient_quota" { "Your credit balance is too low." } else { message };
    let body = json!({"type": "error", "error": {"type": kind, "message": message}, "request_id": "req_studio"});
    let reply = Reply::json(status, &body).header("request-id", "req_studio");
    match wait {
        Some(wait) => reply.header("retry-after", wait.as_secs_f64()),
        None => reply,
    }
}

/// A moment as RFC 3339 writes it, in whole seconds, rounded up.
fn rfc3339(at: SystemTime) -> String {
    let seconds = at.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs() + 1;
    let (days, rest) = ((seconds / 86_400) as i64, seconds % 86_400);
    // Howard Hinnant's civil_from_days; years begin in March.
    let z = days + 719_468;
    let era = z.div_euclid(146_097);
    let of_era = z.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", rest / 3600, rest % 3600 / 60, rest % 60)
}

fn with_rates(reply: Reply, level: Level) -> Reply {
    reply
        .header("request-id", "req_studio")
        .header("anthropic-ratelimit-requests-limit", level.limit)
        .header("anthropic-ratelimit-requests-remaining", level.remaining)
        .header("anthropic-ratelimit-requests-reset", rfc3339(SystemTime::now() + level.reset))
}

pub(crate) async fn serve(call: &Call<'_>) -> Made {
    let free = |reply| Made::free(Part::Language, reply);
    if call.request.header("x-api-key") != Some(call.studio.options.key.as_str()) {
        return free(error(401, "", "invalid x-api-key", None));
    }
    if call.request.header("anthropic-version") != Some("2023-06-01") {
        return free(error(400, "", "anthropic-version: header is required", None));
    }
    if call.request.method == "GET" {
        let id = call.path.trim_start_matches("/v1/models").trim_start_matches('/');
        return free(Reply::json(200, &json!({"type": "model", "id": id, "display_name": id})));
    }
    if call.path != "/v1/messages" {
        return free(error(404, "", "Not found", None));
    }
    let level = call.studio.buckets.take(Service::Anthropic);
    if level.over {
        let refused = error(429, "", "This request would exceed your rate limit.", Some(level.reset));
        return free(with_rates(refused, level));
    }
    if call.json["max_tokens"].as_u64().is_none_or(|n| n == 0) {
        return free(error(400, "", "max_tokens: Field required", None));
    }
    let content = call.json.pointer("/messages/0/content").and_then(Value::as_array);
    let (mut prompt, mut files) = ("", Vec::new());
    for block in content.into_iter().flatten() {
        match block["type"].as_str() {
            Some("text") => prompt = block["text"].as_str().unwrap_or_default(),
            Some("image") => {
                let data = block["source"]["data"].as_str().unwrap_or_default();
                if data.len() > 5_242_880 {
                    return free(error(400, "", "image exceeds 5 MB maximum", None));
                }
                match STANDARD.decode(data) {
                    Ok(file) => files.push(file),
                    Err(_) => return free(error(400, "", "image.source.base64: invalid base64 data", None)),
                }
            }
            other => return free(error(400, "", &format!("content block {other:?} is not known"), None)),
        }
    }
    let most = if files.len() > 20 { 2000 } else { 8000 };
    for file in &files {
        match looked_at(file) {
            Ok(image) if image.width().max(image.height()) <= most => {}
            Ok(_) => return free(error(400, "", "image dimensions exceed max allowed size", None)),
            Err(message) => return free(error(400, "", &message, None)),
        }
    }
    let format = &call.json["output_config"]["format"];
    if format["type"] != "json_schema" {
        return free(error(400, "", "the studio wants output_config.format", None));
    }
    let text = match think(call, prompt, &files, &format["schema"], Rules::Anthropic).await {
        Ok(text) => text,
        Err(NoThought::Bad(message) | NoThought::Own(message)) => return free(error(400, "", &message, None)),
    };
    let (input, output) = tokens(prompt, files.len(), &text);
    let (stop, text) = match call.fault {
        Some(Fault::Refusal | Fault::SafetyBlock) => ("refusal", String::new()),
        Some(Fault::CutAnswer) => ("max_tokens", text),
        _ => ("end_turn", text),
    };
    let body = json!({
        "id": "msg_studio", "type": "message", "role": "assistant", "model": call.json["model"],
        "content": [{"type": "text", "text": text}], "stop_reason": stop, "stop_sequence": null,
        "usage": {"input_tokens": input, "cache_creation_input_tokens": 0, "cache_read_input_tokens": 0,
                  "output_tokens": output},
    });
    Made::paid(Part::Language, with_rates(Reply::json(200, &body), level), (input, output))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resets_are_written_as_the_program_reads_them() {
        for seconds in [0, 951_782_399, 1_709_251_198, 1_795_255_229] {
            let written = rfc3339(UNIX_EPOCH + Duration::from_secs(seconds));
            let read = harmony_players::http::rfc3339(&written).unwrap();
            assert_eq!(read.duration_since(UNIX_EPOCH).unwrap().as_secs(), seconds + 1, "{written}");
        }
    }
}
