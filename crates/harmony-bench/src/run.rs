//! Runs the pipeline on rooms with known truth, played by the oracle, and judges what comes out.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast};
use harmony_pipeline::{Phase, ProgressSink, RunFile, RunOutcome, RunRequest, Settings, Warnings};
use harmony_scene::Level;
use serde::{Deserialize, Serialize};

use crate::metrics::similarity::Looking;
use crate::oracle::{Meshes, Noise, NoiseLevel, Oracle};
use crate::score::{Prediction, RoomScore, ScoreOptions, pictures, score};
use crate::truth::{TruthError, TruthRoom};
use crate::views::{Lit, LitOptions, judge_case};

/// The last phase that the geometry needs.
pub(crate) const LAST_PHASE: Phase = Phase::Objects(Level::Decoration);

/// What to run.
#[derive(Debug, Clone)]
pub struct BenchRequest {
    /// Truth folders.
    pub rooms: Vec<PathBuf>,
    /// Folder for the runs.
    pub out: PathBuf,
    /// Level of noise.
    pub level: NoiseLevel,
    /// Its errors.
    pub noise: Noise,
    /// Seeds: every room is run once with each.
    pub seeds: Vec<u64>,
    /// The room's height is told exactly.
    pub exact_height: bool,
    /// Settings of the pipeline.
    pub settings: Settings,
    /// What was changed in them, as typed.
    pub changes: Vec<String>,
    /// Points drawn from each side's surfaces; 0 leaves out the comparison of surfaces.
    pub points: usize,
    /// Runs at a time.
    pub jobs: usize,
    /// Run folders stay; else they go once judged.
    pub keep: bool,
    /// Networks that compare pictures.
    pub looking: Looking,
    /// Runs go on through materials and light, and lit pictures are judged too, at this size.
    pub lit: Option<LitOptions>,
    /// What the oracle's meshes are made of.
    pub meshes: Meshes,
}

impl BenchRequest {
    /// Runs that others judge: all kept, no surfaces, networks or light.
    pub fn to_be_judged_elsewhere(level: NoiseLevel, settings: Settings) -> Self {
        Self {
            rooms: Vec::new(),
            out: PathBuf::new(),
            level,
            noise: level.noise(),
            seeds: Vec::new(),
            exact_height: false,
            settings,
            changes: Vec::new(),
            points: 0,
            jobs: 1,
            keep: true,
            looking: Looking::default(),
            lit: None,
            meshes: Meshes::Truth,
        }
    }
}

/// Scores of a benchmark, as measured and after scale alignment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchResult {
    /// What was run, in words.
    pub title: String,
    /// Level of noise; `None` when only results were judged.
    pub level: Option<NoiseLevel>,
    /// Whether the room's height was exact.
    pub exact_height: bool,
    /// Changes to the settings, `key=value`.
    #[serde(default)]
    pub changes: Vec<String>,
    /// What the oracle's meshes were made of; `None` when only results were judged, and in older files.
    #[serde(default)]
    pub meshes: Option<Meshes>,
    /// What was not measured, and why.
    #[serde(default)]
    pub absent: Vec<String>,
    /// One a room and seed, metres as delivered.
    pub raw: Vec<RoomScore>,
    /// The same after scaling each run by its median depth ratio.
    pub aligned: Vec<RoomScore>,
}

