//! The phases of a run, in order.

use std::fmt;
use std::str::FromStr;

use harmony_scene::Level;

/// A phase: room and camera, the four levels of objects, light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Room and camera.
    Layout,
    /// Objects of a level.
    Objects(Level),
    /// Materials and light.
    Lighting,
}

impl Phase {
    /// All, in order.
    pub const ALL: [Self; 6] = [
        Self::Layout,
        Self::Objects(Level::Wall),
        Self::Objects(Level::Furniture),
        Self::Objects(Level::Ceiling),
        Self::Objects(Level::Decoration),
        Self::Lighting,
    ];

    /// Its folder in a run, and its name in `run.json`, warnings and names of calls.
    pub fn folder(self) -> &'static str {
        match self {
            Self::Layout => "1_layout",
            Self::Objects(level) => level.folder(),
            Self::Lighting => "6_lighting",
        }
    }

    /// The name that people type: its folder's without the number.
    pub fn name(self) -> &'static str {
        &self.folder()[2..]
    }

    /// The phase of a folder.
    pub fn of_folder(folder: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|phase| phase.folder() == folder)
    }

    /// The levels up to a phase, in order.
    pub fn levels_until(self) -> impl Iterator<Item = Level> {
        Level::ALL.into_iter().filter(move |level| Self::Objects(*level) <= self)
    }

    /// All names, for messages.
    pub fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.folder())
    }
}

impl FromStr for Phase {
    type Err = String;

    /// A phase by its name or its folder.
    fn from_str(text: &str) -> Result<Self, String> {
        let named = Self::ALL.into_iter().find(|phase| phase.name() == text || phase.folder() == text);
        named.ok_or_else(|| format!("phases are {}", Self::names()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_numbered_in_order_and_names_lead_back() {
        for (i, phase) in Phase::ALL.into_iter().enumerate() {
            assert!(phase.folder().starts_with(&format!("{}_", i + 1)));
            assert_eq!(phase.name().parse(), Ok(phase));
            assert_eq!(phase.folder().parse(), Ok(phase));
            assert_eq!(Phase::of_folder(phase.folder()), Some(phase));
        }
        assert!(Phase::ALL.is_sorted());
        assert!("7_world".parse::<Phase>().unwrap_err().contains("decoration"));
    }

    #[test]
    fn levels_go_as_far_as_the_phase() {
        assert_eq!(Phase::Layout.levels_until().count(), 0);
        let furniture: Vec<Level> = Phase::Objects(Level::Furniture).levels_until().collect();
        assert_eq!(furniture, [Level::Wall, Level::Furniture]);
        assert_eq!(Phase::Lighting.levels_until().count(), 4);
    }
}
