//! `harmony schema`.

use anyhow::Result;

use crate::{EXIT_OK, say};

/// What to describe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Subject {
    /// `scene.json`.
    Scene,
    /// The default configuration as TOML, every key with its default, and the players of each profile.
    Config,
    /// A part model (a mesh described in JSON).
    PartModel,
}

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  harmony schema config > harmony.schema.json")]
pub struct Args {
    /// What to describe.
    #[arg(value_enum, default_value = "scene")]
    subject: Subject,
}

/// Runs the command.
///
/// # Errors
/// None in practice.
pub fn run(args: &Args) -> Result<u8> {
    let text = match args.subject {
        Subject::Scene => serde_json::to_string_pretty(&schemars::schema_for!(harmony_scene::Scene))?,
        Subject::PartModel => serde_json::to_string_pretty(&schemars::schema_for!(harmony_mesh::PartModel))?,
        Subject::Config => {
            let defaults = toml::to_string_pretty(&crate::config::ConfigFile::default())?;
            format!("{defaults}{}", crate::config::players::described()?)
        }
    };
    say!("{text}")?;
    Ok(EXIT_OK)
}