/// A benchmark cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A truth folder.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// A photo.
    #[error("photo of {room}: {reason}")]
    Photo {
        /// Room.
        room: String,
        /// Why.
        reason: String,
    },
    /// A run folder.
    #[error("run of {room}: {reason}")]
    Run {
        /// Room.
        room: String,
        /// Why.
        reason: String,
    },
    /// Runs and rooms don't go together.
    #[error("{reason}: {path}", path = path.display())]
    NoRuns {
        /// Folder of the runs.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// A table or picture.
    #[error(transparent)]
    File(#[from] harmony_io::FileError),
}

/// Folder of the pictures of each case, beside the runs.
pub const PICTURES: &str = "cases";

/// One room with one seed.
struct Job {
    place: usize,
    room: PathBuf,
    seed: u64,
}

/// Runs all rooms with all seeds, [`BenchRequest::jobs`] at a time. `tell` hears a line after each.
///
/// # Errors
/// Folders that cannot be used. A run that fails is no error: its score says so and counts as nothing found.
///
/// # Panics
/// Outside a Tokio runtime.
pub async fn run(
    request: &BenchRequest,
    offline: &Cast,
    tell: &(dyn Fn(String) + Sync),
) -> Result<BenchResult, BenchError> {
    let cases = request.rooms.iter().flat_map(|room| request.seeds.iter().map(move |seed| (room.clone(), *seed)));
    let mut waiting = cases.enumerate().map(|(place, (room, seed))| Job { place, room, seed });
    let count = request.rooms.len() * request.seeds.len();
    let shared = Arc::new(request.clone());
    let mut scores: Vec<(usize, [RoomScore; 2])> = Vec::new();
    let mut absent = request.looking.absent.clone();
    let mut working = tokio::task::JoinSet::new();
    loop {
        while working.len() < request.jobs.max(1)
            && let Some(job) = waiting.next()
        {
            let (shared, offline) = (Arc::clone(&shared), offline.clone());
            let runtime = tokio::runtime::Handle::current();
            // Judging computes for seconds, and a run is not `Send` throughout: each job has its own thread.
            working.spawn_blocking(move || {
                runtime.block_on(Box::pin(case(&shared, &job, &offline))).map(|scores| (job.place, scores))
            });
        }
        let Some(done) = working.join_next().await else { break };
        // A panic is a fault of this program: it goes on as one.
        let (place, (judged, missing)) = done.unwrap_or_else(|e| std::panic::resume_unwind(e.into_panic()))?;
        absent.extend(missing.filter(|m| !absent.contains(m)));
        tell(format!("{:>3}/{count} {}", scores.len() + 1, line(&judged[0])));
        scores.push((place, judged));
    }
    scores.sort_by_key(|(place, _)| *place);
    let (raw, aligned) = scores.into_iter().map(|(_, [a, b])| (a, b)).unzip();
    Ok(BenchResult {
        title: format!("{} rooms, {} seeds, noise {}", request.rooms.len(), request.seeds.len(), request.level.name()),
        level: Some(request.level),
        exact_height: request.exact_height,
        changes: request.changes.clone(),
        meshes: Some(request.meshes),
        absent,
        raw,
        aligned,
    })
}

/// Runs and judges one case; also says what could not be judged.
async fn case(
    request: &BenchRequest,
    job: &Job,
    offline: &Cast,
) -> Result<([RoomScore; 2], Option<String>), BenchError> {
    let truth = TruthRoom::load(&job.room)?;
    let name = format!("{}_{}", truth.name, job.seed);
    let out = request.out.join(&name);
    let begun = Instant::now();
    let failure = Box::pin(one(request, &truth, job.seed, &out, offline)).await?;
    let seconds = begun.elapsed().as_secs_f64();
    let mut scores = judged(&truth, &out, request.points, seconds, failure.as_deref(), &request.looking);
    for s in &mut scores {
        s.seed = Some(job.seed);
    }
    let lit = request.lit.map(|options| Lit { renderer: &*offline.lit_renderer, options });
    let absent = judge_case(&truth, &out, &mut scores[0], &request.looking, lit, Some(&request.out)).await?;
    write_picture(&request.out, &name, &truth, &out)?;
    if !request.keep {
        std::fs::remove_dir_all(&out).map_err(|e| BenchError::Run { room: name, reason: e.to_string() })?;
    }
    Ok((scores, absent))
}

/// Photo, render and outlines of a case side by side, for the report; a run without a scene has none.
fn write_picture(out: &Path, case: &str, truth: &TruthRoom, folder: &Path) -> Result<(), BenchError> {
    let Some(jpeg) = Prediction::load(folder).ok().and_then(|run| crate::report::case_picture(truth, &run)) else {
        return Ok(());
    };
    let pictures = out.join(PICTURES);
    std::fs::create_dir_all(&pictures).map_err(|e| BenchError::Run { room: case.to_owned(), reason: e.to_string() })?;
    Ok(harmony_io::write_atomic(&pictures.join(format!("{case}.jpg")), &jpeg)?)
}

/// Judges a run folder raw and scale-aligned; `points` as in [`ScoreOptions`].
pub fn judged(
    truth: &TruthRoom,
    folder: &Path,
    points: usize,
    seconds: f64,
    failure: Option<&str>,
    looking: &Looking,
) -> [RoomScore; 2] {
    let run = Prediction::load(folder);
    let questions_per_object = RunFile::read(folder).map(|file| file.questions_per_object).filter(|asked| *asked > 0.0);
    // Pictures are the same whatever the scale.
    let pair = run.as_ref().ok().and_then(|run| pictures(truth, run));
    let alike = pair.map(|(render, photo)| looking.compare(&render, &photo)).unwrap_or_default();
    [false, true].map(|align_scale| match &run {
        Ok(run) => {
            let s = score(truth, run, ScoreOptions { align_scale, points });
            let (n_clip, lpips) = (alike.n_clip, alike.lpips);
            let failure = failure.map(str::to_owned);
            RoomScore { n_clip, lpips, questions_per_object, seconds, failure, ..s }
        }
        Err(error) => RoomScore::failed(truth, seconds, failure.map_or_else(|| error.to_string(), str::to_owned)),
    })
}

/// How finished runs are judged.
#[derive(Clone, Copy)]
pub struct Judging<'a> {
    /// As in [`ScoreOptions`].
    pub points: usize,
    /// Folder for the pictures of the cases.
    pub out: Option<&'a Path>,
    /// Networks that compare pictures.
    pub looking: &'a Looking,
    /// Who renders lit pictures, when they are judged.
    pub lit: Option<Lit<'a>>,
}

