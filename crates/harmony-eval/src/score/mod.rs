//! How much a render looks like its photo, over a set of scenes.
//! Key `eval.pictures`.
//!
//! # What is compared
//! A scene's flat and lit render from the recovered camera, each with the photo, as VIGA's evaluation does it (the
//! paper, Sec. 4, follows it): the **photo is resized to the render's size** with Pillow's bicubic filter, whatever its
//! shape. Ours have the photo's shape; a square render of another program is compared with a squashed photo, and that
//! is told ([`Shot::squash`]).
//!
//! # Three means
//! The release of the paper leaves failed scenes out of a method's mean. Here three means always stand together:
//! *own* over what the column has, *intersection* over the scenes that every column has, *failures as worst* over all
//! scenes, where a missing one gets the worst value that any column has in any scene (a stated guess: there is no
//! natural worst value; N-CLIP and LPIPS have no useful bound).
//!
//! # Limits
//! CLIP's cosines lie in a narrow band: differences mean something, values little. N-CLIP never sees the left and right
//! ends of a wide photo (CLIP crops to a square). Figures of different sets of scenes must not be compared.

pub mod csv;
mod metric;
mod page;
mod runs;
mod table;
mod text;

pub use metric::{Looks, MetricError, MetricId, PictureMetric, PixelLoss};
pub use page::page;
pub use runs::{RunEntry, RunSet, RunsError, SetOptions, find_set};
pub use table::{Column, ColumnKey, Comparison, Evaluation, Look, SceneScore, Shot, compare_sets, evaluate};
pub use text::{comparisons, table};

use std::path::Path;

use harmony_io::{FileError, write_atomic, write_json};

/// Writes `eval.json`, `scenes.csv`, `table.csv` and eval.html.
///
/// # Errors
/// A file that cannot be written.
pub fn write(out: &Path, evaluation: &Evaluation) -> Result<(), FileError> {
    write_json(&out.join("eval.json"), evaluation)?;
    write_atomic(&out.join("scenes.csv"), csv::scenes(evaluation).as_bytes())?;
    write_atomic(&out.join("table.csv"), csv::table(evaluation).as_bytes())?;
    write_atomic(&out.join("eval.html"), page(evaluation).as_bytes())
}
