//! `harmony estimate`.

use std::path::PathBuf;

use anyhow::Result;
use harmony_calls::CallBook;
use harmony_io::load_photo;
use harmony_pipeline::{Estimate, Inventory, estimate};

use crate::cast::{self, CastRequest};
use crate::config::{self, Profile};
use crate::display::{Display, hinted};
use crate::{EXIT_OK, say};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  harmony estimate room.jpg --profile hosted

Nothing is asked and nothing is written; keys need not be set. Prices come from [prices] in harmony.toml; a model that is not in that table
has no known price.")]
pub struct Args {
    /// The photo.
    photo: PathBuf,
    /// Run folder of an earlier or broken-off run of this photo: its objects and its measured times are used.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Who plays the roles.
    #[arg(long)]
    profile: Option<Profile>,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Number of objects, where it is known.
    #[arg(long)]
    objects: Option<usize>,
    /// Leave the path-traced render out.
    #[arg(long)]
    no_lit: bool,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// A photo or configuration that cannot be used.
pub fn run(args: &Args) -> Result<u8> {
    let config = config::load(args.config.as_deref())?;
    let photo = load_photo(&args.photo).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let display = Display::new();
    let profile = args.profile.or(config.profile).unwrap_or_default();
    let request = CastRequest {
        profile,
        // Nobody is asked, so no key is needed.
        players: config.players.resolved(profile).without_keys(),
        models: crate::models::store(&config.models, None),
        photo_size: photo.size(),
        points: None,
        intrinsics: None,
        depth_scale: 1000.0,
        masks: None,
        questions: config.files.folder.clone().unwrap_or_else(|| PathBuf::from("questions")),
        tasks: None,
        timeout_minutes: config.files.timeout_minutes,
        path_tracer: !args.no_lit,
        working_px: config.settings.working_px,
        tell: std::sync::Arc::new(|_| {}),
    };
    let casting = cast::cast(&request)?;
    display.finish();
    let of_run = args.out.as_deref().filter(|_| args.objects.is_none()).and_then(Inventory::of_run);
    let inventory = of_run.unwrap_or_else(|| Inventory::typical(args.objects));
    let log = match &args.out {
        Some(run) => CallBook::look(run).log()?,
        None => Vec::new(),
    };
    let found = estimate(inventory, &casting.cast, casting.cast.can().traces, &config.prices, &log);
    if args.json {
        say!("{}", serde_json::to_string_pretty(&found)?)?;
    } else {
        print(&found)?;
    }
    Ok(EXIT_OK)
}

fn print(e: &Estimate) -> Result<()> {
    say!("An ESTIMATE, from {}:", e.inventory.source)?;
    let count = |i: usize| e.inventory.objects[i];
    say!(
        "  {:.0} wall objects, {:.0} pieces of furniture, {:.0} ceiling objects, {:.0} decorations",
        count(0),
        count(1),
        count(2),
        count(3)
    )?;
    say!("")?;
    say!("{:20} {:32} {:>6} {:>10} {:>9} {:>10}", "role", "player / model", "calls", "tokens", "s a call", "US$")?;
    for r in &e.roles {
        let tokens = r.tokens.0 + r.tokens.1;
        say!(
            "{:20} {:32} {:>6.0} {:>10} {:>9} {:>10}",
            r.role.folder(),
            format!("{} / {}", r.card.player, r.card.model),
            r.calls,
            if tokens > 0.0 && !r.card.offline { format!("{tokens:.0}") } else { "-".to_owned() },
            if r.card.offline {
                "-".to_owned()
            } else {
                format!("{:.0}{}", r.seconds_each, if r.measured { "" } else { "?" })
            },
            r.usd.map_or_else(|| "not known".to_owned(), |usd| format!("{usd:.2}")),
        )?;
    }
    say!("")?;
    let unknown: Vec<&str> = e.unpriced.iter().map(|role| role.folder()).collect();
    let date = if e.prices_date.is_empty() { String::new() } else { format!(", prices of {}", e.prices_date) };
    say!(
        "money: {:.2} US${date}{}",
        e.usd,
        if unknown.is_empty() { String::new() } else { format!(", without {} (price not known)", unknown.join(", ")) }
    )?;
    say!(
        "time: at least {:.1} minutes of waiting for players (one call after another: {:.1}); this program's own work \
         comes on top, some seconds an object",
        e.minutes_at_least,
        e.minutes_in_a_row
    )?;
    if e.roles.iter().any(|r| !r.measured && !r.card.offline) {
        say!("times with ? are usual ones, not measured here")?;
    }
    Ok(())
}
