//! Several photos of one room: generated rooms photographed from up to four sides, each photo reconstructed by itself, the
//! runs joined, and what comes out held beside one photo's.
//!
//! Everything is judged in the first photo's frame. A run's objects are known by their masks, as everywhere in the benchmark;
//! a joined thing is what most of its members are. Errors of one photo and of several are compared on the same objects:
//! those that the run of the first photo has. A room whose runs are not joined keeps the errors of its first photo.
//!
//! Key `join.bench` of `docs/paper-map.md`.

mod judge;
mod table;

use std::path::PathBuf;
use std::time::Instant;

use harmony_calls::Cast;
use harmony_join::{JoinNoise, JoinReport, Link, Source, join, pair};
use harmony_pipeline::{RunFile, Settings};
use harmony_scene::QuarterTurn;
use serde::{Deserialize, Serialize};

use crate::generate::{GeneratorSettings, MAX_PHOTOS, photographed, write};
use crate::oracle::{Meshes, Noise, NoiseLevel};
use crate::run::{BenchError, BenchRequest, one};
use crate::truth::TruthRoom;

pub use judge::{ObjectError, Scene};
pub use table::{Line, lines, markdown};

/// What to run.
#[derive(Debug, Clone)]
pub struct PhotosRequest {
    /// Folder for rooms, runs, joined runs and tables. Rooms and runs that are there are kept.
    pub out: PathBuf,
    /// Seeds of the rooms.
    pub seeds: Vec<u64>,
    /// Numbers of photos, 2 to [`MAX_PHOTOS`].
    pub photos: Vec<usize>,
    /// Level of noise.
    pub level: NoiseLevel,
    /// Its errors.
    pub noise: Noise,
    /// Settings of the pipeline.
    pub settings: Settings,
    /// What the oracle's meshes are made of.
    pub meshes: Meshes,
}

/// One room.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RoomOfPhotos {
    /// Its seed.
    pub seed: u64,
    /// From the first photo alone.
    pub single: Scene,
    /// From several: how many photos, and the scene or why there is none.
    pub joined: Vec<(usize, Result<Scene, String>)>,
}

/// A photo with its truth and its run.
pub struct Taken {
    /// The truth in the photo's frame.
    pub truth: TruthRoom,
    /// Carries the first photo's frame into this one's.
    pub turn: QuarterTurn,
    /// Run folder.
    pub run: PathBuf,
}

/// Runs everything; `tell` hears a line after each step.
///
/// # Errors
/// Folders that cannot be used. A run that fails or is not joined is no error: its room says so.
pub async fn several(
    request: &PhotosRequest,
    offline: &Cast,
    tell: &(dyn Fn(String) + Sync),
) -> Result<Vec<RoomOfPhotos>, BenchError> {
    let most = request.photos.iter().copied().max().unwrap_or(2).min(MAX_PHOTOS);
    let mut rooms = Vec::new();
    for (k, seed) in request.seeds.iter().enumerate() {
        let begun = Instant::now();
        let taken = Box::pin(taken(request, *seed, most, offline, tell)).await?;
        let room = judged(request, *seed, &taken, tell)?;
        tell(format!("{:>3}/{} room {seed}: {:.0} s", k + 1, request.seeds.len(), begun.elapsed().as_secs_f64()));
        rooms.push(room);
    }
    Ok(rooms)
}

/// Runs of different rooms held against each other.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Strangers {
    /// Pairs that were tried.
    pub pairs: usize,
    /// Those that would have been joined.
    pub taken_for_one: usize,
    /// Odds for one room of each pair, nats, highest first.
    pub odds: Vec<f64>,
}

/// Holds the first two photos of each room against those of the next one, which it must not be joined with;
/// rooms without such a run are left out.
pub fn strangers(request: &PhotosRequest) -> Strangers {
    let noise = JoinNoise::default();
    let read = |seed: u64, photo: usize| {
        let name = format!("generated_{seed:06}_photo_{photo}");
        Source::read(&request.out.join("runs").join(name)).ok()
    };
    let mut out = Strangers::default();
    for seeds in request.seeds.windows(2) {
        for (a, b) in [(1, 1), (2, 2)] {
            let (Some(first), Some(second)) = (read(seeds[0], a), read(seeds[1], b)) else { continue };
            let link = Link { runs: [0, 1], pairing: pair(&first, &second, &noise) };
            out.pairs += 1;
            out.taken_for_one += usize::from(link.sure(&noise).is_some());
            out.odds.push(link.pairing.best.as_ref().map_or(f64::NEG_INFINITY, |best| best.odds));
        }
    }
    out.odds.sort_by(|a, b| b.total_cmp(a));
    out
}

