//! Running a job.

use super::{CyclesJob, CyclesOutput, CyclesRenderer, LitError};

/// How far a render is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Samples done.
    pub sample: u32,
    /// Samples wanted.
    pub of: u32,
}

impl CyclesRenderer {
    /// Renders one job and waits for it.
    ///
    /// # Errors
    /// [`LitError`]: no scene, a time-out, or a failure of Blender with the end of its log.
    pub fn render(&self, job: &CyclesJob) -> Result<CyclesOutput, LitError> {
        self.render_with(job, &mut |_| {})
    }

    /// As [`Self::render`], with progress.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn render_with(&self, job: &CyclesJob, progress: &mut dyn FnMut(Progress)) -> Result<CyclesOutput, LitError> {
        let _ = (job, progress);
        Err(LitError::NotFound)
    }
}
