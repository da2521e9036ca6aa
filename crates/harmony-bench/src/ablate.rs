//! The full configuration beside variants that lack one part each: the paper's ablation table and further switches.
//! Key `eval.ablation`.

use std::fmt::Write;

use harmony_calls::Cast;
use harmony_io::FileError;
use serde::{Deserialize, Serialize};

use crate::overrides::{OverrideError, switches_off, with_change};
use crate::report::{csv, write_tables};
use crate::run::{BenchError, BenchRequest, BenchResult, run};
use crate::summary::{
    CHAMFER_OBJECTS, F_OBJECTS, Figure, HOST, LPIPS, N_CLIP, PENETRATING, PIXEL_LOSS, POSITION, POSITION_SMALL, RECALL,
    SIZE, VIEWS_IOU, VIEWS_SEEN, VIEWS_UNSEEN, YAW, find, number, summary,
};

/// Name of the variant that lacks nothing.
pub const FULL: &str = "full";

/// A row of the paper's ablation table ("Ablation of our key design choices", label `tab:ablation`, Sec. "Ablation
/// Study").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperRow {
    /// The change to our settings that stands for it.
    pub change: &'static str,
    /// Its name in the paper.
    pub name: &'static str,
    /// N-CLIP, lower is better.
    pub n_clip: f64,
    /// Pixel loss, lower is better.
    pub pixel_loss: f64,
}

/// The paper's ablation table. Its photos are not ours: compare differences, not values.
pub const PAPER: [PaperRow; 8] = [
    paper_row(FULL, "HARMONY (full)", 0.1034, 0.0462),
    paper_row("placement.depth_first=false", "w/o depth-first traversal", 0.1045, 0.0523),
    paper_row("placement.refinement=false", "w/o placement refinement", 0.1051, 0.0516),
    paper_row("placement.placement_order=false", "w/o placement order", 0.1065, 0.0477),
    paper_row("placement.point_map=false", "w/o VGGT refinement", 0.1069, 0.0509),
    paper_row("placement.relations=false", "w/o VLM placement reasoning", 0.1079, 0.0522),
    paper_row("review_rounds=0", "w/o feedback loop", 0.1184, 0.0509),
    paper_row("camera_calibration=false", "w/o camera calibration", 0.1381, 0.0596),
];

const fn paper_row(change: &'static str, name: &'static str, n_clip: f64, pixel_loss: f64) -> PaperRow {
    PaperRow { change, name, n_clip, pixel_loss }
}

/// One row of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Variant {
    /// [`FULL`], or the change to the settings.
    pub change: String,
    /// Name for people: the paper's where it has this row.
    pub name: String,
    /// Figures, metres as delivered.
    pub figures: Vec<Figure>,
    /// Runs that failed.
    pub failed: usize,
}

/// All rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ablation {
    /// What was run, in words.
    pub title: String,
    /// The full configuration, then the paper's rows in its order, then further ones.
    pub variants: Vec<Variant>,
}

/// A column: heading, figure, which of its values, digits.
struct Column {
    heading: &'static str,
    figure: &'static str,
    p90: bool,
    digits: usize,
}

const fn column(heading: &'static str, figure: &'static str, p90: bool, digits: usize) -> Column {
    Column { heading, figure, p90, digits }
}

const COLUMNS: [Column; 16] = [
    column("position m", POSITION, false, 3),
    column("p90 m", POSITION, true, 3),
    column("decor. m", POSITION_SMALL, false, 3),
    column("yaw %", YAW, false, 1),
    column("host %", HOST, false, 1),
    column("size %", SIZE, false, 2),
    column("recall %", RECALL, false, 1),
    column("F@0.1 %", F_OBJECTS, false, 2),
    column("CD m", CHAMFER_OBJECTS, false, 4),
    column("cutting", PENETRATING, false, 0),
    column("PL", PIXEL_LOSS, false, 4),
    column("N-CLIP", N_CLIP, false, 4),
    column("LPIPS", LPIPS, false, 4),
    column("PL seen", VIEWS_SEEN, false, 4),
    column("PL unseen", VIEWS_UNSEEN, false, 4),
    column("views IoU", VIEWS_IOU, false, 3),
];

impl Column {
    fn value(&self, variant: &Variant) -> Option<f64> {
        let figure = find(&variant.figures, self.figure)?;
        if self.p90 { figure.p90 } else { Some(figure.value) }.filter(|v| v.is_finite())
    }

    fn text(&self, variant: &Variant) -> String {
        self.value(variant).map_or_else(|| "-".to_owned(), |v| format!("{v:.*}", self.digits))
    }
}

