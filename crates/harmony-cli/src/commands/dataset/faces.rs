//! `harmony dataset faces`: the detector is asked where faces are in the photos of a data set.
//!
//! Answers are records of calls in the data set's folder `faces`, written as they come: what was paid is there when the
//! program is killed, and asking again costs nothing. `sources.csv` is written once, when all have answered.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use harmony_calls::{BookOptions, CallBook, CallName, CallOptions, Calls, Cast, StopReason};
use harmony_dataset::config::Config;
use harmony_dataset::faces::{self, Face, Kept, Look, Wanted, Which};
use harmony_dataset::sources::{self, Source};
use harmony_dataset::{DatasetError, layout};
use harmony_pipeline::{RunFolder, RunFolderError};
use harmony_players::flat_cast;
use harmony_roles::{DetectRequest, PhraseRequest, PlayerCard, Role, RoleError};
use harmony_scene::{ImageSize, Level};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use super::failed;
use crate::cast::{self, Known};
use crate::config::players::{Boxes, Editor, Language, Meshes, PlayersConfig};
use crate::config::{self, ConfigFile, Profile};
use crate::display::{Display, hinted};
use crate::{EXIT_INCOMPLETE, EXIT_OK, EXIT_STOPPED, models, networks, say, stopping, tell};

/// What is looked for: faces of people, and of people in mirrors and pictures.
const PHRASE: &str = "human face . face in a mirror . face in a photograph";

/// Photos that are under way at a time; how many a player takes at a time is its own.
const AT_ONCE: usize = 8;

/// Photos that are decoded at a time: one of a hundred megapixels takes 600 MB.
const DECODED_AT_ONCE: usize = 2;

/// So many failures in a row, and no answer between them, are no longer those of single photos; as `harmony batch` has it.
const IN_A_ROW: usize = 20;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct FacesArgs {
    /// The data set.
    root: PathBuf,
    /// Whose detector is asked.
    #[arg(long)]
    profile: Option<Profile>,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Leave out photos that somebody looked at: `faces` or `blur` of sources.csv says something.
    #[arg(long)]
    only_new: bool,
    /// Least score at which a face is blurred, 0 to 1; one without a score is blurred.
    #[arg(long, default_value_t = faces::MIN_SCORE, value_parser = share)]
    min_score: f64,
    /// Nothing may leave this machine: players elsewhere are refused.
    #[arg(long)]
    local_only: bool,
    /// Stop before more US dollars are spent on the faces of this data set; overrides budget.usd.
    #[arg(long)]
    max_usd: Option<f64>,
}

fn share(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v| (0.0..=1.0).contains(v)).ok_or_else(|| "a number from 0 to 1".to_owned())
}

/// Runs the command.
///
/// # Errors
/// No data set, nobody who finds faces, a player that is not there; nothing was changed then.
pub fn run(args: &FacesArgs) -> Result<u8> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    runtime.block_on(look(args))
}

async fn look(args: &FacesArgs) -> Result<u8> {
    Config::load(&args.root).map_err(failed)?;
    let rows = sources::load(&args.root).map_err(failed)?;
    // Regions that cannot be read cannot be added to; better told before anything is paid.
    rows.iter().try_for_each(|row| row.boxes().map(|_| ())).map_err(failed)?;
    let wanted = faces::wanted(&rows, if args.only_new { Which::New } else { Which::Published });
    if wanted.photos.is_empty() {
        say!("there is no photo to look at{}", left_out(&wanted))?;
        return Ok(EXIT_OK);
    }
    let config = config::load(args.config.as_deref())?;
    let (cast, known) = detector(&config, args)?;
    let card = cast.detector.card();
    let folder = args.root.join(layout::FACES);
    let there = answered(&folder, &card, &wanted.photos);
    let asked = wanted.photos.len() - there;
    if asked > 0 {
        reach(&known).await?;
    }
    let _only_one = RunFolder::take(&folder).map_err(|e| {
        let busy = matches!(e, RunFolderError::Busy { .. });
        hinted(e.to_string(), if busy { Some("wait until it has ended") } else { e.hint() })
    })?;
    let display = Display::new();
    let calls = Arc::new(calls(&folder, &config, args, cast, known, &display)?);
    let who = format!("{} {}", card.player, card.model).trim().to_owned();
    say!(
        "{who} is asked about {asked} of {} photos{}{}; {}",
        rows.len(),
        if there > 0 { format!(", has answered about {there} already") } else { String::new() },
        left_out(&wanted),
        price(&config, &card, asked)
    )?;
    stopping::on_interrupt(&calls);
    let ticker = stopping::show_calls(&calls, &display);
    let outcome = ask_all(&args.root, wanted.photos, &calls, &*display.line_sink()).await;
    ticker.abort();
    display.finish();
    let kept = faces::keep(&args.root, &outcome.looks, &who, args.min_score).map_err(failed)?;
    report(args, &outcome, &kept)?;
    let stopped = matches!(calls.stop().reason(), Some(StopReason::Interrupted(_) | StopReason::Budget(_)));
    Ok(match () {
        () if stopped => EXIT_STOPPED,
        () if outcome.failed + outcome.left > 0 => EXIT_INCOMPLETE,
        () => EXIT_OK,
    })
}

