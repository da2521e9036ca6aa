//! Players: who can be cast for a role without a network.
//!
//! * [`files`]: a language model made of a folder: a person, a chat window or an agent answers;
//! * [`given`]: masks, point maps and meshes that somebody made before;
//! * [`offline`]: this program alone: classical image operations, part models, rules. Always there, and what stands in
//!   when another player fails;
//! * [`report`]: who can play here, and what to do about it.
//!
//! Replaying a recording is not a player: `harmony-calls` does it for any role.

pub mod files;
pub mod given;
pub mod offline;
pub mod report;

pub use files::{FilesEvent, FilesOptions, FilesPlayer};
pub use given::{MaskFiles, MeshFolder, PointMapFile};
pub use offline::offline_cast;
pub use report::{RoleStatus, casting_report};
