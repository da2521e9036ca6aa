//! What a run tells while it goes on; whoever listens draws it.

use harmony_scene::Warning;

/// Something happened.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ProgressEvent {
    /// A phase began.
    PhaseStarted {
        /// Folder name.
        phase: String,
    },
    /// A step inside a phase began.
    Step {
        /// Folder name.
        phase: String,
        /// In words, such as `placing 7 objects`.
        text: String,
    },
    /// A phase ended.
    PhaseDone {
        /// Folder name.
        phase: String,
        /// Seconds.
        seconds: f64,
        /// One line.
        outcome: String,
    },
    /// A phase failed.
    PhaseFailed {
        /// Folder name.
        phase: String,
        /// Why.
        reason: String,
    },
    /// Something went another way than intended.
    Warned(Warning),
}

/// Listens to a run.
pub type ProgressSink = std::sync::Arc<dyn Fn(ProgressEvent) + Send + Sync>;
