//! What can go wrong.

use std::path::PathBuf;

use harmony_io::picture::PictureError;
use harmony_io::{FileError, GlbError};

/// A data set could not be made, read or published.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A picture could not be read or written.
    #[error("{source}: {path}")]
    Picture {
        /// Which picture.
        path: PathBuf,
        /// Why.
        source: PictureError,
    },
    /// A scene's mesh file could not be read.
    #[error("{source}: {path}")]
    Glb {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: GlbError,
    },
    /// A CSV file is not what it should be.
    #[error("{why}: {path}")]
    Csv {
        /// Which file.
        path: PathBuf,
        /// Where and why.
        why: String,
    },
    /// A name or a value that cannot be used.
    #[error("{what} {value:?} cannot be used: {why}")]
    Value {
        /// What.
        what: &'static str,
        /// The value.
        value: String,
        /// What is allowed.
        why: &'static str,
    },
    /// The place is taken.
    #[error("{0} exists already")]
    Exists(PathBuf),
    /// The folder holds no data set.
    #[error("{0} holds no data set (dataset.json is missing)")]
    NoDataset(PathBuf),
    /// A scene's folder holds no photo.
    #[error("there is no photo in {0}")]
    NoPhoto(PathBuf),
    /// The photo in a scene's folder is not the one that the list of sources is about.
    #[error("{0} has another photo than the one whose hash sources.csv has")]
    OtherPhoto(String),
    /// The folder holds no finished run.
    #[error("{folder} is no finished run: {missing} is missing")]
    NoRun {
        /// The folder.
        folder: PathBuf,
        /// What is not there.
        missing: &'static str,
    },
    /// None of the folders holds a run.
    #[error("no run in {0}")]
    NoRuns(String),
    /// The photo is part of the data set already.
    #[error("this photo is {scene} already (sha256 {hash})")]
    Doubled {
        /// Which scene.
        scene: String,
        /// The photo's hash.
        hash: String,
    },
    /// The data set has faults that forbid its release.
    #[error("{0} faults forbid a release")]
    Faults(usize),
    /// A format of another program has a limit.
    #[error("{what} cannot be written as {format}: {why}")]
    Format {
        /// What.
        what: String,
        /// Which format.
        format: &'static str,
        /// Why.
        why: &'static str,
    },
}

impl DatasetError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Picture { source, .. } => source.hint(),
            Self::Exists(_) => Some("choose another folder, or move this one away; nothing was overwritten"),
            Self::NoDataset(_) => Some("make one with `harmony dataset init`"),
            Self::NoPhoto(_) | Self::OtherPhoto(_) => {
                Some("`harmony dataset check` lists what else is missing or wrong")
            }
            Self::NoRun { .. } => Some("give the folder of a run that `harmony reconstruct` finished"),
            Self::NoRuns(_) => Some("give folders of runs, or a folder that holds them"),
            Self::Faults(_) => Some("`harmony dataset check` lists them"),
            Self::Csv { .. } => Some("compare the first line with the columns that docs/dataset.md lists"),
            Self::Doubled { .. } => {
                Some("each photo is one scene; remove the other one first if this is to replace it")
            }
            _ => None,
        }
    }

    pub(crate) fn read(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::File(FileError::Read { path: path.to_owned(), source })
    }

    pub(crate) fn write(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::File(FileError::Write { path: path.to_owned(), source })
    }
}
