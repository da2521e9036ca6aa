//! What can go wrong, with what a person can do about it.

use std::path::PathBuf;

use harmony_export::ExportError;
use harmony_io::{FileError, GlbError};

/// A home cannot be built, or a room not be adapted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HomeError {
    /// A layout that is not usable.
    #[error("{what}: {why}")]
    Layout {
        /// Which part.
        what: String,
        /// What is wrong.
        why: String,
    },
    /// A drawing that is no layout.
    #[error("the drawing cannot be read as a layout: {why}")]
    Drawing {
        /// What is wrong.
        why: String,
    },
    /// Runs and rooms do not go together.
    #[error("{why}")]
    Rooms {
        /// What is wrong.
        why: String,
    },
    /// A run that does not fit its room.
    #[error(
        "{run} does not fit room {room}: its {axis} must be scaled by {factor:.2} ({found:.2} m seen, {wanted:.2} m in the layout)"
    )]
    Scale {
        /// The run.
        run: String,
        /// The room.
        room: String,
        /// Width, depth or height.
        axis: &'static str,
        /// By how much.
        factor: f64,
        /// The run's length, metres.
        found: f64,
        /// The layout's, metres.
        wanted: f64,
    },
    /// Nothing joins the rooms.
    #[error("{room} cannot be joined to the others: none of its doors fits one of theirs")]
    Apart {
        /// The room.
        room: String,
    },
    /// A size that a room cannot have.
    #[error("a room of {width} x {depth} x {height} m cannot be made: {why}")]
    Size {
        /// Metres.
        width: f64,
        /// Metres.
        depth: f64,
        /// Metres.
        height: f64,
        /// What is wrong.
        why: String,
    },
    /// A folder that is there.
    #[error("{path} is there already", path = path.display())]
    Exists {
        /// Which.
        path: PathBuf,
    },
    /// A run that cannot be read.
    #[error("{run}: {source}", run = run.display())]
    Run {
        /// Which.
        run: PathBuf,
        /// Why.
        source: Box<ExportError>,
    },
    /// A file that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The GLB file cannot be written.
    #[error(transparent)]
    Glb(Box<GlbError>),
    /// A picture cannot be written.
    #[error(transparent)]
    Picture(#[from] harmony_io::picture::PictureError),
}

impl From<GlbError> for HomeError {
    fn from(source: GlbError) -> Self {
        Self::Glb(Box::new(source))
    }
}

impl HomeError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<String> {
        let own = match self {
            Self::Layout { .. } => "docs/homes.md describes layouts, with an example",
            Self::Drawing { .. } => "rooms are elements with an id, doors have the class door: docs/homes.md has more",
            Self::Rooms { .. } => "NAME=RUN says which room of the layout a run is",
            Self::Scale { .. } => {
                "is it the right photo for this room, and the layout's unit right? NAME=RUN says which run is which room"
            }
            Self::Apart { .. } => "give a floor plan with --layout: docs/homes.md has an example",
            Self::Size { .. } => "--room takes width x depth x height in metres, such as 4.2x3.6x2.5",
            Self::Exists { .. } => "choose another folder with --out, or take this one away",
            Self::Run { source, .. } => return source.hint(),
            Self::File(e) => return e.hint().map(str::to_owned),
            Self::Glb(e) => return e.hint().map(str::to_owned),
            Self::Picture(e) => return e.hint().map(str::to_owned),
        };
        Some(own.to_owned())
    }
}
