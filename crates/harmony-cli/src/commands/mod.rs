//! One module a command.

pub mod bench;
pub mod doctor;
pub mod reconstruct;
pub mod record;
pub mod render;
pub mod schema;
pub mod show;