/// Photos that nobody is asked about, in words.
fn left_out(wanted: &Wanted) -> String {
    let counts = [(wanted.unpublished, "not published"), (wanted.known, "looked at before")];
    let said: Vec<String> = counts.iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!(", {n} {why}")).collect();
    said.concat()
}

fn price(config: &ConfigFile, card: &PlayerCard, asked: usize) -> String {
    match config.prices.expected(Role::Detector, card) {
        _ if card.offline => "this costs nothing but time".to_owned(),
        Some(usd) => format!("about {:.2} US$ by [prices]", usd * asked as f64),
        None => "[prices] does not say what that costs".to_owned(),
    }
}

/// A cast whose detector knows faces when it sees them.
fn detector(config: &ConfigFile, args: &FacesArgs) -> Result<(Cast, Known)> {
    let profile = args.profile.or(config.profile).unwrap_or_default();
    let mut players = config.players.resolved(profile);
    players.local_only |= args.local_only;
    // Only who looks is wanted: no key of anybody else.
    players.image_editor.player = Some(Editor::Offline);
    players.mesh_generator.player = Some(Meshes::Offline);
    let (mut cast, mut known) = (flat_cast(), Known::default());
    let played = native(&mut cast, &mut known, &players, config);
    if played.detector {
        players.detector.player = Some(Boxes::Owlv2);
    }
    if players.detector.player != Some(Boxes::VlmBoxes) {
        players.vision_language.player = Some(Language::Offline);
    }
    let mut failures = played.failures;
    failures.extend(cast::cast_services(&mut cast, &players, None, &mut known));
    if let Some((role, error)) = failures.into_iter().next() {
        return Err(hinted(format!("{}: {error}", role.folder()), error.hint().map(str::to_owned)));
    }
    let boxes = !matches!(players.detector.player, None | Some(Boxes::Offline | Boxes::WithList));
    let looks = players.detector.player != Some(Boxes::VlmBoxes) || cast.vision_language.sees();
    if !(boxes && looks && cast.detector.gives_boxes() && cast.detector.recognises()) {
        let message = format!("nobody in profile {} finds faces", profile.name());
        let hint = "cast a detector: --profile paper, local or hosted, or `player` = locate_anything, grounding_dino, owlv2 or \
                    vlm_boxes in [players.detector] of harmony.toml (docs/players.md); or look yourself and write regions into \
                    the column blur of sources.csv, and `by hand` into faces (harmony dataset add: --blur, --faces)";
        return Err(hinted(message, Some(hint)));
    }
    Ok((cast, known))
}

/// OWLv2 inside this program, where it is wanted and there.
fn native(cast: &mut Cast, known: &mut Known, players: &PlayersConfig, config: &ConfigFile) -> networks::Played {
    let wanted = networks::Wanted {
        players,
        store: &models::store(&config.models, None),
        no_geometry: true,
        no_masks: true,
        tell: &|line| tell!("{line}"),
    };
    networks::cast(cast, &wanted, known)
}

