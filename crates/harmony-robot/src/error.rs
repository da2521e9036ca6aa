//! What can go wrong, by name.

use std::path::PathBuf;

use harmony_export::ExportError;
use harmony_io::FileError;

/// A robot that cannot be read, or a task that cannot be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The model file cannot be read.
    #[error("the robot's model {path} cannot be read: {why}", path = path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the place in the file.
        why: String,
    },
    /// A mesh that the model names is not there.
    #[error("the robot's model names the mesh {mesh}, and there is no file {path}", path = path.display())]
    NoMesh {
        /// Its name in the model.
        mesh: String,
        /// Where it should be.
        path: PathBuf,
    },
    /// A mesh file is broken or of a format that is not read.
    #[error("the mesh file {path} cannot be used: {why}", path = path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// A joint has no limits.
    #[error("joint {joint} of the robot's model has no limits")]
    NoLimits {
        /// Which.
        joint: String,
    },
    /// The model lacks what the task needs.
    #[error("the model {model} has no {part}: it is not a {robot}")]
    NotThisRobot {
        /// Name of the model.
        model: String,
        /// What is missing.
        part: String,
        /// What it should be.
        robot: &'static str,
    },
    /// The scene has nothing of the kind the task is about.
    #[error("there is no {what} in this room")]
    Nothing {
        /// What was looked for.
        what: String,
    },
    /// A measurement forbids the task.
    #[error("{task}: {why}")]
    Forbidden {
        /// What was to be done.
        task: String,
        /// Which measurement forbids it, with its number and its limit.
        why: String,
    },
    /// The scene cannot be exported.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// A file of a task cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A picture cannot be written.
    #[error(transparent)]
    Picture(#[from] harmony_io::picture::PictureError),
    /// The scene with the robot in it cannot be written for the renderer.
    #[error(transparent)]
    Glb(#[from] harmony_io::GlbError),
    /// A picture cannot be path-traced.
    #[error(transparent)]
    Lit(#[from] harmony_physics::pictures::PictureError),
}

impl RobotError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<String> {
        let said = match self {
            Self::Model { .. } => {
                "give the MJCF file of the robot (panda.xml, h1.xml); docs/simulation.md tells where they come from"
            }
            Self::NoMesh { .. } => "keep the model's XML beside its folder of meshes, as it was packed",
            Self::Mesh { .. } => "binary STL and OBJ are read",
            Self::NoLimits { .. } => "give the joint a range in the model file",
            Self::NotThisRobot { .. } => "--robot names the robot of the file that --model gives",
            Self::Nothing { .. } => "harmony robot RUN --report tells what the room has",
            Self::Forbidden { .. } | Self::Glb(_) | Self::Lit(_) => return None,
            Self::Export(e) => return e.hint(),
            Self::File(e) => return e.hint().map(Into::into),
            Self::Picture(e) => return e.hint().map(Into::into),
        };
        Some(said.to_owned())
    }
}
