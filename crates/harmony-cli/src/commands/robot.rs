//! `harmony robot`: what robots can do in the scene of a run, and scripted tasks on its geometry.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use harmony_export::World;
use harmony_io::write_json;
use harmony_physics::pictures::{self, Lit};
use harmony_robot::jaw::Jaw;
use harmony_robot::lit::LitMotion;
use harmony_robot::measure::JawSize;
use harmony_robot::motion::Trajectory;
use harmony_robot::pictures::Painter;
use harmony_robot::{Affordances, Job, Model, Output, RobotError, Surroundings, affordances, perform, write};
use harmony_scene::ImageSize;
use serde::Serialize;

use crate::commands::simulate::{blender, write_frames};
use crate::display::hinted;
use crate::{EXIT_OK, say, tell};

/// Which robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Robot {
    /// Franka Panda: an arm with a jaw of 80 mm.
    Panda,
    /// Unitree H1: a humanoid with 19 joints.
    H1,
}

/// What it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Task {
    /// The Panda draws a chair back by its backrest.
    DrawChair,
    /// The Panda picks a decoration up.
    Pick,
    /// The Panda opens a drawer or a door of furniture.
    OpenDrawer,
    /// The H1 draws the chair, goes around it and sits down at the desk.
    Sit,
}

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony robot run --report
  harmony robot run --robot h1 --model h1/h1.xml --task sit --lit
  harmony robot run --robot panda --model panda/panda.xml --task pick --object mug_01")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Tell of every object whether it can be grasped, sat on, placed on, opened, with the measurements.
    #[arg(long)]
    report: bool,
    /// Which robot.
    #[arg(long, value_enum)]
    robot: Option<Robot>,
    /// Its model: an MJCF file with its meshes beside it.
    #[arg(long, value_name = "PATH")]
    model: Option<PathBuf>,
    /// What it does.
    #[arg(long, value_enum)]
    task: Option<Task>,
    /// The object of the task by its id; default the first that allows it.
    #[arg(long, value_name = "ID")]
    object: Option<String>,
    /// Opening of the jaw of --report, metres, when no --model says it.
    #[arg(long, default_value_t = 0.08, value_parser = opening)]
    jaw: f64,
    /// Longest side of a frame's picture, pixels.
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(64..=1920))]
    size: u32,
    /// Path-trace six evenly spaced frames with the scene's own light (needs Blender; about a minute a frame).
    #[arg(long)]
    lit: bool,
    /// Samples a pixel with --lit.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=1024))]
    samples: u32,
    /// Folder of the results; default `<run>/7_world/robot`, a folder a task below it.
    #[arg(long, short)]
    out: Option<PathBuf>,
}

fn opening(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("\"{text}\" is no number"))?;
    if (0.005..=0.5).contains(&value) { Ok(value) } else { Err("a jaw opens between 0.005 and 0.5 m".to_owned()) }
}

/// Sizes of the Panda's hand but for its opening, for a report without a model.
fn panda_like(opening_m: f64) -> JawSize {
    JawSize { opening_m, tip_m: 0.0094, palm_m: 0.0369, pad_half_height_m: 0.0085, pad_half_width_m: 0.0085 }
}

fn told(error: &RobotError) -> anyhow::Error {
    hinted(error.to_string(), error.hint())
}

