//! Several runs of photos of one room into one scene (the paper's future work).
//!
//! Every photo is reconstructed by itself first; what is joined are finished runs, read from their folders. The main path
//! is [`join`]:
//!
//! 1. `source`: each run's scene and meshes, and how well its photo shows each thing;
//! 2. `pair`: how two runs lie together, scored in nats against chance; `tree`: all runs in the first one's frame. Runs of
//!    other rooms, and rooms that fit in two ways, are refused with these numbers;
//! 3. `tracks`: which objects are one thing (one to one, by place, size, colour and kind);
//! 4. `solve`: room, cameras and places as one least squares; matched and solved once more;
//! 5. `merge`: each thing from the run that sees it best; `room`: faces and textures likewise;
//! 6. `write`: a run folder like any other, with `join.json` and `cameras.json`.
//!
//! Frames and units are those of `docs/conventions.md`; the joined frame is the first run's, its origin the corner of the
//! walls as all runs have them. No model is asked. `docs/photos.md` tells how good it is.

mod assign;
mod depth;
mod merge;
mod noise;
mod pair;
mod placing;
mod room;
mod seen;
mod solve;
mod source;
#[cfg(test)]
mod testing;
mod tracks;
mod tree;
mod write;

use std::path::{Path, PathBuf};

use harmony_pipeline::{RunFolder, RunFolderError};
use harmony_scene::Scene;
use serde::Serialize;

pub use merge::{Dropped, Thing};
pub use noise::JoinNoise;
pub use pair::{Overlap, Pairing, pair};
pub use placing::Placing;
pub use seen::{SeenShare, in_place, seen_share};
pub use solve::Joint;
pub use source::{SeenObject, Source, SourceError};
pub use tracks::Track;
pub use tree::Link;

/// The file that tells how a run was joined; who has it is no run of one photo.
pub const JOIN_FILE: &str = "join.json";
/// The phase's name in `run.json`, warnings and the report.
pub const PHASE: &str = "join";
/// Rounds of matching and solving.
const ROUNDS: usize = 3;
/// Most runs that are joined: all pairs of them are laid together.
pub const MAX_RUNS: usize = 24;