/// How many photos have a player's answer already; whether it is about the same photo shows when it is taken.
fn answered(folder: &Path, card: &PlayerCard, photos: &[Source]) -> usize {
    let book = CallBook::look(folder);
    let has = |row: &&Source| {
        let record = CallName::new(&row.id().path()).ok().and_then(|name| book.record(Role::Detector, &name));
        record.is_some_and(|r| r.cast.player == card.player && r.cast.model == card.model)
    };
    photos.iter().filter(has).count()
}

/// A player that is not there is told before anything is asked.
async fn reach(known: &Known) -> Result<()> {
    for (role, name, result) in cast::check_all(&known.checks, false).await {
        let Err(error) = result else { continue };
        let section = role.folder();
        let hint = error.hint().map_or_else(
            || {
                format!(
                    "start it (docs/players.md tells how), or check `address` in [players.{section}] of harmony.toml, or set \
                     another `player` there"
                )
            },
            str::to_owned,
        );
        return Err(hinted(format!("{section}: {name}: {error}"), Some(hint)));
    }
    Ok(())
}

fn calls(
    folder: &Path,
    config: &ConfigFile,
    args: &FacesArgs,
    cast: Cast,
    known: Known,
    display: &Arc<Display>,
) -> Result<Calls> {
    let mut budget = config.budget.clone();
    budget.usd = args.max_usd.or(budget.usd);
    budget.check().map_err(|e| anyhow::anyhow!(e))?;
    // The photos are in the data set.
    let options = BookOptions { secrets: known.secrets, without_images: true, ..BookOptions::default() };
    let book = CallBook::open(folder, options).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let options = CallOptions {
        on_event: display.call_sink(),
        limits: config.limits.clone(),
        budget,
        prices: config.prices.clone(),
        ..CallOptions::default()
    };
    // Nobody stands in: regions by rules are no faces.
    Ok(Calls::new(Arc::new(book), cast.clone(), cast, options))
}

/// Why a photo was not looked at.
enum Failure {
    Photo(DatasetError),
    Call(RoleError),
}

impl Failure {
    /// Whether the others would fail, too.
    fn is_everybodys(&self) -> bool {
        matches!(self, Self::Call(error) if error.is_fatal() || matches!(error, RoleError::NotSetUp { .. }))
    }

    /// Whether the photo's turn did not come: somebody stopped, or a budget is reached.
    fn is_stop(&self) -> bool {
        matches!(self, Self::Call(RoleError::Interrupted { .. } | RoleError::Budget { .. }))
    }

    fn text(&self) -> String {
        let (text, hint) = match self {
            Self::Photo(error) => (error.to_string(), error.hint().map(str::to_owned)),
            Self::Call(error) => (error.to_string(), error.hint().map(str::to_owned)),
        };
        hint.map_or_else(|| text.clone(), |hint| format!("{text} (hint: {hint})"))
    }
}

/// What all photos gave.
#[derive(Default)]
struct Outcome {
    /// By scene.
    looks: Vec<Look>,
    /// Photos whose look failed.
    failed: usize,
    /// Photos whose turn did not come.
    left: usize,
    /// Why it did not.
    because: Option<String>,
}

