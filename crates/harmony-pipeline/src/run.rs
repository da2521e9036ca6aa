//! The main path: photo -> layout -> wall -> furniture -> ceiling -> decoration -> lighting -> files.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use harmony_calls::{Bill, Calls};
use harmony_io::Photo;
use harmony_roles::Role;
use harmony_scene::{ImageSize, Scene};
use image::{RgbImage, imageops};
use serde_json::json;

use crate::Phase;
use crate::ctx::{PhaseCtx, PhaseError, Warnings};
use crate::graph::Graph;
use crate::looks;
use crate::outputs::{self, GENERATOR};
use crate::phases;
use crate::progress::{ProgressEvent, ProgressSink};
use crate::relight::LitPictures;
use crate::run_file::{PhaseEntry, PhaseState, PhaseTime, RunFile, hash_files};
use crate::settings::Settings;
use crate::state::SceneState;

/// Files that a complete run must have.
const REQUIRED: [&str; 9] = [
    "scene.json",
    "scene_full.glb",
    "render_flat.png",
    "render_canonical.png",
    "segmentation.png",
    "segmentation.json",
    "objects.json",
    "camera.json",
    "report.html",
];

/// What to run.
pub struct RunRequest {
    /// The photo.
    pub photo: Photo,
    /// Title for the report, such as the file's name.
    pub title: String,
    /// Run folder.
    pub run: PathBuf,
    /// Profile name, for the record.
    pub profile: String,
    /// Settings.
    pub settings: Settings,
    /// The last phase to run.
    pub until: Phase,
    /// Lit pictures are wanted, if there is a path tracer.
    pub path_tracer: bool,
    /// What else the result depends on (hash of mask and point-map files, recording).
    pub further_inputs: String,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct RunOutcome {
    /// `run.json`.
    pub file: RunFile,
    /// True when an earlier run had done everything and nothing had to be computed.
    pub nothing_to_do: bool,
    /// The scene, when there is one.
    pub scene: Option<Scene>,
    /// The first failure.
    pub failure: Option<Failure>,
}

/// Why a run is not complete.
#[derive(Debug, Clone, PartialEq)]
pub struct Failure {
    /// Where; `None` = the files of the whole scene.
    pub phase: Option<Phase>,
    /// Why.
    pub reason: String,
    /// What a person can do about it.
    pub hint: Option<String>,
}

impl Failure {
    fn of(phase: Option<Phase>, error: &PhaseError) -> Self {
        Self { phase, reason: error.to_string(), hint: error.hint() }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.phase.map_or("files", Phase::folder), self.reason)
    }
}

/// A run cannot even begin, or its folder cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A file of the run folder.
    #[error(transparent)]
    File(#[from] harmony_io::FileError),
    /// Settings out of range.
    #[error("setting {0}")]
    Settings(String),
    /// The call log cannot be read.
    #[error(transparent)]
    Book(#[from] harmony_calls::BookError),
}

impl RunError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(error) => error.hint(),
            Self::Settings(_) => Some("`harmony schema config` prints what can be set"),
            Self::Book(error) => error.hint(),
        }
    }
}

/// Runs the phases; everything obtained is kept, whatever happens.
///
/// # Errors
/// [`RunError`] when the run folder cannot be used at all. A failed phase is not an error here: it is in the outcome.
pub async fn run(
    request: &RunRequest,
    calls: &Calls,
    warnings: &Warnings,
    progress: &ProgressSink,
) -> Result<RunOutcome, RunError> {
    request.settings.check().map_err(RunError::Settings)?;
    let inputs = inputs_hash(request, calls);
    if let Some(outcome) = finished_before(request, calls, &inputs)? {
        return Ok(outcome);
    }
    let photo_file = request.run.join(format!("input.{}", request.photo.extension));
    harmony_io::write_atomic(&photo_file, &request.photo.bytes)?;
    for warning in &request.photo.warnings {
        warnings.push(warning.clone());
    }
    let mut file = RunFile {
        generator: GENERATOR.to_owned(),
        profile: request.profile.clone(),
        inputs,
        answers: String::new(),
        phases: Phase::ALL.iter().map(|p| (p.to_string(), PhaseEntry::default())).collect(),
        cast: calls.cast().cards(),
        settings: request.settings.clone(),
        objects: 0,
        questions_per_object: 0.0,
        bill: Bill::default(),
        looks: Vec::new(),
        plausibility: Vec::new(),
        joined_from: Vec::new(),
        files: BTreeMap::new(),
    };
    let mut stage = Stage { request, calls, warnings, progress, file: &mut file, failure: None, lit: None };
    let state = Box::pin(stage.all()).await?;
    let failure = stage.failure.take();
    let lit = stage.lit.take();
    let mut outcome = RunOutcome { file, nothing_to_do: false, scene: None, failure };
    if let Some(state) = state {
        finish(request, calls, warnings, &state, lit.as_ref(), &mut outcome)?;
    }
    outcome.file.write(&request.run)?;
    Ok(outcome)
}

