//! Runs with random faults: each ends with a scene or a clear error, pays nothing twice, hangs nowhere, and keeps its
//! memory.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::OpenOptions;
use std::io::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use harmony_bench::oracle::NoiseLevel;
use harmony_bench::truth::TruthRoom;
use harmony_calls::{BookOptions, Budget, CallBook, CallOptions, Calls, Cast, Limits, Source};
use harmony_pipeline::{Phase, RunRequest, Settings, Warnings};
use harmony_players::detector::asked::VlmBoxes;
use harmony_players::detector::boxes::BoxStyle;
use harmony_players::detector::grounding::{GroundingOptions, GroundingPlayer};
use harmony_players::detector::locate::{LocateOptions, LocatePlayer};
use harmony_players::editor::wire::EditSettings;
use harmony_players::editor::{EditorFormat, EditorOptions, EditorPlayer};
use harmony_players::flat_cast;
use harmony_players::http::{ApiKey, Auth, Http, HttpLimits, ServiceOptions};
use harmony_players::mesh::hosted::tasks::Tasks;
use harmony_players::mesh::hosted::{Host as Hosted, HostedOptions, HostedPlayer};
use harmony_players::mesh::hunyuan::{HunyuanOptions, HunyuanPlayer, Route, Version};
use harmony_players::mesh::trellis::{Host, TrellisOptions, TrellisPlayer};
use harmony_players::vlm::wire::ModelSettings;
use harmony_players::vlm::wire::chat::Server;
use harmony_players::vlm::{Format, VlmOptions, VlmPlayer};
use harmony_roles::{Detector, ImageEditor, MeshGenerator, Role, RoleError, VisionLanguage};
use harmony_scene::WarningKind;
use serde::{Deserialize, Serialize};

use crate::faults::{Fault, FaultPlan, Part, drawn};
use crate::services::Service;
use crate::truth_oracle::TruthOracle;
use crate::{KEY, Studio, StudioOptions, rooms};

/// Longest time of one try, and of its silences: scaled down from minutes.
const TRY: Duration = Duration::from_secs(4);
const SILENCE: Duration = Duration::from_secs(1);

/// Longest that a run may take; one that takes longer hangs. Tries, retries and computing on a busy machine fit in.
const RUN: Duration = Duration::from_mins(4);

/// Deadline of the runs that have one, and the grace for what is in flight.
const DEADLINE: Duration = Duration::from_millis(1200);
const GRACE: Duration = Duration::from_millis(500);

/// What a run may take beyond its deadline and grace: computing is not torn down.
const COMPUTING: Duration = Duration::from_secs(30);

/// Below this line of the page, what people wrote stays when the table is made anew.
const NOTES: &str = "<!-- notes -->";

/// Command line of `harmony-studio faults`.
#[derive(Debug, Clone, clap::Args)]
pub struct SoakOptions {
    /// How many runs.
    #[arg(long, default_value_t = 100)]
    pub runs: u64,
    /// Seed of the first; each run has the next.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Runs at a time.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// No run is begun after so many minutes.
    #[arg(long)]
    pub minutes: Option<f64>,
    /// Where the table is written (Markdown); what stands there below the line `<!-- notes -->` stays.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Where a line is written as each run ends; runs that are there already are not made again.
    #[arg(long)]
    pub rows: Option<PathBuf>,
}

/// How one run ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ended {
    /// Seed.
    pub seed: u64,
    /// Who played.
    pub cast: String,
    /// Faults that befell it.
    pub faults: BTreeMap<Fault, usize>,
    /// `scene`, `scene, with stand-ins`, `stopped`, `error`.
    pub end: String,
    /// Why it stopped or failed.
    pub reason: Option<String>,
    /// Objects in the scene.
    pub objects: usize,
    /// Seconds.
    pub seconds: f64,
    /// Largest memory, MiB; of the process, studio included.
    pub peak_mib: u64,
    /// Memory of the process after the run, MiB.
    pub after_mib: u64,
    /// Requests that the studio got.
    pub requests: usize,
    /// What must not be; empty = all is well.
    pub wrong: Vec<String>,
}

/// Runs, tells, writes the table; whether all is well.
///
/// # Errors
/// A folder that cannot be written.
pub fn command(options: &SoakOptions) -> anyhow::Result<bool> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    let ended = runtime.block_on(all(options, &|line| {
        let _ = std::io::stderr().write_all(format!("{line}\n").as_bytes());
    }))?;
    if let Some(out) = &options.out {
        let page = std::fs::read_to_string(out).unwrap_or_default();
        let notes = page.split_once(NOTES).map_or("\n", |(_, notes)| notes);
        std::fs::write(out, table(options, &ended) + "\n" + NOTES + notes).context("writing the table")?;
    }
    Ok(ended.iter().all(|run| run.wrong.is_empty()))
}

