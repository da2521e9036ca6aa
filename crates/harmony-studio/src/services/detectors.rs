//! Detectors.
//!
//! Quirks, detector sheet: section 1 (LocateAnything has no server of its own; one that speaks chat completions prints
//! box tokens only when told to; coordinates are 0 to 1000, x first; no score; a box is six tokens, and too small a token
//! limit drops boxes without a word; nothing found is `<box>none</box>`), section 2 (Grounding DINO's scores; no
//! suppression of repeated boxes inside).

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_scene::ImageSize;
use serde_json::{Value, json};

use super::{Call, Made, looked_at};
use crate::faults::{Fault, Part};
use crate::http::Reply;
use crate::truth_oracle::{Found, scaled};

/// Tokens of one box with its label, about.
const BOX_TOKENS: usize = 10;

fn bad(message: &str) -> Made {
    Made::free(Part::Detector, Reply::json(400, &json!({"error": {"message": message, "code": 400}})))
}

/// Boxes as they should not be.
fn spoilt(call: &Call<'_>, numbers: [f64; 4], i: usize) -> [f64; 4] {
    let [x0, y0, x1, y1] = numbers;
    if !call.is(Fault::BadBoxes) {
        return numbers;
    }
    match i % 4 {
        0 => [x1, y1, x0, y0],
        1 => [x0, y0, x0, y1],
        2 => [-5000.0, -5000.0, 90_000.0, 90_000.0],
        _ => [x0 + 4000.0, y0, x1 + 4000.0, y1],
    }
}

pub(crate) async fn locate(call: &Call<'_>) -> Made {
    if call.request.method == "GET" {
        let list = json!({"data": [{"id": "LocateAnything-3B", "object": "model", "owned_by": "llamacpp"}]});
        return Made::free(Part::Detector, Reply::json(200, &list));
    }
    if call.path != "/v1/chat/completions" {
        return bad("not found");
    }
    let content = call.json.pointer("/messages/0/content").and_then(Value::as_array);
    let content = content.map_or(&[][..], Vec::as_slice);
    let url = content.iter().find_map(|part| part["image_url"]["url"].as_str()).unwrap_or_default();
    let file = url.split_once(";base64,").and_then(|(_, data)| STANDARD.decode(data).ok());
    if file.is_none_or(|file| looked_at(&file).is_err()) {
        return bad("invalid image");
    }
    let prompt = content.iter().find_map(|part| part["text"].as_str()).unwrap_or_default();
    let asked = prompt.split_once("following description: ").map(|(_, rest)| rest.trim_end_matches('.'));
    let Some(asked) = asked else { return bad("the model was not trained with this prompt") };
    let phrases: Vec<String> = asked.split("</c>").map(str::to_owned).collect();
    let found = call.studio.truth_oracle.boxes(&phrases).await;
    let most = call.json["max_tokens"].as_u64().unwrap_or(256) as usize / BOX_TOKENS;
    let cut = found.len() > most;
    let mut text = String::new();
    for phrase in &phrases {
        let own: Vec<&Found> = found.iter().take(most).filter(|f| f.phrase == *phrase).collect();
        if own.is_empty() {
            continue;
        }
        text.push_str(&format!("<ref>{phrase}</ref>"));
        for (i, one) in own.iter().enumerate() {
            let [x0, y0, x1, y1] = spoilt(call, scaled(one.bounds, ImageSize::new(1000, 1000)), i);
            text.push_str(&format!("<box><{x0}><{y0}><{x1}><{y1}></box>"));
        }
    }
    if text.is_empty() {
        text.push_str("<box>none</box>");
    }
    // Special tokens are hidden unless the request (vLLM) or the start (llama.cpp) says otherwise.
    if call.json["skip_special_tokens"] != json!(false) {
        text = text.replace("<box>", "").replace("</box>", "").replace("<ref>", "").replace("</ref>", "");
    }
    let finish = if cut || call.is(Fault::CutAnswer) { "length" } else { "stop" };
    let (input, output) = (1200, 6 * found.len());
    let body = json!({
        "choices": [{"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": finish}],
        "usage": {"prompt_tokens": input, "completion_tokens": output, "total_tokens": input + output},
    });
    let mut made = Made::paid(Part::Detector, Reply::json(200, &body), (input as u64, output as u64));
    made.usable = !cut;
    made
}

pub(crate) async fn grounding(call: &Call<'_>) -> Made {
    let file = call.json["inputs"].as_str().and_then(|data| STANDARD.decode(data).ok());
    let Some(Ok(image)) = file.map(|file| looked_at(&file)) else { return bad("inputs is no image") };
    let size = ImageSize::new(image.width(), image.height());
    let labels = call.json.pointer("/parameters/candidate_labels").and_then(Value::as_array);
    let phrases: Vec<String> = labels.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect();
    if phrases.is_empty() {
        return bad("candidate_labels is missing");
    }
    let threshold = call.json.pointer("/parameters/threshold").and_then(Value::as_f64).unwrap_or(0.25);
    let found = call.studio.truth_oracle.boxes(&phrases).await;
    let kept = found.iter().filter(|f| f.score >= threshold);
    let mut rows: Vec<Value> = kept
        .enumerate()
        .map(|(i, f)| {
            let [x0, y0, x1, y1] = spoilt(call, scaled(f.bounds, size), i);
            json!({"score": f.score, "label": f.phrase, "box": {"xmin": x0, "ymin": y0, "xmax": x1, "ymax": y1}})
        })
        .collect();
    // One of 900 queries repeats another.
    if let Some(first) = rows.first().cloned() {
        let mut again = first;
        again["score"] = json!(again["score"].as_f64().unwrap_or(0.0) * 0.9);
        if again["score"].as_f64().unwrap_or(0.0) >= threshold {
            rows.push(again);
        }
    }
    let body = if call.is(Fault::CutAnswer) { json!({"error": "the model ran out of memory"}) } else { json!(rows) };
    Made::paid(Part::Detector, Reply::json(200, &body), (0, 0))
}
