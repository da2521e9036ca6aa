//! The folder of a home with truth: `layout.json`, `turns.json`, and a room's folder each in `rooms/`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harmony_home::HomeError;
use harmony_home::layout::HomeLayout;
use harmony_io::{read_json, write_json};
use harmony_scene::QuarterTurn;

use super::HomePlan;
use crate::generate::{GeneratorSettings, generate, write as write_room};

/// Seeds of rooms lie this far apart.
const ROOM_SEEDS: u64 = 16;

/// A home with truth.
#[derive(Debug, Clone)]
pub struct TruthHome {
    /// Folder name.
    pub name: String,
    /// As a user would give it.
    pub layout: HomeLayout,
    /// How each room's photo is turned, in the order of the layout.
    pub turns: Vec<QuarterTurn>,
    /// Folders of the rooms, in the order of the layout.
    pub rooms: Vec<PathBuf>,
}

/// Furnishes and photographs the rooms of a plan, and writes the home's folder.
///
/// # Errors
/// A folder that cannot be written.
pub fn write(plan: &HomePlan, seed: u64, settings: &GeneratorSettings, folder: &Path) -> Result<(), HomeError> {
    let mut turns = BTreeMap::new();
    for (k, room) in plan.rooms.iter().enumerate() {
        let settings = GeneratorSettings {
            kinds: vec![room.kind],
            fixed: Some(room.fixed.clone()),
            views: false,
            ..settings.clone()
        };
        let made = generate(seed * ROOM_SEEDS + k as u64, &settings);
        write_room(&made, &folder.join("rooms").join(&room.name))
            .map_err(|e| HomeError::Rooms { why: format!("room {} cannot be written: {e}", room.name) })?;
        turns.insert(room.name.clone(), room.turn);
    }
    write_json(&folder.join("layout.json"), &plan.layout)?;
    write_json(&folder.join("turns.json"), &turns)?;
    Ok(())
}

impl TruthHome {
    /// Reads a home's folder.
    ///
    /// # Errors
    /// Files that are missing or hold something else.
    pub fn load(folder: &Path) -> Result<Self, HomeError> {
        let mut layout: HomeLayout = read_json(&folder.join("layout.json"))?;
        layout.check()?;
        let turns: BTreeMap<String, QuarterTurn> = read_json(&folder.join("turns.json"))?;
        let turn = |name: &String| {
            let why = || HomeError::Rooms { why: format!("turns.json has no room {name}") };
            turns.get(name).copied().ok_or_else(why)
        };
        Ok(Self {
            name: folder.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            turns: layout.rooms.iter().map(|r| turn(&r.name)).collect::<Result<_, _>>()?,
            rooms: layout.rooms.iter().map(|r| folder.join("rooms").join(&r.name)).collect(),
            layout,
        })
    }
}
