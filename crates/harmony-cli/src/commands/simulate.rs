//! `harmony simulate`: does the scene of a run stand, and what does an earthquake do to it?

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use harmony_export::animation::Animation;
use harmony_export::{Format, Options, World, export};
use harmony_io::{ReadLimits, read_bounded, read_glb, scene_for_light, write_atomic, write_json};
use harmony_lighting::CyclesRenderer;
use harmony_physics::pictures::{FILM_STEP, Lit, Painter, gif_bytes, mp4_bytes, sheet, sheet_frames};
use harmony_physics::{
    Bodies, BodySettings, Motion, Plausibility, Quake, Repaired, RunScene, Settled, Shaken, animate, bodies, ground,
    places, plausibility, quake, repair, settle, shake,
};
use harmony_pipeline::{PlausibilityRow, RunFile};
use harmony_render::canonical_camera;
use harmony_scene::{Camera, ImageSize, Surface};
use image::RgbImage;
use serde::Serialize;

use crate::display::hinted;
use crate::{EXIT_OK, say, tell};

/// From where the earthquake is filmed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum View {
    /// The photo's camera.
    Input,
    /// From above, near walls and ceiling removed.
    Canonical,
}

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony simulate run --settle
  harmony simulate run --repair
  harmony simulate run --earthquake --intensity 7")]
#[expect(clippy::struct_excessive_bools, reason = "switches of a command line")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Let the scene stand for five seconds and tell what moved (the default when nothing else is asked).
    #[arg(long)]
    settle: bool,
    /// Move what does not stand by as little as makes it stand, and tell what was moved.
    #[arg(long)]
    repair: bool,
    /// Shake the room.
    #[arg(long)]
    earthquake: bool,
    /// Modified Mercalli intensity, 1 to 12; 8 has a peak ground acceleration of 0.44 g.
    #[arg(long, default_value_t = ground::USUAL_INTENSITY)]
    intensity: f64,
    /// How long it shakes, seconds.
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Another seed is another earthquake of the same intensity.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// From where it is filmed.
    #[arg(long, value_enum, default_value = "input")]
    camera: View,
    /// Longest side of the film, pixels.
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(64..=1920))]
    size: u32,
    /// Path-trace the six frames with the scene's own light (needs Blender; about a minute a frame).
    #[arg(long)]
    lit: bool,
    /// Samples a pixel with --lit.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=1024))]
    samples: u32,
    /// Folder of the results; default `<run>/7_world`.
    #[arg(long, short)]
    out: Option<PathBuf>,
}

/// `settle.json`.
#[derive(Serialize)]
struct SettleFile<'a> {
    generator: String,
    plausibility: &'a Plausibility,
    settled: &'a Settled,
    #[serde(skip_serializing_if = "Option::is_none")]
    repaired: Option<&'a Repaired>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plausibility_repaired: Option<&'a Plausibility>,
}

/// Runs the command.
///
/// # Errors
/// A run without a scene, an impossible earthquake, or an unwritable file.
pub fn run(args: &Args) -> Result<u8> {
    let quake = Quake { intensity: args.intensity, seconds: args.seconds, seed: args.seed };
    if args.earthquake {
        quake.check()?;
    } else if args.lit {
        bail!("--lit is for the frames of an earthquake; add --earthquake");
    }
    let renderer = if args.lit { Some(blender()?) } else { None };
    let loaded = RunScene::read(&args.run).map_err(|e| hinted(e.to_string(), e.hint()))?;
    if loaded.scene.objects.is_empty() {
        bail!("there is no object in this scene: {}", args.run.display());
    }
    let out = args.out.clone().unwrap_or_else(|| args.run.join("7_world"));
    let cache = out.join("hulls");
    std::fs::create_dir_all(&cache).with_context(|| format!("cannot make the folder {}", cache.display()))?;
    let started = Instant::now();
    let made = bodies(&loaded.scene, &loaded.meshes, &BodySettings { cache: Some(cache) })
        .map_err(|e| hinted(e.to_string(), Some(e.hint())))?;
    write_json(&out.join("bodies.json"), &made)?;
    let hulls: usize = made.objects.iter().map(|b| b.hulls.len()).sum();
    say!("{} bodies of {hulls} convex pieces in {:.1} s", made.objects.len(), started.elapsed().as_secs_f64())?;
    if args.settle || args.repair || !args.earthquake {
        settle_run(args, &loaded, &made, &out)?;
    }
    if args.earthquake {
        let mut loaded = loaded;
        shake_run(args, &quake, &mut loaded, &made, renderer.as_ref(), &out)?;
    }
    Ok(EXIT_OK)
}