/// Runs of these seeds that a file of rows holds. A last line that was not written whole is cut off.
fn earlier(rows: &Path, seeds: &Range<u64>) -> anyhow::Result<Vec<Ended>> {
    let Ok(text) = std::fs::read_to_string(rows) else { return Ok(Vec::new()) };
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    if whole < text.len() {
        std::fs::write(rows, &text[..whole]).context("writing the runs")?;
    }
    let mut ended: Vec<Ended> =
        text[..whole].lines().map(serde_json::from_str).collect::<Result<_, _>>().context("reading earlier runs")?;
    ended.retain(|run| seeds.contains(&run.seed));
    Ok(ended)
}

/// All runs, in order of their seeds; those that the file of rows holds are not made again.
///
/// # Errors
/// A room that cannot be made, rows that cannot be read or written.
pub async fn all(options: &SoakOptions, tell: &(dyn Fn(String) + Sync)) -> anyhow::Result<Vec<Ended>> {
    let folder = tempfile::tempdir()?;
    let room = Arc::new(rooms::small(folder.path())?);
    let seeds = options.seed..options.seed + options.runs;
    let mut ended = options.rows.as_deref().map_or_else(|| Ok(Vec::new()), |rows| earlier(rows, &seeds))?;
    let made: BTreeSet<u64> = ended.iter().map(|run| run.seed).collect();
    let mut seeds = seeds.filter(|seed| !made.contains(seed));
    let mut rows = match &options.rows {
        Some(rows) => {
            Some(OpenOptions::new().create(true).append(true).open(rows).context("opening the file of rows")?)
        }
        None => None,
    };
    let mut working = tokio::task::JoinSet::new();
    let begun = Instant::now();
    let in_time = || options.minutes.is_none_or(|minutes| begun.elapsed().as_secs_f64() < minutes * 60.0);
    loop {
        while working.len() < options.jobs.max(1)
            && in_time()
            && let Some(seed) = seeds.next()
        {
            let (room, at) = (Arc::clone(&room), folder.path().join(format!("run_{seed}")));
            let runtime = tokio::runtime::Handle::current();
            // A run is not `Send` throughout: each has its own thread.
            working.spawn_blocking(move || runtime.block_on(one(&room, seed, plan(seed), &at)));
        }
        let Some(done) = working.join_next().await else { break };
        let run = done.map_err(|error| anyhow::anyhow!("a run broke off: {error}"))??;
        if let Some(rows) = &mut rows {
            rows.write_all((serde_json::to_string(&run)? + "\n").as_bytes()).context("writing a run")?;
        }
        if !run.wrong.is_empty() || ended.len() % 20 == 0 {
            tell(format!(
                "{:>4} of {}: seed {} {} {:.1} s {} MiB {}",
                ended.len() + 1,
                options.runs,
                run.seed,
                run.end,
                run.seconds,
                run.peak_mib,
                run.wrong.join("; ")
            ));
        }
        ended.push(run);
    }
    ended.sort_by_key(|run| run.seed);
    Ok(ended)
}

/// The faults of a seed: most runs have some of all kinds, some have a part that always fails.
pub fn plan(seed: u64) -> FaultPlan {
    let draw = |what: &str| drawn(seed, what, b"plan");
    let share = [0.0, 0.1, 0.25, 0.5][(draw("share") * 4.0) as usize % 4];
    let part = [Part::Language, Part::Editor, Part::Mesh, Part::Detector][(draw("part") * 4.0) as usize % 4];
    let possible: Vec<Fault> = Fault::ALL
        .into_iter()
        // What takes seconds each time is not drawn for every request.
        .filter(|fault| {
            fault.befalls(part) && !matches!(fault, Fault::HugeMesh | Fault::Huge | Fault::Silence | Fault::Stall)
        })
        .collect();
    let always = (draw("always") < 0.15).then(|| (part, possible[(draw("which") * possible.len() as f64) as usize]));
    FaultPlan { seed, share, always, only: Vec::new() }
}