/// One run in progress.
struct Stage<'a> {
    request: &'a RunRequest,
    calls: &'a Calls,
    warnings: &'a Warnings,
    progress: &'a ProgressSink,
    file: &'a mut RunFile,
    failure: Option<Failure>,
    lit: Option<LitPictures>,
}

impl Stage<'_> {
    /// All phases up to the last wanted one; the state after the last that succeeded.
    async fn all(&mut self) -> Result<Option<SceneState>, RunError> {
        let request = self.request;
        let working = Arc::new(working_photo(&request.photo, request.settings.working_px));
        let ctx = self.ctx(Phase::Layout);
        let Some(start) = self.phase(Phase::Layout, phases::layout::run(&ctx, &request.photo, working)).await? else {
            return Ok(None);
        };
        let levels = request.until.levels_until();
        let graph = Graph::new(levels.map(|level| self.ctx(Phase::Objects(level))).collect(), Arc::new(start.clone()));
        let ((), placed) = futures::join!(graph.prepare(), self.levels(&graph, start));
        let (mut state, complete) = placed?;
        if !complete {
            return Ok(Some(state));
        }
        if request.until == Phase::Lighting {
            let ctx = self.ctx(Phase::Lighting);
            let lighting = Box::pin(phases::lighting::run(&ctx, state.clone()));
            if let Some((next, lit)) = self.phase(Phase::Lighting, lighting).await? {
                state = next;
                self.lit = lit;
            }
        }
        Ok(Some(state))
    }

    /// Places the levels in order; the state after the last that succeeded, and whether that is the last one.
    async fn levels(&mut self, graph: &Graph<'_>, mut state: SceneState) -> Result<(SceneState, bool), RunError> {
        for (level, phase) in graph.phases().enumerate() {
            let placed = Box::pin(self.phase(phase, graph.place(level, state.clone()))).await;
            match placed {
                Ok(Some(next)) => state = next,
                // Whoever waits in the graph must hear of it before the run can end.
                Ok(None) => {
                    graph.end(Some(&format!("{phase} failed")));
                    return Ok((state, false));
                }
                Err(error) => {
                    graph.end(Some(&error.to_string()));
                    return Err(error);
                }
            }
        }
        graph.end(None);
        Ok((state, true))
    }

    /// Runs one phase and marks how it ended.
    async fn phase<T>(
        &mut self,
        phase: Phase,
        work: impl Future<Output = Result<T, PhaseError>>,
    ) -> Result<Option<T>, RunError> {
        let name = phase.folder();
        let (started, waited) = (Instant::now(), self.calls.waited());
        self.mark(name, PhaseEntry { state: PhaseState::Running, ..PhaseEntry::default() })?;
        (self.progress)(ProgressEvent::PhaseStarted { phase: name.to_owned() });
        let ended = work.await;
        let time = Some(PhaseTime::new(started.elapsed(), self.calls.waited().saturating_sub(waited)));
        match ended {
            Ok(value) => {
                let outcome = "done".to_owned();
                self.mark(name, PhaseEntry { state: PhaseState::Done, outcome, hint: None, time })?;
                let seconds = started.elapsed().as_secs_f64();
                (self.progress)(ProgressEvent::PhaseDone {
                    phase: name.to_owned(),
                    seconds,
                    outcome: "done".to_owned(),
                });
                Ok(Some(value))
            }
            Err(error) => {
                let reason = error.to_string();
                tracing::error!(phase = name, "{reason}");
                (self.progress)(ProgressEvent::PhaseFailed { phase: name.to_owned(), reason: reason.clone() });
                let entry = PhaseEntry { state: PhaseState::Failed, outcome: reason, hint: error.hint(), time };
                self.mark(name, entry)?;
                self.failure = Some(Failure::of(Some(phase), &error));
                Ok(None)
            }
        }
    }

    fn mark(&mut self, name: &str, entry: PhaseEntry) -> Result<(), RunError> {
        self.file.phases.insert(name.to_owned(), entry);
        Ok(self.file.write(&self.request.run)?)
    }

    fn ctx<'b>(&self, phase: Phase) -> PhaseCtx<'b>
    where
        Self: 'b,
    {
        PhaseCtx {
            run: &self.request.run,
            phase,
            within: None,
            calls: self.calls,
            path_tracer: self.request.path_tracer && self.calls.can().traces,
            settings: &self.request.settings,
            warnings: self.warnings,
            progress: self.progress,
        }
    }
}

