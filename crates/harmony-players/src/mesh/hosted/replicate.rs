//! Replicate's predictions: `https://api.replicate.com/v1`.
//!
//! Read in November 2026: Replicate's pages "Create a prediction", "Prediction lifecycle" and "Prediction deadlines", the
//! example page of `tencent/hunyuan3d-2`; for `firtoz/trellis`, programs that use it.
//!
//! - `POST /predictions` with `version` and `input` -> `id`; `GET /predictions/{id}` -> `status` of `starting`,
//!   `processing`, `succeeded`, `failed`, `canceled`, `aborted`; `POST /predictions/{id}/cancel`.
//! - `POST /files` takes what is too large for a `data:` URL; it costs nothing.
//! - Output files are deleted after an hour.
//! - A prediction is charged by its time on the machine: a failed one may be, too.
//!
//! Not certain: the size from which a `data:` URL is refused (pages say 256 KB), and that `remove_background = false` keeps
//! our cut-out as it is.

use serde_json::{Map, Value, json};

use super::wire::{Ended, TaskState, Wire, Work, done, failed, names_glb, plain_id, with_extra, words};
use crate::http::multipart::Field;
use crate::http::{HttpAnswer, HttpRequest, Method};
use crate::mesh::finish::SourceFrame;

/// Largest file that goes into a `data:` URL, bytes.
const INLINE: usize = 256 << 10;

/// Names under which outputs have their GLB file.
const FILES: [&str; 6] = ["model_file", "mesh", "mesh_paint", "glb", "textured_mesh", "model"];

/// Replicate.
#[derive(Debug)]
pub struct Replicate;

fn is_trellis(model: &str) -> bool {
    model.to_lowercase().contains("trellis")
}

impl Wire for Replicate {
    /// TRELLIS and Hunyuan3D write glTF's usage, as their own servers do; the page of no model says it.
    fn frame(&self, _model: &str) -> SourceFrame {
        SourceFrame::default()
    }

    fn not_metal(&self, model: &str) -> bool {
        is_trellis(model)
    }

    fn upload(&self, png: &[u8]) -> Option<HttpRequest> {
        let file = || Field::png("content", "object.png", png.to_vec());
        (png.len() > INLINE).then(|| HttpRequest::post_form("/files", &[file()]))
    }

    fn uploaded(&self, answer: &Value) -> Result<String, String> {
        let url = answer.pointer("/urls/get").and_then(Value::as_str);
        url.map(str::to_owned).ok_or_else(|| "the uploaded file has no address".to_owned())
    }

    fn submit(&self, picture: &str, work: &Work) -> (HttpRequest, Vec<String>) {
        let settings = &work.settings;
        let mut notes = Vec::new();
        let input = if is_trellis(&work.model) {
            let steps = settings.steps.clamp(1, 50);
            json!({
                "images": [picture], "seed": work.seed, "randomize_seed": false, "generate_model": true,
                "generate_color": false, "texture_size": 1024, "ss_sampling_steps": steps,
                "slat_sampling_steps": steps,
            })
        } else {
            let steps = settings.steps.clamp(20, 50);
            if steps != settings.steps {
                notes.push(format!("{} steps are not allowed by the service; {steps} were asked for", settings.steps));
            }
            json!({
                "image": picture, "seed": work.seed, "steps": steps,
                "octree_resolution": settings.octree_resolution, "remove_background": false,
            })
        };
        let body = json!({"version": work.model, "input": with_extra(input, &work.extra)});
        (HttpRequest::post_json("/predictions", &body), notes)
    }

    fn submitted(&self, answer: &Value) -> Result<String, String> {
        plain_id(answer.get("id"))
    }

    fn look(&self, _model: &str, id: &str) -> HttpRequest {
        HttpRequest::get(&format!("/predictions/{id}"))
    }

    fn state(&self, answer: &Value) -> TaskState {
        match answer.get("status").and_then(Value::as_str) {
            Some("starting" | "processing" | "queued") => TaskState::Working,
            Some("succeeded") => match file(answer.get("output").unwrap_or(&Value::Null)) {
                Some(link) => done(&link, None),
                // Outputs are deleted after an hour; then the prediction is there without them.
                None => TaskState::Ended(Ended::NotUnderstood("there is no GLB file in the output".to_owned())),
            },
            Some("failed") => failed(words(answer.get("error"))),
            Some(status @ ("canceled" | "aborted")) => failed(format!("the prediction was {status}")),
            other => TaskState::Ended(Ended::NotUnderstood(format!("the prediction's status is {other:?}"))),
        }
    }

    fn cancel(&self, _model: &str, id: &str) -> Option<HttpRequest> {
        Some(HttpRequest::empty(Method::Post, &format!("/predictions/{id}/cancel")))
    }

    fn check(&self, _model: &str) -> HttpRequest {
        HttpRequest::get("/account")
    }

    fn checked(&self, answer: &HttpAnswer) -> Option<Result<String, String>> {
        answer.is_success().then(|| Ok("the key is accepted; how much credit is left is not told".to_owned()))
    }
}

/// The GLB file of an output: a link, a list of links, or links by name.
fn file(output: &Value) -> Option<String> {
    let is_glb = |link: &str| link.starts_with("data:") || names_glb(link);
    let glb = |value: &Value| value.as_str().filter(|link| is_glb(link)).map(str::to_owned);
    match output {
        Value::String(_) => glb(output),
        Value::Array(items) => items.iter().find_map(glb),
        Value::Object(map) => FILES
            .iter()
            .find_map(|name| map.get(*name).and_then(Value::as_str).map(str::to_owned))
            .or_else(|| Map::values(map).find_map(glb)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::hosted::wire::{sent, work};

    #[test]
    fn each_family_of_models_gets_its_request() {
        for (name, model) in
            [("replicate_hunyuan", "tencent/hunyuan3d-2:b1b9449a"), ("replicate_trellis", "firtoz/trellis:e8f6c452")]
        {
            insta::assert_json_snapshot!(name, sent(&Replicate.submit("data:image/png;base64,iVBO", &work(model)).0));
        }
        assert!(Replicate.upload(&[0; 1000]).is_none());
        assert_eq!(Replicate.upload(&vec![0; INLINE + 1]).unwrap().path, "/files");
        assert!(
            Replicate.uploaded(&json!({"id": "f", "urls": {"get": "https://api.replicate.com/v1/files/f"}})).is_ok()
        );
        assert!(Replicate.uploaded(&json!({})).is_err());
    }

    #[test]
    fn states_and_outputs_are_read() {
        let with =
            |status: &str, output: Value| Replicate.state(&json!({"id": "a", "status": status, "output": output}));
        assert_eq!(with("starting", Value::Null), TaskState::Working);
        let link = "https://replicate.delivery/xezq/mesh.glb";
        for output in [json!(link), json!({"mesh": link}), json!(["https://x/p.png", link]), json!({"odd": link})] {
            assert_eq!(with("succeeded", output.clone()), done(link, None), "{output}");
        }
        assert!(matches!(with("succeeded", Value::Null), TaskState::Ended(Ended::NotUnderstood(_))));
        let state = Replicate.state(&json!({"status": "failed", "error": "NSFW content detected"}));
        assert!(matches!(state, TaskState::Ended(Ended::Refused(_))));
        assert!(matches!(with("aborted", Value::Null), TaskState::Ended(Ended::Failed(_))));
        assert!(matches!(Replicate.state(&json!({})), TaskState::Ended(Ended::NotUnderstood(_))));
    }
}
