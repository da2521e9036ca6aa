//! What a phase is given beside the scene, and how it fails.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use harmony_calls::{Calls, Capabilities};
use harmony_io::{FileError, MaskError, PointsError, picture};
use harmony_prompts::Ask;
use harmony_roles::{Picture, RoleError, VlmRequest};
use harmony_scene::{ObjectId, Warning, WarningKind};
use image::{RgbImage, RgbaImage};
use serde::Serialize;

use crate::Phase;
use crate::progress::{ProgressEvent, ProgressSink};
use crate::settings::Settings;

/// A phase cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PhaseError {
    /// A role failed, its stand-in too, or the run must stop.
    #[error(transparent)]
    Role(#[from] RoleError),
    /// A file cannot be written or read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A folder cannot be made.
    #[error("folder {path} cannot be made: {source}", path = path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A picture cannot be written.
    #[error(transparent)]
    Picture(#[from] picture::PictureError),
    /// A mask cannot be written.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// A point map cannot be written.
    #[error(transparent)]
    Points(#[from] PointsError),
    /// The GLB cannot be written.
    #[error(transparent)]
    Glb(#[from] harmony_io::GlbError),
    /// The report cannot be written.
    #[error(transparent)]
    Report(#[from] harmony_viewer::ReportError),
    /// What this phase waited for will not come, for an earlier one failed.
    #[error("{phase} was not begun, for a phase before it failed")]
    Abandoned {
        /// Phase.
        phase: Phase,
    },
    /// A bug of ours.
    #[error("{phase} failed inside: {reason}")]
    Internal {
        /// Phase.
        phase: Phase,
        /// Why.
        reason: String,
    },
}

impl PhaseError {
    /// Something that should not happen.
    pub fn internal(phase: Phase, reason: &dyn std::fmt::Display) -> Self {
        Self::Internal { phase, reason: reason.to_string() }
    }

    /// See [`PhaseError::Abandoned`].
    pub fn abandoned(phase: Phase) -> Self {
        Self::Abandoned { phase }
    }

    /// What a person can do about it.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Role(RoleError::Io { source, .. }) => Some(
                harmony_io::atomic::io_hint(source)
                    .unwrap_or("check the disk and the run folder, then run the same command again")
                    .to_owned(),
            ),
            Self::Role(RoleError::Budget { .. }) => Some(
                "raise [budget] in harmony.toml and run the same command again: nothing that was answered is asked again"
                    .to_owned(),
            ),
            Self::Role(RoleError::Interrupted { .. }) => {
                Some("run the same command again to go on: nothing that was answered is asked again".to_owned())
            }
            Self::Role(error) => error.hint().map(ToOwned::to_owned),
            Self::File(error) => error.hint().map(ToOwned::to_owned),
            Self::Picture(error) => error.hint().map(ToOwned::to_owned),
            Self::Mask(error) => error.hint().map(ToOwned::to_owned),
            Self::Points(error) => error.hint().map(ToOwned::to_owned),
            Self::Glb(error) => error.hint().map(ToOwned::to_owned),
            Self::Folder { source, .. } => harmony_io::atomic::io_hint(source).map(ToOwned::to_owned),
            Self::Internal { .. } => Some(
                "this is a fault of the program; what was obtained is kept, and running again goes on from it".into(),
            ),
            _ => None,
        }
    }
}

/// Warnings of a run, in a stable order, each once.
#[derive(Debug, Default)]
pub struct Warnings(Mutex<Vec<Warning>>);

impl Warnings {
    /// Adds one.
    pub fn push(&self, warning: Warning) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !all.contains(&warning) {
            all.push(warning);
        }
    }

    /// All so far, sorted by phase, object, kind and text.
    pub fn sorted(&self) -> Vec<Warning> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        all.sort();
        all
    }
}

/// Roles, settings, progress, warnings, and the phase's folder.
pub struct PhaseCtx<'a> {
    /// Run folder.
    pub run: &'a Path,
    /// The phase.
    pub phase: Phase,
    /// A look within the phase that prepares objects of its own: its calls and records have names of their own.
    pub within: Option<&'a str>,
    /// Calls to roles.
    pub calls: &'a Calls,
    /// Lit pictures are wanted, and there is a path tracer.
    pub path_tracer: bool,
    /// Settings.
    pub settings: &'a Settings,
    /// Where warnings go.
    pub warnings: &'a Warnings,
    /// Who listens.
    pub progress: &'a ProgressSink,
}

