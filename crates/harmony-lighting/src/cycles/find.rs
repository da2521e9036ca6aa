//! Finding a Blender.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A python that can `import bpy`, before all other places.
pub(crate) const ENV_PYTHON: &str = "HARMONY_BPY_PYTHON";
/// Blender's module that `harmony setup --blender` and `tools/setup.sh` install, and the only Python that it is made for.
pub const BPY_VERSION: &str = "5.0.1";
/// Major and minor number.
pub const BPY_PYTHON: &str = "3.11";
/// Oldest version whose Principled shader and glTF importer the script knows.
const OLDEST: (u32, u32) = (4, 2);
/// A cold start from a slow disk takes some seconds; a program that asks questions never ends.
const PROBE_LIMIT: Duration = Duration::from_mins(1);

/// In which shape Blender is here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlenderKind {
    /// A python interpreter with the `bpy` module.
    Module,
    /// The `blender` program.
    Program,
}

/// A Blender that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CyclesRenderer {
    pub(crate) program: PathBuf,
    pub(crate) kind: BlenderKind,
    pub(crate) version: String,
}

/// Folder of the virtual environment in which Blender's module is looked for.
pub fn bpy_folder() -> PathBuf {
    let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let cache = set("HARMONY_CACHE").or_else(|| set("HOME").map(|home| home.join(".cache").join("harmony")));
    cache.unwrap_or_else(|| PathBuf::from(".harmony")).join("bpy")
}

/// The interpreter of a virtual environment.
pub fn python_of(venv: &Path) -> PathBuf {
    if cfg!(windows) { venv.join("Scripts").join("python.exe") } else { venv.join("bin").join("python") }
}

impl CyclesRenderer {
    /// Looks for Blender: `HARMONY_BPY_PYTHON`, the cache's virtual environment, `python3`, then `blender` on PATH.
    ///
    /// A candidate counts when it starts and names a version from 4.2 on. Takes a second or two: call it once.
    pub fn find() -> Option<Self> {
        Self::find_saying_why().0
    }

    /// As [`Self::find`], with one sentence for each candidate that was there and did not do.
    pub fn find_saying_why() -> (Option<Self>, Vec<String>) {
        let mut candidates: Vec<(PathBuf, BlenderKind)> = Vec::new();
        if let Some(python) = std::env::var_os(ENV_PYTHON).filter(|v| !v.is_empty()) {
            candidates.push((PathBuf::from(python), BlenderKind::Module));
        }
        let venv = python_of(&bpy_folder());
        if venv.exists() {
            candidates.push((venv, BlenderKind::Module));
        }
        candidates.push((PathBuf::from("python3"), BlenderKind::Module));
        candidates.push((PathBuf::from("blender"), BlenderKind::Program));
        let mut why = Vec::new();
        for (program, kind) in candidates {
            match Self::probe(&program, kind) {
                Ok(found) => return (Some(found), why),
                Err(reason) => why.push(format!("{}: {reason}", program.display())),
            }
        }
        (None, why)
    }

    /// Checks one python interpreter or `blender` program.
    ///
    /// # Errors
    /// Why it does not do, in words.
    pub fn probe(program: &Path, kind: BlenderKind) -> Result<Self, String> {
        let mut command = Command::new(program);
        match kind {
            BlenderKind::Module => command.args(["-c", "import bpy; print('Blender', bpy.app.version_string)"]),
            BlenderKind::Program => command.arg("--version"),
        };
        let said = output_of(command)?;
        let version = said
            .lines()
            .find_map(|l| l.trim().strip_prefix("Blender "))
            .and_then(|l| l.split_whitespace().next())
            .ok_or("it names no version")?;
        let mut numbers = version.split('.').map(|n| n.parse::<u32>().unwrap_or(0));
        let have = (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0));
        if have < OLDEST {
            return Err(format!("Blender {version} is older than {}.{}", OLDEST.0, OLDEST.1));
        }
        Ok(Self { program: program.to_owned(), kind, version: version.to_owned() })
    }

    /// Its version, such as `5.0.1`.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// Module or program.
    pub fn kind(&self) -> BlenderKind {
        self.kind
    }
}

/// Standard output of a short command.
fn output_of(mut command: Command) -> Result<String, String> {
    let spawned = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    let mut child = spawned.map_err(|e| format!("does not start: {e}"))?;
    let started = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if started.elapsed() < PROBE_LIMIT => std::thread::sleep(Duration::from_millis(20)),
            Ok(None) => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!("no answer within {PROBE_LIMIT:?}"));
            }
            Err(e) => return Err(format!("cannot be waited for: {e}")),
        }
    };
    if !status.success() {
        return Err("it starts, but there is no bpy in it".to_owned());
    }
    let output = child.wait_with_output().map_err(|e| format!("cannot be read: {e}"))?;
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_blender_is_told_apart() {
        let missing = CyclesRenderer::probe(Path::new("no-such-program-here"), BlenderKind::Program);
        assert!(missing.unwrap_err().contains("does not start"));
        let other = CyclesRenderer::probe(Path::new("true"), BlenderKind::Program);
        assert!(other.unwrap_err().contains("no version"));
    }
}
