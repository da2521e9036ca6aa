//! A run's scene for scripts that do not read node transforms.
//!
//! The geometry script of the paper's release loads our kind of file by its meshes alone: it ignores the places of nodes,
//! and drops what belongs to the shell by names that begin with `floor`, `wall` or `ceiling`. Here every mesh stands where
//! it belongs by its vertices, nodes have no transforms, surfaces of the room keep the names that are dropped, and objects
//! get names that are not: `floor_lamp_01` becomes `object_floor_lamp_01`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use harmony_io::{GlbError, GlbNode, GlbScene, NodeTransform, ReadLimits, load_glb, write_glb};
use harmony_scene::{Camera, Level, Scene, SceneObject};
use serde_json::Value;

use crate::rivals::baked;

/// Beginnings of names that the script drops.
const DROPPED: [&str; 3] = ["floor", "wall", "ceiling"];

/// What is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BakedOptions {
    /// Only the room and the furniture on its floor.
    pub furniture_only: bool,
}

/// A run that cannot be exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakedError {
    /// `scene.json`.
    #[error(transparent)]
    File(#[from] harmony_io::FileError),
    /// A GLB file.
    #[error("{path}: {source}")]
    Glb {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        source: GlbError,
    },
}

impl BakedError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Glb { source, .. } => source.hint(),
        }
    }
}

/// The name of an object: its id, kept from the script's broom.
fn object_name(id: &str) -> String {
    if DROPPED.iter().any(|d| id.starts_with(d)) { format!("object_{id}") } else { id.to_owned() }
}

/// Writes a run's scene with every transform in the vertices; the names of its meshes.
///
/// # Errors
/// A run without a scene, or a file that cannot be written.
pub fn export_baked(run: &Path, out: &Path, options: BakedOptions) -> Result<Vec<String>, BakedError> {
    let glb = |path: PathBuf| move |source| BakedError::Glb { path, source };
    let scene: Scene = harmony_io::read_json(&run.join("scene.json"))?;
    let file = run.join("scene_full.glb");
    let loaded = load_glb(&file, &ReadLimits::default()).map_err(glb(file))?;
    let (mut objects, mut shell) = (Vec::new(), Vec::new());
    for node in &loaded.nodes {
        let object: Option<&SceneObject> = scene.objects.iter().find(|o| o.id.as_str() == node.name);
        if options.furniture_only && object.is_some_and(|o| o.level != Level::Furniture) {
            continue;
        }
        let name = match object {
            Some(_) => object_name(&node.name),
            None if DROPPED.iter().any(|d| node.name.starts_with(d)) => node.name.clone(),
            // Skirting boards and the like are of the walls.
            None => format!("wall_{}", node.name),
        };
        let mesh = Arc::new(baked(&node.mesh, &node.transform));
        let node = GlbNode { name, mesh, transform: NodeTransform::IDENTITY, extras: Value::Null };
        if object.is_some() { objects.push(node) } else { shell.push(node) }
    }
    let names = shell.iter().chain(&objects).map(|n| n.name.clone()).collect();
    let scene = GlbScene {
        objects,
        shell,
        camera: Some(Camera::from(&scene.camera)),
        generator: scene.generator,
        ..GlbScene::default()
    };
    write_glb(&scene, out).map_err(glb(out.to_owned()))?;
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_not_swept_away_by_their_names() {
        for (id, name) in [
            ("floor_lamp_01", "object_floor_lamp_01"),
            ("wall_lamp_02", "object_wall_lamp_02"),
            ("ceiling_fan_01", "object_ceiling_fan_01"),
            ("chair_01", "chair_01"),
        ] {
            assert_eq!(object_name(id), name);
        }
    }
}