/// Writes the scene's files, the report and the bill, and checks that what must be there is there.
fn finish(
    request: &RunRequest,
    calls: &Calls,
    warnings: &Warnings,
    state: &SceneState,
    lit: Option<&LitPictures>,
    outcome: &mut RunOutcome,
) -> Result<(), RunError> {
    let log = calls.book().log()?;
    let file = &mut outcome.file;
    file.objects = state.partial.placed.len();
    let questions: Vec<&str> = log.iter().filter(|c| c.role == Role::VisionLanguage).map(|c| &*c.name).collect();
    file.questions_per_object = questions.len() as f64 / (file.objects.max(1)) as f64;
    file.bill = Bill::of(&log);
    file.looks = looks::counted(state.looks.clone(), &questions);
    harmony_io::write_json(&request.run.join("bill.json"), &file.bill.without_times())?;
    file.answers = calls.book().answers_digest("")?;
    let written =
        outputs::write(&request.run, state, request.photo.original_size, lit, &warnings.sorted()).and_then(|scene| {
            let mut report = outputs::report_data(state, &scene, &log, &request.run);
            report.title.clone_from(&request.title);
            report.profile.clone_from(&request.profile);
            report.phases = report_phases(file, state);
            let unseen = file.unseen().iter().map(|line| harmony_viewer::Fact::new("note", *line));
            report.facts = vec![
                harmony_viewer::Fact::new("program", GENERATOR),
                harmony_viewer::Fact::new(
                    "questions for each placed object",
                    format!("{:.2}", file.questions_per_object),
                ),
            ];
            report.facts.extend(file.looks.iter().map(looks::Came::fact));
            report.facts.extend(unseen);
            harmony_viewer::write_report(&request.run, &scene, &report)?;
            Ok(scene)
        });
    match written {
        Ok(scene) => outcome.scene = Some(scene),
        Err(error) => {
            outcome.failure.get_or_insert(Failure::of(None, &error));
        }
    }
    let missing: Vec<&str> = REQUIRED.iter().copied().filter(|path| !request.run.join(path).is_file()).collect();
    if !missing.is_empty() && outcome.failure.is_none() {
        let reason = format!("not written: {}", missing.join(", "));
        outcome.failure = Some(Failure { phase: None, reason, hint: None });
    }
    outcome.file.files = hash_files(&request.run);
    Ok(())
}

