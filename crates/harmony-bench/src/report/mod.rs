//! What a benchmark leaves in its folder: scores, tables, one page for people.

pub mod csv;
mod page;
mod pictures;
mod svg;
mod views;

use std::path::Path;

use harmony_io::{FileError, write_atomic, write_json};

pub use page::page;
pub use pictures::case_picture;
pub use svg::histogram;

use crate::run::BenchResult;

/// Writes `scores.json`, `table.csv`, `objects.csv`, `looks.csv` and `views.csv` where there are looks and views, and `report.html`; pictures are taken from `cases/`.
///
/// # Errors
/// A file that cannot be written.
pub fn write_tables(out: &Path, result: &BenchResult) -> Result<(), FileError> {
    std::fs::create_dir_all(out).map_err(|source| FileError::Write { path: out.to_owned(), source })?;
    write_json(&out.join("scores.json"), result)?;
    write_atomic(&out.join("table.csv"), csv::figures(result).as_bytes())?;
    write_atomic(&out.join("objects.csv"), csv::objects(&result.raw).as_bytes())?;
    if result.raw.iter().any(|r| !r.looks.is_empty()) {
        write_atomic(&out.join("looks.csv"), csv::looks(&result.raw).as_bytes())?;
    }
    if result.raw.iter().any(|r| !r.views.is_empty() || r.lit.is_some()) {
        write_atomic(&out.join("views.csv"), crate::views::csv(&result.raw).as_bytes())?;
    }
    write_atomic(&out.join("report.html"), page(result, out).as_bytes())
}
