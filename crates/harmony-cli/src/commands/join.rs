//! `harmony join`: several runs of photos of one room into one scene.

use std::path::{Path, PathBuf};

use anyhow::Result;
use harmony_join::{JoinNoise, JoinReport, join};

use crate::display::hinted;
use crate::{EXIT_INCOMPLETE, EXIT_OK, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony reconstruct door.jpg --out runs/door
  harmony reconstruct window.jpg --out runs/window
  harmony join runs/door runs/window --out room
  harmony reconstruct door.jpg window.jpg --out room

The last line does the same in one. Each photo is reconstructed by itself first; joining asks no model.
Photos must share furniture. A run that does not fit to the others, or fits in two ways, is left out and told (exit code 3);
where none fits to the first nothing is written.")]
pub struct Args {
    /// Run folders of the single photos; the first one's frame and photo are the joined scene's.
    #[arg(required = true, num_args = 2..)]
    runs: Vec<PathBuf>,
    /// Folder of the joined run.
    #[arg(long, short)]
    out: PathBuf,
    /// Replace what was joined there before.
    #[arg(long)]
    replace: bool,
}

/// Runs the command.
///
/// # Errors
/// Runs that cannot be read or do not fit together, an unwritable folder.
pub fn run(args: &Args) -> Result<u8> {
    joined(&args.runs, &args.out, args.replace)
}

/// Joins runs and says what came of it.
///
/// # Errors
/// As [`run`].
pub fn joined(runs: &[PathBuf], out: &Path, replace: bool) -> Result<u8> {
    let report = join(runs, out, replace, &JoinNoise::default(), &|line| tell!("{line}"))
        .map_err(|e| hinted(e.to_string(), e.hint()))?;
    print(&report)?;
    say!("look at {}/report.html", out.display())?;
    Ok(if report.left_out.is_empty() { EXIT_OK } else { EXIT_INCOMPLETE })
}

fn print(report: &JoinReport) -> Result<()> {
    let e = report.scene.room.extents;
    let several = report.things.iter().filter(|t| t.track.members.len() > 1).count();
    say!(
        "{} photos, {}: {:.2} x {:.2} x {:.2} m, {} objects, {several} of them seen in several photos",
        report.runs.len(),
        report.scene.room.room_type,
        e.width,
        e.depth,
        e.height,
        report.things.len()
    )?;
    for link in &report.links {
        let Some(best) = &link.pairing.best else { continue };
        say!(
            "  {} and {}: {:.1} nats for one room, {:.1} before the next way, {} things in common",
            report.runs[link.runs[0]],
            report.runs[link.runs[1]],
            best.odds,
            link.pairing.lead,
            best.pairs.len()
        )?;
    }
    for (name, placing) in report.runs.iter().zip(&report.joint.placings) {
        say!(
            "  {name}: {} quarter turns, {:+.2} deg askew, scale {:.3}",
            placing.turn.quarters(),
            placing.yaw.to_degrees(),
            placing.ln_scale.exp()
        )?;
    }
    let seen = &report.seen;
    let first = |of: &[f64]| 100.0 * of.first().copied().unwrap_or(0.0);
    say!(
        "  seen: {:.0} % of the objects' surface ({:.0} % by the first photo alone), {:.0} % of the room's ({:.0} %)",
        100.0 * seen.objects,
        first(&seen.objects_by_photo),
        100.0 * seen.room,
        first(&seen.room_by_photo)
    )?;
    report.dropped.iter().try_for_each(|d| say!("  left out: {} of {}: {}", d.id, d.run, d.reason))?;
    report.left_out.iter().try_for_each(|l| say!("  left out: the whole of {}: {}", l.run, l.reason))
}
