//! Tripo's open API: `https://api.tripo3d.ai/v2/openapi`.
//!
//! Read in November 2026: Tripo's pages "General", "Upload", "Generation", "Task" as a public repository keeps them, and the
//! models of its own Python package.
//!
//! - `POST /upload/sts` (a form) -> `image_token` in `data`; `POST /task` -> `task_id` in `data`; `GET /task/{id}` -> `status` in `data` of
//!   `queued`, `running`, `success`, `failed`, `banned`, `expired`, `cancelled`, `unknown`; `GET /user/balance`.
//! - Links to files end after five minutes; each look at the task gives fresh ones. A task can only be looked at with the
//!   key that made it.
//! - Every error has a number: 2000 too many tasks (429), 2008 content policy (400), 2010 too few credits (403).
//! - There is no way to cancel a task.
//!
//! Not certain: `consumed_credit` in a task (seen, not described); the front, +X, which is only the default of the option
//! `export_orientation` of a later conversion.

use serde_json::{Value, json};

use super::wire::{Ended, Meaning, TaskState, Wire, Work, done, failed, plain_id, with_extra, words};
use crate::http::multipart::Field;
use crate::http::{HttpAnswer, HttpRequest};
use crate::mesh::finish::{AxisName, SourceFrame};

/// Tripo.
#[derive(Debug)]
pub struct Tripo;

impl Wire for Tripo {
    fn frame(&self, _model: &str) -> SourceFrame {
        SourceFrame { up: AxisName::PlusY, front: AxisName::PlusX }
    }

    fn upload(&self, png: &[u8]) -> Option<HttpRequest> {
        Some(HttpRequest::post_form("/upload/sts", &[Field::png("file", "object.png", png.to_vec())]))
    }

    fn uploaded(&self, answer: &Value) -> Result<String, String> {
        plain_id(answer.pointer("/data/image_token")).map_err(|_| "the upload gave no token".to_owned())
    }

    fn submit(&self, picture: &str, work: &Work) -> (HttpRequest, Vec<String>) {
        let body = json!({
            "type": "image_to_model", "model_version": work.model,
            "file": {"type": "png", "file_token": picture},
            "model_seed": work.seed, "texture_seed": work.seed, "face_limit": work.settings.faces,
            "texture": work.texture, "pbr": work.texture,
        });
        (HttpRequest::post_json("/task", &with_extra(body, &work.extra)), Vec::new())
    }

    fn submitted(&self, answer: &Value) -> Result<String, String> {
        plain_id(answer.pointer("/data/task_id"))
    }

    fn look(&self, _model: &str, id: &str) -> HttpRequest {
        HttpRequest::get(&format!("/task/{id}"))
    }

    fn state(&self, answer: &Value) -> TaskState {
        let Some(task) = answer.get("data") else {
            return TaskState::Ended(Ended::NotUnderstood("there is no `data`".to_owned()));
        };
        let said = || words(task.get("error_msg"));
        match task.get("status").and_then(Value::as_str) {
            Some("queued" | "running") => TaskState::Working,
            Some("success") => {
                let output = task.get("output");
                let named = ["pbr_model", "model", "base_model"];
                let link = named.iter().find_map(|name| output?.get(name)?.as_str());
                match link {
                    Some(link) => done(link, task.get("consumed_credit").and_then(Value::as_f64)),
                    None => TaskState::Ended(Ended::NotUnderstood("there is no model in the output".to_owned())),
                }
            }
            Some("banned") => TaskState::Ended(Ended::Refused(format!("its content policy: {}", said()))),
            Some(status @ ("failed" | "expired" | "cancelled" | "unknown")) => failed(format!("{status}: {}", said())),
            other => TaskState::Ended(Ended::NotUnderstood(format!("the task's status is {other:?}"))),
        }
    }

    fn check(&self, _model: &str) -> HttpRequest {
        HttpRequest::get("/user/balance")
    }

    fn checked(&self, answer: &HttpAnswer) -> Option<Result<String, String>> {
        let body: Value = serde_json::from_slice(&answer.body).ok()?;
        let balance = body.pointer("/data/balance").and_then(Value::as_f64).filter(|_| answer.is_success())?;
        Some(if balance > 0.0 {
            Ok(format!("{balance} credits are left"))
        } else {
            Err("no credit is left".to_owned())
        })
    }

    fn meaning(&self, answer: &HttpAnswer) -> Option<Meaning> {
        let body: Value = serde_json::from_slice(&answer.body).ok()?;
        match body.get("code").and_then(Value::as_u64)? {
            2008 => Some(Meaning::Refused(words(body.get("message")))),
            2010 => Some(Meaning::Spent(words(body.get("message")))),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::hosted::wire::{sent, work};

    fn answer(status: u16, body: &Value) -> HttpAnswer {
        HttpAnswer { status, headers: vec![], body: body.to_string().into_bytes() }
    }

    #[test]
    fn its_request_is_as_it_wants_it() {
        insta::assert_json_snapshot!("tripo", sent(&Tripo.submit("token-1", &work("v2.5-20250123")).0));
        assert_eq!(Tripo.uploaded(&json!({"code": 0, "data": {"image_token": "token-1"}})), Ok("token-1".to_owned()));
        assert!(Tripo.uploaded(&json!({"code": 2003, "message": "empty"})).is_err());
    }

    #[test]
    fn tasks_and_errors_are_read() {
        let task = |task: Value| Tripo.state(&json!({"code": 0, "data": task}));
        assert_eq!(task(json!({"status": "running", "progress": 40})), TaskState::Working);
        let made = json!({"status": "success", "output": {"model": "https://h/m.glb", "pbr_model": "https://h/p.glb"},
                          "consumed_credit": 30});
        assert_eq!(task(made), done("https://h/p.glb", Some(30.0)));
        assert!(matches!(task(json!({"status": "banned"})), TaskState::Ended(Ended::Refused(_))));
        for status in ["failed", "expired", "cancelled", "unknown"] {
            assert!(matches!(task(json!({"status": status})), TaskState::Ended(Ended::Failed(_))), "{status}");
        }
        assert!(matches!(Tripo.state(&json!({"code": 0})), TaskState::Ended(Ended::NotUnderstood(_))));
        let spent = answer(403, &json!({"code": 2010, "message": "You need more credits"}));
        assert!(matches!(Tripo.meaning(&spent), Some(Meaning::Spent(_))));
        let policy = answer(400, &json!({"code": 2008, "message": "violates our content policy"}));
        assert!(matches!(Tripo.meaning(&policy), Some(Meaning::Refused(_))));
        assert_eq!(Tripo.meaning(&answer(404, &json!({"code": 2001}))), None);
        let balance =
            |left: f64| Tripo.checked(&answer(200, &json!({"code": 0, "data": {"balance": left, "frozen": 0}})));
        assert!(balance(12.0).unwrap().is_ok() && balance(0.0).unwrap().is_err());
        assert!(Tripo.checked(&answer(401, &json!({"code": 1002}))).is_none());
    }
}
