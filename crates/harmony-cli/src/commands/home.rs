//! `harmony home`: reconstructed rooms in one layout, and one room in another size.

use std::path::{Path, PathBuf};

use anyhow::Result;
use harmony_export::World;
use harmony_home::HomeError;
use harmony_home::adapt::adapt;
use harmony_home::build::{Built, How, build};
use harmony_home::files::{write, write_adapted};
use harmony_home::layout::HomeLayout;
use harmony_home::matching::SURE_NATS;
use harmony_home::rooms::RoomRun;
use harmony_home::svg::{self, SvgOptions};
use harmony_scene::Extents;

use crate::display::hinted;
use crate::{EXIT_INCOMPLETE, EXIT_OK, say, tell};

/// Largest layout that is read, bytes.
const MAX_LAYOUT: u64 = 16 << 20;

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony home build --layout flat.json kitchen=runs/k hall=runs/h --out home
  harmony home adapt runs/bedroom --room 4.2x3.6x2.5 --out wider")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Put reconstructed rooms into one layout: one scene with rooms as groups.
    #[command(after_help = BUILD_HELP)]
    Build(BuildArgs),
    /// One reconstructed room in another size: things keep their walls, relations and clearances.
    #[command(after_help = ADAPT_HELP)]
    Adapt(AdaptArgs),
}

const BUILD_HELP: &str = "\
Examples:
  harmony home build --layout flat.json kitchen=runs/k hall=runs/h --out home
  harmony home build --layout flat.svg --scale 0.01 --height 2.5 runs/k runs/h --out home
  harmony home build runs/k runs/h --out home
  harmony export home --to glb,usd,plan --check

Without a layout the rooms are joined by their doors. docs/homes.md describes layouts, with an example.
Exit code 3: the home was built, but something does not fit or the layout is not sure; home.json has it with sizes.";

const ADAPT_HELP: &str = "\
Example:
  harmony home adapt runs/bedroom --room 4.2x3.6x2.5 --out wider

WIDTHxDEPTHxHEIGHT are metres; the height may be left out. Exit code 3: something does not fit.";

/// Arguments of `home build`.
#[derive(Debug, clap::Args)]
struct BuildArgs {
    /// Run folders, each as RUN or NAME=RUN where NAME is a room of the layout.
    #[arg(required = true)]
    runs: Vec<String>,
    /// The floor plan, JSON or SVG; without one the rooms are joined by their doors.
    #[arg(long)]
    layout: Option<PathBuf>,
    /// Length of one unit of an SVG, metres.
    #[arg(long, value_name = "METRES", requires = "layout")]
    scale: Option<f64>,
    /// Height of an SVG's rooms, metres.
    #[arg(long, value_name = "METRES", requires = "layout")]
    height: Option<f64>,
    /// Folder of the home; must not exist.
    #[arg(long, short)]
    out: PathBuf,
}

/// Arguments of `home adapt`.
#[derive(Debug, clap::Args)]
struct AdaptArgs {
    /// Run folder.
    run: PathBuf,
    /// The other size, metres: 4.2x3.6x2.5, or 4.2x3.6 with the height as it is.
    #[arg(long, value_name = "WxDxH")]
    room: String,
    /// Folder for the adapted scene; must not exist.
    #[arg(long, short)]
    out: PathBuf,
}

fn told(error: &HomeError) -> anyhow::Error {
    hinted(error.to_string(), error.hint())
}

/// Runs the command.
///
/// # Errors
/// Runs, layouts and folders that cannot be used.
pub fn run(args: &Args) -> Result<u8> {
    match &args.command {
        Command::Build(args) => build_home(args),
        Command::Adapt(args) => adapt_room(args),
    }
}

/// A layout from a file: SVG by its ending or its first characters, else JSON.
fn layout(path: &Path, options: &SvgOptions) -> Result<HomeLayout> {
    let bytes = harmony_io::read_bounded(path, MAX_LAYOUT).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let text = String::from_utf8_lossy(&bytes);
    let drawn = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg")) || text.trim_start().starts_with('<');
    let read = if drawn { svg::parse(&text, options) } else { HomeLayout::parse(&text) };
    read.map_err(|e| hinted(format!("{}: {e}", path.display()), e.hint()))
}