/// A player and what it is called in tables.
type Named<P> = (&'static str, Arc<P>);

/// Who plays in a run: every service of the studio comes up.
struct Players {
    language: Named<dyn VisionLanguage>,
    editor: Named<dyn ImageEditor>,
    mesh: Named<dyn MeshGenerator>,
    detector: Named<dyn Detector>,
}

fn players(studio: &Studio, seed: u64) -> Result<Players, RoleError> {
    let http = Http::new(None, Duration::from_secs(1))?;
    let key = || {
        ApiKey::new("STUDIO_KEY", KEY).map_err(|error| RoleError::NotSetUp {
            player: "studio".to_owned(),
            reason: error.to_string(),
            hint: String::new(),
        })
    };
    let at = |service: Service, auth: Auth| ServiceOptions {
        player: service.prefix().to_owned(),
        address: studio.base(service),
        auth,
        limits: HttpLimits { silence: SILENCE, total: TRY, ..HttpLimits::default() },
        remedy: "look at the studio".to_owned(),
    };
    let pick = |what: &str, count: usize| (drawn(seed, what, b"cast") * count as f64) as usize % count;
    let settings =
        |model: &str| ModelSettings { model: model.to_owned(), detail: "high".to_owned(), ..ModelSettings::default() };
    let vlm = |name, service, auth, format, model: &str| {
        let options = VlmOptions { service: at(service, auth), format, settings: settings(model), concurrency: 4 };
        Ok::<Named<dyn VisionLanguage>, RoleError>((name, Arc::new(VlmPlayer::new(&http, options)?)))
    };
    let bearer = || Ok::<Auth, RoleError>(Auth::Bearer(key()?));
    let google = || Ok::<Auth, RoleError>(Auth::Header("x-goog-api-key", key()?));
    let language = match pick("language", 6) {
        0 => vlm("openai", Service::OpenAi, bearer()?, Format::Responses, "gpt-5.5")?,
        1 => vlm("openai chat", Service::OpenAi, bearer()?, Format::Chat(Some(Server::OpenAi)), "gpt-5.5")?,
        2 => vlm("gemini", Service::Gemini, google()?, Format::Gemini, "gemini-3.6-flash")?,
        3 => {
            let auth = Auth::Header("x-api-key", key()?);
            vlm("anthropic", Service::Anthropic, auth, Format::Anthropic, "some-claude")?
        }
        4 => vlm("vllm", Service::Vllm, Auth::None, Format::Chat(None), "")?,
        _ => vlm("llama.cpp", Service::LlamaCpp, Auth::None, Format::Chat(None), "")?,
    };
    let edit = |name, service, auth, format, model: &str| {
        let settings = EditSettings { model: model.to_owned(), ..EditSettings::default() };
        let options = EditorOptions { service: at(service, auth), format, settings, concurrency: 4 };
        Ok::<Named<dyn ImageEditor>, RoleError>((name, Arc::new(EditorPlayer::new(&http, options)?)))
    };
    let editor = match pick("editor", 3) {
        0 => edit("gemini", Service::Gemini, google()?, EditorFormat::Gemini, "gemini-3.1-flash-image")?,
        1 => edit("openai", Service::OpenAi, bearer()?, EditorFormat::OpenAi, "gpt-image-1.5")?,
        _ => edit("sd-server", Service::SdServer, Auth::None, EditorFormat::Local, "")?,
    };
    let hunyuan = |name, service, version, route| {
        let options = HunyuanOptions {
            service: at(service, Auth::None),
            version,
            model: "hunyuan".to_owned(),
            route,
            texture: true,
            seed: 1234,
            poll: Duration::from_millis(20),
            concurrency: 2,
        };
        Ok::<Named<dyn MeshGenerator>, RoleError>((name, Arc::new(HunyuanPlayer::new(&http, options)?)))
    };
    let trellis = |name, service, host| {
        let service = at(service, Auth::None);
        let options = TrellisOptions { service, host, model: "trellis".to_owned(), seed: 1234, concurrency: 2 };
        Ok::<Named<dyn MeshGenerator>, RoleError>((name, Arc::new(TrellisPlayer::new(&http, options)?)))
    };
    let hosted = |name, service, auth, host, model: &str| {
        let options = HostedOptions {
            service: at(service, auth),
            host,
            model: model.to_owned(),
            texture: true,
            seed: 1234,
            extra: serde_json::Map::new(),
            frame: None,
            usd_per_credit: None,
            poll: Duration::from_millis(10),
            patience: TRY + SILENCE,
            tasks: Arc::new(Tasks::default()),
            concurrency: 4,
        };
        Ok::<Named<dyn MeshGenerator>, RoleError>((name, Arc::new(HostedPlayer::new(&http, options)?)))
    };
    let mesh = match pick("mesh", 10) {
        0 | 1 => hunyuan("hunyuan 2", Service::Hunyuan2, Version::V2, Route::Generate)?,
        2 => hunyuan("hunyuan 2 jobs", Service::Hunyuan2, Version::V2, Route::Send)?,
        3 => hunyuan("hunyuan 2.1", Service::Hunyuan21, Version::V2_1, Route::Generate)?,
        4 => trellis("trellis nim", Service::TrellisNim, Host::Nim)?,
        5 => trellis("trellis localai", Service::TrellisLocalAi, Host::LocalAi)?,
        6 => hosted("fal", Service::Fal, Auth::Scheme("Key", key()?), Hosted::Fal, "fal-ai/trellis")?,
        7 => hosted("replicate", Service::Replicate, bearer()?, Hosted::Replicate, "firtoz/trellis:1")?,
        8 => hosted("tripo", Service::Tripo, bearer()?, Hosted::Tripo, "v2.5-20250123")?,
        _ => hosted("meshy", Service::Meshy, bearer()?, Hosted::Meshy, "meshy-6")?,
    };
    let detector: Named<dyn Detector> = match pick("detector", 3) {
        0 => {
            let service = at(Service::LocateAnything, Auth::None);
            let options = LocateOptions { service, model: "LocateAnything-3B".to_owned(), concurrency: 1 };
            ("locate anything", Arc::new(LocatePlayer::new(&http, options)?))
        }
        1 => {
            let service = at(Service::GroundingDino, Auth::None);
            let options = GroundingOptions { service, model: "dino".to_owned(), threshold: 0.35, concurrency: 1 };
            ("grounding dino", Arc::new(GroundingPlayer::new(&http, options)?))
        }
        _ => ("vlm boxes", Arc::new(VlmBoxes::new(Arc::clone(&language.1), BoxStyle::Thousandths))),
    };
    Ok(Players { language, editor, mesh, detector })
}

/// Settings under which computing takes a second: first poses are enough.
pub fn quick_settings() -> Settings {
    let mut settings = Settings { working_px: 256, surface_px_per_m: 10.0, ..Settings::default() };
    settings.mesh.faces = 2000;
    let placement = &mut settings.placement;
    (placement.refinement, placement.optimiser) = (false, false);
    (placement.global_refinement, placement.collision) = (false, false);
    (placement.max_rounds, placement.renders_per_object, placement.window_px) = (1, 2, 32);
    settings
}

/// One run: `seed` says who plays, `faults` what befalls them. The folder `out` is made and taken away again.
///
/// # Errors
/// A folder that cannot be written, a studio that cannot be started.
pub async fn one(room: &TruthRoom, seed: u64, faults: FaultPlan, out: &Path) -> anyhow::Result<Ended> {
    let truth_oracle = Arc::new(TruthOracle::new(room.clone(), NoiseLevel::Real.noise(), seed, false)?);
    let studio =
        Studio::start(Arc::clone(&truth_oracle), StudioOptions { faults, ..StudioOptions::default() }, 0).await?;
    let who = players(&studio, seed)?;
    let offline = flat_cast();
    let cast = Cast {
        vision_language: Arc::clone(&who.language.1),
        image_editor: Arc::clone(&who.editor.1),
        mesh_generator: Arc::clone(&who.mesh.1),
        detector: Arc::clone(&who.detector.1),
        // These two have no service: the truth itself plays.
        ..truth_oracle.oracle.cast(&offline)
    };
    std::fs::create_dir_all(out)?;
    let book = CallBook::open(out, BookOptions { without_images: true, ..BookOptions::default() })?;
    let warnings = Arc::new(Warnings::default());
    let collected = Arc::clone(&warnings);
    let mut limits = Limits::default();
    limits.retry.retries = 3;
    (limits.retry.first_seconds, limits.retry.most_seconds, limits.retry.patience_seconds) = (0.03, 0.1, 5.0);
    // The client's own deadline is the shorter one; this one bounds what is computed around it, too.
    limits.minute = Some(Duration::from_secs(1));
    limits.try_seconds = Role::ALL.into_iter().map(|role| (role, 20.0)).collect();
    let has_deadline = drawn(seed, "deadline", b"plan") < 0.1;
    let budget = Budget {
        minutes: has_deadline.then_some(DEADLINE.as_secs_f64() / 60.0),
        grace_seconds: Some(GRACE.as_secs_f64()),
        ..Budget::default()
    };
    let options = CallOptions {
        on_warning: Arc::new(move |warning| collected.push(warning)),
        limits,
        budget,
        random: Arc::new(move || drawn(seed, "jitter", b"")),
        ..CallOptions::default()
    };
    let calls = Calls::new(Arc::new(book), cast, offline, options);
    let photo = harmony_io::load_photo(&room.photo())?;
    let request = RunRequest {
        photo,
        title: room.name.clone(),
        run: out.to_owned(),
        profile: "studio".to_owned(),
        settings: quick_settings(),
        until: Phase::Lighting,
        path_tracer: false,
        further_inputs: String::new(),
    };
    let silent: harmony_pipeline::ProgressSink = Arc::new(|_| {});
    forget_peak();
    let begun = Instant::now();
    let run = Box::pin(harmony_pipeline::run(&request, &calls, &warnings, &silent));
    let outcome = tokio::time::timeout(RUN, run).await;
    let seconds = begun.elapsed();
    let mut ended = Ended {
        seed,
        cast: format!("{}, {}, {}, {}", who.language.0, who.editor.0, who.mesh.0, who.detector.0),
        faults: BTreeMap::new(),
        end: String::new(),
        reason: None,
        objects: 0,
        seconds: seconds.as_secs_f64(),
        peak_mib: status_mib("VmHWM"),
        after_mib: 0,
        requests: 0,
        wrong: Vec::new(),
    };
    let replaced = calls.counts().replaced;
    match outcome {
        Err(_) => {
            ended.end = "hangs".to_owned();
            ended.wrong.push(format!("it was not at its end after {RUN:?}"));
        }
        Ok(Err(error)) => {
            ended.end = "error".to_owned();
            ended.reason = Some(error.to_string());
        }
        Ok(Ok(outcome)) => {
            if let Some(scene) = &outcome.scene {
                ended.objects = scene.objects.len();
            }
            match (&outcome.failure, &outcome.scene) {
                (Some(failure), _) => {
                    let stopped =
                        calls.stop().reason().is_some_and(|r| matches!(r, harmony_calls::StopReason::Budget(_)));
                    ended.end = if stopped { "stopped at its deadline" } else { "error" }.to_owned();
                    ended.reason = Some(failure.to_string());
                    if failure.reason.trim().is_empty() || (stopped && failure.hint.is_none()) {
                        ended.wrong.push("the failure says nothing, or not what to do".to_owned());
                    }
                    if failure.reason.contains("failed inside") {
                        ended.wrong.push(format!("a fault of the program: {}", failure.reason));
                    }
                }
                (None, Some(scene)) => {
                    ended.end = if replaced > 0 { "scene, with stand-ins" } else { "scene" }.to_owned();
                    let told = scene.warnings.iter().any(|w| w.kind == WarningKind::PlayerReplaced);
                    if replaced > 0 && !told {
                        ended.wrong.push("somebody stood in and nobody was told".to_owned());
                    }
                    if let Err(error) = honest(&calls, scene) {
                        ended.wrong.push(error);
                    }
                }
                (None, None) => ended.wrong.push("neither a scene nor a failure".to_owned()),
            }
        }
    }
    if has_deadline && seconds > DEADLINE + GRACE + COMPUTING {
        ended.wrong.push(format!("it took {seconds:?} with a deadline of {DEADLINE:?}"));
    }
    // What is on its way out when the run ends is let go of.
    tokio::time::sleep(Duration::from_millis(20)).await;
    judge(&studio, &calls, &mut ended);
    std::fs::remove_dir_all(out)?;
    ended.after_mib = status_mib("VmRSS");
    Ok(ended)
}

/// Every stand-in's answer is told of by a warning that names the phase.
fn honest(calls: &Calls, scene: &harmony_scene::Scene) -> Result<(), String> {
    let log = calls.book().log().map_err(|error| error.to_string())?;
    for call in log.iter().filter(|call| matches!(call.source, Source::Replaced { .. })) {
        let phase = call.name.split('/').next().unwrap_or_default();
        let told = scene.warnings.iter().any(|w| w.kind == WarningKind::PlayerReplaced && w.phase == phase);
        if !told {
            return Err(format!("{} was answered by a stand-in, and no warning says so", call.name));
        }
    }
    Ok(())
}

/// What the studio has to say about a run.
fn judge(studio: &Studio, calls: &Calls, ended: &mut Ended) {
    let entries = studio.ledger.entries();
    ended.requests = entries.len();
    for fault in entries.iter().filter_map(|entry| entry.fault) {
        *ended.faults.entry(fault).or_default() += 1;
    }
    for (work, count) in studio.ledger.paid_twice() {
        ended.wrong.push(format!("{work} was paid {count} times"));
    }
    if studio.visits_elsewhere() > 0 {
        ended.wrong.push("a redirect was followed".to_owned());
    }
    // What the studio was paid for is on the bill, as far as it came: answered tries that were accepted or refused.
    let paid = entries.iter().filter(|entry| entry.is_paid() && entry.part != Part::Detector).count();
    let asked = calls.counts().asked_outside;
    if paid > asked {
        ended.wrong.push(format!("{paid} answers were paid, {asked} are on the bill"));
    }
}

/// Forgets the largest memory so far (Linux); elsewhere the figure is 0.
pub fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// A row of the process's state in MiB (Linux): `VmHWM`, the largest memory since it was forgotten; `VmRSS`, memory now.
pub fn status_mib(row: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let value = status.lines().find_map(|line| line.strip_prefix(row)?.strip_prefix(':'));
    value.and_then(|value| value.trim().trim_end_matches(" kB").trim().parse::<u64>().ok()).map_or(0, |kb| kb / 1024)
}

/// The table, in Markdown.
pub fn table(options: &SoakOptions, ended: &[Ended]) -> String {
    let count = |is: &dyn Fn(&Ended) -> bool| ended.iter().filter(|run| is(run)).count();
    let mut text = format!(
        "# Runs with faults\n\n`harmony-studio faults --runs {} --seed {} --jobs {}`\n\n{} runs, {} requests, {} of them \
         with a fault; {} runs in which something is wrong.\n\n",
        options.runs,
        options.seed,
        options.jobs,
        ended.len(),
        ended.iter().map(|run| run.requests).sum::<usize>(),
        ended.iter().flat_map(|run| run.faults.values()).sum::<usize>(),
        count(&|run| !run.wrong.is_empty()),
    );
    text.push_str(
        "| how runs ended | runs | objects, mean | slowest, s | largest memory, MiB |\n|---|---|---|---|---|\n",
    );
    let mut ends: Vec<&str> = ended.iter().map(|run| run.end.as_str()).collect();
    ends.sort_unstable();
    ends.dedup();
    for end in ends {
        let runs: Vec<&Ended> = ended.iter().filter(|run| run.end == end).collect();
        let worst = runs.iter().map(|run| run.seconds).fold(0.0, f64::max);
        let objects = runs.iter().map(|run| run.objects).sum::<usize>() as f64 / runs.len().max(1) as f64;
        let memory = runs.iter().map(|run| run.peak_mib).max().unwrap_or_default();
        text.push_str(&format!("| {end} | {} | {objects:.1} | {worst:.1} | {memory} |\n", runs.len()));
    }
    text.push_str(
        "\n| fault | times | runs with it | of these: a scene | with stand-ins | stopped | an error | slowest, s | \
         largest memory, MiB |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for fault in Fault::ALL {
        let runs: Vec<&Ended> = ended.iter().filter(|run| run.faults.contains_key(&fault)).collect();
        let times: usize = runs.iter().filter_map(|run| run.faults.get(&fault)).sum();
        let of = |end: &str| runs.iter().filter(|run| run.end.starts_with(end)).count();
        let with = runs.iter().filter(|run| run.end == "scene, with stand-ins").count();
        text.push_str(&format!(
            "| {} | {times} | {} | {} | {with} | {} | {} | {:.1} | {} |\n",
            fault.name(),
            runs.len(),
            of("scene") - with,
            of("stopped"),
            of("error"),
            runs.iter().map(|run| run.seconds).fold(0.0, f64::max),
            runs.iter().map(|run| run.peak_mib).max().unwrap_or_default(),
        ));
    }
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    for reason in ended.iter().filter_map(|run| run.reason.as_deref()) {
        *reasons.entry(reason).or_default() += 1;
    }
    if !reasons.is_empty() {
        text.push_str("\n| why runs ended early | runs |\n|---|---|\n");
        for (reason, count) in reasons {
            let short: String = reason.chars().take(200).collect();
            text.push_str(&format!("| {} | {count} |\n", short.replace('|', "/").replace('\n', " ")));
        }
    }
    for run in ended.iter().filter(|run| !run.wrong.is_empty()) {
        text.push_str(&format!("\nWRONG, seed {} ({}): {}\n", run.seed, run.cast, run.wrong.join("; ")));
    }
    text
}
