//! Meshy's image to 3D: `https://api.meshy.ai`.
//!
//! Read in November 2026: Meshy's pages "Quickstart", "Errors", "Rate limits", "Changelog", the Markdown of all its pages,
//! and programs that use it.
//!
//! - `POST /openapi/v1/image-to-3d` -> `result`, the task's id (202); `GET /openapi/v1/image-to-3d/{id}` -> `status` of
//!   `PENDING`, `IN_PROGRESS`, `SUCCEEDED`, `FAILED`, `CANCELED`; `GET /openapi/v1/balance`.
//! - Pictures are `data:` URLs. `consumed_credits` says what a task took. Links are signed and end (`expires_at`).
//! - A used-up account is a 402.
//!
//! Not certain: the front (+Z, glTF's usage; no page says it); whether a task at work can be cancelled (pages tell of
//! deleting a task, which is not done here). It takes no seed: the same picture gives another mesh.

use serde_json::{Value, json};

use super::wire::{Ended, TaskState, Wire, Work, done, failed, plain_id, with_extra, words};
use crate::http::{HttpAnswer, HttpRequest};
use crate::mesh::finish::SourceFrame;

const PATH: &str = "/openapi/v1/image-to-3d";

/// Most faces that can be asked for.
const FACES: (u32, u32) = (100, 300_000);

/// Meshy.
#[derive(Debug)]
pub struct Meshy;

impl Wire for Meshy {
    fn frame(&self, _model: &str) -> SourceFrame {
        SourceFrame::default()
    }

    fn has_seed(&self) -> bool {
        false
    }

    fn submit(&self, picture: &str, work: &Work) -> (HttpRequest, Vec<String>) {
        let wanted = work.settings.faces;
        let faces = wanted.clamp(FACES.0, FACES.1);
        let mut notes = Vec::new();
        if faces != wanted {
            notes.push(format!("{wanted} faces are not offered by the service; {faces} were asked for"));
        }
        let body = json!({
            "image_url": picture, "ai_model": work.model, "topology": "triangle", "should_remesh": true,
            "target_polycount": faces, "should_texture": work.texture, "enable_pbr": work.texture,
        });
        (HttpRequest::post_json(PATH, &with_extra(body, &work.extra)), notes)
    }

    fn submitted(&self, answer: &Value) -> Result<String, String> {
        plain_id(answer.get("result"))
    }

    fn look(&self, _model: &str, id: &str) -> HttpRequest {
        HttpRequest::get(&format!("{PATH}/{id}"))
    }

    fn state(&self, answer: &Value) -> TaskState {
        match answer.get("status").and_then(Value::as_str) {
            Some("PENDING" | "IN_PROGRESS") => TaskState::Working,
            Some("SUCCEEDED") => match answer.pointer("/model_urls/glb").and_then(Value::as_str) {
                Some(link) => done(link, answer.get("consumed_credits").and_then(Value::as_f64)),
                None => TaskState::Ended(Ended::NotUnderstood("there is no GLB file in the task".to_owned())),
            },
            Some(status @ ("FAILED" | "CANCELED" | "EXPIRED")) => {
                failed(format!("{status}: {}", words(answer.pointer("/task_error/message"))))
            }
            other => TaskState::Ended(Ended::NotUnderstood(format!("the task's status is {other:?}"))),
        }
    }

    fn check(&self, _model: &str) -> HttpRequest {
        HttpRequest::get("/openapi/v1/balance")
    }

    fn checked(&self, answer: &HttpAnswer) -> Option<Result<String, String>> {
        let body: Value = serde_json::from_slice(&answer.body).ok()?;
        let balance = body.get("balance").and_then(Value::as_f64).filter(|_| answer.is_success())?;
        Some(if balance > 0.0 {
            Ok(format!("{balance} credits are left"))
        } else {
            Err("no credit is left".to_owned())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::hosted::wire::{sent, work};

    #[test]
    fn its_request_is_as_it_wants_it() {
        insta::assert_json_snapshot!("meshy", sent(&Meshy.submit("data:image/png;base64,iVBO", &work("meshy-6")).0));
        let mut many = work("meshy-6");
        many.settings.faces = 1_000_000;
        assert!(Meshy.submit("x", &many).1[0].contains("300000 were asked for"));
    }

    #[test]
    fn tasks_are_read() {
        assert_eq!(Meshy.submitted(&json!({"result": "018a-1"})), Ok("018a-1".to_owned()));
        assert_eq!(Meshy.state(&json!({"status": "PENDING", "progress": 0})), TaskState::Working);
        let made = json!({"status": "SUCCEEDED", "model_urls": {"glb": "https://assets.meshy.ai/m.glb?Expires=1", "fbx": "x"},
                          "consumed_credits": 30});
        assert_eq!(Meshy.state(&made), done("https://assets.meshy.ai/m.glb?Expires=1", Some(30.0)));
        let bad = json!({"status": "FAILED", "task_error": {"message": "The server is busy."}});
        assert!(matches!(Meshy.state(&bad), TaskState::Ended(Ended::Failed(text)) if text.contains("busy")));
        assert!(matches!(Meshy.state(&json!({"message": "x"})), TaskState::Ended(Ended::NotUnderstood(_))));
    }
}