fn report_phases(file: &RunFile, state: &SceneState) -> Vec<harmony_viewer::PhaseReport> {
    file.phases
        .iter()
        .map(|(name, entry)| harmony_viewer::PhaseReport {
            name: name.clone(),
            status: match entry.state {
                PhaseState::Done => harmony_viewer::PhaseStatus::Done,
                PhaseState::Failed => harmony_viewer::PhaseStatus::Failed,
                PhaseState::Pending => harmony_viewer::PhaseStatus::Skipped,
                PhaseState::Running => harmony_viewer::PhaseStatus::Pending,
            },
            seconds: file.bill.by_phase.get(name).map_or(0.0, |line| line.latency_ms as f64 / 1000.0),
            own_seconds: entry.time.map(|time| time.own_s),
            waited_seconds: entry.time.map(|time| time.waited_s),
            outcome: if entry.state == PhaseState::Done {
                brought(Phase::of_folder(name), state)
            } else {
                entry.outcome.clone()
            },
        })
        .collect()
}

/// What a phase has added to the scene, in words.
fn brought(phase: Option<Phase>, state: &SceneState) -> String {
    let level = match phase {
        Some(Phase::Layout) => return state.layout.method.clone(),
        Some(Phase::Lighting) => return format!("{} lights", state.lighting.as_ref().map_or(0, |l| l.lights.len())),
        Some(Phase::Objects(level)) => level,
        None => return String::new(),
    };
    let placed = state.partial.placed.iter().filter(|p| p.item.level == level).count();
    let dropped = state.left.iter().filter(|left| Some(left.phase) == phase).count();
    format!("{placed} placed{}", if dropped > 0 { format!(", {dropped} left out") } else { String::new() })
}

/// An earlier run's outcome, when nothing it depends on has changed and all its files are as it left them.
fn finished_before(request: &RunRequest, calls: &Calls, inputs: &str) -> Result<Option<RunOutcome>, RunError> {
    let Some(file) = RunFile::read(&request.run) else { return Ok(None) };
    let state_of = |phase: Phase| file.phases.get(phase.folder()).map(|entry| entry.state);
    let (wanted, beyond): (Vec<Phase>, Vec<Phase>) = Phase::ALL.into_iter().partition(|p| *p <= request.until);
    let done = wanted.into_iter().all(|p| state_of(p) == Some(PhaseState::Done));
    let no_more = beyond.into_iter().all(|p| state_of(p).is_none_or(|state| state == PhaseState::Pending));
    let same = file.inputs == *inputs && file.answers == calls.book().answers_digest("")?;
    if !(done && no_more && same && file.files_hold(&request.run)) {
        return Ok(None);
    }
    let scene = harmony_io::read_json(&request.run.join("scene.json")).ok();
    Ok(Some(RunOutcome { file, nothing_to_do: true, scene, failure: None }))
}

fn inputs_hash(request: &RunRequest, calls: &Calls) -> String {
    let (cards, can) = (calls.cast().cards(), calls.can());
    let text = json!({
        "generator": GENERATOR, "settings": request.settings, "cast": cards, "profile": request.profile,
        "boxes_from_vlm": !can.gives_boxes, "path_tracer": request.path_tracer && can.traces,
        "further": request.further_inputs, "title": request.title,
        "photo": blake3::hash(&request.photo.bytes).to_hex().to_string(),
    });
    blake3::hash(text.to_string().as_bytes()).to_hex().to_string()
}

/// The photo at the size the pipeline works with.
fn working_photo(photo: &Photo, longest: u32) -> RgbImage {
    let size = ImageSize::new(photo.image.width(), photo.image.height()).fit_within(longest);
    if size.width == photo.image.width() && size.height == photo.image.height() {
        return photo.image.clone();
    }
    imageops::resize(&photo.image, size.width, size.height, imageops::FilterType::CatmullRom)
}

#[cfg(test)]
mod tests {
    use harmony_calls::StopReason;

    use super::*;
    use crate::testing::{Desk, photo};

    fn request(desk: &Desk) -> RunRequest {
        RunRequest {
            photo: photo(),
            title: "a wall".to_owned(),
            run: desk.run.path().to_owned(),
            profile: "offline".to_owned(),
            settings: Settings { working_px: 256, ..Settings::default() },
            until: Phase::Layout,
            path_tracer: false,
            further_inputs: String::new(),
        }
    }

