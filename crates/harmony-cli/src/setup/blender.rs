//! Blender's Python module, installed where the path tracer is looked for: a virtual environment in HARMONY's cache.
//!
//! The environment is made beside its place and renamed when Blender has started in it, so that whatever breaks leaves
//! nothing that looks finished.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result};
use harmony_lighting::{BPY_PYTHON, BPY_VERSION, BlenderKind, CyclesRenderer, bpy_folder, python_of};

use crate::display::hinted;
use crate::tell;

/// Size and licence, for who decides: measured with 5.0.1 on Linux.
pub const TERMS: &str = "Blender's Python module (bpy) makes lit, path-traced pictures and fits the light to the photo.\n\
     From PyPI, by the Blender Foundation: about 370 MB to fetch, 1 GB on disk.\n\
     Licence GPL-3.0 (https://www.blender.org/about/license/); it runs as a program of its own.";

/// Names under which a Python may be found.
const PYTHONS: [&str; 3] = ["python3.11", "python3", "python"];

/// What else gives a path tracer.
const OTHERWISE: &str = "or put a Blender of 4.2 or newer on PATH";

/// What will be done.
#[derive(Debug, PartialEq, Eq)]
pub struct Plan {
    python: &'static str,
    folder: PathBuf,
}

impl Plan {
    /// Finds the Python that the module is made for.
    ///
    /// # Errors
    /// There is none, or only others.
    pub fn new() -> Result<Self> {
        let found: Vec<(&str, String)> = PYTHONS.iter().filter_map(|name| Some((*name, version_of(name)?))).collect();
        chosen(&found).map(|python| Self { python, folder: bpy_folder() })
    }

    /// Where the environment grows.
    fn fresh(&self) -> PathBuf {
        self.folder.with_extension("new")
    }

    /// The commands that [`Self::run`] runs, words apart.
    fn commands(&self) -> [Vec<String>; 2] {
        let fresh = self.fresh();
        let words = |program: &Path, rest: &[&str]| {
            let program = program.display().to_string();
            std::iter::once(program).chain(rest.iter().map(|word| (*word).to_owned())).collect()
        };
        let module = format!("bpy=={BPY_VERSION}");
        [
            words(Path::new(self.python), &["-m", "venv", &fresh.display().to_string()]),
            words(&python_of(&fresh), &["-m", "pip", "install", "--disable-pip-version-check", &module, "numpy"]),
        ]
    }

    /// The same for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> = self.commands().iter().map(|words| words.join(" ")).collect();
        lines.push(format!("mv {} {}", self.fresh().display(), self.folder.display()));
        lines
    }

    /// Installs. What the commands say goes to stderr.
    ///
    /// # Errors
    /// A command that fails, a Blender that does not start; the environment that was there before stays.
    pub fn run(&self) -> Result<CyclesRenderer> {
        let fresh = self.fresh();
        removed(&fresh)?;
        let made = self.made(&fresh);
        if made.is_err() {
            removed(&fresh)?;
        }
        made?;
        removed(&self.folder)?;
        std::fs::rename(&fresh, &self.folder).with_context(|| format!("renaming {}", fresh.display()))?;
        started(&self.folder)
    }

    fn made(&self, fresh: &Path) -> Result<()> {
        if let Some(parent) = fresh.parent() {
            std::fs::create_dir_all(parent).with_context(|| format!("making {}", parent.display()))?;
        }
        let hints = [
            format!("on Debian and Ubuntu `apt install python{BPY_PYTHON}-venv` brings what is missing"),
            format!(
                "1 GB of disk and the way to PyPI are needed (HTTPS_PROXY, PIP_INDEX_URL); `harmony setup --blender` \
                 starts anew; {OTHERWISE}"
            ),
        ];
        for (words, hint) in self.commands().iter().zip(hints) {
            tell!("+ {}", words.join(" "));
            let mut command = Command::new(&words[0]);
            command.args(&words[1..]).stdin(Stdio::null()).stdout(std::io::stderr());
            let status = command.status().with_context(|| format!("starting {}", words[0]))?;
            if !status.success() {
                return Err(hinted(format!("`{}` failed ({status})", words.join(" ")), Some(hint)));
            }
        }
        started(fresh).map(|_| ())
    }
}

/// Removes a folder that may be there.
fn removed(folder: &Path) -> Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("removing {}", folder.display()))
        }
        _ => Ok(()),
    }
}

/// Starts the Blender of an environment.
fn started(venv: &Path) -> Result<CyclesRenderer> {
    let python = python_of(venv);
    CyclesRenderer::probe(&python, BlenderKind::Module).map_err(|reason| {
        // What the system lacks stands in the last line of the import's own words.
        let tried = Command::new(&python).args(["-c", "import bpy"]).stdin(Stdio::null()).output();
        let words = tried.map(|output| String::from_utf8_lossy(&output.stderr).trim().to_owned()).unwrap_or_default();
        let last = words.lines().last().map_or_else(String::new, |line| format!(": {line}"));
        let hint = format!("a library that it names is the system's to install, {OTHERWISE}");
        hinted(format!("Blender's module is installed and does not start: {reason}{last}"), Some(hint))
    })
}

/// `3.11`, of a Python that starts.
fn version_of(python: &str) -> Option<String> {
    let mut command = Command::new(python);
    command.args(["-c", "import sys; print('%d.%d' % sys.version_info[:2])"]).stdin(Stdio::null());
    let output = command.output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// The Python to take, of those found with their versions.
fn chosen(found: &[(&'static str, String)]) -> Result<&'static str> {
    if let Some((python, _)) = found.iter().find(|(_, version)| version == BPY_PYTHON) {
        return Ok(python);
    }
    let there: Vec<String> = found.iter().map(|(name, version)| format!("{name} is {version}")).collect();
    let there = if there.is_empty() { "there is no Python".to_owned() } else { there.join(", ") };
    Err(hinted(
        format!("Blender's module {BPY_VERSION} needs Python {BPY_PYTHON}: {there}"),
        Some(format!(
            "install Python {BPY_PYTHON} so that `python{BPY_PYTHON}` is on PATH and run `harmony setup --blender` \
             again, {OTHERWISE}"
        )),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::Hinted;

    #[test]
    fn only_the_python_that_the_module_is_made_for_is_taken() {
        let found = |versions: &[(&'static str, &str)]| {
            versions.iter().map(|(name, version)| (*name, (*version).to_owned())).collect::<Vec<_>>()
        };
        assert_eq!(chosen(&found(&[("python3", "3.12"), ("python", "3.11")])).unwrap(), "python");
        let wrong = chosen(&found(&[("python3", "3.13")])).unwrap_err();
        assert!(wrong.to_string().ends_with("needs Python 3.11: python3 is 3.13"), "{wrong}");
        assert!(wrong.downcast_ref::<Hinted>().unwrap().hint.contains("install Python 3.11"));
        assert!(chosen(&[]).unwrap_err().to_string().ends_with("there is no Python"));
    }

    #[test]
    fn the_version_is_that_of_the_judges() {
        let script = include_str!("../../../../tools/setup.sh");
        assert!(script.contains(&format!("bpy_version={BPY_VERSION}\n")));
    }
}