/// Runs cannot be joined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JoinError {
    /// A run.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Too few or too many.
    #[error("{count} runs were given; 2 to {MAX_RUNS} can be joined")]
    Count {
        /// How many.
        count: usize,
    },
    /// One run was named twice.
    #[error("{folder} was named twice", folder = folder.display())]
    Twice {
        /// Which.
        folder: PathBuf,
    },
    /// The result's folder holds something.
    #[error("{folder} holds something already", folder = folder.display())]
    Taken {
        /// Which.
        folder: PathBuf,
    },
    /// A run does not fit to the others.
    #[error("{run} does not show the room of the others: {numbers}")]
    AnotherRoom {
        /// Which.
        run: String,
        /// The numbers that say so.
        numbers: String,
    },
    /// A run fits in more than one way.
    #[error("how {run} lies to the others is not clear: {numbers}")]
    Ambiguous {
        /// Which.
        run: String,
        /// The numbers that say so.
        numbers: String,
    },
    /// The result's folder.
    #[error(transparent)]
    Folder(#[from] RunFolderError),
    /// A file of the result.
    #[error(transparent)]
    File(#[from] harmony_io::FileError),
    /// A mesh of the result.
    #[error(transparent)]
    Glb(#[from] harmony_io::GlbError),
    /// A picture of the result.
    #[error(transparent)]
    Picture(#[from] harmony_io::picture::PictureError),
    /// A mask of the result.
    #[error(transparent)]
    Mask(#[from] harmony_io::MaskError),
    /// The report.
    #[error(transparent)]
    Report(#[from] harmony_viewer::ReportError),
    /// A photo of a run.
    #[error("{path} cannot be read: {source}", path = path.display())]
    Photo {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The list of runs has no JSON form.
    #[error("run.json cannot be encoded: {source}")]
    Encode {
        /// Why.
        source: serde_json::Error,
    },
}

impl JoinError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Source(SourceError::Joined { .. }) => Some("join the runs of the single photos"),
            Self::Source(_) => {
                Some("`harmony reconstruct PHOTO --out RUN` makes one; `harmony show RUN` tells what is in it")
            }
            Self::Count { .. } => Some("harmony join RUN_A RUN_B --out RUN"),
            Self::Twice { .. } => Some("name each run once"),
            Self::Taken { .. } => Some("choose another --out, or --replace to replace what was joined there"),
            Self::AnotherRoom { .. } => {
                Some("leave it out, or add a photo that shows things of both; photos must share furniture")
            }
            Self::Ambiguous { .. } => Some("add a photo that shows what tells the sides of the room apart"),
            Self::Folder(error) => error.hint(),
            Self::File(error) => error.hint(),
            Self::Glb(error) => error.hint(),
            Self::Picture(error) => error.hint(),
            Self::Mask(error) => error.hint(),
            Self::Report(error) => error.hint(),
            Self::Photo { .. } | Self::Encode { .. } => None,
        }
    }
}

/// A run that was given and is not in the scene.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Its name.
    pub run: String,
    /// Why, with the numbers that say so.
    pub reason: String,
}

/// What was joined.
#[derive(Debug, Clone)]
pub struct JoinReport {
    /// The scene as it was written.
    pub scene: Scene,
    /// The names of the runs that are in it.
    pub runs: Vec<String>,
    /// Their places among those that were given.
    pub numbers: Vec<usize>,
    /// Runs that do not fit to the first one, or not in one way only.
    pub left_out: Vec<LeftOut>,
    /// How pairs of runs lie together.
    pub links: Vec<Link>,
    /// Room, placings, places.
    pub joint: Joint,
    /// Things, in the order of the scene's objects.
    pub things: Vec<Thing>,
    /// What is not in the scene.
    pub dropped: Vec<Dropped>,
    /// Shares of the scene's surface that photos show.
    pub seen: SeenShare,
}

/// Joins finished runs into the folder `out`, which must not hold anything unless `replace` and it was joined before. The
/// first run's frame is the joined one's. Runs that do not fit to it are left out, and told; where none does that is an
/// error. `tell` hears of each step.
///
/// # Errors
/// [`JoinError`]; nothing is written before two runs fit together.
pub fn join(
    folders: &[PathBuf],
    out: &Path,
    replace: bool,
    noise: &JoinNoise,
    tell: &dyn Fn(&str),
) -> Result<JoinReport, JoinError> {
    check(folders, out, replace)?;
    let mut sources = Vec::new();
    for (k, folder) in folders.iter().enumerate() {
        tell(&format!("reading {} ({} of {})", folder.display(), k + 1, folders.len()));
        sources.push(Source::read(folder)?);
    }
    distinct_names(&mut sources);
    tell("laying the runs together");
    let links = tree::links(&sources, noise);
    let (placings, order) = tree::spanned(sources.len(), &links, noise);
    let numbers: Vec<usize> = (0..sources.len()).filter(|run| placings[*run].is_some()).collect();
    let mut left_out = Vec::new();
    for run in (0..sources.len()).filter(|run| placings[*run].is_none()) {
        let error = refused(&sources, &links, run, noise);
        if numbers.len() < 2 {
            return Err(error);
        }
        tell(&format!("left out: {error}"));
        left_out.push(LeftOut { run: sources[run].name.clone(), reason: error.to_string() });
    }
    let (sources, links, order) = only(&numbers, sources, links, &order);
    let start: Vec<Placing> = placings.into_iter().flatten().collect();
    let mut tracks = tracks::tracks(&sources, &start, &order, noise);
    let mut joint = solve::solve(&sources, &start, &tracks, noise);
    for round in 1..ROUNDS {
        tell(&format!("solving for room, cameras and objects, round {round}"));
        let again = tracks::tracks(&sources, &joint.placings, &order, noise);
        let same = again == tracks;
        tracks = again;
        joint = solve::solve(&sources, &joint.placings, &tracks, noise);
        if same {
            break;
        }
    }
    let (things, dropped) = merge::things(&sources, &tracks, &joint, noise);
    tell("painting the room");
    let (textures, faces) = room::textures(&sources, &joint);
    let (room, beyond) = room::room(&sources, &joint, &things);
    let trims = room::trims(&sources, &joint);
    let joined = write::Joined {
        sources: &sources,
        links: &links,
        joint: &joint,
        room,
        beyond,
        textures,
        faces,
        trims,
        things: things.clone(),
        dropped: dropped.clone(),
        left_out: left_out.clone(),
    };
    tell("writing");
    let _lock = RunFolder::take(out)?;
    let title = sources.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(" + ");
    let (scene, seen) = write::write(out, &joined, &title)?;
    drop(joined);
    let runs = sources.into_iter().map(|s| s.name).collect();
    Ok(JoinReport { scene, runs, numbers, left_out, links, joint, things, dropped, seen })
}

/// Sources, links and order of some runs alone, numbered anew.
fn only(
    numbers: &[usize],
    sources: Vec<Source>,
    links: Vec<Link>,
    order: &[usize],
) -> (Vec<Source>, Vec<Link>, Vec<usize>) {
    let anew = |run: usize| numbers.iter().position(|n| *n == run);
    let sources = sources.into_iter().enumerate().filter(|(run, _)| numbers.contains(run)).map(|(_, s)| s).collect();
    let links = links.into_iter().filter_map(|l| Some(Link { runs: [anew(l.runs[0])?, anew(l.runs[1])?], ..l }));
    (sources, links.collect(), order.iter().filter_map(|run| anew(*run)).collect())
}

/// Refuses what cannot be joined before anything is read.
fn check(folders: &[PathBuf], out: &Path, replace: bool) -> Result<(), JoinError> {
    if !(2..=MAX_RUNS).contains(&folders.len()) {
        return Err(JoinError::Count { count: folders.len() });
    }
    let real = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    for (k, folder) in folders.iter().enumerate() {
        if folders[..k].iter().any(|other| real(other) == real(folder)) {
            return Err(JoinError::Twice { folder: folder.clone() });
        }
        if real(folder) == real(out) {
            return Err(JoinError::Taken { folder: out.to_owned() });
        }
    }
    // A lock alone, and the runs that a command makes below its result, are not in the way.
    let holds = ["scene.json", "run.json", JOIN_FILE].iter().any(|name| out.join(name).exists());
    let joined = out.join(JOIN_FILE).is_file();
    if out.is_file() || (holds && !(replace && joined)) {
        return Err(JoinError::Taken { folder: out.to_owned() });
    }
    Ok(())
}

/// Runs of one folder name are told apart by their numbers.
fn distinct_names(sources: &mut [Source]) {
    let names: Vec<String> = sources.iter().map(|s| s.name.clone()).collect();
    for (k, source) in sources.iter_mut().enumerate() {
        if names.iter().filter(|n| **n == names[k]).count() > 1 {
            source.name = format!("{}_{}", names[k], k + 1);
        }
    }
}

/// Why a run was not reached, from the link that speaks most for it.
fn refused(sources: &[Source], links: &[Link], run: usize, noise: &JoinNoise) -> JoinError {
    let own = links.iter().filter(|l| l.runs.contains(&run));
    let odds = |l: &Link| l.pairing.best.as_ref().map_or(f64::NEG_INFINITY, |b| b.odds);
    let best = own.max_by(|a, b| odds(a).total_cmp(&odds(b)));
    let name = sources[run].name.clone();
    let Some((link, way)) = best.and_then(|l| Some((l, l.pairing.best.as_ref()?))) else {
        return JoinError::AnotherRoom { run: name, numbers: "they have no thing and no wall in common".to_owned() };
    };
    let other = &sources[link.runs[usize::from(link.runs[0] == run)]].name;
    let things = way.pairs.len();
    if way.odds >= noise.least_odds {
        let lead = link.pairing.lead;
        let least = noise.least_lead;
        let numbers = format!(
            "with {other} the best way ({things} things in common) leads the next one by {lead:.1} nats, at least \
             {least:.1} are needed"
        );
        return JoinError::Ambiguous { run: name, numbers };
    }
    let numbers = format!(
        "with {other} {things} things and the walls give {:.1} nats for one room, at least {:.1} are needed",
        way.odds, noise.least_odds
    );
    JoinError::AnotherRoom { run: name, numbers }
}

#[cfg(test)]
mod tests {
    use harmony_scene::QuarterTurn;

    use super::*;
    use crate::testing::{ROOM, furnished, source, thing};

    #[test]
    fn a_stranger_is_left_out_and_the_others_are_numbered_anew() {
        let noise = JoinNoise::default();
        let others =
            vec![thing("bed", [1.6, 1.1], 0.0, [1.6, 0.6, 2.0]), thing("wardrobe", [3.2, 0.4], 0.0, [1.2, 2.1, 0.6])];
        let elsewhere = harmony_scene::Extents { width: 3.7, height: 2.8, depth: 4.1 };
        let sources = vec![
            source("door", ROOM, &furnished(), QuarterTurn::ALL[0], 1.0, &[]),
            source("hotel", elsewhere, &others, QuarterTurn::ALL[0], 1.0, &[]),
            source("window", ROOM, &furnished(), QuarterTurn::ALL[2], 1.02, &[]),
        ];
        let links = tree::links(&sources, &noise);
        let (placings, order) = tree::spanned(3, &links, &noise);
        assert!(placings[1].is_none() && placings[2].is_some(), "{placings:?}");
        assert!(refused(&sources, &links, 1, &noise).to_string().contains("hotel"));
        let (kept, links, order) = only(&[0, 2], sources, links, &order);
        assert_eq!(kept.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["door", "window"]);
        assert_eq!(links.iter().map(|l| l.runs).collect::<Vec<_>>(), [[0, 1]]);
        assert_eq!(order, [0, 1]);
    }
}
