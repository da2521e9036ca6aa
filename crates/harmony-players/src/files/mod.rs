//! `files`: each question is a folder, and whoever wants to answers it.
//!
//! ```text
//! <folder>/README.md                        how it goes
//!          007_3_furniture__list/prompt.md  the question, with its images and the form of the answer
//!                                image_1_*.png  schema.json  example.json
//!                                answer.json    <- written by whoever answers
//!                                complaint.md   what is wrong with it, if something is
//!                                accepted       its form is right; what it says is tried after that
//! ```
//!
//! An answer is judged as soon as it is written. A file that cannot be read yet is given time: whoever writes it may be
//! half through. A question that is asked again later, with the same content, takes the answer that is already there.

mod folder;
mod schema_words;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use async_trait::async_trait;
use harmony_calls::{parse_answer, schema_complaints};
use harmony_roles::{PlayerCard, RoleError, Usage, VisionLanguage, VlmAnswer, VlmRequest};
use serde_json::Value;

use folder::{Question, QuestionError};

/// What happens to the questions, for whoever shows progress.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilesEvent {
    /// A question waits for its answer.
    Waiting {
        /// Call name.
        name: String,
        /// Its folder.
        folder: PathBuf,
        /// How many questions are open now, this one included.
        open: usize,
        /// How many were answered since the program was started.
        answered: usize,
    },
    /// An answer was not accepted; `complaint.md` says why.
    Complained {
        /// Call name.
        name: String,
        /// Its folder.
        folder: PathBuf,
        /// What is wrong.
        complaint: String,
    },
    /// The form of an answer was accepted.
    Accepted {
        /// Call name.
        name: String,
        /// How many questions are still open.
        open: usize,
        /// How many were answered since the program was started.
        answered: usize,
    },
}

/// How questions are asked.
#[derive(Clone)]
pub struct FilesOptions {
    /// Where the question folders are made.
    pub folder: PathBuf,
    /// Who answers, for records and recordings, such as `a person` or a model's name.
    pub answered_by: String,
    /// How often the folders are looked at.
    pub poll: Duration,
    /// How long an answer that cannot be read as JSON is given to be finished.
    pub settle: Duration,
    /// How long a question waits; `None` = until it is answered.
    pub patience: Option<Duration>,
    /// Told what happens.
    pub on_event: Arc<dyn Fn(FilesEvent) + Send + Sync>,
}

impl FilesOptions {
    /// Looks every 200 ms and waits as long as it takes.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
            answered_by: "not said".to_owned(),
            poll: Duration::from_millis(200),
            settle: Duration::from_secs(2),
            patience: None,
            on_event: Arc::new(|_| {}),
        }
    }
}

impl std::fmt::Debug for FilesOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FilesOptions")
            .field("folder", &self.folder)
            .field("answered_by", &self.answered_by)
            .field("patience", &self.patience)
            .finish_non_exhaustive()
    }
}

/// The language model made of a folder.
#[derive(Debug)]
pub struct FilesPlayer {
    options: FilesOptions,
    tally: Mutex<Tally>,
}

#[derive(Debug, Default)]
struct Tally {
    open: BTreeSet<String>,
    answered: usize,
}

/// What is found when a question's folder is looked at.
enum Look {
    /// Nothing new.
    Nothing,
    /// The answer, and the text it came in.
    Answer(Value, String),
    /// An answer that cannot be accepted, and the hash of its bytes.
    Complaint(String, String),
    /// An answer that is not JSON, perhaps not yet, and the hash of its bytes.
    Unreadable(String, String),
    /// Whoever answers passes, in these words.
    Passed(String),
}

impl FilesPlayer {
    /// A player that asks in a folder.
    pub fn new(options: FilesOptions) -> Self {
        Self { options, tally: Mutex::default() }
    }

    /// Number of open questions and of answered ones.
    pub fn tally(&self) -> (usize, usize) {
        let tally = self.tally.lock().unwrap_or_else(PoisonError::into_inner);
        (tally.open.len(), tally.answered)
    }

    fn event(&self, event: FilesEvent) {
        (self.options.on_event)(event);
    }

