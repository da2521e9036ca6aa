//! Why weights are not here, or not what they should be.

use std::path::PathBuf;

/// A failure with weight files. Addresses in messages have no query: signatures stand there.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Nobody has agreed to the licence.
    #[error("the licence of {model}, {licence}, was not accepted")]
    NotAccepted {
        /// Model.
        model: String,
        /// The licence's name as typed.
        licence: String,
    },
    /// Another process works in the folder.
    #[error("another harmony is fetching into this folder: {}", path.display())]
    Busy {
        /// The lock.
        path: PathBuf,
    },
    /// Too little room.
    #[error("{needed} bytes are needed and {free} are free: {}", path.display())]
    NoSpace {
        /// Folder.
        path: PathBuf,
        /// Bytes still to come, with some to spare.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
    /// Not there.
    #[error("{name} is missing: {}", path.display())]
    Missing {
        /// File.
        name: String,
        /// Where it was looked for.
        path: PathBuf,
    },
    /// Another length than it should have.
    #[error("{name} has {found} bytes, wanted {wanted}{}: {place}", if found < wanted { " (cut off?)" } else { "" })]
    WrongSize {
        /// File.
        name: String,
        /// Bytes that it should have.
        wanted: u64,
        /// Bytes that it has.
        found: u64,
        /// Its path, or the address that offers it.
        place: String,
    },
    /// Another content than it should have.
    #[error("{name} has SHA-256 {found}, wanted {wanted}: {place}")]
    WrongChecksum {
        /// File.
        name: String,
        /// Checksum that it should have.
        wanted: String,
        /// Checksum that it has.
        found: String,
        /// Its path, or the address that offers it.
        place: String,
    },
    /// The hub wants to know who asks, or that its conditions are accepted.
    #[error("the hub does not give {name} without more (HTTP {status}): {reason}: {place}")]
    Gated {
        /// File.
        name: String,
        /// Status.
        status: u16,
        /// The hub's words.
        reason: String,
        /// Address.
        place: String,
        /// Whether a token was sent.
        with_token: bool,
        /// The page where conditions are accepted.
        page: String,
    },
    /// The hub has no such file at this revision.
    #[error("{name} is not there (HTTP 404): {place}")]
    NotFound {
        /// File.
        name: String,
        /// Address.
        place: String,
    },
    /// Any other answer that is no file.
    #[error("{name}: {reason}: {place}")]
    Answer {
        /// File.
        name: String,
        /// What was wrong.
        reason: String,
        /// Address.
        place: String,
        /// Whether asking again may help.
        passing: bool,
        /// Seconds after which to ask again, where the server said so.
        after: Option<u64>,
    },
    /// The connection failed or broke.
    #[error("{name}: {reason}; {have} bytes of {} are kept: {place}", total.map_or("an unknown number".to_owned(), |t| t.to_string()))]
    Broken {
        /// File.
        name: String,
        /// What happened.
        reason: String,
        /// Bytes that came.
        have: u64,
        /// Bytes of the whole.
        total: Option<u64>,
        /// Address.
        place: String,
    },
    /// An address that cannot be used.
    #[error("{reason}: {address}")]
    Address {
        /// As written.
        address: String,
        /// Why.
        reason: String,
    },
    /// The disk did not let us.
    #[error("{source}: {}", path.display())]
    Io {
        /// File or folder.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// The folder's own record cannot be read.
    #[error("cannot be read: {reason}: {}", path.display())]
    Ledger {
        /// The record.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

impl ModelError {
    pub(crate) fn io(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }

    /// Whether trying again right away may help.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Broken { .. } | Self::Answer { passing: true, .. })
    }

    /// What to do about it.
    pub fn hint(&self) -> Option<String> {
        Some(match self {
            Self::NotAccepted { model, licence } => {
                format!("read it (`harmony models list` has the address), then `harmony models pull {model} --accept-licence {licence}`; the same with `verify` for files that are here already")
            }
            Self::Busy { .. } => "wait for it to end; the lock goes with its process".to_owned(),
            Self::NoSpace { .. } => "free some space, or name another folder with --dir or HARMONY_MODELS".to_owned(),
            Self::Missing { .. } => {
                "`harmony models pull NAME` fetches it; on a machine without network, copy the folder by hand, or `harmony models pull NAME --from FOLDER`".to_owned()
            }
            Self::WrongSize { .. } | Self::WrongChecksum { .. } => {
                "this is not the file that the table knows; `harmony models pull NAME` fetches it anew. If that says the same, the hub or the mirror has another file: do not use it".to_owned()
            }
            Self::Gated { with_token: false, page, .. } => format!(
                "open {page} in a browser, accept what it asks for, make a read token there and set HF_TOKEN to it"
            ),
            Self::Gated { page, .. } => {
                format!("the token of HF_TOKEN has no access: look at {page} with the account it belongs to")
            }
            Self::NotFound { .. } => "a mirror may lack it: look at [models] hub, HARMONY_HUB and HF_ENDPOINT".to_owned(),
            Self::Broken { .. } => "run the same command again: it goes on where it stopped".to_owned(),
            Self::Answer { passing: true, .. } => "try again later".to_owned(),
            Self::Address { .. } => "addresses look like https://host or https://host/path".to_owned(),
            Self::Ledger { .. } => "delete it: files are then checked anew and licences asked for again".to_owned(),
            Self::Answer { .. } | Self::Io { .. } => return None,
        })
    }
}
