//! What the servers of TRELLIS take and give. Pure.

use harmony_roles::MeshSettings;
use serde_json::{Value, json};

use super::Host;
use crate::editor::wire::decoded;
use crate::vlm::wire::Trouble;

/// Path below the base address.
pub fn path(host: Host) -> &'static str {
    match host {
        Host::Nim => "/v1/infer",
        Host::LocalAi => "/3d/generations",
    }
}

/// The request's body. `image` is a PNG in base64.
pub fn body(image: &str, settings: &MeshSettings, seed: u32, model: &str, host: Host) -> Value {
    let url = format!("data:image/png;base64,{image}");
    match host {
        Host::Nim => json!({
            "mode": "image",
            "image": url,
            "ss_sampling_steps": settings.steps,
            "slat_sampling_steps": settings.steps,
            "ss_cfg_scale": 7.5,
            "slat_cfg_scale": 3.0,
            "output_format": "glb",
            "seed": seed,
        }),
        Host::LocalAi => json!({
            "model": model,
            "image": url,
            "quality": "auto",
            "background": "keep",
            "seed": seed,
            "response_format": "b64_json",
        }),
    }
}

/// Reads the file's bytes.
///
/// # Errors
/// [`Trouble`].
pub fn read(body: &Value, host: Host) -> Result<Vec<u8>, Trouble> {
    let (list, data) = match host {
        Host::Nim => ("artifacts", "base64"),
        Host::LocalAi => ("data", "b64_json"),
    };
    let Some(first) = body.get(list).and_then(|list| list.get(0)) else {
        return Err(Trouble::NotUnderstood(format!("there is no `{list}`")));
    };
    match first.get("finishReason").and_then(Value::as_str) {
        None | Some("SUCCESS") => {}
        Some(reason) if reason.contains("FILTER") => return Err(Trouble::Refused(reason.to_owned())),
        Some(reason) => return Err(Trouble::Failed(reason.to_owned())),
    }
    match first.get(data).and_then(Value::as_str) {
        Some(text) if !text.is_empty() => decoded(text),
        _ => Err(Trouble::NotUnderstood(format!("there is no `{data}` in the answer; addresses are not fetched"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_server_gets_its_request() {
        let settings = MeshSettings::default();
        insta::assert_json_snapshot!("nim", body("iVBO", &settings, 7, "", Host::Nim));
        insta::assert_json_snapshot!("localai", body("iVBO", &settings, 7, "trellis2", Host::LocalAi));
    }

    #[test]
    fn files_are_read_and_failures_told_apart() {
        let nim = |reason: &str| json!({"artifacts": [{"base64": "Z2xURg==", "finishReason": reason, "seed": 7}]});
        assert_eq!(read(&nim("SUCCESS"), Host::Nim), Ok(b"glTF".to_vec()));
        assert!(matches!(read(&nim("CONTENT_FILTERED"), Host::Nim), Err(Trouble::Refused(_))));
        assert!(matches!(read(&nim("ERROR"), Host::Nim), Err(Trouble::Failed(_))));
        assert_eq!(read(&json!({"data": [{"b64_json": "Z2xURg=="}]}), Host::LocalAi), Ok(b"glTF".to_vec()));
        for odd in [json!({"data": [{"url": "http://elsewhere/x.glb"}]}), json!({"data": []}), json!({})] {
            assert!(matches!(read(&odd, Host::LocalAi), Err(Trouble::NotUnderstood(_))), "{odd}");
        }
    }
}
