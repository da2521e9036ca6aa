//! Truth from whatever it was read from, in one form: surfaces in the frame of the photo's camera (OpenCV axes), metres.

use std::path::{Path, PathBuf};

use glam::DVec3;
use harmony_scene::{Camera, Level};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::front::{FrontError, front_room};
use super::front3d::{list_of, scene_of};
use crate::metrics::sample::Seed;
use crate::metrics::soup::{Triangle, soup_of};
use crate::score::Prediction;
use crate::truth::{TruthError, TruthRoom, rooms_in};

/// An object of the truth.
#[derive(Debug, Clone)]
pub struct TruthPiece {
    /// Id or name.
    pub id: String,
    /// Whether it is furniture on the floor.
    pub furniture: bool,
    /// Surface; none for points alone.
    pub triangles: Vec<Triangle>,
    /// Vertices as the file has them.
    pub vertices: Vec<DVec3>,
}

/// A room's truth.
#[derive(Debug, Clone)]
pub struct TruthSurfaces {
    /// Name.
    pub name: String,
    /// Size and lens; its pose carries the truth's own world into its frame.
    pub camera: Camera,
    /// Objects in the camera's frame.
    pub pieces: Vec<TruthPiece>,
    /// Whether it holds all of a room, seen by the photo or not.
    pub whole_room: bool,
    /// Whether its pieces are single objects: only then objects can be compared one by one.
    pub separate: bool,
    /// The photo, where it is there.
    pub photo: Option<PathBuf>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

impl TruthSurfaces {
    /// Vertices of the floor furniture, drawn at random as the paper's script draws them: without putting back where
    /// there are enough.
    pub fn vertices(&self, count: usize, seed: Seed) -> Vec<DVec3> {
        let mut all: Vec<DVec3> =
            self.pieces.iter().filter(|p| p.furniture).flat_map(|p| p.vertices.iter().copied()).collect();
        let mut numbers = ChaCha8Rng::seed_from_u64(seed.seed);
        numbers.set_stream(u64::from(seed.draw));
        if all.len() > count {
            for i in 0..count {
                let other = numbers.random_range(i..all.len());
                all.swap(i, other);
            }
            all.truncate(count);
        }
        all
    }

    /// The truth of one of our rooms.
    pub fn of_room(room: &TruthRoom) -> Self {
        let piece = |o: &crate::truth::TruthObject| {
            let place = |p: DVec3| room.camera.to_camera(o.point(p));
            TruthPiece {
                id: o.id.clone(),
                furniture: o.level == Level::Furniture,
                triangles: soup_of(&o.mesh, place),
                vertices: o.mesh.positions.iter().map(|p| place(p.as_dvec3())).collect(),
            }
        };
        Self {
            name: room.name.clone(),
            camera: room.camera,
            pieces: room.objects.iter().map(piece).collect(),
            whole_room: true,
            separate: true,
            photo: Some(room.photo()).filter(|p| p.is_file()),
            notes: Vec::new(),
        }
    }
}

/// An object of a run.
#[derive(Debug, Clone)]
pub struct RunPiece {
    /// Id.
    pub id: String,
    /// Whether it is furniture on the floor.
    pub furniture: bool,
    /// Surface in the run's room, metres.
    pub triangles: Vec<Triangle>,
}

/// A run's objects.
#[derive(Debug, Clone)]
pub struct RunSurfaces {
    /// The run's camera in its room.
    pub camera: Camera,
    /// Objects.
    pub pieces: Vec<RunPiece>,
}

impl RunSurfaces {
    /// Of a finished run.
    pub fn of(run: &Prediction) -> Self {
        let pieces = run.objects.iter().map(|o| RunPiece {
            id: o.object.id.to_string(),
            furniture: o.object.level == Level::Furniture,
            triangles: soup_of(&o.mesh, |p| p),
        });
        Self { camera: run.camera, pieces: pieces.collect() }
    }
}

/// A folder's truth cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TruthsError {
    /// One of our rooms.
    #[error(transparent)]
    Room(#[from] TruthError),
    /// 3D-FRONT, or the list of Gen3DSR.
    #[error(transparent)]
    Front(#[from] FrontError),
}

impl TruthsError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Room(e) => e.hint(),
            Self::Front(e) => e.hint(),
        }
    }
}

/// All truth of a folder: our rooms (`objects.json`), rooms of 3D-FRONT (`front3d.json` beside or in folders), or the list
/// FRONT3D of Gen3DSR (`sceneobjgt_*.ply`).
///
/// # Errors
/// A folder without any of them, or files that cannot be read.
pub fn truths_in(folder: &Path) -> Result<Vec<TruthSurfaces>, TruthsError> {
    let list = list_of(folder)?;
    if !list.is_empty() {
        return Ok(list.iter().map(|id| scene_of(folder, id)).collect::<Result<Vec<_>, FrontError>>()?);
    }
    let mut described: Vec<PathBuf> = Vec::new();
    for place in std::iter::once(folder.to_owned()).chain(
        std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok).map(|e| e.path()).filter(|p| p.is_dir()),
    ) {
        let file = place.join("front3d.json");
        if file.is_file() {
            described.push(file);
        }
    }
    described.sort();
    if !described.is_empty() {
        return Ok(described.iter().map(|file| front_room(file)).collect::<Result<Vec<_>, FrontError>>()?);
    }
    let rooms = rooms_in(folder)?;
    Ok(rooms
        .iter()
        .map(|r| Ok(TruthSurfaces::of_room(&TruthRoom::load(r)?)))
        .collect::<Result<Vec<_>, TruthError>>()?)
}