/// An ablation cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AblationError {
    /// A room or run folder.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// A variant that is no change of a setting.
    #[error(transparent)]
    Override(#[from] OverrideError),
    /// A table.
    #[error(transparent)]
    File(#[from] FileError),
}

/// The variants of some settings: full, the paper's in its order, then every further switch that is on.
pub fn variants(settings: &harmony_pipeline::Settings) -> Vec<String> {
    let off = switches_off(settings);
    let known = |change: &String| PAPER.iter().position(|row| row.change == change);
    let mut papers: Vec<String> = off.iter().filter(|c| known(c).is_some()).cloned().collect();
    papers.sort_by_key(|c| known(c));
    let others = off.into_iter().filter(|c| known(c).is_none());
    std::iter::once(FULL.to_owned()).chain(papers).chain(others).collect()
}

/// The paper's row of a variant.
pub fn paper_of(change: &str) -> Option<&'static PaperRow> {
    PAPER.iter().find(|row| row.change == change)
}

fn name_of(change: &str) -> String {
    match paper_of(change) {
        Some(row) => row.name.to_owned(),
        None => match change.strip_suffix("=false") {
            Some(key) => match key.strip_prefix("looks.") {
                Some(look) => format!("w/o look at {look}"),
                None => format!("w/o {}", key.trim_start_matches("placement.").replace('_', " ")),
            },
            None => change.to_owned(),
        },
    }
}

/// Runs the variants one after the other, with the same rooms and seeds, each into its own folder in `request.out`.
/// The tables are written after every variant, so that an ablation that is stopped leaves what it has.
///
/// # Errors
/// Folders that cannot be used, a variant that is no change of a setting.
pub async fn ablate(
    request: &BenchRequest,
    changes: &[String],
    offline: &Cast,
    tell: &(dyn Fn(String) + Sync),
) -> Result<Ablation, AblationError> {
    let requests: Vec<BenchRequest> = changes
        .iter()
        .map(|change| {
            let mut variant = request.clone();
            variant.out = request.out.join(folder_of(change));
            if change != FULL {
                variant.settings = with_change(&request.settings, change)?;
                variant.changes.push(change.clone());
            }
            Ok(variant)
        })
        .collect::<Result<_, OverrideError>>()?;
    let mut ablation = Ablation { title: String::new(), variants: Vec::new() };
    for (change, variant) in changes.iter().zip(&requests) {
        tell(format!("{} ({change})", name_of(change)));
        let result = run(variant, offline, tell).await?;
        write_tables(&variant.out, &result)?;
        ablation.title.clone_from(&result.title);
        ablation.variants.push(variant_of(change, &result));
        write(&request.out, &ablation)?;
    }
    Ok(ablation)
}

/// A folder's name for a change: `placement.refinement=false` becomes `placement_refinement_false`.
fn folder_of(change: &str) -> String {
    change.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect()
}

/// A row from a result.
pub fn variant_of(change: &str, result: &BenchResult) -> Variant {
    Variant {
        change: change.to_owned(),
        name: name_of(change),
        figures: summary(&result.raw),
        failed: result.raw.iter().filter(|r| r.failure.is_some()).count(),
    }
}

fn write(out: &std::path::Path, ablation: &Ablation) -> Result<(), FileError> {
    harmony_io::write_json(&out.join("ablation.json"), ablation)?;
    harmony_io::write_atomic(&out.join("ablation.csv"), csv_table(ablation).as_bytes())?;
    harmony_io::write_atomic(&out.join("ablation.md"), markdown(ablation).as_bytes())
}

/// The table for a terminal.
pub fn text_table(ablation: &Ablation) -> String {
    let mut out = format!("{:<32}", "variant");
    for c in &COLUMNS {
        let _ = write!(out, " {:>10}", c.heading);
    }
    out.push_str("   failed\n");
    for v in &ablation.variants {
        let _ = write!(out, "{:<32}", v.name);
        for c in &COLUMNS {
            let _ = write!(out, " {:>10}", c.text(v));
        }
        let _ = writeln!(out, "   {}", v.failed);
    }
    out
}

/// The table as CSV, with the paper's numbers.
pub fn csv_table(ablation: &Ablation) -> String {
    let head = ["variant", "change"].into_iter().chain(COLUMNS.iter().map(|c| c.heading));
    let head = head.chain(["failed", "paper N-CLIP", "paper PL"]).map(str::to_owned);
    let mut out = csv::line(head);
    for v in &ablation.variants {
        let paper = paper_of(&v.change);
        let optional = |n: Option<f64>| n.map_or_else(String::new, csv::number);
        let fields = [v.name.clone(), v.change.clone()].into_iter();
        let fields = fields.chain(COLUMNS.iter().map(|c| optional(c.value(v))));
        out.push_str(&csv::line(fields.chain([
            v.failed.to_string(),
            optional(paper.map(|p| p.n_clip)),
            optional(paper.map(|p| p.pixel_loss)),
        ])));
    }
    out
}

