//! What can go wrong.

use std::path::PathBuf;

use harmony_io::FileError;
use harmony_io::picture::PictureError;

/// A study could not be built, served, collected or analysed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
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
    /// A name that cannot be used.
    #[error("{what} {name:?} cannot be used: {why}")]
    Name {
        /// Name of what.
        what: &'static str,
        /// The name.
        name: String,
        /// What is allowed.
        why: &'static str,
    },
    /// A set that is no `name=folder`.
    #[error("{0:?} is no set")]
    SetSyntax(String),
    /// Too few or too many sets.
    #[error("a study compares 2 to 9 sets, {0} were given")]
    SetCount(usize),
    /// A folder without anything to show.
    #[error("set {name}: no run and no picture in {folder}")]
    EmptySet {
        /// Name of the set.
        name: String,
        /// Its folder.
        folder: PathBuf,
    },
    /// No scene has a photo and a picture of every method.
    #[error("no scene has a photo and a picture in every set{}", list(.missing))]
    NoScenes {
        /// Why each was left out.
        missing: Vec<String>,
    },
    /// Fewer scenes than asked for.
    #[error("{wanted} {what} were asked for, {found} scenes are complete")]
    TooFewScenes {
        /// What was asked for.
        what: &'static str,
        /// How many.
        wanted: usize,
        /// How many there are.
        found: usize,
    },
    /// The place is taken.
    #[error("{0} exists already")]
    Exists(PathBuf),
    /// The folder is not a study's.
    #[error("{path} is of study {found}, not of {wanted}")]
    OtherStudy {
        /// Which file or folder.
        path: PathBuf,
        /// Whose it is.
        found: String,
        /// Whose it should be.
        wanted: String,
    },
    /// Format of a newer program.
    #[error("format {found} is not {known}, which this program reads: {path}")]
    Format {
        /// Which file.
        path: PathBuf,
        /// Its format.
        found: u32,
        /// What is read.
        known: u32,
    },
    /// A line of the log is not what was written.
    #[error("line {line} of the log is damaged ({why}): {path}")]
    Log {
        /// Which file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        why: &'static str,
    },
    /// Another server has the log.
    #[error("another program is writing {0}")]
    LogInUse(PathBuf),
    /// Nothing to analyse.
    #[error("the log holds no answer that can be used ({answers} answers, {why})")]
    NoAnswers {
        /// Answers in the log.
        answers: usize,
        /// Why none is left.
        why: &'static str,
    },
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// Address.
        address: String,
        /// Why.
        source: std::io::Error,
    },
}

/// The first few of a list, for an error.
fn list(missing: &[String]) -> String {
    if missing.is_empty() {
        return String::new();
    }
    let more = if missing.len() > 5 { format!("; and {} more", missing.len() - 5) } else { String::new() };
    format!(": {}{more}", missing.iter().take(5).cloned().collect::<Vec<_>>().join("; "))
}

impl StudyError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::File(e) => e.hint(),
            Self::Picture { source, .. } => source.hint(),
            Self::SetSyntax(_) => Some("write name=folder, such as ours=runs/ours"),
            Self::SetCount(_) => Some("give one name=folder for each method that is compared"),
            Self::EmptySet { .. } => Some(
                "a set is a folder of run folders (scene.json and renders), or of pictures named by their scenes \
                 (bedroom_01.png, or bedroom_01/render.png)",
            ),
            Self::NoScenes { .. } => {
                Some("scenes are matched by folder or file name over all sets; --photos names a folder of photos")
            }
            Self::Exists(_) => Some("choose another folder, or move this one away; nothing was overwritten"),
            Self::OtherStudy { .. } => Some("give the private folder and the log that belong to this study"),
            Self::Log { .. } => Some("the log was changed by hand or by a failing disk; restore it from a copy"),
            Self::LogInUse(_) => Some("stop the other `harmony study serve` or `collect` first"),
            Self::Listen { .. } => Some("choose another port with --listen"),
            _ => None,
        }
    }
}
