//! What is wrong with a program, so that whoever wrote it can put it right.

use serde::{Deserialize, Serialize};

/// In which step a program failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum ErrorKind {
    /// It was refused before it was read: too long, too deep.
    Refused,
    /// It is not a program.
    Syntax,
    /// A function was called with what it does not take, a name does not exist, `fail` was called.
    Run,
    /// It took too much time or memory, or made too much.
    Limit,
    /// The cage could not be started or fell over for a reason of its own.
    Cage,
}

/// Why a program yields nothing: what, where, and what would do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("line {line}: {message}")]
pub struct ProgramError {
    /// In which step.
    pub kind: ErrorKind,
    /// Line of the program, 1 for the first; 0 when no line is to blame.
    pub line: u32,
    /// What is wrong, in one or two lines.
    pub message: String,
    /// What to write instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

impl ProgramError {
    pub(crate) fn new(kind: ErrorKind, line: u32, message: impl Into<String>) -> Self {
        Self { kind, line, message: message.into(), hint: None }
    }

    pub(crate) fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// The error with the line of the source that it speaks about and its hint: what is sent back to a model.
    pub fn explain(&self, source: &str) -> String {
        let mut text =
            if self.line == 0 { self.message.clone() } else { format!("line {}: {}", self.line, self.message) };
        if let Some(line) = (self.line as usize).checked_sub(1).and_then(|i| source.lines().nth(i)) {
            let shown: String = line.trim().chars().take(120).collect();
            text.extend(["\n    ", &shown]);
        }
        if let Some(hint) = &self.hint {
            text.extend(["\nhint: ", hint]);
        }
        text
    }
}

/// What a modelling function says about its arguments; the engine adds the line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub(crate) struct Complaint {
    pub message: String,
    pub hint: Option<String>,
    pub limit: bool,
}

impl Complaint {
    pub fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), hint: None, limit: false }
    }

    pub fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// Too much of something.
    pub fn limit(message: impl Into<String>) -> Self {
        Self { message: message.into(), hint: None, limit: true }
    }
}

/// What a native function ends with when it does not end well.
pub(crate) enum Failure {
    /// Our own words.
    Complaint(Complaint),
    /// The interpreter's, from a callback.
    Engine(starlark::Error),
}

impl From<Complaint> for Failure {
    fn from(complaint: Complaint) -> Self {
        Self::Complaint(complaint)
    }
}

impl From<starlark::Error> for Failure {
    fn from(error: starlark::Error) -> Self {
        Self::Engine(error)
    }
}

impl From<Failure> for starlark::Error {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Complaint(complaint) => Self::new_native(complaint),
            Failure::Engine(error) => error,
        }
    }
}
