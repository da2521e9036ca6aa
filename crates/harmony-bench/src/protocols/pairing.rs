//! Which run is of which truth.

use std::path::{Path, PathBuf};

use harmony_io::read_bounded;

use super::front3d::number;
use super::truth::TruthSurfaces;

/// Largest photo that is compared, bytes.
const MAX_PHOTO: u64 = 256 << 20;

/// Run folders of a folder (or the folder itself) with the truth they are of: by name (`<truth>`, `<truth>_<seed>`), by
/// the number of a FRONT3D scene, by the photo byte for byte, or because there is only one of each. `None` for a run
/// that is of none.
pub fn pair_runs(folder: &Path, truths: &[TruthSurfaces]) -> Vec<(PathBuf, Option<usize>)> {
    let is_run = |p: &Path| p.join("scene.json").is_file() || p.join("run.json").is_file();
    let runs: Vec<PathBuf> = if is_run(folder) {
        vec![folder.to_owned()]
    } else {
        let mut inside: Vec<PathBuf> =
            std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok).map(|e| e.path()).collect();
        inside.retain(|p| p.is_dir() && is_run(p));
        inside.sort();
        inside
    };
    let one = runs.len() == 1 && truths.len() == 1;
    runs.into_iter()
        .map(|run| {
            let found = by_name(&run, truths).or_else(|| by_photo(&run, truths)).or(if one { Some(0) } else { None });
            (run, found)
        })
        .collect()
}

fn by_name(run: &Path, truths: &[TruthSurfaces]) -> Option<usize> {
    let name = std::fs::canonicalize(run).ok()?.file_name()?.to_string_lossy().into_owned();
    let seeded = name.rsplit_once('_').filter(|(_, seed)| seed.parse::<u64>().is_ok()).map(|(room, _)| room);
    truths
        .iter()
        .position(|t| t.name == name)
        .or_else(|| truths.iter().position(|t| Some(t.name.as_str()) == seeded))
        .or_else(|| {
            truths.iter().position(|t| {
                t.name.starts_with("rgb_") && number(&t.name).is_some() && number(&t.name) == number(&name)
            })
        })
}

fn by_photo(run: &Path, truths: &[TruthSurfaces]) -> Option<usize> {
    let input = std::fs::read_dir(run)
        .ok()?
        .filter_map(Result::ok)
        .map(|e| e.path())
        .find(|p| p.file_stem().is_some_and(|s| s == "input") && p.is_file())?;
    let bytes = read_bounded(&input, MAX_PHOTO).ok()?;
    truths.iter().position(|t| {
        t.photo.as_ref().and_then(|p| read_bounded(p, MAX_PHOTO).ok()).is_some_and(|other| other == bytes)
    })
}