/// The photos of a room with their runs; what is there already is not made again.
async fn taken(
    request: &PhotosRequest,
    seed: u64,
    most: usize,
    offline: &Cast,
    tell: &(dyn Fn(String) + Sync),
) -> Result<Vec<Taken>, BenchError> {
    let name = format!("generated_{seed:06}");
    let rooms = request.out.join("rooms");
    let failed = |reason: String| BenchError::Run { room: name.clone(), reason };
    let turns_file = rooms.join(format!("{name}_turns.json"));
    let known: Option<(usize, Vec<(String, QuarterTurn)>)> = harmony_io::read_json(&turns_file).ok();
    let turns = if let Some((_, turns)) = known.filter(|(asked, _)| *asked >= most) {
        turns
    } else {
        let photos = photographed(seed, &GeneratorSettings::default(), most);
        let mut turns = Vec::new();
        for photo in photos {
            write(&photo.room, &rooms.join(&photo.room.name)).map_err(|e| failed(e.to_string()))?;
            turns.push((photo.room.name, photo.turn));
        }
        harmony_io::write_json(&turns_file, &(most, &turns))?;
        turns
    };
    let mut out = Vec::new();
    for (photo, turn) in turns.into_iter().take(most) {
        let truth = TruthRoom::load(&rooms.join(&photo))?;
        let run = request.out.join("runs").join(&photo);
        if RunFile::read(&run).is_none() || !run.join("scene.json").is_file() {
            let begun = Instant::now();
            // Errors of answers are drawn for each photo by itself.
            let settings = request.settings.clone();
            let playing = BenchRequest {
                noise: request.noise,
                meshes: request.meshes,
                ..BenchRequest::to_be_judged_elsewhere(request.level, settings)
            };
            if let Some(reason) = Box::pin(one(&playing, &truth, seed, &run, offline)).await? {
                return Err(failed(format!("{photo}: {reason}")));
            }
            tell(format!("    {photo}: {:.0} s", begun.elapsed().as_secs_f64()));
        }
        out.push(Taken { truth, turn, run });
    }
    Ok(out)
}

/// Joins and judges a room's runs.
fn judged(
    request: &PhotosRequest,
    seed: u64,
    taken: &[Taken],
    tell: &(dyn Fn(String) + Sync),
) -> Result<RoomOfPhotos, BenchError> {
    let failed = |reason: String| BenchError::Run { room: format!("generated_{seed:06}"), reason };
    let judge = judge::Judge::new(taken).map_err(|e| failed(e.to_string()))?;
    let single = judge.single();
    let mut joined = Vec::new();
    for photos in request.photos.iter().copied() {
        if taken.len() < photos {
            joined.push((photos, Err(format!("only {} photos could be taken", taken.len()))));
            continue;
        }
        let out = request.out.join("joined").join(format!("generated_{seed:06}_{photos}"));
        let runs: Vec<PathBuf> = taken[..photos].iter().map(|t| t.run.clone()).collect();
        let scene = match join(&runs, &out, true, &JoinNoise::default(), &|_| {}) {
            Ok(report) => {
                told(&report, tell);
                Ok(judge.joined(&report, &out).map_err(|e| failed(e.to_string()))?)
            }
            Err(error) => {
                tell(format!("    {photos} photos: {error}"));
                Err(error.to_string())
            }
        };
        joined.push((photos, scene));
    }
    Ok(RoomOfPhotos { seed, single, joined })
}

fn told(report: &JoinReport, tell: &(dyn Fn(String) + Sync)) {
    for link in &report.links {
        let Some(best) = &link.pairing.best else { continue };
        tell(format!(
            "    {} + {}: {:.1} nats, lead {:.1}, {} things",
            link.runs[0] + 1,
            link.runs[1] + 1,
            best.odds,
            link.pairing.lead,
            best.pairs.len()
        ));
    }
}
