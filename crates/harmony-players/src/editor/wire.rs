//! The wire formats of image editors: Gemini's `generateContent`, and OpenAI's `images/edits`, which local servers
//! speak too. Pure; nothing here opens a connection.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Map, Value, json};

use crate::http::Tokens;
use crate::http::multipart::Field;
use crate::vlm::wire::Trouble;
use crate::vlm::wire::gemini::{declined, tokens as gemini_tokens};

/// Path of the edits below the base address.
pub const EDITS_PATH: &str = "/images/edits";

/// What is sent to an editor.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SentEdit {
    /// Instruction.
    pub prompt: String,
    /// PNG files, the one to change first.
    pub images: Vec<Vec<u8>>,
    /// PNG file whose transparent pixels may change, of the first image's size.
    pub mask: Option<Vec<u8>>,
    /// Size of the first image.
    pub size: (u32, u32),
    /// Shape to ask for.
    pub shape: Option<(u32, u32)>,
}

/// What is set for an editor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EditSettings {
    /// Model name; may be empty for a local server.
    pub model: String,
    /// OpenAI: `low`, `medium`, `high`; empty = the service's default.
    pub quality: String,
    /// Seed, where the service has one.
    pub seed: Option<u64>,
    /// Further properties: of `generationConfig` for Gemini, form fields for OpenAI, native options for `sd-server`.
    pub extra: Map<String, Value>,
}

/// An edited image as it came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReceivedEdit {
    /// The file's bytes.
    pub bytes: Vec<u8>,
    /// Tokens.
    pub tokens: Tokens,
}

/// Gemini's request.
pub fn gemini_body(edit: &SentEdit, settings: &EditSettings) -> Value {
    let mut parts = vec![json!({"text": edit.prompt})];
    for image in &edit.images {
        parts.push(json!({"inlineData": {"mimeType": "image/png", "data": STANDARD.encode(image)}}));
    }
    let mut generation = json!({"responseModalities": ["TEXT", "IMAGE"]});
    if let Some((a, b)) = edit.shape {
        generation["imageConfig"] = json!({"aspectRatio": format!("{a}:{b}")});
    }
    if let Some(seed) = settings.seed {
        generation["seed"] = json!(seed);
    }
    for (key, value) in &settings.extra {
        generation[key] = value.clone();
    }
    json!({"contents": [{"role": "user", "parts": parts}], "generationConfig": generation})
}

/// Gemini's answer: the last image that is not a thought.
///
/// # Errors
/// [`Trouble`].
pub fn read_gemini(body: &Value) -> Result<ReceivedEdit, Trouble> {
    if let Some(reason) = declined(body) {
        return Err(Trouble::Refused(reason));
    }
    let Some(candidate) = body.pointer("/candidates/0") else {
        return Err(Trouble::NotUnderstood("there is no `candidates`".to_owned()));
    };
    let parts = candidate.pointer("/content/parts").and_then(Value::as_array).into_iter().flatten();
    let mut last = None;
    let mut words = String::new();
    for part in parts.filter(|part| part.get("thought").and_then(Value::as_bool) != Some(true)) {
        // Both spellings are in use.
        if let Some(data) = part.get("inlineData").or_else(|| part.get("inline_data")).and_then(|d| d.get("data")) {
            last = data.as_str();
        } else if let Some(text) = part.get("text").and_then(Value::as_str) {
            words.push_str(text);
        }
    }
    let finish = candidate.get("finishReason").and_then(Value::as_str).unwrap_or_default();
    match last {
        Some(data) => Ok(ReceivedEdit { bytes: decoded(data)?, tokens: gemini_tokens(body) }),
        None if matches!(finish, "NO_IMAGE" | "IMAGE_OTHER") => {
            Err(Trouble::Refused(format!("{finish} {words}").trim().to_owned()))
        }
        None => Err(Trouble::NotUnderstood(format!("there is no image in the answer, only words: {words:?}"))),
    }
}

