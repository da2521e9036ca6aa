//! What a set has come to: numbers for people and for files.

use std::path::Path;

use image::imageops::FilterType;
use serde::Serialize;

use crate::queue::{CauseCount, Counts, Queue, SceneRow, SetRow, StageCount, WorkerRow};
use crate::set::SetFolder;
use crate::{BatchError, page};

/// A worker that was silent for longer is taken for gone, milliseconds.
const SILENT_MS: i64 = 90_000;

/// Scenes of each kind that are listed; a page of a million would not open.
const LISTED: i64 = 200;

/// Size of the small pictures, pixels.
const THUMB: u32 = 240;

/// Numbers of scenes that are read at a time for `scenes.csv`: rows as they come from the database take ten times the
/// memory of their lines.
const AT_ONCE: i64 = 10_000;

/// See the module.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    /// When, milliseconds since 1970 by the database's clock.
    pub now: i64,
    /// The set.
    pub set: SetRow,
    /// Scenes by state.
    pub counts: Counts,
    /// Failures by stage.
    pub stages: Vec<StageCount>,
    /// Failures by stage and cause, most frequent first.
    pub causes: Vec<CauseCount>,
    /// Workers that were heard of lately.
    pub workers: Vec<WorkerRow>,
    /// Scenes that run.
    pub running: Vec<SceneRow>,
    /// Scenes that failed, the last first.
    pub failed: Vec<SceneRow>,
    /// Scenes that are done, the last first.
    pub done: Vec<SceneRow>,
    /// Seconds until all have ended, at the pace of those that are done; `None` when none is, or nobody works.
    pub left_s: Option<f64>,
    /// US dollars that the scenes that have not ended will take at the mean of those that are done.
    pub left_usd: Option<f64>,
}

impl Status {
    /// Looks.
    ///
    /// # Errors
    /// [`BatchError::Database`], [`BatchError::Unknown`].
    pub async fn of(queue: &Queue, set: &str) -> Result<Self, BatchError> {
        let set = queue.set(set).await?;
        let now = queue.now().await?;
        let counts = queue.counts(set.id).await?;
        let causes = queue.causes(set.id).await?;
        let workers = queue.workers(SILENT_MS).await?;
        let running = queue.scenes(set.id, "running", LISTED).await?;
        let slots: i64 = workers.iter().map(|w| w.slots).sum();
        // Scenes that run are half done, as far as anybody knows.
        let work = (counts.queued + counts.waiting) as f64 + 0.5 * counts.running as f64;
        let known = counts.done > 0;
        let left_s = (known && slots > 0).then(|| work * counts.mean_busy_ms / 1000.0 / slots as f64);
        let left_usd = known.then_some(work * counts.mean_paid_usd);
        Ok(Self {
            now,
            stages: StageCount::of(&causes),
            running,
            failed: queue.scenes(set.id, "failed", LISTED).await?,
            done: queue.scenes(set.id, "done", LISTED).await?,
            set,
            counts,
            causes,
            workers,
            left_s,
            left_usd,
        })
    }

    /// For the terminal.
    pub fn text(&self, folder: &Path) -> String {
        let c = &self.counts;
        let mut lines = vec![format!(
            "{}: {}{}",
            folder.display(),
            self.set.state.name(),
            if self.set.reason.is_empty() { String::new() } else { format!(" ({})", self.set.reason) }
        )];
        lines.push(format!("{} {} of {} done", bar(c), c.done, c.all()));
        lines.push(format!(
            "running {}, queued {}, waiting for a retry {}, failed {}, cancelled {}",
            c.running, c.queued, c.waiting, c.failed, c.cancelled
        ));
        lines.push(self.money());
        if c.done > 0 {
            let left = self.left_s.filter(|_| c.open() > 0);
            lines.push(format!(
                "{} a scene{}",
                spoken(c.mean_busy_ms / 1000.0),
                left.map_or_else(String::new, |s| format!(", about {} left", spoken(s)))
            ));
        }
        let busy: i64 = self.workers.iter().map(|w| w.busy).sum();
        let slots: i64 = self.workers.iter().map(|w| w.slots).sum();
        lines.push(format!("{} workers, {busy} of {slots} places busy", self.workers.len()));
        if !self.causes.is_empty() {
            lines.push("failures:".to_owned());
            for cause in self.causes.iter().take(20) {
                lines.push(format!(
                    "  {:>5} failed {:>5} waiting  {:<13} {}  (such as {})",
                    cause.failed, cause.waiting, cause.stage, cause.cause, cause.example
                ));
            }
            lines.push("try again: harmony batch retry SET --stage STAGE --cause TEXT".to_owned());
        }
        lines.join("\n")
    }