/// Blender, for pictures with `--lit`.
pub(super) fn blender() -> Result<CyclesRenderer> {
    let (found, why) = CyclesRenderer::find_saying_why();
    found.ok_or_else(|| {
        hinted(
            format!("--lit needs Blender, and none was found ({})", why.join("; ")),
            Some("harmony doctor tells how to install it"),
        )
    })
}

fn settle_run(args: &Args, loaded: &RunScene, made: &Bodies, out: &Path) -> Result<()> {
    let scene = &loaded.scene;
    let start = places(scene);
    let settled = settle(scene, made, &start);
    let table = plausibility(scene, made, &start, &settled);
    print_objects(made, &settled)?;
    print_table(&table)?;
    let repaired = args.repair.then(|| repair(scene, made, &start, &settled));
    let mut after_table = None;
    if let Some(repaired) = &repaired {
        for r in &repaired.repairs {
            say!("  {:24} moved {:.1} cm: {}", r.id, 100.0 * r.moved_m, r.reasons.join("; "))?;
        }
        for u in &repaired.unrepaired {
            say!("  {:24} NOT STABLE: {}", u.id, u.reason)?;
        }
        let (stable, count) = repaired.after.stable();
        say!("after the repair {stable} of {count} objects are stable; {} were moved", repaired.repairs.len())?;
        let mut moved = scene.clone();
        repaired.apply(&mut moved);
        let places_after = places(&moved);
        after_table = Some(plausibility(&moved, made, &places_after, &repaired.after));
        write_json(&out.join("scene_repaired.json"), &moved)?;
    }
    let file = SettleFile {
        generator: generator(),
        plausibility: &table,
        settled: &settled,
        repaired: repaired.as_ref(),
        plausibility_repaired: after_table.as_ref(),
    };
    let path = out.join("settle.json");
    write_json(&path, &file)?;
    let rows: Vec<PlausibilityRow> = table
        .rows()
        .into_iter()
        .map(|(what, value, good)| PlausibilityRow { what: what.to_owned(), value, good })
        .collect();
    RunFile::keep_plausibility(&args.run, &rows).context("the table cannot be kept in run.json and report.html")?;
    say!("{}", path.display())
}

fn generator() -> String {
    concat!("HARMONY ", env!("CARGO_PKG_VERSION")).to_owned()
}

fn print_objects(made: &Bodies, settled: &Settled) -> Result<()> {
    say!(
        "  {:24} {:>8} {:>5} {:>6} {:>7} {:>7} {:>8} {:>7}  state",
        "object",
        "kg",
        "hulls",
        "fit cm",
        "in cm",
        "gap cm",
        "drift cm",
        "tilt"
    )?;
    for (o, body) in settled.objects.iter().zip(&made.objects) {
        let state = match (o.motion, o.exploded, o.stable) {
            (Motion::Static, ..) => "fixed".to_owned(),
            (_, true, _) => "EXPLODED".to_owned(),
            (_, _, true) if o.support_right => "stable".to_owned(),
            (_, _, true) => format!("stable, but does not touch {}", o.support),
            _ => "UNSTABLE".to_owned(),
        };
        let gap = o.gap_m.map_or_else(|| "-".to_owned(), |g| format!("{:.1}", 100.0 * g));
        say!(
            "  {:24} {:>8.2} {:>5} {:>6.1} {:>7.1} {gap:>7} {:>8.2} {:>6.1}°  {state}",
            o.id,
            o.mass_kg,
            o.hulls,
            100.0 * o.fit_m,
            100.0 * o.penetration_m,
            100.0 * o.drift_m,
            o.tilt_deg
        )?;
        for note in &body.notes {
            tell!("    {}: {note}", o.id);
        }
    }
    Ok(())
}

fn print_table(table: &Plausibility) -> Result<()> {
    for (name, value, good) in table.rows() {
        say!("  {name:34} {value:32} {}", if good { "ok" } else { "-" })?;
    }
    for door in table.doors.iter().filter(|d| !d.free) {
        say!("  {:34} cannot swing open: {}", door.door, door.blocked_by.join(", "))?;
    }
    Ok(())
}

