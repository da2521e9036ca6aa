//! Finding a Blender.

use std::path::PathBuf;

/// A python that can `import bpy`, before all other places.
pub(crate) const ENV_PYTHON: &str = "HARMONY_BPY_PYTHON";

/// In which shape Blender is here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlenderKind {
    /// A python interpreter with the `bpy` module.
    Module,
    /// The `blender` program.
    Program,
}

/// A Blender that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CyclesRenderer {
    pub(crate) program: PathBuf,
    pub(crate) kind: BlenderKind,
    pub(crate) version: String,
}

/// Folder of the virtual environment that HARMONY uses by default.
pub(crate) fn cache_place() -> PathBuf {
    let cache = std::env::var_os("HARMONY_CACHE")
        .map(PathBuf::from)
        .or_else(|| std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".cache").join("harmony")));
    cache.unwrap_or_else(|| PathBuf::from(".harmony")).join("bpy")
}

impl CyclesRenderer {
    /// Looks for Blender: `HARMONY_BPY_PYTHON`, the cache's virtual environment, `python3`, then `blender` on PATH.
    ///
    /// A candidate counts when it starts and names its version.
    pub fn find() -> Option<Self> {
        None
    }

    /// Its version, such as `5.0.1`.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// Module or program.
    pub fn kind(&self) -> BlenderKind {
        self.kind
    }
}
