//! Who plays: the only place that knows every player.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use harmony_calls::{Cast, Secret};
use harmony_io::{PointMapOptions, load_masks, load_point_map, points::parse_intrinsics};
use harmony_models::Store;
use harmony_players::check::{Check, Checked};
use harmony_players::{
    BoxesWithLists, FilesEvent, FilesOptions, FilesPlayer, MaskFiles, PointMapFile, flat_cast, offline_cast,
};
use harmony_roles::{Role, RoleError};
use harmony_scene::ImageSize;

use crate::config::Profile;
use crate::config::players::{Boxes, Language, PlayersConfig};
use crate::display::hinted;
use crate::networks::{self, Wanted};
pub use services::Known;
use services::Services;

mod services;

/// Folder below a run's calls where tasks at hosted services are noted.
pub const TASKS: &str = ".tasks";

/// How long a check that costs nothing may take.
const FREE_PATIENCE: Duration = Duration::from_secs(30);

/// How long a check that does a piece of work may take.
const PAID_PATIENCE: Duration = Duration::from_mins(10);

/// What the cast is made from.
pub struct CastRequest<'a> {
    /// Profile.
    pub profile: Profile,
    /// Hosted and local players, resolved for the profile.
    pub players: PlayersConfig,
    /// Weights of networks.
    pub models: Store,
    /// Size of the photo as loaded.
    pub photo_size: ImageSize,
    /// Point map.
    pub points: Option<&'a Path>,
    /// `fx,fy,cx,cy` of a depth image.
    pub intrinsics: Option<&'a str>,
    /// Depth units a metre.
    pub depth_scale: f64,
    /// Masks.
    pub masks: Option<&'a Path>,
    /// Folder of the files player.
    pub questions: PathBuf,
    /// Where tasks at hosted services are noted, so that another start goes on with them; `None` = nowhere.
    pub tasks: Option<PathBuf>,
    /// Its patience, minutes; 0 = for ever.
    pub timeout_minutes: f64,
    /// Whether a path tracer may be used.
    pub path_tracer: bool,
    /// Longest side of the photo the pipeline works with, pixels.
    pub working_px: u32,
    /// Told what a person should know.
    pub tell: Arc<dyn Fn(String) + Send + Sync>,
}

/// A cast, and what the pipeline must know about it.
pub struct Casting {
    /// Who plays.
    pub cast: Cast,
    /// Who stands in.
    pub offline: Cast,
    /// Hash of the files that were given beside the photo.
    pub inputs: String,
    /// What was unusual about them.
    pub notes: Vec<String>,
    /// Networks that were wanted and are not there.
    pub absent: Vec<String>,
    /// Hosted and local players that can be asked whether they are there.
    pub checks: Vec<(Role, String, Arc<dyn Check>)>,
    /// Keys, to be kept out of everything that is written.
    pub secrets: Vec<Secret>,
}

/// Casts every role.
///
/// # Errors
/// A file that was given and cannot be used.
pub fn cast(request: &CastRequest<'_>) -> Result<Casting> {
    let offline = if request.path_tracer { offline_cast() } else { flat_cast() };
    let mut cast = offline.clone();
    let mut notes = Vec::new();
    let mut inputs = blake3::Hasher::new();
    let working = request.photo_size.fit_within(request.working_px);
    let mut known = Known::default();
    let wanted = Wanted {
        players: &request.players,
        store: &request.models,
        no_geometry: request.points.is_some(),
        no_masks: request.masks.is_some(),
        tell: &*request.tell,
    };
    let own = networks::cast(&mut cast, &wanted, &mut known);
    let mut players = request.players.clone();
    if own.detector {
        // No server is needed, so none is asked.
        players.detector.player = Some(Boxes::Owlv2);
    }
    let players = &players;
    if players.vision_language.player == Some(Language::Files) {
        cast.vision_language = Arc::new(FilesPlayer::new(files_options(request)));
        (request.tell)(format!("questions will appear in {}", request.questions.display()));
    }
    let mut failures = own.failures;
    failures.extend(cast_services(&mut cast, players, request.tasks.as_deref(), &mut known));
    if !failures.is_empty() {
        // Everything that is missing at once: nobody likes to be told of the next thing after each.
        let each = |(role, failure): &(Role, RoleError)| format!("{}: {failure}", role.folder());
        let reasons: Vec<String> = failures.iter().map(each).collect();
        let mut hints: Vec<&str> = failures.iter().filter_map(|(_, failure)| failure.hint()).collect();
        hints.push("`harmony doctor` tells more");
        let message = format!("profile {} can't play: {}", request.profile.name(), reasons.join("; "));
        return Err(hinted(message, Some(hints.join("; "))));
    }
    if players.detector.player == Some(Boxes::WithList) {
        cast.detector = Arc::new(BoxesWithLists);
    }
    if let Some(path) = request.points {
        let mut options = PointMapOptions::new(working);
        options.depth_scale = Some(request.depth_scale);
        if let Some(text) = request.intrinsics {
            options.intrinsics = Some(parse_intrinsics(text).map_err(|e| hinted(e.to_string(), e.hint()))?);
        }
        // What cannot be used is told before anything is run.
        load_point_map(path, &options).map_err(|e| hinted(e.to_string(), e.hint()))?;
        inputs.update(&std::fs::read(path).unwrap_or_default());
        inputs.update(request.intrinsics.unwrap_or_default().as_bytes());
        inputs.update(&request.depth_scale.to_le_bytes());
        let player = PointMapFile::new(path.to_owned(), options).map_err(|e| hinted(e.to_string(), e.hint()))?;
        cast.geometry_estimator = Arc::new(player);
    }
    if let Some(path) = request.masks {
        let loaded = load_masks(path, working).map_err(|e| hinted(e.to_string(), e.hint()))?;
        notes.extend(loaded.notes);
        for mask in &loaded.masks {
            inputs.update(mask.name.as_bytes());
            inputs.update(&mask.mask.bits().iter().map(|b| u8::from(*b)).collect::<Vec<_>>());
        }
        let player = Arc::new(MaskFiles::new(loaded.masks));
        if player.have_labels() {
            cast.detector = player.clone();
        }
        cast.segmenter = player;
    }
    let inputs = inputs.finalize().to_hex().to_string();
    let Known { checks, secrets } = known;
    let absent = own.notes;
    Ok(Casting { cast, offline, inputs, notes, absent, checks, secrets })
}

