//! The report: one self-contained page about a run.
//!
//! Everything that is shown comes from a scene, a run's data and the run folder's pictures; all of it may hold what a
//! model wrote, so every text is escaped, paths cannot leave the run folder, and the page forbids itself the network.

mod data;
mod html;
mod pictures;
mod sections;

use std::path::Path;

pub use data::{
    CallRow, DroppedObject, Evidence, Fact, ObjectReport, PhaseReport, PhaseStatus, PlausibilityRow, ReportData,
    ReportPicture,
};
use harmony_io::FileError;
use harmony_scene::Scene;

use html::{esc, script_json};

/// What the page allows itself: its own inline parts and data, nothing from outside.
const POLICY: &str = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; \
                      connect-src data: blob:; base-uri 'none'; form-action 'none'";

/// The report cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The page cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The page's data has no JSON form.
    #[error("the report's data cannot be encoded: {0}")]
    Encode(#[from] serde_json::Error),
}

impl ReportError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Encode(_) => None,
        }
    }
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
    let page = report_html(run_folder, scene, report)?;
    Ok(harmony_io::write_atomic(&run_folder.join("report.html"), page.as_bytes())?)
}

/// The page as text; see [`write_report`].
///
/// # Errors
/// [`ReportError::Encode`].
pub fn report_html(run_folder: &Path, scene: &Scene, report: &ReportData) -> Result<String, ReportError> {
    // What embeds files takes the time.
    let (pictures, ((view3d, scripts), objects)) = rayon::join(
        || sections::pictures(run_folder, report),
        || (sections::view3d(run_folder), sections::objects(run_folder, scene, report)),
    );
    let parts = [
        sections::overview(scene, report),
        pictures,
        view3d,
        sections::phases(scene, report),
        sections::room(scene, report),
        sections::plausibility(&[]),
        objects,
        sections::calls(report, scene.objects.len()),
    ];
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta http-equiv=\"Content-Security-Policy\" \
         content=\"{POLICY}\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{title}</title>\
         <style>{css}</style></head><body>{body}</main><footer>{generator}. Metres; x to the right, y up, z from the back \
         wall towards the viewer.</footer><dialog id=\"large\"><img alt=\"\"></dialog><script type=\"application/json\" \
         id=\"scene\">{json}</script>{scripts}<script>{js}</script></body></html>\n",
        title = esc(if report.title.is_empty() { "Scene" } else { &report.title }),
        css = include_str!("../assets/page.css"),
        body = parts.concat(),
        generator = esc(&scene.generator),
        json = script_json(scene)?,
        js = include_str!("../assets/page.js"),
    ))
}

/// Fills the table of plausibility of `<run_folder>/report.html` in; `false` when there is no page, or one without a
/// place for it.
///
/// # Errors
/// [`ReportError::File`] for a page that cannot be written.
pub fn show_plausibility(run_folder: &Path, rows: &[PlausibilityRow]) -> Result<bool, ReportError> {
    let path = run_folder.join("report.html");
    let Ok(page) = std::fs::read_to_string(&path) else { return Ok(false) };
    let Some(page) = sections::filled(&page, rows) else { return Ok(false) };
    harmony_io::write_atomic(&path, page.as_bytes())?;
    Ok(true)
}

#[cfg(test)]
mod tests;