/// The table as Markdown: values, then changes against the full configuration beside the paper's.
pub fn markdown(ablation: &Ablation) -> String {
    let headings: Vec<&str> = COLUMNS.iter().map(|c| c.heading).collect();
    let rule = |columns: usize| format!("|---|{}\n", "---:|".repeat(columns));
    let mut out = format!(
        "# Ablation\n\n{}; metres as delivered.\nPosition is the median error of furniture, wall and ceiling objects \
         and its 90th percentile; F and CD are those of the protocol gen3dsr on objects; PL compares the evenly lit \
         render with the photo; PL seen, PL unseen and views IoU are from the rooms' other views, on surfaces that \
         the photo saw and on those it did not, and of objects' silhouettes.\n\n| variant | {} |\n{}",
        ablation.title,
        headings.join(" | "),
        rule(headings.len())
    );
    for v in &ablation.variants {
        let cells: Vec<String> = COLUMNS.iter().map(|c| c.text(v)).collect();
        let _ = writeln!(out, "| {} | {} |", v.name, cells.join(" | "));
    }
    out.push_str(
        "\n## Beside the paper\n\nThe paper's numbers are from its table \"Ablation of our key design choices\" \
         (Sec. Ablation Study), on its own photos. The values cannot be compared, their order and signs can.\nN-CLIP \
         stands in the table above where CLIP's weights were there.\n\n| variant | PL ours | change | PL paper | change | N-CLIP \
         paper | change | our position m | change |\n",
    );
    out.push_str(&rule(8));
    let full = ablation.variants.iter().find(|v| v.change == FULL);
    let change = |value: Option<f64>, from: Option<f64>| {
        value.zip(from).map_or_else(|| "-".to_owned(), |(v, f)| format!("{:+.1} %", 100.0 * (v / f - 1.0)))
    };
    let paper_full = &PAPER[0];
    for v in &ablation.variants {
        let paper = paper_of(&v.change);
        let four = |n: Option<f64>| n.map_or_else(|| "-".to_owned(), |n| format!("{n:.4}"));
        let ours = |name: &str| find(&v.figures, name).map(|f| f.value).filter(|n| n.is_finite());
        let base = |name: &str| find(&full?.figures, name).map(|f| f.value).filter(|n| n.is_finite());
        let (loss, clip) = (paper.map(|p| p.pixel_loss), paper.map(|p| p.n_clip));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            v.name,
            four(ours(PIXEL_LOSS)),
            change(ours(PIXEL_LOSS), base(PIXEL_LOSS)),
            four(loss),
            change(loss, Some(paper_full.pixel_loss)),
            four(clip),
            change(clip, Some(paper_full.n_clip)),
            ours(POSITION).map_or_else(|| "-".to_owned(), number),
            change(ours(POSITION), base(POSITION)),
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use harmony_pipeline::Settings;

    use super::*;

    #[test]
    fn every_row_of_the_paper_has_its_switch() {
        let all = variants(&Settings::default());
        assert_eq!(all[..PAPER.len()], PAPER.map(|row| row.change.to_owned()), "in the paper's order, before ours");
        assert!(
            all.len() > PAPER.len() && all.iter().all(|c| c == FULL || with_change(&Settings::default(), c).is_ok())
        );
        assert_eq!(name_of("placement.optimiser=false"), "w/o optimiser");
        assert_eq!(name_of("looks.hosts=false"), "w/o look at hosts");
        assert_eq!(folder_of("placement.refinement=false"), "placement_refinement_false");
    }

    #[test]
    fn tables_have_a_row_a_variant() {
        let empty = BenchResult {
            title: "no rooms".to_owned(),
            level: None,
            exact_height: false,
            meshes: None,
            changes: Vec::new(),
            absent: Vec::new(),
            raw: Vec::new(),
            aligned: Vec::new(),
        };
        let rows = [FULL, "placement.refinement=false"].map(|change| variant_of(change, &empty));
        let ablation = Ablation { title: "no rooms".to_owned(), variants: rows.to_vec() };
        assert_eq!(text_table(&ablation).lines().count(), 3);
        let csv = csv_table(&ablation);
        let widths: Vec<usize> = csv.lines().map(|l| l.split(',').count()).collect();
        assert_eq!(widths, [2 + COLUMNS.len() + 3; 3], "{csv}");
        assert!(csv.lines().nth(2).unwrap().ends_with("0,0.1051,0.0516"), "{csv}");
        assert!(markdown(&ablation).contains("+11.7 %"), "PL of the paper without refinement, against its full one");
    }
}
