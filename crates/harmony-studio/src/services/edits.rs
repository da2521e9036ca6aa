//! `images/edits`: OpenAI's, and that of stable-diffusion.cpp's `sd-server`.
//!
//! Quirks: image-editor sheet, section 2 (sizes by model; the mask is a PNG with alpha of the first image's size and
//! less than 4 MB; refusals are 400 with `moderation_blocked`; images come as base64) and section 3a (`sd-server` has no
//! model field, its list of models says `sd-cpp-local`, native options ride in the prompt, calls are synchronous).

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_io::picture::rgb_png;
use image::RgbImage;
use image::codecs::png::{CompressionType, FilterType as PngFilter, PngEncoder};
use image::imageops::{FilterType, resize};
use serde_json::{Value, json};

use super::form::{boundary, parts};
use super::{Call, Made, Service, looked_at, openai, rgb};
use crate::faults::{Fault, Part};
use crate::http::Reply;

/// What stands in place of an image that is none.
const NO_IMAGE: &[u8] = b"I can describe the picture instead: a room.";

/// The picture that comes back, of a size.
pub(super) async fn painted(
    call: &Call<'_>,
    prompt: &str,
    images: Vec<RgbImage>,
    size: (u32, u32),
) -> Result<RgbImage, String> {
    let truth_oracle = std::sync::Arc::clone(&call.studio.truth_oracle);
    let prompt = prompt.to_owned();
    let (w, h) = if call.is(Fault::WrongSize) { (size.0 / 2, size.1) } else { size };
    let work = move || {
        let image = truth_oracle.edited(&prompt, &images)?;
        Ok(if image.dimensions() == (w, h) { image } else { resize(&image, w, h, FilterType::Triangle) })
    };
    tokio::task::spawn_blocking(work).await.map_err(|error| error.to_string())?
}

/// The file of a picture.
pub(super) fn file(call: &Call<'_>, image: &RgbImage) -> Vec<u8> {
    if call.is(Fault::NotAnImage) {
        return NO_IMAGE.to_vec();
    }
    let mut file = Vec::new();
    // Quickly rather than small: nobody keeps it.
    let encoder = PngEncoder::new_with_quality(&mut file, CompressionType::Fast, PngFilter::Sub);
    match image.write_with_encoder(encoder) {
        Ok(()) => file,
        Err(_) => rgb_png(image).unwrap_or_default(),
    }
}

/// A form's fields.
struct Form {
    fields: Vec<(String, String)>,
    images: Vec<RgbImage>,
    mask: Option<Vec<u8>>,
}

impl Form {
    fn read(call: &Call<'_>) -> Result<Self, String> {
        let kind = call.request.header("content-type").unwrap_or_default();
        let boundary = boundary(kind).ok_or("Content-Type must be multipart/form-data")?;
        let mut form = Self { fields: Vec::new(), images: Vec::new(), mask: None };
        for part in parts(&call.request.body, boundary) {
            match part.name.as_str() {
                "image" | "image[]" => form.images.push(rgb(part.content)?),
                "mask" => form.mask = Some(part.content.to_vec()),
                _ => form.fields.push((part.name, String::from_utf8_lossy(part.content).into_owned())),
            }
        }
        Ok(form)
    }

