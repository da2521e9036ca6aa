//! fal.ai's queue: `https://queue.fal.run`.
//!
//! Read in November 2026: fal's pages "Asynchronous inference", "Cancel a request", "fal CDN", "FAQ", its OpenAPI file of
//! the queue, and the pages of the models `fal-ai/trellis` and `fal-ai/hunyuan3d/v2`.
//!
//! - `POST /{model}` -> `request_id`; `GET /{owner}/{app}/requests/{id}/status` -> `IN_QUEUE`, `IN_PROGRESS`, `COMPLETED`
//!   (202 until then); `GET /{owner}/{app}/requests/{id}` -> the model's output, or the model's error with its status;
//!   `PUT .../cancel`. Further parts of the model's name are left out of these three.
//! - The key is sent as `Authorization: Key ...`. A used-up account is a 403 ("User is locked. Reason: Exhausted balance").
//! - Errors of 500 and more are not charged.
//!
//! Not certain: that every 3D model takes `data:` URLs (the pages say "some models"); fields of models not named above.

use serde_json::{Map, Value, json};

use super::wire::{Ended, TaskState, Wire, Work, done, failed, names_glb, plain_id, with_extra, words};
use crate::http::{HttpAnswer, HttpRequest, Method};
use crate::mesh::finish::SourceFrame;

/// Names under which outputs have their GLB file.
const FILES: [&str; 4] = ["model_glb", "model_mesh", "model_glb_pbr", "mesh"];

/// fal.ai.
#[derive(Debug)]
pub struct Fal;

/// What a model's request looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Family {
    Trellis,
    Hunyuan2,
    Hunyuan3,
    Other,
}

fn family(model: &str) -> Family {
    // The second TRELLIS has other settings than the first.
    if model == "fal-ai/trellis" || model.starts_with("fal-ai/trellis/") {
        Family::Trellis
    } else if model.starts_with("fal-ai/hunyuan3d/v2") || model.starts_with("fal-ai/hunyuan3d-v2") {
        Family::Hunyuan2
    } else if model.starts_with("fal-ai/hunyuan3d-v3") {
        Family::Hunyuan3
    } else {
        Family::Other
    }
}

/// Owner and app: the first two parts of a model's name.
fn app(model: &str) -> String {
    model.trim_matches('/').splitn(3, '/').take(2).collect::<Vec<_>>().join("/")
}

impl Wire for Fal {
    /// TRELLIS and Hunyuan3D write glTF's usage, as their own servers do; the page of no model says it.
    fn frame(&self, _model: &str) -> SourceFrame {
        SourceFrame::default()
    }

    fn not_metal(&self, model: &str) -> bool {
        family(model) == Family::Trellis
    }

    fn submit(&self, picture: &str, work: &Work) -> (HttpRequest, Vec<String>) {
        let settings = &work.settings;
        let steps = settings.steps.clamp(1, 50);
        let mut notes = Vec::new();
        let body = match family(&work.model) {
            Family::Trellis => json!({
                "image_url": picture, "seed": work.seed,
                "ss_sampling_steps": steps, "slat_sampling_steps": steps,
            }),
            Family::Hunyuan2 => json!({
                "input_image_url": picture, "seed": work.seed, "num_inference_steps": steps,
                "octree_resolution": settings.octree_resolution.clamp(1, 1024), "textured_mesh": work.texture,
            }),
            Family::Hunyuan3 => {
                let faces = settings.faces.clamp(40_000, 1_500_000);
                if faces != settings.faces {
                    let wanted = settings.faces;
                    notes.push(format!("{wanted} faces are not offered by the service; {faces} were asked for"));
                }
                json!({"input_image_url": picture, "face_count": faces, "enable_pbr": work.texture})
            }
            Family::Other => json!({"image_url": picture}),
        };
        let path = format!("/{}", work.model.trim_matches('/'));
        (HttpRequest::post_json(&path, &with_extra(body, &work.extra)), notes)
    }

    fn submitted(&self, answer: &Value) -> Result<String, String> {
        plain_id(answer.get("request_id"))
    }

    fn look(&self, model: &str, id: &str) -> HttpRequest {
        HttpRequest::get(&format!("/{}/requests/{id}/status", app(model)))
    }

    fn state(&self, answer: &Value) -> TaskState {
        match answer.get("status").and_then(Value::as_str) {
            Some("IN_QUEUE" | "IN_PROGRESS") => TaskState::Working,
            Some("COMPLETED") => match answer.get("error").filter(|error| !error.is_null()) {
                Some(error) => failed(words(Some(error))),
                None => TaskState::Ready,
            },
            Some(status @ ("FAILED" | "ERROR" | "CANCELED" | "CANCELLED")) => {
                failed(format!("{status}: {}", words(answer.get("error"))))
            }
            other => TaskState::Ended(Ended::NotUnderstood(format!("the task's status is {other:?}"))),
        }
    }

