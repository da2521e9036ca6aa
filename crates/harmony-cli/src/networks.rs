//! Networks inside this program: which weights are used, and by whom they are played.
//!
//! Profiles `paper` and `local` play VGGT, SAM 2 and OWLv2 where their weights are in the models folder and their
//! licences accepted; what is not there is said in the run's warnings, and the offline player (or the server) plays.
//! With the feature `nets` off nothing of this is in the program, and that is said, too.

use std::path::PathBuf;

use harmony_calls::Cast;
use harmony_models::{FileState, Model, ModelError, Store};
use harmony_roles::{Role, RoleError};

use crate::cast::Known;
use crate::config::networks::{Device, Geometry, Masks};
use crate::config::players::{Boxes, PlayersConfig};

#[cfg(feature = "nets")]
mod memory;
#[cfg(feature = "nets")]
mod native;
#[cfg(feature = "nets")]
mod report;
#[cfg(feature = "nets")]
mod similarity;
pub mod status;

/// Models that can play a role, the preferred one first. The one that may be used for anything goes first.
const GEOMETRY: [&str; 2] = ["vggt-1b-commercial", "vggt-1b"];
const SEGMENTER: [&str; 4] = ["sam2.1-large", "sam2.1-base-plus", "sam2.1-small", "sam2.1-tiny"];
/// `docs/decisions/0014-detector.md`: base for everybody, large for who has the time and asks for it.
const DETECTOR: [&str; 2] = ["owlv2-base", "owlv2-large"];

/// What a program without networks says of itself.
#[cfg(not(feature = "nets"))]
const WITHOUT: &str = "this build has no networks (feature `nets`)";

/// Who is wanted.
pub struct Wanted<'a> {
    /// Resolved players.
    pub players: &'a PlayersConfig,
    /// The models folder.
    pub store: &'a Store,
    /// The geometry is given.
    pub no_geometry: bool,
    /// The masks are given.
    pub no_masks: bool,
    /// Told what takes a while.
    pub tell: &'a dyn Fn(String),
}

/// What became of it.
#[derive(Default)]
pub struct Played {
    /// What the user should know.
    pub notes: Vec<String>,
    /// Roles whose named player cannot play.
    pub failures: Vec<(Role, RoleError)>,
    /// The detector is one of ours: no server is needed.
    pub detector: bool,
}

/// Weights that were found.
#[cfg_attr(not(feature = "nets"), expect(dead_code, reason = "nobody loads them"))]
pub struct Weights {
    /// Model's name, or that of the user's own file.
    pub name: String,
    /// The file, or the folder where a model has several.
    pub path: PathBuf,
    /// Says which content it is, in few letters.
    pub version: String,
}

/// What is asked for of a role.
struct Ask<'a> {
    role: Role,
    ids: &'a [&'static str],
    model: Option<&'a str>,
    weights: Option<&'a PathBuf>,
    /// The user named this player.
    named: bool,
    device: Device,
}

/// Casts the networks that are wanted and there.
pub fn cast(cast: &mut Cast, wanted: &Wanted<'_>, known: &mut Known) -> Played {
    let mut played = Played::default();
    let players = wanted.players;
    let geometry = &players.geometry_estimator;
    if !wanted.no_geometry && geometry.player != Some(Geometry::Offline) {
        let ask = Ask {
            role: Role::GeometryEstimator,
            ids: &GEOMETRY,
            model: geometry.model.as_deref(),
            weights: geometry.weights.as_ref(),
            named: geometry.player.is_some(),
            device: geometry.device.unwrap_or_default(),
        };
        one(cast, wanted, &ask, known, &mut played);
    }
    let segmenter = &players.segmenter;
    if !wanted.no_masks && segmenter.player != Some(Masks::Offline) {
        let ask = Ask {
            role: Role::Segmenter,
            ids: &SEGMENTER,
            model: segmenter.model.as_deref(),
            weights: segmenter.weights.as_ref(),
            named: segmenter.player.is_some(),
            device: segmenter.device.unwrap_or_default(),
        };
        one(cast, wanted, &ask, known, &mut played);
    }
    let detector = &players.detector;
    let named = detector.player == Some(Boxes::Owlv2);
    if named || detector.native == Some(true) {
        let ask = Ask {
            role: Role::Detector,
            ids: &DETECTOR,
            // A server's model may stand there.
            model: detector.model.as_deref().filter(|m| named || m.starts_with("owlv2-")),
            weights: detector.weights.as_ref(),
            named,
            device: detector.device.unwrap_or_default(),
        };
        played.detector = one(cast, wanted, &ask, known, &mut played);
    }
    played
}

