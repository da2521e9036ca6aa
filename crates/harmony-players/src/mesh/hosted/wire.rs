//! What is common to the APIs of hosted services, which differ in names only: a picture goes in, a task is made, it is
//! looked at until it is done, a link to a file comes out. Pure: nothing here opens a connection.

use harmony_roles::MeshSettings;
use serde_json::{Map, Value};

use crate::http::{HttpAnswer, HttpRequest};
use crate::mesh::finish::SourceFrame;

/// What is asked of a service, beside the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Work {
    /// Model, as the service names it.
    pub model: String,
    /// Fidelity.
    pub settings: MeshSettings,
    /// Seed, where the service has one.
    pub seed: u32,
    /// Whether the mesh is textured.
    pub texture: bool,
    /// Further properties of the request (of its `input`, where the service has one).
    pub extra: Map<String, Value>,
}

/// What a look at a task finds.
#[derive(Debug, Clone, PartialEq)]
pub enum TaskState {
    /// At work, or waiting for its turn.
    Working,
    /// Done; the result is asked for by [`Wire::result`].
    Ready,
    /// Done.
    Done(Product),
    /// It ended without a result.
    Ended(Ended),
}

/// What a task made.
#[derive(Debug, Clone, PartialEq)]
pub struct Product {
    /// Link to the GLB file, or a `data:` URL.
    pub link: String,
    /// What it took of the account, in the service's own unit.
    pub credits: Option<f64>,
}

/// How a task ended without a result, with the service's words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// Declined for what the picture shows.
    Refused(String),
    /// It failed.
    Failed(String),
    /// The answer is not understood.
    NotUnderstood(String),
}

/// What an error of the service means where its status does not say it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Meaning {
    /// Declined for what the picture shows.
    Refused(String),
    /// The account is used up.
    Spent(String),
}

/// The API of one service.
pub trait Wire: std::fmt::Debug + Send + Sync {
    /// The frame in which a model leaves its meshes.
    fn frame(&self, model: &str) -> SourceFrame;

    /// Whether a model's files leave metalness out, which glTF reads as metal.
    fn not_metal(&self, _model: &str) -> bool {
        false
    }

    /// Whether the same request makes the same mesh.
    fn has_seed(&self) -> bool {
        true
    }

    /// A file that has to be uploaded before the task is made; `None` = it goes with the task.
    fn upload(&self, _png: &[u8]) -> Option<HttpRequest> {
        None
    }

    /// What stands for an uploaded file in the task.
    ///
    /// # Errors
    /// In words.
    fn uploaded(&self, _answer: &Value) -> Result<String, String> {
        Err("nothing was to be uploaded".to_owned())
    }

    /// Makes a task. `picture` is a `data:` URL or what [`Wire::uploaded`] gave. Notes tell what could not be asked for
    /// as it was set.
    fn submit(&self, picture: &str, work: &Work) -> (HttpRequest, Vec<String>);

    /// The new task's id; it becomes part of an address.
    ///
    /// # Errors
    /// In words.
    fn submitted(&self, answer: &Value) -> Result<String, String>;

    /// Asks how a task is.
    fn look(&self, model: &str, id: &str) -> HttpRequest;

    /// Reads that.
    fn state(&self, answer: &Value) -> TaskState;

    /// Asks for the result of a task that is [`TaskState::Ready`].
    fn result(&self, model: &str, id: &str) -> HttpRequest {
        self.look(model, id)
    }

    /// Reads that.
    fn product(&self, _answer: &Value) -> TaskState {
        TaskState::Ended(Ended::NotUnderstood("there is no result to be asked for".to_owned()))
    }

    /// Cancels a task, where the service allows it.
    fn cancel(&self, _model: &str, _id: &str) -> Option<HttpRequest> {
        None
    }

    /// Asks something that costs nothing and, where that is possible, needs the key.
    fn check(&self, model: &str) -> HttpRequest;

    /// What the answer to that says; `None` = it is the error that its status says.
    ///
    /// # Errors
    /// In words, when the account is used up.
    fn checked(&self, answer: &HttpAnswer) -> Option<Result<String, String>>;

    /// What an error means, where its status does not say it.
    fn meaning(&self, _answer: &HttpAnswer) -> Option<Meaning> {
        None
    }
}

/// An id that may become part of an address.
///
/// # Errors
/// In words.
pub fn plain_id(id: Option<&Value>) -> Result<String, String> {
    let id = id.and_then(Value::as_str).ok_or("there is no task id")?;
    let plain =
        (1..=100).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    if plain { Ok(id.to_owned()) } else { Err("the task id is none that can be asked for".to_owned()) }
}

/// A service's own words, or that there are none.
pub fn words(value: Option<&Value>) -> String {
    match value {
        Some(Value::String(text)) if !text.trim().is_empty() => text.trim().to_owned(),
        Some(other) if !other.is_null() && other != &Value::String(String::new()) => other.to_string(),
        _ => "it does not say why".to_owned(),
    }
}

/// Whether a link leads to a GLB file by its name, its query aside.
pub fn names_glb(link: &str) -> bool {
    let path = link.split(['?', '#']).next().unwrap_or_default();
    std::path::Path::new(path).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("glb"))
}

/// Whether words of a failed task speak of what the picture shows.
pub fn speaks_of_policy(words: &str) -> bool {
    let words = words.to_lowercase();
    ["nsfw", "content policy", "content_policy", "safety", "moderation", "sensitive"].iter().any(|w| words.contains(w))
}

/// The end of a task that failed with these words.
pub fn failed(words: String) -> TaskState {
    TaskState::Ended(if speaks_of_policy(&words) { Ended::Refused(words) } else { Ended::Failed(words) })
}

/// A product of this link and these credits.
pub fn done(link: &str, credits: Option<f64>) -> TaskState {
    TaskState::Done(Product { link: link.to_owned(), credits })
}

/// Further properties over those that are sent anyway.
pub fn with_extra(mut body: Value, extra: &Map<String, Value>) -> Value {
    for (key, value) in extra {
        body[key] = value.clone();
    }
    body
}

#[cfg(test)]
pub(super) fn work(model: &str) -> Work {
    Work { model: model.to_owned(), settings: MeshSettings::default(), seed: 7, texture: true, extra: Map::new() }
}

#[cfg(test)]
pub(super) fn sent(request: &HttpRequest) -> Value {
    let body: Value = serde_json::from_slice(&request.body.as_ref().expect("a body").1).expect("JSON");
    serde_json::json!({"method": format!("{:?}", request.method), "path": request.path, "body": body})
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn ids_that_would_lead_elsewhere_are_refused() {
        assert_eq!(plain_id(Some(&json!("0b1c-9_A"))), Ok("0b1c-9_A".to_owned()));
        for odd in [json!("../account"), json!("a/b"), json!("a?b"), json!(""), json!(7), json!("x".repeat(101))] {
            assert!(plain_id(Some(&odd)).is_err(), "{odd}");
        }
        assert!(plain_id(None).is_err());
    }

    #[test]
    fn failures_are_told_from_refusals_by_their_words() {
        assert!(matches!(failed("NSFW content detected".into()), TaskState::Ended(Ended::Refused(_))));
        assert!(matches!(failed(words(Some(&json!("CUDA out of memory")))), TaskState::Ended(Ended::Failed(_))));
        assert_eq!(words(None), words(Some(&json!(""))));
    }
}
