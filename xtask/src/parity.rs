//! Parity of the networks at full size with their reference implementations, and speed in the same run.
//!
//! The reference code is not ours to keep: it is read from a checkout that the user names.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, bail, ensure};

/// Packages of the comparison's Python; the whole of torch, for it does not load without its CUDA libraries.
const PACKAGES: [&str; 6] =
    ["torch==2.11.0", "torchvision==0.26.0", "numpy", "safetensors", "einops", "huggingface_hub"];

/// Runs the comparison, then `rounds` timings of each side in turn.
pub fn run(rounds: usize) -> Result<()> {
    let cache = cache()?;
    let python = python(&cache)?;
    let reference = std::env::var_os("HARMONY_VGGT").map_or_else(|| cache.join("vggt"), PathBuf::from);
    ensure!(
        reference.join("vggt/models/vggt.py").is_file(),
        "no checkout of the VGGT authors' repository; clone facebookresearch/vggt and name it by HARMONY_VGGT: {}",
        reference.display()
    );
    let out = cache.join("parity-data");
    std::fs::create_dir_all(&out)?;
    let script = crate::root().join("crates/harmony-nets/tests/parity/make_vggt.py");
    let (weights, expected) = (out.join("vggt_full_weights.safetensors"), out.join("vggt_full_expected.safetensors"));
    if !expected.is_file() {
        checked(Command::new(&python).args(["-W", "ignore"]).arg(&script).arg("full").arg(&reference).arg(&out))?;
    }
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let example = ["--release", "-p", "harmony-nets", "--features", "vggt", "--example", "parity"];
    checked(Command::new(&cargo).arg("build").args(example))?;
    println!("| output | values | range | relative L2 | worst element |");
    println!("|---|---|---|---|---|");
    let ours = |mode: &str| {
        let mut command = Command::new(&cargo);
        command.args(["run", "--quiet"]).args(example).arg("--").arg(mode).arg(&weights).arg(&expected);
        command
    };
    checked(&mut ours("compare"))?;
    if rounds == 0 {
        return Ok(());
    }
    let mut theirs = Command::new(&python);
    theirs.args(["-W", "ignore"]).arg(&script).arg("time").arg(&reference).arg(&out).arg(rounds.to_string());
    let mut ours = ours("time");
    ours.env("RAYON_NUM_THREADS", "2");
    in_turn(rounds, &mut ours, &mut theirs)
}

/// Passes of both sides in turn, one line each.
pub(crate) fn in_turn(rounds: usize, ours: &mut Command, theirs: &mut Command) -> Result<()> {
    let mut sides = [Side::start(ours)?, Side::start(theirs)?];
    for round in 0..rounds {
        for side in &mut sides {
            println!("round {}: {}", round + 1, side.pass()?);
        }
    }
    Ok(())
}

/// A program that does one pass for each line it is given, and answers with one line.
struct Side {
    child: Child,
    answers: BufReader<std::process::ChildStdout>,
}

impl Side {
    fn start(command: &mut Command) -> Result<Self> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let answers = BufReader::new(child.stdout.take().context("no output")?);
        Ok(Self { child, answers })
    }

    fn pass(&mut self) -> Result<String> {
        self.child.stdin.as_mut().context("no input")?.write_all(b"\n")?;
        let mut line = String::new();
        ensure!(self.answers.read_line(&mut line)? > 0, "a side of the timing ended early");
        Ok(line.trim_end().to_owned())
    }
}

impl Drop for Side {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

pub(crate) fn cache() -> Result<PathBuf> {
    if let Some(path) = std::env::var_os("HARMONY_CACHE") {
        return Ok(path.into());
    }
    let home = std::env::var_os("HOME").context("neither HARMONY_CACHE nor HOME is set")?;
    Ok(PathBuf::from(home).join(".cache/harmony"))
}

/// Python with torch, in a folder of its own; made on first use.
pub(crate) fn python(cache: &Path) -> Result<PathBuf> {
    let folder = cache.join("parity");
    let python = folder.join("bin/python");
    let ready = folder.join("ready");
    if !ready.is_file() {
        checked(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
        checked(Command::new(&python).args(["-m", "pip", "install", "--quiet"]).args(PACKAGES))?;
        std::fs::write(&ready, PACKAGES.join("\n"))?;
    }
    Ok(python)
}

pub(crate) fn checked(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("{} does not start", command.get_program().display()))?;
    if !status.success() {
        bail!("{} ended with {status}", command.get_program().display());
    }
    Ok(())
}
