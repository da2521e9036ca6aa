//! Measured scenes, and the columns made of them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use harmony_bench::metrics::picture::resize_bicubic;
use harmony_io::picture;
use harmony_scene::ImageSize;
use image::RgbImage;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::metric::{Looks, MetricId};
use super::runs::{RunEntry, RunSet};
use crate::statistics::{Mean, Paired};

/// Which render.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Look {
    /// Path-traced with the estimated lights.
    Lit,
    /// Even light.
    Flat,
}

impl Look {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Lit, Self::Flat];

    /// As in columns.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lit => "lit",
            Self::Flat => "flat",
        }
    }
}

/// A render that was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shot {
    /// The picture.
    pub file: PathBuf,
    /// Its columns.
    pub width: u32,
    /// Its rows.
    pub height: u32,
    /// How much the photo's shape was changed: its aspect over the render's, 1 for none.
    pub squash: f64,
    /// Figures.
    pub values: BTreeMap<MetricId, f64>,
    /// What could not be measured, and why.
    pub errors: Vec<String>,
}

/// What a set has of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneScore {
    /// Its folder; `None` where the set lacks the scene.
    pub run: Option<PathBuf>,
    /// Whether its background was lent.
    pub starred: bool,
    /// How many things it has, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objects: Option<usize>,
    /// Why it has no render.
    pub failure: Option<String>,
    /// Renders.
    pub shots: BTreeMap<Look, Shot>,
}

/// A scene in all sets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneRow {
    /// Name.
    pub scene: String,
    /// The photo; `None` when no set has one that can be read: the scene then counts nowhere.
    pub photo: Option<PathBuf>,
    /// One a set.
    pub sets: Vec<SceneScore>,
}

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ColumnKey {
    /// Which set.
    pub set: usize,
    /// Which render.
    pub look: Look,
    /// Which figure.
    pub metric: MetricId,
}

/// Three means of a figure of a set's renders.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Column {
    /// What it holds.
    #[serde(flatten)]
    pub key: ColumnKey,
    /// Over what the set has.
    pub own: Option<Mean>,
    /// Over the scenes that every column of this figure has.
    pub intersection: Option<Mean>,
    /// Over all scenes, a missing one counted with `worst`.
    pub failures_as_worst: Option<Mean>,
    /// Scenes that are missing.
    pub missing: usize,
    /// The worst value of this figure in any column.
    pub worst: Option<f64>,
}

/// A set against the first one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// First set minus this one.
    pub against: usize,
    /// Which render.
    pub look: Look,
    /// Which figure.
    pub metric: MetricId,
    /// Over scenes that both have.
    pub paired: Paired,
}

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// What made it.
    pub generator: String,
    /// Seed of the intervals.
    pub seed: u64,
    /// Names of the sets.
    pub sets: Vec<String>,
    /// What is not measured and why, and what else must be known.
    pub notes: Vec<String>,
    /// Columns with at least one value.
    pub columns: Vec<Column>,
    /// The first set against each of the others.
    pub comparisons: Vec<Comparison>,
    /// Scenes by name.
    pub scenes: Vec<SceneRow>,
}

impl Evaluation {
    /// A value; `None` where it was not measured.
    pub fn value(&self, row: &SceneRow, key: ColumnKey) -> Option<f64> {
        row.sets.get(key.set)?.shots.get(&key.look)?.values.get(&key.metric).copied()
    }

    /// What a column is called: `ours lit N-CLIP`.
    pub fn title(&self, key: ColumnKey) -> String {
        format!("{} {} {}", self.sets[key.set], key.look.name(), key.metric.title())
    }

    /// Scenes that count: those with a photo.
    pub fn counted(&self) -> impl Iterator<Item = &SceneRow> {
        self.scenes.iter().filter(|row| row.photo.is_some())
    }
}

/// A photo differs in shape when its aspect is off by more than this share.
const SQUASHED: f64 = 0.01;