/// OpenAI's form. `input_fidelity` keeps the looks of what is sent, for the models that have it as a choice.
pub fn openai_form(edit: &SentEdit, settings: &EditSettings) -> Vec<Field> {
    let model = settings.model.as_str();
    let mut fields = vec![Field::text("model", model)];
    fields.extend(common_fields(edit, &edit.prompt));
    if let Some(mask) = &edit.mask {
        fields.push(Field::png("mask", "mask.png", mask.clone()));
    }
    fields.push(Field::text("background", "opaque"));
    if !settings.quality.is_empty() {
        fields.push(Field::text("quality", settings.quality.clone()));
    }
    if matches!(model, "gpt-image-1" | "gpt-image-1.5" | "chatgpt-image-latest") {
        fields.push(Field::text("input_fidelity", "high"));
    }
    fields
}

/// Whether the list of models (`GET /v1/models`) is that of stable-diffusion.cpp's `sd-server`.
pub fn is_sd_server(models: &Value) -> bool {
    let ids = models.get("data").and_then(Value::as_array).into_iter().flatten();
    ids.filter_map(|model| model.get("id")?.as_str()).any(|id| id.starts_with("sd-cpp"))
}

/// A local server's form: only what all understand.
///
/// `sd-server` takes its native options inside the prompt. It begins with the picture that is to be edited rather than
/// with noise (leejet/stable-diffusion.cpp#1779), which keeps what should go: strength 1 makes it begin with noise, as
/// its own command line does.
pub fn local_form(edit: &SentEdit, settings: &EditSettings, sd_server: bool) -> Vec<Field> {
    let mut fields = Vec::new();
    if !settings.model.is_empty() {
        fields.push(Field::text("model", settings.model.clone()));
    }
    if sd_server {
        let mut options = Map::from_iter([("strength".to_owned(), json!(1.0))]);
        options.extend(settings.seed.map(|seed| ("seed".to_owned(), json!(seed))));
        options.extend(settings.extra.clone());
        let prompt = format!("{}<sd_cpp_extra_args>{}</sd_cpp_extra_args>", edit.prompt, Value::Object(options));
        fields.extend(common_fields(edit, &prompt));
        return fields;
    }
    fields.extend(common_fields(edit, &edit.prompt));
    fields.extend(settings.seed.map(|seed| Field::text("seed", seed.to_string())));
    fields
}

fn common_fields(edit: &SentEdit, prompt: &str) -> Vec<Field> {
    let mut fields = vec![
        Field::text("prompt", prompt),
        Field::text("n", "1"),
        Field::text("size", format!("{}x{}", edit.size.0, edit.size.1)),
        Field::text("output_format", "png"),
    ];
    fields.extend(edit.images.iter().map(|image| Field::png("image[]", "image.png", image.clone())));
    fields
}

/// The answer of `images/edits`. An image that is given as an address is not fetched: who knows where it leads.
///
/// # Errors
/// [`Trouble`].
pub fn read_edits(body: &Value) -> Result<ReceivedEdit, Trouble> {
    let Some(first) = body.pointer("/data/0") else {
        return Err(Trouble::NotUnderstood("there is no `data`".to_owned()));
    };
    let count = |pointer: &str| body.pointer(pointer).and_then(Value::as_u64).unwrap_or(0);
    let tokens = Tokens { input: count("/usage/input_tokens"), cached: 0, output: count("/usage/output_tokens") };
    if let Some(data) = first.get("b64_json").and_then(Value::as_str) {
        return Ok(ReceivedEdit { bytes: decoded(data)?, tokens });
    }
    match first.get("url").and_then(Value::as_str) {
        Some(url) if url.starts_with("data:") => Ok(ReceivedEdit { bytes: decoded(url)?, tokens }),
        Some(_) => Err(Trouble::NotUnderstood("the image is given as an address, which is not fetched".to_owned())),
        None => Err(Trouble::NotUnderstood("there is no image in the answer".to_owned())),
    }
}

