//! Small rooms with truth, made on the spot.

use std::path::Path;

use harmony_bench::generate::{GeneratorSettings, generate, write};
use harmony_bench::truth::TruthRoom;
use harmony_scene::ImageSize;

/// Seed of the room for faults: few objects, all four levels.
pub const SMALL_SEED: u64 = 3;

/// Makes a room of a seed in a folder; `size` is that of its photo, `most` the number of objects at most.
///
/// # Errors
/// A folder that cannot be written.
pub fn make(seed: u64, size: ImageSize, most: usize, folder: &Path) -> anyhow::Result<TruthRoom> {
    let settings = GeneratorSettings {
        image: Some(size),
        min_objects: most.min(4),
        max_objects: most,
        min_seen: most.min(3),
        points: 100,
        shell_points: 100,
        ..GeneratorSettings::default()
    };
    let room = generate(seed, &settings);
    let target = folder.join(&room.name);
    write(&room, &target)?;
    Ok(TruthRoom::load(&target)?)
}

/// The room for runs with faults.
///
/// # Errors
/// A folder that cannot be written.
pub fn small(folder: &Path) -> anyhow::Result<TruthRoom> {
    make(SMALL_SEED, ImageSize::new(256, 192), 6, folder)
}
