//! What can go wrong, in words that name the thing.

use std::path::PathBuf;

use harmony_io::FileError;

/// A batch cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BatchError {
    /// The queue's address is none.
    #[error("{address:?} is no address of a queue: {reason}")]
    Address {
        /// As given, without its password.
        address: String,
        /// Why.
        reason: String,
    },
    /// The queue's database cannot be used.
    #[error("the queue {queue} cannot be used: {reason}")]
    Database {
        /// Address without password.
        queue: String,
        /// What the database says.
        reason: String,
        /// The same may work in a moment: the database is restarting, busy or not reached.
        passing: bool,
    },
    /// The database holds something else, or a queue of another version.
    #[error("the database {queue} is no queue of this version: {reason}; nothing was changed")]
    Schema {
        /// Address without password.
        queue: String,
        /// What was found.
        reason: String,
    },
    /// A file or folder.
    #[error(transparent)]
    File(#[from] FileError),
    /// The set's folder cannot be used.
    #[error("the set folder {path} cannot be used: {reason}")]
    Set {
        /// Which.
        path: PathBuf,
        /// Why.
        reason: String,
        /// What to do.
        hint: &'static str,
    },
    /// What was given as photos cannot be taken.
    #[error("{path}: {reason}")]
    Photos {
        /// Folder, list or photo.
        path: PathBuf,
        /// Why.
        reason: String,
        /// What to do.
        hint: &'static str,
    },
    /// A set, scene or cause that is not there.
    #[error("{0}")]
    Unknown(String),
    /// The program that makes scenes cannot be started.
    #[error("cannot start {program}: {source}")]
    Program {
        /// Which.
        program: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

impl BatchError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Address { .. } => {
                Some("a queue is the path of an SQLite file, or postgres://user@host/database (password in PGPASSWORD)")
            }
            Self::Database { .. } => Some(
                "is the server running and reachable (psql ADDRESS), and is the password in PGPASSWORD or ~/.pgpass?",
            ),
            Self::Schema { .. } => {
                Some("name another database or file with --queue, or use the version that made this one")
            }
            Self::File(error) => error.hint(),
            Self::Set { hint, .. } | Self::Photos { hint, .. } => Some(hint),
            Self::Unknown(_) => Some("`harmony batch status SET` lists what is there"),
            Self::Program { .. } => Some("give the path of the program `harmony`"),
        }
    }

    /// Whether the same may work in a moment.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Database { passing: true, .. })
    }
}