fn build_home(args: &BuildArgs) -> Result<u8> {
    if args.out.exists() {
        return Err(told(&HomeError::Exists { path: args.out.clone() }));
    }
    let options = SvgOptions { metres_per_unit: args.scale, height: args.height };
    let layout = args.layout.as_deref().map(|path| layout(path, &options)).transpose()?;
    let mut runs = Vec::new();
    for argument in &args.runs {
        let run = RoomRun::read(argument).map_err(|e| told(&e))?;
        tell!("{}: {} objects", run.run.display(), run.world.items.len());
        runs.push(run);
    }
    let built = build(layout.as_ref(), runs).map_err(|e| told(&e))?;
    let sure = report(&built)?;
    let file = write(built, &args.out).map_err(|e| told(&e))?;
    file.notes.iter().for_each(|note| tell!("note: {note}"));
    file.conflicts.iter().for_each(|conflict| tell!("conflict: {conflict}"));
    say!(
        "{}: {} rooms, {} doors, {} objects, {} conflicts",
        args.out.join("home.json").display(),
        file.rooms.len(),
        file.doors.len(),
        file.rooms.iter().map(|r| r.objects.len()).sum::<usize>(),
        file.conflicts.len()
    )?;
    Ok(if sure && file.conflicts.is_empty() { EXIT_OK } else { EXIT_INCOMPLETE })
}

/// Says where the rooms are; whether that is sure.
fn report(built: &Built) -> Result<bool> {
    let home = &built.home;
    for room in &home.rooms {
        let (size, place) = (room.solved.rect.size(), &room.solved.place);
        let photo = if room.run.is_some() {
            format!("scale {:+.1} %, yaw {:+.2} deg", (place.scale - 1.0) * 100.0, place.yaw.to_degrees())
        } else {
            "no photo".to_owned()
        };
        say!("{}: {:.2} x {:.2} m, turned by {} quarters, {photo}", room.name, size.x, size.y, u8::from(place.turn))?;
    }
    for door in &home.doors {
        let rooms: Vec<&str> = door.rooms.iter().map(|r| home.rooms[*r].name.as_str()).collect();
        let off = |v: Option<f64>| v.map_or_else(|| "not in its photo".to_owned(), |v| format!("{:+.1} cm", v * 100.0));
        let seen: Vec<String> = (0..door.rooms.len())
            .map(|k| format!("{} (before: {})", off(door.seen[k].map(|s| s.1)), off(door.before[k])))
            .collect();
        say!("door {}: {:.2} m wide; off by {}", rooms.join(" - "), door.range[1] - door.range[0], seen.join(", "))?;
    }
    say!(
        "chi-square of walls, doors and heights: {:.1} before, {:.1} after",
        2.0 * built.cost[0],
        2.0 * built.cost[1]
    )?;
    let (what, next) = match &built.how {
        How::Layout(a) => ("assignment", a.next.min(a.runs.iter().map(|r| r.next_turn).fold(f64::INFINITY, f64::min))),
        How::Doors(r) => ("layout", r.next),
    };
    if next.is_finite() {
        say!("the next best {what} is {next:.1} nats behind")?;
    }
    if next < SURE_NATS {
        tell!("note: that is not sure: name rooms as NAME=RUN, or give a floor plan with --layout");
    }
    Ok(next >= SURE_NATS)
}

/// `4.2x3.6x2.5` or `4.2x3.6`.
fn size(text: &str, height: f64) -> Result<Extents> {
    let numbers: Vec<Option<f64>> = text.split(['x', 'X']).map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [Some(width), Some(depth)] => Ok(Extents { width, height, depth }),
        [Some(width), Some(depth), Some(height)] => Ok(Extents { width, height, depth }),
        _ => Err(hinted(
            format!("--room {text:?} is no size"),
            Some("width x depth x height in metres, such as 4.2x3.6x2.5"),
        )),
    }
}

fn adapt_room(args: &AdaptArgs) -> Result<u8> {
    if args.out.exists() {
        return Err(told(&HomeError::Exists { path: args.out.clone() }));
    }
    let world = World::read(&args.run)
        .map_err(|source| told(&HomeError::Run { run: args.run.clone(), source: Box::new(source) }))?;
    let to = size(&args.room, world.scene.room.extents.height)?;
    let (world, report) = adapt(&world, to).map_err(|e| told(&e))?;
    write_adapted(&world, &report, &args.out).map_err(|e| told(&e))?;
    report.resolved.iter().for_each(|line| tell!("note: {line}"));
    report.conflicts.iter().for_each(|line| tell!("conflict: {line}"));
    say!(
        "{}: {} of {} objects moved, {} conflicts",
        args.out.join("scene.json").display(),
        report.moved.len(),
        world.items.len(),
        report.conflicts.len()
    )?;
    Ok(if report.conflicts.is_empty() { EXIT_OK } else { EXIT_INCOMPLETE })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_and_without_a_height() {
        let read = |text| size(text, 2.4).ok().map(|e| [e.width, e.depth, e.height]);
        assert_eq!(read("4.2x3.6x2.5"), Some([4.2, 3.6, 2.5]));
        assert_eq!(read("4 X 3"), Some([4.0, 3.0, 2.4]));
        for wrong in ["", "4", "4x", "4xax2", "1x2x3x4"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
