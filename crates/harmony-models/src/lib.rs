//! Weight files of the native networks: a table of what there is ([`table`]), the folder that holds them ([`Store`]),
//! and how they get there ([`Hub::pull`], [`Store::import`]).
//!
//! A file is used when its checksum is the one in the table. Where the table has none, the checksum of the first file
//! that came is written down and holds from then on (trust on first use), and whoever looks is told so.
//!
//! Nothing here knows what is inside a weight file.

mod date;
mod error;
mod fetch;
mod hub;
mod ledger;
mod store;
pub mod table;

pub use error::ModelError;
pub use fetch::Event;
pub use hub::{Endpoints, Hub, HubOptions, PullLimits, Token};
pub use ledger::{Accepted, Checksum, Known, LEDGER};
pub use store::{FileState, Lock, Store, Verified};
pub use table::{Licence, MODELS, Model, ModelFile, Source};
