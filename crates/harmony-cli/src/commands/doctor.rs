//! `harmony doctor`.

use anyhow::Result;
use harmony_players::{casting_report, offline_cast};

use crate::EXIT_OK;

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
        println!("{}", serde_json::to_string_pretty(&report)?);
        return Ok(EXIT_OK);
    }
    println!("What can be cast on this machine:");
    let mut last = None;
    for status in &report {
        if last != Some(status.role) {
            println!("\n{}", status.role.folder());
            last = Some(status.role);
        }
        println!(
            "  {} {:12} {}",
            if status.available { "ok     " } else { "missing" },
            status.player.player,
            status.detail
        );
        if !status.available
            && let Some(hint) = &status.hint
        {
            println!("          hint: {hint}");
        }
    }
    Ok(EXIT_OK)
}