/// Judges finished runs: each is one run folder, or a folder of runs named `<room>_<seed>` (or `<room>`). A run of
/// another name belongs to the room whose photo it has, or to the one room that there is.
///
/// # Errors
/// Folders that cannot be used, or no run that goes with a room.
pub async fn judge_finished(
    runs: &[PathBuf],
    rooms: &[PathBuf],
    judging: Judging<'_>,
    tell: &dyn Fn(String),
) -> Result<BenchResult, BenchError> {
    let mut all = Vec::new();
    for folder in runs {
        all.extend(pairs(folder, rooms)?);
    }
    let (mut raw, mut aligned) = (Vec::new(), Vec::new());
    let mut absent = judging.looking.absent.clone();
    for (folder, room, seed) in &all {
        let truth = TruthRoom::load(room)?;
        let [mut a, mut b] = judged(&truth, folder, judging.points, 0.0, None, judging.looking);
        (a.seed, b.seed) = (*seed, *seed);
        let missing = judge_case(&truth, folder, &mut a, judging.looking, judging.lit, judging.out).await?;
        absent.extend(missing.filter(|m| !absent.contains(m)));
        if let Some(out) = judging.out {
            write_picture(out, &a.case(), &truth, folder)?;
        }
        tell(line(&a));
        raw.push(a);
        aligned.push(b);
    }
    Ok(BenchResult {
        title: format!("{} finished runs", all.len()),
        level: None,
        exact_height: false,
        changes: Vec::new(),
        meshes: None,
        absent,
        raw,
        aligned,
    })
}

fn is_run(folder: &Path) -> bool {
    folder.join("run.json").is_file() || folder.join("scene.json").is_file()
}

/// The room of a run folder's name, and the seed.
fn room_of<'a>(name: &str, rooms: &'a [PathBuf]) -> Option<(&'a PathBuf, Option<u64>)> {
    let named = |wanted: &str| rooms.iter().find(|r| r.file_name().is_some_and(|n| n.to_string_lossy() == wanted));
    if let Some(room) = named(name) {
        return Some((room, None));
    }
    let (room, seed) = name.rsplit_once('_')?;
    Some((named(room)?, Some(seed.parse().ok()?)))
}

