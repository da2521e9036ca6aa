//! How near a run comes to what its calls allow: `cargo run --release -p harmony-bench --example wall_clock`.
//!
//! A made-up room of 30 objects, players with latencies like the real ones (8 s a question, 12 s an edit, 45 s a mesh).
//! By default the clock is stopped: waits are counted, not waited, and computing counts as none. `--real 20` runs
//! everything 20 times faster under the real clock, computing included; `--rooms 1` takes the first room only. The
//! first line tells what a call costs by itself.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example that prints a table")]

use std::time::Duration;

use harmony_bench::wall_clock::{Pace, Played, overhead, play};
use harmony_calls::Cast;
use harmony_players::flat_cast;
use harmony_roles::Role;

/// Objects on walls, furniture, ceiling, decorations: the room of the test, and others.
const ROOMS: [(&str, [usize; 4]); 6] = [
    ("two ceiling lamps", [6, 10, 2, 12]),
    ("much on the walls", [12, 10, 2, 6]),
    ("much decoration", [4, 8, 2, 16]),
    ("one ceiling lamp", [6, 12, 1, 11]),
    ("no ceiling lamp", [5, 12, 0, 13]),
    ("twenty objects", [4, 7, 1, 8]),
];

fn main() {
    let given = |name: &str| std::env::args().skip_while(|a| a != name).nth(1);
    let real: Option<f64> = given("--real").map(|text| text.parse().expect("--real takes a number"));
    let rooms: usize = given("--rooms").map_or(ROOMS.len(), |text| text.parse().expect("--rooms takes a number"));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .start_paused(real.is_none())
        .build()
        .expect("a runtime can be made");
    let offline = flat_cast();
    let faster = real.unwrap_or(1.0);
    tell_overhead(&offline);
    println!("lower bound = the larger of the longest chain (all players unlimited) and the busiest player's work");
    println!(
        "divided by its places; times in seconds of the {} clock\n",
        if real.is_some() { "real" } else { "stopped" }
    );
    println!(
        "{:18} {:>14} {:>6} {:>10} {:>8} {:>9} {:>9} {:>9} {:>6} {:>8} {:>6}",
        "room", "w/f/c/d", "meshes", "questions", "edits", "chain", "bound", "run", "ratio", "in a row", "gain"
    );
    for (name, counts) in ROOMS.iter().take(rooms) {
        for meshes in [2, 4] {
            let pace = Pace::like_real(faster, meshes);
            let free = Pace { questions_at_once: 0, edits_at_once: 0, meshes_at_once: 0, ..pace };
            let chain = run(&runtime, *counts, free, &offline).elapsed;
            let played = run(&runtime, *counts, pace, &offline);
            // Under the real clock the sum stands for the run, which would take as long.
            let in_a_row = if real.is_some() {
                played.in_a_row()
            } else {
                run(&runtime, *counts, Pace { in_a_row: true, ..pace }, &offline).elapsed
            };
            let bound = chain.max(played.busiest(&pace));
            let seconds = Duration::as_secs_f64;
            let calls = |role| played.work.get(&role).map_or(0, |(n, _)| *n);
            println!(
                "{name:18} {:>14} {meshes:>6} {:>10} {:>8} {:>9.1} {:>9.1} {:>9.1} {:>6.3} {:>8.1} {:>6.2}",
                counts.map(|n| n.to_string()).join("/"),
                calls(Role::VisionLanguage),
                calls(Role::ImageEditor),
                seconds(&chain),
                seconds(&bound),
                seconds(&played.elapsed),
                seconds(&played.elapsed) / seconds(&bound),
                seconds(&in_a_row),
                seconds(&in_a_row) / seconds(&played.elapsed),
            );
        }
    }
}

/// What a call costs by itself.
fn tell_overhead(offline: &Cast) {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().expect("a runtime can be made");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("calls");
    std::fs::create_dir_all(&out).unwrap();
    let cost = runtime.block_on(overhead(2000, offline, &out)).unwrap();
    println!(
        "2000 questions to a player that takes no time, one place: from one answer to the next question {:.3} ms \
         (median, scheduling alone), {:.3} ms a call with its record written and read back",
        cost.handover.as_secs_f64() * 1e3,
        cost.whole.as_secs_f64() * 1e3,
    );
    println!();
}

fn run(runtime: &tokio::runtime::Runtime, counts: [usize; 4], pace: Pace, offline: &Cast) -> Played {
    let out = tempfile::tempdir().unwrap();
    let played = runtime.block_on(play(counts, pace, offline, out.path())).unwrap();
    if let Some(failure) = &played.failure {
        println!("FAILED: {failure}");
    }
    played
}
