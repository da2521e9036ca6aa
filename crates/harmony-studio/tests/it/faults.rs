//! A few of the runs with faults; all of them are in `docs/results/faults.md`.

use harmony_studio::soak::{SoakOptions, all};

#[tokio::test(flavor = "multi_thread")]
async fn runs_with_faults_end_well_and_pay_nothing_twice() {
    let options = SoakOptions { runs: 20, seed: 9001, jobs: 2, minutes: None, out: None, rows: None };
    let ended = all(&options, &|line| eprintln!("{line}")).await.unwrap();
    let wrong: Vec<_> = ended.iter().filter(|run| !run.wrong.is_empty()).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    // Runs without a fault would prove nothing, and so would runs that all break off.
    assert!(ended.iter().filter(|run| !run.faults.is_empty()).count() > 10);
    assert!(ended.iter().filter(|run| run.end.starts_with("scene")).count() > 10);
    assert!(ended.iter().all(|run| run.peak_mib < 2048), "memory stays bounded");
}