impl PhaseCtx<'_> {
    /// Full name of a call of this phase.
    pub fn call(&self, step: &str) -> String {
        match self.within {
            Some(look) => format!("{}/{look}/{step}", self.phase),
            None => format!("{}/{step}", self.phase),
        }
    }

    /// Name of a record of this phase, such as `detections.json`.
    pub fn record(&self, name: &str) -> String {
        self.within.map_or(name.to_owned(), |look| format!("{look}_{name}"))
    }

    /// The same for a look within a phase.
    pub fn inside<'b>(&'b self, phase: Phase, look: &'b str) -> PhaseCtx<'b> {
        PhaseCtx { phase, within: Some(look), ..*self }
    }

    /// Whether a question of this phase is answered by somebody who looks.
    pub fn is_looked_at(&self, step: &str) -> bool {
        self.calls.is_looked_at(&self.call(step))
    }

    /// Whether somebody knows what is in the photo: the language model, or a detector. Where nobody does, most things
    /// were not found and are paint on the room.
    pub fn is_seen(&self) -> bool {
        self.can().recognises || self.calls.is_looked_at(&format!("{}/layout", Phase::Layout))
    }

    /// What the players can do.
    pub fn can(&self) -> Capabilities {
        self.calls.can()
    }

    /// Tells that a step begins.
    pub fn step(&self, text: &str) {
        tracing::info!(phase = %self.phase, "{text}");
        (self.progress)(ProgressEvent::Step { phase: self.phase.to_string(), text: text.to_owned() });
    }

    /// Collects a warning.
    pub fn warn(&self, kind: WarningKind, object: Option<ObjectId>, message: String) {
        let warning = Warning { phase: self.phase.to_string(), object, kind, message };
        (self.progress)(ProgressEvent::Warned(warning.clone()));
        self.warnings.push(warning);
    }

    /// Asks the VLM a question.
    ///
    /// # Errors
    /// Fatal role errors, or no acceptable answer from anybody.
    pub async fn ask<Q: Ask>(&self, step: &str, question: Q, pictures: Vec<Picture>) -> Result<Q::Answer, PhaseError> {
        self.ask_and_try(step, question, pictures, |_| Ok(())).await
    }

    /// The same; an answer that passes the question's own check is tried out before it is accepted.
    ///
    /// # Errors
    /// As [`PhaseCtx::ask`].
    pub async fn ask_and_try<Q: Ask>(
        &self,
        step: &str,
        question: Q,
        pictures: Vec<Picture>,
        tried: impl Fn(&Q::Answer) -> Result<(), String> + Send + Sync,
    ) -> Result<Q::Answer, PhaseError> {
        let request = VlmRequest::new(self.call(step), question.clone().into(), pictures);
        Ok(self.calls.ask_as(&request, |answer| question.check(answer).and_then(|()| tried(answer))).await?)
    }

    /// Computes beside the asynchronous work, so that other objects' chains go on meanwhile.
    ///
    /// # Errors
    /// A panic of the work, as a fault inside.
    pub async fn computed<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, PhaseError> {
        tokio::task::spawn_blocking(work).await.map_err(|e| PhaseError::internal(self.phase, &e))
    }

    /// Path of a file of this phase; its folder is made.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn file(&self, relative: &str) -> Result<PathBuf, PhaseError> {
        self.file_in(self.phase, relative)
    }

    fn file_in(&self, phase: Phase, relative: &str) -> Result<PathBuf, PhaseError> {
        let path = self.run.join(phase.folder()).join(relative);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|source| PhaseError::Folder { path: folder.to_owned(), source })?;
        }
        Ok(path)
    }

    /// Writes JSON into the phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_json<T: Serialize + ?Sized>(&self, relative: &str, value: &T) -> Result<(), PhaseError> {
        Ok(harmony_io::write_json(&self.file(relative)?, value)?)
    }

    /// Writes text into the phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_text(&self, relative: &str, text: &str) -> Result<(), PhaseError> {
        Ok(harmony_io::write_atomic(&self.file(relative)?, text.as_bytes())?)
    }

    /// Writes text into another phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_text_in(&self, phase: Phase, relative: &str, text: &str) -> Result<(), PhaseError> {
        Ok(harmony_io::write_atomic(&self.file_in(phase, relative)?, text.as_bytes())?)
    }

    /// Writes JSON into another phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_json_in<T: Serialize + ?Sized>(
        &self,
        phase: Phase,
        relative: &str,
        value: &T,
    ) -> Result<(), PhaseError> {
        Ok(harmony_io::write_json(&self.file_in(phase, relative)?, value)?)
    }

    /// Writes a PNG into the phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_picture(&self, relative: &str, image: &RgbImage) -> Result<(), PhaseError> {
        self.write_picture_in(self.phase, relative, image)
    }

    /// Writes a PNG into another phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_picture_in(&self, phase: Phase, relative: &str, image: &RgbImage) -> Result<(), PhaseError> {
        Ok(picture::write_rgb_png(&self.file_in(phase, relative)?, image)?)
    }

    /// Writes a PNG with alpha into another phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_picture_rgba_in(&self, phase: Phase, relative: &str, image: &RgbaImage) -> Result<(), PhaseError> {
        Ok(picture::write_rgba_png(&self.file_in(phase, relative)?, image)?)
    }

    /// Writes a PNG with alpha into the phase's folder.
    ///
    /// # Errors
    /// Unwritable files.
    pub fn write_picture_rgba(&self, relative: &str, image: &RgbaImage) -> Result<(), PhaseError> {
        Ok(picture::write_rgba_png(&self.file(relative)?, image)?)
    }
}
