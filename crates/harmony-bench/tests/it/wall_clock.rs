//! A run of 30 objects takes little longer than its calls allow. The clock is stopped (Tokio's `start_paused`): what is

//! measured is the order of calls alone, the same on every machine.

use harmony_bench::wall_clock::{Pace, Played, play};
use harmony_players::flat_cast;

/// Thirty objects: wall, furniture, ceiling, decoration. The proportions are near those of the recorded rooms in
/// `examples/`, with one lamp more under the ceiling: ceiling objects fill the gap before the decorations, and a room
/// without any comes to 1.24 (`docs/performance.md`, "The wall clock").
const ROOM: [usize; 4] = [6, 10, 2, 12];

async fn played(pace: Pace) -> Played {
    let out = tempfile::tempdir().unwrap();
    let played = play(ROOM, pace, &flat_cast(), out.path()).await.unwrap();
    assert_eq!(played.failure, None);
    assert_eq!(played.work[&harmony_roles::Role::MeshGenerator].0, 30, "every object is meshed once");
    played
}

#[tokio::test(start_paused = true)]
async fn thirty_objects_take_at_most_1_15_times_the_lower_bound_and_a_third_of_one_call_after_another() {
    let pace = Pace::like_real(1.0, 2);
    let run = played(pace).await;
    // The longest chain: the same run with as many places as anybody may want.
    let free = Pace { questions_at_once: 0, edits_at_once: 0, meshes_at_once: 0, ..pace };
    let longest_chain = played(free).await.elapsed;
    let bound = longest_chain.max(run.busiest(&pace));
    let ratio = run.elapsed.as_secs_f64() / bound.as_secs_f64();
    assert!(ratio <= 1.15, "{:?} is {ratio:.3} times the lower bound {bound:?}", run.elapsed);
    let gain = run.in_a_row().as_secs_f64() / run.elapsed.as_secs_f64();
    assert!(gain >= 3.0, "{:?} against {:?} in a row: {gain:.2} times", run.elapsed, run.in_a_row());
}

#[tokio::test(start_paused = true)]
async fn with_four_meshes_at_a_time_it_takes_a_fifth_of_one_call_after_another() {
    let run = played(Pace::like_real(1.0, 4)).await;
    let in_a_row = played(Pace { in_a_row: true, ..Pace::like_real(1.0, 4) }).await;
    assert_eq!(run.work, in_a_row.work, "the same calls");
    assert_eq!(in_a_row.elapsed.as_secs(), in_a_row.in_a_row().as_secs(), "one after another, without a pause");
    let gain = in_a_row.elapsed.as_secs_f64() / run.elapsed.as_secs_f64();
    assert!(gain >= 5.0, "{:?} against {:?} in a row: {gain:.2} times", run.elapsed, in_a_row.elapsed);
}

/// Twenty objects, four meshes at a time, which is what the profile `hosted` asks for.
#[tokio::test(start_paused = true)]
async fn twenty_objects_take_less_than_six_minutes_at_usual_latencies() {
    let out = tempfile::tempdir().unwrap();
    let played = play([4, 7, 1, 8], Pace::like_real(1.0, 4), &flat_cast(), out.path()).await.unwrap();
    assert_eq!(played.failure, None);
    assert_eq!(played.work[&harmony_roles::Role::MeshGenerator].0, 20);
    assert!(played.elapsed.as_secs() < 360, "{:?}", played.elapsed);
}
