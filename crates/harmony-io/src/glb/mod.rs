//! The scene as a GLB file (glTF 2.0 binary), and GLB files of others as meshes.
//!
//! Our room frame is glTF's frame, so nothing is turned on the way. The room's walls are written as they are given:
//! single-sided walls facing in let a viewer look into the room from outside.

mod accessor;
mod document;
mod lights;
mod material;
mod normals;
mod read;
mod surface;
mod texture;
mod write;

use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use harmony_mesh::Mesh;
use harmony_scene::{Camera, Lighting, Pose};
use serde_json::Value;

use crate::atomic::FileError;
pub use lights::{AMBIENT_GLOW, punctual_intensity};

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

/// Nodes gathered under one of their own, such as the rooms of a home.
#[derive(Debug, Clone, Default)]
pub struct NodeGroup {
    /// Name of the node above them.
    pub name: String,
    /// Names of objects and faces of the shell; names that no node has are left out.
    pub members: Vec<String>,
    /// Metadata, as a node's.
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
    /// Share of its base colour that every surface emits, for viewers without ambient light; 0 for none. Readers of ours
    /// leave it out again.
    pub glow: f64,
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
    /// A mesh cannot be written, or does not hold together.
    #[error("node {node}: {source}")]
    Mesh {
        /// Which node.
        node: String,
        /// What is wrong.
        source: harmony_mesh::MeshError,
    },
    /// A node's place is not finite, or its scale is zero.
    #[error("node {node} has no usable transform")]
    Transform {
        /// Which node.
        node: String,
    },
    /// The file's JSON cannot be read or written.
    #[error("the GLB file's JSON is broken: {0}")]
    Json(#[from] serde_json::Error),
    /// Not a GLB file at all.
    #[error("this is not a GLB file")]
    NotGlb,
    /// Not glTF 2.
    #[error("glTF version {version} is not read, only 2")]
    Version {
        /// What the file says.
        version: String,
    },
    /// The file ends early.
    #[error("the GLB file is cut off")]
    Truncated,
    /// Something refers to what is not there, or to bytes outside the file.
    #[error("{what} {index} of the GLB file is broken")]
    Broken {
        /// What.
        what: &'static str,
        /// Which.
        index: usize,
    },
    /// A vertex index points past the vertices.
    #[error("a triangle of the GLB file refers to vertex {index}, but there are {count}")]
    BadIndex {
        /// The index.
        index: u32,
        /// Number of vertices.
        count: usize,
    },
    /// Packed in a way that is not read.
    #[error("GLB files with {what} are not read")]
    Unsupported {
        /// What.
        what: &'static str,
    },
    /// More than the limits allow.
    #[error("{count} {what} are more than the {limit} allowed")]
    TooLarge {
        /// Of what.
        what: &'static str,
        /// How many.
        count: u64,
        /// The limit.
        limit: u64,
    },
    /// No triangles.
    #[error("there is no triangle in the GLB file")]
    Empty,
}

impl GlbError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Picture(e) => e.hint(),
            Self::Unsupported { .. } => Some("export it without compression, with everything in one .glb file"),
            Self::NotGlb | Self::Version { .. } => Some("export it as glTF 2.0 binary (.glb)"),
            Self::Truncated | Self::Broken { .. } | Self::BadIndex { .. } | Self::Json(_) => {
                Some("the file is damaged; export or download it again")
            }
            Self::TooLarge { .. } => Some("simplify the mesh first"),
            _ => None,
        }
    }
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
        Self { bytes: 512 << 20, triangles: 8_000_000, vertices: 8_000_000, nodes: 20_000, texture_pixels: 128 << 20 }
    }
}

/// The bytes of a GLB file; the same scene gives the same bytes.
///
/// # Errors
/// [`GlbError::Mesh`] for a mesh that does not pass [`Mesh::check`], [`GlbError::Picture`] for a texture.
pub fn glb_bytes(scene: &GlbScene<'_>) -> Result<Vec<u8>, GlbError> {
    write::glb_bytes(scene, &[])
}

/// [`glb_bytes`] with nodes gathered in groups; those of no group are where they are without.
///
/// # Errors
/// As [`glb_bytes`].
pub fn glb_bytes_grouped(scene: &GlbScene<'_>, groups: &[NodeGroup]) -> Result<Vec<u8>, GlbError> {
    write::glb_bytes(scene, groups)
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
    read::read(bytes, limits)
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

#[cfg(test)]
mod tests;