/// Looks at photos beside each other. One that fails is told and the others go on, unless they would fail, too.
async fn ask_all(root: &Path, photos: Vec<Source>, calls: &Arc<Calls>, line: &(dyn Fn(String) + Sync)) -> Outcome {
    let (total, root) = (photos.len(), Arc::<Path>::from(root));
    let decoding = Arc::new(Semaphore::new(DECODED_AT_ONCE));
    let mut photos = photos.into_iter();
    let mut tasks: JoinSet<(String, Result<Look, Failure>)> = JoinSet::new();
    let (mut outcome, mut in_a_row) = (Outcome::default(), 0);
    loop {
        while tasks.len() < AT_ONCE && outcome.because.is_none() {
            let Some(row) = photos.next() else { break };
            let (root, calls, decoding) = (Arc::clone(&root), Arc::clone(calls), Arc::clone(&decoding));
            tasks.spawn(async move { (row.id().path(), one(root, row, &calls, &decoding).await) });
        }
        let Some(done) = tasks.join_next().await else { break };
        let number = outcome.looks.len() + outcome.failed + 1;
        match done {
            Ok((scene, Ok(look))) => {
                in_a_row = 0;
                line(format!("{number}/{total} {scene}: {} faces", look.faces.len()));
                outcome.looks.push(look);
            }
            Ok((_, Err(failure))) if failure.is_stop() => {
                outcome.left += 1;
                outcome.because.get_or_insert(failure.text());
            }
            Ok((scene, Err(failure))) => {
                in_a_row += 1;
                outcome.failed += 1;
                line(format!("{number}/{total} {scene}: not looked at: {}", failure.text()));
                if failure.is_everybodys() {
                    outcome.because.get_or_insert(failure.text());
                } else if in_a_row == IN_A_ROW {
                    outcome.because.get_or_insert(format!("{IN_A_ROW} photos failed in a row"));
                }
            }
            // A panic of ours.
            Err(error) => {
                outcome.failed += 1;
                line(format!("a look broke off: {error}"));
            }
        }
    }
    outcome.left += photos.count();
    outcome.looks.sort_by(|a, b| a.scene.cmp(&b.scene));
    outcome
}

async fn one(root: Arc<Path>, row: Source, calls: &Calls, decoding: &Semaphore) -> Result<Look, Failure> {
    let (scene, sha256) = (row.id(), row.sha256.clone());
    let broke = |reason: String| Failure::Call(RoleError::NotCapable { player: "this program".to_owned(), reason });
    let shown = {
        let _place = decoding.acquire().await.map_err(|e| broke(e.to_string()))?;
        let shown = tokio::task::spawn_blocking(move || faces::open(&root, &row)).await;
        shown.map_err(|e| broke(e.to_string()))?.map_err(Failure::Photo)?
    };
    let size = ImageSize::new(shown.image.width(), shown.image.height());
    let request = DetectRequest {
        name: scene.path(),
        image: Arc::new(shown.image),
        level: Level::Decoration,
        phrases: vec![PhraseRequest { label: "face".to_owned(), phrase: PHRASE.to_owned(), count: 0 }],
    };
    let found = calls.detect(&request).await.map_err(Failure::Call)?;
    let face = |d: &harmony_roles::Detection| {
        Some(Face { region: faces::region(&d.bounds, size, shown.photo)?, score: d.score })
    };
    Ok(Look { scene, sha256, faces: found.detections.iter().filter_map(face).collect() })
}

/// Tells what was found, what is blurred of it and what was not looked at.
fn report(args: &FacesArgs, outcome: &Outcome, kept: &Kept) -> Result<()> {
    let mut found = 0;
    for look in &outcome.looks {
        found += look.faces.len();
        for face in &look.faces {
            let [x0, y0, x1, y1] = face.region;
            let score = face.score.map_or_else(|| "no score".to_owned(), |score| format!("score {score:.2}"));
            let low = if face.score.is_some_and(|score| score < args.min_score) {
                format!(", below {}: not blurred (--min-score)", args.min_score)
            } else {
                String::new()
            };
            say!("{}: {x0} {y0} {x1} {y1}, {score}{low}", look.scene.path())?;
        }
    }
    for scene in &kept.gone {
        tell!("{}: its row or its photo is another one by now; nothing was written about it", scene.path());
    }
    say!(
        "{} photos looked at, {found} faces, {} regions added, {} faces not blurred for their score",
        kept.photos,
        kept.regions,
        kept.below
    )?;
    if outcome.failed > 0 {
        tell!("{} photos could not be looked at", outcome.failed);
    }
    if outcome.left > 0 {
        let because = outcome.because.as_deref().unwrap_or_default();
        tell!("{} photos were not asked about: {because}", outcome.left);
    }
    if outcome.failed + outcome.left > 0 {
        tell!("run the same command again to go on: what was answered is not asked again");
    }
    if kept.photos > 0 {
        tell!("note: detectors miss faces; look at the photos of a release before you publish it");
    }
    Ok(())
}