/// Measures all sets; the first is the one the others are compared with.
pub fn evaluate(sets: &[RunSet], looks: &Looks, seed: u64, tell: &(dyn Fn(String) + Sync)) -> Evaluation {
    let paired = pair(sets);
    let mut notes = looks.absent.clone();
    let total = paired.len();
    let done = std::sync::atomic::AtomicUsize::new(0);
    let scenes: Vec<SceneRow> = paired
        .par_iter()
        .map(|(name, runs)| {
            let row = scene(name, runs, looks);
            let count = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            tell(format!("{count}/{total} {name}"));
            row
        })
        .collect();
    let without: Vec<&str> = scenes.iter().filter(|s| s.photo.is_none()).map(|s| s.scene.as_str()).collect();
    if !without.is_empty() {
        notes.push(format!(
            "{} scenes have no photo that can be read and count nowhere: {}",
            without.len(),
            first(&without)
        ));
    }
    for (i, set) in sets.iter().enumerate() {
        let squashed: Vec<&str> = scenes
            .iter()
            .filter(|s| s.sets[i].shots.values().any(|shot| (shot.squash - 1.0).abs() > SQUASHED))
            .map(|s| s.scene.as_str())
            .collect();
        if !squashed.is_empty() {
            notes.push(format!(
                "{}: {} renders have another shape than their photo, which was squashed to theirs: {}",
                set.name,
                squashed.len(),
                first(&squashed)
            ));
        }
        if scenes.iter().any(|s| s.sets[i].starred) {
            notes.push(format!("{}*: the background is not its own but that of our run", set.name));
        }
        let bare: Vec<&str> =
            scenes.iter().filter(|s| s.sets[i].objects == Some(0)).map(|s| s.scene.as_str()).collect();
        if !bare.is_empty() {
            notes.push(format!(
                "{}: {} scenes have no objects; a photo painted on bare walls has the best figures here: {}",
                set.name,
                bare.len(),
                first(&bare)
            ));
        }
        if scenes.iter().all(|s| !s.sets[i].shots.contains_key(&Look::Lit)) {
            notes.push(format!("{}: no lit render", set.name));
        }
    }
    let mut evaluation = Evaluation {
        generator: concat!("HARMONY ", env!("CARGO_PKG_VERSION")).to_owned(),
        seed,
        sets: sets.iter().map(|s| s.name.clone()).collect(),
        notes,
        columns: Vec::new(),
        comparisons: Vec::new(),
        scenes,
    };
    evaluation.columns = columns(&evaluation);
    evaluation.comparisons = compare_sets(&evaluation);
    evaluation
}

fn first(names: &[&str]) -> String {
    const MOST: usize = 5;
    let more = names.len().saturating_sub(MOST);
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    names[..names.len().min(MOST)].join(", ") + &rest
}

/// Scenes by name, with the run of each set; runs of other names are put beside those of the first set by their photo.
fn pair(sets: &[RunSet]) -> BTreeMap<String, Vec<Option<RunEntry>>> {
    let mut rows: BTreeMap<String, Vec<Option<RunEntry>>> = BTreeMap::new();
    let mut by_photo: Option<BTreeMap<String, String>> = None;
    for (i, set) in sets.iter().enumerate() {
        for run in &set.runs {
            let mut name = run.name.clone();
            if i > 0 && !rows.contains_key(&name) {
                let known = by_photo.get_or_insert_with(|| {
                    let runs = sets[0].runs.iter();
                    runs.filter_map(|r| Some((r.photo_hash()?, r.name.clone()))).collect()
                });
                let same = run.photo_hash().and_then(|hash| known.get(&hash));
                // Two runs of one photo: the first is taken, the other keeps a row of its own.
                if let Some(same) = same.filter(|n| rows.get(*n).is_some_and(|row| row[i].is_none())) {
                    name.clone_from(same);
                }
            }
            rows.entry(name).or_insert_with(|| vec![None; sets.len()])[i] = Some(run.clone());
        }
    }
    rows
}

fn scene(name: &str, runs: &[Option<RunEntry>], looks: &Looks) -> SceneRow {
    let mut photo = None;
    for path in runs.iter().flatten().filter_map(|r| r.photo.as_ref()) {
        if let Ok(found) = harmony_io::load_photo(path) {
            photo = Some((path.clone(), found.image));
            break;
        }
    }
    let sets = runs.iter().map(|run| score(run.as_ref(), photo.as_ref().map(|p| &p.1), looks)).collect();
    SceneRow { scene: name.to_owned(), photo: photo.map(|p| p.0), sets }
}

