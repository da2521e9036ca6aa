//! What the files of a scene say, for checks, figures and indices.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use harmony_io::{SegmentationFile, read_json};
use harmony_scene::Scene;
use serde::{Deserialize, Serialize};

use crate::DatasetError;
use crate::layout::{self, SceneId};
use crate::sources::Source;

/// `objects.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectsFile {
    /// Objects.
    pub objects: Vec<ObjectRow>,
}

/// An object of `objects.json`; see docs/run-folder.md.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the fields of the file, which docs/run-folder.md describes")]
pub struct ObjectRow {
    pub id: String,
    #[serde(rename = "type")]
    pub kind: String,
    pub stage: String,
    pub size_m: harmony_scene::Size,
    pub position_m: [f64; 3],
    pub yaw_deg: f64,
    pub wall_affinity: Option<String>,
    pub facing: Option<String>,
    pub in_front_of: Option<String>,
    pub behind: Option<String>,
    pub on_top_of: Option<String>,
    pub grouped_with: Option<String>,
    #[serde(flatten)]
    pub rest: BTreeMap<String, serde_json::Value>,
}

/// `camera.json`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[expect(missing_docs, reason = "the fields of the file, which docs/run-folder.md describes")]
#[expect(non_snake_case, reason = "the fields of the file")]
pub struct CameraFile {
    pub width: u32,
    pub height: u32,
    pub K: [[f64; 3]; 3],
    pub R: [[f64; 3]; 3],
    pub t: [f64; 3],
}

/// `provenance.json`: who made what in the scene.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Provenance {
    /// Program and version.
    pub generator: String,
    /// Profile.
    pub profile: String,
    /// Players by role: player and model.
    pub cast: BTreeMap<String, [String; 2]>,
    /// How many meshes each source made.
    pub mesh_sources: BTreeMap<String, usize>,
    /// `path-traced`, or `even light` where no path tracer was there.
    pub render: String,
}

impl Provenance {
    /// Everybody whose work is in the scene.
    pub fn makers(&self) -> BTreeSet<String> {
        let players = self.cast.values().map(|[player, _]| player.as_str());
        let sources = self.mesh_sources.keys().map(|source| maker_of(source));
        players.chain(sources).filter(|maker| !maker.is_empty()).map(str::to_owned).collect()
    }
}

/// Who made a mesh, by its source. What this program builds goes by `offline`: templates, part models, and programs, whose
/// text is the language model's, a player of its own.
fn maker_of(source: &str) -> &str {
    let own = source == "part model" || source.starts_with("template ") || source.starts_with("program of ");
    if own { "offline" } else { source }
}

/// A scene as its files have it.
#[derive(Debug, Clone)]
pub struct Record {
    /// Which.
    pub id: SceneId,
    /// Its row of `sources.csv`.
    pub source: Source,
    /// `scene.json`.
    pub scene: Scene,
    /// `objects.json`.
    pub objects: Vec<ObjectRow>,
    /// `segmentation.json`.
    pub segmentation: SegmentationFile,
    /// `provenance.json`.
    pub provenance: Provenance,
    /// Name of the photo's file; none where it is not published.
    pub photo: Option<String>,
}

/// Reads a scene's records.
///
/// # Errors
/// A missing or broken file.
pub fn load(root: &Path, source: &Source) -> Result<Record, DatasetError> {
    let id = source.id();
    let folder = root.join(id.path());
    let objects: ObjectsFile = read_json(&folder.join(layout::OBJECTS))?;
    Ok(Record {
        scene: read_json(&folder.join(layout::SCENE_JSON))?,
        objects: objects.objects,
        segmentation: read_json(&folder.join(layout::SEGMENTATION_JSON))?,
        provenance: read_json(&folder.join(layout::PROVENANCE))?,
        photo: layout::photo_of(&folder).and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned())),
        source: source.clone(),
        id,
    })
}
