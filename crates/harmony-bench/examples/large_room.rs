//! What everything of ours takes for a room with 25 objects of 80,000 faces:
//! `cargo run --release -p harmony-bench --example large_room -- [--room FOLDER] [--faces 80000] [--out FOLDER] [--keep]`
//!
//! Without a folder, a room with 25 objects in view is generated first. The oracle plays all roles at level `real`, its
//! meshes cut finer and textured; lighting is asked of this program's own rules, and nothing is path-traced. What the
//! oracle's answers cost is measured by themselves: it is no part of the program. `--faces 0` leaves meshes as they are.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example that prints a table")]

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use harmony_bench::generate::{GeneratorSettings, generate, write};
use harmony_bench::oracle::{NoiseLevel, Oracle};
use harmony_bench::run::Play;
use harmony_bench::spent::{peak_mib, processor_seconds};
use harmony_bench::truth::TruthRoom;
use harmony_pipeline::{Phase, ProgressEvent, ProgressSink, Settings};

/// Objects of the generated room, and the first seed that shows them all.
const OBJECTS: usize = 25;
const SEED: u64 = 1;

fn main() {
    let given = |name: &str| std::env::args().skip_while(|a| a != name).nth(1);
    let faces: usize = given("--faces").map_or(80_000, |text| text.parse().expect("--faces takes a number"));
    let out = given("--out").map_or_else(|| std::env::temp_dir().join("harmony_large_room"), PathBuf::from);
    let room = given("--room").map_or_else(|| generated(&out), PathBuf::from);
    let truth = TruthRoom::load(&room).unwrap();
    let oracle = Oracle::new(truth.clone(), NoiseLevel::Real.noise(), 1, true);
    let oracle = Arc::new(if faces > 0 { oracle.with_faces(faces) } else { oracle });
    println!("{}: {} objects in view, meshes of {faces} faces", truth.name, truth.visible().count());

    let play = Play {
        path_tracer: false,
        truth: &truth,
        oracle: Arc::clone(&oracle),
        settings: Settings::default(),
        until: Phase::Lighting,
        profile: format!("oracle, {faces} faces"),
        further_inputs: faces.to_string(),
    };
    let begun = Instant::now();
    let clock = move || (begun.elapsed().as_secs_f64(), processor_seconds().unwrap_or(f64::NAN));
    let (start, before) = (clock(), oracle.spent());
    // When each step began.
    let steps: Arc<Mutex<Vec<(String, f64, f64)>>> = Arc::default();
    let listener = Arc::clone(&steps);
    let progress: ProgressSink = Arc::new(move |event| {
        let text = match event {
            ProgressEvent::Step { phase, text } => format!("{phase}: {text}"),
            ProgressEvent::PhaseDone { phase, .. } => format!("{phase} done"),
            _ => return,
        };
        let (wall, processor) = clock();
        listener.lock().unwrap().push((text, wall, processor));
    });
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().thread_stack_size(8 << 20).build().unwrap();
    let outcome = runtime.block_on(Box::pin(play.run(&out.join("run"), &harmony_players::flat_cast(), &progress)));
    let outcome = outcome.unwrap();
    let (end, after) = (clock(), oracle.spent());
    if let Some(failure) = &outcome.failure {
        println!("FAILED in {failure}");
    }

    println!("    wall  processor, seconds since the start");
    for (text, wall, processor) in steps.lock().unwrap().iter() {
        println!("{wall:>8.2} {:>8.2}  {text}", processor - start.1);
    }
    let (wall, processor) = (end.0 - start.0, end.1 - start.1);
    let (their_wall, theirs) = (after.wall - before.wall, after.processor - before.processor);
    println!("{wall:>8.2} {processor:>8.2}  all, {} objects placed", outcome.file.objects);
    println!("{their_wall:>8.2} {theirs:>8.2}  of it the players' answers");
    println!("{:>8.2} {:>8.2}  ours", wall - their_wall, processor - theirs);
    println!("{:>8.0} MiB at most, the room's truth and the players included", peak_mib().unwrap_or(f64::NAN));
    if !std::env::args().any(|a| a == "--keep") {
        std::fs::remove_dir_all(out.join("run")).unwrap();
    }
}

/// A room that shows all its 25 objects.
fn generated(out: &Path) -> PathBuf {
    let settings = GeneratorSettings { min_objects: OBJECTS, max_objects: OBJECTS, ..GeneratorSettings::default() };
    let seen = |seed: u64| {
        let room = generate(seed, &settings);
        let folder = out.join(&room.name);
        let all = room.objects.iter().filter(|o| o.visible_pixels > 100).count() == OBJECTS;
        all.then(|| {
            write(&room, &folder).unwrap();
            folder
        })
    };
    std::fs::create_dir_all(out).unwrap();
    (SEED..).find_map(seen).expect("some seed shows all objects")
}
