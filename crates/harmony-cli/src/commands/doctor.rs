//! `harmony doctor`.

use anyhow::Result;
use harmony_players::{casting_report, offline_cast};

use crate::{EXIT_OK, say};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// None in practice.
pub fn run(args: &Args) -> Result<u8> {
    let report = casting_report(&offline_cast());
    if args.json {
        say!("{}", serde_json::to_string_pretty(&report)?)?;
        return Ok(EXIT_OK);
    }
    say!("What can be cast on this machine:")?;
    let mut last = None;
    for status in &report {
        if last != Some(status.role) {
            say!("\n{}", status.role.folder())?;
            last = Some(status.role);
        }
        say!(
            "  {} {:12} {}",
            if status.available { "ok     " } else { "missing" },
            status.player.player,
            status.detail
        )?;
        if !status.available
            && let Some(hint) = &status.hint
        {
            say!("          hint: {hint}")?;
        }
    }
    Ok(EXIT_OK)
}
