//! The paper's ablation table on photos: the full configuration and variants that lack one part each, played by
//! recordings, judged by their pictures.
//!
//! A recording answers by the names of questions. A variant that asks other questions than the recording has answers for
//! gets the stand-in's answers there: differences are therefore those of the geometry around the answers, as far as the
//! recording reaches, and a variant that needs new answers is judged at its worst. How many answers came from the
//! recording is told for each variant.
//!
//! Rooms with truth have the same table with errors of place and turn, and views where no photo was taken:
//! `harmony bench ablate`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use harmony_bench::ablate::{FULL, paper_of};
use harmony_bench::overrides::{OverrideError, with_change};
use harmony_bench::report::csv;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast};
use harmony_io::load_photo;
use harmony_pipeline::{Phase, ProgressSink, RunRequest, Settings, Warnings};
use harmony_scene::Level;
use serde::{Deserialize, Serialize};

use crate::score::{
    ColumnKey, Evaluation, Look, Looks, MetricId, RunsError, SetOptions, evaluate, find_set, write as write_evaluation,
};

/// Extensions of photos.
const PICTURES: [&str; 7] = ["jpg", "jpeg", "png", "webp", "bmp", "tif", "tiff"];

/// A photo and the recording of its answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subject {
    /// Name, also its run folders'.
    pub name: String,
    /// The photo.
    pub photo: PathBuf,
    /// Its recording.
    pub recording: PathBuf,
}

/// What is run.
pub struct AblateRequest {
    /// Photos with recordings.
    pub subjects: Vec<Subject>,
    /// Folder for the runs and tables.
    pub out: PathBuf,
    /// Settings of the full configuration.
    pub settings: Settings,
    /// Variants: [`FULL`] first, then changes.
    pub changes: Vec<String>,
    /// Whether lit renders are made, too.
    pub lit: bool,
    /// Seed of the intervals.
    pub seed: u64,
}

/// A row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotoVariant {
    /// [`FULL`], or the change.
    pub change: String,
    /// Runs that left no render.
    pub failed: usize,
    /// Answers taken from the recordings, and from the stand-in.
    pub answers: [usize; 2],
}

/// The table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotoAblation {
    /// Rows, in the order of the sets of `evaluation`.
    pub variants: Vec<PhotoVariant>,
    /// Their pictures: the full configuration is the first set, so that the others are compared with it in pairs.
    pub evaluation: Evaluation,
}

