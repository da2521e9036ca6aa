//! A run folder's scene with its meshes.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use harmony_io::{FileError, GlbError, ReadLimits, load_glb, read_json};
use harmony_mesh::Mesh;
use harmony_scene::{ObjectId, Scene};

/// The scene and the canonical meshes of its objects.
#[derive(Debug, Clone)]
pub struct RunScene {
    /// `scene.json`.
    pub scene: Scene,
    /// By object; objects that share a mesh in the file share it here.
    pub meshes: BTreeMap<ObjectId, Arc<Mesh>>,
}

/// A run folder without a usable scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// `scene.json` cannot be read.
    #[error("this run has no scene yet: {0}")]
    Scene(#[source] FileError),
    /// `scene_full.glb` cannot be read.
    #[error("the scene's GLB cannot be read: {0}")]
    Glb(#[from] GlbError),
    /// Both disagree.
    #[error("{object} stands elsewhere in scene_full.glb than in scene.json, {apart_m:.3} m apart")]
    Elsewhere {
        /// Which.
        object: String,
        /// How far.
        apart_m: f64,
    },
    /// An object is in the JSON alone.
    #[error("{object} is in scene.json but not in scene_full.glb")]
    Missing {
        /// Which.
        object: String,
    },
}

impl LoadError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Scene(e) => e.hint().or(Some("run harmony reconstruct first")),
            Self::Glb(e) => e.hint(),
            Self::Elsewhere { .. } | Self::Missing { .. } => {
                Some("both files must come from the same run; run reconstruct again")
            }
        }
    }
}

/// Farthest that the two files may differ, metres.
const SAME_PLACE_M: f64 = 1e-3;

impl RunScene {
    /// Reads a run folder.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn read(run: &Path) -> Result<Self, LoadError> {
        let scene: Scene = read_json(&run.join("scene.json")).map_err(LoadError::Scene)?;
        let glb = load_glb(&run.join("scene_full.glb"), &ReadLimits::default())?;
        let mut meshes = BTreeMap::new();
        for object in &scene.objects {
            let name = object.id.as_str();
            let Some(node) = glb.nodes.iter().find(|n| n.name == name) else {
                return Err(LoadError::Missing { object: name.to_owned() });
            };
            let apart_m = node.transform.translation.distance(object.pose.position);
            if apart_m.is_nan() || apart_m > SAME_PLACE_M {
                return Err(LoadError::Elsewhere { object: name.to_owned(), apart_m });
            }
            meshes.insert(object.id.clone(), Arc::clone(&node.mesh));
        }
        Ok(Self { scene, meshes })
    }
}