    /// What was spent, in one line.
    pub fn money(&self) -> String {
        let set = &self.set;
        let mut line = format!("{:.2} US$ spent", set.spent_usd);
        if set.flying_usd > 0.005 {
            line += &format!(" and {:.2} in flight", set.flying_usd);
        }
        if let Some(limit) = set.budget_usd {
            line += &format!(" of {limit:.2}");
        }
        line += &format!(" in {} calls", set.spent_calls);
        if let Some(limit) = set.budget_calls {
            line += &format!(" of {limit}");
        }
        if let Some(left) = self.left_usd.filter(|usd| *usd >= 0.005) {
            line += &format!(", about {left:.2} to come");
        }
        line
    }

    /// Writes `status.html` and `status.json`.
    ///
    /// # Errors
    /// [`BatchError::File`].
    pub fn write(&self, folder: &SetFolder) -> Result<(), BatchError> {
        harmony_io::write_json(&folder.path().join("status.json"), self)?;
        let page = page::page(self, folder);
        Ok(harmony_io::write_atomic(&folder.path().join("status.html"), page.as_bytes())?)
    }
}

/// Writes `scenes.csv`: one line a scene.
///
/// # Errors
/// [`BatchError::Database`], [`BatchError::File`].
pub async fn write_table(queue: &Queue, set: &SetRow, folder: &SetFolder) -> Result<(), BatchError> {
    let mut lines: Vec<(String, String)> = Vec::new();
    if let Some((first, last)) = queue.numbers(set.id).await? {
        let mut begin = first;
        while begin <= last {
            let end = begin.saturating_add(AT_ONCE - 1).min(last);
            let rows = queue.scenes_between(set.id, begin, end).await?;
            for row in rows {
                let line = line(&row);
                lines.push((row.scene, line));
            }
            begin = end.saturating_add(1);
        }
    }
    lines.sort_unstable();
    let mut text = String::from("scene,state,stage,cause,seconds,paid_usd,bill_usd,calls,failed,lost,photo\n");
    text.extend(lines.drain(..).map(|(_, line)| line));
    Ok(harmony_io::write_atomic(&folder.path().join("scenes.csv"), text.as_bytes())?)
}

/// A scene's line of `scenes.csv`.
fn line(row: &SceneRow) -> String {
    let bill = row.bill_usd.map_or_else(String::new, |usd| format!("{usd:.4}"));
    let (stage, cause) = if row.state == "done" { ("", "") } else { (row.stage.as_str(), row.cause.as_str()) };
    format!(
        "{},{},{},{},{:.3},{:.4},{bill},{},{},{},{}\n",
        quoted(&row.scene),
        row.state,
        quoted(stage),
        quoted(cause),
        row.busy_ms as f64 / 1000.0,
        row.paid_usd,
        row.calls,
        row.attempts,
        row.losses,
        quoted(&row.photo),
    )
}

/// A field of a CSV file.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn bar(counts: &Counts) -> String {
    const WIDTH: i64 = 40;
    let all = counts.all().max(1);
    let part = |n: i64| (n * WIDTH / all) as usize;
    let (done, failed) = (part(counts.done), part(counts.failed + counts.cancelled));
    let rest = (WIDTH as usize).saturating_sub(done + failed);
    format!("[{}{}{}]", "#".repeat(done), "x".repeat(failed), ".".repeat(rest))
}

/// A duration in words.
pub fn spoken(seconds: f64) -> String {
    match seconds {
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.1} days", s / 86_400.0),
    }
}

/// The photo and the scene's picture beside each other, small. Nothing when one of them cannot be read.
pub(crate) fn write_thumb(photo: &Path, run: &Path, thumb: &Path) -> Option<()> {
    let render =
        ["render_lit.png", "render_flat.png"].into_iter().map(|name| run.join(name)).find(|path| path.is_file())?;
    let small = |path: &Path| Some(image::open(path).ok()?.resize(THUMB, THUMB, FilterType::Triangle).into_rgb8());
    // The run's own copy of the photo is upright; the one that was handed in need not be.
    let (left, right) = (small(photo)?, small(&render)?);
    let mut both = image::RgbImage::new(left.width() + right.width(), left.height().max(right.height()));
    image::imageops::replace(&mut both, &left, 0, 0);
    image::imageops::replace(&mut both, &right, i64::from(left.width()), 0);
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 80);
    both.write_with_encoder(encoder).ok()?;
    harmony_io::write_atomic(thumb, &bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_durations_and_fields_read_well() {
        let counts = Counts { done: 20, failed: 10, queued: 10, ..Counts::default() };
        assert_eq!(bar(&counts), format!("[{}{}{}]", "#".repeat(20), "x".repeat(10), ".".repeat(10)));
        assert_eq!(bar(&Counts::default()).len(), 42);
        let words: Vec<String> = [0.25, 61.0, 600.0, 40_000.0, 4e5].into_iter().map(spoken).collect();
        assert_eq!(words, ["0.2 s", "61 s", "10 min", "11.1 h", "4.6 days"]);
        assert_eq!(quoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
    }
}
