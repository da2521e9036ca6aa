//! Finished outputs of other programs, brought into one form.
//!
//! # The neutral form
//! Parts with their transforms baked into the vertices, in a world with glTF's axes (right-handed, +Y up), and a camera
//! in that world (OpenCV axes, as everywhere here). Where a program leaves its scene in the frame of its camera, the
//! world is that frame with glTF's axes: x right, y up, looking along -z. No conversion has a negative determinant:
//! nothing is mirrored that was not mirrored in the files.
//!
//! | kind | what is read | its axes | camera | metres |
//! |---|---|---|---|---|
//! | `harmony-release` | `scene_full.glb`, `camera_vggt.json` | room, Y up | yes | yes |
//! | `gen3dsr` | `reconstruction/*.glb` or `full_scene.glb`, `cam_params.json` | OpenCV camera | yes | if its depth was |
//! | `sam3d` | a list of poses and the objects' GLB (or splat PLY), or `assembled_scene.glb` | PyTorch3D camera | focal length | no |
//! | `3d-re-gen` | `combined_scene.glb`, `camera.npz`, `ground_aligned.glb` | glTF camera | yes | no |
//! | `cast` | `positioned_objects/*.glb` or `reconstructed_scene.glb`, `intrinsics.npy` | glTF camera | yes | MoGe's |
//! | `viga` | a GLB exported from its `.blend`, cameras included | glTF's export | yes | no |
//! | `midi` | `output.glb`, `textured_scene.glb` | normalised, Y up | an assumed one | no |
//! | `scenegen` | `<id>.glb` | its largest object's | none | no |
//! | `sceneconductor` | `blender_scene.json` and meshes | Blender's world, Z up | yes | yes |
//! | `generic` | any GLB, PLY or OBJ | glTF's, or `--axes` | in the GLB or beside it | not known |
//!
//! What is guessed is said in [`RivalScene::notes`]; what cannot be used ends in a named reason, never in a silent skip.
//! Both a program's own tree and a flattened folder are read: files are searched by name.

mod blender;
mod camera;
mod camera_frame;
mod draw;
mod files;
mod frames;
mod glb;
mod sam3d;
mod splat;
mod whole;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use harmony_bench::ply::PlyError;
use harmony_mesh::Mesh;
use harmony_scene::{Camera, ImageSize};
use serde::{Deserialize, Serialize};

pub use draw::{DrawOptions, Drawn, RivalReport, draw, write};
pub use frames::{Axes, baked};

/// Whose output it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum RivalKind {
    HarmonyRelease,
    Gen3dsr,
    Sam3d,
    #[serde(rename = "3d-re-gen")]
    ReGen,
    Cast,
    Viga,
    Midi,
    #[serde(rename = "scenegen")]
    SceneGen,
    #[serde(rename = "sceneconductor")]
    SceneConductor,
    Generic,
}

impl RivalKind {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::HarmonyRelease,
        Self::Gen3dsr,
        Self::Sam3d,
        Self::ReGen,
        Self::Cast,
        Self::Viga,
        Self::Midi,
        Self::SceneGen,
        Self::SceneConductor,
        Self::Generic,
    ];

    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::HarmonyRelease => "harmony-release",
            Self::Gen3dsr => "gen3dsr",
            Self::Sam3d => "sam3d",
            Self::ReGen => "3d-re-gen",
            Self::Cast => "cast",
            Self::Viga => "viga",
            Self::Midi => "midi",
            Self::SceneGen => "scenegen",
            Self::SceneConductor => "sceneconductor",
            Self::Generic => "generic",
        }
    }
}

impl std::str::FromStr for RivalKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|k| k.name() == text);
        found.ok_or_else(|| format!("kinds are {}", Self::ALL.map(Self::name).join(", ")))
    }
}

/// What a part is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PartKind {
    /// Furniture, decoration, whatever stands in the room.
    Object,
    /// Walls, floor, ceiling, a background mesh.
    Shell,
}

/// A part of a scene.
#[derive(Debug, Clone)]
pub struct Part {
    /// Name in the file.
    pub name: String,
    /// What it is.
    pub kind: PartKind,
    /// In the world, transforms baked in.
    pub mesh: Arc<Mesh>,
}

/// In whose frame the program left its scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// The photo's camera's.
    Camera,
    /// A room's, or a world's.
    Room,
    /// An object's: gravity and camera are not known.
    Object,
}

/// What a length of 1 is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// A metre, as the program says.
    Metres,
    /// Nobody knows.
    Relative,
}

/// A finished output in the neutral form.
#[derive(Debug, Clone)]
pub struct RivalScene {
    /// Whose.
    pub kind: RivalKind,
    /// Parts; at least one.
    pub parts: Vec<Part>,
    /// The camera in the world, at the size its program worked with.
    pub camera: Option<Camera>,
    /// Frame of the files.
    pub frame: Frame,
    /// Unit of the files.
    pub unit: Unit,
    /// What was read.
    pub files: Vec<PathBuf>,
    /// What was guessed, repaired or left out.
    pub notes: Vec<String>,
}

