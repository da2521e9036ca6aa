//! `harmony bill`, and the bill that ends a run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Result;
use harmony_calls::{Bill, BillLine, CallBook};

use crate::display::hinted;
use crate::{EXIT_OK, say};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  harmony bill run --objects")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
    /// The objects too, dearest first.
    #[arg(long)]
    objects: bool,
}

/// Runs the command.
///
/// # Errors
/// A folder that holds no calls.
pub fn run(args: &Args) -> Result<u8> {
    if !args.run.join("calls").is_dir() {
        return Err(hinted(format!("{} holds no calls", args.run.display()), Some("give the folder of a run")));
    }
    let bill = Bill::of(&CallBook::look(&args.run).log()?);
    if args.json {
        say!("{}", serde_json::to_string_pretty(&bill)?)?;
        return Ok(EXIT_OK);
    }
    print(&bill, args.objects)?;
    Ok(EXIT_OK)
}

/// Prints a bill by phase, role and player, and by object where wanted.
///
/// # Errors
/// What stdout cannot take.
pub fn print(bill: &Bill, objects: bool) -> Result<()> {
    header("phase")?;
    table(bill.by_phase.iter().map(|(name, line)| (name.as_str(), line)))?;
    header("role")?;
    table(bill.by_role.iter().map(|(role, line)| (role.folder(), line)))?;
    header("player / model")?;
    table(bill.by_player.iter().map(|(name, line)| (name.as_str(), line)))?;
    if objects {
        header("object")?;
        table(dearest_first(&bill.by_object).into_iter())?;
    }
    header("")?;
    row("all", &bill.total)?;
    if bill.total.unpriced > 0 {
        say!("{} calls have no known price ([prices] in harmony.toml)", bill.total.unpriced)?;
    }
    if bill.total.unanswered > 0 {
        say!("{} calls were tried and not answered before the run stopped", bill.total.unanswered)?;
    }
    Ok(())
}

fn dearest_first(lines: &BTreeMap<String, BillLine>) -> Vec<(&str, &BillLine)> {
    let mut all: Vec<_> = lines.iter().map(|(name, line)| (name.as_str(), line)).collect();
    let cost = |line: &BillLine| line.usage.cost_usd.unwrap_or(0.0);
    all.sort_by(|a, b| cost(b.1).total_cmp(&cost(a.1)).then(b.1.latency_ms.cmp(&a.1.latency_ms)).then(a.0.cmp(b.0)));
    all
}

fn header(what: &str) -> Result<()> {
    say!(
        "{what:32} {:>6} {:>8} {:>6} {:>10} {:>10} {:>8} {:>10}",
        "calls",
        "outside",
        "tries",
        "tokens in",
        "out",
        "minutes",
        "US$"
    )
}

fn table<'a>(lines: impl Iterator<Item = (&'a str, &'a BillLine)>) -> Result<()> {
    for (name, line) in lines {
        row(name, line)?;
    }
    say!("")
}

fn row(name: &str, l: &BillLine) -> Result<()> {
    let outside = l.calls.saturating_sub(l.offline + l.recorded);
    let cost = match l.usage.cost_usd {
        Some(usd) => format!("{usd:.3}"),
        None if outside > 0 => "not known".to_owned(),
        None => "-".to_owned(),
    };
    say!(
        "{name:32} {:>6} {outside:>8} {:>6} {:>10} {:>10} {:>8.1} {cost:>10}",
        l.calls,
        l.tries,
        l.usage.input_tokens,
        l.usage.output_tokens,
        l.latency_ms as f64 / 60_000.0
    )
}
