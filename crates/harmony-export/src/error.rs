//! What can go wrong, by name.

use std::path::PathBuf;

use harmony_io::{FileError, GlbError};

/// A scene cannot be exported, or an export does not hold what the scene holds.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The folder is no finished run.
    #[error("{run} has no {missing}: it is not the folder of a finished run", run = run.display())]
    NoRun {
        /// The folder.
        run: PathBuf,
        /// The file that is missing.
        missing: &'static str,
    },
    /// `scene.json` was written by another version.
    #[error("scene.json has version {found}, this program reads version {known}")]
    Version {
        /// What it says.
        found: u32,
        /// What is read.
        known: u32,
    },
    /// A value of `scene.json` cannot be used.
    #[error("scene.json: {what} of {of} is {value}")]
    Value {
        /// Which value.
        what: &'static str,
        /// Whose.
        of: String,
        /// What it is.
        value: String,
    },
    /// Two objects share an id.
    #[error("scene.json has two objects named {object}")]
    Twice {
        /// The id.
        object: String,
    },
    /// An object of the scene has no mesh.
    #[error("object {object} stands in scene.json, but no mesh of it in {file}")]
    NoMesh {
        /// The object.
        object: String,
        /// The file that was looked at.
        file: String,
    },
    /// `scene.json` and `scene_full.glb` put an object at different places.
    #[error("object {object} stands {apart:.3} m apart in scene.json and scene_full.glb")]
    Moved {
        /// The object.
        object: String,
        /// Largest distance of a corner of its box, metres.
        apart: f64,
    },
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A GLB file cannot be read or written.
    #[error("{file}: {source}")]
    Glb {
        /// Which file.
        file: String,
        /// Why.
        source: GlbError,
    },
    /// A texture cannot be encoded.
    #[error("texture {name}: {source}")]
    Texture {
        /// Which texture.
        name: String,
        /// Why.
        source: harmony_io::picture::PictureError,
    },
    /// A texture cannot be encoded in a way that this crate's other errors know.
    #[error("texture {name} cannot be encoded as {format}: {reason}")]
    Encode {
        /// Which texture.
        name: String,
        /// The format.
        format: &'static str,
        /// Why, in the encoder's words.
        reason: String,
    },
    /// No name of a format.
    #[error("{name:?} is no format: glb, usd, usdz, mjcf, urdf, blend, obj and plan are")]
    Format {
        /// What was given.
        name: String,
    },
    /// A package would be larger than its format allows.
    #[error("{file} would have {bytes} bytes, {limit} are possible")]
    TooLarge {
        /// Which file.
        file: String,
        /// Its size.
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// An object cannot become a rigid body.
    #[error(transparent)]
    Body(#[from] harmony_physics::BodyError),
    /// Blender is not here, or failed.
    #[error("the Blender file was not made: {0}")]
    Blender(#[from] harmony_lighting::LitError),
    /// There is nothing to check.
    #[error("{folder} holds no export.json: nothing was exported there", folder = folder.display())]
    NothingExported {
        /// The folder.
        folder: PathBuf,
    },
}

impl ExportError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<String> {
        let text = |t: &str| Some(t.to_owned());
        match self {
            Self::NoRun { .. } => text(
                "give the folder that `harmony reconstruct` wrote; run the same command again if it was broken off",
            ),
            Self::Version { .. } => {
                text("reconstruct the photo with this version: recorded answers are not asked for again")
            }
            Self::Value { .. } | Self::Twice { .. } => {
                text("scene.json was changed by hand; put the value right, or run `harmony reconstruct` again")
            }
            Self::NoMesh { .. } | Self::Moved { .. } => text(
                "the files of the run do not belong together; run the same `harmony reconstruct` again to have them made again",
            ),
            Self::File(e) => e.hint().map(str::to_owned),
            Self::Glb { source, .. } => source.hint().map(str::to_owned),
            Self::TooLarge { .. } => text("lower --texture or --faces"),
            Self::Body(e) => text(e.hint()),
            Self::Blender(e) => e.hint(),
            Self::NothingExported { .. } => {
                text("run `harmony export RUN --to ...` first, or name the folder with --out")
            }
            _ => None,
        }
    }
}