/// It cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PhotoAblationError {
    /// No photo has a recording.
    #[error("no photo in {photos} has a recording of its name in {recordings}")]
    NoSubjects {
        /// Folder of the photos.
        photos: PathBuf,
        /// Folder of the recordings.
        recordings: PathBuf,
    },
    /// A folder.
    #[error("cannot read {path}: {source}")]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A variant that is no change of a setting.
    #[error(transparent)]
    Override(#[from] OverrideError),
    /// A photo, a recording or a run.
    #[error("{name}, {change}: {reason}")]
    Run {
        /// Which photo.
        name: String,
        /// Which variant.
        change: String,
        /// Why.
        reason: String,
    },
    /// The runs afterwards.
    #[error(transparent)]
    Runs(#[from] RunsError),
    /// A table.
    #[error(transparent)]
    File(#[from] harmony_io::FileError),
}

/// Photos of a folder that have a recording of their name (`<name>` or `<name>_recording`) in another.
///
/// # Errors
/// Folders that cannot be read, or no photo with a recording.
pub fn subjects(photos: &Path, recordings: &Path) -> Result<Vec<Subject>, PhotoAblationError> {
    let read = |path: &Path| {
        let fail = |source| PhotoAblationError::Read { path: path.to_owned(), source };
        let entries = std::fs::read_dir(path).map_err(fail)?;
        let mut all: Vec<PathBuf> = entries.filter_map(Result::ok).map(|e| e.path()).collect();
        all.sort();
        Ok::<_, PhotoAblationError>(all)
    };
    let held: BTreeMap<String, PathBuf> = read(recordings)?
        .into_iter()
        .filter(|p| p.join("recording.json").is_file())
        .filter_map(|p| {
            let name = p.file_name()?.to_string_lossy().into_owned();
            Some((name.strip_suffix("_recording").unwrap_or(&name).to_owned(), p))
        })
        .collect();
    let found: Vec<Subject> = read(photos)?
        .into_iter()
        .filter(|p| p.extension().is_some_and(|e| PICTURES.contains(&e.to_string_lossy().to_lowercase().as_str())))
        .filter_map(|photo| {
            let name = photo.file_stem()?.to_string_lossy().into_owned();
            let recording = held.get(&name)?.clone();
            Some(Subject { name, photo, recording })
        })
        .collect();
    if found.is_empty() {
        return Err(PhotoAblationError::NoSubjects { photos: photos.to_owned(), recordings: recordings.to_owned() });
    }
    Ok(found)
}

fn folder_of(change: &str) -> String {
    change.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect()
}

/// Runs every variant on every photo, and judges the pictures. Runs that are finished are not run again.
///
/// # Errors
/// [`PhotoAblationError`]; a phase that fails is none: the run then counts as failed.
pub async fn ablate_photos(
    request: &AblateRequest,
    cast: &Cast,
    looks: &Looks,
    tell: &(dyn Fn(String) + Sync),
) -> Result<PhotoAblation, PhotoAblationError> {
    let mut variants = Vec::new();
    let mut settings = Vec::new();
    for change in &request.changes {
        settings.push(if change == FULL { request.settings.clone() } else { with_change(&request.settings, change)? });
    }
    for (change, settings) in request.changes.iter().zip(settings) {
        let mut answers = [0; 2];
        for subject in &request.subjects {
            let run = request.out.join(folder_of(change)).join(&subject.name);
            let counted = one(request, subject, change, &run, settings.clone(), cast).await?;
            answers = [answers[0] + counted[0], answers[1] + counted[1]];
            tell(format!("{change}: {}", subject.name));
        }
        variants.push(PhotoVariant { change: change.clone(), failed: 0, answers });
    }
    let mut sets = Vec::new();
    for change in &request.changes {
        let source = request.out.join(folder_of(change)).to_string_lossy().into_owned();
        sets.push(find_set(change, &[source], &SetOptions::default())?);
    }
    for (variant, set) in variants.iter_mut().zip(&sets) {
        variant.failed = set.runs.iter().filter(|r| r.failure.is_some()).count();
    }
    let evaluation = evaluate(&sets, looks, request.seed, &|_| {});
    let ablation = PhotoAblation { variants, evaluation };
    write_evaluation(&request.out, &ablation.evaluation)?;
    harmony_io::write_json(&request.out.join("ablation.json"), &ablation)?;
    harmony_io::write_atomic(&request.out.join("ablation.csv"), csv_table(&ablation).as_bytes())?;
    Ok(ablation)
}

async fn one(
    request: &AblateRequest,
    subject: &Subject,
    change: &str,
    run: &Path,
    settings: Settings,
    cast: &Cast,
) -> Result<[usize; 2], PhotoAblationError> {
    let fail =
        |reason: String| PhotoAblationError::Run { name: subject.name.clone(), change: change.to_owned(), reason };
    let photo = load_photo(&subject.photo).map_err(|e| fail(e.to_string()))?;
    std::fs::create_dir_all(run).map_err(|e| fail(e.to_string()))?;
    let options = BookOptions { replay: Some(subject.recording.clone()), ..BookOptions::default() };
    let book = CallBook::open(run, options).map_err(|e| fail(e.to_string()))?;
    let warnings = Arc::new(Warnings::default());
    let collected = Arc::clone(&warnings);
    let options = CallOptions { on_warning: Arc::new(move |w| collected.push(w)), ..CallOptions::default() };
    let calls = Arc::new(Calls::new(Arc::new(book), cast.clone(), cast.clone(), options));
    let request = RunRequest {
        photo,
        title: subject.name.clone(),
        run: run.to_owned(),
        profile: format!("ablation {change} (replayed)"),
        settings,
        until: if request.lit { Phase::Lighting } else { Phase::Objects(Level::Decoration) },
        path_tracer: request.lit,
        further_inputs: change.to_owned(),
    };
    let silent: ProgressSink = Arc::new(|_| {});
    let outcome = Box::pin(harmony_pipeline::run(&request, &calls, &warnings, &silent)).await;
    outcome.map_err(|e| fail(e.to_string()))?;
    let counts = calls.counts();
    Ok([counts.replayed, counts.asked])
}

/// The figures of a variant's look that the table shows: mean, and its difference from the full configuration.
fn cell(a: &PhotoAblation, set: usize, look: Look, metric: MetricId) -> Option<(f64, Option<(f64, f64)>)> {
    let key = ColumnKey { set, look, metric };
    let own = a.evaluation.columns.iter().find(|c| c.key == key)?.own?;
    let pair = a.evaluation.comparisons.iter().find(|c| c.against == set && c.look == look && c.metric == metric);
    // A comparison is the full configuration minus the variant.
    Some((own.mean, pair.map(|p| (-p.paired.difference.mean, p.paired.p))))
}

/// Look of the table: lit where it was made for the full configuration, else flat.
fn shown(a: &PhotoAblation) -> Look {
    let lit = a.evaluation.columns.iter().any(|c| c.key.set == 0 && c.key.look == Look::Lit);
    if lit { Look::Lit } else { Look::Flat }
}

/// The table for a terminal, ours beside the paper's.
pub fn text(a: &PhotoAblation) -> String {
    let look = shown(a);
    let metrics: Vec<MetricId> =
        MetricId::ALL.into_iter().filter(|m| a.evaluation.columns.iter().any(|c| c.key.metric == *m)).collect();
    let mut out =
        format!("{} renders; difference from the full configuration in pairs, p of the sign test\n", look.name());
    let _ = write!(out, "{:<36} {:>6}", "variant", "failed");
    for m in &metrics {
        let _ = write!(out, " {:>10} {:>9} {:>6}", m.title(), "diff", "p");
    }
    let _ = writeln!(out, " {:>12} {:>9} {:>13}", "paper N-CLIP", "paper PL", "replayed");
    for (set, v) in a.variants.iter().enumerate() {
        let paper = paper_of(&v.change);
        let name = paper.map_or(v.change.as_str(), |p| p.name);
        let _ = write!(out, "{name:<36} {:>6}", v.failed);
        for m in &metrics {
            match cell(a, set, look, *m) {
                None => {
                    let _ = write!(out, " {:>10} {:>9} {:>6}", "-", "", "");
                }
                Some((mean, None)) => {
                    let _ = write!(out, " {mean:>10.4} {:>9} {:>6}", "", "");
                }
                Some((mean, Some((diff, p)))) => {
                    let _ = write!(out, " {mean:>10.4} {diff:>+9.4} {p:>6.3}");
                }
            }
        }
        let four = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
        let _ = writeln!(
            out,
            " {:>12} {:>9} {:>13}",
            four(paper.map(|p| p.n_clip)),
            four(paper.map(|p| p.pixel_loss)),
            format!("{}/{}", v.answers[0], v.answers[0] + v.answers[1])
        );
    }
    out
}

/// The table as CSV.
pub fn csv_table(a: &PhotoAblation) -> String {
    let look = shown(a);
    let mut head: Vec<String> =
        ["variant", "change", "render", "failed", "replayed", "stand_in"].map(str::to_owned).to_vec();
    for m in MetricId::ALL {
        head.extend(["", "_diff", "_p"].map(|k| format!("{}{k}", m.key())));
    }
    head.extend(["paper_n_clip", "paper_pl"].map(str::to_owned));
    let mut out = csv::line(head);
    let optional = |v: Option<f64>| v.map_or_else(String::new, csv::number);
    for (set, v) in a.variants.iter().enumerate() {
        let paper = paper_of(&v.change);
        let mut fields = vec![
            paper.map_or(v.change.as_str(), |p| p.name).to_owned(),
            v.change.clone(),
            look.name().to_owned(),
            v.failed.to_string(),
            v.answers[0].to_string(),
            v.answers[1].to_string(),
        ];
        for m in MetricId::ALL {
            let found = cell(a, set, look, m);
            let pair = found.and_then(|c| c.1);
            fields.extend([found.map(|c| c.0), pair.map(|p| p.0), pair.map(|p| p.1)].map(optional));
        }
        fields.extend([paper.map(|p| p.n_clip), paper.map(|p| p.pixel_loss)].map(optional));
        out.push_str(&csv::line(fields));
    }
    out
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn photos_meet_their_recordings_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let (photos, recordings) = (folder.path().join("photos"), folder.path().join("recordings"));
        for place in ["a_recording", "b", "c"] {
            fs::create_dir_all(recordings.join(place)).unwrap();
        }
        for place in ["a_recording", "b"] {
            fs::write(recordings.join(place).join("recording.json"), "{}").unwrap();
        }
        fs::create_dir_all(&photos).unwrap();
        for file in ["a.jpg", "b.PNG", "c.jpg", "d.jpg", "a.txt"] {
            fs::write(photos.join(file), "").unwrap();
        }
        let found: Vec<String> = subjects(&photos, &recordings).unwrap().into_iter().map(|s| s.name).collect();
        assert_eq!(found, ["a", "b"]);
        assert!(matches!(subjects(&recordings, &recordings), Err(PhotoAblationError::NoSubjects { .. })));
        assert!(matches!(subjects(&photos, &folder.path().join("x")), Err(PhotoAblationError::Read { .. })));
    }
}