/// Whether a run was made from a room's own photo, byte by byte.
fn has_photo_of(run: &Path, room: &Path) -> bool {
    let photo = std::fs::read(room.join("photo.jpg")).ok();
    photo.is_some() && photo == std::fs::read(run.join("input.jpg")).ok()
}

/// A run folder, the room that it is of, and its seed where the name tells one.
pub type Pair = (PathBuf, PathBuf, Option<u64>);

/// The runs of a folder, with their rooms; see [`judge_finished`].
///
/// # Errors
/// Folders that cannot be used, or no run that goes with a room.
pub fn pairs(runs: &Path, rooms: &[PathBuf]) -> Result<Vec<Pair>, BenchError> {
    let missing = |reason: &str| BenchError::NoRuns { path: runs.to_owned(), reason: reason.to_owned() };
    let name = |path: &Path| path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    if is_run(runs) {
        let only = if let [room] = rooms { Some((room, None)) } else { None };
        let same_photo = || Some((rooms.iter().find(|room| has_photo_of(runs, room))?, None));
        let found = room_of(&name(runs), rooms).or(only).or_else(same_photo);
        let (room, seed) =
            found.ok_or_else(|| missing("no room has the name or the photo of this run; name the room"))?;
        return Ok(vec![(runs.to_owned(), room.clone(), seed)]);
    }
    let entries = std::fs::read_dir(runs).map_err(|e| missing(&e.to_string()))?;
    let mut folders: Vec<PathBuf> = entries.filter_map(Result::ok).map(|e| e.path()).filter(|p| is_run(p)).collect();
    folders.sort();
    let pairs: Vec<Pair> = folders
        .into_iter()
        .filter_map(|f| {
            let (room, seed) = room_of(&name(&f), rooms)?;
            Some((f, room.clone(), seed))
        })
        .collect();
    if pairs.is_empty() {
        return Err(missing("no run that is named like a room is in it (<room>_<seed>)"));
    }
    Ok(pairs)
}

/// Reads a `scores.json`, of older versions too.
///
/// JSON has no NaN: what was not measured on objects without a counterpart stands as `null` there.
///
/// # Errors
/// A file that cannot be read or holds something else.
pub fn read_result(path: &Path) -> Result<BenchResult, BenchError> {
    let mut value: serde_json::Value = harmony_io::read_json(path)?;
    for list in ["raw", "aligned"] {
        let rooms = value.get_mut(list).and_then(serde_json::Value::as_array_mut).into_iter().flatten();
        for object in rooms.filter_map(|r| r.get_mut("objects")?.as_array_mut()).flatten() {
            for key in ["position_m", "yaw_deg", "size", "size_bias"] {
                if object.get(key).is_some_and(serde_json::Value::is_null) {
                    object[key] = UNMEASURED.into();
                }
            }
        }
    }
    let wrong = |e: serde_json::Error| BenchError::NoRuns { path: path.to_owned(), reason: format!("no scores: {e}") };
    let mut result: BenchResult = serde_json::from_value(value).map_err(wrong)?;
    for object in result.raw.iter_mut().chain(&mut result.aligned).flat_map(|r| &mut r.objects) {
        for v in [&mut object.position_m, &mut object.yaw_deg, &mut object.size, &mut object.size_bias] {
            if *v == UNMEASURED {
                *v = f64::NAN;
            }
        }
    }
    Ok(result)
}

/// Stands for NaN on the way through JSON: no length, angle or ratio has this value.
const UNMEASURED: f64 = f64::MIN;