    /// Waits for an answer that fits the schema.
    async fn wait(&self, question: &Question, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let since = Instant::now();
        // An answer that was judged already: only a changed one is judged again.
        let mut judged: Option<String> = None;
        if let Some(complaint) = request.split_complaint().1 {
            judged = question.reopen(complaint).map_err(|error| self.disk(error))?;
            self.complained(request, question, complaint);
        }
        let mut unreadable_since: Option<(String, Instant)> = None;
        loop {
            match question.look(judged.as_deref(), &request.schema).map_err(|error| self.disk(error))? {
                Look::Nothing => {}
                Look::Answer(value, raw) => {
                    question.accept(&request.name).map_err(|error| self.disk(error))?;
                    return Ok(VlmAnswer { value, raw, usage: Usage::default() });
                }
                Look::Passed(reason) => {
                    return Err(RoleError::Refused { player: self.card().player, reason });
                }
                Look::Complaint(complaint, hash) => {
                    question.complain(&complaint).map_err(|error| self.disk(error))?;
                    self.complained(request, question, &complaint);
                    judged = Some(hash);
                }
                Look::Unreadable(complaint, hash) => match &unreadable_since {
                    Some((old, at)) if *old == hash => {
                        if at.elapsed() >= self.options.settle {
                            question.complain(&complaint).map_err(|error| self.disk(error))?;
                            self.complained(request, question, &complaint);
                            judged = Some(hash);
                        }
                    }
                    _ => unreadable_since = Some((hash, Instant::now())),
                },
            }
            if self.options.patience.is_some_and(|patience| since.elapsed() > patience) {
                return Err(RoleError::Unavailable {
                    player: self.card().player,
                    reason: format!("nobody answered {} within {:?}", request.name, self.options.patience),
                    status: None,
                    retry_after: None,
                });
            }
            tokio::time::sleep(self.options.poll).await;
        }
    }

    fn complained(&self, request: &VlmRequest, question: &Question, complaint: &str) {
        self.event(FilesEvent::Complained {
            name: request.name.clone(),
            folder: question.folder().to_owned(),
            complaint: complaint.to_owned(),
        });
    }

    fn disk(&self, error: QuestionError) -> RoleError {
        RoleError::Io { player: self.card().player, source: std::io::Error::other(error) }
    }
}

#[async_trait]
impl VisionLanguage for FilesPlayer {
    fn card(&self) -> PlayerCard {
        PlayerCard {
            player: "files".to_owned(),
            model: self.options.answered_by.clone(),
            offline: false,
            concurrency: 0,
        }
    }

    fn in_own_time(&self) -> bool {
        true
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let opened = {
            let (root, request) = (self.options.folder.clone(), request.clone());
            tokio::task::spawn_blocking(move || Question::open(&root, &request)).await
        };
        let question = match opened {
            Ok(question) => question.map_err(|error| self.disk(error))?,
            Err(error) => {
                return Err(RoleError::Io { player: self.card().player, source: std::io::Error::other(error) });
            }
        };
        let (open, answered) = {
            let mut tally = self.tally.lock().unwrap_or_else(PoisonError::into_inner);
            tally.open.insert(request.name.clone());
            (tally.open.len(), tally.answered)
        };
        let folder = question.folder().to_owned();
        self.event(FilesEvent::Waiting { name: request.name.clone(), folder, open, answered });
        let result = self.wait(&question, request).await;
        let (open, answered) = {
            let mut tally = self.tally.lock().unwrap_or_else(PoisonError::into_inner);
            tally.open.remove(&request.name);
            tally.answered += usize::from(result.is_ok());
            (tally.open.len(), tally.answered)
        };
        if result.is_ok() {
            self.event(FilesEvent::Accepted { name: request.name.clone(), open, answered });
        }
        result
    }
}

/// Judges the text of an answer.
fn judge(text: &str, hash: String, schema: &Value) -> Look {
    match parse_answer(text) {
        Err(complaint) => Look::Unreadable(complaint, hash),
        Ok(value) => {
            let complaints = schema_complaints(schema, &value);
            if complaints.is_empty() {
                Look::Answer(value, text.to_owned())
            } else {
                let lines: Vec<String> = complaints.iter().map(|c| format!("- {c}")).collect();
                Look::Complaint(lines.join("\n"), hash)
            }
        }
    }
}
