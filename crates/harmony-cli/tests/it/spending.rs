//! Budgets, interrupts, estimates and bills as a person meets them.

#![cfg(unix)]
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{harmony, program, said};

const PHOTO: &str = "examples/home_office.jpg";

fn config(folder: &Path, text: &str) -> String {
    let path = folder.join("harmony.toml");
    fs::write(&path, format!("[settings]\nworking_px = 256\n{text}")).unwrap();
    path.to_str().unwrap().to_owned()
}

fn phase_state(run: &Path, phase: &str) -> serde_json::Value {
    let file: serde_json::Value = serde_json::from_slice(&fs::read(run.join("run.json")).unwrap()).unwrap();
    file["phases"][phase].clone()
}

#[test]
fn a_budget_stops_the_run_with_exit_code_4_and_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let config = config(folder.path(), "");
    let args = ["reconstruct", PHOTO, "--until", "layout", "--config", &config, "--out", run.to_str().unwrap()];
    let stopped = harmony(&[&args[..], &["--profile", "files", "--max-calls", "0"]].concat());
    assert_eq!(stopped.status.code(), Some(4), "{}", said(&stopped));
    assert!(said(&stopped).contains("budget reached: all 0 calls are made"), "{}", said(&stopped));
    assert!(said(&stopped).contains("hint: raise [budget]"), "{}", said(&stopped));
    assert_eq!(phase_state(&run, "1_layout")["state"], "failed");
    assert!(!run.join("questions").exists(), "nobody was asked");

    let alone = harmony(&[&args[..], &["--profile", "offline"]].concat());
    assert!(alone.status.success(), "{}", said(&alone));
    let bill = harmony(&["bill", run.to_str().unwrap(), "--json"]);
    let bill: serde_json::Value = serde_json::from_slice(&bill.stdout).unwrap();
    assert_eq!(bill["total"]["calls"], bill["total"]["offline"], "{bill}");
    let table = harmony(&["bill", run.to_str().unwrap(), "--objects"]);
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.contains("1_layout") && table.contains("vision_language") && table.contains("(shared)"), "{table}");
    let kept: serde_json::Value = serde_json::from_slice(&fs::read(run.join("bill.json")).unwrap()).unwrap();
    assert_eq!(kept["total"]["calls"], bill["total"]["calls"]);
}

#[test]
fn an_interrupt_ends_the_run_cleanly_and_the_same_command_can_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let config = config(folder.path(), "[budget]\ngrace_seconds = 0.2\n");
    let mut child = program()
        .args(["reconstruct", PHOTO, "--until", "layout", "--profile", "files", "--config", &config, "--out"])
        .arg(&run)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let clock = Instant::now();
    while !run.join("questions/001_1_layout__layout").is_dir() {
        assert!(clock.elapsed() < Duration::from_mins(2) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(4), "{}", said(&output));
    assert!(said(&output).contains("stopped: interrupted"), "{}", said(&output));
    let account = run.join("calls/.unanswered/vision_language/1_layout.layout.json");
    assert!(account.is_file(), "the question that was in flight is on the account");
    let bill = harmony(&["bill", run.to_str().unwrap()]);
    assert!(String::from_utf8_lossy(&bill.stdout).contains("1 calls were tried and not answered"));
}

#[test]
fn an_estimate_says_that_it_is_one_and_from_what_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(
        folder.path(),
        "[prices]\ndate = \"2026-11-01\"\n[prices.models.\"files\"]\ninput = 1.0\noutput = 10.0\n",
    );
    let output = harmony(&["estimate", PHOTO, "--profile", "files", "--config", &config]);
    assert!(output.status.success(), "{}", said(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("ESTIMATE") && text.contains("typical room of 16 objects"), "{text}");
    assert!(text.contains("prices of 2026-11-01") && text.contains("vision_language"), "{text}");
    let output = harmony(&["estimate", PHOTO, "--objects", "30", "--json"]);
    let estimate: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(estimate["usd"], 0.0, "this program alone costs nothing");
    assert!(estimate["inventory"]["source"].as_str().unwrap().contains("30 objects"));
    // A profile with hosted services is estimated without their keys: nobody is asked.
    let mut paper = program();
    paper.args(["estimate", PHOTO, "--profile", "paper"]).env_remove("OPENAI_API_KEY").env_remove("GEMINI_API_KEY");
    let output = paper.output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("openai / gpt-5.5") && text.contains("price not known"), "{text}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing but the configuration");
}
