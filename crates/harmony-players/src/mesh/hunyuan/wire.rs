//! What Hunyuan3D's servers take and give. Pure.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use harmony_roles::MeshSettings;
use serde_json::{Value, json};

use super::Version;

/// What the server of 2.1 lets pass, and refuses with 422 beyond.
const OCTREE_2_1: (u32, u32) = (64, 512);
const STEPS_2_1: (u32, u32) = (1, 20);
const FACES_2_1: (u32, u32) = (1000, 100_000);

/// The request's body, and what could not be asked for as it was set.
pub fn body(image: &str, settings: &MeshSettings, seed: u32, texture: bool, version: Version) -> (Value, Vec<String>) {
    let mut notes = Vec::new();
    let mut within = |what: &str, value: u32, (low, high): (u32, u32)| {
        let allowed = value.clamp(low, high);
        if version == Version::V2_1 && allowed != value {
            notes.push(format!("{what} {value} is not allowed by the server; {allowed} was asked for"));
            return allowed;
        }
        value
    };
    let octree = within("octree resolution", settings.octree_resolution, OCTREE_2_1);
    let steps = within("steps", settings.steps, STEPS_2_1);
    let faces = within("face count", settings.faces, FACES_2_1);
    let mut body = json!({
        "image": image,
        "seed": seed,
        "octree_resolution": octree,
        "num_inference_steps": steps,
        "guidance_scale": 5.0,
        "texture": texture,
        "face_count": faces,
    });
    match version {
        // It reads the file format from the request; 2.1 knows no such field.
        Version::V2 => body["type"] = json!("glb"),
        Version::V2_1 => body["remove_background"] = json!(true),
    }
    (body, notes)
}

/// What a failed `POST /generate` says: this server answers 404 with `{"text", "error_code"}` to every failure of its
/// own, so that 404 does not mean a wrong path. `None` = it is not such an answer.
pub fn failure_text(status: u16, body: &Value) -> Option<String> {
    let text = body.get("text")?.as_str()?;
    (matches!(status, 404 | 500) && body.get("error_code").is_some()).then(|| text.to_owned())
}

/// State of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JobState {
    /// Not done; a failed job stays so for ever.
    Working,
    /// Done: the bytes of the GLB file, perhaps not all of them yet.
    Done(Vec<u8>),
    /// Something else.
    NotUnderstood(String),
}

/// Reads the id of `POST /send`.
pub fn job_id(body: &Value) -> Option<&str> {
    let id = body.get("uid")?.as_str()?;
    // It becomes part of an address.
    let plain =
        !id.is_empty() && id.len() <= 100 && id.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    plain.then_some(id)
}

/// Reads `GET /status/{uid}`. A file that does not decode is one that is being written.
pub fn job_state(body: &Value) -> JobState {
    match body.get("status").and_then(Value::as_str) {
        Some("processing" | "texturing" | "pending" | "queued") => JobState::Working,
        Some("completed") => match body.get("model_base64").and_then(Value::as_str) {
            Some(data) => STANDARD.decode(data).map_or(JobState::Working, JobState::Done),
            None => JobState::NotUnderstood("the job is completed, but there is no model in the answer".to_owned()),
        },
        Some(other) => {
            let message = body.get("message").and_then(Value::as_str).unwrap_or_default();
            JobState::NotUnderstood(format!("the job's status is {other:?} {message}").trim().to_owned())
        }
        None => JobState::NotUnderstood("there is no `status`".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_settings_reach_version_2() {
        let (body, notes) = body("iVBO", &MeshSettings::default(), 1234, true, Version::V2);
        insta::assert_json_snapshot!("generate_2", body);
        assert!(notes.is_empty());
    }

    #[test]
    fn version_2_1_gets_what_it_allows_and_says_so() {
        let (body, notes) = body("iVBO", &MeshSettings::default(), 1234, true, Version::V2_1);
        insta::assert_json_snapshot!("generate_2_1", body);
        assert_eq!(notes, ["steps 25 is not allowed by the server; 20 was asked for"]);
    }

    #[test]
    fn a_404_of_the_server_is_told_from_a_wrong_path() {
        assert_eq!(failure_text(404, &json!({"text": "boom", "error_code": 1})).as_deref(), Some("boom"));
        assert_eq!(failure_text(404, &json!({"detail": "Not Found"})), None);
        assert_eq!(failure_text(200, &json!({"text": "boom", "error_code": 1})), None);
    }

    #[test]
    fn jobs_are_read() {
        assert_eq!(job_id(&json!({"uid": "0b1c-9"})), Some("0b1c-9"));
        for odd in [json!({"uid": "../etc"}), json!({"uid": ""}), json!({"uid": 7}), json!({})] {
            assert_eq!(job_id(&odd), None, "{odd}");
        }
        assert_eq!(job_state(&json!({"status": "processing"})), JobState::Working);
        assert_eq!(job_state(&json!({"status": "texturing"})), JobState::Working);
        let done = json!({"status": "completed", "model_base64": STANDARD.encode(b"glTF")});
        assert_eq!(job_state(&done), JobState::Done(b"glTF".to_vec()));
        let half = json!({"status": "completed", "model_base64": "Z2x"});
        assert_eq!(job_state(&half), JobState::Working);
        for odd in [json!({"status": "error"}), json!({"status": "completed"}), json!({})] {
            assert!(matches!(job_state(&odd), JobState::NotUnderstood(_)), "{odd}");
        }
    }
}