/// Runs the command.
///
/// # Errors
/// A folder that is no run, a model that cannot be read, a task that the geometry forbids.
pub fn run(args: &Args) -> Result<u8> {
    let wants = args.robot.is_some() || args.task.is_some();
    if !args.report && !wants {
        bail!("nothing to do: give --report, or --robot with --model and --task");
    }
    if args.lit && !wants {
        bail!("--lit is for the frames of a task; add --robot with --model and --task");
    }
    let renderer = if args.lit { Some(blender()?) } else { None };
    let model = args.model.as_deref().map(Model::read).transpose().map_err(|e| told(&e))?;
    let world = World::read(&args.run).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let room = Surroundings::new(&world);
    let out = args.out.clone().unwrap_or_else(|| args.run.join("7_world/robot"));
    if args.report {
        report(args, &world, &room, model.as_ref(), &out)?;
    }
    if !wants {
        return Ok(EXIT_OK);
    }
    let (Some(robot), Some(task)) = (args.robot, args.task) else { bail!("--robot and --task belong together") };
    let job = match (robot, task) {
        (Robot::Panda, Task::DrawChair) => Job::DrawChair,
        (Robot::Panda, Task::Pick) => Job::Pick,
        (Robot::Panda, Task::OpenDrawer) => Job::OpenDrawer,
        (Robot::H1, Task::Sit) => Job::Sit,
        (Robot::Panda, Task::Sit) => {
            bail!("a Panda is an arm and cannot sit; its tasks are draw-chair, pick and open-drawer")
        }
        (Robot::H1, _) => bail!("an H1 has no jaw; its task is sit"),
    };
    let Some(model) = model else {
        return Err(hinted(
            "--model is missing: the MJCF file of the robot".to_owned(),
            Some("tools/setup.sh robots installs panda.xml and h1.xml; docs/simulation.md tells where"),
        ));
    };
    let started = Instant::now();
    let done = perform(&world, &room, &model, job, args.object.as_deref()).map_err(|e| told(&e))?;
    tell!("planned and measured in {:.1} s", started.elapsed().as_secs_f64());
    let folder = if args.out.is_some() { out } else { out.join(&done.motion.task) };
    let hulls = args.run.join("7_world/hulls");
    let output = Output {
        folder: folder.clone(),
        hulls: Some(hulls),
        size: ImageSize::new(args.size, args.size * 3 / 4),
        pictures: 9,
    };
    let written = write(&world, &room, &done, &output).map_err(|e| told(&e))?;
    print_task(&written)?;
    if let Some(renderer) = &renderer {
        let albedo = harmony_io::albedo_field(&args.run);
        let kept = Some(args.run.join("7_world/lit"));
        let lit = Lit { renderer, scene: &world.scene, albedo, samples: args.samples, kept };
        let painter = Painter::new(&world, &room, &done.motion, output.size);
        let motion = LitMotion::new(&world, &done.motion, &painter).map_err(|e| told(&e))?;
        let mut traced = Vec::new();
        for (k, number) in pictures::sheet_frames(done.motion.frames.len()).into_iter().enumerate() {
            tell!("path-tracing frame {} of {}", k + 1, pictures::SHEET_FRAMES);
            traced.push(motion.frame(&lit, number).map_err(|e| told(&e))?);
        }
        write_frames(&folder, "frame_lit", "sheet_lit.jpg", &traced)?;
    }
    say!("{}", folder.display())?;
    Ok(EXIT_OK)
}

fn print_task(done: &Trajectory) -> Result<()> {
    let e = &done.evidence;
    say!("{} of {} by {}: {} frames, {} failed", done.task, done.object, done.robot, e.frames, e.failed_frames)?;
    for sentence in &done.because {
        say!("  {sentence}")?;
    }
    for (name, value) in &done.measured {
        say!("  {name:32} {value:.4}")?;
    }
    say!("  {:32} {:.4} ({})", "smallest_clearance_m", e.smallest_clearance_m, e.nearest)?;
    say!("  {:32} {:.4} ({})", "smallest_joint_margin", e.smallest_margin, e.tightest_joint)?;
    say!("  {:32} {:.4} gap, {:.4} deep", "touch_m", e.largest_gap_m, e.deepest_touch_m)
}

/// `affordances.json`.
#[derive(Serialize)]
struct ReportFile<'a> {
    generator: String,
    jaw: JawSize,
    objects: &'a [Affordances],
}

fn report(args: &Args, world: &World, room: &Surroundings, model: Option<&Model>, out: &Path) -> Result<()> {
    let jaw = match model {
        Some(model) => Jaw::of(model).map_err(|e| told(&e))?.size,
        None => panda_like(args.jaw),
    };
    let found = affordances(world, room, &jaw);
    for a in &found {
        say!("{} ({})", a.id, a.label)?;
        for (name, verdict) in [("grasp", &a.grasp), ("sit", &a.sit), ("place", &a.place)] {
            let mark = if verdict.possible { "yes" } else { "no " };
            say!("  {name:6} {mark}  {}", verdict.because)?;
        }
        for part in &a.open {
            let unit = if part.kind == "slide" { "m" } else { "rad" };
            let meets = part.meets.as_ref().map_or_else(String::new, |m| format!(", then meets {m}"));
            say!("  open   {}  {} {:.2} of {:.2} {unit}{meets}", part.part, part.kind, part.free, part.range)?;
        }
        if let Some(why) = &a.rigid {
            say!("  open   no   {why}")?;
        }
    }
    let generator = concat!("HARMONY ", env!("CARGO_PKG_VERSION")).to_owned();
    let path = out.join("affordances.json");
    write_json(&path, &ReportFile { generator, jaw, objects: &found })?;
    say!("{}", path.display())
}
