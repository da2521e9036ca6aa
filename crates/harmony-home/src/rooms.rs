//! What runs say of their rooms.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use harmony_export::World;
use harmony_scene::{Extents, OpeningKind, Room, Surface, Wall};

use crate::HomeError;
use crate::layout::is_name;

/// A reconstructed room.
#[derive(Debug, Clone)]
pub struct RoomRun {
    /// Its name in the home.
    pub name: String,
    /// Whether somebody gave the name, so that it says which room of a layout it is.
    pub named: bool,
    /// The run folder.
    pub run: PathBuf,
    /// Its scene with meshes, in its own room frame.
    pub world: World,
}

/// A door as a run has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DoorSeen {
    /// Number of the opening in the run's room.
    pub opening: usize,
    /// In which wall.
    pub wall: Wall,
    /// Along the wall, metres.
    pub u: [f64; 2],
    /// Height of its top, metres.
    pub top: f64,
}

/// What of a run places its room: sizes, which faces were seen, doors.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Size of the room's box.
    pub extents: Extents,
    /// Faces that the photo shows.
    pub seen: Vec<Surface>,
    /// Doors and passages.
    pub doors: Vec<DoorSeen>,
}

impl DoorSeen {
    /// Width, metres.
    pub fn width(&self) -> f64 {
        self.u[1] - self.u[0]
    }

    /// Both ends at the floor, room frame.
    pub fn ends(&self, extents: &Extents) -> [DVec3; 2] {
        self.u.map(|u| self.wall.point(extents, u, 0.0))
    }
}

impl Evidence {
    /// Of a room.
    pub fn of(room: &Room) -> Self {
        let doors = room.openings.iter().enumerate().filter(|(_, o)| o.kind == OpeningKind::Door && o.u[1] > o.u[0]);
        Self {
            extents: room.extents,
            seen: room.seen.clone(),
            doors: doors.map(|(opening, o)| DoorSeen { opening, wall: o.wall, u: o.u, top: o.y[1] }).collect(),
        }
    }

    /// Whether the photo shows a face.
    pub fn sees(&self, surface: Surface) -> bool {
        self.seen.contains(&surface)
    }
}

impl RoomRun {
    /// Reads `RUN` or `NAME=RUN`; without a name the run folder's own is taken.
    ///
    /// # Errors
    /// A folder that is no run, a name that cannot be one.
    pub fn read(argument: &str) -> Result<Self, HomeError> {
        let (name, run) = match argument.split_once('=') {
            Some((name, run)) if !name.contains(['/', '\\']) => (Some(name), run),
            _ => (None, argument),
        };
        if let Some(name) = name.filter(|n| !is_name(n)) {
            return Err(HomeError::Rooms { why: format!("{name:?} is no name: names of rooms are of a-z, 0-9 and _") });
        }
        let run = Path::new(run);
        let world =
            World::read(run).map_err(|source| HomeError::Run { run: run.to_owned(), source: Box::new(source) })?;
        let own = name.map_or_else(|| name_of(run), str::to_owned);
        Ok(Self { name: own, named: name.is_some(), run: run.to_owned(), world })
    }

    /// What it says of its room.
    pub fn evidence(&self) -> Evidence {
        Evidence::of(&self.world.scene.room)
    }
}

/// A name made of a run folder's.
fn name_of(run: &Path) -> String {
    let file = run.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().to_lowercase()));
    let name: String =
        file.unwrap_or_default().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let name = name.trim_matches('_');
    let name: String = name.chars().take(26).collect();
    if is_name(&name) { name } else { format!("room_{name}").trim_end_matches('_').to_owned() }
}

/// Gives rooms of the same name numbers.
pub fn make_names_unique(rooms: &mut [RoomRun]) {
    for k in 1..rooms.len() {
        let base = rooms[k].name.clone();
        let mut n = 2;
        while rooms[..k].iter().any(|r| r.name == rooms[k].name) {
            rooms[k].name = format!("{base}_{n}");
            n += 1;
        }
    }
}

/// x and z of a point.
pub(crate) fn flat(p: DVec3) -> DVec2 {
    DVec2::new(p.x, p.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_folders_become_names() {
        assert_eq!(name_of(Path::new("/tmp/no such/Living Room!")), "room");
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("Living Room (2)");
        std::fs::create_dir(&run).unwrap();
        assert_eq!(name_of(&run), "living_room__2");
        let why = RoomRun::read("A B=x").unwrap_err().to_string();
        assert!(why.contains("a-z"), "{why}");
        assert!(matches!(RoomRun::read("kitchen=/nowhere").unwrap_err(), HomeError::Run { .. }));
    }
}
