//! The order of panels and trials, in Rust, in the page's JavaScript and by an independent program.

use std::io::Write as _;
use std::process::{Command, Stdio};

use harmony_study::shuffle::{panel_order, trial_order};
use serde_json::{Value, json};

fn ours(row: &Value) -> Vec<usize> {
    let text = |key: &str| row[key].as_str().unwrap();
    let count = row["count"].as_u64().unwrap() as usize;
    match row["trial"].as_str() {
        Some(trial) => panel_order(text("study"), text("participant"), trial, count),
        None => trial_order(text("study"), text("participant"), count),
    }
}

#[test]
fn the_orders_are_those_of_an_independent_program() {
    let rows: Vec<Value> = serde_json::from_str(include_str!("../vectors/shuffle.json")).unwrap();
    assert_eq!(rows.len(), 3 * 4 * (3 * 3 + 3));
    for row in rows {
        let expected: Vec<usize> = serde_json::from_value(row["order"].clone()).unwrap();
        assert_eq!(ours(&row), expected, "{row}");
    }
}

#[test]
fn the_page_has_the_same_orders() {
    if Command::new("node").arg("--version").output().is_err() {
        return harmony_testing::skip("node is not installed");
    }
    let mut rows = Vec::new();
    for i in 0..1500 {
        let study = ["s", "harmony", "a-1"][i % 3];
        let participant = format!("p{i}-ä");
        let trial = if i % 5 == 0 { Value::Null } else { json!(format!("{:016x}", i * 7919)) };
        rows.push(json!({ "study": study, "participant": participant, "trial": trial, "count": 1 + i % 9 }));
    }
    let script = format!(
        "const s = require({:?}); const rows = JSON.parse(require('fs').readFileSync(0, 'utf8'));
         console.log(JSON.stringify(rows.map((r) => r.trial === null
           ? s.trialOrder(r.study, r.participant, r.count) : s.panelOrder(r.study, r.participant, r.trial, r.count))));",
        // Of the checkout that is tested: checkouts may share a folder of builds.
        std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").to_owned()) + "/assets/shuffle.js"
    );
    let mut child =
        Command::new("node").args(["-e", &script]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(serde_json::to_string(&rows).unwrap().as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    let theirs: Vec<Vec<usize>> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(theirs.len(), rows.len());
    for (row, theirs) in rows.iter().zip(theirs) {
        assert_eq!(ours(row), theirs, "{row}");
    }
}