/// The bytes of base64, with or without the head of a `data:` URL.
///
/// # Errors
/// [`Trouble::NotUnderstood`].
pub fn decoded(text: &str) -> Result<Vec<u8>, Trouble> {
    let data = match text.strip_prefix("data:") {
        Some(rest) => rest.split_once(',').map_or("", |(_, data)| data),
        None => text,
    };
    STANDARD.decode(data.trim()).map_err(|error| Trouble::NotUnderstood(format!("the file is not base64: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edit() -> SentEdit {
        SentEdit {
            prompt: "Empty the room.".into(),
            images: vec![vec![1, 2, 3], vec![4, 5]],
            mask: Some(vec![6]),
            size: (1024, 768),
            shape: Some((4, 3)),
        }
    }

    fn settings(model: &str) -> EditSettings {
        EditSettings { model: model.into(), seed: Some(7), ..EditSettings::default() }
    }

    /// A form as text: names and short contents.
    fn shown(fields: &[Field]) -> Vec<String> {
        fields
            .iter()
            .map(|field| match field.file {
                Some((name, kind)) => format!("{} = {name} ({kind}, {} bytes)", field.name, field.content.len()),
                None => format!("{} = {}", field.name, String::from_utf8_lossy(&field.content)),
            })
            .collect()
    }

    #[test]
    fn geminis_request_is_as_it_wants_it() {
        insta::assert_json_snapshot!(gemini_body(&edit(), &settings("gemini-3.1-flash-image")));
    }

    #[test]
    fn openais_form_is_as_it_wants_it() {
        insta::assert_json_snapshot!("openai_1_5", shown(&openai_form(&edit(), &settings("gpt-image-1.5"))));
        let mini = shown(&openai_form(&edit(), &settings("gpt-image-1-mini")));
        assert!(!mini.iter().any(|f| f.starts_with("input_fidelity")), "the small model refuses it");
    }

    #[test]
    fn a_local_servers_form_holds_what_all_understand() {
        let mut settings = settings("");
        settings.extra.insert("sample_params".into(), json!({"sample_steps": 8}));
        insta::assert_json_snapshot!("sd_server", shown(&local_form(&edit(), &settings, true)));
        insta::assert_json_snapshot!("other_server", shown(&local_form(&edit(), &settings, false)));
        assert!(is_sd_server(&json!({"data": [{"id": "sd-cpp-local"}]})));
        assert!(!is_sd_server(&json!({"data": [{"id": "Qwen/Qwen-Image-Edit-2511"}]})) && !is_sd_server(&Value::Null));
    }

    #[test]
    fn the_last_image_that_is_no_thought_counts() {
        let image = |bytes: &[u8]| json!({"inlineData": {"mimeType": "image/png", "data": STANDARD.encode(bytes)}});
        let mut draft = image(b"draft");
        draft["thought"] = json!(true);
        let answer = json!({
            "candidates": [{"content": {"parts": [draft, {"text": "Here:"}, image(b"first"), image(b"last")]}, "finishReason": "STOP"}],
            "usageMetadata": {"promptTokenCount": 600, "candidatesTokenCount": 1290, "thoughtsTokenCount": 10}});
        let read = read_gemini(&answer).unwrap();
        assert_eq!((read.bytes.as_slice(), read.tokens.output), (b"last".as_slice(), 1300));
    }

    #[test]
    fn refusals_and_words_in_place_of_images_are_told_apart() {
        let finish = |reason: &str| json!({"candidates": [{"content": {"parts": [{"text": "I see a room."}]}, "finishReason": reason}]});
        for reason in ["IMAGE_SAFETY", "PROHIBITED_CONTENT", "NO_IMAGE", "SAFETY", "RECITATION"] {
            assert!(matches!(read_gemini(&finish(reason)), Err(Trouble::Refused(_))), "{reason}");
        }
        assert!(
            matches!(read_gemini(&finish("STOP")), Err(Trouble::NotUnderstood(text)) if text.contains("I see a room"))
        );
        let blocked = json!({"promptFeedback": {"blockReason": "OTHER"}});
        assert!(matches!(read_gemini(&blocked), Err(Trouble::Refused(_))));
    }

    #[test]
    fn edits_are_read_and_addresses_are_not_followed() {
        let answer = json!({"created": 1, "data": [{"b64_json": STANDARD.encode(b"png")}],
                            "usage": {"input_tokens": 800, "output_tokens": 4160}});
        let read = read_edits(&answer).unwrap();
        assert_eq!((read.bytes.as_slice(), read.tokens.output), (b"png".as_slice(), 4160));
        let inline = json!({"data": [{"url": format!("data:image/png;base64,{}", STANDARD.encode(b"x"))}]});
        assert_eq!(read_edits(&inline).unwrap().bytes, b"x");
        for odd in [
            json!({"data": [{"url": "https://elsewhere.example/image.png"}]}),
            json!({"data": [{"b64_json": "!!"}]}),
            json!({"data": []}),
            json!({}),
        ] {
            assert!(matches!(read_edits(&odd), Err(Trouble::NotUnderstood(_))), "{odd}");
        }
    }
}