fn score(run: Option<&RunEntry>, photo: Option<&RgbImage>, looks: &Looks) -> SceneScore {
    let Some(run) = run else {
        let failure = Some("not in this set".to_owned());
        return SceneScore { run: None, starred: false, objects: None, failure, shots: BTreeMap::new() };
    };
    let mut shots = BTreeMap::new();
    let mut failure = run.failure.clone();
    for (look, file) in [(Look::Lit, &run.lit), (Look::Flat, &run.flat)] {
        let (Some(file), Some(photo)) = (file, photo) else { continue };
        match shot(file, photo, looks) {
            Ok(shot) => {
                shots.insert(look, shot);
            }
            Err(reason) => failure = Some(format!("{}: {reason}", file.display())),
        }
    }
    SceneScore { run: Some(run.path.clone()), starred: run.starred, objects: run.objects, failure, shots }
}

fn shot(file: &Path, photo: &RgbImage, looks: &Looks) -> Result<Shot, picture::PictureError> {
    let render = picture::read(file)?.into_rgb8();
    let (width, height) = render.dimensions();
    let aspect = |image: &RgbImage| f64::from(image.width()) / f64::from(image.height().max(1));
    let squash = aspect(photo) / aspect(&render);
    let (mut values, mut errors) = (BTreeMap::new(), Vec::new());
    // Once for all figures.
    let target = resize_bicubic(photo, ImageSize::new(width, height)).unwrap_or_default();
    for metric in &looks.metrics {
        match metric.measure(&render, &target) {
            Ok(value) if value.is_finite() => {
                values.insert(metric.id(), value);
            }
            Ok(value) => errors.push(format!("{}: {value} is no figure", metric.id().title())),
            Err(error) => errors.push(error.to_string()),
        }
    }
    Ok(Shot { file: file.to_owned(), width, height, squash, values, errors })
}

fn columns(e: &Evaluation) -> Vec<Column> {
    let mut keys: BTreeSet<ColumnKey> = BTreeSet::new();
    for row in e.counted() {
        for (set, score) in row.sets.iter().enumerate() {
            for (look, shot) in &score.shots {
                keys.extend(shot.values.keys().map(|metric| ColumnKey { set, look: *look, metric: *metric }));
            }
        }
    }
    let rows: Vec<&SceneRow> = e.counted().collect();
    keys.iter()
        .map(|key| {
            let same: Vec<ColumnKey> = keys.iter().filter(|k| k.metric == key.metric).copied().collect();
            let values: Vec<Option<f64>> = rows.iter().map(|row| e.value(row, *key)).collect();
            let own: Vec<f64> = values.iter().flatten().copied().collect();
            let all = |row: &SceneRow| same.iter().all(|k| e.value(row, *k).is_some());
            let shared: Vec<f64> = rows.iter().filter(|r| all(r)).filter_map(|r| e.value(r, *key)).collect();
            let worst = same.iter().flat_map(|k| rows.iter().filter_map(|r| e.value(r, *k))).reduce(f64::max);
            let filled: Vec<f64> = values.iter().filter_map(|v| v.or(worst)).collect();
            Column {
                key: *key,
                own: Mean::of(&own, e.seed),
                intersection: Mean::of(&shared, e.seed),
                failures_as_worst: Mean::of(&filled, e.seed),
                missing: values.len() - own.len(),
                worst,
            }
        })
        .collect()
}

/// The first set against each of the others, figure by figure, over the scenes that both have.
pub fn compare_sets(e: &Evaluation) -> Vec<Comparison> {
    let mut out = Vec::new();
    for against in 1..e.sets.len() {
        for look in Look::ALL {
            for metric in MetricId::ALL {
                let key = |set| ColumnKey { set, look, metric };
                let both = |row: &SceneRow| Some((e.value(row, key(0))?, e.value(row, key(against))?));
                let pairs: Vec<(f64, f64)> = e.counted().filter_map(both).collect();
                out.extend(Paired::of(&pairs, e.seed).map(|paired| Comparison { against, look, metric, paired }));
            }
        }
    }
    out
}
