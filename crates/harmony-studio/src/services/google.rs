//! Gemini's `generateContent`, for text and for images.
//!
//! Quirks: vlm sheet, section 5 (no rate headers, the wait stands in `error.details` as `RetryInfo`; thoughts are counted
//! beside the candidates; a blocked prompt has no candidates), image-editor sheet, section 1 (the size of an image is not
//! that of what was sent but one of about a megapixel in the shape that was asked for; thought parts may hold drafts; 402
//! when the credit is gone).

use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture::rgb_png;
use serde_json::{Value, json};

use super::{Call, Made, NoThought, edits, rgb, think, tokens};
use crate::faults::{Fault, Part};
use crate::http::Reply;
use crate::strict::Rules;

/// Output tokens of one image (image-editor sheet, section 1).
const IMAGE_TOKENS: u64 = 1290;

/// Sizes by shape; 1024x1024, 1344x768 and 1184x864 are from the sheet, the others have as many pixels.
const SHAPES: [(&str, (u32, u32)); 10] = [
    ("1:1", (1024, 1024)),
    ("2:3", (832, 1248)),
    ("3:2", (1248, 832)),
    ("3:4", (864, 1184)),
    ("4:3", (1184, 864)),
    ("4:5", (896, 1152)),
    ("5:4", (1152, 896)),
    ("9:16", (768, 1344)),
    ("16:9", (1344, 768)),
    ("21:9", (1536, 672)),
];

/// Whether a request is one for images.
pub fn wants_images(body: &Value) -> bool {
    let modalities = body.pointer("/generationConfig/responseModalities").and_then(Value::as_array);
    modalities.is_some_and(|all| all.iter().any(|m| m == "IMAGE"))
}

/// An error in Google's form.
pub fn error(status: u16, message: &str, wait: Option<Duration>) -> Reply {
    let name = match status {
        400 => "INVALID_ARGUMENT",
        402 | 429 => "RESOURCE_EXHAUSTED",
        403 => "PERMISSION_DENIED",
        404 => "NOT_FOUND",
        503 => "UNAVAILABLE",
        _ => "INTERNAL",
    };
    let mut body = json!({"error": {"code": status, "message": message, "status": name}});
    if let Some(wait) = wait {
        body["error"]["details"] = json!([
            {"@type": "type.googleapis.com/google.rpc.QuotaFailure", "violations": [{"quotaId": "GenerateRequestsPerMinutePerProjectPerModel"}]},
            {"@type": "type.googleapis.com/google.rpc.RetryInfo", "retryDelay": format!("{}s", wait.as_secs_f64())},
        ]);
    }
    Reply::json(status, &body)
}

pub(crate) async fn serve(call: &Call<'_>) -> Made {
    let part = if wants_images(&call.json) { Part::Editor } else { Part::Language };
    let free = |reply| Made::free(part, reply);
    match call.request.header("x-goog-api-key") {
        None => return free(error(403, "Method doesn't allow unregistered callers.", None)),
        Some(key) if key != call.studio.options.key => return free(error(400, "API key not valid.", None)),
        Some(_) => {}
    }
    let Some(model) = call.path.strip_prefix("/v1beta/models/") else { return free(error(404, "Not found.", None)) };
    if call.request.method == "GET" {
        return free(Reply::json(200, &json!({"name": format!("models/{model}"), "version": "001"})));
    }
    if !model.ends_with(":generateContent") {
        return free(error(404, "Not found.", None));
    }
    let parts = call.json.pointer("/contents/0/parts").and_then(Value::as_array);
    let Some(parts) = parts else { return free(error(400, "contents is not specified", None)) };
    let mut prompt = "";
    let mut files = Vec::new();
    for part in parts {
        if let Some(text) = part["text"].as_str() {
            prompt = text;
        } else if let Some(data) = part["inlineData"]["data"].as_str().or_else(|| part["inline_data"]["data"].as_str())
        {
            match STANDARD.decode(data) {
                Ok(file) => files.push(file),
                Err(_) => return free(error(400, "Base64 decoding failed", None)),
            }
        }
    }
    // The limit of an inline request (image-editor sheet, section 1).
    if call.request.body.len() > 20_000_000 {
        return free(error(400, "Request payload size exceeds the limit.", None));
    }
    if call.is(Fault::SafetyBlock) {
        return free(Reply::json(200, &json!({"promptFeedback": {"blockReason": "SAFETY"}, "usageMetadata": {}})));
    }
    if wants_images(&call.json) { drawn(call, prompt, &files).await } else { thought(call, prompt, &files).await }
}