/// What a person tells about an output.
#[derive(Debug, Clone, Default)]
pub struct RivalOptions {
    /// A camera file beside the output.
    pub camera: Option<PathBuf>,
    /// Which camera of the GLB.
    pub camera_name: Option<String>,
    /// Horizontal field of view, radians, for scenes in their camera's frame without a focal length.
    pub hfov: Option<f64>,
    /// Axes of a generic file.
    pub axes: Option<Axes>,
    /// Size of the photo, for cameras that tell no size.
    pub photo: Option<ImageSize>,
}

/// An output cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RivalError {
    /// The folder is laid out in another way.
    #[error("{folder} is no finished output of {}: {reason}", .kind.name())]
    Layout {
        /// Whose it should be.
        kind: RivalKind,
        /// The folder.
        folder: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// Something is there that cannot be used, and why.
    #[error("{path}: {reason}")]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A file.
    #[error(transparent)]
    File(#[from] harmony_io::FileError),
    /// A GLB file.
    #[error("{path}: {source}")]
    Glb {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        source: harmony_io::GlbError,
    },
    /// A PLY file.
    #[error("{path}: {source}")]
    Ply {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        source: PlyError,
    },
    /// Nothing to look at.
    #[error("no part of {folder} has a surface")]
    Empty {
        /// The folder.
        folder: PathBuf,
    },
    /// Several cameras.
    #[error("{path} has several cameras: {}", .names.join(", "))]
    Cameras {
        /// The GLB.
        path: PathBuf,
        /// Their names.
        names: Vec<String>,
    },
    /// No camera, but pictures are wanted.
    #[error("{folder} has no camera")]
    NoCamera {
        /// The folder.
        folder: PathBuf,
    },
    /// Next to nothing is in the picture.
    #[error("only {:.0} % of the objects are in the picture: axes or camera are wrong", 100.0 * .share)]
    Outside {
        /// Share of the objects' corners that project into the picture.
        share: f64,
    },
    /// A picture.
    #[error(transparent)]
    Picture(#[from] harmony_io::picture::PictureError),
    /// The run that it is compared with.
    #[error("the run {path} cannot be used: {reason}")]
    Run {
        /// The run.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

impl RivalError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Layout { kind: RivalKind::Viga, .. } => Some(
                "open blender_file.blend and export it as GLB with cameras, modifiers applied, hidden objects left out",
            ),
            Self::Layout { .. } => Some(
                "docs/evaluation.md has what is read of each program; any GLB, PLY or OBJ is read with --kind generic",
            ),
            Self::Cameras { .. } => Some("choose one with --camera-name"),
            Self::NoCamera { .. } => Some(
                "give one with --camera FILE (docs/evaluation.md has the forms), or --hfov DEGREES for a scene in its \
                 camera's frame",
            ),
            Self::Outside { .. } => Some("try --axes and --camera, or --anyway to draw it as it is"),
            Self::Glb { source, .. } => source.hint(),
            Self::File(e) => e.hint(),
            Self::Picture(e) => e.hint(),
            Self::Run { .. } => Some("name a finished run of the same photo"),
            _ => None,
        }
    }
}

/// Reads a finished output.
///
/// # Errors
/// [`RivalError`].
pub fn load(kind: RivalKind, folder: &Path, options: &RivalOptions) -> Result<RivalScene, RivalError> {
    if !folder.exists() {
        let reason = "it is not there".to_owned();
        return Err(RivalError::Layout { kind, folder: folder.to_owned(), reason });
    }
    let mut scene = match kind {
        RivalKind::HarmonyRelease => whole::release(folder),
        RivalKind::Gen3dsr => camera_frame::gen3dsr(folder),
        RivalKind::Sam3d => sam3d::load(folder, options),
        RivalKind::ReGen => camera_frame::regen(folder),
        RivalKind::Cast => camera_frame::cast(folder),
        RivalKind::Viga | RivalKind::Generic => whole::generic(kind, folder, options),
        RivalKind::Midi => whole::midi(folder),
        RivalKind::SceneGen => whole::scenegen(folder),
        RivalKind::SceneConductor => blender::sceneconductor(folder),
    }?;
    if let Some(path) = &options.camera {
        scene.camera = Some(camera::sidecar(path, options.photo)?);
        scene.files.push(path.clone());
    } else if let (None, Some(hfov), Frame::Camera) = (scene.camera, options.hfov, scene.frame) {
        let size = options.photo.unwrap_or(ImageSize::new(1024, 768));
        scene.camera = Some(camera::at_origin(size, hfov));
        scene.notes.push(format!("the field of view of {:.1} degrees was given, it is not its own", hfov.to_degrees()));
    }
    scene.parts.retain(|p| p.mesh.triangle_count() > 0);
    if scene.parts.iter().all(|p| !has_area(&p.mesh)) {
        return Err(RivalError::Empty { folder: folder.to_owned() });
    }
    let far = scene.parts.iter().filter(|p| p.mesh.bounds().is_some_and(|b| b.size().max_element() > 1000.0));
    let far: Vec<&str> = far.map(|p| p.name.as_str()).collect();
    if !far.is_empty() {
        scene.notes.push(format!("parts are more than 1000 units long: {}", far.join(", ")));
    }
    Ok(scene)
}

fn has_area(mesh: &Mesh) -> bool {
    mesh.triangles().any(|[a, b, c]| {
        let [a, b, c] = [a, b, c].map(|i| mesh.positions[i as usize]);
        (b - a).cross(c - a).length_squared() > 0.0
    })
}
