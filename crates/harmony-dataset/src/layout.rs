//! Splits, names of scenes, names of files.
//! Key `data.layout`.
//!
//! Paper: "Each `<difficulty>/<room_type>_NN/` folder contains the reference photo, the physically-lit render, the
//! reconstructed scene, and the calibrated camera", a segmentation colour map with a companion JSON, and another JSON
//! with size, position, wall affinity and relations. The paper prints no file names; these are ours.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::DatasetError;

/// Level of difficulty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Synthetic renders with truth.
    Easy,
    /// Real photos with a single dominant layout.
    Medium,
    /// Real photos, cluttered.
    Complicated,
}

impl Split {
    /// All, from easy to complicated.
    pub const ALL: [Self; 3] = [Self::Easy, Self::Medium, Self::Complicated];

    /// Its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Easy => "easy",
            Self::Medium => "medium",
            Self::Complicated => "complicated",
        }
    }

    /// By the folder's name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }
}

/// The scene as the program reads it.
pub const SCENE_JSON: &str = "scene.json";
/// The reconstructed scene: shell, wall-mounted, furniture, ceiling, decorations.
pub const SCENE_GLB: &str = "scene.glb";
/// The physically lit render from the photo's camera.
pub const RENDER: &str = "render.png";
/// The same in even light.
pub const RENDER_FLAT: &str = "render_flat.png";
/// The canonical elevated view.
pub const CANONICAL: &str = "canonical.png";
/// The calibrated camera.
pub const CAMERA: &str = "camera.json";
/// The colour map.
pub const SEGMENTATION_PNG: &str = "segmentation.png";
/// Per object colour, stage, type, phrase, mask file.
pub const SEGMENTATION_JSON: &str = "segmentation.json";
/// Per object size, position, wall affinity, relations.
pub const OBJECTS: &str = "objects.json";
/// Who made what in the scene.
pub const PROVENANCE: &str = "provenance.json";
/// Folder of masks.
pub const MASKS: &str = "masks";
/// Settings of the data set.
pub const DATASET: &str = "dataset.json";
/// Where each photo is from.
pub const SOURCES: &str = "sources.csv";
/// Folder of the answers to the question where faces are, in the working folder alone.
pub const FACES: &str = "faces";

/// Files that every scene must have, beside its photo.
pub const REQUIRED: [&str; 8] =
    [SCENE_JSON, SCENE_GLB, RENDER, CAMERA, SEGMENTATION_PNG, SEGMENTATION_JSON, OBJECTS, PROVENANCE];

/// Extensions of photos.
pub const PHOTO_EXTENSIONS: [&str; 7] = ["jpg", "png", "webp", "tif", "bmp", "pnm", "jpeg"];

/// A scene: its split and its name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SceneId {
    /// Split.
    pub split: Split,
    /// `<room_type>_NN`.
    pub name: String,
}

impl SceneId {
    /// `easy/bedroom_01`.
    pub fn path(&self) -> String {
        format!("{}/{}", self.split.name(), self.name)
    }

    /// The room type in the name.
    pub fn room_type(&self) -> &str {
        parse_name(&self.name).map_or("", |(room, _)| room)
    }
}

/// Splits `<room_type>_NN`: small letters, digits and `_`, then two to four digits.
pub fn parse_name(name: &str) -> Option<(&str, u32)> {
    let (room, number) = name.rsplit_once('_')?;
    let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_';
    let good = room.starts_with(|c: char| c.is_ascii_lowercase())
        && room.len() <= 40
        && room.bytes().all(plain)
        && (2..=4).contains(&number.len())
        && number.bytes().all(|b| b.is_ascii_digit());
    if good { Some((room, number.parse().ok()?)) } else { None }
}

/// A room type as a part of a name: `Living Room` becomes `living_room`.
///
/// # Errors
/// When nothing is left of it.
pub fn room_slug(room_type: &str) -> Result<String, DatasetError> {
    let mut slug = String::new();
    for c in room_type.chars() {
        if c.is_ascii_alphanumeric() {
            slug.push(c.to_ascii_lowercase());
        } else if !slug.is_empty() && !slug.ends_with('_') {
            slug.push('_');
        }
    }
    let slug = slug.trim_matches('_').trim_start_matches(|c: char| c.is_ascii_digit() || c == '_').to_owned();
    if slug.is_empty() || slug.len() > 40 {
        return Err(DatasetError::Value {
            what: "the room type",
            value: room_type.to_owned(),
            why: "it needs one to forty letters",
        });
    }
    Ok(slug)
}

/// All folders below the splits, sorted; whether their names are right is for the check to say.
///
/// # Errors
/// An unreadable folder.
pub fn scenes(root: &Path) -> Result<Vec<SceneId>, DatasetError> {
    let mut found = Vec::new();
    for split in Split::ALL {
        let folder = root.join(split.name());
        if !folder.is_dir() {
            continue;
        }
        for entry in std::fs::read_dir(&folder).map_err(|e| DatasetError::read(&folder, e))? {
            let path = entry.map_err(|e| DatasetError::read(&folder, e))?.path();
            let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
            if path.is_dir() && !name.starts_with('.') {
                found.push(SceneId { split, name });
            }
        }
    }
    found.sort();
    Ok(found)
}

/// The photo in a scene's folder.
pub fn photo_of(folder: &Path) -> Option<PathBuf> {
    PHOTO_EXTENSIONS.iter().map(|e| folder.join(format!("photo.{e}"))).find(|p| p.is_file())
}

/// Lower-case hexadecimal SHA-256.
pub fn sha256(bytes: &[u8]) -> String {
    use sha2::Digest as _;
    use std::fmt::Write as _;
    sha2::Sha256::digest(bytes).iter().fold(String::new(), |mut text, b| {
        let _ = write!(text, "{b:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_scenes() {
        assert_eq!(parse_name("living_room_07"), Some(("living_room", 7)));
        assert_eq!(parse_name("bedroom_100"), Some(("bedroom", 100)));
        for bad in [
            "bedroom",
            "bedroom_1",
            "Bedroom_01",
            "_01",
            "7_01",
            "bed room_01",
            "bedroom_0x",
            "bedroom_00001",
            "../x_01",
        ] {
            assert_eq!(parse_name(bad), None, "{bad}");
        }
        assert_eq!(room_slug("Living / Dining Room").unwrap(), "living_dining_room");
        assert_eq!(room_slug("home office ").unwrap(), "home_office");
        assert!(room_slug("12 ").is_err());
        assert!(parse_name(&format!("{}_01", room_slug("3D Lab").unwrap())).is_some());
    }
}