fn shake_run(
    args: &Args,
    quake: &Quake,
    loaded: &mut RunScene,
    made: &Bodies,
    renderer: Option<&CyclesRenderer>,
    out: &Path,
) -> Result<()> {
    let started = Instant::now();
    let shaken = shake(&loaded.scene, made, quake)?;
    say!(
        "{} s of intensity {} (peak ground acceleration {:.2} g) in {:.1} s",
        quake.seconds,
        quake.intensity,
        shaken.peak_acceleration / 9.81,
        started.elapsed().as_secs_f64()
    )?;
    print_shaken(&shaken)?;
    write_json(&out.join("earthquake.json"), &shaken)?;
    let bytes = read_bounded(&args.run.join("scene_full.glb"), ReadLimits::default().bytes)?;
    let animated = animate::animated_glb(&bytes, &shaken).map_err(|e| hinted(e.to_string(), Some(e.hint())))?;
    write_atomic(&out.join("earthquake.glb"), &animated)?;
    stage(args, &shaken, out)?;
    let glb = read_glb(&bytes, &ReadLimits::default())?;
    let (camera, omit) = view(args, loaded);
    let painter = Painter::new(&glb, &shaken, camera, &omit);
    let film: Vec<RgbImage> = (0..shaken.frames()).step_by(FILM_STEP).map(|f| painter.frame(f)).collect();
    let rate = quake::FRAMES_PER_SECOND as f64 / FILM_STEP as f64;
    write_atomic(&out.join("earthquake.gif"), &gif_bytes(&film, rate)?)?;
    match mp4_bytes(&film, rate)? {
        Some(bytes) => write_atomic(&out.join("earthquake.mp4"), &bytes)?,
        None => tell!("no ffmpeg with H.264 here: earthquake.gif is the film"),
    }
    drop(film);
    let numbers = sheet_frames(shaken.frames());
    let frames: Vec<RgbImage> = numbers.iter().map(|f| painter.frame(*f)).collect();
    write_frames(out, "frame", "sheet.jpg", &frames)?;
    if let Some(renderer) = renderer {
        let albedo = harmony_io::albedo_field(&args.run);
        let kept = Some(args.run.join("7_world/lit"));
        let lit = Lit { renderer, scene: &loaded.scene, albedo, samples: args.samples, kept };
        let scene_for_light = read_bounded(&scene_for_light(&args.run), ReadLimits::default().bytes)?;
        let mut traced = Vec::new();
        for (k, f) in numbers.iter().enumerate() {
            tell!("path-tracing frame {} of {}", k + 1, numbers.len());
            traced.push(lit.frame(&scene_for_light, &shaken, *f, camera)?);
        }
        write_frames(out, "frame_lit", "sheet_lit.jpg", &traced)?;
    }
    say!("{}", out.display())
}

/// `usd/scene.usda` and over it `usd/earthquake.usda` with time samples.
fn stage(args: &Args, shaken: &Shaken, out: &Path) -> Result<()> {
    let world = World::read(&args.run).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let options = Options { cache: Some(out.join("hulls")), ..Options::default() };
    export(&world, &[Format::Usd], out, &options).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let layer = Animation::of_earthquake(&world, shaken).layer(&world);
    Ok(write_atomic(&out.join("usd/earthquake.usda"), layer.as_bytes())?)
}

fn view(args: &Args, loaded: &RunScene) -> (Camera, Vec<Surface>) {
    let photo = Camera::from(&loaded.scene.camera);
    match args.camera {
        View::Input => {
            let k = f64::from(args.size) / f64::from(photo.size.width.max(photo.size.height));
            let side = |v: u32| ((f64::from(v) * k / 2.0).round() as u32 * 2).max(2);
            (photo.resized(ImageSize::new(side(photo.size.width), side(photo.size.height))), Vec::new())
        }
        View::Canonical => {
            let view = canonical_camera(
                &loaded.scene.room,
                ImageSize::new(args.size, args.size * 3 / 4),
                &photo,
                &loaded.scene.stands(),
            );
            (view.camera, view.omit)
        }
    }
}

/// Numbered frames and a sheet of them.
pub(super) fn write_frames(out: &Path, name: &str, sheet_name: &str, frames: &[RgbImage]) -> Result<()> {
    for (k, frame) in frames.iter().enumerate() {
        harmony_io::picture::write_rgb_png(&out.join(format!("{name}_{}.png", k + 1)), frame)?;
    }
    let jpeg = harmony_io::picture::rgb_jpeg(&sheet(frames), 88)?;
    Ok(write_atomic(&out.join(sheet_name), &jpeg)?)
}

fn print_shaken(shaken: &Shaken) -> Result<()> {
    say!("  {:24} {:>8} {:>12} {:>9} {:>7}  state", "object", "kg", "farthest cm", "moved cm", "tilt")?;
    for o in shaken.objects.iter().filter(|o| o.motion == Motion::Dynamic) {
        let state = match (o.toppled, o.fallen, o.moved_m > 0.05) {
            (true, true, _) => "fell and lies",
            (true, ..) => "toppled",
            (_, true, _) => "fell",
            (.., true) => "slid",
            _ => "stands",
        };
        say!(
            "  {:24} {:>8.2} {:>12.1} {:>9.1} {:>6.0}°  {state}",
            o.id,
            o.mass_kg,
            100.0 * o.farthest_m,
            100.0 * o.moved_m,
            o.tilt_deg
        )?;
    }
    Ok(())
}