async fn thought(call: &Call<'_>, prompt: &str, files: &[Vec<u8>]) -> Made {
    let free = |reply| Made::free(Part::Language, reply);
    let config = &call.json["generationConfig"];
    if config["responseMimeType"] != "application/json" {
        return free(error(400, "the studio wants JSON", None));
    }
    let text = match think(call, prompt, files, &config["responseJsonSchema"], Rules::Gemini).await {
        Ok(text) => text,
        Err(NoThought::Bad(message) | NoThought::Own(message)) => return free(error(400, &message, None)),
    };
    let finish = match call.fault {
        Some(Fault::Refusal) => "PROHIBITED_CONTENT",
        Some(Fault::CutAnswer) => "MAX_TOKENS",
        _ => "STOP",
    };
    let parts = if call.is(Fault::Refusal) {
        json!([])
    } else {
        json!([{"text": "The user asks about a room.", "thought": true}, {"text": text}])
    };
    let (input, output) = tokens(prompt, files.len(), &text);
    let body = json!({
        "candidates": [{"content": {"role": "model", "parts": parts}, "finishReason": finish, "index": 0}],
        "usageMetadata": {"promptTokenCount": input, "candidatesTokenCount": output, "thoughtsTokenCount": 7,
                          "totalTokenCount": input + output + 7},
    });
    Made::paid(Part::Language, Reply::json(200, &body), (input, output + 7))
}

async fn drawn(call: &Call<'_>, prompt: &str, files: &[Vec<u8>]) -> Made {
    let free = |reply| Made::free(Part::Editor, reply);
    let mut images = Vec::new();
    for file in files {
        match rgb(file) {
            Ok(image) => images.push(image),
            Err(message) => return free(error(400, &message, None)),
        }
    }
    let Some(first) = images.first() else { return free(error(400, "there is no image", None)) };
    let asked = call.json.pointer("/generationConfig/imageConfig/aspectRatio").and_then(Value::as_str);
    let size = match asked {
        Some(shape) => match SHAPES.iter().find(|(name, _)| *name == shape) {
            Some((_, size)) => *size,
            None => return free(error(400, &format!("aspect_ratio {shape:?} is not supported"), None)),
        },
        None => first.dimensions(),
    };
    let image = match edits::painted(call, prompt, images, size).await {
        Ok(image) => image,
        Err(message) => return free(error(400, &message, None)),
    };
    let input = (prompt.len() / 4) as u64 + 258 * files.len() as u64;
    let (parts, finish) = if call.is(Fault::Refusal) {
        (json!([]), "IMAGE_SAFETY")
    } else {
        let file = edits::file(call, &image);
        let data = STANDARD.encode(&file);
        // A draft among the thoughts, as Gemini 3 sends.
        let draft = rgb_png(&image::RgbImage::new(8, 8)).map(|d| STANDARD.encode(d)).unwrap_or_default();
        let parts = json!([
            {"inlineData": {"mimeType": "image/png", "data": draft}, "thought": true},
            {"text": "Here is the edited image."},
            {"inlineData": {"mimeType": "image/png", "data": data}},
        ]);
        (parts, "STOP")
    };
    let body = json!({
        "candidates": [{"content": {"role": "model", "parts": parts}, "finishReason": finish, "index": 0}],
        "usageMetadata": {"promptTokenCount": input, "candidatesTokenCount": IMAGE_TOKENS, "totalTokenCount": input + IMAGE_TOKENS},
    });
    Made::paid(Part::Editor, Reply::json(200, &body), (input, IMAGE_TOKENS))
}
