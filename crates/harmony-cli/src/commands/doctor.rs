//! `harmony doctor`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use harmony_players::check::Checked;
use harmony_players::{RoleStatus, casting_report, offline_cast};
use harmony_roles::{PlayerCard, Role, RoleError};
use serde_json::json;

use crate::cast::{self, Known};
use crate::config::players::Boxes;
use crate::config::{self, ConfigFile, Profile};
use crate::networks::{self, Wanted};
use crate::survey::{USUAL, survey};
use crate::{EXIT_ERROR, EXIT_OK, models, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "switches of a command line")]
#[command(after_help = "\
Example:
  harmony doctor --profile hosted

Each hosted or local player of the profile is asked with one call that costs nothing; with --paid it does a tiny piece
of work instead. Ends with 1 when a player that the profile needs is missing.")]
pub struct Args {
    /// Whose players are looked at (default: the configuration's).
    #[arg(long)]
    profile: Option<Profile>,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Let each player do a tiny piece of work, which may cost a few cents.
    #[arg(long)]
    paid: bool,
    /// Nothing may leave this machine.
    #[arg(long)]
    local_only: bool,
    /// Look for servers of one's own at their usual ports on this machine, too.
    #[arg(long)]
    ports: bool,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// A configuration that does not fit.
pub fn run(args: &Args) -> Result<u8> {
    let config = config::load(args.config.as_deref())?;
    let profile = args.profile.or(config.profile).unwrap_or_default();
    let Looked { report, missing, notes } = look(&config, profile, args.local_only, args.paid)?;
    let store = models::store(&config.models, None);
    let status = networks::status(&store);
    let servers: Vec<String> = if args.ports { USUAL.map(str::to_owned).to_vec() } else { Vec::new() };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    let found = runtime.block_on(survey(&servers, &store))?;
    if args.json {
        let networks = serde_json::to_value(&status)?;
        let report = json!({
            "profile": profile.name(), "players": report, "notes": notes, "networks": networks, "machine": found,
        });
        say!("{}", serde_json::to_string_pretty(&report)?)?;
    } else {
        print(&report, profile)?;
        if profile == Profile::Files {
            say!(
                "\nquestions are written to <run folder>/questions, one folder each, and wait there for an answer.json;"
            )?;
            say!("docs/players.md, \"Answering by hand\", tells how it goes")?;
        }
        say!("\nthis machine")?;
        for line in found.lines() {
            say!("  {line}")?;
        }
        if !args.ports {
            say!("  (usual ports are looked at with --ports, and by `harmony setup`)")?;
        }
        say!("\nnetworks inside this program")?;
        for line in notes.into_iter().chain(status.lines()) {
            say!("  {line}")?;
        }
    }
    Ok(if missing { EXIT_ERROR } else { EXIT_OK })
}

/// What was found out about the players of a profile.
pub struct Looked {
    /// Role by role.
    pub report: Vec<RoleStatus>,
    /// A player that the profile needs is missing.
    pub missing: bool,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// Casts a profile and asks each player whether it is there; with `paid`, for a tiny piece of work.
///
/// # Errors
/// None in practice.
pub fn look(config: &ConfigFile, profile: Profile, local_only: bool, paid: bool) -> Result<Looked> {
    let mut players = config.players.resolved(profile);
    players.local_only |= local_only;
    let mut cast = offline_cast();
    let mut report = casting_report(&cast);
    let mut known = Known::default();
    let store = models::store(&config.models, None);
    let hear = |line: String| tell!("{line}");
    let wanted = Wanted { players: &players, store: &store, no_geometry: false, no_masks: false, tell: &hear };
    let played = networks::cast(&mut cast, &wanted, &mut known);
    if played.detector {
        players.detector.player = Some(Boxes::Owlv2);
    }
    let mut failures = played.failures;
    failures.extend(cast::cast_services(&mut cast, &players, None, &mut known));
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    let checked = runtime.block_on(cast::check_all(&known.checks, paid));
    let missing = !failures.is_empty() || checked.iter().any(|(_, _, result)| result.is_err());
    let service =
        |player: &str| PlayerCard { player: player.to_owned(), model: String::new(), offline: false, concurrency: 0 };
    report.extend(failures.iter().map(|(role, error)| failed(*role, service(player_of(error)), error)));
    for (role, name, result) in &checked {
        let mut card = cast.card(*role);
        card.player.clone_from(name);
        report.push(match result {
            Ok(checked) => there(*role, card, checked),
            Err(error) => failed(*role, card, error),
        });
    }
    report.sort_by_key(|status| (Role::ALL.iter().position(|role| *role == status.role), status.player.offline));
    Ok(Looked { report, missing, notes: played.notes })
}

/// The player that an error is about.
fn player_of(error: &RoleError) -> &str {
    match error {
        RoleError::NotSetUp { player, .. } | RoleError::NotCapable { player, .. } => player,
        _ => "not cast",
    }
}

fn failed(role: Role, player: PlayerCard, error: &RoleError) -> RoleStatus {
    let hint = Some(error.hint().map_or_else(|| cast::unreachable_hint(role, &player.player), str::to_owned));
    RoleStatus { role, player, available: false, detail: error.to_string(), hint }
}

fn there(role: Role, player: PlayerCard, checked: &Checked) -> RoleStatus {
    let cost = match checked.usage {
        Some(usage) => match usage.cost_usd {
            Some(cost) => format!(" ({cost:.4} US$)"),
            None => " (cost not known)".to_owned(),
        },
        None => String::new(),
    };
    RoleStatus { role, player, available: true, detail: format!("{}{cost}", checked.detail), hint: None }
}

/// Prints a report, role by role.
///
/// # Errors
/// The output cannot be written.
pub fn print(report: &[RoleStatus], profile: Profile) -> Result<()> {
    say!("What can be cast on this machine (profile {}):", profile.name())?;
    let mut last = None;
    for status in report {
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
    Ok(())
}