fn line(s: &RoomScore) -> String {
    let f = s.geometry.as_ref().and_then(|g| g.objects.as_ref()?.f(0.1));
    format!(
        "{:<20} camera {:>5.2} deg {:.3} m  {:>2} objects ({} missed)  position {:.3} m  F@0.1 {}  {:.1} s{}",
        s.case(),
        s.camera.rotation_deg,
        s.camera.centre_m,
        s.objects.len(),
        s.missed.len(),
        s.median_position(),
        f.map_or_else(|| "-".to_owned(), |f| format!("{f:.1} %")),
        s.seconds,
        s.failure.as_ref().map_or_else(String::new, |f| format!("  FAILED: {f}")),
    )
}

/// One run; returns the reason when a phase failed.
pub(crate) async fn one(
    request: &BenchRequest,
    truth: &TruthRoom,
    seed: u64,
    out: &Path,
    offline: &Cast,
) -> Result<Option<String>, BenchError> {
    let photo = harmony_io::picture::read(&truth.photo())
        .map_err(|e| BenchError::Photo { room: truth.name.clone(), reason: e.to_string() })?;
    let oracle = Oracle::new(truth.clone(), request.noise, seed, request.exact_height);
    let oracle = Arc::new(oracle.with_meshes(request.meshes, Arc::new(photo.into_rgb8())));
    let level = request.level.name();
    let play = Play {
        truth,
        oracle: Arc::clone(&oracle),
        settings: request.settings.clone(),
        until: if request.lit.is_some() { Phase::Lighting } else { LAST_PHASE },
        path_tracer: request.lit.is_some(),
        profile: format!("oracle, noise {level}"),
        further_inputs: format!("{level} {seed} {}", request.meshes.name()),
    };
    let silent: ProgressSink = Arc::new(|_| {});
    let outcome = Box::pin(play.run(out, offline, &silent)).await?;
    oracle.faults().write(out).map_err(|reason| BenchError::Run { room: truth.name.clone(), reason })?;
    Ok(outcome.failure.map(|failure| failure.to_string()))
}

/// One run of one room.
pub struct Play<'a> {
    /// The room.
    pub truth: &'a TruthRoom,
    /// Who plays.
    pub oracle: Arc<Oracle>,
    /// Settings of the pipeline.
    pub settings: Settings,
    /// The last phase; what the oracle has no answer to is answered by this program's own rules.
    pub until: Phase,
    /// The last phase may render with the path tracer.
    pub path_tracer: bool,
    /// Who plays, in words.
    pub profile: String,
    /// What the oracle's answers depend on.
    pub further_inputs: String,
}

impl Play<'_> {
    /// Runs it in a folder, which is emptied first.
    ///
    /// # Errors
    /// A photo or folder that cannot be used. A phase that fails is none: it is in the outcome.
    pub async fn run(self, out: &Path, offline: &Cast, progress: &ProgressSink) -> Result<RunOutcome, BenchError> {
        let name = &self.truth.name;
        let failed = |reason: String| BenchError::Run { room: name.clone(), reason };
        let photo = harmony_io::load_photo(&self.truth.photo())
            .map_err(|e| BenchError::Photo { room: name.clone(), reason: e.to_string() })?;
        if out.exists() {
            std::fs::remove_dir_all(out).map_err(|e| failed(e.to_string()))?;
        }
        std::fs::create_dir_all(out).map_err(|e| failed(e.to_string()))?;
        let warnings = Arc::new(Warnings::default());
        let collected = Arc::clone(&warnings);
        let options =
            CallOptions { on_warning: Arc::new(move |warning| collected.push(warning)), ..CallOptions::default() };
        let book = CallBook::open(out, BookOptions::default()).map_err(|e| failed(e.to_string()))?;
        let calls = Calls::new(Arc::new(book), self.oracle.cast(offline), offline.clone(), options);
        let run = RunRequest {
            photo,
            title: name.clone(),
            run: out.to_owned(),
            profile: self.profile,
            settings: self.settings,
            until: self.until,
            path_tracer: self.path_tracer,
            further_inputs: self.further_inputs,
        };
        Box::pin(harmony_pipeline::run(&run, &calls, &warnings, progress)).await.map_err(|e| failed(e.to_string()))
    }
}