/// Casts one role; whether a network plays it.
fn one(cast: &mut Cast, wanted: &Wanted<'_>, ask: &Ask<'_>, known: &mut Known, played: &mut Played) -> bool {
    let outcome = choose(wanted, ask).and_then(|weights| play(cast, ask, &weights, known));
    match outcome {
        Ok(()) => true,
        Err(error) if ask.named || is_grave(&error) => {
            played.failures.push((ask.role, error));
            false
        }
        Err(RoleError::NotSetUp { reason, hint, .. }) => {
            let instead = if ask.role == Role::Detector { "the player that the profile names" } else { "own rules" };
            played.notes.push(format!("{}: no network but {instead}: {reason}; {hint}", ask.role.folder()));
            false
        }
        Err(other) => {
            played.failures.push((ask.role, other));
            false
        }
    }
}

/// Weights that are there and wrong are told as an error, whoever asked: nobody keeps them for nothing.
fn is_grave(error: &RoleError) -> bool {
    !matches!(error, RoleError::NotSetUp { player, .. } if player == ABSENT)
}

/// Player's name in errors that only say that there are no weights.
const ABSENT: &str = "network";

fn not_set_up(player: &str, reason: impl Into<String>, hint: impl Into<String>) -> RoleError {
    RoleError::NotSetUp { player: player.to_owned(), reason: reason.into(), hint: hint.into() }
}

#[cfg(feature = "nets")]
fn wrong(model: &str, error: &ModelError) -> RoleError {
    not_set_up(model, error.to_string(), error.hint().unwrap_or_else(|| "look at `harmony models verify`".to_owned()))
}

#[cfg(not(feature = "nets"))]
fn choose(wanted: &Wanted<'_>, ask: &Ask<'_>) -> Result<Weights, RoleError> {
    let _ = (wanted.store, &wanted.tell, ask.ids, ask.model, ask.weights, ask.device);
    Err(not_set_up(ABSENT, WITHOUT, "build with `--features nets` (or `cuda`)"))
}

#[cfg(not(feature = "nets"))]
fn play(_: &mut Cast, _: &Ask<'_>, _: &Weights, _: &mut Known) -> Result<(), RoleError> {
    Err(not_set_up(ABSENT, WITHOUT, ""))
}

#[cfg(feature = "nets")]
use native::play;

/// The user's own file, the named model, or the first one that is there.
#[cfg(feature = "nets")]
fn choose(wanted: &Wanted<'_>, ask: &Ask<'_>) -> Result<Weights, RoleError> {
    if let Some(path) = ask.weights {
        let about = std::fs::metadata(path).map_err(|error| {
            let section = ask.role.folder();
            let hint = format!("`weights` in [players.{section}] of harmony.toml names it");
            not_set_up("weights", format!("{error}: {}", path.display()), hint)
        })?;
        let file = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let name = ask.model.map_or_else(|| file.clone(), str::to_owned);
        return Ok(Weights { name, path: path.clone(), version: format!("{file} of {} bytes", about.len()) });
    }
    let store = wanted.store;
    let ids: Vec<&str> = ask.model.map_or_else(|| ask.ids.to_vec(), |id| vec![id]);
    let mut reasons = Vec::new();
    for id in &ids {
        let model = harmony_models::table::find(id).filter(|m| ask.ids.contains(&m.id)).ok_or_else(|| {
            not_set_up(id, format!("{id} is no model for this role"), format!("models are {}", ask.ids.join(", ")))
        })?;
        match state(store, model).map_err(|e| wrong(id, &e))? {
            Here::No => {}
            Here::Wrong(reason) => reasons.push(reason),
            Here::Yes { unchecked } => {
                if let Err(error) = store.check_licence(model) {
                    let hint = format!("`harmony models verify {id} --accept-licence {}`", model.licence.id);
                    reasons.push(format!("{id} is here, but {error}; {hint}"));
                    continue;
                }
                if unchecked {
                    (wanted.tell)(format!("checking the weights of {id}, once"));
                    for file in model.files {
                        store.verify(model, file, &|_| {}).map_err(|e| wrong(id, &e))?;
                    }
                }
                return weights(store, model).map_err(|e| wrong(id, &e));
            }
        }
    }
    if reasons.is_empty() {
        reasons.push(format!("no weights in {}", store.folder().display()));
    }
    let hint = format!("`harmony models pull {}` fetches them", ids.join("` or `harmony models pull "));
    Err(not_set_up(ABSENT, reasons.join("; "), hint))
}

