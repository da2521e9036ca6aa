//! Players: who can be cast for a role.
//!
//! Without a network:
//!
//! * [`files`]: a language model made of a folder: a person, a chat window or an agent answers;
//! * [`given`]: masks, point maps and meshes that somebody made before;
//! * [`offline`]: this program alone: classical image operations, part models, rules. Always there, and what stands in
//!   when another player fails.
//!
//! Over HTTP ([`http`] is the one client of all; `docs/players.md` tells how to get and start each):
//!
//! * [`vlm`]: language models that see: OpenAI, Gemini, Anthropic, and servers that speak like OpenAI;
//! * [`editor`]: image editors: Gemini, OpenAI, a local server;
//! * [`mesh`]: mesh generators: Hunyuan3D-2 and 2.1, TRELLIS;
//! * [`detector`]: LocateAnything, Grounding DINO, boxes asked from a language model.
//!
//! [`report`] tells who can play here, and what to do about it; [`check`] asks a player whether it is there.
//! Replaying a recording is not a player: `harmony-calls` does it for any role.

pub mod check;
pub mod detector;
pub mod editor;
pub mod files;
pub mod given;
pub mod http;
pub mod mesh;
pub mod offline;
pub mod report;
pub mod vlm;
mod work;

pub use files::{FilesEvent, FilesOptions, FilesPlayer};
pub use given::{Catalogue, MaskFiles, MeshFolder, PointMapFile};
pub use offline::{BoxesWithLists, flat_cast, forget_path_tracer, offline_cast, path_tracer};
pub use report::{RoleStatus, casting_report};