    async fn run_at(desk: &Desk, request: &RunRequest) -> RunOutcome {
        run(request, &desk.calls, &desk.warnings, &desk.progress).await.unwrap()
    }

    fn states(file: &RunFile) -> Vec<PhaseState> {
        Phase::ALL.iter().map(|p| file.phases[p.folder()].state).collect()
    }

    #[tokio::test]
    async fn a_run_marks_its_phases_and_the_same_one_again_has_nothing_to_do() {
        let desk = Desk::new();
        let asked = request(&desk);
        let first = run_at(&desk, &asked).await;
        assert_eq!(first.failure, None);
        let mut wanted = vec![PhaseState::Pending; Phase::ALL.len()];
        wanted[0] = PhaseState::Done;
        assert_eq!(states(&first.file), wanted);
        assert_eq!(RunFile::read(&asked.run).unwrap(), first.file, "run.json is what the outcome says");
        assert!(!first.nothing_to_do && first.scene.is_some());
        for path in REQUIRED {
            assert!(first.file.files.contains_key(path), "{path} has a hash");
        }
        assert_eq!(std::fs::read(asked.run.join("input.png")).unwrap(), asked.photo.bytes);

        let desk = Desk::at(desk.run);
        let again = run_at(&desk, &asked).await;
        assert!(again.nothing_to_do && again.scene == first.scene && desk.events.lock().unwrap().is_empty());
        // A file that is not as it was left is made anew, by records alone.
        std::fs::write(asked.run.join("scene.json"), "{}").unwrap();
        let mended = run_at(&desk, &asked).await;
        assert!(!mended.nothing_to_do && desk.calls.counts().asked == 0);
        assert_eq!(mended.file.files, first.file.files);
        // Another photo, title, or mask file is another run.
        let other = RunRequest { further_inputs: "masks".to_owned(), ..request(&desk) };
        assert!(!run_at(&desk, &other).await.nothing_to_do);
    }

    #[tokio::test]
    async fn a_stopped_run_names_its_phase_and_goes_on_when_it_is_started_again() {
        let desk = Desk::new();
        let asked = request(&desk);
        desk.calls.stop().close(StopReason::Interrupted("somebody wanted it so".to_owned()));
        let stopped = run_at(&desk, &asked).await;
        let failure = stopped.failure.unwrap();
        assert_eq!(failure.phase, Some(Phase::Layout));
        assert!(failure.hint.as_ref().is_some_and(|h| h.contains("run the same command again")), "{failure:?}");
        assert!(failure.to_string().starts_with(Phase::Layout.folder()), "{failure}");
        assert_eq!(stopped.scene, None);
        let kept = RunFile::read(&asked.run).unwrap();
        assert_eq!(states(&kept)[..2], [PhaseState::Failed, PhaseState::Pending]);
        let entry = &kept.phases[Phase::Layout.folder()];
        assert!(entry.outcome.contains("somebody wanted it so") && entry.hint == failure.hint, "{entry:?}");
        let failed = |e: &ProgressEvent| matches!(e, ProgressEvent::PhaseFailed { .. });
        assert_eq!(desk.events.lock().unwrap().iter().filter(|e| failed(e)).count(), 1);

        let desk = Desk::at(desk.run);
        let resumed = run_at(&desk, &asked).await;
        assert_eq!((resumed.failure, states(&resumed.file)[0]), (None, PhaseState::Done));
    }

    #[tokio::test]
    async fn settings_out_of_range_are_refused_before_anything_is_written() {
        let desk = Desk::new();
        let mut asked = request(&desk);
        asked.settings.working_px = 8;
        let error = run(&asked, &desk.calls, &desk.warnings, &desk.progress).await.unwrap_err();
        assert!(matches!(&error, RunError::Settings(what) if what.contains("working_px")), "{error}");
        assert!(error.hint().is_some() && !asked.run.join("run.json").exists());
    }

    #[test]
    fn a_failure_of_no_phase_is_one_of_the_files() {
        let failure = Failure { phase: None, reason: "not written: report.html".to_owned(), hint: None };
        assert_eq!(failure.to_string(), "files: not written: report.html");
    }
}