    fn field(&self, name: &str) -> Option<&str> {
        self.fields.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    fn size(&self) -> Option<(u32, u32)> {
        let (w, h) = self.field("size")?.split_once('x')?;
        Some((w.parse().ok()?, h.parse().ok()?))
    }
}

/// What OpenAI has against a form.
fn check(form: &Form) -> Result<(u32, u32), (&'static str, String)> {
    let bad = |message: String| ("invalid_value", message);
    let model = form.field("model").unwrap_or("gpt-image-1.5");
    let first = form.images.first().ok_or_else(|| bad("Missing required parameter: 'image'.".into()))?;
    if form.images.len() > 16 || form.field("prompt").is_none_or(|p| p.is_empty() || p.len() > 32_000) {
        return Err(bad("Invalid 'image' or 'prompt'.".into()));
    }
    if model == "gpt-image-1-mini" && form.field("input_fidelity").is_some() {
        return Err(("unsupported_parameter", "'input_fidelity' is not supported with this model.".into()));
    }
    let size = form.size().ok_or_else(|| bad("Invalid 'size'.".into()))?;
    let fits = if model.starts_with("gpt-image-2") {
        let (w, h) = size;
        w % 16 == 0 && h % 16 == 0 && w <= 3 * h && h <= 3 * w && (655_360..=8_294_400).contains(&(w * h))
    } else {
        [(1024, 1024), (1536, 1024), (1024, 1536)].contains(&size)
    };
    if !fits {
        return Err(bad(format!("Invalid value: '{}x{}' for 'size'.", size.0, size.1)));
    }
    if let Some(mask) = &form.mask {
        let image = looked_at(mask).map_err(bad)?;
        if mask.len() >= 4 << 20 || !image.color().has_alpha() {
            return Err(bad("Invalid mask image format - mask must be a PNG with an alpha channel under 4 MB.".into()));
        }
        if (image.width(), image.height()) != first.dimensions() {
            return Err(bad("Invalid mask image format - mask size does not match image size.".into()));
        }
    }
    Ok(size)
}

pub(crate) async fn openai(call: &Call<'_>) -> Made {
    let free = |reply| Made::free(Part::Editor, reply);
    if call.bearer() != Some(call.studio.options.key.as_str()) {
        return free(openai::error(401, "invalid_api_key", "Incorrect API key provided.", None));
    }
    let level = call.studio.buckets.take(Service::OpenAi);
    if level.over {
        let refused = openai::error(429, "rate_limit_exceeded", "Rate limit reached for images.", Some(level.reset));
        return free(openai::with_rates(refused, level));
    }
    let form = match Form::read(call) {
        Ok(form) => form,
        Err(message) => return free(openai::error(400, "invalid_value", &message, None)),
    };
    let size = match check(&form) {
        Ok(size) => size,
        Err((code, message)) => return free(openai::error(400, code, &message, None)),
    };
    if matches!(call.fault, Some(Fault::Refusal | Fault::SafetyBlock)) {
        let message = "Your request was rejected by the safety system.";
        return free(openai::error(400, "moderation_blocked", message, None));
    }
    made(call, form, size, Some(level)).await
}

pub(crate) async fn sd_server(call: &Call<'_>) -> Made {
    let free = |reply| Made::free(Part::Editor, reply);
    let error = |status, message: &str| free(Reply::json(status, &json!({"error": message})));
    if call.request.method == "GET" {
        let list = json!({"data": [{"id": "sd-cpp-local", "object": "model", "owned_by": "local"}]});
        return free(if call.path == "/v1/models" { Reply::json(200, &list) } else { Reply::json(404, &json!({})) });
    }
    if call.path != "/v1/images/edits" {
        return error(404, "not found");
    }
    let form = match Form::read(call) {
        Ok(form) => form,
        Err(message) => return error(400, &message),
    };
    // Native options are JSON inside the prompt.
    let prompt = form.field("prompt").unwrap_or_default();
    if let Some((_, rest)) = prompt.split_once("<sd_cpp_extra_args>") {
        let options = rest.split("</sd_cpp_extra_args>").next().unwrap_or_default();
        if serde_json::from_str::<Value>(options).is_err() {
            return error(400, "sd_cpp_extra_args is no JSON");
        }
    }
    let Some(size) = form.size().filter(|_| !form.images.is_empty()) else {
        return error(400, "image or size is missing");
    };
    made(call, form, size, None).await
}

async fn made(call: &Call<'_>, form: Form, size: (u32, u32), level: Option<crate::limits::Level>) -> Made {
    let prompt = form.field("prompt").unwrap_or_default().to_owned();
    let count = form.images.len();
    let image = match painted(call, &prompt, form.images, size).await {
        Ok(image) => image,
        Err(message) => {
            return Made::free(Part::Editor, openai::error(400, "studio", &message, None));
        }
    };
    let data = STANDARD.encode(file(call, &image));
    let mut body = json!({"created": 1_790_000_000, "data": [{"b64_json": data}], "output_format": "png"});
    // A local server counts no tokens.
    let tokens = if level.is_some() { ((prompt.len() / 4 + 300 * count) as u64, 1056) } else { (0, 0) };
    if level.is_some() {
        body["usage"] =
            json!({"input_tokens": tokens.0, "output_tokens": tokens.1, "total_tokens": tokens.0 + tokens.1});
    }
    let reply = Reply::json(200, &body);
    let reply = level.map_or_else(|| reply.clone(), |level| openai::with_rates(reply.clone(), level));
    Made::paid(Part::Editor, reply, tokens)
}
