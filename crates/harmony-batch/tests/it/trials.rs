//! Short forms of the trials; the long ones are commands, `docs/batch.md`.

use std::process::Command;

use crate::common::PROGRAM;

/// Runs a trial; `None` when PostgreSQL is missing.
fn trial(args: &[&str]) -> Option<String> {
    let made = Command::new(PROGRAM).args(args).output().unwrap();
    let said = String::from_utf8_lossy(&made.stdout).into_owned();
    if said.contains("PostgreSQL is not installed") {
        harmony_testing::skip("PostgreSQL is not installed");
        return None;
    }
    assert!(made.status.success(), "{args:?}: {said}{}", String::from_utf8_lossy(&made.stderr));
    Some(said)
}

#[test]
fn killed_workers_and_databases_lose_nothing_and_pay_nothing_twice() {
    trial(&[
        "kills",
        "--scenes",
        "16",
        "--workers",
        "3",
        "--objects",
        "3",
        "--speed",
        "60",
        "--worker-kills",
        "10",
        "--database-kills",
        "2",
        "--pause-ms",
        "250",
    ]);
}

#[test]
fn killed_workers_and_scenes_on_one_machine_end_in_the_same_scenes() {
    // Two kills of scenes: a third one of the same scene would set it aside, as it should.
    trial(&[
        "kills",
        "--scenes",
        "12",
        "--workers",
        "3",
        "--objects",
        "3",
        "--speed",
        "60",
        "--worker-kills",
        "6",
        "--database-kills",
        "0",
        "--scene-kills",
        "2",
        "--pause-ms",
        "250",
    ]);
}

#[test]
fn rates_and_places_hold_over_all_workers() {
    trial(&[
        "throughput",
        "--scenes",
        "6",
        "--workers",
        "3",
        "--objects",
        "2",
        "--speed",
        "30",
        "--mesh-places",
        "2",
        "--questions-a-minute",
        "10",
    ]);
}

#[test]
fn jobs_end_by_priority_with_a_bill_and_without_on_either_database() {
    trial(&["queue", "--jobs", "200"]);
    trial(&["queue", "--jobs", "200", "--postgres"]);
}
