//! Homes made, photographed, reconstructed and built.

use std::path::{Path, PathBuf};

use harmony_calls::Cast;
use harmony_home::HomeError;
use harmony_pipeline::Settings;

use super::{TruthHome, plan, write};
use crate::generate::GeneratorSettings;
use crate::oracle::NoiseLevel;
use crate::run::{BenchError, BenchRequest, run as run_rooms};

/// What to make and run.
#[derive(Debug, Clone)]
pub struct HomesRequest {
    /// A home each.
    pub seeds: Vec<u64>,
    /// Rooms of each; without it 2 to 5.
    pub rooms: Option<usize>,
    /// Folder for homes with truth and runs.
    pub out: PathBuf,
    /// How far the oracle's answers are off.
    pub level: NoiseLevel,
    /// Settings of the pipeline.
    pub settings: Settings,
    /// Runs at a time.
    pub jobs: usize,
}

/// A home's rooms cannot be made or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HomesError {
    /// A home.
    #[error(transparent)]
    Home(#[from] HomeError),
    /// A room.
    #[error(transparent)]
    Room(#[from] BenchError),
}

/// The folder of a home below the one for all.
pub fn folder(out: &Path, seed: u64) -> PathBuf {
    out.join(format!("home_{seed:06}"))
}

/// Makes the homes and reconstructs their rooms; what is there already stays.
///
/// # Errors
/// Folders that cannot be used.
pub async fn reconstruct(
    request: &HomesRequest,
    offline: &Cast,
    tell: &(dyn Fn(String) + Sync),
) -> Result<Vec<TruthHome>, HomesError> {
    let mut homes = Vec::new();
    for seed in &request.seeds {
        let folder = folder(&request.out, *seed);
        if !folder.join("layout.json").is_file() {
            let plan = plan(*seed, request.rooms);
            tell(format!("{}: {} rooms, {} doors", plan.name, plan.rooms.len(), plan.layout.doors.len()));
            write(&plan, *seed, &GeneratorSettings::default(), &folder)?;
        }
        let home = TruthHome::load(&folder)?;
        let missing: Vec<PathBuf> =
            home.rooms.iter().filter(|r| !run_of(&folder, r, *seed).join("scene.json").is_file()).cloned().collect();
        if !missing.is_empty() {
            let rooms = BenchRequest {
                rooms: missing,
                out: folder.join("runs"),
                seeds: vec![*seed],
                jobs: request.jobs,
                ..BenchRequest::to_be_judged_elsewhere(request.level, request.settings.clone())
            };
            run_rooms(&rooms, offline, tell).await?;
        }
        homes.push(home);
    }
    Ok(homes)
}

/// The run of a room.
pub fn run_of(home: &Path, room: &Path, seed: u64) -> PathBuf {
    let name = room.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    home.join("runs").join(format!("{name}_{seed}"))
}
