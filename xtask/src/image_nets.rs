//! Parity and speed of SAM 2, CLIP, OWLv2 and LPIPS at full size; see [`crate::parity`] for the rest.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, ensure};

use crate::parity::{cache, checked, in_turn, python};

/// Packages beside those of the VGGT comparison.
/// Pillow 13 resizes along y first in some cases.
const PACKAGES: [&str; 6] = ["transformers", "lpips", "scipy", "pillow==12.0.0", "hydra-core", "iopath"];

/// A network: its name for the example, the script, and the script's words for it.
const NETS: [(&str, &str, &[&str]); 8] = [
    ("sam2_tiny", "sam2.py", &["tiny"]),
    ("sam2_small", "sam2.py", &["small"]),
    ("sam2_base_plus", "sam2.py", &["base_plus"]),
    ("sam2_large", "sam2.py", &["large"]),
    ("clip", "clip.py", &[]),
    ("owlv2_base", "owlv2.py", &["base"]),
    ("owlv2_large", "owlv2.py", &["large"]),
    ("lpips", "lpips_nets.py", &[]),
];

/// Networks whose time is compared.
const TIMED: [&str; 3] = ["sam2_large", "clip", "owlv2_base"];

const FEATURES: &str = "sam2,clip,detector,lpips";

/// Runs the comparison, then `rounds` timings of each side in turn.
pub fn run(rounds: usize) -> Result<()> {
    let cache = cache()?;
    let python = python(&cache)?;
    let ready = cache.join("parity/ready-images");
    let wanted = PACKAGES.join("\n");
    if std::fs::read_to_string(&ready).ok().as_deref() != Some(wanted.as_str()) {
        checked(Command::new(&python).args(["-m", "pip", "install", "--quiet"]).args(PACKAGES))?;
        std::fs::write(&ready, wanted)?;
    }
    let sam2 = std::env::var_os("HARMONY_SAM2").map_or_else(|| cache.join("sam2"), PathBuf::from);
    ensure!(
        sam2.join("sam2/build_sam.py").is_file(),
        "no checkout of facebookresearch/sam2; clone it and name it by HARMONY_SAM2: {}",
        sam2.display()
    );
    let scripts = crate::root().join("crates/harmony-nets/tests/parity");
    let theirs = |script: &str| {
        let mut command = Command::new(&python);
        command.args(["-W", "ignore", script]).current_dir(&scripts).env("SAM2_REPO", &sam2);
        command
    };
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let example = ["--release", "-p", "harmony-nets", "--features", FEATURES, "--example", "image_nets"];
    let ours = |mode: &str, net: &str, folder: &Path| {
        let mut command = Command::new(&cargo);
        command.args(["run", "--quiet"]).args(example).args(["--", mode, net]).arg(folder);
        command
    };
    println!("| network | output | values | worst element | of the largest | relative L2 |\n|---|---|---|---|---|---|");
    let mut failed = Vec::new();
    for (net, script, words) in NETS {
        let folder = cache.join("parity-data").join(net);
        let done = folder.join("done");
        if !done.is_file() {
            checked(theirs(script).arg("full").args(words).arg(&folder))?;
            std::fs::write(&done, "")?;
        }
        if checked(&mut ours("parity", net, &folder)).is_err() {
            failed.push(net);
        }
    }
    for (net, script, words) in NETS.into_iter().filter(|(net, ..)| rounds > 0 && TIMED.contains(net)) {
        let folder = cache.join("parity-data").join(net);
        println!("{net}:");
        let (mut ours, mut theirs) = (ours("turns", net, &folder), theirs(script));
        in_turn(rounds, ours.env("RAYON_NUM_THREADS", "2"), theirs.arg("turns").args(words).arg(&folder))?;
    }
    ensure!(failed.is_empty(), "further apart than allowed: {failed:?}");
    Ok(())
}