/// Casts hosted and local players for the roles that have one; the roles for which that failed, and why. `tasks` as in
/// [`CastRequest::tasks`].
pub fn cast_services(
    cast: &mut Cast,
    players: &PlayersConfig,
    tasks: Option<&Path>,
    known: &mut Known,
) -> Vec<(Role, RoleError)> {
    let services = Services::new(players, tasks);
    let mut failures = Vec::new();
    match services.language(known) {
        Ok(player) => cast.vision_language = player.unwrap_or_else(|| Arc::clone(&cast.vision_language)),
        Err(error) => failures.push((Role::VisionLanguage, error)),
    }
    match services.editor(known) {
        Ok(player) => cast.image_editor = player.unwrap_or_else(|| Arc::clone(&cast.image_editor)),
        Err(error) => failures.push((Role::ImageEditor, error)),
    }
    match services.meshes(known) {
        Ok(player) => cast.mesh_generator = player.unwrap_or_else(|| Arc::clone(&cast.mesh_generator)),
        Err(error) => failures.push((Role::MeshGenerator, error)),
    }
    match services.detector(&cast.vision_language, known) {
        Ok(player) => cast.detector = player.unwrap_or_else(|| Arc::clone(&cast.detector)),
        Err(error) => failures.push((Role::Detector, error)),
    }
    failures
}

/// What to do about a player that does not answer; `name` says where it is.
#[must_use]
pub fn unreachable_hint(role: Role, name: &str) -> String {
    let section = role.folder();
    let first = if name.contains(" at https://") {
        "is this machine online? A proxy is taken from HTTPS_PROXY. The service's status page tells whether it is down"
            .to_owned()
    } else {
        format!("start it (docs/players.md tells how), or check `address` in [players.{section}] of harmony.toml")
    };
    format!("{first}; or set another `player` in [players.{section}], or use --profile offline")
}

/// Asks all players at once whether they are there.
pub async fn check_all(
    checks: &[(Role, String, Arc<dyn Check>)],
    paid: bool,
) -> Vec<(Role, String, Result<Checked, RoleError>)> {
    let tasks: Vec<_> = checks
        .iter()
        .map(|(role, name, check)| {
            let check = Arc::clone(check);
            let task = tokio::spawn(async move {
                let patience = if paid { PAID_PATIENCE } else { FREE_PATIENCE };
                tokio::time::timeout(patience, check.check(paid)).await.unwrap_or_else(|_| {
                    Err(RoleError::Unavailable {
                        player: "the check".to_owned(),
                        reason: format!("no answer within {patience:?}"),
                        status: None,
                        retry_after: None,
                    })
                })
            });
            (*role, name.clone(), task)
        })
        .collect();
    let mut results = Vec::new();
    for (role, name, task) in tasks {
        let result = task.await.unwrap_or_else(|error| {
            Err(RoleError::NotCapable { player: name.clone(), reason: format!("the check broke off: {error}") })
        });
        results.push((role, name, result));
    }
    results
}

fn files_options(request: &CastRequest<'_>) -> FilesOptions {
    let tell = Arc::clone(&request.tell);
    let mut options = FilesOptions::new(&request.questions);
    options.patience = (request.timeout_minutes > 0.0).then(|| Duration::from_secs_f64(request.timeout_minutes * 60.0));
    options.on_event = Arc::new(move |event| match event {
        FilesEvent::Waiting { folder, open, answered, .. } => {
            tell(format!("waiting for {}/answer.json ({open} open, {answered} answered)", folder.display()));
        }
        FilesEvent::Complained { folder, complaint, .. } => {
            let first = complaint.lines().next().unwrap_or_default().to_owned();
            tell(format!("{}/answer.json was not accepted: {first} (complaint.md says more)", folder.display()));
        }
        FilesEvent::Accepted { name, .. } => tell(format!("{name}: answer taken, its form is right")),
        _ => {}
    });
    options
}