#[cfg(feature = "nets")]
fn weights(store: &Store, model: &'static Model) -> Result<Weights, ModelError> {
    let first = &model.files[0];
    let file = store.path(model, first);
    let path = if model.files.len() == 1 { file } else { store.folder().join(model.id) };
    let sum = store.known(model, first)?.map(|k| k.sha256).or_else(|| first.sha256.map(str::to_owned));
    let version = sum.and_then(|s| s.get(..8).map(str::to_owned)).unwrap_or_default();
    Ok(Weights { name: model.id.to_owned(), path, version })
}

/// What there is of a model.
#[cfg_attr(not(feature = "nets"), expect(dead_code, reason = "nobody asks"))]
enum Here {
    No,
    Wrong(String),
    Yes { unchecked: bool },
}

#[cfg_attr(not(feature = "nets"), expect(dead_code, reason = "nobody asks"))]
fn state(store: &Store, model: &Model) -> Result<Here, ModelError> {
    let (mut unchecked, mut missing, mut there) = (false, Vec::new(), 0);
    for file in model.files {
        let name = format!("{}/{}", model.id, file.name);
        match store.state(model, file)? {
            FileState::Missing { .. } => missing.push(name),
            FileState::WrongSize { wanted, found } => {
                return Ok(Here::Wrong(format!("{name} has {found} bytes, wanted {wanted}")));
            }
            FileState::Unchecked => (unchecked, there) = (true, there + 1),
            FileState::Verified(_) => there += 1,
        }
    }
    Ok(match (there, missing.is_empty()) {
        (0, _) => Here::No,
        (_, false) => Here::Wrong(format!("{} is missing", missing.join(", "))),
        (_, true) => Here::Yes { unchecked },
    })
}

/// Whether a model's files have the keys and shapes that its network needs; `None` without networks.
#[cfg(feature = "nets")]
#[expect(clippy::unnecessary_wraps, reason = "as in a build without networks")]
pub fn layout(model: &Model, store: &Store) -> Option<Result<(), String>> {
    let weights = |model: &Model| store.folder().join(model.id);
    Some(native::layout(model, &weights(model)))
}

/// Whether a model's files have the keys and shapes that its network needs; `None` without networks.
#[cfg(not(feature = "nets"))]
pub fn layout(_: &Model, _: &Store) -> Option<Result<(), String>> {
    None
}

/// CLIP and LPIPS for the benchmark, where their weights are.
#[cfg(feature = "nets")]
pub use similarity::{looking, looks};

/// CLIP and LPIPS for the benchmark, where their weights are.
#[cfg(not(feature = "nets"))]
pub fn looking(_: &Store) -> harmony_bench::metrics::similarity::Looking {
    let absent = vec![format!("N-CLIP and LPIPS are not measured: {WITHOUT}")];
    harmony_bench::metrics::similarity::Looking { similarity: None, absent }
}

/// The figures of `harmony eval` that can be measured here.
#[cfg(not(feature = "nets"))]
pub fn looks(_: &Store) -> harmony_eval::score::Looks {
    harmony_eval::score::Looks::new(Vec::new(), vec![format!("N-CLIP and LPIPS are not measured: {WITHOUT}")])
}

/// Devices, weights and expected times.
#[cfg(feature = "nets")]
pub use report::status;

/// Devices, weights and expected times.
#[cfg(not(feature = "nets"))]
pub fn status(store: &Store) -> status::Status {
    status::Status {
        absent: Some(WITHOUT),
        devices: Vec::new(),
        folder: store.folder().to_path_buf(),
        weights: status::weights(store),
        expected: Vec::new(),
    }
}
