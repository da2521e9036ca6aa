//! `harmony show`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use harmony_pipeline::{PhaseState, RunFile};
use harmony_scene::{Scene, Support};

use crate::{EXIT_INCOMPLETE, EXIT_OK, say};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  harmony show run --warnings")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Print the warnings too.
    #[arg(long, short)]
    warnings: bool,
}

/// Runs the command.
///
/// # Errors
/// A folder that holds no run.
pub fn run(args: &Args) -> Result<u8> {
    let file = RunFile::read(&args.run)
        .with_context(|| format!("{} holds no readable run.json: is it a run folder?", args.run.display()))?;
    say!("{} by {}, profile {}", args.run.display(), file.generator, file.profile)?;
    for (name, phase) in &file.phases {
        let state = match phase.state {
            PhaseState::Pending => "not run",
            PhaseState::Running => "not finished",
            PhaseState::Done => "done",
            PhaseState::Failed => "FAILED",
        };
        let more = if phase.state == PhaseState::Failed { format!(": {}", phase.outcome) } else { String::new() };
        say!("  {name:14} {state}{more}")?;
    }
    say!(
        "  calls: {}, tokens {} in / {} out, {:.2} questions for each placed object",
        file.bill.total.calls,
        file.bill.total.usage.input_tokens,
        file.bill.total.usage.output_tokens,
        file.questions_per_object
    )?;
    let Ok(scene) = harmony_io::read_json::<Scene>(&args.run.join("scene.json")) else {
        say!("no scene yet")?;
        return Ok(EXIT_INCOMPLETE);
    };
    let e = scene.room.extents;
    say!("{}: W {:.2} x D {:.2} x H {:.2} m", scene.room.room_type, e.width, e.depth, e.height)?;
    say!("  {:24} {:22} {:>22} {:>6} {:>5}  on", "object", "size W x H x D (m)", "position (m)", "yaw", "conf")?;
    for o in &scene.objects {
        let on = match &o.support {
            Support::Floor => "floor".to_owned(),
            Support::Ceiling => "ceiling".to_owned(),
            Support::Wall { wall } => format!("{} wall", wall.surface().name()),
            Support::Object { id } => id.to_string(),
            Support::Block { block } => harmony_scene::Ledge::Block(*block).id().to_string(),
            Support::Niche { niche } => harmony_scene::Ledge::Niche(*niche).id().to_string(),
        };
        let (s, p) = (o.size, o.pose.position);
        say!(
            "  {:24} {:22} {:>22} {:>5.0}° {:>5.2}  {on}",
            o.id.as_str(),
            format!("{:.2} x {:.2} x {:.2}", s.width, s.height, s.depth),
            format!("{:.2}, {:.2}, {:.2}", p.x, p.y, p.z),
            o.pose.yaw.to_degrees(),
            o.confidence.overall
        )?;
    }
    say!("{} warnings{}", scene.warnings.len(), if args.warnings { ":" } else { " (--warnings shows them)" })?;
    if args.warnings {
        for w in &scene.warnings {
            let object = w.object.as_ref().map_or(String::new(), |o| format!(" {o}"));
            say!("  [{}{object}] {}", w.phase, w.message)?;
        }
    }
    Ok(if file.complete() { EXIT_OK } else { EXIT_INCOMPLETE })
}