    fn result(&self, model: &str, id: &str) -> HttpRequest {
        HttpRequest::get(&format!("/{}/requests/{id}", app(model)))
    }

    fn product(&self, answer: &Value) -> TaskState {
        let link = |file: &Value| file.get("url").and_then(Value::as_str).map(str::to_owned);
        let named = FILES.iter().find_map(|name| answer.get(name).and_then(link));
        let glb = |file: &Value| link(file).filter(|url| names_glb(url));
        match named.or_else(|| answer.as_object().into_iter().flat_map(Map::values).find_map(glb)) {
            Some(link) => done(&link, None),
            None => TaskState::Ended(Ended::NotUnderstood("there is no GLB file in the result".to_owned())),
        }
    }

    fn cancel(&self, model: &str, id: &str) -> Option<HttpRequest> {
        Some(HttpRequest::empty(Method::Put, &format!("/{}/requests/{id}/cancel", app(model))))
    }

    /// A task that does not exist: the service has no question that costs nothing and proves the key.
    fn check(&self, model: &str) -> HttpRequest {
        self.look(model, "00000000-0000-0000-0000-000000000000")
    }

    fn checked(&self, answer: &HttpAnswer) -> Option<Result<String, String>> {
        let answers = answer.is_success() || matches!(answer.status, 400 | 404 | 422);
        answers.then(|| Ok("the queue answers; whether the key is good shows with the first mesh".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::hosted::wire::{sent, work};

    #[test]
    fn each_family_of_models_gets_its_request() {
        for (name, model) in [
            ("fal_trellis", "fal-ai/trellis"),
            ("fal_hunyuan2", "fal-ai/hunyuan3d/v2"),
            ("fal_hunyuan3", "fal-ai/hunyuan3d-v3/image-to-3d"),
            ("fal_other", "tripo3d/p2/image-to-3d"),
        ] {
            insta::assert_json_snapshot!(name, sent(&Fal.submit("data:image/png;base64,iVBO", &work(model)).0));
        }
        let mut few = work("fal-ai/hunyuan3d-v3/image-to-3d");
        few.settings.faces = 1000;
        assert!(Fal.submit("x", &few).1[0].contains("1000 faces"));
        let mut extra = work("fal-ai/trellis-2");
        extra.extra.insert("texture_size".into(), json!(1024));
        assert_eq!(sent(&Fal.submit("x", &extra).0)["body"], json!({"image_url": "x", "texture_size": 1024}));
    }

    #[test]
    fn a_task_is_asked_for_at_owner_and_app_alone() {
        let path = |model: &str| Fal.look(model, "a-1").path;
        assert_eq!(path("fal-ai/hunyuan3d/v2"), "/fal-ai/hunyuan3d/requests/a-1/status");
        assert_eq!(path("fal-ai/trellis"), "/fal-ai/trellis/requests/a-1/status");
        assert_eq!(Fal.result("a/b/c/d", "x").path, "/a/b/requests/x");
        assert_eq!(Fal.cancel("a/b/c", "x").unwrap().path, "/a/b/requests/x/cancel");
    }

    #[test]
    fn states_and_results_are_read() {
        assert_eq!(Fal.submitted(&json!({"request_id": "a-1", "status": "IN_QUEUE"})), Ok("a-1".to_owned()));
        assert!(Fal.submitted(&json!({"detail": "no"})).is_err());
        assert_eq!(Fal.state(&json!({"status": "IN_QUEUE", "queue_position": 3})), TaskState::Working);
        assert_eq!(Fal.state(&json!({"status": "COMPLETED"})), TaskState::Ready);
        let error = json!({"status": "COMPLETED", "error": "runner died", "error_type": "internal_error"});
        assert!(matches!(Fal.state(&error), TaskState::Ended(Ended::Failed(_))));
        assert!(matches!(Fal.state(&json!({})), TaskState::Ended(Ended::NotUnderstood(_))));
        let file = |name: &str| json!({name: {"url": "https://v3.fal.media/x.glb"}, "seed": 1});
        for name in ["model_mesh", "model_glb", "anything"] {
            assert_eq!(Fal.product(&file(name)), done("https://v3.fal.media/x.glb", None), "{name}");
        }
        let picture = json!({"thumbnail": {"url": "https://v3.fal.media/x.png"}});
        assert!(matches!(Fal.product(&picture), TaskState::Ended(Ended::NotUnderstood(_))));
    }
}
