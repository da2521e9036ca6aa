//! Blender Cycles as a program of its own: found on the machine, given a job file, watched, and ended in time.

mod find;
mod job;
mod outputs;
mod run;
mod script;

pub use find::{BPY_PYTHON, BPY_VERSION, BlenderKind, CyclesRenderer, bpy_folder, python_of};
pub use job::{CyclesJob, Delight, RenderMode};
pub use outputs::{CyclesOutput, CyclesTimings, LightPass};
pub use run::Progress;

use std::time::Duration;

/// Why there is no path-traced image.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LitError {
    /// No Blender on this machine.
    #[error("no Blender was found: not as a Python module, not as a program")]
    NotFound,
    /// The scene file is not there.
    #[error("the scene to render is not a file: {}", path.display())]
    NoScene {
        /// What was asked for.
        path: std::path::PathBuf,
    },
    /// The job itself makes no sense.
    #[error("the render job cannot be done: {reason}")]
    BadJob {
        /// What is wrong.
        reason: String,
    },
    /// Blender ran longer than allowed and was ended.
    #[error("Blender was still rendering after {limit:?} and was ended; last words: {log_tail}")]
    Timeout {
        /// The limit.
        limit: Duration,
        /// End of its log.
        log_tail: String,
    },
    /// Blender ended without the images.
    #[error("Blender failed ({status}): {log_tail}")]
    Failed {
        /// Exit status in words.
        status: String,
        /// End of its log.
        log_tail: String,
    },
    /// What it wrote cannot be read.
    #[error("Blender's output cannot be read: {reason}")]
    BadOutput {
        /// What is wrong.
        reason: String,
    },
    /// Files or processes.
    #[error("could not {what}")]
    Io {
        /// What was tried.
        what: &'static str,
        /// Why not.
        #[source]
        source: std::io::Error,
    },
}

impl LitError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::NotFound => Some(format!(
                "`harmony setup --blender` installs Blender's Python module, or set {} to a python that can import bpy, or put blender on PATH",
                find::ENV_PYTHON
            )),
            Self::Timeout { .. } => Some("lower the samples or the image size, or raise the time limit".to_owned()),
            Self::Failed { log_tail, .. } if log_tail.contains("MemoryError") || log_tail.contains("bad_alloc") => {
                Some("the scene needs more memory than the limit: simplify its meshes or textures".to_owned())
            }
            _ => None,
        }
    }
}
